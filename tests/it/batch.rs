//! Several schedules at once against one at a time.

use std::borrow::Cow;

use scheme_opt::internals::covariance::{
    CoefficientCovariance, CovarianceModel, CovarianceRoot, TickRule,
};
use scheme_opt::internals::criterion::{Criterion, Smoothing};
use scheme_opt::internals::drift::{CoefficientMatrix, CoefficientVector};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{Platform, PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

use crate::support::Random;

/// How the schedules of a batch are to differ.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// Angles only, moves that take no time; long enough to tell all coefficients.
    SameDurations,
    /// Numbers of positions and durations, moves that take time, a return.
    Slews,
    /// The same with measured moves and dwells shorter than a period.
    AllApart,
    /// As `AllApart`, with the moves of frame-hold repositioning.
    FrameHold,
}

fn platform(random: &mut Random, kind: Kind) -> Platform {
    let mut config = PlatformConfig::default();
    config.site.latitude_deg = random.between(-80.0, 80.0);
    match kind {
        Kind::SameDurations => {}
        Kind::Slews | Kind::AllApart => {
            config.motion.return_to_start = kind == Kind::Slews;
            config.motion.settle_s = 30.0;
            config.motion.slew_rate_deg_per_s = Some(1.0.into());
        }
        Kind::FrameHold => config.motion.repositioning = Repositioning::FrameHold,
    }
    config.check().unwrap()
}

fn timeline(random: &mut Random, platform: &Platform, kind: Kind) -> Timeline {
    let apart = kind != Kind::SameDurations;
    let count = if apart {
        8 + (random.unit() * 6.0) as usize
    } else {
        12
    };
    let positions = (0..count).map(|k| {
        let dwell_s = match apart {
            // Shorter than a period, whole, and neither.
            true if k == 2 && kind != Kind::Slews => 4.0,
            true if k % 2 == 0 => random.between(150.0, 900.0).round(),
            true => random.between(150.0, 900.0),
            false => 950.0 + 13.7 * k as f64,
        };
        ScheduledPosition {
            move_measured: (kind == Kind::AllApart).then(|| random.unit() < 0.3),
            ..ScheduledPosition::new(random.position(), dwell_s)
        }
    });
    Timeline::new(
        &platform.clone().into(),
        &Schedule::new(positions.collect()).unwrap(),
    )
    .unwrap()
}

/// How far a batch may be off: a rounding, times how much better some combinations are known than
/// others.
fn tolerance(kind: Kind) -> f64 {
    match kind {
        Kind::SameDurations => 1e-12,
        Kind::Slews | Kind::AllApart | Kind::FrameHold => 1e-10,
    }
}

/// 19 timelines: whole registers of them, and some to spare.
fn problem(seed: u64, kind: Kind) -> (CovarianceModel, Vec<Timeline>) {
    let mut random = Random(seed);
    let platform = platform(&mut random, kind);
    let timelines = (0..19)
        .map(|_| timeline(&mut random, &platform, kind))
        .collect();
    (CovarianceModel::new(&platform), timelines)
}

const KINDS: [Kind; 4] = [
    Kind::SameDurations,
    Kind::Slews,
    Kind::AllApart,
    Kind::FrameHold,
];

#[test]
fn values_are_those_of_single_schedules() {
    for (seed, kind) in KINDS.into_iter().enumerate() {
        let (model, timelines) = problem(seed as u64, kind);
        for rule in [TickRule::Relaxed, TickRule::Filter] {
            let rms = model.values(&timelines, rule, |p| Criterion::rms().value(p));
            let largest = model.values(&timelines, rule, |p| Criterion::E.value(p));
            for (i, timeline) in timelines.iter().enumerate() {
                let p = model.end_covariance_by_gram(timeline, rule).unwrap();
                let value = Criterion::rms().value(&p).unwrap();
                let error = (rms[i].as_ref().unwrap() / value - 1.0).abs();
                assert!(
                    error < tolerance(kind),
                    "{kind:?} {rule:?} {i}: RMS off by {error:e}"
                );
                let value = Criterion::E.value(&p).unwrap();
                let error = (largest[i].as_ref().unwrap() / value - 1.0).abs();
                assert!(
                    error < tolerance(kind),
                    "{kind:?} {rule:?} {i}: value off by {error:e}"
                );
            }
        }
    }
}

/// Whatever shares a group and whatever the lanes.
#[test]
fn a_value_depends_on_its_schedule_alone() {
    for (seed, kind) in KINDS.into_iter().enumerate() {
        let (mut model, timelines) = problem(20 + seed as u64, kind);
        for rule in [TickRule::Relaxed, TickRule::Filter] {
            let merit = |p: &dyn CoefficientCovariance| Criterion::rms().log(p, Smoothing::Exact);
            let values = |model: &CovarianceModel, of: &[Timeline]| -> Vec<u64> {
                let all = model.values(of, rule, merit).into_iter();
                all.map(|v| v.unwrap().to_bits()).collect()
            };
            let known = values(&model, &timelines);
            for (timeline, known) in timelines.iter().zip(&known) {
                let alone = model.value(timeline, rule, merit).unwrap();
                assert_eq!(alone.to_bits(), *known, "{kind:?} {rule:?} alone");
            }
            for lanes in [1, 4, 8] {
                model = model.with_most_lanes(lanes);
                for first in [0, 3, 7] {
                    let found = values(&model, &timelines[first..first + 9]);
                    assert_eq!(found, known[first..first + 9], "{kind:?} {lanes} lanes");
                }
            }
        }
    }
}

/// Whatever shares a group and whatever the lanes: the bits of the schedule alone.
#[test]
fn gradients_are_those_of_single_schedules() {
    for (seed, kind) in KINDS.into_iter().enumerate() {
        for criterion in [Criterion::rms(), Criterion::D] {
            let merit =
                |p: &dyn CoefficientCovariance| criterion.log_with_gradient(p, Smoothing::Exact);
            let (mut model, timelines) = problem(10 + seed as u64, kind);
            for rule in [TickRule::Relaxed, TickRule::Filter] {
                let alone: Vec<_> = timelines
                    .iter()
                    .map(|timeline| model.gradient(timeline, rule, merit).unwrap())
                    .collect();
                for lanes in [1, 4, 8] {
                    model = model.with_most_lanes(lanes);
                    for count in [19, 6, 5] {
                        let found = model.gradients(&timelines[..count], rule, merit);
                        for (found, alone) in found.iter().zip(&alone) {
                            assert_eq!(found.as_ref().unwrap(), alone, "{kind:?} {lanes} lanes");
                        }
                    }
                }
            }
        }
    }
}

struct Given(CovarianceRoot);

impl CoefficientCovariance for Given {
    fn matrix(&self) -> &CoefficientMatrix {
        self.0.matrix()
    }
    fn root(&self) -> Cow<'_, CovarianceRoot> {
        Cow::Borrowed(&self.0)
    }
}

#[test]
fn one_bad_schedule_does_not_upset_the_others() {
    let (model, timelines) = problem(5, Kind::AllApart);
    let merit =
        |p: &dyn CoefficientCovariance| Criterion::rms().log_with_gradient(p, Smoothing::Exact);
    let expected = model.gradients(&timelines, TickRule::Relaxed, merit);
    let worst = expected
        .iter()
        .map(|r| r.as_ref().unwrap().0)
        .fold(f64::NEG_INFINITY, f64::max);
    let refusing = |p: &dyn CoefficientCovariance| {
        let (value, slope) = merit(p)?;
        if value < worst {
            return Ok((value, slope));
        }
        // Without a number there is no determinant.
        let sigma = CoefficientVector::repeat(f64::NAN);
        let lost = Given(CovarianceRoot::independent(&sigma));
        Criterion::D.log_with_gradient(&lost, Smoothing::Exact)
    };
    let found = model.gradients(&timelines, TickRule::Relaxed, refusing);
    let refused = found.iter().filter(|r| r.is_err()).count();
    assert_eq!(refused, 1);
    for (a, b) in expected.iter().zip(&found) {
        if let (Ok(a), Ok(b)) = (a, b) {
            assert_eq!(a, b);
        }
    }
    assert!(model.values(&[], TickRule::Relaxed, |_| Ok(0.0)).is_empty());
}
