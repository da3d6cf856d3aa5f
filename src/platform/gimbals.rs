//! What the gimbals allow: ranges and index tables, decided in the 1e-9° that files carry.

use std::ops::RangeInclusive;

use crate::attitude::{NanoDegrees, decimal, deg_of_rad};
use crate::units::round_deg;

/// The range of one gimbal, rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GimbalRange {
    /// Smallest angle, rad.
    pub low_rad: f64,
    /// Largest angle, rad.
    pub high_rad: f64,
}

/// The gimbals, checked: one range per axis (none: unlimited), and the index step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Gimbals {
    /// Ranges of α, β, γ.
    pub ranges: [Option<GimbalRange>; 3],
    /// Step of an index table, rad.
    pub step_rad: Option<f64>,
}

impl GimbalRange {
    /// Its ends in the 1e-9° that files carry, which decide what lies within.
    pub(crate) fn ends(&self) -> RangeInclusive<NanoDegrees> {
        let nano = |rad| NanoDegrees::nearest(deg_of_rad(rad));
        nano(self.low_rad)..=nano(self.high_rad)
    }

    /// Whether an angle, degrees, lies within.
    fn contains(&self, deg: f64) -> bool {
        !deg.is_nan() && self.ends().contains(&NanoDegrees::nearest(deg))
    }
}

impl Gimbals {
    /// Step of an index table, degrees.
    pub(crate) fn step_deg(&self) -> Option<f64> {
        self.step_rad.map(deg_of_rad)
    }

    /// What is allowed on `axis`, in words, if the angle (degrees) is not.
    pub(crate) fn refusal(&self, axis: usize, deg: f64) -> Option<String> {
        if let Some(range) = self.ranges[axis]
            && !range.contains(deg)
        {
            let (low, high) = range.ends().into_inner();
            let (low, high) = (low.deg(), high.deg());
            return Some(format!("the gimbal's range {low} to {high}"));
        }
        let step = self.step_deg()?;
        if is_multiple(step, deg) {
            return None;
        }
        let step = round_deg(step);
        Some(format!("multiples of gimbals.step_deg = {step}"))
    }

    /// Whether `axis` can be set to an angle: [`Gimbals::refusal`] without its words, which a search
    /// does not read.
    pub(crate) fn allows(&self, axis: usize, deg: f64) -> bool {
        let within = self.ranges[axis].is_none_or(|range| range.contains(deg));
        within && self.step_deg().is_none_or(|step| is_multiple(step, deg))
    }

    /// The settings of an axis on an index table, degrees: the multiples of the step within the
    /// range, or on an unlimited axis in (−180°, 180°]; none without a table. Sorted.
    pub(crate) fn settings_deg(&self, axis: usize) -> Option<impl ExactSizeIterator<Item = f64>> {
        let step = self.step_deg()?;
        let half = NanoDegrees::HALF_TURN;
        let ends = self.ranges[axis].map_or(NanoDegrees::new(1) - half..=half, |r| r.ends());
        Some(multiples(step, ends).map(move |k| decimal(f64::from(k) * step)))
    }
}

/// Whether an angle is a multiple of the step, as a file can hold it.
fn is_multiple(step: f64, deg: f64) -> bool {
    let off = (deg - step * (deg / step).round()).abs();
    off.is_nan() || off <= 0.5e-9 + 8.0 * f64::EPSILON * deg.abs()
}

/// The multiples of `step` degrees within a range, as numbers of steps.
pub(crate) fn multiples(step: f64, ends: RangeInclusive<NanoDegrees>) -> std::ops::Range<i32> {
    // A multiple lies within when it does in the 1e-9° that files carry. Ranges end at a hundred
    // turns and steps are a tenth of a degree at least.
    let (low, high) = (ends.start().deg() / step, ends.end().deg() / step);
    let within = |k: &i32| ends.contains(&NanoDegrees::nearest(f64::from(*k) * step));
    let near = |at: f64| (at.floor() as i32 - 1)..=(at.ceil() as i32 + 1);
    match (near(low).find(within), near(high).rev().find(within)) {
        (Some(first), Some(last)) => first..last + 1,
        _ => 0..0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::PlatformConfig;

    #[test]
    fn ranges_and_tables_are_decided_in_the_decimals_of_files() {
        let mut config = PlatformConfig::default();
        config.gimbals.alpha_deg = Some([-60.1, 213.3]);
        let limited = *config.check().unwrap().gimbals();
        for (deg, allowed) in [
            (-60.1, true),
            (213.3, true),
            (f64::to_degrees(213.3_f64.to_radians()), true),
            (-60.100_000_001, false),
            (213.300_000_001, false),
            (f64::NAN, false),
        ] {
            assert_eq!(limited.refusal(0, deg).is_none(), allowed, "{deg}");
        }
        for step in [0.1, 0.7, 7.5, 15.0, 360.0 / 7.0, 180.0] {
            config.gimbals.step_deg = Some(step);
            config.gimbals.alpha_deg = None;
            config.gimbals.gamma_deg = Some([-2.0 * step, 4.0 * step]);
            let table = *config.check().unwrap().gimbals();
            for k in -100..=100 {
                let multiple = f64::from(k) * step;
                for deg in [multiple, round_deg(multiple)] {
                    assert_eq!(table.refusal(0, deg), None, "{step}: {deg}");
                }
                let beside = round_deg(multiple) + 1.1e-9;
                assert!(table.refusal(0, beside).is_some(), "{step}: {beside}");
            }
            let settings: Vec<f64> = table.settings_deg(0).unwrap().collect();
            assert!(settings.iter().all(|deg| table.refusal(0, *deg).is_none()));
            assert!(settings[0] > -180.0 && settings[settings.len() - 1] <= 180.0);
            let turn = (360.0 / step).round();
            if turn * step == 360.0 {
                assert_eq!(settings.len() as f64, turn, "{step}");
            }
            assert_eq!(table.settings_deg(2).unwrap().len(), 7);
        }
    }
}
