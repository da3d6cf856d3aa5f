//! The paper's measure beside the methods it argues against.
//!
//! Three tables. What each method says of every coefficient of one schedule; how far each agrees
//! with the accuracy that the filter achieves, by Spearman's rank correlation over random
//! schedules; and what each costs. Run it with `cargo run --release --example
//! 04_methods_compared`; the times depend on the machine, everything else does not.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use std::time::Instant;

use nalgebra::{Quaternion, UnitQuaternion};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use scheme_opt::internals::attitude::Attitude;
use scheme_opt::internals::covariance::CovarianceModel;
use scheme_opt::internals::covariance::filter::step_by_step;
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::observability::Observability;
use scheme_opt::internals::observability::classical::{Measure, PiecewiseConstant, STATES, Units};
use scheme_opt::internals::platform::Platform;
use scheme_opt::settings::PlatformConfig;
use scheme_opt::{DriftCoefficient, Position, Schedule, ScheduledPosition, StandardScheme};

const TOTAL_S: f64 = 12_000.0;
const POSITIONS: usize = 12;
const SCHEDULES: usize = 400;

fn main() -> scheme_opt::Result<()> {
    let platform = PlatformConfig::default().check()?;
    let model = CovarianceModel::new(&platform);
    let optimal = StandardScheme::Icosahedron12.schedule(TOTAL_S, &platform.clone().into())?;
    one_schedule(&model, &Timeline::new(&platform.clone().into(), &optimal)?)?;
    agreement("attitudes at random", &model, &platform, |random| {
        (0..POSITIONS).map(|_| random_position(random)).collect()
    })?;
    agreement("12 of the 24 axis-aligned", &model, &platform, |random| {
        let mut positions = StandardScheme::Axis24.positions();
        positions.shuffle(random);
        positions.truncate(POSITIONS);
        positions
    })?;
    cost(&model, &platform, &optimal)
}

/// What each method says of every coefficient.
fn one_schedule(model: &CovarianceModel, timeline: &Timeline) -> scheme_opt::Result<()> {
    println!("icosahedron-12, {TOTAL_S} s: what each method says\n");
    print!("{:26}", "");
    for c in DriftCoefficient::ALL {
        print!("{:>8}", c.name());
    }
    println!();
    for measure in Measure::ALL {
        let values = measure.of(model, timeline)?;
        print!("{:26}", measure.name());
        for value in values.iter() {
            print!("{:>8}", short(*value));
        }
        println!();
    }
    println!("\nsingular values of the Lie-derivative matrix, largest and smallest:");
    for units in Units::ALL {
        let p = PiecewiseConstant::new(model, timeline, units);
        println!(
            "  {:18} {:9.3e} {:9.3e}  rank {} of {STATES}",
            units.name(),
            p.singular_values[0],
            p.singular_values[STATES - 1],
            p.rank
        );
    }
    Ok(())
}

/// Three digits in seven columns.
fn short(value: f64) -> String {
    match value {
        v if v == 0.0 || (0.01..1000.0).contains(&v) => format!("{v:.3}"),
        v if (1000.0..1e7).contains(&v) => format!("{v:.0}"),
        v => format!("{v:.0e}"),
    }
}

/// A uniform attitude: a normalised quaternion of normals.
fn random_position(random: &mut ChaCha8Rng) -> Position {
    let mut normal = || (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>();
    let quaternion = Quaternion::new(normal(), normal(), normal(), normal());
    let rotation = UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix();
    Attitude::from_rotation(rotation).position()
}

/// Spearman's rank correlation of each measure with the accuracy 1/sigma of the filter.
fn agreement(
    what: &str,
    model: &CovarianceModel,
    platform: &Platform,
    positions: impl Fn(&mut ChaCha8Rng) -> Vec<Position>,
) -> scheme_opt::Result<()> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    // values[measure][schedule][coefficient].
    let mut values = vec![Vec::with_capacity(SCHEDULES); Measure::ALL.len()];
    for _ in 0..SCHEDULES {
        let timeline = Timeline::new(
            &platform.clone().into(),
            &schedule(&positions(&mut random), &mut random)?,
        )?;
        for (slot, measure) in values.iter_mut().zip(Measure::ALL) {
            slot.push(measure.of(model, &timeline)?);
        }
    }
    let achieved = Measure::ALL
        .iter()
        .position(|m| *m == Measure::FilterCovariance)
        .map_or_else(Vec::new, |k| values[k].clone());
    println!("\n{SCHEDULES} schedules, {what}: rank correlation with the accuracy achieved\n");
    println!(
        "{:26}{:>13}{:>13}{:>13}{:>13}",
        "", "coefficients", "schedules,", "schedules,", "schedules,"
    );
    println!(
        "{:26}{:>13}{:>13}{:>13}{:>13}",
        "", "of one", "mean coeff.", "worst coeff.", "RMS"
    );
    for (measure, found) in Measure::ALL.iter().zip(&values) {
        let within = found
            .iter()
            .zip(&achieved)
            .map(|(a, b)| rank_correlation(a.as_slice(), b.as_slice()));
        let across: Vec<Option<f64>> = (0..DriftCoefficient::ALL.len())
            .map(|i| {
                let column = |v: &[nalgebra::SVector<f64, 12>]| -> Vec<f64> {
                    v.iter().map(|s| s[i]).collect()
                };
                rank_correlation(&column(found), &column(&achieved))
            })
            .collect();
        let least = across.iter().flatten().copied().reduce(f64::min);
        let overall = |v: &[nalgebra::SVector<f64, 12>]| -> Vec<f64> {
            v.iter()
                .map(|s| s.map(|x| x.powi(-2)).mean().powf(-0.5))
                .collect()
        };
        println!(
            "{:26}{:>13}{:>13}{:>13}{:>13}",
            measure.name(),
            shown(mean(within)),
            shown(mean(across.iter().copied())),
            shown(least),
            shown(rank_correlation(&overall(found), &overall(&achieved))),
        );
    }
    Ok(())
}

/// Dwells between 0.3 and 1.7 of the mean, in whole filter periods.
fn schedule(positions: &[Position], random: &mut ChaCha8Rng) -> scheme_opt::Result<Schedule> {
    let shares: Vec<f64> = positions
        .iter()
        .map(|_| random.random_range(0.3..1.7))
        .collect();
    let sum: f64 = shares.iter().sum();
    let held = positions.iter().zip(&shares).map(|(p, share)| {
        let dwell_s = (TOTAL_S * share / sum / 10.0).round() * 10.0;
        ScheduledPosition::new(*p, dwell_s)
    });
    Schedule::new(held.collect())
}

/// Mean of what there is; none when a correlation is not defined anywhere.
fn mean(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let defined: Vec<f64> = values.flatten().collect();
    (!defined.is_empty()).then(|| defined.iter().sum::<f64>() / defined.len() as f64)
}

fn shown(value: Option<f64>) -> String {
    value.map_or_else(|| "constant".to_owned(), |v| format!("{v:.3}"))
}

/// Time per schedule of each method, and as a multiple of the paper's.
fn cost(
    model: &CovarianceModel,
    platform: &Platform,
    schedule: &Schedule,
) -> scheme_opt::Result<()> {
    let timeline = Timeline::new(&platform.clone().into(), schedule)?;
    let paper = time(|| Measure::Order.of(model, &timeline).map(|_| ()))?;
    println!("\ncost per schedule of {POSITIONS} positions, 1200 filter periods\n");
    let line = |name: &str, seconds: f64| {
        println!(
            "{name:40}{:>10.1} us{:>8.2} x",
            1e6 * seconds,
            seconds / paper
        );
    };
    line("orders by row spaces (the paper)", paper);
    line(
        "orders, separability, combinations",
        time(|| Observability::analyze(model, &timeline).map(|_| ()))?,
    );
    for measure in [
        Measure::PiecewiseConstant(Units::Si),
        Measure::OutputSensitivity,
        Measure::Gramian,
    ] {
        line(
            measure.name(),
            time(|| measure.of(model, &timeline).map(|_| ()))?,
        );
    }
    line(
        "filter covariance P, step by step",
        time(|| step_by_step(platform, &timeline, &mut |_| {}).map(|_| ()))?,
    );
    line(
        "filter covariance P, dwell kernels",
        time(|| Measure::FilterCovariance.of(model, &timeline).map(|_| ()))?,
    );
    Ok(())
}

/// The fastest of many runs, s.
fn time(mut run: impl FnMut() -> scheme_opt::Result<()>) -> scheme_opt::Result<f64> {
    let mut fastest = f64::INFINITY;
    for _ in 0..200 {
        let start = Instant::now();
        run()?;
        fastest = fastest.min(start.elapsed().as_secs_f64());
    }
    Ok(fastest)
}

/// Spearman's rank correlation of two equally long lists, ties sharing their mean rank; none
/// where one of them is constant, holds a NaN, or there are fewer than two numbers.
fn rank_correlation(a: &[f64], b: &[f64]) -> Option<f64> {
    if a.len() != b.len() || a.iter().chain(b).any(|v| v.is_nan()) {
        return None;
    }
    let (a, b) = (ranks(a), ranks(b));
    let mean = (a.len() as f64 - 1.0) / 2.0;
    let product = |x: &[f64], y: &[f64]| -> f64 {
        x.iter().zip(y).map(|(x, y)| (x - mean) * (y - mean)).sum()
    };
    let size = (product(&a, &a) * product(&b, &b)).sqrt();
    (size > 0.0).then(|| product(&a, &b) / size)
}

/// Ranks from 0, ties sharing their mean. Values within 1e-9 of each other are ties.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&i, &j| values[i].total_cmp(&values[j]));
    let mut ranks = vec![0.0; values.len()];
    let mut first = 0;
    while first < order.len() {
        let lowest = values[order[first]];
        let tied = |&&i: &&usize| values[i] - lowest <= 1e-9 * lowest.abs();
        let count = order[first..].iter().take_while(tied).count().max(1);
        for &i in &order[first..first + count] {
            ranks[i] = first as f64 + (count as f64 - 1.0) / 2.0;
        }
        first += count;
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rank_correlation_knows_ties_and_opposites() {
        let up = [1.0, 2.0, 3.0, 4.0];
        let down = [4.0, 3.0, 2.0, 1.0];
        assert_eq!(rank_correlation(&up, &down), Some(-1.0));
        // Ranks 0.5 0.5 2.5 2.5 against 0 1 2 3: 4/√(4·5).
        let tied = rank_correlation(&[0.5, 0.5, 1.0, 1.0], &up).unwrap();
        assert!((tied - 4.0 / 20.0_f64.sqrt()).abs() < 1e-15);
        assert_eq!(rank_correlation(&up, &[f64::NAN; 4]), None);
        assert_eq!(rank_correlation(&[1.0], &[2.0]), None);
    }
}
