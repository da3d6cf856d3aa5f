//! Numbers of 16 and of 32 digits, and small matrices of them.
//!
//! Where measurements tell some combination of coefficients 1e16 times better than the prior
//! tells another, the rounding of the sixteenth digit of the former is as much information as
//! there is on the latter. [`Extended`], a sum of two doubles, leaves 1e32. See the numbers in
//! docs/reliability.md.

use faer::traits::RealField;
use nalgebra::{ClosedAddAssign, ClosedMulAssign, ClosedSubAssign, Matrix3, Scalar};
use num_traits::{One, Zero};

use super::Precision;
use crate::attitude::{Degrees, Position, Stand};
use crate::dynamics::ErrorDynamics;

/// A number of 32 digits.
pub(crate) type Extended = faer::fx128;

/// `A` rows of `B` numbers.
pub(crate) type Dense<T, const A: usize, const B: usize> = [[T; B]; A];

/// A number that a filter can be run with.
pub(crate) trait Real:
    RealField
    + Copy
    + From<f64>
    + Scalar
    + Zero
    + One
    + ClosedAddAssign
    + ClosedSubAssign
    + ClosedMulAssign
{
    /// σ of a misalignment component known exactly, in units of the measurement noise: its share
    /// of any variance is below rounding even after a million measurements.
    const KNOWN: f64;

    /// Terms of a series of size one that are less than this are below rounding.
    const SMALLEST_TERM: f64;

    /// Its name.
    const PRECISION: Precision;

    /// The nearest double.
    fn f64(self) -> f64;

    /// √ of it.
    fn sqrt(self) -> Self;

    /// C_c^n of a position on a stand.
    fn attitude(stand: &Stand, position: Position) -> Matrix3<Self>;

    /// Φ and Γ of an interval.
    fn transition(dynamics: &ErrorDynamics, length_s: f64) -> [Matrix3<Self>; 2];
}

impl Real for f64 {
    const KNOWN: f64 = 1e-9;
    const SMALLEST_TERM: f64 = 1e-18;
    const PRECISION: Precision = Precision::Double;

    fn f64(self) -> f64 {
        self
    }

    fn sqrt(self) -> Self {
        Self::sqrt(self)
    }

    fn attitude(stand: &Stand, position: Position) -> Matrix3<Self> {
        *stand.attitude(position).matrix()
    }

    fn transition(dynamics: &ErrorDynamics, length_s: f64) -> [Matrix3<Self>; 2] {
        [dynamics.transition(length_s), dynamics.integral(length_s)]
    }
}

impl Real for Extended {
    const KNOWN: f64 = 1e-12;
    const SMALLEST_TERM: f64 = 1e-34;
    const PRECISION: Precision = Precision::Extended;

    fn f64(self) -> f64 {
        self.0
    }

    fn sqrt(self) -> Self {
        Self::sqrt(self)
    }

    fn attitude(stand: &Stand, position: Position) -> Matrix3<Self> {
        let turn = |angle: Degrees, axis: usize| {
            let (s, c) = sine_cosine(angle);
            let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut m = Matrix3::identity();
            m[(j, j)] = c;
            m[(k, k)] = c;
            m[(j, k)] = s;
            m[(k, j)] = -s;
            m
        };
        let [alpha, beta, gamma] = stand.papers(position.exact());
        let papers = turn(alpha, 0) * turn(beta, 1) * turn(gamma, 2);
        let Some(frame) = stand.frame() else {
            return papers;
        };
        // Rot(−e, θ) is what `turn` gives.
        let [heading, tilt_x, tilt_z] = stand.base_angles();
        let base = turn(heading, 1) * turn(-tilt_x, 0) * turn(-tilt_z, 2);
        base * frame.hung.map(Self::from) * papers * frame.right.map(Self::from)
    }

    /// In closed form, F = −[ω ×] of rate ω.
    fn transition(dynamics: &ErrorDynamics, length_s: f64) -> [Matrix3<Self>; 2] {
        let f = dynamics.system_matrix().map(Self::from);
        let squared = f * f;
        // F² has the trace −2 ω².
        let trace = squared[(0, 0)] + squared[(1, 1)] + squared[(2, 2)];
        let rate = (-trace / Self::from(2.0)).sqrt();
        let t = Self::from(length_s);
        let (sin, cos) = sin_cos(rate * t);
        let first = sin / rate;
        let second = (Self::ONE - cos) / (rate * rate);
        let third = (t - first) / (rate * rate);
        let one = Matrix3::<Self>::identity();
        [
            one + f * first + squared * second,
            one * t + f * second + squared * third,
        ]
    }
}

/// sin and cos by their series.
pub(crate) fn sin_cos(angle: Extended) -> (Extended, Extended) {
    /// π⁴⁸/48! is below 1e-37.
    const TERMS: u32 = 48;
    let turn = Extended::PI + Extended::PI;
    let x = angle - turn * Extended::from((angle.0 / turn.0).round());
    let (mut sin, mut cos) = (Extended::ZERO, Extended::ZERO);
    let mut term = Extended::ONE;
    for k in 0..TERMS {
        match k % 4 {
            0 => cos += term,
            1 => sin += term,
            2 => cos -= term,
            _ => sin -= term,
        }
        term *= x / Extended::from(f64::from(k + 1));
    }
    (sin, cos)
}

/// (sin, cos) of an angle in degrees: not one digit of a decimal is lost before they are taken.
fn sine_cosine(angle: Degrees) -> (Extended, Extended) {
    let reduced = angle.reduced();
    if reduced.is_middle() {
        let root = Extended::from(0.5).sqrt();
        return reduced.turned((-root, root));
    }
    let nano = Extended::from(reduced.nano as f64);
    let deg = nano / Extended::from(1e9) + Extended::from(reduced.rest_deg);
    reduced.turned(sin_cos(deg * Extended::PI / Extended::from(180.0)))
}

/// All zero.
pub(crate) fn zeros<T: Real, const A: usize, const B: usize>() -> Dense<T, A, B> {
    [[T::from(0.0); B]; A]
}

/// I.
pub(crate) fn identity<T: Real, const N: usize>() -> Dense<T, N, N> {
    let mut m = zeros();
    for (i, row) in m.iter_mut().enumerate() {
        row[i] = T::from(1.0);
    }
    m
}

/// a b.
pub(crate) fn product<T: Real, const A: usize, const B: usize, const C: usize>(
    a: &Dense<T, A, B>,
    b: &Dense<T, B, C>,
) -> Dense<T, A, C> {
    let mut c = zeros();
    for (row, out) in a.iter().zip(&mut c) {
        for (factor, from) in row.iter().zip(b) {
            for (value, other) in out.iter_mut().zip(from) {
                *value += *factor * *other;
            }
        }
    }
    c
}

/// a + b.
pub(crate) fn sum<T: Real, const A: usize, const B: usize>(
    mut a: Dense<T, A, B>,
    b: &Dense<T, A, B>,
) -> Dense<T, A, B> {
    for (row, other) in a.iter_mut().zip(b) {
        for (value, other) in row.iter_mut().zip(other) {
            *value += *other;
        }
    }
    a
}

/// f a.
pub(crate) fn times<T: Real, const A: usize, const B: usize>(
    mut a: Dense<T, A, B>,
    f: T,
) -> Dense<T, A, B> {
    a.iter_mut().flatten().for_each(|value| *value *= f);
    a
}

/// aᵀ.
pub(crate) fn transposed<T: Real, const A: usize, const B: usize>(
    a: &Dense<T, A, B>,
) -> Dense<T, B, A> {
    std::array::from_fn(|j| std::array::from_fn(|i| a[i][j]))
}

/// The same numbers in another precision.
pub(crate) fn convert<T: Real, const A: usize, const B: usize>(
    value: impl Fn(usize, usize) -> f64,
) -> Dense<T, A, B> {
    std::array::from_fn(|i| std::array::from_fn(|j| T::from(value(i, j))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::SignedAxis;

    #[test]
    fn sines_have_thirty_digits() {
        for angle in [1e-9, 0.3, -1.2, 2.5, 3.1, -40.0] {
            let (s, c) = sin_cos(Extended::from(angle));
            assert!((s.0 - angle.sin()).abs() < 1e-15 && (c.0 - angle.cos()).abs() < 1e-15);
            assert!((s * s + c * c - Extended::ONE).0.abs() < 1e-30, "{angle}");
            // sin 3a = 3 sin a − 4 sin³ a.
            let triple = sin_cos(Extended::from(angle) * Extended::from(3.0)).0;
            let expected = s * Extended::from(3.0) - s * s * s * Extended::from(4.0);
            assert!((triple - expected).0.abs() < 1e-29, "{angle}");
        }
    }

    /// sin 33.3° and cos 33.3° to 35 places, computed apart.
    #[test]
    fn decimals_of_degrees_lose_no_digit() {
        let parts = |high: f64, low: f64| Extended::from(high) + Extended::from(low);
        let sin = parts(0.549_022_817_998_131_8, -5.222_917_071_713_295e-17);
        let cos = parts(0.835_807_361_368_270_3, -1.557_404_642_124_358_5e-17);
        for (deg, sign) in [(33.3, 1.0), (213.3, -1.0), (-326.7, 1.0), (-35_786.7, -1.0)] {
            let (s, c) = sine_cosine(Degrees::new(deg));
            assert!((s * Extended::from(sign) - sin).0.abs() < 1e-31, "{deg}");
            assert!((c * Extended::from(sign) - cos).0.abs() < 1e-31, "{deg}");
        }
    }

    #[test]
    fn attitudes_are_those_of_doubles_and_right_angles_are_exact() {
        let position = Position::from_deg(20.0, -130.0, 77.0);
        let far = Position::from_deg(20.0 - 3600.0, 230.0, 437.0);
        let axes = Position::from_deg(90.0, -180.0, 270.0);
        let named = |names: [&str; 3]| names.map(|name| SignedAxis::from_name(name).unwrap());
        let stand = |names, heading, tilt| Stand::new(named(names), heading, tilt).unwrap();
        for stand in [
            Stand::PAPER,
            stand(["+y", "-x", "+z"], 0.0, [0.0; 2]),
            stand(["+z", "+x", "-z"], 90.0, [180.0, -90.0]),
            stand(["-x", "+z", "-x"], 33.3, [-20.0, 71.0]),
        ] {
            let of = |p| Extended::attitude(&stand, p);
            let (a, b) = (of(position), f64::attitude(&stand, position));
            for (a, b) in a.iter().zip(b.iter()) {
                assert!((a.0 - b).abs() < 1e-15);
            }
            assert_eq!(of(far), a);
            let axes = of(axes);
            let exact = axes.iter().all(|v| v.0 == v.0.round() && v.1 == 0.0);
            assert_eq!(exact, stand.heading_deg() != 33.3);
        }
    }
}
