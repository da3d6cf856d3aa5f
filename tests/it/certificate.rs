//! The certificate as a library caller sees it: no schedule is below its bound, and the bound is
//! close where it can be.

use std::time::{Duration, Instant};

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::certificate::{Certifier, Majorant, MinimumTime, Remark};
use scheme_opt::internals::covariance::filter::full_step_by_step;
use scheme_opt::internals::covariance::{CovarianceModel, TickRule};
use scheme_opt::internals::criterion::Criterion;
use scheme_opt::internals::drift::CoefficientVector;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{AxisValue, OutputAxes, PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use scheme_opt::internals::search::shortest::shortest;
use scheme_opt::internals::search::{Control, SearchProblem, search};

use crate::full_model;
use crate::support::{Random, slewing};

fn certifier(change: impl FnOnce(&mut PlatformConfig)) -> Certifier {
    let mut config = PlatformConfig::default();
    change(&mut config);
    Certifier::new(&config.check().unwrap())
}

/// About one level axis alone gravity never comes along it: three coefficients are known as before, and
/// that is the bound.
#[test]
fn what_a_stand_cannot_tell_is_the_bound() {
    let blind = |c: &mut PlatformConfig| {
        c.gimbals.beta_deg = Some([0.0, 0.0]);
        c.gimbals.gamma_deg = Some([0.0, 0.0]);
        c.motion.slew_rate_deg_per_s = Some(0.5.into());
    };
    let weights = CoefficientVector::from_fn(|i, _| if i == 3 { 2.0 } else { 1.0 });
    let criteria = [
        // Three of twelve at 8 °/h; two of the weights of thirteen are of one of them.
        (Criterion::rms(), 4.0),
        (Criterion::weighted(weights), (4.0 * 64.0_f64 / 13.0).sqrt()),
        (Criterion::E, 8.0),
        (Criterion::max_ratio(CoefficientVector::repeat(0.5)), 16.0),
    ];
    let certifier = certifier(blind);
    let mut config = PlatformConfig::default();
    blind(&mut config);
    let platform = config.check().unwrap();
    for (criterion, expected) in criteria {
        let bound = certifier.bound(&criterion, 12_000.0).unwrap();
        assert!((bound.lower_bound / expected - 1.0).abs() < 1e-6);
        assert!(bound.criterion.rests_on_priors);
        let said = bound.remarks[0].to_string();
        assert!(
            said.ends_with("on this stand can tell: D_IX; D_OZ; D_SY"),
            "{said}"
        );
        let objective = Objective {
            criterion: criterion.clone(),
            ..Objective::default()
        };
        let evaluator = Evaluator::new(platform.clone(), objective);
        let problem = SearchProblem {
            starts: 2,
            max_positions: 4,
            ..SearchProblem::default()
        };
        let found = search(&evaluator, &problem, &Control::default()).unwrap();
        let reached = criterion.value(&found.evaluation.end).unwrap();
        assert!(reached >= bound.lower_bound, "{reached}");
        assert!(reached <= 1.001 * bound.lower_bound, "{reached}");
        let sigma = found.evaluation.end.sigma_deg_per_h();
        for (s, least) in sigma.iter().zip(bound.sigma_deg_per_h.iter()) {
            assert!(s >= least);
        }
    }
    // The determinant is about the rest as well.
    let d = certifier.bound(&Criterion::D, 12_000.0).unwrap();
    assert!(!d.criterion.rests_on_priors);
}

#[test]
fn the_default_search_is_within_six_per_cent_of_the_best_possible() {
    let started = Instant::now();
    let bound = certifier(|_| {})
        .bound(&Criterion::rms(), 12_000.0)
        .unwrap();
    println!("{:.7} in {:?}", bound.lower_bound, started.elapsed());
    assert!(bound.lower_bound >= 0.000_855, "{}", bound.lower_bound);
    assert!(bound.criterion.equivalence_gap < 1e-3 && bound.remarks.is_empty());
    let majorant = bound.criterion.majorant.unwrap();
    assert_eq!(majorant.kind, Majorant::Separated);
    let evaluator = Evaluator::new(
        PlatformConfig::default().check().unwrap(),
        Objective::default(),
    );
    let control = Control::default();
    for (allow_tumbling, gap) in [(false, 1.06), (true, 1.055)] {
        let problem = SearchProblem {
            starts: 24,
            allow_tumbling,
            ..SearchProblem::default()
        };
        let found = search(&evaluator, &problem, &control).unwrap().evaluation;
        let rms = found.rms_sigma_deg_per_h();
        println!("{rms:.7}: {:.2} %", 100.0 * (rms / bound.lower_bound - 1.0));
        assert!(rms >= bound.lower_bound && rms <= gap * bound.lower_bound);
        let sigma = found.end.sigma_deg_per_h();
        for (s, least) in sigma.iter().zip(bound.sigma_deg_per_h.iter()) {
            assert!(s >= least);
        }
    }
}

/// A platform, and a schedule of at most `total_time_s` on it.
fn random_platform(random: &mut Random) -> PlatformConfig {
    let mut c = PlatformConfig::default();
    c.site.latitude_deg = random.between(-90.0, 90.0);
    c.filter.period_s = 10.0_f64.powf(random.between(0.3, 2.0));
    c.accelerometer.noise_g = Some(10.0_f64.powf(random.between(-6.5, -4.0)));
    let drift = 10.0_f64.powf(random.between(-3.0, -1.0));
    c.gyro.random_drift_deg_per_h = Some(if random.unit() < 0.1 { 0.0 } else { drift });
    let angles = [(); 3].map(|()| {
        if random.unit() < 0.2 {
            0.0
        } else {
            random.between(1e-4, 1.0)
        }
    });
    c.prior.misalignment_deg = AxisValue::PerAxis(angles);
    let sigmas = [(); 3].map(|()| 10.0_f64.powf(random.between(-3.0, 2.0)));
    c.prior.constant_drift_deg_per_h = AxisValue::PerAxis(sigmas);
    if random.unit() < 0.3 {
        let low = random.between(-150.0, 60.0);
        c.gimbals.alpha_deg = Some([low, low + random.between(30.0, 120.0)]);
        c.gimbals.gamma_deg = Some([-40.0, 60.0]);
    }
    if random.unit() < 0.2 {
        c.motion.repositioning = Repositioning::FrameHold;
    } else if random.unit() < 0.5 {
        slewing(&mut c, random, 0.1, 5.0);
        c.motion.settle_s = random.between(0.0, 40.0);
    }
    c
}

fn random_schedule(
    random: &mut Random,
    config: &PlatformConfig,
    total_time_s: f64,
) -> Option<Timeline> {
    let platform = config.check().unwrap();
    let slews = config.motion.repositioning == Repositioning::Slew;
    let count = 1 + (random.unit() * 14.0) as usize;
    let mut positions: Vec<ScheduledPosition> = (0..count)
        .map(|_| {
            let mut angles = random.position().to_array();
            for (angle, range) in angles.iter_mut().zip(platform.gimbals().ranges) {
                if let Some(range) = range {
                    *angle = random.between(range.low_rad, range.high_rad);
                }
            }
            let position = Position::from_array(angles);
            let mut p = ScheduledPosition::new(position, random.unit());
            p.move_measured = (slews && random.unit() < 0.4).then_some(true);
            let free = slews && config.motion.slew_rate_deg_per_s.is_none();
            p.move_s = (free && random.unit() < 0.5)
                .then(|| random.between(0.0, total_time_s / count as f64));
            p
        })
        .collect();
    let sum: f64 = positions.iter().map(|p| p.dwell_s).sum();
    let moves = Timeline::new(
        &platform.clone().into(),
        &Schedule::new(positions.clone()).unwrap(),
    )
    .unwrap();
    let left = total_time_s - moves.overhead_s();
    if left <= 0.0 {
        return None;
    }
    for p in &mut positions {
        p.dwell_s *= left / sum;
    }
    Timeline::new(&platform.clone().into(), &Schedule::new(positions).unwrap()).ok()
}

fn random_criterion(random: &mut Random) -> Criterion {
    match (random.unit() * 4.0) as usize {
        0 => Criterion::D,
        1 => Criterion::E,
        2 => Criterion::max_ratio(CoefficientVector::from_fn(|_, _| {
            random.between(1e-3, 1e-1)
        })),
        _ => Criterion::weighted(CoefficientVector::from_fn(|_, _| random.unit())),
    }
}

/// The full run is `examples/06_certificate_validity.rs`; its output is in docs/certificate.md.
#[test]
fn no_random_schedule_is_below_its_bound() {
    let mut random = Random(6);
    let (mut seen, mut closest) = (0, f64::INFINITY);
    for _ in 0..16 {
        let config = random_platform(&mut random);
        let criterion = random_criterion(&mut random);
        let total_time_s = 10.0_f64.powf(random.between(2.3, 4.5));
        let platform = config.check().unwrap();
        let bound = Certifier::new(&platform)
            .bound(&criterion, total_time_s)
            .unwrap();
        let model = CovarianceModel::new(&platform);
        for _ in 0..60 {
            let Some(timeline) = random_schedule(&mut random, &config, total_time_s) else {
                continue;
            };
            let Ok(end) = model.end_covariance(&timeline, TickRule::Filter) else {
                continue;
            };
            let value = criterion.value(&end).unwrap();
            assert!(value >= bound.lower_bound, "{criterion:?} {config:?}");
            closest = closest.min(value / bound.lower_bound);
            let sigma = end.sigma_deg_per_h();
            assert!(
                sigma
                    .iter()
                    .zip(bound.sigma_deg_per_h.iter())
                    .all(|(s, b)| s >= b)
            );
            seen += 1;
        }
    }
    println!("{seen} schedules, closest {closest:.4}");
    assert!(seen > 600 && closest < 3.0);
}

/// Whatever errors a platform has, estimated or ignored, in any mounting, with an azimuth reference or
/// not: neither the exact chain nor the step-by-step filter knows a coefficient better than its bound.
/// The full run is that of `no_random_schedule_is_below_its_bound`.
#[test]
fn no_schedule_of_a_full_platform_is_below_its_bound() {
    let (mut seen, mut with_azimuth, mut closest) = (0, 0, f64::INFINITY);
    for case in 0..24 {
        let random = &mut Random::of_case(7700 + case);
        let mut config = full_model::random_platform(random);
        if case % 3 == 0 {
            // Nothing is lost to other errors where there are none.
            config.errors = Default::default();
        }
        let criterion = random_criterion(random);
        let total_time_s = 10.0_f64.powf(random.between(2.5, 4.2));
        let platform = config.check().unwrap();
        let bound = Certifier::new(&platform).bound(&criterion, total_time_s);
        let bound = bound.unwrap();
        let model = CovarianceModel::new(&platform);
        for k in 0..12 {
            let Some(timeline) = random_schedule(random, &config, total_time_s) else {
                continue;
            };
            let end = match k {
                0 => full_step_by_step(&platform, &timeline).unwrap().end,
                _ => model.full_covariance(&timeline).unwrap().end,
            };
            let value = criterion.value(&end).unwrap();
            assert!(value >= bound.lower_bound, "{criterion:?} {config:?}");
            let rms = Criterion::rms().value(&end).unwrap();
            assert!(rms >= bound.rms_sigma_deg_per_h, "{config:?}");
            let sigma = end.sigma_deg_per_h();
            let mut each = sigma.iter().zip(bound.sigma_deg_per_h.iter());
            assert!(each.all(|(s, b)| s >= b), "{config:?}");
            closest = closest.min(value / bound.lower_bound);
            with_azimuth += usize::from(config.azimuth.noise_arcsec.is_some());
            seen += 1;
        }
    }
    println!("{seen} schedules, {with_azimuth} with an azimuth, closest {closest:.4}");
    assert!(seen > 150 && with_azimuth > 40 && closest < 3.0);
}

fn rms_bound(change: impl FnOnce(&mut PlatformConfig)) -> f64 {
    let bound = certifier(change).criterion_bound(&Criterion::rms(), 12_000.0);
    bound.unwrap().lower_bound
}

/// The better the azimuth, the lower the bound; a useless one changes nothing.
#[test]
fn an_azimuth_lowers_the_bound() {
    let with = |noise| rms_bound(|c| c.azimuth.noise_arcsec = Some(noise));
    let without = rms_bound(|_| {});
    let bounds = [0.01, 1.0, 5.0, 50.0, 500.0].map(with);
    println!("{bounds:?} {without}");
    assert!(bounds.windows(2).all(|w| w[0] <= w[1] * (1.0 + 1e-3)));
    assert!(bounds[4] < without && with(1e6) > 0.999 * without && with(1e6) <= without);
    assert!((bounds[2] / 0.000_468_1 - 1.0).abs() < 5e-4);
    // At a pole the azimuth alone sees the vertical drift.
    let pole = |noise| {
        rms_bound(|c| {
            c.site.latitude_deg = 90.0;
            c.azimuth.noise_arcsec = noise;
        })
    };
    assert!(pole(None) > 2.0 && pole(Some(5.0)) < 0.000_5);
}

/// With equal priors and free gimbals a mounting is another basis of the same drifts: nothing that
/// treats all alike can tell. On an index table, and coefficient by coefficient, it can.
#[test]
fn the_mounting_is_the_platforms_own() {
    let quarter_turned =
        || -> OutputAxes { serde_json::from_str(r#"{"X": "+y", "Y": "+x", "Z": "-y"}"#).unwrap() };
    let oblique =
        || -> OutputAxes { serde_json::from_str(r#"{"X": [0.0, 0.6, 0.8], "Y": "-x"}"#).unwrap() };
    let papers = rms_bound(|_| {});
    let mounted = rms_bound(|c| c.gyro.output_axis = oblique());
    assert!((mounted / papers - 1.0).abs() < 2e-4, "{mounted} {papers}");
    let table = |axes: OutputAxes, weights: [f64; 12]| {
        let certifier = certifier(|c| {
            c.gimbals.step_deg = Some(90.0);
            c.gyro.output_axis = axes;
            c.filter.period_s = 50.0;
        });
        let weights = CoefficientVector::from_row_slice(&weights);
        let bound = certifier.criterion_bound(&Criterion::weighted(weights), 4000.0);
        bound.unwrap().lower_bound
    };
    // Output and spin axis of the three gyros change places, with signs.
    let outputs = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0];
    let spins = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0];
    let [plain, turned] = [
        table(OutputAxes::default(), spins),
        table(quarter_turned(), outputs),
    ];
    assert!((turned / plain - 1.0).abs() < 1e-3, "{turned} {plain}");
}

/// Errors that are taken as known leave the bound as it is, and are named.
#[test]
fn other_errors_are_taken_as_known_and_named() {
    let bound = |certifier: Certifier| certifier.bound(&Criterion::rms(), 6000.0).unwrap();
    let plain = bound(certifier(|_| {}));
    let full = bound(certifier(|c| {
        c.errors.estimated.torquer_scale_factor_ppm = Some(AxisValue::All(500.0));
        c.errors.estimated.accelerometer_bias_ug = Some(AxisValue::All(0.0));
        let considered = &mut c.errors.considered;
        considered.parameter.insert("K_1X".to_owned(), 20.0);
    }));
    assert!(plain.taken_as_known.is_empty() && plain.remarks.is_empty());
    let known = ["torquer_scale_factor_ppm", "accelerometer_scale_factor_ppm"];
    assert_eq!(full.taken_as_known, known);
    assert_eq!(full.remarks, [Remark::TakenAsKnown(known.to_vec())]);
    assert_eq!(full.lower_bound, plain.lower_bound);
    assert_eq!(full.sigma_deg_per_h, plain.sigma_deg_per_h);
}

#[test]
fn the_shortest_test_found_is_no_shorter_than_possible() {
    let spec_deg_per_h = CoefficientVector::repeat(0.002);
    let objective = Objective {
        spec_deg_per_h: Some(spec_deg_per_h),
        ..Objective::default()
    };
    let platform = PlatformConfig::default().check().unwrap();
    let minimum = Certifier::new(&platform).minimum_time(&spec_deg_per_h, 1e4);
    let MinimumTime::MoreThan(least_s) = minimum.unwrap() else {
        panic!("it takes a while");
    };
    let problem = SearchProblem {
        total_time_s: 14_400.0,
        starts: 4,
        ..SearchProblem::default()
    };
    let deadline = Instant::now() + Duration::from_secs(2);
    let control = Control::default().with_deadline(Some(deadline));
    let evaluator = Evaluator::new(platform, objective);
    let found = shortest(&evaluator, &problem, &control).unwrap();
    let time_s = found.evaluation.total_time_s;
    println!("{time_s} s, at least {least_s:.1} s");
    assert!(time_s > least_s && time_s < 1.5 * least_s);
}

#[test]
fn limits_raise_the_bound_and_never_lower_it() {
    let bound = |change: fn(&mut PlatformConfig)| {
        let certifier = certifier(change);
        let found = certifier.criterion_bound(&Criterion::rms(), 12_000.0);
        found.unwrap().lower_bound
    };
    let free = bound(|_| {});
    let table = bound(|c| c.gimbals.step_deg = Some(90.0));
    let narrow = bound(|c| {
        c.gimbals.alpha_deg = Some([-20.0, 20.0]);
        c.gimbals.beta_deg = Some([-20.0, 20.0]);
        c.gimbals.gamma_deg = Some([-20.0, 20.0]);
    });
    let middle = bound(|c| c.gimbals.beta_deg = Some([-60.0, 60.0]));
    println!("{free} {table} {narrow} {middle}");
    assert!(table > 1.5 * free && narrow > 2.5 * free);
    assert!((middle / free - 1.0).abs() < 1e-9);
}

#[test]
fn the_answer_does_not_depend_on_the_number_of_threads() {
    let bounds = [1, 2, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap()
            .install(|| certifier(|_| {}).bound(&Criterion::D, 5000.0).unwrap())
    });
    assert_eq!(bounds[0], bounds[1]);
    assert_eq!(bounds[0], bounds[2]);
}
