//! What the physics demands of any covariance, whatever its numbers.

use nalgebra::{Matrix3, Rotation3};
use proptest::prelude::*;
use scheme_opt::internals::attitude::{Attitude, Position};
use scheme_opt::internals::covariance::{CovarianceModel, EndCovariance, TickRule};
use scheme_opt::internals::drift::{CoefficientVector, DriftCoefficient};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{AxisValue, GSensitivePrior, PlatformConfig};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

fn end(config: &PlatformConfig, positions: Vec<ScheduledPosition>) -> EndCovariance {
    let platform = config.check().unwrap();
    let timeline =
        Timeline::new(&platform.clone().into(), &Schedule::new(positions).unwrap()).unwrap();
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

/// Both the same, to a relative `tolerance`.
fn same(a: &CoefficientVector, b: &CoefficientVector, tolerance: f64) -> bool {
    a.iter()
        .zip(b.iter())
        .all(|(a, b)| a == b || (a / b - 1.0).abs() < tolerance)
}

/// The axis whose g-component excites a coefficient; none for the constant drifts.
fn g_axis(c: DriftCoefficient) -> Option<usize> {
    let excites = |axis: &usize| c.factor(&nalgebra::Vector3::ith(*axis, 1.0)) != 0.0;
    (c.factor(&nalgebra::Vector3::zeros()) == 0.0)
        .then(|| (0..3).find(excites))
        .flatten()
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
        acceleration in prop::option::of(0.01..1.0_f64),
        settle in 0.0..60.0_f64,
        measure_moves in any::<bool>(),
    ) -> PlatformConfig {
        let mut c = PlatformConfig::default();
        c.site.latitude_deg = latitude;
        c.accelerometer.noise_g = Some(10.0_f64.powf(log_noise));
        c.gyro.random_drift_deg_per_h = Some(10.0_f64.powf(log_drift));
        c.filter.period_s = period;
        c.motion.slew_rate_deg_per_s = slew.map(Into::into);
        c.motion.acceleration_deg_per_s2 = acceleration.filter(|_| slew.is_some()).map(Into::into);
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
        quiet.accelerometer.noise_g = quiet.accelerometer.noise_g.map(|v| 0.3 * v);
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
        config.motion.acceleration_deg_per_s2 = None;
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

    #[test]
    fn nothing_is_forgotten_when_the_last_dwell_gets_longer(
        config in config(), positions in schedule(), more in 0.0..2000.0_f64,
    ) {
        let mut longer = positions.clone();
        longer[positions.len() - 1].dwell_s += more;
        prop_assert!(at_least_as_good(&sigma(&config, &longer), &sigma(&config, &positions)));
    }

    #[test]
    fn at_a_pole_turning_the_scheme_about_the_vertical_changes_nothing(
        mut config in config(), positions in schedule(), turn in -3.1..3.1_f64, south in any::<bool>(),
    ) {
        // There is no north: the Earth turns about the vertical itself.
        config.site.latitude_deg = if south { -90.0 } else { 90.0 };
        config.motion.slew_rate_deg_per_s = None;
        config.motion.acceleration_deg_per_s2 = None;
        let about_up = Rotation3::from_axis_angle(&nalgebra::Vector3::y_axis(), turn);
        let turned: Vec<_> = positions.iter().map(|p| {
            let c = about_up * Rotation3::from_matrix_unchecked(*p.position.attitude().matrix());
            ScheduledPosition::new(Attitude::from_rotation(c).position(), p.dwell_s)
        }).collect();
        let (a, b) = (end(&config, positions), end(&config, turned));
        prop_assert!(same(&a.sigma_deg_per_h(), &b.sigma_deg_per_h(), 1e-7));
        prop_assert!((a.misalignment[(1, 1)] / b.misalignment[(1, 1)] - 1.0).abs() < 1e-7);
    }

    #[test]
    fn the_mirrored_scheme_is_as_good_on_the_other_hemisphere(
        mut config in config(), positions in schedule(),
    ) {
        // Reflect north in n and x in the platform: rates are axial vectors, so that ω_N keeps
        // its sign, ω_U does not, and every coefficient goes into plus or minus itself.
        config.motion.slew_rate_deg_per_s = None;
        config.motion.acceleration_deg_per_s2 = None;
        let mirror = Matrix3::from_diagonal(&nalgebra::Vector3::new(-1.0, 1.0, 1.0));
        let mirrored: Vec<_> = positions.iter().map(|p| {
            let c = mirror * p.position.attitude().matrix() * mirror;
            let c = Rotation3::from_matrix_unchecked(c);
            ScheduledPosition::new(Attitude::from_rotation(c).position(), p.dwell_s)
        }).collect();
        let here = sigma(&config, &positions);
        config.site.latitude_deg = -config.site.latitude_deg;
        prop_assert!(same(&here, &sigma(&config, &mirrored), 1e-7));
    }

    #[test]
    fn another_name_for_the_axes_is_another_name_for_the_coefficients(
        mut config in config(), positions in schedule(), forward in any::<bool>(),
    ) {
        // x → y → z → x in the platform, or back, with one prior for all coefficients of a kind.
        config.motion.slew_rate_deg_per_s = None;
        config.motion.acceleration_deg_per_s2 = None;
        let cycle = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
        let cycle = if forward { cycle } else { cycle.transpose() };
        let renamed: Vec<_> = positions.iter().map(|p| {
            let c = Rotation3::from_matrix_unchecked(*p.position.attitude().matrix());
            let c = c * Rotation3::from_matrix_unchecked(cycle.transpose());
            ScheduledPosition::new(Attitude::from_rotation(c).position(), p.dwell_s)
        }).collect();
        let (old, new) = (sigma(&config, &positions), sigma(&config, &renamed));
        let to = |axis: usize| if forward { (axis + 1) % 3 } else { (axis + 2) % 3 };
        for c in DriftCoefficient::ALL {
            let is_image = |d: &&DriftCoefficient| {
                d.gyro() == to(c.gyro())
                    && g_axis(**d) == g_axis(c).map(to)
            };
            let image = DriftCoefficient::ALL.iter().find(is_image).unwrap();
            let ratio = new[image.index()] / old[c.index()];
            prop_assert!((ratio - 1.0).abs() < 1e-7, "{} {}: {ratio}", c.name(), image.name());
        }
    }

    #[test]
    fn a_unit_is_only_a_unit(config in config(), positions in schedule(), log in -2.0..2.0_f64) {
        // All noises and priors in a unit k times as large: every σ is k times as large.
        let k = 10.0_f64.powf(log);
        let mut scaled = config.clone();
        scaled.accelerometer.noise_g = config.accelerometer.noise_g.map(|noise| k * noise);
        scaled.gyro.random_drift_deg_per_h = config.gyro.random_drift_deg_per_h.map(|d| k * d);
        scaled.prior.misalignment_deg = AxisValue::All(0.1 * k);
        scaled.prior.constant_drift_deg_per_h = AxisValue::All(15.0 * k);
        scaled.prior.g_sensitive_drift_deg_per_h_per_g =
            GSensitivePrior::All(AxisValue::All(8.0 * k));
        let (a, b) = (sigma(&config, &positions) * k, sigma(&scaled, &positions));
        prop_assert!(same(&a, &b, 1e-8));
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
