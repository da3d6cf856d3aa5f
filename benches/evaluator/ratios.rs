//! Ratios to the step-by-step filter, measured in turn: the clock of a shared machine changes from
//! one second to the next, and what is measured minutes apart cannot be divided.

use std::hint::black_box;
use std::time::Instant;

use scheme_opt::internals::covariance::{CoefficientCovariance, CovarianceModel, TickRule};
use scheme_opt::internals::criterion::{Criterion, Smoothing};
use scheme_opt::internals::platform::PlatformConfig;

use crate::{Case, batch, naive, wide};

/// Rounds in which everything is measured once.
const ROUNDS: usize = 300;

/// Seconds that `work` takes.
fn time<T>(work: impl FnOnce() -> T) -> f64 {
    let began = Instant::now();
    black_box(work());
    began.elapsed().as_secs_f64()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Prints the median over the rounds of what a search computes, K = 12 with the dwells that it
/// has, and its ratio to the filter.
pub fn print() {
    let case = Case::relaxed(12);
    let (platform, model, timeline) = (case.platform(), case.model(), case.timeline(0));
    let (_, timelines) = batch(case);
    let many = timelines.len() as f64;
    let rule = TickRule::Relaxed;
    let log = |p: &dyn CoefficientCovariance| Criterion::rms().log(p, Smoothing::Exact);
    let slope =
        |p: &dyn CoefficientCovariance| Criterion::rms().log_with_gradient(p, Smoothing::Exact);
    let repeated = |work: &dyn Fn()| time(|| (0..50).for_each(|_| work())) / 50.0;
    let once: [(&str, &dyn Fn() -> f64); 4] = [
        ("value", &|| {
            repeated(&|| {
                let _ = black_box(model.value(black_box(&timeline), rule, log));
            })
        }),
        ("gradient", &|| {
            repeated(&|| {
                let _ = black_box(model.gradient(black_box(&timeline), rule, slope));
            })
        }),
        ("value in lanes", &|| {
            time(|| model.values(black_box(&timelines), rule, log)) / many
        }),
        ("gradient in lanes", &|| {
            time(|| model.gradients(black_box(&timelines), rule, slope)) / many
        }),
    ];
    let mut filter = Vec::new();
    let mut taken = [(); 4].map(|()| (Vec::new(), Vec::new()));
    for _ in 0..ROUNDS {
        let naive_s = time(|| naive::covariance_trace(&platform, black_box(&timeline)));
        for ((_, work), (times, ratios)) in once.iter().zip(&mut taken) {
            let s = work();
            times.push(s);
            ratios.push(naive_s / s);
        }
        filter.push(naive_s);
    }
    show(filter, once.map(|(name, _)| name), taken);
}

/// Medians.
fn show<const N: usize>(filter: Vec<f64>, names: [&str; N], taken: [(Vec<f64>, Vec<f64>); N]) {
    println!("step-by-step filter: {:.0} µs", 1e6 * median(filter));
    for (name, (times, ratios)) in names.iter().zip(taken) {
        let (taken, ratio) = (1e6 * median(times), median(ratios));
        println!("{name}: {taken:.3} µs, {ratio:.0} times faster");
    }
}

/// The same with 33 parameters. The filter takes so long that few rounds are enough.
pub fn print_wide() {
    let case = Case::relaxed(12);
    let (platform, timeline) = (wide::platform(), case.timeline(0));
    let (model, parameters) = (CovarianceModel::new(&platform), wide::parameters(&platform));
    let four = CovarianceModel::new(&platform).with_most_lanes(4);
    let (_, timelines) = batch(case);
    let many = timelines.len() as f64;
    let rule = TickRule::Relaxed;
    let log = |p: &dyn CoefficientCovariance| Criterion::rms().log(p, Smoothing::Exact);
    let slope =
        |p: &dyn CoefficientCovariance| Criterion::rms().log_with_gradient(p, Smoothing::Exact);
    let repeated = |work: &dyn Fn()| time(|| (0..50).for_each(|_| work())) / 50.0;
    let whole = Case::whole(12).timeline(0);
    let by_filter = wide::covariance_trace(&platform, &parameters, &whole);
    let trace = |p: &dyn CoefficientCovariance| Ok(p.matrix().trace());
    let found = model.value(&whole, TickRule::Filter, trace);
    let found = found.unwrap_or(f64::NAN);
    assert!(
        (found / by_filter - 1.0).abs() < 1e-3,
        "{found} {by_filter}"
    );
    let once: [(&str, &dyn Fn() -> f64); 6] = [
        ("value, 33 parameters", &|| {
            repeated(&|| {
                let _ = black_box(model.value(black_box(&timeline), rule, log));
            })
        }),
        ("gradient, 33 parameters", &|| {
            repeated(&|| {
                let _ = black_box(model.gradient(black_box(&timeline), rule, slope));
            })
        }),
        ("value in lanes, 33 parameters", &|| {
            time(|| model.values(black_box(&timelines), rule, log)) / many
        }),
        ("gradient in lanes, 33 parameters", &|| {
            time(|| model.gradients(black_box(&timelines), rule, slope)) / many
        }),
        ("value in four lanes, 33 parameters", &|| {
            time(|| four.values(black_box(&timelines), rule, log)) / many
        }),
        ("gradient in four lanes, 33 parameters", &|| {
            time(|| four.gradients(black_box(&timelines), rule, slope)) / many
        }),
    ];
    let mut filter = Vec::new();
    let mut taken = [(); 6].map(|()| (Vec::new(), Vec::new()));
    for _ in 0..ROUNDS / 10 {
        let naive_s = time(|| wide::covariance_trace(&platform, &parameters, black_box(&timeline)));
        for ((_, work), (times, ratios)) in once.iter().zip(&mut taken) {
            let s = work();
            times.push(s);
            ratios.push(naive_s / s);
        }
        filter.push(naive_s);
    }
    show(filter, once.map(|(name, _)| name), taken);
}

/// The same with a random walk of the drift, and the cost against white noise; K = 24.
pub fn print_wandering() {
    const WALK: f64 = 0.003;
    let case = Case::relaxed(24);
    let mut config = PlatformConfig::default();
    config.gyro.rate_random_walk_deg_per_h_per_sqrt_h = Some(WALK);
    let platform = config.check().unwrap();
    let (white, model) = (case.model(), CovarianceModel::new(&platform));
    let (_, timelines) = batch(case);
    let (timeline, many) = (&timelines[0], timelines.len() as f64);
    let rule = TickRule::Relaxed;
    let log = |p: &dyn CoefficientCovariance| Criterion::rms().log(p, Smoothing::Exact);
    let slope =
        |p: &dyn CoefficientCovariance| Criterion::rms().log_with_gradient(p, Smoothing::Exact);
    let whole = Case::whole(24).timeline(0);
    let by_filter = naive::wandering_trace(&platform, WALK, &whole);
    let trace = |p: &dyn CoefficientCovariance| Ok(p.matrix().trace());
    let found = model.value(&whole, TickRule::Filter, trace);
    let found = found.unwrap_or(f64::NAN);
    // The filter's walk goes in steps.
    assert!(
        (found / by_filter - 1.0).abs() < 1e-2,
        "{found} {by_filter}"
    );
    let value = |model: &CovarianceModel| {
        time(|| (0..50).for_each(|_| drop(black_box(model.value(timeline, rule, log))))) / 50.0
    };
    let gradient = |model: &CovarianceModel| {
        time(|| (0..50).for_each(|_| drop(black_box(model.gradient(timeline, rule, slope))))) / 50.0
    };
    let values = |model: &CovarianceModel| time(|| model.values(&timelines, rule, log)) / many;
    let gradients =
        |model: &CovarianceModel| time(|| model.gradients(&timelines, rule, slope)) / many;
    type Timed<'a> = (&'a str, &'a dyn Fn(&CovarianceModel) -> f64);
    let once: [Timed<'_>; 4] = [
        ("value, random walk", &value),
        ("gradient, random walk", &gradient),
        ("value in lanes, random walk", &values),
        ("gradient in lanes, random walk", &gradients),
    ];
    let mut filter = Vec::new();
    let mut taken = [(); 4].map(|()| (Vec::new(), Vec::new()));
    let mut costs = [(); 4].map(|()| Vec::new());
    for _ in 0..ROUNDS / 10 {
        let naive_s = time(|| naive::wandering_trace(&platform, WALK, black_box(timeline)));
        for (((_, work), (times, ratios)), costs) in once.iter().zip(&mut taken).zip(&mut costs) {
            let s = work(&model);
            times.push(s);
            ratios.push(naive_s / s);
            costs.push(s / work(&white));
        }
        filter.push(naive_s);
    }
    let names = once.map(|(name, _)| name);
    show(filter, names, taken);
    for (name, costs) in names.iter().zip(costs) {
        println!(
            "{name}: {:.1} times the time with white noise",
            median(costs)
        );
    }
}
