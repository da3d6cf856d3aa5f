//! The chain of the twelve coefficients in doubles, in the paper's mounting: for searches.

use nalgebra::Matrix3;

use super::chain::{Effects, InformationSink, NoRecord, Reached, Recorder, Runner, run, start};
use super::kernel::Kernel;
use super::real::Extended;
use super::rows::Rows;
use super::selection::MOST_IN_DOUBLES;
use super::small::square_root;
use super::{CovarianceModel, CovarianceRoot, EndCovariance, TickRule};
use crate::attitude::{Attitude, EAST, NORTH};
use crate::drift::{DriftMatrix, times_drift_matrix};
use crate::error::Result;
use crate::motion::{Leg, Move, Timeline};

/// The state of the chain of the twelve coefficients: V, P.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct State {
    /// Sensitivity of ψ^n to D, arcsec per °/h.
    pub v: DriftMatrix,
    /// Covariance of ψ^n for known D, arcsec².
    pub p: Matrix3<f64>,
}

/// E itself, by Gram products.
#[cfg(test)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Gram(pub crate::drift::CoefficientMatrix);

#[cfg(test)]
impl InformationSink for Gram {
    fn add(&mut self, rows: &DriftMatrix) {
        self.0.gemm_tr(1.0, rows, rows, 1.0);
    }
}

/// The twelve coefficients in doubles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Twelve<'a>(pub &'a CovarianceModel);

impl Effects for Twelve<'_> {
    type Number = f64;
    type Drive = DriftMatrix;
    type Place = Attitude;

    fn model(&self) -> &CovarianceModel {
        self.0
    }
    fn nothing(&self) -> DriftMatrix {
        DriftMatrix::zeros()
    }
    fn place(&self, leg: &Leg) -> Attitude {
        leg.attitude
    }
    fn attitude(&self, place: &Attitude) -> Matrix3<f64> {
        *place.matrix()
    }
    fn held(&self, x: &Matrix3<f64>, place: &Attitude) -> DriftMatrix {
        times_drift_matrix(x, place)
    }
    fn moved(&self, m: &Move, start_s: f64, length_s: f64) -> DriftMatrix {
        m.drift_integral(&self.0.stand, &self.0.dynamics, start_s, length_s)
    }
    fn kernel(&self, periods: usize) -> Kernel {
        self.0.kernels.kernel(periods)
    }
    fn measurement(&self) -> Matrix3<f64> {
        measurement_root(self.0.noise_variance.recip())
    }
}

impl CovarianceModel {
    /// Information on the twelve coefficients (without the prior) and the final state of
    /// `timeline`.
    pub(crate) fn run<S: InformationSink, R: Recorder>(
        &self,
        timeline: &Timeline,
        rule: TickRule,
        sink: &mut S,
        recorder: &mut R,
    ) -> State {
        let Reached { v, g } = run(&Twelve(self), timeline, rule, sink, recorder);
        State {
            v,
            p: g * g.transpose(),
        }
    }

    /// What `timeline` tells, and what it would tell with each dwell of its schedule longer by
    /// `by_s`, in order: what comes before that dwell is gone through once for all of them.
    pub(crate) fn run_lengthened<S: InformationSink + Clone>(
        &self,
        timeline: &Timeline,
        rule: TickRule,
        by_s: f64,
        nothing: S,
    ) -> (S, Vec<S>) {
        let legs = timeline.legs();
        let mut sink = nothing;
        let (effects, mut recorder) = (Twelve(self), NoRecord);
        let mut runner = start(&effects, rule, &mut sink, &mut recorder);
        let mut lengthened = Vec::with_capacity(timeline.position_legs().len());
        for (index, leg) in legs.iter().enumerate() {
            let before = index.checked_sub(1).map(|k| &legs[k].attitude);
            runner.reach(leg, &leg.attitude, before);
            if timeline.positions().contains(&index) {
                let mut ahead = runner.sink.clone();
                let mut fork = Runner {
                    effects: runner.effects,
                    sink: &mut ahead,
                    recorder: &mut NoRecord,
                    ..runner
                };
                let dwell_s = leg.dwell_s + by_s;
                fork.dwell(&Leg { dwell_s, ..*leg }, &leg.attitude);
                for pair in legs[index..].windows(2) {
                    fork.reach(&pair[1], &pair[1].attitude, Some(&pair[0].attitude));
                    fork.dwell(&pair[1], &pair[1].attitude);
                }
                lengthened.push(ahead);
            }
            runner.dwell(leg, &leg.attitude);
        }
        (sink, lengthened)
    }

    /// Before the test: nothing is known of D, and ψ^n by its prior.
    pub(crate) fn start_state(&self) -> State {
        State {
            v: DriftMatrix::zeros(),
            p: self.prior_psi,
        }
    }

    /// The move to `leg` from the attitude `before` it, and its settle.
    pub(crate) fn arrive<S: InformationSink>(
        &self,
        state: State,
        (before, leg): (&Attitude, &Leg),
        rule: TickRule,
        sink: &mut S,
    ) -> State {
        self.step(state, rule, sink, |runner| {
            runner.arrive(leg, &leg.attitude, before);
        })
    }

    /// The dwell of `leg`.
    pub(crate) fn dwell<S: InformationSink>(
        &self,
        state: State,
        leg: &Leg,
        rule: TickRule,
        sink: &mut S,
    ) -> State {
        self.step(state, rule, sink, |runner| {
            runner.dwell(leg, &leg.attitude);
        })
    }

    fn step<S: InformationSink>(
        &self,
        state: State,
        rule: TickRule,
        sink: &mut S,
        take: impl FnOnce(&mut Runner<'_, Twelve<'_>, S, NoRecord>),
    ) -> State {
        let mut runner = Runner {
            effects: &Twelve(self),
            rule,
            v: state.v,
            g: square_root(&state.p),
            sink,
            recorder: &mut NoRecord,
            leg: 0,
        };
        take(&mut runner);
        State {
            v: runner.v,
            p: runner.g * runner.g.transpose(),
        }
    }

    /// The covariance at the end of `timeline`, its information triangularised by QR.
    ///
    /// Where a combination of coefficients is told 1e9 times better than its prior, the sixteenth
    /// digit of its rows may count beside the prior of another; and where a misalignment is told
    /// 1e8 times better than its prior, I + R11 P R11ᵀ loses its I. Under the filter's rule it is
    /// then worked out in numbers of 32 digits.
    ///
    /// By the filter's rule with everything that the platform has; by the relaxed one of the twelve
    /// coefficients alone, in the paper's mounting.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows.
    pub fn end_covariance(&self, timeline: &Timeline, rule: TickRule) -> Result<EndCovariance> {
        if rule == TickRule::Filter && !self.is_of_the_paper() {
            return Ok(self.full_covariance(timeline)?.end);
        }
        let (mut rows, state) = self.rows(timeline, rule);
        let told = rows.largest();
        let root = rows.covariance_root();
        let lost = root.is_err() || told > MOST_IN_DOUBLES;
        match rule == TickRule::Filter && lost && self.is_of_the_paper() {
            true => Ok(self.full_covariance_in::<Extended>(timeline)?.full.end),
            false => Ok(EndCovariance::new(root?, &state)),
        }
    }

    pub(super) fn rows(&self, timeline: &Timeline, rule: TickRule) -> (Rows, State) {
        let mut rows = Rows::new(&self.prior_sigma);
        let state = self.run(timeline, rule, &mut rows, &mut NoRecord);
        (rows, state)
    }

    /// The same in doubles, whatever the priors: for searches.
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::end_covariance`].
    pub(crate) fn end_covariance_in_doubles(
        &self,
        timeline: &Timeline,
        rule: TickRule,
    ) -> Result<EndCovariance> {
        let (rows, state) = self.rows(timeline, rule);
        Ok(EndCovariance::new(rows.covariance_root()?, &state))
    }
}

impl EndCovariance {
    /// P_D = L Lᵀ; ψ^n's covariance is P + (V L)(V L)ᵀ. By V P_D Vᵀ it would be a difference of
    /// large numbers under weak priors, and could come out negative.
    pub(super) fn new(root: CovarianceRoot, state: &State) -> Self {
        let through_drift = state.v * root.matrix();
        Self {
            coefficients: root.matrix() * root.matrix().transpose(),
            root,
            misalignment: state.p + through_drift * through_drift.transpose(),
        }
    }
}

/// √weight on ψ_x and ψ_z, nothing on ψ_y: a measurement (9) in the form of `r11`.
pub(crate) fn measurement_root(weight: f64) -> Matrix3<f64> {
    let mut h = Matrix3::zeros();
    h[(NORTH, NORTH)] = weight.sqrt();
    h[(EAST, EAST)] = weight.sqrt();
    h
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Position;
    use crate::drift::COEFFICIENTS;
    use crate::platform::{PlatformConfig, Repositioning};
    use crate::schedule::{Schedule, ScheduledPosition};

    /// On an ordinary problem sixteen digits are enough: the same covariance, signs included, by
    /// moves that take time or none, are measured or not, or turn ψ^n.
    #[test]
    fn doubles_and_numbers_of_32_digits_have_the_same_covariance() {
        type Change = fn(&mut PlatformConfig);
        let cases: [Change; 4] = [
            |_| {},
            |c| {
                c.motion.slew_rate_deg_per_s = Some(0.9.into());
                c.motion.measure_moves = true;
            },
            |c| {
                c.motion.slew_rate_deg_per_s = Some(0.9.into());
                c.motion.settle_s = 37.0;
                c.motion.start_deg = Some([5.0, -20.0, 60.0]);
                c.motion.return_to_start = true;
            },
            |c| c.motion.repositioning = Repositioning::FrameHold,
        ];
        for (k, change) in cases.into_iter().enumerate() {
            let mut config = PlatformConfig::default();
            change(&mut config);
            let platform = config.check().unwrap();
            let positions = [
                ([10.0, 20.0, 30.0], 604.0),
                ([-80.0, 65.0, 140.0], 1300.0),
                ([-80.0, 65.0, 140.0], 7.0),
                ([150.0, -40.0, -75.0], 955.0),
            ]
            .map(|(a, dwell_s)| {
                ScheduledPosition::new(Position::from_deg(a[0], a[1], a[2]), dwell_s)
            });
            let timeline = Timeline::new(
                &platform.clone().into(),
                &Schedule::new(positions.into()).unwrap(),
            );
            let timeline = timeline.unwrap();
            let model = CovarianceModel::new(&platform);
            let doubles = model.end_covariance(&timeline, TickRule::Filter).unwrap();
            let extended = model
                .full_covariance_in::<Extended>(&timeline)
                .unwrap()
                .full
                .end;
            let (a, b) = (&doubles.coefficients, &extended.coefficients);
            for i in 0..COEFFICIENTS {
                for j in 0..COEFFICIENTS {
                    let scale = (b[(i, i)] * b[(j, j)]).sqrt();
                    assert!((a[(i, j)] - b[(i, j)]).abs() < 1e-9 * scale, "{k}: {i} {j}");
                }
            }
            let difference = doubles.misalignment - extended.misalignment;
            assert!(difference.amax() < 1e-9 * extended.misalignment.amax());
        }
    }
}
