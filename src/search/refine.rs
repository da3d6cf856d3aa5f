//! Refinement of a plan: L-BFGS ([`super::lbfgs`]) with the exact gradient, driven by argmin.
//!
//! Memory 20, Moré–Thuente line search, gradient tolerance 1e-5, cost tolerance 1e-9 on the
//! logarithm of the criterion. (Finite-difference gradients stop about 10 % early.) What comes of it
//! is the best point seen, trial points included, and how it ended.

use super::context::Context;
use super::lbfgs::solver::{self, MeritFunction};
use super::plan::Plan;
use super::rated::Refined;
use super::variables::{Coordinates, Variables};
use crate::criterion::Smoothing;

/// The merit as a function of the variables.
struct MeritOf<'a, C> {
    context: Context<'a>,
    variables: &'a C,
    smoothing: Smoothing,
}

impl<C: Coordinates> MeritFunction for MeritOf<'_, C> {
    fn with_gradient(&self, x: &[f64]) -> Option<(f64, Vec<f64>)> {
        let timeline = self.variables.timeline(x)?;
        let evaluator = self.context.evaluator;
        // Where the covariance cannot be computed there is no merit, and the line search turns back.
        let (value, legs) = evaluator.merit_gradient(&timeline, self.smoothing).ok()?;
        Some((value, self.variables.pull_back(x, &timeline, &legs)))
    }

    fn must_stop(&self) -> bool {
        self.context.must_stop()
    }
}

/// Refines angles and dwells of `plan` together; none when the plan has no merit at all.
pub(crate) fn refine(
    context: Context<'_>,
    plan: &Plan,
    smoothing: Smoothing,
    iterations: u64,
) -> Option<Refined> {
    let test = context.evaluator.test();
    let variables = Variables::angles_and_dwells(test, context.problem.total_time_s);
    refine_in(context, &variables, plan, smoothing, iterations)
}

/// Refines the angles of `plan`, its dwells held.
pub(crate) fn refine_angles(
    context: Context<'_>,
    plan: &Plan,
    smoothing: Smoothing,
    iterations: u64,
) -> Option<Refined> {
    let test = context.evaluator.test();
    let variables = Variables::angles_only(test, plan.dwell_s.clone());
    refine_in(context, &variables, plan, smoothing, iterations)
}

/// Refines a plan in the variables that move it.
fn refine_in(
    context: Context<'_>,
    variables: &Variables<'_>,
    plan: &Plan,
    smoothing: Smoothing,
    iterations: u64,
) -> Option<Refined> {
    let variables = &variables.of(plan);
    let start = variables.encode(plan);
    let (merit, x) = minimise(context, variables, start, smoothing, iterations)?;
    let plan = variables.decode(&x)?;
    Some(Refined { plan, merit })
}

/// The best point L-BFGS sees from `start`, with its merit; none when it sees no timeline. Ends
/// soon when the search is stopped. How it ended is counted.
pub(crate) fn minimise<C: Coordinates>(
    context: Context<'_>,
    variables: &C,
    start: Vec<f64>,
    smoothing: Smoothing,
    iterations: u64,
) -> Option<(f64, Vec<f64>)> {
    let merit = MeritOf {
        context,
        variables,
        smoothing,
    };
    let minimised = solver::minimise(&merit, start, iterations);
    context.work.count_refinement(minimised.ended);
    minimised.best
}

#[cfg(test)]
mod tests {
    use argmin::core::{CostFunction, Error, Executor, Gradient};
    use argmin::solver::linesearch::MoreThuenteLineSearch;
    use argmin::solver::quasinewton::LBFGS;

    use super::*;
    use crate::evaluate::{Evaluator, Objective};
    use crate::platform::PlatformConfig;
    use crate::search::context::WorkDone;
    use crate::search::problem::SearchProblem;
    use crate::search::progress::Control;
    use crate::search::propose::starts;
    use crate::search::together::refine_all;

    impl<C: Coordinates> CostFunction for &MeritOf<'_, C> {
        type Param = Vec<f64>;
        type Output = f64;
        fn cost(&self, x: &Vec<f64>) -> Result<f64, Error> {
            // Far above any merit, but finite, so that its line search can turn back.
            Ok(self.with_gradient(x).map_or(1e10, |found| found.0))
        }
    }

    impl<C: Coordinates> Gradient for &MeritOf<'_, C> {
        type Param = Vec<f64>;
        type Gradient = Vec<f64>;
        fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, Error> {
            let none = || vec![0.0; x.len()];
            Ok(self.with_gradient(x).map_or_else(none, |found| found.1))
        }
    }

    /// The merit that argmin's own L-BFGS comes to; infinite where it comes to none.
    fn by_argmins_own(merit: &MeritOf<'_, Variables<'_>>, start: Vec<f64>) -> f64 {
        let solver = LBFGS::new(MoreThuenteLineSearch::new(), 20)
            .with_tolerance_grad(1e-5)
            .and_then(|s| s.with_tolerance_cost(1e-9))
            .unwrap();
        let done = Executor::new(merit, solver)
            .configure(|state| state.param(start).max_iters(400))
            .run();
        done.map_or(f64::INFINITY, |done| done.state().get_best_cost())
    }

    #[test]
    fn plans_are_worked_out_as_well_as_by_argmins_own() {
        for slew_rate_deg_per_s in [None, Some(0.5)] {
            let mut config = PlatformConfig::default();
            config.motion.slew_rate_deg_per_s = slew_rate_deg_per_s.map(Into::into);
            let objective = Objective {
                separability_weight: 0.0,
                ..Objective::default()
            };
            let evaluator = Evaluator::new(config.check().unwrap(), objective);
            let problem = SearchProblem {
                starts: 12,
                ..SearchProblem::default()
            };
            let control = Control::default();
            let context = Context {
                evaluator: &evaluator,
                problem: &problem,
                control: &control,
                work: &WorkDone::default(),
            };
            let smoothing = Smoothing::Exact;
            // Screened: near enough to a minimum that both should come to the same one.
            let plans = starts(&evaluator, &problem).unwrap();
            let screened = refine_all(context, plans, smoothing, 90);
            let variables = Variables::angles_and_dwells(evaluator.test(), problem.total_time_s);
            let merit = MeritOf {
                context,
                variables: &variables,
                smoothing,
            };
            let gains: Vec<f64> = screened
                .into_iter()
                .flatten()
                .map(|screened| {
                    let ours = refine(context, &screened.plan, smoothing, 400).unwrap();
                    by_argmins_own(&merit, variables.encode(&screened.plan)) - ours.merit
                })
                .collect();
            let mean = gains.iter().sum::<f64>() / gains.len() as f64;
            assert!(gains.len() >= 12 && mean > -1e-4, "{gains:?}");
        }
    }
}
