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
//! - Further errors of the instruments are further columns C ⊗ (features), see [`shape`]; what is
//!   said here of the twelve coefficients holds for all of them.
//! - Errors of the accelerometers, b^n = C_c^n δZ, are constant while a position is held. The chain
//!   carries ψ' = ψ + U D, U the rows (−b_z, 0, b_x), which is what is measured:
//!
//!   ```text
//!   z_x = ψ'_z,   z_z = −ψ'_x,   ψ̇' = −ω_ie × ψ' + (A + [ω_ie ×] U) D,
//!   ```
//!
//!   so that the kernel stays as it is. Over a move V' ← Φ (V' − U) + B + U of the new place. The
//!   vertical channel is z_y = b_y and tells of them alone.
//! - Torquers turn in moves without duration too: V jumps by ∫ C ⊗ ω dt along the gimbals' path.
//!
//! [`arithmetic`] says what it runs on, [`adjoint`] is the reverse mode.

#![allow(
    clippy::needless_range_loop,
    reason = "indices are the formulas' own, and closures would not be compiled with the caller"
)]

pub(crate) mod adjoint;
pub(crate) mod arithmetic;
pub(crate) mod coloured;
#[cfg(test)]
mod counting;
pub(crate) mod course;
pub(crate) mod cuts;
pub(crate) mod dispatch;
pub(crate) mod earth;
pub(crate) mod gains;
pub(crate) mod information;
pub(crate) mod mixing;
pub(crate) mod moves;
pub(crate) mod posterior;
pub(crate) mod several;
pub(crate) mod shape;
pub(crate) mod single;
pub(crate) mod square;
pub(crate) mod tiles;
pub(crate) mod trigonometry;
pub(crate) mod turn;
pub(crate) mod wide;

use std::fmt::Debug;

use crate::attitude::{Attitude, EAST, NORTH, UP};
use arithmetic::{Arithmetic, Number, Row, four, three};
use earth::{Earth, Passed};
use gains::{Azimuth, Gain, Seen, whiten};
use information::{Information, Rows};
use shape::{Array, Drift, Shape, quads};
use square::{
    Entries, Square, combine, entries, gram_of_rows, product, rows, square_root, whitener,
};

/// Three rows over the columns of a shape: row, quad, factor. Of [`Drift`] 3×12, gyro by gyro.
pub(crate) type Wide<Q, S = Drift> = [<S as Shape>::Quads<Q>; 3];

/// Σ a_k b_k over a row.
#[inline(always)]
pub(crate) fn row_dot<Q: Row, S: Shape>(a: &S::Quads<Q>, b: &S::Quads<Q>) -> Q::Number {
    let mut sum = a[0].by(b[0]);
    for q in 1..S::QUADS {
        sum = sum.plus(a[q].by(b[q]));
    }
    // One horizontal sum instead of one per quad.
    sum.total()
}

/// The sum of a(row) · b(row) over all entries.
#[inline(always)]
pub(crate) fn inner<Q: Row, S: Shape>(
    a: &Wide<Q, S>,
    b: &Wide<Q, S>,
    i: usize,
    k: usize,
) -> Q::Number {
    row_dot::<Q, S>(&a[i], &b[k])
}

/// `Σ_k m_k v_k + to` in quad `q`.
#[inline(always)]
fn add_column<Q: Row, S: Shape>(m: &[Q::Number; 3], v: &Wide<Q, S>, q: usize, to: Q) -> Q {
    v[2][q].times_add(m[2], v[1][q].times_add(m[1], v[0][q].times_add(m[0], to)))
}

/// Numbers in every lane.
#[inline(always)]
fn wide<A: Arithmetic>(ar: A, of: &Wide<[f64; 4]>) -> Wide<A::Quad> {
    three!(|i| three!(|j| ar.quad(four!(|e| ar.number(of[i][j][e])))))
}

/// `m v`.
#[inline(always)]
pub(crate) fn turn<Q: Row, S: Shape>(m: &Entries<Q::Number>, v: &Wide<Q, S>) -> Wide<Q, S> {
    three!(|i| quads!(S, |q| combine(&m[i], &[v[0][q], v[1][q], v[2][q]])))
}

/// `m v + (turned) ⊗ h`.
#[inline(always)]
pub(crate) fn carry<A: Arithmetic, S: Shape>(
    m: &Entries<A::Number>,
    v: &Wide<A::Quad, S>,
    turned: &S::Groups<Entries<A::Number>>,
    h: &S::Blocks<A::Quad>,
) -> Wide<A::Quad, S> {
    three!(|i| quads!(S, |q| {
        let of = &S::LAYOUT[q];
        let drift = h[of.block].times(turned[of.group][i][of.axis]);
        add_column::<_, S>(&m[i], v, q, drift)
    }))
}

/// A 3×3 matrix times the rows of C of every group.
#[inline(always)]
pub(crate) fn turned<A: Arithmetic, S: Shape>(
    m: &Entries<A::Number>,
    rows: &S::Groups<Square<A::Triple>>,
) -> S::Groups<Square<A::Triple>> {
    let mut out = S::Groups::filled(product(m, &rows[0]));
    for group in 1..S::GROUPS {
        out[group] = product(m, &rows[group]);
    }
    out
}

/// [`entries`] of every group.
#[inline(always)]
pub(crate) fn entries_of<A: Arithmetic, S: Shape>(
    rows: &S::Groups<Square<A::Triple>>,
) -> S::Groups<Entries<A::Number>> {
    let mut out = S::Groups::filled(entries(&rows[0]));
    for group in 1..S::GROUPS {
        out[group] = entries(&rows[group]);
    }
    out
}

/// A position as the chain sees it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place<A: Arithmetic, S: Shape = Drift> {
    /// C_c^n.
    pub c: Entries<A::Number>,
    /// The rows of C_c^n; of the accelerometers those of [ω_ie ×] U, but for the features.
    pub rows: S::Groups<Square<A::Triple>>,
    /// The features, block by block; the first is 1 for the constant drift, then g^c.
    pub h: S::Blocks<A::Quad>,
}

impl<A: Arithmetic, S: Shape> Place<A, S> {
    /// From the entries of C_c^n.
    #[inline(always)]
    pub fn new(ar: A, earth: &Earth<A::Number>, c: Entries<A::Number>) -> Self {
        let rate = match S::DRIFT_ONLY {
            true => [ar.number(0.0); 3],
            false => earth.vector(),
        };
        Self::turning(ar, earth, c, &rate)
    }

    /// While the body turns at `rate` against inertial space, in n, rad/s.
    #[inline(always)]
    pub fn turning(
        ar: A,
        earth: &Earth<A::Number>,
        c: Entries<A::Number>,
        rate: &[A::Number; 3],
    ) -> Self {
        let mut all = S::Groups::filled(rows(ar, &c));
        if S::GROUPS > 1 {
            all[1] = rows(ar, &tilt(earth, &c));
        }
        Self {
            rows: all,
            h: shape::blocks::<A, S>(ar, &shape::basis::<_, S>(&c, rate)),
            c,
        }
    }
}

/// [ω_ie ×] T C with T the rows (−z, 0, x): what the shift by U adds to A, but for the features.
#[inline(always)]
fn tilt<N: Number>(earth: &Earth<N>, c: &Entries<N>) -> Entries<N> {
    let [north, up, _] = earth.vector();
    [
        three!(|j| up * c[NORTH][j]),
        three!(|j| -(north * c[NORTH][j])),
        three!(|j| up * c[EAST][j]),
    ]
}

/// The transpose of what [`tilt`] does.
#[inline(always)]
pub(crate) fn tilt_transposed<N: Number>(earth: &Earth<N>, of: &Entries<N>) -> Entries<N> {
    let [north, up, _] = earth.vector();
    let zero = north.constant(0.0);
    [
        three!(|j| up * of[0][j] - north * of[1][j]),
        [zero; 3],
        three!(|j| up * of[2][j]),
    ]
}

/// The entries of C_c^n.
#[inline(always)]
pub(crate) fn attitude_entries(attitude: &Attitude) -> Entries<f64> {
    let m = attitude.matrix();
    three!(|i| three!(|j| m[(i, j)]))
}

/// The information on the columns of a shape, as the chain collects it.
pub(crate) trait Collected<A: Arithmetic, S: Shape>: Debug {
    /// Nothing known.
    fn nothing(ar: A) -> Self;

    /// Adds a dwell's: XᵀX + (R22 A)ᵀ (R22 A), `q_c` = R22 C, and `vertical` times what a measurement
    /// of the vertical channel tells.
    fn of_dwell(
        &mut self,
        x: &Wide<A::Quad, S>,
        q_c: &S::Groups<Square<A::Triple>>,
        at: &Place<A, S>,
        vertical: A::Number,
    );

    /// Adds Σ_r w_r x_rᵀ x_r.
    fn of_rows(&mut self, x: &[S::Quads<A::Quad>; 2], w: [A::Number; 2]);

    /// Adds `weight` times what a measurement of the vertical channel tells.
    fn of_vertical(&mut self, at: &Place<A, S>, weight: A::Number);
}

/// A shape with the form in which the chain collects the information on its columns.
pub(crate) trait Collecting: Shape {
    /// That information.
    type Information<A: Arithmetic>: Collected<A, Self>;
}

/// What the chain carries of one schedule, or of one per lane.
#[derive(Debug)]
pub(crate) struct Carried<A: Arithmetic, S: Collecting = Drift> {
    /// V, arcsec per °/h.
    pub v: Wide<A::Quad, S>,
    /// E, (°/h)⁻².
    pub e: S::Information<A>,
}

/// A dwell as the reverse mode needs it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DwellStep<A: Arithmetic, S: Shape = Drift> {
    pub gain: Gain<A>,
    /// X, the whitened rows.
    pub x: Wide<A::Quad, S>,
    /// Z C, N C, R22 C.
    pub z_c: S::Groups<Entries<A::Number>>,
    pub n_c: S::Groups<Entries<A::Number>>,
    pub q_c: S::Groups<Square<A::Triple>>,
}

/// A measurement of ψ_x and ψ_z as the reverse mode needs it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MeasureStep<A: Arithmetic, S: Shape = Drift> {
    /// The measurement.
    pub seen: Seen<A>,
    /// L⁻¹ H V.
    pub rows: [S::Quads<A::Quad>; 2],
}

/// A measurement of the azimuth as the reverse mode needs it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AzimuthStep<A: Arithmetic, S: Shape> {
    /// The measurement.
    pub azimuth: Azimuth<A>,
    /// H V.
    pub row: S::Quads<A::Quad>,
}

impl<A: Arithmetic> Carried<A> {
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
        let t = turn::<_, Drift>(&psi, &self.v);
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
}

impl<A: Arithmetic, S: Collecting> Carried<A, S> {
    /// Before the first position: V = 0, E = 0.
    #[inline(always)]
    pub fn new(ar: A) -> Self {
        let nothing = shape::every::<S, _>(ar.quad([ar.number(0.0); 4]));
        Self {
            v: [nothing; 3],
            e: S::Information::nothing(ar),
        }
    }

    /// Whole filter periods at a place, with the information of the vertical channel.
    #[inline(always)]
    pub fn dwell(
        &mut self,
        gain: &Gain<A>,
        at: &Place<A, S>,
        vertical: A::Number,
    ) -> DwellStep<A, S> {
        let z_c = entries_of::<A, S>(&turned::<A, S>(&entries(&gain.z), &at.rows));
        let n_c = entries_of::<A, S>(&turned::<A, S>(&entries(&gain.n), &at.rows));
        let q_c = turned::<A, S>(&entries(&gain.r22), &at.rows);
        let x = carry::<A, S>(&entries(&gain.y), &self.v, &z_c, &at.h);
        self.v = carry::<A, S>(&entries(&gain.m), &self.v, &n_c, &at.h);
        self.e.of_dwell(&x, &q_c, at, vertical);
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
    pub fn pass_at(
        &mut self,
        passed: &Passed<A>,
        at: &Place<A, S>,
    ) -> S::Groups<Entries<A::Number>> {
        let gamma_c = entries_of::<A, S>(&turned::<A, S>(&passed.gamma, &at.rows));
        self.v = carry::<A, S>(&passed.phi, &self.v, &gamma_c, &at.h);
        gamma_c
    }

    /// Time without a measurement in which the drift adds `b` to V.
    #[inline(always)]
    pub fn pass(&mut self, passed: &Passed<A>, b: &Wide<A::Quad, S>) {
        let v = &self.v;
        self.v = three!(|i| quads!(S, |q| add_column::<_, S>(&passed.phi[i], v, q, b[i][q])));
    }

    /// V ← V + `by` U, U the shift by the accelerometers at a place.
    #[inline(always)]
    pub fn shift(&mut self, at: &Place<A, S>, by: A::Number) {
        for q in S::GYRO_QUADS..S::QUADS {
            let of = &S::LAYOUT[q];
            let (x, z) = (by * at.c[NORTH][of.axis], by * at.c[EAST][of.axis]);
            let h = at.h[of.block];
            self.v[NORTH][q] = h.times_add(-z, self.v[NORTH][q]);
            self.v[EAST][q] = h.times_add(x, self.v[EAST][q]);
        }
    }

    /// A measurement of ψ_x and ψ_z.
    #[inline(always)]
    pub fn measure(&mut self, seen: &Seen<A>) -> MeasureStep<A, S> {
        let w = seen.weight;
        let v = self.v;
        let rows = [v[0], quads!(S, |q| v[0][q].times_add(-seen.l, v[2][q]))];
        self.e.of_rows(&rows, [w * seen.d[0], w * seen.d[1]]);
        // V₊ = V − P₊ Hᵀ w H V.
        self.v = three!(|i| {
            let (x, z) = (-(w * seen.p[i][0]), -(w * seen.p[i][2]));
            quads!(S, |q| v[2][q].times_add(z, v[0][q].times_add(x, v[i][q])))
        });
        MeasureStep { seen: *seen, rows }
    }

    /// A measurement of ψ_y.
    #[inline(always)]
    pub fn measure_azimuth(&mut self, ar: A, azimuth: &Azimuth<A>) -> AzimuthStep<A, S> {
        let w = azimuth.weight;
        let v = self.v;
        let row = v[UP];
        self.e.of_rows(&[row, row], [w * azimuth.d, ar.number(0.0)]);
        self.v = three!(|i| {
            let y = -(w * azimuth.p[i][UP]);
            quads!(S, |q| row[q].times_add(y, v[i][q]))
        });
        AzimuthStep {
            azimuth: *azimuth,
            row,
        }
    }

    /// A change of position in frame-hold repositioning: ψ^n ← q ψ^n.
    #[inline(always)]
    pub fn rotate(&mut self, q: &Entries<A::Number>) {
        self.v = turn::<_, S>(q, &self.v);
    }
}
