//! What sharing out a jump changes and costs, against the jump shared out.

use nalgebra::Vector3;

use super::*;
use crate::attitude::UP;
use crate::platform::PlatformConfig;

/// Points of the quadrature over a cell.
const POINTS: usize = 200;

fn setting(latitude_deg: f64, period_s: f64, azimuth_arcsec: Option<f64>) -> (Conditions, Cells) {
    let mut config = PlatformConfig::default();
    config.site.latitude_deg = latitude_deg;
    config.filter.period_s = period_s;
    config.azimuth.noise_arcsec = azimuth_arcsec;
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
        places().map(move |theta| (Vector3::new(cos, 0.0, sin), theta))
    })
}

fn places() -> impl Iterator<Item = f64> {
    (1..20).map(|k| 0.05 * f64::from(k))
}

const SITES: [(f64, f64); 5] = [
    (28.2, 10.0),
    (28.2, 1000.0),
    (-75.0, 600.0),
    (0.0, 300.0),
    (60.0, 100.0),
];

fn settings() -> Vec<(Conditions, Cells)> {
    SITES
        .map(|(latitude, period)| setting(latitude, period, None))
        .into()
}

/// With an azimuth about as good as the accelerometers, better and worse.
fn settings_with_azimuth() -> impl Iterator<Item = (Conditions, Cells)> {
    SITES.into_iter().flat_map(|(latitude, period)| {
        [0.03, 2.0, 5.0, 300.0].map(|noise| setting(latitude, period, Some(noise)))
    })
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
                let left = bounds.left_over(&conditions, &cells, &inverse, kappa).level;
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
            let left = bounds
                .left_over_of_noise(&conditions, &cells, kappa, 0.1)
                .level;
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

#[test]
fn a_vertical_jump_shared_out_changes_no_more_than_its_bounds() {
    let slack = 1.0 + 1e-9;
    for (conditions, cells) in settings_with_azimuth() {
        let length = cells.length_s;
        let bounds = Sharing::new(&conditions, &cells);
        let (mut level, mut turned) = (0.0_f64, 0.0_f64);
        for theta in places() {
            let shared = share(&conditions, length, Vector3::y(), theta);
            for d in shared.corrections {
                assert!(d.norm() <= bounds.correction * slack);
                level = level.max(d.x.hypot(d.z));
            }
            let integral: Vector3<f64> = shared.error.iter().sum();
            let integral = integral[UP].abs() * length / POINTS as f64;
            assert!(integral <= bounds.vertical_integral * slack);
            for (e, turn) in shared.error.iter().zip(&shared.turn) {
                assert!(e.x.hypot(e.z) <= bounds.inside_up * slack);
                turned = turned.max(turn[UP].abs());
            }
        }
        assert!(level <= bounds.correction_up * slack);
        assert!(turned <= bounds.vertical_turn && turned > 0.05 * bounds.vertical_turn);
    }
}

/// Jumps of any direction, level and vertical parts of very different size among them.
fn slanting_jumps() -> impl Iterator<Item = (Vector3<f64>, f64)> {
    jumps().step_by(3).flat_map(|(level, theta)| {
        let tilts = [-30.0, -1.0, -0.02, 0.003, 0.4, 4.0, 1e3];
        tilts.map(move |up| (level + Vector3::y() * up, theta))
    })
}

/// Σ of a variance times the square of a jump.
fn price(of: Variances, jump: &Vector3<f64>) -> f64 {
    of.level * (jump.x * jump.x + jump.z * jump.z) + of.up * jump.y * jump.y
}

/// Section 3 with an azimuth: level and vertical jumps together.
#[test]
fn what_is_taken_off_the_noises_pays_for_sharing_out() {
    for (conditions, cells) in settings_with_azimuth() {
        let bounds = Sharing::new(&conditions, &cells);
        let psd = conditions.drift_psd;
        let azimuth = conditions.azimuth_variance.unwrap();
        let mut cases = Vec::new();
        for kappa in [1e-4, 1e-2, 0.3] {
            for relative in [[1.05, 7.0, 1.05], [3.0, 1.3, 1.2], [1.0, 1.0, 2.0]] {
                let inverse = relative.map(|r| r * psd);
                let left = bounds.left_over(&conditions, &cells, &inverse, kappa);
                let kept = 1.0 - TRACE_SHARE * kappa;
                cases.push((inverse.map(|d| d - psd), inverse, kappa, left, kept));
            }
            let left = bounds.left_over_of_noise(&conditions, &cells, kappa, 0.1);
            cases.push(([psd; 3], [psd; 3], kappa, left, 0.9));
        }
        for (weight, inverse, kappa, left, kept) in cases {
            let taken = Variances {
                level: (conditions.noise_variance * kept - left.level) / cells.per_cell,
                up: (azimuth * kept - left.up) / cells.per_cell,
            };
            let of_noise = kept == 0.9;
            let cost = Cost {
                conditions: &conditions,
                cells: &cells,
                weight,
                inverse,
                kappa,
            };
            for (jump, theta) in slanting_jumps() {
                let shared = share(&conditions, cells.length_s, jump, theta);
                let own = if of_noise { 0.0 } else { cost.own(&shared) };
                let spent = own + cost.cross(&shared);
                let paid = price(taken, &jump);
                assert!(
                    spent <= paid * (1.0 + 1e-9),
                    "{jump} {kappa}: {spent} {paid}"
                );
            }
        }
    }
}

/// The measurements on the grid cost no more than what is left of the schedule's own, and for
/// jumps of one kind not much less.
#[test]
fn the_grid_costs_no_more_than_what_is_left() {
    for (conditions, cells) in settings_with_azimuth() {
        let bounds = Sharing::new(&conditions, &cells);
        let left = Variances {
            level: 0.7 * conditions.noise_variance,
            up: 0.8 * conditions.azimuth_variance.unwrap(),
        };
        let grid = bounds.grid_noise(&cells, left).unwrap();
        for (jump, theta) in slanting_jumps() {
            let shared = share(&conditions, cells.length_s, jump, theta);
            for d in shared.corrections {
                let cost = cells.per_cell * price(grid, &(jump + d));
                assert!(cost <= price(left, &jump), "{jump} {theta}");
            }
        }
        // Where the azimuth is no much better than the accelerometers, which costs the latter.
        if left.up < 0.1 * left.level {
            continue;
        }
        let ratio = grid.level * cells.per_cell / left.level;
        assert!(ratio > 0.99 * (1.0 + bounds.correction).powi(-2), "{ratio}");
    }
}

/// Jumps of both kinds, and all of them at once.
#[test]
fn the_integral_of_the_trace_is_paid_for_with_an_azimuth_too() {
    for (conditions, cells) in settings_with_azimuth() {
        let bounds = Sharing::new(&conditions, &cells);
        let noises = Variances {
            level: conditions.noise_variance,
            up: conditions.azimuth_variance.unwrap(),
        };
        for kappa in [1e-4, 1e-2] {
            let granted = bounds.trace_variance(&conditions, &cells, 1e30, kappa);
            let least = bounds.least_trace_information(&conditions, &cells, kappa, 0.1);
            for (jump, theta) in slanting_jumps() {
                let shared = share(&conditions, cells.length_s, jump, theta);
                let integral: Vector3<f64> = shared.error.iter().sum();
                let integral = integral[UP] * cells.length_s / POINTS as f64;
                // n equal jumps: (n δ/√3)² against n times their price.
                let square = integral * integral / 3.0 * cells.measurements;
                let paid = price(noises, &jump);
                assert!(granted * square <= TRACE_SHARE * kappa * paid);
                assert!((1.0 + 1.0 / kappa) * square <= least * 0.1 * paid);
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
