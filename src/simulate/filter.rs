//! A filter at work in one run: the linear one, or one that linearises about estimates.

use crate::units::ARCSEC_PER_RAD;

use super::belief::{State, Taken};
use super::ekf::ExtendedFilter;
use super::linear::LinearFilter;
use super::program::{DriftInterval, Program};
use super::square_root::Knowledge;
use super::states::Shape;
use super::truth::{Measured, Misalignment};

/// A filter at work in one run.
#[derive(Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "one per run, on the stack of its thread; boxing would only add a hop per tick"
)]
pub(super) enum Filter<'a> {
    /// Kalman filter on (8), (9), gains from beforehand.
    Linear(LinearFilter<'a>),
    /// Linearised about estimates.
    Extended(ExtendedFilter<'a>),
}

impl Filter<'_> {
    /// Predicts through `interval`.
    pub fn advance(&mut self, program: &Program, interval: &DriftInterval) {
        match self {
            Self::Linear(f) => f.advance(program, interval),
            Self::Extended(f) => f.advance(interval),
        }
    }

    /// Takes what is measured at the end of `interval`.
    pub fn measure(&mut self, interval: &DriftInterval, measured: &Measured, taken: Taken<'_>) {
        match self {
            Self::Linear(f) => f.measure(interval, measured, taken),
            Self::Extended(f) => f.measure(interval, measured, taken),
        }
    }

    /// Truth minus estimate of every state: of the `parameters` and of what wanders, given in the
    /// filter's order, and the rotation from the estimated to the true platform, in n, arcsec.
    pub fn error(&self, misalignment: &Misalignment, parameters: &[f64]) -> Vec<f64> {
        let (psi, error): (_, Vec<f64>) = match self {
            Self::Linear(f) => {
                let known = parameters.iter().zip(&f.state.parameters);
                (
                    misalignment.relative_to_vector(&(f.state.psi / ARCSEC_PER_RAD)),
                    known.map(|(truth, estimate)| truth - estimate).collect(),
                )
            }
            Self::Extended(f) => {
                let nominal = f.nominal.parameters.iter().chain(std::iter::repeat(&0.0));
                let known = nominal.zip(&f.correction.parameters);
                let known = parameters.iter().zip(known);
                (
                    misalignment.relative_to(&f.nominal.rotation) - f.correction.psi,
                    known
                        .map(|(truth, (nominal, correction))| truth - nominal - correction)
                        .collect(),
                )
            }
        };
        error.into_iter().chain(psi.iter().copied()).collect()
    }

    /// The parameters, and ψ^n as a rotation vector, as estimated and reported.
    pub fn estimate(&self, shape: &Shape) -> State {
        match self {
            Self::Linear(f) => f.state.reported(shape),
            Self::Extended(f) => {
                let mut best = f.best();
                let wandering = &f.correction.parameters[shape.parameters..];
                best.parameters.extend(wandering);
                let best = State {
                    psi: best.rotation.scaled_axis() * ARCSEC_PER_RAD,
                    parameters: best.parameters,
                };
                best.reported(shape)
            }
        }
    }

    /// The filter's own covariance, where it is computed along with the run.
    pub fn knowledge(&self) -> Option<&Knowledge> {
        match self {
            Self::Linear(_) => None,
            Self::Extended(f) => Some(&f.knowledge),
        }
    }
}
