//! The search: from a platform and an objective to the recommended schedule.
//!
//! 1. **Propose** ([`propose`]): random attitudes and structured sets (icosahedron, cube), as
//!    many starts as asked for, each from its own random stream, in parallel.
//! 2. **Refine** ([`refine`]): L-BFGS (argmin) with the exact gradient on all angles and dwells
//!    at once ([`variables`]).
//! 3. **Allocate** ([`allocate`]): dwell times by a sequence of convex quadratic programs
//!    (clarabel); positions whose time goes to zero are dropped. Then positions are removed one
//!    by one as long as the score loses less than a tolerance by it: a position that does not
//!    pay is a position somebody has to drive to.
//! 4. **Round**: dwells to whole filter periods, angles to 0.001°, and refine the angles once
//!    more in between.
//! 5. **Check**: the winner goes through [`Evaluator::evaluate`], which computes its covariance
//!    a second time by the step-by-step square-root filter.
//!
//! The result depends on the problem and the seed only, not on the number of threads, unless a
//! time limit or a cancellation ends the search early.

pub mod allocate;
mod finish;
mod progress;
pub mod propose;
pub mod refine;
pub mod variables;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use rayon::prelude::*;

use crate::criterion::Smoothing;
use crate::error::{Error, Result};
use crate::evaluate::{Evaluation, Evaluator};
use crate::schedule::Schedule;
pub use progress::{Control, Phase, Progress};
use refine::Refined;
use variables::Plan;

/// What to search for.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchProblem {
    /// Duration of the test, moves and settles included, s.
    pub total_time_s: f64,
    /// Most positions of the schedule.
    pub max_positions: usize,
    /// How many starts.
    pub starts: usize,
    /// Seed of the random streams.
    pub seed: u64,
    /// A position is dropped when the score gets worse by less than this without it.
    pub position_tolerance: f64,
    /// Measured continuous moves as part of the schedule; this search does not plan them yet.
    pub allow_tumbling: bool,
}

impl Default for SearchProblem {
    fn default() -> Self {
        Self {
            total_time_s: 12_000.0,
            max_positions: 24,
            starts: 64,
            seed: 1,
            position_tolerance: 2e-4,
            allow_tumbling: false,
        }
    }
}

/// How a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Status {
    /// All starts were worked through.
    Converged,
    /// The time limit ended it; the schedule is the best found so far.
    TimeLimit,
    /// It was cancelled; the schedule is the best found so far.
    Interrupted,
    /// No schedule meets what was asked; the schedule is the nearest found.
    Infeasible,
}

impl Status {
    /// The name used in documents.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::TimeLimit => "time-limit",
            Self::Interrupted => "interrupted",
            Self::Infeasible => "infeasible",
        }
    }
}

/// How much work a search did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Values of schedules computed without gradient.
    pub evaluations: u64,
    /// Values computed with gradient.
    pub gradients: u64,
    /// Starts worked through.
    pub starts: u64,
}

/// The result of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchOutcome {
    /// How it ended.
    pub status: Status,
    /// The same in words.
    pub reason: String,
    /// The recommended schedule.
    pub schedule: Schedule,
    /// Its evaluation, both computations agreeing.
    pub evaluation: Evaluation,
    /// Work done.
    pub counters: Counters,
}

/// Work counters shared between threads.
#[derive(Debug, Default)]
pub(crate) struct Work {
    evaluations: AtomicU64,
    gradients: AtomicU64,
    starts: AtomicU64,
    cut_short: AtomicBool,
}

impl Work {
    /// Whether to stop, remembering that work was left undone.
    pub(crate) fn must_stop(&self, control: &Control<'_>) -> bool {
        let stop = control.should_stop();
        if stop {
            self.cut_short.store(true, Ordering::Relaxed);
        }
        stop
    }
    pub(crate) fn count_evaluations(&self, n: u64) {
        self.evaluations.fetch_add(n, Ordering::Relaxed);
    }
    pub(crate) fn count_gradients(&self, n: u64) {
        self.gradients.fetch_add(n, Ordering::Relaxed);
    }
    fn counters(&self) -> Counters {
        Counters {
            evaluations: self.evaluations.load(Ordering::Relaxed),
            gradients: self.gradients.load(Ordering::Relaxed),
            starts: self.starts.load(Ordering::Relaxed),
        }
    }
}

/// How many of the best starts are worked out to the end.
const FINALISTS: usize = 6;
/// L-BFGS iterations of a start before the best are chosen.
const SCREENING_ITERATIONS: u64 = 60;

/// Searches for the best schedule of `problem` on the evaluator's platform, by its objective.
///
/// Runs on the rayon pool it is called from; stops early as `control` says and then returns the
/// best schedule so far.
///
/// # Errors
///
/// [`Error::is_input`] for a problem this search cannot take (an index table);
/// [`Error::is_infeasible`] when not even the fewest positions fit into the time;
/// [`Error::is_disagreement`] when the winner's two computations differ.
pub fn search(
    evaluator: &Evaluator,
    problem: &SearchProblem,
    control: &Control<'_>,
) -> Result<SearchOutcome> {
    refuse_unsupported(evaluator, problem)?;
    let work = Work::default();
    let starts = propose::starts(evaluator, problem)?;
    let screened = screen(evaluator, problem, control, &work, starts)?;
    let finalists = finish_all(evaluator, problem, control, &work, screened);
    let best = best_of(finalists).ok_or_else(no_schedule)?;
    control.report(Phase::Checking, 1, 1, Some(best.criterion));
    let schedule = best.plan.to_schedule()?;
    let evaluation = evaluator.evaluate(&schedule)?;
    let (status, reason) = verdict(evaluator, control, &work, &evaluation);
    Ok(SearchOutcome {
        status,
        reason,
        schedule,
        evaluation,
        counters: work.counters(),
    })
}

/// What this search cannot plan is refused, not quietly left out.
fn refuse_unsupported(evaluator: &Evaluator, problem: &SearchProblem) -> Result<()> {
    if evaluator.platform().gimbals().step_rad.is_some() {
        return Err(
            Error::input("the search does not place positions on an index table yet")
                .with_key("gimbals.step_deg")
                .with_allowed("left out for a search; an evaluation takes it"),
        );
    }
    if problem.allow_tumbling {
        return Err(
            Error::input("the search does not plan continuous moves yet")
                .with_key("search.allow_tumbling")
                .with_value(true)
                .with_allowed("false; an evaluation takes measured moves"),
        );
    }
    Ok(())
}

fn no_schedule() -> Error {
    Error::numerical("no start led to a schedule whose covariance can be computed")
}

/// A plan with its merit.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    pub plan: Plan,
    pub merit: f64,
    /// Value of the criterion, for the progress display.
    pub criterion: f64,
}

/// The first of the best: ties go to the earlier start, whatever thread was faster.
fn best_of(candidates: Vec<Candidate>) -> Option<Candidate> {
    candidates
        .into_iter()
        .reduce(|best, c| if c.merit < best.merit { c } else { best })
}

/// Refines every start for a while, in parallel; returns them best first. The first start is
/// worked on whatever the control says, so that there always is a best so far.
fn screen(
    evaluator: &Evaluator,
    problem: &SearchProblem,
    control: &Control<'_>,
    work: &Work,
    starts: Vec<Plan>,
) -> Result<Vec<Refined>> {
    let total = starts.len();
    let done = AtomicU64::new(0);
    let mut refined: Vec<Refined> = starts
        .into_par_iter()
        .enumerate()
        .filter_map(|(index, plan)| {
            if index > 0 && work.must_stop(control) {
                return None;
            }
            let smoothing = first_smoothing(evaluator);
            let result = refine::refine(
                evaluator,
                &plan,
                problem.total_time_s,
                smoothing,
                SCREENING_ITERATIONS,
                work,
            );
            work.starts.fetch_add(1, Ordering::Relaxed);
            let count = done.fetch_add(1, Ordering::Relaxed) + 1;
            let log = result.as_ref().map(|r| r.merit);
            control.report(Phase::Screening, count, total as u64, log.map(f64::exp));
            result
        })
        .collect();
    if refined.is_empty() {
        return Err(no_schedule());
    }
    refined.sort_by(|a, b| a.merit.total_cmp(&b.merit));
    Ok(refined)
}

/// What smoothing a search begins with: a mild power mean where the criterion has kinks.
fn first_smoothing(evaluator: &Evaluator) -> Smoothing {
    match evaluator.objective().criterion.has_kinks() {
        true => Smoothing::PowerMean(6.0),
        false => Smoothing::Exact,
    }
}

/// Works the best starts out to the end, in parallel.
fn finish_all(
    evaluator: &Evaluator,
    problem: &SearchProblem,
    control: &Control<'_>,
    work: &Work,
    mut screened: Vec<Refined>,
) -> Vec<Candidate> {
    screened.truncate(FINALISTS);
    let total = screened.len() as u64;
    let done = AtomicU64::new(0);
    screened
        .into_par_iter()
        .enumerate()
        .filter_map(|(index, start)| {
            if index > 0 && work.must_stop(control) {
                return None;
            }
            let result = finish::finish(evaluator, problem, work, control, start.plan);
            let count = done.fetch_add(1, Ordering::Relaxed) + 1;
            let criterion = result.as_ref().map(|c| c.criterion);
            control.report(Phase::Finishing, count, total, criterion);
            result
        })
        .collect()
}

/// Status and reason of a search whose best schedule has been evaluated.
fn verdict(
    evaluator: &Evaluator,
    control: &Control<'_>,
    work: &Work,
    evaluation: &Evaluation,
) -> (Status, String) {
    let cut_short = work.cut_short.load(Ordering::Relaxed);
    if cut_short && control.is_cancelled() {
        return (
            Status::Interrupted,
            "interrupted; the schedule is the best found so far".to_owned(),
        );
    }
    if cut_short {
        return (
            Status::TimeLimit,
            "the time limit was reached; the schedule is the best found so far".to_owned(),
        );
    }
    let score = &evaluation.score;
    if !score.meets_minimum_separability {
        return (
            Status::Infeasible,
            format!(
                "no schedule found reaches the minimum separability {}; the nearest has {:.4}",
                evaluator.objective().minimum_separability,
                score.least_separability
            ),
        );
    }
    (
        Status::Converged,
        "all starts were refined to convergence and the winner was confirmed by the \
         step-by-step filter"
            .to_owned(),
    )
}
