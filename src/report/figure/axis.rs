//! Ranges and ticks of an axis.

/// A range of values and the distance of its ticks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axis {
    low: f64,
    high: f64,
    step: f64,
}

/// About how many ticks an axis has.
const TICKS: f64 = 5.0;

impl Axis {
    /// From the smallest of `values` to the largest.
    pub fn tight(values: impl Iterator<Item = f64>) -> Self {
        Self::around(values, 0.0)
    }

    /// The same with some space on either side.
    pub fn loose(values: impl Iterator<Item = f64>) -> Self {
        Self::around(values, 0.06)
    }

    fn around(values: impl Iterator<Item = f64>, margin: f64) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for v in values.filter(|v| v.is_finite()) {
            low = low.min(v);
            high = high.max(v);
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        // A constant, up to rounding, still needs some height.
        let least = 1e-9 * low.abs().max(high.abs());
        if high - low <= least {
            let half = 0.05 * low.abs().max(f64::MIN_POSITIVE.sqrt());
            (low, high) = (low - half, high + half);
        }
        let space = margin * (high - low);
        (low, high) = (low - space, high + space);
        Self {
            low,
            high,
            step: nice((high - low) / TICKS),
        }
    }

    /// Where `value` lies, 0 at the low end and 1 at the high end.
    pub fn fraction(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    /// Values of the ticks and their texts.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        let decimals = (-self.step.log10().floor()).max(0.0) as usize;
        let first = (self.low / self.step - 1e-6).ceil() as i64;
        let last = (self.high / self.step + 1e-6).floor() as i64;
        (first..=last)
            .map(|i| {
                let value = i as f64 * self.step;
                let text = if decimals > 6 || value.abs() >= 1e6 {
                    format!("{value:.1e}")
                } else {
                    format!("{value:.decimals$}")
                };
                // A proper minus sign.
                (value, text.replace('-', "\u{2212}"))
            })
            .collect()
    }
}

/// 1, 2 or 5 times a power of ten, at or above `step`.
fn nice(step: f64) -> f64 {
    let power = 10.0_f64.powf(step.log10().floor());
    let factor = step / power;
    let chosen = [1.0, 2.0, 5.0]
        .into_iter()
        .find(|c| factor <= c * 1.000_001);
    power * chosen.unwrap_or(10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_inside_the_range() {
        let axis = Axis::tight([0.0, 2000.0].into_iter());
        let texts: Vec<String> = axis.ticks().into_iter().map(|t| t.1).collect();
        assert_eq!(texts, ["0", "500", "1000", "1500", "2000"]);
        let axis = Axis::tight([-0.00031, 0.00042].into_iter());
        let texts: Vec<String> = axis.ticks().into_iter().map(|t| t.1).collect();
        assert_eq!(texts, ["−0.0002", "0.0000", "0.0002", "0.0004"]);
    }

    #[test]
    fn a_constant_has_a_range_around_it() {
        for v in [0.0, 5.0, -1e-9] {
            let axis = Axis::loose([v, v].into_iter());
            assert!((axis.fraction(v) - 0.5).abs() < 1e-9);
            assert!(axis.ticks().len() < 20);
        }
    }
}
