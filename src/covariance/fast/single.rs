//! One schedule at a time, on the widest registers that keep its bits the same everywhere.

use std::any::Any;
use std::borrow::Cow;
use std::cell::RefCell;

use nalgebra::Matrix3;

use super::adjoint::ByRows;
use super::arithmetic::{Arithmetic, Row, Single};
use super::course::{self, Legs, Step, Stretch, Tape};
use super::dispatch::{self, Task};
use super::earth::Earth;
use super::gains::{DwellKernel, Gains, Own, Seen};
use super::information::{
    Factor, PLACES, by_gyros, complete, keeps_digits, known_rows, pulled_slope, symmetric_product,
    to_coefficients,
};
use super::moves::Interval;
use super::shape::{Drift, Facts, Shape};
use super::square::{Entries, entries, mirrored};
use super::turn::Turn;
use super::{Place, Wide, attitude_entries};
use crate::covariance::gradient::LegGradient;
use crate::covariance::rows::{Told, Whitened};
use crate::covariance::{
    CoefficientCovariance, CovarianceModel, CovarianceRoot, EndCovariance, Rooted, Slope, TickRule,
    split_periods,
};
use crate::drift::{COEFFICIENTS, CoefficientMatrix, DriftMatrix};
use crate::error::Result;
use crate::motion::integral::{Panels, half_phase};
use crate::motion::{Move, Timeline};

/// The legs of one timeline.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OneTimeline<'a, A> {
    pub ar: A,
    pub model: &'a CovarianceModel,
    pub timeline: &'a Timeline,
    pub rule: TickRule,
    /// Whether steps of no length are wanted too (their derivative is not zero).
    pub keep_empty: bool,
    /// Of the shape that is carried.
    pub facts: Facts,
}

/// Corners of the rate of a move whose gimbals speed up and slow down.
const CORNERS: usize = 2;

/// Where a stretch of a move ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// At the end of a filter period, with a measurement.
    Tick,
    /// Where the rate has a corner.
    Corner,
    /// At the position.
    Arrival,
}

impl<A: Single> OneTimeline<'_, A> {
    /// The move to a leg, where something happens in it: it takes time, or torquers count.
    pub fn slew(&self, leg: usize) -> Option<&Move> {
        let arrival = self.timeline.legs()[leg].arrival.as_ref()?;
        let counts = arrival.duration_s > 0.0 || self.facts.jumps;
        (!self.model.frame_hold && counts).then_some(arrival)
    }

    /// Ticks of a measured move and what is left.
    fn ticks(&self, m: &Move) -> (usize, f64) {
        split_periods(m.duration_s, self.model.period_s)
    }

    /// The whole periods of a dwell.
    pub fn periods(&self, leg: usize) -> usize {
        split_periods(self.timeline.legs()[leg].dwell_s, self.model.period_s).0
    }

    /// The rest of a dwell, s.
    fn rest_s(&self, leg: usize) -> f64 {
        split_periods(self.timeline.legs()[leg].dwell_s, self.model.period_s).1
    }

    fn panels(&self, m: &Move, interval: (f64, f64)) -> Panels {
        Panels::of_half_phase(half_phase(m, interval) * self.facts.phase)
    }

    /// A part of a move that takes time: of a filter period where it is measured, or cut where the rate
    /// has a corner, or what is left. Start and length in s, and where it ends.
    pub fn part(&self, m: &Move, index: usize) -> ((f64, f64), End) {
        let (ticks, remainder) = match m.measured {
            true => self.ticks(m),
            false => (0, m.duration_s),
        };
        let period_s = self.model.period_s;
        if m.ramp() == 0.0 {
            let start_s = index as f64 * period_s;
            let (length_s, end) = match index < ticks {
                true => (period_s, End::Tick),
                false => (remainder, End::Arrival),
            };
            return ((start_s, length_s), end);
        }
        let [up_s, down_s] = m.corners_s();
        let ticks_until = |at_s: f64| {
            let near = ((at_s / period_s) as usize).min(ticks);
            let is_late = near as f64 * period_s > at_s;
            near - usize::from(is_late)
        };
        // The periods that end before a corner, the corner, the next periods, the other corner, the rest.
        let corners = [ticks_until(up_s), ticks_until(down_s) + 1];
        let end_of = |index: usize| {
            let passed = corners.iter().filter(|corner| index > **corner).count();
            let tick = index + 1 - passed;
            match index {
                _ if index == corners[0] => (up_s, End::Corner),
                _ if index == corners[1] => (down_s, End::Corner),
                _ if tick <= ticks => (tick as f64 * period_s, End::Tick),
                _ => (m.duration_s, End::Arrival),
            }
        };
        let start_s = index.checked_sub(1).map_or(0.0, |before| end_of(before).0);
        let (end_s, end) = end_of(index);
        // A period may end at a corner but for rounding.
        let length_s = (end_s - start_s).max(0.0);
        ((start_s, length_s), end)
    }

    /// A move without duration, as if it took a second in which nothing else happens.
    fn jump(&self, m: &Move) -> Stretch<f64, Panels> {
        Stretch {
            turn: Turn {
                from: m.reduced_from(),
                change: m.change,
                duration_s: 1.0,
                time: 0.0,
                instant: true,
                way: [0.0, 1.0, 0.0],
                ramp: None,
            },
            interval: Interval {
                start_s: 0.0,
                length_s: 1.0,
            },
            panels: self.panels(&m.lasting(1.0), (0.0, 1.0)),
            elapsed_s: 0.0,
            present: 1.0,
            last: 0.0,
            measured: None,
        }
    }

    fn relaxed_weight(&self, length_s: f64) -> Option<f64> {
        (self.rule == TickRule::Relaxed)
            .then(|| length_s / (self.model.period_s * self.model.noise_variance))
    }
}

impl<A: Single> Legs<A> for OneTimeline<'_, A> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.timeline.legs().len()
    }
    #[inline(always)]
    fn attitude(&self, leg: usize) -> Entries<f64> {
        attitude_entries(&self.timeline.legs()[leg].attitude)
    }
    #[inline(always)]
    fn alpha(&self, leg: usize) -> (f64, f64) {
        self.timeline.legs()[leg].position.sines_of_alpha()
    }
    #[inline(always)]
    fn rotates(&self, _: usize) -> bool {
        self.model.frame_hold
    }
    #[inline(always)]
    fn stretches(&self, leg: usize) -> usize {
        match self.slew(leg) {
            None => 0,
            Some(m) if m.duration_s > 0.0 => {
                let parts = match m.measured {
                    true => {
                        let (ticks, remainder) = self.ticks(m);
                        ticks + usize::from(remainder > 0.0 || self.keep_empty)
                    }
                    false => 1,
                };
                parts + if m.ramp() > 0.0 { CORNERS } else { 0 }
            }
            Some(_) => 1,
        }
    }
    #[inline(always)]
    fn stretch(&self, leg: usize, index: usize) -> Stretch<f64, Panels> {
        // Only called for legs that have stretches, hence a move.
        let Some(m) = self.slew(leg) else {
            return Stretch::nothing();
        };
        if m.duration_s <= 0.0 {
            return self.jump(m);
        }
        let ((start_s, length_s), end) = self.part(m, index);
        let between = [start_s, start_s + length_s];
        let last = index + 1 == self.stretches(leg);
        let measured = match end {
            End::Tick => Some((self.model.noise_variance.recip(), 0.0)),
            End::Arrival if m.measured => self
                .relaxed_weight(self.ticks(m).1)
                .map(|weight| (weight, 1.0)),
            End::Corner | End::Arrival => None,
        };
        Stretch {
            turn: Turn::of_a_move(m, self.model.slew.as_ref(), between),
            interval: Interval {
                start_s: 0.0,
                length_s,
            },
            panels: self.panels(m, (start_s, length_s)),
            elapsed_s: length_s,
            present: 1.0,
            last: if last { 1.0 } else { 0.0 },
            measured,
        }
    }
    #[inline(always)]
    fn settles(&self, leg: usize) -> bool {
        let l = &self.timeline.legs()[leg];
        l.arrival.is_some() && l.settle_s > 0.0
    }
    #[inline(always)]
    fn settle_s(&self, leg: usize) -> f64 {
        self.timeline.legs()[leg].settle_s
    }
    #[inline(always)]
    fn dwell(&self, leg: usize) -> Option<DwellKernel<A>> {
        let periods = self.periods(leg);
        if periods == 0 {
            return None;
        }
        let numbers = self.model.searched_kernels().numbers(periods);
        Some(DwellKernel::new(self.ar, numbers.get()))
    }
    #[inline(always)]
    fn azimuth(&self) -> Option<f64> {
        let variance = self.model.azimuth_variance?;
        Some(self.model.noise_variance / variance)
    }
    #[inline(always)]
    fn vertical(&self, leg: usize) -> f64 {
        self.periods(leg) as f64 / self.model.noise_variance
    }
    #[inline(always)]
    fn remains(&self, leg: usize) -> bool {
        self.keep_empty || self.rest_s(leg) > 0.0
    }
    #[inline(always)]
    fn remainder(&self, leg: usize) -> (f64, Option<f64>) {
        let rest_s = self.rest_s(leg);
        (rest_s, self.relaxed_weight(rest_s))
    }
}

impl CovarianceModel {
    /// The Earth's rotation and the random drift, in plain numbers.
    pub(crate) fn earth(&self) -> Earth<f64> {
        Earth::new(0.0, &self.dynamics, &self.stand, self.drift_psd)
    }
}

/// A figure of merit of P_D.
pub(super) type Merit<'a, T> = &'a mut dyn FnMut(&dyn CoefficientCovariance) -> Result<T>;

/// What is wanted of P_D at the end of a timeline.
pub(super) enum Wanted<'a> {
    /// The value of a figure of merit.
    Value(Merit<'a, f64>),
    /// Its derivatives too, leg by leg.
    Gradient(Merit<'a, (f64, Slope)>, &'a mut [LegGradient]),
}

/// The end of a timeline, and what is wanted of it.
struct ToEnd<'a> {
    model: &'a CovarianceModel,
    timeline: &'a Timeline,
    rule: TickRule,
    wanted: Wanted<'a>,
}

/// What a timeline leads to: V, P, and the figure of merit.
struct AtEnd {
    v: DriftMatrix,
    p: Matrix3<f64>,
    value: f64,
}

/// P_D by the factors of the information.
pub(super) struct ByFactors<'a, A: Arithmetic<Number = f64>> {
    pub matrix: CoefficientMatrix,
    pub factor: &'a Factor<A>,
}

impl<A: Arithmetic<Number = f64>> CoefficientCovariance for ByFactors<'_, A> {
    fn matrix(&self) -> &CoefficientMatrix {
        &self.matrix
    }
    fn root(&self) -> Cow<'_, CovarianceRoot> {
        Cow::Owned(self.factor.root(|v| v))
    }
}

impl Task for ToEnd<'_> {
    type Output = Result<AtEnd>;
    #[inline(always)]
    fn run<A: Single>(self, ar: A) -> Result<AtEnd> {
        let model = self.model;
        let earth = model.earth();
        let keeps_tape = matches!(self.wanted, Wanted::Gradient(..));
        let legs = OneTimeline {
            ar,
            model,
            timeline: self.timeline,
            rule: self.rule,
            keep_empty: keeps_tape,
            facts: Facts::of::<Drift>(),
        };
        let mut tape = take_tape(keeps_tape);
        let mut gains = Own::new(ar, &legs, &earth, &model.prior_psi);
        let chain = course::forward::<_, Drift>(ar, &legs, &earth, &mut gains, &mut tape);
        let factor = chain.e.factor(ar, &model.prior_scale);
        let mut p = factor.covariance(ar);
        let of = ByFactors {
            matrix: to_coefficients(&p),
            factor: &factor,
        };
        let kept = keeps_digits(factor.least, factor.cancelled);
        let p_psi = mirrored(&gains.p());
        let per_s = 1.0 / (model.period_s * model.noise_variance);
        let value = match self.wanted {
            Wanted::Value(merit) if kept => merit(&of),
            Wanted::Value(merit) => model
                .end_covariance_in_doubles(self.timeline, self.rule)
                .and_then(|end| merit(&end)),
            // No closures around what is bulky: they are compiled without the registers.
            Wanted::Gradient(merit, out) if kept => match merit(&of) {
                Ok((value, slope)) => {
                    let information = match &slope {
                        Slope::Variances(g) => {
                            complete(ar, &mut p);
                            symmetric_product(ar, &p, &pulled_slope(ar, &p, g))
                        }
                        _ => known_rows(ar, &by_gyros(&slope.of_information(&of))),
                    };
                    course::backward(ar, &legs, &earth, &tape.steps, &information, per_s, out);
                    Ok(value)
                }
                Err(error) => Err(error),
            },
            Wanted::Gradient(merit, out) => {
                let told = told(&legs, &earth, &tape);
                match by_rows(&told, model, merit) {
                    Ok((value, rows)) => {
                        let mut of_rows = Vec::with_capacity(rows.len());
                        for row in &rows {
                            of_rows.push(row_by_gyros(ar, row));
                        }
                        let information = ByRows(of_rows);
                        course::backward(ar, &legs, &earth, &tape.steps, &information, per_s, out);
                        Ok(value)
                    }
                    Err(error) => Err(error),
                }
            }
        };
        keep_tape(tape);
        Ok(AtEnd {
            v: drift_matrix_of(&chain.v),
            p: Matrix3::from_fn(|i, j| p_psi[i][j]),
            value: value?,
        })
    }
}

/// A figure of merit by the rows that the chain has told, and what its derivative does to each.
fn by_rows(
    told: &[Told],
    model: &CovarianceModel,
    merit: Merit<'_, (f64, Slope)>,
) -> Result<(f64, Vec<[f64; COEFFICIENTS]>)> {
    let whitened = Whitened::new(told, &model.prior_sigma)?;
    let of = Rooted::new(whitened.root.clone());
    let (value, slope) = merit(&of)?;
    Ok((value, whitened.times_adjoint(&slope.in_root(&of))))
}

/// The rows on D that the chain has told, in order.
fn told<A: Single>(legs: &OneTimeline<'_, A>, earth: &Earth<f64>, tape: &Tape<A>) -> Vec<Told> {
    let mut told = Vec::new();
    let mut push = |row: &[A::Quad; 3], scale: f64| {
        told.push(Told::new(
            &of_coefficients(row),
            scale,
            &legs.model.prior_sigma,
        ));
    };
    for (leg, step) in &tape.steps {
        match step {
            Step::Dwell(dwell) => {
                let [h] = Place::<A>::new(legs.ar, earth, legs.attitude(*leg)).h;
                let [q_c] = dwell.q_c;
                let second = entries(&q_c).map(|row| row.map(|v| h.times(v)));
                dwell.x.iter().chain(&second).for_each(|row| push(row, 1.0));
            }
            Step::Measure(measure, ..) => {
                let Seen { weight, d, .. } = measure.seen;
                for (row, d) in measure.rows.iter().zip(d) {
                    push(row, (weight * d).sqrt());
                }
            }
            _ => {}
        }
    }
    told
}

/// A row in the order of the coefficients.
fn of_coefficients<Q: Row<Number = f64>>(row: &[Q; 3]) -> [f64; COEFFICIENTS] {
    PLACES.map(|(at, sign)| sign * row[at / 4].get(at % 4))
}

/// A row of coefficients gyro by gyro.
#[inline(always)]
fn row_by_gyros<A: Single>(ar: A, row: &[f64; COEFFICIENTS]) -> [A::Quad; 3] {
    let mut places = [[0.0; 4]; 3];
    for (value, (at, sign)) in row.iter().zip(PLACES) {
        places[at / 4][at % 4] = sign * value;
    }
    places.map(|of| ar.quad(of))
}

/// V in the order of the coefficients.
#[inline(always)]
fn drift_matrix_of<Q: Row<Number = f64>>(v: &Wide<Q>) -> DriftMatrix {
    let mut out = DriftMatrix::zeros();
    for (c, &(at, sign)) in PLACES.iter().enumerate() {
        for i in 0..3 {
            out[(i, c)] = sign * v[i][at / 4].get(at % 4);
        }
    }
    out
}

thread_local! {
    /// The tape of the last schedule of this thread: its memory is used again.
    static TAPE: RefCell<Option<Box<dyn Any>>> = const { RefCell::new(None) };
}

/// This thread's tape, empty. Taken out, not borrowed: a figure of merit may itself ask for a
/// gradient.
pub(crate) fn take_tape<A: Arithmetic + 'static, S: Shape>(on: bool) -> Box<Tape<A, S>> {
    let kept = TAPE.with(RefCell::take);
    let kept: Option<Box<Tape<A, S>>> = kept.and_then(|t| t.downcast().ok());
    let mut tape = kept.unwrap_or_else(|| {
        Box::new(Tape {
            on,
            steps: Vec::new(),
        })
    });
    tape.on = on;
    tape.steps.clear();
    tape
}

/// Puts the tape back.
pub(crate) fn keep_tape<A: Arithmetic + 'static, S: Shape>(tape: Box<Tape<A, S>>) {
    TAPE.with(|slot| slot.replace(Some(tape)));
}

impl CovarianceModel {
    /// The value of a figure of merit of P_D at the end of `timeline`, by the Gram form of the
    /// information where that keeps its digits, by its rows where it does not.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows; what
    /// `merit` returns.
    pub fn value(
        &self,
        timeline: &Timeline,
        rule: TickRule,
        mut merit: impl FnMut(&dyn CoefficientCovariance) -> Result<f64>,
    ) -> Result<f64> {
        if let Some(coloured) = &self.coloured {
            return self.coloured_value(coloured, timeline, rule, &mut merit);
        }
        if let Some(mixing) = &self.mixing {
            return self.wide_value(mixing, timeline, rule, merit);
        }
        Ok(self.to_end(timeline, rule, &mut merit)?.value)
    }

    fn to_end(
        &self,
        timeline: &Timeline,
        rule: TickRule,
        merit: &mut dyn FnMut(&dyn CoefficientCovariance) -> Result<f64>,
    ) -> Result<AtEnd> {
        dispatch::run(ToEnd {
            model: self,
            timeline,
            rule,
            wanted: Wanted::Value(merit),
        })
    }

    /// The covariance at the end of `timeline` by the Gram form of the information: much faster
    /// than [`CovarianceModel::end_covariance`], for searches. What the schedule leaves to the
    /// prior loses digits where the rest is known much better.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows.
    pub fn end_covariance_by_gram(
        &self,
        timeline: &Timeline,
        rule: TickRule,
    ) -> Result<EndCovariance> {
        let mut root = CovarianceRoot::independent(&self.prior_sigma);
        let mut coefficients = CoefficientMatrix::zeros();
        let end = self.to_end(timeline, rule, &mut |p| {
            (coefficients, root) = (*p.matrix(), p.root().into_owned());
            Ok(0.0)
        })?;
        let through_drift = end.v * root.matrix();
        Ok(EndCovariance {
            coefficients,
            root,
            misalignment: end.p + through_drift * through_drift.transpose(),
        })
    }

    /// The value of a figure of merit and its gradient, one [`LegGradient`] per leg.
    ///
    /// `merit` takes P_D and returns the value with its derivative with respect to P_D.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows; what
    /// `merit` returns.
    pub fn gradient(
        &self,
        timeline: &Timeline,
        rule: TickRule,
        mut merit: impl FnMut(&dyn CoefficientCovariance) -> Result<(f64, Slope)>,
    ) -> Result<(f64, Vec<LegGradient>)> {
        if let Some(coloured) = &self.coloured {
            return self.coloured_gradient(coloured, timeline, rule, &mut merit);
        }
        if let Some(mixing) = &self.mixing {
            return self.wide_gradient(mixing, timeline, rule, merit);
        }
        let mut out = vec![LegGradient::default(); timeline.legs().len()];
        let end = dispatch::run(ToEnd {
            model: self,
            timeline,
            rule,
            wanted: Wanted::Gradient(&mut merit, &mut out),
        })?;
        Ok((end.value, out))
    }
}
