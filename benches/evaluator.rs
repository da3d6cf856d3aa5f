//! Value, gradient and step-by-step filter of a schedule of K dwells.
//!
//! `cargo bench --bench evaluator` prints the table of docs/benchmarks.md and the ratios beside
//! it. The fair peer is the square-root filter at 10 s steps over the same 12000 s, the way such
//! covariances are commonly computed.

#![allow(clippy::unwrap_used, missing_docs, reason = "a bench has no callers")]

use divan::{Bencher, black_box};
use scheme_opt::attitude::Position;
use scheme_opt::covariance::reference::step_by_step;
use scheme_opt::covariance::{CovarianceModel, TickRule};
use scheme_opt::criterion::{Criterion, Smoothing};
use scheme_opt::motion::Timeline;
use scheme_opt::platform::{Platform, PlatformConfig};
use scheme_opt::schedule::{Schedule, ScheduledPosition};

fn main() {
    divan::main();
}

/// Numbers of positions.
const COUNTS: [usize; 3] = [8, 12, 24];
/// Duration of the test, s.
const TOTAL_S: f64 = 12_000.0;

fn problem(count: usize) -> (Platform, Timeline) {
    let platform = PlatformConfig::default().check().unwrap();
    let dwell = (TOTAL_S / count as f64 / 10.0).floor() * 10.0;
    let positions = (0..count).map(|k| {
        let k = k as f64;
        let angles = [0.3 + 2.1 * k, 1.1 * k * k, 1.7 * k * k * k];
        let angles = angles.map(|a| a % std::f64::consts::TAU);
        ScheduledPosition::new(Position::from_array(angles), dwell)
    });
    let schedule = Schedule::new(positions.collect()).unwrap();
    let timeline = Timeline::new(&platform, &schedule).unwrap();
    (platform, timeline)
}

#[divan::bench(args = COUNTS)]
fn value(bencher: Bencher<'_, '_>, count: usize) {
    let (platform, timeline) = problem(count);
    let model = CovarianceModel::new(&platform);
    bencher.bench(|| {
        let end = model
            .end_covariance_by_gram(black_box(&timeline), TickRule::Filter)
            .unwrap();
        Criterion::rms().value(&end.coefficients).unwrap()
    });
}

#[divan::bench(args = COUNTS)]
fn gradient(bencher: Bencher<'_, '_>, count: usize) {
    let (platform, timeline) = problem(count);
    let model = CovarianceModel::new(&platform);
    bencher.bench(|| {
        model
            .gradient(black_box(&timeline), TickRule::Relaxed, |p| {
                Criterion::rms().log_with_gradient(p, Smoothing::Exact)
            })
            .unwrap()
    });
}

#[divan::bench(args = COUNTS)]
fn step_by_step_filter(bencher: Bencher<'_, '_>, count: usize) {
    let (platform, timeline) = problem(count);
    bencher.bench(|| step_by_step(&platform, black_box(&timeline), &mut |_| {}).unwrap());
}
