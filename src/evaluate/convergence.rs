//! The average of ln(criterion) over a test: what rewards early convergence.
//!
//! With c_k = ln(criterion) at the ends t_k of the legs and c_0 before the test,
//!
//! ```text
//! average = (1/T) Σ_k τ_k (c_{k−1} + c_k)/2,   τ_k = t_k − t_{k−1}:
//! ∂/∂c_k = (τ_k + τ_{k+1})/2T,   ∂/∂τ_k = ((c_{k−1} + c_k)/2 − average)/T.
//! ```

use super::Evaluator;
use crate::covariance::full::FullCovariance;
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CoefficientCovariance, CovarianceRoot, EndCovariance, Rooted, TickRule};
use crate::criterion::Smoothing;
use crate::error::Result;
use crate::motion::Timeline;

/// An average by the trapezoidal rule.
struct Average<'a> {
    durations: &'a [f64],
    /// c_0, c_1, …
    logs: &'a [f64],
}

impl Average<'_> {
    fn total_s(&self) -> f64 {
        self.durations.iter().sum()
    }

    /// (c_{k−1} + c_k)/2.
    fn mean(&self, leg: usize) -> f64 {
        0.5 * (self.logs[leg] + self.logs[leg + 1])
    }

    fn value(&self) -> f64 {
        let legs = self.durations.iter().enumerate();
        let sum: f64 = legs.map(|(leg, s)| s * self.mean(leg)).sum();
        sum / self.total_s()
    }

    /// ∂/∂c at the end of a leg.
    fn of_log(&self, leg: usize) -> f64 {
        let next = self.durations.get(leg + 1).copied().unwrap_or(0.0);
        0.5 * (self.durations[leg] + next) / self.total_s()
    }

    /// ∂/∂τ of a leg.
    fn of_duration(&self, leg: usize) -> f64 {
        (self.mean(leg) - self.value()) / self.total_s()
    }
}

/// The test up to the end of each of its legs.
fn prefixes(timeline: &Timeline) -> Vec<Timeline> {
    let legs = timeline.legs().len();
    (1..=legs).map(|end| timeline.only(0..end)).collect()
}

fn durations(timeline: &Timeline) -> Vec<f64> {
    timeline.legs().iter().map(|leg| leg.duration_s()).collect()
}

impl Evaluator {
    /// Before the test.
    fn log_before(&self, smoothing: Smoothing) -> Result<f64> {
        let parameters = self.model.errors.parameters();
        let prior = self.model.prior_sigma_deg_per_h();
        let root = CovarianceRoot::independent(prior);
        let mut full = FullCovariance::of_coefficients(EndCovariance {
            coefficients: *Rooted::new(root.clone()).matrix(),
            root,
            misalignment: self.model.prior_psi,
        });
        let estimated = self.model.errors.estimated();
        let sigma = nalgebra::DVector::from_fn(estimated, |i, _| parameters[i].prior_sigma);
        full.parameters = nalgebra::DMatrix::from_diagonal(&sigma.component_mul(&sigma));
        let criterion = &self.objective.criterion;
        criterion.log(&full.seeing(&self.objective.others), smoothing)
    }

    /// The part of the merit.
    pub(super) fn convergence_part(
        &self,
        timeline: &Timeline,
        rule: TickRule,
        smoothing: Smoothing,
    ) -> Result<f64> {
        let weight = self.objective.convergence_weight;
        if weight == 0.0 {
            return Ok(0.0);
        }
        let log = |p: &dyn CoefficientCovariance| self.objective.criterion.log(p, smoothing);
        let ends = self.model.values(&prefixes(timeline), rule, log);
        let mut logs = vec![self.log_before(smoothing)?];
        for end in ends {
            logs.push(end?);
        }
        Ok(weight * average(timeline, &logs))
    }

    /// The same by the exact chain.
    pub(super) fn convergence_by_filter(&self, timeline: &Timeline) -> Result<f64> {
        let weight = self.objective.convergence_weight;
        if weight == 0.0 {
            return Ok(0.0);
        }
        let mut logs = vec![self.log_before(Smoothing::Exact)?];
        for prefix in prefixes(timeline) {
            logs.push(libm::log(self.end_with_criterion(&prefix)?.1));
        }
        Ok(weight * average(timeline, &logs))
    }

    /// Adds the part to a merit and its gradient.
    pub(super) fn add_convergence(
        &self,
        timeline: &Timeline,
        smoothing: Smoothing,
        (value, gradient): &mut (f64, Vec<LegGradient>),
    ) -> Result<()> {
        let weight = self.objective.convergence_weight;
        if weight == 0.0 {
            return Ok(());
        }
        let criterion = &self.objective.criterion;
        let merit = |p: &dyn CoefficientCovariance| criterion.log_with_gradient(p, smoothing);
        let ends = self
            .model
            .gradients(&prefixes(timeline), TickRule::Relaxed, merit);
        let ends = ends.into_iter().collect::<Result<Vec<_>>>()?;
        let mut logs = vec![self.log_before(smoothing)?];
        logs.extend(ends.iter().map(|(log, _)| *log));
        let durations = durations(timeline);
        let average = Average {
            durations: &durations,
            logs: &logs,
        };
        if average.total_s() <= 0.0 {
            return Ok(());
        }
        *value += weight * average.value();
        for (end, (_, slopes)) in ends.iter().enumerate() {
            let share = weight * average.of_log(end);
            for (to, from) in gradient.iter_mut().zip(slopes) {
                for axis in 0..3 {
                    to.angles[axis] += share * from.angles[axis];
                }
                to.dwell_s += share * from.dwell_s;
                to.move_s += share * from.move_s;
            }
        }
        for (leg, to) in gradient.iter_mut().enumerate() {
            let slope = weight * average.of_duration(leg);
            to.dwell_s += slope;
            to.move_s += slope;
        }
        Ok(())
    }
}

fn average(timeline: &Timeline, logs: &[f64]) -> f64 {
    let durations = durations(timeline);
    let average = Average {
        durations: &durations,
        logs,
    };
    match average.total_s() > 0.0 {
        true => average.value(),
        // A test that takes no time has not left what was known before.
        false => logs[0],
    }
}
