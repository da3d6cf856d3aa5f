//! Rows of information and their triangles, by faer's Householder QR.

use faer::linalg::householder;
use faer::linalg::qr::{col_pivoting, no_pivoting};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Conj, Mat, Par, dyn_stack};

use crate::covariance::real::{Dense, Real, identity, inverse_of_triangle, zeros};
use crate::drift::COEFFICIENTS;

/// Block size of the Householder factors: these matrices are small.
const BLOCK: usize = 1;

/// Eliminates the first columns of a few rows, with the memory for it.
pub(super) struct Elimination<T: Real> {
    matrix: Mat<T>,
    factors: Mat<T>,
    scratch: dyn_stack::MemBuffer,
}

impl<T: Real> Elimination<T> {
    /// Of `width` columns of `rows` rows of `columns` entries.
    pub(super) fn new(rows: usize, columns: usize, width: usize) -> Self {
        let factor = no_pivoting::factor::qr_in_place_scratch::<T>(
            rows,
            width,
            BLOCK,
            Par::Seq,
            Default::default(),
        );
        let apply =
            householder::apply_block_householder_sequence_transpose_on_the_left_in_place_scratch::<T>(
                rows,
                BLOCK,
                columns - width,
            );
        Self {
            matrix: Mat::zeros(rows, columns),
            factors: Mat::zeros(BLOCK, width),
            scratch: dyn_stack::MemBuffer::new(factor.or(apply)),
        }
    }

    /// Turns `rows` so that all but the first hold nothing of the columns to eliminate.
    pub(super) fn run<const N: usize>(&mut self, rows: &mut [[T; N]]) {
        let width = self.factors.ncols();
        put_sorted(&mut self.matrix, rows, width);
        let (mut eliminated, mut rest) = self.matrix.as_mut().split_at_col_mut(width);
        let _rank = no_pivoting::factor::qr_in_place(
            eliminated.rb_mut(),
            self.factors.as_mut(),
            Par::Seq,
            dyn_stack::MemStack::new(&mut self.scratch),
            Default::default(),
        );
        householder::apply_block_householder_sequence_transpose_on_the_left_in_place_with_conj(
            eliminated.rb(),
            self.factors.as_ref(),
            Conj::No,
            rest.rb_mut(),
            Par::Seq,
            dyn_stack::MemStack::new(&mut self.scratch),
        );
        for (i, row) in rows.iter_mut().enumerate() {
            for (j, value) in row.iter_mut().enumerate() {
                // Below the diagonal are the Householder vectors.
                *value = match j < width && i > j {
                    true => T::from(0.0),
                    false => self.matrix[(i, j)],
                };
            }
        }
    }
}

/// Twelve rows of unit noise on D/s, the prior among them.
pub(super) struct DriftInformation<T: Real> {
    /// Upper triangular in the order of the pivots.
    triangle: Dense<T, COEFFICIENTS, COEFFICIENTS>,
    /// Which coefficient each column is.
    order: [usize; COEFFICIENTS],
    matrix: Mat<T>,
    factors: Mat<T>,
    scratch: dyn_stack::MemBuffer,
}

impl<T: Real> DriftInformation<T> {
    /// The prior; up to `most` rows are added at a time.
    pub(super) fn new(most: usize) -> Self {
        let rows = COEFFICIENTS + most;
        Self {
            triangle: identity(),
            order: std::array::from_fn(|i| i),
            matrix: Mat::zeros(rows, COEFFICIENTS),
            factors: Mat::zeros(BLOCK, COEFFICIENTS),
            scratch: dyn_stack::MemBuffer::new(
                col_pivoting::factor::qr_in_place_scratch::<usize, T>(
                    rows,
                    COEFFICIENTS,
                    BLOCK,
                    Par::Seq,
                    Default::default(),
                ),
            ),
        }
    }

    /// Adds `M − 12` rows.
    pub(super) fn add<const M: usize>(&mut self, new: &[&[T]]) {
        let mut rows: Dense<T, M, COEFFICIENTS> = zeros();
        for (i, row) in rows.iter_mut().take(COEFFICIENTS).enumerate() {
            for (pivot, &column) in self.order.iter().enumerate().skip(i) {
                row[column] = self.triangle[i][pivot];
            }
        }
        for (row, new) in rows.iter_mut().skip(COEFFICIENTS).zip(new) {
            row.copy_from_slice(new);
        }
        put_sorted(&mut self.matrix, &mut rows, COEFFICIENTS);
        let mut inverse = [0; COEFFICIENTS];
        let _transpositions = col_pivoting::factor::qr_in_place(
            self.matrix.as_mut(),
            self.factors.as_mut(),
            &mut self.order,
            &mut inverse,
            Par::Seq,
            dyn_stack::MemStack::new(&mut self.scratch),
            Default::default(),
        );
        for pivot in 0..COEFFICIENTS {
            for i in 0..=pivot {
                self.triangle[i][pivot] = self.matrix[(i, pivot)];
            }
        }
    }

    /// Which coefficient each pivot is of.
    pub(super) fn order(&self) -> &[usize; COEFFICIENTS] {
        &self.order
    }

    /// L with L Lᵀ the covariance of D/s.
    pub(super) fn covariance_root(&self) -> Dense<T, COEFFICIENTS, COEFFICIENTS> {
        let inverse = inverse_of_triangle(&self.triangle);
        let mut root = zeros();
        for (row, &coefficient) in inverse.iter().zip(&self.order) {
            root[coefficient] = *row;
        }
        root
    }
}

/// Copies `rows` into `matrix`, the largest in their first `width` entries first.
fn put_sorted<T: Real, const N: usize>(matrix: &mut Mat<T>, rows: &mut [[T; N]], width: usize) {
    let size = |row: &[T; N]| {
        let sizes = row[..width].iter().map(|v| v.f64().abs());
        sizes.fold(0.0_f64, f64::max)
    };
    rows.sort_by(|a, b| size(b).total_cmp(&size(a)));
    for (i, row) in rows.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            matrix[(i, j)] = *value;
        }
    }
}
