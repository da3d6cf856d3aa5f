//! The information on D kept as rows and triangularised by QR: for numbers that are printed.
//!
//! The Gram form E = Σ XᵀX squares the condition of the problem. Where a schedule leaves a
//! combination such as D_FX + D_SX to the prior while it measures D_FX − D_SX to 1e-7 of it, E
//! has lost every digit of the former. Rows under a QR factorisation keep them. Columns are
//! pivoted and large rows come first, which makes Householder QR backward stable row by row (Cox &
//! Higham, *Stability of Householder QR factorization for weighted least squares problems*, 1998).

use nalgebra::{DMatrix, SMatrix};

use super::chain::InformationSink;
use super::{CovarianceRoot, not_finite};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector, DriftMatrix};
use crate::error::Result;

/// Rows collected between two factorisations.
const FRESH: usize = 60;
const HEIGHT: usize = COEFFICIENTS + FRESH;

/// Rows of the information on D, in units of the prior σ.
#[derive(Debug, Clone)]
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

    /// R of all rows, in units of the prior σ.
    pub fn triangle(&mut self) -> CoefficientMatrix {
        self.compress();
        self.stack.fixed_rows::<COEFFICIENTS>(0).into_owned()
    }

    /// Adds such an R.
    pub fn add_triangle(&mut self, r: &CoefficientMatrix) {
        self.compress();
        self.stack
            .fixed_rows_mut::<COEFFICIENTS>(COEFFICIENTS)
            .copy_from(r);
        self.used = 2 * COEFFICIENTS;
    }

    /// L with P_D = L Lᵀ = S (RᵀR + I)⁻¹ S, S the prior σ.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when a row is not finite.
    pub fn covariance_root(mut self) -> Result<CovarianceRoot> {
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
        let mut pivots = in_order();
        qr.p().permute_rows(&mut pivots);
        root_of_triangle(&qr.r(), pivots.into(), &self.prior_sigma)
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

/// A row on D in units of the prior σ, and the information with which it counts: `scale` times the
/// row has unit noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct Told {
    pub row: [f64; COEFFICIENTS],
    pub scale: f64,
}

impl Told {
    /// Of a row on D and the prior σ.
    pub fn new(row: &[f64; COEFFICIENTS], scale: f64, prior_sigma: &CoefficientVector) -> Self {
        Self {
            row: std::array::from_fn(|j| row[j] * prior_sigma[j]),
            scale,
        }
    }
}

/// Rows on D, triangularised together with the prior, and what Ē does to each of them.
///
/// Of a row x that measurements tell, x P_D is 1e22 times less than x and P_D say where that is the
/// condition of P_D. As (x L) Lᵀ with x L from the factorisation it keeps its digits, x L being
/// what the row adds to each pivot.
pub(super) struct Whitened {
    /// L.
    pub root: CovarianceRoot,
    /// The rows times L.
    rows: DMatrix<f64>,
}

impl Whitened {
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when a row is not finite.
    pub fn new(told: &[Told], prior_sigma: &CoefficientVector) -> Result<Self> {
        let size = |t: &Told| t.scale * t.row.iter().fold(0.0_f64, |max, v| max.max(v.abs()));
        let mut order: Vec<(f64, usize)> = told.iter().map(size).zip(0..).collect();
        if !order.iter().all(|(size, _)| size.is_finite()) {
            return Err(not_finite());
        }
        order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut stack = DMatrix::zeros(told.len() + COEFFICIENTS, COEFFICIENTS);
        for (to, (_, from)) in order.iter().enumerate() {
            for j in 0..COEFFICIENTS {
                stack[(to, j)] = told[*from].row[j] * told[*from].scale;
            }
        }
        stack
            .rows_mut(told.len(), COEFFICIENTS)
            .fill_with_identity();
        let qr = stack.col_piv_qr();
        let r = qr
            .r()
            .fixed_view::<COEFFICIENTS, COEFFICIENTS>(0, 0)
            .into_owned();
        let mut pivots = in_order();
        qr.p().permute_rows(&mut pivots);
        let pivots: [usize; COEFFICIENTS] = pivots.into();
        let scaled = root_of_triangle(&r, pivots, &CoefficientVector::repeat(1.0))?;
        let q = qr.q();
        let mut rows = DMatrix::zeros(told.len(), COEFFICIENTS);
        for (at, (_, k)) in order.iter().enumerate() {
            let Told { row, scale } = &told[*k];
            if *scale > 0.0 {
                rows.set_row(*k, &(q.row(at) / *scale));
            } else {
                // A row that does not count yet adds nothing to a pivot.
                let row = CoefficientVector::from(*row).transpose();
                rows.set_row(*k, &(row * scaled.matrix()));
            }
        }
        Ok(Self {
            root: root_of_triangle(&r, pivots, prior_sigma)?,
            rows,
        })
    }

    /// Every row times Ē = −L K Lᵀ.
    pub fn times_adjoint(&self, in_root: &CoefficientMatrix) -> Vec<[f64; COEFFICIENTS]> {
        let pulled = -(in_root * self.root.matrix().transpose());
        let all = &self.rows * pulled;
        all.row_iter()
            .map(|row| std::array::from_fn(|j| row[j]))
            .collect()
    }
}

/// S P R⁻¹: `pivots` are the coefficients in the order of the columns of R, S the prior σ.
fn root_of_triangle(
    r: &CoefficientMatrix,
    pivots: [usize; COEFFICIENTS],
    prior_sigma: &CoefficientVector,
) -> Result<CovarianceRoot> {
    let mut inverse = CoefficientMatrix::identity();
    if !r.solve_upper_triangular_mut(&mut inverse) {
        return Err(not_finite());
    }
    let mut root = CoefficientMatrix::zeros();
    for (k, &coefficient) in pivots.iter().enumerate() {
        root.set_row(coefficient, &(inverse.row(k) * prior_sigma[coefficient]));
    }
    Ok(CovarianceRoot::new(root, pivots))
}

/// The coefficients in order, for a permutation to put in its own.
fn in_order() -> SMatrix<usize, COEFFICIENTS, 1> {
    SMatrix::from_fn(|i, _| i)
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
