//! From starts to the best candidate: screen, finish, choose.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use rayon::prelude::*;

use super::refine::{Refined, refine};
use super::table::{Table, screen_on_table};
use super::variables::Plan;
use super::{Control, Counters, Phase, SearchProblem, finish, propose};
use crate::criterion::Smoothing;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;

/// What every step of a search needs to know.
#[derive(Clone, Copy)]
pub(crate) struct Context<'a> {
    pub evaluator: &'a Evaluator,
    pub problem: &'a SearchProblem,
    pub control: &'a Control<'a>,
    pub work: &'a Work,
}

impl Context<'_> {
    /// Whether to stop, remembering that work was left undone.
    pub fn must_stop(&self) -> bool {
        let stop = self.control.should_stop();
        if stop {
            self.work.cut_short.store(true, Ordering::Relaxed);
        }
        stop
    }

    /// What smoothing a search begins with: a mild power mean where the criterion has kinks.
    pub fn first_smoothing(&self) -> Smoothing {
        match self.evaluator.objective().criterion.has_kinks() {
            true => Smoothing::PowerMean(6.0),
            false => Smoothing::Exact,
        }
    }
}

/// Work counters shared between threads, and whether any work was left undone.
#[derive(Debug, Default)]
pub(crate) struct Work {
    evaluations: AtomicU64,
    gradients: AtomicU64,
    starts: AtomicU64,
    cut_short: AtomicBool,
}

impl Work {
    pub fn count_evaluations(&self, n: u64) {
        self.evaluations.fetch_add(n, Ordering::Relaxed);
    }

    pub fn count_gradients(&self, n: u64) {
        self.gradients.fetch_add(n, Ordering::Relaxed);
    }

    pub fn counters(&self) -> Counters {
        Counters {
            evaluations: self.evaluations.load(Ordering::Relaxed),
            gradients: self.gradients.load(Ordering::Relaxed),
            starts: self.starts.load(Ordering::Relaxed),
        }
    }

    pub fn was_cut_short(&self) -> bool {
        self.cut_short.load(Ordering::Relaxed)
    }
}

/// A plan worked out to the end, with its merit.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    pub plan: Plan,
    pub merit: f64,
    /// Value of the criterion by the filter's own tick rule.
    pub criterion: f64,
}

/// How many of the best starts are worked out to the end.
const FINALISTS: usize = 12;
/// L-BFGS iterations of a start before the best are chosen.
const SCREENING_ITERATIONS: u64 = 90;

/// The plan stretched or shortened to the total time, with its merit; none when it does not fit.
pub(super) fn rate(context: Context<'_>, plan: &Plan, smoothing: Smoothing) -> Option<Refined> {
    let platform = context.evaluator.platform();
    let plan = plan
        .clone()
        .fitted(platform, context.problem.total_time_s)?;
    context.work.count_evaluations(1);
    let timeline = plan.timeline(platform);
    let merit = context.evaluator.merit(&timeline, smoothing).ok()?;
    merit.is_finite().then_some(Refined { plan, merit })
}

/// The best candidate of the problem: from its own starts, and from `warm` plans of neighbouring
/// problems, which are all worked out to the end.
pub(crate) fn best_candidate(context: Context<'_>, warm: &[Plan]) -> Result<Candidate> {
    let starts = propose::starts(context.evaluator, context.problem)?;
    let mut finalists = screen(context, starts);
    finalists.truncate(FINALISTS);
    let warm = warm.iter().filter_map(|plan| {
        plan.clone()
            .fitted(context.evaluator.platform(), context.problem.total_time_s)
    });
    let plans: Vec<Plan> = warm.chain(finalists.into_iter().map(|r| r.plan)).collect();
    best_of(finish_all(context, plans)).ok_or_else(no_schedule)
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

/// Refines every start for a while, in parallel; returns them best first. The first start is
/// worked on whatever the control says, so that there always is a best so far.
fn screen(context: Context<'_>, starts: Vec<Plan>) -> Vec<Refined> {
    let total = starts.len() as u64;
    let done = AtomicU64::new(0);
    let smoothing = context.first_smoothing();
    let table = Table::new(context.evaluator.platform()).filter(Table::is_coarse);
    let mut refined: Vec<Refined> = starts
        .into_par_iter()
        .enumerate()
        .filter_map(|(index, plan)| {
            if index > 0 && context.must_stop() {
                return None;
            }
            let result = match &table {
                // Free angles say little about a coarse table.
                Some(table) => screen_on_table(context, table, &plan),
                // A plan without spare time has no variables to refine.
                None => refine(context, &plan, smoothing, SCREENING_ITERATIONS)
                    .or_else(|| rate(context, &plan, smoothing)),
            };
            context.work.starts.fetch_add(1, Ordering::Relaxed);
            let count = done.fetch_add(1, Ordering::Relaxed) + 1;
            let criterion = result.as_ref().and_then(|r| context.shown_criterion(r));
            context
                .control
                .report(Phase::Screening, count, total, criterion);
            result
        })
        .collect();
    refined.sort_by(|a, b| a.merit.total_cmp(&b.merit));
    refined
}

impl Context<'_> {
    /// The criterion behind a merit, where the merit is nothing but its logarithm.
    fn shown_criterion(&self, refined: &Refined) -> Option<f64> {
        let o = self.evaluator.objective();
        let plain = o.separability_weight == 0.0 && o.minimum_separability == 0.0;
        (plain && o.covariance_weight > 0.0).then(|| (refined.merit / o.covariance_weight).exp())
    }
}

/// Works plans out to the end, in parallel.
fn finish_all(context: Context<'_>, plans: Vec<Plan>) -> Vec<Candidate> {
    let total = plans.len() as u64;
    let done = AtomicU64::new(0);
    plans
        .into_par_iter()
        .enumerate()
        .filter_map(|(index, plan)| {
            if index > 0 && context.must_stop() {
                return None;
            }
            let result = finish::finish(context, plan);
            let count = done.fetch_add(1, Ordering::Relaxed) + 1;
            let criterion = result.as_ref().map(|c| c.criterion);
            context
                .control
                .report(Phase::Finishing, count, total, criterion);
            result
        })
        .collect()
}
