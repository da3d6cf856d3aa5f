//! 3×3 matrices: rows of an [`Arithmetic`], and the factorisations of [`super::super::small`]
//! without square roots on the way from pivot to pivot.

use super::arithmetic::{Arithmetic, Number, Row, three};

/// A 3×3 matrix as three rows.
pub(crate) type Square<T> = [T; 3];
/// A 3×3 matrix entry by entry.
pub(crate) type Entries<N> = [[N; 3]; 3];

/// The rows of a matrix given by its entries.
#[inline(always)]
pub(crate) fn rows<A: Arithmetic>(ar: A, m: &Entries<A::Number>) -> Square<A::Triple> {
    [ar.triple(m[0]), ar.triple(m[1]), ar.triple(m[2])]
}

/// The entries of a matrix given by its rows.
#[inline(always)]
pub(crate) fn entries<T: Row>(m: &Square<T>) -> Entries<T::Number> {
    three!(|i| three!(|j| m[i].get(j)))
}

/// The transpose.
#[inline(always)]
pub(crate) fn transpose<N: Copy>(m: &Entries<N>) -> Entries<N> {
    three!(|i| three!(|j| m[j][i]))
}

/// `a b`.
#[inline(always)]
pub(crate) fn product<T: Row>(a: &Entries<T::Number>, b: &Square<T>) -> Square<T> {
    three!(|i| combine(&a[i], b))
}

/// `aᵀ b`.
#[inline(always)]
pub(crate) fn transposed_product<T: Row>(a: &Entries<T::Number>, b: &Square<T>) -> Square<T> {
    product(&transpose(a), b)
}

/// `Σ_k c_k b_k`.
#[inline(always)]
pub(crate) fn combine<T: Row>(c: &[T::Number; 3], b: &Square<T>) -> T {
    b[2].times_add(c[2], b[1].times_add(c[1], b[0].times(c[0])))
}

/// `a − b`, row by row.
#[inline(always)]
pub(crate) fn difference<T: Row>(a: &Square<T>, b: &Square<T>) -> Square<T> {
    three!(|i| a[i].minus(b[i]))
}

/// `a + b`, row by row.
#[inline(always)]
pub(crate) fn sum<T: Row>(a: &Square<T>, b: &Square<T>) -> Square<T> {
    three!(|i| a[i].plus(b[i]))
}

/// Σ a_k b_k.
#[inline(always)]
pub(crate) fn dot<N: Number>(a: &[N; 3], b: &[N; 3]) -> N {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

/// The matrix with `lower`'s lower triangle in both triangles.
#[inline(always)]
pub(crate) fn mirrored<N: Copy>(lower: &Entries<N>) -> Entries<N> {
    [
        [lower[0][0], lower[1][0], lower[2][0]],
        [lower[1][0], lower[1][1], lower[2][1]],
        [lower[2][0], lower[2][1], lower[2][2]],
    ]
}

/// (1/pivot, √pivot), both zero for a pivot of rounding size: it belongs to a direction that is
/// known already.
#[inline(always)]
fn pivot_inverse_and_root<N: Number>(pivot: N, diagonal: N) -> (N, N) {
    let (zero, one) = (pivot.constant(0.0), pivot.constant(1.0));
    let floor = diagonal * pivot.constant(1e-15);
    let open = pivot.where_greater(pivot, floor, one);
    (
        (one / open).where_greater(pivot, floor, zero),
        open.sqrt().where_greater(pivot, floor, zero),
    )
}

/// A lower-triangular G with G Gᵀ = P for a positive-semidefinite P, whose lower triangle is
/// read. A direction without variance gives a zero column.
#[inline(always)]
pub(crate) fn square_root<N: Number>(p: &Entries<N>) -> Entries<N> {
    let zero = p[0][0].constant(0.0);
    let (i0, r0) = pivot_inverse_and_root(p[0][0], p[0][0]);
    let (l10, l20) = (p[1][0] * i0, p[2][0] * i0);
    let (i1, r1) = pivot_inverse_and_root(p[1][1] - l10 * p[1][0], p[1][1]);
    let s21 = p[2][1] - l20 * p[1][0];
    let l21 = s21 * i1;
    let (_, r2) = pivot_inverse_and_root(p[2][2] - l20 * p[2][0] - l21 * s21, p[2][2]);
    [
        [r0, zero, zero],
        [l10 * r0, r1, zero],
        [l20 * r0, l21 * r1, r2],
    ]
}

/// L⁻¹ (unit lower triangular: its entries (1,0), (2,0), (2,1)) and D⁻¹ with L D Lᵀ = I + M, M
/// positive semidefinite, its lower triangle read.
#[inline(always)]
pub(crate) fn whitener<N: Number>(m: &Entries<N>) -> ([N; 3], [N; 3]) {
    let one = m[0][0].constant(1.0);
    let i0 = one / (m[0][0] + one);
    let (l10, l20) = (m[1][0] * i0, m[2][0] * i0);
    let i1 = one / (m[1][1] + one - l10 * m[1][0]);
    let s21 = m[2][1] - l20 * m[1][0];
    let l21 = s21 * i1;
    let i2 = one / (m[2][2] + one - l20 * m[2][0] - l21 * s21);
    ([-l10, l21 * l10 - l20, -l21], [i0, i1, i2])
}

/// The lower triangle of B Bᵀ.
#[inline(always)]
pub(crate) fn gram_of_rows<N: Number>(b: &Entries<N>) -> Entries<N> {
    let zero = b[0][0].constant(0.0);
    [
        [dot(&b[0], &b[0]), zero, zero],
        [dot(&b[1], &b[0]), dot(&b[1], &b[1]), zero],
        [dot(&b[2], &b[0]), dot(&b[2], &b[1]), dot(&b[2], &b[2])],
    ]
}

/// (P⁻¹ + J)⁻¹ for P = G Gᵀ, as G (I + M)⁻¹ Gᵀ with M = Gᵀ J G: nothing cancels, and P may be
/// singular. G lower triangular; M's lower triangle is read.
#[inline(always)]
pub(crate) fn condition<N: Number>(g: &Entries<N>, m: &Entries<N>) -> Entries<N> {
    let ([w10, w20, w21], d) = whitener(m);
    // Y = L⁻¹ Gᵀ.
    let y = [
        [g[0][0], g[1][0], g[2][0]],
        [
            w10 * g[0][0],
            w10.mul_add(g[1][0], g[1][1]),
            w10.mul_add(g[2][0], g[2][1]),
        ],
        [
            w20 * g[0][0],
            w20.mul_add(g[1][0], w21 * g[1][1]),
            w20.mul_add(g[2][0], w21.mul_add(g[2][1], g[2][2])),
        ],
    ];
    let scaled = three!(|k| three!(|i| y[k][i] * d[k]));
    let (y, scaled) = (transpose(&y), transpose(&scaled));
    mirrored(&[
        [dot(&scaled[0], &y[0]), d[0], d[0]],
        [dot(&scaled[1], &y[0]), dot(&scaled[1], &y[1]), d[0]],
        [
            dot(&scaled[2], &y[0]),
            dot(&scaled[2], &y[1]),
            dot(&scaled[2], &y[2]),
        ],
    ])
}
