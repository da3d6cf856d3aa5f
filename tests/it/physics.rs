//! What the physics demands of any covariance, whatever its numbers.

use nalgebra::Rotation3;
use proptest::prelude::*;
use scheme_opt::attitude::{Attitude, Position};
use scheme_opt::covariance::{CovarianceModel, EndCovariance, TickRule};
use scheme_opt::drift::CoefficientVector;
use scheme_opt::motion::Timeline;
use scheme_opt::platform::{AxisValue, GSensitivePrior, PlatformConfig};
use scheme_opt::schedule::{Schedule, ScheduledPosition};

fn end(config: &PlatformConfig, positions: Vec<ScheduledPosition>) -> EndCovariance {
    let platform = config.check().unwrap();
    let timeline = Timeline::new(&platform, &Schedule::new(positions).unwrap()).unwrap();
    CovarianceModel::new(&platform)
        .end_covariance(&timeline, TickRule::Filter)
        .unwrap()
}

fn sigma(config: &PlatformConfig, positions: &[ScheduledPosition]) -> CoefficientVector {
    end(config, positions.to_vec()).sigma_deg_per_h()
}

/// No σ of `less` is larger than that of `more`, up to rounding.
fn at_least_as_good(better: &CoefficientVector, worse: &CoefficientVector) -> bool {
    better
        .iter()
        .zip(worse.iter())
        .all(|(b, w)| *b <= w * (1.0 + 1e-9))
}

prop_compose! {
    fn scheduled()(
        angles in prop::array::uniform3(-180.0..180.0_f64),
        dwell in 0.0..1500.0_f64,
    ) -> ScheduledPosition {
        ScheduledPosition::new(Position::from_deg(angles[0], angles[1], angles[2]), dwell)
    }
}

prop_compose! {
    fn config()(
        latitude in -90.0..90.0_f64,
        log_noise in -7.0..-3.0_f64,
        log_drift in -4.0..0.0_f64,
        period in 2.0..40.0_f64,
        slew in prop::option::of(0.2..5.0_f64),
        settle in 0.0..60.0_f64,
        measure_moves in any::<bool>(),
    ) -> PlatformConfig {
        let mut c = PlatformConfig::default();
        c.site.latitude_deg = latitude;
        c.accelerometer.noise_g = 10.0_f64.powf(log_noise);
        c.gyro.random_drift_deg_per_h = Some(10.0_f64.powf(log_drift));
        c.filter.period_s = period;
        c.motion.slew_rate_deg_per_s = slew;
        c.motion.settle_s = settle;
        c.motion.measure_moves = measure_moves;
        c
    }
}

fn schedule() -> impl Strategy<Value = Vec<ScheduledPosition>> {
    prop::collection::vec(scheduled(), 1..9)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn nothing_is_forgotten_when_a_position_is_added(
        config in config(), positions in schedule(), last in scheduled(),
    ) {
        let before = sigma(&config, &positions);
        let longer: Vec<_> = positions.iter().copied().chain([last]).collect();
        prop_assert!(at_least_as_good(&sigma(&config, &longer), &before));
        prop_assert!(at_least_as_good(&before, &CovarianceModel::new(&config.check().unwrap())
            .prior_sigma_deg_per_h().clone_owned()));
    }

    #[test]
    fn less_noise_is_never_worse(config in config(), positions in schedule()) {
        let noisy = sigma(&config, &positions);
        let mut quiet = config.clone();
        quiet.accelerometer.noise_g *= 0.3;
        prop_assert!(at_least_as_good(&sigma(&quiet, &positions), &noisy));
        let mut steady = config.clone();
        steady.gyro.random_drift_deg_per_h = config.gyro.random_drift_deg_per_h.map(|d| 0.3 * d);
        prop_assert!(at_least_as_good(&sigma(&steady, &positions), &noisy));
    }

    #[test]
    fn a_stronger_prior_is_never_worse(config in config(), positions in schedule()) {
        let weak = sigma(&config, &positions);
        let mut strong = config.clone();
        strong.prior.misalignment_deg = AxisValue::PerAxis([0.1, 0.01, 0.05]);
        strong.prior.g_sensitive_drift_deg_per_h_per_g = GSensitivePrior::All(AxisValue::All(2.0));
        prop_assert!(at_least_as_good(&sigma(&strong, &positions), &weak));
    }

    #[test]
    fn a_dwell_split_at_a_tick_is_the_same_dwell(
        mut config in config(), positions in schedule(), at in any::<prop::sample::Index>(),
    ) {
        // Without settling: a repeated position settles too.
        config.motion.settle_s = 0.0;
        let k = at.index(positions.len());
        let ticks = (positions[k].dwell_s / config.filter.period_s).floor();
        let first = (ticks / 2.0).floor() * config.filter.period_s;
        let mut split = positions.clone();
        split[k].dwell_s = first;
        let rest = ScheduledPosition::new(positions[k].position, positions[k].dwell_s - first);
        split.insert(k + 1, rest);
        let (whole, split) = (sigma(&config, &positions), sigma(&config, &split));
        for (a, b) in whole.iter().zip(split.iter()) {
            prop_assert!((a / b - 1.0).abs() < 1e-7, "{a} {b}");
        }
    }

    #[test]
    fn turning_the_body_axes_turns_the_coefficients(
        mut config in config(), positions in schedule(),
        axis in prop::array::uniform3(-3.0..3.0_f64),
    ) {
        // D_F is a vector and the g-sensitive coefficients are a matrix in the platform; under
        // isotropic priors another choice of platform axes turns P_D and keeps its trace. Moves
        // would follow other gimbal paths, so they take no time here.
        config.motion.slew_rate_deg_per_s = None;
        let turn = Rotation3::new(nalgebra::Vector3::from(axis));
        let turned: Vec<_> = positions.iter().map(|p| {
            let c = Rotation3::from_matrix_unchecked(*p.position.attitude().matrix()) * turn;
            ScheduledPosition::new(Attitude::from_rotation(c).position(), p.dwell_s)
        }).collect();
        config.prior.constant_drift_deg_per_h = AxisValue::All(15.0);
        let (a, b) = (end(&config, positions), end(&config, turned));
        prop_assert!((a.coefficients.trace() / b.coefficients.trace() - 1.0).abs() < 1e-7);
        let (va, vb) = (
            a.coefficients.symmetric_eigenvalues(),
            b.coefficients.symmetric_eigenvalues(),
        );
        prop_assert!((va.max() / vb.max() - 1.0).abs() < 1e-7);
        let psi = (a.misalignment - b.misalignment).amax() / a.misalignment.amax();
        prop_assert!(psi < 1e-7, "{psi}");
    }
}

#[test]
fn a_coefficient_known_exactly_stays_known() {
    let mut config = PlatformConfig::default();
    config.prior.constant_drift_deg_per_h = AxisValue::PerAxis([0.0, 15.0, 15.0]);
    let positions = [[0.0, 0.0, 0.0], [180.0, 0.0, 0.0]]
        .map(|a| ScheduledPosition::new(Position::from_deg(a[0], a[1], a[2]), 1000.0));
    let sigma = sigma(&config, &positions);
    assert_eq!(sigma[0], 0.0);
    assert!(sigma[1] > 0.0);
}
