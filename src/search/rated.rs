//! Plans with their merit, at two stages of their making.

use super::context::Context;
use super::plan::Plan;
use crate::criterion::Smoothing;

/// A refined plan with its merit.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The plan.
    pub plan: Plan,
    /// Its merit (the score, with any penalty), lower is better.
    pub merit: f64,
}

impl Refined {
    /// The better of two; of equals the first, whatever thread was faster.
    pub(super) fn better(self, other: Self) -> Self {
        if other.merit < self.merit {
            other
        } else {
            self
        }
    }
}

/// A plan worked out to the end, with its merit.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    pub plan: Plan,
    pub merit: f64,
    /// Value of the criterion by the filter's own tick rule.
    pub criterion: f64,
}

/// The plan stretched or shortened to the total time, with its merit; none when it does not fit.
pub(super) fn rate(context: Context<'_>, plan: &Plan, smoothing: Smoothing) -> Option<Refined> {
    let test = context.evaluator.test();
    let fitted = plan.clone();
    let (plan, timeline) = fitted.fitted_timeline(test, context.problem.total_time_s)?;
    context.work.count_evaluations(1);
    // Here and wherever plans are tried: one whose merit cannot be computed is no candidate. That
    // none is left is an error of the search, and the winner is evaluated in full.
    let merit = context.evaluator.merit(&timeline, smoothing).ok()?;
    merit.is_finite().then_some(Refined { plan, merit })
}
