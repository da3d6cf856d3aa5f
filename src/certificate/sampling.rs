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
            let turned =
                VERTICAL_SHARE * cells.per_cell * level / ((1.0 + tau.recip()) * turned);
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
        let spent =
            |cross: f64, square: f64| cells.per_cell * (2.0 / kappa * cross + square);
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
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::attitude::UP;
    use crate::platform::PlatformConfig;

    /// Points of the quadrature over a cell.
    const POINTS: usize = 200;

    fn setting(latitude_deg: f64, period_s: f64) -> (Conditions, Cells) {
        let mut config = PlatformConfig::default();
        config.site.latitude_deg = latitude_deg;
        config.filter.period_s = period_s;
        let conditions = Conditions::new(&config.check().unwrap());
        let cells = Cells::new(&conditions, 12.0 * period_s).unwrap();
        (conditions, cells)
    }

    /// A unit jump at θ of the way through the cell, shared out by the rule of
    /// `docs/certificate.md`: the corrections d₀, d₁, and e over the cell.
    struct Shared {
        corrections: [Vector3<f64>; 2],
        error: Vec<Vector3<f64>>,
        /// e without the part that does not need the Earth's rotation.
        turn: Vec<Vector3<f64>>,
    }

    fn share(conditions: &Conditions, length: f64, jump: Vector3<f64>, theta: f64) -> Shared {
        let back = |t: f64| conditions.dynamics.transition(t).transpose();
        let time = theta * length;
        let first = back(time) * jump - jump * (1.0 - theta) - back(length) * jump * theta;
        let second = back(-length) * first;
        let (mut error, mut turn) = (Vec::new(), Vec::new());
        for i in 0..POINTS {
            let s = (i as f64 + 0.5) / POINTS as f64 * length;
            let mut e = -theta * (back(length - s) * (jump + second));
            let mut plain = -theta;
            if s < time {
                e += back(time - s) * jump;
                plain += 1.0;
            }
            error.push(e);
            turn.push(e - jump * plain);
        }
        Shared {
            corrections: [first, second],
            error,
            turn,
        }
    }

    /// Horizontal unit jumps at places all over the cell.
    fn jumps() -> impl Iterator<Item = (Vector3<f64>, f64)> {
        (0..12).flat_map(|i| {
            let (sin, cos) = (f64::from(i) * std::f64::consts::PI / 6.0).sin_cos();
            let places = (1..20).map(|k| 0.05 * f64::from(k));
            places.map(move |theta| (Vector3::new(cos, 0.0, sin), theta))
        })
    }

    fn settings() -> Vec<(Conditions, Cells)> {
        [
            (28.2, 10.0),
            (28.2, 1000.0),
            (-75.0, 600.0),
            (0.0, 300.0),
            (60.0, 100.0),
        ]
        .map(|(latitude, period)| setting(latitude, period))
        .into()
    }

    #[test]
    fn a_jump_shared_out_changes_no_more_than_its_bounds() {
        for (conditions, cells) in settings() {
            let length = cells.length_s;
            let bounds = Sharing::new(&conditions, &cells);
            let (mut largest, mut largest_up) = (0.0_f64, 0.0_f64);
            for (jump, theta) in jumps() {
                let shared = share(&conditions, length, jump, theta);
                for d in shared.corrections {
                    largest = largest.max(d.norm());
                    largest_up = largest_up.max(d[UP].abs());
                }
                let integral: Vector3<f64> = shared.error.iter().sum();
                let integral = integral[UP].abs() * length / POINTS as f64;
                assert!(integral <= bounds.integral_up);
                for (e, turn) in shared.error.iter().zip(&shared.turn) {
                    assert!(e[UP].abs() <= bounds.inside_up * (1.0 + 1e-9));
                    assert!(turn.norm() <= bounds.inside_turn);
                }
            }
            let slack = 1.0 + 1e-9;
            assert!(largest <= bounds.correction * slack && largest > 0.9 * bounds.correction);
            assert!(largest_up <= bounds.correction_up * slack);
            // Only the horizontal part of the Earth's rate turns a jump upwards, and of a jump
            // that it turns, the vertical part of the rate has its share.
            let up = conditions.omega_up / conditions.omega;
            assert!(largest_up >= 0.9 * up * bounds.correction_up);
        }
    }

    /// Section 3, (1): what λ_true = λ_grid + e costs with the weight N = Δ⁻¹ − q, beyond κ of
    /// ∫ λ_gridᵀ Δ⁻¹ λ_grid, is no more than what is taken off r².
    #[test]
    fn what_is_taken_off_the_noise_pays_for_sharing_out() {
        for (conditions, cells) in settings() {
            let bounds = Sharing::new(&conditions, &cells);
            let psd = conditions.drift_psd;
            for relative in [[1.05, 7.0, 1.05], [3.0, 3.0, 1.2], [1.0, 40.0, 2.0]] {
                for kappa in [1e-4, 1e-2, 0.3] {
                    let inverse = relative.map(|r| r * psd);
                    let left = bounds.left_over(&conditions, &cells, &inverse, kappa);
                    let kept = conditions.noise_variance * (1.0 - TRACE_SHARE * kappa);
                    let taken = (kept - left) / cells.per_cell;
                    let cost = Cost {
                        conditions: &conditions,
                        cells: &cells,
                        weight: inverse.map(|d| d - psd),
                        inverse,
                        kappa,
                    };
                    let worst = cost.worst(|s| cost.own(s) + cost.cross(s));
                    assert!(worst <= taken, "{relative:?} {kappa}: {worst} {taken}");
                }
            }
        }
    }

    /// The same where the process noise is the weight, for the bound on the trace.
    #[test]
    fn what_is_taken_off_the_noise_pays_for_the_bound_on_the_trace() {
        for (conditions, cells) in settings() {
            let bounds = Sharing::new(&conditions, &cells);
            let psd = [conditions.drift_psd; 3];
            for kappa in [1e-4, 1e-2, 0.3] {
                let left = bounds.left_over_of_noise(&conditions, &cells, kappa, 0.1);
                let taken = (conditions.noise_variance * 0.9 - left) / cells.per_cell;
                let cost = Cost {
                    conditions: &conditions,
                    cells: &cells,
                    weight: psd,
                    inverse: psd,
                    kappa,
                };
                let worst = cost.worst(|s| cost.cross(s));
                assert!(worst <= taken, "{kappa}: {worst} {taken}");
            }
        }
    }

    /// The trace's integral a = ∫ cᵀλ changes by at most δ; σ²δ² is paid for by its share of the
    /// noise, and by the smallest information in the bound on the trace.
    #[test]
    fn the_integral_of_the_trace_is_paid_for() {
        for (conditions, cells) in settings() {
            let bounds = Sharing::new(&conditions, &cells);
            let largest = jumps()
                .map(|(jump, theta)| {
                    let shared = share(&conditions, cells.length_s, jump, theta);
                    let integral: Vector3<f64> = shared.error.iter().sum();
                    integral[UP].abs() * cells.length_s / POINTS as f64
                })
                .fold(0.0, f64::max);
            // (Σ |c_k| δ/√3)² ≤ n Σ|c_k|² δ²/3, the worst being equal jumps.
            let cost = largest * largest / 3.0 * cells.measurements;
            for kappa in [1e-4, 1e-2] {
                let paid = TRACE_SHARE * kappa * conditions.noise_variance;
                let granted = bounds.trace_variance(&conditions, &cells, 1e30, kappa);
                assert!(granted * cost <= paid && granted * cost > 1e-2 * paid);
                let wanted = 0.5 * granted;
                assert_eq!(
                    bounds.trace_variance(&conditions, &cells, wanted, kappa),
                    wanted
                );
                // (a + δ)² ≤ (1 + κ) a² + (1 + 1/κ) δ².
                for share in [1e-3, 0.1] {
                    let least = bounds.least_trace_information(&conditions, &cells, kappa, share);
                    let exact = (1.0 + 1.0 / kappa) * cost / (share * conditions.noise_variance);
                    assert!(least >= exact && least < 100.0 * exact);
                }
            }
        }
    }

    /// What sharing out costs with the weights N and W, both diagonal.
    struct Cost<'a> {
        conditions: &'a Conditions,
        cells: &'a Cells,
        weight: [f64; 3],
        inverse: [f64; 3],
        kappa: f64,
    }

    impl Cost<'_> {
        fn step(&self) -> f64 {
            self.cells.length_s / POINTS as f64
        }

        /// ∫ eᵀNe, where it costs.
        fn own(&self, shared: &Shared) -> f64 {
            let square = |e: &Vector3<f64>| {
                let terms = e.iter().zip(&self.weight);
                terms.map(|(e, w)| e * e * w.max(0.0)).sum::<f64>()
            };
            shared.error.iter().map(square).sum::<f64>() * self.step()
        }

        /// The largest 2 ∫ λᵀNe − κ ∫ λᵀWλ over the λ that a grid can have inside a cell: a
        /// constant that the Earth turns, of any direction and size.
        fn cross(&self, shared: &Shared) -> f64 {
            let step = self.step();
            let n = nalgebra::Matrix3::from_diagonal(&Vector3::from(self.weight));
            let w = nalgebra::Matrix3::from_diagonal(&Vector3::from(self.inverse));
            let mut linear = Vector3::zeros();
            let mut square = nalgebra::Matrix3::zeros();
            for (i, e) in shared.error.iter().enumerate() {
                let time = -(i as f64 + 0.5) * step;
                let phi = self.conditions.dynamics.transition(time);
                linear += phi * n * e * step;
                square += phi * w * phi.transpose() * step;
            }
            linear.dot(&(square.try_inverse().unwrap() * linear)) / self.kappa
        }

        /// The worst of a cost over all jumps.
        fn worst(&self, cost: impl Fn(&Shared) -> f64) -> f64 {
            let length = self.cells.length_s;
            let shared = jumps().map(|(jump, theta)| share(self.conditions, length, jump, theta));
            shared.map(|s| cost(&s)).fold(0.0, f64::max)
        }
    }
}
