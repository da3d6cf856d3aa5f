//! What figures of merit see of a schedule with all parameters.

use std::borrow::Cow;

use nalgebra::DMatrix;

use super::super::arithmetic::Number;
use super::super::posterior::{Order, Posterior, Pulled};
use crate::covariance::{CoefficientCovariance, CovarianceRoot, Slope};
use crate::drift::{COEFFICIENTS, CoefficientMatrix};

/// K over the coefficients as one over all that is seen.
pub(super) fn padded(k: &CoefficientMatrix, seen: usize) -> DMatrix<f64> {
    let first = seen - COEFFICIENTS;
    let mut all = DMatrix::zeros(seen, seen);
    all.view_mut((first, first), (COEFFICIENTS, COEFFICIENTS))
        .copy_from(k);
    all
}

/// A matrix over the coefficients, or their rows of a root, in their units.
pub(super) fn of_coefficients(m: &DMatrix<f64>, left: &[f64], right: &[f64]) -> CoefficientMatrix {
    let first = m.nrows() - COEFFICIENTS;
    CoefficientMatrix::from_fn(|i, j| {
        m[(first + i, first + j)] * left[first + i] * right[first + j]
    })
}

/// G in units of the prior σ.
pub(super) fn scaled(g: &DMatrix<f64>, sigma: &[f64]) -> DMatrix<f64> {
    DMatrix::from_fn(g.nrows(), g.ncols(), |i, j| sigma[i] * sigma[j] * g[(i, j)])
}

/// P of one schedule, or of one lane.
pub(crate) struct OfPosterior<'a, N, F> {
    coefficients: CoefficientMatrix,
    posterior: &'a Posterior<N>,
    sigma: &'a [f64],
    lane: F,
}

impl<'a, N: Number, F: Fn(N) -> f64> OfPosterior<'a, N, F> {
    /// `lane` takes the number wanted.
    pub fn new(posterior: &'a Posterior<N>, order: &'a Order, lane: F) -> Self {
        let sigma = order.seen_scale();
        Self {
            coefficients: of_coefficients(&posterior.matrix(&lane), sigma, sigma),
            posterior,
            sigma,
            lane,
        }
    }

    /// The derivative of a figure of merit in units of the prior σ.
    pub fn pulled(&self, slope: &Slope) -> Pulled<f64> {
        let first = self.sigma.len() - COEFFICIENTS;
        let variance = |i: usize, g: f64| g * self.sigma[i] * self.sigma[i];
        match slope {
            Slope::Variances(g) => {
                let mut all = vec![0.0; first];
                all.extend((first..).zip(g.iter()).map(|(i, g)| variance(i, *g)));
                Pulled::Variances(all)
            }
            Slope::InRoot(k) => {
                let k = padded(k, self.sigma.len());
                self.posterior.pulled_of_root(&k, &self.lane)
            }
            Slope::SeenVariances(g) => {
                Pulled::Variances(g.iter().enumerate().map(|(i, g)| variance(i, *g)).collect())
            }
            Slope::SeenCovariance(g) => {
                Pulled::Covariance(scaled(g, self.sigma).iter().copied().collect())
            }
        }
    }
}

impl<N: Number, F: Fn(N) -> f64> CoefficientCovariance for OfPosterior<'_, N, F> {
    fn matrix(&self) -> &CoefficientMatrix {
        &self.coefficients
    }
    fn root(&self) -> Cow<'_, CovarianceRoot> {
        let ones = vec![1.0; self.sigma.len()];
        let root = of_coefficients(&self.posterior.root(&self.lane), self.sigma, &ones);
        Cow::Owned(CovarianceRoot::new(root, std::array::from_fn(|i| i)))
    }
    fn seen(&self) -> DMatrix<f64> {
        scaled(&self.posterior.matrix(&self.lane), self.sigma)
    }
}
