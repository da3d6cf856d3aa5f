//! Value, gradient, batch and step-by-step filters of a schedule of K dwells.
//!
//! `cargo bench --bench evaluator` prints what docs/benchmarks.md tabulates; every ratio there is
//! of two lines of one run. The named alternatives, over the same 12000 s in steps of 10 s, the
//! way such covariances are commonly computed:
//!
//! - `naive_filter`: the Kalman filter on the 15×15 covariance, nalgebra's static matrices;
//! - `square_root_filter`: the square-root filter on faer, which keeps its digits.
//!
//! `cargo bench --bench evaluator -- --ratios` measures the ratios to the first of them, in turn.
//!
//! `peak_fma` is the rate of fused multiply-adds that this core reaches on registers alone.

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    missing_docs,
    reason = "a bench has no callers, and prints"
)]

mod naive;
mod ratios;
#[path = "../../tests/battery/schedules.rs"]
mod schedules;
mod wide;

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use schedules::Case;
use scheme_opt::internals::covariance::filter::step_by_step;
use scheme_opt::internals::covariance::{CovarianceModel, TickRule};
use scheme_opt::internals::criterion::{Criterion, Smoothing};
use scheme_opt::internals::motion::Timeline;

fn main() {
    if std::env::args().any(|arg| arg == "--ratios") {
        ratios::print();
        ratios::print_wide();
        ratios::print_wandering();
    } else {
        divan::main();
    }
}

/// Numbers of positions.
const COUNTS: [usize; 4] = [8, 12, 24, 48];
/// Schedules in a batch.
const BATCH: usize = 64;

impl Case {
    fn timeline(&self, index: usize) -> Timeline {
        Timeline::new(&self.platform().into(), &self.schedule(index)).unwrap()
    }

    fn model(&self) -> CovarianceModel {
        CovarianceModel::new(&self.platform())
    }
}

fn bench_value(bencher: Bencher<'_, '_>, case: Case) {
    let (model, timeline) = (case.model(), case.timeline(0));
    bencher.counter(ItemsCount::new(1_usize)).bench(|| {
        model
            .value(black_box(&timeline), TickRule::Relaxed, |p| {
                Criterion::rms().log(p, Smoothing::Exact)
            })
            .unwrap()
    });
}

fn bench_gradient(bencher: Bencher<'_, '_>, case: Case) {
    let (model, timeline) = (case.model(), case.timeline(0));
    bencher.counter(ItemsCount::new(1_usize)).bench(|| {
        model
            .gradient(black_box(&timeline), TickRule::Relaxed, |p| {
                Criterion::rms().log_with_gradient(p, Smoothing::Exact)
            })
            .unwrap()
    });
}

fn batch(case: Case) -> (CovarianceModel, Vec<Timeline>) {
    let timelines = (0..BATCH).map(|i| case.timeline(i)).collect();
    (case.model(), timelines)
}

fn bench_batch_value(bencher: Bencher<'_, '_>, case: Case) {
    let (model, timelines) = batch(case);
    bencher.counter(ItemsCount::new(BATCH)).bench(|| {
        model.values(black_box(&timelines), TickRule::Relaxed, |p| {
            Criterion::rms().log(p, Smoothing::Exact)
        })
    });
}

fn bench_batch_gradient(bencher: Bencher<'_, '_>, case: Case) {
    let (model, timelines) = batch(case);
    bencher.counter(ItemsCount::new(BATCH)).bench(|| {
        model.gradients(black_box(&timelines), TickRule::Relaxed, |p| {
            Criterion::rms().log_with_gradient(p, Smoothing::Exact)
        })
    });
}

#[divan::bench(args = COUNTS)]
fn value(bencher: Bencher<'_, '_>, count: usize) {
    bench_value(bencher, Case::whole(count));
}

#[divan::bench(args = COUNTS)]
fn value_relaxed(bencher: Bencher<'_, '_>, count: usize) {
    bench_value(bencher, Case::relaxed(count));
}

#[divan::bench]
fn value_slews(bencher: Bencher<'_, '_>) {
    bench_value(bencher, Case::slews());
}

/// The same schedule of twelve positions over ever longer tests.
#[divan::bench(args = [1_200.0, 12_000.0, 120_000.0])]
fn value_by_duration(bencher: Bencher<'_, '_>, total_s: f64) {
    bench_value(bencher, Case::whole(12).lasting(total_s));
}

#[divan::bench(args = COUNTS)]
fn gradient(bencher: Bencher<'_, '_>, count: usize) {
    bench_gradient(bencher, Case::relaxed(count));
}

#[divan::bench]
fn gradient_slews(bencher: Bencher<'_, '_>) {
    bench_gradient(bencher, Case::slews());
}

#[divan::bench(args = COUNTS)]
fn batch_value(bencher: Bencher<'_, '_>, count: usize) {
    bench_batch_value(bencher, Case::whole(count));
}

#[divan::bench(args = COUNTS)]
fn batch_value_relaxed(bencher: Bencher<'_, '_>, count: usize) {
    bench_batch_value(bencher, Case::relaxed(count));
}

#[divan::bench]
fn batch_value_slews(bencher: Bencher<'_, '_>) {
    bench_batch_value(bencher, Case::slews());
}

#[divan::bench(args = COUNTS)]
fn batch_gradient(bencher: Bencher<'_, '_>, count: usize) {
    bench_batch_gradient(bencher, Case::relaxed(count));
}

#[divan::bench]
fn batch_gradient_slews(bencher: Bencher<'_, '_>) {
    bench_batch_gradient(bencher, Case::slews());
}

#[divan::bench(args = [12], sample_count = 20)]
fn naive_filter(bencher: Bencher<'_, '_>, count: usize) {
    let case = Case::whole(count);
    let (platform, timeline) = (case.platform(), case.timeline(0));
    bencher
        .counter(ItemsCount::new(1_usize))
        .bench(|| naive::covariance_trace(&platform, black_box(&timeline)));
}

#[divan::bench(args = [12], sample_count = 20)]
fn square_root_filter(bencher: Bencher<'_, '_>, count: usize) {
    let case = Case::whole(count);
    let (platform, timeline) = (case.platform(), case.timeline(0));
    bencher
        .counter(ItemsCount::new(1_usize))
        .bench(|| step_by_step(&platform, black_box(&timeline), &mut |_| {}).unwrap());
}

#[divan::bench]
fn peak_fma(bencher: Bencher<'_, '_>) {
    bencher
        .counter(ItemsCount::new(naive::PEAK_ITEMS * naive::lanes()))
        .bench(|| naive::peak_fma(black_box(1e-3)));
}
