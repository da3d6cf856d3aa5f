//! One schedule with all parameters of a platform's error model: as [`super::single`], with more
//! columns.

mod seen;
#[cfg(test)]
pub(super) mod tests;
mod told;

use std::marker::PhantomData;

use super::Collecting;
use super::arithmetic::{Arithmetic, Number, Single, Work};
use super::course;
use super::dispatch::{self, Task};
use super::gains::Own;
use super::mixing::{Kind, Mixing};
use super::posterior::{Posterior, Pulled};
use super::shape::{Catalogue, Facts, Instruments};
use super::single::{Merit, OneTimeline, Wanted, keep_tape, take_tape};
use super::tiles::{Tiles, WideAdjoint};
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CoefficientCovariance, CovarianceModel, Slope, TickRule};
use crate::error::Result;
use crate::motion::Timeline;
pub(crate) use seen::OfPosterior;
pub(crate) use told::{Stacked, Told};
use told::{by_columns, told};

/// How a value is worked out.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct How {
    /// By the rows even where sums of squares keep their digits.
    pub by_rows: bool,
    /// Steps of no length too, as in lanes.
    pub in_step: bool,
}

/// The end of a timeline, and what is wanted of it.
struct ToEnd<'a, S> {
    model: &'a CovarianceModel,
    mixing: &'a Mixing,
    timeline: &'a Timeline,
    rule: TickRule,
    wanted: Wanted<'a>,
    how: How,
    _shape: S,
}

impl<S: WideShape> Task for ToEnd<'_, S> {
    type Output = Result<f64>;
    #[inline(always)]
    fn run<A: Single>(self, ar: A) -> Result<f64> {
        let Self { model, mixing, .. } = self;
        let earth = model.earth();
        let keeps_tape = matches!(self.wanted, Wanted::Gradient(..));
        let legs = OneTimeline {
            ar,
            model,
            timeline: self.timeline,
            rule: self.rule,
            keep_empty: keeps_tape,
            facts: Facts::of::<S>(),
        };
        let mut tape = take_tape(keeps_tape);
        let (posterior, kept) = loop {
            let mut gains = Own::new(ar, &legs, &earth, &model.prior_psi);
            let chain = course::forward::<A, S>(ar, &legs, &earth, &mut gains, &mut tape);
            let tiles = S::numbers(&chain.e);
            let posterior = ar.always_apart(Finish(0.0, mixing, &tiles));
            let kept = !self.how.by_rows && posterior.keeps_digits(|v| v);
            if kept || tape.on {
                break (posterior, kept);
            }
            // Once more, with the rows kept.
            tape.on = true;
        };
        let of = OfPosterior::new(&posterior, &mixing.order, |v: f64| v);
        let by_rows = || {
            let told = told(ar, &legs, &earth, &tape, mixing);
            Stacked::new(&told, &mixing.order)
        };
        let value = match self.wanted {
            Wanted::Value(merit) if kept => merit(&of),
            Wanted::Value(merit) => by_rows().and_then(|stacked| merit(&stacked)),
            Wanted::Gradient(merit, out) => {
                // No closures around what is bulky: they would be compiled without the registers.
                let found = if kept {
                    match merit(&of) {
                        Ok((value, slope)) => {
                            let slope = of.pulled(&slope);
                            let pull = Pull::<A, S>::new(ar, mixing, &posterior, &slope);
                            Ok((value, ar.always_apart(pull)))
                        }
                        Err(error) => Err(error),
                    }
                } else {
                    by_rows().and_then(|stacked| {
                        let (value, slope) = merit(&stacked)?;
                        Ok((
                            value,
                            by_columns::<A, S>(ar, mixing, &stacked.times_adjoint(&slope)),
                        ))
                    })
                };
                let per_s = 1.0 / (model.period_s * model.noise_variance);
                match found {
                    Ok((value, information)) => {
                        course::backward(ar, &legs, &earth, &tape.steps, &information, per_s, out);
                        Ok(value)
                    }
                    Err(error) => Err(error),
                }
            }
        };
        keep_tape(tape);
        value
    }
}

/// What the collected information leaves of what is seen.
pub(crate) struct Finish<'a, N>(pub N, pub &'a Mixing, pub &'a [N]);

impl<N: Number> Work for Finish<'_, N> {
    type Output = Posterior<N>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        Posterior::new(self.0, &self.1.order, self.1.information(self.0, self.2))
    }
}

/// Ē over the columns of the shape.
pub(crate) struct Pull<'a, A: Arithmetic, S> {
    ar: A,
    mixing: &'a Mixing,
    posterior: &'a Posterior<A::Number>,
    slope: &'a Pulled<A::Number>,
    shape: PhantomData<S>,
}

impl<'a, A: Arithmetic, S> Pull<'a, A, S> {
    pub fn new(
        ar: A,
        mixing: &'a Mixing,
        posterior: &'a Posterior<A::Number>,
        slope: &'a Pulled<A::Number>,
    ) -> Self {
        Self {
            ar,
            mixing,
            posterior,
            slope,
            shape: PhantomData,
        }
    }
}

impl<A: Arithmetic, S: WideShape> Work for Pull<'_, A, S> {
    type Output = WideAdjoint<A, S>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let of_parameters = self.posterior.adjoint(self.slope);
        let of_columns = self.mixing.pulled(self.ar.number(0.0), &of_parameters);
        WideAdjoint::new(self.ar, &of_columns)
    }
}

/// A shape whose information is in tiles.
pub(crate) trait WideShape: Collecting {
    /// The entries of all tiles.
    fn numbers<A: Arithmetic>(e: &Self::Information<A>) -> Vec<A::Number>;
}

macro_rules! wide_shape {
    ($($S:ty),*) => {$(
        impl WideShape for $S {
            #[inline(always)]
            fn numbers<A: Arithmetic>(e: &Tiles<A, Self>) -> Vec<A::Number> {
                e.numbers()
            }
        }
    )*};
}
wide_shape!(Instruments, Catalogue);

impl CovarianceModel {
    fn to_wide_end<'a>(
        &'a self,
        mixing: &'a Mixing,
        timeline: &'a Timeline,
        rule: TickRule,
        how: How,
        wanted: Wanted<'a>,
    ) -> Result<f64> {
        macro_rules! run {
            ($shape:expr) => {
                dispatch::run(ToEnd {
                    model: self,
                    mixing,
                    timeline,
                    rule,
                    wanted,
                    how,
                    _shape: $shape,
                })
            };
        }
        match mixing.kind {
            Kind::Instruments => run!(Instruments),
            Kind::Catalogue => run!(Catalogue),
        }
    }

    /// As [`CovarianceModel::value`], with the parameters of `mixing`.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows; what
    /// `merit` returns.
    pub(super) fn wide_value(
        &self,
        mixing: &Mixing,
        timeline: &Timeline,
        rule: TickRule,
        mut merit: impl FnMut(&dyn CoefficientCovariance) -> Result<f64>,
    ) -> Result<f64> {
        self.to_wide_end(
            mixing,
            timeline,
            rule,
            How::default(),
            Wanted::Value(&mut merit),
        )
    }

    /// As [`CovarianceModel::gradient`], with the parameters of `mixing`.
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::wide_value`].
    pub(super) fn wide_gradient(
        &self,
        mixing: &Mixing,
        timeline: &Timeline,
        rule: TickRule,
        mut merit: impl FnMut(&dyn CoefficientCovariance) -> Result<(f64, Slope)>,
    ) -> Result<(f64, Vec<LegGradient>)> {
        self.wide_gradient_by(mixing, timeline, rule, How::default(), &mut merit)
    }

    fn wide_gradient_by(
        &self,
        mixing: &Mixing,
        timeline: &Timeline,
        rule: TickRule,
        how: How,
        merit: Merit<'_, (f64, Slope)>,
    ) -> Result<(f64, Vec<LegGradient>)> {
        let mut out = vec![LegGradient::default(); timeline.legs().len()];
        let wanted = Wanted::Gradient(merit, &mut out);
        let value = self.to_wide_end(mixing, timeline, rule, how, wanted)?;
        Ok((value, out))
    }
}
