//! What works a plan out: with free angles or on an index table.

use super::context::Context;
use super::plan::Plan;
use super::rated::{Candidate, Refined};
use crate::criterion::Smoothing;

/// The steps of a search that differ between free angles and an index table.
pub(super) trait Workshop: Sync {
    /// A little work on each plan: enough to see whether a proposal leads somewhere.
    fn try_out(
        &self,
        context: Context<'_>,
        plans: Vec<Plan>,
        smoothing: Smoothing,
    ) -> Vec<Option<Refined>>;
    /// A proposal that won, worked out; never worse than it was.
    fn work_out(&self, context: Context<'_>, plan: Refined, smoothing: Smoothing) -> Refined;
    /// Angles, dwells and number of positions settled; none when the plan comes to nothing.
    fn settle(&self, context: Context<'_>, plan: &Plan, smoothing: Smoothing) -> Option<Refined>;
    /// The criterion itself instead of its smooth form, and figures a stand can be given.
    fn polish(&self, context: Context<'_>, plan: Refined) -> Option<Candidate>;
    /// The nearest plan that the platform can take.
    fn admit(&self, context: Context<'_>, plan: Plan) -> Plan;
}
