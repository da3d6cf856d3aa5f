//! The chain in plain and in counted numbers. How much arithmetic a schedule takes is counted, so
//! that it is the same on every machine and a change of it shows in a test. The counts are also what docs/benchmarks.md compares with the
//! rate of the core.

#![allow(
    clippy::suspicious_arithmetic_impl,
    reason = "operations are counted as they are done"
)]

use std::cell::Cell;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::arithmetic::{Arithmetic, InArray, Number, Plain, Row, Work, three};
use super::attitude_entries;
use super::course::{self, Legs, Stretch, Tape};
use super::earth::Earth;
use super::gains::{DwellKernel, Own};
use super::information::{complete, pulled_slope, symmetric_product, to_coefficients};
use super::moves::Interval;
use super::shape::{Drift, Facts};
use super::single::{ByFactors, OneTimeline};
use super::square::Entries;
use super::turn::{Ramp, Turn};
use crate::attitude::Position;
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CoefficientCovariance, CovarianceModel, Slope, TickRule};
use crate::criterion::{Criterion, Smoothing};
use crate::drift::COEFFICIENTS;
use crate::motion::Timeline;
use crate::motion::integral::Panels;
use crate::platform::PlatformConfig;
use crate::schedule::{Schedule, ScheduledPosition};

/// Operations on numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Operations {
    /// Products with a sum.
    fused: usize,
    /// Additions, subtractions and multiplications on their own.
    single: usize,
    /// Divisions and square roots.
    slow: usize,
}

thread_local! {
    static DONE: Cell<Operations> = const { Cell::new(Operations { fused: 0, single: 0, slow: 0 }) };
}

fn count(by: impl Fn(&mut Operations)) {
    DONE.with(|done| {
        let mut operations = done.get();
        by(&mut operations);
        done.set(operations);
    });
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Counted(f64);

impl Add for Counted {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        count(|o| o.single += 1);
        Self(self.0 + other.0)
    }
}
impl Sub for Counted {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        count(|o| o.single += 1);
        Self(self.0 - other.0)
    }
}
impl Mul for Counted {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        count(|o| o.single += 1);
        Self(self.0 * other.0)
    }
}
impl Div for Counted {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        count(|o| o.slow += 1);
        Self(self.0 / other.0)
    }
}
impl Neg for Counted {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0)
    }
}
impl Number for Counted {
    fn constant(self, value: f64) -> Self {
        Self(value)
    }
    fn mul_add(self, factor: Self, term: Self) -> Self {
        count(|o| o.fused += 1);
        Self(self.0 * factor.0 + term.0)
    }
    fn sqrt(self) -> Self {
        count(|o| o.slow += 1);
        Self(self.0.sqrt())
    }
    fn where_greater(self, left: Self, right: Self, otherwise: Self) -> Self {
        if left.0 > right.0 { self } else { otherwise }
    }
}

/// The arithmetic of one lane, counted.
#[derive(Debug, Clone, Copy)]
struct Counting;

impl Arithmetic for Counting {
    type Number = Counted;
    type Triple = InArray<Counted, 3>;
    type Quad = InArray<Counted, 4>;
    type Node = Counted;
    type Panels = Panels;
    const PASSES: usize = 4;

    fn always_apart<W: Work>(self, work: W) -> W::Output {
        work.run()
    }
    fn number(self, value: f64) -> Counted {
        Counted(value)
    }
    fn triple(self, entries: [Counted; 3]) -> Self::Triple {
        InArray(entries)
    }
    fn constants(self, padded: &[f64; 4]) -> Self::Triple {
        InArray([0, 1, 2].map(|i| Counted(padded[i])))
    }
    fn quad(self, entries: [Counted; 4]) -> Self::Quad {
        InArray(entries)
    }
    fn at_nodes(self, value: Counted) -> Counted {
        value
    }
    fn steps(self, panels: &Panels) -> usize {
        panels.steps()
    }
    fn panel_share(self, panels: &Panels) -> Counted {
        Counted(panels.share())
    }
    fn nodes(self, panels: &Panels, pass: usize, step: usize) -> [Counted; 2] {
        let (panel, group) = panels.group(step);
        [group.places[pass] + panel, group.weights[pass]].map(Counted)
    }
    fn sum_nodes(self, values: Counted) -> Counted {
        values
    }
}

/// A timeline in counted numbers.
struct CountedLegs<'a>(OneTimeline<'a, Plain>);

impl Legs<Counting> for CountedLegs<'_> {
    fn count(&self) -> usize {
        Legs::count(&self.0)
    }
    fn attitude(&self, leg: usize) -> Entries<Counted> {
        let c = attitude_entries(&self.0.timeline.legs()[leg].attitude);
        three!(|i| three!(|j| Counted(c[i][j])))
    }
    fn alpha(&self, leg: usize) -> (Counted, Counted) {
        let (sin, cos) = self.0.alpha(leg);
        (Counted(sin), Counted(cos))
    }
    fn rotates(&self, leg: usize) -> bool {
        self.0.rotates(leg)
    }
    fn stretches(&self, leg: usize) -> usize {
        self.0.stretches(leg)
    }
    fn stretch(&self, leg: usize, index: usize) -> Stretch<Counted, Panels> {
        let s = self.0.stretch(leg, index);
        Stretch {
            turn: Turn {
                from: s.turn.from.map(Counted),
                change: s.turn.change.map(Counted),
                duration_s: Counted(s.turn.duration_s),
                time: Counted(s.turn.time),
                instant: s.turn.instant,
                way: s.turn.way.map(Counted),
                ramp: s.turn.ramp.map(|ramp| Ramp {
                    by_duration: ramp.by_duration.map(Counted),
                    by_ramp: ramp.by_ramp.map(Counted),
                    ramp_by_change: ramp.ramp_by_change.map(Counted),
                }),
            },
            interval: Interval {
                start_s: Counted(s.interval.start_s),
                length_s: Counted(s.interval.length_s),
            },
            panels: s.panels,
            elapsed_s: Counted(s.elapsed_s),
            present: Counted(s.present),
            last: Counted(s.last),
            measured: s.measured.map(|(w, grows)| (Counted(w), Counted(grows))),
        }
    }
    fn settles(&self, leg: usize) -> bool {
        self.0.settles(leg)
    }
    fn settle_s(&self, leg: usize) -> Counted {
        Counted(self.0.settle_s(leg))
    }
    fn dwell(&self, leg: usize) -> Option<DwellKernel<Counting>> {
        let periods = self.0.periods(leg);
        (periods > 0)
            .then(|| DwellKernel::new(Counting, self.0.model.kernels.numbers(periods).get()))
    }
    fn azimuth(&self) -> Option<f64> {
        self.0.azimuth()
    }
    fn vertical(&self, leg: usize) -> Counted {
        Counted(self.0.vertical(leg))
    }
    fn remains(&self, leg: usize) -> bool {
        self.0.remains(leg)
    }
    fn remainder(&self, leg: usize) -> (Counted, Option<Counted>) {
        let (length, weight) = self.0.remainder(leg);
        (Counted(length), weight.map(Counted))
    }
}

fn timeline(count: usize, dwell_s: f64, slews: bool) -> (CovarianceModel, Timeline) {
    let mut config = PlatformConfig::default();
    if slews {
        config.motion.slew_rate_deg_per_s = Some(0.5.into());
        config.motion.settle_s = 30.0;
    }
    let platform = config.check().unwrap();
    let positions = (0..count).map(|k| {
        let k = k as f64;
        let angles = [0.3 + 2.1 * k, 1.1 * k * k, 1.7 * k];
        let position = Position::from_array(angles.map(|a| a % std::f64::consts::TAU));
        ScheduledPosition::new(position, dwell_s)
    });
    let schedule = Schedule::new(positions.collect()).unwrap();
    let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
    (CovarianceModel::new(&platform), timeline)
}

/// What `work` takes.
fn counted<T>(work: impl FnOnce() -> T) -> (T, Operations) {
    DONE.with(|done| done.set(Operations::default()));
    let result = work();
    (result, DONE.with(Cell::get))
}

fn trace_of(model: &CovarianceModel, timeline: &Timeline) -> f64 {
    let end = model.end_covariance_by_gram(timeline, TickRule::Relaxed);
    end.unwrap().coefficients.trace()
}

/// What P_D of a schedule takes in a lane.
fn operations(count: usize, dwell_s: f64, slews: bool) -> Operations {
    let (model, timeline) = timeline(count, dwell_s, slews);
    let legs = CountedLegs(OneTimeline {
        ar: Plain,
        model: &model,
        timeline: &timeline,
        rule: TickRule::Relaxed,
        keep_empty: false,
        facts: Facts::of::<Drift>(),
    });
    let earth = Earth::new(Counted(0.0), &model.dynamics, &model.stand, model.drift_psd);
    let mut tape = Tape {
        on: false,
        steps: Vec::new(),
    };
    let (covariance, done) = counted(|| {
        let mut gains = Own::new(Counting, &legs, &earth, &model.prior_psi);
        let chain = course::forward::<_, Drift>(Counting, &legs, &earth, &mut gains, &mut tape);
        let factor = chain.e.factor(Counting, &model.prior_scale);
        factor.covariance(Counting)
    });
    let trace: f64 = (0..COEFFICIENTS)
        .map(|i| covariance[i][i / 4].get(i % 4).0)
        .sum();
    assert!((trace / trace_of(&model, &timeline) - 1.0).abs() < 1e-12);
    done
}

#[test]
fn the_work_of_a_schedule_is_what_it_was() {
    let table = [
        operations(12, 1000.0, false),
        operations(12, 1003.7, false),
        operations(20, 503.7, true),
    ];
    let found: Vec<_> = table.iter().map(|o| (o.fused, o.single, o.slow)).collect();
    // (products with a sum, others, divisions and roots): twelve dwells, whole, with the rest of a
    // period at each end; twenty with slews.
    let known = [(10032, 4458, 192), (15396, 7254, 336), (63780, 54006, 590)];
    assert_eq!(found, known);
}

#[test]
fn work_grows_with_positions_and_not_with_time() {
    let of = |count, dwell_s| operations(count, dwell_s, false).fused;
    assert_eq!(of(12, 100.0), of(12, 100_000.0));
    assert_eq!(of(24, 500.0) - of(12, 500.0), of(36, 500.0) - of(24, 500.0));
}

/// The registers of this machine against plain numbers: the dispatched path must give the same
/// bits as the one that every machine has.
#[test]
fn one_schedule_has_the_same_bits_on_every_machine() {
    for (dwell_s, slews) in [(1000.0, false), (503.7, true)] {
        let (model, timeline) = timeline(9, dwell_s, slews);
        let legs = OneTimeline {
            ar: Plain,
            model: &model,
            timeline: &timeline,
            rule: TickRule::Relaxed,
            keep_empty: true,
            facts: Facts::of::<Drift>(),
        };
        let earth = model.earth();
        let mut tape = Tape {
            on: true,
            steps: Vec::new(),
        };
        let mut gains = Own::new(Plain, &legs, &earth, &model.prior_psi);
        let chain = course::forward::<_, Drift>(Plain, &legs, &earth, &mut gains, &mut tape);
        let factor = chain.e.factor(Plain, &model.prior_scale);
        let mut p = factor.covariance(Plain);
        let of = ByFactors {
            matrix: to_coefficients(&p),
            factor: &factor,
        };
        let merit =
            |p: &dyn CoefficientCovariance| Criterion::rms().log_with_gradient(p, Smoothing::Exact);
        let (value, slope) = merit(&of).unwrap();
        let Slope::Variances(slope) = slope else {
            panic!("the RMS is one of variances");
        };
        complete(Plain, &mut p);
        let information = symmetric_product(Plain, &p, &pulled_slope(Plain, &p, &slope));
        let mut gradient = vec![LegGradient::default(); timeline.legs().len()];
        let per_s = 1.0 / (model.period_s * model.noise_variance);
        course::backward(
            Plain,
            &legs,
            &earth,
            &tape.steps,
            &information,
            per_s,
            &mut gradient,
        );
        let dispatched = model.gradient(&timeline, TickRule::Relaxed, merit).unwrap();
        assert_eq!((value, gradient), dispatched);
    }
}
