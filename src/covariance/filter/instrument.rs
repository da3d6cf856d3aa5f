//! The instrument for the filter alone: the attitude as the product of three turns, the axes of each
//! gyro, what the parameters do, whole filter periods.
//!
//! The dwell kernels have the attitude in closed form, and of the parameters a table of which feature
//! multiplies which, and with which factor. Nothing of that is used here, so that a slip in one is
//! found by the other.

use super::terms::Term;
use crate::attitude::{Degrees, NanoDegrees, Position, UP};
use crate::covariance::real::{Dense, Real, identity, product};
use crate::model::{GyroAxes, Parameter};
use crate::platform::Platform;

const GYROS: usize = 3;

/// Three rows on the parameters.
pub(super) type Drive<T> = [Vec<T>; 3];

/// What the filter takes for the instrument. Tests give it a wrong one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Instrument {
    /// The axes of gyro X, Y, Z.
    pub axes: [GyroAxes; GYROS],
    /// Splits a duration into whole periods and what is left, s.
    pub split: fn(f64, f64) -> (usize, f64),
    /// Axes of the platform that the outer, middle and inner gimbal turn about, right-handed.
    pub gimbals: [[f64; 3]; 3],
    /// Heading of the base, and its tilts about x and z.
    pub base: [Degrees; 3],
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
        gimbals: [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        base: [LEVEL; 3],
    };

    /// C_c^n = C_b^n Rot(a₁, α) Rot(a₂, β) Rot(a₃, γ); the paper's is Mx(α) My(β) Mz(γ), (19).
    pub fn attitude<T: Real>(&self, position: Position) -> Dense<T, 3, 3> {
        let angles = position.exact();
        let [outer, middle, inner] = [0, 1, 2].map(|k| turn::<T>(&self.gimbals[k], angles[k]));
        let on_base = product(&product(&outer, &middle), &inner);
        if self.base == [LEVEL; 3] {
            return on_base;
        }
        let about = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        let [heading, tilt_x, tilt_z] = [0, 1, 2].map(|k| turn::<T>(&about[k], self.base[k]));
        product(&product(&product(&heading, &tilt_x), &tilt_z), &on_base)
    }

    /// That of `platform`.
    pub fn of(platform: &Platform) -> Self {
        Self {
            axes: *platform.errors.mounting().axes(),
            gimbals: platform.stand.axes().map(|axis| axis.vector().into()),
            base: platform.stand.base_angles(),
            ..Self::PAPER
        }
    }

    /// ω_nc^c, where the angles at `angles` change by `change` in the unit of time.
    pub fn gimbal_rate<T: Real>(&self, angles: [Degrees; 3], change: [T; 3]) -> [T; 3] {
        let [_, middle, inner] = [0, 1, 2].map(|k| turn::<T>(&self.gimbals[k], angles[k]));
        let both = product(&middle, &inner);
        // Of C = C_b R1 R2 R3, dR = R [a ×] dθ: ω = θ̇1 (R2 R3)ᵀ a1 + θ̇2 R3ᵀ a2 + θ̇3 a3.
        let [outer_axis, middle_axis, inner_axis] = self.gimbals.map(|axis| axis.map(T::from));
        let pulled = |turn: &Dense<T, 3, 3>, axis: &[T; 3], i: usize| {
            let parts = turn.iter().zip(axis);
            parts.fold(T::from(0.0), |sum, (row, a)| sum + row[i] * *a)
        };
        std::array::from_fn(|i| {
            change[0] * pulled(&both, &outer_axis, i)
                + change[1] * pulled(&inner, &middle_axis, i)
                + change[2] * inner_axis[i]
        })
    }
}

/// The parameters as the filter takes them.
pub(super) struct Terms<T>(Vec<(Term, T)>);

impl<T: Real> Terms<T> {
    /// None where a name says nothing.
    pub fn new(parameters: &[Parameter]) -> Option<Self> {
        let term = |p: &Parameter| {
            let unit = T::from(p.unit.in_filter_units());
            Term::of(p.name).map(|term| (term, unit))
        };
        parameters.iter().map(term).collect::<Option<_>>().map(Self)
    }

    /// Whether any is of the accelerometers.
    pub fn has_accelerometers(&self) -> bool {
        self.0.iter().any(|(term, _)| term.is_of_accelerometers())
    }

    /// Whether any is of the torquers.
    pub fn has_torquers(&self) -> bool {
        self.0.iter().any(|(term, _)| term.is_of_torquers())
    }

    /// A: what each parameter does to ε^n at an attitude where the commanded rate is `rate` in the
    /// platform; what is no rate counts `times`.
    pub fn drift(
        &self,
        axes: &[GyroAxes; GYROS],
        attitude: &Dense<T, 3, 3>,
        rate: &[T; 3],
        times: T,
    ) -> Drive<T> {
        // Down, in the platform: minus the Up row of C_c^n.
        let gravity = attitude[UP].map(|v| -v);
        self.turned(attitude, |term| term.drift(axes, &gravity, rate, times))
    }

    /// δZ^n of each parameter at an attitude.
    pub fn output(&self, attitude: &Dense<T, 3, 3>) -> Drive<T> {
        self.turned(attitude, |term| term.output(&attitude[UP]))
    }

    fn turned(&self, attitude: &Dense<T, 3, 3>, of: impl Fn(Term) -> [T; 3]) -> Drive<T> {
        let in_platform: Vec<[T; 3]> = self
            .0
            .iter()
            .map(|(term, unit)| of(*term).map(|v| v * *unit))
            .collect();
        attitude.map(|row| {
            let along = |v: &[T; 3]| {
                let parts = row.iter().zip(v);
                parts.fold(T::from(0.0), |sum, (c, v)| sum + *c * *v)
            };
            in_platform.iter().map(along).collect()
        })
    }
}

/// No heading, no tilt.
const LEVEL: Degrees = Degrees {
    nano: NanoDegrees::new(0),
    rest_deg: 0.0,
};

/// Rot(a, θ) by the formula of Rodrigues, a aᵀ + cos θ (1 − a aᵀ) + sin θ [a×], a of unit length; about
/// −x, −y and −z the paper's Mx, My, Mz.
fn turn<T: Real>(axis: &[f64; 3], angle: Degrees) -> Dense<T, 3, 3> {
    let (sin, cos) = sin_cos::<T>(angle);
    let a = axis.map(T::from);
    let zero = T::from(0.0);
    let cross = [
        [zero, -a[2], a[1]],
        [a[2], zero, -a[0]],
        [-a[1], a[0], zero],
    ];
    let one = identity::<T, 3>();
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let along = a[i] * a[j];
            along + cos * (one[i][j] - along) + sin * cross[i][j]
        })
    })
}

/// π/2 in two doubles: 106 bits.
const QUARTER_TURN: [f64; 2] = [
    f64::from_bits(0x3ff921fb54442d18),
    f64::from_bits(0x3c91a62633145c07),
];

/// 90° in 1e-9°.
const RIGHT_ANGLE: i64 = 90_000_000_000;

/// sin and cos of an angle as it was given, in whole 1e-9° and a rest: the nearest right angle is
/// taken off in whole numbers, what is left becomes a fraction of π/2, and then their series.
fn sin_cos<T: Real>(angle: Degrees) -> (T, T) {
    let given = angle.nano.count();
    let quarters = (given as f64 / RIGHT_ANGLE as f64).round() as i64;
    let left = T::from((given - quarters * RIGHT_ANGLE) as f64) / T::from(RIGHT_ANGLE as f64);
    let left = left + T::from(angle.rest_deg) / T::from(90.0);
    let x = left * (T::from(QUARTER_TURN[0]) + T::from(QUARTER_TURN[1]));
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
    match quarters.rem_euclid(4) {
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
    use crate::drift::{COEFFICIENTS, drift_matrix};
    use crate::platform::PlatformConfig;

    #[test]
    fn the_parts_of_a_quarter_turn_are_all_of_it() {
        let sum = Extended::from(QUARTER_TURN[0]) + Extended::from(QUARTER_TURN[1]);
        let error = (sum - Extended::PI / Extended::from(2.0)).f64();
        assert!(error.abs() < 1e-31, "{error:e}");
    }

    #[test]
    fn sines_have_the_digits_of_their_numbers() {
        for deg in [0.0, 1e-7, 17.3, -68.7, 143.2, 177.6, -2291.8, 35_999.999] {
            let (angle, rad) = (Degrees::new(deg), f64::to_radians(deg));
            let (sin, cos) = sin_cos::<f64>(angle);
            let error = (sin - rad.sin()).abs().max((cos - rad.cos()).abs());
            // The radians themselves are rounded.
            assert!(error < 3e-16 * rad.abs().max(1.0), "{deg}: {error:e}");
            let (sin, cos) = sin_cos::<Extended>(angle);
            let one = sin * sin + cos * cos - Extended::from(1.0);
            assert!(one.f64().abs() < 1e-30, "{deg}");
            // sin 3a = 3 sin a − 4 sin³ a; three times the decimal is one.
            let triple = sin_cos::<Extended>(angle + angle + angle).0;
            let expected = sin * Extended::from(3.0) - sin * sin * sin * Extended::from(4.0);
            assert!((triple - expected).f64().abs() < 1e-29, "{deg}");
        }
        let degrees = |deg: f64| sin_cos::<f64>(Degrees::new(deg));
        assert_eq!(degrees(90.0), (1.0, 0.0));
        assert_eq!(degrees(-180.0), (0.0, -1.0));
        assert_eq!(degrees(630.0), (-1.0, 0.0));
    }

    /// What the filter has of its own is what the kernels have in another form.
    #[test]
    fn the_filters_instrument_is_that_of_the_kernels() {
        let platform = PlatformConfig::default().check().unwrap();
        let terms = Terms::<f64>::new(platform.errors.parameters()).unwrap();
        for k in 0..200 {
            let k = f64::from(k);
            let position = Position::from_deg(37.1 * k - 900.0, 61.7 * k - 2000.0, 11.9 * k * k);
            let attitude = Instrument::PAPER.attitude::<f64>(position);
            let own = terms.drift(&Instrument::PAPER.axes, &attitude, &[0.0; 3], 1.0);
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

    /// Against the difference of two attitudes: Ċ_c^n = C_c^n [ω_nc^c ×].
    #[test]
    fn the_gimbals_turn_the_platform() {
        let degrees = |a: [f64; 3]| a.map(Degrees::new);
        let attitude = |a: [f64; 3]| {
            let c = Instrument::PAPER.attitude::<f64>(Position::from_deg(a[0], a[1], a[2]));
            nalgebra::Matrix3::from_fn(|i, j| c[i][j])
        };
        let (angles, rate) = ([20.0, -70.0, 130.0], [0.3, -0.8, 0.5]);
        let h: f64 = 1e-4;
        let at = |s: f64| attitude(std::array::from_fn(|i| angles[i] + s * rate[i]));
        let slope = (at(h) - at(-h)) / (2.0 * h.to_radians());
        let turning = nalgebra::Vector3::from(Instrument::PAPER.gimbal_rate(degrees(angles), rate));
        let expected = attitude(angles) * turning.cross_matrix();
        assert!((slope - expected).amax() < 1e-9);
    }
}
