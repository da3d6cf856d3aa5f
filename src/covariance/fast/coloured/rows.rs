//! Rows over the parameters: slices of quads, padded with columns of zeros, row after row. All that is done
//! to them runs along quads, in registers. No sum runs along a register but in one fixed order, so that a
//! lane has the bits of its schedule alone.

use super::algebra::Matrix;
use crate::covariance::fast::arithmetic::Row;

/// `to` + m v, row by row of `width` quads: R×K · K rows.
#[inline(always)]
pub(super) fn add_combined_here<Q: Row, const R: usize, const K: usize>(
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
pub(super) fn turn_rows_here<Q: Row, const R: usize>(
    a: &Matrix<Q::Number, R, R>,
    v: &mut [Q],
    width: usize,
) {
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

/// v ← T v, T with the rows `top` and, below them, `kept` on the diagonal.
#[inline(always)]
pub(crate) fn pass_rows<Q: Row, const S: usize>(
    top: &Matrix<Q::Number, 3, S>,
    kept: &[Q::Number; S],
    v: &mut [Q],
    width: usize,
) {
    let v = &mut v[..S * width];
    for q in 0..width {
        let mut sums = [v[q]; 3];
        for i in 0..3 {
            let mut sum = v[q].times(top[i][0]);
            for k in 1..S {
                sum = v[k * width + q].times_add(top[i][k], sum);
            }
            sums[i] = sum;
        }
        for j in 3..S {
            v[j * width + q] = v[j * width + q].times(kept[j]);
        }
        for i in 0..3 {
            v[i * width + q] = sums[i];
        }
    }
}

/// v ← Tᵀ v for the same T.
#[inline(always)]
pub(crate) fn pull_rows<Q: Row, const S: usize>(
    top: &Matrix<Q::Number, 3, S>,
    kept: &[Q::Number; S],
    v: &mut [Q],
    width: usize,
) {
    let v = &mut v[..S * width];
    for q in 0..width {
        let of = [v[q], v[width + q], v[2 * width + q]];
        for j in 0..S {
            let mut sum = of[0].times(top[0][j]);
            sum = of[1].times_add(top[1][j], sum);
            sum = of[2].times_add(top[2][j], sum);
            if j >= 3 {
                sum = v[j * width + q].times_add(kept[j], sum);
            }
            v[j * width + q] = sum;
        }
    }
}

/// v with every block of three rows from `first` on turned by `q`.
#[inline(always)]
pub(crate) fn turn_blocks<Q: Row, const S: usize>(
    q: &Matrix<Q::Number, 3, 3>,
    first: usize,
    v: &mut [Q],
    width: usize,
) {
    for block in (first..S).step_by(3) {
        let rows = &mut v[block * width..(block + 3) * width];
        for at in 0..width {
            let of = [rows[at], rows[width + at], rows[2 * width + at]];
            for i in 0..3 {
                let sum = of[1].times_add(q[i][1], of[0].times(q[i][0]));
                rows[i * width + at] = of[2].times_add(q[i][2], sum);
            }
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
pub(super) fn dots_here<Q: Row, const R: usize, const K: usize>(
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
