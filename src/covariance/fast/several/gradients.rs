//! Gradients of many schedules at once, each with the bits of its schedule alone.
//!
//! A search that refines several plans side by side takes its steps from what is found here, and
//! a step that differs by a rounding leads elsewhere in the end. The time is in the tape's memory,
//! not in the arithmetic.

use pulp::Simd;

use super::{Batch, Covariance, Factorise, Group, OfLane, keeps_digits_in};
use crate::covariance::fast::adjoint;
use crate::covariance::fast::arithmetic::{
    Alignment, Arithmetic, Lanes, MOST_LANES, Number, Register, Row, Work, four, three,
};
use crate::covariance::fast::course::{self, LegAdjoint, Legs, Tape};
use crate::covariance::fast::dispatch::{LaneTask, lanes, run_in_lanes};
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::gains::Own;
use crate::covariance::fast::information::{
    Factor, PLACES, Rows, by_gyros, complete, symmetric_product,
};
use crate::covariance::fast::shape::{Drift, Facts, Shape};
use crate::covariance::fast::single::{keep_tape, take_tape};
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CoefficientCovariance, CovarianceModel, Slope, TickRule, not_finite};
use crate::drift::COEFFICIENTS;
use crate::error::Result;
use crate::motion::Timeline;

/// Derivatives with respect to one leg, per lane.
#[derive(Debug, Clone, Copy)]
pub(in crate::covariance::fast) struct LaneGradient<N> {
    angles: [N; 3],
    dwell_s: N,
    move_s: N,
}

impl<N: Number> LaneGradient<N> {
    /// None of it.
    pub fn nothing(zero: N) -> Self {
        Self {
            angles: [zero; 3],
            dwell_s: zero,
            move_s: zero,
        }
    }
}

impl<S: Simd, L: Alignment> LaneGradient<Register<S, L>> {
    /// Of one lane.
    #[inline(always)]
    pub fn of_lane(&self, lane: usize) -> LegGradient {
        LegGradient {
            angles: [0, 1, 2].map(|a| self.angles[a].lane(lane)),
            dwell_s: self.dwell_s.lane(lane),
            move_s: self.move_s.lane(lane),
        }
    }
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

/// Ē = −P G P.
struct InformationAdjoint<'a, S: Simd, L: Alignment>(
    Lanes<S, L>,
    &'a Rows<<Lanes<S, L> as Arithmetic>::Quad>,
    &'a Slopes,
);

impl<S: Simd, L: Alignment> Work for InformationAdjoint<'_, S, L> {
    type Output = Rows<<Lanes<S, L> as Arithmetic>::Quad>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self(ar, p, slopes) = self;
        match &slopes.of_information {
            None => symmetric_product(ar, p, &slopes.pull(ar, p)),
            Some(of_information) => gathered(ar, of_information),
        }
    }
}

/// One matrix per lane.
#[inline(always)]
fn gathered<S: Simd, L: Alignment>(
    ar: Lanes<S, L>,
    of: &[[[f64; MOST_LANES]; COEFFICIENTS]; COEFFICIENTS],
) -> Rows<<Lanes<S, L> as Arithmetic>::Quad> {
    let mut rows = [[ar.quad([ar.number(0.0); 4]); 3]; COEFFICIENTS];
    for i in 0..COEFFICIENTS {
        for k in 0..3 {
            rows[i][k] = ar.quad(four!(|f| Register::gather(ar.0, &of[i][4 * k + f])));
        }
    }
    rows
}

/// A figure of merit of P_D with its derivative.
pub(in crate::covariance::fast) type Merit<'a> =
    &'a dyn Fn(&dyn CoefficientCovariance) -> Result<(f64, Slope)>;
/// The figure of merit of a timeline with its derivatives, leg by leg.
pub(in crate::covariance::fast) type Answer = Result<(f64, Vec<LegGradient>)>;

/// The gradients of a group of timelines, no more than there are lanes. What has to be worked out
/// alone is put down in `alone`.
struct Gradients<'a> {
    batch: Batch<'a>,
    of: &'a [usize],
    merit: Merit<'a>,
    out: &'a mut [Answer],
    alone: &'a mut Vec<usize>,
}

impl LaneTask for Gradients<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd, L: Alignment>(mut self, ar: Lanes<S, L>) {
        let model = self.batch.model;
        let group = self.batch.group(ar, self.of, true);
        let mut tape = take_tape(true);
        let earth = Earth::new(
            ar.number(0.0),
            &model.dynamics,
            &model.stand,
            model.drift_psd,
        );
        let mut gains = Own::new(ar, &group, &earth, &model.prior_psi);
        let chain = course::forward::<_, Drift>(ar, &group, &earth, &mut gains, &mut tape);
        let factor = ar.apart(Factorise(ar, &chain.e, &model.prior_scale));
        let mut p = ar.apart(Covariance(ar, &factor));
        let slopes = self.slopes::<S, L>(&factor, &p);
        complete(ar, &mut p);
        let information = ar.apart(InformationAdjoint(ar, &p, &slopes));
        let gradient = backward(&group, &earth, &tape, &information);
        keep_tape(tape);
        for (lane, &i) in self.of.iter().enumerate() {
            if let Ok((_, legs)) = &mut self.out[i] {
                let count = group.timelines[lane].count();
                legs.extend(gradient.iter().take(count).map(|g| g.of_lane(lane)));
            }
        }
    }
}

impl Gradients<'_> {
    /// The figure of merit of every lane, put down, and its derivative with respect to P_D.
    #[inline(always)]
    fn slopes<S: Simd, L: Alignment>(
        &mut self,
        factor: &Factor<Lanes<S, L>>,
        p: &Rows<<Lanes<S, L> as Arithmetic>::Quad>,
    ) -> Slopes {
        let mut slopes = Slopes::default();
        for (lane, &i) in self.of.iter().enumerate() {
            if !keeps_digits_in(factor, lane) {
                self.alone.push(i);
                continue;
            }
            let of = OfLane::known(p, factor, lane);
            self.out[i] = (self.merit)(&of).map(|(value, slope)| {
                slopes.set(lane, &slope, &of);
                (value, Vec::new())
            });
        }
        slopes
    }
}

/// The derivatives of every lane's figure of merit, leg by leg.
#[inline(always)]
pub(super) fn backward<S: Simd, L: Alignment, C: Shape>(
    group: &Group<'_, S, L>,
    earth: &Earth<Register<S, L>>,
    tape: &Tape<Lanes<S, L>, C>,
    information: &impl adjoint::InformationAdjoint<Lanes<S, L>, C>,
) -> Vec<LaneGradient<Register<S, L>>> {
    let ar = group.ar;
    let model = group.timelines[0].model;
    let zero = ar.number(0.0);
    let mut gradient = vec![LaneGradient::nothing(zero); group.legs];
    let per_s = 1.0 / (model.period_s * model.noise_variance);
    course::backward(
        ar,
        group,
        earth,
        &tape.steps,
        information,
        per_s,
        &mut gradient,
    );
    gradient
}

/// The derivative of each lane's figure of merit, gyro by gyro. A criterion gives the same form of
/// it for every schedule.
#[derive(Default)]
struct Slopes {
    /// With respect to the variances.
    variances: [[f64; MOST_LANES]; COEFFICIENTS],
    /// With respect to the information, where it is not known by the variances alone.
    of_information: Option<Box<[[[f64; MOST_LANES]; COEFFICIENTS]; COEFFICIENTS]>>,
}

impl Slopes {
    fn set(&mut self, lane: usize, slope: &Slope, of: &dyn CoefficientCovariance) {
        match slope {
            Slope::Variances(g) => {
                for (c, &(i, _)) in PLACES.iter().enumerate() {
                    self.variances[i][lane] = g[c];
                }
            }
            _ => {
                let none = || Box::new([[[0.0; MOST_LANES]; COEFFICIENTS]; COEFFICIENTS]);
                let entries = self.of_information.get_or_insert_with(none);
                let rows = by_gyros(&slope.of_information(of));
                for (to, from) in entries.iter_mut().zip(&rows) {
                    for (to, from) in to.iter_mut().zip(from.as_flattened()) {
                        to[lane] = *from;
                    }
                }
            }
        }
    }

    /// −G P, in the operations of one schedule alone.
    #[inline(always)]
    fn pull<S: Simd, L: Alignment>(
        &self,
        ar: Lanes<S, L>,
        p: &Rows<<Lanes<S, L> as Arithmetic>::Quad>,
    ) -> Rows<<Lanes<S, L> as Arithmetic>::Quad> {
        let mut out = [[ar.quad([ar.number(0.0); 4]); 3]; COEFFICIENTS];
        for i in 0..COEFFICIENTS {
            let g = -Register::gather(ar.0, &self.variances[i]);
            out[i] = three!(|q| p[i][q].times(g));
        }
        out
    }
}

impl CovarianceModel {
    /// Value and gradient of a figure of merit of every timeline, several at once; `merit` as in
    /// [`CovarianceModel::gradient`].
    ///
    /// Each has the bits that [`CovarianceModel::gradient`] gives it alone.
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::values`].
    pub fn gradients(
        &self,
        timelines: &[Timeline],
        rule: TickRule,
        merit: impl Fn(&dyn CoefficientCovariance) -> Result<(f64, Slope)>,
    ) -> Vec<Result<(f64, Vec<LegGradient>)>> {
        if let Some(coloured) = &self.coloured {
            return self.coloured_gradients(coloured, timelines, rule, merit);
        }
        if let Some(mixing) = &self.mixing {
            return self.wide_gradients(mixing, timelines, rule, merit);
        }
        self.gradients_by(
            timelines,
            |of, out, alone| {
                let task = Gradients {
                    batch: Batch {
                        model: self,
                        timelines,
                        rule,
                        facts: Facts::of::<Drift>(),
                    },
                    of,
                    merit: &merit,
                    out,
                    alone,
                };
                run_in_lanes(self.most_lanes, task);
            },
            |timeline| self.gradient(timeline, rule, &merit),
        )
    }

    /// The answers of every timeline: of those that can share a group by `together`, which is given a group
    /// and leaves to the last what it cannot answer, of the others by `single`.
    pub(in crate::covariance::fast) fn gradients_by(
        &self,
        timelines: &[Timeline],
        mut together: impl FnMut(&[usize], &mut [Answer], &mut Vec<usize>),
        single: impl Fn(&Timeline) -> Answer,
    ) -> Vec<Answer> {
        let mut out: Vec<Answer> = Vec::new();
        out.resize_with(timelines.len(), || Err(not_finite()));
        let lanes = lanes(self.most_lanes);
        let (in_step, mut alone) = self.in_step(timelines);
        for of in in_step.chunks(lanes) {
            match is_worth_while(of.len(), lanes) {
                true => together(of, &mut out, &mut alone),
                false => alone.extend_from_slice(of),
            }
        }
        for i in alone {
            out[i] = single(&timelines[i]);
        }
        out
    }
}

/// Whether `count` schedules in so many lanes take less time than one by one.
fn is_worth_while(count: usize, lanes: usize) -> bool {
    lanes >= 4 && 2 * count > lanes
}
