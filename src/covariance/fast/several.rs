//! Many schedules at once: one per lane of the machine's registers.
//!
//! The straight-line chain ([`fast`](super)) runs on registers of eight lanes
//! (AVX-512), four (AVX2) or two (NEON), whatever the machine has when the program runs; without
//! any of them on one. Schedules are grouped by their number of positions; in a group each lane
//! has its own angles, durations and moves, and a schedule with fewer positions waits.
//!
//! Lanes do not fuse products and sums: every lane does the operations of
//! [`single`](super::single) in its order, whatever shares the group, whatever the instruction set.
//! So what a schedule gives depends on the schedule alone. Nothing depends on threads.

#![allow(
    clippy::needless_range_loop,
    reason = "indices are the formulas' own, and closures would not be compiled with the caller"
)]

pub(crate) mod between;
pub(super) mod gradients;
mod wide;

use std::borrow::Cow;
use std::cell::OnceCell;

use pulp::Simd;

use super::arithmetic::{
    Alignment, Arithmetic, Lanes, MOST_LANES, Plain, Register, Row, Work, three,
};
use super::attitude_entries;
use super::course::{Legs, Stretch, Tape};
use super::dispatch::{LaneTask, run_in_lanes};
use super::gains::DwellKernel;
use super::information::{Factor, Information, PLACES, PriorScale, Rows, in_order, keeps_digits};
use super::moves::Interval;
use super::shape::{Drift, Facts};
use super::single::OneTimeline;
use super::square::Entries;
use super::turn::{Ramp, Turn};
use crate::covariance::kernel_table::LookedUp;
use crate::covariance::{
    CoefficientCovariance, CovarianceModel, CovarianceRoot, Rooted, TickRule, not_finite,
    split_periods,
};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector};
use crate::error::Result;
use crate::motion::integral::Panels;
use crate::motion::{Leg, Move, Timeline};
use between::{Between, run};
pub(super) use wide::Slopes;

type Lane<S, L> = Register<S, L>;

/// One timeline per lane; the last one again in lanes to spare.
pub(super) struct Group<'a, S, L> {
    pub ar: Lanes<S, L>,
    pub timelines: Vec<OneTimeline<'a, Plain>>,
    legs: usize,
}

impl<'a, S: Simd, L: Alignment> Group<'a, S, L> {
    fn new(ar: Lanes<S, L>, timelines: Vec<OneTimeline<'a, Plain>>) -> Self {
        let legs = timelines.iter().map(Legs::count).max().unwrap_or(0);
        Self {
            ar,
            timelines,
            legs,
        }
    }

    pub fn lane(&self, i: usize) -> &OneTimeline<'a, Plain> {
        &self.timelines[i.min(self.timelines.len() - 1)]
    }

    /// `value` of every lane, with its timeline.
    #[inline(always)]
    pub fn gather(&self, value: impl Fn(&OneTimeline<'a, Plain>) -> f64) -> Lane<S, L> {
        let mut values = [0.0; MOST_LANES];
        for (i, slot) in values.iter_mut().enumerate().take(S::F64_LANES) {
            *slot = value(self.lane(i));
        }
        Register::gather(self.ar.0, &values)
    }

    fn any(&self, leg: usize, has: impl Fn(&OneTimeline<'a, Plain>) -> bool) -> bool {
        self.timelines.iter().any(|t| leg < t.count() && has(t))
    }
}

/// The leg, or the last one for a lane that is done; none in a timeline without legs.
fn leg_or_last<'t>(t: &OneTimeline<'t, Plain>, leg: usize) -> Option<&'t Leg> {
    let legs = t.timeline.legs();
    legs.get(leg).or(legs.last())
}

impl<S: Simd, L: Alignment> Legs<Lanes<S, L>> for Group<'_, S, L> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.legs
    }
    #[inline(always)]
    fn attitude(&self, leg: usize) -> Entries<Lane<S, L>> {
        let mut c = [[[0.0; MOST_LANES]; 3]; 3];
        for lane in 0..S::F64_LANES {
            let Some(l) = leg_or_last(self.lane(lane), leg) else {
                continue;
            };
            let entries = attitude_entries(&l.attitude);
            for i in 0..3 {
                for j in 0..3 {
                    c[i][j][lane] = entries[i][j];
                }
            }
        }
        let simd = self.ar.0;
        three!(|i| three!(|j| Register::gather(simd, &c[i][j])))
    }
    #[inline(always)]
    fn alpha(&self, leg: usize) -> (Lane<S, L>, Lane<S, L>) {
        let (mut sin, mut cos) = ([0.0; MOST_LANES], [1.0; MOST_LANES]);
        for lane in 0..S::F64_LANES {
            if let Some(l) = leg_or_last(self.lane(lane), leg) {
                (sin[lane], cos[lane]) = l.position.sines_of_alpha();
            }
        }
        let simd = self.ar.0;
        (Register::gather(simd, &sin), Register::gather(simd, &cos))
    }
    #[inline(always)]
    fn rotates(&self, leg: usize) -> bool {
        self.timelines[0].rotates(leg)
    }
    #[inline(always)]
    fn stretches(&self, leg: usize) -> usize {
        let own = self.timelines.iter().filter(|t| leg < t.count());
        own.map(|t| t.stretches(leg)).max().unwrap_or(0)
    }
    #[inline(always)]
    fn stretch(&self, leg: usize, index: usize) -> Stretch<Lane<S, L>, [Panels; MOST_LANES]> {
        let mut of = [Stretch::nothing(); MOST_LANES];
        for (lane, slot) in of.iter_mut().enumerate().take(S::F64_LANES) {
            let t = self.lane(lane);
            if leg < t.count() && index < t.stretches(leg) {
                *slot = t.stretch(leg, index);
            }
        }
        let simd = self.ar.0;
        let measured = of.iter().any(|s| s.measured.is_some());
        let gathered = |value: &dyn Fn(&Stretch<f64, Panels>) -> f64| {
            let mut values = [0.0; MOST_LANES];
            for (slot, s) in values.iter_mut().zip(&of) {
                *slot = value(s);
            }
            values
        };
        macro_rules! lanes {
            ($value:expr) => {
                Register::gather(simd, &gathered(&$value))
            };
        }
        let ramp = of.iter().any(|s| s.turn.ramp.is_some()).then(|| {
            let in_lane = |s: &Stretch<f64, Panels>| s.turn.ramp.unwrap_or(Ramp::NONE);
            Ramp {
                by_duration: three!(|k| lanes!(|s| in_lane(s).by_duration[k])),
                by_ramp: three!(|k| lanes!(|s| in_lane(s).by_ramp[k])),
                ramp_by_change: three!(|i| lanes!(|s| in_lane(s).ramp_by_change[i])),
            }
        });
        Stretch {
            turn: Turn {
                from: three!(|i| lanes!(|s: &Stretch<f64, Panels>| s.turn.from[i])),
                change: three!(|i| lanes!(|s: &Stretch<f64, Panels>| s.turn.change[i])),
                duration_s: lanes!(|s: &Stretch<f64, Panels>| s.turn.duration_s),
                time: lanes!(|s: &Stretch<f64, Panels>| s.turn.time),
                instant: of.iter().all(|s| s.turn.instant),
                way: three!(|k| lanes!(|s: &Stretch<f64, Panels>| s.turn.way[k])),
                ramp,
            },
            interval: Interval {
                start_s: lanes!(|s: &Stretch<f64, Panels>| s.interval.start_s),
                length_s: lanes!(|s: &Stretch<f64, Panels>| s.interval.length_s),
            },
            panels: of.map(|s| s.panels),
            elapsed_s: lanes!(|s: &Stretch<f64, Panels>| s.elapsed_s),
            present: lanes!(|s: &Stretch<f64, Panels>| s.present),
            last: lanes!(|s: &Stretch<f64, Panels>| s.last),
            measured: if measured {
                let weight = lanes!(|s: &Stretch<f64, Panels>| s.measured.map_or(0.0, |m| m.0));
                let grows = lanes!(|s: &Stretch<f64, Panels>| s.measured.map_or(0.0, |m| m.1));
                Some((weight, grows))
            } else {
                None
            },
        }
    }
    #[inline(always)]
    fn settles(&self, leg: usize) -> bool {
        self.any(leg, |t| t.settles(leg))
    }
    #[inline(always)]
    fn settle_s(&self, leg: usize) -> Lane<S, L> {
        self.gather(|t| match leg < t.count() && t.settles(leg) {
            true => t.settle_s(leg),
            false => 0.0,
        })
    }
    #[inline(always)]
    fn dwell(&self, leg: usize) -> Option<DwellKernel<Lanes<S, L>>> {
        let periods = |t: &OneTimeline<'_, Plain>| match leg < t.count() {
            true => t.periods(leg),
            false => 0,
        };
        let first = periods(self.lane(0));
        let kernels = self.timelines[0].model.searched_kernels();
        if self.timelines.iter().all(|t| periods(t) == first) {
            if first == 0 {
                return None;
            }
            return Some(DwellKernel::new(self.ar, kernels.numbers(first).get()));
        }
        let numbers: [LookedUp<'_>; MOST_LANES] =
            std::array::from_fn(|lane| kernels.numbers(periods(self.lane(lane))));
        let numbers = numbers.each_ref().map(LookedUp::get);
        Some(DwellKernel::gather(self.ar, &numbers))
    }
    #[inline(always)]
    fn azimuth(&self) -> Option<f64> {
        self.timelines[0].azimuth()
    }
    #[inline(always)]
    fn vertical(&self, leg: usize) -> Lane<S, L> {
        self.gather(|t| match leg < t.count() {
            true => t.vertical(leg),
            false => 0.0,
        })
    }
    #[inline(always)]
    fn remains(&self, leg: usize) -> bool {
        self.any(leg, |t| t.remains(leg))
    }
    #[inline(always)]
    fn remainder(&self, leg: usize) -> (Lane<S, L>, Option<Lane<S, L>>) {
        let rest = |t: &OneTimeline<'_, Plain>| match leg < t.count() {
            true => t.remainder(leg),
            false => (0.0, None),
        };
        let length_s = self.gather(|t| rest(t).0);
        let weight = self.gather(|t| rest(t).1.unwrap_or(0.0));
        let relaxed = self.timelines[0].rule == TickRule::Relaxed;
        (length_s, if relaxed { Some(weight) } else { None })
    }
}

/// What is asked of a batch.
pub(super) struct Batch<'a> {
    pub model: &'a CovarianceModel,
    pub timelines: &'a [Timeline],
    pub rule: TickRule,
    /// Of the shape that is carried.
    pub facts: Facts,
}

impl<'a> Batch<'a> {
    /// The timelines in groups of at most `lanes`, alike in their number of legs; those that would
    /// make others of their group do what they do not do alone, on their own.
    pub fn groups(&self, lanes: usize) -> Vec<Vec<usize>> {
        let (together, alone) = self.model.in_step(self.timelines);
        let together = together.chunks(lanes).map(<[usize]>::to_vec);
        together.chain(alone.into_iter().map(|i| vec![i])).collect()
    }

    pub fn group<S: Simd, L: Alignment>(
        &self,
        ar: Lanes<S, L>,
        of: &[usize],
        keep_empty: bool,
    ) -> Group<'a, S, L> {
        let timeline = |&i: &usize| OneTimeline {
            ar: Plain,
            model: self.model,
            timeline: &self.timelines[i],
            rule: self.rule,
            keep_empty,
            facts: self.facts,
        };
        Group::new(ar, of.iter().map(timeline).collect())
    }
}

/// P_D of one lane in the order of the coefficients.
#[inline(always)]
fn covariance_of_lane<S: Simd, L: Alignment>(
    p: &Rows<<Lanes<S, L> as Arithmetic>::Quad>,
    lane: usize,
) -> CoefficientMatrix {
    in_order(|i, j| p[i][j / 4].get(j % 4).lane(lane))
}

/// Whether the covariance of one lane has the digits that a search needs.
fn keeps_digits_in<S: Simd, L: Alignment>(factor: &Factor<Lanes<S, L>>, lane: usize) -> bool {
    keeps_digits(factor.least.lane(lane), factor.cancelled.lane(lane))
}

/// P_D of one lane.
struct OfLane<'a, S: Simd, L: Alignment> {
    variances: CoefficientVector,
    /// Worked out when it is asked for: most figures of merit need the variances alone.
    matrix: OnceCell<CoefficientMatrix>,
    factor: &'a Factor<Lanes<S, L>>,
    lane: usize,
}

impl<'a, S: Simd, L: Alignment> OfLane<'a, S, L> {
    #[inline(always)]
    fn new(variances: &Variances<S, L>, factor: &'a Factor<Lanes<S, L>>, lane: usize) -> Self {
        let mut of_lane = CoefficientVector::zeros();
        for (c, &(i, _)) in PLACES.iter().enumerate() {
            of_lane[c] = variances[i].lane(lane);
        }
        Self {
            variances: of_lane,
            matrix: OnceCell::new(),
            factor,
            lane,
        }
    }

    /// With P_D known of every lane.
    #[inline(always)]
    fn known(
        p: &Rows<<Lanes<S, L> as Arithmetic>::Quad>,
        factor: &'a Factor<Lanes<S, L>>,
        lane: usize,
    ) -> Self {
        let matrix = covariance_of_lane::<S, L>(p, lane);
        Self {
            variances: matrix.diagonal(),
            matrix: OnceCell::from(matrix),
            factor,
            lane,
        }
    }
}

impl<S: Simd, L: Alignment> CoefficientCovariance for OfLane<'_, S, L> {
    fn matrix(&self) -> &CoefficientMatrix {
        self.matrix
            .get_or_init(|| self.factor.matrix(|v| v.lane(self.lane)))
    }
    fn variances(&self) -> CoefficientVector {
        self.variances
    }
    fn root(&self) -> Cow<'_, CovarianceRoot> {
        Cow::Owned(self.factor.root(|v| v.lane(self.lane)))
    }
}

/// The factorisation of what the chain has collected.
struct Factorise<'a, S: Simd, L: Alignment>(
    Lanes<S, L>,
    &'a Information<Lanes<S, L>>,
    &'a PriorScale,
);

impl<S: Simd, L: Alignment> Work for Factorise<'_, S, L> {
    type Output = Factor<Lanes<S, L>>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        self.1.factor(self.0, self.2)
    }
}

/// P_D from its factors.
struct Covariance<'a, S: Simd, L: Alignment>(Lanes<S, L>, &'a Factor<Lanes<S, L>>);

impl<S: Simd, L: Alignment> Work for Covariance<'_, S, L> {
    type Output = Rows<<Lanes<S, L> as Arithmetic>::Quad>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        self.1.covariance(self.0)
    }
}

/// Variance of every coefficient, gyro by gyro.
type Variances<S, L> = [Lane<S, L>; COEFFICIENTS];

/// The diagonal of P_D from its factors.
struct Diagonal<'a, S: Simd, L: Alignment>(Lanes<S, L>, &'a Factor<Lanes<S, L>>);

impl<S: Simd, L: Alignment> Work for Diagonal<'_, S, L> {
    type Output = Variances<S, L>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        self.1.variances(self.0.number(0.0))
    }
}

/// A figure of merit of P_D.
pub(super) type Value<'a> = &'a dyn Fn(&dyn CoefficientCovariance) -> Result<f64>;

struct Values<'a> {
    batch: Batch<'a>,
    /// What comes before and after the timelines, if they are parts of a test.
    between: Option<&'a Between>,
    merit: Value<'a>,
}

impl Values<'_> {
    /// What is wanted of a timeline whose information loses digits in a sum of squares: by its
    /// rows.
    fn by_rows(&self, i: usize) -> Result<f64> {
        let Batch {
            model,
            timelines,
            rule,
            ..
        } = self.batch;
        let end = match self.between {
            None => Rooted::new(model.end_covariance_in_doubles(&timelines[i], rule)?.root),
            Some(between) => Rooted::new(between.root(model, &timelines[i], rule)?),
        };
        (self.merit)(&end)
    }
}

impl LaneTask for Values<'_> {
    type Output = Vec<Result<f64>>;
    #[inline(always)]
    fn run<S: Simd, L: Alignment>(self, ar: Lanes<S, L>) -> Vec<Result<f64>> {
        let mut out: Vec<Result<f64>> = Vec::new();
        out.resize_with(self.batch.timelines.len(), || Err(not_finite()));
        let mut tape = Tape {
            on: false,
            steps: Vec::new(),
        };
        for of in self.batch.groups(S::F64_LANES) {
            let group = self.batch.group(ar, &of, false);
            let information = run(&group, self.between, &mut tape);
            let factor = ar.apart(Factorise(ar, &information, &self.batch.model.prior_scale));
            let variances = ar.apart(Diagonal(ar, &factor));
            for (lane, &i) in of.iter().enumerate() {
                out[i] = match keeps_digits_in(&factor, lane) {
                    true => (self.merit)(&OfLane::new(&variances, &factor, lane)),
                    false => self.by_rows(i),
                };
            }
        }
        out
    }
}

impl CovarianceModel {
    fn in_lanes<'a>(
        &'a self,
        timelines: &'a [Timeline],
        rule: TickRule,
        between: Option<&'a Between>,
        merit: Value<'a>,
    ) -> Vec<Result<f64>> {
        let values = Values {
            batch: Batch {
                model: self,
                timelines,
                rule,
                facts: Facts::of::<Drift>(),
            },
            between,
            merit,
        };
        run_in_lanes(self.most_lanes, values)
    }

    /// A figure of merit of every timeline, several at once: `merit` takes P_D.
    ///
    /// Each has the bits that [`CovarianceModel::value`] gives it alone.
    ///
    /// # Errors
    ///
    /// Of a timeline: [`Error::is_numerical`](crate::Error::is_numerical) when its information
    /// overflows; what `merit` returns.
    pub fn values(
        &self,
        timelines: &[Timeline],
        rule: TickRule,
        merit: impl Fn(&dyn CoefficientCovariance) -> Result<f64>,
    ) -> Vec<Result<f64>> {
        match (&self.coloured, &self.mixing) {
            (Some(coloured), _) => self.coloured_values(coloured, timelines, rule, merit),
            (None, Some(mixing)) => self.wide_values(mixing, timelines, rule, merit),
            (None, None) => self.in_lanes(timelines, rule, None, &merit),
        }
    }

    /// A figure of merit at the end of a test of which `timelines` are variants of one part, and
    /// the rest is given.
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::values`].
    pub(crate) fn values_between(
        &self,
        timelines: &[Timeline],
        rule: TickRule,
        between: &Between,
        merit: impl Fn(&dyn CoefficientCovariance) -> Result<f64>,
    ) -> Vec<Result<f64>> {
        self.in_lanes(timelines, rule, Some(between), &merit)
    }
}

impl CovarianceModel {
    /// Those of the timelines that can share groups, by their number of legs, and the others.
    fn in_step(&self, timelines: &[Timeline]) -> (Vec<usize>, Vec<usize>) {
        let (mut together, alone): (Vec<usize>, Vec<usize>) =
            (0..timelines.len()).partition(|&i| self.keeps_step(&timelines[i]));
        together.sort_by_key(|&i| timelines[i].legs().len());
        (together, alone)
    }

    /// Whether what a timeline goes through leg by leg is what others do too, so that it can share
    /// a group without a lane doing anything that its schedule alone does not: every position is
    /// held for a whole period at least, no move is measured, and where gimbals speed up and slow down,
    /// which cuts a move into parts, every one takes time.
    fn keeps_step(&self, timeline: &Timeline) -> bool {
        let has_ramps = self
            .slew
            .is_some_and(|s| s.acceleration_rad_per_s2.is_some());
        let in_step = |m: &Move| !m.measured && (!has_ramps || m.ramp() > 0.0);
        let held = |dwell_s: f64| split_periods(dwell_s, self.period_s).0 > 0;
        timeline.position_legs().iter().all(|leg| held(leg.dwell_s))
            && timeline
                .legs()
                .iter()
                .all(|leg| leg.arrival.as_ref().is_none_or(in_step))
    }
}
