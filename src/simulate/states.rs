//! The states of a filter, and what becomes of them over an interval.

use nalgebra::{DMatrix, Matrix3, Matrix3xX};

/// Three rows on the parameters, estimated and considered.
pub(super) type Drive = Matrix3xX<f64>;

/// What the states are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shape {
    /// The estimated parameters.
    pub parameters: usize,
    /// Components of what wanders.
    pub wandering: usize,
    /// Whether the first three of these are the random walk of the drift.
    pub has_walk: bool,
}

impl Shape {
    /// All of them.
    pub fn states(&self) -> usize {
        self.psi() + 3
    }

    /// Where ψ^n starts.
    pub fn psi(&self) -> usize {
        self.parameters + self.wandering
    }

    /// Of numbers of all states those that are reported, (D, ψ^n): D_F is the drift of the moment, its
    /// constant part and what the random walk has come to.
    pub fn reported(&self, all: &[f64]) -> Vec<f64> {
        let mut reported = all[..self.parameters].to_vec();
        if self.has_walk {
            let walked = &all[self.parameters..self.parameters + 3];
            reported.iter_mut().zip(walked).for_each(|(d, w)| *d += w);
        }
        reported.extend(&all[self.psi()..]);
        reported
    }
}

/// What the states do over an interval beside what the parameters do to ψ^n: each fades, and noise comes
/// to them and to ψ^n.
#[derive(Debug, Clone)]
pub(super) struct Fading {
    pub kept: Vec<f64>,
    /// Rows of unit noise on (d, b, ψ^n).
    pub noise: DMatrix<f64>,
}

impl Fading {
    /// What becomes of states that wander, but for the noise.
    pub fn fade(&self, states: &mut [f64]) {
        let kept = states.iter_mut().zip(&self.kept);
        kept.for_each(|(state, kept)| *state *= kept);
    }
}

/// Φ and B of the linear model over an interval: ψ^n ← Φ ψ^n + B D, D the estimated parameters, what
/// wanders, and the considered parameters.
#[derive(Debug, Clone)]
pub(super) struct LinearTransition {
    pub phi: Matrix3<f64>,
    /// In arcsec per unit of each parameter.
    pub b: Drive,
    /// What becomes of what wanders; none: nothing wanders, or no time passes.
    pub fading: Option<Fading>,
}
