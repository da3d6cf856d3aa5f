//! L-BFGS that can be stepped: it says where it wants value and gradient, and is told them.
//!
//! The two-loop recursion over the last [`MEMORY`] steps (Nocedal & Wright, *Numerical
//! Optimization*, algorithm 7.4), H₀ = γ I with γ = sᵀy / yᵀy, and a line search for the strong
//! Wolfe conditions ([`line_search`]). Where the line search fails although the gradient is not
//! short, the pairs are forgotten and steepest descent is tried once from that point before the
//! minimisation counts as ended. The best point seen is kept, trial points included: a line search
//! may accept another than the lowest it has tried.
//!
//! There are two who step it. One plan is driven by argmin ([`solver`]): its `Executor` runs the
//! loop over iterations, its `IterState` holds iterate and termination. Many plans are advanced
//! together, each gradient in a lane ([`super::together`]); there the method is stepped directly,
//! because argmin's loop is over the iterations of one minimisation, and eight of them are in the
//! midst of their line searches at different points: an argmin `State` of such a group would have
//! no parameter, no cost and no iteration of its own, and the loop would hide in a single
//! `next_iter`. Both ask the same [`Lbfgs`], so a plan refined alone takes the way that it takes in
//! a group (`a_plan_alone_takes_the_way_that_it_takes_in_a_group`), and both learn the same
//! [`Termination`].

mod line_search;
pub(super) mod solver;

use std::collections::VecDeque;

use line_search::{LinePoint, LineSearch, Next};

use super::termination::Termination;

/// Steps that are remembered.
const MEMORY: usize = 20;
/// Stop when the gradient of the merit is shorter than this.
const GRADIENT_TOLERANCE: f64 = 1e-5;
/// Stop when an iteration gains less than this.
const COST_TOLERANCE: f64 = 1e-9;
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
pub(super) type ValueAndGradient<'a> = Option<(f64, &'a [f64])>;

/// What becomes of a minimisation that has been told a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Advance {
    /// It asks for another point of the same line.
    Tries,
    /// A line search is done; it asks for the first point of the next.
    Iterates,
    /// It has come to its end.
    Ended(Termination),
}

/// What came of a minimisation.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Minimised {
    /// The best point seen, with its value; none when no point had one.
    pub best: Option<(f64, Vec<f64>)>,
    /// How it ended, and what it took.
    pub ended: Ended,
}

/// How a minimisation ended, and what it took.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Ended {
    /// Why it ended.
    pub termination: Termination,
    /// Values with gradient that it was told.
    pub gradients: u64,
    /// Line searches that failed and were begun anew along steepest descent.
    pub restarts: u64,
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
    iterations: u64,
    most_iterations: u64,
    best: Option<(f64, Vec<f64>)>,
    gradients: u64,
    restarts: u64,
    termination: Option<Termination>,
}

impl Lbfgs {
    /// From `start`, for at most so many iterations.
    pub fn new(start: Vec<f64>, most_iterations: u64) -> Self {
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
            iterations: 0,
            most_iterations,
            best: None,
            gradients: 0,
            restarts: 0,
            termination: None,
        }
    }

    /// The point whose value and gradient are wanted.
    pub fn point(&self) -> &[f64] {
        &self.trial
    }

    /// What came of it, as far as it has come: one that has not ended was stopped.
    pub fn into_minimised(self) -> Minimised {
        Minimised {
            best: self.best,
            ended: Ended {
                termination: self.termination.unwrap_or(Termination::Stopped),
                gradients: self.gradients,
                restarts: self.restarts,
            },
        }
    }

    /// Takes value and gradient at [`Lbfgs::point`]. Numbers that are not finite count as none.
    pub fn tell(&mut self, found: ValueAndGradient<'_>) -> Advance {
        let is_finite = |f: &(f64, &[f64])| f.0.is_finite() && f.1.iter().all(|g| g.is_finite());
        let found = found.filter(is_finite);
        self.keep_best(found);
        self.gradients += 1;
        self.trials += 1;
        let Some(line) = &mut self.line else {
            return match found {
                Some((value, gradient)) => {
                    self.value = value;
                    self.gradient.copy_from_slice(gradient);
                    self.search_on()
                }
                None => self.end(Termination::NoMerit),
            };
        };
        let slope = found.map(|(value, gradient)| LinePoint {
            value,
            slope: dot(gradient, &self.direction),
        });
        match line.next(slope) {
            Next::Try(step) if self.trials < MOST_TRIALS => {
                self.go(step);
                Advance::Tries
            }
            Next::Try(_) | Next::Accept => self.accept(found),
            Next::Fail => self.start_anew(),
        }
    }

    fn end(&mut self, termination: Termination) -> Advance {
        self.termination = Some(termination);
        Advance::Ended(termination)
    }

    fn keep_best(&mut self, found: ValueAndGradient<'_>) {
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
    fn accept(&mut self, found: ValueAndGradient<'_>) -> Advance {
        let Some((value, gradient)) = found.filter(|(value, _)| *value < self.value) else {
            return self.start_anew();
        };
        let gain = self.value - value;
        self.remember(gradient);
        self.value = value;
        self.x.copy_from_slice(&self.trial);
        self.gradient.copy_from_slice(gradient);
        if self.is_stationary() {
            return self.end(Termination::GradientConverged);
        }
        if gain < COST_TOLERANCE {
            return self.end(Termination::CostConverged);
        }
        self.search_on()
    }

    /// The line search has found nothing: once more by steepest descent, else the end.
    fn start_anew(&mut self) -> Advance {
        if self.pairs.is_empty() {
            return self.end(Termination::LineSearchFailed);
        }
        self.pairs.clear();
        self.restarts += 1;
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
        // Positive after a step that meets the Wolfe conditions. A step that was taken because the
        // trials were used up need not, and its pair would spoil the approximation.
        if curvature > f64::EPSILON * dot(&pair.y, &pair.y) {
            pair.per_curvature = 1.0 / curvature;
            self.pairs.push_back(pair);
        }
    }

    fn is_stationary(&self) -> bool {
        dot(&self.gradient, &self.gradient).sqrt() < GRADIENT_TOLERANCE
    }

    /// A new direction from the present point.
    fn search_on(&mut self) -> Advance {
        if self.is_stationary() {
            return self.end(Termination::GradientConverged);
        }
        if self.iterations == self.most_iterations {
            return self.end(Termination::IterationLimit);
        }
        self.iterations += 1;
        self.turn();
        let mut slope = dot(&self.gradient, &self.direction);
        if slope.is_nan() || slope >= 0.0 {
            // Only rounding in the pairs can point uphill: forget them, steepest descent.
            self.pairs.clear();
            self.turn();
            slope = dot(&self.gradient, &self.direction);
        }
        self.trials = 0;
        self.line = Some(LineSearch::new(LinePoint {
            value: self.value,
            slope,
        }));
        self.go(1.0);
        Advance::Iterates
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
mod tests;
