//! Φ and B of an interval: Taylor series at a position, Runge–Kutta steps in a move.

use nalgebra::Vector3;

use super::instrument::{Drive, Instrument, Terms};
use crate::covariance::real::{Dense, Real, convert, identity, product, sum, times, zeros};
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
    let mut term = identity();
    for k in 1..25 {
        let step = t / T::from(f64::from(k));
        phi = sum(phi, &term);
        gamma = sum(gamma, &times(term, step));
        term = times(product(&f, &term), step);
    }
    let (mut whole_phi, mut whole_gamma) = (identity(), zeros());
    for _ in 0..chunks as usize {
        whole_gamma = sum(product(&phi, &whole_gamma), &gamma);
        whole_phi = product(&phi, &whole_phi);
    }
    (whole_phi, whole_gamma)
}

/// How much of a move is done at the share `x` of its duration, and the gimbals' rate there, in units of
/// the mean rate: the area under the trapezoid that the rate is, a triangle, a rectangle, a triangle.
pub(super) fn way_done(m: &Move, x: f64) -> (f64, f64) {
    let ramp = m.ramp();
    if ramp == 0.0 {
        return (x, 1.0);
    }
    let highest = 1.0 / (1.0 - ramp);
    let [rising, falling] = [x.min(ramp), (1.0 - x).min(ramp)].map(|of| of / ramp);
    let level = (x - ramp).clamp(0.0, 1.0 - 2.0 * ramp);
    let area = ramp * rising * rising + 2.0 * level + ramp * (1.0 - falling * falling);
    (0.5 * highest * area, highest * rising.min(falling))
}

/// Where the intervals begin and end into which the corners of that trapezoid cut one, shares of the
/// duration.
pub(super) fn cut_at_corners(m: &Move, (start, length): (f64, f64)) -> Vec<(f64, f64)> {
    let end = start + length;
    let mut all = vec![start];
    let corners = [m.ramp(), 1.0 - m.ramp()];
    all.extend(corners.into_iter().filter(|x| *x > start && *x < end));
    all.push(end);
    all.dedup();
    all.windows(2)
        .map(|pair| (pair[0], pair[1] - pair[0]))
        .collect()
}

/// B of an interval of a move by the classical Runge–Kutta method on
/// dB = (F B + A(a)) dt + A(ω_nc^c) ds, s the way: what the gimbals' motion does to the torquers
/// depends on the way alone, and is there when a move takes no time. Its error is far above rounding,
/// so doubles will do.
pub(super) fn runge_kutta_integral(
    instrument: &Instrument,
    terms: &Terms<f64>,
    earth_rate: &Vector3<f64>,
    m: &Move,
    // Where the interval starts and how long it is, as shares of the move's duration; no corner of the
    // rate inside it.
    (start, length): (f64, f64),
) -> Drive<f64> {
    /// Turn per step, rad (0.25°), and longest step, s: local error below 1e-9.
    const STEP_RAD: f64 = 0.0044;
    const STEP_S: f64 = 50.0;
    let duration_s = m.duration_s;
    let speed = way_done(m, start).1.max(way_done(m, start + length).1);
    let turn = m.change.iter().map(|c| c.abs()).sum::<f64>() * length * speed;
    let steps = (turn / STEP_RAD).max(duration_s * length / STEP_S);
    let steps = steps.ceil().max(1.0);
    let h = length / steps;
    let f = times(system_matrix::<f64>(earth_rate), duration_s);
    let slope_at = |s: f64| {
        let (done, speed) = way_done(m, start + s);
        let position = m.position_after(done);
        let attitude = instrument.attitude::<f64>(position);
        let gimbals = instrument.gimbal_rate(position.exact(), m.change.map(|c| c * speed));
        let rate: [f64; 3] = std::array::from_fn(|i| {
            let earth: f64 = (0..3).map(|k| attitude[k][i] * earth_rate[k]).sum();
            earth * duration_s + gimbals[i]
        });
        terms.drift(&instrument.axes, &attitude, &rate, duration_s)
    };
    let mut a0 = slope_at(0.0);
    let mut b: Drive<f64> = std::array::from_fn(|i| vec![0.0; a0[i].len()]);
    for step in 0..steps as usize {
        let s = step as f64 * h;
        let (a_mid, a1) = (slope_at(s + 0.5 * h), slope_at(s + h));
        let slope = |b: &Drive<f64>, a: &Drive<f64>| combined(&driven(&f, b), a, 1.0);
        let k1 = slope(&b, &a0);
        let k2 = slope(&combined(&b, &k1, 0.5 * h), &a_mid);
        let k3 = slope(&combined(&b, &k2, 0.5 * h), &a_mid);
        let k4 = slope(&combined(&b, &k3, h), &a1);
        let between = combined(&k2, &k3, 1.0);
        let ends = combined(&k1, &k4, 1.0);
        b = combined(&b, &combined(&ends, &between, 2.0), h / 6.0);
        a0 = a1;
    }
    b
}

/// F B.
fn driven(f: &Dense<f64, 3, 3>, b: &Drive<f64>) -> Drive<f64> {
    f.map(|row| {
        let of = |j: usize| row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j];
        (0..b[0].len()).map(of).collect()
    })
}

/// a + times b.
fn combined(a: &Drive<f64>, b: &Drive<f64>, times: f64) -> Drive<f64> {
    std::array::from_fn(|i| {
        let both = a[i].iter().zip(&b[i]);
        both.map(|(a, b)| a + times * b).collect()
    })
}

/// 1 − e^{−x}, x = `rate` · `length_s` not negative, by its series and y(2x) = y (2 − y).
pub(super) fn decayed<T: Real>(rate: f64, length_s: f64) -> T {
    /// 2⁻²⁴/24! is below 1e-30, and the next far below 1e-34.
    const TERMS: u32 = 30;
    let exponent = rate * length_s;
    let halvings = (libm::log2(exponent.max(f64::MIN_POSITIVE)) + 1.0)
        .ceil()
        .max(0.0);
    let x = T::from(exponent) / T::from(libm::pow(2.0, halvings));
    let (mut y, mut term) = (T::from(0.0), x);
    for k in 2..TERMS {
        y += term;
        term = -(term * x) / T::from(f64::from(k));
    }
    for _ in 0..halvings as usize {
        y = y * (T::from(2.0) - y);
    }
    y
}

/// e^{−x}.
pub(super) fn decay<T: Real>(rate: f64, length_s: f64) -> T {
    T::from(1.0) - decayed::<T>(rate, length_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::covariance::real::Extended;

    #[test]
    fn decays_are_exponential() {
        for x in [0.0, 1e-12, 0.3, 1.0, 7.9] {
            let found = decayed::<f64>(x, 1.0);
            assert!((found + (-x).exp_m1()).abs() <= 4e-16 * found, "{x}");
            // e^{−x} e^{−2x} = e^{−3x}.
            let kept = |times: f64| decay::<Extended>(x, times);
            let error = kept(1.0) * kept(2.0) - kept(3.0);
            // The exponents are those of doubles.
            assert!(error.f64().abs() < 1e-15, "{x}: {:e}", error.f64());
        }
        let twice = decay::<Extended>(0.375, 1.0) * decay::<Extended>(0.375, 1.0);
        assert!((twice - decay::<Extended>(0.75, 1.0)).f64().abs() < 1e-31);
    }
}
