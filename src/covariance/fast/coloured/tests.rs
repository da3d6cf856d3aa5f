use serde_json::{Value, json};

use crate::covariance::fast::wide::How;
use crate::covariance::fast::wide::tests::{
    Random, accelerometers, is_rough, largest_angle, merged, motions, others, platform, positions,
    slope, timeline, torquers, turned,
};
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CoefficientCovariance, CovarianceModel, Slope, TickRule};
use crate::criterion::{Criterion, Smoothing};
use crate::error::Result;
use crate::motion::Timeline;
use crate::platform::Platform;
use crate::schedule::ScheduledPosition;

fn walk() -> Value {
    json!({ "rate_random_walk_deg_per_h_per_sqrt_h": 0.02 })
}

fn markov(time_s: f64) -> Value {
    json!({ "bias_instability_deg_per_h": 0.01, "bias_correlation_time_s": time_s })
}

fn biases() -> Value {
    json!({
        "acceleration_random_walk_ug_per_sqrt_h": 4.0,
        "bias_instability_ug": 3.0,
        "bias_correlation_time_s": 300.0,
    })
}

/// Tables of a platform file with all that can wander, of every size.
fn selections() -> Vec<Value> {
    let both = merged(&[&walk(), &markov(400.0)]);
    // Faster than moves and periods.
    let fast = markov(15.0);
    let instruments = merged(&[&torquers(), &accelerometers()]);
    let considering = merged(&[&torquers(), &json!({ "considered": accelerometers() })]);
    let everything = merged(&[&instruments, &others()]);
    vec![
        json!({ "gyro": walk() }),
        json!({ "gyro": fast }),
        json!({ "gyro": both, "errors": everything }),
        json!({ "gyro": walk(), "errors": considering, "azimuth": { "noise_arcsec": 5.0 } }),
        json!({ "gyro": both, "accelerometer": biases(), "errors": instruments }),
        json!({ "accelerometer": { "acceleration_random_walk_ug_per_sqrt_h": 4.0 } }),
    ]
}

/// Every selection with every kind of step.
pub(super) fn for_each_platform(mut test: impl FnMut(&str, usize, &Platform)) {
    for (m, motion) in motions().iter().enumerate() {
        for (s, selection) in selections().iter().enumerate() {
            let name = format!("motion {m}, selection {s}");
            test(&name, m + s, &platform(selection, motion));
        }
    }
}

pub(super) fn log(p: &dyn CoefficientCovariance) -> Result<f64> {
    Criterion::rms().log(p, Smoothing::Exact)
}

fn log_slope(p: &dyn CoefficientCovariance) -> Result<(f64, Slope)> {
    Criterion::rms().log_with_gradient(p, Smoothing::Exact)
}

/// The exact chain has other matrices, other moves and another way to the drift at the end.
#[test]
fn values_are_those_of_the_exact_chain() {
    let mut random = Random(7);
    let mut worst = 0.0_f64;
    for_each_platform(|name, number, platform| {
        let model = CovarianceModel::new(platform);
        let timeline = timeline(platform, &positions(&mut random, platform, 7));
        let rule = [TickRule::Filter, TickRule::Relaxed][number % 2];
        let full = model
            .full_covariance_by::<f64>(&timeline, rule)
            .unwrap()
            .full;
        for criterion in [Criterion::rms(), Criterion::D, Criterion::E] {
            let found = model
                .value(&timeline, rule, |p| criterion.value(p))
                .unwrap();
            let expected = criterion.value(&full.end).unwrap();
            let error = (found / expected - 1.0).abs();
            worst = worst.max(error);
            assert!(
                error < 3e-9,
                "{name}: {} {found} {expected} {error:e}",
                criterion.name()
            );
        }
    });
    println!("worst {worst:e}");
}

#[test]
fn gradients_are_finite_differences() {
    let mut random = Random(11);
    for_each_platform(|name, number, platform| {
        let model = CovarianceModel::new(platform);
        let positions = positions(&mut random, platform, 4);
        let rule = TickRule::Relaxed;
        let criterion = &[Criterion::rms(), Criterion::D][number % 2];
        let at = |positions: &[ScheduledPosition]| {
            let log = |p: &dyn CoefficientCovariance| criterion.log(p, Smoothing::Exact);
            let timeline = timeline(platform, positions);
            model.value(&timeline, rule, log).unwrap()
        };
        let before = timeline(platform, &positions);
        let merit =
            |p: &dyn CoefficientCovariance| criterion.log_with_gradient(p, Smoothing::Exact);
        let (value, gradient) = model.gradient(&before, rule, merit).unwrap();
        assert!((value - at(&positions)).abs() < 1e-11);
        let first = before.positions().start;
        let returns = before.legs().len() > before.positions().end;
        let mut size = 0.0_f64;
        let mut errors = Vec::new();
        let mut compare = |numeric: f64, exact: f64, of: String| {
            size = size.max(exact.abs());
            errors.push((numeric - exact, of));
        };
        for k in 0..positions.len() {
            let leg = &gradient[first + k];
            if is_rough(&before, k, platform.period_s()) {
                continue;
            }
            let with = |change: &dyn Fn(&mut ScheduledPosition)| {
                let mut changed = positions.clone();
                change(&mut changed[k]);
                at(&changed)
            };
            // The way back takes as long as its angles say.
            if !(returns && k + 1 == positions.len()) {
                for axis in 0..3 {
                    let numeric = slope(0.05, |by| at(&turned(&positions, k, axis, by)));
                    compare(
                        numeric,
                        leg.angles[axis].to_radians(),
                        format!("{k} axis {axis}"),
                    );
                }
            }
            let is_inside = |t: f64| (0.5..9.5).contains(&(t % platform.period_s()));
            if is_inside(positions[k].dwell_s) {
                let numeric = slope(0.1, |by| with(&|p| p.dwell_s += by));
                compare(numeric, leg.dwell_s, format!("{k} dwell"));
            }
            if let Some(move_s) = positions[k].move_s.filter(|t| is_inside(*t)) {
                let numeric = slope(0.1, |by| with(&|p| p.move_s = Some(move_s + by)));
                compare(numeric, leg.move_s, format!("{k} move"));
            }
        }
        for (error, of) in errors {
            assert!(
                error.abs() < 1e-7 * size,
                "{name}, {of}: {error:e} of {size:e}"
            );
        }
    });
}

/// Value and gradient by rows where sums of squares lose digits.
#[test]
fn rows_and_sums_of_squares_agree() {
    let mut random = Random(13);
    for_each_platform(|name, _, platform| {
        let model = CovarianceModel::new(platform);
        let coloured = model.coloured.as_deref().unwrap();
        let timeline = timeline(platform, &positions(&mut random, platform, 5));
        let rule = TickRule::Relaxed;
        let by_rows = How {
            by_rows: true,
            ..How::default()
        };
        let value = model
            .coloured_value_by(coloured, &timeline, rule, by_rows, &mut log)
            .unwrap();
        assert!(
            (value - model.value(&timeline, rule, log).unwrap()).abs() < 1e-9,
            "{name}"
        );
        let (_, expected) = model.gradient(&timeline, rule, log_slope).unwrap();
        let (_, found) = model
            .coloured_gradient_by(coloured, &timeline, rule, by_rows, &mut log_slope)
            .unwrap();
        let size = largest_angle(&expected);
        for (found, expected) in found.iter().zip(&expected) {
            let difference = |f: &dyn Fn(&LegGradient) -> f64| (f(found) - f(expected)).abs();
            for axis in 0..3 {
                assert!(difference(&|leg| leg.angles[axis]) < 1e-6 * size, "{name}");
            }
            assert!(difference(&|leg| leg.dwell_s) < 1e-6 * size, "{name}");
            assert!(difference(&|leg| leg.move_s) < 1e-6 * size, "{name}");
        }
    });
}

/// Schedules of different lengths and numbers of positions, with moves and without.
#[test]
fn lanes_have_the_bits_of_single_schedules() {
    let mut random = Random(17);
    for_each_platform(|name, number, platform| {
        let timelines: Vec<Timeline> = (0..11)
            .map(|k| {
                let mut all = positions(&mut random, platform, 3 + k % 3);
                if k % 4 == 1 {
                    // Stays where it is.
                    all[1].position = all[0].position;
                    all[1].move_s = None;
                }
                timeline(platform, &all)
            })
            .collect();
        let rule = [TickRule::Relaxed, TickRule::Filter][number % 2];
        let model = CovarianceModel::new(platform);
        let alone: Vec<f64> = timelines
            .iter()
            .map(|t| {
                let coloured = model.coloured.as_deref().unwrap();
                model
                    .coloured_value_in_step(coloured, t, rule, None, &mut log)
                    .unwrap()
            })
            .collect();
        let gradients: Vec<_> = timelines
            .iter()
            .map(|t| model.gradient(t, rule, log_slope).unwrap())
            .collect();
        for lanes in [8, 4, 1] {
            let model = CovarianceModel::new(platform).with_most_lanes(lanes);
            let values = model.values(&timelines, rule, log);
            for (k, value) in values.into_iter().enumerate() {
                assert_eq!(
                    value.unwrap().to_bits(),
                    alone[k].to_bits(),
                    "{name}, {lanes}, {k}"
                );
            }
            let found = model.gradients(&timelines, rule, log_slope);
            for (k, found) in found.into_iter().enumerate() {
                assert_eq!(found.unwrap(), gradients[k], "{name}, {lanes} lanes, {k}");
            }
        }
    });
}
