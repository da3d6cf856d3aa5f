//! Drift and biases that wander, in truth and filter: exact in discrete time.
//!
//! Of a process d over an interval of length h only two numbers count, d at its end and the mean of d in
//! it, which drives the platform as a constant drift would:
//!
//! ```text
//! d₊ = e^{−h/τ} d + w_1,    d̄ = μ d + w_2,    μ = (1 − e^{−h/τ}) τ/h,
//! ```
//!
//! w_1 and w_2 with the covariance that they have. In a move the mean turns with the platform, as d does to
//! first order in h/τ. A bias shows at the end of an interval, and needs the first alone. So do the truth
//! and the extended filters, which follow their own estimate; the linear model, whose gains and σ are known
//! before any test, has the integrals of [`Passed`], as [`evaluate`](crate::evaluate) has.
//!
//! The filters have d and b, along the axes of the platform, as states behind the parameters that they
//! estimate. D_F is reported as the drift of the moment, D_F + d of the random walk.

use nalgebra::{DMatrix, Matrix3, Vector3};
use rand_chacha::ChaCha8Rng;

use super::normal::normal3;
use super::states::{Drive, Fading, LinearTransition, Shape};
use crate::attitude::{Attitude, Stand};
use crate::covariance::coloured::Layout;
use crate::covariance::coloured::passage::Passed;
use crate::dynamics::ErrorDynamics;
use crate::model::{Colour, Markov};
use crate::motion::Move;
use crate::platform::Platform;
use crate::units::ARCSEC_PER_RAD;

/// A process that each of three instruments has.
#[derive(Debug, Clone, Copy)]
enum Process {
    /// The variance by which a random walk grows in a second.
    Walk(f64),
    Markov(Markov),
}

/// What a process does in an interval; the noises are w_1 = a n_1, w_2 = b n_1 + c n_2.
#[derive(Debug, Clone, Copy)]
struct Stride {
    kept: f64,
    mean: f64,
    a: f64,
    b: f64,
    c: f64,
}

impl Process {
    fn of(colour: &Colour) -> Vec<Self> {
        let walk = colour.random_walk.map(Self::Walk);
        walk.into_iter()
            .chain(colour.markov.map(Self::Markov))
            .collect()
    }

    fn start_sigma(self) -> f64 {
        match self {
            Self::Walk(_) => 0.0,
            Self::Markov(m) => m.sigma,
        }
    }

    fn stride(self, length_s: f64) -> Stride {
        match self {
            Self::Walk(k) => {
                let a = (k * length_s).sqrt();
                Stride {
                    kept: 1.0,
                    mean: 1.0,
                    a,
                    b: 0.5 * a,
                    c: a / 12.0_f64.sqrt(),
                }
            }
            Self::Markov(m) => {
                let x = length_s / m.time_s;
                let lost = -libm::expm1(-x);
                let mean = lost / x;
                let a = m.renewed(length_s).sqrt();
                // The variance of the mean that does not come of d, in σ²: 2 (x − 1 + e⁻ˣ)/x² − μ².
                let varies = match x < 1e-3 {
                    true => x * (2.0 / 3.0 - x * (0.5 - 7.0 / 30.0 * x)),
                    false => 2.0 * (x - lost) / (x * x) - mean * mean,
                };
                let sigma2 = m.sigma * m.sigma;
                let b = sigma2 * mean * lost / a;
                let c = (sigma2 * varies - b * b).max(0.0).sqrt();
                Stride {
                    kept: 1.0 - lost,
                    mean,
                    a,
                    b,
                    c,
                }
            }
        }
    }
}

/// What wanders, in °/h and arcsec, beside parameters that are estimated.
#[derive(Debug, Clone)]
pub(super) struct Wandering {
    /// How many parameters these are.
    estimated: usize,
    drift: Vec<Process>,
    biases: Vec<Process>,
    /// The same as the chain has it.
    layout: Layout,
    stand: Stand,
}

/// Where the platform is in an interval.
#[derive(Debug, Clone, Copy)]
pub(super) enum Whereabouts<'a> {
    /// Held so.
    At(&'a Attitude),
    /// On a move, so long after its start, s.
    Moving(&'a Move, f64),
}

/// Φ and B of an interval of that length, with B of the parameters, for a filter that knows of `wandering`.
pub(super) fn linear_transition(
    wandering: Option<&Wandering>,
    phi: Matrix3<f64>,
    b: Drive,
    length_s: f64,
) -> LinearTransition {
    match wandering {
        Some(wandering) => wandering.transition(phi, &b, length_s),
        None => LinearTransition {
            phi,
            b,
            fading: None,
        },
    }
}

impl Wandering {
    /// Of a platform; none where noise is white.
    pub fn of(platform: &Platform) -> Option<Self> {
        let of = |colour: &Colour| Process::of(&colour.times(ARCSEC_PER_RAD));
        (!platform.is_white()).then(|| Self {
            estimated: platform.errors().estimated(),
            stand: *platform.stand(),
            drift: of(platform.drift_colour()),
            biases: of(platform.accelerometer_colour()),
            layout: Layout::new(
                &platform.drift_colour().times(ARCSEC_PER_RAD),
                &platform.accelerometer_colour().times(ARCSEC_PER_RAD),
            ),
        })
    }

    fn all(&self) -> impl Iterator<Item = Process> + '_ {
        self.drift.iter().chain(&self.biases).copied()
    }

    /// How many states there are.
    pub fn states(&self) -> usize {
        3 * self.all().count()
    }

    /// The states of a filter that knows of `wandering`, if it knows of any, beside so many parameters.
    pub fn shape(wandering: Option<&Self>, parameters: usize) -> Shape {
        Shape {
            parameters,
            wandering: wandering.map_or(0, Self::states),
            has_walk: wandering.is_some_and(Self::has_walk),
        }
    }

    /// Whether the drift has a random walk, which then is the first of the states.
    pub fn has_walk(&self) -> bool {
        matches!(self.drift.first(), Some(Process::Walk(_)))
    }

    /// Whether the accelerometers' biases wander.
    pub fn has_biases(&self) -> bool {
        !self.biases.is_empty()
    }

    /// 1σ of the states before the test.
    pub fn start_sigma(&self) -> Vec<f64> {
        self.all().flat_map(|p| [p.start_sigma(); 3]).collect()
    }

    /// What becomes of ψ^n and of the states in an interval: ψ^n ← Φ ψ^n + B D.
    fn transition(&self, phi: Matrix3<f64>, b: &Drive, length_s: f64) -> LinearTransition {
        LinearTransition {
            phi,
            b: self.driving(b, length_s),
            fading: self.fading(&b.fixed_columns::<3>(0).into_owned(), length_s),
        }
    }

    /// What becomes of ψ^n and of the states in an interval of the linear model, in which the parameters do
    /// `b`: as the chain has it.
    pub fn passed(
        &self,
        dynamics: &ErrorDynamics,
        at: Whereabouts<'_>,
        b: &Drive,
        length_s: f64,
    ) -> LinearTransition {
        let phi = dynamics.transition(length_s);
        let states = self.states();
        if length_s <= 0.0 {
            let nothing = self.all().map(|_| Matrix3::zeros());
            return LinearTransition {
                phi,
                b: widened(b, self.estimated, nothing),
                fading: None,
            };
        }
        // White noise comes to ψ^n by itself.
        let white = 0.0;
        let passed = match at {
            Whereabouts::At(attitude) => {
                let mut passed = Passed::held(&self.layout, dynamics, white, length_s);
                // δ^n = C_c^n d: columns of d instead.
                for k in 0..self.drift.len() {
                    for m in [&mut passed.transition, &mut passed.u] {
                        let mut block = m.fixed_view_mut::<3, 3>(0, 3 + 3 * k);
                        block.copy_from(&(&block * attitude.matrix()));
                    }
                }
                passed
            }
            Whereabouts::Moving(m, start_s) => {
                let of = (&self.stand, dynamics);
                Passed::moved(&self.layout, of, white, m, (start_s, length_s))
            }
        };
        let Passed { transition, u } = passed;
        let carried = |k: usize| transition.fixed_view::<3, 3>(0, 3 + 3 * k).into_owned();
        let row = |j: usize| match j.checked_sub(states) {
            Some(axis) => axis,
            None => 3 + j,
        };
        LinearTransition {
            phi,
            b: widened(b, self.estimated, (0..states / 3).map(carried)),
            fading: Some(Fading {
                kept: (0..states).map(|j| transition[(3 + j, 3 + j)]).collect(),
                noise: DMatrix::from_fn(3 + states, states + 3, |source, j| u[(row(j), source)]),
            }),
        }
    }

    /// `drive` with columns of the states behind those of the estimated parameters: what d̄ of an interval
    /// does, as D_F does it.
    fn driving(&self, drive: &Drive, length_s: f64) -> Drive {
        let constant = drive.fixed_columns::<3>(0).into_owned();
        let of = |process: Process| match length_s > 0.0 {
            true => constant * process.stride(length_s).mean,
            false => Matrix3::zeros(),
        };
        let drift = self.drift.iter().map(|p| of(*p));
        let biases = self.biases.iter().map(|_| Matrix3::zeros());
        widened(drive, self.estimated, drift.chain(biases))
    }

    /// The same of what the accelerometers show where the platform stands as `attitude`.
    pub fn shown(&self, output: &Drive, attitude: &Matrix3<f64>) -> Drive {
        let drift = self.drift.iter().map(|_| Matrix3::zeros());
        let biases = self.biases.iter().map(|_| *attitude);
        widened(output, self.estimated, drift.chain(biases))
    }

    /// What the states do over an interval in which D_F of 1 °/h turns the platform by `constant`; none
    /// where it takes no time.
    fn fading(&self, constant: &Matrix3<f64>, length_s: f64) -> Option<Fading> {
        if length_s <= 0.0 {
            return None;
        }
        let states = self.states();
        let mut noise = DMatrix::zeros(states + 3 * self.drift.len(), states + 3);
        let mut kept = Vec::with_capacity(states);
        for (k, process) in self.all().enumerate() {
            let stride = process.stride(length_s);
            kept.extend([stride.kept; 3]);
            let is_drift = k < self.drift.len();
            for i in 0..3 {
                let at = 3 * k + i;
                noise[(at, at)] = stride.a;
                if is_drift {
                    let turned = constant.column(i).transpose();
                    for (row, share) in [(at, stride.b), (states + at, stride.c)] {
                        let mut psi = noise.fixed_view_mut::<1, 3>(row, states);
                        psi.copy_from(&(turned * share));
                    }
                }
            }
        }
        Some(Fading { kept, noise })
    }
}

/// `drive` with further columns behind the first `estimated`.
fn widened(drive: &Drive, estimated: usize, more: impl Iterator<Item = Matrix3<f64>>) -> Drive {
    let more: Vec<Matrix3<f64>> = more.collect();
    let mut wide = Drive::zeros(drive.ncols() + 3 * more.len());
    let (first, last) = (drive.columns(0, estimated), estimated + 3 * more.len());
    wide.columns_mut(0, estimated).copy_from(&first);
    for (k, block) in more.iter().enumerate() {
        wide.fixed_columns_mut::<3>(estimated + 3 * k)
            .copy_from(block);
    }
    let rest = drive.ncols() - estimated;
    wide.columns_mut(last, rest)
        .copy_from(&drive.columns(estimated, rest));
    wide
}

/// What wanders in one run.
#[derive(Debug)]
pub(super) struct TrueWandering<'a> {
    model: &'a Wandering,
    /// Along the axes of the platform, °/h and arcsec.
    values: Vec<Vector3<f64>>,
}

impl<'a> TrueWandering<'a> {
    /// Before the test.
    pub fn new(model: &'a Wandering, random: &mut ChaCha8Rng) -> Self {
        let start = |process: Process| normal3(random) * process.start_sigma();
        Self {
            values: model.all().map(start).collect(),
            model,
        }
    }

    /// Goes through an interval; gives the mean of the drift in it, °/h.
    pub fn advance(&mut self, length_s: f64, random: &mut ChaCha8Rng) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        if length_s <= 0.0 {
            return sum;
        }
        let drifts = self.model.drift.len();
        for (k, (value, process)) in self.values.iter_mut().zip(self.model.all()).enumerate() {
            let stride = process.stride(length_s);
            let [first, second] = [(); 2].map(|()| normal3(random));
            if k < drifts {
                sum += *value * stride.mean + first * stride.b + second * stride.c;
            }
            *value = *value * stride.kept + first * stride.a;
        }
        sum
    }

    /// All of it in the order of the states.
    pub fn states(&self) -> impl Iterator<Item = f64> {
        self.values.iter().flatten().copied()
    }

    /// What of the biases wanders, arcsec.
    pub fn biases(&self) -> Vector3<f64> {
        self.values[self.model.drift.len()..].iter().sum()
    }
}

#[cfg(test)]
mod ignorance;

#[cfg(test)]
mod tests {
    use super::*;

    /// Two strides are one: means and ends have the covariances that they have in one.
    #[test]
    fn strides_compose() {
        let markov = |time_s| Process::Markov(Markov { sigma: 0.7, time_s });
        let all = [3e4, 400.0, 20.0, 3.0].map(markov);
        for process in [Process::Walk(1e-4)].into_iter().chain(all) {
            for [first_s, second_s] in [[10.0, 10.0], [4.0, 31.0]] {
                let whole = process.stride(first_s + second_s);
                let (one, two) = (process.stride(first_s), process.stride(second_s));
                let [u, v] = [first_s, second_s].map(|s| s / (first_s + second_s));
                let mean = u * one.mean + v * two.mean * one.kept;
                assert!((mean - whole.mean).abs() < 1e-14);
                // End and mean of the whole by (n_1, n_2) of the first and of the second.
                let end = [one.a * two.kept, 0.0, two.a, 0.0];
                let mean = [
                    u * one.b + v * two.mean * one.a,
                    u * one.c,
                    v * two.b,
                    v * two.c,
                ];
                let dot = |p: &[f64; 4], q: &[f64; 4]| -> f64 {
                    p.iter().zip(q).map(|(a, b)| a * b).sum()
                };
                for (found, expected) in [
                    (dot(&end, &end), whole.a * whole.a),
                    (dot(&end, &mean), whole.a * whole.b),
                    (dot(&mean, &mean), whole.b.powi(2) + whole.c.powi(2)),
                ] {
                    assert!((found / expected - 1.0).abs() < 1e-7, "{process:?}");
                }
            }
        }
    }

    #[test]
    fn columns_go_behind_the_estimated_ones() {
        let drive = Drive::from_fn(5, |i, j| (10 * i + j) as f64);
        let wide = widened(&drive, 4, [Matrix3::identity() * 7.0].into_iter());
        assert_eq!(wide.ncols(), 8);
        assert_eq!(wide.columns(0, 4), drive.columns(0, 4));
        assert_eq!(wide.column(7), drive.column(4));
        assert_eq!((wide[(0, 4)], wide[(1, 5)], wide[(2, 5)]), (7.0, 7.0, 0.0));
    }
}
