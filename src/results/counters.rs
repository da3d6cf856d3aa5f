//! The work of a search, as documents have it.

use serde::{Deserialize, Serialize};

use crate::search::{Counters, RefinementCounters};

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
    pub refinements: Option<RefinementRecord>,
}

/// How many refinements ended in which way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct RefinementRecord {
    /// The gradient became shorter than its tolerance.
    pub gradient_converged: u64,
    /// An iteration gained less than the cost tolerance.
    pub cost_converged: u64,
    /// All allowed iterations were used up; screening and trying proposals out mostly end so.
    pub iteration_limit: u64,
    /// The line search found no better point, along steepest descent either.
    pub line_search_failed: u64,
    /// The search was cancelled or its time was up.
    pub stopped: u64,
    /// There was no merit at the first point, so nothing to refine.
    pub no_merit: u64,
    /// Line searches that failed and were begun anew along steepest descent; not an end.
    pub restarts: u64,
}

impl From<&Counters> for CounterRecord {
    fn from(c: &Counters) -> Self {
        Self {
            evaluations: c.evaluations,
            gradients: c.gradients,
            starts: c.starts,
            refinements: Some(RefinementRecord::from(&c.refinements)),
        }
    }
}

impl From<&RefinementCounters> for RefinementRecord {
    fn from(c: &RefinementCounters) -> Self {
        Self {
            gradient_converged: c.gradient_converged,
            cost_converged: c.cost_converged,
            iteration_limit: c.iteration_limit,
            line_search_failed: c.line_search_failed,
            stopped: c.stopped,
            no_merit: c.no_merit,
            restarts: c.restarts,
        }
    }
}
