//! Criteria of optimality on the coefficient covariance P_D: value and gradient.
//!
//! | criterion | value | unit |
//! |---|---|---|
//! | `a` | √(Σ w_i σ_i² / Σ w_i): the weighted RMS σ | °/h |
//! | `d` | (det P_D)^{1/2n}: the geometric mean of the principal σ | °/h |
//! | `e` | √λ_max(P_D): σ of the worst combination | °/h |
//! | `max-ratio` | max σ_i / σ_i^spec | 1 |
//! | `use` | √tr(L_u P L_uᵀ): the attitude error after a [mission](crate::mission), RMS | arcsec |
//!
//! The coefficients are the twelve of drift. `a` and `max-ratio` count other parameters too where these
//! have a weight or a specification, and `use` whatever turns the platform in the mission.
//!
//! Search and score work on the logarithm, which makes a relative change of accuracy the same
//! whatever the unit. `e` and `max-ratio` have kinks; [`Smoothing::PowerMean`] replaces the
//! maximum by a power mean, an upper bound that tends to it.
//!
//! `d` and `e` come from a root L of P_D = L Lᵀ ([`CovarianceRoot`]), so that they have the digits
//! that the σ have: ln det P_D = 2 Σ ln |L_kk| from the diagonal of the triangle, λ_max(P_D) =
//! λ_max(LᵀL), and their derivatives in the columns of L ([`Slope::InRoot`]).
//!
//! [`CovarianceRoot`]: crate::covariance::CovarianceRoot

use std::fmt;

use nalgebra::{Cholesky, DMatrix, DVector, DefaultAllocator, Dim, allocator::Allocator};

use crate::covariance::{CoefficientCovariance, Slope};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector, DriftCoefficient};
use crate::error::{Error, Result};

/// A criterion with its parameters.
#[derive(Debug, Clone, PartialEq)]
pub enum Criterion {
    /// A-optimality: weighted RMS σ; weights ≥ 0, not all zero.
    A {
        /// Weight of each coefficient's variance.
        weights: CoefficientVector,
        /// The same of other parameters that are [seen](CoefficientCovariance::seen), in their order.
        others: Vec<f64>,
    },
    /// D-optimality: geometric mean of the principal σ, over the coefficients not known already.
    D,
    /// E-optimality: σ of the worst combination.
    E,
    /// Largest σ relative to its specification; an infinite specification asks for nothing.
    MaxRatio {
        /// Specification, 1σ, °/h.
        spec_deg_per_h: CoefficientVector,
        /// The same of other parameters that are seen, in their units.
        others: Vec<f64>,
    },
    /// V-optimality: what the errors of all that is seen do in a mission.
    Use {
        /// L_uᵀ L_u over all that is seen, arcsec² per squares of the parameters' units.
        weight: DMatrix<f64>,
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

/// Why a criterion is 0 before any test: every coefficient that counts in it is known exactly.
/// [`fmt::Display`] says so in words.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownBefore {
    criterion: Criterion,
    coefficients: Vec<DriftCoefficient>,
}

impl fmt::Display for KnownBefore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let which = match &self.criterion {
            Criterion::A { .. } => " with a weight",
            Criterion::D | Criterion::E => "",
            Criterion::Use { .. } => " that matters in the mission",
            Criterion::MaxRatio { .. } => " with a specification",
        };
        let names: Vec<&str> = self.coefficients.iter().map(|c| c.name()).collect();
        let names = match (&self.criterion, names.len()) {
            (Criterion::D | Criterion::E, _) | (_, 0 | COEFFICIENTS) => String::new(),
            _ => format!(" ({})", names.join(", ")),
        };
        write!(
            f,
            "criterion {} is 0 before any test and whatever the schedule: every coefficient{which}\
             {names} is known exactly, its prior sigma being 0",
            self.criterion.name()
        )
    }
}

impl Criterion {
    /// A-optimality with equal weights: the RMS σ.
    pub fn rms() -> Self {
        Self::A {
            weights: CoefficientVector::repeat(1.0),
            others: Vec::new(),
        }
    }

    /// A-optimality of the twelve coefficients.
    pub const fn weighted(weights: CoefficientVector) -> Self {
        Self::A {
            weights,
            others: Vec::new(),
        }
    }

    /// The largest ratio to a specification of the twelve coefficients, °/h.
    pub const fn max_ratio(spec_deg_per_h: CoefficientVector) -> Self {
        Self::MaxRatio {
            spec_deg_per_h,
            others: Vec::new(),
        }
    }

    /// The value, in the unit of the table above.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when P_D is not finite, or all of it is zero.
    pub fn value(&self, covariance: &dyn CoefficientCovariance) -> Result<f64> {
        Ok(libm::exp(self.log(covariance, Smoothing::Exact)?))
    }

    /// ln(value), smoothed or not.
    ///
    /// # Errors
    ///
    /// As [`Criterion::value`].
    pub fn log(&self, covariance: &dyn CoefficientCovariance, smoothing: Smoothing) -> Result<f64> {
        match self {
            // The search's usual criterion: without a gradient that nobody wants.
            Self::A { weights, others } if others.is_empty() => {
                Ok(log_weighted_rms(&covariance.variances(), weights))
            }
            Self::D => log_geometric_mean(covariance),
            _ => Ok(self.log_with_gradient(covariance, smoothing)?.0),
        }
    }

    /// ln(value) and its derivative with respect to P_D.
    ///
    /// # Errors
    ///
    /// As [`Criterion::value`].
    pub fn log_with_gradient(
        &self,
        covariance: &dyn CoefficientCovariance,
        smoothing: Smoothing,
    ) -> Result<(f64, Slope)> {
        match self {
            Self::A { weights, others } if others.is_empty() => {
                Ok(weighted_rms(&covariance.variances(), weights))
            }
            Self::A { weights, others } => Ok(weighted_rms_of_all(
                &covariance.seen().diagonal(),
                &all(others, weights),
            )),
            Self::D => geometric_mean(covariance),
            Self::E => worst_combination(covariance, smoothing),
            Self::MaxRatio {
                spec_deg_per_h,
                others,
            } if others.is_empty() => Ok(worst_ratio(
                &covariance.variances(),
                spec_deg_per_h,
                smoothing,
            )),
            Self::MaxRatio {
                spec_deg_per_h,
                others,
            } => Ok(worst_ratio_of_all(
                &covariance.seen().diagonal(),
                &all(others, spec_deg_per_h),
                smoothing,
            )),
            Self::Use { weight } => Ok(attitude_error(&covariance.seen(), weight)),
        }
    }

    /// Whether the σ of a coefficient has a part in the value: a weight or a specification.
    pub fn counts(&self, coefficient: DriftCoefficient) -> bool {
        match self {
            Self::A { weights, .. } => weights[coefficient.index()] > 0.0,
            Self::D | Self::E => true,
            Self::MaxRatio { spec_deg_per_h, .. } => {
                spec_deg_per_h[coefficient.index()].is_finite()
            }
            Self::Use { weight } => {
                let at = weight.nrows() - COEFFICIENTS + coefficient.index();
                weight[(at, at)] > 0.0
            }
        }
    }

    /// A criterion of the twelve coefficients alone which, times the factor, is never above this one.
    pub(crate) fn of_the_coefficients(&self) -> (Self, f64) {
        match self {
            Self::A { weights, others } => {
                let (twelve, rest) = (weights.sum(), others.iter().sum::<f64>());
                let factor = if rest > 0.0 {
                    (twelve / (twelve + rest)).sqrt()
                } else {
                    1.0
                };
                (Self::weighted(*weights), factor)
            }
            Self::MaxRatio { spec_deg_per_h, .. } => (Self::max_ratio(*spec_deg_per_h), 1.0),
            Self::D | Self::E => (self.clone(), 1.0),
            // With the others known P ⪰ the covariance of the twelve alone.
            Self::Use { .. } => (self.estimate(), 1.0),
        }
    }

    /// What is closest to it of the twelve coefficients alone: for estimates by those.
    pub(crate) fn estimate(&self) -> Self {
        match self {
            Self::A { weights, .. } if weights.sum() > 0.0 => Self::weighted(*weights),
            Self::MaxRatio { spec_deg_per_h, .. } if spec_deg_per_h.min().is_finite() => {
                Self::max_ratio(*spec_deg_per_h)
            }
            Self::A { .. } | Self::MaxRatio { .. } => Self::rms(),
            Self::D | Self::E => self.clone(),
            Self::Use { weight } => {
                let first = weight.nrows() - COEFFICIENTS;
                let own = weight.view((first, first), (COEFFICIENTS, COEFFICIENTS));
                Self::Use {
                    weight: own.into_owned(),
                }
            }
        }
    }

    /// Whether it counts parameters beside the drift coefficients, and none of these.
    pub fn counts_only_others(&self) -> bool {
        let none = match self {
            Self::D | Self::E | Self::Use { .. } => false,
            Self::A { weights, .. } => weights.iter().all(|w| *w == 0.0),
            Self::MaxRatio { spec_deg_per_h, .. } => spec_deg_per_h.iter().all(|s| s.is_infinite()),
        };
        none && self.counts_others()
    }

    /// Whether parameters beside the twelve coefficients have a part in the value.
    pub fn counts_others(&self) -> bool {
        match self {
            Self::D | Self::E => false,
            Self::A { others, .. } => others.iter().any(|w| *w > 0.0),
            Self::MaxRatio { others, .. } => others.iter().any(|s| s.is_finite()),
            Self::Use { weight } => weight.nrows() > COEFFICIENTS,
        }
    }

    /// Whether the value is 0 before any test and whatever the test: every coefficient that counts
    /// is known exactly, its prior σ being zero.
    pub fn is_known(&self, prior_sigma: &CoefficientVector) -> bool {
        self.known_before(prior_sigma).is_some()
    }

    /// The same in words; none where a test makes a difference.
    ///
    /// ```
    /// use scheme_opt::internals::criterion::Criterion;
    /// use scheme_opt::internals::drift::{CoefficientVector, DriftCoefficient as D};
    /// let mut weights = CoefficientVector::zeros();
    /// weights[D::FX.index()] = 1.0;
    /// let mut prior_sigma = CoefficientVector::repeat(8.0);
    /// let one = Criterion::A { weights, others: Vec::new() };
    /// assert_eq!(one.known_before(&prior_sigma), None);
    /// prior_sigma[D::FX.index()] = 0.0;
    /// let words = one.known_before(&prior_sigma).unwrap().to_string();
    /// assert!(words.starts_with("criterion a is 0 before any test"), "{words}");
    /// assert!(words.contains("D_FX"));
    /// ```
    pub fn known_before(&self, prior_sigma: &CoefficientVector) -> Option<KnownBefore> {
        let all = DriftCoefficient::ALL.into_iter();
        let counting: Vec<DriftCoefficient> = all.filter(|c| self.counts(*c)).collect();
        let open = counting.iter().any(|c| prior_sigma[c.index()] > 0.0);
        (!open && !self.counts_others()).then_some(KnownBefore {
            criterion: self.clone(),
            coefficients: counting,
        })
    }

    /// The name used in files and documents.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::A { .. } => "a",
            Self::D => "d",
            Self::E => "e",
            Self::MaxRatio { .. } => "max-ratio",
            Self::Use { .. } => "use",
        }
    }

    /// True when the criterion has kinks that a search should smooth.
    pub const fn has_kinks(&self) -> bool {
        matches!(self, Self::E | Self::MaxRatio { .. })
    }
}

/// ln √(Σ w P_ii / Σ w).
fn log_weighted_rms(variances: &CoefficientVector, weights: &CoefficientVector) -> f64 {
    0.5 * libm::log(variances.dot(weights) / weights.sum())
}

/// ln √(Σ w P_ii / Σ w) and its gradient.
fn weighted_rms(variances: &CoefficientVector, weights: &CoefficientVector) -> (f64, Slope) {
    let weighted = variances.dot(weights);
    let slope = Slope::Variances(weights / (2.0 * weighted));
    (log_weighted_rms(variances, weights), slope)
}

/// Numbers of other parameters, then of the twelve.
fn all(others: &[f64], twelve: &CoefficientVector) -> DVector<f64> {
    let both = others.iter().chain(twelve.iter()).copied();
    DVector::from_iterator(others.len() + COEFFICIENTS, both)
}

/// ln √(Σ w P_ii / Σ w) over all that is seen, and its gradient.
fn weighted_rms_of_all(variances: &DVector<f64>, weights: &DVector<f64>) -> (f64, Slope) {
    let weighted = variances.dot(weights);
    (
        0.5 * libm::log(weighted / weights.sum()),
        Slope::SeenVariances(weights / (2.0 * weighted)),
    )
}

/// ln √tr(W P), and its gradient.
fn attitude_error(p: &DMatrix<f64>, weight: &DMatrix<f64>) -> (f64, Slope) {
    let square = p.dot(weight);
    (
        0.5 * libm::log(square),
        Slope::SeenCovariance(weight / (2.0 * square)),
    )
}

/// ln max σ_i/spec_i over all that is seen, or its power mean.
fn worst_ratio_of_all(
    variances: &DVector<f64>,
    spec: &DVector<f64>,
    smoothing: Smoothing,
) -> (f64, Slope) {
    let squares = spec.map(|s| s * s);
    let ratios: Vec<f64> = variances.component_div(&squares).iter().copied().collect();
    let (log_value, shares) = soft_maximum(&ratios, smoothing);
    let slope = DVector::from_fn(spec.len(), |i, _| 0.5 * shares[i] / squares[i]);
    (0.5 * log_value, Slope::SeenVariances(slope))
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
fn log_geometric_mean(p: &dyn CoefficientCovariance) -> Result<f64> {
    let (log_det, count) = p.root().log_determinant();
    if count == 0 {
        // All known: as for the other criteria, the logarithm of zero.
        return Ok(f64::NEG_INFINITY);
    }
    let log = log_det / (2 * count) as f64;
    if log.is_finite() {
        Ok(log)
    } else {
        Err(not_a_covariance())
    }
}

/// The same with its gradient: G = P⁻¹/2n, so that K = LᵀGL = I/2n.
fn geometric_mean(p: &dyn CoefficientCovariance) -> Result<(f64, Slope)> {
    let open = p.root().open();
    // All known: nothing changes the logarithm of zero.
    let slope = Slope::InRoot(open / (2.0 * open.trace()).max(1.0));
    Ok((log_geometric_mean(p)?, slope))
}

/// The eigenvalues of LᵀL, those of P_D, with its eigenvectors u; those of P_D are L u/√λ.
fn eigen(
    p: &dyn CoefficientCovariance,
) -> Result<nalgebra::SymmetricEigen<f64, nalgebra::Const<COEFFICIENTS>>> {
    let root = p.root();
    let l = root.matrix();
    if !l.iter().all(|v| v.is_finite()) {
        return Err(not_a_covariance());
    }
    Ok((l.transpose() * l).symmetric_eigen())
}

/// √λ_max(P_D), °/h.
///
/// # Errors
///
/// [`Error::is_numerical`] when P_D is not finite.
pub(crate) fn largest_principal_sigma(p: &dyn CoefficientCovariance) -> Result<f64> {
    Ok(eigen(p)?.eigenvalues.max().sqrt())
}

/// ln √λ_max, or ln (Σ λ^p)^{1/2p}. With v = L u/√λ, G = ½ Σ share v vᵀ and K = ½ Σ share λ u uᵀ.
fn worst_combination(p: &dyn CoefficientCovariance, smoothing: Smoothing) -> Result<(f64, Slope)> {
    let eigen = eigen(p)?;
    let (log_value, shares) = soft_maximum(eigen.eigenvalues.as_slice(), smoothing);
    let mut in_root = CoefficientMatrix::zeros();
    for (i, share) in shares.into_iter().enumerate() {
        if share > 0.0 {
            let u = eigen.eigenvectors.column(i);
            in_root += u * u.transpose() * (0.5 * share * eigen.eigenvalues[i]);
        }
    }
    Ok((0.5 * log_value, Slope::InRoot(in_root)))
}

fn not_a_covariance() -> Error {
    Error::numerical(
        "the covariance of the coefficients is not finite, or all of them are known exactly",
    )
}

/// ln max σ_i/spec_i, or its power mean.
fn worst_ratio(
    variances: &CoefficientVector,
    spec: &CoefficientVector,
    smoothing: Smoothing,
) -> (f64, Slope) {
    let ratios: Vec<f64> = (0..COEFFICIENTS)
        .map(|i| variances[i] / (spec[i] * spec[i]))
        .collect();
    let (log_value, shares) = soft_maximum(&ratios, smoothing);
    let slope = CoefficientVector::from_fn(|i, _| 0.5 * shares[i] / (spec[i] * spec[i]));
    (0.5 * log_value, Slope::Variances(slope))
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
    use crate::covariance::{CovarianceRoot, Rooted};

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
            Criterion::weighted(weights),
            Criterion::D,
            Criterion::E,
            Criterion::max_ratio(spec),
        ]
    }

    #[test]
    fn values_are_what_their_names_say() {
        let sigma = CoefficientVector::from_fn(|i, _| 1.0 + i as f64);
        let p = Rooted::new(CovarianceRoot::independent(&sigma));
        let value = |c: Criterion| c.value(&p).unwrap();
        assert!((value(Criterion::rms()) - (650.0_f64 / 12.0).sqrt()).abs() < 1e-12);
        let factorial: f64 = (1..=12).map(f64::from).product();
        assert!((value(Criterion::D) - factorial.powf(1.0 / 12.0)).abs() < 1e-12);
        assert!((value(Criterion::E) - 12.0).abs() < 1e-12);
        let spec_deg_per_h = CoefficientVector::from_fn(|i, _| if i == 2 { 0.5 } else { 100.0 });
        assert!((value(Criterion::max_ratio(spec_deg_per_h)) - 6.0).abs() < 1e-12);
    }

    #[test]
    fn gradients_are_the_derivatives() {
        let p = sample();
        for criterion in criteria() {
            for smoothing in [Smoothing::Exact, Smoothing::PowerMean(6.0)] {
                let of = Rooted::of(&p);
                let (_, slope) = criterion.log_with_gradient(&of, smoothing).unwrap();
                // Ē = −P G P.
                let inverse = p.try_inverse().unwrap();
                let g = -(inverse * slope.of_information(&of) * inverse);
                for (i, j) in [(0, 0), (2, 5), (11, 3), (7, 7)] {
                    let mut direction = CoefficientMatrix::zeros();
                    direction[(i, j)] += 0.5;
                    direction[(j, i)] += 0.5;
                    let f = |h: f64| {
                        let shifted = p + direction * h;
                        let of = Rooted::of(&shifted);
                        criterion.log_with_gradient(&of, smoothing).unwrap().0
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
        let p = Rooted::of(&sample());
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
        let sigma = CoefficientVector::from_fn(|i, _| if i == 4 { 0.0 } else { 3.0 });
        let p = Rooted::new(CovarianceRoot::independent(&sigma));
        assert!((Criterion::D.value(&p).unwrap() - 3.0).abs() < 1e-12);
        let nothing = Rooted::new(CovarianceRoot::independent(&CoefficientVector::zeros()));
        // All known: the criterion is 0, as for the others.
        assert_eq!(Criterion::D.value(&nothing).unwrap(), 0.0);
    }
}
