//! Many schedules at once: one per lane of the machine's registers.
//!
//! The straight-line chain ([`two_stage`](super::two_stage)) runs on registers of eight lanes
//! (AVX-512), four (AVX2) or two (NEON), whatever the machine has when the program runs; without
//! any of them on one. Schedules are grouped by their number of positions; in a group each lane
//! has its own angles, durations and moves, and a schedule with fewer positions waits. Where all
//! durations of a group agree, what depends on them alone is worked out once for the group.
//!
//! Lanes fuse products and sums, so a value differs from that of the schedule alone by rounding
//! (tested: 1e-12), and by rounding too with the schedules that share its group. It never depends
//! on threads.

#![allow(
    clippy::needless_range_loop,
    reason = "indices are the formulas' own, and closures would not be compiled with the caller"
)]

pub(crate) mod between;

use pulp::Simd;

use super::gradient::LegGradient;
use super::two_stage::course::{self, LegAdjoint, Legs, Stretch, Tape};
use super::two_stage::dispatch::{LaneTask, run_in_lanes};
use super::two_stage::earth::Earth;
use super::two_stage::gains::{DwellKernel, DwellNumbers};
use super::two_stage::information::{
    Factor, Information, PLACES, PriorScale, Rows, complete, symmetric_product,
};
use super::two_stage::moves::{Interval, Turn};
use super::two_stage::numbers::{
    self, Alignment, Arithmetic, Lanes, MOST_LANES, Number, Plain, Register, Row, three,
};
use super::two_stage::single::OneTimeline;
use super::two_stage::{Place, attitude_entries};
use super::{CovarianceModel, TickRule, not_finite};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector};
use crate::error::Result;
use crate::motion::integral::{Panels, half_phase};
use crate::motion::{Leg, Timeline};
use between::{Between, run};

type Lane<S, L> = Register<S, true, L>;

/// One timeline per lane; the last one again in lanes to spare.
struct Group<'a, S, L> {
    ar: Lanes<S, L>,
    timelines: Vec<OneTimeline<'a, Plain>>,
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

    fn lane(&self, i: usize) -> &OneTimeline<'a, Plain> {
        &self.timelines[i.min(self.timelines.len() - 1)]
    }

    /// `value` of every lane, with its timeline.
    #[inline(always)]
    fn gather(&self, value: impl Fn(&OneTimeline<'a, Plain>) -> f64) -> Lane<S, L> {
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

/// A stretch of no length, for lanes that have none.
fn no_stretch() -> Stretch<f64> {
    Stretch {
        turn: Turn {
            from: [0.0; 3],
            change: [0.0; 3],
            duration_s: 1.0,
        },
        interval: Interval {
            start_s: 0.0,
            length_s: 0.0,
        },
        panels: Panels::of_half_phase(0.0),
        last: 0.0,
        measured: None,
    }
}

impl<S: Simd, L: Alignment> Legs<Lanes<S, L>> for Group<'_, S, L> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.legs
    }
    #[inline(always)]
    fn place(&self, leg: usize) -> Place<Lanes<S, L>> {
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
        Place::new(
            self.ar,
            three!(|i| three!(|j| Register::gather(simd, &c[i][j]))),
        )
    }
    #[inline(always)]
    fn alpha(&self, leg: usize) -> (Lane<S, L>, Lane<S, L>) {
        let alpha =
            |t: &OneTimeline<'_, Plain>| leg_or_last(t, leg).map_or(0.0, |l| l.position.alpha);
        (
            self.gather(|t| alpha(t).sin()),
            self.gather(|t| alpha(t).cos()),
        )
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
    fn stretch(&self, leg: usize, index: usize) -> Stretch<Lane<S, L>> {
        let mut of = [no_stretch(); MOST_LANES];
        let mut phase = 0.0_f64;
        for (lane, slot) in of.iter_mut().enumerate().take(S::F64_LANES) {
            let t = self.lane(lane);
            if leg < t.count() && index < t.stretches(leg) {
                *slot = t.stretch(leg, index);
                if let Some(m) = t.slew(leg) {
                    phase = phase.max(half_phase(m, slot.interval.length_s));
                }
            }
        }
        let simd = self.ar.0;
        let measured = of.iter().any(|s| s.measured.is_some());
        let gathered = |value: &dyn Fn(&Stretch<f64>) -> f64| {
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
        Stretch {
            turn: Turn {
                from: three!(|i| lanes!(|s: &Stretch<f64>| s.turn.from[i])),
                change: three!(|i| lanes!(|s: &Stretch<f64>| s.turn.change[i])),
                duration_s: lanes!(|s: &Stretch<f64>| s.turn.duration_s),
            },
            interval: Interval {
                start_s: lanes!(|s: &Stretch<f64>| s.interval.start_s),
                length_s: lanes!(|s: &Stretch<f64>| s.interval.length_s),
            },
            panels: Panels::of_half_phase(phase),
            last: lanes!(|s: &Stretch<f64>| s.last),
            measured: if measured {
                let weight = lanes!(|s: &Stretch<f64>| s.measured.map_or(0.0, |m| m.0));
                let grows = lanes!(|s: &Stretch<f64>| s.measured.map_or(0.0, |m| m.1));
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
        let kernels = &self.timelines[0].model.kernels;
        if self.timelines.iter().all(|t| periods(t) == first) {
            if first == 0 {
                return None;
            }
            return Some(DwellKernel::new(self.ar, kernels.numbers(first).get()));
        }
        let mut numbers = [DwellNumbers::NOTHING; MOST_LANES];
        for (lane, slot) in numbers.iter_mut().enumerate().take(S::F64_LANES) {
            *slot = *kernels.numbers(periods(self.lane(lane))).get();
        }
        Some(DwellKernel::gather(self.ar, &numbers))
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

/// Derivatives with respect to one leg, per lane.
#[derive(Debug, Clone, Copy)]
struct LaneGradient<N> {
    angles: [N; 3],
    dwell_s: N,
    move_s: N,
}

impl<N: Number> LegAdjoint<N> for LaneGradient<N> {
    #[inline(always)]
    fn add_angles(&mut self, angles: &[N; 3]) {
        for i in 0..3 {
            self.angles[i] = self.angles[i] + angles[i];
        }
    }
    #[inline(always)]
    fn add_dwell(&mut self, slope: N) {
        self.dwell_s = self.dwell_s + slope;
    }
    #[inline(always)]
    fn add_move(&mut self, slope: N) {
        self.move_s = self.move_s + slope;
    }
}

/// What is asked of a batch.
struct Batch<'a> {
    model: &'a CovarianceModel,
    timelines: &'a [Timeline],
    rule: TickRule,
}

impl<'a> Batch<'a> {
    /// The timelines in groups of at most `lanes`, alike in their number of legs.
    fn groups(&self, lanes: usize) -> Vec<Vec<usize>> {
        let mut order: Vec<usize> = (0..self.timelines.len()).collect();
        order.sort_by_key(|&i| self.timelines[i].legs().len());
        order.chunks(lanes).map(<[usize]>::to_vec).collect()
    }

    fn group<S: Simd, L: Alignment>(
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
    let mut out = CoefficientMatrix::zeros();
    for (a, &(i, sign_a)) in PLACES.iter().enumerate() {
        for (b, &(j, sign_b)) in PLACES.iter().enumerate().take(a + 1) {
            let (low, high) = if i < j { (i, j) } else { (j, i) };
            let entry = sign_a * sign_b * p[low][high / 4].get(high % 4).lane(lane);
            out[(a, b)] = entry;
            out[(b, a)] = entry;
        }
    }
    out
}

fn is_covariance<S: Simd, L: Alignment>(factor: &Factor<Lanes<S, L>>, lane: usize) -> bool {
    factor.least.lane(lane) > 0.0
}

/// The factorisation of what the chain has collected.
struct Factorise<'a, S: Simd, L: Alignment>(
    Lanes<S, L>,
    &'a Information<Lanes<S, L>>,
    &'a PriorScale,
);

impl<S: Simd, L: Alignment> numbers::Work for Factorise<'_, S, L> {
    type Output = Factor<Lanes<S, L>>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        self.1.factor(self.0, self.2)
    }
}

/// P_D from its factors.
struct Covariance<'a, S: Simd, L: Alignment>(Lanes<S, L>, &'a Factor<Lanes<S, L>>);

impl<S: Simd, L: Alignment> numbers::Work for Covariance<'_, S, L> {
    type Output = Rows<<Lanes<S, L> as Arithmetic>::Quad>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        self.1.covariance(self.0)
    }
}

/// −P G P.
struct InformationAdjoint<'a, S: Simd, L: Alignment>(
    Lanes<S, L>,
    &'a Rows<<Lanes<S, L> as Arithmetic>::Quad>,
    &'a Slopes,
);

impl<S: Simd, L: Alignment> numbers::Work for InformationAdjoint<'_, S, L> {
    type Output = Rows<<Lanes<S, L> as Arithmetic>::Quad>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        symmetric_product(self.0, self.1, &self.2.pull(self.0, self.1))
    }
}

/// A figure of merit of P_D, (°/h)².
type Value<'a> = &'a dyn Fn(&CoefficientMatrix) -> Result<f64>;
/// The same with its derivative.
type ValueAndSlope<'a> = &'a dyn Fn(&CoefficientMatrix) -> Result<(f64, CoefficientMatrix)>;

/// What is wanted of every timeline. One type for all, so that they share their code.
enum Wanted<'a> {
    /// tr(W P_D) for the diagonal of W.
    WeightedTrace(PriorScale),
    Value(Value<'a>),
    Gradient(ValueAndSlope<'a>),
}

/// A value, with a gradient where one is wanted.
type Answer = Result<(f64, Vec<LegGradient>)>;

struct Work<'a> {
    batch: Batch<'a>,
    /// What comes before and after the timelines, if they are parts of a test.
    between: Option<&'a Between>,
    wanted: Wanted<'a>,
}

impl LaneTask for Work<'_> {
    type Output = Vec<Answer>;
    #[inline(always)]
    fn run<S: Simd, L: Alignment>(self, ar: Lanes<S, L>) -> Vec<Answer> {
        let mut out: Vec<Answer> = Vec::new();
        out.resize_with(self.batch.timelines.len(), || Err(not_finite()));
        let on = matches!(self.wanted, Wanted::Gradient(_));
        let mut tape = Tape {
            on,
            steps: Vec::new(),
        };
        for of in self.batch.groups(S::F64_LANES) {
            let group = self.batch.group(ar, &of, on);
            tape.steps.clear();
            let information = run(&group, self.between, &mut tape);
            let factor = ar.apart(Factorise(ar, &information, &self.batch.model.prior_scale));
            match &self.wanted {
                Wanted::WeightedTrace(weights) => {
                    let traces = factor.weighted_trace(ar, weights);
                    for (lane, &i) in of.iter().enumerate() {
                        if is_covariance(&factor, lane) {
                            out[i] = Ok((traces.lane(lane), Vec::new()));
                        }
                    }
                }
                Wanted::Value(merit) => {
                    let p = ar.apart(Covariance(ar, &factor));
                    for (lane, &i) in of.iter().enumerate() {
                        if is_covariance(&factor, lane) {
                            let value = merit(&covariance_of_lane::<S, L>(&p, lane));
                            out[i] = value.map(|v| (v, Vec::new()));
                        }
                    }
                }
                Wanted::Gradient(merit) => gradients(&group, &of, *merit, &factor, &tape, &mut out),
            }
        }
        out
    }
}

#[inline(always)]
fn gradients<S: Simd, L: Alignment>(
    group: &Group<'_, S, L>,
    of: &[usize],
    merit: ValueAndSlope<'_>,
    factor: &Factor<Lanes<S, L>>,
    tape: &Tape<Lanes<S, L>>,
    out: &mut [Answer],
) {
    let ar = group.ar;
    let model = group.timelines[0].model;
    let mut p = ar.apart(Covariance(ar, factor));
    let mut slopes = Slopes::new();
    for (lane, &i) in of.iter().enumerate() {
        if !is_covariance(factor, lane) {
            continue;
        }
        match merit(&covariance_of_lane::<S, L>(&p, lane)) {
            Ok((value, slope)) => {
                slopes.set(lane, &slope);
                out[i] = Ok((value, Vec::new()));
            }
            Err(error) => out[i] = Err(error),
        }
    }
    complete(ar, &mut p);
    let information = ar.apart(InformationAdjoint(ar, &p, &slopes));
    let zero = ar.number(0.0);
    let nothing = LaneGradient {
        angles: [zero; 3],
        dwell_s: zero,
        move_s: zero,
    };
    let mut gradient = vec![nothing; group.legs];
    let earth = Earth::new(zero, &model.dynamics, model.drift_psd);
    let per_s = 1.0 / (model.period_s * model.noise_variance);
    course::backward(
        ar,
        group,
        &earth,
        &tape.steps,
        &information,
        per_s,
        &mut gradient,
    );
    for (lane, &i) in of.iter().enumerate() {
        if let Ok((_, legs)) = &mut out[i] {
            let count = group.timelines[lane].count();
            legs.extend(gradient.iter().take(count).map(|g| LegGradient {
                angles: [0, 1, 2].map(|a| g.angles[a].lane(lane)),
                dwell_s: g.dwell_s.lane(lane),
                move_s: g.move_s.lane(lane),
            }));
        }
    }
}

/// The derivative of each lane's figure of merit with respect to its P_D, gyro by gyro.
struct Slopes {
    entries: Box<[[[f64; MOST_LANES]; COEFFICIENTS]; COEFFICIENTS]>,
    diagonal: bool,
}

impl Slopes {
    fn new() -> Self {
        Self {
            entries: Box::new([[[0.0; MOST_LANES]; COEFFICIENTS]; COEFFICIENTS]),
            diagonal: true,
        }
    }

    fn set(&mut self, lane: usize, slope: &CoefficientMatrix) {
        for (a, &(i, sign_a)) in PLACES.iter().enumerate() {
            for (b, &(k, sign_b)) in PLACES.iter().enumerate() {
                let entry = sign_a * sign_b * slope[(a, b)];
                self.entries[i][k][lane] = entry;
                self.diagonal &= i == k || entry == 0.0;
            }
        }
    }

    /// −G P.
    #[inline(always)]
    fn pull<S: Simd, L: Alignment>(
        &self,
        ar: Lanes<S, L>,
        p: &Rows<<Lanes<S, L> as Arithmetic>::Quad>,
    ) -> Rows<<Lanes<S, L> as Arithmetic>::Quad> {
        let mut out = [[ar.quad([ar.number(0.0); 4]); 3]; COEFFICIENTS];
        for i in 0..COEFFICIENTS {
            for k in 0..COEFFICIENTS {
                if self.diagonal && i != k {
                    continue;
                }
                let g = -Register::gather(ar.0, &self.entries[i][k]);
                for q in 0..3 {
                    out[i][q] = p[k][q].times_add(g, out[i][q]);
                }
            }
        }
        out
    }
}

impl CovarianceModel {
    fn batch<'a>(
        &'a self,
        timelines: &'a [Timeline],
        rule: TickRule,
        between: Option<&'a Between>,
        wanted: Wanted<'a>,
    ) -> Vec<Answer> {
        let batch = Batch {
            model: self,
            timelines,
            rule,
        };
        let work = Work {
            batch,
            between,
            wanted,
        };
        run_in_lanes(self.most_lanes, work)
    }

    /// tr(W P_D) of every timeline, (°/h)², W diagonal with `weights`: what the weighted RMS σ is
    /// made of. Several timelines at once, see [`CovarianceModel::values`].
    ///
    /// # Errors
    ///
    /// Of a timeline: [`Error::is_numerical`](crate::Error::is_numerical) when its information
    /// overflows.
    pub fn weighted_traces(
        &self,
        timelines: &[Timeline],
        rule: TickRule,
        weights: &CoefficientVector,
    ) -> Vec<Result<f64>> {
        let wanted = Wanted::WeightedTrace(PriorScale::new(weights));
        let answers = self.batch(timelines, rule, None, wanted);
        answers.into_iter().map(|a| Ok(a?.0)).collect()
    }

    /// A figure of merit of every timeline, several at once: `merit` takes P_D in (°/h)².
    ///
    /// P_D is that of [`CovarianceModel::end_covariance_by_gram`] to rounding (1e-12 of it); a
    /// timeline's depends by rounding on the others, never on threads.
    ///
    /// # Errors
    ///
    /// Of a timeline: [`Error::is_numerical`](crate::Error::is_numerical) when its information
    /// overflows; what `merit` returns.
    pub fn values(
        &self,
        timelines: &[Timeline],
        rule: TickRule,
        merit: impl Fn(&CoefficientMatrix) -> Result<f64>,
    ) -> Vec<Result<f64>> {
        let answers = self.batch(timelines, rule, None, Wanted::Value(&merit));
        answers.into_iter().map(|a| Ok(a?.0)).collect()
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
        merit: impl Fn(&CoefficientMatrix) -> Result<f64>,
    ) -> Vec<Result<f64>> {
        let answers = self.batch(timelines, rule, Some(between), Wanted::Value(&merit));
        answers.into_iter().map(|a| Ok(a?.0)).collect()
    }

    /// Value and gradient of a figure of merit of every timeline, several at once; `merit` as in
    /// [`CovarianceModel::gradient`].
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::values`].
    pub fn gradients(
        &self,
        timelines: &[Timeline],
        rule: TickRule,
        merit: impl Fn(&CoefficientMatrix) -> Result<(f64, CoefficientMatrix)>,
    ) -> Vec<Result<(f64, Vec<LegGradient>)>> {
        self.batch(timelines, rule, None, Wanted::Gradient(&merit))
    }
}
