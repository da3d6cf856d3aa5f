//! The search: from a platform and an objective to the recommended schedule.
//!
//! 1. **Propose** ([`propose`]): random attitudes, structured sets (icosahedron, cube) and the
//!    standard schemes, as many starts as asked for, each from its own random stream, in parallel.
//! 2. **Refine** (`refine`): L-BFGS with the exact gradient on all angles and dwells at once
//!    ([`variables`]), driven by argmin for a plan that is worked out to the end; where many plans
//!    are tried, it advances them together, a gradient in each lane.
//! 3. **Allocate** ([`allocate`]): dwell times by a sequence of convex quadratic programs
//!    (clarabel); positions whose time goes to zero are dropped. Then positions are removed one
//!    by one as long as the score loses less than a tolerance by it: a position that does not
//!    pay is a position somebody has to drive to.
//! 4. **Improve** ([`reordering`]): for the best few, proposals beyond what the gradient sees, each
//!    refined for a while: other orders of the positions by 2-opt and or-opt moves, positions
//!    inserted where the exact directional derivative over the attitude set promises most, and
//!    random kicks. Of the Euler triples of an attitude the quickest to reach are taken.
//! 5. **Round**: dwells to whole filter periods, angles to 0.001°, and refine the angles once
//!    more in between.
//! 6. **Check**: the winner goes through [`Evaluator::evaluate`], which computes its covariance
//!    a second time by the step-by-step square-root filter.
//!
//! A search may begin with a scheme that is there already, and keep some of it ([`given`], [`only`]).
//!
//! On an index table the place of L-BFGS is taken by coordinate exchange, every place estimated
//! at the cost of one dwell.
//!
//! The result depends on the problem and the seed only, not on the number of threads, unless a
//! time limit or a cancellation ends the search early. With a [`checkpoint`] it can be continued
//! then, and ends where it would have.

pub mod allocate;
pub mod checkpoint;
mod context;
mod cost;
mod finish;
mod fit;
pub mod front;
pub mod given;
mod improve;
mod index_table;
mod insert;
mod journal;
mod lbfgs;
mod only;
mod pipeline;
pub mod plan;
mod problem;
mod progress;
pub mod propose;
mod rated;
mod reason;
mod refine;
pub mod reordering;
pub mod shortest;
mod still;
mod termination;
mod together;
mod tumbling;
mod turns;
pub mod variables;
mod ways;
mod workshop;

use crate::analysis::Unobservable;
use crate::criterion::Criterion;
use crate::error::{Error, Result};
use crate::evaluate::{Evaluation, Evaluator, Objective};
use crate::motion::MAX_FILTER_PERIODS;
use crate::platform::Repositioning;
use crate::schedule::Schedule;
use context::{Context, WorkDone};
pub use given::{Freedom, Given, StartingScheme};
use given::{hold_the_promise, scores_better};
pub use journal::Journal;
use pipeline::best_candidate;
pub use problem::{Counters, FrontPoint, SearchOutcome, SearchProblem, Status};
pub use progress::{Control, Phase, Progress};
pub use reason::{EnoughTime, MissedSpecification, Reason};
pub use termination::RefinementCounters;

/// Searches for the best schedule of `problem` on the evaluator's platform, by its objective.
///
/// Runs on the rayon pool it is called from; stops early as `control` says and then returns the
/// best schedule so far.
///
/// # Errors
///
/// [`Error::is_input`] for a problem this search cannot take (tumbling on an index table);
/// [`Error::is_infeasible`] when no schedule fits into the time, with the least that one takes;
/// [`Error::is_disagreement`] when the winner's two computations differ.
pub fn search(
    evaluator: &Evaluator,
    problem: &SearchProblem,
    control: &Control,
) -> Result<SearchOutcome> {
    refuse_unsupported(evaluator, problem)?;
    let work = WorkDone::default();
    if let Some(known) = nothing_to_find(evaluator, problem, control, &work)? {
        return Ok(known);
    }
    let searched = what_depends_on_the_schedule(evaluator);
    let context = Context {
        evaluator: searched.as_ref().unwrap_or(evaluator),
        problem,
        control,
        work: &work,
    };
    let best = best_candidate(context, &[])?;
    control.report(Phase::Checking, 1, 1, Some(best.criterion));
    let mut schedule = best.plan.to_schedule(evaluator.test())?;
    if problem.allow_tumbling
        && !context.must_stop()
        && let Some((criterion, turning)) = tumbling::tumble(context, &best.plan)
        && criterion < best.criterion
    {
        schedule = turning;
    }
    let outcome = conclude(evaluator, control, &work, schedule)?;
    hold_the_promise(
        evaluator,
        problem,
        control,
        &work,
        outcome,
        |given, found| scores_better(context.evaluator, given, found),
    )
}

/// The plan of `schedule` with angles and dwells refined in so much time by the gradient alone, from
/// where it is; none where it turns while it measures, or cannot be refined.
pub(crate) fn polished(
    evaluator: &Evaluator,
    schedule: &Schedule,
    total_time_s: f64,
) -> Option<plan::Plan> {
    /// Enough for an optimum to follow a change of its limits.
    const ITERATIONS: u64 = 60;
    let positions = schedule.positions();
    if positions.iter().any(|p| p.move_s.is_some()) {
        return None;
    }
    let angles = positions.iter().map(|p| p.position.to_array()).collect();
    let dwell_s = positions.iter().map(|p| p.dwell_s).collect();
    let problem = SearchProblem {
        total_time_s,
        ..SearchProblem::default()
    };
    let context = Context {
        evaluator,
        problem: &problem,
        control: &Control::default(),
        work: &WorkDone::default(),
    };
    let mut plan = plan::Plan::new(angles, dwell_s);
    let ways = positions.iter().map(|p| p.change_deg);
    plan.ways = ways
        .map(|way| way.map(|deg| deg.map(f64::to_radians)))
        .collect();
    let plan = plan.fitted(evaluator.test(), total_time_s)?;
    let smoothing = context.first_smoothing();
    Some(refine::refine(context, &plan, smoothing, ITERATIONS)?.plan)
}

/// Where the criterion is 0 before any test and nothing else is asked for, every schedule is as
/// good as any: the shortest one, and why.
pub(crate) fn nothing_to_find(
    evaluator: &Evaluator,
    problem: &SearchProblem,
    control: &Control,
    work: &WorkDone,
) -> Result<Option<SearchOutcome>> {
    let objective = evaluator.objective();
    let prior = evaluator.model().prior_sigma_deg_per_h();
    let Some(why) = objective.criterion.known_before(prior) else {
        return Ok(None);
    };
    if objective.is_led_by_separability() {
        return Ok(None);
    }
    fit::LeastTime::of(evaluator.test()).check(problem.total_time_s)?;
    let schedule = still::stillest(evaluator.test())?;
    let mut outcome = conclude(evaluator, control, work, schedule)?;
    if outcome.status == Status::Converged {
        outcome.reason = Reason::NoTestNeeded(why);
    }
    outcome.from = Given::of(evaluator, problem)?;
    Ok(Some(outcome))
}

/// An evaluator by the separability alone, where the criterion is 0 whatever the schedule and its
/// logarithm would hide the rest; none otherwise.
pub(crate) fn what_depends_on_the_schedule(evaluator: &Evaluator) -> Option<Evaluator> {
    let prior = evaluator.model().prior_sigma_deg_per_h();
    evaluator.objective().criterion.is_known(prior).then(|| {
        let objective = Objective {
            covariance_weight: 0.0,
            ..evaluator.objective().clone()
        };
        Evaluator::new(evaluator.test().clone(), objective)
    })
}

/// Evaluates the winner by both computations and says how the search ended.
pub(crate) fn conclude(
    evaluator: &Evaluator,
    control: &Control,
    work: &WorkDone,
    schedule: Schedule,
) -> Result<SearchOutcome> {
    let evaluation = evaluator.evaluate(&schedule)?;
    let unobservable = Unobservable::of(evaluator, &schedule, &evaluation)?;
    let lacks = shortcoming(evaluator.objective(), &evaluation, &unobservable);
    let lacking = lacks.is_some();
    let missed = MissedSpecification::all(evaluator.objective(), &evaluation);
    let (status, reason) = verdict(control, work, lacks, Reason::Finished { missed });
    Ok(SearchOutcome {
        status,
        reason,
        lacking,
        schedule,
        evaluation,
        unobservable,
        front: Vec::new(),
        from: None,
        counters: work.counters(),
    })
}

/// What this search cannot plan is refused, not quietly left out.
pub(crate) fn refuse_unsupported(evaluator: &Evaluator, problem: &SearchProblem) -> Result<()> {
    let platform = evaluator.test().platform();
    let empty = index_table::IndexTable::new(platform).is_some_and(|t| t.is_empty());
    if empty || still::still(evaluator.test()).is_none() {
        return Err(still::no_setting(platform));
    }
    let motion = platform.motion();
    if problem.allow_tumbling {
        let listed = platform.obstacles().allowed().is_some();
        let why = match (platform.gimbals().step_rad, motion.repositioning) {
            (Some(_), _) => Some("an index table (gimbals.step_deg) does not turn continuously"),
            _ if listed => {
                Some("a stand with a list of positions (gimbals.allowed) holds only them")
            }
            (_, Repositioning::FrameHold) => Some("in frame-hold repositioning moves take no time"),
            _ => None,
        };
        if let Some(why) = why {
            return Err(Error::input(why)
                .with_key("search.allow_tumbling")
                .with_value(true)
                .with_allowed("false"));
        }
    }
    if let Some(from) = &problem.from {
        from.check(evaluator.test(), problem)?;
    }
    if problem.total_time_s.is_nan() || problem.total_time_s <= 0.0 {
        let key = "objective.total_time_s";
        return Err(Error::out_of_range(
            key,
            problem.total_time_s,
            "greater than 0",
        ));
    }
    let periods = problem.total_time_s / platform.period_s;
    if periods > MAX_FILTER_PERIODS {
        return Err(Error::input("the test has too many filter periods")
            .with_key("objective.total_time_s")
            .with_value(problem.total_time_s)
            .with_allowed(format!("at most {MAX_FILTER_PERIODS:e} filter periods")));
    }
    Ok(())
}

/// Status and reason of a search whose best schedule `lacks` something, if it does; `finished` where all
/// is well.
pub(crate) fn verdict(
    control: &Control,
    work: &WorkDone,
    lacks: Option<Reason>,
    finished: Reason,
) -> (Status, Reason) {
    if control.is_cancelled() {
        let lacks = lacks.map(Box::new);
        return (Status::Interrupted, Reason::Interrupted { lacks });
    }
    if work.was_cut_short() {
        let lacks = lacks.map(Box::new);
        return (Status::TimeLimit, Reason::TimeLimit { lacks });
    }
    match lacks {
        Some(reason) => (Status::Infeasible, reason),
        None => (Status::Converged, finished),
    }
}

/// In what a schedule is less than what was asked, however its search ended: nothing where it is not.
fn shortcoming(
    objective: &Objective,
    evaluation: &Evaluation,
    unobservable: &Unobservable,
) -> Option<Reason> {
    let score = &evaluation.score;
    if !score.meets_minimum_separability {
        return Some(Reason::SeparabilityMissed {
            minimum: objective.minimum_separability,
            nearest: score.least_separability,
        });
    }
    if !unobservable.is_acceptable() {
        return Some(Reason::Unobservable(unobservable.clone()));
    }
    // A specification need not be met unless it is the criterion.
    let missed = MissedSpecification::all(objective, evaluation);
    let is_the_criterion = matches!(objective.criterion, Criterion::MaxRatio { .. });
    (is_the_criterion && !missed.is_empty()).then(|| Reason::SpecificationMissed {
        total_time_s: evaluation.total_time_s,
        missed,
        times_as_wide: score.criterion,
    })
}
