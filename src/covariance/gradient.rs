//! Reverse mode of the [`chain`](super::chain): the gradient of any function of P_D with respect
//! to all angles and durations, for a few times the cost of one value.
//!
//! E is only ever added to, so its adjoint Ē is the same through the whole chain. Per dwell,
//! backwards, with V̄', P̄' the adjoints of the state after it (P̄, Ē symmetric):
//!
//! ```text
//! V̄₊ = A_ψᵀ V̄',  P̄₊ = A_ψᵀ P̄' A_ψ − sym(V̄₊ (R11ᵀ T)ᵀ),
//! T̄ = 2 S⁻¹ T Ē − R11 P₊ V̄₊,   S̄ = −S⁻¹ T Ē Tᵀ S⁻¹,
//! V̄ = V̄₊ + R11ᵀ T̄,            P̄ = (I − J P₊) P̄₊ (I − P₊ J) + R11ᵀ S̄ R11,
//! Ā = A_εᵀ V̄' + R12ᵀ T̄ + 2 R22ᵀ R22 A Ē,      J = R11ᵀ R11.
//! ```
//!
//! Time enters through the steps without measurement, d/dt (V, P) = (F V + A_end, F P + P Fᵀ +
//! q I), and through the weight of the relaxed measurement at the end of a remainder. A duration
//! at a whole number of periods gets its derivative from above.

use nalgebra::Matrix3;

use super::chain::{
    Gram, Measured, Passage, Recorder, State, Step, drift_matrix_at_end, measurement_root,
};
use super::small::{condition, square_root, whitener};
use super::{CovarianceModel, TickRule, covariance_from_information};
use crate::attitude::{EAST, NORTH};
use crate::drift::{CoefficientMatrix, DriftMatrix, drift_matrix_adjoint, times_drift_matrix};
use crate::error::Result;
use crate::motion::{Leg, Timeline};

/// Derivatives of a figure of merit with respect to one leg of a timeline.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LegGradient {
    /// With respect to (α, β, γ), per rad, all durations held.
    pub angles: [f64; 3],
    /// With respect to the dwell, per s.
    pub dwell_s: f64,
    /// With respect to the duration of the move to the position, per s, its path held.
    pub move_s: f64,
}

/// The steps of the chain with the state before each.
#[derive(Debug, Default)]
struct Tape(Vec<(usize, Step, State)>);

impl Recorder for Tape {
    const KEEP_EMPTY: bool = true;
    fn record(&mut self, leg: usize, step: Step, before: &State) {
        self.0.push((leg, step, *before));
    }
}

impl CovarianceModel {
    /// The value of a figure of merit and its gradient, one [`LegGradient`] per leg.
    ///
    /// `merit` takes P_D in (°/h)² and returns the value with its derivative with respect to
    /// P_D, a symmetric matrix G: df = tr(G dP_D).
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows; what
    /// `merit` returns.
    pub fn gradient(
        &self,
        timeline: &Timeline,
        rule: TickRule,
        merit: impl FnOnce(&CoefficientMatrix) -> Result<(f64, CoefficientMatrix)>,
    ) -> Result<(f64, Vec<LegGradient>)> {
        let mut gram = Gram(CoefficientMatrix::zeros());
        let mut tape = Tape::default();
        let end = self.run(timeline, rule, &mut gram, &mut tape);
        let covariance = covariance_from_information(&gram.0, &self.prior_sigma)?;
        let (value, merit_adjoint) = merit(&covariance)?;
        // dP_D = −P_D dE P_D.
        let information_adjoint = -(covariance * merit_adjoint * covariance);
        let mut sweep = Sweep {
            model: self,
            legs: timeline.legs(),
            information: information_adjoint,
            v: DriftMatrix::zeros(),
            p: Matrix3::zeros(),
            after: end,
            gradient: vec![LegGradient::default(); timeline.legs().len()],
        };
        for (leg, step, before) in tape.0.iter().rev() {
            sweep.back(*leg, *step, before);
            sweep.after = *before;
        }
        Ok((value, sweep.gradient))
    }
}

/// The backward sweep: adjoints of V and P after the step at hand.
struct Sweep<'a> {
    model: &'a CovarianceModel,
    legs: &'a [Leg],
    information: CoefficientMatrix,
    v: DriftMatrix,
    p: Matrix3<f64>,
    /// The state after the step at hand.
    after: State,
    gradient: Vec<LegGradient>,
}

/// The symmetric part.
fn symmetric(m: &Matrix3<f64>) -> Matrix3<f64> {
    (m + m.transpose()) * 0.5
}

impl Sweep<'_> {
    fn back(&mut self, leg: usize, step: Step, before: &State) {
        match step {
            Step::Dwell { periods } => self.dwell(leg, periods, before),
            Step::Pass { passage, length_s } => self.pass(leg, passage, length_s),
            Step::Measure { weight, of } => self.measure(leg, weight, of, before),
            Step::Rotate => self.rotate(leg, before),
        }
    }

    fn add_angles(&mut self, leg: usize, angles: [f64; 3]) {
        for (sum, angle) in self.gradient[leg].angles.iter_mut().zip(angles) {
            *sum += angle;
        }
    }

    fn add_drift_matrix(&mut self, leg: usize, adjoint: &DriftMatrix) {
        let l = &self.legs[leg];
        let angles = drift_matrix_adjoint(l.position, &l.attitude, adjoint);
        self.add_angles(leg, angles);
    }

    /// Common to dwells and single measurements: conditioning on three scalars of unit noise
    /// with sensitivity `r11` to ψ and residual sensitivity `t` to D. Takes the adjoints after
    /// it, leaves those before it, and returns T̄.
    fn condition(&mut self, r11: &Matrix3<f64>, t: &DriftMatrix, before: &State) -> DriftMatrix {
        let g = square_root(&before.p);
        let w = whitener(&(r11 * g));
        let s_inv_t = w.transpose() * (w * t);
        let p_plus = condition(&g, r11);
        let v_plus_adjoint = self.v;
        let pull = r11.transpose() * t;
        let p_plus_adjoint = self.p - symmetric(&(v_plus_adjoint * pull.transpose()));
        let s_inv_t_e = s_inv_t * self.information;
        let t_adjoint = s_inv_t_e * 2.0 - r11 * (p_plus * v_plus_adjoint);
        let s_adjoint = -(s_inv_t_e * s_inv_t.transpose());
        let keep = Matrix3::identity() - p_plus * (r11.transpose() * r11);
        self.v = v_plus_adjoint + r11.transpose() * t_adjoint;
        self.p = keep.transpose() * p_plus_adjoint * keep + r11.transpose() * s_adjoint * r11;
        t_adjoint
    }

    fn dwell(&mut self, leg: usize, periods: usize, before: &State) {
        let k = self.model.kernels.kernel(periods);
        let attitude = self.legs[leg].attitude;
        let t = k.r11 * before.v + times_drift_matrix(&k.r12, &attitude);
        let seen = times_drift_matrix(&k.r22, &attitude);
        let mut a_adjoint =
            k.a_epsilon.transpose() * self.v + k.r22.transpose() * (seen * self.information) * 2.0;
        self.v = k.a_psi.transpose() * self.v;
        self.p = k.a_psi.transpose() * self.p * k.a_psi;
        let t_adjoint = self.condition(&k.r11, &t, before);
        a_adjoint += k.r12.transpose() * t_adjoint;
        self.add_drift_matrix(leg, &a_adjoint);
    }

    fn pass(&mut self, leg: usize, passage: Passage, length_s: f64) {
        let dynamics = &self.model.dynamics;
        let l = &self.legs[leg];
        let f = dynamics.system_matrix();
        let v_rate = f * self.after.v + drift_matrix_at_end(passage, l, length_s);
        let fp = f * self.after.p;
        let p_rate = fp + fp.transpose() + Matrix3::identity() * self.model.drift_psd;
        let length_adjoint = self.v.dot(&v_rate) + self.p.dot(&p_rate);
        match (passage, &l.arrival) {
            (Passage::Moving { start_s, last }, Some(m)) => {
                let b = m.drift_integral_adjoint(dynamics, start_s, length_s, &self.v);
                self.add_angles(leg, b.change);
                let before = leg - 1;
                self.add_angles(before, b.from);
                self.add_angles(before, b.change.map(|c| -c));
                self.gradient[leg].move_s += b.duration;
                if last {
                    self.gradient[leg].move_s += length_adjoint;
                }
            }
            _ => {
                let gamma = dynamics.integral(length_s);
                self.add_drift_matrix(leg, &(gamma.transpose() * self.v));
                if passage == Passage::Remainder {
                    self.gradient[leg].dwell_s += length_adjoint;
                }
            }
        }
        let phi_t = dynamics.transition(length_s).transpose();
        self.v = phi_t * self.v;
        self.p = phi_t * self.p * phi_t.transpose();
    }

    fn measure(&mut self, leg: usize, weight: f64, of: Measured, before: &State) {
        let weight_adjoint = match of {
            Measured::Tick => 0.0,
            _ => self.weight_adjoint(weight, before),
        };
        let per_s = 1.0 / (self.model.period_s * self.model.noise_variance);
        match of {
            Measured::Tick => {}
            Measured::DwellRemainder => self.gradient[leg].dwell_s += weight_adjoint * per_s,
            Measured::MoveRemainder => self.gradient[leg].move_s += weight_adjoint * per_s,
        }
        let h = measurement_root(weight);
        self.condition(&h, &(h * before.v), before);
    }

    /// Derivative with respect to the weight w of a measurement H ψ, H = [ψ_x; ψ_z]:
    /// dE/dw = (M T)ᵀ (M T) with T = H V, M = (I + w H P Hᵀ)⁻¹; dP₊/dw = −P₊ HᵀH P₊ and
    /// dV₊/dw = −P₊ HᵀH V₊. Regular at w = 0, where √w is not.
    fn weight_adjoint(&self, weight: f64, before: &State) -> f64 {
        let h = measurement_root(1.0);
        let root = measurement_root(weight);
        let w = whitener(&(root * square_root(&before.p)));
        let mt = w.transpose() * (w * (h * before.v));
        let State { v, p } = self.after;
        let through_e = (mt * self.information).dot(&mt);
        let seen = |axis: usize| {
            let p_column = p.column(axis);
            let through_p = p_column.dot(&(self.p * p_column));
            let through_v = p_column.dot(&(self.v * v.row(axis).transpose()));
            through_p + through_v
        };
        through_e - seen(NORTH) - seen(EAST)
    }

    fn rotate(&mut self, leg: usize, before: &State) {
        let (now, previous) = (&self.legs[leg], &self.legs[leg - 1]);
        let (c, c0) = (now.attitude.matrix(), previous.attitude.matrix());
        let q = c * c0.transpose();
        let q_adjoint = self.v * before.v.transpose() + self.p * q * before.p * 2.0;
        let here = now.attitude.angle_adjoint(now.position, &(q_adjoint * c0));
        let there = previous
            .attitude
            .angle_adjoint(previous.position, &(q_adjoint.transpose() * c));
        self.add_angles(leg, here);
        self.add_angles(leg - 1, there);
        self.v = q.transpose() * self.v;
        self.p = q.transpose() * self.p * q;
    }
}
