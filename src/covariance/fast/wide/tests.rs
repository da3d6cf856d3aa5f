use serde_json::{Value, json};

use super::super::mixing::{Kind, Mixing};
use super::{How, Wanted};
use crate::attitude::Position;
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CoefficientCovariance, CovarianceModel, Slope, TickRule};
use crate::criterion::{Criterion, Smoothing};
use crate::error::Result;
use crate::motion::Timeline;
use crate::platform::{Platform, PlatformConfig, Repositioning};
use crate::schedule::ScheduledPosition;

mod duals;
mod weights;

/// A small generator of its own: the same cases for ever.
pub(in crate::covariance::fast) struct Random(pub u64);

impl Random {
    pub fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// Keys and values of several objects in one.
pub(in crate::covariance::fast) fn merged(of: &[&Value]) -> Value {
    let all = of.iter().flat_map(|v| v.as_object().unwrap().clone());
    Value::Object(all.collect())
}

pub(in crate::covariance::fast) fn torquers() -> Value {
    json!({ "torquer_scale_factor_ppm": 1000.0, "torquer_misalignment_arcsec": 60.0 })
}

pub(in crate::covariance::fast) fn accelerometers() -> Value {
    json!({
        "accelerometer_bias_ug": 100.0,
        "accelerometer_scale_factor_ppm": 200.0,
        "accelerometer_misalignment_arcsec": 60.0,
        "accelerometer_second_order_ug_per_g2": 20.0,
    })
}

pub(in crate::covariance::fast) fn others() -> Value {
    json!({
        "quadratic_drift_deg_per_h_per_g2": 0.1,
        "accelerometer_third_order_ug_per_g3": 5.0,
        "accelerometer_cross_coupling_ug_per_g2": 20.0,
        "local_gravity_ug": 10.0,
    })
}

/// Tables of a platform file with the full error model, and the shape that they take.
fn selections() -> Vec<(Kind, Value)> {
    // One of the output axes is between the axes.
    let oblique = json!({ "output_axis": {
        "X": [0.0, 0.6, -0.8], "Y": [1.0, 0.0, 0.0], "Z": [0.0, -1.0, 0.0]
    } });
    let considering = |estimated: Value, considered: Value| {
        merged(&[&estimated, &json!({ "considered": considered })])
    };
    let everything = merged(&[&torquers(), &accelerometers(), &others()]);
    vec![
        (Kind::Instruments, json!({ "errors": torquers() })),
        (
            Kind::Instruments,
            json!({ "errors": merged(&[&torquers(), &accelerometers()]), "gyro": oblique }),
        ),
        (
            Kind::Instruments,
            json!({ "errors": considering(torquers(), accelerometers()) }),
        ),
        (
            Kind::Catalogue,
            json!({ "errors": everything, "gyro": oblique }),
        ),
        (
            Kind::Instruments,
            json!({ "azimuth": { "noise_arcsec": 5.0 }, "errors": accelerometers() }),
        ),
        (
            Kind::Catalogue,
            json!({ "errors": considering(
                json!({
                    "accelerometer_bias_ug": 100.0,
                    "accelerometer_scale_factor_ppm": 200.0,
                    "quadratic_drift_deg_per_h_per_g2": 0.1,
                }),
                merged(&[&torquers(), &json!({ "accelerometer_cross_coupling_ug_per_g2": 20.0 })]),
            ) }),
        ),
    ]
}

/// Platforms with every kind of step.
pub(in crate::covariance::fast) fn motions() -> Vec<Value> {
    vec![
        json!({}),
        json!({ "slew_rate_deg_per_s": 0.5, "settle_s": 13.0 }),
        json!({ "slew_rate_deg_per_s": 1.0, "measure_moves": true }),
        json!({ "repositioning": "frame-hold", "settle_s": 7.0 }),
        json!({
            "slew_rate_deg_per_s": 2.0, "start_deg": [5.0, 10.0, -20.0], "return_to_start": true
        }),
        json!({
            "slew_rate_deg_per_s": [0.5, 1.0, 2.0], "acceleration_deg_per_s2": [0.02, 0.1, 0.03],
            "settle_s": 13.0
        }),
        json!({
            "slew_rate_deg_per_s": 1.0, "acceleration_deg_per_s2": 0.04, "measure_moves": true
        }),
    ]
}

pub(in crate::covariance::fast) fn platform(selection: &Value, motion: &Value) -> Platform {
    let prior = json!({
        "constant_drift_deg_per_h": 0.1, "g_sensitive_drift_deg_per_h_per_g": 0.1
    });
    let all = merged(&[selection, &json!({ "motion": motion, "prior": prior })]);
    let config: PlatformConfig = serde_json::from_value(all).unwrap();
    config.check().unwrap()
}

/// Every selection with every kind of step.
fn for_each_platform(mut test: impl FnMut(&str, usize, &Platform)) {
    for (m, motion) in motions().iter().enumerate() {
        for (s, (_, selection)) in selections().iter().enumerate() {
            test(
                &format!("motion {m}, selection {s}"),
                m + s,
                &platform(selection, motion),
            );
        }
    }
}

/// Uneven dwells, the time of some moves given.
pub(in crate::covariance::fast) fn positions(
    random: &mut Random,
    platform: &Platform,
    count: usize,
) -> Vec<ScheduledPosition> {
    let moves = platform.motion().repositioning == Repositioning::Slew;
    let first = usize::from(platform.motion().start.is_none());
    (0..count)
        .map(|k| {
            let position = Position::from_deg(
                random.between(-170.0, 170.0),
                random.between(-80.0, 80.0),
                random.between(-170.0, 170.0),
            );
            let dwell_s = random.between(80.0, 330.0);
            ScheduledPosition {
                // Durations that do not follow the angles, so that derivatives are partial.
                move_s: (moves && k >= first).then(|| random.between(100.0, 400.0)),
                ..ScheduledPosition::new(position, dwell_s)
            }
        })
        .collect()
}

pub(in crate::covariance::fast) fn timeline(
    platform: &Platform,
    positions: &[ScheduledPosition],
) -> Timeline {
    Timeline::unchecked(&platform.clone().into(), positions.iter().copied())
}

/// A central difference of sixth order.
pub(in crate::covariance::fast) fn slope(h: f64, f: impl Fn(f64) -> f64) -> f64 {
    (45.0 * (f(h) - f(-h)) - 9.0 * (f(2.0 * h) - f(-2.0 * h)) + (f(3.0 * h) - f(-3.0 * h)))
        / (60.0 * h)
}

/// `positions` with the angle of one turned.
pub(in crate::covariance::fast) fn turned(
    positions: &[ScheduledPosition],
    k: usize,
    axis: usize,
    by: f64,
) -> Vec<ScheduledPosition> {
    let mut changed = positions.to_vec();
    let mut deg = changed[k].position.degrees();
    deg[axis] += by;
    changed[k].position = Position::from_deg(deg[0], deg[1], deg[2]);
    changed
}

/// Whether differences of the way to or from a position see more than its slope: where an axis turns by
/// nearly half a turn it may take the other way round, and where a corner of the rate is near the end of a
/// filter period its second derivative jumps.
pub(in crate::covariance::fast) fn is_rough(timeline: &Timeline, k: usize, period_s: f64) -> bool {
    let legs = timeline.legs();
    let at = timeline.positions().start + k;
    let moves = legs[at..].iter().take(2).filter_map(|leg| leg.arrival);
    moves.into_iter().any(|m| {
        let half_turn = m
            .change
            .iter()
            .any(|c| (c.abs().to_degrees() - 180.0).abs() < 1.0);
        let near_a_tick = |at_s: f64| (at_s / period_s - (at_s / period_s).round()).abs() < 0.06;
        half_turn || (m.measured && m.ramp() > 0.0 && m.corners_s().into_iter().any(near_a_tick))
    })
}

pub(in crate::covariance::fast) fn largest_angle(gradient: &[LegGradient]) -> f64 {
    let angles = gradient.iter().flat_map(|leg| leg.angles);
    angles.fold(0.0_f64, |m, a| m.max(a.abs()))
}

#[test]
fn selections_take_the_smallest_shape() {
    for (kind, selection) in selections() {
        let platform = platform(&selection, &json!({}));
        assert_eq!(Mixing::new(platform.errors(), &[]).kind, kind);
    }
}

/// Every parameter that there is, in whatever mounting.
#[test]
fn the_catalogue_has_every_feature() {
    let mut errors = serde_json::Map::new();
    for group in crate::model::optional_groups() {
        errors.insert(group.key.to_owned(), 1.0.into());
    }
    let oblique = &selections()[1].1["gyro"];
    for gyro in [&json!({}), oblique] {
        let platform = platform(&json!({ "errors": errors, "gyro": gyro }), &json!({}));
        let mixing = Mixing::new(platform.errors(), &[]);
        assert_eq!(mixing.kind, Kind::Catalogue);
        assert_eq!(mixing.order.size(), platform.errors().parameters().len());
    }
}

/// The exact chain shares neither shapes nor shifts nor sums of squares with the straight-line one.
#[test]
fn values_are_those_of_the_exact_chain() {
    let mut random = Random(7);
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
            assert!(
                (found / expected - 1.0).abs() < 1e-9,
                "{name}: {} {found} {expected}",
                criterion.name()
            );
        }
    });
}

#[test]
fn gradients_are_finite_differences() {
    let mut random = Random(11);
    for_each_platform(|name, number, platform| {
        let model = CovarianceModel::new(platform);
        let positions = positions(&mut random, platform, 5);
        let rule = TickRule::Relaxed;
        let criterion = &[Criterion::rms(), Criterion::D][number % 2];
        let at = |positions: &[ScheduledPosition]| {
            let log = |p: &dyn CoefficientCovariance| criterion.log(p, Smoothing::Exact);
            model
                .value(&timeline(platform, positions), rule, log)
                .unwrap()
        };
        let before = timeline(platform, &positions);
        let (value, gradient) = model
            .gradient(&before, rule, |p| {
                criterion.log_with_gradient(p, Smoothing::Exact)
            })
            .unwrap();
        assert!((value - at(&positions)).abs() < 1e-11);
        let first = before.positions().start;
        let returns = before.legs().len() > before.positions().end;
        let with = |change: &dyn Fn(&mut ScheduledPosition), k: usize| {
            let mut changed = positions.clone();
            change(&mut changed[k]);
            at(&changed)
        };
        let mut size = 0.0_f64;
        let mut errors = Vec::new();
        for k in 0..positions.len() {
            let leg = &gradient[first + k];
            if is_rough(&before, k, platform.period_s()) {
                continue;
            }
            // The way back takes as long as its angles say.
            if !(returns && k + 1 == positions.len()) {
                for axis in 0..3 {
                    let numeric = slope(0.05, |by| at(&turned(&positions, k, axis, by)));
                    let exact = leg.angles[axis].to_radians();
                    size = size.max(exact.abs());
                    errors.push((numeric - exact, format!("{k} axis {axis}")));
                }
            }
            let rest = positions[k].dwell_s % platform.period_s();
            if (0.5..9.5).contains(&rest) {
                let numeric = slope(0.1, |by| with(&|p| p.dwell_s += by, k));
                size = size.max(leg.dwell_s.abs());
                errors.push((numeric - leg.dwell_s, format!("{k} dwell")));
            }
            if let Some(move_s) = positions[k].move_s
                && (0.5..9.5).contains(&(move_s % platform.period_s()))
            {
                let numeric = slope(0.1, |by| with(&|p| p.move_s = Some(move_s + by), k));
                size = size.max(leg.move_s.abs());
                errors.push((numeric - leg.move_s, format!("{k} move")));
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

/// Moves that take no time: the torquers' errors turn into a jump of ψ.
#[test]
fn moves_without_duration_count_for_torquers() {
    let mut random = Random(23);
    for (_, selection) in selections() {
        let platform = &platform(&selection, &json!({}));
        let model = CovarianceModel::new(platform);
        let mut positions = positions(&mut random, platform, 8);
        for p in &mut positions {
            p.move_s = None;
        }
        let rule = TickRule::Relaxed;
        let at = |positions: &[ScheduledPosition]| {
            let log = |p: &dyn CoefficientCovariance| Criterion::rms().log(p, Smoothing::Exact);
            model
                .value(&timeline(platform, positions), rule, log)
                .unwrap()
        };
        let before = timeline(platform, &positions);
        let full = model.full_covariance_by::<f64>(&before, rule).unwrap().full;
        let expected = Criterion::rms().value(&full.end).unwrap();
        assert!((at(&positions).exp() / expected - 1.0).abs() < 1e-9);
        let (_, gradient) = model
            .gradient(&before, rule, |p| {
                Criterion::rms().log_with_gradient(p, Smoothing::Exact)
            })
            .unwrap();
        let size = largest_angle(&gradient);
        for (k, leg) in gradient.iter().enumerate() {
            assert_eq!(leg.move_s, 0.0);
            for axis in 0..3 {
                let numeric = slope(0.05, |by| at(&turned(&positions, k, axis, by)));
                let error = (numeric.to_degrees() - leg.angles[axis]).abs();
                assert!(error < 1e-7 * size, "{k} {axis}: {error:e} of {size:e}");
            }
        }
    }
}

/// The rows that the chain tells, triangularised, are what takes over where sums of squares lose
/// digits: the same numbers where they do not.
#[test]
fn rows_and_sums_of_squares_agree() {
    let mut random = Random(41);
    for_each_platform(|name, _, platform| {
        let model = CovarianceModel::new(platform);
        let timeline = timeline(platform, &positions(&mut random, platform, 6));
        for criterion in [Criterion::rms(), Criterion::D] {
            let log = |p: &dyn CoefficientCovariance| criterion.log(p, Smoothing::Exact);
            let slope =
                |p: &dyn CoefficientCovariance| criterion.log_with_gradient(p, Smoothing::Exact);
            let rule = TickRule::Relaxed;
            let value = model.value(&timeline, rule, log).unwrap();
            let by_rows = model.value_by_rows(&timeline, rule, log).unwrap();
            assert!((value - by_rows).abs() < 1e-10, "{name}: {value} {by_rows}");
            let (_, sums) = model.gradient(&timeline, rule, slope).unwrap();
            let (value, rows) = model.gradient_by_rows(&timeline, rule, slope).unwrap();
            assert!((value - by_rows).abs() < 1e-10);
            let all = |leg: &LegGradient| {
                [&leg.angles[..], &[100.0 * leg.dwell_s, 100.0 * leg.move_s]].concat()
            };
            let sums: Vec<f64> = sums.iter().flat_map(all).collect();
            let rows: Vec<f64> = rows.iter().flat_map(all).collect();
            let size = sums.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            for (a, b) in sums.iter().zip(&rows) {
                assert!((a - b).abs() < 1e-8 * size, "{name}: {a} {b} of {size}");
            }
        }
    });
}

/// Whatever shares a group and whatever the lanes: the bits of the schedule alone.
#[test]
fn lanes_have_the_bits_of_single_schedules() {
    let mut random = Random(31);
    for_each_platform(|name, number, platform| {
        let timelines: Vec<Timeline> = [5, 5, 4, 5, 3, 5, 5, 5, 5, 4, 5]
            .map(|count| timeline(platform, &positions(&mut random, platform, count)))
            .into();
        let criterion = &[Criterion::rms(), Criterion::D][number % 2];
        let slope =
            |p: &dyn CoefficientCovariance| criterion.log_with_gradient(p, Smoothing::Exact);
        let value = |p: &dyn CoefficientCovariance| criterion.log(p, Smoothing::Exact);
        let rule = [TickRule::Relaxed, TickRule::Filter][number / 2 % 2];
        let mut model = CovarianceModel::new(platform);
        let alone = |t: &Timeline| model.gradient(t, rule, slope).unwrap();
        let known: Vec<_> = timelines.iter().map(alone).collect();
        let values = |model: &CovarianceModel, of: &[Timeline]| -> Vec<u64> {
            let all = model.values(of, rule, value).into_iter();
            all.map(|v| v.unwrap().to_bits()).collect()
        };
        let all = values(&model, &timelines);
        for (of, (exact, _)) in all.iter().zip(&known) {
            assert!((f64::from_bits(*of) - exact).abs() < 1e-10, "{name}");
        }
        for lanes in [1, 4, 8] {
            model = model.with_most_lanes(lanes);
            assert_eq!(values(&model, &timelines[2..9]), all[2..9], "{name}");
            for count in [11, 5] {
                let found = model.gradients(&timelines[..count], rule, slope);
                for (found, known) in found.iter().zip(&known) {
                    assert_eq!(found.as_ref().unwrap(), known, "{name}, {lanes} lanes");
                }
            }
        }
    });
}

const BY_ROWS: How = How {
    by_rows: true,
    in_step: false,
};

impl CovarianceModel {
    fn value_by_rows(
        &self,
        timeline: &Timeline,
        rule: TickRule,
        mut merit: impl FnMut(&dyn CoefficientCovariance) -> Result<f64>,
    ) -> Result<f64> {
        let mixing = self.mixing.as_ref().unwrap();
        self.to_wide_end(mixing, timeline, rule, BY_ROWS, Wanted::Value(&mut merit))
    }

    fn gradient_by_rows(
        &self,
        timeline: &Timeline,
        rule: TickRule,
        mut merit: impl FnMut(&dyn CoefficientCovariance) -> Result<(f64, Slope)>,
    ) -> Result<(f64, Vec<LegGradient>)> {
        let mixing = self.mixing.as_ref().unwrap();
        self.wide_gradient_by(mixing, timeline, rule, BY_ROWS, &mut merit)
    }
}
