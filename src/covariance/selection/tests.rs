use super::*;
use crate::attitude::Position;
use crate::covariance::filter;
use crate::model::Role;
use crate::platform::{AxisValue, ErrorTable, Platform, PlatformConfig, Repositioning};
use crate::schedule::{Schedule, ScheduledPosition};

/// Every group at this many times its usual prior.
pub(super) fn every_error(times: f64) -> ErrorTable {
    let all = |sigma: f64| Some(AxisValue::All(sigma * times));
    ErrorTable {
        torquer_scale_factor_ppm: all(1000.0),
        torquer_misalignment_arcsec: all(60.0),
        quadratic_drift_deg_per_h_per_g2: all(0.1),
        quadratic_output_drift_deg_per_h_per_g2: all(0.1),
        accelerometer_bias_ug: all(100.0),
        accelerometer_scale_factor_ppm: all(200.0),
        accelerometer_misalignment_arcsec: all(60.0),
        accelerometer_second_order_ug_per_g2: all(20.0),
        accelerometer_third_order_ug_per_g3: all(5.0),
        accelerometer_cross_coupling_ug_per_g2: all(20.0),
        local_gravity_ug: Some(10.0 * times),
        ..ErrorTable::default()
    }
}

/// Moves that take time or none, are measured or not, turn ψ^n, start and return; the errors of
/// even cases are estimated, those of odd ones half considered.
fn configs() -> [PlatformConfig; 5] {
    let changes: [fn(&mut PlatformConfig); 5] = [
        |_| {},
        |c| {
            c.motion.slew_rate_deg_per_s = Some(0.9.into());
            c.motion.measure_moves = true;
        },
        |c| {
            c.motion.slew_rate_deg_per_s = Some(0.9.into());
            c.motion.settle_s = 37.0;
            c.motion.start_deg = Some([5.0, -20.0, 60.0]);
            c.motion.return_to_start = true;
            c.azimuth.noise_arcsec = Some(20.0);
        },
        |c| c.motion.repositioning = Repositioning::FrameHold,
        |c| c.motion.measure_moves = true,
    ];
    let mut k = 0;
    changes.map(|change| {
        let mut config = PlatformConfig::default();
        config.errors.estimated = every_error(1.0);
        if k % 2 == 1 {
            let considered = &mut config.errors.considered;
            let estimated = &mut config.errors.estimated;
            considered.accelerometer_bias_ug = estimated.accelerometer_bias_ug.take();
            considered.torquer_misalignment_arcsec = estimated.torquer_misalignment_arcsec.take();
            considered.quadratic_drift_deg_per_h_per_g2 =
                estimated.quadratic_drift_deg_per_h_per_g2.take();
        }
        k += 1;
        change(&mut config);
        config
    })
}

fn timeline(platform: &Platform) -> Timeline {
    let positions = [
        ([10.0, 20.0, 30.0], 304.0),
        ([-80.0, 65.0, 140.0], 500.0),
        ([-80.0, 65.0, 140.0], 7.0),
        ([150.0, -40.0, -75.0], 355.0),
    ]
    .map(|(a, dwell_s)| ScheduledPosition::new(Position::from_deg(a[0], a[1], a[2]), dwell_s));
    Timeline::new(
        &platform.clone().into(),
        &Schedule::new(positions.into()).unwrap(),
    )
    .unwrap()
}

/// Largest difference of a covariance, beside the σ of what it is of.
fn worst(a: &FullCovariance, b: &FullCovariance) -> f64 {
    let of = |a: &DMatrix<f64>, b: &DMatrix<f64>| {
        let mut worst = 0.0_f64;
        for i in 0..a.nrows() {
            for j in 0..a.ncols() {
                let scale = (b[(i, i)] * b[(j, j)]).sqrt();
                if a[(i, j)] != b[(i, j)] {
                    worst = worst.max((a[(i, j)] - b[(i, j)]).abs() / scale);
                }
            }
        }
        worst
    };
    let psi = (a.end.misalignment - b.end.misalignment).amax() / b.end.misalignment.amax();
    let budget = a.budget.iter().zip(&b.budget).map(|(a, b)| {
        assert_eq!((a.group, a.role), (b.group, b.role));
        (a.error_deg_per_h - b.error_deg_per_h).amax() / b.error_deg_per_h.amax().max(1e-9)
    });
    assert_eq!(a.budget.len(), b.budget.len());
    let all = [
        of(&a.parameters, &b.parameters),
        of(&a.claimed, &b.claimed),
        psi,
    ];
    budget.chain(all).fold(0.0, f64::max)
}

#[test]
fn doubles_and_numbers_of_32_digits_have_the_same_covariance() {
    for (k, config) in configs().into_iter().enumerate() {
        let platform = config.check().unwrap();
        let timeline = timeline(&platform);
        let model = CovarianceModel::new(&platform);
        let doubles = model.full_covariance_in::<f64>(&timeline).unwrap().full;
        let extended = model.full_covariance_in::<Extended>(&timeline).unwrap();
        assert_eq!(extended.precision, Precision::Extended);
        let difference = worst(&doubles, &extended.full);
        assert!(difference < 1e-9, "{k}: {difference:e}");
        // The judge's drift integrals of moves are known to nine digits.
        let instrument = filter::instrument::Instrument::of(&platform);
        let judge = filter::run::<f64>(&platform, &instrument, &timeline, &mut |_| {}).unwrap();
        let difference = worst(&judge, &doubles);
        assert!(difference < 1e-7, "{k}: {difference:e}");
    }
}

#[test]
fn the_judge_has_32_digits_too() {
    let mut config = PlatformConfig::default();
    config.errors.estimated.parameter = [("T_XY", 30.0), ("K_0Y", 50.0), ("D_IOZ", 0.3)]
        .map(|(name, sigma)| (name.to_owned(), sigma))
        .into();
    config.errors.considered.local_gravity_ug = Some(10.0);
    config.prior.constant_drift_deg_per_h = AxisValue::All(1e9);
    let platform = config.check().unwrap();
    let timeline = timeline(&platform);
    let instrument = filter::instrument::Instrument::of(&platform);
    let judge = filter::run::<Extended>(&platform, &instrument, &timeline, &mut |_| {});
    let model = CovarianceModel::new(&platform);
    let chain = model.full_with_told(&timeline).unwrap();
    assert_eq!(chain.precision, Precision::Extended);
    let difference = worst(&judge.unwrap(), &chain.full);
    assert!(difference < 1e-7, "{difference:e}");
}

#[test]
fn errors_known_exactly_change_nothing() {
    for config in configs() {
        let known = |considered: bool| {
            let mut config = config.clone();
            config.azimuth.noise_arcsec = None;
            let errors = &mut config.errors;
            errors.estimated = ErrorTable::default();
            errors.considered = ErrorTable::default();
            match considered {
                true => errors.considered = every_error(0.0),
                false => errors.estimated = every_error(0.0),
            }
            config.check().unwrap()
        };
        let mut without = config.clone();
        without.azimuth.noise_arcsec = None;
        without.errors.estimated = ErrorTable::default();
        without.errors.considered = ErrorTable::default();
        let without = without.check().unwrap();
        let of = |platform: &Platform| {
            let timeline = timeline(platform);
            CovarianceModel::new(platform)
                .full_covariance(&timeline)
                .unwrap()
        };
        let expected = of(&without).end;
        for platform in [known(false), known(true)] {
            let found = of(&platform);
            let ratio = found
                .end
                .sigma_deg_per_h()
                .component_div(&expected.sigma_deg_per_h());
            assert!(ratio.iter().all(|r| (r - 1.0).abs() < 1e-12), "{ratio}");
            let psi = found.end.misalignment - expected.misalignment;
            assert!(psi.amax() < 1e-12 * expected.misalignment.amax());
            assert!(found.sigma()[COEFFICIENTS..].iter().all(|s| *s == 0.0));
            assert!(found.budget.iter().all(|g| g.rms_error_deg_per_h() == 0.0));
        }
    }
}

#[test]
fn the_truth_is_the_claim_and_the_shares_of_what_is_considered() {
    for config in configs() {
        let platform = config.check().unwrap();
        let timeline = timeline(&platform);
        let found = CovarianceModel::new(&platform)
            .full_covariance(&timeline)
            .unwrap();
        let considered = found.budget.iter().filter(|g| g.role == Role::Considered);
        let mut squares = nalgebra::SVector::<f64, COEFFICIENTS>::zeros();
        for group in considered {
            squares += group.error_deg_per_h.component_mul(&group.error_deg_per_h);
        }
        for i in 0..COEFFICIENTS {
            let sum = found.claimed[(i, i)] + squares[i];
            assert!((sum / found.parameters[(i, i)] - 1.0).abs() < 1e-12);
        }
    }
}

/// ε = λ(u) u with u the vertical in the platform: what no channel of order 1 ever sees.
#[test]
fn drift_along_the_vertical_is_vertical_at_every_attitude() {
    let platform = configs()[0].check().unwrap();
    let model = CovarianceModel::new(&platform);
    let parameters = platform.errors().parameters();
    let combinations: [[(&str, f64); 3]; 4] = [
        [("D_IX", 1.0), ("D_IY", 1.0), ("D_IZ", 1.0)],
        [("D_IIX", 1.0), ("D_ISY", -1.0), ("D_IOZ", 1.0)],
        [("D_ISX", 1.0), ("D_IIY", 1.0), ("D_ISZ", 1.0)],
        [("D_IOX", 1.0), ("D_IOY", 1.0), ("D_IIZ", -1.0)],
    ];
    for k in 0..50 {
        let k = f64::from(k);
        let attitude = Position::from_deg(37.0 * k, 11.0 * k * k, -53.0 * k).attitude();
        let a = model.drift_by_gravity(&attitude);
        for combination in &combinations {
            let mut drift = Vector3::zeros();
            for (name, factor) in combination {
                let of = |p: &crate::model::Parameter| p.name == *name;
                let column = parameters.iter().position(of).unwrap();
                drift += a.column(column) * *factor;
            }
            let horizontal = drift[NORTH].abs().max(drift[EAST].abs());
            assert!(horizontal < 1e-14, "{combination:?}: {drift}");
        }
    }
}
