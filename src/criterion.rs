//! Criteria of optimality on the coefficient covariance P_D: value and gradient.
//!
//! | criterion | value | unit |
//! |---|---|---|
//! | `a` | √(Σ w_i σ_i² / Σ w_i): the weighted RMS σ | °/h |
//! | `d` | (det P_D)^{1/2n}: the geometric mean of the principal σ | °/h |
//! | `e` | √λ_max(P_D): σ of the worst combination | °/h |
//! | `max-ratio` | max σ_i / σ_i^spec | 1 |
//!
//! Search and score work on the logarithm, which makes a relative change of accuracy the same
//! whatever the unit. `e` and `max-ratio` have kinks; [`Smoothing::PowerMean`] replaces the
//! maximum by a power mean, an upper bound that tends to it.

use nalgebra::{Cholesky, DefaultAllocator, Dim, allocator::Allocator};

use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector, DriftCoefficient};
use crate::error::{Error, Result};

/// A criterion with its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Criterion {
    /// A-optimality: weighted RMS σ; weights ≥ 0, not all zero.
    A {
        /// Weight of each coefficient's variance.
        weights: CoefficientVector,
    },
    /// D-optimality: geometric mean of the principal σ, over the coefficients not known already.
    D,
    /// E-optimality: σ of the worst combination.
    E,
    /// Largest σ relative to its specification; an infinite specification asks for nothing.
    MaxRatio {
        /// Specification, 1σ, °/h.
        spec_deg_per_h: CoefficientVector,
    },
}

/// Whether a maximum is taken as it is or as a power mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Smoothing {
    /// The criterion itself; at a kink, one of its subgradients.
    Exact,
    /// max x ≈ (Σ x^p)^{1/p} on variances, p ≥ 1: smooth, and at most n^{1/2p} too large.
    PowerMean(f64),
}

impl Criterion {
    /// A-optimality with equal weights: the RMS σ.
    pub fn rms() -> Self {
        Self::A {
            weights: CoefficientVector::repeat(1.0),
        }
    }

    /// The value, in the unit of the table above.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when P_D is not positive definite where it must be.
    pub fn value(&self, covariance: &CoefficientMatrix) -> Result<f64> {
        Ok(libm::exp(self.log(covariance, Smoothing::Exact)?))
    }

    /// ln(value), smoothed or not.
    ///
    /// # Errors
    ///
    /// As [`Criterion::value`].
    pub fn log(&self, covariance: &CoefficientMatrix, smoothing: Smoothing) -> Result<f64> {
        match self {
            // The search's usual criterion: without a matrix for a gradient that nobody wants.
            Self::A { weights } => Ok(log_weighted_rms(covariance, weights)),
            _ => Ok(self.log_with_gradient(covariance, smoothing)?.0),
        }
    }

    /// ln(value) and its derivative with respect to P_D, a symmetric matrix G:
    /// d ln(value) = tr(G dP_D).
    ///
    /// # Errors
    ///
    /// As [`Criterion::value`].
    pub fn log_with_gradient(
        &self,
        covariance: &CoefficientMatrix,
        smoothing: Smoothing,
    ) -> Result<(f64, CoefficientMatrix)> {
        match self {
            Self::A { weights } => Ok(weighted_rms(covariance, weights)),
            Self::D => geometric_mean(covariance),
            Self::E => Ok(worst_combination(covariance, smoothing)),
            Self::MaxRatio { spec_deg_per_h } => {
                Ok(worst_ratio(covariance, spec_deg_per_h, smoothing))
            }
        }
    }

    /// Whether the σ of a coefficient has a part in the value: a weight or a specification.
    pub fn counts(&self, coefficient: DriftCoefficient) -> bool {
        match self {
            Self::A { weights } => weights[coefficient.index()] > 0.0,
            Self::D | Self::E => true,
            Self::MaxRatio { spec_deg_per_h } => spec_deg_per_h[coefficient.index()].is_finite(),
        }
    }

    /// Whether the value is 0 before any test and whatever the test: every coefficient that counts
    /// is known exactly, its prior σ being zero.
    pub fn is_known(&self, prior_sigma: &CoefficientVector) -> bool {
        self.known_in_words(prior_sigma).is_some()
    }

    /// The same in words; none where a test makes a difference.
    ///
    /// ```
    /// use scheme_opt::criterion::Criterion;
    /// use scheme_opt::drift::{CoefficientVector, DriftCoefficient as D};
    /// let mut weights = CoefficientVector::zeros();
    /// weights[D::FX.index()] = 1.0;
    /// let mut prior_sigma = CoefficientVector::repeat(8.0);
    /// assert_eq!(Criterion::A { weights }.known_in_words(&prior_sigma), None);
    /// prior_sigma[D::FX.index()] = 0.0;
    /// let words = Criterion::A { weights }.known_in_words(&prior_sigma).unwrap_or_default();
    /// assert!(words.starts_with("criterion a is 0 before any test"), "{words}");
    /// assert!(words.contains("D_FX"));
    /// ```
    pub fn known_in_words(&self, prior_sigma: &CoefficientVector) -> Option<String> {
        let counting = DriftCoefficient::ALL
            .into_iter()
            .filter(|c| self.counts(*c));
        let counting: Vec<DriftCoefficient> = counting.collect();
        if counting.iter().any(|c| prior_sigma[c.index()] > 0.0) {
            return None;
        }
        let names: Vec<&str> = counting.iter().map(|c| c.name()).collect();
        let (which, names) = match self {
            Self::A { .. } => (" with a weight", names),
            Self::D | Self::E => ("", Vec::new()),
            Self::MaxRatio { .. } => (" with a specification", names),
        };
        let names = match names.len() {
            0 | COEFFICIENTS => String::new(),
            _ => format!(" ({})", names.join(", ")),
        };
        Some(format!(
            "criterion {} is 0 before any test and whatever the schedule: every coefficient{which}\
             {names} is known exactly, its prior sigma being 0",
            self.name()
        ))
    }

    /// The name used in files and documents.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::A { .. } => "a",
            Self::D => "d",
            Self::E => "e",
            Self::MaxRatio { .. } => "max-ratio",
        }
    }

    /// True when the criterion has kinks that a search should smooth.
    pub const fn has_kinks(&self) -> bool {
        matches!(self, Self::E | Self::MaxRatio { .. })
    }
}

/// ln √(Σ w P_ii / Σ w).
fn log_weighted_rms(p: &CoefficientMatrix, weights: &CoefficientVector) -> f64 {
    0.5 * libm::log(p.diagonal().dot(weights) / weights.sum())
}

/// ln √(Σ w P_ii / Σ w) and its gradient.
fn weighted_rms(p: &CoefficientMatrix, weights: &CoefficientVector) -> (f64, CoefficientMatrix) {
    let weighted = p.diagonal().dot(weights);
    let gradient = CoefficientMatrix::from_diagonal(&(weights / (2.0 * weighted)));
    (log_weighted_rms(p, weights), gradient)
}

/// ln det of the matrix that `cholesky` is of. (nalgebra's own takes logarithms of squares, which
/// overflow and underflow at half the exponents.)
pub(crate) fn log_determinant<D: Dim>(cholesky: &Cholesky<f64, D>) -> f64
where
    DefaultAllocator: Allocator<D, D>,
{
    let l = cholesky.l_dirty();
    (0..l.nrows()).map(|i| 2.0 * libm::log(l[(i, i)])).sum()
}

/// ln det P / 2n over the coefficients that are not known exactly.
fn geometric_mean(p: &CoefficientMatrix) -> Result<(f64, CoefficientMatrix)> {
    let open: Vec<usize> = (0..COEFFICIENTS).filter(|&i| p[(i, i)] > 0.0).collect();
    if open.is_empty() {
        // All known: as for the other criteria, the logarithm of zero.
        return Ok((f64::NEG_INFINITY, CoefficientMatrix::zeros()));
    }
    let block = nalgebra::DMatrix::from_fn(open.len(), open.len(), |i, j| p[(open[i], open[j])]);
    let cholesky = Cholesky::new(block).ok_or_else(|| {
        Error::numerical(
            "the coefficient covariance lost definiteness: its logarithmic determinant cannot \
             be trusted",
        )
    })?;
    let count = open.len() as f64;
    let log_det = log_determinant(&cholesky);
    let inverse = cholesky.inverse();
    let mut gradient = CoefficientMatrix::zeros();
    for (i, &row) in open.iter().enumerate() {
        for (j, &column) in open.iter().enumerate() {
            gradient[(row, column)] = inverse[(i, j)] / (2.0 * count);
        }
    }
    Ok((log_det / (2.0 * count), gradient))
}

/// ln √λ_max, or ln (Σ λ^p)^{1/2p}.
fn worst_combination(p: &CoefficientMatrix, smoothing: Smoothing) -> (f64, CoefficientMatrix) {
    let eigen = p.symmetric_eigen();
    let (log_value, shares) = soft_maximum(eigen.eigenvalues.as_slice(), smoothing);
    let mut gradient = CoefficientMatrix::zeros();
    for (i, share) in shares.into_iter().enumerate() {
        if share > 0.0 {
            let v = eigen.eigenvectors.column(i);
            gradient += v * v.transpose() * (0.5 * share);
        }
    }
    (0.5 * log_value, gradient)
}

/// ln max σ_i/spec_i, or its power mean.
fn worst_ratio(
    p: &CoefficientMatrix,
    spec: &CoefficientVector,
    smoothing: Smoothing,
) -> (f64, CoefficientMatrix) {
    let ratios: Vec<f64> = (0..COEFFICIENTS)
        .map(|i| p[(i, i)] / (spec[i] * spec[i]))
        .collect();
    let (log_value, shares) = soft_maximum(&ratios, smoothing);
    let mut gradient = CoefficientMatrix::zeros();
    for (i, share) in shares.into_iter().enumerate() {
        gradient[(i, i)] = 0.5 * share / (spec[i] * spec[i]);
    }
    (0.5 * log_value, gradient)
}

/// ln of the maximum of non-negative `values` (or of their power mean) and its derivative with
/// respect to each value.
fn soft_maximum(values: &[f64], smoothing: Smoothing) -> (f64, Vec<f64>) {
    let mut top = 0;
    for (i, value) in values.iter().enumerate() {
        if *value > values[top] {
            top = i;
        }
    }
    let max = values[top];
    match smoothing {
        Smoothing::Exact => {
            let mut shares = vec![0.0; values.len()];
            shares[top] = 1.0 / max;
            (libm::log(max), shares)
        }
        Smoothing::PowerMean(power) => {
            // Relative to the maximum, so that no power overflows.
            let terms: Vec<f64> = values
                .iter()
                .map(|v| libm::pow((v / max).max(0.0), power))
                .collect();
            let sum: f64 = terms.iter().sum();
            let shares = values
                .iter()
                .zip(&terms)
                .map(|(v, t)| if *v > 0.0 { t / (sum * v) } else { 0.0 })
                .collect();
            (libm::log(max) + libm::log(sum) / power, shares)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> CoefficientMatrix {
        let root = CoefficientMatrix::from_fn(|i, j| {
            let diagonal = if i == j { 2.0 } else { 0.0 };
            diagonal + ((3 * i * i + 7 * i * j + j) as f64).sin()
        });
        root * root.transpose()
    }

    fn criteria() -> [Criterion; 4] {
        let spec = CoefficientVector::from_fn(|i, _| match i {
            3 => f64::INFINITY,
            _ => 0.5 + 0.1 * i as f64,
        });
        let weights = CoefficientVector::from_fn(|i, _| 1.0 + i as f64);
        [
            Criterion::A { weights },
            Criterion::D,
            Criterion::E,
            Criterion::MaxRatio {
                spec_deg_per_h: spec,
            },
        ]
    }

    #[test]
    fn values_are_what_their_names_say() {
        let p = CoefficientMatrix::from_diagonal(&CoefficientVector::from_fn(|i, _| {
            (1.0 + i as f64).powi(2)
        }));
        let value = |c: Criterion| c.value(&p).unwrap();
        assert!((value(Criterion::rms()) - (650.0_f64 / 12.0).sqrt()).abs() < 1e-12);
        let factorial: f64 = (1..=12).map(f64::from).product();
        assert!((value(Criterion::D) - factorial.powf(1.0 / 12.0)).abs() < 1e-12);
        assert!((value(Criterion::E) - 12.0).abs() < 1e-12);
        let spec_deg_per_h = CoefficientVector::from_fn(|i, _| if i == 2 { 0.5 } else { 100.0 });
        assert!((value(Criterion::MaxRatio { spec_deg_per_h }) - 6.0).abs() < 1e-12);
    }

    #[test]
    fn gradients_are_the_derivatives() {
        let p = sample();
        for criterion in criteria() {
            for smoothing in [Smoothing::Exact, Smoothing::PowerMean(6.0)] {
                let (_, g) = criterion.log_with_gradient(&p, smoothing).unwrap();
                for (i, j) in [(0, 0), (2, 5), (11, 3), (7, 7)] {
                    let mut direction = CoefficientMatrix::zeros();
                    direction[(i, j)] += 0.5;
                    direction[(j, i)] += 0.5;
                    let f = |h: f64| {
                        let shifted = p + direction * h;
                        criterion.log_with_gradient(&shifted, smoothing).unwrap().0
                    };
                    let numeric = (f(1e-5) - f(-1e-5)) / 2e-5;
                    let exact = g.dot(&direction);
                    assert!((numeric - exact).abs() < 1e-7, "{criterion:?} {i} {j}");
                }
            }
        }
    }

    #[test]
    fn power_mean_is_an_upper_bound_that_tends_to_the_maximum() {
        let p = sample();
        for criterion in criteria().into_iter().filter(Criterion::has_kinks) {
            let value = |s| criterion.log_with_gradient(&p, s).unwrap().0;
            let exact = value(Smoothing::Exact);
            let [coarse, fine] = [4.0, 64.0].map(|p| value(Smoothing::PowerMean(p)));
            assert!(exact <= fine && fine <= coarse);
            assert!(fine - exact <= (12.0_f64).ln() / 128.0);
        }
    }

    #[test]
    fn a_known_coefficient_does_not_upset_the_determinant() {
        let mut p = sample();
        p.row_mut(4).fill(0.0);
        p.column_mut(4).fill(0.0);
        assert!(Criterion::D.value(&p).unwrap().is_finite());
    }
}
