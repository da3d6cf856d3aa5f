//! One schedule with all parameters of a platform's error model: as [`super::single`], with more
//! columns.

mod seen;
#[cfg(test)]
mod tests;
mod told;

use nalgebra::{DMatrix, DVector, Matrix3};

use super::arithmetic::{Arithmetic, Row, Single};
use super::course;
use super::dispatch::{self, Task};
use super::gains::{Gains, Own};
use super::mixing::{Kind, Mixing};
use super::posterior::Posterior;
use super::shape::{Catalogue, Facts, Instruments, Shape, Torquers};
use super::single::{OneTimeline, keep_tape, take_tape};
use super::square::mirrored;
use super::tiles::{Tiles, WideAdjoint};
use super::{Place, Wide};
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CovarianceModel, TickRule, not_finite};
use crate::error::Result;
use crate::motion::Timeline;
pub(crate) use seen::OfPosterior;
pub use seen::{WideCovariance, WideSlope};
use told::{Stacked, told};

/// A figure of merit.
type Merit<'a, T> = &'a mut dyn FnMut(&dyn WideCovariance) -> Result<T>;

/// What is wanted at the end of a timeline.
enum Wanted<'a> {
    Value(Merit<'a, f64>),
    Gradient(Merit<'a, (f64, WideSlope)>, &'a mut [LegGradient]),
    End(&'a mut Option<WideEnd>),
}

/// What the filter knows at the end of a test, and what is true.
#[derive(Debug, Clone, PartialEq)]
pub struct WideEnd {
    /// 1σ of what is estimated, in the order of the mixing, in the parameters' units: as the filter
    /// claims it.
    pub claimed_sigma: Vec<f64>,
    /// And with the considered parameters.
    pub sigma: Vec<f64>,
    /// The filter's covariance of ψ^n, arcsec².
    pub misalignment: Matrix3<f64>,
}

/// How a value is worked out.
#[derive(Debug, Clone, Copy, Default)]
struct How {
    /// By the rows even where sums of squares keep their digits.
    by_rows: bool,
    /// Steps of no length too, as in lanes.
    in_step: bool,
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
            keep_empty: keeps_tape || self.how.in_step,
            facts: Facts::of::<S>(),
        };
        let mut tape = take_tape(keeps_tape);
        let is_end = matches!(self.wanted, Wanted::End(_));
        let (chain, p, tiles, posterior, kept) = loop {
            let mut gains = Own::new(ar, &legs, &earth, &model.prior_psi);
            let chain = course::forward::<A, S>(ar, &legs, &earth, &mut gains, &mut tape);
            let tiles = S::numbers(&chain.e);
            let posterior = Posterior::new(0.0, mixing, &tiles);
            let kept = !self.how.by_rows && posterior.keeps_digits(|v| v);
            if kept || tape.on || is_end {
                break (chain, gains.p(), tiles, posterior, kept);
            }
            // Once more, with the rows kept.
            tape.on = true;
        };
        let of = OfPosterior::new(&posterior, mixing, |v: f64| v);
        let by_rows = || {
            let told = told(ar, &legs, &earth, &tape, mixing);
            Stacked::new(&told, mixing)
        };
        let value = match self.wanted {
            Wanted::Value(merit) if kept => merit(&of),
            Wanted::Value(merit) => by_rows().and_then(|stacked| merit(&stacked)),
            Wanted::Gradient(merit, out) => {
                // No closures around what is bulky: they would be compiled without the registers.
                let found = if kept {
                    match merit(&of) {
                        Ok((value, slope)) => {
                            let of_parameters = posterior.adjoint(&of.pulled(&slope));
                            let of_columns = mixing.pulled(0.0, &of_parameters);
                            Ok((value, WideAdjoint::<A, S>::new(ar, &of_columns)))
                        }
                        Err(error) => Err(error),
                    }
                } else {
                    by_rows().and_then(|stacked| {
                        let (value, slope) = merit(&stacked)?;
                        Ok((value, stacked.times_adjoint::<A, S>(ar, &slope)))
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
            Wanted::End(to) => {
                let mut v = chain.v;
                if let Some(last) = self.timeline.legs().last() {
                    let c = super::attitude_entries(&last.attitude);
                    shift_back::<A, S>(&Place::new(ar, &earth, c), &mut v);
                }
                let p = mirrored(&p);
                let p = Matrix3::from_fn(|i, j| p[i][j]);
                *to = WideEnd::new::<A, S>(mixing, &mixing.information(0.0, &tiles), &v, &p);
                Ok(0.0)
            }
        };
        keep_tape(tape);
        value
    }
}

/// V from V'.
#[inline(always)]
fn shift_back<A: Single, S: Shape>(at: &Place<A, S>, v: &mut Wide<A::Quad, S>) {
    use crate::attitude::{EAST, NORTH};
    for q in S::GYRO_QUADS..S::QUADS {
        let of = &S::LAYOUT[q];
        let h = at.h[of.block];
        v[NORTH][q] = h.times_add(at.c[EAST][of.axis], v[NORTH][q]);
        v[EAST][q] = h.times_add(-at.c[NORTH][of.axis], v[EAST][q]);
    }
}

/// A shape whose information is in tiles.
pub(crate) trait WideShape: Shape {
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
wide_shape!(Torquers, Instruments, Catalogue);

impl WideEnd {
    /// From the information in units of the prior σ, V over the columns, and P; none where the
    /// information is not finite.
    fn new<A: Single, S: Shape>(
        mixing: &Mixing,
        information: &[f64],
        v: &Wide<A::Quad, S>,
        p: &Matrix3<f64>,
    ) -> Option<Self> {
        let size = mixing.size();
        let e = DMatrix::from_fn(size, size, |i, j| information[i.min(j) * size + i.max(j)]);
        let considered = mixing.estimated..mixing.estimated + mixing.considered;
        let known: Vec<usize> = (0..size).filter(|i| !considered.contains(i)).collect();
        let considered: Vec<usize> = considered.collect();
        let mut of_known = e.select_rows(&known).select_columns(&known);
        for i in 0..known.len() {
            of_known[(i, i)] += 1.0;
        }
        let claimed = nalgebra::Cholesky::new(of_known)?.inverse();
        let cross = e.select_rows(&known).select_columns(&considered);
        let biased = &claimed * cross;
        let truth = &claimed + &biased * biased.transpose();
        let sigma = DVector::from_fn(known.len(), |i, _| mixing.prior_sigma[known[i]]);
        let of = |m: &DMatrix<f64>| {
            let diagonal = m.diagonal().map(f64::sqrt);
            diagonal.component_mul(&sigma).iter().copied().collect()
        };
        let rows: Vec<Vec<f64>> = (0..3)
            .map(|i| mixing.row(|at| v[i][at / 4].get(at % 4)))
            .collect();
        let v = DMatrix::from_fn(3, known.len(), |i, j| rows[i][known[j]]);
        let through = &v * &claimed * v.transpose();
        Some(Self {
            claimed_sigma: of(&claimed),
            sigma: of(&truth),
            misalignment: p + through.fixed_view::<3, 3>(0, 0),
        })
    }
}

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
            Kind::Torquers => run!(Torquers),
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
    pub fn wide_value(
        &self,
        mixing: &Mixing,
        timeline: &Timeline,
        rule: TickRule,
        mut merit: impl FnMut(&dyn WideCovariance) -> Result<f64>,
    ) -> Result<f64> {
        self.to_wide_end(
            mixing,
            timeline,
            rule,
            How::default(),
            Wanted::Value(&mut merit),
        )
    }

    /// The same with the bits that it has in lanes.
    pub(super) fn wide_value_in_step(
        &self,
        mixing: &Mixing,
        timeline: &Timeline,
        rule: TickRule,
        merit: Merit<'_, f64>,
    ) -> Result<f64> {
        let how = How {
            in_step: true,
            ..How::default()
        };
        self.to_wide_end(mixing, timeline, rule, how, Wanted::Value(merit))
    }

    /// As [`CovarianceModel::gradient`], with the parameters of `mixing`.
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::wide_value`].
    pub fn wide_gradient<T: Into<WideSlope>>(
        &self,
        mixing: &Mixing,
        timeline: &Timeline,
        rule: TickRule,
        mut merit: impl FnMut(&dyn WideCovariance) -> Result<(f64, T)>,
    ) -> Result<(f64, Vec<LegGradient>)> {
        let mut merit = |p: &dyn WideCovariance| {
            let (value, slope) = merit(p)?;
            Ok((value, slope.into()))
        };
        self.wide_gradient_by(mixing, timeline, rule, How::default(), &mut merit)
    }

    fn wide_gradient_by(
        &self,
        mixing: &Mixing,
        timeline: &Timeline,
        rule: TickRule,
        how: How,
        merit: Merit<'_, (f64, WideSlope)>,
    ) -> Result<(f64, Vec<LegGradient>)> {
        let mut out = vec![LegGradient::default(); timeline.legs().len()];
        let wanted = Wanted::Gradient(merit, &mut out);
        let value = self.to_wide_end(mixing, timeline, rule, how, wanted)?;
        Ok((value, out))
    }

    /// What is known of all parameters at the end of `timeline`.
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::wide_value`].
    pub fn wide_end(
        &self,
        mixing: &Mixing,
        timeline: &Timeline,
        rule: TickRule,
    ) -> Result<WideEnd> {
        let mut end = None;
        self.to_wide_end(
            mixing,
            timeline,
            rule,
            How::default(),
            Wanted::End(&mut end),
        )?;
        end.ok_or_else(not_finite)
    }
}
