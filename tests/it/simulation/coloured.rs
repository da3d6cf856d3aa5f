//! Drift and biases that wander.

use scheme_opt::internals::covariance::CovarianceModel;
use scheme_opt::internals::drift::COEFFICIENTS;
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{AxisValue, Platform, PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::Schedule;
use scheme_opt::internals::simulate::consistency::Verdict;
use scheme_opt::internals::simulate::{
    FilterModel, MonteCarlo, SimulationOptions, ToldNoise, TruthModel,
};

use super::{simulation, twelve, with};
use crate::battery::full::coloured_cases;

/// Twelve positions with slews, of gyros and accelerometers that wander in both ways.
fn wandering(change: impl FnOnce(&mut PlatformConfig)) -> (Platform, Schedule) {
    let mut config = super::platform_config(1.0);
    config.motion.slew_rate_deg_per_s = Some(1.0.into());
    config.gyro.rate_random_walk_deg_per_h_per_sqrt_h = Some(0.003);
    config.gyro.bias_instability_deg_per_h = Some(0.003);
    config.gyro.bias_correlation_time_s = Some(600.0);
    let accelerometer = &mut config.accelerometer;
    accelerometer.acceleration_random_walk_ug_per_sqrt_h = Some(3.0);
    accelerometer.bias_instability_ug = Some(4.0);
    accelerometer.bias_correlation_time_s = Some(900.0);
    config.errors.estimated.accelerometer_bias_ug = Some(AxisValue::All(100.0));
    change(&mut config);
    (config.check().unwrap(), twelve())
}

fn monte_carlo(
    (platform, schedule): &(Platform, Schedule),
    runs: usize,
    options: SimulationOptions,
) -> MonteCarlo {
    simulation(platform, schedule, options)
        .monte_carlo(runs, 3)
        .unwrap()
}

fn print(found: &MonteCarlo) {
    println!(
        "RMS error {:.6}, sigma {:.6}, planned {:.6} deg/h",
        found.rms_error_deg_per_h(),
        found.rms_sigma_deg_per_h(),
        found.rms_planned_sigma_deg_per_h()
    );
    for statistic in [
        found.nees,
        found.nees_parameters,
        found.nees_coefficients,
        found.nis,
    ] {
        println!("{statistic:?}");
    }
}

/// The gains of the linear filter are those of the reference.
#[test]
fn the_linear_filters_sigma_is_that_of_the_reference() {
    let options = with(TruthModel::FirstOrder, FilterModel::Linear);
    for case in coloured_cases() {
        let platform = case.config.check().unwrap();
        let found = monte_carlo(&(platform, case.schedule.clone()), 2, options);
        let off = found.parameters.iter().map(|p| {
            let expected = case.sigma[p.parameter.name];
            (p.check.planned_sigma / expected - 1.0).abs()
        });
        let worst = off.fold(0.0, f64::max);
        println!("{}: {worst:.1e}", case.name);
        assert!(worst < 1e-9, "{}: {worst:e}", case.name);
    }
}

/// However short the time constant beside a period, and however the platform turns meanwhile.
#[test]
fn what_is_planned_is_what_the_evaluator_says() {
    let moves: [&dyn Fn(&mut PlatformConfig); 4] = [
        &|_| {},
        &|c| c.motion.measure_moves = true,
        &|c| c.motion.slew_rate_deg_per_s = None,
        &|c| c.motion.repositioning = Repositioning::FrameHold,
    ];
    let options = with(TruthModel::FirstOrder, FilterModel::Linear);
    for (time_s, moving) in [3.0, 60.0, 4000.0].into_iter().zip(moves.iter().cycle()) {
        for moving in [moving, &moves[1]] {
            let test = wandering(|c| {
                c.gyro.bias_correlation_time_s = Some(time_s);
                c.motion.slew_rate_deg_per_s = Some(7.0.into());
                c.motion.settle_s = 7.0;
                moving(c);
            });
            let found = monte_carlo(&test, 2, options);
            let timeline = Timeline::new(&test.0.clone().into(), &test.1).unwrap();
            let by_the_chain = CovarianceModel::new(&test.0).full_covariance(&timeline);
            let sigma = by_the_chain.unwrap().sigma();
            for (check, sigma) in found.parameters.iter().zip(sigma) {
                let off = check.check.planned_sigma / sigma - 1.0;
                assert!(
                    off.abs() < 1e-9,
                    "{time_s} {}: {off:e}",
                    check.parameter.name
                );
            }
        }
    }
}

/// The drift at the end is what errors are of, and what a filter that knows of the wandering says of it
/// is right.
#[test]
fn a_filter_that_knows_of_it_is_consistent() {
    let test = wandering(|_| {});
    for (options, runs) in [
        (with(TruthModel::FirstOrder, FilterModel::Linear), 100),
        (with(TruthModel::Nonlinear, FilterModel::Iterated), 60),
    ] {
        let found = monte_carlo(&test, runs, options);
        print(&found);
        assert_eq!(found.verdict(), Verdict::Consistent);
        let by_the_chain = CovarianceModel::new(&test.0)
            .full_covariance(&Timeline::new(&test.0.clone().into(), &test.1).unwrap())
            .unwrap();
        let sigma = by_the_chain.sigma();
        for (check, sigma) in found.parameters.iter().zip(sigma) {
            let planned = check.check.planned_sigma;
            assert!(
                (planned / sigma - 1.0).abs() < 1e-9,
                "{}",
                check.parameter.name
            );
        }
        // What wanders are states too: six of the drift, six of the biases.
        let dof = found.nees.unwrap().degrees_of_freedom;
        assert_eq!(dof, COEFFICIENTS + 3 + 12 + 3);
    }
}

#[test]
fn the_extended_filter_carries_what_wanders_along() {
    // A start that is known well: from one of degrees the extended filter is not consistent anyway.
    let test = wandering(|config| {
        config.prior.misalignment_deg = AxisValue::All(0.01);
        config.prior.constant_drift_deg_per_h = AxisValue::All(0.1);
        config.prior.g_sensitive_drift_deg_per_h_per_g =
            scheme_opt::internals::platform::GSensitivePrior::All(AxisValue::All(0.1));
    });
    let options = with(TruthModel::Nonlinear, FilterModel::Extended);
    let found = monte_carlo(&test, 60, options);
    print(&found);
    assert_eq!(found.verdict(), Verdict::Consistent);
}

/// It claims far less than its errors are.
#[test]
fn a_filter_that_takes_it_for_white_fails() {
    for change in [
        |config: &mut PlatformConfig| {
            config.gyro.bias_instability_deg_per_h = None;
            config.gyro.bias_correlation_time_s = None;
        },
        |config: &mut PlatformConfig| {
            config.gyro.rate_random_walk_deg_per_h_per_sqrt_h = None;
        },
    ] {
        let test = wandering(|config| {
            change(config);
            config.accelerometer = Default::default();
            config.errors = Default::default();
        });
        let options = with(TruthModel::Nonlinear, FilterModel::Iterated);
        let known = monte_carlo(&test, 60, options);
        print(&known);
        assert_eq!(known.verdict(), Verdict::Consistent);
        let white = monte_carlo(&test, 60, options.with_told(ToldNoise::only_white()));
        print(&white);
        assert_eq!(
            white.nees_coefficients.unwrap().verdict,
            Verdict::Optimistic
        );
        assert!(white.rms_error_deg_per_h() > 1.5 * white.rms_sigma_deg_per_h());
        assert!(white.rms_error_deg_per_h() > 1.05 * known.rms_error_deg_per_h());
    }
}
