//! A schedule as a chain of elements: Friedland's separated bias, two stages.
//!
//! Carried are V (3×12, sensitivity of ψ^n to D), P (3×3, covariance of ψ^n for known D) and the
//! information E (12×12) on D. With a dwell's [`Kernel`](super::kernel::Kernel), in its factored
//! form, and A = A(position):
//!
//! ```text
//! T = R11 V + R12 A,          S = I + R11 P R11ᵀ,
//! E += Tᵀ S⁻¹ T + (R22 A)ᵀ (R22 A),
//! P₊ = (P⁻¹ + R11ᵀ R11)⁻¹,    V₊ = V − P₊ R11ᵀ T,
//! V ← A_ψ V₊ + A_ε A,         P ← A_ψ P₊ A_ψᵀ + C.
//! ```
//!
//! Every change of E is an addition of a square, so nothing cancels. Against theory texts that
//! use J_ψψ⁻¹: S ⪰ I always, so a dwell of one period, the poles, and a misalignment known
//! exactly are ordinary cases.
//!
//! Between dwells V ← Φ V + B, P ← Φ P Φᵀ + q t I with B the drift integral; in frame-hold
//! repositioning V ← Q V, P ← Q P Qᵀ with Q = C_{k+1} C_kᵀ. A measured move runs the filter's
//! ticks one by one.

use nalgebra::Matrix3;

use super::rows::Rows;
use super::small::{condition, square_root, whitener};
use super::{CovarianceModel, CovarianceRoot, EndCovariance, Precision, TickRule, split_periods};
use crate::attitude::{Attitude, EAST, NORTH};
use crate::drift::{DriftMatrix, times_drift_matrix};
use crate::error::Result;
use crate::motion::{Leg, Move, Timeline};

/// The covariance at the end of a schedule, and what it took.
pub(crate) struct WithPrecision {
    pub end: EndCovariance,
    /// The numbers it was worked out in.
    pub precision: Precision,
    /// How many times better than its prior, σ against σ, some combination of coefficients is
    /// told.
    pub told: f64,
}

/// The state of the chain: V, P.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct State {
    /// Sensitivity of ψ^n to D, arcsec per °/h.
    pub v: DriftMatrix,
    /// Covariance of ψ^n for known D, arcsec².
    pub p: Matrix3<f64>,
}

/// Why time passes without a measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Passage {
    /// The rest of a dwell, shorter than a period.
    Remainder,
    /// Settling after a move.
    Settle,
    /// `start_s` to `start_s + length` of the move.
    Moving { start_s: f64 },
}

/// One step of the chain.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Step {
    /// `periods` filter periods of the dwell.
    Dwell { periods: usize },
    /// Time without a measurement.
    Pass { passage: Passage, length_s: f64 },
    /// A measurement of ψ_x, ψ_z with information `weight` each, 1/arcsec².
    Measure { weight: f64, of: Measured },
    /// Change of position in frame-hold repositioning.
    Rotate,
}

/// What a single measurement belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Measured {
    /// A measured move.
    Move,
    /// The rest of a dwell.
    Dwell,
}

/// Takes the information rows as the chain produces them: E += XᵀX.
pub(crate) trait InformationSink {
    /// Adds three rows of unit noise.
    fn add(&mut self, rows: &DriftMatrix);
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

/// Watches the chain.
pub(crate) trait Recorder {
    /// Called before each step of a leg.
    fn record(&mut self, leg: usize, step: Step);
}

/// Remembers nothing.
pub(crate) struct NoRecord;

impl Recorder for NoRecord {
    fn record(&mut self, _: usize, _: Step) {}
}

/// The chain at work: model, rule, and what it writes to.
struct Runner<'a, S, R> {
    model: &'a CovarianceModel,
    rule: TickRule,
    state: State,
    sink: &'a mut S,
    recorder: &'a mut R,
    leg: usize,
}

impl CovarianceModel {
    /// Information on D (without the prior) and the final state of `timeline`.
    pub(crate) fn run<S: InformationSink, R: Recorder>(
        &self,
        timeline: &Timeline,
        rule: TickRule,
        sink: &mut S,
        recorder: &mut R,
    ) -> State {
        let mut runner = self.runner(self.start_state(), rule, sink, recorder);
        let legs = timeline.legs();
        for (index, leg) in legs.iter().enumerate() {
            runner.leg = index;
            if let Some(arrival) = &leg.arrival {
                runner.arrive(arrival, leg, &legs[index - 1].attitude);
            }
            runner.dwell(leg);
        }
        runner.state
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
        let Some(arrival) = &leg.arrival else {
            return state;
        };
        let mut none = NoRecord;
        let mut runner = self.runner(state, rule, sink, &mut none);
        runner.arrive(arrival, leg, before);
        runner.state
    }

    /// The dwell of `leg`.
    pub(crate) fn dwell<S: InformationSink>(
        &self,
        state: State,
        leg: &Leg,
        rule: TickRule,
        sink: &mut S,
    ) -> State {
        let mut none = NoRecord;
        let mut runner = self.runner(state, rule, sink, &mut none);
        runner.dwell(leg);
        runner.state
    }

    fn runner<'a, S: InformationSink, R: Recorder>(
        &'a self,
        state: State,
        rule: TickRule,
        sink: &'a mut S,
        recorder: &'a mut R,
    ) -> Runner<'a, S, R> {
        Runner {
            model: self,
            rule,
            state,
            sink,
            recorder,
            leg: 0,
        }
    }

    /// The covariance at the end of `timeline`, its information triangularised by QR.
    ///
    /// Where a combination of coefficients is told 1e9 times better than its prior, the sixteenth
    /// digit of its rows may count beside the prior of another; and where a misalignment is told
    /// 1e8 times better than its prior, I + R11 P R11ᵀ loses its I. Under the filter's rule it is
    /// then worked out in numbers of 32 digits.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows.
    pub fn end_covariance(&self, timeline: &Timeline, rule: TickRule) -> Result<EndCovariance> {
        Ok(self.end_with_precision(timeline, rule)?.end)
    }

    /// The same, with the numbers that it took.
    ///
    /// # Errors
    ///
    /// As [`CovarianceModel::end_covariance`].
    pub(crate) fn end_with_precision(
        &self,
        timeline: &Timeline,
        rule: TickRule,
    ) -> Result<WithPrecision> {
        /// Information of 1e-7 of a unit prior: its share of a σ is below 1e-13.
        const MOST_IN_DOUBLES: f64 = 1e9;
        let (mut rows, state) = self.rows(timeline, rule);
        let told = rows.largest();
        let root = rows.covariance_root();
        let lost = root.is_err() || told > MOST_IN_DOUBLES;
        let (end, precision) = match rule == TickRule::Filter && lost {
            true => (self.end_covariance_extended(timeline)?, Precision::Extended),
            false => (EndCovariance::new(root?, &state), Precision::Double),
        };
        Ok(WithPrecision {
            end,
            precision,
            told,
        })
    }

    fn rows(&self, timeline: &Timeline, rule: TickRule) -> (Rows, State) {
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
    fn new(root: CovarianceRoot, state: &State) -> Self {
        let through_drift = state.v * root.matrix();
        Self {
            coefficients: root.matrix() * root.matrix().transpose(),
            root,
            misalignment: state.p + through_drift * through_drift.transpose(),
        }
    }
}

impl<S: InformationSink, R: Recorder> Runner<'_, S, R> {
    fn arrive(&mut self, arrival: &Move, leg: &Leg, previous: &Attitude) {
        if self.model.frame_hold {
            self.recorder.record(self.leg, Step::Rotate);
            let q = leg.attitude.matrix() * previous.matrix().transpose();
            self.state.v = q * self.state.v;
            self.state.p = q * self.state.p * q.transpose();
        } else if arrival.measured {
            self.measured_move(arrival);
        } else if arrival.duration_s > 0.0 {
            self.moving(arrival, 0.0, arrival.duration_s);
        }
        if leg.settle_s > 0.0 {
            self.pass_at(Passage::Settle, leg, leg.settle_s);
        }
    }

    /// A measured move: the filter's ticks run through it.
    fn measured_move(&mut self, arrival: &Move) {
        if arrival.duration_s <= 0.0 {
            return;
        }
        let period = self.model.period_s;
        let (ticks, remainder) = split_periods(arrival.duration_s, period);
        let weight = self.model.noise_variance.recip();
        for tick in 0..ticks {
            self.moving(arrival, tick as f64 * period, period);
            self.measure(weight, Measured::Move);
        }
        if remainder > 0.0 {
            self.moving(arrival, ticks as f64 * period, remainder);
            if self.rule == TickRule::Relaxed {
                self.measure(weight * remainder / period, Measured::Move);
            }
        }
    }

    fn dwell(&mut self, leg: &Leg) {
        let (periods, remainder) = split_periods(leg.dwell_s, self.model.period_s);
        if periods > 0 {
            self.recorder.record(self.leg, Step::Dwell { periods });
            self.dwell_periods(leg, periods);
        }
        if remainder > 0.0 {
            self.pass_at(Passage::Remainder, leg, remainder);
            if self.rule == TickRule::Relaxed {
                let weight = remainder / (self.model.period_s * self.model.noise_variance);
                self.measure(weight, Measured::Dwell);
            }
        }
    }

    fn dwell_periods(&mut self, leg: &Leg, periods: usize) {
        let k = self.model.kernels.kernel(periods);
        let State { v, p } = self.state;
        let t = k.r11 * v + times_drift_matrix(&k.r12, &leg.attitude);
        let g = square_root(&p);
        self.sink.add(&(whitener(&(k.r11 * g)) * t));
        self.sink.add(&times_drift_matrix(&k.r22, &leg.attitude));
        let p_plus = condition(&g, &k.r11);
        let v_plus = v - p_plus * (k.r11.transpose() * t);
        self.state = State {
            v: k.a_psi * v_plus + times_drift_matrix(&k.a_epsilon, &leg.attitude),
            p: k.a_psi * p_plus * k.a_psi.transpose() + k.c,
        };
    }

    /// Time at a position without a measurement.
    fn pass_at(&mut self, passage: Passage, leg: &Leg, length_s: f64) {
        let b = times_drift_matrix(&self.model.dynamics.integral(length_s), &leg.attitude);
        self.pass(passage, length_s, &b);
    }

    /// An interval of a move.
    fn moving(&mut self, m: &Move, start_s: f64, length_s: f64) {
        let b = m.drift_integral(&self.model.dynamics, start_s, length_s);
        self.pass(Passage::Moving { start_s }, length_s, &b);
    }

    fn pass(&mut self, passage: Passage, length_s: f64, b: &DriftMatrix) {
        self.recorder
            .record(self.leg, Step::Pass { passage, length_s });
        let phi = self.model.dynamics.transition(length_s);
        let noise = Matrix3::identity() * (self.model.drift_psd * length_s);
        self.state.v = phi * self.state.v + b;
        self.state.p = phi * self.state.p * phi.transpose() + noise;
    }

    fn measure(&mut self, weight: f64, of: Measured) {
        self.recorder.record(self.leg, Step::Measure { weight, of });
        let h = measurement_root(weight);
        let State { v, p } = self.state;
        let g = square_root(&p);
        let t = h * v;
        self.sink.add(&(whitener(&(h * g)) * t));
        let p_plus = condition(&g, &h);
        self.state = State {
            v: v - p_plus * (h * t),
            p: p_plus,
        };
    }
}

/// √weight on ψ_x and ψ_z, nothing on ψ_y: a measurement (9) in the form of `r11`.
pub(crate) fn measurement_root(weight: f64) -> Matrix3<f64> {
    let mut h = Matrix3::zeros();
    h[(NORTH, NORTH)] = weight.sqrt();
    h[(EAST, EAST)] = weight.sqrt();
    h
}
