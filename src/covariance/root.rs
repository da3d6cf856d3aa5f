//! P_D by a root: what criteria are computed from.
//!
//! Under weak priors the σ of one combination of coefficients may be 1e11 times that of another.
//! A determinant or a derivative from the entries of P_D, which then has a condition of 1e22, has
//! no digits left. A root of it, the inverse of the triangle that the information is kept as, has
//! half the exponents, and its diagonal the digits of every pivot.

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};

use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector};

/// L with P_D = L Lᵀ, °/h: triangular but for the order of its rows.
#[derive(Debug, Clone, PartialEq)]
pub struct CovarianceRoot {
    matrix: CoefficientMatrix,
    /// The row in which column k has its pivot.
    pivots: [usize; COEFFICIENTS],
}

impl CovarianceRoot {
    /// L, whose rows `pivots[0]`, `pivots[1]`, … make an upper triangle.
    pub(crate) fn new(matrix: CoefficientMatrix, pivots: [usize; COEFFICIENTS]) -> Self {
        Self { matrix, pivots }
    }

    /// Of coefficients known independently of each other, by their 1σ, °/h.
    pub fn independent(sigma_deg_per_h: &CoefficientVector) -> Self {
        Self {
            matrix: CoefficientMatrix::from_diagonal(sigma_deg_per_h),
            pivots: std::array::from_fn(|i| i),
        }
    }

    /// L, °/h.
    pub fn matrix(&self) -> &CoefficientMatrix {
        &self.matrix
    }

    /// The pivots of the coefficients that are not known exactly, °/h: their squares' product is
    /// the determinant over those.
    fn open_pivots(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let pivot = |(k, &row): (usize, &usize)| (k, self.matrix[(row, k)].abs());
        let all = self.pivots.iter().enumerate().map(pivot);
        all.filter(|(_, pivot)| *pivot != 0.0)
    }

    /// ln det P_D over the coefficients not known exactly, P_D in (°/h)², and how many they are.
    pub fn log_determinant(&self) -> (f64, usize) {
        self.open_pivots().fold((0.0, 0), |(sum, count), (_, v)| {
            (sum + 2.0 * libm::log(v), count + 1)
        })
    }

    /// I but for the coefficients that are known exactly, in the columns of L.
    pub(crate) fn open(&self) -> CoefficientMatrix {
        let mut open = CoefficientMatrix::zeros();
        for (k, _) in self.open_pivots() {
            open[(k, k)] = 1.0;
        }
        open
    }
}

/// P_D as a criterion sees it: its entries, and a root of it where those are not enough.
pub trait CoefficientCovariance {
    /// P_D, (°/h)².
    fn matrix(&self) -> &CoefficientMatrix;
    /// Its diagonal, (°/h)².
    fn variances(&self) -> CoefficientVector {
        self.matrix().diagonal()
    }
    /// A root of it, worked out when it is asked for.
    fn root(&self) -> Cow<'_, CovarianceRoot>;
    /// P over all that a figure of merit sees: other parameters, then the twelve, in their units and
    /// with what considered parameters do. P_D where nothing else is seen.
    fn seen(&self) -> DMatrix<f64> {
        let p = self.matrix();
        DMatrix::from_fn(COEFFICIENTS, COEFFICIENTS, |i, j| p[(i, j)])
    }
}

/// P_D with its root.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rooted {
    matrix: CoefficientMatrix,
    root: CovarianceRoot,
}

impl Rooted {
    /// L Lᵀ.
    pub fn new(root: CovarianceRoot) -> Self {
        Self {
            matrix: root.matrix * root.matrix.transpose(),
            root,
        }
    }

    /// (E + S⁻²)⁻¹ by the Cholesky factor of S E S + I, S the prior σ; none where E is not finite, or
    /// so much larger than the prior's information that a sum of squares has lost the latter's digits.
    pub fn of_information(
        information: &CoefficientMatrix,
        prior_sigma: &CoefficientVector,
    ) -> Option<Self> {
        /// Of what is known after the test beside what was known before, as a ratio of variances: a
        /// sum of squares then has four digits left for what only the prior tells.
        const MOST_GAINED: f64 = 1e12;
        let mut scaled = *information;
        for j in 0..COEFFICIENTS {
            for i in 0..COEFFICIENTS {
                scaled[(i, j)] *= prior_sigma[i] * prior_sigma[j];
            }
            scaled[(j, j)] += 1.0;
        }
        if scaled.diagonal().max() > MOST_GAINED {
            return None;
        }
        let upper = nalgebra::Cholesky::new(scaled)?.l().transpose();
        let mut root = CoefficientMatrix::identity();
        if !upper.solve_upper_triangular_mut(&mut root) {
            return None;
        }
        for (i, sigma) in prior_sigma.iter().enumerate() {
            root.row_mut(i).scale_mut(*sigma);
        }
        Some(Self::new(CovarianceRoot::new(
            root,
            std::array::from_fn(|i| i),
        )))
    }

    /// A P_D, positive definite but for coefficients that are known exactly, by its Cholesky factor:
    /// with its columns the other way round, its rows from the last on make an upper triangle.
    #[cfg(test)]
    pub fn of(p: &CoefficientMatrix) -> Self {
        let known = p.diagonal().map(|v| f64::from(u8::from(v == 0.0)));
        let with_units = *p + CoefficientMatrix::from_diagonal(&known);
        let mut l = nalgebra::Cholesky::new(with_units).unwrap().l();
        for k in (0..COEFFICIENTS).filter(|&k| known[k] != 0.0) {
            l[(k, k)] = 0.0;
        }
        let pivots = std::array::from_fn(|k| COEFFICIENTS - 1 - k);
        let columns = pivots.map(|k| l.column(k).into_owned());
        Self::new(CovarianceRoot::new(
            CoefficientMatrix::from_columns(&columns),
            pivots,
        ))
    }
}

impl CoefficientCovariance for Rooted {
    fn matrix(&self) -> &CoefficientMatrix {
        &self.matrix
    }
    fn root(&self) -> Cow<'_, CovarianceRoot> {
        Cow::Borrowed(&self.root)
    }
}

/// The derivative of a figure of merit f with respect to P_D.
#[allow(
    clippy::large_enum_variant,
    reason = "one lives at a time, on the stack of every gradient: a box would cost more"
)]
#[derive(Debug, Clone, PartialEq)]
pub enum Slope {
    /// ∂f/∂P_ii: only the variances count.
    Variances(CoefficientVector),
    /// K = Lᵀ G L with df = tr(G dP_D), in the columns of the root L: where G itself, as large as
    /// P_D⁻¹, would have lost its digits.
    InRoot(CoefficientMatrix),
    /// ∂f/∂P_ii over all that is [seen](CoefficientCovariance::seen).
    SeenVariances(DVector<f64>),
    /// G with df = tr(G dP) over all that is seen.
    SeenCovariance(DMatrix<f64>),
}

impl Slope {
    /// Of `factor` times the figure of merit.
    pub fn times(self, factor: f64) -> Self {
        match self {
            Self::Variances(g) => Self::Variances(g * factor),
            Self::InRoot(k) => Self::InRoot(k * factor),
            Self::SeenVariances(g) => Self::SeenVariances(g * factor),
            Self::SeenCovariance(g) => Self::SeenCovariance(g * factor),
        }
    }

    /// G over the twelve; what else is seen comes before them.
    fn of_covariance(&self) -> Option<CoefficientMatrix> {
        match self {
            Self::InRoot(_) => None,
            Self::Variances(g) => Some(CoefficientMatrix::from_diagonal(g)),
            Self::SeenVariances(g) => {
                let first = g.len() - COEFFICIENTS;
                let diagonal = CoefficientVector::from_fn(|i, _| g[first + i]);
                Some(CoefficientMatrix::from_diagonal(&diagonal))
            }
            Self::SeenCovariance(g) => {
                let first = g.nrows() - COEFFICIENTS;
                Some(CoefficientMatrix::from_fn(|i, j| g[(first + i, first + j)]))
            }
        }
    }

    /// Lᵀ G L, of the twelve.
    pub fn in_root(&self, of: &dyn CoefficientCovariance) -> CoefficientMatrix {
        match (self, self.of_covariance()) {
            (Self::InRoot(k), _) => *k,
            (_, g) => {
                let root = of.root();
                root.matrix.transpose() * g.unwrap_or_default() * root.matrix
            }
        }
    }

    /// Ē = ∂f/∂E = −P G P with E the information on D, P_D = E⁻¹.
    pub fn of_information(&self, of: &dyn CoefficientCovariance) -> CoefficientMatrix {
        match (self, self.of_covariance()) {
            (Self::InRoot(k), _) => {
                let root = of.root();
                -(root.matrix * k * root.matrix.transpose())
            }
            (_, g) => {
                let p = of.matrix();
                -(p * g.unwrap_or_default() * p)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A permuted triangle with a coefficient that is known.
    fn sample() -> CovarianceRoot {
        let pivots: [usize; COEFFICIENTS] = std::array::from_fn(|k| (5 * k + 3) % COEFFICIENTS);
        let mut matrix = CoefficientMatrix::zeros();
        for (k, &row) in pivots.iter().enumerate() {
            for j in k..COEFFICIENTS {
                matrix[(row, j)] = 1.0 / (1 + k + 2 * j) as f64;
            }
        }
        let known = pivots[4];
        matrix.row_mut(known).fill(0.0);
        CovarianceRoot::new(matrix, pivots)
    }

    #[test]
    fn the_determinant_is_over_what_is_not_known() {
        let root = sample();
        let (log, count) = root.log_determinant();
        assert_eq!(count, 11);
        let pivots = (0..COEFFICIENTS).filter(|&k| k != 4);
        let expected: f64 = pivots.map(|k| -2.0 * ((1 + 3 * k) as f64).ln()).sum();
        assert!((log - expected).abs() < 1e-12);
        assert_eq!(root.open().trace(), 11.0);
    }

    #[test]
    fn both_forms_of_a_slope_are_the_same_derivative() {
        let of = Rooted::new(sample());
        let g = CoefficientVector::from_fn(|i, _| 1.0 + i as f64);
        let variances = Slope::Variances(g).times(2.0);
        let in_root = Slope::InRoot(variances.in_root(&of));
        let difference = variances.of_information(&of) - in_root.of_information(&of);
        assert!(difference.amax() < 1e-13);
    }
}
