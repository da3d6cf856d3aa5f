//! Criteria, their gradients and searches by them under priors far weaker than the measurements,
//! against a dense Kalman filter in 320-bit arithmetic.

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::covariance::{CoefficientCovariance, CovarianceModel, TickRule};
use scheme_opt::internals::criterion::{Criterion, Smoothing};
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{AxisValue, GSensitivePrior, PlatformConfig};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use scheme_opt::internals::search::{Control, SearchProblem, search};

use crate::dense_filter;
use crate::support::Random;

fn config(constant: f64, g_sensitive: f64) -> PlatformConfig {
    let mut config = PlatformConfig::default();
    config.prior.constant_drift_deg_per_h = AxisValue::All(constant);
    config.prior.g_sensitive_drift_deg_per_h_per_g =
        GSensitivePrior::All(AxisValue::All(g_sensitive));
    config
}

fn schedule(random: &mut Random, most: f64) -> Schedule {
    let count = random.between(1.0, most) as usize;
    let positions = (0..count).map(|_| {
        let periods = random.between(3.0, 25.0).floor();
        ScheduledPosition::new(random.position(), 10.0 * periods)
    });
    Schedule::new(positions.collect()).unwrap()
}

fn criteria() -> [Criterion; 3] {
    [Criterion::D, Criterion::E, Criterion::rms()]
}

#[test]
fn criteria_have_the_digits_that_sigmas_have() {
    criteria_have_the_digits(80);
}

/// `cargo test --release --test it criteria_of_300 -- --ignored --nocapture`
#[test]
#[ignore = "the long form of the test above"]
fn criteria_of_300_schedules_have_the_digits_that_sigmas_have() {
    criteria_have_the_digits(300);
}

fn criteria_have_the_digits(schedules: usize) {
    let mut random = Random(15);
    let (mut worst, mut worst_in_search) = ([0.0_f64; 3], [0.0_f64; 3]);
    for case in 0..schedules {
        let mut prior = || 10.0_f64.powf(random.between(4.0, 9.0));
        let platform = config(prior(), prior()).check().unwrap();
        let schedule = schedule(&mut random, 7.0);
        let exact = dense_filter::run(&platform, &schedule);
        let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
        let evaluator = Evaluator::new(platform, Objective::default());
        let printed = evaluator.evaluate(&schedule).unwrap();
        let log_det = printed.logdet_deg_per_h().unwrap();
        assert!((log_det - exact.log_det).abs() < 1e-9, "{case}: {log_det}");
        let largest = printed.max_eig_sigma_deg_per_h();
        assert!((largest / exact.criteria()[1] - 1.0).abs() < 1e-9);
        let model = evaluator.model();
        for (k, (criterion, exact)) in criteria().iter().zip(exact.criteria()).enumerate() {
            let value = criterion.value(&printed.end).unwrap();
            let error = (value / exact - 1.0).abs();
            assert!(
                error < 1e-9,
                "case {case}, {criterion:?}: {value} for {exact}"
            );
            worst[k] = worst[k].max(error);
            // The search's own, alone and in a group.
            let log = |p: &dyn CoefficientCovariance| criterion.log(p, Smoothing::Exact);
            let alone = model.value(&timeline, TickRule::Filter, log).unwrap();
            let group = vec![timeline.clone(); 3];
            let group = model.values(&group, TickRule::Filter, log);
            for log in group.into_iter().map(Result::unwrap).chain([alone]) {
                let error = (log - exact.ln()).abs();
                assert!(
                    error < 1e-6,
                    "case {case}, {criterion:?}: {error:e} in the search"
                );
                worst_in_search[k] = worst_in_search[k].max(error);
            }
        }
    }
    println!("d, e, a: printed {worst:?}, in the search {worst_in_search:?}");
}

/// Against sixth-order differences of values whose 32 digits the differences use up.
#[test]
fn gradients_under_weak_priors_are_the_derivatives() {
    let mut random = Random(51);
    for prior in [1e5, 1e8] {
        for criterion in criteria() {
            let platform = config(prior, prior).check().unwrap();
            let model = CovarianceModel::new(&platform);
            let count = random.between(2.0, 5.0) as usize;
            let x: Vec<[f64; 3]> = (0..count).map(|_| random.position().to_array()).collect();
            let timeline = |x: &[[f64; 3]]| {
                let held = |a: &[f64; 3]| ScheduledPosition::new(Position::from_array(*a), 600.0);
                let schedule = Schedule::new(x.iter().map(held).collect()).unwrap();
                Timeline::new(&platform.clone().into(), &schedule).unwrap()
            };
            let (_, gradient) = model
                .gradient(&timeline(&x), TickRule::Filter, |p| {
                    criterion.log_with_gradient(p, Smoothing::Exact)
                })
                .unwrap();
            let value = |k: usize, axis: usize, by: f64| {
                let mut moved = x.clone();
                moved[k][axis] += by;
                let end = model.end_covariance(&timeline(&moved), TickRule::Filter);
                criterion.value(&end.unwrap()).unwrap().ln()
            };
            let mut size = 0.0_f64;
            let mut worst = 0.0_f64;
            for (k, leg) in gradient.iter().enumerate() {
                for axis in 0..3 {
                    let h = 1e-3;
                    let f = |n: f64| value(k, axis, n * h) - value(k, axis, -n * h);
                    let numeric = (45.0 * f(1.0) - 9.0 * f(2.0) + f(3.0)) / (60.0 * h);
                    size = size.max(numeric.abs());
                    worst = worst.max((numeric - leg.angles[axis]).abs());
                }
            }
            println!("{prior:e} {criterion:?}: {worst:.1e} of {size:.1e}");
            // Derivatives of a logarithm per radian: some are 0, and none far above 1.
            assert!(
                worst < 1e-5,
                "{prior:e} {criterion:?}: {worst:e} of {size:e}"
            );
        }
    }
}

#[test]
fn searches_with_few_positions_end_with_a_schedule_and_its_exact_criterion() {
    for prior in [1e5, 1e8] {
        for max_positions in 1..=4 {
            let platform = config(prior, prior).check().unwrap();
            let objective = Objective {
                criterion: Criterion::D,
                ..Objective::default()
            };
            let evaluator = Evaluator::new(platform.clone(), objective);
            let problem = SearchProblem {
                total_time_s: 6000.0,
                max_positions,
                starts: 4,
                ..SearchProblem::default()
            };
            let found = search(&evaluator, &problem, &Control::default()).unwrap();
            let value = found.evaluation.score.criterion;
            let exact = dense_filter::run(&platform, &found.schedule).criteria()[0];
            println!("prior {prior:e}, {max_positions} positions: {value:.9}");
            assert!((value / exact - 1.0).abs() < 1e-9, "{value} for {exact}");
        }
    }
}
