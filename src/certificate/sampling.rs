//! From the schedule's own measurement times to a fixed grid: what it costs at most.
//!
//! A schedule measures at times at least one period apart, but each dwell starts its own count,
//! so the times are on no common grid. In the adjoint form of `docs/certificate.md`, section 3, a
//! measurement is a jump c of the co-state λ at its time; shared out linearly to the two ends of
//! its cell it leaves λ unchanged outside the cell, up to what the Earth turns meanwhile. The
//! numbers below bound that, relative to |c|, with a = ωH and b = ω_N H. Everything vertical
//! carries the factor b: a jump is horizontal and only ω_N turns it upwards.
//!
//! Where the azimuth is measured as well, a jump has a vertical part of its own, at a price of its
//! own. What it turns to the level carries the factor b like what a level one turns upwards, and
//! what it loses of itself b². The two kinds of jump meet in squares of sums, which are shared out
//! to them: (x + y)² ≤ (1 + τ) x² + (1 + 1/τ) y² for any τ > 0.

use super::conditions::{Cells, Conditions};

/// Share of the measurement noise that a vertical part of a shared-out jump may cost.
const VERTICAL_SHARE: f64 = 1e-5;
/// Share of the measurement noise that the trace's integral may cost, relative to κ.
const TRACE_SHARE: f64 = 0.3;

/// τ where what a jump is itself meets what the Earth turned of the other kind.
const MEETING: f64 = 0.01;
/// Values of τ that are tried for the measurements on the grid.
const MEETINGS: [f64; 5] = [1e-6, 1e-4, 1e-2, 0.3, 10.0];
/// Share of the azimuth's noise that the level part of a shared-out vertical jump may cost.
const LEVEL_SHARE: f64 = 1e-4;

/// A variance of measurements: of each level component of ψ^n, and of the vertical one, which is
/// infinite where that is not measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Variances {
    pub level: f64,
    pub up: f64,
}

impl Variances {
    /// Nothing is measured.
    pub const NONE: Self = Self {
        level: f64::INFINITY,
        up: f64::INFINITY,
    };

    /// The smaller of the two, one by one.
    pub fn least(self, other: Self) -> Self {
        Self {
            level: self.level.min(other.level),
            up: self.up.min(other.up),
        }
    }

    /// What is left where all of both is positive.
    fn positive(self) -> Option<Self> {
        (self.level > 0.0 && self.up > 0.0).then_some(self)
    }
}

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
    /// ζ_y: |e_y| of a vertical jump, but for the part without the Earth's rotation.
    vertical_turn: f64,
    /// |∫ e_y| of a vertical jump over the cell, s.
    vertical_integral: f64,
}

impl Sharing {
    pub fn new(conditions: &Conditions, cells: &Cells) -> Self {
        let length = cells.length_s;
        let (a, b) = (conditions.omega * length, conditions.omega_north * length);
        let correction = a * a / 8.0;
        let correction_up = b * (a / 8.0 + correction);
        // R_yy − 1 is at most b²/2, twice; the correction's own part b²/8, its level part turned.
        let vertical_turn = b * b * (1.0 + 1.0 / 8.0) + b * correction_up;
        Self {
            vertical_turn,
            vertical_integral: length * vertical_turn,
            correction,
            correction_up,
            inside_up: 2.0 * b * (1.0 + correction) + correction_up,
            inside_turn: 2.0 * a + correction,
            integral_up: b * length * (1.0 / 8.0 + a / 3.0 + 0.5 * correction)
                + length * correction_up,
        }
    }

    /// Variances of a measurement at a grid point when `left` of those of the schedule's own is left;
    /// none where nothing is.
    pub fn grid_noise(&self, cells: &Cells, left: Variances) -> Option<Variances> {
        if left.up == f64::INFINITY {
            let level =
                left.level / (cells.per_cell * ((1.0 + self.correction).powi(2) + VERTICAL_SHARE));
            // The vertical one: next to infinite.
            let up = level * (VERTICAL_SHARE / self.correction_up.powi(2));
            return Variances { level, up }.positive();
        }
        let left = left.positive()?;
        let of_one = cells.per_cell * (1.0 + self.correction).powi(2);
        // x_h = c_h + d_h with |d_h| ≤ ε|c_h| + ε_y|c_y|, x_y alike. The level variance first: what
        // a vertical jump turns to the level is paid for by a share of the azimuth's noise.
        let turned = cells.per_cell * self.correction_up.powi(2);
        let level = MEETINGS.map(|tau| {
            let own = left.level / ((1.0 + tau) * of_one + VERTICAL_SHARE * cells.per_cell);
            let turned = LEVEL_SHARE * left.up / ((1.0 + tau.recip()) * turned);
            own.min(turned)
        });
        let level = level.into_iter().fold(0.0, f64::max);
        // Then the vertical one: what a level jump turns upwards is paid for by a share of r².
        let up = MEETINGS.map(|tau| {
            let own = (1.0 - LEVEL_SHARE) * left.up / ((1.0 + tau) * of_one);
            let turned = VERTICAL_SHARE * cells.per_cell * level / ((1.0 + tau.recip()) * turned);
            own.min(turned)
        });
        let up = up.into_iter().fold(0.0, f64::max);
        Variances { level, up }.positive()
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
        let share = TRACE_SHARE * kappa;
        let level = share * conditions.noise_variance / self.trace_cost(conditions, cells);
        let up = conditions.azimuth_variance.map(|azimuth| {
            let cost = self.vertical_trace_cost(cells);
            share * azimuth / cost
        });
        wanted.min(level).min(up.unwrap_or(f64::INFINITY))
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
        let level = (1.0 + kappa.recip()) * self.trace_cost(conditions, cells)
            / (share * conditions.noise_variance);
        let up = conditions.azimuth_variance.map(|azimuth| {
            let cost = self.vertical_trace_cost(cells);
            (1.0 + kappa.recip()) * cost / (share * azimuth)
        });
        level.max(up.unwrap_or(0.0))
    }

    /// (δ∫c·λ)² per Σ|c|² of level jumps: the trace drifts by 1/√3 upwards.
    fn trace_cost(&self, conditions: &Conditions, cells: &Cells) -> f64 {
        let alone = self.integral_up.powi(2) * cells.measurements / 3.0;
        match conditions.azimuth_variance {
            None => alone,
            // (x + y)² ≤ 2x² + 2y², x of the level and y of the vertical jumps.
            Some(_) => 2.0 * alone,
        }
    }

    /// The same of vertical jumps.
    fn vertical_trace_cost(&self, cells: &Cells) -> f64 {
        2.0 * self.vertical_integral.powi(2) * cells.measurements / 3.0
    }

    /// What is left of the noise in a cell with inverse majorant `inverse` (x, y, z), when `kappa`
    /// of the latter pays for the cross terms. Not positive: nothing is left.
    pub fn left_over(
        &self,
        conditions: &Conditions,
        cells: &Cells,
        inverse: &[f64; 3],
        kappa: f64,
    ) -> Variances {
        let length = cells.length_s;
        let weight = inverse.map(|d| d - conditions.drift_psd);
        let ratio = [0, 1, 2].map(|i| weight[i] * weight[i] / inverse[i]);
        let (up, north) = (conditions.omega_up.powi(2), conditions.omega_north.powi(2));
        // The jump's own part has zero mean: it meets only the change of λ across the cell.
        let cube = length.powi(3) / 16.0;
        let swing_x = weight[0] * weight[0] * cube * up / inverse[2];
        let swing_z = weight[2] * weight[2] * cube * (up / inverse[0] + north / inverse[1]);
        let vertical = length * self.inside_up.powi(2);
        let level_turn = ratio[0].max(ratio[2]) * length * self.inside_turn.powi(2);
        let horizontal = weight[0].max(weight[2]).max(0.0);
        let own = horizontal * length * (0.5 + self.inside_turn).powi(2);
        let kept = 1.0 - TRACE_SHARE * kappa;
        let Some(azimuth) = conditions.azimuth_variance else {
            let cross = ratio[1] * vertical + swing_x.max(swing_z) + level_turn;
            let square = weight[1].max(0.0) * vertical + own;
            let spent = cells.per_cell * (2.0 / kappa * cross + square);
            return Variances {
                level: conditions.noise_variance * kept - spent,
                up: f64::INFINITY,
            };
        };
        // Both kinds of jump meet the same λ: (x + y)² ≤ 2x² + 2y², but for the level part of λ's
        // change that only a jump about East meets.
        let swing_y = weight[1] * weight[1] * cube * north / inverse[2];
        let cross_level =
            2.0 * ratio[1] * vertical + (2.0 * swing_x).max(swing_z) + 2.0 * level_turn;
        let cross_up = 2.0 * ratio[1] * length * self.vertical_turn.powi(2)
            + 2.0 * swing_y
            + 2.0 * ratio[0].max(ratio[2]) * vertical;
        let vertical_own = weight[1].max(0.0) * length * (0.5 + self.vertical_turn).powi(2);
        let (own_share, turned_share) = (1.0 + MEETING, 1.0 + MEETING.recip());
        let square_level = own_share * own + turned_share * weight[1].max(0.0) * vertical;
        let square_up = own_share * vertical_own + turned_share * horizontal * vertical;
        let spent = |cross: f64, square: f64| cells.per_cell * (2.0 / kappa * cross + square);
        Variances {
            level: conditions.noise_variance * kept - spent(cross_level, square_level),
            up: azimuth * kept - spent(cross_up, square_up),
        }
    }

    /// What is left of the noise where the process noise itself, not a majorant, is the weight.
    pub fn left_over_of_noise(
        &self,
        conditions: &Conditions,
        cells: &Cells,
        kappa: f64,
        share: f64,
    ) -> Variances {
        let length = cells.length_s;
        let swing = (conditions.omega * length).powi(2) / 16.0;
        let (up, turn) = (self.inside_up.powi(2), self.inside_turn.powi(2));
        let spent =
            |cross: f64| cells.per_cell * 2.0 / kappa * conditions.drift_psd * length * cross;
        let kept = |noise: f64, cross: f64| noise * (1.0 - share) - spent(cross);
        match conditions.azimuth_variance {
            None => Variances {
                level: kept(conditions.noise_variance, up + turn + swing),
                up: f64::INFINITY,
            },
            Some(azimuth) => {
                let vertical_turn = self.vertical_turn.powi(2);
                Variances {
                    level: kept(conditions.noise_variance, 2.0 * (up + turn) + swing),
                    up: kept(azimuth, 2.0 * (vertical_turn + up) + swing),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
