//! The test of a majorant in O(N): a Kalman filter with a negative process noise.
//!
//! 𝓖 ⪯ Δ is the same as "the measurements' covariance stays positive when Δ⁻¹ is taken off the
//! process noise" (`docs/certificate.md`, section 2). The covariance is positive if and only if
//! every innovation variance of the filter is. State: ψ^n (arcsec) and the trace's drift τ
//! (°/h), which moves ψ by −τ/√3 upwards and is an unknown of the test, not of the bound.

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};

use super::conditions::{Cells, Conditions};
use super::sampling::{Sharing, Variances};
use crate::attitude::{EAST, NORTH, UP};

/// Smallest innovation variance that counts as positive, relative to the noise.
const POSITIVE: f64 = 1e-6;
/// Largest phase of the Earth in a panel of the quadrature: leaves 1e-15.
const PANEL_PHASE: f64 = 0.02;

/// The filter over the cells, ready for any Δ.
#[derive(Debug, Clone)]
pub(super) struct Recursion {
    pub conditions: Conditions,
    pub cells: Cells,
    pub sharing: Sharing,
    /// f of each cell, (°/h)⁻² s⁻¹.
    pub profile: Vec<f64>,
    /// ∫ f over the test, (°/h)⁻².
    pub mass: f64,
    transition: Matrix3<f64>,
    /// What a unit drift of τ adds to ψ in a cell, arcsec per °/h.
    trace_step: Vector3<f64>,
    /// ∫ Φ e eᵀ Φᵀ over a cell for the three axes.
    noise: [Matrix3<f64>; 3],
}

impl Recursion {
    pub fn new(conditions: Conditions, cells: Cells, profile: Vec<f64>) -> Self {
        let mass = (0..cells.count)
            .map(|j| profile[j] * cells.inside_s(j))
            .sum();
        let dynamics = &conditions.dynamics;
        let down = Vector3::new(0.0, -(3.0_f64.sqrt().recip()), 0.0);
        Self {
            sharing: Sharing::new(&conditions, &cells),
            transition: dynamics.transition(cells.length_s),
            trace_step: dynamics.integral(cells.length_s) * down,
            noise: noise_integrals(&conditions, cells.length_s),
            conditions,
            cells,
            profile,
            mass,
        }
    }

    /// Whether 𝓖 ⪯ f(t) diag(δ) for every admissible set of measurement times, ψ^n and a drift of
    /// the trace with `trace_variance` unknown. δ is relative to f.
    pub fn holds(&self, delta: &[f64; 3], trace_variance: f64, kappa: f64) -> bool {
        let Some(grid_noise) = self.grid_noise(delta, kappa) else {
            return false;
        };
        let psd = self.conditions.drift_psd;
        let mut transition = Matrix4::identity();
        transition
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&self.transition);
        transition
            .fixed_view_mut::<3, 1>(0, 3)
            .copy_from(&self.trace_step);
        let psi = &self.conditions.prior_psi;
        // (a + δa)² ≥ a²/2 − δa²: half the variance is what the shared-out measurements see.
        let mut p =
            Matrix4::from_diagonal(&Vector4::new(psi.x, psi.y, psi.z, 0.5 * trace_variance));
        for (node, &noise) in grid_noise.iter().enumerate() {
            if node > 0 {
                p = transition * p * transition.transpose();
                let f = self.profile[node - 1];
                for (axis, integral) in self.noise.iter().enumerate() {
                    let rate = psd - (1.0 + kappa) / (delta[axis] * f);
                    let mut block = p.fixed_view_mut::<3, 3>(0, 0);
                    block += integral * rate;
                }
            } else if !self.cells.measures_at_start() {
                continue;
            }
            for (axis, variance) in in_order(noise) {
                if variance < f64::INFINITY && !observe(&mut p, axis, variance) {
                    return false;
                }
            }
        }
        true
    }

    /// Variances of the measurement at each grid point, the start included; none when sharing
    /// out costs more than there is.
    fn grid_noise(&self, delta: &[f64; 3], kappa: f64) -> Option<Vec<Variances>> {
        let mut noise = vec![Variances::NONE; self.cells.count + 1];
        for (j, f) in self.profile.iter().enumerate() {
            let inverse = delta.map(|d| (d * f).recip());
            let left = self
                .sharing
                .left_over(&self.conditions, &self.cells, &inverse, kappa);
            let variances = self.sharing.grid_noise(&self.cells, left)?;
            noise[j] = variances.least(noise[j]);
            noise[j + 1] = variances;
        }
        Some(noise)
    }

    /// An upper bound on the information on the trace, tᵀMt, that any admissible set of
    /// measurement times gives, (°/h)⁻²; infinite when none is found.
    pub fn trace_information(&self) -> f64 {
        // At a pole nothing turns the vertical drift to where the accelerometers see it.
        if self.conditions.omega_north == 0.0 && self.conditions.azimuth_variance.is_none() {
            return 0.0;
        }
        let shares = [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1];
        let mut least = f64::INFINITY;
        for kappa in shares {
            for share in shares {
                if let Some(information) = self.trace_information_with(kappa, share) {
                    least = least.min(information);
                }
            }
        }
        least
    }

    fn trace_information_with(&self, kappa: f64, share: f64) -> Option<f64> {
        let (conditions, cells) = (&self.conditions, &self.cells);
        let left = self
            .sharing
            .left_over_of_noise(conditions, cells, kappa, share);
        let noise = self.sharing.grid_noise(&self.cells, left)?;
        let psd = self.conditions.drift_psd * (1.0 - kappa);
        let step = Matrix3::identity() * (psd * self.cells.length_s);
        let mut p = Matrix3::from_diagonal(&self.conditions.prior_psi);
        let mut v = Vector3::zeros();
        let mut information = 0.0;
        for node in 0..=self.cells.count {
            if node > 0 {
                p = self.transition * p * self.transition.transpose() + step;
                v = self.transition * v + self.trace_step;
            } else if !self.cells.measures_at_start() {
                continue;
            }
            for (axis, variance) in in_order(noise) {
                if variance < f64::INFINITY {
                    let innovation = p[(axis, axis)] + variance;
                    let gain = p.column(axis) / innovation;
                    information += v[axis] * v[axis] / innovation;
                    v -= gain * v[axis];
                    p -= gain * gain.transpose() * innovation;
                    p = 0.5 * (p + p.transpose());
                }
            }
        }
        let bound = (1.0 + kappa) * information;
        let least = self
            .sharing
            .least_trace_information(conditions, cells, kappa, share);
        Some(bound.max(least))
    }
}

/// The scalar measurements at a grid point.
fn in_order(noise: Variances) -> [(usize, f64); 3] {
    [(NORTH, noise.level), (EAST, noise.level), (UP, noise.up)]
}

/// One scalar measurement; false when its innovation variance is not positive.
fn observe(p: &mut Matrix4<f64>, axis: usize, variance: f64) -> bool {
    let innovation = p[(axis, axis)] + variance;
    if innovation.is_nan() || innovation < POSITIVE * variance {
        return false;
    }
    let column = p.column(axis).into_owned();
    let gain = column / innovation;
    for i in 0..4 {
        for j in 0..=i {
            let value = p[(i, j)] - gain[i] * column[j];
            p[(i, j)] = value;
            p[(j, i)] = value;
        }
    }
    true
}

/// ∫₀ᴴ Φ e eᵀ Φᵀ ds for the three axes, by Gauss's rule of three points in panels.
fn noise_integrals(conditions: &Conditions, length: f64) -> [Matrix3<f64>; 3] {
    let panels = (conditions.omega * length / PANEL_PHASE).ceil().max(1.0);
    let width = length / panels;
    let offset = 0.6_f64.sqrt();
    let mut out = [Matrix3::zeros(); 3];
    for panel in 0..panels as usize {
        for (node, weight) in [(-offset, 5.0), (0.0, 8.0), (offset, 5.0)] {
            let time = width * (panel as f64 + 0.5 + 0.5 * node);
            let phi = conditions.dynamics.transition(time);
            for (axis, integral) in out.iter_mut().enumerate() {
                let column = phi.column(axis);
                *integral += column * column.transpose() * (weight * width / 18.0);
            }
        }
    }
    out
}

/// The isotropic test: as if all three axes were measured, as well as the best of them, and every
/// change of position might turn ψ^n. Nothing then depends on the attitude of n, and one channel
/// stands for three.
pub(super) fn isotropic_holds(recursion: &Recursion, delta: f64) -> bool {
    let (conditions, cells) = (&recursion.conditions, &recursion.cells);
    let psd = conditions.drift_psd;
    let left = |j: usize| {
        let weight = ((delta * recursion.profile[j]).recip() - psd).max(0.0);
        let spent = cells.per_cell * weight * cells.length_s / 4.0;
        (conditions.least_variance() - spent) / cells.per_cell
    };
    // The smallest of the three prior variances: starting from a larger one would leave
    // out information that there is.
    let mut p = conditions.prior_psi.min();
    for node in 0..=cells.count {
        if node > 0 {
            let rate = psd - (delta * recursion.profile[node - 1]).recip();
            p += rate * cells.length_s;
        } else if !cells.measures_at_start() {
            continue;
        }
        let before = if node > 0 {
            left(node - 1)
        } else {
            f64::INFINITY
        };
        let after = if node < cells.count {
            left(node)
        } else {
            f64::INFINITY
        };
        let variance = before.min(after);
        let innovation = p + variance;
        if variance.is_nan() || variance <= 0.0 || innovation < POSITIVE * variance {
            return false;
        }
        p -= p * p / innovation;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::PlatformConfig;

    #[test]
    fn the_noise_of_an_axis_is_what_the_earth_turns_it_to() {
        let platform = PlatformConfig::default().check().unwrap();
        let conditions = Conditions::new(&platform);
        for length in [0.01, 10.0, 700.0, 6000.0] {
            let found = noise_integrals(&conditions, length);
            const POINTS: usize = 20_000;
            for (axis, integral) in found.iter().enumerate() {
                let mut sum = Matrix3::zeros();
                for i in 0..POINTS {
                    let time = (i as f64 + 0.5) / POINTS as f64 * length;
                    let column = conditions
                        .dynamics
                        .transition(time)
                        .column(axis)
                        .into_owned();
                    sum += column * column.transpose() * (length / POINTS as f64);
                }
                assert!((integral - sum).amax() < 1e-8 * length, "{length} {axis}");
                // A rotation keeps lengths.
                assert!((integral.trace() / length - 1.0).abs() < 1e-12);
            }
        }
    }
}
