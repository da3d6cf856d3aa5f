//! What the steps do to V and E, and P: 3×3 matrices that depend on the durations only.

use nalgebra::Matrix3;
use pulp::Simd;

use super::arithmetic::{Alignment, Arithmetic, Lanes, MOST_LANES, Number, Register, Row, three};
use super::course::{Legs, Stretch};
use super::earth::{Earth, Passed};
use super::square::{
    Entries, Square, condition, difference, entries, gram_of_rows, mirrored, product, rows,
    square_root, sum, transpose, whitener,
};
use crate::attitude::UP;
use crate::covariance::kernel::Kernel;

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

impl<S: Simd, L: Alignment> DwellKernel<Lanes<S, L>> {
    /// Each lane its own kernel.
    #[inline(always)]
    pub fn gather(ar: Lanes<S, L>, of: &[&DwellNumbers; MOST_LANES]) -> Self {
        macro_rules! matrix {
            ($field:ident) => {
                three!(|i| three!(|j| {
                    let mut values = [0.0; MOST_LANES];
                    for lane in 0..S::F64_LANES {
                        values[lane] = of[lane].$field[i][j];
                    }
                    Register::gather(ar.0, &values)
                }))
            };
        }
        let (r11, a_psi) = (matrix!(r11), matrix!(a_psi));
        Self {
            r11,
            a_psi,
            r11_rows: rows(ar, &r11),
            r12_rows: rows(ar, &matrix!(r12)),
            r22_rows: rows(ar, &matrix!(r22)),
            j_rows: rows(ar, &matrix!(j)),
            cross_rows: rows(ar, &matrix!(cross)),
            a_psi_rows: rows(ar, &a_psi),
            a_psi_t_rows: rows(ar, &transpose(&a_psi)),
            a_epsilon_rows: rows(ar, &matrix!(a_epsilon)),
            c_rows: rows(ar, &matrix!(c)),
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
    /// R22.
    pub r22: Square<A::Triple>,
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
            r22: k.r22_rows,
            p: entries(&sum(&end, &k.c_rows)),
        }
    }
}

/// D^{-½} L⁻¹ m for the entries of L⁻¹ and the diagonal of D^{-½}.
#[inline(always)]
pub(crate) fn whiten<T: Row>(
    w: &[T::Number; 3],
    root: &[T::Number; 3],
    m: &Square<T>,
) -> Square<T> {
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

/// A measurement of ψ_x and ψ_z with information w each: with H = [ψ_x; ψ_z] and
/// S = I + w H P Hᵀ = L D Lᵀ its rows are L⁻¹ H V and their weights w/D. At w = 0 nothing changes,
/// to the bit: a lane whose dwells are whole periods may share the rests of others.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen<A: Arithmetic> {
    /// w, 1/arcsec².
    pub weight: A::Number,
    /// L's entry below the diagonal.
    pub l: A::Number,
    /// D⁻¹.
    pub d: [A::Number; 2],
    /// P after it.
    pub p: Entries<A::Number>,
}

impl<A: Arithmetic> Seen<A> {
    /// With information `weight` each, from the covariance `p` of ψ^n.
    #[inline(always)]
    pub fn new(ar: A, weight: A::Number, p: &Entries<A::Number>) -> Self {
        let one = ar.number(1.0);
        let s01 = weight * p[2][0];
        let d0 = one / weight.mul_add(p[0][0], one);
        let l = s01 * d0;
        let d1 = one / (weight.mul_add(p[2][2], one) - l * s01);
        let g = square_root(p);
        // w Gᵀ HᵀH G from the two rows of G that are seen.
        let m = three!(|i| three!(|j| weight * g[2][i].mul_add(g[2][j], g[0][i] * g[0][j])));
        let after = condition(&g, &m);
        Self {
            weight,
            l,
            d: [d0, d1],
            p: where_seen(weight, &after, p),
        }
    }
}

/// A measurement of the azimuth ψ_y with information w: with H = ψ_y and D = 1 + w H P Hᵀ its row is
/// H V with the weight w/D. Regular at w = 0.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Azimuth<A: Arithmetic> {
    /// w, 1/arcsec².
    pub weight: A::Number,
    /// D⁻¹.
    pub d: A::Number,
    /// P after it.
    pub p: Entries<A::Number>,
}

impl<A: Arithmetic> Azimuth<A> {
    /// With information `weight`, from the covariance `p` of ψ^n.
    #[inline(always)]
    pub fn new(ar: A, weight: A::Number, p: &Entries<A::Number>) -> Self {
        let one = ar.number(1.0);
        let g = square_root(p);
        // w Gᵀ HᵀH G from the row of G that is seen.
        let m = three!(|i| three!(|j| weight * g[UP][i] * g[UP][j]));
        let after = condition(&g, &m);
        Self {
            weight,
            d: one / weight.mul_add(p[UP][UP], one),
            p: where_seen(weight, &after, p),
        }
    }
}

/// P after a measurement, or P as it was where the measurement has no weight.
#[inline(always)]
fn where_seen<N: Number>(weight: N, after: &Entries<N>, before: &Entries<N>) -> Entries<N> {
    let zero = weight.constant(0.0);
    let before = mirrored(before);
    three!(|i| three!(|j| after[i][j].where_greater(weight, zero, before[i][j])))
}

/// Time without a measurement, P at its end, and the measurement there.
pub(crate) type PassedThenSeen<A> = (
    Passed<A>,
    Entries<<A as Arithmetic>::Number>,
    Option<Seen<A>>,
);

/// P through a schedule, and what the steps do with it.
pub(crate) trait Gains<A: Arithmetic> {
    /// P now; its lower triangle counts.
    fn p(&self) -> Entries<A::Number>;
    /// ψ^n ← q ψ^n.
    fn rotate(&mut self, q: &Entries<A::Number>);
    /// A stretch of a move, with the measurement that ends it.
    fn stretch(&mut self, stretch: &Stretch<A::Number, A::Panels>) -> PassedThenSeen<A>;
    /// The settling of a leg.
    fn settle(&mut self, leg: usize) -> Passed<A>;
    /// The whole periods of its dwell; none where no lane has any.
    fn dwell(&mut self, leg: usize) -> Option<Gain<A>>;
    /// The rest of its dwell, with P before the measurement that ends it.
    fn remainder(&mut self, leg: usize) -> PassedThenSeen<A>;
    /// The azimuth beside a measurement of that weight, where it is measured.
    fn azimuth(&mut self, weight: A::Number) -> Option<Azimuth<A>>;
}

/// Worked out in the chain's own arithmetic.
#[derive(Debug)]
pub(crate) struct Own<'a, A: Arithmetic, L> {
    ar: A,
    legs: &'a L,
    earth: Earth<A::Number>,
    p: Entries<A::Number>,
}

impl<'a, A: Arithmetic, L: Legs<A>> Own<'a, A, L> {
    /// From the prior covariance of ψ^n.
    #[inline(always)]
    pub fn new(ar: A, legs: &'a L, earth: &Earth<A::Number>, prior_psi: &Matrix3<f64>) -> Self {
        Self {
            ar,
            legs,
            earth: *earth,
            p: three!(|i| three!(|j| ar.number(prior_psi[(i, j)]))),
        }
    }

    #[inline(always)]
    fn pass(&mut self, length_s: A::Number) -> Passed<A> {
        let passed = self.earth.pass(length_s);
        self.p = passed.covariance(self.ar, &self.p);
        passed
    }

    #[inline(always)]
    fn measure(&mut self, weight: A::Number) -> Seen<A> {
        let seen = Seen::new(self.ar, weight, &self.p);
        self.p = seen.p;
        seen
    }
}

impl<A: Arithmetic, L: Legs<A>> Gains<A> for Own<'_, A, L> {
    #[inline(always)]
    fn p(&self) -> Entries<A::Number> {
        self.p
    }
    #[inline(always)]
    fn rotate(&mut self, q: &Entries<A::Number>) {
        let half = entries(&product(q, &rows(self.ar, &mirrored(&self.p))));
        self.p = entries(&product(&half, &rows(self.ar, &transpose(q))));
    }
    #[inline(always)]
    fn stretch(&mut self, stretch: &Stretch<A::Number, A::Panels>) -> PassedThenSeen<A> {
        let passed = self.pass(stretch.elapsed_s);
        let p = self.p;
        match stretch.measured {
            Some((weight, _)) => (passed, p, Some(self.measure(weight))),
            None => (passed, p, None),
        }
    }
    #[inline(always)]
    fn settle(&mut self, leg: usize) -> Passed<A> {
        self.pass(self.legs.settle_s(leg))
    }
    #[inline(always)]
    fn dwell(&mut self, leg: usize) -> Option<Gain<A>> {
        let kernel = self.legs.dwell(leg)?;
        let gain = Gain::new(self.ar, &kernel, &self.p);
        self.p = gain.p;
        Some(gain)
    }
    #[inline(always)]
    fn remainder(&mut self, leg: usize) -> PassedThenSeen<A> {
        let (length_s, weight) = self.legs.remainder(leg);
        let passed = self.pass(length_s);
        let p = self.p;
        match weight {
            Some(weight) => (passed, p, Some(self.measure(weight))),
            None => (passed, p, None),
        }
    }
    #[inline(always)]
    fn azimuth(&mut self, weight: A::Number) -> Option<Azimuth<A>> {
        let ratio = self.legs.azimuth()?;
        let azimuth = Azimuth::new(self.ar, weight * self.ar.number(ratio), &self.p);
        self.p = azimuth.p;
        Some(azimuth)
    }
}
