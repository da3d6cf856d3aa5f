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

use super::pipeline::Work;
use super::variables::{Plan, Variables};
use crate::criterion::Smoothing;
use crate::evaluate::Evaluator;

/// A refined plan with its merit.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The plan.
    pub plan: Plan,
    /// Its merit (the score, with any penalty), lower is better.
    pub merit: f64,
}

/// Merit of a point that is no plan: far above any real one, but finite, so that a line search
/// can interpolate back from it.
const NO_PLAN: f64 = 1e3;

struct Point {
    x: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
}

struct Problem<'a> {
    evaluator: &'a Evaluator,
    variables: &'a Variables<'a>,
    smoothing: Smoothing,
    work: &'a Work,
    last: RefCell<Option<Point>>,
    best: &'a RefCell<Option<(f64, Vec<f64>)>>,
}

impl Problem<'_> {
    fn compute(&self, x: &[f64]) -> Point {
        self.work.count_gradients(1);
        let no_plan = || Point {
            x: x.to_vec(),
            value: NO_PLAN,
            gradient: vec![0.0; x.len()],
        };
        let Some(plan) = self.variables.decode(x) else {
            return no_plan();
        };
        let timeline = plan.timeline(self.evaluator.platform());
        match self.evaluator.merit_gradient(&timeline, self.smoothing) {
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

impl CostFunction for &Problem<'_> {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        Ok(self.with_point(x, |p| p.value))
    }
}

impl Gradient for &Problem<'_> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;
    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, argmin::core::Error> {
        Ok(self.with_point(x, |p| p.gradient.clone()))
    }
}

/// L-BFGS memory.
const MEMORY: usize = 20;
/// Stop when the gradient of the merit is shorter than this.
const GRADIENT_TOLERANCE: f64 = 1e-5;
/// Stop when the merit changes by less than this.
const COST_TOLERANCE: f64 = 1e-9;

/// Refines angles and dwells of `plan` together; none when the plan has no merit at all.
pub(crate) fn refine(
    evaluator: &Evaluator,
    plan: &Plan,
    total_time_s: f64,
    smoothing: Smoothing,
    iterations: u64,
    work: &Work,
) -> Option<Refined> {
    let variables = Variables::angles_and_dwells(evaluator.platform(), total_time_s);
    minimise(evaluator, &variables, plan, smoothing, iterations, work)
}

/// Refines the angles of `plan`, its dwells held.
pub(crate) fn refine_angles(
    evaluator: &Evaluator,
    plan: &Plan,
    smoothing: Smoothing,
    iterations: u64,
    work: &Work,
) -> Option<Refined> {
    let variables = Variables::angles_only(evaluator.platform(), plan.dwell_s.clone());
    minimise(evaluator, &variables, plan, smoothing, iterations, work)
}

fn minimise(
    evaluator: &Evaluator,
    variables: &Variables<'_>,
    plan: &Plan,
    smoothing: Smoothing,
    iterations: u64,
    work: &Work,
) -> Option<Refined> {
    let best = RefCell::new(None);
    let problem = Problem {
        evaluator,
        variables,
        smoothing,
        work,
        last: RefCell::new(None),
        best: &best,
    };
    let solver = LBFGS::new(MoreThuenteLineSearch::new(), MEMORY)
        .with_tolerance_grad(GRADIENT_TOLERANCE)
        .and_then(|s| s.with_tolerance_cost(COST_TOLERANCE))
        .ok()?;
    let start = variables.encode(plan);
    // Whether it ended in a status or in an error of the line search, what counts is the best
    // point it has seen.
    let _ended = Executor::new(&problem, solver)
        .configure(|state| state.param(start).max_iters(iterations))
        .timer(false)
        .run();
    let (merit, x) = best.into_inner()?;
    let plan = variables.decode(&x)?;
    (merit < NO_PLAN).then_some(Refined { plan, merit })
}
