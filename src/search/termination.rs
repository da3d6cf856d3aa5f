//! How refinements end, one by one and counted.

use serde::{Deserialize, Serialize};

/// Why a refinement is at its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Termination {
    /// The gradient is shorter than its tolerance: a stationary point.
    GradientConverged,
    /// The last iteration gained less than the cost tolerance.
    CostConverged,
    /// All iterations that were allowed are used up.
    IterationLimit,
    /// No step along steepest descent decreases the merit enough, though the gradient is longer
    /// than its tolerance: rounding is all that is left, or a kink.
    LineSearchFailed,
    /// The search was cancelled, or its time is up.
    Stopped,
    /// The first point has no merit; nothing could be refined.
    NoMerit,
}

/// How many refinements ended in which way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(rename = "RefinementRecord"))]
#[non_exhaustive]
pub struct RefinementCounters {
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

impl RefinementCounters {
    /// A refinement that ended so, after so many restarts.
    pub(crate) fn count(&mut self, termination: Termination, restarts: u64) {
        self.restarts += restarts;
        *match termination {
            Termination::GradientConverged => &mut self.gradient_converged,
            Termination::CostConverged => &mut self.cost_converged,
            Termination::IterationLimit => &mut self.iteration_limit,
            Termination::LineSearchFailed => &mut self.line_search_failed,
            Termination::Stopped => &mut self.stopped,
            Termination::NoMerit => &mut self.no_merit,
        } += 1;
    }

    /// Adds what was counted elsewhere.
    pub(crate) fn add(&mut self, other: Self) {
        self.gradient_converged += other.gradient_converged;
        self.cost_converged += other.cost_converged;
        self.iteration_limit += other.iteration_limit;
        self.line_search_failed += other.line_search_failed;
        self.stopped += other.stopped;
        self.no_merit += other.no_merit;
        self.restarts += other.restarts;
    }

    /// How many refinements ended, in whatever way.
    pub const fn total(&self) -> u64 {
        self.gradient_converged
            + self.cost_converged
            + self.iteration_limit
            + self.line_search_failed
            + self.stopped
            + self.no_merit
    }
}
