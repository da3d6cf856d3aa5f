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
//! [`numbers`] says what it runs on, [`adjoint`] is the reverse mode.

#![allow(
    clippy::needless_range_loop,
    reason = "indices are the formulas' own, and closures would not be compiled with the caller"
)]

pub(crate) mod adjoint;
pub(crate) mod course;
pub(crate) mod earth;
pub(crate) mod information;
pub(crate) mod moves;
pub(crate) mod numbers;
pub(crate) mod single;
pub(crate) mod square;
pub(crate) mod trigonometry;

use nalgebra::Matrix3;

use super::kernel::Kernel;
use crate::attitude::{Attitude, UP};
use earth::Passed;
use information::Information;
use numbers::{Arithmetic, Number, Row, three};
use square::{
    Entries, Square, combine, condition, difference, entries, gram_of_rows, product, rows,
    square_root, transpose, transposed_product, whitener,
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

/// A dwell's kernel, padded and with its products, in plain numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DwellNumbers {
    r11: [[f64; 4]; 3],
    r12: [[f64; 4]; 3],
    r22: [[f64; 4]; 3],
    /// R11ᵀ R11.
    j: [[f64; 4]; 3],
    /// R11ᵀ R12.
    cross: [[f64; 4]; 3],
    a_psi: [[f64; 4]; 3],
    a_psi_t: [[f64; 4]; 3],
    a_epsilon: [[f64; 4]; 3],
    c: [[f64; 4]; 3],
}

impl DwellNumbers {
    /// Of `kernel`.
    pub fn new(kernel: &Kernel) -> Self {
        let padded = |m: &Matrix3<f64>| [0, 1, 2].map(|i| [m[(i, 0)], m[(i, 1)], m[(i, 2)], 0.0]);
        Self {
            r11: padded(&kernel.r11),
            r12: padded(&kernel.r12),
            r22: padded(&kernel.r22),
            j: padded(&(kernel.r11.transpose() * kernel.r11)),
            cross: padded(&(kernel.r11.transpose() * kernel.r12)),
            a_psi: padded(&kernel.a_psi),
            a_psi_t: padded(&kernel.a_psi.transpose()),
            a_epsilon: padded(&kernel.a_epsilon),
            c: padded(&kernel.c),
        }
    }
}

#[inline(always)]
fn constant_entries<A: Arithmetic>(ar: A, m: &[[f64; 4]; 3]) -> Entries<A::Number> {
    three!(|i| three!(|j| ar.number(m[i][j])))
}

#[inline(always)]
fn constant_rows<A: Arithmetic>(ar: A, m: &[[f64; 4]; 3]) -> Square<A::Triple> {
    three!(|i| ar.constants(&m[i]))
}

/// A dwell's kernel as an arithmetic reads it: entries of what multiplies from the left, rows of
/// what is multiplied.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DwellKernel<A: Arithmetic> {
    r11: Entries<A::Number>,
    a_psi: Entries<A::Number>,
    r22: Entries<A::Number>,
    r11_rows: Square<A::Triple>,
    r12_rows: Square<A::Triple>,
    r22_rows: Square<A::Triple>,
    j_rows: Square<A::Triple>,
    cross_rows: Square<A::Triple>,
    a_psi_rows: Square<A::Triple>,
    a_psi_t_rows: Square<A::Triple>,
    a_epsilon_rows: Square<A::Triple>,
    c_rows: Square<A::Triple>,
}

impl<A: Arithmetic> DwellKernel<A> {
    /// The same kernel in every lane.
    #[inline(always)]
    pub fn new(ar: A, k: &DwellNumbers) -> Self {
        Self {
            r11: constant_entries(ar, &k.r11),
            a_psi: constant_entries(ar, &k.a_psi),
            r22: constant_entries(ar, &k.r22),
            r11_rows: constant_rows(ar, &k.r11),
            r12_rows: constant_rows(ar, &k.r12),
            r22_rows: constant_rows(ar, &k.r22),
            j_rows: constant_rows(ar, &k.j),
            cross_rows: constant_rows(ar, &k.cross),
            a_psi_rows: constant_rows(ar, &k.a_psi),
            a_psi_t_rows: constant_rows(ar, &k.a_psi_t),
            a_epsilon_rows: constant_rows(ar, &k.a_epsilon),
            c_rows: constant_rows(ar, &k.c),
        }
    }
}

/// What a dwell does to V, E and P: the matrices of the module text.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gain<A: Arithmetic> {
    /// Y = S^{-½} R11.
    pub y: Square<A::Triple>,
    /// Z = S^{-½} R12.
    pub z: Square<A::Triple>,
    /// M = A_ψ (I − P₊ J).
    pub m: Square<A::Triple>,
    /// N = A_ε − A_ψ P₊ R11ᵀ R12.
    pub n: Square<A::Triple>,
    /// P at the end of the dwell.
    pub p: Entries<A::Number>,
}

impl<A: Arithmetic> Gain<A> {
    /// Of a dwell that starts with the covariance `p` of ψ^n.
    #[inline(always)]
    pub fn new(ar: A, k: &DwellKernel<A>, p: &Entries<A::Number>) -> Self {
        let g = square_root(p);
        let b = lower_product(&k.r11, &g);
        let (w, d) = whitener(&gram_of_rows(&b));
        let p_plus = condition(&g, &gram_of_rows(&transpose(&b)));
        let root = three!(|i| d[i].sqrt());
        let u = entries(&product(&k.a_psi, &rows(ar, &p_plus)));
        let end = product(&u, &k.a_psi_t_rows);
        Self {
            y: whiten(&w, &root, &k.r11_rows),
            z: whiten(&w, &root, &k.r12_rows),
            m: difference(&k.a_psi_rows, &product(&u, &k.j_rows)),
            n: difference(&k.a_epsilon_rows, &product(&u, &k.cross_rows)),
            p: entries(&square::sum(&end, &k.c_rows)),
        }
    }
}

/// D^{-½} L⁻¹ m for the entries of L⁻¹ and the diagonal of D^{-½}.
#[inline(always)]
fn whiten<T: Row>(w: &[T::Number; 3], root: &[T::Number; 3], m: &Square<T>) -> Square<T> {
    [
        m[0].times(root[0]),
        m[0].times_add(w[0], m[1]).times(root[1]),
        m[0].times_add(w[1], m[1].times_add(w[2], m[2]))
            .times(root[2]),
    ]
}

/// `r g`, g lower triangular.
#[inline(always)]
fn lower_product<N: Number>(r: &Entries<N>, g: &Entries<N>) -> Entries<N> {
    three!(|i| [
        r[i][2].mul_add(g[2][0], r[i][1].mul_add(g[1][0], r[i][0] * g[0][0])),
        r[i][2].mul_add(g[2][1], r[i][1] * g[1][1]),
        r[i][2] * g[2][2],
    ])
}

/// The chain at work on one schedule, or on one per lane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chain<A: Arithmetic> {
    pub ar: A,
    /// V, arcsec per °/h, gyro by gyro.
    pub v: Wide<A::Quad>,
    /// P, arcsec²; its lower triangle counts.
    pub p: Entries<A::Number>,
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
    /// R22.
    pub r22: Square<A::Triple>,
}

/// A measurement of ψ_x and ψ_z as the reverse mode needs it: with S = L D Lᵀ and H = [ψ_x; ψ_z],
/// its rows are L⁻¹ H V and their weights w/D.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MeasureStep<A: Arithmetic> {
    /// Information w of each axis, 1/arcsec².
    pub weight: A::Number,
    /// L's entry below the diagonal.
    pub l: A::Number,
    /// D⁻¹.
    pub d: [A::Number; 2],
    /// L⁻¹ H V.
    pub rows: [[A::Quad; 3]; 2],
}

impl<A: Arithmetic> Chain<A> {
    /// Before the first position: V = 0, E = 0, P the prior.
    #[inline(always)]
    pub fn new(ar: A, prior_psi: &Matrix3<f64>) -> Self {
        let zero = ar.number(0.0);
        let nothing = ar.quad([zero; 4]);
        Self {
            ar,
            v: [[nothing; 3]; 3],
            p: three!(|i| three!(|j| ar.number(prior_psi[(i, j)]))),
            e: Information::zeros(ar),
        }
    }

    /// Whole filter periods at a place.
    #[inline(always)]
    pub fn dwell(&mut self, k: &DwellKernel<A>, gain: &Gain<A>, at: &Place<A>) -> DwellStep<A> {
        let z_c = entries(&product(&entries(&gain.z), &at.rows));
        let n_c = entries(&product(&entries(&gain.n), &at.rows));
        let q_c = product(&k.r22, &at.rows);
        let x = carry::<A>(&entries(&gain.y), &self.v, &z_c, at.h);
        self.v = carry::<A>(&entries(&gain.m), &self.v, &n_c, at.h);
        self.p = gain.p;
        let n_gram = entries(&transposed_product(&entries(&q_c), &q_c));
        self.e.add_dwell(&x, &n_gram, at.h);
        DwellStep {
            gain: *gain,
            x,
            z_c,
            n_c,
            q_c,
            r22: k.r22_rows,
        }
    }

    /// Time without a measurement at a place; returns Γ C.
    #[inline(always)]
    pub fn pass_at(&mut self, passed: &Passed<A>, at: &Place<A>) -> Entries<A::Number> {
        let gamma_c = entries(&product(&passed.gamma, &at.rows));
        self.v = carry::<A>(&passed.phi, &self.v, &gamma_c, at.h);
        self.p = passed.covariance(self.ar, &self.p);
        gamma_c
    }

    /// Time without a measurement in which the drift adds `b` to V.
    #[inline(always)]
    pub fn pass(&mut self, passed: &Passed<A>, b: &Wide<A::Quad>) {
        let v = &self.v;
        self.v = three!(|i| three!(|j| add_column(&passed.phi[i], v, j, b[i][j])));
        self.p = passed.covariance(self.ar, &self.p);
    }

    /// A measurement of ψ_x and ψ_z with information `weight` each, regular at weight zero.
    #[inline(always)]
    pub fn measure(&mut self, weight: A::Number) -> MeasureStep<A> {
        let p = &self.p;
        let one = self.ar.number(1.0);
        // S = I + w H P Hᵀ = L D Lᵀ.
        let s01 = weight * p[2][0];
        let d0 = one / weight.mul_add(p[0][0], one);
        let l = s01 * d0;
        let d1 = one / (weight.mul_add(p[2][2], one) - l * s01);
        let g = square_root(p);
        // w Gᵀ HᵀH G from the two rows of G that are seen.
        let m = three!(|i| three!(|j| weight * g[2][i].mul_add(g[2][j], g[0][i] * g[0][j])));
        let p_plus = condition(&g, &m);
        let rows = [
            self.v[0],
            three!(|j| self.v[0][j].times_add(-l, self.v[2][j])),
        ];
        self.e.add_rows(&rows, [weight * d0, weight * d1]);
        // V₊ = V − P₊ Hᵀ w H V.
        let v = self.v;
        self.v = three!(|i| {
            let (x, z) = (-(weight * p_plus[i][0]), -(weight * p_plus[i][2]));
            three!(|j| v[2][j].times_add(z, v[0][j].times_add(x, v[i][j])))
        });
        self.p = p_plus;
        MeasureStep {
            weight,
            l,
            d: [d0, d1],
            rows,
        }
    }

    /// A change of position in frame-hold repositioning: ψ^n ← q ψ^n.
    #[inline(always)]
    pub fn rotate(&mut self, q: &Entries<A::Number>) {
        self.v = turn(q, &self.v);
        let p = rows(self.ar, &square::mirrored(&self.p));
        let half = entries(&product(q, &p));
        self.p = entries(&product(&half, &rows(self.ar, &transpose(q))));
    }
}
