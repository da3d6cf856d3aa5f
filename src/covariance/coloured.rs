//! The exact chain where drift or biases wander.
//!
//! The dynamic state is x = (ψ^n, δ^n, …, b^n, …), δ^n = C_c^n d what of the drift wanders and b^n = C_c^n b
//! what of the accelerometers' biases does. Equal, independent processes along the axes of the platform are
//! isotropic, so that in n they obey the same equations at every position: the [`kernel`] of a dwell is one
//! per duration, whatever the position, and a change of position turns every block but ψ^n by
//! C_{k+1} C_kᵀ (in frame-hold repositioning ψ^n too).
//!
//! # The order of blocks
//!
//! [`Layout`] says which there are; each has three components, North, Up, East:
//!
//! ```text
//! x       ψ^n | δ^n random walk | δ^n Gauss–Markov | b^n random walk | b^n Gauss–Markov
//! inputs  ε^n | b_y, one number, where the accelerometers' biases wander
//! ```
//!
//! ε^n = A D is the constant part of the drift. Without biases that wander the vertical channel tells of D
//! alone, b_2ᵀ b_2 / r² in each period, as in the white chain; with them it joins the kernel, b_y = b_2 D the
//! constant part of what it shows. In either case the shift ψ' = ψ^n + U D stays ([`super::selection`]).
//!
//! Units: arcsec, °/h = arcsec/s, s.
//!
//! # Singular information
//!
//! What a dwell tells of (ψ^n, δ^n) at its start is singular for every number of periods: ψ_y, δ_y and δ_z
//! act through two functions of time; and δ^n of a random walk acts as ε^n does. Nothing is ever divided by
//! it: I + P J is inverted, by a triangle of I + (R G)ᵀ(R G).

mod chain;
pub(crate) mod kernel;
pub(crate) mod passage;

use super::CovarianceModel;
use crate::model::Colour;
use passage::Process;

pub(super) use chain::{End, run};

/// Which blocks the state has.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Layout {
    /// Of the drift, the random walk first.
    drift: Vec<Process>,
    /// Of the accelerometers' biases, likewise.
    biases: Vec<Process>,
}

impl Layout {
    /// Of a model.
    pub fn of(model: &CovarianceModel) -> Self {
        Self::new(&model.drift_colour, &model.accelerometer_colour)
    }

    /// Of drift (°/h) and biases (arcsec) that wander so.
    pub fn new(drift: &Colour, biases: &Colour) -> Self {
        Self {
            drift: Process::of(drift),
            biases: Process::of(biases),
        }
    }

    /// The processes of the drift, and those of the biases.
    pub fn blocks(&self) -> (&[Process], &[Process]) {
        (&self.drift, &self.biases)
    }

    /// All processes in the order of their blocks.
    pub fn processes(&self) -> impl Iterator<Item = Process> + '_ {
        self.drift.iter().chain(&self.biases).copied()
    }

    /// Components of x.
    pub fn states(&self) -> usize {
        3 + 3 * (self.drift.len() + self.biases.len())
    }

    /// Components of the inputs: 3, or 4 with b_y.
    pub fn inputs(&self) -> usize {
        3 + usize::from(self.has_biases())
    }

    /// Whether the accelerometers' biases wander: the vertical channel is one of x then.
    pub fn has_biases(&self) -> bool {
        !self.biases.is_empty()
    }

    /// Where the block of the drift's random walk starts in x; none: it has none.
    pub fn walk(&self) -> Option<usize> {
        matches!(self.drift.first(), Some(Process::Walk(_))).then_some(3)
    }

    /// Where the blocks of the biases start in x.
    pub fn bias_blocks(&self) -> impl Iterator<Item = usize> + use<> {
        let first = 1 + self.drift.len();
        (first..first + self.biases.len()).map(|block| 3 * block)
    }
}
