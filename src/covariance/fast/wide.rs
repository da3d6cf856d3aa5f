//! One schedule with all parameters of a platform's error model: as [`super::single`], with more
//! columns.

#[cfg(test)]
mod tests;
mod told;

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector, Matrix3};

use super::arithmetic::{Arithmetic, Row, Single};
use super::course;
use super::dispatch::{self, Task};
use super::gains::{Gains, Own};
use super::mixing::{Kind, Mixing};
use super::posterior::{Posterior, Pulled, root_in_units};
use super::shape::{Catalogue, Facts, Instruments, Shape, Torquers};
use super::single::{OneTimeline, keep_tape, take_tape};
use super::square::mirrored;
use super::tiles::{Tiles, TilesAdjoint};
use super::{Place, Wide};
use crate::covariance::gradient::LegGradient;
use crate::covariance::{
    CoefficientCovariance, CovarianceModel, CovarianceRoot, Slope, TickRule, not_finite,
};
use crate::drift::{CoefficientMatrix, CoefficientVector};
use crate::error::Result;
use crate::motion::Timeline;
use told::{Stacked, told};

/// P_D of one schedule, or of one lane.
pub(crate) struct OfPosterior<'a, N, F> {
    pub matrix: CoefficientMatrix,
    pub posterior: &'a Posterior<N>,
    pub sigma: &'a CoefficientVector,
    pub lane: F,
}

impl<'a, N: super::arithmetic::Number, F: Fn(N) -> f64> OfPosterior<'a, N, F> {
    pub fn new(posterior: &'a Posterior<N>, sigma: &'a CoefficientVector, lane: F) -> Self {
        Self {
            matrix: posterior.matrix(sigma, &lane),
            posterior,
            sigma,
            lane,
        }
    }

    /// The derivative of a figure of merit in units of the prior σ.
    pub fn pulled(&self, slope: &Slope) -> Pulled<f64> {
        match slope {
            Slope::Variances(g) => Pulled::Variances(std::array::from_fn(|i| {
                g[i] * self.sigma[i] * self.sigma[i]
            })),
            Slope::InRoot(k) => self.posterior.pulled_of_root(k, &self.lane),
        }
    }
}

impl<N: super::arithmetic::Number, F: Fn(N) -> f64> CoefficientCovariance
    for OfPosterior<'_, N, F>
{
    fn matrix(&self) -> &CoefficientMatrix {
        &self.matrix
    }
    fn root(&self) -> Cow<'_, CovarianceRoot> {
        Cow::Owned(root_in_units(
            &self.posterior.scaled_root(&self.lane),
            self.sigma,
        ))
    }
}

/// A figure of merit of P_D.
type Merit<'a, T> = &'a mut dyn FnMut(&dyn CoefficientCovariance) -> Result<T>;

/// What is wanted at the end of a timeline.
enum Wanted<'a> {
    Value(Merit<'a, f64>),
    Gradient(Merit<'a, (f64, Slope)>, &'a mut [LegGradient]),
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
        let mut gains = Own::new(ar, &legs, &earth, &model.prior_psi);
        let chain = course::forward::<A, S>(ar, &legs, &earth, &mut gains, &mut tape);
        let tiles = S::numbers(&chain.e);
        let posterior = Posterior::new(0.0, mixing, &tiles);
        let sigma = mixing.coefficient_sigma();
        let of = OfPosterior::new(&posterior, &sigma, |v: f64| v);
        let kept = !self.how.by_rows && posterior.keeps_digits(|v| v);
        let per_s = 1.0 / (model.period_s * model.noise_variance);
        let value = match self.wanted {
            Wanted::Value(merit) if kept => merit(&of),
            Wanted::Value(merit) => {
                // Once more, with the rows kept.
                tape.on = true;
                tape.steps.clear();
                let mut gains = Own::new(ar, &legs, &earth, &model.prior_psi);
                course::forward::<A, S>(ar, &legs, &earth, &mut gains, &mut tape);
                let told = told(ar, &legs, &earth, &tape, mixing);
                Stacked::new(&told, mixing).and_then(|stacked| merit(stacked.covariance()))
            }
            Wanted::Gradient(merit, out) if !kept => {
                let told = told(ar, &legs, &earth, &tape, mixing);
                Stacked::new(&told, mixing).and_then(|stacked| {
                    let (value, slope) = merit(stacked.covariance())?;
                    let information = stacked.times_adjoint::<A, S>(ar, &slope);
                    course::backward(ar, &legs, &earth, &tape.steps, &information, per_s, out);
                    Ok(value)
                })
            }
            Wanted::Gradient(merit, out) => merit(&of).map(|(value, slope)| {
                let of_parameters = posterior.adjoint(&of.pulled(&slope));
                let of_columns = mixing.pulled(0.0, &of_parameters);
                let information = TilesAdjoint::<A, S>::new(ar, &of_columns);
                course::backward(ar, &legs, &earth, &tape.steps, &information, per_s, out);
                value
            }),
            Wanted::End(to) => {
                let mut v = chain.v;
                if let Some(last) = self.timeline.legs().last() {
                    let c = super::attitude_entries(&last.attitude);
                    shift_back::<A, S>(&Place::new(ar, &earth, c), &mut v);
                }
                let p = mirrored(&gains.p());
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
    pub fn wide_gradient(
        &self,
        mixing: &Mixing,
        timeline: &Timeline,
        rule: TickRule,
        mut merit: impl FnMut(&dyn CoefficientCovariance) -> Result<(f64, Slope)>,
    ) -> Result<(f64, Vec<LegGradient>)> {
        let mut out = vec![LegGradient::default(); timeline.legs().len()];
        let wanted = Wanted::Gradient(&mut merit, &mut out);
        let value = self.to_wide_end(mixing, timeline, rule, How::default(), wanted)?;
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
