//! The certificate as a library caller sees it: no schedule is below its bound, and the bound is
//! close where it can be.

use std::time::{Duration, Instant};

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::certificate::{Certifier, Majorant, MinimumTime};
use scheme_opt::internals::covariance::{CovarianceModel, TickRule};
use scheme_opt::internals::criterion::Criterion;
use scheme_opt::internals::drift::CoefficientVector;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{AxisValue, PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use scheme_opt::internals::search::shortest::shortest;
use scheme_opt::internals::search::{Control, SearchProblem, search};

use crate::support::Random;

fn certifier(change: impl FnOnce(&mut PlatformConfig)) -> Certifier {
    let mut config = PlatformConfig::default();
    change(&mut config);
    Certifier::new(&config.check().unwrap())
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
    c.accelerometer.noise_g = 10.0_f64.powf(random.between(-6.5, -4.0));
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
        c.motion.slew_rate_deg_per_s = Some(random.between(0.1, 5.0));
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
    let moves = Timeline::new(&platform, &Schedule::new(positions.clone()).unwrap()).unwrap();
    let left = total_time_s - moves.overhead_s();
    if left <= 0.0 {
        return None;
    }
    for p in &mut positions {
        p.dwell_s *= left / sum;
    }
    Timeline::new(&platform, &Schedule::new(positions).unwrap()).ok()
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
