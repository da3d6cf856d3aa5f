//! One schedule at a time, on the widest registers that keep its bits the same everywhere.

use std::any::Any;
use std::cell::RefCell;

use nalgebra::Matrix3;

use super::course::{self, Legs, Stretch, Tape};
use super::dispatch::{self, Task};
use super::earth::Earth;
use super::gains::{DwellKernel, Gains, Own};
use super::information::{PLACES, complete, pulled_slope, symmetric_product, to_coefficients};
use super::moves::{Interval, Turn};
use super::numbers::{Arithmetic, Row, Single};
use super::square::mirrored;
use super::{Place, Wide, attitude_entries};
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CovarianceModel, EndCovariance, TickRule, not_finite, split_periods};
use crate::drift::{CoefficientMatrix, DriftMatrix};
use crate::error::Result;
use crate::motion::integral::Panels;
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
}

impl<A: Single> OneTimeline<'_, A> {
    /// The move to a leg, where it takes time.
    pub fn slew(&self, leg: usize) -> Option<&Move> {
        let arrival = self.timeline.legs()[leg].arrival.as_ref()?;
        (!self.model.frame_hold && arrival.duration_s > 0.0).then_some(arrival)
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
    fn place(&self, leg: usize) -> Place<A> {
        Place::new(
            self.ar,
            attitude_entries(&self.timeline.legs()[leg].attitude),
        )
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
            Some(m) if m.measured => {
                let (ticks, remainder) = self.ticks(m);
                ticks + usize::from(remainder > 0.0 || self.keep_empty)
            }
            Some(_) => 1,
        }
    }
    #[inline(always)]
    fn stretch(&self, leg: usize, index: usize) -> Stretch<f64, Panels> {
        // Only called for legs that have stretches, hence a move.
        let none = Move {
            from: [0.0; 3],
            change: [0.0; 3],
            duration_s: 1.0,
            measured: false,
        };
        let m = self.slew(leg).unwrap_or(&none);
        let period_s = self.model.period_s;
        let (start_s, length_s, last, measured) = if m.measured {
            let (ticks, remainder) = self.ticks(m);
            let start_s = index as f64 * period_s;
            if index < ticks {
                let weight = self.model.noise_variance.recip();
                let last = remainder == 0.0 && index + 1 == ticks && !self.keep_empty;
                (start_s, period_s, last, Some((weight, 0.0)))
            } else {
                let weight = self.relaxed_weight(remainder).map(|w| (w, 1.0));
                (start_s, remainder, true, weight)
            }
        } else {
            (0.0, m.duration_s, true, None)
        };
        Stretch {
            turn: Turn {
                from: m.reduced_from(),
                change: m.change,
                duration_s: m.duration_s,
            },
            interval: Interval { start_s, length_s },
            panels: Panels::of(m, length_s),
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
        let numbers = self.model.kernels.numbers(periods);
        Some(DwellKernel::new(self.ar, numbers.get()))
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
        Earth::new(0.0, &self.dynamics, self.drift_psd)
    }
}

/// A figure of merit of P_D, (°/h)², with its derivative.
type Merit<'a> = &'a mut dyn FnMut(&CoefficientMatrix) -> Result<(f64, CoefficientMatrix)>;

/// The end of a timeline, and the gradient of a figure of merit where one is given.
struct ToEnd<'a> {
    model: &'a CovarianceModel,
    timeline: &'a Timeline,
    rule: TickRule,
    merit: Option<(Merit<'a>, &'a mut [LegGradient])>,
}

/// What a timeline leads to: P_D, V, P, and the figure of merit if any.
struct AtEnd {
    coefficients: CoefficientMatrix,
    v: DriftMatrix,
    p: Matrix3<f64>,
    value: f64,
}

impl Task for ToEnd<'_> {
    type Output = Result<AtEnd>;
    #[inline(always)]
    fn run<A: Single>(self, ar: A) -> Result<AtEnd> {
        let model = self.model;
        let earth = model.earth();
        let legs = OneTimeline {
            ar,
            model,
            timeline: self.timeline,
            rule: self.rule,
            keep_empty: self.merit.is_some(),
        };
        let mut tape = take_tape(self.merit.is_some());
        let mut gains = Own::new(ar, &legs, &earth, &model.prior_psi);
        let chain = course::forward(ar, &legs, &earth, &mut gains, &mut tape);
        let factor = chain.e.factor(ar, &model.prior_scale);
        if factor.least.is_nan() || factor.least <= 0.0 {
            keep_tape(tape);
            return Err(not_finite());
        }
        let mut p = factor.covariance(ar);
        let p_psi = mirrored(&gains.p());
        let mut end = AtEnd {
            coefficients: to_coefficients(&p),
            v: drift_matrix_of(&chain.v),
            p: Matrix3::from_fn(|i, j| p_psi[i][j]),
            value: 0.0,
        };
        if let Some((merit, out)) = self.merit {
            let (value, slope) = merit(&end.coefficients)?;
            end.value = value;
            complete(ar, &mut p);
            let information = symmetric_product(ar, &p, &pulled_slope(ar, &p, &slope));
            let per_s = 1.0 / (model.period_s * model.noise_variance);
            course::backward(ar, &legs, &earth, &tape.steps, &information, per_s, out);
        }
        keep_tape(tape);
        Ok(end)
    }
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
pub(crate) fn take_tape<A: Arithmetic + 'static>(on: bool) -> Box<Tape<A>> {
    let kept = TAPE.with(RefCell::take);
    let kept: Option<Box<Tape<A>>> = kept.and_then(|t| t.downcast().ok());
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
pub(crate) fn keep_tape<A: Arithmetic + 'static>(tape: Box<Tape<A>>) {
    TAPE.with(|slot| slot.replace(Some(tape)));
}

impl CovarianceModel {
    fn to_end(&self, timeline: &Timeline, rule: TickRule) -> Result<AtEnd> {
        dispatch::run::<_, false>(ToEnd {
            model: self,
            timeline,
            rule,
            merit: None,
        })
    }

    /// P_D at the end of `timeline` by the Gram form of the information, (°/h)².
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows.
    pub(crate) fn coefficients_by_gram(
        &self,
        timeline: &Timeline,
        rule: TickRule,
    ) -> Result<CoefficientMatrix> {
        Ok(self.to_end(timeline, rule)?.coefficients)
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
        let end = self.to_end(timeline, rule)?;
        Ok(EndCovariance {
            coefficients: end.coefficients,
            misalignment: end.p + end.v * end.coefficients * end.v.transpose(),
        })
    }

    /// The value of a figure of merit and its gradient, one [`LegGradient`] per leg.
    ///
    /// `merit` takes P_D in (°/h)² and returns the value with its derivative with respect to
    /// P_D, a symmetric matrix G: df = tr(G dP_D).
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows; what
    /// `merit` returns.
    pub fn gradient(
        &self,
        timeline: &Timeline,
        rule: TickRule,
        merit: impl FnOnce(&CoefficientMatrix) -> Result<(f64, CoefficientMatrix)>,
    ) -> Result<(f64, Vec<LegGradient>)> {
        let mut merit = Some(merit);
        let mut once = |p: &CoefficientMatrix| match merit.take() {
            Some(merit) => merit(p),
            None => Err(not_finite()),
        };
        let mut out = vec![LegGradient::default(); timeline.legs().len()];
        let end = dispatch::run::<_, false>(ToEnd {
            model: self,
            timeline,
            rule,
            merit: Some((&mut once, &mut out)),
        })?;
        Ok((end.value, out))
    }
}
