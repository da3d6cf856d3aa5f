//! One schedule.

use super::columns::packed;
use super::course::Wanders;
use super::cuts::Around;
use super::ending::{Back, Ending, Pull, Run};
use super::{Coloured, Columns, by_size};
use crate::covariance::fast::arithmetic::Single;
use crate::covariance::fast::dispatch::{self, Task};
use crate::covariance::fast::single::{Merit, OneTimeline, Wanted};
use crate::covariance::fast::wide::{How, OfPosterior, Stacked, Told};
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CovarianceModel, Slope, TickRule};
use crate::error::Result;
use crate::motion::Timeline;

impl<A: Single> Wanders<A> for OneTimeline<'_, A> {
    #[inline(always)]
    fn kernel(&self, leg: usize) -> Option<Vec<f64>> {
        let periods = self.periods(leg);
        let coloured = self.model.coloured.as_deref()?;
        (periods > 0).then(|| coloured.wander.kernel(periods).into_owned())
    }
    #[inline(always)]
    fn holds(&self, leg: usize) -> f64 {
        self.periods(leg) as f64
    }
    #[inline(always)]
    fn panels(&self, leg: usize, index: usize) -> (usize, f64) {
        let (Some(m), Some(coloured)) = (self.slew(leg), self.model.coloured.as_deref()) else {
            return (0, 0.0);
        };
        if m.duration_s <= 0.0 {
            return (0, 0.0);
        }
        let count = coloured.wander.panels(m, self.part(m, index).0);
        (count, count as f64)
    }
    #[inline(always)]
    fn turns(&self, leg: usize) -> f64 {
        let arrival = self.timeline.legs()[leg].arrival;
        f64::from(u8::from(arrival.is_some_and(|m| m.change != [0.0; 3])))
    }
}

/// The end of a timeline, and what is wanted of it.
struct ToEnd<'a, const S: usize, const I: usize> {
    model: &'a CovarianceModel,
    coloured: &'a Coloured,
    timeline: &'a Timeline,
    rule: TickRule,
    wanted: Wanted<'a>,
    how: How,
    /// Of a part of a test.
    around: Option<&'a Around>,
}

impl<const S: usize, const I: usize> Task for ToEnd<'_, S, I> {
    type Output = Result<f64>;
    #[inline(always)]
    fn run<A: Single>(self, ar: A) -> Result<f64> {
        let Self {
            model, coloured, ..
        } = self;
        let columns = &coloured.columns;
        let keeps_tape = matches!(self.wanted, Wanted::Gradient(..));
        let legs = OneTimeline {
            ar,
            model,
            timeline: self.timeline,
            rule: self.rule,
            keep_empty: keeps_tape || self.how.in_step,
            facts: columns.facts(),
        };
        let end: Ending<A, S, I> = ar.always_apart(Run {
            ar,
            model,
            coloured,
            legs: &legs,
            keeps_tape,
            around: self.around,
        });
        let kept = !self.how.by_rows && end.posterior.keeps_digits(|v| v);
        let of = OfPosterior::new(&end.posterior, &columns.order, |v: f64| v);
        let value = match self.wanted {
            Wanted::Value(merit) if kept => merit(&of)?,
            Wanted::Value(merit) => merit(&stacked(&end, columns, self.around)?)?,
            Wanted::Gradient(merit, out) => {
                let (value, through) = if kept {
                    let (value, slope) = merit(&of)?;
                    let pull = Pull {
                        ar,
                        columns,
                        end: &end,
                        slope: &of.pulled(&slope),
                    };
                    (value, ar.always_apart(pull))
                } else {
                    let stacked = stacked(&end, columns, self.around)?;
                    let (value, slope) = merit(&stacked)?;
                    (value, rows(ar, columns, &stacked.times_adjoint(&slope)))
                };
                ar.always_apart(Back {
                    ar,
                    model,
                    coloured,
                    legs: &legs,
                    end: &end,
                    through: &through,
                    out,
                });
                value
            }
        };
        end.memory.keep();
        Ok(value)
    }
}

/// The rows that the chain has told, triangularised.
fn stacked<'a, A: Single, const S: usize, const I: usize>(
    end: &Ending<A, S, I>,
    columns: &'a Columns,
    around: Option<&Around>,
) -> Result<Stacked<'a>> {
    let more = around.into_iter().flat_map(|around| around.rows(columns));
    let told = end.rows(columns).chain(more).map(|(row, weight)| Told {
        row,
        scale: weight.sqrt(),
    });
    Stacked::new(&told.collect::<Vec<_>>(), &columns.order)
}

/// Rows over the parameters in the chain's own numbers.
#[inline(always)]
fn rows<A: Single>(ar: A, columns: &Columns, of: &[Vec<f64>]) -> Vec<A::Quad> {
    let mut all = vec![0.0; 4 * columns.width * of.len()];
    for (to, from) in all.chunks_exact_mut(4 * columns.width).zip(of) {
        to[..from.len()].copy_from_slice(from);
    }
    packed(ar, &all)
}

impl CovarianceModel {
    fn to_coloured_end<'a>(
        &'a self,
        coloured: &'a Coloured,
        timeline: &'a Timeline,
        rule: TickRule,
        how: How,
        wanted: Wanted<'a>,
        around: Option<&'a Around>,
    ) -> Result<f64> {
        macro_rules! run {
            ($states:literal, $inputs:literal) => {
                dispatch::run(ToEnd::<$states, $inputs> {
                    model: self,
                    coloured,
                    timeline,
                    rule,
                    wanted,
                    how,
                    around,
                })
            };
        }
        by_size!(coloured.wander.size, run)
    }

    /// As [`CovarianceModel::value`], where drift or biases wander.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows; what
    /// `merit` returns.
    pub(in crate::covariance::fast) fn coloured_value(
        &self,
        coloured: &Coloured,
        timeline: &Timeline,
        rule: TickRule,
        merit: Merit<'_, f64>,
    ) -> Result<f64> {
        let how = How::default();
        self.to_coloured_end(coloured, timeline, rule, how, Wanted::Value(merit), None)
    }

    /// The same with the bits that it has in lanes, of a whole test or of a part.
    pub(super) fn coloured_value_in_step(
        &self,
        coloured: &Coloured,
        timeline: &Timeline,
        rule: TickRule,
        around: Option<&Around>,
        merit: Merit<'_, f64>,
    ) -> Result<f64> {
        let how = How {
            in_step: true,
            ..How::default()
        };
        let wanted = Wanted::Value(merit);
        self.to_coloured_end(coloured, timeline, rule, how, wanted, around)
    }

    /// As [`CovarianceModel::gradient`], where drift or biases wander.
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::coloured_value`].
    pub(in crate::covariance::fast) fn coloured_gradient(
        &self,
        coloured: &Coloured,
        timeline: &Timeline,
        rule: TickRule,
        merit: Merit<'_, (f64, Slope)>,
    ) -> Result<(f64, Vec<LegGradient>)> {
        self.coloured_gradient_by(coloured, timeline, rule, How::default(), merit)
    }

    pub(super) fn coloured_gradient_by(
        &self,
        coloured: &Coloured,
        timeline: &Timeline,
        rule: TickRule,
        how: How,
        merit: Merit<'_, (f64, Slope)>,
    ) -> Result<(f64, Vec<LegGradient>)> {
        let mut out = vec![LegGradient::default(); timeline.legs().len()];
        let wanted = Wanted::Gradient(merit, &mut out);
        let value = self.to_coloured_end(coloured, timeline, rule, how, wanted, None)?;
        Ok((value, out))
    }

    #[cfg(test)]
    pub(super) fn coloured_value_by(
        &self,
        coloured: &Coloured,
        timeline: &Timeline,
        rule: TickRule,
        how: How,
        merit: Merit<'_, f64>,
    ) -> Result<f64> {
        self.to_coloured_end(coloured, timeline, rule, how, Wanted::Value(merit), None)
    }
    #[cfg(test)]
    pub(super) fn coloured_value_of_part(
        &self,
        coloured: &Coloured,
        (part, around): (&Timeline, &Around),
        rule: TickRule,
        how: How,
        merit: Merit<'_, f64>,
    ) -> Result<f64> {
        let wanted = Wanted::Value(merit);
        self.to_coloured_end(coloured, part, rule, how, wanted, Some(around))
    }
}
