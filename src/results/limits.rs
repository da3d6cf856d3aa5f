//! What limits a test, as documents have it.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::platform::AxisValue;

/// What the criterion of the schedule would be if one thing were better, the total time being the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct LimitRecord {
    /// What is changed: a key of the platform file.
    pub what: String,
    /// How, in words.
    pub change: String,
    /// The criterion with the change as a ratio to that without: less than 1 is better.
    pub criterion_ratio: f64,
}

impl LimitRecord {
    pub(crate) fn new(what: String, change: Change, criterion_ratio: f64) -> Self {
        Self {
            what,
            change: change.to_string(),
            criterion_ratio,
        }
    }
}

/// How something is changed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Change {
    /// Half as large: from, to.
    Halved(f64, f64),
    /// Twice as large, for all axes or axis by axis: from, to.
    Doubled(AxisValue, AxisValue),
    /// A tenth more: from, to.
    TenthMore(f64, f64),
    /// Something measured with this noise, arcsec, that is not there.
    Added(f64),
    /// So many degrees more at each end.
    Wider(f64),
    /// What the filter does not know of becomes one of its states.
    Estimated,
}

impl Change {
    /// Twice as large.
    pub fn doubled(value: AxisValue) -> Self {
        Self::Doubled(value, value.map(|v| 2.0 * v))
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let change = |f: &mut fmt::Formatter<'_>, how: &str, from: f64, to: f64| {
            write!(f, "{how}, {} to {}", plain(from), plain(to))
        };
        match *self {
            Self::Halved(from, to) => change(f, "halved", from, to),
            Self::Doubled(AxisValue::All(from), AxisValue::All(to)) => {
                change(f, "doubled", from, to)
            }
            Self::Doubled(from, to) => {
                let list = |of: AxisValue| of.to_array().map(plain).join(", ");
                write!(f, "doubled, [{}] to [{}]", list(from), list(to))
            }
            Self::TenthMore(from, to) => change(f, "a tenth more", from, to),
            Self::Added(noise) => write!(f, "a reference of {noise} arcsec"),
            Self::Wider(deg) => write!(f, "{deg} deg wider at each end"),
            Self::Estimated => write!(f, "estimated by the filter"),
        }
    }
}

/// A number of a platform file as a person would write it, without the roundings of a product.
fn plain(value: f64) -> String {
    let digits = format!("{value:.5e}");
    let value: f64 = digits.parse().unwrap_or(value);
    match value != 0.0 && value.abs() < 1e-3 {
        true => format!("{value:e}"),
        false => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_said_as_a_person_would() {
        for (change, said) in [
            (Change::Halved(1e-5, 5e-6), "halved, 1e-5 to 5e-6"),
            (
                Change::TenthMore(12_000.0, 1.1 * 12_000.0),
                "a tenth more, 12000 to 13200",
            ),
            (Change::doubled(0.5.into()), "doubled, 0.5 to 1"),
            (
                Change::doubled(AxisValue::PerAxis([0.5, 0.1, 2.0])),
                "doubled, [0.5, 0.1, 2] to [1, 0.2, 4]",
            ),
            (Change::Added(20.0), "a reference of 20 arcsec"),
        ] {
            assert_eq!(change.to_string(), said);
        }
    }
}
