//! How fast the gimbals turn: a rate and an acceleration for each axis.
//!
//! In a move all gimbals go through the same share s of their way at the same time, so that they start
//! and arrive together. With R_i the rate and A_i the acceleration of axis i, and c_i its change,
//!
//! ```text
//! q = max |c_i| / R_i,   p = max |c_i| / A_i,   |ds/dt| ≤ 1/q,   |d²s/dt²| ≤ 1/p:
//! T = q + p/q where q² ≥ p: speeding up for p/q, then at the rate, then slowing down for p/q,
//! T = 2 √p    elsewhere:    half of the way speeding up, half of it slowing down.
//! ```
//!
//! A move that is given more time speeds up as fast and then goes slower: r (T − r) = p with r the time
//! that speeding up takes.

use super::AxisValue;
use crate::error::{Error, Result};
use crate::units::AngularRate;

/// Key of the rates.
const RATE: &str = "motion.slew_rate_deg_per_s";
/// Key of the accelerations.
const ACCELERATION: &str = "motion.acceleration_deg_per_s2";

/// A move is the quickest possible when it is longer by no more than rounding.
const SAME_DURATION: f64 = 1e-12;

/// How fast the gimbals can turn, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlewLimits {
    /// Greatest rate of (α, β, γ), rad/s.
    pub rate_rad_per_s: [f64; 3],
    /// Acceleration of (α, β, γ), rad/s²; none: they are at their rate at once.
    pub acceleration_rad_per_s2: Option<[f64; 3]>,
}

/// How the share of a move's duration that speeding up takes, depends on the move.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct RampSlopes {
    /// By its duration, its change held, 1/s; 0 for the quickest move, which has no choice of one.
    pub by_duration: f64,
    /// By the change of (α, β, γ), 1/rad.
    pub by_change: [f64; 3],
}

/// The axis that asks for most, and what it asks for.
#[derive(Clone, Copy)]
struct Greatest {
    value: f64,
    axis: usize,
    /// By the change of that axis.
    slope: f64,
}

impl Greatest {
    fn of(change: &[f64; 3], limit: &[f64; 3]) -> Self {
        let mut greatest = Self {
            value: 0.0,
            axis: 0,
            slope: 0.0,
        };
        for (axis, (change, limit)) in change.iter().zip(limit).enumerate() {
            let value = change.abs() / limit;
            if value > greatest.value {
                greatest = Self {
                    value,
                    axis,
                    slope: change.signum() / limit,
                };
            }
        }
        greatest
    }
}

/// As it was written.
fn shown(value: AxisValue) -> String {
    match value {
        AxisValue::All(v) => v.to_string(),
        AxisValue::PerAxis([a, b, g]) => format!("[{a}, {b}, {g}]"),
    }
}

/// Refuses what no gimbal has.
fn check_each(key: &str, value: AxisValue, left_out: &str) -> Result<()> {
    let is_right = |v: &f64| (1e-6..=1e6).contains(v);
    match value.to_array().iter().all(is_right) {
        true => Ok(()),
        false => {
            let allowed = format!("1e-6 to 1e6, or left out: {left_out}");
            Err(Error::out_of_range(key, shown(value), &allowed))
        }
    }
}

impl SlewLimits {
    pub(super) fn check(
        rate: Option<AxisValue>,
        acceleration: Option<AxisValue>,
    ) -> Result<Option<Self>> {
        let Some(rate) = rate else {
            return match acceleration {
                None => Ok(None),
                Some(given) => Err(Error::input("an acceleration needs a rate to reach")
                    .with_key(ACCELERATION)
                    .with_value(shown(given))
                    .with_allowed(format!("left out, or {RATE} beside it"))),
            };
        };
        check_each(RATE, rate, "moves take no time")?;
        if let Some(acceleration) = acceleration {
            check_each(
                ACCELERATION,
                acceleration,
                "gimbals are at their rate at once",
            )?;
        }
        let in_rad = |values: AxisValue| {
            let values = values.to_array();
            values.map(|deg| AngularRate::from_deg_per_s(deg).rad_per_s())
        };
        Ok(Some(Self {
            rate_rad_per_s: in_rad(rate),
            acceleration_rad_per_s2: acceleration.map(in_rad),
        }))
    }

    /// Whether the axis that turns most is the one that takes longest: equal limits on all axes.
    pub(crate) fn are_alike(&self) -> bool {
        let alike = |limit: [f64; 3]| limit.iter().all(|l| *l == limit[0]);
        alike(self.rate_rad_per_s) && self.acceleration_rad_per_s2.is_none_or(alike)
    }

    fn q(&self, change: &[f64; 3]) -> Greatest {
        Greatest::of(change, &self.rate_rad_per_s)
    }

    fn p(&self, change: &[f64; 3]) -> Option<Greatest> {
        let acceleration = self.acceleration_rad_per_s2.as_ref()?;
        Some(Greatest::of(change, acceleration)).filter(|p| p.value > 0.0)
    }

    /// The shortest time in which the gimbals turn by `change`, rad, starting and ending at rest, s.
    pub fn shortest_s(&self, change: &[f64; 3]) -> f64 {
        let q = self.q(change).value;
        match self.p(change).map(|p| p.value) {
            None => q,
            Some(p) if q * q >= p => q + p / q,
            Some(p) => 2.0 * p.sqrt(),
        }
    }

    /// Its derivative by the change of each axis, s/rad; of the axis that takes longest where two do.
    pub(crate) fn shortest_slope(&self, change: &[f64; 3]) -> [f64; 3] {
        let q = self.q(change);
        let mut slope = [0.0; 3];
        match self.p(change) {
            None => slope[q.axis] = q.slope,
            Some(p) if q.value * q.value >= p.value => {
                slope[q.axis] += q.slope * (1.0 - p.value / (q.value * q.value));
                slope[p.axis] += p.slope / q.value;
            }
            Some(p) => slope[p.axis] = p.slope / p.value.sqrt(),
        }
        slope
    }

    /// Whether `duration_s` is the shortest time, or less.
    fn is_shortest(&self, change: &[f64; 3], duration_s: f64) -> bool {
        duration_s <= self.shortest_s(change) * (1.0 + SAME_DURATION)
    }

    /// Which share of a move's duration the gimbals speed up, and again slow down: 0 to ½.
    pub(crate) fn ramp(&self, change: &[f64; 3], duration_s: f64) -> f64 {
        let Some(p) = self.p(change).map(|p| p.value) else {
            return 0.0;
        };
        if self.is_shortest(change, duration_s) {
            let q = self.q(change).value;
            return match q * q >= p {
                true => p / (q * q + p),
                false => 0.5,
            };
        }
        // ρ (1 − ρ) = p/T², its smaller solution, without a difference of equal numbers.
        let x = 4.0 * p / (duration_s * duration_s);
        0.5 * x / (1.0 + (1.0 - x).max(0.0).sqrt())
    }

    /// How that depends on the move.
    pub(crate) fn ramp_slopes(&self, change: &[f64; 3], duration_s: f64) -> RampSlopes {
        let mut slopes = RampSlopes::default();
        let Some(p) = self.p(change) else {
            return slopes;
        };
        if self.is_shortest(change, duration_s) {
            let q = self.q(change);
            let square = q.value * q.value;
            if square >= p.value {
                let sum = square + p.value;
                slopes.by_change[p.axis] += p.slope * square / (sum * sum);
                slopes.by_change[q.axis] -= q.slope * 2.0 * p.value * q.value / (sum * sum);
            }
            return slopes;
        }
        let square = duration_s * duration_s;
        let rest = (1.0 - 4.0 * p.value / square).max(0.0).sqrt();
        if rest > 0.0 {
            slopes.by_change[p.axis] = p.slope / (square * rest);
            slopes.by_duration = -2.0 * p.value / (square * duration_s * rest);
        }
        slopes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::assert_refused_by_key;

    fn limits(rate: [f64; 3], acceleration: Option<[f64; 3]>) -> SlewLimits {
        let acceleration = acceleration.map(AxisValue::PerAxis);
        SlewLimits::check(Some(AxisValue::PerAxis(rate)), acceleration)
            .unwrap()
            .unwrap()
    }

    fn rad(deg: [f64; 3]) -> [f64; 3] {
        deg.map(f64::to_radians)
    }

    #[test]
    fn the_slowest_axis_decides() {
        let l = limits([0.5, 1.0, 2.0], None);
        for (change, expected_s) in [
            ([30.0, 0.0, 0.0], 60.0),
            ([30.0, -90.0, 0.0], 90.0),
            ([30.0, 50.0, -170.0], 85.0),
            ([0.0; 3], 0.0),
        ] {
            let found = l.shortest_s(&rad(change));
            assert!((found - expected_s).abs() < 1e-9, "{change:?}: {found}");
            assert_eq!(l.ramp(&rad(change), found), 0.0);
        }
        assert!(!l.are_alike());
        assert!(limits([0.5; 3], Some([0.1; 3])).are_alike());
        assert!(!limits([0.5; 3], Some([0.1, 0.2, 0.1])).are_alike());
    }

    #[test]
    fn long_moves_reach_the_rate_and_short_ones_do_not() {
        let l = limits([0.5, 1.0, 2.0], Some([0.1, 0.2, 0.2]));
        // 60° at 0.5 °/s, 5 s to reach it: 120 s and once more 5 s.
        let long = rad([60.0, 0.0, 0.0]);
        assert!((l.shortest_s(&long) - 125.0).abs() < 1e-9);
        assert!((l.ramp(&long, 125.0 + 1e-14) - 5.0 / 125.0).abs() < 1e-12);
        // 1° at 0.1 °/s²: √10 s speeding up, √10 s slowing down.
        let short = rad([1.0, 0.0, 0.0]);
        let found = l.shortest_s(&short);
        assert!((found - 2.0 * 10.0_f64.sqrt()).abs() < 1e-9);
        assert_eq!(l.ramp(&short, found), 0.5);
        // One axis asks for the rate, another for the acceleration.
        let both = rad([20.0, 0.0, 100.0]);
        let (q, p) = (50.0, 500.0);
        assert!((l.shortest_s(&both) - (q + p / q)).abs() < 1e-9);
    }

    #[test]
    fn more_time_keeps_the_acceleration() {
        let l = limits([0.5; 3], Some([0.1; 3]));
        let change = rad([10.0, -4.0, 0.0]);
        for duration_s in [25.0, 30.0, 100.0, 4000.0] {
            let ramp_s = l.ramp(&change, duration_s) * duration_s;
            // Acceleration of the slowest axis: c/(r (T − r)).
            let acceleration = 10.0 / (ramp_s * (duration_s - ramp_s));
            assert!(
                (acceleration - 0.1).abs() < 1e-9,
                "{duration_s}: {acceleration}"
            );
        }
    }

    #[test]
    fn slopes_are_differences() {
        let l = limits([0.5, 1.0, 2.0], Some([0.1, 0.2, 0.05]));
        for deg in [
            [60.0, 20.0, -5.0],
            [-1.0, 0.5, 0.1],
            [20.0, -7.0, 100.0],
            [3.0, -160.0, 30.0],
        ] {
            let change = rad(deg);
            let shortest_s = l.shortest_s(&change);
            let slope = l.shortest_slope(&change);
            for axis in 0..3 {
                let at = |by: f64, of: &dyn Fn(&[f64; 3]) -> f64| {
                    let mut moved = change;
                    moved[axis] += by;
                    of(&moved)
                };
                let difference =
                    |of: &dyn Fn(&[f64; 3]) -> f64| (at(1e-6, of) - at(-1e-6, of)) / 2e-6;
                let by_time = difference(&|c| l.shortest_s(c));
                assert!((by_time - slope[axis]).abs() < 1e-5 * (1.0 + by_time.abs()));
                // The quickest move, and a slower one.
                let quickest = l.ramp_slopes(&change, shortest_s);
                let by_ramp = difference(&|c| l.ramp(c, l.shortest_s(c)));
                assert!((by_ramp - quickest.by_change[axis]).abs() < 1e-6, "{deg:?}");
                let slower_s = 1.3 * shortest_s;
                let slower = l.ramp_slopes(&change, slower_s);
                let by_ramp = difference(&|c| l.ramp(c, slower_s));
                assert!((by_ramp - slower.by_change[axis]).abs() < 1e-6, "{deg:?}");
                let longer =
                    (l.ramp(&change, slower_s + 1e-4) - l.ramp(&change, slower_s - 1e-4)) / 2e-4;
                assert!((longer - slower.by_duration).abs() < 1e-7);
            }
        }
    }

    #[test]
    fn what_no_stand_has_is_refused_by_name() {
        let check = |rate, acceleration| SlewLimits::check(rate, acceleration);
        let all = |v| Some(AxisValue::All(v));
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e7] {
            assert_refused_by_key(&check(all(wrong), None).unwrap_err(), RATE);
            let each = Some(AxisValue::PerAxis([1.0, wrong, 1.0]));
            assert_refused_by_key(&check(each, None).unwrap_err(), RATE);
            assert_refused_by_key(&check(all(1.0), each).unwrap_err(), ACCELERATION);
        }
        assert_refused_by_key(&check(None, all(1.0)).unwrap_err(), ACCELERATION);
        assert_eq!(check(None, None).unwrap(), None);
    }
}
