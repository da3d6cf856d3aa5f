//! The information on D kept as rows and triangularised by QR: for numbers that are printed.
//!
//! The Gram form E = Σ XᵀX squares the condition of the problem. Where a schedule leaves a
//! combination such as D_FX + D_SX to the prior while it measures D_FX − D_SX to 1e-7 of it, E
//! has lost every digit of the former. Rows under a QR factorisation keep them. Columns are
//! pivoted and large rows come first, which makes Householder QR backward stable row by row (Cox &
//! Higham, *Stability of Householder QR factorization for weighted least squares problems*, 1998).

use nalgebra::allocator::Allocator;
use nalgebra::{DMatrix, DefaultAllocator, Dim, OMatrix, SMatrix, U3};

use super::chain::InformationSink;
use super::real::Real;
use super::triangle::triangularise_pivoted;
use super::{CovarianceRoot, not_finite};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector};
use crate::error::Result;

/// Rows collected between two factorisations.
const FRESH: usize = 60;

/// Rows of the information on D, in units of the prior σ.
#[derive(Debug, Clone)]
pub(super) struct Rows<T: Real = f64> {
    prior_sigma: Vec<f64>,
    /// The triangularised past, then fresh rows.
    stack: Vec<Vec<T>>,
    used: usize,
}

impl Rows {
    /// On the twelve coefficients.
    pub fn new(prior_sigma: &CoefficientVector) -> Self {
        Self::on(prior_sigma.as_slice())
    }

    /// R of all rows, in units of the prior σ.
    pub fn triangle(&mut self) -> CoefficientMatrix {
        self.compress();
        CoefficientMatrix::from_fn(|i, j| self.stack[i][j])
    }

    /// Adds such an R.
    pub fn add_triangle(&mut self, r: &CoefficientMatrix) {
        self.compress();
        for i in 0..COEFFICIENTS {
            for j in 0..COEFFICIENTS {
                self.stack[self.used + i][j] = r[(i, j)];
            }
        }
        self.used += COEFFICIENTS;
    }

    /// L with P_D = L Lᵀ = S (RᵀR + I)⁻¹ S, S the prior σ.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when a row is not finite.
    pub fn covariance_root(self) -> Result<CovarianceRoot> {
        let all: Vec<usize> = (0..COEFFICIENTS).collect();
        self.solve([&[], &all], &[])?.of_coefficients()
    }
}

impl<T: Real> Rows<T> {
    /// On parameters of these prior σ.
    pub fn on(prior_sigma: &[f64]) -> Self {
        let count = prior_sigma.len();
        Self {
            prior_sigma: prior_sigma.to_vec(),
            stack: vec![vec![T::from(0.0); count]; count + FRESH],
            used: count,
        }
    }

    fn count(&self) -> usize {
        self.prior_sigma.len()
    }

    /// The largest entry in all: how many times better than the prior, σ against σ, some
    /// combination of parameters is told.
    pub fn largest(&mut self) -> f64 {
        self.compress();
        let all = self.stack[..self.used].iter().flatten();
        all.fold(0.0_f64, |max, v| max.max(v.f64().abs()))
    }

    /// The triangle of the first parameters, in units of the prior σ.
    pub fn first_columns(&self, count: usize) -> DMatrix<f64> {
        DMatrix::from_fn(self.used, count, |i, j| self.stack[i][j].f64())
    }

    /// What a filter comes to that estimates the parameters of both `blocks`, from their priors and
    /// all rows, and does not know of those that it has `ignored`, nor of any others.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when a row is not finite.
    pub fn solve(mut self, blocks: [&[usize]; 2], ignored: &[usize]) -> Result<Solved<T>> {
        self.compress();
        self.solution(blocks, ignored)
    }

    /// The same, the rows having been triangularised.
    pub fn solution(&self, blocks: [&[usize]; 2], ignored: &[usize]) -> Result<Solved<T>> {
        let columns: Vec<usize> = [blocks[0], blocks[1], ignored].concat();
        let estimated = blocks[0].len() + blocks[1].len();
        let picked = |row: &Vec<T>| columns.iter().map(|&c| row[c]).collect();
        let mut rows: Vec<Vec<T>> = self.stack[..self.used].iter().map(picked).collect();
        for k in 0..estimated {
            let mut prior = vec![T::from(0.0); columns.len()];
            prior[k] = T::from(1.0);
            rows.push(prior);
        }
        if !rows.iter().flatten().all(|v| v.f64().is_finite()) {
            return Err(not_finite());
        }
        let order = triangularise_pivoted(&mut rows, &[blocks[0].len(), estimated]);
        let inverse = inverse_of_rows(&rows, estimated);
        let sigma = |k: usize| T::from(self.prior_sigma[columns[order[k]]]);
        let root = DMatrix::from_fn(estimated, estimated, |i, j| inverse[(i, j)] * sigma(i));
        let seen = DMatrix::from_fn(estimated, ignored.len(), |i, j| rows[i][estimated + j]);
        let solved = Solved {
            pivots: order[..estimated].iter().map(|&k| columns[k]).collect(),
            bias: -(&root * seen),
            root,
        };
        match solved.is_finite() {
            true => Ok(solved),
            false => Err(not_finite()),
        }
    }

    /// Adds rows of unit noise on the parameters.
    pub fn add_rows(&mut self, rows: &DMatrix<T>) {
        let nothing = T::from(0.0);
        for row in rows.row_iter() {
            if row.iter().all(|v| *v == nothing) {
                continue;
            }
            if self.used + 1 > self.stack.len() {
                self.compress();
            }
            let columns = row.iter().zip(&self.prior_sigma);
            for (value, (of, sigma)) in self.stack[self.used].iter_mut().zip(columns) {
                *value = *of * T::from(*sigma);
            }
            self.used += 1;
        }
    }

    /// Triangularises what has been added.
    pub fn compress(&mut self) {
        let count = self.count();
        let rows = &mut self.stack[..self.used];
        let order = triangularise_pivoted(rows, &[count]);
        let mut sorted = vec![T::from(0.0); count];
        for row in &mut rows[..count] {
            for (from, &to) in order.iter().enumerate() {
                sorted[to] = row[from];
            }
            row.copy_from_slice(&sorted);
        }
        self.used = count;
    }
}

/// R⁻¹ of the first rows and columns of `rows`, which are upper triangular.
fn inverse_of_rows<T: Real>(rows: &[Vec<T>], count: usize) -> DMatrix<T> {
    let mut inverse = DMatrix::zeros(count, count);
    for j in 0..count {
        inverse[(j, j)] = T::from(1.0) / rows[j][j];
        for i in (0..j).rev() {
            let mut sum = T::from(0.0);
            for k in i + 1..=j {
                sum += rows[i][k] * inverse[(k, j)];
            }
            inverse[(i, j)] = -sum / rows[i][i];
        }
    }
    inverse
}

/// What a filter comes to: its own covariance by a root, and what it does not know of.
pub(super) struct Solved<T> {
    /// The parameter that each row belongs to.
    pub pivots: Vec<usize>,
    /// L with N = L Lᵀ, upper triangular in this order, in the parameters' units.
    pub root: DMatrix<T>,
    /// What each ignored parameter does to the estimates at one prior σ of it.
    pub bias: DMatrix<T>,
}

impl<T: Real> Solved<T> {
    fn is_finite(&self) -> bool {
        let all = self.root.iter().chain(self.bias.iter());
        all.copied().all(|v| v.f64().is_finite())
    }

    /// L of the twelve coefficients, which are the last of all.
    pub fn of_coefficients(&self) -> Result<CovarianceRoot> {
        let first = self.pivots.len() - COEFFICIENTS;
        let mut root = CoefficientMatrix::zeros();
        let pivots: [usize; COEFFICIENTS] = std::array::from_fn(|k| self.pivots[first + k]);
        for (k, &coefficient) in pivots.iter().enumerate() {
            for j in 0..COEFFICIENTS {
                root[(coefficient, j)] = self.root[(first + k, first + j)].f64();
            }
        }
        Ok(CovarianceRoot::new(root, pivots))
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

impl<T: Real, C: Dim> InformationSink<OMatrix<T, U3, C>> for Rows<T>
where
    DefaultAllocator: Allocator<U3, C>,
{
    fn add(&mut self, rows: &OMatrix<T, U3, C>) {
        if self.used + 3 > self.stack.len() {
            self.compress();
        }
        let nothing = T::from(0.0);
        for i in 0..3 {
            if rows.row(i).iter().all(|v| *v == nothing) {
                continue;
            }
            let columns = self.prior_sigma.iter().enumerate();
            for (value, (j, sigma)) in self.stack[self.used].iter_mut().zip(columns) {
                *value = rows[(i, j)] * T::from(*sigma);
            }
            self.used += 1;
        }
    }
}
