//! Φ and B of an interval: Taylor series at a position, Runge–Kutta steps in a move.

use nalgebra::Vector3;

use super::instrument::Instrument;
use crate::covariance::real::{Dense, Real, convert, product, sum, times, zeros};
use crate::drift::COEFFICIENTS;
use crate::motion::Move;

/// F = −[ω ×].
fn system_matrix<T: Real>(earth_rate: &Vector3<f64>) -> Dense<T, 3, 3> {
    let f = -earth_rate.cross_matrix();
    convert(|i, j| f[(i, j)])
}

/// Φ and Γ by their Taylor series, in chunks short enough for it to converge fast.
pub(super) fn taylor_transition<T: Real>(
    earth_rate: &Vector3<f64>,
    length_s: f64,
) -> (Dense<T, 3, 3>, Dense<T, 3, 3>) {
    const LONGEST_S: f64 = 1000.0;
    let chunks = (length_s / LONGEST_S).ceil().max(1.0);
    let t = T::from(length_s) / T::from(chunks);
    let f = system_matrix(earth_rate);
    let (mut phi, mut gamma) = (zeros(), zeros());
    let mut term = super::identity();
    for k in 1..25 {
        let step = t / T::from(f64::from(k));
        phi = sum(phi, &term);
        gamma = sum(gamma, &times(term, step));
        term = times(product(&f, &term), step);
    }
    let (mut whole_phi, mut whole_gamma) = (super::identity(), zeros());
    for _ in 0..chunks as usize {
        whole_gamma = sum(product(&phi, &whole_gamma), &gamma);
        whole_phi = product(&phi, &whole_phi);
    }
    (whole_phi, whole_gamma)
}

/// B of an interval of a move by the classical Runge–Kutta method on dB/dt = F B + A(t). Its
/// error is far above rounding, so doubles will do.
pub(super) fn runge_kutta_integral(
    instrument: &Instrument,
    earth_rate: &Vector3<f64>,
    m: &Move,
    (start_s, length_s): (f64, f64),
) -> Dense<f64, 3, COEFFICIENTS> {
    /// Turn per step, rad (0.25°), and longest step, s: local error below 1e-9.
    const STEP_RAD: f64 = 0.0044;
    const STEP_S: f64 = 50.0;
    let turn = m.change.iter().map(|c| c.abs()).sum::<f64>() * length_s / m.duration_s;
    let steps = (turn / STEP_RAD).max(length_s / STEP_S).ceil().max(1.0);
    let h = length_s / steps;
    let f = system_matrix::<f64>(earth_rate);
    let a_at =
        |t: f64| instrument.drift_columns::<f64>(m.position_at((start_s + t) / m.duration_s));
    let mut b = zeros::<f64, 3, COEFFICIENTS>();
    let mut a0 = a_at(0.0);
    for step in 0..steps as usize {
        let t = step as f64 * h;
        let (a_mid, a1) = (a_at(t + 0.5 * h), a_at(t + h));
        let slope = |b, a: &_| sum(product(&f, &b), a);
        let k1 = slope(b, &a0);
        let k2 = slope(sum(b, &times(k1, 0.5 * h)), &a_mid);
        let k3 = slope(sum(b, &times(k2, 0.5 * h)), &a_mid);
        let k4 = slope(sum(b, &times(k3, h)), &a1);
        let between = times(sum(k2, &k3), 2.0);
        b = sum(b, &times(sum(sum(k1, &between), &k4), h / 6.0));
        a0 = a1;
    }
    b
}
