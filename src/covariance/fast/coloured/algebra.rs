//! Small dense matrices, and rows over the parameters, in the chain's numbers.
//!
//! A matrix of states is `[[N; C]; R]`. Rows over the parameters are slices of quads, padded with columns
//! of zeros, row after row: all that is done to them runs along quads, in registers. No sum runs along a
//! register but in one fixed order, so that a lane has the bits of its schedule alone.

use std::marker::PhantomData;

use crate::covariance::fast::arithmetic::{Arithmetic, Number, Row, Work};

/// A matrix of states, row by row.
pub(crate) type Matrix<N, const R: usize, const C: usize> = [[N; C]; R];

/// Zeros.
#[inline(always)]
pub(crate) fn zeros<N: Number, const R: usize, const C: usize>(zero: N) -> Matrix<N, R, C> {
    [[zero; C]; R]
}

/// a b.
#[inline(always)]
fn product_here<N: Number, const R: usize, const K: usize, const C: usize>(
    a: &Matrix<N, R, K>,
    b: &Matrix<N, K, C>,
) -> Matrix<N, R, C> {
    let mut to = [[a[0][0]; C]; R];
    for i in 0..R {
        for j in 0..C {
            let mut sum = a[i][0] * b[0][j];
            for k in 1..K {
                sum = a[i][k].mul_add(b[k][j], sum);
            }
            to[i][j] = sum;
        }
    }
    to
}

/// aᵀ b.
#[inline(always)]
fn transposed_product_here<N: Number, const R: usize, const K: usize, const C: usize>(
    a: &Matrix<N, K, R>,
    b: &Matrix<N, K, C>,
) -> Matrix<N, R, C> {
    let mut to = [[a[0][0]; C]; R];
    for i in 0..R {
        for j in 0..C {
            let mut sum = a[0][i] * b[0][j];
            for k in 1..K {
                sum = a[k][i].mul_add(b[k][j], sum);
            }
            to[i][j] = sum;
        }
    }
    to
}

/// a bᵀ.
#[inline(always)]
fn product_transposed_here<N: Number, const R: usize, const K: usize, const C: usize>(
    a: &Matrix<N, R, K>,
    b: &Matrix<N, C, K>,
) -> Matrix<N, R, C> {
    let mut to = [[a[0][0]; C]; R];
    for i in 0..R {
        for j in 0..C {
            let mut sum = a[i][0] * b[j][0];
            for k in 1..K {
                sum = a[i][k].mul_add(b[j][k], sum);
            }
            to[i][j] = sum;
        }
    }
    to
}

/// a aᵀ: symmetric by construction.
#[inline(always)]
pub(crate) fn square<N: Number, const R: usize, const K: usize>(
    a: &Matrix<N, R, K>,
) -> Matrix<N, R, R> {
    let mut to = [[a[0][0]; R]; R];
    for i in 0..R {
        for j in 0..=i {
            let mut sum = a[i][0] * a[j][0];
            for k in 1..K {
                sum = a[i][k].mul_add(a[j][k], sum);
            }
            to[i][j] = sum;
            to[j][i] = sum;
        }
    }
    to
}

/// The transpose.
#[inline(always)]
pub(crate) fn transpose<N: Number, const R: usize, const C: usize>(
    a: &Matrix<N, R, C>,
) -> Matrix<N, C, R> {
    let mut to = [[a[0][0]; R]; C];
    for i in 0..R {
        for j in 0..C {
            to[j][i] = a[i][j];
        }
    }
    to
}

/// a − b.
#[inline(always)]
pub(crate) fn difference<N: Number, const R: usize, const C: usize>(
    a: &Matrix<N, R, C>,
    b: &Matrix<N, R, C>,
) -> Matrix<N, R, C> {
    let mut to = *a;
    for i in 0..R {
        for j in 0..C {
            to[i][j] = a[i][j] - b[i][j];
        }
    }
    to
}

/// (A + Aᵀ)/2.
#[inline(always)]
pub(crate) fn symmetric<N: Number, const R: usize>(a: &Matrix<N, R, R>) -> Matrix<N, R, R> {
    let half = a[0][0].constant(0.5);
    let mut to = *a;
    for i in 0..R {
        for j in 0..i {
            let mean = (a[i][j] + a[j][i]) * half;
            to[i][j] = mean;
            to[j][i] = mean;
        }
    }
    to
}

/// A lower triangle G with G Gᵀ = P for a positive semidefinite P, whose lower triangle is read. A
/// direction without variance gives a column of zeros.
#[inline(always)]
pub(crate) fn square_root<N: Number, const R: usize>(p: &Matrix<N, R, R>) -> Matrix<N, R, R> {
    let (zero, one) = (p[0][0].constant(0.0), p[0][0].constant(1.0));
    let mut g = [[zero; R]; R];
    for k in 0..R {
        let mut pivot = p[k][k];
        for l in 0..k {
            pivot = pivot - g[k][l] * g[k][l];
        }
        // A pivot of rounding size belongs to a direction that is known already.
        let floor = p[k][k] * zero.constant(1e-15);
        let open = pivot.where_greater(pivot, floor, one);
        let root = open.sqrt();
        let inverse = (one / root).where_greater(pivot, floor, zero);
        g[k][k] = root.where_greater(pivot, floor, zero);
        for i in k + 1..R {
            let mut rest = p[i][k];
            for l in 0..k {
                rest = rest - g[i][l] * g[k][l];
            }
            g[i][k] = rest * inverse;
        }
    }
    g
}

/// L⁻¹ with L Lᵀ = I + M, M positive semidefinite, its lower triangle read; lower triangular.
#[inline(always)]
fn whitener_here<N: Number, const R: usize>(m: &Matrix<N, R, R>) -> Matrix<N, R, R> {
    let (zero, one) = (m[0][0].constant(0.0), m[0][0].constant(1.0));
    inverse_of_root(zero, one, m, one)
}

/// L⁻¹ with L Lᵀ = M + `more` I.
#[inline(always)]
fn inverse_of_root<N: Number, const R: usize>(
    zero: N,
    one: N,
    m: &Matrix<N, R, R>,
    more: N,
) -> Matrix<N, R, R> {
    // Of L, with the diagonal as its inverse.
    let mut l = [[zero; R]; R];
    let mut inverse = [[zero; R]; R];
    for i in 0..R {
        for j in 0..=i {
            let mut sum = m[i][j];
            if i == j {
                sum = sum + more;
            }
            for k in 0..j {
                sum = sum - l[i][k] * l[j][k];
            }
            l[i][j] = match i == j {
                true => one / sum.sqrt(),
                false => sum * l[j][j],
            };
        }
    }
    for i in 0..R {
        for j in 0..i {
            let mut sum = -(l[i][j] * inverse[j][j]);
            for k in j + 1..i {
                sum = sum - l[i][k] * inverse[k][j];
            }
            inverse[i][j] = sum * l[i][i];
        }
        inverse[i][i] = l[i][i];
    }
    inverse
}

/// L⁻¹ with L Lᵀ = P for a positive definite P, whose lower triangle is read; lower triangular.
#[inline(always)]
pub(crate) fn inverse_root<N: Number, const R: usize>(p: &Matrix<N, R, R>) -> Matrix<N, R, R> {
    let (zero, one) = (p[0][0].constant(0.0), p[0][0].constant(1.0));
    inverse_of_root(zero, one, p, zero)
}

/// `to` + m v, row by row of `width` quads: R×K · K rows.
#[inline(always)]
fn add_combined_here<Q: Row, const R: usize, const K: usize>(
    to: &mut [Q],
    m: &Matrix<Q::Number, R, K>,
    v: &[Q],
    width: usize,
) {
    let (to, v) = (&mut to[..R * width], &v[..K * width]);
    for q in 0..width {
        for i in 0..R {
            let mut sum = to[i * width + q];
            for k in 0..K {
                sum = v[k * width + q].times_add(m[i][k], sum);
            }
            to[i * width + q] = sum;
        }
    }
}

/// Appends a v + b w to `to`, row by row.
#[inline(always)]
pub(crate) fn append_combined<Q: Row, const R: usize, const K: usize, const L: usize>(
    to: &mut Vec<Q>,
    (a, v): (&Matrix<Q::Number, R, K>, &[Q]),
    (b, w): (&Matrix<Q::Number, R, L>, &[Q]),
    width: usize,
) {
    let (v, w) = (&v[..K * width], &w[..L * width]);
    for i in 0..R {
        for q in 0..width {
            let mut sum = v[q].times(a[i][0]);
            for k in 1..K {
                sum = v[k * width + q].times_add(a[i][k], sum);
            }
            for k in 0..L {
                sum = w[k * width + q].times_add(b[i][k], sum);
            }
            to.push(sum);
        }
    }
}

/// v ← a v in place.
#[inline(always)]
fn turn_rows_here<Q: Row, const R: usize>(a: &Matrix<Q::Number, R, R>, v: &mut [Q], width: usize) {
    let v = &mut v[..R * width];
    for q in 0..width {
        let mut of = [v[q]; R];
        for k in 1..R {
            of[k] = v[k * width + q];
        }
        for i in 0..R {
            let mut sum = of[0].times(a[i][0]);
            for k in 1..R {
                sum = of[k].times_add(a[i][k], sum);
            }
            v[i * width + q] = sum;
        }
    }
}

/// `to` += `factor` `of`.
#[inline(always)]
pub(crate) fn add<Q: Row>(to: &mut [Q], factor: Q::Number, of: &[Q]) {
    for (to, of) in to.iter_mut().zip(of) {
        *to = of.times_add(factor, *to);
    }
}

/// a bᵀ over rows of `width` quads: R rows · K rows.
#[inline(always)]
fn dots_here<Q: Row, const R: usize, const K: usize>(
    a: &[Q],
    b: &[Q],
    width: usize,
) -> Matrix<Q::Number, R, K> {
    let (a, b) = (&a[..R * width], &b[..K * width]);
    let mut sums = [[a[0]; K]; R];
    for i in 0..R {
        for j in 0..K {
            sums[i][j] = a[i * width].by(b[j * width]);
        }
    }
    for q in 1..width {
        for i in 0..R {
            for j in 0..K {
                sums[i][j] = sums[i][j].plus(a[i * width + q].by(b[j * width + q]));
            }
        }
    }
    let mut out = [[a[0].get(0); K]; R];
    for i in 0..R {
        for j in 0..K {
            out[i][j] = sums[i][j].total();
        }
    }
    out
}

/// `to` += Σ_r w_r x_rᵀ x_r over rows of `width` quads: the upper triangle of tiles of four rows and a quad.
/// Row i of `to` is `to[i · width ..]`.
#[inline(always)]
pub(crate) fn add_squares<Q: Row>(to: &mut [Q], rows: &[Q], weights: &[Q::Number], width: usize) {
    let mut at = 0;
    while at + 4 <= weights.len() {
        let block = &rows[at * width..(at + 4) * width];
        let w = &weights[at..at + 4];
        for p in 0..width {
            let left = [
                block[p].times(w[0]),
                block[width + p].times(w[1]),
                block[2 * width + p].times(w[2]),
                block[3 * width + p].times(w[3]),
            ];
            let (mut of, mut from) = ([[w[0]; 4]; 4], 4 * p * width);
            for e in 0..4 {
                for r in 0..4 {
                    of[e][r] = left[r].get(e);
                }
            }
            for f in of {
                let to = &mut to[from + p..from + width];
                let (a, b) = (&block[p..width], &block[width + p..2 * width]);
                let (c, d) = (&block[2 * width + p..3 * width], &block[3 * width + p..]);
                for (q, to) in to.iter_mut().enumerate() {
                    let sum = a[q].times_add(f[0], *to);
                    let sum = b[q].times_add(f[1], sum);
                    let sum = c[q].times_add(f[2], sum);
                    *to = d[q].times_add(f[3], sum);
                }
                from += width;
            }
        }
        at += 4;
    }
    while at < weights.len() {
        let x = &rows[at * width..(at + 1) * width];
        for p in 0..width {
            let left = x[p].times(weights[at]);
            for e in 0..4 {
                let from = (4 * p + e) * width;
                add(&mut to[from + p..from + width], left.get(e), &x[p..]);
            }
        }
        at += 1;
    }
}

/// Rows times a symmetric matrix given in full, its rows of `width` quads.
#[inline(always)]
pub(crate) fn times_symmetric<Q: Row>(rows: &[Q], m: &[Q], width: usize) -> Vec<Q> {
    let mut out = Vec::with_capacity(rows.len());
    for x in rows.chunks_exact(width) {
        let from = out.len();
        for q in 0..width {
            out.push(m[q].times(x[0].get(0)));
        }
        let to = &mut out[from..];
        for p in 0..width {
            let first = 4 * p * width;
            let (a, b) = (
                &m[first..first + width],
                &m[first + width..first + 2 * width],
            );
            let (c, d) = (
                &m[first + 2 * width..first + 3 * width],
                &m[first + 3 * width..first + 4 * width],
            );
            let f = [x[p].get(0), x[p].get(1), x[p].get(2), x[p].get(3)];
            for (q, to) in to.iter_mut().enumerate() {
                // The first is there already.
                let sum = match p {
                    0 => *to,
                    _ => a[q].times_add(f[0], *to),
                };
                let sum = b[q].times_add(f[1], sum);
                let sum = c[q].times_add(f[2], sum);
                *to = d[q].times_add(f[3], sum);
            }
        }
    }
    out
}

/// A function of its own for what is used in many places: all of it in one takes the compiler minutes.
macro_rules! apart {
    (
        $(#[$doc:meta])*
        $name:ident, $work:ident<$($size:ident),*>($($arg:ident: $of:ty),*) -> $out:ty, $here:ident
    ) => {
        struct $work<'a, A: Arithmetic, $(const $size: usize),*> {
            numbers: PhantomData<A>,
            $($arg: $of),*
        }

        impl<'a, A: Arithmetic, $(const $size: usize),*> Work for $work<'a, A, $($size),*> {
            type Output = $out;
            #[inline(always)]
            fn run(self) -> $out {
                $here($(self.$arg),*)
            }
        }

        $(#[$doc])*
        #[inline(always)]
        pub(crate) fn $name<'a, A: Arithmetic, $(const $size: usize),*>(
            ar: A,
            $($arg: $of),*
        ) -> $out {
            ar.always_apart($work {
                numbers: PhantomData::<A>,
                $($arg),*
            })
        }
    };
}

apart! {
    /// a b.
    product, Product<R, K, C>(
        a: &'a Matrix<A::Number, R, K>, b: &'a Matrix<A::Number, K, C>
    ) -> Matrix<A::Number, R, C>, product_here
}
apart! {
    /// aᵀ b.
    transposed_product, TransposedProduct<R, K, C>(
        a: &'a Matrix<A::Number, K, R>, b: &'a Matrix<A::Number, K, C>
    ) -> Matrix<A::Number, R, C>, transposed_product_here
}
apart! {
    /// a bᵀ.
    product_transposed, ProductTransposed<R, K, C>(
        a: &'a Matrix<A::Number, R, K>, b: &'a Matrix<A::Number, C, K>
    ) -> Matrix<A::Number, R, C>, product_transposed_here
}
apart! {
    /// L⁻¹ with L Lᵀ = I + M, M positive semidefinite, its lower triangle read; lower triangular.
    whitener, Whitener<R>(m: &'a Matrix<A::Number, R, R>) -> Matrix<A::Number, R, R>, whitener_here
}
apart! {
    /// `to` + m v, row by row of `width` quads: R×K · K rows.
    add_combined, AddCombined<R, K>(
        to: &'a mut [A::Quad], m: &'a Matrix<A::Number, R, K>, v: &'a [A::Quad], width: usize
    ) -> (), add_combined_here
}
apart! {
    /// v ← a v in place.
    turn_rows, TurnRows<R>(
        a: &'a Matrix<A::Number, R, R>, v: &'a mut [A::Quad], width: usize
    ) -> (), turn_rows_here
}
apart! {
    /// a bᵀ over rows of `width` quads: R rows · K rows.
    dots, Dots<R, K>(
        a: &'a [A::Quad], b: &'a [A::Quad], width: usize
    ) -> Matrix<A::Number, R, K>, dots_here
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, SMatrix};

    use super::*;
    use crate::covariance::fast::arithmetic::{Arithmetic, Plain};

    fn matrix<const R: usize, const C: usize>(seed: f64) -> Matrix<f64, R, C> {
        std::array::from_fn(|i| std::array::from_fn(|j| libm::sin(seed + (C * i + j) as f64 * 1.7)))
    }

    fn dense<const R: usize, const C: usize>(a: &Matrix<f64, R, C>) -> SMatrix<f64, R, C> {
        SMatrix::from_fn(|i, j| a[i][j])
    }

    type Quad = <Plain as Arithmetic>::Quad;

    fn rows(count: usize, width: usize, seed: f64) -> Vec<Quad> {
        let quad = |i: usize| [0, 1, 2, 3].map(|e| libm::cos(seed + (4 * i + e) as f64 * 0.9));
        (0..count * width).map(|i| Plain.quad(quad(i))).collect()
    }

    fn of_rows(rows: &[Quad], width: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows.len() / width, 4 * width, |i, j| {
            rows[i * width + j / 4].get(j % 4)
        })
    }

    #[test]
    fn products_are_those_of_matrices() {
        let (a, b) = (matrix::<6, 9>(0.3), matrix::<9, 4>(0.9));
        let expected = dense(&a) * dense(&b);
        assert!((dense(&product(Plain, &a, &b)) - expected).amax() < 1e-14);
        assert!((dense(&transposed_product(Plain, &transpose(&a), &b)) - expected).amax() < 1e-14);
        assert!((dense(&product_transposed(Plain, &a, &transpose(&b))) - expected).amax() < 1e-14);
        assert!((dense(&square(&a)) - dense(&a) * dense(&a).transpose()).amax() < 1e-14);
    }

    #[test]
    fn roots_and_whiteners() {
        fn check<const R: usize>() {
            let m = square(&matrix::<R, R>(0.7));
            let g = dense(&square_root(&m));
            assert!((g * g.transpose() - dense(&m)).amax() < 1e-12);
            let w = dense(&whitener(Plain, &m));
            let one = SMatrix::<f64, R, R>::identity();
            assert!((w * (dense(&m) + one) * w.transpose() - one).amax() < 1e-12);
            let mut more = m;
            for i in 0..R {
                more[i][i] += 0.1;
            }
            let w = dense(&inverse_root(&more));
            assert!((w * dense(&more) * w.transpose() - one).amax() < 1e-11);
        }
        check::<1>();
        check::<3>();
        check::<9>();
        // Nothing is known of the second direction but that it is zero.
        assert_eq!(
            square_root(&[[4.0, 0.0], [0.0, 0.0]]),
            [[2.0, 0.0], [0.0, 0.0]]
        );
    }

    #[test]
    fn rows_are_combined_summed_and_squared() {
        let width = 3;
        let (v, w) = (rows(3, width, 0.2), rows(6, width, 1.1));
        let (m, n) = (matrix::<3, 3>(0.4), matrix::<3, 6>(0.5));
        let (dense_v, dense_w) = (of_rows(&v, width), of_rows(&w, width));
        let dynamic = |m: &[&[f64]]| DMatrix::from_fn(m.len(), m[0].len(), |i, j| m[i][j]);
        let (dense_m, dense_n) = (
            dynamic(&m.each_ref().map(|r| &r[..])),
            dynamic(&n.each_ref().map(|r| &r[..])),
        );
        let mut out = Vec::new();
        append_combined(&mut out, (&m, &v), (&n, &w), width);
        let expected = &dense_m * &dense_v + &dense_n * &dense_w;
        assert!((of_rows(&out, width) - &expected).amax() < 1e-13);
        let mut turned = v.clone();
        turn_rows(Plain, &m, &mut turned, width);
        add_combined(Plain, &mut turned, &n, &w, width);
        assert!((of_rows(&turned, width) - expected).amax() < 1e-13);
        let found = dots::<_, 3, 6>(Plain, &v, &w, width);
        let expected = &dense_v * dense_w.transpose();
        assert!((dynamic(&found.each_ref().map(|r| &r[..])) - expected).amax() < 1e-13);
        for count in [1, 4, 6] {
            let weights: Vec<f64> = (0..count).map(|r| 0.5 + r as f64).collect();
            let mut e = vec![Plain.quad([0.0; 4]); 4 * width * width];
            add_squares(&mut e, &w[..count * width], &weights, width);
            let x = of_rows(&w[..count * width], width);
            let expected = x.transpose() * DMatrix::from_diagonal(&weights.into()) * &x;
            let found = of_rows(&e, width);
            for i in 0..4 * width {
                for j in i..4 * width {
                    assert!((found[(i, j)] - expected[(i, j)]).abs() < 1e-13);
                }
            }
        }
        let symmetric = rows(4 * width, width, 0.6);
        let found = times_symmetric(&v, &symmetric, width);
        let expected = dense_v * of_rows(&symmetric, width);
        assert!((of_rows(&found, width) - expected).amax() < 1e-13);
    }
}
