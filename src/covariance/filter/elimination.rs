//! Rows of information and their triangles, by faer's Householder QR.

use faer::linalg::householder;
use faer::linalg::qr::{col_pivoting, no_pivoting};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Conj, Mat, Par, dyn_stack};

use crate::covariance::real::Real;

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
    pub(super) fn run(&mut self, rows: &mut [Vec<T>]) {
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
        if rest.ncols() > 0 {
            householder::apply_block_householder_sequence_transpose_on_the_left_in_place_with_conj(
                eliminated.rb(),
                self.factors.as_ref(),
                Conj::No,
                rest.rb_mut(),
                Par::Seq,
                dyn_stack::MemStack::new(&mut self.scratch),
            );
        }
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

/// Rows of unit noise on D/s, one for each parameter, the priors among them.
pub(super) struct DriftInformation<T: Real> {
    /// Upper triangular in the order of the pivots.
    triangle: Vec<Vec<T>>,
    /// Which parameter each column is.
    order: Vec<usize>,
    inverse: Vec<usize>,
    rows: Vec<Vec<T>>,
    matrix: Mat<T>,
    factors: Mat<T>,
    scratch: dyn_stack::MemBuffer,
}

/// What is told of some parameters by a filter that does not know of others.
pub(super) struct Told<T> {
    /// The parameter that each row belongs to.
    pub pivots: Vec<usize>,
    /// L with L Lᵀ the covariance that the filter claims, upper triangular, in units of s.
    pub root: Vec<Vec<T>>,
    /// What each parameter it does not know of does to its estimates, at one s of it.
    pub bias: Vec<Vec<T>>,
}

impl<T: Real> DriftInformation<T> {
    /// Of parameters of which the first `estimated` have priors; up to `most` rows are added at a
    /// time.
    pub(super) fn new(count: usize, estimated: usize, most: usize) -> Self {
        let rows = count + most;
        let mut triangle = vec![vec![T::from(0.0); count]; count];
        for (i, row) in triangle.iter_mut().enumerate().take(estimated) {
            row[i] = T::from(1.0);
        }
        Self {
            triangle,
            order: (0..count).collect(),
            inverse: vec![0; count],
            rows: vec![vec![T::from(0.0); count]; rows],
            matrix: Mat::zeros(rows, count),
            factors: Mat::zeros(BLOCK, count),
            scratch: dyn_stack::MemBuffer::new(
                col_pivoting::factor::qr_in_place_scratch::<usize, T>(
                    rows,
                    count,
                    BLOCK,
                    Par::Seq,
                    Default::default(),
                ),
            ),
        }
    }

    fn count(&self) -> usize {
        self.order.len()
    }

    /// Adds rows.
    pub(super) fn add<'a>(&mut self, new: impl Iterator<Item = &'a [T]>) {
        let count = self.count();
        let mut rows = std::mem::take(&mut self.rows);
        rows.iter_mut().for_each(|row| row.fill(T::from(0.0)));
        self.unpivot_into(&mut rows);
        for (row, new) in rows[count..].iter_mut().zip(new) {
            row.copy_from_slice(new);
        }
        put_sorted(&mut self.matrix, &mut rows, count);
        self.rows = rows;
        let _transpositions = col_pivoting::factor::qr_in_place(
            self.matrix.as_mut(),
            self.factors.as_mut(),
            &mut self.order,
            &mut self.inverse,
            Par::Seq,
            dyn_stack::MemStack::new(&mut self.scratch),
            Default::default(),
        );
        for pivot in 0..count {
            for i in 0..=pivot {
                self.triangle[i][pivot] = self.matrix[(i, pivot)];
            }
        }
    }

    /// The triangle with its columns in the order of the parameters.
    fn unpivot_into(&self, rows: &mut [Vec<T>]) {
        for (i, (row, from)) in rows.iter_mut().zip(&self.triangle).enumerate() {
            for (pivot, &column) in self.order.iter().enumerate().skip(i) {
                row[column] = from[pivot];
            }
        }
    }

    /// What a filter of the `estimated` parameters comes to, in the order of the pivots but for the
    /// `last`, which come last.
    pub(super) fn told(&self, estimated: &[usize], last: &[usize], ignored: &[usize]) -> Told<T> {
        let plain = ignored.is_empty() && last.len() == estimated.len();
        if plain && estimated.len() == self.count() {
            return Told {
                pivots: self.order.clone(),
                root: inverse_of(&self.triangle, self.count()),
                bias: vec![Vec::new(); self.count()],
            };
        }
        let of = |set: &[usize], but: &[usize]| -> Vec<usize> {
            let wanted = |p: &&usize| set.contains(p) && !but.contains(p);
            self.order.iter().filter(wanted).copied().collect()
        };
        let pivots = [of(estimated, last), of(last, &[])].concat();
        let columns = [&pivots[..], ignored].concat();
        let mut unpivoted = vec![vec![T::from(0.0); self.count()]; self.count()];
        self.unpivot_into(&mut unpivoted);
        let picked = |row: &Vec<T>| columns.iter().map(|&c| row[c]).collect();
        let mut rows: Vec<Vec<T>> = unpivoted.iter().map(picked).collect();
        Elimination::new(rows.len(), columns.len(), pivots.len()).run(&mut rows);
        let root = inverse_of(&rows, pivots.len());
        let bias = root.iter().map(|row| {
            let of = |j: usize| {
                let parts = row.iter().zip(&rows);
                parts.fold(T::from(0.0), |sum, (l, r)| sum - *l * r[pivots.len() + j])
            };
            (0..ignored.len()).map(of).collect()
        });
        Told {
            bias: bias.collect(),
            pivots,
            root,
        }
    }
}

/// R⁻¹ of the upper triangle that the first entries of `rows` are.
pub(super) fn inverse_of<T: Real>(rows: &[Vec<T>], count: usize) -> Vec<Vec<T>> {
    let mut inverse = vec![vec![T::from(0.0); count]; count];
    for i in (0..count).rev() {
        let mut row = vec![T::from(0.0); count];
        row[i] = T::from(1.0);
        for (below, factor) in inverse[i + 1..].iter().zip(&rows[i][i + 1..]) {
            for (value, below) in row[i + 1..].iter_mut().zip(&below[i + 1..]) {
                *value -= *factor * *below;
            }
        }
        row.iter_mut().for_each(|value| *value /= rows[i][i]);
        inverse[i] = row;
    }
    inverse
}

/// Copies `rows` into `matrix`, the largest in their first `width` entries first.
fn put_sorted<T: Real>(matrix: &mut Mat<T>, rows: &mut [Vec<T>], width: usize) {
    let size = |row: &Vec<T>| {
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
