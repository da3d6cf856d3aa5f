//! What a position costs: time for a detour, and what time is worth.

use super::context::Context;
use super::plan::Plan;
use super::ways::in_deg;
use crate::attitude::{Degrees, Position};
use crate::criterion::Smoothing;
use crate::motion::{Test, way};

/// What one more second of test changes the merit by, given to all dwells in proportion.
pub(super) fn price_of_time(
    context: Context<'_>,
    smoothing: Smoothing,
    plan: &Plan,
) -> Option<f64> {
    /// A difference long against rounding, short against the test.
    const STEP: f64 = 1e-3;
    let test = context.evaluator.test();
    let total_time_s = context.problem.total_time_s;
    let merit = |total_time_s: f64| {
        let (_, timeline) = plan.clone().fitted_timeline(test, total_time_s)?;
        context.work.count_evaluations(1);
        // Without a merit time has no price.
        context.evaluator.merit(&timeline, smoothing).ok()
    };
    let longer = merit(total_time_s * (1.0 + STEP))?;
    Some((longer - merit(total_time_s)?) / (STEP * total_time_s))
}

/// Time for the moves and the settle that a position at `gap` adds, s.
pub(super) fn detour_s(test: &Test, plan: &Plan, gap: usize, position: Position) -> f64 {
    let motion = test.platform().motion();
    let Some(slew) = motion.slew else {
        return motion.settle_s;
    };
    let by_way = |from: Position, to: Position, given: Option<[f64; 3]>| {
        slew.shortest_s(&way(test.platform(), from, to, given).map(Degrees::rad))
    };
    let short = |from: Position, to: Position| by_way(from, to, None);
    let at = |k: usize| plan.angles.get(k).map(|a| Position::from_array(*a));
    let before = gap.checked_sub(1).map_or(test.standing(), at);
    let after = at(gap);
    let to = before.map_or(0.0, |b| short(b, position));
    let on = after.map_or(0.0, |a| short(position, a));
    let direct = match (before, after) {
        (Some(b), Some(a)) => by_way(b, a, plan.ways[gap].map(in_deg)),
        _ => 0.0,
    };
    to + on - direct + motion.settle_s
}
