//! The work of a search, as documents have it.

use serde::{Deserialize, Serialize};

use crate::search::Counters;
pub use crate::search::RefinementCounters;

/// How much work a search did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct CounterRecord {
    /// Values of schedules computed without gradient.
    pub evaluations: u64,
    /// Values computed with gradient.
    pub gradients: u64,
    /// Starts worked through.
    pub starts: u64,
    /// How the refinements (L-BFGS, each from one plan) ended; absent in documents of versions that
    /// did not count them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refinements: Option<RefinementCounters>,
}

impl From<&Counters> for CounterRecord {
    fn from(c: &Counters) -> Self {
        Self {
            evaluations: c.evaluations,
            gradients: c.gradients,
            starts: c.starts,
            refinements: Some(c.refinements),
        }
    }
}
