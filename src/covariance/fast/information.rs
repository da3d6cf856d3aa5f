//! The information E on D, gyro by gyro, and the covariance it leaves.
//!
//! Row 4 j + e of E is factor e of gyro j; it is kept as rows of three quads, of which those from
//! gyro j on are used: one triangle.

use super::arithmetic::{Arithmetic, Number, Row, four, three};
use super::shape::Drift;
use super::square::{Entries, Square, entries, transposed_product};
use super::{Collected, Collecting, Place, Wide};
use crate::covariance::CovarianceRoot;
use crate::drift::{
    COEFFICIENTS, CoefficientMatrix, CoefficientVector, DriftCoefficient, DriftMatrix,
};

/// Where a coefficient stands among the rows, and the sign with which it counts: its column of A
/// is `sign · h_e C_j`.
const fn place(c: DriftCoefficient) -> (usize, f64) {
    match c.excitation() {
        None => (4 * c.gyro(), 1.0),
        Some((axis, sign)) => (4 * c.gyro() + 1 + axis, sign),
    }
}

/// [`place`] of every coefficient.
pub(crate) const PLACES: [(usize, f64); COEFFICIENTS] = {
    let mut places = [(0, 0.0); COEFFICIENTS];
    let mut i = 0;
    while i < COEFFICIENTS {
        places[i] = place(DriftCoefficient::ALL[i]);
        i += 1;
    }
    places
};

/// A symmetric matrix over the coefficients, gyro by gyro.
pub(crate) type Rows<Q> = [[Q; 3]; COEFFICIENTS];

/// E, see the module text.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Information<A: Arithmetic>(Rows<A::Quad>);

/// Numbers in every lane.
#[inline(always)]
pub(crate) fn known_rows<A: Arithmetic>(ar: A, of: &Rows<[f64; 4]>) -> Rows<A::Quad> {
    let mut rows = [[ar.quad([ar.number(0.0); 4]); 3]; COEFFICIENTS];
    for i in 0..COEFFICIENTS {
        for k in 0..3 {
            rows[i][k] = ar.quad(four!(|f| ar.number(of[i][k][f])));
        }
    }
    rows
}

impl<A: Arithmetic> Information<A> {
    /// Nothing known.
    #[inline(always)]
    pub fn zeros(ar: A) -> Self {
        Self([[ar.quad([ar.number(0.0); 4]); 3]; COEFFICIENTS])
    }

    /// The same numbers in every lane.
    #[inline(always)]
    pub fn known(ar: A, e: &Rows<[f64; 4]>) -> Self {
        Self(known_rows(ar, e))
    }

    /// E += XᵀX.
    #[inline(always)]
    pub fn add_squares(&mut self, x: &Wide<A::Quad>) {
        three!(|j| four!(|e| three!(|k| if k >= j {
            let first = if k == j { e } else { 0 };
            let sum = self.0[4 * j + e][k];
            let sum = x[0][k].times_add_from(x[0][j].get(e), sum, first);
            let sum = x[1][k].times_add_from(x[1][j].get(e), sum, first);
            self.0[4 * j + e][k] = x[2][k].times_add_from(x[2][j].get(e), sum, first);
        })));
    }

    /// E += XᵀX + n ⊗ hᵀh, n symmetric.
    #[inline(always)]
    pub fn add_dwell(&mut self, x: &Wide<A::Quad>, n: &Entries<A::Number>, h: A::Quad) {
        // Indices written out: as loops over memory this would cost several times the arithmetic.
        three!(|j| four!(|e| {
            let hh = h.times(h.get(e));
            three!(|k| if k >= j {
                let first = if k == j { e } else { 0 };
                let sum = self.0[4 * j + e][k];
                let sum = hh.times_add_from(n[j][k], sum, first);
                let sum = x[0][k].times_add_from(x[0][j].get(e), sum, first);
                let sum = x[1][k].times_add_from(x[1][j].get(e), sum, first);
                self.0[4 * j + e][k] = x[2][k].times_add_from(x[2][j].get(e), sum, first);
            })
        }));
    }

    /// E += Σ_r w_r x_rᵀ x_r.
    #[inline(always)]
    pub fn add_rows(&mut self, x: &[[A::Quad; 3]; 2], w: [A::Number; 2]) {
        three!(|j| {
            let weighted = [x[0][j].times(w[0]), x[1][j].times(w[1])];
            four!(|e| three!(|k| if k >= j {
                let first = if k == j { e } else { 0 };
                let sum = self.0[4 * j + e][k];
                let sum = x[0][k].times_add_from(weighted[0].get(e), sum, first);
                self.0[4 * j + e][k] = x[1][k].times_add_from(weighted[1].get(e), sum, first);
            }))
        });
    }

    /// S⁻¹ with S = I + s E s, as the rows of L⁻¹ scaled by s and the pivots' inverses D⁻¹ (S =
    /// L D Lᵀ): P_D = Σ_k d_k w_kᵀ w_k. `sigma` are the prior σ.
    #[inline(always)]
    pub fn factor(&self, ar: A, sigma: &PriorScale) -> Factor<A> {
        let one = ar.number(1.0);
        let zero = ar.number(0.0);
        let scale = sigma.0;
        let scales = three!(|k| ar.quad(four!(|e| ar.number(scale[4 * k + e]))));
        let mut s = self.0;
        let mut w = [[ar.quad([zero; 4]); 3]; COEFFICIENTS];
        for i in 0..COEFFICIENTS {
            let (j, e) = (i / 4, i % 4);
            for k in j..3 {
                s[i][k] = s[i][k].by(scales[k]).times(ar.number(scale[i]));
            }
            let unit = ar.quad(four!(|k| if k == e { one } else { zero }));
            s[i][j] = s[i][j].plus(unit);
            w[i][j] = unit;
        }
        let mut d = [one; COEFFICIENTS];
        let diagonal: [A::Number; COEFFICIENTS] = std::array::from_fn(|k| s[k][k / 4].get(k % 4));
        let (mut least, mut cancelled) = (one, one);
        for k in 0..COEFFICIENTS {
            let pivot = s[k][k / 4].get(k % 4);
            least = pivot.where_greater(least, pivot, least);
            d[k] = one / pivot;
            let ratio = diagonal[k] * d[k];
            // A ratio that is not a number is taken for the larger one.
            cancelled = cancelled.where_greater(cancelled, ratio, ratio);
            let (s_k, w_k) = (s[k], w[k]);
            for i in k + 1..COEFFICIENTS {
                let factor = -(s_k[i / 4].get(i % 4) * d[k]);
                for q in i / 4..3 {
                    let first = if q == i / 4 { i % 4 } else { 0 };
                    s[i][q] = s_k[q].times_add_from(factor, s[i][q], first);
                }
                for q in 0..=k / 4 {
                    w[i][q] = w_k[q].times_add(factor, w[i][q]);
                }
            }
        }
        for row in &mut w {
            for k in 0..3 {
                row[k] = row[k].by(scales[k]);
            }
        }
        Factor {
            w,
            d,
            least,
            cancelled,
        }
    }
}

impl Collecting for Drift {
    type Information<A: Arithmetic> = Information<A>;
}

impl<A: Arithmetic> Collected<A, Drift> for Information<A> {
    #[inline(always)]
    fn nothing(ar: A) -> Self {
        Self::zeros(ar)
    }
    #[inline(always)]
    fn of_dwell(
        &mut self,
        x: &Wide<A::Quad>,
        q_c: &[Square<A::Triple>; 1],
        at: &Place<A>,
        _: A::Number,
    ) {
        let [q_c] = q_c;
        let n_gram = entries(&transposed_product(&entries(q_c), q_c));
        self.add_dwell(x, &n_gram, at.h[0]);
    }
    #[inline(always)]
    fn of_rows(&mut self, x: &[[A::Quad; 3]; 2], w: [A::Number; 2]) {
        self.add_rows(x, w);
    }
    #[inline(always)]
    fn of_vertical(&mut self, _: &Place<A>, _: A::Number) {}
}

/// P_D in factors.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Factor<A: Arithmetic> {
    w: Rows<A::Quad>,
    d: [A::Number; COEFFICIENTS],
    /// The smallest pivot: at least 1, but for rounding.
    pub least: A::Number,
    /// The largest ratio of a diagonal entry to the pivot that elimination leaves of it.
    pub cancelled: A::Number,
}

/// Whether P_D by factors with that smallest pivot and that largest ratio has the digits that a
/// search needs. What a combination of coefficients is known by may cancel in E to its sixteenth
/// digit; at this ratio, eight are left.
pub(crate) fn keeps_digits(least: f64, cancelled: f64) -> bool {
    const MOST: f64 = 1e8;
    least > 0.0 && cancelled < MOST
}

impl<A: Arithmetic> Factor<A> {
    /// L with P_D = L Lᵀ: the rows of L⁻¹ are its columns. `value` takes the number wanted.
    pub fn root(&self, value: impl Fn(A::Number) -> f64) -> CovarianceRoot {
        let mut root = CoefficientMatrix::zeros();
        let mut pivots = [0; COEFFICIENTS];
        for (c, &(at, sign)) in PLACES.iter().enumerate() {
            pivots[at] = c;
            for k in at..COEFFICIENTS {
                let entry = value(self.w[k][at / 4].get(at % 4));
                root[(c, k)] = sign * entry * value(self.d[k]).sqrt();
            }
        }
        CovarianceRoot::new(root, pivots)
    }

    /// The diagonal of P_D, (°/h)², gyro by gyro, in the operations of [`Factor::covariance`].
    #[inline(always)]
    pub fn variances(&self, zero: A::Number) -> [A::Number; COEFFICIENTS] {
        let mut p = [zero; COEFFICIENTS];
        for (k, (row, d)) in self.w.iter().zip(&self.d).enumerate() {
            for (i, p) in p.iter_mut().enumerate().take(k + 1) {
                let entry = row[i / 4].get(i % 4);
                *p = entry.mul_add(entry * *d, *p);
            }
        }
        p
    }

    /// P_D, (°/h)², of one schedule in the order of the coefficients, in the operations of
    /// [`Factor::covariance`]. `value` takes the number wanted.
    pub fn matrix(&self, value: impl Fn(A::Number) -> f64) -> CoefficientMatrix {
        let mut p = [[0.0; COEFFICIENTS]; COEFFICIENTS];
        for (k, (row, d)) in self.w.iter().zip(&self.d).enumerate() {
            let d = value(*d);
            let row: [f64; COEFFICIENTS] = std::array::from_fn(|i| value(row[i / 4].get(i % 4)));
            for i in 0..=k {
                let factor = row[i] * d;
                for j in i..=k {
                    p[i][j] += row[j] * factor;
                }
            }
        }
        in_order(|i, j| p[i][j])
    }

    /// P_D, (°/h)², one triangle as in [`Information`].
    #[inline(always)]
    pub fn covariance(&self, ar: A) -> Rows<A::Quad> {
        let mut p = [[ar.quad([ar.number(0.0); 4]); 3]; COEFFICIENTS];
        for (k, (row, d)) in self.w.iter().zip(&self.d).enumerate() {
            for j in 0..=k / 4 {
                let weighted = row[j].times(*d);
                for e in 0..4 {
                    // Entries of a row of L⁻¹ end at the diagonal.
                    if 4 * j + e > k {
                        continue;
                    }
                    let factor = weighted.get(e);
                    for q in j..=k / 4 {
                        let first = if q == j { e } else { 0 };
                        p[4 * j + e][q] = row[q].times_add_from(factor, p[4 * j + e][q], first);
                    }
                }
            }
        }
        p
    }
}

/// The prior σ of each coefficient, °/h, gyro by gyro.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PriorScale(pub [f64; COEFFICIENTS]);

impl PriorScale {
    /// From the order of the coefficients.
    #[inline(always)]
    pub fn new(sigma: &CoefficientVector) -> Self {
        let mut scale = [0.0; COEFFICIENTS];
        for (c, (to, _)) in PLACES.iter().enumerate() {
            scale[*to] = sigma[c];
        }
        Self(scale)
    }
}

/// A symmetric matrix in the order of the coefficients, from its upper triangle gyro by gyro.
#[inline(always)]
pub(crate) fn in_order(entry: impl Fn(usize, usize) -> f64) -> CoefficientMatrix {
    let mut out = CoefficientMatrix::zeros();
    for (a, &(i, sign_a)) in PLACES.iter().enumerate() {
        for (b, &(j, sign_b)) in PLACES.iter().enumerate().take(a + 1) {
            let (low, high) = if i < j { (i, j) } else { (j, i) };
            let entry = sign_a * sign_b * entry(low, high);
            out[(a, b)] = entry;
            out[(b, a)] = entry;
        }
    }
    out
}

/// [`in_order`] of rows.
#[inline(always)]
pub(crate) fn to_coefficients<Q: Row<Number = f64>>(rows: &Rows<Q>) -> CoefficientMatrix {
    in_order(|i, j| rows[i][j / 4].get(j % 4))
}

/// A symmetric matrix over the coefficients, gyro by gyro.
pub(crate) fn by_gyros(m: &CoefficientMatrix) -> Rows<[f64; 4]> {
    let mut rows = [[[0.0; 4]; 3]; COEFFICIENTS];
    for (a, &(i, sign_a)) in PLACES.iter().enumerate() {
        for (b, &(k, sign_b)) in PLACES.iter().enumerate() {
            rows[i][k / 4][k % 4] = sign_a * sign_b * m[(a, b)];
        }
    }
    rows
}

/// Three rows over the coefficients, gyro by gyro.
pub(crate) fn rows_by_gyros(m: &DriftMatrix) -> Wide<[f64; 4]> {
    let mut wide = [[[0.0; 4]; 3]; 3];
    for (c, &(at, sign)) in PLACES.iter().enumerate() {
        for i in 0..3 {
            wide[i][at / 4][at % 4] = sign * m[(i, c)];
        }
    }
    wide
}

/// The lower blocks from the upper ones.
#[inline(always)]
fn mirror<A: Arithmetic>(ar: A, rows: &mut Rows<A::Quad>) {
    for j in 1..3 {
        for k in 0..j {
            for e in 0..4 {
                rows[4 * j + e][k] = ar.quad(four!(|f| rows[4 * k + f][j].get(e)));
            }
        }
    }
}

/// −G P for the derivative G of a figure of merit with respect to P, diagonal, in the order of the
/// coefficients. `p` with both triangles.
#[inline(always)]
pub(crate) fn pulled_slope<A: Arithmetic<Number = f64>>(
    ar: A,
    p: &Rows<A::Quad>,
    slope: &CoefficientVector,
) -> Rows<A::Quad> {
    let mut out = [[ar.quad([0.0; 4]); 3]; COEFFICIENTS];
    for (c, &(i, _)) in PLACES.iter().enumerate() {
        if slope[c] != 0.0 {
            out[i] = three!(|q| p[i][q].times(-slope[c]));
        }
    }
    out
}

/// P X for a symmetric result: with X = −G P the adjoint of E. Both triangles in and out.
#[inline(always)]
pub(crate) fn symmetric_product<A: Arithmetic>(
    ar: A,
    p: &Rows<A::Quad>,
    x: &Rows<A::Quad>,
) -> Rows<A::Quad> {
    let mut out = [[ar.quad([ar.number(0.0); 4]); 3]; COEFFICIENTS];
    for i in 0..COEFFICIENTS {
        for j in 0..3 {
            for e in 0..4 {
                let factor = p[i][j].get(e);
                for q in j..3 {
                    out[4 * j + e][q] = x[i][q].times_add(factor, out[4 * j + e][q]);
                }
            }
        }
    }
    mirror(ar, &mut out);
    out
}

/// Both triangles of a matrix from the upper one.
#[inline(always)]
pub(crate) fn complete<A: Arithmetic>(ar: A, p: &mut Rows<A::Quad>) {
    mirror(ar, p);
    for j in 0..3 {
        let block = four!(|e| four!(|f| match e <= f {
            true => p[4 * j + e][j].get(f),
            false => p[4 * j + f][j].get(e),
        }));
        for e in 0..4 {
            p[4 * j + e][j] = ar.quad(block[e]);
        }
    }
}
