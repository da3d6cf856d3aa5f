//! Starts of a search: random attitudes, and structured sets in random orientation and order.

use std::f64::consts::TAU;

use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};
use rand::seq::SliceRandom;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::fit::{LeastTime, brought_within};
use super::plan::Plan;
use super::problem::SearchProblem;
use super::still::still;
use crate::attitude::{Attitude, Position};
use crate::error::Result;
use crate::evaluate::Evaluator;
use crate::motion::{
    Place, Test, Timeline, clear_way, equivalent_positions, gimbal_change, quickest_positions,
};
use crate::platform::Platform;
use crate::schedule::standard::StandardScheme;

/// How many positions the starts have, in turn. The allocation removes what does not pay, so
/// that these are upper ends, not choices; the last gives way to the most positions allowed.
const COUNTS: [usize; 6] = [12, 14, 10, 16, 12, 20];
/// A start has no more positions than this, however many are allowed.
const LARGEST_START: usize = 40;

/// The starts of `problem`: start k depends on the seed and k only.
///
/// # Errors
///
/// [`Error::is_infeasible`](crate::Error::is_infeasible) when not even staying where the platform
/// stands fits into the time, which is the least that any schedule takes.
pub fn starts(evaluator: &Evaluator, problem: &SearchProblem) -> Result<Vec<Plan>> {
    starts_while(evaluator, problem, &|| true)
}

/// The same as long as `go_on` says so, but at least one.
pub(super) fn starts_while(
    evaluator: &Evaluator,
    problem: &SearchProblem,
    go_on: &dyn Fn() -> bool,
) -> Result<Vec<Plan>> {
    let test = evaluator.test();
    LeastTime::of(test).check(problem.total_time_s)?;
    let mut starts: Vec<Plan> = (0..problem.starts.max(1))
        .take_while(|k| *k == 0 || go_on())
        .filter_map(|k| start(test, problem, k))
        .collect();
    // Staying is always possible, however little time there is for moves.
    if test.standing().is_some() && test.platform().motion().slew.is_some() {
        let stay = still(test);
        starts.extend(stay.and_then(|stay| stay.fitted(test, problem.total_time_s)));
    }
    // The standard schemes too, so that no recommendation is worse than they are.
    starts.extend(standard_starts(test, problem));
    match &problem.from {
        Some(from) if from.pinned().next().is_some() => Ok(starts
            .iter()
            .filter_map(|start| from.among(test, problem, start))
            .collect()),
        _ => Ok(starts),
    }
}

/// The standard schemes that the platform can take in the time, within the most positions.
fn standard_starts(test: &Test, problem: &SearchProblem) -> Vec<Plan> {
    StandardScheme::ALL
        .into_iter()
        .map(|scheme| scheme.positions_on(test.platform()))
        .filter(|positions| positions.len() <= problem.max_positions)
        .filter(|positions| {
            positions
                .iter()
                .all(|p| within_ranges(test.platform(), *p).is_some())
        })
        .filter_map(|positions| {
            let quickest = quickest_positions(test, &positions);
            let angles: Vec<[f64; 3]> = quickest.into_iter().map(Position::to_array).collect();
            let dwell_s = vec![problem.total_time_s; angles.len()];
            Plan::new(angles, dwell_s).fitted(test, problem.total_time_s)
        })
        .collect()
}

fn start(test: &Test, problem: &SearchProblem, k: usize) -> Option<Plan> {
    let platform = test.platform();
    let mut random = ChaCha8Rng::seed_from_u64(problem.seed);
    random.set_stream(k as u64);
    let most = problem.max_positions.clamp(1, LARGEST_START);
    let count = match k % COUNTS.len() {
        5 => most.max(COUNTS[5]),
        turn => COUNTS[turn],
    };
    let count = count.min(most);
    let mut positions = match k % 4 {
        3 => icosahedral(platform, count, &mut random),
        _ => (0..count)
            .map(|_| random_position(platform, &mut random))
            .collect(),
    };
    // With moves that take time, every second start is put into an order of short moves.
    if platform.motion().slew.is_some() && k % 2 == 1 {
        order_by_nearest(platform, &mut positions);
    }
    if platform.obstacles().stop_moves() {
        positions = passable(test, positions, &mut random);
    }
    if positions.is_empty() {
        return None;
    }
    positions = quickest_positions(test, &positions);
    let whole = Plan::new(
        positions.iter().map(|p| p.to_array()).collect(),
        vec![problem.total_time_s; positions.len()],
    );
    // A little spare time, so that the first steps have room.
    let with_room = |plan: Plan| plan.fitted(test, 0.95 * problem.total_time_s);
    let full = |plan: Plan| plan.fitted(test, problem.total_time_s);
    let first_ones = |count: usize| {
        Plan::new(
            whole.angles[..count].to_vec(),
            whole.dwell_s[..count].to_vec(),
        )
    };
    // Where the time is too short for so many positions so far apart, every second start has fewer
    // of them and the others have them nearer to each other.
    let fewest = if k % 2 == 1 { positions.len() } else { 1 };
    (fewest..=positions.len())
        .rev()
        .find_map(|count| with_room(first_ones(count)))
        .or_else(|| brought_within(test, &whole, with_room))
        .or_else(|| brought_within(test, &whole, full))
}

/// Positions that can be driven to one after the other, where something stands in the gimbals' way: one
/// that cannot is exchanged for another, or left out.
fn passable(test: &Test, positions: Vec<Position>, random: &mut ChaCha8Rng) -> Vec<Position> {
    let platform = test.platform();
    let mut net = Timeline::wound_before(test);
    let mut from = test.standing();
    let mut kept = Vec::with_capacity(positions.len());
    for wanted in positions {
        let mut others = (0..ATTEMPTS).map(|_| random_position(platform, random));
        let mut reach = |to: Position| {
            if !platform.obstacles().allow(to.nano()) {
                return None;
            }
            let Some(from) = from else {
                return Some((to, net));
            };
            // By whichever triple there is a way to.
            equivalent_positions(platform, to)
                .into_iter()
                .find_map(|to| {
                    let way = clear_way(
                        platform,
                        &Place::new(from),
                        &Place::new(to),
                        None,
                        Some(net),
                    )?;
                    Some((to, std::array::from_fn(|axis| net[axis] + way[axis].nano)))
                })
        };
        if let Some((to, wound)) = reach(wanted).or_else(|| others.find_map(&mut reach)) {
            kept.push(to);
            from = Some(to);
            net = wound;
        }
    }
    kept
}

/// A rotation drawn from the uniform (Haar) distribution: a normalised quaternion of normals.
fn random_rotation(random: &mut impl Rng) -> Rotation3<f64> {
    // Marsaglia's method for a uniform point on the 3-sphere, from pairs in the unit disc.
    let mut disc = || {
        loop {
            let x: f64 = random.random_range(-1.0..1.0);
            let y: f64 = random.random_range(-1.0..1.0);
            let s = x * x + y * y;
            if s < 1.0 && s > 0.0 {
                return (x, y, s);
            }
        }
    };
    let (x, y, s1) = disc();
    let (z, w, s2) = disc();
    let scale = ((1.0 - s1) / s2).sqrt();
    let quaternion = Quaternion::new(w * scale, x, y, z * scale);
    UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix()
}

/// How often a uniform attitude is drawn before a limited platform gets uniform angles instead.
const ATTEMPTS: usize = 50;

/// A position within the gimbals' ranges: of a uniform attitude if one can be had.
pub(super) fn random_position(platform: &Platform, random: &mut impl Rng) -> Position {
    for _ in 0..ATTEMPTS {
        let attitude = Attitude::from_rotation(random_rotation(random));
        if let Some(position) = within_ranges(platform, platform.stand().position(&attitude)) {
            return position;
        }
    }
    let mut anywhere = || {
        Position::from_array(std::array::from_fn(|axis| {
            match platform.gimbals().ranges[axis] {
                Some(r) => r.low_rad + (r.high_rad - r.low_rad) * random.random_range(0.0..1.0),
                None => random.random_range(-TAU / 2.0..TAU / 2.0),
            }
        }))
    };
    let mut position = anywhere();
    if let Some(listed) = platform.obstacles().allowed() {
        return listed[random.random_range(0..listed.len())];
    }
    if platform.obstacles().stop_moves() {
        for _ in 0..ATTEMPTS {
            if platform.obstacles().at(position.nano()).is_none() {
                break;
            }
            position = anywhere();
        }
    }
    position
}

/// The first triple of the same attitude that the platform can take.
pub fn within_ranges(platform: &Platform, position: Position) -> Option<Position> {
    equivalent_positions(platform, position).into_iter().next()
}

/// Gravity along the twelve directions of a randomly turned icosahedron, each at a random
/// heading, in random order; the rest, if any, random. The icosahedron is A- and D-optimal for
/// the order-1 levelling problem.
fn icosahedral(platform: &Platform, count: usize, random: &mut ChaCha8Rng) -> Vec<Position> {
    let turn = random_rotation(random);
    let golden = 0.5 * (1.0 + 5.0_f64.sqrt());
    let mut positions = Vec::with_capacity(12);
    for (i, j) in [(0, 1), (1, 2), (2, 0)] {
        for (si, sj) in [
            (1.0, golden),
            (1.0, -golden),
            (-1.0, golden),
            (-1.0, -golden),
        ] {
            let mut direction = Vector3::zeros();
            direction[i] = si;
            direction[j] = sj;
            let heading = random.random_range(0.0..TAU);
            let position = Attitude::with_gravity_along(turn * direction, heading)
                .and_then(|attitude| within_ranges(platform, platform.stand().position(&attitude)));
            positions.push(position.unwrap_or_else(|| random_position(platform, random)));
        }
    }
    positions.shuffle(random);
    positions.truncate(count);
    while positions.len() < count {
        positions.push(random_position(platform, random));
    }
    positions
}

/// Orders positions by always driving to the nearest one next.
fn order_by_nearest(platform: &Platform, positions: &mut [Position]) {
    let distance = |from: Position, to: Position| {
        let change = gimbal_change(platform, from, to);
        change.iter().fold(0.0_f64, |max, c| max.max(c.abs()))
    };
    for next in 1..positions.len() {
        let here = positions[next - 1];
        let nearest = (next..positions.len())
            .min_by(|&a, &b| distance(here, positions[a]).total_cmp(&distance(here, positions[b])));
        if let Some(nearest) = nearest {
            positions.swap(next, nearest);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Timeline;
    use crate::testing::evaluator;

    #[test]
    fn starts_are_within_limits_and_time() {
        let evaluator = evaluator(|c| {
            c.gimbals.alpha_deg = Some([-100.0, 120.0]);
            c.gimbals.beta_deg = Some([-60.0, 60.0]);
            c.motion.slew_rate_deg_per_s = Some(0.3.into());
            c.motion.settle_s = 30.0;
        });
        let problem = SearchProblem {
            total_time_s: 4000.0,
            ..SearchProblem::default()
        };
        for plan in starts(&evaluator, &problem).unwrap() {
            let schedule = plan.to_schedule(evaluator.test()).unwrap();
            let timeline = Timeline::new(evaluator.test(), &schedule).unwrap();
            assert!(timeline.total_time_s() <= 4000.0 + 1e-6);
            assert!(plan.dwell_s.iter().all(|d| *d >= 60.0));
        }
    }

    #[test]
    fn a_start_depends_on_seed_and_number_only() {
        let evaluator = evaluator(|_| {});
        let few = SearchProblem {
            starts: 3,
            ..SearchProblem::default()
        };
        let many = SearchProblem {
            starts: 9,
            ..SearchProblem::default()
        };
        let (few, many) = (
            starts(&evaluator, &few).unwrap(),
            starts(&evaluator, &many).unwrap(),
        );
        assert_eq!(few[..3], many[..3]);
        assert_ne!(many[0], many[1]);
        let other = SearchProblem {
            seed: 2,
            starts: 1,
            ..SearchProblem::default()
        };
        assert_ne!(starts(&evaluator, &other).unwrap()[0], many[0]);
    }

    #[test]
    fn random_rotations_are_uniform() {
        // For Haar measure every entry has mean 0 and variance 1/3.
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let count = 20_000;
        let (mut mean, mut square) = (nalgebra::Matrix3::zeros(), nalgebra::Matrix3::zeros());
        for _ in 0..count {
            let r = random_rotation(&mut random).into_inner();
            mean += r / f64::from(count);
            square += r.component_mul(&r) / f64::from(count);
        }
        assert!(mean.amax() < 5.0 * (1.0 / 3.0 / f64::from(count)).sqrt());
        assert!((square - nalgebra::Matrix3::repeat(1.0 / 3.0)).amax() < 0.011);
    }

    #[test]
    fn both_triples_of_an_attitude_are_tried() {
        let evaluator = evaluator(|c| c.gimbals.alpha_deg = Some([100.0, 200.0]));
        let position = Position::from_deg(-20.0, 10.0, 30.0);
        let found = within_ranges(evaluator.test().platform(), position).unwrap();
        let difference = found.attitude().matrix() - position.attitude().matrix();
        assert!(difference.amax() < 1e-14);
        assert!((found.to_deg()[0] - 160.0).abs() < 1e-9);
        let narrow = self::evaluator(|c| c.gimbals.alpha_deg = Some([10.0, 20.0]));
        assert!(within_ranges(narrow.test().platform(), position).is_none());
    }

    #[test]
    fn too_short_a_test_is_infeasible() {
        let evaluator = evaluator(|_| {});
        let problem = SearchProblem {
            total_time_s: 30.0,
            ..SearchProblem::default()
        };
        assert!(starts(&evaluator, &problem).unwrap_err().is_infeasible());
    }
}
