//! The information on D kept as rows and triangularised by QR: for numbers that are printed.
//!
//! The Gram form E = Σ XᵀX squares the condition of the problem. Where a schedule leaves a
//! combination such as D_FX + D_SX to the prior while it measures D_FX − D_SX to 1e-7 of it, E
//! has lost every digit of the former. Rows under a QR factorisation keep them. Columns are
//! pivoted and large rows come first, which makes Householder QR backward stable row by row (Cox &
//! Higham, *Stability of Householder QR factorization for weighted least squares problems*, 1998).

use nalgebra::SMatrix;

use super::chain::InformationSink;
use super::not_finite;
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector, DriftMatrix};
use crate::error::Result;

/// Rows collected between two factorisations.
const FRESH: usize = 60;
const HEIGHT: usize = COEFFICIENTS + FRESH;

/// Rows of the information on D, in units of the prior σ.
pub(super) struct Rows {
    prior_sigma: CoefficientVector,
    /// The triangularised past, then fresh rows.
    stack: Box<SMatrix<f64, HEIGHT, COEFFICIENTS>>,
    used: usize,
}

impl Rows {
    pub fn new(prior_sigma: &CoefficientVector) -> Self {
        Self {
            prior_sigma: *prior_sigma,
            stack: Box::new(SMatrix::zeros()),
            used: COEFFICIENTS,
        }
    }

    /// The largest entry in all: how many times better than the prior, σ against σ, some
    /// combination of coefficients is told.
    pub fn largest(&mut self) -> f64 {
        self.compress();
        self.stack.amax()
    }

    /// L with P_D = L Lᵀ = S (RᵀR + I)⁻¹ S, S the prior σ.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when a row is not finite.
    pub fn covariance_root(mut self) -> Result<CoefficientMatrix> {
        self.compress();
        let mut with_prior = SMatrix::<f64, { 2 * COEFFICIENTS }, COEFFICIENTS>::zeros();
        with_prior
            .fixed_rows_mut::<COEFFICIENTS>(0)
            .copy_from(&self.stack.fixed_rows::<COEFFICIENTS>(0));
        with_prior
            .fixed_rows_mut::<COEFFICIENTS>(COEFFICIENTS)
            .fill_with_identity();
        if !with_prior.iter().all(|v| v.is_finite()) {
            return Err(not_finite());
        }
        let qr = with_prior.col_piv_qr();
        let mut root = CoefficientMatrix::identity();
        if !qr.r().solve_upper_triangular_mut(&mut root) {
            return Err(not_finite());
        }
        // Rows of `root` are in pivot order; put them back, in units of °/h.
        qr.p().inv_permute_rows(&mut root);
        for (i, mut row) in root.row_iter_mut().enumerate() {
            row *= self.prior_sigma[i];
        }
        Ok(root)
    }

    fn compress(&mut self) {
        sort_rows(&mut self.stack, self.used);
        let qr = self.stack.col_piv_qr();
        let mut r = qr.r();
        qr.p().inv_permute_columns(&mut r);
        self.stack.fill(0.0);
        self.stack.fixed_rows_mut::<COEFFICIENTS>(0).copy_from(&r);
        self.used = COEFFICIENTS;
    }
}

/// Puts the largest of the first `used` rows first.
fn sort_rows(stack: &mut SMatrix<f64, HEIGHT, COEFFICIENTS>, used: usize) {
    let mut order: Vec<(f64, usize)> = (0..used).map(|i| (stack.row(i).amax(), i)).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let unsorted = *stack;
    for (to, (_, from)) in order.into_iter().enumerate() {
        stack.set_row(to, &unsorted.row(from));
    }
}

impl InformationSink for Rows {
    fn add(&mut self, rows: &DriftMatrix) {
        if self.used + 3 > HEIGHT {
            self.compress();
        }
        for i in 0..3 {
            for j in 0..COEFFICIENTS {
                self.stack[(self.used + i, j)] = rows[(i, j)] * self.prior_sigma[j];
            }
        }
        self.used += 3;
    }
}
