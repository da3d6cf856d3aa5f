//! The dwell kernel: n filter periods composed into one element, in square-root form.
//!
//! Over a dwell the state is x = (ψ^n, ε^n), ε^n constant. As in the associative Kalman scan
//! (Särkkä & García-Fernández, *Temporal Parallelization of Bayesian Smoothers*, IEEE TAC 66(1),
//! 2021) n periods compose into one element (Φ̃, C̃, J): J is the information on the start state
//! from the dwell's measurements, and x_end given x_start and those measurements has mean
//! Φ̃ x_start + … and covariance C̃. Composition of elements 1 then 2:
//!
//! ```text
//! Φ̃ = Φ̃2 (I + C̃1 J2)⁻¹ Φ̃1,   C̃ = Φ̃2 (I + C̃1 J2)⁻¹ C̃1 Φ̃2ᵀ + C̃2,
//! J = J1 + Φ̃1ᵀ J2 (I + C̃1 J2)⁻¹ Φ̃1
//! ```
//!
//! so n periods cost O(log n) by doubling. The element depends on the duration and the noises
//! only, never on the position.
//!
//! # Square-root form
//!
//! We keep J = Wᵀ W and C̃ = U Uᵀ and compose the factors by QR (cf. Yaghoobi, Corenflos, Hassan
//! & Särkkä, *Parallel square-root statistical linear regression for inference in nonlinear state
//! space models*, 2022): the formulas with J itself need J_ψψ⁻¹, which does not exist for a dwell
//! of one period (ψ_y is not seen) nor at the poles (ω_N = 0 hides it for ever), and they form
//! the weak information on ε_y as a difference of large numbers. The factored form has neither
//! trouble; n = 0, 1, 2 and the poles are ordinary cases. ε^n carries no process noise, so C̃
//! lives on ψ alone (3×3).
//!
//! In W the columns are eliminated in the order ψ_x, ψ_z, ψ_y, ε_x, ε_z, ε_y: strongest first,
//! which grades the rows and keeps the weak ones accurate.

use nalgebra::{Matrix3, Matrix6, Matrix6x3, SMatrix, Vector3};

use super::real::Real;
use super::triangle::{add_roots, inverse, one_and, triangle};
use crate::attitude::{EAST, NORTH, UP};
use crate::dynamics::ErrorDynamics;

/// Elimination order of (ψ, ε): strongest first.
const ORDER: [usize; 6] = [NORTH, EAST, UP, 3 + NORTH, 3 + EAST, 3 + UP];

/// The element of n periods of a dwell, split over (ψ^n, ε^n).
///
/// The dwell's measurements tell as much about its start as six scalars with unit noise:
/// `r11 ψ + r12 ε` (three) and `r22 ε` (three). Given them, ψ at the end is
/// `a_psi ψ + a_epsilon ε` plus noise of covariance `c`. ψ in arcsec, ε in °/h.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kernel<T = f64> {
    /// Sensitivity of the first three scalars to ψ at the start, 1/arcsec.
    pub r11: Matrix3<T>,
    /// Sensitivity of the first three scalars to ε, 1/(°/h).
    pub r12: Matrix3<T>,
    /// Sensitivity of the last three scalars to ε, 1/(°/h).
    pub r22: Matrix3<T>,
    /// ψ at the end from ψ at the start, given the measurements.
    pub a_psi: Matrix3<T>,
    /// ψ at the end from ε, given the measurements, s.
    pub a_epsilon: Matrix3<T>,
    /// Covariance of ψ at the end given the start and the measurements, arcsec².
    pub c: Matrix3<T>,
    /// A root of it, arcsec.
    pub u: Matrix3<T>,
    /// How well the dwell alone tells ε_x, ε_y, ε_z − ω_N ψ_y: 1/σ, (°/h)⁻¹.
    pub channel_weights: Vector3<f64>,
}

/// The element in the factored form that composes: W (6×6), Φ̃ = [a_psi a_epsilon; 0 I], U.
#[derive(Debug, Clone, Copy)]
pub(super) struct Element<T: Real = f64> {
    w: Matrix6<T>,
    a_psi: Matrix3<T>,
    a_epsilon: Matrix3<T>,
    u: Matrix3<T>,
}

impl<T: Real> Element<T> {
    /// No time at all.
    pub(super) fn identity() -> Self {
        Self {
            w: Matrix6::zeros(),
            a_psi: Matrix3::identity(),
            a_epsilon: Matrix3::zeros(),
            u: Matrix3::zeros(),
        }
    }

    /// One period: propagate, then measure the components of ψ^n that have a noise variance,
    /// arcsec²: ψ_x and ψ_z (9), and the azimuth ψ_y where it is.
    pub(super) fn one_period(
        dynamics: &ErrorDynamics,
        period_s: f64,
        q: f64,
        measured: [Option<f64>; 3],
    ) -> Self {
        let [phi, gamma] = T::transition(dynamics, period_s);
        let process = T::from(q) * T::from(period_s);
        let mut w = Matrix6::zeros();
        // Given the measurement, the measured directions of the process noise shrink.
        let mut keep = Matrix3::identity();
        for (row, axis) in [NORTH, EAST, UP].into_iter().enumerate() {
            let Some(noise) = measured[axis].map(T::from) else {
                continue;
            };
            let innovation_sigma = (noise + process).sqrt();
            for j in 0..3 {
                w[(row, j)] = phi[(axis, j)] / innovation_sigma;
                w[(row, 3 + j)] = gamma[(axis, j)] / innovation_sigma;
            }
            keep[(axis, axis)] = noise / (noise + process);
        }
        Self {
            w,
            a_psi: keep * phi,
            a_epsilon: keep * gamma,
            u: (keep * process).map(T::sqrt),
        }
    }

    /// This element, then `next`.
    pub(super) fn then(&self, next: &Self) -> Self {
        // The next element's scalars seen from this one's start: W2 Φ̃1 x + W2 U1 ξ + noise.
        let w2_psi: Matrix6x3<T> = next.w.fixed_columns::<3>(0).into_owned();
        let seen_psi = w2_psi * self.a_psi;
        let seen_epsilon = w2_psi * self.a_epsilon + next.w.fixed_columns::<3>(3);
        let mut seen = Matrix6::zeros();
        seen.fixed_columns_mut::<3>(0).copy_from(&seen_psi);
        seen.fixed_columns_mut::<3>(3).copy_from(&seen_epsilon);
        // Whitening by I + (W2 U1)(W2 U1)ᵀ through its triangular factor.
        let through_noise = w2_psi * self.u;
        let whitened = inverse(&one_and(&through_noise.transpose())).transpose() * seen;
        // ξ given x and the next element's measurements: covariance (I + U1ᵀ J2 U1)⁻¹.
        let shrink = inverse(&one_and(&through_noise));
        let conditional = self.u * shrink;
        // (I + C̃1 J2)⁻¹ Φ̃1 = Φ̃1 − U1 (I + U1ᵀ J2 U1)⁻¹ U1ᵀ J2 Φ̃1.
        let gain = conditional * shrink.transpose() * through_noise.transpose();
        let start_psi = self.a_psi - gain * seen_psi;
        let start_epsilon = self.a_epsilon - gain * seen_epsilon;
        Self {
            w: stack_information(&self.w, &whitened),
            a_psi: next.a_psi * start_psi,
            a_epsilon: next.a_psi * start_epsilon + next.a_epsilon,
            u: add_roots(&(next.a_psi * conditional), &next.u),
        }
    }

    pub(super) fn split(&self) -> Kernel<T> {
        let block = |i: usize, j: usize| self.w.fixed_view::<3, 3>(i, j).into_owned();
        let (r11, r12, r22) = (block(0, 0), block(0, 3), block(3, 3));
        let doubles = |m: &Matrix3<T>| m.map(T::f64);
        Kernel {
            channel_weights: channel_weights(&doubles(&r11), &doubles(&r12), &doubles(&r22)),
            r11,
            r12,
            r22,
            a_psi: self.a_psi,
            a_epsilon: self.a_epsilon,
            c: self.u * self.u.transpose(),
            u: self.u,
        }
    }
}

/// W with WᵀW = W1ᵀW1 + W2ᵀW2: R of the stacked rows, eliminated in [`ORDER`].
fn stack_information<T: Real>(w1: &Matrix6<T>, w2: &Matrix6<T>) -> Matrix6<T> {
    let ordered = |w: &Matrix6<T>| Matrix6::from_fn(|i, j| w[(i, ORDER[j])]);
    let r = triangle(&[&ordered(w1), &ordered(w2)]);
    let mut w = Matrix6::zeros();
    for (from, to) in ORDER.into_iter().enumerate() {
        w.set_column(to, &r.column(from));
    }
    w
}

/// How well one dwell on its own, its start unknown, tells the channels of ε^n: 1/σ of each,
/// (°/h)⁻¹; zero where the dwell is too short, or at the poles, to tell it.
///
/// The dwell sees ψ_y only through η_z = ε_z − ω_N ψ_y (10), so the column of ψ_y is a multiple
/// of that of ε_z and is dropped; ψ_x and ψ_z are eliminated. In the R factor of the rest, in the
/// order (ε_x, η_z, ε_y), the first two channels are those of order 1, read with the order-2
/// channel known, and ε_y, of order 2, is read with everything else unknown.
fn channel_weights(r11: &Matrix3<f64>, r12: &Matrix3<f64>, r22: &Matrix3<f64>) -> Vector3<f64> {
    let mut stacked = SMatrix::<f64, 6, 5>::zeros();
    for (to, axis) in [NORTH, EAST].into_iter().enumerate() {
        stacked
            .fixed_view_mut::<3, 1>(0, to)
            .copy_from(&r11.column(axis));
    }
    for (to, axis) in [NORTH, EAST, UP].into_iter().enumerate() {
        stacked
            .fixed_view_mut::<3, 1>(0, 2 + to)
            .copy_from(&r12.column(axis));
        stacked
            .fixed_view_mut::<3, 1>(3, 2 + to)
            .copy_from(&r22.column(axis));
    }
    let r = stacked.qr().r();
    let (x, xz, z, y) = (r[(2, 2)].abs(), r[(2, 3)], r[(3, 3)].abs(), r[(4, 4)].abs());
    // Pivots of rounding size, relative to their column, are channels that are not seen.
    let column = |j: usize| r.column(j).norm();
    let seen = |pivot: f64, j: usize| if pivot > 1e-9 * column(j) { pivot } else { 0.0 };
    let (x, z, y) = (seen(x, 2), seen(z, 3), seen(y, 4));
    let mut weights = Vector3::zeros();
    // σ_x² = (1 + (xz/z)²)/x² for the 2×2 factor [x xz; 0 z].
    weights[NORTH] = if z > 0.0 {
        x / libm::hypot(xz / z, 1.0)
    } else {
        0.0
    };
    weights[EAST] = z;
    weights[UP] = y;
    weights
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::earth_rate_n;
    use crate::covariance::kernel_table::KernelTable;

    const Q: f64 = 1e-3;
    const R2: f64 = 4.254;

    fn table(latitude: f64) -> (KernelTable, ErrorDynamics) {
        let dynamics = ErrorDynamics::new(earth_rate_n(latitude));
        (KernelTable::new(dynamics, 10.0, Q, R2), dynamics)
    }

    type Matrix6 = SMatrix<f64, 6, 6>;

    /// The element by composing one period at a time with the textbook formulas on (Φ̃, C̃, J).
    fn textbook(dynamics: &ErrorDynamics, periods: usize) -> (Matrix6, Matrix6, Matrix6) {
        let mut phi1 = Matrix6::identity();
        phi1.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&dynamics.transition(10.0));
        phi1.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&dynamics.integral(10.0));
        let mut process = Matrix6::zeros();
        for i in 0..3 {
            process[(i, i)] = Q * 10.0;
        }
        let mut h = SMatrix::<f64, 2, 6>::zeros();
        h[(0, NORTH)] = 1.0;
        h[(1, EAST)] = 1.0;
        let s = (Q * 10.0 + R2).recip();
        let gain = process * h.transpose() * s;
        let step_phi = (Matrix6::identity() - gain * h) * phi1;
        let step_c = (Matrix6::identity() - gain * h) * process;
        let step_j = phi1.transpose() * h.transpose() * h * phi1 * s;
        let (mut phi, mut c, mut j) = (Matrix6::identity(), Matrix6::zeros(), Matrix6::zeros());
        for _ in 0..periods {
            let m = (Matrix6::identity() + c * step_j).try_inverse().unwrap();
            j += phi.transpose() * step_j * m * phi;
            c = step_phi * m * c * step_phi.transpose() + step_c;
            phi = step_phi * m * phi;
        }
        (phi, c, j)
    }

    #[test]
    fn doubling_in_square_roots_equals_the_textbook_recursion() {
        for latitude in [0.49, -1.1, std::f64::consts::FRAC_PI_2] {
            let (table, dynamics) = table(latitude);
            for periods in [1, 2, 3, 7, 33, 100, 121] {
                let k = table.kernel(periods);
                let (phi, c, j) = textbook(&dynamics, periods);
                let mut w = Matrix6::zeros();
                w.fixed_view_mut::<3, 3>(0, 0).copy_from(&k.r11);
                w.fixed_view_mut::<3, 3>(0, 3).copy_from(&k.r12);
                w.fixed_view_mut::<3, 3>(3, 3).copy_from(&k.r22);
                let j_error = (w.transpose() * w - j).amax() / j.amax();
                assert!(j_error < 1e-11, "J after {periods}: {j_error:e}");
                let c_error = (k.c - c.fixed_view::<3, 3>(0, 0)).amax() / c.amax();
                assert!(c_error < 1e-11, "C after {periods}: {c_error:e}");
                assert!((k.a_psi - phi.fixed_view::<3, 3>(0, 0)).amax() < 1e-11);
                let scale = phi.amax();
                assert!((k.a_epsilon - phi.fixed_view::<3, 3>(0, 3)).amax() < 1e-11 * scale);
            }
        }
    }

    #[test]
    fn a_failed_factorisation_is_seen() {
        // A kernel of numbers that are none ends in an error, not in a number.
        let spoilt = Element {
            w: Matrix6::repeat(f64::NAN),
            ..table(0.49).0.doublings.one_period
        };
        let kernel = table(0.49).0.doublings.one_period.then(&spoilt).split();
        let a = crate::drift::drift_matrix(&crate::attitude::Position::default().attitude());
        let rows = kernel.r22 * a;
        let information = rows.transpose() * rows;
        let prior = crate::drift::CoefficientVector::repeat(1.0);
        assert_eq!(
            crate::covariance::Rooted::of_information(&information, &prior),
            None
        );
    }

    #[test]
    fn a_dwell_without_a_period_is_nothing() {
        let k = table(0.49).0.kernel(0);
        assert_eq!(k.a_psi, Matrix3::identity());
        assert_eq!(k.r11, Matrix3::zeros());
        assert_eq!(k.c, Matrix3::zeros());
    }

    #[test]
    fn the_dwell_sees_psi_y_only_through_epsilon_z() {
        let (table, _) = table(0.49);
        let omega_n = earth_rate_n(0.49).x;
        let k = table.kernel(100);
        let mixed = k.r12.column(EAST) * -omega_n;
        assert!((k.r11.column(UP) - mixed).amax() < 1e-12 * mixed.amax());
    }

    #[test]
    fn channels_are_told_in_the_order_of_their_derivatives() {
        let (table, _) = table(0.49);
        // A slope needs two measurements, a second derivative three.
        assert_eq!(table.kernel(1).channel_weights, Vector3::zeros());
        let two = table.kernel(2).channel_weights;
        assert!(
            two[NORTH] > 0.0 && two[EAST] > 0.0 && two[UP] == 0.0,
            "{two}"
        );
        let long = table.kernel(100).channel_weights;
        assert!(long[NORTH] > 20.0 * long[UP] && long[UP] > 0.0, "{long}");
        // The line fitted through n points of noise r: σ² = 12 r²/(n³ T²) for large n.
        let quiet = KernelTable::new(ErrorDynamics::new(earth_rate_n(0.49)), 10.0, 0.0, R2);
        let line = 1.0 / (12.0 * R2 / (100.0_f64.powi(3) * 100.0)).sqrt();
        let found = quiet.kernel(100).channel_weights[NORTH];
        assert!((found / line - 1.0).abs() < 1e-3, "{found} for {line}");
    }

    /// By inverting the information matrix of one dwell, its start unknown.
    #[test]
    fn the_weight_of_a_channel_is_one_by_its_sigma() {
        for (latitude, periods) in [(0.49, 100), (1.3, 900)] {
            let (table, dynamics) = table(latitude);
            let j = textbook(&dynamics, periods).2;
            // ψ_x, ψ_z, ε_x, η_z; then ε_y too. ψ_y is part of η_z.
            let sigma = |unknown: &[usize], of: usize| {
                let n = unknown.len();
                let scale = |i: usize| j[(unknown[i], unknown[i])].sqrt();
                let scaled = nalgebra::DMatrix::from_fn(n, n, |a, b| {
                    j[(unknown[a], unknown[b])] / (scale(a) * scale(b))
                });
                let inverse = scaled.try_inverse().unwrap();
                inverse[(of, of)].sqrt() / scale(of)
            };
            let found = table.kernel(periods).channel_weights;
            let order_1 = [NORTH, EAST, 3 + NORTH, 3 + EAST];
            let order_2 = [NORTH, EAST, 3 + NORTH, 3 + EAST, 3 + UP];
            for (axis, sigma) in [
                (NORTH, sigma(&order_1, 2)),
                (EAST, sigma(&order_1, 3)),
                (UP, sigma(&order_2, 4)),
            ] {
                let ratio = found[axis] * sigma;
                assert!((ratio - 1.0).abs() < 1e-5, "{latitude} {axis}: {ratio}");
            }
        }
    }

    #[test]
    fn at_the_poles_the_vertical_channel_is_not_seen() {
        let (table, _) = table(std::f64::consts::FRAC_PI_2);
        let k = table.kernel(100).channel_weights;
        assert_eq!(k[UP], 0.0);
        assert!(k[NORTH] > 0.0 && k[EAST] > 0.0);
    }
}
