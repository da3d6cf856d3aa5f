//! The error dynamics in n, (2) and (8): ψ̇^n = −ω_ie^n × ψ^n + ε^n + w.
//!
//! In n the equation does not know the platform's motion: a body rotation turns c and p
//! together, so ψ^n is continuous across every change of position and only ε^n = A(t) D changes.
//! Its solution over a time t with ε^n constant is ψ(t) = Φ(t) ψ(0) + Γ(t) ε, with Φ a rotation
//! by −ω_ie t. Because Φ is a rotation and w is isotropic with PSD q, the process noise of any
//! interval is q t I.

use nalgebra::{Matrix3, Vector3};

/// Φ(t) and Γ(t) = ∫₀ᵗ Φ(s) ds of ψ̇^n = F ψ^n + ε^n, F = −[ω_ie^n ×].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorDynamics {
    rate: f64,
    axis: Vector3<f64>,
    axis_cross: Matrix3<f64>,
    axis_cross_squared: Matrix3<f64>,
}

impl ErrorDynamics {
    /// For the Earth rate `earth_rate_n` in rad/s.
    pub fn new(earth_rate_n: Vector3<f64>) -> Self {
        let rate = earth_rate_n.norm();
        let axis = earth_rate_n / rate;
        let axis_cross = axis.cross_matrix();
        Self {
            rate,
            axis,
            axis_cross,
            axis_cross_squared: axis_cross * axis_cross,
        }
    }

    /// The Earth rate ω_ie, rad/s.
    pub const fn rate(&self) -> f64 {
        self.rate
    }

    /// The axis of the Earth's rotation in n, a unit vector.
    pub(crate) const fn axis(&self) -> &Vector3<f64> {
        &self.axis
    }

    /// F = −[ω_ie^n ×], 1/s.
    pub fn system_matrix(&self) -> Matrix3<f64> {
        -self.rate * self.axis_cross
    }

    /// Φ(t) = I − sin(ωt) K + (1 − cos ωt) K², K the unit axis' cross matrix.
    pub fn transition(&self, t_s: f64) -> Matrix3<f64> {
        let x = self.rate * t_s;
        // 1 − cos x loses its digits at a filter period, where x is 1e-3 or less.
        let one_minus_cos = 2.0 * libm::sin(0.5 * x).powi(2);
        Matrix3::identity() - libm::sin(x) * self.axis_cross
            + one_minus_cos * self.axis_cross_squared
    }

    /// Γ(t) = t I − (1 − cos ωt)/ω K + (t − sin(ωt)/ω) K², s.
    pub fn integral(&self, t_s: f64) -> Matrix3<f64> {
        let x = self.rate * t_s;
        let one_minus_cos = 2.0 * libm::sin(0.5 * x).powi(2);
        let x_minus_sin = if x.abs() < 0.1 {
            // x − sin x by its series; the next term, x¹¹/11!, is below 3e-18 x at x = 0.1.
            let x2 = x * x;
            x * x2 / 6.0 * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0)))
        } else {
            x - libm::sin(x)
        };
        Matrix3::identity() * t_s - (one_minus_cos / self.rate) * self.axis_cross
            + (x_minus_sin / self.rate) * self.axis_cross_squared
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::earth_rate_n;

    #[test]
    fn transition_and_integral_solve_the_equation() {
        // Against a Taylor series of the exponential, summed to convergence.
        for latitude in [-1.2_f64, 0.0, 0.49, std::f64::consts::FRAC_PI_2] {
            let d = ErrorDynamics::new(earth_rate_n(latitude));
            let f = d.system_matrix();
            for t in [0.01, 10.0, 1300.0, 1400.0, 5000.0] {
                let (mut phi, mut gamma) = (Matrix3::zeros(), Matrix3::zeros());
                let mut term = Matrix3::identity();
                for k in 1..60 {
                    phi += term;
                    gamma += term * (t / k as f64);
                    term = f * term * (t / k as f64);
                }
                assert!((d.transition(t) - phi).amax() < 1e-15);
                assert!((d.integral(t) - gamma).amax() < 1e-15 * t.max(1.0));
            }
        }
    }

    #[test]
    fn signs_are_those_of_equation_10() {
        // ψ̇_z = ω_U ψ_x − ω_N ψ_y + ε_z and ψ̇_x = −ω_U ψ_z + ε_x, ψ̇_y = ω_N ψ_z + ε_y (25).
        let w = earth_rate_n(0.5);
        let f = ErrorDynamics::new(w).system_matrix();
        let expected = Matrix3::new(0.0, 0.0, -w.y, 0.0, 0.0, w.x, w.y, -w.x, 0.0);
        assert!((f - expected).amax() < 1e-20);
    }
}
