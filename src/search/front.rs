//! Mode `pareto`: the front of total time against criterion.
//!
//! Times are spaced geometrically up to the longest. Each point is a search of its own, warm-
//! started from the next shorter test; then a sweep back offers every longer test's plan to the
//! next shorter one. In the end each point is evaluated like any winner, by both computations.
//! More time is never worse: a plan with every dwell stretched is still a plan, and information
//! never falls with an added dwell.

use rayon::prelude::*;

use super::context::{Context, WorkDone};
use super::fit::LeastTime;
use super::given::{Freedom, Given};
use super::pipeline::{best_candidate, finish};
use super::problem::{FrontPoint, SearchOutcome, SearchProblem, Status};
use super::progress::{Control, Phase};
use super::rated::Candidate;
use super::reason::Reason;
use super::shortest::dwells_stay;
use super::tumbling::tumble;
use super::{conclude, nothing_to_find, refuse_unsupported, verdict, what_depends_on_the_schedule};
use crate::analysis::Unobservable;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::motion::Timeline;
use crate::schedule::Schedule;

/// The shortest test of the front, as a share of the longest.
const SHORTEST_SHARE: f64 = 0.125;

/// The front with `points` tests up to `problem.total_time_s`.
///
/// # Errors
///
/// As [`search`](super::search()); times too short for any schedule are left out.
pub fn front(
    evaluator: &Evaluator,
    problem: &SearchProblem,
    points: usize,
    control: &Control,
) -> Result<SearchOutcome> {
    refuse_unsupported(evaluator, problem)?;
    if let Some(from) = &problem.from
        && from.freedom == Freedom::Order
    {
        return Err(dwells_stay("pareto"));
    }
    let work = WorkDone::default();
    if let Some(mut known) = nothing_to_find(evaluator, problem, control, &work)? {
        known.front = feasible_points(evaluator, vec![known.schedule.clone()])?;
        return Ok(known);
    }
    let searched = what_depends_on_the_schedule(evaluator);
    let sweep = FrontSweep {
        context: Context {
            evaluator: searched.as_ref().unwrap_or(evaluator),
            problem,
            control,
            work: &work,
        },
        problems: problems(evaluator, problem, points.max(1)),
    };
    let mut candidates = sweep.forward()?;
    sweep.back(&mut candidates);
    sweep.repair(&mut candidates);
    let mut schedules = sweep.schedules(&candidates)?;
    let given = Given::of(evaluator, problem)?;
    if let (Some(given), Some(from)) = (&given, &problem.from)
        && let Some(given) = given.to_beat()
    {
        // Among the others by its time: the front keeps it where no shorter test is as good.
        let test = evaluator.test();
        let taken_s = |s: &Schedule| Timeline::new(test, s).map_or(0.0, |t| t.total_time_s());
        let at = schedules.partition_point(|s| taken_s(s) <= given.total_time_s);
        schedules.insert(at, from.schedule.clone());
    }
    control.report(Phase::Checking, 1, 1, None);
    let longest = schedules.last().ok_or_else(nothing_fits)?.clone();
    let mut outcome = conclude(evaluator, control, &work, longest)?;
    outcome.front = feasible_points(sweep.context.evaluator, schedules)?;
    match outcome.front.last() {
        Some(last) => {
            outcome.schedule = last.schedule.clone();
            outcome.evaluation = match searched {
                Some(_) => evaluator.evaluate(&last.schedule)?,
                None => last.evaluation.clone(),
            };
            outcome.unobservable =
                Unobservable::of(evaluator, &outcome.schedule, &outcome.evaluation)?;
            // A front has no specification to meet; its points say what can be met when.
            let lacks = (!outcome.unobservable.is_acceptable())
                .then(|| Reason::Unobservable(outcome.unobservable.clone()));
            outcome.lacking = lacks.is_some();
            let finished = match outcome.reason {
                finished @ Reason::Finished { .. } => finished,
                _ => Reason::FrontFinished,
            };
            (outcome.status, outcome.reason) = verdict(control, &work, lacks, finished);
        }
        // The reason of the verdict stands: nothing meets the minimum separability.
        None => outcome.status = Status::Infeasible,
    }
    outcome.from = given.map(|given| Given {
        is_the_result: (problem.from.as_ref()).is_some_and(|f| f.schedule == outcome.schedule),
        ..given
    });
    Ok(outcome)
}

/// The schedules evaluated, as far as each is feasible and better than every shorter one.
fn feasible_points(evaluator: &Evaluator, schedules: Vec<Schedule>) -> Result<Vec<FrontPoint>> {
    let mut front: Vec<FrontPoint> = Vec::new();
    for schedule in schedules {
        let evaluation = evaluator.evaluate(&schedule)?;
        let falls = front
            .last()
            .is_none_or(|p| evaluation.score.value < p.evaluation.score.value);
        if falls && evaluation.score.meets_minimum_separability {
            front.push(FrontPoint {
                total_time_s: evaluation.total_time_s,
                schedule,
                evaluation,
            });
        }
    }
    Ok(front)
}

fn nothing_fits() -> Error {
    Error::infeasible("no test of the front can hold a schedule")
}

/// The problem at each time, shortest first. Fewer starts for each: neighbours help.
fn problems(evaluator: &Evaluator, problem: &SearchProblem, points: usize) -> Vec<SearchProblem> {
    let test = evaluator.test();
    let longest = problem.total_time_s;
    let shortest = (SHORTEST_SHARE * longest)
        .max(LeastTime::of(test).total_s())
        .min(longest);
    (0..points)
        .map(|k| {
            let share = match points {
                1 => 1.0,
                _ => k as f64 / (points - 1) as f64,
            };
            let total_time_s = match k + 1 == points {
                true => longest,
                false => shortest * libm::pow(longest / shortest, share),
            };
            SearchProblem {
                total_time_s,
                starts: (problem.starts / 2).max(4),
                ..problem.clone()
            }
        })
        .collect()
}

struct FrontSweep<'a> {
    /// With the problem of the longest test.
    context: Context<'a>,
    problems: Vec<SearchProblem>,
}

impl FrontSweep<'_> {
    /// From the shortest test on, each warm-started from the one before.
    fn forward(&self) -> Result<Vec<Option<Candidate>>> {
        let mut found: Vec<Option<Candidate>> = Vec::new();
        let mut last_error = None;
        for problem in &self.problems {
            if !found.is_empty() && self.context.on(problem).must_stop() {
                found.push(None);
                continue;
            }
            let warm: Vec<_> = found
                .iter()
                .flatten()
                .last()
                .map(|c| c.plan.clone())
                .into_iter()
                .collect();
            match best_candidate(self.context.on(problem), &warm) {
                Ok(candidate) => found.push(Some(candidate)),
                Err(e) if e.is_infeasible() || e.is_numerical() => {
                    last_error = Some(e);
                    found.push(None);
                }
                Err(e) => return Err(e),
            }
        }
        match (found.iter().any(Option::is_some), last_error) {
            (false, Some(e)) => Err(e),
            (false, None) => Err(nothing_fits()),
            _ => Ok(found),
        }
    }

    /// The schedules of the candidates, turning while they measure where that is allowed and
    /// better.
    fn schedules(&self, found: &[Option<Candidate>]) -> Result<Vec<Schedule>> {
        let pairs: Vec<_> = self.problems.iter().zip(found).collect();
        pairs
            .into_par_iter()
            .filter_map(|(problem, candidate)| Some((problem, candidate.as_ref()?)))
            .map(|(problem, candidate)| {
                let context = self.context.on(problem);
                if problem.allow_tumbling
                    && !context.must_stop()
                    && let Some((criterion, turning)) = tumble(context, &candidate.plan)
                    && criterion < candidate.criterion
                {
                    return Ok(turning);
                }
                candidate.plan.to_schedule(self.context.evaluator.test())
            })
            .collect()
    }

    /// From the longest test back, each shorter one is offered the plan of the longer.
    fn back(&self, found: &mut [Option<Candidate>]) {
        for k in (1..found.len()).rev() {
            self.offer(found, k, k - 1);
        }
    }

    /// Forward once more where a longer test came out no better.
    fn repair(&self, found: &mut [Option<Candidate>]) {
        for k in 1..found.len() {
            let better = |a: &Option<Candidate>, b: &Option<Candidate>| match (a, b) {
                (Some(a), Some(b)) => a.merit <= b.merit,
                (Some(_), None) => true,
                _ => false,
            };
            if better(&found[k - 1], &found[k]) {
                self.offer(found, k - 1, k);
            }
        }
    }

    fn offer(&self, found: &mut [Option<Candidate>], from: usize, to: usize) {
        let problem = &self.problems[to];
        let context = self.context.on(problem);
        if context.must_stop() {
            return;
        }
        let plan = found[from].as_ref().and_then(|c| {
            c.plan
                .clone()
                .fitted(self.context.evaluator.test(), problem.total_time_s)
        });
        let stage = self.context.work.next_stage();
        let name = || format!("{stage}/offer");
        let offered =
            plan.and_then(|plan| context.remembered(name, |context| finish(context, &plan)));
        let Some(offered) = offered else {
            return;
        };
        if found[to].as_ref().is_none_or(|c| offered.merit < c.merit) {
            found[to] = Some(offered);
        }
    }
}
