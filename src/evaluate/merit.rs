//! The figure of merit of a search, with its gradient.

use super::Evaluator;
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CoefficientCovariance, Slope, TickRule};
use crate::criterion::{Criterion, Smoothing};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector};
use crate::error::Result;
use crate::motion::Timeline;
use crate::observability::log_separability::LogSeparability;

/// A coefficient that is hardly separated, or not at all, counts in the score as if it were so far:
/// one that no schedule on the stand can separate must not hide what is told of the others.
const LEAST_COUNTED: f64 = 1e-3;

impl Evaluator {
    /// The figure of merit of a search: the score, plus a penalty below the minimum
    /// separability, by the fast kernels. Infinite where nothing can be said.
    pub(crate) fn merit(&self, timeline: &Timeline, smoothing: Smoothing) -> Result<f64> {
        let merit = |p: &dyn CoefficientCovariance| self.merit_of_covariance(p, smoothing);
        let value = self.model.value(timeline, TickRule::Relaxed, merit)?;
        let convergence = self.convergence_part(timeline, TickRule::Relaxed, smoothing)?;
        Ok(value + self.separability_part(timeline) + convergence)
    }

    /// The covariance's part of the merit from P_D.
    pub(crate) fn merit_of_covariance(
        &self,
        covariance: &dyn CoefficientCovariance,
        smoothing: Smoothing,
    ) -> Result<f64> {
        let weight = self.objective.covariance_weight;
        if weight == 0.0 {
            return Ok(0.0);
        }
        Ok(weight * self.objective.criterion.log(covariance, smoothing)?)
    }

    /// The same where only the twelve coefficients are known: for proposals, which are rated after.
    pub(crate) fn estimate_of_covariance(
        &self,
        covariance: &dyn CoefficientCovariance,
        smoothing: Smoothing,
    ) -> Result<f64> {
        let weight = self.objective.covariance_weight;
        if weight == 0.0 {
            return Ok(0.0);
        }
        Ok(weight * self.estimate.log(covariance, smoothing)?)
    }

    /// The same with its derivative.
    pub(crate) fn estimate_and_slope(
        &self,
        covariance: &dyn CoefficientCovariance,
        smoothing: Smoothing,
    ) -> Result<(f64, Slope)> {
        self.merit_and_slope_by(&self.estimate, covariance, smoothing)
    }

    /// The merit of every timeline, several at once.
    pub(crate) fn merits(&self, timelines: &[Timeline], smoothing: Smoothing) -> Vec<Result<f64>> {
        self.merits_by(timelines, TickRule::Relaxed, smoothing)
    }

    /// The merit of every timeline by the filter's own rule, several at once.
    pub(crate) fn merits_by_filter(&self, timelines: &[Timeline]) -> Vec<Result<f64>> {
        self.merits_by(timelines, TickRule::Filter, Smoothing::Exact)
    }

    fn merits_by(
        &self,
        timelines: &[Timeline],
        rule: TickRule,
        smoothing: Smoothing,
    ) -> Vec<Result<f64>> {
        let merit = |p: &dyn CoefficientCovariance| self.merit_of_covariance(p, smoothing);
        let mut merits = self.model.values(timelines, rule, merit);
        for (merit, timeline) in merits.iter_mut().zip(timelines) {
            if let Ok(value) = merit {
                let convergence = self.convergence_part(timeline, rule, smoothing);
                let separability = self.separability_part(timeline);
                *merit = convergence.map(|part| *value + separability + part);
            }
        }
        merits
    }

    /// What separability adds to the merit; nothing where it has no part in the objective.
    pub(crate) fn separability_part(&self, timeline: &Timeline) -> f64 {
        if !self.objective.uses_separability() {
            return 0.0;
        }
        self.separability_merit(&LogSeparability::new(&self.model, timeline).log)
            .0
    }

    /// [`Evaluator::merit`] with its gradient.
    pub(crate) fn merit_gradient(
        &self,
        timeline: &Timeline,
        smoothing: Smoothing,
    ) -> Result<(f64, Vec<LegGradient>)> {
        let merit = |p: &dyn CoefficientCovariance| self.merit_and_slope(p, smoothing);
        let mut found = self.model.gradient(timeline, TickRule::Relaxed, merit)?;
        self.add_separability(timeline, &mut found);
        self.add_convergence(timeline, smoothing, &mut found)?;
        Ok(found)
    }

    /// The same of every timeline, several at once; each has the bits that it has alone.
    pub(crate) fn merit_gradients(
        &self,
        timelines: &[Timeline],
        smoothing: Smoothing,
    ) -> Vec<Result<(f64, Vec<LegGradient>)>> {
        let merit = |p: &dyn CoefficientCovariance| self.merit_and_slope(p, smoothing);
        let mut all = self.model.gradients(timelines, TickRule::Relaxed, merit);
        for (timeline, found) in timelines.iter().zip(&mut all) {
            if let Ok(of) = found {
                self.add_separability(timeline, of);
                if let Err(error) = self.add_convergence(timeline, smoothing, of) {
                    *found = Err(error);
                }
            }
        }
        all
    }

    /// [`Evaluator::merit_of_covariance`] with its derivative.
    pub(crate) fn merit_and_slope(
        &self,
        covariance: &dyn CoefficientCovariance,
        smoothing: Smoothing,
    ) -> Result<(f64, Slope)> {
        self.merit_and_slope_by(&self.objective.criterion, covariance, smoothing)
    }

    fn merit_and_slope_by(
        &self,
        criterion: &Criterion,
        covariance: &dyn CoefficientCovariance,
        smoothing: Smoothing,
    ) -> Result<(f64, Slope)> {
        let weight = self.objective.covariance_weight;
        if weight == 0.0 {
            return Ok((0.0, Slope::InRoot(CoefficientMatrix::zeros())));
        }
        let (log, slope) = criterion.log_with_gradient(covariance, smoothing)?;
        Ok((weight * log, slope.times(weight)))
    }

    /// Adds the separability's part, where it has one, to a merit and its gradient.
    fn add_separability(
        &self,
        timeline: &Timeline,
        (value, gradient): &mut (f64, Vec<LegGradient>),
    ) {
        if !self.objective.uses_separability() {
            return;
        }
        let s = LogSeparability::new(&self.model, timeline);
        let (part, slopes) = self.separability_merit(&s.log);
        *value += part;
        s.add_gradient(timeline, &slopes, gradient);
    }

    /// −mean ln(separability) of the coefficients that are not known before the test, each counted
    /// as [`LEAST_COUNTED`] at least, and its derivative with respect to each ln s_i.
    pub(super) fn counted_separability(&self, log: &CoefficientVector) -> (f64, CoefficientVector) {
        let prior = self.model.prior_sigma_deg_per_h();
        let least = libm::log(LEAST_COUNTED);
        let unknown = prior.iter().filter(|s| **s > 0.0).count();
        // With all of them known nothing is counted.
        let share = 1.0 / unknown.max(1) as f64;
        let (mut value, mut slopes) = (0.0, CoefficientVector::zeros());
        for i in (0..COEFFICIENTS).filter(|&i| prior[i] > 0.0) {
            value -= share * log[i].max(least);
            if log[i] > least {
                slopes[i] = -share;
            }
        }
        (value, slopes)
    }

    /// The separability's part of the merit and its derivative with respect to each ln s_i.
    fn separability_merit(&self, log: &CoefficientVector) -> (f64, CoefficientVector) {
        /// Weight of the squared shortfall: one per cent short costs as much as a criterion
        /// twenty per cent worse.
        const SHORTFALL_WEIGHT: f64 = 2000.0;
        /// A penalty stops just short of its aim, so the aim is half a per cent above.
        const MARGIN: f64 = 0.005;
        let o = &self.objective;
        let (counted, slopes) = self.counted_separability(log);
        let mut value = o.separability_weight * counted;
        let mut slopes = slopes * o.separability_weight;
        if o.minimum_separability > 0.0 {
            let wanted = libm::log(o.minimum_separability) + MARGIN;
            for (slope, log) in slopes.iter_mut().zip(log.iter()) {
                let short = (wanted - log).max(0.0);
                // Quadratic near the aim, linear far from it.
                let near = short.min(1.0);
                value += SHORTFALL_WEIGHT * near * (2.0 * short - near);
                *slope -= 2.0 * SHORTFALL_WEIGHT * near;
            }
        }
        (value, slopes)
    }
}
