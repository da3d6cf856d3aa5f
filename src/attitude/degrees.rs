//! Angles in degrees, as people and files give them: exact where a decimal is exact.
//!
//! In radians a half turn is no number: 210° − 30° is π or a little less, as rounding has it. So
//! an angle is kept as the nearest whole number of 1e-9° ([`NanoDegrees`], what files carry) and
//! the rest, which is zero for a decimal of up to nine places ([`Degrees`]). Whatever depends on
//! the last bit of an angle (which way a half turn goes, whether two angles are the same, whether
//! one lies in a range) is decided on the whole number; and sines are taken of what is left over
//! by whole right angles, so that angles a half turn apart have the same ones but for the sign.

use std::ops::{Add, Neg, Sub};

use crate::units::RAD_PER_DEG;

/// An angle in whole 1e-9°.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub(crate) struct NanoDegrees(i64);

/// How many there are in a degree.
const PER_DEG: f64 = 1e9;

impl NanoDegrees {
    /// 90°.
    pub const QUARTER_TURN: Self = Self(90_000_000_000);
    /// 180°.
    pub const HALF_TURN: Self = Self(180_000_000_000);
    /// 360°.
    pub const TURN: Self = Self(360_000_000_000);
    /// Beyond this (of angles that no schedule may hold) sums could overflow.
    const LARGEST: f64 = 2e18;

    /// The nearest to an angle in degrees, from the middle away from zero.
    #[inline]
    pub fn nearest(deg: f64) -> Self {
        // As `round` has it, which is a call where the processor's own rounding may be missing; a
        // search asks a million times a second.
        let scaled = (deg * PER_DEG).clamp(-Self::LARGEST, Self::LARGEST);
        let whole = scaled as i64;
        let rest = scaled - whole as f64;
        Self(whole + i64::from(rest >= 0.5) - i64::from(rest <= -0.5))
    }

    /// That many.
    pub const fn new(count: i64) -> Self {
        Self(count)
    }

    /// How many they are.
    pub const fn count(self) -> i64 {
        self.0
    }

    /// In degrees: the double nearest to the decimal.
    #[inline]
    pub fn deg(self) -> f64 {
        self.0 as f64 / PER_DEG
    }

    /// Without whole turns, in (−180°, 180°]: a half turn is positive.
    #[inline]
    pub const fn wrapped(self) -> Self {
        if -Self::HALF_TURN.0 < self.0 && self.0 <= Self::HALF_TURN.0 {
            return self;
        }
        let once = self.0.rem_euclid(Self::TURN.0);
        Self(if once > Self::HALF_TURN.0 {
            once - Self::TURN.0
        } else {
            once
        })
    }

    /// Its size.
    pub const fn abs(self) -> Self {
        Self(self.0.abs())
    }
}

impl Add for NanoDegrees {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl Sub for NanoDegrees {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

impl Neg for NanoDegrees {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

/// An angle in two parts: whole 1e-9°, and the rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Degrees {
    /// The nearest whole 1e-9°.
    pub nano: NanoDegrees,
    /// What is left, degrees; zero for a decimal of up to nine places.
    pub rest_deg: f64,
}

impl From<NanoDegrees> for Degrees {
    fn from(nano: NanoDegrees) -> Self {
        let rest_deg = 0.0;
        Self { nano, rest_deg }
    }
}

impl Degrees {
    /// An angle in degrees.
    #[inline]
    pub fn new(deg: f64) -> Self {
        let nano = NanoDegrees::nearest(deg);
        // Exact: the two are next to each other.
        let rest_deg = deg - nano.deg();
        Self { nano, rest_deg }
    }

    /// An angle in radians in degrees, as [`deg_of_rad`] has it, and the same taken apart.
    #[inline]
    pub fn of_rad(rad: f64) -> (f64, Self) {
        let deg = rad / RAD_PER_DEG;
        let nano = NanoDegrees::nearest(deg);
        let decimal = nano.deg();
        match is_decimal(deg, decimal) {
            true => (decimal, Self::from(nano)),
            false => {
                let rest_deg = deg - decimal;
                (deg, Self { nano, rest_deg })
            }
        }
    }

    /// In degrees.
    pub fn deg(self) -> f64 {
        self.nano.deg() + self.rest_deg
    }

    /// In radians.
    pub fn rad(self) -> f64 {
        self.deg() * RAD_PER_DEG
    }

    /// Without whole turns: within a half turn of zero, a half turn positive.
    pub fn wrapped(self) -> Self {
        let nano = self.nano.wrapped();
        Self { nano, ..self }
    }

    /// What is left over by whole right angles, and how many of them there are.
    pub fn reduced(self) -> Reduced {
        let (angle, quarter) = (self.nano.count(), NanoDegrees::QUARTER_TURN.count());
        // Rounded upwards where it lies in the middle, on either side of zero.
        let quarters = (angle + quarter / 2).div_euclid(quarter);
        Reduced {
            quarters: quarters.rem_euclid(4),
            nano: angle - quarters * quarter,
            rest_deg: self.rest_deg,
        }
    }

    /// (sin, cos).
    #[inline]
    pub fn sine_cosine(self) -> (f64, f64) {
        let reduced = self.reduced();
        if reduced.is_middle() {
            let root = std::f64::consts::FRAC_1_SQRT_2;
            return reduced.turned((-root, root));
        }
        let deg = reduced.nano as f64 / PER_DEG + reduced.rest_deg;
        reduced.turned(libm::sincos(deg * RAD_PER_DEG))
    }
}

impl Add for Degrees {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            nano: self.nano + other.nano,
            rest_deg: self.rest_deg + other.rest_deg,
        }
    }
}

impl Sub for Degrees {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Neg for Degrees {
    type Output = Self;
    fn neg(self) -> Self {
        Self {
            nano: -self.nano,
            rest_deg: -self.rest_deg,
        }
    }
}

/// An angle as right angles and a remainder of −45° to 45°.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reduced {
    /// Right angles, 0 to 3.
    quarters: i64,
    /// The remainder in whole 1e-9°,
    pub nano: i64,
    /// and what is left of it, degrees.
    pub rest_deg: f64,
}

impl Reduced {
    /// Whether the remainder is −45° exactly, where sine and cosine have one size: computed apart
    /// they may differ in the last place, and 45° not be the mirror image of −45°.
    pub fn is_middle(&self) -> bool {
        self.nano == -NanoDegrees::QUARTER_TURN.count() / 2 && self.rest_deg == 0.0
    }

    /// (sin, cos) of the angle from those of the remainder.
    #[inline]
    pub fn turned<T: Copy + Neg<Output = T>>(&self, (sin, cos): (T, T)) -> (T, T) {
        match self.quarters {
            0 => (sin, cos),
            1 => (cos, -sin),
            2 => (-sin, -cos),
            _ => (-cos, sin),
        }
    }
}

/// Radians in degrees. What was a decimal of up to nine places before it became radians is that
/// decimal again.
#[inline]
pub(crate) fn deg_of_rad(rad: f64) -> f64 {
    decimal(rad / RAD_PER_DEG)
}

/// The decimal of up to nine places that a computed angle (degrees) is but for two or three
/// roundings; otherwise the angle itself.
#[inline]
pub(crate) fn decimal(deg: f64) -> f64 {
    let decimal = NanoDegrees::nearest(deg).deg();
    match is_decimal(deg, decimal) {
        true => decimal,
        false => deg,
    }
}

/// Whether a computed angle is this decimal but for two or three roundings.
#[inline]
fn is_decimal(deg: f64, decimal: f64) -> bool {
    (deg - decimal).abs() <= 4.0 * f64::EPSILON * deg.abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_of_right_angles_are_exact_and_of_half_turns_opposite() {
        for quarters in -400..=400 {
            let (sin, cos) = Degrees::new(90.0 * f64::from(quarters)).sine_cosine();
            assert_eq!(sin.abs() + cos.abs(), 1.0);
            assert!(sin * cos == 0.0);
            let x = f64::from(quarters) * std::f64::consts::FRAC_PI_2;
            assert!((sin - x.sin()).abs() < 1e-12 && (cos - x.cos()).abs() < 1e-12);
        }
        for tenths in -3600..3600 {
            let at = |tenths: i32| Degrees::new(f64::from(tenths) / 10.0).sine_cosine();
            let (sin, cos) = at(tenths);
            assert_eq!(at(tenths + 1800), (-sin, -cos));
            assert_eq!(at(tenths + 3600), (sin, cos));
            assert_eq!(at(1800 - tenths), (sin, -cos));
            assert_eq!(at(-tenths), (-sin, cos));
            assert_eq!(at(900 - tenths), (cos, sin));
            let x = f64::from(tenths) / 10.0 * RAD_PER_DEG;
            assert!((sin - x.sin()).abs() < 1e-15 && (cos - x.cos()).abs() < 1e-15);
        }
    }

    #[test]
    fn the_nearest_is_that_of_round() {
        let ends = [
            0.0,
            -0.0,
            0.5e-9,
            -0.5e-9,
            1.5e-9,
            2.5e-9,
            4.999_999_999_999_999e-10,
        ];
        let more = [
            360.0,
            1e-12,
            4.5e6 + 0.5e-9,
            1e9,
            -1e10,
            f64::MAX,
            f64::INFINITY,
            f64::NAN,
        ];
        let others = (0..2000).map(|k| 17.3 * f64::from(k).sin() * f64::from(k % 40 - 20).exp2());
        for deg in ends.into_iter().chain(more).chain(others) {
            let round = (deg * 1e9).round().clamp(-2e18, 2e18) as i64;
            assert_eq!(NanoDegrees::nearest(deg).count(), round, "{deg:e}");
            assert_eq!(NanoDegrees::nearest(-deg).count(), -round, "{deg:e}");
        }
    }

    #[test]
    fn half_turns_wrap_to_the_positive_side() {
        for (deg, wrapped) in [
            (180.0, 180.0),
            (-180.0, 180.0),
            (540.0, 180.0),
            (-36_000.0 + 180.0, 180.0),
            (-180.000_000_001, 179.999_999_999),
            (210.0 - 30.0, 180.0),
            (359.5, -0.5),
        ] {
            assert_eq!(NanoDegrees::nearest(deg).wrapped().deg(), wrapped);
        }
        // Angles that no schedule may hold neither overflow nor lose their order.
        let far = NanoDegrees::nearest(f64::INFINITY);
        assert!((far - -far) > far && far.wrapped() <= NanoDegrees::HALF_TURN);
    }

    #[test]
    fn decimals_come_back_from_radians() {
        for count in 0..200_000_i64 {
            let deg = NanoDegrees::new(count * 360_000_013 - 36_000_000_000_000).deg();
            assert_eq!(deg_of_rad(deg * RAD_PER_DEG), deg);
        }
        assert_eq!(deg_of_rad(1.0).to_bits(), (1.0 / RAD_PER_DEG).to_bits());
        assert!(deg_of_rad(f64::NAN).is_nan());
    }

    #[test]
    fn angles_in_radians_are_taken_apart_as_their_degrees_are() {
        let decimals = (0..2000).map(|k| f64::from(k * 137 - 90_000) * 1e-3 * RAD_PER_DEG);
        // Up to angles whose whole 1e-9° a double holds: far beyond those that a schedule may hold.
        let others = (0..2000).map(|k| 7.3 * f64::from(k).sin() * f64::from(k % 33 - 20).exp2());
        let ends = [0.0, -0.0, f64::MIN_POSITIVE];
        for rad in decimals.chain(others).chain(ends) {
            let (deg, apart) = Degrees::of_rad(rad);
            assert_eq!(deg.to_bits(), deg_of_rad(rad).to_bits(), "{rad:e}");
            assert_eq!(apart, Degrees::new(deg), "{rad:e}");
        }
    }
}
