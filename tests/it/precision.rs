//! The kernels and the step-by-step filter against a dense Kalman filter in 320-bit arithmetic:
//! weak priors, near-unobservable corners.

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::covariance::filter::{step_by_step, step_by_step_extended};
use scheme_opt::internals::covariance::{CovarianceModel, EndCovariance, TickRule};
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{AxisValue, GSensitivePrior, PlatformConfig};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

use crate::dense_filter::{self, Exact};
use crate::extremes::{extreme_platform, extreme_schedule};
use crate::support::Random;

fn largest(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    pairs
        .map(|(a, b)| if a == b { 0.0 } else { (a / b - 1.0).abs() })
        .fold(0.0, f64::max)
}

/// Largest relative difference of a coefficient's σ.
fn of_drift(end: &EndCovariance, exact: &Exact) -> f64 {
    let sigma = end.sigma_deg_per_h();
    largest(
        sigma
            .iter()
            .copied()
            .zip(exact.sigma_deg_per_h.iter().copied()),
    )
}

/// Largest relative difference of any σ.
fn of_all(end: &EndCovariance, exact: &Exact) -> f64 {
    let sigma = end.misalignment_sigma_arcsec();
    let exact_sigma = exact.misalignment_sigma_arcsec.iter().copied();
    largest(sigma.iter().copied().zip(exact_sigma)).max(of_drift(end, exact))
}

/// Dwells of whole periods, moves taking no time.
fn schedule(config: &PlatformConfig, dwells: &[(Position, usize)]) -> Schedule {
    let scheduled = dwells
        .iter()
        .map(|&(position, n)| ScheduledPosition::new(position, n as f64 * config.filter.period_s));
    Schedule::new(scheduled.collect()).unwrap()
}

/// Largest relative differences of a coefficient's σ: kernels, then the step-by-step filter in
/// doubles, then what is printed.
fn differences(config: &PlatformConfig, dwells: &[(Position, usize)]) -> [f64; 3] {
    let platform = config.check().unwrap();
    let schedule = schedule(config, dwells);
    let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
    let kernels = CovarianceModel::new(&platform)
        .end_covariance(&timeline, TickRule::Filter)
        .unwrap();
    let filter = step_by_step(&platform, &timeline, &mut |_| {}).unwrap();
    let exact = dense_filter::run(&platform, &schedule);
    let evaluator = Evaluator::new(platform, Objective::default());
    let printed = evaluator.evaluate(&schedule).unwrap().end;
    [kernels, filter, printed].map(|end| of_drift(&end, &exact))
}

fn config(latitude_deg: f64, noise_g: f64, random: f64, period_s: f64) -> PlatformConfig {
    let mut config = PlatformConfig::default();
    config.site.latitude_deg = latitude_deg;
    config.accelerometer.noise_g = Some(noise_g);
    config.gyro.random_drift_deg_per_h = Some(random);
    config.filter.period_s = period_s;
    config
}

fn with_priors(
    mut config: PlatformConfig,
    misalignment: f64,
    constant: f64,
    g: f64,
) -> PlatformConfig {
    config.prior.misalignment_deg = AxisValue::All(misalignment);
    config.prior.constant_drift_deg_per_h = AxisValue::All(constant);
    config.prior.g_sensitive_drift_deg_per_h_per_g = GSensitivePrior::All(AxisValue::All(g));
    config
}

#[test]
fn weak_priors_up_to_1e12_are_followed_by_both() {
    let mut random = Random(5);
    let dwells: Vec<_> = (0..9).map(|_| (random.position(), 12)).collect();
    for sigma in [1e-6, 1.0, 1e6, 1e9, 1e11, 1e12] {
        let config = with_priors(config(28.2, 1e-5, 0.01, 10.0), 1.0, sigma, sigma);
        let [kernels, filter, _] = differences(&config, &dwells);
        println!("prior {sigma:e}: kernels {kernels:.1e}, filter {filter:.1e}");
        assert!(
            kernels < 1e-12 && filter < 1e-12,
            "{sigma:e}: {kernels:e} {filter:e}"
        );
    }
}

#[test]
fn corners_of_the_allowed_ranges_are_right() {
    let mut random = Random(6);
    let mut pick = |choices: &[f64]| {
        let index = random.between(0.0, choices.len() as f64) as usize;
        choices[index.min(choices.len() - 1)]
    };
    let (mut worst, mut lost) = ([0.0_f64; 3], 0);
    for case in 0..48 {
        let base = config(
            pick(&[-90.0, -60.0, 0.0, 28.2, 89.999, 90.0]),
            pick(&[1e-9, 1e-7, 1e-5, 1e-3, 1e-1]),
            pick(&[0.0, 1e-6, 1e-2, 1.0, 1e3]),
            pick(&[0.01, 1.0, 10.0, 100.0, 1000.0]),
        );
        let config = with_priors(
            base,
            pick(&[1e-4, 0.1, 10.0]),
            pick(&[0.0, 1e-6, 1.0, 1e6, 1e12]),
            pick(&[0.0, 1e-6, 1.0, 1e6, 1e12]),
        );
        let count = pick(&[1.0, 2.0, 6.0, 9.0]) as usize;
        let periods = pick(&[1.0, 2.0, 5.0, 14.0]) as usize;
        let mut place = Random(100 + case);
        let dwells: Vec<_> = (0..count).map(|_| (place.position(), periods)).collect();
        let found = differences(&config, &dwells);
        for (worst, found) in worst.iter_mut().zip(found) {
            *worst = worst.max(found);
        }
        // Where doubles cannot follow, numbers of 32 digits do.
        let [kernels, filter, printed] = found;
        assert!(
            kernels < 1e-9 && printed < 1e-9,
            "case {case}: {found:?}\n{config:?}"
        );
        if filter > 1e-6 {
            println!("case {case}: {count} x {periods}: {found:?}\n{config:?}");
            lost += 1;
        }
    }
    assert!(lost >= 1, "no corner needs more than doubles any more");
    println!(
        "worst of 48 cases: kernels {:.1e}, filter {:.1e} ({lost} lost), printed {:.1e}",
        worst[0], worst[1], worst[2]
    );
}

/// Of the cases below those in which the kernels in doubles take a cosine of 6e-17 for one. The
/// filter did too while it shared their attitude; its own sines are exact there.
const RIGHT_ANGLES: [u64; 2] = [1107, 1185];

/// Cases of `extremes` that double precision gets wrong, in kernels or filter: factors of up to
/// 2700.
#[test]
fn what_doubles_lose_is_right_in_32_digits() {
    for case in [1009, 1051, 1071, 1107, 1182, 1185, 1189, 1195, 1208, 1218] {
        let random = &mut Random::of_case(case);
        let config = extreme_platform(random, 12.0);
        let schedule = extreme_schedule(random, config.filter.period_s, 400.0);
        let platform = config.check().unwrap();
        let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
        let exact = dense_filter::run(&platform, &schedule);
        let in_doubles = step_by_step(&platform, &timeline, &mut |_| {}).unwrap();
        let lost = of_all(&in_doubles, &exact);
        match RIGHT_ANGLES.contains(&case) {
            true => assert!(lost < 1e-6, "case {case}: the filter's own sines, {lost:e}"),
            false => assert!(lost > 1e-6, "case {case}: doubles will do, {lost:e}"),
        }
        let filter = step_by_step_extended(&platform, &timeline, &mut |_| {}).unwrap();
        let evaluator = Evaluator::new(platform, Objective::default());
        let printed = evaluator.evaluate(&schedule).unwrap();
        let [filter, printed] = [&filter, &printed.end].map(|end| of_all(end, &exact));
        println!("case {case}: doubles {lost:.1e}, filter {filter:.1e}, printed {printed:.1e}");
        assert!(
            filter < 1e-12 && printed < 1e-12,
            "case {case}: {filter:e} {printed:e}"
        );
    }
}

/// A misalignment told some 1e7 times better than its prior by very few measurements: the chain in
/// doubles is wrong in the fifth digit, and the filter says so.
#[test]
fn a_misalignment_far_better_told_than_known_is_right() {
    let mut config = PlatformConfig::default();
    config.accelerometer.noise_g = Some(1e-8);
    config.prior.misalignment_deg = AxisValue::All(15.0);
    config.prior.constant_drift_deg_per_h = AxisValue::All(8.0);
    let at = Position::from_deg;
    let dwells = [
        (at(90.0, -90.0, 180.0), 1),
        (at(0.0, 0.0, 0.0), 2),
        (at(30.0, 40.0, 50.0), 1),
    ];
    for random_drift in [0.0, 1e-6, 1e-4, 0.01] {
        config.gyro.random_drift_deg_per_h = Some(random_drift);
        let [.., printed] = differences(&config, &dwells);
        assert!(printed < 1e-6, "{random_drift}: {printed:e}");
    }
}
