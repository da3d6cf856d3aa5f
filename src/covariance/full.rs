//! What is known of all parameters at the end of a test, by a filter that may not know of some.
//!
//! With E the information of (estimated e, considered c) without c's prior, N = E_ee⁻¹ is what the
//! filter claims and B = −N E_ec what an error of c does to its estimates. The truth is
//! P = N + B Σ_c Bᵀ, Σ_c the prior covariance of c. In factored form, E = RᵀR with e first,
//! N = R_ee⁻¹ R_ee⁻ᵀ and B = −R_ee⁻¹ R_ec: c may be known from nowhere.
//!
//! The **budget** says the same of every group of `[errors]`: what a filter would add that ignored it
//! and estimated the rest.

use std::borrow::Cow;

use nalgebra::{DMatrix, Matrix3};

use super::{CoefficientCovariance, CovarianceRoot, EndCovariance};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector};
use crate::model::{ErrorModel, Role};

/// The covariance of everything at the end of a schedule.
#[derive(Debug, Clone, PartialEq)]
pub struct FullCovariance {
    /// Of the twelve coefficients and of ψ^n: the truth.
    pub end: EndCovariance,
    /// Of all estimated parameters, each in its unit: the truth, P.
    pub parameters: DMatrix<f64>,
    /// What the filter claims of them, N; the same where nothing is considered.
    pub claimed: DMatrix<f64>,
    /// What ignoring each group adds.
    pub budget: Vec<IgnoredGroup>,
    /// 1σ of the constant part of D_FX, D_FY, D_FZ, °/h, the truth, under a random walk of the drift:
    /// D_F itself is then the drift at the end of the test, that part and what the walk has come to. None:
    /// no random walk.
    pub constant_part_deg_per_h: Option<[f64; 3]>,
}

/// What a filter adds that ignores a group of parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct IgnoredGroup {
    /// The key of the group in `[errors]`.
    pub group: &'static str,
    /// Whether it is ignored already.
    pub role: Role,
    /// 1σ of the error that it causes in each of the twelve coefficients, °/h.
    pub error_deg_per_h: CoefficientVector,
}

impl IgnoredGroup {
    /// √(mean of their squares), °/h.
    pub fn rms_error_deg_per_h(&self) -> f64 {
        (self.error_deg_per_h.norm_squared() / COEFFICIENTS as f64).sqrt()
    }
}

/// What a route comes to, in the parameters' units.
pub(super) struct Outcome {
    /// The parameter that each row belongs to; the twelve coefficients come last.
    pub pivots: Vec<usize>,
    /// L with N = L Lᵀ, upper triangular in this order.
    pub root: DMatrix<f64>,
    /// B Σ_c^½, a column for each considered parameter.
    pub bias: DMatrix<f64>,
    /// Of ψ^n: the truth, arcsec².
    pub misalignment: Matrix3<f64>,
    /// What the random walk of the drift has come to; none: it has none.
    pub walked: Option<Walked>,
    pub budget: Vec<IgnoredGroup>,
}

/// What the random walk of the drift of gyros X, Y, Z has come to at the end, °/h.
pub(super) struct Walked {
    /// A root of what of its covariance is its own.
    pub own: DMatrix<f64>,
    /// What it is of the errors of the estimates, whose root L is: a column for each of L.
    pub by_estimates: DMatrix<f64>,
    /// What it is of the parameters that are ignored, at one prior σ of each.
    pub by_ignored: DMatrix<f64>,
}

impl Walked {
    /// The rows of D_FX, D_FY, D_FZ, with the gyro.
    fn rows(pivots: &[usize]) -> impl Iterator<Item = (usize, usize)> + '_ {
        let gyro =
            |(row, parameter): (usize, &usize)| (*parameter < 3).then_some((row, *parameter));
        pivots.iter().enumerate().filter_map(gyro)
    }

    /// Adds it to what is ignored makes of D_F.
    pub fn add_to_bias(&self, pivots: &[usize], bias: &mut DMatrix<f64>) {
        for (row, gyro) in Self::rows(pivots) {
            let mut of = bias.row_mut(row);
            of += self.by_ignored.row(gyro);
        }
    }

    /// 1σ of the drift D_F + d(T) of each gyro, with its index.
    pub fn sigma<'a>(
        &'a self,
        pivots: &'a [usize],
        root: &'a DMatrix<f64>,
        bias: &'a DMatrix<f64>,
    ) -> impl Iterator<Item = (usize, f64)> + 'a {
        Self::rows(pivots).map(|(row, gyro)| {
            let estimated = root.row(row) + self.by_estimates.row(gyro);
            let ignored = bias.row(row) + self.by_ignored.row(gyro);
            let own = self.own.row(gyro).norm_squared();
            let sum = own + estimated.norm_squared() + ignored.norm_squared();
            (gyro, sum.sqrt())
        })
    }

    /// The root and the bias with D_F + d(T) for D_F.
    fn at_the_end(
        &self,
        pivots: &[usize],
        root: &DMatrix<f64>,
        bias: &DMatrix<f64>,
    ) -> (DMatrix<f64>, DMatrix<f64>) {
        let (count, own) = (pivots.len(), self.own.ncols());
        let mut both = root.clone().resize_horizontally(count + own, 0.0);
        for (row, gyro) in Self::rows(pivots) {
            let mut of = both.view_mut((row, 0), (1, count));
            of += self.by_estimates.row(gyro);
            both.view_mut((row, count), (1, own))
                .copy_from(&self.own.row(gyro));
        }
        let mut bias = bias.clone();
        self.add_to_bias(pivots, &mut bias);
        (upper_root(&both), bias)
    }
}

/// U, upper triangular, with U Uᵀ = M Mᵀ: by one triangle, from the last row up. With J the reversal,
/// (J M)ᵀ = Q R gives M Mᵀ = (J Rᵀ J)(J R J).
fn upper_root(m: &DMatrix<f64>) -> DMatrix<f64> {
    let last = m.nrows() - 1;
    let reversed = DMatrix::from_fn(m.ncols(), m.nrows(), |i, j| m[(last - j, i)]);
    let r = reversed.qr().r();
    DMatrix::from_fn(m.nrows(), m.nrows(), |i, j| r[(last - j, last - i)])
}

/// The twelve coefficients.
pub(super) fn coefficients() -> Vec<usize> {
    (0..COEFFICIENTS).collect()
}

/// A filter that is asked about: the parameters that it estimates but for the twelve coefficients,
/// and those that it ignores.
pub(super) struct Question {
    pub others: Vec<usize>,
    pub ignored: Vec<usize>,
}

impl Question {
    /// The filter of the platform.
    pub fn of(errors: &ErrorModel) -> Self {
        let estimated = errors.estimated();
        Self {
            others: (COEFFICIENTS..estimated).collect(),
            ignored: (estimated..errors.parameters().len()).collect(),
        }
    }

    /// Those of the budget: for each group and role a filter that ignores it.
    pub fn of_budget(errors: &ErrorModel) -> Vec<(&'static str, Role, Self)> {
        let parameters = errors.parameters();
        let mut questions: Vec<(&'static str, Role, Self)> = Vec::new();
        for p in &parameters[COEFFICIENTS..] {
            let asked =
                |(group, role, _): &(&str, Role, Self)| (*group, *role) == (p.group, p.role);
            if questions.iter().any(asked) {
                continue;
            }
            let all = COEFFICIENTS..parameters.len();
            let (ignored, rest): (Vec<usize>, Vec<usize>) = all.partition(|k| {
                let other = &parameters[*k];
                (other.group, other.role) == (p.group, p.role)
            });
            let estimated = |k: &usize| parameters[*k].role == Role::Estimated;
            let others = rest.into_iter().filter(estimated).collect();
            questions.push((p.group, p.role, Self { others, ignored }));
        }
        questions
    }
}

/// 1σ of what the rows of `bias` make of the twelve coefficients.
pub(super) fn errors_of_coefficients(pivots: &[usize], bias: &DMatrix<f64>) -> CoefficientVector {
    let mut errors = CoefficientVector::zeros();
    for (row, &parameter) in pivots.iter().enumerate() {
        if parameter < COEFFICIENTS {
            errors[parameter] = bias.row(row).norm();
        }
    }
    errors
}

impl FullCovariance {
    pub(super) fn new(outcome: Outcome) -> Self {
        let Outcome {
            pivots,
            root,
            bias,
            misalignment,
            walked,
            budget,
        } = outcome;
        let constant_part_deg_per_h = walked.as_ref().map(|_| {
            let mut sigma = [0.0; 3];
            for (row, gyro) in Walked::rows(&pivots) {
                let squares = root.row(row).norm_squared() + bias.row(row).norm_squared();
                sigma[gyro] = squares.sqrt();
            }
            sigma
        });
        let (root, bias) = match &walked {
            Some(walked) => walked.at_the_end(&pivots, &root, &bias),
            None => (root, bias),
        };
        let first = pivots.len() - COEFFICIENTS;
        let coefficient_root = coefficient_root(&pivots[first..], &root, &bias);
        let matrix = coefficient_root.matrix();
        let claimed = &root * root.transpose();
        let truth = &claimed + &bias * bias.transpose();
        let in_order = |m: &DMatrix<f64>| {
            let mut ordered = DMatrix::zeros(pivots.len(), pivots.len());
            for (i, &a) in pivots.iter().enumerate() {
                for (j, &b) in pivots.iter().enumerate() {
                    ordered[(a, b)] = m[(i, j)];
                }
            }
            ordered
        };
        let coefficients = matrix * matrix.transpose();
        let mut parameters = in_order(&truth);
        // The same numbers to the last digit.
        for i in 0..COEFFICIENTS {
            for j in 0..COEFFICIENTS {
                parameters[(i, j)] = coefficients[(i, j)];
            }
        }
        Self {
            claimed: match bias.ncols() {
                0 => parameters.clone(),
                _ => in_order(&claimed),
            },
            parameters,
            end: EndCovariance {
                coefficients,
                root: coefficient_root,
                misalignment,
            },
            budget,
            constant_part_deg_per_h,
        }
    }

    /// Of the twelve coefficients where there is nothing else.
    pub(crate) fn of_coefficients(end: EndCovariance) -> Self {
        let parameters =
            DMatrix::from_fn(COEFFICIENTS, COEFFICIENTS, |i, j| end.coefficients[(i, j)]);
        Self {
            claimed: parameters.clone(),
            parameters,
            budget: Vec::new(),
            constant_part_deg_per_h: None,
            end,
        }
    }

    /// Whether every number is one.
    pub(super) fn is_finite(&self) -> bool {
        let end = self
            .end
            .coefficients
            .iter()
            .chain(self.end.misalignment.iter());
        let all = end.chain(self.parameters.iter()).chain(self.claimed.iter());
        let budget = self.budget.iter().flat_map(|g| g.error_deg_per_h.iter());
        all.chain(budget).all(|v| v.is_finite())
    }

    /// P as a criterion sees it that counts `others` besides the twelve coefficients.
    pub(crate) fn seeing<'a>(&'a self, others: &'a [usize]) -> Seeing<'a> {
        Seeing { full: self, others }
    }

    /// 1σ of every estimated parameter in its unit: the truth.
    pub fn sigma(&self) -> Vec<f64> {
        self.parameters
            .diagonal()
            .iter()
            .map(|v| v.sqrt())
            .collect()
    }

    /// 1σ of every estimated parameter in its unit: what the filter claims.
    pub fn claimed_sigma(&self) -> Vec<f64> {
        self.claimed.diagonal().iter().map(|v| v.sqrt()).collect()
    }
}

/// The truth of other parameters and of the twelve coefficients.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seeing<'a> {
    full: &'a FullCovariance,
    /// Places in the model's parameters.
    others: &'a [usize],
}

impl CoefficientCovariance for Seeing<'_> {
    fn matrix(&self) -> &CoefficientMatrix {
        self.full.end.matrix()
    }
    fn root(&self) -> Cow<'_, CovarianceRoot> {
        self.full.end.root()
    }
    fn seen(&self) -> DMatrix<f64> {
        let all: Vec<usize> = self.others.iter().copied().chain(0..COEFFICIENTS).collect();
        let p = &self.full.parameters;
        DMatrix::from_fn(all.len(), all.len(), |i, j| p[(all[i], all[j])])
    }
}

/// A root of the truth of the twelve coefficients, upper triangular in the order of their pivots.
fn coefficient_root(pivots: &[usize], root: &DMatrix<f64>, bias: &DMatrix<f64>) -> CovarianceRoot {
    let first = root.nrows() - COEFFICIENTS;
    let own = root.view((first, first), (COEFFICIENTS, COEFFICIENTS));
    let mut triangle = CoefficientMatrix::from_fn(|i, j| own[(i, j)]);
    if bias.ncols() > 0 {
        // [L B] [L B]ᵀ by one triangle, from the last row up: with J the reversal,
        // (J [L B])ᵀ = Q R gives [L B][L B]ᵀ = (J Rᵀ J)(J R J).
        let both = DMatrix::from_fn(COEFFICIENTS + bias.ncols(), COEFFICIENTS, |i, j| {
            let row = COEFFICIENTS - 1 - j;
            match i.checked_sub(COEFFICIENTS) {
                None => own[(row, i)],
                Some(considered) => bias[(first + row, considered)],
            }
        });
        let r = both.qr().r();
        let last = COEFFICIENTS - 1;
        triangle = CoefficientMatrix::from_fn(|i, j| r[(last - j, last - i)]);
    }
    let mut matrix = CoefficientMatrix::zeros();
    for (k, &coefficient) in pivots.iter().enumerate() {
        matrix.set_row(coefficient, &triangle.row(k));
    }
    CovarianceRoot::new(matrix, std::array::from_fn(|k| pivots[k]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_of_the_truth_is_its_root() {
        let size = COEFFICIENTS + 2;
        let root = DMatrix::from_fn(size, size, |i, j| match i.cmp(&j) {
            std::cmp::Ordering::Equal => 1.0 + 0.1 * i as f64,
            std::cmp::Ordering::Less => 0.3 * ((3 * i + 7 * j) as f64).sin(),
            std::cmp::Ordering::Greater => 0.0,
        });
        let bias = DMatrix::from_fn(size, 3, |i, j| ((i * i + 5 * j) as f64).cos());
        let pivots: Vec<usize> = [13, 12]
            .into_iter()
            .chain((0..COEFFICIENTS).rev())
            .collect();
        for bias in [DMatrix::zeros(size, 0), bias] {
            let full = FullCovariance::new(Outcome {
                pivots: pivots.clone(),
                root: root.clone(),
                bias: bias.clone(),
                misalignment: Matrix3::identity(),
                walked: None,
                budget: Vec::new(),
            });
            let truth = &root * root.transpose() + &bias * bias.transpose();
            for (i, &a) in pivots.iter().enumerate() {
                for (j, &b) in pivots.iter().enumerate() {
                    let found = full.parameters[(a, b)];
                    assert!((found - truth[(i, j)]).abs() < 1e-13);
                    if a < COEFFICIENTS && b < COEFFICIENTS {
                        let found = full.end.coefficients[(a, b)];
                        assert!((found - truth[(i, j)]).abs() < 1e-12, "{a} {b}");
                    }
                }
            }
            // The determinant is that of the triangle.
            let expected = full.end.coefficients.determinant().ln();
            let (found, open) = full.end.root.log_determinant();
            assert_eq!(open, COEFFICIENTS);
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
    }
}
