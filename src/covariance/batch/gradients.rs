//! Gradients of many schedules at once, each with the bits of its schedule alone.
//!
//! A search that refines several plans side by side takes its steps from what is found here, and
//! a step that differs by a rounding leads elsewhere in the end. So these lanes do not fuse
//! products and sums, and every lane does the operations of [`single`](super::super::two_stage::single)
//! in its order: what a schedule gives depends neither on the schedules beside it nor on the
//! instruction set. The time is in the tape's memory, not in the arithmetic: fusing would gain
//! nothing.

use pulp::Simd;

use super::{Batch, Covariance, Factorise, Group, covariance_of_lane, is_covariance};
use crate::covariance::gradient::LegGradient;
use crate::covariance::two_stage::course::{self, LegAdjoint, Legs, Tape};
use crate::covariance::two_stage::dispatch::{LaneTask, lanes, run_in_lanes};
use crate::covariance::two_stage::earth::Earth;
use crate::covariance::two_stage::gains::Own;
use crate::covariance::two_stage::information::{
    Factor, PLACES, Rows, complete, symmetric_product,
};
use crate::covariance::two_stage::numbers::{
    Alignment, Arithmetic, Lanes, MOST_LANES, Number, Register, Row, Work,
};
use crate::covariance::two_stage::single::{keep_tape, take_tape};
use crate::covariance::{CovarianceModel, TickRule, not_finite, split_periods};
use crate::drift::{COEFFICIENTS, CoefficientMatrix};
use crate::error::Result;
use crate::motion::Timeline;

/// Derivatives with respect to one leg, per lane.
#[derive(Debug, Clone, Copy)]
struct LaneGradient<N> {
    angles: [N; 3],
    dwell_s: N,
    move_s: N,
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

/// −P G P.
struct InformationAdjoint<'a, S: Simd, L: Alignment, const FUSED: bool>(
    Lanes<S, L, FUSED>,
    &'a Rows<<Lanes<S, L, FUSED> as Arithmetic>::Quad>,
    &'a Slopes,
);

impl<S: Simd, L: Alignment, const FUSED: bool> Work for InformationAdjoint<'_, S, L, FUSED> {
    type Output = Rows<<Lanes<S, L, FUSED> as Arithmetic>::Quad>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        symmetric_product(self.0, self.1, &self.2.pull(self.0, self.1))
    }
}

/// A figure of merit of P_D, (°/h)², with its derivative.
type Merit<'a> = &'a dyn Fn(&CoefficientMatrix) -> Result<(f64, CoefficientMatrix)>;
/// The figure of merit of a timeline with its derivatives, leg by leg.
type Answer = Result<(f64, Vec<LegGradient>)>;

/// The gradients of a group of timelines, no more than there are lanes.
struct Gradients<'a> {
    batch: Batch<'a>,
    of: &'a [usize],
    merit: Merit<'a>,
    out: &'a mut [Answer],
}

impl LaneTask for Gradients<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd, L: Alignment, const FUSED: bool>(mut self, ar: Lanes<S, L, FUSED>) {
        let model = self.batch.model;
        let group = self.batch.group(ar, self.of, true);
        let mut tape = take_tape(true);
        let earth = Earth::new(ar.number(0.0), &model.dynamics, model.drift_psd);
        let mut gains = Own::new(ar, &group, &earth, &model.prior_psi);
        let chain = course::forward(ar, &group, &earth, &mut gains, &mut tape);
        let factor = ar.apart(Factorise(ar, &chain.e, &model.prior_scale));
        let mut p = ar.apart(Covariance(ar, &factor));
        let slopes = self.slopes::<S, L, FUSED>(&factor, &p);
        complete(ar, &mut p);
        let information = ar.apart(InformationAdjoint(ar, &p, &slopes));
        let gradient = backward(&group, &earth, &tape, &information);
        keep_tape(tape);
        for (lane, &i) in self.of.iter().enumerate() {
            if let Ok((_, legs)) = &mut self.out[i] {
                let count = group.timelines[lane].count();
                legs.extend(gradient.iter().take(count).map(|g| LegGradient {
                    angles: [0, 1, 2].map(|a| g.angles[a].lane(lane)),
                    dwell_s: g.dwell_s.lane(lane),
                    move_s: g.move_s.lane(lane),
                }));
            }
        }
    }
}

impl Gradients<'_> {
    /// The figure of merit of every lane, put down, and its derivative with respect to P_D.
    #[inline(always)]
    fn slopes<S: Simd, L: Alignment, const FUSED: bool>(
        &mut self,
        factor: &Factor<Lanes<S, L, FUSED>>,
        p: &Rows<<Lanes<S, L, FUSED> as Arithmetic>::Quad>,
    ) -> Slopes {
        let mut slopes = Slopes::new();
        for (lane, &i) in self.of.iter().enumerate() {
            if !is_covariance(factor, lane) {
                continue;
            }
            self.out[i] = (self.merit)(&covariance_of_lane::<S, L, FUSED>(p, lane)).map(|found| {
                let (value, slope) = found;
                slopes.set(lane, &slope);
                (value, Vec::new())
            });
        }
        slopes
    }
}

/// The derivatives of every lane's figure of merit, leg by leg.
#[inline(always)]
fn backward<S: Simd, L: Alignment, const FUSED: bool>(
    group: &Group<'_, S, L, FUSED>,
    earth: &Earth<Register<S, FUSED, L>>,
    tape: &Tape<Lanes<S, L, FUSED>>,
    information: &Rows<<Lanes<S, L, FUSED> as Arithmetic>::Quad>,
) -> Vec<LaneGradient<Register<S, FUSED, L>>> {
    let ar = group.ar;
    let model = group.timelines[0].model;
    let zero = ar.number(0.0);
    let nothing = LaneGradient {
        angles: [zero; 3],
        dwell_s: zero,
        move_s: zero,
    };
    let mut gradient = vec![nothing; group.legs];
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

/// The derivative of each lane's figure of merit with respect to its P_D, gyro by gyro.
struct Slopes {
    entries: Box<[[[f64; MOST_LANES]; COEFFICIENTS]; COEFFICIENTS]>,
    diagonal: bool,
}

impl Slopes {
    fn new() -> Self {
        Self {
            entries: Box::new([[[0.0; MOST_LANES]; COEFFICIENTS]; COEFFICIENTS]),
            diagonal: true,
        }
    }

    fn set(&mut self, lane: usize, slope: &CoefficientMatrix) {
        for (a, &(i, sign_a)) in PLACES.iter().enumerate() {
            for (b, &(k, sign_b)) in PLACES.iter().enumerate() {
                let entry = sign_a * sign_b * slope[(b, a)];
                self.entries[i][k][lane] = entry;
                self.diagonal &= i == k || entry == 0.0;
            }
        }
    }

    /// −G P, summed up in the order of one schedule alone.
    #[inline(always)]
    fn pull<S: Simd, L: Alignment, const FUSED: bool>(
        &self,
        ar: Lanes<S, L, FUSED>,
        p: &Rows<<Lanes<S, L, FUSED> as Arithmetic>::Quad>,
    ) -> Rows<<Lanes<S, L, FUSED> as Arithmetic>::Quad> {
        let mut out = [[ar.quad([ar.number(0.0); 4]); 3]; COEFFICIENTS];
        for &(i, _) in &PLACES {
            for &(k, _) in &PLACES {
                if self.diagonal && i != k {
                    continue;
                }
                let g = -Register::gather(ar.0, &self.entries[i][k]);
                for q in 0..3 {
                    out[i][q] = p[k][q].times_add(g, out[i][q]);
                }
            }
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
        merit: impl Fn(&CoefficientMatrix) -> Result<(f64, CoefficientMatrix)>,
    ) -> Vec<Result<(f64, Vec<LegGradient>)>> {
        let mut out: Vec<Answer> = Vec::new();
        out.resize_with(timelines.len(), || Err(not_finite()));
        let lanes = lanes(self.most_lanes);
        let (mut together, mut alone): (Vec<usize>, Vec<usize>) =
            (0..timelines.len()).partition(|&i| self.keeps_step(&timelines[i]));
        together.sort_by_key(|&i| timelines[i].legs().len());
        for of in together.chunks(lanes) {
            if !is_worth_while(of.len(), lanes) {
                alone.extend_from_slice(of);
                continue;
            }
            let task = Gradients {
                batch: Batch {
                    model: self,
                    timelines,
                    rule,
                },
                of,
                merit: &merit,
                out: &mut out,
            };
            run_in_lanes::<_, false>(self.most_lanes, task);
        }
        for i in alone {
            out[i] = self.gradient(&timelines[i], rule, &merit);
        }
        out
    }

    /// Whether what a timeline goes through leg by leg is what others do too, so that it can share
    /// a group without a lane doing anything that its schedule alone does not: every position is
    /// held for a whole period at least, and no move is measured.
    fn keeps_step(&self, timeline: &Timeline) -> bool {
        let held = |dwell_s: f64| split_periods(dwell_s, self.period_s).0 > 0;
        timeline.position_legs().iter().all(|leg| held(leg.dwell_s))
            && timeline
                .legs()
                .iter()
                .all(|leg| leg.arrival.is_none_or(|m| !m.measured))
    }
}

/// Whether `count` schedules in so many lanes take less time than one by one.
fn is_worth_while(count: usize, lanes: usize) -> bool {
    lanes >= 4 && 2 * count > lanes
}
