//! Refinement of a plan: argmin's L-BFGS with the exact gradient.
//!
//! Memory 20, Moré–Thuente line search, gradient tolerance 1e-5, cost tolerance 1e-9 on the
//! logarithm of the criterion. (Hager–Zhang sometimes stops with an internal error inside an
//! `Ok`; finite-difference gradients stop about 10 % early.) argmin asks for cost and gradient in
//! separate calls at the same point, so the last point is remembered; and because a line search
//! may end in an error after having seen better points than it returns, the best point seen is
//! kept here and not taken from argmin's state.

use std::cell::RefCell;

use argmin::core::{CostFunction, Executor, Gradient};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;

use super::pipeline::Context;
use super::variables::{Plan, Variables};
use crate::covariance::gradient::LegGradient;
use crate::criterion::Smoothing;
use crate::motion::Timeline;

/// A refined plan with its merit.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The plan.
    pub plan: Plan,
    /// Its merit (the score, with any penalty), lower is better.
    pub merit: f64,
}

impl Refined {
    /// The better of two; of equals the first, whatever thread was faster.
    pub(super) fn better(self, other: Self) -> Self {
        if other.merit < self.merit {
            other
        } else {
            self
        }
    }
}

/// Merit of a point that is no plan: far above any real one whatever the weights (each at most
/// 1e6, on logarithms), but finite, so that a line search can interpolate back from it.
const NO_PLAN: f64 = 1e10;

struct Point {
    x: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
}

/// Free variables behind a timeline.
pub(crate) trait Coordinates {
    /// The timeline of `x`; none where there is none.
    fn timeline(&self, x: &[f64]) -> Option<Timeline>;
    /// The gradient with respect to `x` from that of the timeline.
    fn pull_back(&self, x: &[f64], timeline: &Timeline, legs: &[LegGradient]) -> Vec<f64>;
}

struct Problem<'a, C> {
    context: Context<'a>,
    variables: &'a C,
    smoothing: Smoothing,
    last: RefCell<Option<Point>>,
    best: &'a RefCell<Option<(f64, Vec<f64>)>>,
}

impl<C: Coordinates> Problem<'_, C> {
    fn compute(&self, x: &[f64]) -> Point {
        self.context.work.count_gradients(1);
        let no_plan = || Point {
            x: x.to_vec(),
            value: NO_PLAN,
            gradient: vec![0.0; x.len()],
        };
        let Some(timeline) = self.variables.timeline(x) else {
            return no_plan();
        };
        match self
            .context
            .evaluator
            .merit_gradient(&timeline, self.smoothing)
        {
            Ok((value, legs)) if value.is_finite() => Point {
                x: x.to_vec(),
                value,
                gradient: self.variables.pull_back(x, &timeline, &legs),
            },
            _ => no_plan(),
        }
    }

    /// The point at `x`, computed once for cost and gradient.
    fn with_point<T>(&self, x: &[f64], take: impl FnOnce(&Point) -> T) -> T {
        let mut last = self.last.borrow_mut();
        let point = match last.take().filter(|p| p.x == x) {
            Some(known) => known,
            None => {
                let point = self.compute(x);
                let mut best = self.best.borrow_mut();
                if best.as_ref().is_none_or(|(value, _)| point.value < *value) {
                    *best = Some((point.value, point.x.clone()));
                }
                point
            }
        };
        take(last.insert(point))
    }
}

impl<C: Coordinates> CostFunction for &Problem<'_, C> {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        if self.best.borrow().is_some() && self.context.must_stop() {
            return Err(argmin::core::Error::msg("stopped"));
        }
        Ok(self.with_point(x, |p| p.value))
    }
}

impl<C: Coordinates> Gradient for &Problem<'_, C> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;
    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, argmin::core::Error> {
        Ok(self.with_point(x, |p| p.gradient.clone()))
    }
}

/// L-BFGS memory.
pub(super) const MEMORY: usize = 20;
/// Stop when the gradient of the merit is shorter than this.
pub(super) const GRADIENT_TOLERANCE: f64 = 1e-5;
/// Stop when the merit changes by less than this.
pub(super) const COST_TOLERANCE: f64 = 1e-9;

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
/// soon when the search is stopped.
pub(crate) fn minimise<C: Coordinates>(
    context: Context<'_>,
    variables: &C,
    start: Vec<f64>,
    smoothing: Smoothing,
    iterations: u64,
) -> Option<(f64, Vec<f64>)> {
    let best = RefCell::new(None);
    let problem = Problem {
        context,
        variables,
        smoothing,
        last: RefCell::new(None),
        best: &best,
    };
    let solver = LBFGS::new(MoreThuenteLineSearch::new(), MEMORY)
        .with_tolerance_grad(GRADIENT_TOLERANCE)
        .and_then(|s| s.with_tolerance_cost(COST_TOLERANCE))
        .ok()?;
    // Whether it ended in a status or in an error of the line search, what counts is the best
    // point it has seen.
    let _ended = Executor::new(&problem, solver)
        .configure(|state| state.param(start).max_iters(iterations))
        .timer(false)
        .run();
    best.into_inner().filter(|(merit, _)| *merit < NO_PLAN)
}
