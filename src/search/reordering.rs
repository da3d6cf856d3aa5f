//! The order of positions: reversals and displacements of segments, and the quickest triples.
//!
//! Order counts twice. Moves take time, the less the nearer the next position; and what a
//! position tells depends on what was known before, through ψ^n and its covariance. So every
//! change is scored by the true evaluator, the time its moves save given to the dwells.

use rand::SeedableRng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::context::Context;
use super::plan::Plan;
use super::rated::{Refined, rate};
use crate::attitude::Position;
use crate::criterion::Smoothing;
use crate::motion::quickest_positions_but;

/// Longest segment that is displaced.
const LONGEST_SEGMENT: usize = 3;
/// More changes than this are not tried at once; a random choice of them is.
const MOST_CHANGES: usize = 2_000;

/// A change of order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reordering {
    /// Positions `from..=to` the other way round (2-opt).
    Reverse { from: usize, to: usize },
    /// `length` positions from `from` on, put before what then is position `to` (or-opt).
    Move {
        from: usize,
        length: usize,
        to: usize,
    },
}

impl Reordering {
    /// The plan with the change made.
    pub(super) fn of(self, plan: &Plan) -> Plan {
        match self {
            Self::Reverse { from, to } => reversed(plan, from, to),
            Self::Move { from, length, to } => moved(plan, from, length, to),
        }
    }
}

/// The plan with positions `from..=to` the other way round.
pub(super) fn reversed(plan: &Plan, from: usize, to: usize) -> Plan {
    let mut changed = plan.clone();
    changed.reverse(from, to);
    changed
}

/// The plan with `length` positions taken out at `from` and put back before what then is
/// position `to`.
pub(super) fn moved(plan: &Plan, from: usize, length: usize, to: usize) -> Plan {
    let mut changed = plan.clone();
    changed.displace(from, length, to);
    changed
}

/// The same attitudes by the triples that take the gimbals least time.
pub(super) fn with_quickest_positions(context: Context<'_>, mut plan: Plan) -> Plan {
    let positions: Vec<Position> = plan
        .angles
        .iter()
        .map(|a| Position::from_array(*a))
        .collect();
    let test = context.evaluator.test();
    let quickest = quickest_positions_but(test, &positions, &|k| plan.is_held(k));
    plan.set_positions(quickest);
    plan
}

pub(super) fn changes(count: usize) -> Vec<Reordering> {
    let mut all = Vec::new();
    for from in 0..count {
        for to in from + 1..count {
            all.push(Reordering::Reverse { from, to });
        }
        for length in 1..=LONGEST_SEGMENT.min(count - from) {
            for to in 0..=count - length {
                // By one place is the same as displacing the neighbour instead, or as reversing the
                // two, which is listed already.
                let distance = to.abs_diff(from);
                if distance > 1 || (distance == 1 && length == 2) {
                    all.push(Reordering::Move { from, length, to });
                }
            }
        }
    }
    all
}

/// The `most` best plans that a change of order makes of `plan`, best first, by the merit of the
/// change alone.
pub(super) fn neighbours(
    context: Context<'_>,
    smoothing: Smoothing,
    plan: &Plan,
    most: usize,
) -> Vec<Refined> {
    let mut all = changes(plan.angles.len());
    if all.len() > MOST_CHANGES {
        let mut random = ChaCha8Rng::seed_from_u64(context.problem.seed);
        all = all.sample(&mut random, MOST_CHANGES).copied().collect();
    }
    let mut estimated: Vec<(f64, Plan)> = all
        .par_chunks(AT_ONCE)
        .flat_map_iter(|some| {
            let changed = some.iter().map(|change| change.of(plan));
            let admitted = changed.filter(|plan| context.problem.admits(plan));
            let quickest = admitted.map(|changed| with_quickest_positions(context, changed));
            estimated(context, smoothing, quickest)
        })
        .collect();
    estimated.sort_by(|a, b| a.0.total_cmp(&b.0));
    let best = estimated.into_iter().take(most);
    best.filter_map(|(_, plan)| rate(context, &plan, smoothing))
        .collect()
}

/// Changes that one thread rates at a time.
const AT_ONCE: usize = 16;

/// Plans fitted into the time with their merits, several at once; those that have one. To nine
/// digits, so that equal ones keep their order on every machine.
fn estimated(
    context: Context<'_>,
    smoothing: Smoothing,
    plans: impl Iterator<Item = Plan>,
) -> Vec<(f64, Plan)> {
    if context.must_stop() {
        return Vec::new();
    }
    let evaluator = context.evaluator;
    let (test, total_time_s) = (evaluator.test(), context.problem.total_time_s);
    let fitted = plans.filter_map(|plan| plan.fitted_timeline(test, total_time_s));
    let (plans, timelines): (Vec<Plan>, Vec<_>) = fitted.unzip();
    context.work.count_evaluations(plans.len() as u64);
    let merits = evaluator.merits(&timelines, smoothing);
    // An order whose merit cannot be computed is no candidate.
    let all = merits.into_iter().zip(plans);
    all.filter_map(|(merit, plan)| Some((merit.ok().filter(|m| m.is_finite())?, plan)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(count: usize) -> Plan {
        let at = |k: usize| [k as f64, 0.0, 0.0];
        Plan::new(
            (0..count).map(at).collect(),
            (0..count).map(|k| 100.0 + k as f64).collect(),
        )
    }

    fn order(plan: &Plan) -> Vec<usize> {
        for (angles, dwell) in plan.angles.iter().zip(&plan.dwell_s) {
            assert_eq!(angles[0] + 100.0, *dwell);
        }
        plan.angles.iter().map(|a| a[0] as usize).collect()
    }

    #[test]
    fn dwells_go_with_their_positions() {
        assert_eq!(order(&reversed(&plan(5), 1, 3)), [0, 3, 2, 1, 4]);
        assert_eq!(order(&moved(&plan(5), 0, 2, 3)), [2, 3, 4, 0, 1]);
        assert_eq!(order(&moved(&plan(5), 3, 2, 0)), [3, 4, 0, 1, 2]);
        assert_eq!(order(&moved(&plan(5), 3, 1, 1)), [0, 3, 1, 2, 4]);
    }

    #[test]
    fn every_change_is_another_order() {
        let plan = plan(7);
        for change in changes(7) {
            let changed = change.of(&plan);
            let mut sorted = order(&changed);
            assert_ne!(sorted, order(&plan));
            sorted.sort_unstable();
            assert_eq!(sorted, order(&plan));
        }
        assert!(changes(1).is_empty());
    }
}
