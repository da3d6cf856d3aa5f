//! Mode `time`: the shortest test in which every coefficient meets its specification.
//!
//! The best max-ratio reachable in a total time T falls steadily with T, about like a power of
//! it, so ln ratio against ln T is nearly a straight line. The root ratio = 1 is bracketed and
//! found by the Illinois variant of regula falsi on those logarithms, each point by a search warm-started
//! from its neighbour. In the end whole filter periods are taken off as long as the
//! specification holds, judged by the filter's own tick rule.

use super::context::{Context, WorkDone};
use super::fit::LeastTime;
use super::given::{Freedom, hold_the_promise, is_sooner, specification_met};
use super::pipeline::best_candidate;
use super::plan::Plan;
use super::problem::{SearchOutcome, SearchProblem, Status};
use super::progress::{Control, Phase};
use super::rated::Candidate;
use super::reason::{EnoughTime, MissedSpecification, Reason};
use super::tumbling::tumble;
use super::{conclude, nothing_to_find, refuse_unsupported, search, what_depends_on_the_schedule};
use crate::covariance::TickRule;
use crate::criterion::{Criterion, Smoothing};
use crate::error::{Error, Result};
use crate::evaluate::{Evaluator, Objective};
use crate::schedule::Schedule;

/// Steps of the root search.
const STEPS: usize = 14;
/// The bracket is narrow enough when its ends differ by this much, relatively.
const WIDTH: f64 = 5e-4;
/// How the ratio falls with the time, for the first guess: σ ∝ T^−1.2.
const POWER: f64 = 1.2;
/// Tests that turn tried, each shorter than the last that does.
const TURNING_STEPS: usize = 6;
/// How much longer than allowed a test is tried, to say what the specification would need.
const LONGEST_TRIAL: f64 = 64.0;

/// The shortest schedule that meets the evaluator's specification, at most
/// `problem.total_time_s` long.
///
/// # Errors
///
/// [`Error::is_input`] without a specification; as [`search`](super::search()) otherwise. A
/// specification that cannot be met in the time is not an error but status
/// [`Status::Infeasible`], with the nearest feasible point in the reason.
pub fn shortest(
    evaluator: &Evaluator,
    problem: &SearchProblem,
    control: &Control,
) -> Result<SearchOutcome> {
    refuse_unsupported(evaluator, problem)?;
    let objective = evaluator.objective();
    let Some(spec_deg_per_h) = objective.spec_deg_per_h else {
        return Err(
            Error::input("the shortest test needs a specification to meet")
                .with_key("objective.spec_deg_per_h"),
        );
    };
    if let Some(from) = &problem.from
        && from.freedom == Freedom::Order
    {
        return Err(dwells_stay("time"));
    }
    // Whatever the criterion of the study, what counts here is the specification.
    let objective = Objective {
        criterion: Criterion::MaxRatio {
            spec_deg_per_h,
            others: objective.spec_of_others.clone(),
        },
        ..objective.clone()
    };
    let evaluator = &Evaluator::new(evaluator.test().clone(), objective);
    let work = WorkDone::default();
    if let Some(known) = nothing_to_find(evaluator, problem, control, &work)? {
        return Ok(known);
    }
    if what_depends_on_the_schedule(evaluator).is_some() {
        // Every time is enough for the specification: what is left is the separability asked for.
        return search(evaluator, problem, control);
    }
    let root = RootSearch {
        context: Context {
            evaluator,
            problem,
            control,
            work: &work,
        },
    };
    let promised = |outcome| {
        let better = |given: &_, found: &_| is_sooner(evaluator, given, found);
        let mut outcome = hold_the_promise(evaluator, problem, control, &work, outcome, better)?;
        if outcome.from.as_ref().is_some_and(|g| g.is_the_result) {
            specification_met(&mut outcome);
        }
        Ok(outcome)
    };
    let longest = root.point(problem.total_time_s, problem.starts, &[])?;
    if longest.criterion > 1.0 {
        return promised(root.infeasible(&longest)?);
    }
    let best = root.narrow(longest)?;
    let plan = root.trim(best.plan);
    control.report(Phase::Checking, 1, 1, None);
    let schedule = match root.turning(&plan) {
        Some(turning) => turning,
        None => plan.to_schedule(evaluator.test())?,
    };
    let mut outcome = conclude(evaluator, control, &work, schedule)?;
    specification_met(&mut outcome);
    promised(outcome)
}

/// Modes in which tests get shorter need free dwells.
pub(super) fn dwells_stay(mode: &str) -> Error {
    Error::input("where dwells stay as they are, there is one time only")
        .with_key("objective.mode")
        .with_value(format!("\"{mode}\""))
        .with_allowed("\"accuracy\" with the order alone free, or free dwells too")
}

struct RootSearch<'a> {
    context: Context<'a>,
}

impl RootSearch<'_> {
    /// The best candidate in `total_time_s`, from fresh starts and warm plans.
    fn point(&self, total_time_s: f64, starts: usize, warm: &[Plan]) -> Result<Candidate> {
        let problem = SearchProblem {
            total_time_s,
            starts,
            ..self.context.problem.clone()
        };
        best_candidate(self.context.on(&problem), warm)
    }

    /// Narrows [infeasible, feasible] around the shortest time, keeping the feasible end.
    fn narrow(&self, longest: Candidate) -> Result<Candidate> {
        let shortest_s = LeastTime::of(self.context.evaluator.test()).total_s();
        let log_ratio = |c: &Candidate| libm::log(c.criterion.max(f64::MIN_POSITIVE));
        let mut high = (
            libm::log(self.context.problem.total_time_s),
            log_ratio(&longest),
        );
        let mut best = longest;
        // Until a test fails, the power law stands in for the failing end of the bracket.
        let mut low: Option<(f64, f64)> = None;
        for _ in 0..STEPS {
            if self.stop() || low.is_some_and(|low| libm::exp(high.0 - low.0) - 1.0 < WIDTH) {
                break;
            }
            let guess = match low {
                None => high.0 + high.1 / POWER - 0.01,
                Some(low) => low.0 + (high.0 - low.0) * low.1 / (low.1 - high.1),
            };
            let total_time_s = libm::exp(guess).max(shortest_s);
            let starts = (self.context.problem.starts / 4).max(4);
            let warm = [best.plan.clone()];
            match self.point(total_time_s, starts, &warm) {
                Ok(c) if c.criterion <= 1.0 => {
                    high = (guess, log_ratio(&c));
                    best = c;
                    // Illinois: halve the stale end, so that it moves too.
                    low = low.map(|(t, g)| (t, 0.5 * g));
                }
                Ok(c) => {
                    low = Some((guess, log_ratio(&c)));
                    high.1 *= 0.5;
                }
                Err(e) if e.is_infeasible() || e.is_numerical() => low = Some((guess, 1.0)),
                Err(e) => return Err(e),
            }
            if guess <= libm::log(shortest_s) {
                break;
            }
        }
        Ok(best)
    }

    fn stop(&self) -> bool {
        self.context.must_stop()
    }

    /// Takes off whole periods, where it costs least, as long as the specification holds.
    fn trim(&self, mut plan: Plan) -> Plan {
        let platform = self.context.evaluator.test().platform();
        let period = platform.period_s;
        let shortest_s = platform.shortest_dwell_s();
        while !self.stop() {
            let shorter = (0..plan.dwell_s.len()).filter_map(|k| {
                let mut shorter = plan.clone();
                shorter.dwell_s[k] -= period;
                (shorter.dwell_s[k] >= shortest_s).then_some(shorter)
            });
            match self.least(shorter.collect()) {
                Some((ratio, shorter)) if ratio <= 1.0 => plan = shorter,
                _ => return plan,
            }
        }
        plan
    }

    /// The plan of the least ratio, and that.
    fn least(&self, plans: Vec<Plan>) -> Option<(f64, Plan)> {
        let least = |best: (f64, Plan), c: (f64, Plan)| if c.0 < best.0 { c } else { best };
        let model = self.context.evaluator.model();
        if model.is_white() {
            let rated = plans.into_iter();
            return rated
                .filter_map(|p| Some((self.ratio(&p)?, p)))
                .reduce(least);
        }
        // Where drift wanders the exact chain takes its time: all by the searches' route, the best by it.
        let test = self.context.evaluator.test();
        let timelines: Vec<_> = plans.iter().map(|p| p.timeline(test)).collect();
        self.context.work.count_evaluations(plans.len() as u64);
        let criterion = &self.context.evaluator.objective().criterion;
        let logs = model.values(&timelines, TickRule::Filter, |p| {
            criterion.log(p, Smoothing::Exact)
        });
        let rated = logs.into_iter().zip(plans);
        let best = rated
            .filter_map(|(log, p)| Some((log.ok()?, p)))
            .reduce(least)?
            .1;
        Some((self.ratio(&best)?, best))
    }

    /// A shorter test that turns while it measures, if that is allowed and there is one: the
    /// plan's time is shortened as long as turning makes up for it.
    fn turning(&self, plan: &Plan) -> Option<Schedule> {
        if !self.context.problem.allow_tumbling {
            return None;
        }
        let test = self.context.evaluator.test();
        let mut shortest_s = plan.timeline(test).total_time_s();
        let mut trial_s = shortest_s;
        let mut best = None;
        for _ in 0..TURNING_STEPS {
            if self.stop() {
                break;
            }
            let problem = SearchProblem {
                total_time_s: trial_s,
                ..self.context.problem.clone()
            };
            let turned = plan.clone().fitted(test, trial_s);
            match turned.and_then(|plan| tumble(self.context.on(&problem), &plan)) {
                Some((ratio, schedule)) if ratio <= 1.0 => {
                    best = Some(schedule);
                    shortest_s = trial_s;
                    trial_s *= libm::pow(ratio, 1.0 / POWER);
                }
                // Too short: try half way back to the shortest test that meets the specification.
                _ if best.is_some() => trial_s = 0.5 * (trial_s + shortest_s),
                _ => break,
            }
            if shortest_s - trial_s < test.platform().period_s {
                break;
            }
        }
        best
    }

    /// The largest ratio of a σ to its specification, by the filter's own tick rule.
    fn ratio(&self, plan: &Plan) -> Option<f64> {
        self.context.work.count_evaluations(1);
        let timeline = plan.timeline(self.context.evaluator.test());
        // A plan whose ratio cannot be computed meets nothing.
        let found = self.context.evaluator.end_with_criterion(&timeline);
        Some(found.ok()?.1)
    }

    /// The nearest feasible points: what can be met in this time, what time would be enough.
    fn infeasible(&self, longest: &Candidate) -> Result<SearchOutcome> {
        let mut outcome = conclude(
            self.context.evaluator,
            self.context.control,
            self.context.work,
            longest.plan.to_schedule(self.context.evaluator.test())?,
        )?;
        let enough = match self.time_needed(longest) {
            Ok(Some(t)) => EnoughTime::Found(t),
            Ok(None) => EnoughTime::NotFound,
            Err(e) => EnoughTime::Failed(e),
        };
        let complete = matches!(outcome.status, Status::Converged | Status::Infeasible);
        if complete && outcome.evaluation.score.meets_minimum_separability {
            outcome.status = Status::Infeasible;
            outcome.lacking = true;
            outcome.reason = Reason::NotInTime {
                unobservable: outcome.unobservable.clone(),
                allowed_s: self.context.problem.total_time_s,
                missed: MissedSpecification::all(
                    self.context.evaluator.objective(),
                    &outcome.evaluation,
                ),
                times_as_wide: longest.criterion,
                enough,
            };
        }
        Ok(outcome)
    }

    /// A time that is enough, within a few per cent of the least.
    fn time_needed(&self, longest: &Candidate) -> Result<Option<f64>> {
        let limit = LONGEST_TRIAL * self.context.problem.total_time_s;
        let starts = (self.context.problem.starts / 4).max(4);
        let (mut t, mut ratio) = (self.context.problem.total_time_s, longest.criterion);
        let mut plan = longest.plan.clone();
        while ratio > 1.0 && !self.stop() {
            t *= libm::pow(ratio, 1.0 / POWER).max(1.02);
            if t > limit {
                return Ok(None);
            }
            let candidate = self.point(t, starts, std::slice::from_ref(&plan))?;
            (ratio, plan) = (candidate.criterion, candidate.plan);
        }
        Ok((ratio <= 1.0).then_some(t))
    }
}
