//! Triangles of rows by Householder reflections, for the [`chain`](super::chain) and its kernels.
//!
//! Large rows come first, and where a triangle is the information itself its columns are pivoted:
//! that makes Householder QR backward stable row by row (Cox & Higham, *Stability of Householder QR
//! factorization for weighted least squares problems*, 1998). So what a weak row tells keeps its
//! digits beside rows that tell 1e16 times more.

use nalgebra::{DMatrix, SMatrix};

use super::real::Real;

/// Squares of less underflow in numbers of 32 digits; nothing of the problem comes near.
const NOTHING: f64 = 1e-140;

/// Puts the largest rows first.
fn sort<T: Real, R: AsRef<[T]>>(rows: &mut [R]) {
    let size = |row: &R| {
        let sizes = row.as_ref().iter().map(|v| v.f64().abs());
        sizes.fold(0.0_f64, f64::max)
    };
    rows.sort_by(|a, b| size(b).total_cmp(&size(a)));
}

/// Turns `rows` so that all but the first are zero in column `at`; those before it are zero
/// already.
fn reflect<T: Real, R: AsMut<[T]>>(rows: &mut [R], at: usize, scratch: &mut Scratch<T>) {
    let zero = T::from(0.0);
    let Scratch { reflector, dots } = scratch;
    reflector.clear();
    reflector.extend(rows.iter_mut().map(|row| row.as_mut()[at]));
    if reflector[1..].iter().all(|v| v.f64().abs() < NOTHING) {
        rows[1..].iter_mut().for_each(|row| row.as_mut()[at] = zero);
        return;
    }
    let squares = reflector.iter().fold(zero, |sum, v| sum + *v * *v);
    let norm = squares.sqrt();
    let head = reflector[0];
    // Away from what is there, so that nothing cancels.
    let diagonal = if head > zero { -norm } else { norm };
    reflector[0] -= diagonal;
    let half_square = squares - head * diagonal;
    dots.clear();
    dots.resize(rows[0].as_mut().len() - at - 1, zero);
    for (row, v) in rows.iter_mut().zip(&*reflector) {
        for (dot, value) in dots.iter_mut().zip(&row.as_mut()[at + 1..]) {
            *dot += *value * *v;
        }
    }
    dots.iter_mut().for_each(|dot| *dot /= half_square);
    for (row, v) in rows.iter_mut().zip(&*reflector) {
        let row = row.as_mut();
        row[at] = zero;
        for (value, share) in row[at + 1..].iter_mut().zip(&*dots) {
            *value -= *v * *share;
        }
    }
    rows[0].as_mut()[at] = diagonal;
}

/// Memory of a reflection.
struct Scratch<T> {
    reflector: Vec<T>,
    dots: Vec<T>,
}

impl<T> Scratch<T> {
    fn new() -> Self {
        Self {
            reflector: Vec::new(),
            dots: Vec::new(),
        }
    }
}

/// Makes the first `width` columns of `rows` upper triangular.
fn triangularise<T: Real, R: AsRef<[T]> + AsMut<[T]>>(rows: &mut [R], width: usize) {
    sort(rows);
    let mut scratch = Scratch::new();
    for j in 0..width.min(rows.len()) {
        reflect(&mut rows[j..], j, &mut scratch);
    }
}

/// The same with the columns pivoted within each block; the columns of a block end where `ends`
/// says, and those after the last block are carried along. Gives which column each came from.
pub(super) fn triangularise_pivoted<T: Real, R: AsRef<[T]> + AsMut<[T]>>(
    rows: &mut [R],
    ends: &[usize],
) -> Vec<usize> {
    sort(rows);
    let columns = rows.first().map_or(0, |row| row.as_ref().len());
    let mut order: Vec<usize> = (0..columns).collect();
    let mut scratch = Scratch::new();
    let mut j = 0;
    for &end in ends {
        while j < end.min(rows.len()) {
            let pivot = largest_column(&rows[j..], j..end);
            if pivot != j {
                order.swap(j, pivot);
                rows.iter_mut().for_each(|row| row.as_mut().swap(j, pivot));
            }
            reflect(&mut rows[j..], j, &mut scratch);
            j += 1;
        }
    }
    order
}

/// The longest of some columns; of equals the first.
fn largest_column<T: Real, R: AsRef<[T]>>(rows: &[R], columns: std::ops::Range<usize>) -> usize {
    let first = columns.start;
    let mut squares = vec![T::from(0.0); columns.len()];
    for row in rows {
        for (square, value) in squares.iter_mut().zip(&row.as_ref()[columns.clone()]) {
            *square += *value * *value;
        }
    }
    let mut largest = 0;
    for (k, square) in squares.iter().enumerate() {
        if *square > squares[largest] {
            largest = k;
        }
    }
    first + largest
}

/// R with RᵀR = Σ AᵀA over the matrices `stacked`.
pub(super) fn triangle<T: Real, const M: usize, const N: usize>(
    stacked: &[&SMatrix<T, M, N>],
) -> SMatrix<T, N, N> {
    triangle_of(stacked.iter().flat_map(|m| rows_of(m)))
}

/// R with RᵀR = I + AᵀA.
pub(super) fn one_and<T: Real, const M: usize, const N: usize>(
    a: &SMatrix<T, M, N>,
) -> SMatrix<T, N, N> {
    triangle_of(rows_of(a).chain(rows_of(&SMatrix::<T, N, N>::identity())))
}

/// A root of A Aᵀ + B Bᵀ.
pub(super) fn add_roots<T: Real, const N: usize>(
    a: &SMatrix<T, N, N>,
    b: &SMatrix<T, N, N>,
) -> SMatrix<T, N, N> {
    triangle(&[&a.transpose(), &b.transpose()]).transpose()
}

fn rows_of<T: Real, const M: usize, const N: usize>(
    m: &SMatrix<T, M, N>,
) -> impl Iterator<Item = [T; N]> + '_ {
    (0..M).map(|i| std::array::from_fn(|j| m[(i, j)]))
}

fn triangle_of<T: Real, const N: usize>(rows: impl Iterator<Item = [T; N]>) -> SMatrix<T, N, N> {
    let mut rows: Vec<[T; N]> = rows.collect();
    triangularise(&mut rows, N);
    SMatrix::from_fn(|i, j| rows[i][j])
}

/// R⁻¹ of an upper triangular R.
pub(super) fn inverse<T: Real, const N: usize>(r: &SMatrix<T, N, N>) -> SMatrix<T, N, N> {
    let mut inverse = SMatrix::<T, N, N>::identity();
    for j in 0..N {
        for i in (0..=j).rev() {
            let mut value = inverse[(i, j)];
            for k in i + 1..=j {
                value -= r[(i, k)] * inverse[(k, j)];
            }
            inverse[(i, j)] = value / r[(i, i)];
        }
    }
    inverse
}

/// R with RᵀR = AᵀA + BᵀB, of as many rows as columns.
pub(super) fn stacked<T: Real>(a: &DMatrix<T>, b: &DMatrix<T>) -> DMatrix<T> {
    dynamic_triangle([a, b].into_iter().flat_map(dynamic_rows), a.ncols())
}

/// R with RᵀR = I + AᵀA.
pub(super) fn one_and_rows<T: Real>(a: &DMatrix<T>) -> DMatrix<T> {
    stacked(a, &DMatrix::identity(a.ncols(), a.ncols()))
}

/// A root of A Aᵀ + B Bᵀ.
pub(super) fn root_of_sum<T: Real>(a: &DMatrix<T>, b: &DMatrix<T>) -> DMatrix<T> {
    stacked(&a.transpose(), &b.transpose()).transpose()
}

fn dynamic_rows<T: Real>(m: &DMatrix<T>) -> impl Iterator<Item = Vec<T>> + '_ {
    m.row_iter().map(|row| row.iter().copied().collect())
}

fn dynamic_triangle<T: Real>(rows: impl Iterator<Item = Vec<T>>, columns: usize) -> DMatrix<T> {
    let mut rows: Vec<Vec<T>> = rows.collect();
    rows.resize(rows.len().max(columns), vec![T::from(0.0); columns]);
    triangularise(&mut rows, columns);
    DMatrix::from_fn(columns, columns, |i, j| rows[i][j])
}

/// R⁻¹ of an upper triangular R.
pub(super) fn inverse_of<T: Real>(r: &DMatrix<T>) -> DMatrix<T> {
    let count = r.ncols();
    let mut inverse = DMatrix::identity(count, count);
    for j in 0..count {
        for i in (0..=j).rev() {
            let mut value = inverse[(i, j)];
            for k in i + 1..=j {
                value -= r[(i, k)] * inverse[(k, j)];
            }
            inverse[(i, j)] = value / r[(i, i)];
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::covariance::real::Extended;
    use nalgebra::Matrix3;

    fn sample(seed: f64) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| {
            ((1.7 * (i * i) as f64 + 2.9 * (i * j + j) as f64 + seed) * 3.1).sin()
        })
    }

    fn extended(m: &Matrix3<f64>) -> Matrix3<Extended> {
        m.map(Extended::from)
    }

    #[test]
    fn triangles_have_the_squares_of_their_rows() {
        let (a, b) = (sample(0.3), sample(1.9) * 40.0);
        let squares = a.transpose() * a + b.transpose() * b;
        let r = triangle(&[&a, &b]);
        assert!((r.transpose() * r - squares).amax() < 1e-12);
        assert!(r[(1, 0)] == 0.0 && r[(2, 0)] == 0.0 && r[(2, 1)] == 0.0);
        let r = one_and(&b);
        let squares = b.transpose() * b + Matrix3::identity();
        assert!((r.transpose() * r - squares).amax() < 1e-12);
        assert!((inverse(&r) * r - Matrix3::identity()).amax() < 1e-13);
        let root = add_roots(&a, &b);
        let sum = a * a.transpose() + b * b.transpose();
        assert!((root * root.transpose() - sum).amax() < 1e-12);
    }

    #[test]
    fn of_any_size_too() {
        let (a, b) = (sample(0.3), sample(1.9) * 40.0);
        let dynamic = |m: &Matrix3<f64>| DMatrix::from_fn(3, 3, |i, j| m[(i, j)]);
        let fixed = |m: &DMatrix<f64>| Matrix3::from_fn(|i, j| m[(i, j)]);
        let (da, db) = (dynamic(&a), dynamic(&b));
        assert_eq!(fixed(&stacked(&da, &db)), triangle(&[&a, &b]));
        assert_eq!(fixed(&one_and_rows(&db)), one_and(&b));
        assert_eq!(fixed(&root_of_sum(&da, &db)), add_roots(&a, &b));
        let r = one_and(&b);
        assert_eq!(fixed(&inverse_of(&dynamic(&r))), inverse(&r));
        // Fewer rows than columns.
        let wide = DMatrix::from_row_slice(1, 3, &[1.0, 2.0, 3.0]);
        let r = stacked(&wide, &DMatrix::zeros(0, 3));
        assert!((r.transpose() * &r - wide.transpose() * &wide).amax() < 1e-14);
    }

    #[test]
    fn in_32_digits_too() {
        let (a, b) = (extended(&sample(0.3)), extended(&(sample(1.9) * 1e9)));
        let r = triangle(&[&a, &b]);
        let difference = r.transpose() * r - (a.transpose() * a + b.transpose() * b);
        assert!(difference.iter().all(|v| v.0.abs() < 1e-11));
        let left = inverse(&r) * r - Matrix3::identity();
        assert!(left.iter().all(|v| v.0.abs() < 1e-20));
    }

    #[test]
    fn pivots_stay_in_their_block() {
        let mut rows: Vec<Vec<f64>> = (0..7)
            .map(|i| {
                (0..5)
                    .map(|j| f64::from(3 * i * i + 5 * i * j + j).sin() * f64::from(1 << j))
                    .collect()
            })
            .collect();
        let before = rows.clone();
        let order = triangularise_pivoted(&mut rows, &[2, 4]);
        assert_eq!(order[4], 4);
        assert!(order[..2].iter().all(|&k| k < 2));
        // The squares are those of before, in the order of the pivots.
        for j in 0..5 {
            for k in 0..5 {
                let now: f64 = rows.iter().map(|r| r[j] * r[k]).sum();
                let then: f64 = before.iter().map(|r| r[order[j]] * r[order[k]]).sum();
                assert!((now - then).abs() < 1e-11);
            }
        }
        assert!(
            rows.iter()
                .enumerate()
                .all(|(i, r)| (0..4.min(i)).all(|j| r[j] == 0.0))
        );
    }
}
