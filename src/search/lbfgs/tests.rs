//! Against functions whose minima are known, and against argmin's own L-BFGS.

use std::cell::Cell;
use std::sync::{Arc, Mutex};

use argmin::core::observers::{Observe, ObserverMode};
use argmin::core::{CostFunction, Error, Executor, Gradient, KV, State, TerminationReason};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;

use super::solver::{Iterate, MeritFunction, minimise};
use super::*;

/// Rosenbrock's valley in many dimensions, a classic for line searches.
fn rosenbrock(x: &[f64]) -> (f64, Vec<f64>) {
    let mut value = 0.0;
    let mut gradient = vec![0.0; x.len()];
    for i in 0..x.len() - 1 {
        let (bend, off) = (x[i + 1] - x[i] * x[i], 1.0 - x[i]);
        value += 100.0 * bend * bend + off * off;
        gradient[i] -= 400.0 * bend * x[i] + 2.0 * off;
        gradient[i + 1] += 200.0 * bend;
    }
    (value, gradient)
}

fn start() -> Vec<f64> {
    (0..10)
        .map(|i| if i % 2 == 0 { -1.2 } else { 1.0 })
        .collect()
}

/// A function to minimise; it says stop after so many values.
struct Function<F> {
    of: F,
    stop_after: u64,
    told: Cell<u64>,
}

impl<F: Fn(&[f64]) -> Option<(f64, Vec<f64>)>> Function<F> {
    fn new(of: F) -> Self {
        Self {
            of,
            stop_after: 10_000,
            told: Cell::new(0),
        }
    }
}

impl<F: Fn(&[f64]) -> Option<(f64, Vec<f64>)>> MeritFunction for Function<F> {
    fn with_gradient(&self, x: &[f64]) -> Option<(f64, Vec<f64>)> {
        self.told.set(self.told.get() + 1);
        (self.of)(x)
    }

    fn must_stop(&self) -> bool {
        self.told.get() >= self.stop_after
    }
}

/// By argmin's `Executor`.
fn minimised(
    start: Vec<f64>,
    iterations: u64,
    of: impl Fn(&[f64]) -> Option<(f64, Vec<f64>)>,
) -> Minimised {
    let function = Function::new(of);
    let minimised = minimise(&function, start, iterations);
    assert_eq!(minimised.ended.gradients, function.told.get());
    minimised
}

/// Stepped directly, as plans in lanes are.
fn stepped(
    start: Vec<f64>,
    iterations: u64,
    of: impl Fn(&[f64]) -> Option<(f64, Vec<f64>)>,
) -> Minimised {
    let mut search = Lbfgs::new(start, iterations);
    for _ in 0..10_000 {
        let found = of(search.point());
        let found = found.as_ref().map(|(value, g)| (*value, g.as_slice()));
        if let Advance::Ended(termination) = search.tell(found) {
            let minimised = search.into_minimised();
            assert_eq!(minimised.ended.termination, termination);
            return minimised;
        }
    }
    panic!("it does not end")
}

/// The valley for argmin's own solver, counting gradients.
struct Valley<'a>(&'a Cell<u64>);

impl CostFunction for Valley<'_> {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, Error> {
        Ok(rosenbrock(x).0)
    }
}

impl Gradient for Valley<'_> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;
    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, Error> {
        self.0.set(self.0.get() + 1);
        Ok(rosenbrock(x).1)
    }
}

#[test]
fn it_goes_where_argmins_own_goes_with_no_more_work() {
    let Minimised { best, ended } = minimised(start(), 500, |x| Some(rosenbrock(x)));
    let (value, x) = best.unwrap();
    assert!(value < 1e-9, "{value:e}");
    assert!(x.iter().all(|x| (x - 1.0).abs() < 1e-4), "{x:?}");
    let solver = LBFGS::new(MoreThuenteLineSearch::new(), MEMORY)
        .with_tolerance_grad(GRADIENT_TOLERANCE)
        .and_then(|s| s.with_tolerance_cost(COST_TOLERANCE))
        .unwrap();
    let calls = Cell::new(0);
    let theirs = Executor::new(Valley(&calls), solver)
        .configure(|state| state.param(start()).max_iters(500))
        .run()
        .unwrap();
    let (cost, theirs) = (
        theirs.state().get_best_cost(),
        theirs.state().get_best_param().unwrap(),
    );
    assert!(cost < 1e-9, "{cost:e}");
    let apart = x.iter().zip(theirs).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) < 1e-4, "{x:?} {theirs:?}");
    let calls = calls.get();
    assert!(
        ended.gradients <= calls,
        "{} and {calls} gradients",
        ended.gradients
    );
}

#[test]
fn driven_by_argmin_or_stepped_it_takes_one_way() {
    for iterations in [0, 1, 7, 30, 500] {
        let of = |x: &[f64]| (x[0] < 1.001).then(|| rosenbrock(x));
        let driven = minimised(start(), iterations, of);
        assert_eq!(driven, stepped(start(), iterations, of), "{iterations}");
    }
}

#[test]
fn a_quadratic_of_n_variables_takes_few_iterations() {
    let f = |x: &[f64]| {
        let weight = |i: usize| 1.0 + i as f64;
        let value = x.iter().enumerate().map(|(i, x)| 0.5 * weight(i) * x * x);
        let gradient = x.iter().enumerate().map(|(i, x)| weight(i) * x);
        Some((value.sum(), gradient.collect()))
    };
    let Minimised { best, ended } = minimised(vec![1.0; 8], 100, f);
    let value = best.unwrap().0;
    assert!(
        value < 1e-9 && ended.gradients < 30,
        "{value:e} after {ended:?}"
    );
}

#[test]
fn where_there_is_no_value_it_turns_back() {
    // ln has none left of zero; the first step leads there.
    let f = |x: &[f64]| {
        (x[0] > 0.0).then(|| {
            let value = x[0] - 0.01 * x[0].ln();
            (value, vec![1.0 - 0.01 / x[0]])
        })
    };
    let (_, x) = minimised(vec![0.9], 100, f).best.unwrap();
    assert!((x[0] - 0.01).abs() < 1e-4, "{x:?}");
}

#[test]
fn numbers_that_are_not_finite_are_no_values() {
    let wall = |value: f64, slope: f64| {
        move |x: &[f64]| match x[0] > 0.5 {
            true => Some((x[0] * x[0], vec![2.0 * x[0]])),
            false => Some((value, vec![slope])),
        }
    };
    for (value, slope) in [
        (f64::NAN, 0.0),
        (f64::NEG_INFINITY, 0.0),
        (0.0, f64::NAN),
        (0.0, f64::INFINITY),
    ] {
        let Minimised { best, .. } = minimised(vec![2.0], 50, wall(value, slope));
        let (best, x) = best.unwrap();
        assert!(best < 4.0 && x[0] > 0.5, "{value} {slope}: {best} at {x:?}");
        let nothing = minimised(vec![0.1], 50, wall(value, slope));
        assert_eq!(nothing.best, None);
        assert_eq!(nothing.ended.termination, Termination::NoMerit);
    }
}

#[test]
fn it_says_how_it_ended() {
    let bowl = |x: &[f64]| Some((0.5 * x[0] * x[0], vec![x[0]]));
    // Steep and narrow: from near its bottom there is less to gain than the tolerance, though the
    // gradient is longer than its own.
    let narrow = |x: &[f64]| {
        let value = 0.5 * (1e6 * x[0] * x[0] + 1e3 * x[1] * x[1]);
        Some((value, vec![1e6 * x[0], 1e3 * x[1]]))
    };
    // Its gradient points up where it falls.
    let liar = |x: &[f64]| Some((x[0], vec![-1.0]));
    type WithGradient = fn(&[f64]) -> Option<(f64, Vec<f64>)>;
    let by = |start: &[f64], iterations, of: WithGradient| {
        minimised(start.to_vec(), iterations, of).ended.termination
    };
    assert_eq!(by(&[1.0], 50, bowl), Termination::GradientConverged);
    assert_eq!(by(&[0.0], 0, bowl), Termination::GradientConverged);
    assert_eq!(by(&[1.0], 0, bowl), Termination::IterationLimit);
    assert_eq!(by(&[1.0], 50, |_| None), Termination::NoMerit);
    assert_eq!(by(&[2e-8, 2e-7], 50, narrow), Termination::CostConverged);
    assert_eq!(by(&[1.0], 50, liar), Termination::LineSearchFailed);
    let valley = by(&start(), 5, |x| Some(rosenbrock(x)));
    assert_eq!(valley, Termination::IterationLimit);
}

/// The valley, without values along quasi-Newton directions until steepest descent has been tried
/// `failures` times.
fn with_failures(failures: u64) -> Minimised {
    let mut search = Lbfgs::new(start(), 500);
    for _ in 0..10_000 {
        let fails = search.restarts < failures && !search.pairs.is_empty();
        let (value, gradient) = rosenbrock(search.point());
        let found = (!fails).then_some((value, gradient.as_slice()));
        if let Advance::Ended(_) = search.tell(found) {
            return search.into_minimised();
        }
    }
    panic!("it does not end")
}

#[test]
fn a_line_search_that_fails_is_begun_anew_by_steepest_descent() {
    for failures in [1, 3] {
        let Minimised { best, ended } = with_failures(failures);
        let value = best.unwrap().0;
        assert!(value < 1e-9, "{value:e}, {ended:?}");
        assert_eq!(ended.restarts, failures);
        assert_ne!(ended.termination, Termination::LineSearchFailed);
    }
}

#[test]
fn where_steepest_descent_fails_too_it_ends() {
    let told = Cell::new(0);
    let Minimised { best, ended } = minimised(start(), 500, |x| {
        told.set(told.get() + 1);
        (told.get() <= 12).then(|| rosenbrock(x))
    });
    assert_eq!(ended.termination, Termination::LineSearchFailed);
    assert_eq!(ended.restarts, 1);
    assert!(best.unwrap().0 < rosenbrock(&start()).0);
}

#[test]
fn it_stops_when_told_to_with_what_it_has() {
    for stop_after in [1, 2, 9] {
        let function = Function {
            stop_after,
            ..Function::new(|x: &[f64]| Some(rosenbrock(x)))
        };
        let Minimised { best, ended } = minimise(&function, start(), 500);
        assert_eq!(ended.termination, Termination::Stopped);
        assert_eq!(ended.gradients, stop_after);
        assert!(best.unwrap().0 <= rosenbrock(&start()).0);
    }
    // From the first value on, so that there is a best.
    let function = Function {
        stop_after: 0,
        ..Function::new(|x: &[f64]| Some(rosenbrock(x)))
    };
    assert!(minimise(&function, start(), 500).best.is_some());
}

/// What an observer of argmin sees.
#[derive(Default)]
struct Observed {
    costs: Vec<f64>,
    ended: Option<(TerminationReason, u64, u64)>,
}

struct Watch(Arc<Mutex<Observed>>);

impl Observe<Iterate> for Watch {
    fn observe_iter(&mut self, state: &Iterate, _: &KV) -> Result<(), Error> {
        self.0.lock().unwrap().costs.push(state.get_cost());
        Ok(())
    }

    fn observe_final(&mut self, state: &Iterate) -> Result<(), Error> {
        let reason = state.get_termination_reason().unwrap().clone();
        let ended = (reason, state.get_iter(), state.get_max_iters());
        self.0.lock().unwrap().ended = Some(ended);
        Ok(())
    }
}

#[test]
fn argmins_state_and_observers_see_it_fall_and_end() {
    for (iterations, reason) in [
        (500, TerminationReason::SolverConverged),
        (12, TerminationReason::MaxItersReached),
    ] {
        let seen = Arc::new(Mutex::new(Observed::default()));
        let function = Function::new(|x: &[f64]| Some(rosenbrock(x)));
        let mut solver = Lbfgs::new(start(), iterations);
        let done = Executor::new(&function, &mut solver)
            .add_observer(Watch(Arc::clone(&seen)), ObserverMode::Always)
            .ctrlc(false)
            .run()
            .unwrap();
        let (cost, gradients) = (
            done.state().get_best_cost(),
            done.problem().counts["gradient_count"],
        );
        let Minimised { best, ended } = solver.into_minimised();
        assert!(best.unwrap().0 <= cost);
        assert_eq!(gradients, ended.gradients);
        let Observed { costs, ended } = &*seen.lock().unwrap();
        assert!(costs.windows(2).all(|w| w[1] <= w[0]), "{costs:?}");
        let (seen_reason, count, most) = ended.clone().unwrap();
        assert_eq!((seen_reason, most), (reason, iterations));
        assert_eq!(count, costs.len() as u64);
        assert!(iterations == 500 || count == iterations);
    }
}
