//! The chain where drift or biases wander, value and gradient: [`crate::covariance::coloured`] for
//! searches, over all parameters of a platform.
//!
//! The state x = (ψ^n, δ^n, …) has the blocks of [`crate::covariance::coloured::Layout`], padded to one of
//! three sizes. The recursion is that of [`super`] with matrices of that size and rows over the
//! parameters ([`Columns`]):
//!
//! ```text
//! X = Y V + Z u,   rows += X, R22 u,   V ← M V + N u,   P ← A_x P₊ A_xᵀ + C,
//! ```
//!
//! u the inputs, A' and, where biases wander, b_y. A change of position turns every block but ψ^n; a move
//! that takes time is gone through in panels, in the axes of the platform ([`moving`]). What the
//! measurements tell is kept as rows with weights, and E = Σ w xᵀx summed up at the end.
//!
//! # Drift at the end of the test
//!
//! Under a random walk D_F is the drift at the end. Written with it, the walk is d'(t) = d(t) − d(T): before
//! the test d'(0) = D_F(0) − D_F, of which D_F(0) has its prior σ and D_F none; at the end it is 0, which
//! the last rows say. Nothing else changes: D_F is a parameter like others, for the criterion, for what is
//! considered, and for the derivative.

pub(crate) mod algebra;
mod back;
mod columns;
mod course;
pub(crate) mod cuts;
mod ending;
mod integral;
mod measuring;
mod moving;
mod place;
mod rows;
pub(crate) mod several;
pub(crate) mod single;
mod tape;
#[cfg(test)]
mod tests;
mod wander;

pub(crate) use columns::Columns;
use place::{Place, PlaceAdjoint, shift};
use wander::{Size, Wander};

use crate::covariance::CovarianceModel;

/// What a model of drift and biases that wander has for searches.
#[derive(Debug)]
pub(crate) struct Coloured {
    columns: Columns,
    wander: Wander,
}

impl Coloured {
    /// Of a model; none where everything is white. Figures of merit see the parameters at `seen` besides
    /// the twelve coefficients; a stand settles for `settle_s`.
    pub fn of(model: &CovarianceModel, seen: &[usize], settle_s: f64) -> Option<Self> {
        (!model.is_white()).then(|| Self {
            columns: Columns::new(&model.errors, seen, &model.drift_colour),
            wander: Wander::new(model, settle_s),
        })
    }

    /// The same with other figures of merit.
    pub fn seeing(self, model: &CovarianceModel, seen: &[usize]) -> Self {
        Self {
            columns: Columns::new(&model.errors, seen, &model.drift_colour),
            ..self
        }
    }
}

/// `$run!(states, inputs)` for the size of what wanders.
macro_rules! by_size {
    ($size:expr, $run:ident) => {
        match $size {
            $crate::covariance::fast::coloured::Size::Six => $run!(6, 3),
            $crate::covariance::fast::coloured::Size::Nine => $run!(9, 3),
            $crate::covariance::fast::coloured::Size::Fifteen => $run!(15, 4),
        }
    };
}
use by_size;
