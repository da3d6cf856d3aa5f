//! Many attitudes in the same dwells.
//!
//! Where moves take no time, P and all the matrices of the [`chain`](super::chain) depend on the
//! durations alone. For durations that are kept while attitudes change, as when starts of a search
//! are drawn or a schedule is compared with its rivals, they are worked out once, and brought into
//! the form that leaves least to do per schedule. What a leg tells are rows of unit noise over
//! (ψ^n, ε^n) at its start; triangularised they are at most
//!
//! ```text
//! X = Y V + Z A,   W = Q A,   E += XᵀX + WᵀW,   V ← M V + N A,
//! ```
//!
//! with Q triangular. Nothing else of V is ever seen, so V may be kept in any basis: with the
//! orthogonal T_k for which M_k = T_{k+1} M T_kᵀ is triangular, from T_0 = I on, and the rows of X
//! turned such that Y_k is, both products take half of what they took.

mod run;

use nalgebra::{Matrix3, SMatrix};

use super::two_stage::dispatch::{self, LaneTask, Task, run_in_lanes};
use super::two_stage::earth::Passed;
use super::two_stage::gains::{Gain, Gains, Own, Seen};
use super::two_stage::information::PriorScale;
use super::two_stage::numbers::{Alignment, Arithmetic, Lanes, Plain, Single};
use super::two_stage::single::OneTimeline;
use super::two_stage::square::{Entries, Square, entries};
use super::{CovarianceModel, TickRule, not_finite};
use crate::attitude::Attitude;
use crate::covariance::two_stage::course::Legs;
use crate::drift::{COEFFICIENTS, CoefficientVector};
use crate::error::{Error, Result};
use crate::motion::Timeline;
use run::{Leg, Places, Run};

/// The prior information of a coefficient that is known, (°/h)⁻²: what it does to the others is
/// far below rounding, and its inverse is still a number.
const KNOWN: f64 = 1e300;

/// The durations of a schedule's dwells, with all that depends on them alone.
///
/// ```
/// use scheme_opt::internals::attitude::Attitude;
/// use scheme_opt::internals::covariance::{CovarianceModel, TickRule};
/// use scheme_opt::internals::drift::CoefficientVector;
/// use scheme_opt::internals::motion::Timeline;
/// use scheme_opt::internals::platform::PlatformConfig;
/// use scheme_opt::internals::schedule::standard::StandardScheme;
///
/// let platform = PlatformConfig::default().check()?;
/// let model = CovarianceModel::new(&platform);
/// let timeline = Timeline::new(&platform, &StandardScheme::Edges12.schedule(12_000.0, &platform)?)?;
/// let dwells = model.dwell_sequence(&timeline, TickRule::Filter).unwrap();
///
/// let attitudes: Vec<Attitude> = timeline.position_legs().iter().map(|leg| leg.attitude).collect();
/// let trace = dwells.weighted_trace(&attitudes, &CoefficientVector::repeat(1.0))?;
/// let same = model.end_covariance(&timeline, TickRule::Filter)?.coefficients.trace();
/// assert!((trace / same - 1.0).abs() < 1e-9);
/// # Ok::<(), scheme_opt::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct DwellSequence {
    legs: Vec<Leg>,
    /// Prior information, (°/h)⁻², gyro by gyro.
    prior_information: [f64; COEFFICIENTS],
    most_lanes: usize,
}

impl CovarianceModel {
    /// The dwells of `timeline`, for evaluating other attitudes in them. None where more than the
    /// dwells depends on the attitudes: moves that take time, changes of position in frame-hold
    /// repositioning.
    pub fn dwell_sequence(&self, timeline: &Timeline, rule: TickRule) -> Option<DwellSequence> {
        let all = timeline.legs();
        let held = timeline.positions();
        let mut elsewhere = all[..held.start].iter().chain(&all[held.end..]);
        let moves = |leg: &crate::motion::Leg| leg.arrival.is_some_and(|m| m.duration_s > 0.0);
        if self.frame_hold || all.iter().any(moves) || elsewhere.any(|l| l.duration_s() > 0.0) {
            return None;
        }
        let legs = OneTimeline {
            ar: Plain,
            model: self,
            timeline,
            rule,
            keep_empty: false,
        };
        let earth = self.earth();
        let mut gains = Own::new(Plain, &legs, &earth, &self.prior_psi);
        let mut basis = Matrix3::identity();
        let legs = held.map(|leg| {
            let (made, next) = Told::of(&legs, leg, &mut gains).into_leg(&basis);
            basis = next;
            made
        });
        Some(DwellSequence {
            legs: legs.collect(),
            prior_information: self.prior_scale.0.map(|s| (1.0 / (s * s)).min(KNOWN)),
            most_lanes: self.most_lanes,
        })
    }
}

/// Most rows that a leg tells: of its whole periods three with ψ^n and three without, of the rest
/// two.
const ROWS: usize = 8;

/// What a leg tells of (ψ^n, ε^n) at its start, and where it leads.
struct Told {
    rows: SMatrix<f64, ROWS, 6>,
    count: usize,
    /// ψ^n at its end from ψ^n and ε^n at its start.
    psi: Matrix3<f64>,
    epsilon: Matrix3<f64>,
}

fn matrix(of: &Square<<Plain as Arithmetic>::Triple>) -> Matrix3<f64> {
    let e = entries(of);
    Matrix3::from_fn(|i, j| e[i][j])
}

impl Told {
    /// Of the settling, the dwell and its rest.
    fn of<L: Legs<Plain>>(legs: &L, leg: usize, gains: &mut Own<'_, Plain, L>) -> Self {
        let mut told = Self {
            rows: SMatrix::zeros(),
            count: 0,
            psi: Matrix3::identity(),
            epsilon: Matrix3::zeros(),
        };
        if legs.settles(leg) {
            told.pass(&gains.settle(leg));
        }
        if let Some(gain) = gains.dwell(leg) {
            told.dwell(&gain);
        }
        if legs.remains(leg) {
            let (passed, _, seen) = gains.remainder(leg);
            told.pass(&passed);
            if let Some(seen) = seen {
                told.measure(&seen);
            }
        }
        told
    }

    fn advance(&mut self, psi: &Matrix3<f64>, epsilon: &Matrix3<f64>) {
        self.epsilon = psi * self.epsilon + epsilon;
        self.psi = psi * self.psi;
    }

    fn pass(&mut self, passed: &Passed<Plain>) {
        let full = |m: &Entries<f64>| Matrix3::from_fn(|i, j| m[i][j]);
        self.advance(&full(&passed.phi), &full(&passed.gamma));
    }

    /// Three rows over (ψ^n, ε^n) as they are now.
    fn add(&mut self, psi: &Matrix3<f64>, epsilon: &Matrix3<f64>) {
        let (p, e) = (psi * self.psi, psi * self.epsilon + epsilon);
        self.rows
            .fixed_view_mut::<3, 3>(self.count, 0)
            .copy_from(&p);
        self.rows
            .fixed_view_mut::<3, 3>(self.count, 3)
            .copy_from(&e);
        self.count += 3;
    }

    fn dwell(&mut self, gain: &Gain<Plain>) {
        self.add(&matrix(&gain.y), &matrix(&gain.z));
        self.add(&Matrix3::zeros(), &matrix(&gain.r22));
        self.advance(&matrix(&gain.m), &matrix(&gain.n));
    }

    /// ψ_x and ψ_z, whitened, and what the measurement makes of ψ^n.
    fn measure(&mut self, seen: &Seen<Plain>) {
        let (psi, epsilon) = (self.psi, self.epsilon);
        let scale = seen.d.map(|d| (seen.weight * d).sqrt());
        let mut put = |of: &Matrix3<f64>, to: usize| {
            let first = of.row(0) * scale[0];
            let second = (of.row(2) - of.row(0) * seen.l) * scale[1];
            let mut rows = self.rows.fixed_view_mut::<2, 3>(self.count, to);
            rows.row_mut(0).copy_from(&first);
            rows.row_mut(1).copy_from(&second);
        };
        put(&psi, 0);
        put(&epsilon, 3);
        self.count += 2;
        let gain = |i: usize, j: usize| {
            if j == 1 {
                0.0
            } else {
                seen.weight * seen.p[i][j]
            }
        };
        let keep = Matrix3::identity() - Matrix3::from_fn(gain);
        self.advance(&keep, &Matrix3::zeros());
    }

    /// In triangular form for V in `basis`; returns the basis of V after it.
    fn into_leg(mut self, basis: &Matrix3<f64>) -> (Leg, Matrix3<f64>) {
        let back = basis.transpose();
        let turned = self.rows.fixed_view::<ROWS, 3>(0, 0) * back;
        self.rows.fixed_view_mut::<ROWS, 3>(0, 0).copy_from(&turned);
        let r = self.rows.qr().r();
        let next = (self.psi * back).qr();
        let basis = next.q().transpose();
        let square = |i: usize, j: usize| r.fixed_view::<3, 3>(i, j).into_owned();
        let leg = Leg::new(
            &square(0, 0),
            &square(0, 3),
            &square(3, 3),
            &next.r(),
            &(basis * self.epsilon),
        );
        (leg, basis)
    }
}

impl DwellSequence {
    /// How many dwells there are.
    pub fn count(&self) -> usize {
        self.legs.len()
    }

    /// tr(W P_D), (°/h)², W diagonal with `weights`, with one attitude per dwell.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] for another number of attitudes than dwells; [`Error::is_numerical`]
    /// when the information overflows.
    pub fn weighted_trace(
        &self,
        attitudes: &[Attitude],
        weights: &CoefficientVector,
    ) -> Result<f64> {
        self.check(attitudes)?;
        let weights = self.weights(weights);
        let one = One {
            dwells: self,
            attitudes,
            weights: &weights,
        };
        checked(dispatch::run::<_, true>(one))
    }

    /// The same for several schedules at once, one per lane of the machine's registers.
    ///
    /// A value agrees with that of the schedule alone to rounding, and does not depend on the
    /// others or on threads.
    pub fn weighted_traces(
        &self,
        schedules: &[&[Attitude]],
        weights: &CoefficientVector,
    ) -> Vec<Result<f64>> {
        let fits = |a: &&[Attitude]| a.len() == self.count();
        let mut out = vec![[f64::NAN; 2]; schedules.len()];
        if schedules.iter().all(fits) {
            let several = Several {
                dwells: self,
                schedules,
                weights: &self.weights(weights),
                out: &mut out,
            };
            run_in_lanes::<_, true>(self.most_lanes, several);
            return out.into_iter().map(checked).collect();
        }
        let alone = |a: &&[Attitude]| self.weighted_trace(a, weights);
        schedules.iter().map(alone).collect()
    }

    /// tr P_D and the smallest pivot in any numbers.
    #[cfg(test)]
    pub(super) fn trace_in<A: Arithmetic>(&self, ar: A, attitudes: &[Attitude]) -> [A::Number; 2] {
        let one = One {
            dwells: self,
            attitudes,
            weights: &[1.0; COEFFICIENTS],
        };
        one.trace(ar)
    }

    /// Weights gyro by gyro, none on what is known.
    fn weights(&self, weights: &CoefficientVector) -> [f64; COEFFICIENTS] {
        let mut weights = PriorScale::new(weights).0;
        for (weight, prior) in weights.iter_mut().zip(&self.prior_information) {
            if *prior >= KNOWN {
                *weight = 0.0;
            }
        }
        weights
    }

    fn check(&self, attitudes: &[Attitude]) -> Result<()> {
        if attitudes.len() == self.count() {
            return Ok(());
        }
        Err(Error::input("one attitude per dwell is needed")
            .with_value(attitudes.len())
            .with_allowed(self.count().to_string()))
    }
}

/// A trace with the smallest pivot on the way to it.
fn checked([trace, least]: [f64; 2]) -> Result<f64> {
    if least > 0.0 && trace.is_finite() {
        Ok(trace)
    } else {
        Err(not_finite())
    }
}

/// One schedule.
struct One<'a> {
    dwells: &'a DwellSequence,
    attitudes: &'a [Attitude],
    weights: &'a [f64; COEFFICIENTS],
}

impl Task for One<'_> {
    type Output = [f64; 2];
    #[inline(always)]
    fn run<A: Single>(self, ar: A) -> [f64; 2] {
        self.trace(ar)
    }
}

impl One<'_> {
    /// tr(W P_D) and the smallest pivot, in the first lane of `ar`.
    #[inline(always)]
    fn trace<A: Arithmetic>(&self, ar: A) -> [A::Number; 2] {
        let dwells = self.dwells;
        let mut run = Run::new(ar);
        let mut places = Places::NOWHERE;
        for (k, (leg, attitude)) in dwells.legs.iter().zip(self.attitudes).enumerate() {
            places.put(0, attitude);
            run.leg(leg, &places, k + 1 == dwells.count());
        }
        let (trace, least) = run.weighted_trace(&dwells.prior_information, self.weights);
        [trace, least]
    }
}

/// Several schedules.
struct Several<'a> {
    dwells: &'a DwellSequence,
    schedules: &'a [&'a [Attitude]],
    weights: &'a [f64; COEFFICIENTS],
    out: &'a mut [[f64; 2]],
}

impl LaneTask for Several<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: pulp::Simd, L: Alignment, const FUSED: bool>(self, ar: Lanes<S, L, FUSED>) {
        let dwells = self.dwells;
        let mut run = Run::new(ar);
        // All places first: a register read right after its lanes were written one by one would
        // have to wait for them.
        let mut places = vec![Places::NOWHERE; dwells.count()];
        let groups = self.schedules.chunks(S::F64_LANES);
        for (of, out) in groups.zip(self.out.chunks_mut(S::F64_LANES)) {
            for (lane, attitudes) in of.iter().enumerate() {
                for (place, attitude) in places.iter_mut().zip(*attitudes) {
                    place.put(lane, attitude);
                }
            }
            run.start();
            for (k, (leg, place)) in dwells.legs.iter().zip(&places).enumerate() {
                run.leg(leg, place, k + 1 == dwells.count());
            }
            let (trace, least) = run.weighted_trace(&dwells.prior_information, self.weights);
            for (lane, out) in out.iter_mut().enumerate() {
                *out = [trace.lane(lane), least.lane(lane)];
            }
        }
    }
}
