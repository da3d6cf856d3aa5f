//! From the schedule's own measurement times to a fixed grid: what it costs at most.
//!
//! A schedule measures at times at least one period apart, but each dwell starts its own count,
//! so the times are on no common grid. In the adjoint form of `docs/certificate.md`, section 3, a
//! measurement is a jump c of the co-state λ at its time; shared out linearly to the two ends of
//! its cell it leaves λ unchanged outside the cell, up to what the Earth turns meanwhile. The
//! numbers below bound that, relative to |c|, with a = ωH and b = ω_N H. Everything vertical
//! carries the factor b: a jump is horizontal and only ω_N turns it upwards.

use super::conditions::{Cells, Conditions};

/// Share of the measurement noise that a vertical part of a shared-out jump may cost.
const VERTICAL_SHARE: f64 = 1e-5;
/// Share of the measurement noise that the trace's integral may cost, relative to κ.
const TRACE_SHARE: f64 = 0.3;

/// Bounds on what sharing out a jump changes, relative to the jump.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sharing {
    /// ε: the correction d that makes λ equal outside the cell.
    correction: f64,
    /// ε_y: its vertical part.
    correction_up: f64,
    /// η: |e_y| inside the cell.
    inside_up: f64,
    /// z: |e| inside the cell but for the part without the Earth's rotation.
    inside_turn: f64,
    /// |∫ e_y| over the cell, s.
    integral_up: f64,
}

impl Sharing {
    pub fn new(conditions: &Conditions, cells: &Cells) -> Self {
        let length = cells.length_s;
        let (a, b) = (conditions.omega * length, conditions.omega_north * length);
        let correction = a * a / 8.0;
        let correction_up = b * (a / 8.0 + correction);
        Self {
            correction,
            correction_up,
            inside_up: 2.0 * b * (1.0 + correction) + correction_up,
            inside_turn: 2.0 * a + correction,
            integral_up: b * length * (1.0 / 8.0 + a / 3.0 + 0.5 * correction)
                + length * correction_up,
        }
    }

    /// Variance of a horizontal measurement at a grid point when `left` of r² is left.
    pub fn grid_noise(&self, cells: &Cells, left: f64) -> f64 {
        left / (cells.per_cell * ((1.0 + self.correction).powi(2) + VERTICAL_SHARE))
    }

    /// Variance of the vertical one, relative to the horizontal: next to infinite.
    pub fn vertical_noise_ratio(&self) -> f64 {
        VERTICAL_SHARE / self.correction_up.powi(2)
    }

    /// The largest variance of the trace, at most `wanted`, whose integral costs no more than
    /// its share of the measurement noise.
    pub fn trace_variance(
        &self,
        conditions: &Conditions,
        cells: &Cells,
        wanted: f64,
        kappa: f64,
    ) -> f64 {
        wanted.min(TRACE_SHARE * kappa * conditions.noise_variance / self.trace_cost(cells))
    }

    /// Smallest information on the trace for which its integral costs no more than `share` of
    /// the measurement noise.
    pub fn least_trace_information(
        &self,
        conditions: &Conditions,
        cells: &Cells,
        kappa: f64,
        share: f64,
    ) -> f64 {
        (1.0 + kappa.recip()) * self.trace_cost(cells) / (share * conditions.noise_variance)
    }

    /// (δ∫c·λ)² per Σ|c|²: the trace drifts by 1/√3 upwards.
    fn trace_cost(&self, cells: &Cells) -> f64 {
        self.integral_up.powi(2) * cells.measurements / 3.0
    }

    /// What is left of r² in a cell with inverse majorant `inverse` (x, y, z), when `kappa` of
    /// the latter pays for the cross terms. Not positive: nothing is left.
    pub fn left_over(
        &self,
        conditions: &Conditions,
        cells: &Cells,
        inverse: &[f64; 3],
        kappa: f64,
    ) -> f64 {
        let length = cells.length_s;
        let weight = inverse.map(|d| d - conditions.drift_psd);
        let ratio = [0, 1, 2].map(|i| weight[i] * weight[i] / inverse[i]);
        let (up, north) = (conditions.omega_up.powi(2), conditions.omega_north.powi(2));
        // The jump's own part has zero mean: it meets only the change of λ across the cell.
        let cube = length.powi(3) / 16.0;
        let swing_x = weight[0] * weight[0] * cube * up / inverse[2];
        let swing_z = weight[2] * weight[2] * cube * (up / inverse[0] + north / inverse[1]);
        let vertical = length * self.inside_up.powi(2);
        let cross = ratio[1] * vertical
            + swing_x.max(swing_z)
            + ratio[0].max(ratio[2]) * length * self.inside_turn.powi(2);
        let horizontal = weight[0].max(weight[2]).max(0.0);
        let square =
            weight[1].max(0.0) * vertical + horizontal * length * (0.5 + self.inside_turn).powi(2);
        let spent = cells.per_cell * (2.0 / kappa * cross + square);
        conditions.noise_variance * (1.0 - TRACE_SHARE * kappa) - spent
    }

    /// What is left of r² where the process noise itself, not a majorant, is the weight.
    pub fn left_over_of_noise(
        &self,
        conditions: &Conditions,
        cells: &Cells,
        kappa: f64,
        share: f64,
    ) -> f64 {
        let length = cells.length_s;
        let swing = (conditions.omega * length).powi(2) / 16.0;
        let cross = self.inside_up.powi(2) + self.inside_turn.powi(2) + swing;
        let spent = cells.per_cell * 2.0 / kappa * conditions.drift_psd * length * cross;
        conditions.noise_variance * (1.0 - share) - spent
    }
}
