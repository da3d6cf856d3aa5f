//! What limits a test, as documents have it.

use std::fmt;

use serde::{Deserialize, Serialize};

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
    /// Twice as large: from, to.
    Doubled(f64, f64),
    /// A tenth more: from, to.
    TenthMore(f64, f64),
    /// Something measured with this noise, arcsec, that is not there.
    Added(f64),
    /// So many degrees more at each end.
    Wider(f64),
    /// What the filter does not know of becomes one of its states.
    Estimated,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Halved(from, to) => write!(f, "halved, {from} to {to}"),
            Self::Doubled(from, to) => write!(f, "doubled, {from} to {to}"),
            Self::TenthMore(from, to) => write!(f, "a tenth more, {from} to {to}"),
            Self::Added(noise) => write!(f, "a reference of {noise} arcsec"),
            Self::Wider(deg) => write!(f, "{deg} deg wider at each end"),
            Self::Estimated => write!(f, "estimated by the filter"),
        }
    }
}
