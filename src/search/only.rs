//! Searches that keep the positions of a scheme: dwells alone, order alone, or both.
//!
//! **Dwells**: gradient and allocation as for any plan, all angles held; a dwell may come down to the
//! shortest one, and no position vanishes. **Order**: descents over all reversals and displacements of
//! segments, from the given order and from random ones, then kicks, each change rated by the evaluator;
//! dwells go with their positions as they are, or fitted into the time where they are free. Ways round
//! the gimbals are tried both ways in the end.

use rand::seq::{IndexedRandom, SliceRandom};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::context::Context;
use super::finish::{best_ways, final_figures, settle_allocation, settle_times, towards_the_kink};
use super::given::{Freedom, StartingScheme};
use super::plan::{Plan, TIME_SLACK};
use super::progress::Phase;
use super::rated::{Candidate, Refined, rate};
use super::refine::refine;
use super::reordering::changes;
use crate::criterion::Smoothing;
use crate::error::Error;

/// L-BFGS iterations of the dwells.
const ITERATIONS: u64 = 400;
/// Random orders that a descent begins at, besides the given one.
const RANDOM_ORDERS: usize = 4;
/// Kicks in a row that may win nothing.
const PATIENCE: usize = 20;
/// Kicks at most.
const MOST_KICKS: usize = 200;
/// More changes than this are not tried at once; a random choice of them is.
const MOST_CHANGES: usize = 1_000;
/// Orders that one thread rates at a time.
const AT_ONCE: usize = 16;
/// A change has to gain this much.
const GAIN: f64 = 1e-9;

/// The best that the scheme comes to when only its `freedom` may change; none when it comes to nothing.
pub(super) fn best_of_scheme(context: Context<'_>, from: &StartingScheme) -> Option<Candidate> {
    let stage = context.work.next_stage();
    let name = || format!("{stage}/{}/0", Phase::Improving.name());
    let found = context.remembered(name, |context| {
        context.work.count_start();
        best(context, from.freedom, &from.plan(context.evaluator.test()))
    });
    let criterion = found.as_ref().map(|c: &Candidate| c.criterion);
    context.control.report(Phase::Improving, 1, 1, criterion);
    found
}

/// Whether the scheme fits into the time in the order that it has.
pub(super) fn fits(context: Context<'_>, from: &StartingScheme) -> bool {
    let (test, total_time_s) = (context.evaluator.test(), context.problem.total_time_s);
    let plan = from.plan(test);
    let taken_s = plan.timeline(test).total_time_s();
    match from.freedom.dwells() {
        true => plan.fitted(test, total_time_s).is_some(),
        false => taken_s <= total_time_s * (1.0 + TIME_SLACK),
    }
}

/// No order that was tried does.
pub(super) fn does_not_fit(context: Context<'_>, from: &StartingScheme) -> Error {
    Error::infeasible(format!(
        "in no order that was tried do the positions of {} fit into the time",
        from.name
    ))
    .with_key("objective.total_time_s")
    .with_value(context.problem.total_time_s)
}

/// The same from a plan of the scheme.
pub(super) fn best(context: Context<'_>, freedom: Freedom, plan: &Plan) -> Option<Candidate> {
    let smoothing = context.first_smoothing();
    if freedom == Freedom::Order {
        let ordered = in_best_order(context, freedom, plan, Smoothing::Exact)?;
        return final_figures(context, best_ways(context, ordered.plan));
    }
    let mut current = match freedom.order() {
        true => in_best_order(context, freedom, plan, smoothing)?,
        false => with_best_dwells(context, plan, smoothing)?,
    };
    if freedom.order() {
        current = with_best_dwells(context, &current.plan, smoothing)?;
        // Another order may suit the dwells now, and other dwells that order.
        while !context.must_stop() {
            let ordered = descend(
                context,
                freedom,
                current.plan.clone(),
                smoothing,
                &mut seeded(context),
            );
            let Some(ordered) = ordered.filter(|r| r.merit < current.merit - GAIN) else {
                break;
            };
            match with_best_dwells(context, &ordered.plan, smoothing) {
                Some(better) if better.merit < current.merit - GAIN => current = better,
                _ => break,
            }
        }
    }
    if context.evaluator.objective().criterion.has_kinks() {
        current = towards_the_kink(context, current);
    }
    settle_times(context, &current.plan, freedom.order())
}

fn seeded(context: Context<'_>) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(context.problem.seed)
}

/// The plan with its dwells at their best.
fn with_best_dwells(context: Context<'_>, plan: &Plan, smoothing: Smoothing) -> Option<Refined> {
    // A plan without spare time has no variables to refine.
    let refined =
        refine(context, plan, smoothing, ITERATIONS).or_else(|| rate(context, plan, smoothing))?;
    Some(settle_allocation(context, smoothing, refined))
}

/// The best order that is found.
fn in_best_order(
    context: Context<'_>,
    freedom: Freedom,
    plan: &Plan,
    smoothing: Smoothing,
) -> Option<Refined> {
    let mut random = seeded(context);
    let mut starts = vec![plan.clone()];
    for _ in 0..RANDOM_ORDERS {
        let mut order: Vec<usize> = (0..plan.angles.len()).collect();
        order.shuffle(&mut random);
        starts.extend(reordered(context, plan, &order));
    }
    let descents = starts
        .into_iter()
        .filter_map(|start| descend(context, freedom, start, smoothing, &mut random));
    let mut best = descents.reduce(Refined::better)?;
    let mut idle = 0;
    for _ in 0..MOST_KICKS {
        if idle >= PATIENCE || plan.angles.len() < 4 || context.must_stop() {
            break;
        }
        let kicked = kicked(context, &best.plan, &mut random);
        let found = kicked.and_then(|k| descend(context, freedom, k, smoothing, &mut random));
        match found.filter(|found| found.merit < best.merit - GAIN) {
            Some(better) => (best, idle) = (better, 0),
            None => idle += 1,
        }
    }
    Some(best)
}

/// The plan that no change of order makes better; none when neither it nor a change fits into the time.
fn descend(
    context: Context<'_>,
    freedom: Freedom,
    start: Plan,
    smoothing: Smoothing,
    random: &mut ChaCha8Rng,
) -> Option<Refined> {
    let mut current = rated(context, freedom, vec![start.clone()], smoothing).pop();
    let mut plan = start;
    while !context.must_stop() {
        let mut all = changes(plan.angles.len());
        if all.len() > MOST_CHANGES {
            all = all.sample(random, MOST_CHANGES).copied().collect();
        }
        let changed = all.iter().map(|change| change.of(&plan));
        let changed = changed
            .filter(|plan| context.problem.admits(plan))
            .collect();
        let next = rated(context, freedom, changed, smoothing);
        let next = next.into_iter().reduce(Refined::better);
        match (next, &current) {
            (Some(next), Some(now)) if next.merit >= now.merit - GAIN => break,
            (None, _) => break,
            (Some(next), _) => {
                plan.clone_from(&next.plan);
                current = Some(next);
            }
        }
    }
    current
}

/// Those of the plans that fit into the time, with their merits; their dwells scaled to it where they
/// are free.
fn rated(
    context: Context<'_>,
    freedom: Freedom,
    plans: Vec<Plan>,
    smoothing: Smoothing,
) -> Vec<Refined> {
    let evaluator = context.evaluator;
    let (test, total_time_s) = (evaluator.test(), context.problem.total_time_s);
    let rate = |some: &[Plan]| {
        let fit = |plan: &Plan| match freedom.dwells() {
            true => plan.clone().fitted(test, total_time_s),
            false => {
                // In another order the short way may be blocked, or wind a gimbal up too far.
                let (plan, timeline) = plan.clone().passable(test)?;
                let taken_s = timeline.total_time_s();
                (taken_s <= total_time_s * (1.0 + TIME_SLACK)).then_some(plan)
            }
        };
        let plans: Vec<Plan> = some.iter().filter_map(fit).collect();
        context.work.count_evaluations(plans.len() as u64);
        let timelines: Vec<_> = plans.iter().map(|plan| plan.timeline(test)).collect();
        let merits = evaluator.merits(&timelines, smoothing);
        let rated = merits.into_iter().zip(plans);
        // An order whose merit cannot be computed is no candidate. To eleven digits, so that equal
        // ones are equal on every machine.
        rated
            .filter_map(|(merit, plan)| {
                let merit = merit.ok().filter(|m| m.is_finite())?;
                let merit = (merit * 1e11).round() * 1e-11;
                Some(Refined { plan, merit })
            })
            .collect::<Vec<_>>()
    };
    plans.par_chunks(AT_ONCE).flat_map_iter(rate).collect()
}

/// The positions of a plan in another order, if that keeps what is pinned.
fn reordered(context: Context<'_>, plan: &Plan, order: &[usize]) -> Option<Plan> {
    let of = |k: &usize| (plan.angles[*k], plan.dwell_s[*k], plan.pins[*k]);
    let mut next = Plan::new(
        order.iter().map(|k| of(k).0).collect(),
        order.iter().map(|k| of(k).1).collect(),
    );
    next.pins = order.iter().map(|k| of(k).2).collect();
    context.problem.admits(&next).then_some(next)
}

/// Four segments in another order, two positions exchanged.
fn kicked(context: Context<'_>, plan: &Plan, random: &mut ChaCha8Rng) -> Option<Plan> {
    let count = plan.angles.len();
    let order: Vec<usize> = (0..count).collect();
    let mut cuts = [0; 3].map(|_| random.random_range(0..=count));
    cuts.sort_unstable();
    let [a, b, c] = cuts;
    let mut kicked = [&order[..a], &order[b..c], &order[a..b], &order[c..]].concat();
    let (i, j) = (random.random_range(0..count), random.random_range(0..count));
    kicked.swap(i, j);
    reordered(context, plan, &kicked)
}
