//! The full error model against an independent dense filter in 400 bits.

use scheme_opt::internals::covariance::filter::full_step_by_step;
use scheme_opt::internals::covariance::full::FullCovariance;
use scheme_opt::internals::covariance::{CoefficientCovariance, CovarianceModel, TickRule};
use scheme_opt::internals::criterion::Criterion;
use scheme_opt::internals::drift::DriftCoefficient;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::model::{Parameter, Role};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{Platform, PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

use crate::battery::full::{FullCase, full_cases};
use crate::support::{Random, slewing};

/// Largest relative difference of a number from the reference, and of which.
struct Worst {
    of: String,
    difference: f64,
}

impl Worst {
    fn none() -> Self {
        Self {
            of: String::new(),
            difference: 0.0,
        }
    }

    fn take(&mut self, of: &str, found: f64, expected: f64) {
        let difference = (found / expected - 1.0).abs();
        if difference.is_nan() || difference > self.difference {
            self.difference = difference;
            self.of = format!("{of}: {found} for {expected}");
        }
    }
}

fn of_route(case: &FullCase, platform: &Platform, found: &FullCovariance) -> Worst {
    let mut worst = Worst::none();
    let estimated = |p: &&Parameter| p.role == Role::Estimated;
    let parameters: Vec<_> = platform
        .errors()
        .parameters()
        .iter()
        .filter(estimated)
        .collect();
    assert_eq!(parameters.len(), case.sigma.len(), "{}", case.name);
    let claimed = match case.claimed_sigma.is_empty() {
        true => &case.sigma,
        false => &case.claimed_sigma,
    };
    let (truth, claim) = (found.sigma(), found.claimed_sigma());
    for (k, p) in parameters.iter().enumerate() {
        worst.take(p.name, truth[k], case.sigma[p.name]);
        worst.take(p.name, claim[k], claimed[p.name]);
    }
    let psi = found.end.misalignment_sigma_arcsec();
    for (axis, expected) in case.misalignment_arcsec.iter().flatten().enumerate() {
        worst.take(["psi_nx", "psi_ny", "psi_nz"][axis], psi[axis], *expected);
    }
    let rms = (found.end.coefficients.trace() / 12.0).sqrt();
    worst.take("rms", rms, case.rms_sigma_deg_per_h);
    for (group, expected) in &case.ignored {
        let of_group = found.budget.iter().find(|g| g.group == group);
        let error = of_group.unwrap().rms_error_deg_per_h();
        if (error - expected).abs() > 1e-9 {
            worst.take(group, error, *expected);
        }
    }
    let constant = found.constant_part_deg_per_h;
    assert_eq!(
        constant.is_some(),
        !case.constant_part_sigma.is_empty(),
        "{}",
        case.name
    );
    for (k, sigma) in constant.iter().flatten().enumerate() {
        let name = parameters[k].name;
        worst.take(name, *sigma, case.constant_part_sigma[name]);
    }
    worst
}

/// Every number of a case that a route finds, to 1e-6.
pub fn check(case: &FullCase, route: &str, platform: &Platform, found: &FullCovariance) {
    let worst = of_route(case, platform, found);
    println!(
        "{} by {route}: {:.1e} {}",
        case.name, worst.difference, worst.of
    );
    assert!(
        worst.difference <= 1e-6,
        "{} by {route}: {}",
        case.name,
        worst.of
    );
}

#[test]
fn the_step_by_step_filter_agrees_to_1e_6() {
    let cases = full_cases();
    assert_eq!(cases.len(), 11);
    for case in cases {
        let platform = case.config.check().unwrap();
        let timeline = Timeline::new(&platform.clone().into(), &case.schedule).unwrap();
        assert!((timeline.total_time_s() - case.total_time_s).abs() < 1e-3);
        let found = full_step_by_step(&platform, &timeline).unwrap();
        check(&case, "the filter", &platform, &found);
    }
}

#[test]
fn the_chain_agrees_to_1e_6() {
    for case in full_cases() {
        let platform = case.config.check().unwrap();
        let timeline = Timeline::new(&platform.clone().into(), &case.schedule).unwrap();
        let model = CovarianceModel::new(&platform);
        let found = model.full_covariance(&timeline).unwrap();
        check(&case, "the chain", &platform, &found);
    }
}

/// Every number that the route of searches gives of them: P_D, alone and in lanes.
#[test]
fn the_fast_route_agrees_to_1e_6() {
    for case in full_cases() {
        let platform = case.config.check().unwrap();
        let timeline = Timeline::new(&platform.clone().into(), &case.schedule).unwrap();
        let model = CovarianceModel::new(&platform);
        let names = DriftCoefficient::ALL.map(DriftCoefficient::name);
        let merit = |p: &dyn CoefficientCovariance| {
            for (k, name) in names.iter().enumerate() {
                let ratio = p.matrix()[(k, k)].sqrt() / case.sigma[*name];
                assert!((ratio - 1.0).abs() < 1e-6, "{}: {name} {ratio}", case.name);
            }
            Criterion::rms().value(p)
        };
        let alone = model.value(&timeline, TickRule::Filter, merit).unwrap();
        assert!(
            (alone / case.rms_sigma_deg_per_h - 1.0).abs() < 1e-6,
            "{}",
            case.name
        );
        let many = vec![timeline; 5];
        for value in model.values(&many, TickRule::Filter, merit) {
            assert!((value.unwrap() / alone - 1.0).abs() < 1e-9, "{}", case.name);
        }
    }
}

/// A platform with some of the errors, each estimated or considered, in some mounting.
pub fn random_platform(random: &mut Random) -> PlatformConfig {
    const GROUPS: [(&str, f64); 11] = [
        ("torquer_scale_factor_ppm", 1000.0),
        ("torquer_misalignment_arcsec", 60.0),
        ("quadratic_drift_deg_per_h_per_g2", 0.1),
        ("quadratic_output_drift_deg_per_h_per_g2", 0.1),
        ("accelerometer_bias_ug", 100.0),
        ("accelerometer_scale_factor_ppm", 200.0),
        ("accelerometer_misalignment_arcsec", 60.0),
        ("accelerometer_second_order_ug_per_g2", 20.0),
        ("accelerometer_third_order_ug_per_g3", 5.0),
        ("accelerometer_cross_coupling_ug_per_g2", 20.0),
        ("local_gravity_ug", 10.0),
    ];
    let mut errors = serde_json::json!({ "considered": {} });
    for (key, sigma) in GROUPS {
        let sigma = match random.unit() < 0.1 {
            true => 0.0,
            false => sigma * random.between(0.1, 3.0),
        };
        let choice = random.unit();
        if choice < 0.4 {
            errors[key] = sigma.into();
        } else if choice < 0.6 {
            errors["considered"][key] = sigma.into();
        }
    }
    let mut across = |axis: usize| {
        let (sin, cos) = random.between(-3.1, 3.1).sin_cos();
        let mut vector = [0.0; 3];
        (vector[(axis + 1) % 3], vector[(axis + 2) % 3]) = (cos, sin);
        vector
    };
    let output_axis = serde_json::json!({ "X": across(0), "Y": across(1), "Z": across(2) });
    let mut config: PlatformConfig = serde_json::from_value(serde_json::json!({
        "errors": errors, "gyro": { "output_axis": output_axis },
    }))
    .unwrap();
    config.site.latitude_deg = random.between(-80.0, 80.0);
    config.motion.settle_s = random.between(0.0, 40.0);
    config.motion.measure_moves = random.unit() < 0.4;
    config.motion.return_to_start = random.unit() < 0.3;
    if random.unit() < 0.6 {
        slewing(&mut config, random, 0.3, 3.0);
    } else if random.unit() < 0.3 {
        config.motion.repositioning = Repositioning::FrameHold;
    }
    if random.unit() < 0.3 {
        config.motion.start_deg = Some([10.0, -50.0, 130.0]);
    }
    if random.unit() < 0.3 {
        config.azimuth.noise_arcsec = Some(random.between(2.0, 200.0));
    }
    config
}

/// Whatever is estimated, considered or known exactly, however the platform moves: both computations
/// come to the same.
#[test]
fn chain_and_filter_agree_for_any_selection() {
    let mut worst = 0.0_f64;
    for case in 0..40 {
        let random = &mut Random::of_case(4100 + case);
        let config = random_platform(random);
        let held =
            (0..4).map(|_| ScheduledPosition::new(random.position(), random.between(5.0, 500.0)));
        let schedule = Schedule::new(held.collect()).unwrap();
        let evaluator = Evaluator::new(config.check().unwrap(), Objective::default());
        let evaluation = evaluator
            .evaluate(&schedule)
            .unwrap_or_else(|e| panic!("case {case}: {e}\n{config:?}"));
        assert!(
            evaluation.agreement < 1e-7,
            "{case}: {:e}",
            evaluation.agreement
        );
        worst = worst.max(evaluation.agreement);
        for p in &evaluation.parameters {
            // Nobody knows less after the test, but of what is told wrong by what is ignored.
            let claimed = p.claimed_sigma.unwrap_or(p.sigma);
            assert!(
                claimed <= p.parameter.prior_sigma * (1.0 + 1e-9),
                "{}",
                p.parameter.name
            );
            assert!(claimed <= p.sigma * (1.0 + 1e-9));
        }
    }
    println!("worst of 40: {worst:.1e}");
}
