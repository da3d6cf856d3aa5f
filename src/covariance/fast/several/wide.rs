//! Many schedules at once with all parameters of a platform's error model, each with the bits of
//! its schedule alone.

use std::marker::PhantomData;

use pulp::Simd;

use super::gradients::{Answer, LaneGradient, Merit, backward};
use super::{Batch, Group, Value};
use crate::covariance::fast::arithmetic::{Alignment, Arithmetic, Lanes, MOST_LANES, Register};
use crate::covariance::fast::course::{self, Legs, Tape};
use crate::covariance::fast::dispatch::{LaneTask, run_in_registers};
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::gains::Own;
use crate::covariance::fast::mixing::{Kind, Mixing};
use crate::covariance::fast::posterior::{Posterior, Pulled};
use crate::covariance::fast::shape::{Catalogue, Facts, Instruments};
use crate::covariance::fast::single::{keep_tape, take_tape};
use crate::covariance::fast::wide::{Finish, OfPosterior, Pull, WideShape};
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CoefficientCovariance, CovarianceModel, Slope, TickRule, not_finite};
use crate::error::Result;
use crate::motion::Timeline;

type Lane<S, L> = Register<S, L>;

/// The chain of every lane, and what it leaves of the coefficients.
#[inline(always)]
fn posterior<S: Simd, L: Alignment, C: WideShape>(
    group: &Group<'_, S, L>,
    mixing: &Mixing,
    earth: &Earth<Lane<S, L>>,
    tape: &mut Tape<Lanes<S, L>, C>,
) -> Posterior<Lane<S, L>> {
    let (ar, model) = (group.ar, group.timelines[0].model);
    let mut gains = Own::new(ar, group, earth, &model.prior_psi);
    let chain = course::forward::<_, C>(ar, group, earth, &mut gains, tape);
    let tiles = C::numbers(&chain.e);
    ar.apart(Finish(ar.number(0.0), mixing, &tiles))
}

/// The values of a batch.
struct Values<'a, C> {
    batch: Batch<'a>,
    mixing: &'a Mixing,
    merit: Value<'a>,
    shape: PhantomData<C>,
}

impl<C: WideShape> LaneTask for Values<'_, C> {
    type Output = Vec<Result<f64>>;
    #[inline(always)]
    fn run<S: Simd, L: Alignment>(self, ar: Lanes<S, L>) -> Vec<Result<f64>> {
        let mut out: Vec<Result<f64>> = Vec::new();
        out.resize_with(self.batch.timelines.len(), || Err(not_finite()));
        let mut tape = Tape::<_, C> {
            on: false,
            steps: Vec::new(),
        };
        let model = self.batch.model;
        let earth = Earth::new(
            ar.number(0.0),
            &model.dynamics,
            &model.stand,
            model.drift_psd,
        );
        for of in self.batch.groups(S::F64_LANES) {
            let group = self.batch.group(ar, &of, false);
            let posterior = posterior(&group, self.mixing, &earth, &mut tape);
            for (lane, &i) in of.iter().enumerate() {
                let value = |v: Lane<S, L>| v.lane(lane);
                out[i] = match posterior.keeps_digits(value) {
                    true => (self.merit)(&OfPosterior::new(&posterior, &self.mixing.order, value)),
                    false => {
                        let timeline = &self.batch.timelines[i];
                        model.wide_value(self.mixing, timeline, self.batch.rule, self.merit)
                    }
                };
            }
        }
        out
    }
}

/// The gradients of a group of timelines, no more than there are lanes.
struct Gradients<'a, C> {
    batch: Batch<'a>,
    mixing: &'a Mixing,
    of: &'a [usize],
    merit: Merit<'a>,
    out: &'a mut [Answer],
    /// What has to be worked out alone.
    alone: &'a mut Vec<usize>,
    shape: PhantomData<C>,
}

/// The derivative of each lane's figure of merit: a criterion gives the same form of it for every
/// schedule.
#[derive(Default)]
pub(in crate::covariance::fast) struct Slopes {
    of: Option<(Form, Vec<[f64; MOST_LANES]>)>,
}

/// Of [`Pulled`].
#[derive(Clone, Copy)]
enum Form {
    Variances,
    Covariance,
    Information,
}

impl Slopes {
    pub fn set(&mut self, lane: usize, pulled: &Pulled<f64>) {
        let (form, from) = match pulled {
            Pulled::Variances(from) => (Form::Variances, from),
            Pulled::Covariance(from) => (Form::Covariance, from),
            Pulled::Information(from) => (Form::Information, from),
        };
        let none = || (form, vec![[0.0; MOST_LANES]; from.len()]);
        let (_, to) = self.of.get_or_insert_with(none);
        for (to, from) in to.iter_mut().zip(from) {
            to[lane] = *from;
        }
    }

    /// None where no lane has any.
    pub fn gathered<S: Simd, L: Alignment>(&self, ar: Lanes<S, L>) -> Option<Pulled<Lane<S, L>>> {
        let (form, of) = self.of.as_ref()?;
        let all = of.iter().map(|v| Register::gather(ar.0, v)).collect();
        Some(match form {
            Form::Variances => Pulled::Variances(all),
            Form::Covariance => Pulled::Covariance(all),
            Form::Information => Pulled::Information(all),
        })
    }
}

impl<C: WideShape> LaneTask for Gradients<'_, C> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd, L: Alignment>(self, ar: Lanes<S, L>) {
        let model = self.batch.model;
        let group = self.batch.group(ar, self.of, true);
        let mut tape = take_tape::<_, C>(true);
        let earth = Earth::new(
            ar.number(0.0),
            &model.dynamics,
            &model.stand,
            model.drift_psd,
        );
        let posterior = posterior(&group, self.mixing, &earth, &mut tape);
        let mut slopes = Slopes::default();
        for (lane, &i) in self.of.iter().enumerate() {
            let value = |v: Lane<S, L>| v.lane(lane);
            if !posterior.keeps_digits(value) {
                self.alone.push(i);
                continue;
            }
            let of = OfPosterior::new(&posterior, &self.mixing.order, value);
            self.out[i] = (self.merit)(&of).map(|(value, slope)| {
                slopes.set(lane, &of.pulled(&slope));
                (value, Vec::new())
            });
        }
        let Some(slope) = slopes.gathered(ar) else {
            return keep_tape(tape);
        };
        let information = ar.apart(Pull::<_, C>::new(ar, self.mixing, &posterior, &slope));
        let gradient = backward(&group, &earth, &tape, &information);
        keep_tape(tape);
        for (lane, &i) in self.of.iter().enumerate() {
            if let Ok((_, legs)) = &mut self.out[i] {
                let count = group.timelines[lane].count();
                let of_lane = |g: &LaneGradient<Lane<S, L>>| g.of_lane(lane);
                legs.extend(gradient.iter().take(count).map(of_lane));
            }
        }
    }
}

impl CovarianceModel {
    /// As [`CovarianceModel::values`], with the parameters of `mixing`.
    ///
    /// # Errors
    ///
    /// Of a timeline: as [`CovarianceModel::wide_value`].
    pub(in crate::covariance::fast) fn wide_values(
        &self,
        mixing: &Mixing,
        timelines: &[Timeline],
        rule: TickRule,
        merit: impl Fn(&dyn CoefficientCovariance) -> Result<f64>,
    ) -> Vec<Result<f64>> {
        macro_rules! run {
            ($shape:ty) => {{
                let values = Values::<$shape> {
                    batch: Batch {
                        model: self,
                        timelines,
                        rule,
                        facts: Facts::of::<$shape>(),
                    },
                    mixing,
                    merit: &merit,
                    shape: PhantomData,
                };
                // Plain numbers need no lanes of their own.
                run_in_registers(self.most_lanes, values).unwrap_or_else(|values| {
                    let alone =
                        |timeline| self.wide_value(mixing, timeline, rule, |p| (values.merit)(p));
                    timelines.iter().map(alone).collect()
                })
            }};
        }
        match mixing.kind {
            Kind::Instruments => run!(Instruments),
            Kind::Catalogue => run!(Catalogue),
        }
    }

    /// As [`CovarianceModel::gradients`], with the parameters of `mixing`: each has the bits that
    /// [`CovarianceModel::wide_gradient`] gives it alone.
    ///
    /// # Errors
    ///
    /// Of a timeline: as [`CovarianceModel::wide_gradient`].
    pub(in crate::covariance::fast) fn wide_gradients(
        &self,
        mixing: &Mixing,
        timelines: &[Timeline],
        rule: TickRule,
        merit: impl Fn(&dyn CoefficientCovariance) -> Result<(f64, Slope)>,
    ) -> Vec<Result<(f64, Vec<LegGradient>)>> {
        self.gradients_by(
            timelines,
            |of, out, alone| {
                macro_rules! run {
                    ($shape:ty) => {{
                        let task = Gradients::<$shape> {
                            batch: Batch {
                                model: self,
                                timelines,
                                rule,
                                facts: Facts::of::<$shape>(),
                            },
                            mixing,
                            of,
                            merit: &merit,
                            out,
                            alone,
                            shape: PhantomData,
                        };
                        // Worth while in several lanes only.
                        let _ = run_in_registers(self.most_lanes, task);
                    }};
                }
                match mixing.kind {
                    Kind::Instruments => run!(Instruments),
                    Kind::Catalogue => run!(Catalogue),
                }
            },
            |timeline| self.wide_gradient(mixing, timeline, rule, &merit),
        )
    }
}
