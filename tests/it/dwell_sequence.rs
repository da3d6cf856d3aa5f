//! Attitudes in known dwells against the evaluation that knows nothing beforehand.

use scheme_opt::internals::attitude::Attitude;
use scheme_opt::internals::covariance::{CovarianceModel, TickRule};
use scheme_opt::internals::drift::CoefficientVector;
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{AxisValue, Platform, PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

use crate::support::Random;

fn config(random: &mut Random) -> PlatformConfig {
    let mut config = PlatformConfig::default();
    config.site.latitude_deg = random.between(-85.0, 85.0);
    config.accelerometer.noise_g = 10f64.powf(random.between(-6.0, -4.0));
    config.motion.settle_s = random.between(0.0, 40.0);
    config.motion.start_deg = (random.unit() < 0.5).then_some([10.0, 0.0, -30.0]);
    config.motion.return_to_start = config.motion.start_deg.is_some();
    config
}

/// Dwells of a number of positions: shorter than a period, whole, and neither.
fn timeline(random: &mut Random, platform: &Platform, dwells: &[f64]) -> Timeline {
    let positions = dwells
        .iter()
        .map(|dwell_s| ScheduledPosition::new(random.position(), *dwell_s));
    Timeline::new(platform, &Schedule::new(positions.collect()).unwrap()).unwrap()
}

fn attitudes(timeline: &Timeline) -> Vec<Attitude> {
    let legs = timeline.position_legs();
    legs.iter().map(|leg| leg.attitude).collect()
}

#[test]
fn values_are_those_of_single_schedules() {
    let mut random = Random(3);
    for count in [1, 2, 7, 8, 9, 12, 17] {
        let platform = config(&mut random).check().unwrap();
        let dwells: Vec<f64> = (0..count)
            .map(|k| match k % 4 {
                0 => 400.0 + 10.0 * k as f64,
                1 => random.between(100.0, 900.0),
                2 => 700.0,
                _ => 4.0,
            })
            .collect();
        // Whole registers of them, and some to spare.
        let timelines: Vec<Timeline> = (0..19)
            .map(|_| timeline(&mut random, &platform, &dwells))
            .collect();
        let all: Vec<Vec<Attitude>> = timelines.iter().map(attitudes).collect();
        let all: Vec<&[Attitude]> = all.iter().map(Vec::as_slice).collect();
        let weights = CoefficientVector::from_fn(|i, _| 1.0 + i as f64);
        for rule in [TickRule::Filter, TickRule::Relaxed] {
            for lanes in [1, 4, 8] {
                let model = CovarianceModel::new(&platform).with_most_lanes(lanes);
                let sequence = model.dwell_sequence(&timelines[0], rule).unwrap();
                assert_eq!(sequence.count(), count);
                let several = sequence.weighted_traces(&all, &weights);
                for (i, timeline) in timelines.iter().enumerate() {
                    let end = model.end_covariance(timeline, rule).unwrap();
                    let expected = end.coefficients.diagonal().dot(&weights);
                    let alone = sequence.weighted_trace(all[i], &weights).unwrap();
                    for found in [alone, *several[i].as_ref().unwrap()] {
                        let error = (found / expected - 1.0).abs();
                        // A rounding, times how much better some combinations are known: with
                        // one or two positions the rest is known by the prior alone.
                        let most = if count < 7 { 1e-8 } else { 1e-10 };
                        assert!(error < most, "{count} {rule:?} {lanes} {i}: {error:e}");
                    }
                }
            }
        }
    }
}

#[test]
fn what_is_known_stays_known() {
    let mut config = PlatformConfig::default();
    config.prior.constant_drift_deg_per_h = AxisValue::PerAxis([15.0, 0.0, 15.0]);
    let platform = config.check().unwrap();
    let model = CovarianceModel::new(&platform);
    let mut random = Random(8);
    let timeline = timeline(&mut random, &platform, &[900.0; 12]);
    let sequence = model.dwell_sequence(&timeline, TickRule::Filter).unwrap();
    let end = model.end_covariance(&timeline, TickRule::Filter).unwrap();
    for i in 0..12 {
        let weights = CoefficientVector::from_fn(|k, _| if k == i { 1.0 } else { 0.0 });
        let found = sequence.weighted_trace(&attitudes(&timeline), &weights);
        let expected = end.coefficients[(i, i)];
        let found = found.unwrap_or(0.0);
        assert!(
            (found - expected).abs() <= 1e-10 * expected,
            "{i}: {found:e} {expected:e}"
        );
    }
}

#[test]
fn other_numbers_of_attitudes_are_refused_one_by_one() {
    let platform = PlatformConfig::default().check().unwrap();
    let model = CovarianceModel::new(&platform);
    let timeline = timeline(&mut Random(1), &platform, &[600.0; 3]);
    let sequence = model.dwell_sequence(&timeline, TickRule::Filter).unwrap();
    let attitudes = attitudes(&timeline);
    let weights = CoefficientVector::repeat(1.0);
    let found = sequence.weighted_traces(&[&attitudes, &attitudes[..2], &[]], &weights);
    assert!(found[0].is_ok());
    for refused in &found[1..] {
        assert!(refused.as_ref().is_err_and(|e| e.is_input()));
    }
    assert!(sequence.weighted_traces(&[], &weights).is_empty());
}

#[test]
fn there_is_none_where_attitudes_change_more_than_the_rows() {
    let mut slow = PlatformConfig::default();
    slow.motion.slew_rate_deg_per_s = Some(1.0);
    let mut hold = PlatformConfig::default();
    hold.motion.repositioning = Repositioning::FrameHold;
    for config in [slow, hold] {
        let platform = config.check().unwrap();
        let model = CovarianceModel::new(&platform);
        let timeline = timeline(&mut Random(2), &platform, &[600.0; 3]);
        assert!(model.dwell_sequence(&timeline, TickRule::Filter).is_none());
    }
}
