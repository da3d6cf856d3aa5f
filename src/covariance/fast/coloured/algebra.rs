//! Small dense matrices in the chain's numbers.

use std::marker::PhantomData;

use super::rows::{add_combined_here, dots_here, turn_rows_here};
use crate::covariance::fast::arithmetic::{Arithmetic, Number, Work};

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

/// T P Tᵀ T with the rows `top` and, below them, `kept` on the diagonal: symmetric by construction.
#[inline(always)]
fn pass_covariance_here<N: Number, const S: usize>(
    top: &Matrix<N, 3, S>,
    kept: &[N; S],
    p: &Matrix<N, S, S>,
) -> Matrix<N, S, S> {
    let half = product_here(top, p);
    let mut to = *p;
    for i in 0..3 {
        for j in 0..=i {
            let mut sum = half[i][0] * top[j][0];
            for k in 1..S {
                sum = half[i][k].mul_add(top[j][k], sum);
            }
            to[i][j] = sum;
            to[j][i] = sum;
        }
    }
    for j in 3..S {
        for i in 0..3 {
            let of = half[i][j] * kept[j];
            to[i][j] = of;
            to[j][i] = of;
        }
        for i in 3..=j {
            let of = p[i][j] * (kept[i] * kept[j]);
            to[i][j] = of;
            to[j][i] = of;
        }
    }
    to
}

/// P T for the same T.
#[inline(always)]
pub(crate) fn times_passed<N: Number, const R: usize, const S: usize>(
    p: &Matrix<N, R, S>,
    top: &Matrix<N, 3, S>,
    kept: &[N; S],
) -> Matrix<N, R, S> {
    let mut to = *p;
    for i in 0..R {
        for j in 0..S {
            let mut sum = p[i][0] * top[0][j];
            sum = p[i][1].mul_add(top[1][j], sum);
            sum = p[i][2].mul_add(top[2][j], sum);
            if j >= 3 {
                sum = p[i][j].mul_add(kept[j], sum);
            }
            to[i][j] = sum;
        }
    }
    to
}

/// Tᵀ P T for the same T, P symmetric.
#[inline(always)]
fn pull_covariance_here<N: Number, const S: usize>(
    top: &Matrix<N, 3, S>,
    kept: &[N; S],
    p: &Matrix<N, S, S>,
) -> Matrix<N, S, S> {
    let half = times_passed(p, top, kept);
    let mut to = *p;
    for j in 0..S {
        for i in 0..=j {
            let mut sum = half[0][j] * top[0][i];
            sum = half[1][j].mul_add(top[1][i], sum);
            sum = half[2][j].mul_add(top[2][i], sum);
            if i >= 3 {
                sum = half[i][j].mul_add(kept[i], sum);
            }
            to[i][j] = sum;
            to[j][i] = sum;
        }
    }
    to
}

/// P with its blocks from `first` on turned by `q`, rows and columns.
#[inline(always)]
fn turn_covariance_here<N: Number, const S: usize>(
    q: &Matrix<N, 3, 3>,
    first: usize,
    p: &Matrix<N, S, S>,
) -> Matrix<N, S, S> {
    let mut half = *p;
    for block in (first..S).step_by(3) {
        for i in 0..3 {
            for j in 0..S {
                let sum = p[block + 1][j].mul_add(q[i][1], p[block][j] * q[i][0]);
                half[block + i][j] = p[block + 2][j].mul_add(q[i][2], sum);
            }
        }
    }
    let mut to = half;
    for block in (first..S).step_by(3) {
        for i in 0..S {
            for j in 0..3 {
                let of = &half[i][block..block + 3];
                let sum = of[1].mul_add(q[j][1], of[0] * q[j][0]);
                to[i][block + j] = of[2].mul_add(q[j][2], sum);
            }
        }
    }
    symmetric(&to)
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

apart! {
    /// T P Tᵀ, T with the rows `top` and, below them, `kept` on the diagonal: symmetric by construction.
    pass_covariance, PassCovariance<S>(
        top: &'a Matrix<A::Number, 3, S>, kept: &'a [A::Number; S], p: &'a Matrix<A::Number, S, S>
    ) -> Matrix<A::Number, S, S>, pass_covariance_here
}
apart! {
    /// Tᵀ P T for the same T, P symmetric.
    pull_covariance, PullCovariance<S>(
        top: &'a Matrix<A::Number, 3, S>, kept: &'a [A::Number; S], p: &'a Matrix<A::Number, S, S>
    ) -> Matrix<A::Number, S, S>, pull_covariance_here
}
apart! {
    /// P with its blocks from `first` on turned by `q`, rows and columns.
    turn_covariance, TurnCovariance<S>(
        q: &'a Matrix<A::Number, 3, 3>, first: usize, p: &'a Matrix<A::Number, S, S>
    ) -> Matrix<A::Number, S, S>, turn_covariance_here
}

#[cfg(test)]
mod tests;
