//! What the evaluator is measured against.

use nalgebra::{Matrix3, SMatrix};
use pulp::{Arch, Simd, WithSimd};
use scheme_opt::internals::attitude::Attitude;
use scheme_opt::internals::drift::drift_matrix;
use scheme_opt::internals::dynamics::ErrorDynamics;
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::Platform;
use scheme_opt::internals::units::ARCSEC_PER_RAD;

type Covariance = SMatrix<f64, 15, 15>;

/// tr P_D by the Kalman filter on the covariance of (ψ^n, D), one step per filter period: the
/// transition once per dwell, P ← Φ P Φᵀ + Q, then the two measurements one after the other. Only
/// for moves that take no time and dwells of whole periods.
pub fn covariance_trace(platform: &Platform, timeline: &Timeline) -> f64 {
    let dynamics = ErrorDynamics::new(platform.earth_rate_n());
    let period = platform.period_s();
    let q = platform.drift_psd_rad2_per_s() * ARCSEC_PER_RAD.powi(2) * period;
    let r = (platform.noise_g() * ARCSEC_PER_RAD).powi(2);
    let mut p = Covariance::zeros();
    for (i, sigma) in platform.prior_misalignment_rad().iter().enumerate() {
        p[(i, i)] = (sigma * ARCSEC_PER_RAD).powi(2);
    }
    for (i, sigma) in platform.prior_drift_rad_per_s().iter().enumerate() {
        p[(3 + i, 3 + i)] = (sigma * ARCSEC_PER_RAD).powi(2);
    }
    for leg in timeline.legs() {
        let phi = transition(&dynamics, &leg.attitude, period);
        let phi_t = phi.transpose();
        for _ in 0..(leg.dwell_s / period).round() as usize {
            p = phi * p * phi_t;
            for i in 0..3 {
                p[(i, i)] += q;
            }
            // ψ_x and ψ_z.
            for axis in [0, 2] {
                let column = p.column(axis).into_owned();
                let gain = column / (column[axis] + r);
                p -= gain * column.transpose();
            }
        }
    }
    p.diagonal().rows(3, 12).sum()
}

type Wandering = SMatrix<f64, 18, 18>;

/// The same with a random walk of the drift, K in °/h/√h, along the axes of the platform: (ψ^n, d, D).
/// The trace over the coefficients, D_F the drift at the end of the test.
pub fn wandering_trace(platform: &Platform, k: f64, timeline: &Timeline) -> f64 {
    let dynamics = ErrorDynamics::new(platform.earth_rate_n());
    let period = platform.period_s();
    let q = platform.drift_psd_rad2_per_s() * ARCSEC_PER_RAD.powi(2) * period;
    let grown = k * k * period / 3600.0;
    let r = (platform.noise_g() * ARCSEC_PER_RAD).powi(2);
    let mut p = Wandering::zeros();
    for (i, sigma) in platform.prior_misalignment_rad().iter().enumerate() {
        p[(i, i)] = (sigma * ARCSEC_PER_RAD).powi(2);
    }
    for (i, sigma) in platform.prior_drift_rad_per_s().iter().enumerate() {
        p[(6 + i, 6 + i)] = (sigma * ARCSEC_PER_RAD).powi(2);
    }
    for leg in timeline.legs() {
        let of_drift = transition(&dynamics, &leg.attitude, period);
        let mut phi = Wandering::identity();
        phi.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&of_drift.fixed_view::<3, 3>(0, 0));
        phi.fixed_view_mut::<3, 12>(0, 6)
            .copy_from(&of_drift.fixed_view::<3, 12>(0, 3));
        // d acts as D_F does.
        phi.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&of_drift.fixed_view::<3, 3>(0, 3));
        let phi_t = phi.transpose();
        for _ in 0..(leg.dwell_s / period).round() as usize {
            p = phi * p * phi_t;
            for i in 0..3 {
                p[(i, i)] += q;
                p[(3 + i, 3 + i)] += grown;
            }
            for axis in [0, 2] {
                let column = p.column(axis).into_owned();
                let gain = column / (column[axis] + r);
                p -= gain * column.transpose();
            }
        }
    }
    let constant = p.diagonal().rows(6, 12).sum();
    let at_end = |i: usize| 2.0 * p[(3 + i, 6 + i)] + p[(3 + i, 3 + i)];
    constant + (0..3).map(at_end).sum::<f64>()
}

fn transition(dynamics: &ErrorDynamics, attitude: &Attitude, period_s: f64) -> Covariance {
    let mut phi = Covariance::identity();
    let rotation: Matrix3<f64> = dynamics.transition(period_s);
    phi.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    let drift = dynamics.integral(period_s) * drift_matrix(attitude);
    phi.fixed_view_mut::<3, 12>(0, 3).copy_from(&drift);
    phi
}

/// Sums that run side by side: enough to hide the latency of an addition on two ports.
const SUMS: usize = 12;
/// Steps of each.
const STEPS: usize = 1000;
/// Fused multiply-adds per lane of one call of [`peak_fma`].
pub const PEAK_ITEMS: usize = SUMS * STEPS;

/// Lanes of the machine's registers.
pub fn lanes() -> usize {
    struct Width;
    impl WithSimd for Width {
        type Output = usize;
        fn with_simd<S: Simd>(self, _: S) -> usize {
            S::F64_LANES
        }
    }
    Arch::new().dispatch(Width)
}

/// Fused multiply-adds on registers alone.
pub fn peak_fma(x: f64) -> f64 {
    struct Sums(f64);
    impl WithSimd for Sums {
        type Output = f64;
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> f64 {
            let (a, b) = (simd.splat_f64s(self.0), simd.splat_f64s(1.0 - self.0));
            let mut sums = [a; SUMS];
            for _ in 0..STEPS {
                for sum in &mut sums {
                    *sum = simd.mul_add_e_f64s(*sum, b, a);
                }
            }
            let mut total = simd.splat_f64s(0.0);
            for sum in sums {
                total = simd.add_f64s(total, sum);
            }
            simd.reduce_sum_f64s(total)
        }
    }
    Arch::new().dispatch(Sums(x))
}
