//! Drift and biases that wander: the chain and the step-by-step filter, against an independent dense
//! filter in 400 bits and against each other.

use scheme_opt::internals::covariance::filter::full_step_by_step;
use scheme_opt::internals::covariance::{CovarianceModel, TickRule};
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::{Test, Timeline};
use scheme_opt::internals::platform::{PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

use crate::battery::full::coloured_cases;
use crate::full_model::{check, random_platform};
use crate::support::Random;

#[test]
fn filter_and_chain_agree_with_the_reference_to_1e_6() {
    let cases = coloured_cases();
    assert_eq!(cases.len(), 4);
    for case in cases {
        let platform = case.config.check().unwrap();
        let timeline = Timeline::new(&platform.clone().into(), &case.schedule).unwrap();
        assert!((timeline.total_time_s() - case.total_time_s).abs() < 1e-3);
        let found = full_step_by_step(&platform, &timeline).unwrap();
        check(&case, "the filter", &platform, &found);
        let model = CovarianceModel::new(&platform);
        let found = model.full_covariance(&timeline).unwrap();
        check(&case, "the chain", &platform, &found);
    }
}

/// Some of what can wander, now and then with time constants short beside a filter period and long
/// beside the test.
pub fn wandering(config: &mut PlatformConfig, random: &mut Random, kinds: u32) {
    let has = |bit: u32| kinds >> bit & 1 == 1;
    let mut time_s = || 10.0_f64.powf(random.between(0.0, 5.0));
    let [of_gyros, of_accelerometers] = [time_s(), time_s()];
    let gyro = &mut config.gyro;
    if has(0) {
        gyro.rate_random_walk_deg_per_h_per_sqrt_h = Some(random.between(1e-4, 1e-2));
    }
    if has(1) {
        gyro.bias_instability_deg_per_h = Some(random.between(1e-4, 1e-2));
        gyro.bias_correlation_time_s = Some(of_gyros);
    }
    let accelerometer = &mut config.accelerometer;
    if has(2) {
        accelerometer.acceleration_random_walk_ug_per_sqrt_h = Some(random.between(0.1, 10.0));
    }
    if has(3) {
        accelerometer.bias_instability_ug = Some(random.between(0.1, 10.0));
        accelerometer.bias_correlation_time_s = Some(of_accelerometers);
    }
}

fn schedule(random: &mut Random, count: usize) -> Schedule {
    let held = (0..count).map(|_| {
        let dwell_s = random.between(5.0, 500.0);
        ScheduledPosition::new(random.position(), dwell_s)
    });
    Schedule::new(held.collect()).unwrap()
}

/// All combinations of what can wander, beside whatever else the platform has, however it moves.
#[test]
fn chain_and_filter_agree_for_any_combination() {
    // Of the paper's platform, and of what `full_model` asks 1e-7 of under white noise.
    let mut worst = [0.0_f64; 2];
    for case in 0..60 {
        let random = &mut Random::of_case(9100 + case);
        let mut config = match case % 4 {
            0 => PlatformConfig::default(),
            _ => random_platform(random),
        };
        wandering(&mut config, random, 1 + case as u32 % 15);
        let schedule = schedule(random, 3);
        let evaluator = Evaluator::new(config.check().unwrap(), Objective::default());
        let evaluation = evaluator
            .evaluate(&schedule)
            .unwrap_or_else(|e| panic!("case {case}: {e}\n{config:?}"));
        let found = evaluation.agreement;
        let (kind, most) = match case % 4 {
            0 => (0, 1e-8),
            _ => (1, 1e-7),
        };
        if found > 1e-9 {
            let mut white = config.clone();
            white.gyro.rate_random_walk_deg_per_h_per_sqrt_h = None;
            white.gyro.bias_instability_deg_per_h = None;
            white.gyro.bias_correlation_time_s = None;
            white.accelerometer.acceleration_random_walk_ug_per_sqrt_h = None;
            white.accelerometer.bias_instability_ug = None;
            white.accelerometer.bias_correlation_time_s = None;
            let evaluator = Evaluator::new(white.check().unwrap(), Objective::default());
            let of_white = evaluator.evaluate(&schedule).unwrap().agreement;
            println!("{case}: {found:.1e}, white {of_white:.1e}");
        }
        assert!(found < most, "{case}: {found:e}\n{config:?}");
        worst[kind] = worst[kind].max(found);
        let walks = config.gyro.rate_random_walk_deg_per_h_per_sqrt_h.is_some();
        for p in &evaluation.parameters {
            let is_constant = p.parameter.name.starts_with("D_F");
            assert_eq!(p.constant_part_sigma.is_some(), walks && is_constant);
        }
    }
    println!("worst of 60: {:.1e} and {:.1e}", worst[0], worst[1]);
}

/// In the middle of a test nothing is forgotten: what has been run, and then the rest, is the whole.
#[test]
fn an_interruption_changes_nothing() {
    for (case, repositioning) in [
        (1, Repositioning::Slew),
        (2, Repositioning::FrameHold),
        (3, Repositioning::Slew),
    ] {
        let random = &mut Random::of_case(9300 + case);
        let mut config = PlatformConfig::default();
        config.motion.repositioning = repositioning;
        if case == 3 {
            config.motion.slew_rate_deg_per_s = Some(0.7.into());
            config.motion.measure_moves = true;
        }
        wandering(&mut config, random, 15);
        let whole = schedule(random, 5);
        let part = |range: std::ops::Range<usize>| {
            Schedule::new(whole.positions()[range].to_vec()).unwrap()
        };
        let test = Test::from(config.check().unwrap());
        let sigma = |test: &Test, schedule: &Schedule| {
            let timeline = Timeline::new(test, schedule).unwrap();
            let model = CovarianceModel::new(test.platform());
            model.full_covariance(&timeline).unwrap().sigma()
        };
        let interrupted = test.clone().interrupted_after(part(0..2)).unwrap();
        let (found, expected) = (sigma(&interrupted, &part(2..5)), sigma(&test, &whole));
        assert_eq!(found, expected);
    }
}

/// Wandering that hardly wanders is none.
#[test]
fn a_little_wandering_is_nearly_white() {
    let random = &mut Random::of_case(9400);
    let schedule = schedule(random, 5);
    let sigma = |walk: Option<f64>| {
        let mut config = PlatformConfig::default();
        config.motion.slew_rate_deg_per_s = Some(0.7.into());
        config.gyro.rate_random_walk_deg_per_h_per_sqrt_h = walk;
        config.gyro.bias_instability_deg_per_h = walk;
        config.gyro.bias_correlation_time_s = walk.map(|_| 300.0);
        let platform = config.check().unwrap();
        let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
        let model = CovarianceModel::new(&platform);
        let end = model.end_covariance(&timeline, TickRule::Filter).unwrap();
        end.sigma_deg_per_h()
    };
    let white = sigma(None);
    let [little, more] = [1e-7, 1e-2].map(|walk| sigma(Some(walk)));
    assert!(((little - white).component_div(&white)).amax() < 1e-5);
    // And drift that wanders costs accuracy, of every coefficient.
    assert!(more.iter().zip(white.iter()).all(|(a, b)| a > b));
}
