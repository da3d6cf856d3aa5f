//! Singular values and right singular vectors of rows.

use nalgebra::DMatrix;

use crate::error::{Error, Result};

/// Steps after which the iteration has failed; some three for each singular value are usual.
const STEPS: usize = 10_000;

/// The thin singular value decomposition of a matrix, without its left vectors.
pub(super) struct Singular {
    /// Largest first, as many as the matrix has columns, or rows if there are fewer.
    pub values: Vec<f64>,
    transposed: DMatrix<f64>,
}

impl Singular {
    /// Of the matrix with `height` rows and `width` columns whose entry (i, j) is `entry(i, j)`.
    ///
    /// By nalgebra, in plain arithmetic: faer's uses the widest vectors that a processor has, and
    /// the last digits, which documents show, depend on the order of summation.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when an entry is not finite, or it does not converge.
    pub fn of(height: usize, width: usize, entry: impl Fn(usize, usize) -> f64) -> Result<Self> {
        let failed = || {
            Error::numerical("the singular value decomposition of the regressor did not converge")
        };
        let matrix = DMatrix::from_fn(height, width, entry);
        if !matrix.iter().all(|v| v.is_finite()) {
            return Err(failed());
        }
        let svd = matrix
            .try_svd(false, true, f64::EPSILON, STEPS)
            .ok_or_else(failed)?;
        Ok(Self {
            values: svd.singular_values.iter().copied().collect(),
            transposed: svd.v_t.ok_or_else(failed)?,
        })
    }

    /// Component `j` of right singular vector `k`.
    pub fn vector(&self, k: usize, j: usize) -> f64 {
        self.transposed[(k, j)]
    }
}
