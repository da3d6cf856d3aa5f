//! L-BFGS that can be stepped: it says where it wants value and gradient, and is told them.
//!
//! argmin's solver ([`super::refine`]) works one plan out to its end and calls for gradients from
//! inside. To advance many plans together, each gradient in a lane ([`super::together`]), the
//! method has to hand out its points instead. It is the same method: the two-loop recursion over
//! the last [`MEMORY`] steps (Nocedal & Wright, *Numerical Optimization*, algorithm 7.4),
//! H₀ = γ I with γ = sᵀy / yᵀy, and a line search for the strong Wolfe conditions
//! ([`line_search`]).

mod line_search;

use std::collections::VecDeque;

use line_search::{LineSearch, Next, Slope};

use super::refine::{COST_TOLERANCE, GRADIENT_TOLERANCE, MEMORY};

/// Evaluations that one line search may take.
const MOST_TRIALS: usize = 20;

/// A step and how the gradient changed along it, with 1/(sᵀy).
#[derive(Debug, Clone)]
struct Pair {
    s: Vec<f64>,
    y: Vec<f64>,
    per_curvature: f64,
}

/// Value and gradient at a point; none where there are none.
pub(super) type Found<'a> = Option<(f64, &'a [f64])>;

/// What becomes of a minimisation that has been told a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Progress {
    /// It asks for another point.
    Goes,
    /// It has come to its end.
    Ended,
}

/// A minimisation on its way.
#[derive(Debug, Clone)]
pub(super) struct Lbfgs {
    /// The last point accepted, with its value and gradient.
    x: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
    /// The point asked for.
    trial: Vec<f64>,
    direction: Vec<f64>,
    /// Along `direction`; none: the start has not been seen yet.
    line: Option<LineSearch>,
    trials: usize,
    pairs: VecDeque<Pair>,
    iterations_left: u64,
    best: Option<(f64, Vec<f64>)>,
}

impl Lbfgs {
    /// From `start`, for at most so many iterations.
    pub fn new(start: Vec<f64>, iterations: u64) -> Self {
        let zeros = vec![0.0; start.len()];
        Self {
            trial: start.clone(),
            x: start,
            value: f64::INFINITY,
            gradient: zeros.clone(),
            direction: zeros,
            line: None,
            trials: 0,
            pairs: VecDeque::with_capacity(MEMORY),
            iterations_left: iterations,
            best: None,
        }
    }

    /// The point whose value and gradient are wanted.
    pub fn point(&self) -> &[f64] {
        &self.trial
    }

    /// The best point seen, with its value.
    pub fn into_best(self) -> Option<(f64, Vec<f64>)> {
        self.best
    }

    /// Takes value and gradient at [`Lbfgs::point`].
    pub fn tell(&mut self, found: Found<'_>) -> Progress {
        let found = found.filter(|(value, _)| value.is_finite());
        self.keep_best(found);
        self.trials += 1;
        let Some(line) = &mut self.line else {
            return match found {
                Some((value, gradient)) => {
                    self.value = value;
                    self.gradient.copy_from_slice(gradient);
                    self.search_on()
                }
                None => Progress::Ended,
            };
        };
        let slope = found.map(|(value, gradient)| Slope {
            value,
            slope: dot(gradient, &self.direction),
        });
        match line.next(slope) {
            Next::Try(step) if self.trials < MOST_TRIALS => {
                self.go(step);
                Progress::Goes
            }
            Next::Try(_) | Next::Accept => self.accept(found),
            Next::Fail => self.start_anew(),
        }
    }

    fn keep_best(&mut self, found: Found<'_>) {
        let Some((value, _)) = found else { return };
        match &mut self.best {
            Some((best, x)) if value < *best => {
                *best = value;
                x.copy_from_slice(&self.trial);
            }
            Some(_) => {}
            None => self.best = Some((value, self.trial.clone())),
        }
    }

    /// Takes the trial point where it is better than the last one.
    fn accept(&mut self, found: Found<'_>) -> Progress {
        let Some((value, gradient)) = found.filter(|(value, _)| *value < self.value) else {
            return self.start_anew();
        };
        let gain = self.value - value;
        self.remember(gradient);
        self.value = value;
        self.x.copy_from_slice(&self.trial);
        self.gradient.copy_from_slice(gradient);
        if gain < COST_TOLERANCE {
            return Progress::Ended;
        }
        self.search_on()
    }

    /// The line search has found nothing: once more by steepest descent, else the end.
    fn start_anew(&mut self) -> Progress {
        if self.pairs.is_empty() {
            return Progress::Ended;
        }
        self.pairs.clear();
        self.search_on()
    }

    /// Puts the step from x to the trial point down.
    fn remember(&mut self, gradient: &[f64]) {
        let oldest = match self.pairs.len() < MEMORY {
            true => None,
            false => self.pairs.pop_front(),
        };
        let mut pair = oldest.unwrap_or_else(|| Pair {
            s: vec![0.0; self.x.len()],
            y: vec![0.0; self.x.len()],
            per_curvature: 0.0,
        });
        subtract(&mut pair.s, &self.trial, &self.x);
        subtract(&mut pair.y, gradient, &self.gradient);
        let curvature = dot(&pair.s, &pair.y);
        // The Wolfe conditions make it positive; a step taken for want of trials may not.
        if curvature > f64::EPSILON * dot(&pair.y, &pair.y) {
            pair.per_curvature = 1.0 / curvature;
            self.pairs.push_back(pair);
        }
    }

    /// A new direction from the present point.
    fn search_on(&mut self) -> Progress {
        let length = dot(&self.gradient, &self.gradient).sqrt();
        if length.is_nan() || length < GRADIENT_TOLERANCE || self.iterations_left == 0 {
            return Progress::Ended;
        }
        self.iterations_left -= 1;
        self.turn();
        let mut slope = dot(&self.gradient, &self.direction);
        if slope.is_nan() || slope >= 0.0 {
            // Rounding has spoilt the pairs: steepest descent.
            self.pairs.clear();
            self.turn();
            slope = -length * length;
        }
        self.trials = 0;
        self.line = Some(LineSearch::new(Slope {
            value: self.value,
            slope,
        }));
        self.go(1.0);
        Progress::Goes
    }

    /// direction = −H g by the two-loop recursion.
    fn turn(&mut self) {
        for (d, g) in self.direction.iter_mut().zip(&self.gradient) {
            *d = -g;
        }
        let mut alpha = [0.0; MEMORY];
        for (pair, alpha) in self.pairs.iter().zip(&mut alpha).rev() {
            *alpha = pair.per_curvature * dot(&pair.s, &self.direction);
            add(&mut self.direction, -*alpha, &pair.y);
        }
        if let Some(last) = self.pairs.back() {
            let gamma = 1.0 / (last.per_curvature * dot(&last.y, &last.y));
            for d in &mut self.direction {
                *d *= gamma;
            }
        }
        for (pair, alpha) in self.pairs.iter().zip(&alpha) {
            let beta = pair.per_curvature * dot(&pair.y, &self.direction);
            add(&mut self.direction, alpha - beta, &pair.s);
        }
    }

    /// The trial point at `step` along the direction.
    fn go(&mut self, step: f64) {
        for ((trial, x), d) in self.trial.iter_mut().zip(&self.x).zip(&self.direction) {
            *trial = x + step * d;
        }
    }
}

/// aᵀb. Four sums side by side: one alone would wait for itself.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a, a_rest) = a.as_chunks::<4>();
    let (b, b_rest) = b.as_chunks::<4>();
    let mut sums = [0.0; 4];
    for (a, b) in a.iter().zip(b) {
        for i in 0..4 {
            sums[i] += a[i] * b[i];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    (sums[0] + sums[2]) + (sums[1] + sums[3]) + rest
}

/// `to` = a − b.
fn subtract(to: &mut [f64], a: &[f64], b: &[f64]) {
    for ((to, a), b) in to.iter_mut().zip(a).zip(b) {
        *to = a - b;
    }
}

/// `to` + `factor` · `of`.
fn add(to: &mut [f64], factor: f64, of: &[f64]) {
    for (to, of) in to.iter_mut().zip(of) {
        *to += factor * of;
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use argmin::core::{CostFunction, Executor, Gradient};
    use argmin::solver::linesearch::MoreThuenteLineSearch;
    use argmin::solver::quasinewton::LBFGS;

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

    /// The best point, and how many evaluations it took.
    fn minimised(
        start: Vec<f64>,
        iterations: u64,
        f: impl Fn(&[f64]) -> Option<(f64, Vec<f64>)>,
    ) -> (f64, Vec<f64>, usize) {
        let mut search = Lbfgs::new(start, iterations);
        let mut count = 0;
        loop {
            count += 1;
            let found = f(search.point());
            let found = found.as_ref().map(|(value, g)| (*value, g.as_slice()));
            if search.tell(found) == Progress::Ended {
                break;
            }
            assert!(count < 10_000);
        }
        let (value, x) = search.into_best().unwrap();
        (value, x, count)
    }

    /// The valley for argmin, counting gradients.
    struct Valley<'a>(&'a Cell<usize>);

    impl CostFunction for Valley<'_> {
        type Param = Vec<f64>;
        type Output = f64;
        fn cost(&self, x: &Vec<f64>) -> Result<f64, argmin::core::Error> {
            Ok(rosenbrock(x).0)
        }
    }

    impl Gradient for Valley<'_> {
        type Param = Vec<f64>;
        type Gradient = Vec<f64>;
        fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, argmin::core::Error> {
            self.0.set(self.0.get() + 1);
            Ok(rosenbrock(x).1)
        }
    }

    fn start() -> Vec<f64> {
        (0..10)
            .map(|i| if i % 2 == 0 { -1.2 } else { 1.0 })
            .collect()
    }

    #[test]
    fn it_goes_where_argmins_solver_goes_with_no_more_work() {
        let (value, x, count) = minimised(start(), 500, |x| Some(rosenbrock(x)));
        assert!(value < 1e-9, "{value:e}");
        assert!(x.iter().all(|x| (x - 1.0).abs() < 1e-4), "{x:?}");
        let solver = LBFGS::new(MoreThuenteLineSearch::new(), MEMORY)
            .with_tolerance_grad(GRADIENT_TOLERANCE)
            .and_then(|s| s.with_tolerance_cost(COST_TOLERANCE))
            .unwrap();
        let calls = Cell::new(0);
        let ended = Executor::new(Valley(&calls), solver)
            .configure(|state| state.param(start()).max_iters(500))
            .run()
            .unwrap();
        let theirs = ended.state().get_best_cost();
        assert!(theirs < 1e-9, "{theirs:e}");
        let calls = calls.get();
        assert!(count <= calls, "{count} and {calls} gradients");
    }

    #[test]
    fn a_quadratic_of_n_variables_takes_few_iterations() {
        let f = |x: &[f64]| {
            let weight = |i: usize| 1.0 + i as f64;
            let value = x.iter().enumerate().map(|(i, x)| 0.5 * weight(i) * x * x);
            let gradient = x.iter().enumerate().map(|(i, x)| weight(i) * x);
            Some((value.sum(), gradient.collect()))
        };
        let (value, _, count) = minimised(vec![1.0; 8], 100, f);
        assert!(value < 1e-9 && count < 30, "{value:e} after {count}");
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
        let (_, x, _) = minimised(vec![0.9], 100, f);
        assert!((x[0] - 0.01).abs() < 1e-4, "{x:?}");
        // Nowhere at all.
        let mut nowhere = Lbfgs::new(vec![1.0], 10);
        assert_eq!(nowhere.tell(None), Progress::Ended);
        assert!(nowhere.into_best().is_none());
    }

    #[test]
    fn it_keeps_to_its_iterations() {
        let short = minimised(start(), 5, |x| Some(rosenbrock(x)));
        let long = minimised(start(), 50, |x| Some(rosenbrock(x)));
        assert!(short.0 > long.0 && short.2 < long.2);
    }
}
