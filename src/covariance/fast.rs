//! The [`chain`](super::chain) as straight-line code, for searches: value and gradient.
//!
//! The same recursion with everything known of its structure used:
//!
//! - A = C ⊗ (1, g_x, g_y, g_z): ordered gyro by gyro, the columns of one gyro are one column of
//!   C_c^n times the row h = (1, g_x, g_y, g_z) of [`Place`], so X A costs a 3×3 product and nine
//!   scalings. V and E are kept in that order, with the coefficients' signs taken out, and put
//!   back into the order of [`crate::drift`] once at the end.
//! - What a dwell does to V is linear with 3×3 matrices that do not depend on V,
//!
//!   ```text
//!   X = Y V + Z A,   E += XᵀX + (R22 A)ᵀ(R22 A),   V ← M V + N A,
//!   Y = S^{-½} R11,  Z = S^{-½} R12,  M = A_ψ (I − P₊ J),  N = A_ε − A_ψ P₊ R11ᵀ R12,
//!   ```
//!
//!   so V and E are each touched once. (R22 A)ᵀ(R22 A) = (CᵀR22ᵀR22 C) ⊗ hᵀh.
//! - Of the symmetric matrices one triangle is kept.
//! - Nothing is allocated; kernels are looked up by reference.
//!
//! [`arithmetic`] says what it runs on, [`adjoint`] is the reverse mode.

#![allow(
    clippy::needless_range_loop,
    reason = "indices are the formulas' own, and closures would not be compiled with the caller"
)]

pub(crate) mod adjoint;
pub(crate) mod arithmetic;
#[cfg(test)]
mod counting;
pub(crate) mod course;
pub(crate) mod cuts;
pub(crate) mod dispatch;
pub(crate) mod earth;
pub(crate) mod gains;
pub(crate) mod information;
pub(crate) mod moves;
pub(crate) mod several;
pub(crate) mod single;
pub(crate) mod square;
pub(crate) mod trigonometry;

use crate::attitude::{Attitude, UP};
use arithmetic::{Arithmetic, Number, Row, four, three};
use earth::Passed;
use gains::{Gain, Seen, whiten};
use information::{Information, Rows};
use square::{
    Entries, Square, combine, entries, gram_of_rows, product, rows, square_root,
    transposed_product, whitener,
};

/// 3×12, gyro by gyro: row, gyro, factor.
pub(crate) type Wide<Q> = [[Q; 3]; 3];

/// The sum of a(row) · b(row) over all entries.
#[inline(always)]
pub(crate) fn inner<Q: Row>(a: &Wide<Q>, b: &Wide<Q>, i: usize, k: usize) -> Q::Number {
    let sum = a[i][0].by(b[k][0]).plus(a[i][1].by(b[k][1]));
    // One horizontal sum instead of three.
    let last = a[i][2].by(b[k][2]);
    sum.plus(last).total()
}

/// `Σ_k m_k v_k + to` in the columns of gyro `j`.
#[inline(always)]
fn add_column<Q: Row>(m: &[Q::Number; 3], v: &Wide<Q>, j: usize, to: Q) -> Q {
    v[2][j].times_add(m[2], v[1][j].times_add(m[1], v[0][j].times_add(m[0], to)))
}

/// Numbers in every lane.
#[inline(always)]
fn wide<A: Arithmetic>(ar: A, of: &Wide<[f64; 4]>) -> Wide<A::Quad> {
    three!(|i| three!(|j| ar.quad(four!(|e| ar.number(of[i][j][e])))))
}

/// `m v`.
#[inline(always)]
pub(crate) fn turn<Q: Row>(m: &Entries<Q::Number>, v: &Wide<Q>) -> Wide<Q> {
    three!(|i| three!(|j| combine(&m[i], &[v[0][j], v[1][j], v[2][j]])))
}

/// `m v + (turned) ⊗ h`.
#[inline(always)]
pub(crate) fn carry<A: Arithmetic>(
    m: &Entries<A::Number>,
    v: &Wide<A::Quad>,
    turned: &Entries<A::Number>,
    h: A::Quad,
) -> Wide<A::Quad> {
    three!(|i| three!(|j| add_column(&m[i], v, j, h.times(turned[i][j]))))
}

/// A position as the chain sees it: C_c^n, and h = (1, g_x, g_y, g_z).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place<A: Arithmetic> {
    /// C_c^n.
    pub c: Entries<A::Number>,
    /// The rows of C_c^n.
    pub rows: Square<A::Triple>,
    /// The factors of a gyro's four coefficients: 1 for the constant drift, then g^c.
    pub h: A::Quad,
}

impl<A: Arithmetic> Place<A> {
    /// From the entries of C_c^n.
    #[inline(always)]
    pub fn new(ar: A, c: Entries<A::Number>) -> Self {
        Self {
            rows: rows(ar, &c),
            h: ar.quad([ar.number(1.0), -c[UP][0], -c[UP][1], -c[UP][2]]),
            c,
        }
    }
}

/// The entries of C_c^n.
#[inline(always)]
pub(crate) fn attitude_entries(attitude: &Attitude) -> Entries<f64> {
    let m = attitude.matrix();
    three!(|i| three!(|j| m[(i, j)]))
}

/// What the chain carries of one schedule, or of one per lane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Carried<A: Arithmetic> {
    /// V, arcsec per °/h, gyro by gyro.
    pub v: Wide<A::Quad>,
    /// E, (°/h)⁻², gyro by gyro.
    pub e: Information<A>,
}

/// A dwell as the reverse mode needs it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DwellStep<A: Arithmetic> {
    pub gain: Gain<A>,
    /// X, the whitened rows.
    pub x: Wide<A::Quad>,
    /// Z C, N C, R22 C.
    pub z_c: Entries<A::Number>,
    pub n_c: Entries<A::Number>,
    pub q_c: Square<A::Triple>,
}

/// A measurement of ψ_x and ψ_z as the reverse mode needs it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MeasureStep<A: Arithmetic> {
    /// The measurement.
    pub seen: Seen<A>,
    /// L⁻¹ H V.
    pub rows: [[A::Quad; 3]; 2],
}

impl<A: Arithmetic> Carried<A> {
    /// Before the first position: V = 0, E = 0.
    #[inline(always)]
    pub fn new(ar: A) -> Self {
        let zero = ar.number(0.0);
        let nothing = ar.quad([zero; 4]);
        Self {
            v: [[nothing; 3]; 3],
            e: Information::zeros(ar),
        }
    }

    /// With `v` and `e` in every lane.
    #[inline(always)]
    pub fn known(ar: A, v: &Wide<[f64; 4]>, e: &Rows<[f64; 4]>) -> Self {
        Self {
            v: wide(ar, v),
            e: Information::known(ar, e),
        }
    }

    /// E and what three rows R ψ^n + S D of unit noise add to it when `p` is the covariance of
    /// ψ^n: T = R V + S, E + Tᵀ (I + R P Rᵀ)⁻¹ T.
    #[inline(always)]
    pub fn joined(
        &self,
        ar: A,
        p: &Entries<A::Number>,
        psi: &Entries<f64>,
        drift: &Wide<[f64; 4]>,
    ) -> Information<A> {
        let psi = three!(|i| three!(|j| ar.number(psi[i][j])));
        let drift = wide(ar, drift);
        let t = turn(&psi, &self.v);
        let g = rows(ar, &square_root(p));
        let (w, d) = whitener(&gram_of_rows(&entries(&product(&psi, &g))));
        let root = three!(|i| d[i].sqrt());
        let columns = three!(|j| {
            let t = three!(|i| t[i][j].plus(drift[i][j]));
            whiten(&w, &root, &t)
        });
        let mut e = self.e;
        e.add_squares(&three!(|i| three!(|j| columns[j][i])));
        e
    }

    /// Whole filter periods at a place.
    #[inline(always)]
    pub fn dwell(&mut self, gain: &Gain<A>, at: &Place<A>) -> DwellStep<A> {
        let z_c = entries(&product(&entries(&gain.z), &at.rows));
        let n_c = entries(&product(&entries(&gain.n), &at.rows));
        let q_c = product(&entries(&gain.r22), &at.rows);
        let x = carry::<A>(&entries(&gain.y), &self.v, &z_c, at.h);
        self.v = carry::<A>(&entries(&gain.m), &self.v, &n_c, at.h);
        let n_gram = entries(&transposed_product(&entries(&q_c), &q_c));
        self.e.add_dwell(&x, &n_gram, at.h);
        DwellStep {
            gain: *gain,
            x,
            z_c,
            n_c,
            q_c,
        }
    }

    /// Time without a measurement at a place; returns Γ C.
    #[inline(always)]
    pub fn pass_at(&mut self, passed: &Passed<A>, at: &Place<A>) -> Entries<A::Number> {
        let gamma_c = entries(&product(&passed.gamma, &at.rows));
        self.v = carry::<A>(&passed.phi, &self.v, &gamma_c, at.h);
        gamma_c
    }

    /// Time without a measurement in which the drift adds `b` to V.
    #[inline(always)]
    pub fn pass(&mut self, passed: &Passed<A>, b: &Wide<A::Quad>) {
        let v = &self.v;
        self.v = three!(|i| three!(|j| add_column(&passed.phi[i], v, j, b[i][j])));
    }

    /// A measurement of ψ_x and ψ_z.
    #[inline(always)]
    pub fn measure(&mut self, seen: &Seen<A>) -> MeasureStep<A> {
        let w = seen.weight;
        let v = self.v;
        let rows = [v[0], three!(|j| v[0][j].times_add(-seen.l, v[2][j]))];
        self.e.add_rows(&rows, [w * seen.d[0], w * seen.d[1]]);
        // V₊ = V − P₊ Hᵀ w H V.
        self.v = three!(|i| {
            let (x, z) = (-(w * seen.p[i][0]), -(w * seen.p[i][2]));
            three!(|j| v[2][j].times_add(z, v[0][j].times_add(x, v[i][j])))
        });
        MeasureStep { seen: *seen, rows }
    }

    /// A change of position in frame-hold repositioning: ψ^n ← q ψ^n.
    #[inline(always)]
    pub fn rotate(&mut self, q: &Entries<A::Number>) {
        self.v = turn(q, &self.v);
    }
}
