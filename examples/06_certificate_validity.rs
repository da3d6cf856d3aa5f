//! No schedule is below its bound: random and optimised schedules on random platforms.
//!
//! Sites, noises, priors, filter periods, gimbal limits, index tables, slews, settling, measured
//! moves, frame-hold, durations and criteria are all drawn at random; so are schedules, with
//! dwells that are no whole number of periods, zero-time, slewed, slow and measured moves. Every
//! schedule is evaluated and compared with the bound for its platform and duration, by the
//! criterion, the RMS σ and each σ.
//!
//! Random schedules are held against all three bounds, optimised ones against the criterion's.
//!
//! Full platforms have a random selection of all families of errors besides, estimated or only
//! considered, in a random mounting, with an azimuth reference or without. A third of their schedules
//! are random, the others better and better: each is the best so far, changed a little. All are
//! evaluated by the exact chain, the best one by the step-by-step filter too.
//!
//! `cargo run --release --example 06_certificate_validity -- [PLATFORMS [SCHEDULES [SEARCHES [FULL]]]]`
//! draws so many platforms, so many random schedules on each, runs so many short searches, and draws
//! so many full platforms with as many schedules on each.
#![allow(clippy::print_stdout, reason = "examples print what they show")]

use std::time::{Duration, Instant};

use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use scheme_opt::internals::certificate::{Bound, Certifier};
use scheme_opt::internals::covariance::filter::full_step_by_step;
use scheme_opt::internals::covariance::{CovarianceModel, EndCovariance, TickRule};
use scheme_opt::internals::criterion::Criterion;
use scheme_opt::internals::drift::CoefficientVector;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::Platform;
use scheme_opt::internals::search::{SearchProblem, search};
use scheme_opt::settings::{AxisValue, GSensitivePrior, PlatformConfig, Repositioning};
use scheme_opt::{Control, Position, Schedule, ScheduledPosition};

fn main() {
    let counts: Vec<usize> = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse().ok())
        .collect();
    let count = |i: usize, default| counts.get(i).copied().unwrap_or(default);
    let (platforms, schedules, searches) = (count(0, 100), count(1, 50), count(2, 20));
    let full_platforms = count(3, 20);
    let mut random = Tally::default();
    (0..platforms)
        .into_par_iter()
        .map(|seed| random_schedules(seed as u64, schedules))
        .collect::<Vec<_>>()
        .iter()
        .for_each(|t| random.add(t));
    random.print("random schedules");
    let mut optimised = Tally::default();
    (0..searches)
        .into_par_iter()
        .map(|seed| optimised_schedule(1_000_000 + seed as u64))
        .collect::<Vec<_>>()
        .iter()
        .for_each(|t| optimised.add(t));
    optimised.print("optimised schedules");
    let mut full = Tally::default();
    (0..full_platforms)
        .into_par_iter()
        .map(|seed| schedules_on_a_full_platform(2_000_000 + seed as u64, schedules))
        .collect::<Vec<_>>()
        .iter()
        .for_each(|t| full.add(t));
    full.print("full platforms");
    if random.below + optimised.below + full.below > 0 {
        std::process::exit(1);
    }
}

/// What was seen.
#[derive(Default)]
struct Tally {
    platforms: usize,
    refused: usize,
    schedules: usize,
    below: usize,
    /// value/bound of the criterion.
    ratios: Vec<f64>,
}

impl Tally {
    fn add(&mut self, other: &Self) {
        self.platforms += other.platforms;
        self.refused += other.refused;
        self.schedules += other.schedules;
        self.below += other.below;
        self.ratios.extend(&other.ratios);
    }

    fn print(&mut self, title: &str) {
        self.ratios.sort_by(f64::total_cmp);
        let at = |q: f64| {
            let last = self.ratios.len().saturating_sub(1) as f64;
            self.ratios
                .get((q * last) as usize)
                .copied()
                .unwrap_or(f64::NAN)
        };
        println!(
            "{title}: {} schedules on {} platforms ({} without a number), {} below their bound; \
             value/bound: least {:.6}, 1 % {:.4}, 10 % {:.4}, median {:.4}",
            self.schedules,
            self.platforms,
            self.refused,
            self.below,
            at(0.0),
            at(0.01),
            at(0.1),
            at(0.5)
        );
    }

    fn compare(
        &mut self,
        seed: u64,
        platform: &Platform,
        criterion: &Criterion,
        bound: &Bound,
        end: &EndCovariance,
    ) {
        let Ok(value) = criterion.value(end) else {
            self.refused += 1;
            return;
        };
        self.schedules += 1;
        self.ratios.push(value / bound.lower_bound);
        let rms = Criterion::rms().value(end).unwrap_or(f64::NAN);
        let sigma = end.sigma_deg_per_h();
        let each = sigma.iter().zip(bound.sigma_deg_per_h.iter());
        let holds = value >= bound.lower_bound
            && rms >= bound.rms_sigma_deg_per_h
            && each.clone().all(|(s, b)| s >= b);
        if !holds {
            self.below += 1;
            println!(
                "seed {seed}: {criterion:?} {value:e} against {:e}, rms {rms:e} against {:e}, {sigma:?} {:?} {platform:?}",
                bound.lower_bound, bound.rms_sigma_deg_per_h, bound.sigma_deg_per_h
            );
        }
    }
}

fn random_schedules(seed: u64, schedules: usize) -> Tally {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut tally = Tally {
        platforms: 1,
        ..Tally::default()
    };
    let platform = random_platform(&mut rng, true);
    let total_time_s = 10.0_f64.powf(rng.random_range(2.0..4.7));
    let criterion = random_criterion(&mut rng);
    let certifier = Certifier::new(&platform);
    let bound = match certifier.bound(&criterion, total_time_s) {
        Ok(bound) => bound,
        Err(e) => {
            println!("seed {seed}: {e}");
            tally.refused += 1;
            return tally;
        }
    };
    let model = CovarianceModel::new(&platform);
    for _ in 0..schedules {
        let Some(timeline) = random_timeline(&mut rng, &platform, total_time_s) else {
            continue;
        };
        match model.end_covariance(&timeline, TickRule::Filter) {
            Ok(end) => tally.compare(seed, &platform, &criterion, &bound, &end),
            Err(_) => tally.refused += 1,
        }
    }
    tally
}

fn schedules_on_a_full_platform(seed: u64, schedules: usize) -> Tally {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut tally = Tally {
        platforms: 1,
        ..Tally::default()
    };
    let platform = full_platform(&mut rng);
    let total_time_s = 10.0_f64.powf(rng.random_range(2.0..4.7));
    let criterion = random_criterion(&mut rng);
    let bound = match Certifier::new(&platform).bound(&criterion, total_time_s) {
        Ok(bound) => bound,
        Err(e) => {
            println!("seed {seed}: {e}");
            tally.refused += 1;
            return tally;
        }
    };
    let model = CovarianceModel::new(&platform);
    let mut best: Option<(f64, Vec<ScheduledPosition>, Timeline)> = None;
    for k in 0..schedules {
        let positions = match &best {
            Some((_, positions, _)) if 3 * k > schedules => changed(&mut rng, &platform, positions),
            _ => random_positions(&mut rng, &platform, total_time_s),
        };
        let fitted = fitted(&mut rng, &platform, total_time_s, positions.clone());
        let Some(timeline) = fitted else {
            continue;
        };
        let Ok(known) = model.full_covariance(&timeline) else {
            tally.refused += 1;
            continue;
        };
        tally.compare(seed, &platform, &criterion, &bound, &known.end);
        if let Ok(value) = criterion.value(&known.end)
            && best.as_ref().is_none_or(|b| value < b.0)
        {
            best = Some((value, positions, timeline));
        }
    }
    if let Some((_, _, timeline)) = best {
        match full_step_by_step(&platform, &timeline) {
            Ok(known) => tally.compare(seed, &platform, &criterion, &bound, &known.end),
            Err(_) => tally.refused += 1,
        }
    }
    tally
}

fn optimised_schedule(seed: u64) -> Tally {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut tally = Tally {
        platforms: 1,
        ..Tally::default()
    };
    // Every third on a platform with more errors.
    let platform = match seed % 3 {
        0 => full_platform(&mut rng),
        _ => random_platform(&mut rng, false),
    };
    let criterion = random_criterion(&mut rng);
    let objective = Objective {
        criterion: criterion.clone(),
        ..Objective::default()
    };
    let problem = SearchProblem {
        total_time_s: 10.0_f64.powf(rng.random_range(3.0..4.3)),
        max_positions: rng.random_range(5..14),
        starts: 2,
        seed,
        allow_tumbling: platform.gimbals().step_rad.is_none()
            && platform.motion().repositioning == Repositioning::Slew
            && rng.random_bool(0.1),
        ..SearchProblem::default()
    };
    let evaluator = Evaluator::new(platform.clone(), objective);
    let deadline = Instant::now() + Duration::from_millis(500);
    let control = Control::default().with_deadline(Some(deadline));
    let Ok(found) = search(&evaluator, &problem, &control) else {
        tally.refused += 1;
        return tally;
    };
    match Certifier::new(&platform).criterion_bound(&criterion, problem.total_time_s) {
        Ok(bound) => {
            let value = found.evaluation.score.criterion;
            tally.schedules += 1;
            tally.ratios.push(value / bound.lower_bound);
            if value < bound.lower_bound {
                tally.below += 1;
                println!("seed {seed}: {criterion:?} {value:e} {bound:?} {platform:?}");
            }
        }
        Err(e) => {
            println!("seed {seed}: {e}");
            tally.refused += 1;
        }
    }
    tally
}

/// A platform; `wild` ones reach into every corner, the others stay where a search is at home.
fn random_platform(rng: &mut ChaCha8Rng, wild: bool) -> Platform {
    let config = random_config(rng, wild);
    config.check().expect("drawn within what a platform allows")
}

/// A platform with some of the errors, each estimated or considered, in some mounting.
fn full_platform(rng: &mut ChaCha8Rng) -> Platform {
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
    let wild = rng.random_bool(0.3);
    let mut config = random_config(rng, wild);
    // On a third of the platforms nothing but the azimuth or the mounting is new.
    let share = [0.0, 0.3, 0.7][rng.random_range(0..3)];
    let mut errors = serde_json::json!({ "considered": {} });
    for (key, sigma) in GROUPS {
        let sigma = sigma * 10.0_f64.powf(rng.random_range(-4.0..1.0));
        if rng.random_bool(share) {
            match rng.random_bool(0.3) {
                true => errors["considered"][key] = sigma.into(),
                false => errors[key] = sigma.into(),
            }
        }
    }
    config.errors = serde_json::from_value(errors).expect("groups as they are named");
    if rng.random_bool(0.6) {
        let mut across = |axis: usize| {
            let (sin, cos) = rng.random_range(-3.1..3.1_f64).sin_cos();
            let mut vector = [0.0; 3];
            (vector[(axis + 1) % 3], vector[(axis + 2) % 3]) = (cos, sin);
            vector
        };
        let axes = serde_json::json!({ "X": across(0), "Y": across(1), "Z": across(2) });
        config.gyro.output_axis = serde_json::from_value(axes).expect("unit vectors across");
    }
    if rng.random_bool(0.6) {
        let within = if wild { -2.9..5.0 } else { -1.0..2.5 };
        config.azimuth.noise_arcsec = Some(10.0_f64.powf(rng.random_range(within)));
    }
    let free = config.gimbals == Default::default();
    if free && config.motion.repositioning == Repositioning::Slew && rng.random_bool(0.3) {
        config.motion.start_deg = Some([10.0, -50.0, 130.0]);
    }
    config.motion.return_to_start = rng.random_bool(0.2);
    config.check().expect("drawn within what a platform allows")
}

fn random_config(rng: &mut ChaCha8Rng, wild: bool) -> PlatformConfig {
    let mut c = PlatformConfig::default();
    let log =
        |rng: &mut ChaCha8Rng, low: f64, high: f64| 10.0_f64.powf(rng.random_range(low..high));
    c.site.latitude_deg = match rng.random_range(0..10) {
        0 => 90.0,
        1 => 0.0,
        _ => rng.random_range(-89.9..89.9),
    };
    c.filter.period_s = if wild {
        log(rng, 0.0, 2.5)
    } else {
        log(rng, 0.5, 1.5)
    };
    c.accelerometer.noise_g = Some(log(rng, -6.5, -3.5));
    c.gyro.random_drift_deg_per_h = Some(match rng.random_range(0..8) {
        0 if wild => 0.0,
        _ => log(rng, -3.5, -1.0),
    });
    if wild && rng.random_bool(0.3) {
        c.prior.misalignment_deg =
            AxisValue::PerAxis([0, 1, 2].map(|_| match rng.random_range(0..4) {
                0 => 0.0,
                _ => log(rng, -4.0, 0.5),
            }));
    }
    if rng.random_bool(0.4) {
        let sigma = |rng: &mut ChaCha8Rng| {
            AxisValue::PerAxis([0, 1, 2].map(|_| match rng.random_range(0..8) {
                0 if wild => 0.0,
                1 => log(rng, -3.5, 0.0),
                _ => log(rng, 0.0, 2.0),
            }))
        };
        c.prior.constant_drift_deg_per_h = sigma(rng);
        c.prior.g_sensitive_drift_deg_per_h_per_g = GSensitivePrior::PerAxis {
            input: sigma(rng),
            output: sigma(rng),
            spin: sigma(rng),
        };
    }
    limits(rng, &mut c);
    c
}

fn limits(rng: &mut ChaCha8Rng, c: &mut PlatformConfig) {
    let range = |rng: &mut ChaCha8Rng| {
        rng.random_bool(0.3).then(|| {
            let low = rng.random_range(-180.0..100.0);
            [low, low + rng.random_range(20.0..200.0)]
        })
    };
    c.gimbals.alpha_deg = range(rng);
    c.gimbals.beta_deg = range(rng);
    c.gimbals.gamma_deg = range(rng);
    if rng.random_bool(0.15) {
        c.gimbals = Default::default();
        c.gimbals.step_deg = Some([15.0, 30.0, 45.0, 90.0][rng.random_range(0..4)]);
    }
    if rng.random_bool(0.15) {
        c.motion.repositioning = Repositioning::FrameHold;
    } else {
        if rng.random_bool(0.5) {
            c.motion.slew_rate_deg_per_s = Some(10.0_f64.powf(rng.random_range(-1.5..1.5)).into());
        }
        c.motion.measure_moves = rng.random_bool(0.2);
    }
    if rng.random_bool(0.3) {
        c.motion.settle_s = rng.random_range(0.0..60.0);
    }
}

fn random_criterion(rng: &mut ChaCha8Rng) -> Criterion {
    match rng.random_range(0..6) {
        4 => {
            // An attitude error about three axes.
            let l = nalgebra::DMatrix::from_fn(3, 12, |_, _| rng.random_range(-1.0..1.0));
            Criterion::Use {
                weight: l.transpose() * l,
            }
        }
        0 => Criterion::weighted(
            CoefficientVector::from_fn(|_, _| {
                if rng.random_bool(0.3) {
                    0.0
                } else {
                    rng.random_range(0.0..1.0)
                }
            }) + CoefficientVector::repeat(1e-3),
        ),
        1 => Criterion::D,
        2 => Criterion::E,
        3 => Criterion::max_ratio(CoefficientVector::from_fn(|_, _| {
            if rng.random_bool(0.3) {
                f64::INFINITY
            } else {
                10.0_f64.powf(rng.random_range(-3.0..-1.0))
            }
        })),
        _ => Criterion::rms(),
    }
}

/// A schedule of the duration, or a little less; none when the moves leave no time.
fn random_timeline(
    rng: &mut ChaCha8Rng,
    platform: &Platform,
    total_time_s: f64,
) -> Option<Timeline> {
    let positions = random_positions(rng, platform, total_time_s);
    fitted(rng, platform, total_time_s, positions)
}

/// Angles that the gimbals can be set to.
fn random_position(rng: &mut ChaCha8Rng, platform: &Platform) -> Position {
    let gimbals = platform.gimbals();
    let angle = |rng: &mut ChaCha8Rng, axis: usize| {
        let (low, high) = gimbals.ranges[axis].map_or((-3.1, 3.1), |r| (r.low_rad, r.high_rad));
        let angle = rng.random_range(low..=high);
        gimbals
            .step_rad
            .map_or(angle, |step| step * (angle / step).round())
    };
    Position::from_rad(angle(rng, 0), angle(rng, 1), angle(rng, 2))
}

/// Positions with any shares of the time.
fn random_positions(
    rng: &mut ChaCha8Rng,
    platform: &Platform,
    total_time_s: f64,
) -> Vec<ScheduledPosition> {
    let count = rng.random_range(1..16);
    let gimbals = platform.gimbals();
    let mut positions: Vec<ScheduledPosition> = (0..count)
        .map(|_| {
            let position = random_position(rng, platform);
            ScheduledPosition::new(position, rng.random_range(0.0..1.0_f64))
        })
        .collect();
    let slews = platform.motion().repositioning == Repositioning::Slew;
    let table_stands = gimbals.step_rad.is_some() && platform.motion().slew.is_none();
    if slews && !table_stands && rng.random_bool(0.5) {
        for p in positions.iter_mut().skip(1) {
            if rng.random_bool(0.5) {
                p.move_measured = Some(rng.random_bool(0.5));
            }
            if platform.motion().slew.is_none() && rng.random_bool(0.5) {
                p.move_s = Some(total_time_s / count as f64 * rng.random_range(0.0..0.9));
            }
        }
    }
    positions
}

/// The same with one position a little elsewhere or anew, and other shares of the time.
fn changed(
    rng: &mut ChaCha8Rng,
    platform: &Platform,
    positions: &[ScheduledPosition],
) -> Vec<ScheduledPosition> {
    let mut positions = positions.to_vec();
    let gimbals = platform.gimbals();
    let k = rng.random_range(0..positions.len());
    let anew = random_position(rng, platform);
    let near = 10.0_f64.powf(rng.random_range(-2.5..0.0));
    let p = &mut positions[k];
    p.position = if gimbals.step_rad.is_some() || rng.random_bool(0.2) {
        anew
    } else {
        let mut angles = p.position.to_array();
        for (angle, range) in angles.iter_mut().zip(gimbals.ranges) {
            *angle += near * rng.random_range(-1.0..1.0);
            if let Some(r) = range {
                *angle = angle.clamp(r.low_rad, r.high_rad);
            }
        }
        Position::from_array(angles)
    };
    p.dwell_s *= 1.0 + 0.3 * near * rng.random_range(-1.0..1.0);
    if positions.len() < 16 && rng.random_bool(0.05) {
        let share = rng.random_range(0.0..1.0_f64);
        positions.push(ScheduledPosition::new(anew, share));
    }
    positions
}

/// The schedule with these shares of the duration as its dwells.
fn fitted(
    rng: &mut ChaCha8Rng,
    platform: &Platform,
    total_time_s: f64,
    mut positions: Vec<ScheduledPosition>,
) -> Option<Timeline> {
    let overhead = Timeline::new(
        &platform.clone().into(),
        &Schedule::new(positions.clone()).ok()?,
    )
    .ok()?
    .overhead_s();
    let left = total_time_s - overhead;
    if left <= 0.0 {
        return None;
    }
    let shares: f64 = positions.iter().map(|p| p.dwell_s).sum();
    let whole = rng.random_bool(0.5);
    for p in &mut positions {
        p.dwell_s *= left / shares;
        if whole {
            p.dwell_s = (p.dwell_s / platform.period_s()).floor() * platform.period_s();
        }
    }
    Timeline::new(&platform.clone().into(), &Schedule::new(positions).ok()?).ok()
}
