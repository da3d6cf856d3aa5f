//! The instrument as the paper describes it, for the filter alone: the attitude as the product of
//! three turns, the axes of each gyro, whole filter periods.
//!
//! The dwell kernels have the attitude in closed form, and of the gyros a table of which component
//! of gravity multiplies which coefficient, and with which sign. Nothing of that is used here, so
//! that a slip in one is found by the other.

use crate::attitude::{Position, UP};
use crate::covariance::real::{Dense, Real, identity, product, zeros};
use crate::drift::COEFFICIENTS;

/// Coefficients of a gyro: D_F, D_I, D_O, D_S, in blocks of three gyros.
const GYROS: usize = 3;

/// Input, output and spin axis of a gyro in the platform, each a unit vector.
pub(crate) type GyroAxes = [[f64; 3]; 3];

/// What the filter takes for the instrument. Tests give it a wrong one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Instrument {
    /// The axes of gyro X, Y, Z.
    pub axes: [GyroAxes; GYROS],
    /// Splits a duration into whole periods and what is left, s.
    pub split: fn(f64, f64) -> (usize, f64),
    /// Turns about the outer, middle and inner axis, in the order of the product: 0 x, 1 y, 2 z.
    pub turns: [usize; 3],
}

impl Instrument {
    /// The paper's, section 2: I, O, S of gyro X are +x, −z, +y; of Y +y, −z, −x; of Z +z, +x, +y.
    /// Each is right-handed, I × O = S.
    pub const PAPER: Self = Self {
        axes: [
            [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
            [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]],
            [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        ],
        split: whole_periods,
        turns: [0, 1, 2],
    };

    /// C_c^n = Mx(α) My(β) Mz(γ), (19).
    pub fn attitude<T: Real>(&self, position: Position) -> Dense<T, 3, 3> {
        let angles = [position.alpha, position.beta, position.gamma];
        let [outer, middle, inner] = [0, 1, 2].map(|k| turn::<T>(self.turns[k], angles[k]));
        product(&product(&outer, &middle), &inner)
    }

    /// A: what each coefficient does to ε^n. Of gyro k, by (3),
    /// ε_k = D_F + D_I (I · g) + D_O (O · g) + D_S (S · g).
    pub fn drift_columns<T: Real>(&self, position: Position) -> Dense<T, 3, COEFFICIENTS> {
        let attitude = self.attitude::<T>(position);
        // Down, in the platform: minus the Up row of C_c^n.
        let gravity = attitude[UP].map(|v| -v);
        let mut in_platform = zeros::<T, 3, COEFFICIENTS>();
        for (gyro, axes) in self.axes.iter().enumerate() {
            in_platform[gyro][gyro] = T::from(1.0);
            for (kind, axis) in axes.iter().enumerate() {
                let along = axis.iter().zip(gravity);
                let along = along.fold(T::from(0.0), |sum, (a, g)| sum + T::from(*a) * g);
                in_platform[gyro][GYROS * (1 + kind) + gyro] = along;
            }
        }
        product(&attitude, &in_platform)
    }
}

/// Frame (passive) rotation about an axis: Mx, My or Mz of the paper.
fn turn<T: Real>(axis: usize, angle_rad: f64) -> Dense<T, 3, 3> {
    let (sin, cos) = sin_cos::<T>(angle_rad);
    let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut m = identity::<T, 3>();
    m[next][next] = cos;
    m[last][last] = cos;
    m[next][last] = sin;
    m[last][next] = -sin;
    m
}

/// π/2 in pieces of thirty bits, so that a whole number of times a piece is exact.
const QUARTER_TURN: [f64; 4] = [
    f64::from_bits(0x3ff921fb54000000),
    f64::from_bits(0x3e110b4611800000),
    f64::from_bits(0x3c2313198a000000),
    f64::from_bits(0x3a3701b839800000),
];

/// sin and cos: quarter turns taken off, then their series. A multiple of 90° is one, although
/// its radians have sixteen digits only.
fn sin_cos<T: Real>(angle_rad: f64) -> (T, T) {
    let quarters = (angle_rad / std::f64::consts::FRAC_PI_2).round();
    let mut x = T::from(angle_rad);
    for piece in QUARTER_TURN {
        x -= T::from(quarters) * T::from(piece);
    }
    if x.f64().abs() <= 2.0 * f64::EPSILON * angle_rad.abs() {
        x = T::from(0.0);
    }
    let (mut sin, mut cos) = (x, T::from(1.0));
    let (mut odd, mut even) = (x, T::from(1.0));
    let square = x * x;
    let mut k = 1.0;
    while even.f64().abs() > T::SMALLEST_TERM {
        even = -(even * square) / T::from(k * (k + 1.0));
        odd = -(odd * square) / T::from((k + 1.0) * (k + 2.0));
        cos += even;
        sin += odd;
        k += 2.0;
    }
    match quarters.rem_euclid(4.0) as u8 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Whole periods in a duration and what is left of it, s; a billionth of a period is nothing.
fn whole_periods(duration_s: f64, period_s: f64) -> (usize, f64) {
    const NOTHING: f64 = 1e-9;
    let mut count = (duration_s / period_s) as usize;
    let mut left_s = duration_s - count as f64 * period_s;
    if left_s >= (1.0 - NOTHING) * period_s {
        count += 1;
        left_s = 0.0;
    }
    match left_s < NOTHING * period_s {
        true => (count, 0.0),
        false => (count, left_s),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::covariance::real::Extended;
    use crate::covariance::split_periods;
    use crate::drift::drift_matrix;

    #[test]
    fn the_pieces_of_a_quarter_turn_are_all_of_it() {
        let sum = QUARTER_TURN
            .into_iter()
            .fold(Extended::from(0.0), |sum, piece| {
                sum + Extended::from(piece)
            });
        let exact = Extended::PI / Extended::from(2.0);
        assert!(
            (sum - exact).f64().abs() < 1e-31,
            "{:e}",
            (sum - exact).f64()
        );
        for piece in QUARTER_TURN {
            // Thirty bits: the last 23 of the mantissa are zero.
            assert_eq!(piece.to_bits() & ((1 << 22) - 1), 0, "{piece:e}");
        }
    }

    #[test]
    fn sines_have_the_digits_of_their_numbers() {
        for angle in [0.0, 1e-9, 0.3, -1.2, 2.5, 3.1, -40.0, 1000.3] {
            let (sin, cos) = sin_cos::<f64>(angle);
            let error = (sin - angle.sin()).abs().max((cos - angle.cos()).abs());
            assert!(error < 3e-16, "{angle}: {error:e}");
            let (sin, cos) = sin_cos::<Extended>(angle);
            assert!((sin.f64() - angle.sin()).abs() < 2e-16, "{angle}");
            let one = sin * sin + cos * cos - Extended::from(1.0);
            assert!(one.f64().abs() < 1e-30, "{angle}");
            // sin 3a = 3 sin a − 4 sin³ a.
            let triple = sin_cos::<Extended>(3.0 * angle).0;
            let expected = sin * Extended::from(3.0) - sin * sin * sin * Extended::from(4.0);
            // 3 a is rounded.
            let rounding = 3.0 * f64::EPSILON * angle.abs();
            assert!((triple - expected).f64().abs() <= rounding, "{angle}");
        }
        let degrees = |deg: f64| sin_cos::<f64>(deg.to_radians());
        assert_eq!(degrees(90.0), (1.0, 0.0));
        assert_eq!(degrees(-180.0), (0.0, -1.0));
        assert_eq!(degrees(630.0), (-1.0, 0.0));
    }

    /// What the filter has of its own is what the kernels have in another form.
    #[test]
    fn the_filters_instrument_is_that_of_the_kernels() {
        for k in 0..200 {
            let k = f64::from(k);
            let position = Position::from_deg(37.1 * k - 900.0, 61.7 * k - 2000.0, 11.9 * k * k);
            let own = Instrument::PAPER.drift_columns::<f64>(position);
            let theirs = drift_matrix(&position.attitude());
            for i in 0..3 {
                for j in 0..COEFFICIENTS {
                    // A dozen roundings each.
                    let error = (own[i][j] - theirs[(i, j)]).abs();
                    assert!(error < 3e-15, "{position:?}: {error:e}");
                }
            }
        }
        for axes in Instrument::PAPER.axes {
            let [i, o, s] = axes.map(nalgebra::Vector3::from);
            assert_eq!(i.cross(&o), s);
        }
        for duration_s in [
            0.0,
            3.0,
            10.0,
            999.999_999_999_9,
            1000.0,
            1003.7,
            1e6,
            7e7 + 0.5,
        ] {
            let (count, left_s) = whole_periods(duration_s, 10.0);
            let (expected, left) = split_periods(duration_s, 10.0);
            assert_eq!(count, expected, "{duration_s}");
            assert!((left_s - left).abs() < 1e-8, "{duration_s}");
        }
    }
}
