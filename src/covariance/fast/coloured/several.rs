//! Many schedules at once, each with the bits of its schedule alone.

use pulp::Simd;

use super::course::Wanders;
use super::cuts::Around;
use super::ending::{Back, Ending, Pull, Run};
use super::{Coloured, Size};
use crate::covariance::fast::arithmetic::{
    Alignment, Arithmetic, Lanes, MOST_LANES, Plain, Register,
};
use crate::covariance::fast::course::Legs;
use crate::covariance::fast::dispatch::{LaneTask, run_in_registers};
use crate::covariance::fast::several::gradients::{Answer, LaneGradient, Merit};
use crate::covariance::fast::several::{Batch, Group, Slopes, Value};
use crate::covariance::fast::single::OneTimeline;
use crate::covariance::fast::wide::OfPosterior;
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CoefficientCovariance, CovarianceModel, Slope, TickRule, not_finite};
use crate::error::Result;
use crate::motion::Timeline;

type Lane<S, L> = Register<S, L>;

impl<S: Simd, L: Alignment> Wanders<Lanes<S, L>> for Group<'_, S, L> {
    #[inline(always)]
    fn kernel(&self, leg: usize) -> Option<Vec<Lane<S, L>>> {
        let periods = |t: &OneTimeline<'_, Plain>| match leg < t.count() {
            true => t.periods(leg),
            false => 0,
        };
        let coloured = self.timelines[0].model.coloured.as_deref()?;
        let first = periods(self.lane(0));
        let numbers = coloured.wander.kernel(first);
        let mut out = Vec::with_capacity(numbers.len());
        if self.timelines.iter().all(|t| periods(t) == first) {
            if first == 0 {
                return None;
            }
            for value in numbers.iter() {
                out.push(self.ar.number(*value));
            }
            return Some(out);
        }
        let all: [_; MOST_LANES] =
            std::array::from_fn(|lane| coloured.wander.kernel(periods(self.lane(lane))));
        for i in 0..numbers.len() {
            let mut values = [0.0; MOST_LANES];
            for (value, numbers) in values.iter_mut().zip(&all) {
                *value = numbers[i];
            }
            out.push(Register::gather(self.ar.0, &values));
        }
        Some(out)
    }
    #[inline(always)]
    fn holds(&self, leg: usize) -> Lane<S, L> {
        self.gather(|t| match leg < t.count() {
            true => t.holds(leg),
            false => 0.0,
        })
    }
    #[inline(always)]
    fn panels(&self, leg: usize, index: usize) -> (usize, Lane<S, L>) {
        let of = |t: &OneTimeline<'_, Plain>| match leg < t.count() && index < t.stretches(leg) {
            true => t.panels(leg, index).0,
            false => 0,
        };
        let most = self.timelines.iter().map(of).max().unwrap_or(0);
        (most, self.gather(|t| of(t) as f64))
    }
    #[inline(always)]
    fn turns(&self, leg: usize) -> Lane<S, L> {
        self.gather(|t| match leg < t.count() {
            true => t.turns(leg),
            false => 0.0,
        })
    }
}

/// The chain of every lane, and what it leaves.
fn ending<S: Simd, L: Alignment, const N: usize, const I: usize>(
    group: &Group<'_, S, L>,
    coloured: &Coloured,
    around: Option<&Around>,
    keeps_tape: bool,
) -> Ending<Lanes<S, L>, N, I> {
    let (ar, model) = (group.ar, group.timelines[0].model);
    ar.apart(Run {
        ar,
        model,
        coloured,
        legs: group,
        keeps_tape,
        around,
    })
}

/// The values of a batch.
struct Values<'a, const N: usize, const I: usize> {
    batch: Batch<'a>,
    coloured: &'a Coloured,
    /// Of parts of a test.
    around: Option<&'a Around>,
    merit: Value<'a>,
}

impl<const N: usize, const I: usize> LaneTask for Values<'_, N, I> {
    type Output = Vec<Result<f64>>;
    #[inline(always)]
    fn run<S: Simd, L: Alignment>(self, ar: Lanes<S, L>) -> Vec<Result<f64>> {
        let Self {
            batch,
            coloured,
            around,
            ..
        } = self;
        let columns = &coloured.columns;
        let mut out: Vec<Result<f64>> = Vec::new();
        out.resize_with(batch.timelines.len(), || Err(not_finite()));
        for of in batch.groups(S::F64_LANES) {
            let group = batch.group(ar, &of, true);
            let end = ending::<_, _, N, I>(&group, coloured, around, false);
            for (lane, &i) in of.iter().enumerate() {
                let value = |v: Lane<S, L>| v.lane(lane);
                out[i] = match end.posterior.keeps_digits(value) {
                    true => (self.merit)(&OfPosterior::new(&end.posterior, &columns.order, value)),
                    false => {
                        let timeline = &batch.timelines[i];
                        let merit = &mut |p: &dyn CoefficientCovariance| (self.merit)(p);
                        let rule = batch.rule;
                        (batch.model)
                            .coloured_value_in_step(coloured, timeline, rule, around, merit)
                    }
                };
            }
            end.memory.keep();
        }
        out
    }
}

/// The gradients of a group of timelines, no more than there are lanes.
struct Gradients<'a, const N: usize, const I: usize> {
    batch: Batch<'a>,
    coloured: &'a Coloured,
    of: &'a [usize],
    merit: Merit<'a>,
    out: &'a mut [Answer],
    /// What has to be worked out alone.
    alone: &'a mut Vec<usize>,
}

impl<const N: usize, const I: usize> LaneTask for Gradients<'_, N, I> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd, L: Alignment>(self, ar: Lanes<S, L>) {
        let Self {
            batch, coloured, ..
        } = self;
        let columns = &coloured.columns;
        let group = batch.group(ar, self.of, true);
        let end = ending::<_, _, N, I>(&group, coloured, None, true);
        let mut slopes = Slopes::default();
        for (lane, &i) in self.of.iter().enumerate() {
            let value = |v: Lane<S, L>| v.lane(lane);
            if !end.posterior.keeps_digits(value) {
                self.alone.push(i);
                continue;
            }
            let of = OfPosterior::new(&end.posterior, &columns.order, value);
            self.out[i] = (self.merit)(&of).map(|(value, slope)| {
                slopes.set(lane, &of.pulled(&slope));
                (value, Vec::new())
            });
        }
        let Some(slope) = slopes.gathered(ar) else {
            return end.memory.keep();
        };
        let through = ar.apart(Pull {
            ar,
            columns,
            end: &end,
            slope: &slope,
        });
        let mut gradient = vec![LaneGradient::nothing(ar.number(0.0)); group.count()];
        ar.apart(Back {
            ar,
            model: batch.model,
            coloured,
            legs: &group,
            end: &end,
            through: &through,
            out: &mut gradient,
        });
        for (lane, &i) in self.of.iter().enumerate() {
            if let Ok((_, legs)) = &mut self.out[i] {
                let count = group.timelines[lane].count();
                let of_lane = |g: &LaneGradient<Lane<S, L>>| g.of_lane(lane);
                legs.extend(gradient.iter().take(count).map(of_lane));
            }
        }
        end.memory.keep();
    }
}

impl CovarianceModel {
    /// As [`CovarianceModel::values`], where drift or biases wander.
    ///
    /// # Errors
    ///
    /// Of a timeline: as [`CovarianceModel::coloured_value`].
    pub(in crate::covariance::fast) fn coloured_values(
        &self,
        coloured: &Coloured,
        timelines: &[Timeline],
        rule: TickRule,
        merit: impl Fn(&dyn CoefficientCovariance) -> Result<f64>,
    ) -> Vec<Result<f64>> {
        self.coloured_values_around(coloured, timelines, rule, None, merit)
    }

    /// The same of whole tests, or of parts of one with something `around` them.
    pub(super) fn coloured_values_around(
        &self,
        coloured: &Coloured,
        timelines: &[Timeline],
        rule: TickRule,
        around: Option<&Around>,
        merit: impl Fn(&dyn CoefficientCovariance) -> Result<f64>,
    ) -> Vec<Result<f64>> {
        macro_rules! run {
            ($states:literal, $inputs:literal) => {{
                let values = Values::<$states, $inputs> {
                    batch: self.coloured_batch(coloured, timelines, rule),
                    coloured,
                    around,
                    merit: &merit,
                };
                run_in_registers(self.most_lanes, values).ok()
            }};
        }
        let found = match coloured.wander.size {
            Size::Six => run!(6, 3),
            Size::Nine => run!(9, 3),
            // So many states take as long one by one, and the compiler half a minute more.
            Size::Fifteen => None,
        };
        // Plain numbers need no lanes of their own.
        found.unwrap_or_else(|| {
            let alone = |timeline| {
                self.coloured_value_in_step(coloured, timeline, rule, around, &mut |p| merit(p))
            };
            timelines.iter().map(alone).collect()
        })
    }

    fn coloured_batch<'a>(
        &'a self,
        coloured: &Coloured,
        timelines: &'a [Timeline],
        rule: TickRule,
    ) -> Batch<'a> {
        Batch {
            model: self,
            timelines,
            rule,
            facts: coloured.columns.facts(),
        }
    }

    /// As [`CovarianceModel::gradients`], where drift or biases wander: each has the bits that
    /// [`CovarianceModel::coloured_gradient`] gives it alone.
    ///
    /// # Errors
    ///
    /// Of a timeline: as [`CovarianceModel::coloured_gradient`].
    pub(in crate::covariance::fast) fn coloured_gradients(
        &self,
        coloured: &Coloured,
        timelines: &[Timeline],
        rule: TickRule,
        merit: impl Fn(&dyn CoefficientCovariance) -> Result<(f64, Slope)>,
    ) -> Vec<Result<(f64, Vec<LegGradient>)>> {
        self.gradients_by(
            timelines,
            |of, out, alone| {
                macro_rules! run {
                    ($states:literal, $inputs:literal) => {{
                        let task = Gradients::<$states, $inputs> {
                            batch: self.coloured_batch(coloured, timelines, rule),
                            coloured,
                            of,
                            merit: &merit,
                            out,
                            alone,
                        };
                        // Worth while in several lanes only.
                        let _ = run_in_registers(self.most_lanes, task);
                    }};
                }
                match coloured.wander.size {
                    Size::Six => run!(6, 3),
                    Size::Nine => run!(9, 3),
                    Size::Fifteen => alone.extend_from_slice(of),
                }
            },
            |timeline| self.coloured_gradient(coloured, timeline, rule, &mut |p| merit(p)),
        )
    }
}
