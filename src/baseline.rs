//! The yardstick: what the standard schemes reach on the same platform in the same time.

use crate::compare::Reorderer;
use crate::drift::COEFFICIENTS;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::motion::Timeline;
use crate::schedule::Schedule;
use crate::schedule::standard::StandardScheme;

/// A standard scheme at a given total time.
#[derive(Debug, Clone, PartialEq)]
pub struct Baseline {
    /// The scheme.
    pub scheme: StandardScheme,
    /// How many positions it has.
    pub positions: usize,
    /// What it reaches, or why it cannot be run on this platform in this time.
    pub accuracy: Result<BaselineAccuracy>,
    /// What the same positions reach in the best order that was found, as good as in their own at the
    /// least; none where they cannot be run, or the criterion is known before any test.
    pub in_best_order: Option<BaselineAccuracy>,
}

/// What a standard scheme reaches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaselineAccuracy {
    /// √(mean of the coefficient variances), °/h.
    pub rms_sigma_deg_per_h: f64,
    /// Value of the evaluator's criterion, °/h (max-ratio: 1).
    pub criterion: f64,
}

/// Every standard scheme on the evaluator's platform, moves and settles included in
/// `total_time_s`, by the evaluator's criterion. Dwells are equal.
///
/// A scheme that the platform cannot take, or whose moves leave less than the shortest dwell
/// (`motion.min_dwell_s`) for each position, is part of the answer with the reason.
///
/// ```
/// use scheme_opt::internals::baseline::baselines;
/// use scheme_opt::internals::evaluate::{Evaluator, Objective};
/// use scheme_opt::internals::platform::PlatformConfig;
///
/// let mut config = PlatformConfig::default();
/// config.gimbals.beta_deg = Some([-60.0, 60.0]);
/// let evaluator = Evaluator::new(config.check()?, Objective::default());
/// let all = baselines(&evaluator, 12_000.0);
/// assert!(all.iter().any(|b| b.accuracy.is_ok()));
/// // axis-24 turns the middle gimbal by 90 degrees.
/// assert!(all.iter().any(|b| b.accuracy.is_err()));
/// # Ok::<(), scheme_opt::Error>(())
/// ```
pub fn baselines(evaluator: &Evaluator, total_time_s: f64) -> Vec<Baseline> {
    let mut all: Vec<Baseline> = StandardScheme::ALL
        .into_iter()
        .map(|scheme| Baseline {
            scheme,
            positions: scheme.positions().len(),
            accuracy: accuracy(evaluator, scheme, total_time_s),
            in_best_order: None,
        })
        .collect();
    let prior = evaluator.model().prior_sigma_deg_per_h();
    if !evaluator.objective().criterion.is_known(prior) {
        put_in_order(evaluator, total_time_s, &mut all);
    }
    all
}

/// Orders of each scheme that are rated at first.
const FEW: usize = 200;
/// Orders of those that are best then.
const MANY: usize = 2_000;
/// How many those are.
const BEST: usize = 2;
/// Where something wanders an order takes so many times as long.
const SLOWER: usize = 10;

/// A good order of each scheme, looked for longer where it is the yardstick: by descents that take a few
/// hundredths of a search.
fn put_in_order(evaluator: &Evaluator, total_time_s: f64, all: &mut [Baseline]) {
    let reorderer = Reorderer::new(evaluator);
    let slower = if evaluator.model().is_white() {
        1
    } else {
        SLOWER
    };
    let best = |baseline: &Baseline, most_rated: usize| -> Option<BaselineAccuracy> {
        let given = *baseline.accuracy.as_ref().ok()?;
        let schedule = baseline
            .scheme
            .schedule(total_time_s, evaluator.test())
            .ok()?;
        let positions = schedule.positions().iter().map(|p| p.position).collect();
        let ordered = reorderer.good_order(positions, total_time_s, most_rated / slower);
        let found = ordered.and_then(|s| reached(evaluator, &s).ok());
        Some(match found {
            Some(found) if found.criterion < given.criterion => found,
            _ => given,
        })
    };
    for baseline in all.iter_mut() {
        baseline.in_best_order = best(baseline, FEW);
    }
    let criterion = |b: &Baseline| b.in_best_order.map_or(f64::INFINITY, |a| a.criterion);
    let mut ranked: Vec<usize> = (0..all.len()).collect();
    ranked.sort_by(|&i, &j| criterion(&all[i]).total_cmp(&criterion(&all[j])));
    for &i in ranked.iter().take(BEST) {
        all[i].in_best_order = best(&all[i], MANY);
    }
}

fn accuracy(
    evaluator: &Evaluator,
    scheme: StandardScheme,
    total_time_s: f64,
) -> Result<BaselineAccuracy> {
    let schedule = scheme.schedule(total_time_s, evaluator.test())?;
    check_dwells(evaluator, &schedule)?;
    reached(evaluator, &schedule)
}

fn reached(evaluator: &Evaluator, schedule: &Schedule) -> Result<BaselineAccuracy> {
    let timeline = Timeline::new(evaluator.test(), schedule)?;
    let (end, criterion) = evaluator.end_with_criterion(&timeline)?;
    let rms_sigma_deg_per_h = (end.coefficients.trace() / COEFFICIENTS as f64).sqrt();
    if rms_sigma_deg_per_h.is_finite() && criterion.is_finite() {
        Ok(BaselineAccuracy {
            rms_sigma_deg_per_h,
            criterion,
        })
    } else {
        Err(Error::numerical("its covariance is not finite"))
    }
}

/// A comparison is fair when both sides keep to the shortest dwell.
pub(crate) fn check_dwells(evaluator: &Evaluator, schedule: &Schedule) -> Result<()> {
    let least_s = evaluator.test().platform().motion().min_dwell_s;
    let dwells = schedule.positions().iter().map(|p| p.dwell_s);
    let shortest_s = dwells.fold(f64::INFINITY, f64::min);
    // The dwells are a quotient, which may round to just below.
    if shortest_s >= least_s * (1.0 - 1e-12) {
        return Ok(());
    }
    Err(Error::infeasible("its equal dwells would be too short")
        .with_key("dwell_s")
        .with_value(format!("{shortest_s:.3}"))
        .with_allowed(format!("at least motion.min_dwell_s = {least_s}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::evaluator;

    #[test]
    fn a_baseline_is_what_its_full_evaluation_says() {
        let evaluator = evaluator(|c| c.motion.slew_rate_deg_per_s = Some(1.0.into()));
        let all = baselines(&evaluator, 12_000.0);
        assert_eq!(all.len(), StandardScheme::ALL.len());
        for baseline in all {
            let accuracy = baseline.accuracy.unwrap();
            assert!(baseline.in_best_order.unwrap().criterion <= accuracy.criterion);
            let schedule = baseline
                .scheme
                .schedule(12_000.0, evaluator.test())
                .unwrap();
            let evaluation = evaluator.evaluate(&schedule).unwrap();
            assert!((evaluation.total_time_s - 12_000.0).abs() < 1e-6);
            let rms = evaluation.rms_sigma_deg_per_h();
            assert!((accuracy.rms_sigma_deg_per_h / rms - 1.0).abs() < 1e-12);
            assert!((accuracy.criterion / evaluation.score.criterion - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn what_does_not_fit_says_why() {
        let slow = evaluator(|c| {
            c.motion.slew_rate_deg_per_s = Some(0.01.into());
            c.motion.settle_s = 100.0;
        });
        let all = baselines(&slow, 1000.0);
        for baseline in all {
            assert!(baseline.accuracy.unwrap_err().is_infeasible());
        }
    }

    #[test]
    fn the_shortest_dwell_holds_for_both_sides() {
        let evaluator = evaluator(|c| c.motion.min_dwell_s = 60.0);
        for baseline in baselines(&evaluator, 720.0) {
            assert_eq!(baseline.accuracy.is_ok(), baseline.positions <= 12);
        }
    }
}
