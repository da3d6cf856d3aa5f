//! One schedule at a time, on the widest registers that keep its bits the same everywhere.

use std::any::Any;
use std::cell::RefCell;

use nalgebra::Matrix3;
use pulp::{NullaryFnOnce, Simd};

use super::course::{self, Legs, NoTape, Step, Stretch};
use super::earth::Earth;
use super::information::{Factor, PLACES, Rows, information_adjoint, mirror, to_coefficients};
use super::moves::{Interval, Turn};
use super::numbers::{Arithmetic, Packed, Plain, Row, four};
use super::{Chain, DwellKernel, Place, Wide, attitude_entries};
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CovarianceModel, EndCovariance, TickRule, not_finite, split_periods};
use crate::drift::{CoefficientMatrix, DriftMatrix};
use crate::error::Result;
use crate::motion::integral::Panels;
use crate::motion::{Move, Timeline};

/// Work on one schedule, in whatever registers the machine has.
trait Task {
    type Output;
    fn run<A: Arithmetic<Number = f64> + 'static>(self, ar: A) -> Self::Output;
}

/// A task with the registers it is to use.
struct In<S, T>(S, T);

impl<S: Simd, T: Task> NullaryFnOnce for In<S, T> {
    type Output = T::Output;
    #[inline(always)]
    fn call(self) -> T::Output {
        self.1.run(Packed(self.0))
    }
}

/// Runs `task` with the instruction set of this machine. The results do not depend on it.
fn dispatch<T: Task>(task: T) -> T::Output {
    #[cfg(target_arch = "x86_64")]
    match pulp::x86::Arch::new() {
        pulp::x86::Arch::V4(simd) => return simd.vectorize(In(*simd, task)),
        pulp::x86::Arch::V3(simd) => return simd.vectorize(In(simd, task)),
        _ => {}
    }
    task.run(Plain)
}

/// The legs of one timeline.
struct OneTimeline<'a, A> {
    ar: A,
    model: &'a CovarianceModel,
    timeline: &'a Timeline,
    rule: TickRule,
    /// Whether steps of no length are wanted too (their derivative is not zero).
    keep_empty: bool,
}

impl<A: Arithmetic<Number = f64>> OneTimeline<'_, A> {
    fn slew(&self, leg: usize) -> Option<&Move> {
        let arrival = self.timeline.legs()[leg].arrival.as_ref()?;
        (!self.model.frame_hold && arrival.duration_s > 0.0).then_some(arrival)
    }

    /// Ticks of a measured move and what is left.
    fn ticks(&self, m: &Move) -> (usize, f64) {
        split_periods(m.duration_s, self.model.period_s)
    }

    fn relaxed_weight(&self, length_s: f64) -> Option<f64> {
        (self.rule == TickRule::Relaxed)
            .then(|| length_s / (self.model.period_s * self.model.noise_variance))
    }
}

impl<A: Arithmetic<Number = f64>> Legs<A> for OneTimeline<'_, A> {
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
        self.timeline.legs()[leg].position.alpha.sin_cos()
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
    fn stretch(&self, leg: usize, index: usize) -> Stretch<f64> {
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
                (start_s, period_s, last, Some((weight, false)))
            } else {
                let weight = self.relaxed_weight(remainder).map(|w| (w, true));
                (start_s, remainder, true, weight)
            }
        } else {
            (0.0, m.duration_s, true, None)
        };
        Stretch {
            turn: Turn {
                from: m.from,
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
    fn settle_s(&self, leg: usize) -> Option<f64> {
        let l = &self.timeline.legs()[leg];
        (l.arrival.is_some() && l.settle_s > 0.0).then_some(l.settle_s)
    }
    #[inline(always)]
    fn dwell(&self, leg: usize) -> Option<DwellKernel<A>> {
        let dwell_s = self.timeline.legs()[leg].dwell_s;
        let (periods, _) = split_periods(dwell_s, self.model.period_s);
        if periods == 0 {
            return None;
        }
        let numbers = self.model.kernels.numbers(periods);
        Some(DwellKernel::new(self.ar, numbers.get()))
    }
    #[inline(always)]
    fn remainder(&self, leg: usize) -> Option<(f64, Option<f64>)> {
        let dwell_s = self.timeline.legs()[leg].dwell_s;
        let (_, remainder) = split_periods(dwell_s, self.model.period_s);
        (remainder > 0.0 || self.keep_empty).then(|| (remainder, self.relaxed_weight(remainder)))
    }
}

impl CovarianceModel {
    fn earth(&self) -> Earth<f64> {
        Earth::new(0.0, &self.dynamics, self.drift_psd)
    }
}

/// P_D of a timeline.
struct Coefficients<'a> {
    model: &'a CovarianceModel,
    timeline: &'a Timeline,
    rule: TickRule,
}

impl Coefficients<'_> {
    #[inline(always)]
    fn chain<A: Arithmetic<Number = f64>>(&self, ar: A) -> (Chain<A>, Factor<A>) {
        let legs = OneTimeline {
            ar,
            model: self.model,
            timeline: self.timeline,
            rule: self.rule,
            keep_empty: false,
        };
        let mut chain = Chain::new(ar, &self.model.prior_psi);
        course::forward(&mut chain, &legs, &self.model.earth(), &mut NoTape);
        let factor = chain.e.factor(ar, &self.model.prior_scale);
        (chain, factor)
    }
}

impl Task for Coefficients<'_> {
    type Output = Option<CoefficientMatrix>;
    #[inline(always)]
    fn run<A: Arithmetic<Number = f64>>(self, ar: A) -> Self::Output {
        let (_, factor) = self.chain(ar);
        if factor.least > 0.0 {
            Some(to_coefficients(&factor.covariance(ar)))
        } else {
            None
        }
    }
}

/// P_D and the covariance of ψ^n.
struct End<'a>(Coefficients<'a>);

impl Task for End<'_> {
    type Output = Option<(CoefficientMatrix, DriftMatrix, Matrix3<f64>)>;
    #[inline(always)]
    fn run<A: Arithmetic<Number = f64>>(self, ar: A) -> Self::Output {
        let (chain, factor) = self.0.chain(ar);
        if factor.least.is_nan() || factor.least <= 0.0 {
            return None;
        }
        let p = super::square::mirrored(&chain.p);
        let coefficients = to_coefficients(&factor.covariance(ar));
        let p = Matrix3::from_fn(|i, j| p[i][j]);
        Some((coefficients, drift_matrix_of(&chain.v), p))
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

/// Value and gradient of a figure of merit.
struct Gradient<'a, F> {
    model: &'a CovarianceModel,
    timeline: &'a Timeline,
    rule: TickRule,
    merit: F,
}

impl<F> Task for Gradient<'_, F>
where
    F: FnOnce(&CoefficientMatrix) -> Result<(f64, CoefficientMatrix)>,
{
    type Output = Result<(f64, Vec<LegGradient>)>;
    #[inline(always)]
    fn run<A: Arithmetic<Number = f64> + 'static>(self, ar: A) -> Self::Output {
        let model = self.model;
        let legs = OneTimeline {
            ar,
            model,
            timeline: self.timeline,
            rule: self.rule,
            keep_empty: true,
        };
        let mut tape = take_tape();
        let mut out = vec![LegGradient::default(); legs.count()];
        let value = value_and_gradient(ar, &legs, self.merit, &mut tape, &mut out);
        keep_tape(tape);
        Ok((value?, out))
    }
}

#[inline(always)]
fn value_and_gradient<A, F>(
    ar: A,
    legs: &OneTimeline<'_, A>,
    merit: F,
    tape: &mut Vec<(usize, Step<A>)>,
    out: &mut [LegGradient],
) -> Result<f64>
where
    A: Arithmetic<Number = f64>,
    F: FnOnce(&CoefficientMatrix) -> Result<(f64, CoefficientMatrix)>,
{
    let model = legs.model;
    let earth = model.earth();
    let mut chain = Chain::new(ar, &model.prior_psi);
    course::forward(&mut chain, legs, &earth, tape);
    let factor = chain.e.factor(ar, &model.prior_scale);
    if factor.least.is_nan() || factor.least <= 0.0 {
        return Err(not_finite());
    }
    let mut p: Rows<A::Quad> = factor.covariance(ar);
    let (value, slope) = merit(&to_coefficients(&p))?;
    complete(ar, &mut p);
    let information = information_adjoint(ar, &p, &slope);
    let per_s = 1.0 / (model.period_s * model.noise_variance);
    course::backward(ar, legs, &earth, tape, &information, per_s, out);
    Ok(value)
}

/// Both triangles of a matrix from the upper one.
#[inline(always)]
fn complete<A: Arithmetic<Number = f64>>(ar: A, p: &mut Rows<A::Quad>) {
    mirror(ar, p);
    for j in 0..3 {
        let block = four!(|e| four!(|f| match e <= f {
            true => p[4 * j + e][j].get(f),
            false => p[4 * j + f][j].get(e),
        }));
        for e in 0..4 {
            p[4 * j + e][j] = ar.quad(block[e]);
        }
    }
}

thread_local! {
    /// The tape of the last gradient of this thread: its memory is used again.
    static TAPE: RefCell<Option<Box<dyn Any>>> = const { RefCell::new(None) };
}

/// This thread's tape, empty. Taken out, not borrowed: a figure of merit may itself ask for a
/// gradient.
#[expect(
    clippy::box_collection,
    reason = "kept as any type, without allocating again"
)]
fn take_tape<T: 'static>() -> Box<Vec<T>> {
    let kept = TAPE.with(RefCell::take);
    let mut tape: Box<Vec<T>> = kept.and_then(|t| t.downcast().ok()).unwrap_or_default();
    tape.clear();
    tape
}

/// Puts the tape back.
#[expect(clippy::box_collection, reason = "as `take_tape` gives it")]
fn keep_tape<T: 'static>(tape: Box<Vec<T>>) {
    TAPE.with(|slot| slot.replace(Some(tape)));
}

impl CovarianceModel {
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
        dispatch(Coefficients {
            model: self,
            timeline,
            rule,
        })
        .ok_or_else(not_finite)
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
        let (coefficients, v, p) = dispatch(End(Coefficients {
            model: self,
            timeline,
            rule,
        }))
        .ok_or_else(not_finite)?;
        Ok(EndCovariance {
            coefficients,
            misalignment: p + v * coefficients * v.transpose(),
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
        dispatch(Gradient {
            model: self,
            timeline,
            rule,
            merit,
        })
    }
}
