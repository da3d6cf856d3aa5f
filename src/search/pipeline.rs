//! From starts to the best candidate: screen, finish, choose.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::checkpoint::Memorable;
use super::context::{Context, WorkDone};
use super::finish::FreeAngles;
use super::improve::{WhichPlan, improve};
use super::index_table::{IndexTable, OnTable, screen_on_table};
use super::only;
use super::plan::Plan;
use super::progress::Phase;
use super::propose;
use super::rated::{Candidate, Refined, rate};
use super::together::{refine_side_by_side, share_of_a_thread};
use super::workshop::Workshop;
use crate::criterion::Smoothing;
use crate::error::{Error, Result};

/// How many of the best starts are worked out to the end.
const FINALISTS: usize = 12;
/// How many different finished plans are improved further.
const IMPROVED: usize = 3;
/// Merits closer than this belong to one basin.
const SAME_BASIN: f64 = 1e-6;
/// L-BFGS iterations of a start before the best are chosen.
const SCREENING_ITERATIONS: u64 = 90;

/// The best candidate of the problem: from its own starts, and from `warm` plans of neighbouring
/// problems, which are all worked out to the end.
pub(crate) fn best_candidate(context: Context<'_>, warm: &[Plan]) -> Result<Candidate> {
    if let Some(from) = &context.problem.from
        && !from.freedom.positions()
    {
        let found = only::best_of_scheme(context, from);
        return found.ok_or_else(|| match only::fits(context, from) {
            true => no_schedule(),
            false => only::does_not_fit(context, from),
        });
    }
    let found = match IndexTable::new(context.evaluator.test().platform()) {
        Some(table) => best_in(context, &OnTable(table), warm),
        None => best_in(context, &FreeAngles, warm),
    };
    found?.ok_or_else(no_schedule)
}

fn best_in(
    context: Context<'_>,
    workshop: &impl Workshop,
    warm: &[Plan],
) -> Result<Option<Candidate>> {
    let stage = context.work.next_stage();
    let starts =
        propose::starts_while(context.evaluator, context.problem, &|| !context.must_stop())?;
    let mut finalists = screen(context, stage, starts);
    finalists.truncate(FINALISTS);
    let known = warm.iter().filter_map(|plan| {
        plan.clone()
            .fitted(context.evaluator.test(), context.problem.total_time_s)
    });
    let given = (context.problem.from.as_ref())
        .and_then(|from| from.start(context.evaluator.test(), context.problem.total_time_s));
    let known = known.chain(given);
    let plans: Vec<Plan> = known.chain(finalists.into_iter().map(|r| r.plan)).collect();
    let smoothing = context.first_smoothing();
    let settle = |context: Context<'_>, _, plan: Plan| workshop.settle(context, &plan, smoothing);
    let mut settled = in_parallel(context, stage, Phase::Finishing, plans, settle);
    settled.sort_by(|a, b| a.merit.total_cmp(&b.merit));
    // Plans of so nearly the same merit are in the same basin: one of them is enough.
    settled.dedup_by(|b, a| b.merit - a.merit < SAME_BASIN);
    // Warm plans come from a neighbouring problem, for which they were improved already; the best
    // alone is worth improving again.
    settled.truncate(if warm.is_empty() { IMPROVED } else { 1 });
    let improve = |context: Context<'_>, stream: u64, plan: Refined| {
        let (smoothing, plan) = sharpened(context, workshop, plan);
        let place = WhichPlan { stage, stream };
        let improved = improve(context, workshop, smoothing, plan, place);
        workshop.polish(context, improved)
    };
    Ok(best_of(in_parallel(
        context,
        stage,
        Phase::Improving,
        settled,
        improve,
    )))
}

/// The plan by the smoothing that proposals are judged with: where the criterion has kinks, close
/// enough to it that what wins is better by the criterion too.
fn sharpened(
    context: Context<'_>,
    workshop: &impl Workshop,
    mut plan: Refined,
) -> (Smoothing, Refined) {
    let mut smoothing = context.first_smoothing();
    if context.evaluator.objective().criterion.has_kinks() {
        for power in [16.0, 48.0] {
            smoothing = Smoothing::PowerMean(power);
            if let Some(rated) = rate(context, &plan.plan, smoothing) {
                plan = workshop.work_out(context, rated, smoothing);
            }
        }
    }
    (smoothing, plan)
}

/// Does a piece of work on each item, in parallel, the first whatever the control says; results
/// in the order of the items. What the journal has done is not done again.
fn in_parallel<T: Send, U: Shown + Memorable + Send>(
    context: Context<'_>,
    stage: u64,
    phase: Phase,
    items: Vec<T>,
    work: impl Fn(Context<'_>, u64, T) -> Option<U> + Sync,
) -> Vec<U> {
    let total = items.len() as u64;
    let done = AtomicU64::new(0);
    let numbered: Vec<(u64, T)> = (0..).zip(items).collect();
    numbered
        .into_par_iter()
        .filter_map(|(index, item)| {
            let name = || format!("{stage}/{}/{index}", phase.name());
            if index > 0 && !context.is_remembered(name) && context.must_stop() {
                return None;
            }
            let result = context.remembered(name, |context| work(context, index, item));
            let count = done.fetch_add(1, Ordering::Relaxed) + 1;
            let criterion = result.as_ref().and_then(|r| r.criterion(context));
            context.control.report(phase, count, total, criterion);
            result
        })
        .collect()
}

/// Works `plan` out to the end; none when it comes to nothing.
pub(super) fn finish(context: Context<'_>, plan: &Plan) -> Option<Candidate> {
    if let Some(from) = &context.problem.from
        && !from.freedom.positions()
    {
        return only::best(context, from.freedom, plan);
    }
    match IndexTable::new(context.evaluator.test().platform()) {
        Some(table) => finish_in(context, &OnTable(table), plan),
        None => finish_in(context, &FreeAngles, plan),
    }
}

fn finish_in(context: Context<'_>, workshop: &impl Workshop, plan: &Plan) -> Option<Candidate> {
    let smoothing = context.first_smoothing();
    let settled = workshop.settle(context, plan, smoothing)?;
    workshop.polish(context, settled)
}

/// What progress can be shown of.
trait Shown {
    /// The criterion, where it is known.
    fn criterion(&self, context: Context<'_>) -> Option<f64>;
}

impl Shown for Refined {
    fn criterion(&self, context: Context<'_>) -> Option<f64> {
        context.shown_criterion(self)
    }
}

impl Shown for Candidate {
    fn criterion(&self, _: Context<'_>) -> Option<f64> {
        Some(self.criterion)
    }
}

fn no_schedule() -> Error {
    Error::numerical("no start led to a schedule whose covariance can be computed")
}

/// The first of the best: ties go to the earlier one, whatever thread was faster.
fn best_of(candidates: Vec<Candidate>) -> Option<Candidate> {
    candidates
        .into_iter()
        .reduce(|best, c| if c.merit < best.merit { c } else { best })
}

/// Refines every start for a while; returns them best first. The first start is worked on
/// whatever the control says, so that there always is a best so far.
fn screen(context: Context<'_>, stage: u64, starts: Vec<Plan>) -> Vec<Refined> {
    let table = IndexTable::new(context.evaluator.test().platform()).filter(IndexTable::is_coarse);
    let mut refined = match &table {
        // On a coarse table rounding changes a plan too much for its merit with free angles to say
        // which plans are good: each is improved on the table itself.
        Some(table) => in_parallel(
            context,
            stage,
            Phase::Screening,
            starts,
            |context, _, plan: Plan| {
                context.work.count_start();
                screen_on_table(context, table, &plan)
            },
        ),
        None => screen_together(context, stage, starts),
    };
    refined.sort_by(|a, b| a.merit.total_cmp(&b.merit));
    refined
}

/// Refines the starts side by side, a share of them on each thread, and hands every one that ends
/// to the journal.
fn screen_together(context: Context<'_>, stage: u64, starts: Vec<Plan>) -> Vec<Refined> {
    let smoothing = context.first_smoothing();
    let total = starts.len() as u64;
    let done = AtomicU64::new(0);
    let name = |index: usize| format!("{stage}/{}/{index}", Phase::Screening.name());
    let share = share_of_a_thread(starts.len());
    let numbered: Vec<(usize, Plan)> = starts.into_iter().enumerate().collect();
    let screen_share = |starts: &[(usize, Plan)]| {
        let mut out: Vec<(usize, Option<Refined>)> = Vec::with_capacity(starts.len());
        let mut keep = |index, result: Option<Refined>| {
            let count = done.fetch_add(1, Ordering::Relaxed) + 1;
            let criterion = result.as_ref().and_then(|r| r.criterion(context));
            let phase = Phase::Screening;
            context.control.report(phase, count, total, criterion);
            out.push((index, result));
        };
        let mut to_do: Vec<&(usize, Plan)> = Vec::with_capacity(starts.len());
        for start in starts {
            match context.recalled(&name(start.0)) {
                Some(known) => keep(start.0, known),
                None if start.0 > 0 && context.must_stop() => {}
                None => to_do.push(start),
            }
        }
        let plans = to_do.iter().map(|(_, plan)| plan.clone()).collect();
        refine_side_by_side(context, plans, smoothing, SCREENING_ITERATIONS, |outcome| {
            let Some(ended) = outcome.ended else {
                return;
            };
            let (index, plan) = to_do[outcome.index];
            let own = WorkDone::default();
            own.count_start();
            own.count_refinement(ended);
            let with_own = Context {
                work: &own,
                ..context
            };
            // A plan without spare time has no variables to refine.
            let result = outcome.refined.or_else(|| rate(with_own, plan, smoothing));
            context.put_down(name(*index), result.as_ref(), &own);
            keep(*index, result);
        });
        out
    };
    let mut screened: Vec<(usize, Option<Refined>)> = numbered
        .par_chunks(share)
        .flat_map_iter(screen_share)
        .collect();
    screened.sort_by_key(|(index, _)| *index);
    screened.into_iter().filter_map(|(_, r)| r).collect()
}

impl Context<'_> {
    /// The criterion behind a merit: what is left of it without the separability's part.
    fn shown_criterion(&self, refined: &Refined) -> Option<f64> {
        let weight = self.evaluator.objective().covariance_weight;
        (weight > 0.0).then(|| {
            let timeline = refined.plan.timeline(self.evaluator.test());
            let covariance_part = refined.merit - self.evaluator.separability_part(&timeline);
            libm::exp(covariance_part / weight)
        })
    }
}
