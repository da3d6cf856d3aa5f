//! Refinement of a plan: L-BFGS ([`super::lbfgs`]) with the exact gradient, driven by argmin.
//!
//! Memory 20, Moré–Thuente line search, gradient tolerance 1e-5, cost tolerance 1e-9 on the
//! logarithm of the criterion. (Finite-difference gradients stop about 10 % early.) What comes of it
//! is the best point seen, trial points included, and how it ended.

use super::context::Context;
use super::lbfgs::solver::{self, Merit};
use super::plan::Refined;
use super::variables::{Coordinates, Plan, Variables};
use crate::criterion::Smoothing;

/// The merit as a function of the variables.
struct MeritOf<'a, C> {
    context: Context<'a>,
    variables: &'a C,
    smoothing: Smoothing,
}

impl<C: Coordinates> Merit for MeritOf<'_, C> {
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
    let platform = context.evaluator.platform();
    let variables = Variables::angles_and_dwells(platform, context.problem.total_time_s);
    refine_in(context, &variables, plan, smoothing, iterations)
}

/// Refines the angles of `plan`, its dwells held.
pub(crate) fn refine_angles(
    context: Context<'_>,
    plan: &Plan,
    smoothing: Smoothing,
    iterations: u64,
) -> Option<Refined> {
    let platform = context.evaluator.platform();
    let variables = Variables::angles_only(platform, plan.dwell_s.clone());
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
