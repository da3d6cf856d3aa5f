//! Ratios to the step-by-step filter, measured in turn: the clock of a shared machine changes from
//! one second to the next, and what is measured minutes apart cannot be divided.

use std::hint::black_box;
use std::time::Instant;

use scheme_opt::internals::attitude::Attitude;
use scheme_opt::internals::covariance::TickRule;
use scheme_opt::internals::drift::CoefficientVector;

use crate::{Case, MANY, known_dwells, naive};

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

/// Prints the median over the rounds of what each takes for K = 12, its ratio to the filter, and
/// its share of the peak rate at `operations` per schedule.
pub fn print(operations: f64) {
    let case = Case::whole(12);
    let (platform, model, timeline) = (case.platform(), case.model(), case.timeline(0));
    let weights = CoefficientVector::repeat(1.0);
    let known = [8, 4].map(|lanes| known_dwells(case, lanes));
    let batch = |(dwells, attitudes): &(_, Vec<Vec<Attitude>>)| {
        let dwells: &scheme_opt::internals::covariance::DwellSequence = dwells;
        let all: Vec<&[Attitude]> = attitudes.iter().map(Vec::as_slice).collect();
        time(|| dwells.weighted_traces(black_box(&all), &weights)) / MANY as f64
    };
    let one = |(dwells, attitudes): &(
        scheme_opt::internals::covariance::DwellSequence,
        Vec<Vec<_>>,
    )| {
        let run = || {
            for attitudes in attitudes {
                let _ = black_box(dwells.weighted_trace(black_box(attitudes), &weights));
            }
        };
        time(run) / MANY as f64
    };
    let value = || {
        let run = || {
            for _ in 0..100 {
                let end = model.end_covariance_by_gram(black_box(&timeline), TickRule::Relaxed);
                let _ = black_box(end);
            }
        };
        time(run) / 100.0
    };
    let peak = || {
        let run = || {
            for _ in 0..20 {
                black_box(naive::peak_fma(black_box(1e-3)));
            }
        };
        time(run) / (20 * naive::PEAK_ITEMS * naive::lanes()) as f64
    };
    let names = [
        "value",
        "value, dwells known",
        "batch, dwells known, widest registers",
        "batch, dwells known, four lanes",
    ];
    let (mut filter, mut taken, mut ratios, mut shares) = (
        Vec::new(),
        [(); 4].map(|()| Vec::new()),
        [(); 4].map(|()| Vec::new()),
        Vec::new(),
    );
    for _ in 0..ROUNDS {
        let naive_s = time(|| naive::covariance_trace(&platform, black_box(&timeline)));
        let all = [value(), one(&known[0]), batch(&known[0]), batch(&known[1])];
        for (i, s) in all.into_iter().enumerate() {
            taken[i].push(s);
            ratios[i].push(naive_s / s);
        }
        shares.push(operations * peak() / all[2]);
        filter.push(naive_s);
    }
    println!("step-by-step filter: {:.0} µs", 1e6 * median(filter));
    for (name, (taken, ratio)) in names.iter().zip(taken.into_iter().zip(ratios)) {
        let (taken, ratio) = (1e6 * median(taken), median(ratio));
        println!("{name}: {taken:.3} µs, {ratio:.0} times faster");
    }
    println!("of the peak rate: {:.0} %", 100.0 * median(shares));
}
