//! The Euler triples of one attitude, and the ones that make a sequence of positions quickest.
//!
//! (α, β, γ) and (α + 180°, 180° − β, γ + 180°) are the same attitude, whole turns make no
//! difference, and at β = ±90° only α ∓ γ counts. (Where the inner axis stands along the outer one, a
//! proper Euler sequence, (α + 180°, −β, γ + 180°), and at β = 0 and 180°; see [`crate::attitude`].)
//! Which of them the gimbals take decides how far
//! they have to turn from one position to the next.

use super::clear::{clear_way, in_units, length};
use super::{Place, Test, way_between};
use crate::attitude::{Degrees, NanoDegrees, Position, Stand};
use crate::platform::Platform;

/// Whole turns that a limited axis is tried at, beside the angle given.
const TURNS: [i64; 3] = [0, 1, -1];

/// The triples of the attitude of `position` that the platform can take, the position itself
/// first if it is one of them. On limited axes angles up to one turn away are tried, or the
/// lowest within the range; in gimbal lock four values of α.
///
/// ```
/// use scheme_opt::internals::attitude::Position;
/// use scheme_opt::internals::motion::equivalent_positions;
/// use scheme_opt::internals::platform::PlatformConfig;
/// let platform = PlatformConfig::default().check()?;
/// let all = equivalent_positions(&platform, Position::from_deg(10.0, 20.0, 30.0));
/// assert_eq!(all.len(), 2);
/// assert!((all[1].to_deg()[1] - 160.0).abs() < 1e-9);
/// # Ok::<(), scheme_opt::Error>(())
/// ```
pub fn equivalent_positions(platform: &Platform, position: Position) -> Vec<Position> {
    let all = equivalent_places(platform, position).into_iter();
    all.map(|place| place.position).collect()
}

/// The same with their angles taken apart.
fn equivalent_places(platform: &Platform, position: Position) -> Vec<Place> {
    let obstacles = platform.obstacles();
    let nothing_in_the_way = obstacles.is_empty();
    let stand = platform.stand();
    let mut all: Vec<Place> = Vec::with_capacity(2);
    for angles in with_lock(stand, position) {
        for triple in [angles, stand.partner(angles)] {
            let axes = [0, 1, 2].map(|axis| settings(platform, axis, triple[axis]));
            for a in axes[0].iter() {
                for b in axes[1].iter() {
                    for g in axes[2].iter() {
                        let found = Place::new(Position::from_deg(a, b, g));
                        let is_new = all.iter().all(|known| known.nano() != found.nano());
                        if is_new && (nothing_in_the_way || obstacles.allow(found.nano())) {
                            all.push(found);
                        }
                    }
                }
            }
        }
    }
    all
}

/// The triple itself and, in gimbal lock, others of the same attitude: there C depends on α ∓ γ alone.
fn with_lock(stand: &Stand, position: Position) -> Vec<[Degrees; 3]> {
    let [a, b, g] = position.exact();
    let mut triples = vec![[a, b, g]];
    if let Some(sense) = stand.lock(b) {
        let (zero, quarter) = (NanoDegrees::default(), NanoDegrees::QUARTER_TURN);
        for alpha in [zero, quarter, NanoDegrees::HALF_TURN, -quarter] {
            let alpha = Degrees::from(alpha);
            let turned = if sense > 0.0 { alpha - a } else { a - alpha };
            triples.push([alpha, b, g + turned]);
        }
    }
    triples
}

/// A few angles of an axis, degrees.
#[derive(Default)]
struct Settings {
    deg: [f64; TURNS.len()],
    count: usize,
}

impl Settings {
    /// Those of `deg` that the axis can be set to.
    fn allowed(platform: &Platform, axis: usize, deg: &[f64]) -> Self {
        let mut settings = Self::default();
        for deg in deg {
            if platform.gimbals().allows(axis, *deg) {
                settings.deg[settings.count] = *deg;
                settings.count += 1;
            }
        }
        settings
    }

    fn iter(&self) -> impl Iterator<Item = f64> + '_ {
        self.deg[..self.count].iter().copied()
    }
}

/// The angles of an axis, degrees, that are the same direction as `angle` and can be set.
fn settings(platform: &Platform, axis: usize, angle: Degrees) -> Settings {
    let allowed = |deg: &[f64]| Settings::allowed(platform, axis, deg);
    let Some(range) = platform.gimbals().ranges[axis] else {
        return allowed(&[angle.wrapped().deg()]);
    };
    let turn = NanoDegrees::TURN.count();
    let by = |turns: i64| (angle + Degrees::from(NanoDegrees::new(turns * turn))).deg();
    let near = allowed(&TURNS.map(by));
    if near.count > 0 {
        return near;
    }
    // The fewest turns that lead to the lower end or beyond.
    let missing = (*range.ends().start() - angle.nano).count();
    let lowest = by(-(-missing).div_euclid(turn));
    allowed(&[lowest])
}

/// The same attitudes in the same order by the triples that take the gimbals least time, start
/// and return of the test included; the first of equally quick ones, and where moves take no
/// time the first that can be reached. Positions that the platform cannot take stay as they are.
///
/// Dynamic programming over the triples of each position.
pub fn quickest_positions(test: &Test, positions: &[Position]) -> Vec<Position> {
    quickest_positions_but(test, positions, &|_| false)
}

/// The same, those that are `held` staying as they are.
pub(crate) fn quickest_positions_but(
    test: &Test,
    positions: &[Position],
    held: &dyn Fn(usize) -> bool,
) -> Vec<Position> {
    let platform = test.platform();
    if platform.motion().slew.is_none() {
        let first = |(k, p): (usize, &Position)| {
            let reachable = equivalent_positions(platform, *p).into_iter().next();
            reachable.filter(|_| !held(k)).unwrap_or(*p)
        };
        return positions.iter().enumerate().map(first).collect();
    }
    if positions.is_empty() {
        return Vec::new();
    }
    let options: Vec<Vec<Place>> = positions
        .iter()
        .enumerate()
        .map(|(k, p)| {
            let all = equivalent_places(platform, *p);
            if all.is_empty() || held(k) {
                vec![Place::new(*p)]
            } else {
                all
            }
        })
        .collect();
    let start = test.standing().map(Place::new);
    let back = platform.motion().return_to_start;
    match (start, back) {
        // A return to the first position: each of its triples is a problem of its own.
        (None, true) => {
            let ways = options[0].iter().map(|first| {
                let fixed = [&[vec![*first]], &options[1..]].concat();
                quickest(platform, &fixed, None, Some(*first))
            });
            let best = ways.reduce(|best, way| if way.0 < best.0 { way } else { best });
            best.map_or_else(|| positions.to_vec(), |(_, way)| way)
        }
        _ => {
            let home = test.home().filter(|_| back).map(Place::new);
            quickest(platform, &options, start, home).1
        }
    }
}

/// Longer than any way: where there is none.
const NO_WAY: i64 = 1_000_000_000_000_000;

/// How long the way is, see [`length`].
fn distance(platform: &Platform, from: &Place, to: &Place) -> i64 {
    if platform.obstacles().stop_moves() {
        let way = clear_way(platform, from, to, None, None);
        return way.map_or(NO_WAY, |way| length(platform, &way));
    }
    length(
        platform,
        &way_between(platform, from.angles, to.angles, None),
    )
}

/// The same in rad or s, units of [`super::unit_s`].
pub(crate) fn way_length(platform: &Platform, from: Position, to: Position) -> f64 {
    let length = distance(platform, &Place::new(from), &Place::new(to));
    in_units(platform, length)
}

/// The cheapest way through one option each, with its cost.
fn quickest(
    platform: &Platform,
    options: &[Vec<Place>],
    start: Option<Place>,
    back: Option<Place>,
) -> (i64, Vec<Position>) {
    let mut cost: Vec<i64> = options[0]
        .iter()
        .map(|p| start.map_or(0, |s| distance(platform, &s, p)))
        .collect();
    let mut came_from: Vec<Vec<usize>> = Vec::with_capacity(options.len());
    for pair in options.windows(2) {
        let mut next = Vec::with_capacity(pair[1].len());
        let mut from = Vec::with_capacity(pair[1].len());
        for p in &pair[1] {
            let ways = pair[0].iter().zip(&cost).enumerate();
            let ways = ways.map(|(i, (before, cost))| (cost + distance(platform, before, p), i));
            let (least, i) = cheapest(ways);
            next.push(least);
            from.push(i);
        }
        cost = next;
        came_from.push(from);
    }
    let last = &options[options.len() - 1];
    let ends = last.iter().zip(&cost).enumerate().map(|(i, (p, cost))| {
        let home = back.map_or(0, |b| distance(platform, p, &b));
        (cost + home, i)
    });
    let (total, mut chosen) = cheapest(ends);
    let mut way = vec![last[chosen].position];
    for (from, before) in came_from.iter().zip(options).rev() {
        chosen = from[chosen];
        way.push(before[chosen].position);
    }
    way.reverse();
    (total, way)
}

/// The least cost and its index; the first of equal ones.
fn cheapest(ways: impl Iterator<Item = (i64, usize)>) -> (i64, usize) {
    ways.fold(
        (i64::MAX, 0),
        |best, way| {
            if way.0 < best.0 { way } else { best }
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::PlatformConfig;

    fn platform(change: impl FnOnce(&mut PlatformConfig)) -> Platform {
        let mut config = PlatformConfig::default();
        config.motion.slew_rate_deg_per_s = Some(1.0.into());
        change(&mut config);
        config.check().unwrap()
    }

    #[test]
    fn all_triples_are_the_same_attitude_and_allowed() {
        let limited = platform(|c| {
            c.gimbals.alpha_deg = Some([-300.0, 300.0]);
            c.gimbals.beta_deg = Some([-100.0, 100.0]);
        });
        for angles in [
            [10.0, 20.0, 30.0],
            [170.0, -80.0, -150.0],
            [40.0, 90.0, 10.0],
            [40.0, -90.0, 10.0],
            [200.0, 260.0, 10.0],
        ] {
            let p = Position::from_deg(angles[0], angles[1], angles[2]);
            for platform in [&platform(|_| {}), &limited] {
                let all = equivalent_positions(platform, p);
                assert!(!all.is_empty(), "{angles:?}");
                for found in all {
                    let difference = found.attitude().matrix() - p.attitude().matrix();
                    assert!(difference.amax() < 1e-15, "{angles:?} {found:?}");
                    assert_eq!(found.attitude_key(), p.attitude_key());
                    for (axis, angle) in found.degrees().into_iter().enumerate() {
                        assert_eq!(platform.gimbals().refusal(axis, angle), None);
                    }
                }
            }
        }
        // α at two turns, β one way only.
        let p = Position::from_deg(100.0, 20.0, 30.0);
        assert_eq!(equivalent_positions(&limited, p).len(), 2);
        let narrow = platform(|c| c.gimbals.alpha_deg = Some([40.0, 50.0]));
        assert!(equivalent_positions(&narrow, p).is_empty());
        let table = platform(|c| c.gimbals.step_deg = Some(40.0));
        let on_table = Position::from_deg(40.0, 80.0, 120.0);
        assert_eq!(equivalent_positions(&table, on_table).len(), 1);
    }

    #[test]
    fn the_quickest_way_is_that_of_trying_all() {
        for (start_deg, return_to_start) in
            [(None, false), (None, true), (Some([5.0, 0.0, 90.0]), true)]
        {
            let platform = platform(|c| {
                c.motion.start_deg = start_deg;
                c.motion.return_to_start = return_to_start;
                c.gimbals.gamma_deg = Some([-270.0, 270.0]);
            });
            let astray = [
                [10.0, 70.0, -160.0],
                [170.0, 100.0, 20.0],
                [-60.0, 85.0, 200.0],
                [120.0, -95.0, -20.0],
            ]
            .map(|a| Position::from_deg(a[0], a[1], a[2]));
            let [least, as_given] = check_quickest(&platform, &astray);
            assert!(least < as_given - 6_000_000_000);
            let fraction = |i: usize, k: f64| (0.3 + i as f64 * k).fract();
            for case in 0..20 {
                let positions: Vec<Position> = (0..4)
                    .map(|i| {
                        let n = 4 * case + i;
                        let angle = |k: f64, range: f64| range * (2.0 * fraction(n, k) - 1.0);
                        let [alpha, gamma] = [0.618_034, 0.754_878].map(|k| angle(k, 180.0));
                        Position::from_deg(alpha, angle(0.569_840, 130.0), gamma)
                    })
                    .collect();
                check_quickest(&platform, &positions);
            }
        }
    }

    /// The least length of all ways, which is that of the way found, and the length as given.
    fn check_quickest(platform: &Platform, positions: &[Position]) -> [i64; 2] {
        let motion = platform.motion();
        let length = |way: &[Position]| {
            let mut stops = way.to_vec();
            if motion.return_to_start {
                stops.push(motion.start.unwrap_or(way[0]));
            }
            if let Some(home) = motion.start {
                stops.insert(0, home);
            }
            let moves = stops
                .windows(2)
                .map(|w| distance(platform, &Place::new(w[0]), &Place::new(w[1])));
            moves.sum::<i64>()
        };
        let mut ways: Vec<Vec<Position>> = vec![Vec::new()];
        for p in positions {
            let options = equivalent_positions(platform, *p);
            assert!(options.len() > 1);
            ways = ways
                .iter()
                .flat_map(|w| options.iter().map(|o| [w.as_slice(), &[*o]].concat()))
                .collect();
        }
        let least = ways.iter().map(|w| length(w)).min().unwrap();
        let found = quickest_positions(&platform.clone().into(), positions);
        assert_eq!(length(&found), least);
        [least, length(positions)]
    }

    #[test]
    fn in_gimbal_lock_only_the_sum_or_difference_of_two_angles_counts() {
        let free = platform(|_| {});
        for (beta, sign) in [(90.0, 1.0), (-90.0, -1.0)] {
            // The same attitude with α anywhere: no axis has to turn.
            let there = Position::from_deg(40.0, beta, 10.0);
            let same = Position::from_deg(0.0, beta, 10.0 - sign * 40.0);
            let way = quickest_positions(&free.clone().into(), &[same, there]);
            assert_eq!(
                distance(&free, &Place::new(way[0]), &Place::new(way[1])),
                0,
                "{way:?}"
            );
        }
        // Beside it all three count.
        let beside = Position::from_deg(40.0, 89.0, 10.0);
        assert_eq!(equivalent_positions(&free, beside).len(), 2);
    }

    #[test]
    fn limited_axes_are_set_by_whole_turns() {
        let wide = platform(|c| c.gimbals.alpha_deg = Some([-400.0, 400.0]));
        let angles = |p: Position| {
            let all = equivalent_positions(&wide, p).into_iter();
            let mut alphas: Vec<f64> = all.map(|p| p.to_deg()[0].round()).collect();
            alphas.sort_by(f64::total_cmp);
            alphas
        };
        // α and α + 180°, each a turn on and a turn back as far as the range goes.
        let all = angles(Position::from_deg(30.0, 20.0, 0.0));
        assert_eq!(all, [-330.0, -150.0, 30.0, 210.0, 390.0]);
        // Far outside, the lowest setting.
        let far = angles(Position::from_deg(30.0 + 1800.0, 20.0, 0.0));
        assert_eq!(far, [-330.0, -150.0]);
    }

    #[test]
    fn without_a_slew_rate_nothing_changes() {
        let free = PlatformConfig::default().check().unwrap();
        let positions = [Position::from_deg(0.0, 170.0, 0.0)];
        assert_eq!(
            quickest_positions(&free.clone().into(), &positions),
            positions
        );
    }
}
