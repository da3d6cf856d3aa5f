//! The free variables behind a plan.
//!
//! A `Plan` is angles and dwells within limits. An optimiser without constraints moves
//! [`Variables`] instead: an unlimited gimbal's angle is its own variable, a limited one is
//! `middle + half range · sin u`; the dwells share what moves, settles and minimum dwells leave
//! of the total time in the proportions `softmax(z)`. So every point is within the limits and
//! takes exactly the total time, and the exact gradient is pulled back through the same map.
//! The whole turns of every way stay as they are while the variables move (`super::ways`).

use std::f64::consts::TAU;

use super::plan::{Pin, Plan};
use crate::attitude::Position;
use crate::covariance::gradient::LegGradient;
use crate::motion::{Test, Timeline};
use crate::platform::{GimbalRange, Platform};
use crate::units::RAD_PER_DEG;

/// Free variables behind a timeline.
pub(crate) trait Coordinates {
    /// The timeline of `x`; none where there is none.
    fn timeline(&self, x: &[f64]) -> Option<Timeline>;
    /// The gradient with respect to `x` from that of the timeline.
    fn pull_back(&self, x: &[f64], timeline: &Timeline, legs: &[LegGradient]) -> Vec<f64>;
}

/// How one angle follows from its free variable.
#[derive(Debug, Clone, Copy)]
pub(super) enum AngleMap {
    Free,
    Limited { middle: f64, half: f64 },
}

impl AngleMap {
    pub fn new(range: Option<GimbalRange>) -> Self {
        match range {
            None => Self::Free,
            Some(r) => Self::Limited {
                middle: 0.5 * (r.low_rad + r.high_rad),
                half: 0.5 * (r.high_rad - r.low_rad),
            },
        }
    }

    pub fn angle(self, u: f64) -> f64 {
        match self {
            Self::Free => u,
            Self::Limited { middle, half } => middle + half * libm::sin(u),
        }
    }

    pub fn slope(self, u: f64) -> f64 {
        match self {
            Self::Free => 1.0,
            Self::Limited { half, .. } => half * libm::cos(u),
        }
    }

    pub fn variable(self, angle: f64) -> f64 {
        match self {
            Self::Free => angle,
            // Not quite to the end of the range: the slope is zero there and would hold it.
            Self::Limited { middle, half } if half > 0.0 => {
                libm::asin(((angle - middle) / half).clamp(-0.9999, 0.9999))
            }
            Self::Limited { .. } => 0.0,
        }
    }
}

/// The map between free variables (four per position: u_α, u_β, u_γ, z) and plans.
#[derive(Debug, Clone)]
pub struct Variables<'a> {
    test: &'a Test,
    maps: [AngleMap; 3],
    /// What angles each position has room for, where something stands in the gimbals' way; empty:
    /// `maps` is for all.
    rooms: Vec<[AngleMap; 3]>,
    total_time_s: f64,
    /// Dwells that stay as they are; none: dwells vary too.
    fixed_dwell_s: Option<Vec<f64>>,
    /// Positions that keep their angles, and those with the turns that the ways give them; empty
    /// where none does.
    held: Vec<Option<(Pin, [f64; 3])>>,
}

/// Free variables per position.
const PER_POSITION: usize = 4;

impl<'a> Variables<'a> {
    /// Angles and dwells vary; the plan always takes `total_time_s`.
    pub fn angles_and_dwells(test: &'a Test, total_time_s: f64) -> Self {
        Self {
            test,
            maps: test.platform().gimbals().ranges.map(AngleMap::new),
            rooms: Vec::new(),
            total_time_s,
            fixed_dwell_s: None,
            held: Vec::new(),
        }
    }

    /// The same for `plan`. Its positions that keep their angles stay where they are; and where something
    /// stands in the gimbals' way each position keeps to the side of it that it is on, so that no step of
    /// an optimiser leads into it. Moves are not held by that; a point at which one is stopped has no
    /// timeline.
    pub(super) fn of(&self, plan: &Plan) -> Self {
        let mut variables = self.clone();
        let platform = self.test.platform();
        let stopped = platform.obstacles().stop_moves();
        if !plan.holds_any() && !stopped {
            return variables;
        }
        let unwound = plan.unwound(self.test);
        if stopped {
            let rooms = unwound.iter().map(|angles| room(platform, *angles));
            variables.rooms = rooms.collect();
        }
        if plan.holds_any() {
            let held = plan.pins.iter().zip(unwound);
            variables.held = held.map(|(pin, at)| Some(((*pin)?, at))).collect();
        }
        variables
    }

    /// How the angles of position `k` follow from their variables.
    fn maps_of(&self, k: usize) -> &[AngleMap; 3] {
        self.rooms.get(k).unwrap_or(&self.maps)
    }

    /// The plan of angles that are not wrapped.
    fn plan(&self, mut angles: Vec<[f64; 3]>, dwell_s: Vec<f64>) -> Plan {
        if self.held.is_empty() {
            return Plan::of_unwound(self.test, angles, dwell_s);
        }
        for (angles, held) in angles.iter_mut().zip(&self.held) {
            if let Some((_, at)) = held {
                *angles = *at;
            }
        }
        let pins = self.held.iter().map(|held| Some((*held)?.0)).collect();
        Plan::of_unwound(self.test, angles, dwell_s).holding(pins)
    }

    /// Only the angles vary; for platforms whose moves take no time of their own.
    pub fn angles_only(test: &'a Test, dwell_s: Vec<f64>) -> Self {
        Self {
            fixed_dwell_s: Some(dwell_s),
            ..Self::angles_and_dwells(test, f64::INFINITY)
        }
    }

    /// Total time of every plan, s.
    pub fn total_time_s(&self) -> f64 {
        self.total_time_s
    }

    /// The variables of `plan`.
    pub fn encode(&self, plan: &Plan) -> Vec<f64> {
        let min_dwell_s = self.test.platform().shortest_dwell_s();
        let mut x = Vec::with_capacity(PER_POSITION * plan.angles.len());
        let places = plan.unwound(self.test).into_iter().zip(&plan.dwell_s);
        for (k, (angles, dwell)) in places.enumerate() {
            for (map, angle) in self.maps_of(k).iter().zip(&angles) {
                x.push(map.variable(*angle));
            }
            // A dwell at the minimum has z = −∞; a period stands in for zero.
            let above = (dwell - min_dwell_s).max(0.1 * self.test.platform().period_s());
            x.push(libm::log(above));
        }
        x
    }

    /// The plan of `x`; none when its moves and settles leave no time for the minimum dwells.
    pub fn decode(&self, x: &[f64]) -> Option<Plan> {
        Some(self.decode_with_timeline(x)?.0)
    }

    /// The plan of `x` and its timeline, made once: what moves leave of the time is known from it.
    fn decode_with_timeline(&self, x: &[f64]) -> Option<(Plan, Timeline)> {
        let angles: Vec<[f64; 3]> = x
            .chunks_exact(PER_POSITION)
            .enumerate()
            .map(|(k, c)| {
                let maps = self.maps_of(k);
                std::array::from_fn(|i| maps[i].angle(c[i]))
            })
            .collect();
        if let Some(dwell_s) = &self.fixed_dwell_s {
            let plan = self.plan(angles, dwell_s.clone());
            let timeline = plan.timeline(self.test);
            let is_clear = timeline.is_clear(self.test.platform());
            return is_clear.then_some((plan, timeline));
        }
        let count = angles.len();
        let mut plan = self.plan(angles, vec![0.0; count]);
        let min_dwell_s = self.test.platform().shortest_dwell_s();
        let timeline = plan.timeline(self.test);
        if !timeline.is_clear(self.test.platform()) {
            return None;
        }
        let spare = self.total_time_s - timeline.overhead_s() - count as f64 * min_dwell_s;
        if spare.is_nan() || spare <= 0.0 {
            return None;
        }
        for (dwell, share) in plan.dwell_s.iter_mut().zip(shares(x, PER_POSITION)) {
            *dwell = min_dwell_s + spare * share;
        }
        let timeline = timeline.with_dwells(plan.dwell_s.iter().copied());
        Some((plan, timeline))
    }
}

impl Coordinates for Variables<'_> {
    fn timeline(&self, x: &[f64]) -> Option<Timeline> {
        Some(self.decode_with_timeline(x)?.1)
    }

    fn pull_back(&self, x: &[f64], timeline: &Timeline, legs: &[LegGradient]) -> Vec<f64> {
        let mut angles: Vec<[f64; 3]> = legs.iter().map(|l| l.angles).collect();
        let held = timeline.positions();
        let vary_dwells = self.fixed_dwell_s.is_none();
        let shares: Vec<f64> = shares(x, PER_POSITION).collect();
        // What one more second for all dwells together is worth.
        let mean_dwell: f64 = match vary_dwells {
            true => {
                let worth = legs[held.clone()].iter().map(|l| l.dwell_s);
                shares.iter().zip(worth).map(|(s, l)| s * l).sum()
            }
            false => 0.0,
        };
        let moves = 1..timeline.legs().len();
        add_move_times(
            self.test.platform(),
            timeline,
            legs,
            moves,
            mean_dwell,
            &mut angles,
        );
        add_return(timeline, &mut angles);
        let spare: f64 = match vary_dwells {
            true => {
                let min_dwell_s = self.test.platform().shortest_dwell_s();
                let dwells = timeline.position_legs().iter();
                dwells.map(|l| l.dwell_s - min_dwell_s).sum()
            }
            false => 0.0,
        };
        let mut gradient = Vec::with_capacity(x.len());
        for (k, c) in x.chunks_exact(PER_POSITION).enumerate() {
            let stays = self.held.get(k).is_some_and(Option::is_some);
            for i in 0..3 {
                gradient.push(match stays {
                    true => 0.0,
                    false => angles[held.start + k][i] * self.maps_of(k)[i].slope(c[i]),
                });
            }
            let dwell = legs[held.start + k].dwell_s;
            gradient.push(spare * shares[k] * (dwell - mean_dwell));
        }
        gradient
    }
}

/// The angles, rad, that each axis of a position can take without entering what stands in the way: a
/// window of at most a turn, within the range.
fn room(platform: &Platform, angles: [f64; 3]) -> [AngleMap; 3] {
    let exact = Position::from_array(angles);
    let gaps = platform.obstacles().room(exact.nano());
    std::array::from_fn(|axis| {
        let range = platform.gimbals().ranges[axis];
        let [down, up] = gaps[axis].map(|gap| gap.map(|gap| gap.deg() * RAD_PER_DEG));
        if down.is_none() && up.is_none() {
            return AngleMap::new(range);
        }
        // An unlimited axis has room on both sides or on none.
        let far = |end: Option<f64>, gap: Option<f64>| match (end, gap) {
            (Some(end), Some(gap)) => end.min(gap),
            (end, gap) => end.or(gap).unwrap_or(TAU),
        };
        let low = far(range.map(|r| (angles[axis] - r.low_rad).max(0.0)), down);
        let high = far(range.map(|r| (r.high_rad - angles[axis]).max(0.0)), up);
        AngleMap::new(Some(GimbalRange {
            low_rad: angles[axis] - low,
            high_rad: angles[axis] + high,
        }))
    })
}

/// The place a test returns to is its first position, where the platform has no start: what the
/// return is worth through its end belongs to that position.
pub(super) fn add_return(timeline: &Timeline, angles: &mut [[f64; 3]]) {
    let held = timeline.positions();
    if held.start > 0 || held.end == timeline.legs().len() {
        return;
    }
    let back = angles[held.end];
    for (first, back) in angles[0].iter_mut().zip(back) {
        *first += back;
    }
}

/// Adds what the `moves` to those legs are worth through their durations: each follows from the
/// axis that takes longest, and takes its time from the dwells, where a second is worth
/// `mean_dwell`.
pub(super) fn add_move_times(
    platform: &Platform,
    timeline: &Timeline,
    legs: &[LegGradient],
    moves: impl Iterator<Item = usize>,
    mean_dwell: f64,
    angles: &mut [[f64; 3]],
) {
    let Some(slew) = platform.motion().slew else {
        return;
    };
    for k in moves {
        let arrival = timeline.legs()[k].arrival;
        let Some(m) = arrival.filter(|m| m.duration_s > 0.0) else {
            continue;
        };
        let longer = slew.shortest_slope(&m.change);
        for (axis, longer) in longer.into_iter().enumerate() {
            let slope = longer * (legs[k].move_s - mean_dwell);
            angles[k][axis] += slope;
            angles[k - 1][axis] -= slope;
        }
    }
}

/// softmax(z), z the last of every `width` variables.
pub(super) fn shares(x: &[f64], width: usize) -> impl Iterator<Item = f64> + '_ {
    let z = move |c: &[f64]| c[width - 1];
    let top = x.chunks_exact(width).map(z).fold(f64::MIN, f64::max);
    let sum: f64 = x.chunks_exact(width).map(|c| libm::exp(z(c) - top)).sum();
    x.chunks_exact(width)
        .map(move |c| libm::exp(z(c) - top) / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Position;
    use crate::criterion::Smoothing;
    use crate::evaluate::{Evaluator, Objective};
    use crate::platform::PlatformConfig;
    use crate::testing::assert_gradient;

    fn sample_plan() -> Plan {
        let angles = (0..7).map(|k| {
            let k = f64::from(k);
            [1.3 * k - 4.0, (0.9 * k).sin() * 0.9, 2.0 - 0.7 * k]
        });
        let dwell_s = (0..7).map(|k| 400.0 + 50.0 * f64::from(k)).collect();
        Plan::new(angles.collect(), dwell_s)
    }

    fn evaluator(limited: bool) -> Evaluator {
        let mut config = PlatformConfig::default();
        config.motion.slew_rate_deg_per_s = Some(0.5.into());
        config.motion.settle_s = 20.0;
        config.motion.return_to_start = true;
        if limited {
            config.motion.start_deg = Some([10.0, -20.0, 30.0]);
            config.gimbals.alpha_deg = Some([-300.0, 300.0]);
            config.gimbals.beta_deg = Some([-60.0, 60.0]);
        }
        Evaluator::new(config.check().unwrap(), Objective::default())
    }

    #[test]
    fn every_point_is_within_the_limits_and_takes_the_total_time() {
        let evaluator = evaluator(true);
        let variables = Variables::angles_and_dwells(evaluator.test(), 9000.0);
        let mut x = variables.encode(&sample_plan());
        for (i, v) in x.iter_mut().enumerate() {
            *v += (3.0 * i as f64).sin() * 0.2;
        }
        let plan = variables.decode(&x).unwrap();
        let schedule = plan.to_schedule(evaluator.test()).unwrap();
        let timeline = Timeline::new(evaluator.test(), &schedule).unwrap();
        assert!((timeline.total_time_s() - 9000.0).abs() < 1e-6);
        assert!(plan.dwell_s.iter().all(|d| *d >= 60.0));
        // Too little time for the moves: no plan.
        let short = Variables::angles_and_dwells(evaluator.test(), 1000.0);
        assert!(short.decode(&x).is_none());
    }

    #[test]
    fn plans_survive_the_way_through_the_variables() {
        let evaluator = evaluator(true);
        let plan = sample_plan().fitted(evaluator.test(), 9000.0).unwrap();
        let variables = Variables::angles_and_dwells(evaluator.test(), 9000.0);
        let again = variables.decode(&variables.encode(&plan)).unwrap();
        for (a, b) in plan
            .angles
            .iter()
            .flatten()
            .zip(again.angles.iter().flatten())
        {
            assert!((a - b).abs() < 1e-9);
        }
        for (a, b) in plan.dwell_s.iter().zip(&again.dwell_s) {
            assert!((a - b).abs() < 1e-6);
        }
    }

    /// Wrapped changes once made the merit jump where a move crosses the half turn.
    #[test]
    fn the_merit_is_smooth_across_half_turns() {
        let evaluator = evaluator(false);
        let test = evaluator.test();
        let variables = Variables::angles_and_dwells(test, 9000.0);
        let at = |deg: f64| Position::from_deg(deg, 10.0, 30.0).to_array();
        let plan = Plan::new(vec![at(20.0), at(199.99), at(60.0)], vec![900.0; 3]);
        let x = variables.encode(&plan.fitted(test, 9000.0).unwrap());
        let merit = |shift_deg: f64| {
            let mut x = x.clone();
            x[4] += shift_deg.to_radians();
            let timeline = variables.decode(&x).unwrap().timeline(test);
            evaluator.merit(&timeline, Smoothing::Exact).unwrap()
        };
        let [before, after, beyond] = [0.0, 0.02, 0.04].map(merit);
        assert!((before - after).abs() < 1e-3, "{before} {after}");
        assert!((after - before - (beyond - after)).abs() < 1e-6);
    }

    #[test]
    fn pulled_back_gradient_is_the_derivative() {
        for limited in [false, true] {
            let evaluator = evaluator(limited);
            let test = evaluator.test();
            let variables = Variables::angles_and_dwells(test, 9000.0);
            let x = variables.encode(&sample_plan().fitted(test, 9000.0).unwrap());
            let timeline = variables.decode(&x).unwrap().timeline(test);
            let (_, legs) = evaluator
                .merit_gradient(&timeline, Smoothing::Exact)
                .unwrap();
            let gradient = variables.pull_back(&x, &timeline, &legs);
            let f = |x: &[f64]| {
                let timeline = variables.decode(x).unwrap().timeline(test);
                evaluator.merit(&timeline, Smoothing::Exact).unwrap()
            };
            assert_gradient(f, &x, &gradient, 2e-6);
        }
    }
}
