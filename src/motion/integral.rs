//! The drift integral of a move, B = ∫ Φ(t_end − t) A(R(t)) dt, and its reverse mode.
//!
//! With the angles linear in time, A(R(t)) is a trigonometric polynomial whose highest angular
//! frequency is 2 (|α̇| + |β̇| + |γ̇|): C_c^n has degree 1 in each angle and g^c too. A
//! Gauss–Legendre rule of n points integrates cos(κ x) over [−1, 1] with an error of about
//! (e κ / 4n)^{2n}, so the number of points follows from κ, half the phase the integrand runs
//! through; long moves are cut into panels. The rules below keep the error under 1e-12 of the
//! duration (tested against a rule of 64 points).

use std::sync::LazyLock;

use nalgebra::Matrix3;

use super::Move;
use crate::attitude::Position;
use crate::drift::{DriftMatrix, drift_matrix, drift_matrix_adjoint, times_drift_matrix};
use crate::dynamics::ErrorDynamics;
use crate::units::EARTH_RATE_RAD_PER_S;

/// A Gauss–Legendre rule on [0, 1]: nodes and weights.
struct Rule {
    nodes: Vec<(f64, f64)>,
}

impl Rule {
    /// The rule of `n` points: roots of the Legendre polynomial P_n by Newton's method from the
    /// customary cosine guess, weights 2/((1 − x²) P_n'(x)²), mapped to [0, 1].
    fn gauss_legendre(n: usize) -> Self {
        let nodes = (0..n).map(|i| {
            let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
            let mut slope = 0.0;
            for _ in 0..100 {
                let (mut p0, mut p1) = (1.0, x);
                for k in 2..=n {
                    let k = k as f64;
                    (p0, p1) = (p1, ((2.0 * k - 1.0) * x * p1 - (k - 1.0) * p0) / k);
                }
                slope = n as f64 * (x * p1 - p0) / (x * x - 1.0);
                let step = p1 / slope;
                x -= step;
                if step.abs() < 1e-16 {
                    break;
                }
            }
            (0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * slope * slope))
        });
        Self {
            nodes: nodes.collect(),
        }
    }
}

/// The rules, each with the largest κ it is used for.
static RULES: LazyLock<[(f64, Rule); 4]> = LazyLock::new(|| {
    [(0.5, 6), (1.5, 8), (4.5, 12), (8.0, 16)].map(|(kappa, n)| (kappa, Rule::gauss_legendre(n)))
});

/// Half the phase that the integrand runs through in `length_s` of the move: the gimbals' turn,
/// and the Earth's in Φ.
fn half_phase(m: &Move, length_s: f64) -> f64 {
    let turn: f64 = m.change.iter().map(|c| c.abs()).sum();
    turn * length_s / m.duration_s + 0.5 * EARTH_RATE_RAD_PER_S * length_s
}

/// The rule and number of panels for half a phase of `kappa`.
fn rule_for(kappa: f64) -> (&'static Rule, usize) {
    let rules = &*RULES;
    for (limit, rule) in rules {
        if kappa <= *limit {
            return (rule, 1);
        }
    }
    let (limit, rule) = &rules[rules.len() - 1];
    (rule, (kappa / limit).ceil() as usize)
}

/// Calls `visit(time from the interval's start, weight in s)` at every node of the interval.
fn for_each_node(m: &Move, length_s: f64, mut visit: impl FnMut(f64, f64)) {
    let (rule, panels) = rule_for(half_phase(m, length_s));
    let width = length_s / panels as f64;
    for panel in 0..panels {
        for &(x, w) in &rule.nodes {
            visit(width * (panel as f64 + x), width * w);
        }
    }
}

/// Adjoints of one interval of a move.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct IntegralAdjoint {
    /// With respect to the angles at the start of the move.
    pub from: [f64; 3],
    /// With respect to the angle change of the move.
    pub change: [f64; 3],
    /// With respect to the move's duration, the interval's place and length held.
    pub duration: f64,
}

impl Move {
    /// B = ∫ Φ(t_end − t) A(R(t)) dt over the interval of `length_s` that starts `start_s` into
    /// the move: what the drift D adds to ψ^n by the interval's end is B D. Unit s (times g).
    pub fn drift_integral(
        &self,
        dynamics: &ErrorDynamics,
        start_s: f64,
        length_s: f64,
    ) -> DriftMatrix {
        let mut b = DriftMatrix::zeros();
        for_each_node(self, length_s, |t, weight| {
            let position = Position::from_array(self.angles_at((start_s + t) / self.duration_s));
            let phi: Matrix3<f64> = dynamics.transition(length_s - t) * weight;
            b += times_drift_matrix(&phi, &position.attitude());
        });
        b
    }

    /// Reverse mode of [`Move::drift_integral`]: adjoints of angles and duration, given the
    /// adjoint of B. The interval's own length is the chain's affair (Leibniz: ∂B/∂length =
    /// A(end) + F B).
    pub(crate) fn drift_integral_adjoint(
        &self,
        dynamics: &ErrorDynamics,
        start_s: f64,
        length_s: f64,
        b_adjoint: &DriftMatrix,
    ) -> IntegralAdjoint {
        let mut out = IntegralAdjoint::default();
        for_each_node(self, length_s, |t, weight| {
            let fraction = (start_s + t) / self.duration_s;
            let position = Position::from_array(self.angles_at(fraction));
            let phi = dynamics.transition(length_s - t) * weight;
            let a_adjoint = phi.transpose() * b_adjoint;
            let angles = drift_matrix_adjoint(position, &position.attitude(), &a_adjoint);
            for (i, angle) in angles.into_iter().enumerate() {
                out.from[i] += angle;
                out.change[i] += fraction * angle;
                out.duration -= fraction / self.duration_s * self.change[i] * angle;
            }
        });
        out
    }

    /// A at the `fraction` of the move.
    pub(crate) fn drift_matrix_at(&self, fraction: f64) -> DriftMatrix {
        drift_matrix(&Position::from_array(self.angles_at(fraction)).attitude())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::earth_rate_n;

    fn fine(m: &Move, dynamics: &ErrorDynamics, start: f64, length: f64) -> DriftMatrix {
        let rule = Rule::gauss_legendre(64);
        let mut b = DriftMatrix::zeros();
        let panels = 8;
        let width = length / panels as f64;
        for panel in 0..panels {
            for &(x, w) in &rule.nodes {
                let t = width * (panel as f64 + x);
                let p = Position::from_array(m.angles_at((start + t) / m.duration_s));
                b += dynamics.transition(length - t) * drift_matrix(&p.attitude()) * (w * width);
            }
        }
        b
    }

    #[test]
    fn rules_integrate_polynomials_of_their_degree() {
        for n in [6, 8, 12, 16] {
            let rule = Rule::gauss_legendre(n);
            for degree in 0..2 * n as i32 {
                let sum: f64 = rule.nodes.iter().map(|&(x, w)| w * x.powi(degree)).sum();
                assert!((sum - 1.0 / (f64::from(degree) + 1.0)).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn drift_integral_is_accurate_to_1e_12() {
        let dynamics = ErrorDynamics::new(earth_rate_n(0.49));
        let changes = [
            [0.0, 0.0, 0.0],
            [0.2, -0.1, 0.1],
            [0.5, 0.5, -0.5],
            [-1.5, 1.0, 1.9],
            [3.1, -3.1, 3.1],
            [6.0, 2.0, -12.0],
        ];
        for change in changes {
            let m = Move {
                from: [0.3, -0.8, 2.0],
                change,
                duration_s: 360.0,
                measured: false,
            };
            for (start, length) in [(0.0, 360.0), (120.0, 10.0), (357.0, 3.0)] {
                let exact = fine(&m, &dynamics, start, length);
                let error = (m.drift_integral(&dynamics, start, length) - exact).amax();
                assert!(error < 1e-12 * length, "{change:?}: {error:e}");
            }
        }
    }

    #[test]
    fn a_slow_move_follows_the_earth() {
        let dynamics = ErrorDynamics::new(earth_rate_n(0.49));
        let m = Move {
            from: [0.0; 3],
            change: [0.02, 0.0, 0.0],
            duration_s: 2e5,
            measured: false,
        };
        let error = (m.drift_integral(&dynamics, 0.0, 2e5) - fine(&m, &dynamics, 0.0, 2e5)).amax();
        assert!(error < 1e-12 * 2e5, "{error:e}");
    }

    #[test]
    fn adjoint_is_the_derivative() {
        let dynamics = ErrorDynamics::new(earth_rate_n(0.49));
        let weight = DriftMatrix::from_fn(|i, j| ((2 * i + 3 * j) as f64).cos());
        let base = Move {
            from: [0.3, -0.8, 2.0],
            change: [1.1, -0.6, 0.4],
            duration_s: 200.0,
            measured: false,
        };
        let (start, length) = (30.0, 90.0);
        let f = |m: &Move| m.drift_integral(&dynamics, start, length).dot(&weight);
        let adjoint = base.drift_integral_adjoint(&dynamics, start, length, &weight);
        let slope = |h: f64, shift: &dyn Fn(&mut Move, f64)| {
            let at = |by: f64| {
                let mut m = base;
                shift(&mut m, by);
                f(&m)
            };
            (at(h) - at(-h)) / (2.0 * h)
        };
        for i in 0..3 {
            let from = slope(1e-5, &|m, by| m.from[i] += by);
            let change = slope(1e-5, &|m, by| m.change[i] += by);
            assert!((from - adjoint.from[i]).abs() < 1e-6);
            assert!((change - adjoint.change[i]).abs() < 1e-6);
        }
        let longer = slope(1e-3, &|m, by| m.duration_s += by);
        assert!((longer - adjoint.duration).abs() < 1e-6);
    }
}
