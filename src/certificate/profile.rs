//! The time profile f(t) of the majorant: what one channel alone would give.
//!
//! Without the Earth's rotation a channel is ẋ = u + w, white noise of PSD q on the rate and of
//! PSD ρ = r²·period on x. Its information operator on u is 𝓖 = (1/q)(1 − ω_c⁻² d²/dt²)⁻¹ with
//! ω_c² = q/ρ, zero at the end of the test and v(0) = ℓ v̇(0), ℓ = ρ/P(0), at its start. The kernel
//! of 𝓖 is not negative, so by Schur's test 𝓖 ⪯ diag(𝓖 1), and 𝓖 1 is in closed form. It is the
//! best diagonal majorant there is: its integral, ⟨1, 𝓖 1⟩, is what a constant u reaches.
//!
//! Here f is only a *shape*: that f(t)·diag(δ) majorises the coupled, sampled problem is for the
//! recursion of [`majorant`](super::majorant) to say. Where the azimuth is measured with another
//! noise than the level components, the channels have different shapes, and several common ones are
//! tried.

use super::conditions::{Cells, Conditions};
use crate::attitude::{EAST, NORTH, UP};

/// Smallest value relative to the largest: keeps the weights of the first and last cell moderate.
const FLOOR: f64 = 0.02;
/// Below this many time constants the test is a parabola in double precision.
const FEW_TIME_CONSTANTS: f64 = 1e-2;

/// Shapes worth trying for one test: that of the level components, and with an azimuth that of the
/// vertical one, those between them, and the constant 1/q.
pub(super) fn profiles(conditions: &Conditions, cells: &Cells) -> Vec<Vec<f64>> {
    /// Share of the vertical component in the noise of the shape between the two.
    const BETWEEN: [f64; 1] = [0.5];
    let mut shapes = vec![profile(conditions, cells)];
    let Some(azimuth) = conditions.azimuth_variance else {
        return shapes;
    };
    let [level, up] = [conditions.noise_variance, azimuth].map(libm::log);
    let prior = conditions.prior_psi.max();
    for share in BETWEEN {
        let noise = libm::exp(level + share * (up - level));
        shapes.push(of_channel(conditions, cells, noise, prior));
    }
    let prior = conditions.prior_psi[UP];
    shapes.push(of_channel(conditions, cells, azimuth, prior));
    if conditions.drift_psd > 0.0 {
        shapes.push(vec![conditions.drift_psd.recip(); cells.count]);
    }
    shapes
}

/// f of the level components at the middle of each cell, (°/h)⁻² s⁻¹.
pub(super) fn profile(conditions: &Conditions, cells: &Cells) -> Vec<f64> {
    let prior = conditions.prior_psi[NORTH].max(conditions.prior_psi[EAST]);
    of_channel(conditions, cells, conditions.noise_variance, prior)
}

/// f of the best measured component, where all count as measured like it.
pub(super) fn profile_of_the_best(conditions: &Conditions, cells: &Cells) -> Vec<f64> {
    if conditions.least_variance() == conditions.noise_variance {
        return profile(conditions, cells);
    }
    let prior = conditions.prior_psi.max();
    of_channel(conditions, cells, conditions.least_variance(), prior)
}

/// f of a channel that is measured with the variance `noise` and starts from the variance `prior`.
fn of_channel(conditions: &Conditions, cells: &Cells, noise: f64, prior: f64) -> Vec<f64> {
    let rho = noise * conditions.period_s;
    let end = cells.count as f64 * cells.length_s;
    let rate = (conditions.drift_psd / rho).sqrt();
    let shape = ClosedForm::new(conditions.drift_psd, rho, rate, rho / prior, end);
    let mut values: Vec<f64> = (0..cells.count)
        .map(|j| shape.at((j as f64 + 0.5) * cells.length_s))
        .collect();
    let floor = FLOOR * values.iter().copied().fold(0.0, f64::max);
    for v in &mut values {
        *v = v.max(floor);
    }
    values
}

/// 𝓖 1 in closed form.
enum ClosedForm {
    /// (1 + a e^{−ω_c t} + b e^{−ω_c (T − t)})/q.
    Exponential {
        psd: f64,
        rate: f64,
        a: f64,
        b: f64,
        end: f64,
    },
    /// Its limit for ω_c T → 0: (c₀ + c₁ t − t²/2)/ρ.
    Parabola { c0: f64, c1: f64, rho: f64 },
}

impl ClosedForm {
    fn new(psd: f64, rho: f64, rate: f64, start_length: f64, end: f64) -> Self {
        if rate * end < FEW_TIME_CONSTANTS {
            let c1 = 0.5 * end * end / (end + start_length);
            let c0 = 0.5 * end * end - c1 * end;
            return Self::Parabola { c0, c1, rho };
        }
        // With s = (1 − ℓω_c)/(1 + ℓω_c), so that ℓ = ∞ (ψ known at the start) is no exception.
        let share = (1.0 + start_length * rate).recip();
        let s = 2.0 * share - 1.0;
        let decay = libm::exp(-rate * end);
        let a = -(share - decay * s) / (1.0 - decay * decay * s);
        Self::Exponential {
            psd,
            rate,
            a,
            b: -1.0 - a * decay,
            end,
        }
    }

    fn at(&self, t: f64) -> f64 {
        match *self {
            Self::Exponential {
                psd,
                rate,
                a,
                b,
                end,
            } => (1.0 + a * libm::exp(-rate * t) + b * libm::exp(-rate * (end - t))) / psd,
            Self::Parabola { c0, c1, rho } => (c0 + t * (c1 - 0.5 * t)) / rho,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ⟨1, 𝓖 1⟩ of the discretised channel: the integral of 𝓖 1.
    fn dense(psd: f64, rho: f64, prior: f64, end: f64) -> Vec<f64> {
        let n = 400;
        let h = end / f64::from(n);
        let times = |i: i32| (f64::from(i) + 1.0) * h;
        let size = usize::try_from(n).unwrap();
        let covariance = nalgebra::DMatrix::from_fn(size, size, |i, j| {
            let (i, j) = (i32::try_from(i).unwrap(), i32::try_from(j).unwrap());
            let noise = if i == j { rho / h } else { 0.0 };
            prior + psd * times(i.min(j)) + noise
        });
        let ones = nalgebra::DVector::from_fn(size, |i, _| (i as f64 + 1.0) * h);
        let solved = covariance.lu().solve(&ones).unwrap();
        // (𝓖 1)(s) = Σ_{t ≥ s} solved(t).
        let mut sum = 0.0;
        let mut out: Vec<f64> = solved
            .iter()
            .rev()
            .map(|v| {
                sum += v;
                sum
            })
            .collect();
        out.reverse();
        out
    }

    #[test]
    fn closed_form_is_the_operator_applied_to_a_constant() {
        for (psd, prior) in [
            (1e-3, 1e5),
            (1e-3, 0.0),
            (1e-3, 30.0),
            (0.0, 1e5),
            (0.0, 3.0),
        ] {
            let (rho, end) = (42.5, 2000.0);
            let shape = ClosedForm::new(psd, rho, (psd / rho).sqrt(), rho / prior, end);
            let reference = dense(psd, rho, prior, end);
            let top = reference.iter().copied().fold(0.0, f64::max);
            for (i, value) in reference.iter().enumerate() {
                let t = (i as f64 + 0.5) * end / 400.0;
                assert!(
                    (shape.at(t) - value).abs() < 0.03 * top,
                    "{psd} {prior} {t}"
                );
            }
        }
    }

    #[test]
    fn the_two_forms_meet() {
        let (rho, end) = (42.5, 1000.0);
        let rate = 0.011 / end;
        let psd = rate * rate * rho;
        let exact = ClosedForm::new(psd, rho, rate, 1.0, end);
        let limit = ClosedForm::new(psd, rho, 0.0, 1.0, end);
        for t in [0.0, 300.0, 999.0] {
            assert!((exact.at(t) / limit.at(t) - 1.0).abs() < 1e-3);
        }
    }
}
