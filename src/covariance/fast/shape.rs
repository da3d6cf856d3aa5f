//! Which errors of the instruments the straight-line chain carries.
//!
//! The drift of a gyro, and likewise the error of an accelerometer along its axis, is a
//! combination of *features* of the attitude and the rate: 1; g_x, g_y, g_z; their products; the
//! body rates ω. So every column of the drift matrix is C_j φ, C_j a column of C_c^n and φ a
//! feature, and a [`Shape`] is a list of such columns, four by four ([`Shape::QUADS`]): an
//! instrument each, and a block of four features. All combinations that a platform has (mounting,
//! signs, units, what is left out) are constant and applied to the information once, at the end:
//! [`super::mixing`].
//!
//! | shape | quads | for |
//! |---|---|---|
//! | [`Drift`] | 3 | constant and g-sensitive drift: today's twelve coefficients |
//! | [`Instruments`] | 10 | with torquer errors, and those of the accelerometers up to second order |
//! | [`Catalogue`] | 15 | with quadratic drift, third order and cross-coupling too |
//!
//! Because g_x² + g_y² + g_z² = 1, the [`Catalogue`] does without g_z² of the gyros: it is 1 − g_x² − g_y².
//! (In units of 1 g. Of an accelerometer, whose own square is what counts, each has its own.)

use std::fmt::Debug;
use std::ops::{Index, IndexMut};

use super::arithmetic::{Arithmetic, Number, three};
use super::square::Entries;
use crate::attitude::UP;

/// A product of components of g^c, or a component of the body rate: what columns are made of. Those of
/// [`crate::model::Feature`] are powers of the specific force for accelerometers; here they are of g^c
/// for all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
#[allow(clippy::upper_case_acronyms, reason = "products of components of g")]
pub(crate) enum Monomial {
    /// Nothing.
    Zero,
    /// 1.
    One,
    /// g_x of g^c, in g.
    X,
    /// g_y.
    Y,
    /// g_z.
    Z,
    /// g_x².
    XX,
    /// g_y².
    YY,
    /// g_z².
    ZZ,
    /// g_x g_y.
    XY,
    /// g_x g_z.
    XZ,
    /// g_y g_z.
    YZ,
    /// g_x³.
    XXX,
    /// g_y³.
    YYY,
    /// g_z³.
    ZZZ,
    /// ω_x of the body against inertial space, rad/s.
    RateX,
    /// ω_y.
    RateY,
    /// ω_z.
    RateZ,
}

/// How many there are.
pub(crate) const FEATURES: usize = 17;

impl Monomial {
    /// Of two components of g^c.
    pub const fn product(i: usize, j: usize) -> Self {
        [
            [Self::XX, Self::XY, Self::XZ],
            [Self::XY, Self::YY, Self::YZ],
            [Self::XZ, Self::YZ, Self::ZZ],
        ][i][j]
    }

    /// Whether it is of the second degree in g.
    pub const fn is_square(self) -> bool {
        matches!(
            self,
            Self::XX | Self::YY | Self::ZZ | Self::XY | Self::XZ | Self::YZ
        )
    }

    /// Whether it is a rate.
    pub const fn is_rate(self) -> bool {
        matches!(self, Self::RateX | Self::RateY | Self::RateZ)
    }
}

/// A fixed number of things.
pub(crate) trait Array<T>:
    Copy + Debug + Index<usize, Output = T> + IndexMut<usize>
{
    /// All of them the same.
    fn filled(with: T) -> Self;
}

impl<T: Copy + Debug, const N: usize> Array<T> for [T; N] {
    #[inline(always)]
    fn filled(with: T) -> Self {
        [with; N]
    }
}

/// Four columns of an instrument.
#[derive(Debug, Clone, Copy)]
pub(crate) struct QuadOf {
    /// 0: gyros, 1: accelerometers.
    pub group: usize,
    /// Which of the three.
    pub axis: usize,
    /// Its features, an index of [`Shape::FEATURES`].
    pub block: usize,
}

const fn gyro(axis: usize, block: usize) -> QuadOf {
    QuadOf {
        group: 0,
        axis,
        block,
    }
}

const fn accelerometer(axis: usize, block: usize) -> QuadOf {
    QuadOf {
        group: 1,
        axis,
        block,
    }
}

/// A choice of columns. The first three quads are the gyros' constant and g-sensitive drifts, those
/// of the other gyro columns follow, those of the accelerometers come last.
pub(crate) trait Shape: Copy + Debug + Send + Sync + 'static {
    /// One of everything per quad.
    type Quads<T: Copy + Debug>: Array<T>;
    /// Per block of features.
    type Blocks<T: Copy + Debug>: Array<T>;
    /// Per kind of instrument.
    type Groups<T: Copy + Debug>: Array<T>;

    /// How many quads.
    const QUADS: usize = Self::LAYOUT.len();
    /// How many of them are of gyros.
    const GYRO_QUADS: usize;
    /// How many kinds of instruments.
    const GROUPS: usize;
    /// The quads.
    const LAYOUT: &'static [QuadOf];
    /// The blocks of features.
    const FEATURES: &'static [[Monomial; 4]];
    /// Of what a gyro's drift is a polynomial in g, with C: its degree in the angles.
    const DEGREE: u8;
    /// Whether it is today's, with one block, and nothing happens in a move without duration.
    const DRIFT_ONLY: bool = Self::LAYOUT.len() == 3;
    /// Whether products of g are wanted.
    const PRODUCTS: bool = Self::LAYOUT.len() > 6;
}

/// Constant and g-sensitive drift.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drift;

impl Shape for Drift {
    type Quads<T: Copy + Debug> = [T; 3];
    type Blocks<T: Copy + Debug> = [T; 1];
    type Groups<T: Copy + Debug> = [T; 1];
    const GYRO_QUADS: usize = 3;
    const GROUPS: usize = 1;
    const LAYOUT: &'static [QuadOf] = &[gyro(0, 0), gyro(1, 0), gyro(2, 0)];
    const FEATURES: &'static [[Monomial; 4]] =
        &[[Monomial::One, Monomial::X, Monomial::Y, Monomial::Z]];
    const DEGREE: u8 = 2;
}

/// With torquer errors, and those of the accelerometers up to the square of what they measure.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Instruments;

impl Shape for Instruments {
    type Quads<T: Copy + Debug> = [T; 10];
    type Blocks<T: Copy + Debug> = [T; 5];
    type Groups<T: Copy + Debug> = [T; 2];
    const GYRO_QUADS: usize = 6;
    const GROUPS: usize = 2;
    const LAYOUT: &'static [QuadOf] = &[
        gyro(0, 0),
        gyro(1, 0),
        gyro(2, 0),
        gyro(0, 1),
        gyro(1, 1),
        gyro(2, 1),
        accelerometer(0, 2),
        accelerometer(1, 3),
        accelerometer(2, 0),
        accelerometer(2, 4),
    ];
    const FEATURES: &'static [[Monomial; 4]] = {
        use Monomial::*;
        &[
            [One, X, Y, Z],
            [RateX, RateY, RateZ, Zero],
            [One, X, XX, Zero],
            [One, X, Y, YY],
            [ZZ, Zero, Zero, Zero],
        ]
    };
    const DEGREE: u8 = 2;
}

/// Everything.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Catalogue;

impl Shape for Catalogue {
    type Quads<T: Copy + Debug> = [T; 15];
    type Blocks<T: Copy + Debug> = [T; 9];
    type Groups<T: Copy + Debug> = [T; 2];
    const GYRO_QUADS: usize = 9;
    const GROUPS: usize = 2;
    const LAYOUT: &'static [QuadOf] = &[
        gyro(0, 0),
        gyro(1, 0),
        gyro(2, 0),
        gyro(0, 1),
        gyro(1, 1),
        gyro(2, 1),
        gyro(0, 2),
        gyro(1, 2),
        gyro(2, 2),
        accelerometer(0, 3),
        accelerometer(1, 4),
        accelerometer(2, 5),
        accelerometer(0, 6),
        accelerometer(1, 7),
        accelerometer(2, 8),
    ];
    const FEATURES: &'static [[Monomial; 4]] = {
        use Monomial::*;
        &[
            [One, X, Y, Z],
            [XX, YY, XY, XZ],
            [YZ, RateX, RateY, RateZ],
            [One, X, XX, XXX],
            [One, Y, YY, YYY],
            [One, Z, ZZ, ZZZ],
            [XY, XZ, Zero, Zero],
            [X, XY, YZ, Zero],
            [X, Y, XZ, YZ],
        ]
    };
    const DEGREE: u8 = 3;
}

/// All features by number.
pub(crate) type Basis<N> = [N; FEATURES];

/// The features in an attitude C_c^n, `rate` being the body's against inertial space, in n, rad/s.
#[inline(always)]
pub(crate) fn basis<N: Number, S: Shape>(c: &Entries<N>, rate: &[N; 3]) -> Basis<N> {
    let g = three!(|e| -c[UP][e]);
    let mut of = [c[0][0].constant(0.0); FEATURES];
    of[Monomial::One as usize] = c[0][0].constant(1.0);
    for e in 0..3 {
        of[Monomial::X as usize + e] = g[e];
    }
    if S::PRODUCTS {
        for e in 0..3 {
            of[Monomial::XX as usize + e] = g[e] * g[e];
            of[Monomial::XXX as usize + e] = g[e] * g[e] * g[e];
        }
        of[Monomial::XY as usize] = g[0] * g[1];
        of[Monomial::XZ as usize] = g[0] * g[2];
        of[Monomial::YZ as usize] = g[1] * g[2];
    }
    if !S::DRIFT_ONLY {
        for e in 0..3 {
            let rate = c[2][e].mul_add(rate[2], c[1][e].mul_add(rate[1], c[0][e] * rate[0]));
            of[Monomial::RateX as usize + e] = rate;
        }
    }
    of
}

/// Reverse mode of [`basis`]: adds to C̄, and gives the adjoint of the rate in n.
#[inline(always)]
pub(crate) fn basis_adjoint<N: Number, S: Shape>(
    c: &Entries<N>,
    rate: &[N; 3],
    of: &Basis<N>,
    c_adjoint: &mut Entries<N>,
) -> [N; 3] {
    let zero = c[0][0].constant(0.0);
    let g = three!(|e| -c[UP][e]);
    let mut g_adjoint = three!(|e| of[Monomial::X as usize + e]);
    if S::PRODUCTS {
        let (two, three) = (zero.constant(2.0), zero.constant(3.0));
        for e in 0..3 {
            let squares = of[Monomial::XX as usize + e] * two;
            let cubes = of[Monomial::XXX as usize + e] * three * g[e];
            g_adjoint[e] = (squares + cubes).mul_add(g[e], g_adjoint[e]);
        }
        for (feature, a, b) in [
            (Monomial::XY, 0, 1),
            (Monomial::XZ, 0, 2),
            (Monomial::YZ, 1, 2),
        ] {
            let product = of[feature as usize];
            g_adjoint[a] = product.mul_add(g[b], g_adjoint[a]);
            g_adjoint[b] = product.mul_add(g[a], g_adjoint[b]);
        }
    }
    let mut rate_adjoint = [zero; 3];
    for e in 0..3 {
        // g = −(Up row of C)ᵀ.
        c_adjoint[UP][e] = c_adjoint[UP][e] - g_adjoint[e];
        if !S::DRIFT_ONLY {
            let of = of[Monomial::RateX as usize + e];
            for k in 0..3 {
                c_adjoint[k][e] = rate[k].mul_add(of, c_adjoint[k][e]);
                rate_adjoint[k] = c[k][e].mul_add(of, rate_adjoint[k]);
            }
        }
    }
    rate_adjoint
}

/// The blocks of features.
#[inline(always)]
pub(crate) fn blocks<A: Arithmetic, S: Shape>(ar: A, of: &Basis<A::Number>) -> S::Blocks<A::Quad> {
    let block = |b: usize| -> [A::Number; 4] {
        let f = S::FEATURES[b];
        [
            of[f[0] as usize],
            of[f[1] as usize],
            of[f[2] as usize],
            of[f[3] as usize],
        ]
    };
    let mut out = S::Blocks::<A::Quad>::filled(ar.quad(block(0)));
    for b in 1..S::FEATURES.len() {
        out[b] = ar.quad(block(b));
    }
    out
}

/// What a place and a shape have in common with all others: kept out of the trait's constants so
/// that a timeline need not know the shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Facts {
    /// Whether moves without duration count, because torquers turn in them.
    pub jumps: bool,
    /// What half the phase of a move's integrand is multiplied by, beside that of [`Drift`].
    pub phase: f64,
}

impl Facts {
    /// Of a shape.
    pub fn of<S: Shape>() -> Self {
        Self {
            jumps: !S::DRIFT_ONLY,
            phase: f64::from(S::DEGREE) / 2.0,
        }
    }
}

/// One entry per quad, worked out. Three are written out, see [`three`].
macro_rules! quads {
    ($S:ty, |$q:ident| $entry:expr) => {{
        let mut out = $crate::covariance::fast::shape::every::<$S, _>({
            let $q = 0;
            $entry
        });
        if <$S as $crate::covariance::fast::shape::Shape>::DRIFT_ONLY {
            out[1] = {
                let $q = 1;
                $entry
            };
            out[2] = {
                let $q = 2;
                $entry
            };
        } else {
            for $q in 1..<$S as $crate::covariance::fast::shape::Shape>::QUADS {
                out[$q] = $entry;
            }
        }
        out
    }};
}
pub(crate) use quads;

/// The same for every quad.
#[inline(always)]
pub(crate) fn every<S: Shape, T: Copy + Debug>(value: T) -> S::Quads<T> {
    Array::filled(value)
}
