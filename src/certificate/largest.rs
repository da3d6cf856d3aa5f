//! The largest value of φ(R) = tr(A(R)ᵀ Δ A(R) B) over all allowed attitudes, from above.
//!
//! Along a rotation about a fixed axis the entries of A have degree 2 in the angle, so φ is a
//! trigonometric polynomial of degree 4. If its values lie in [m, M] and it reaches M somewhere,
//! then θ away from there it is still at least M − (M − m) sin²(2θ) (M. Riesz, 1914: above
//! cos 4θ between the extremes). A grid that covers all attitudes within ρ hence sees the maximum
//! up to (M − m) sin²(2ρ), and the minimum too: no tolerance is assumed.
//!
//! Where gimbals are limited, the maximum may lie on the edge of what is allowed; then
//! φ(x) ≤ φ(p) + |∇φ(p)| ρ + 4 (M − m) ρ², as |φ''| ≤ 16 (M − m)/2 by Bernstein.
//!
//! Gravity's direction g fixes the Up row of C_c^n; the heading turns North and East about it.
//! With Q(g) the 3×3 matrix for which a row c of C_c^n contributes cᵀ Q c, and a, b, d its entries
//! in an orthonormal basis at right angles to g,
//!
//! ```text
//! φ = ½(δ_x + δ_z)(a + d) + δ_y gᵀQg + ½(δ_x − δ_z) ((a − d) cos 2h + 2b sin 2h),
//! ```
//!
//! whose largest and smallest values over the heading h are the mean ± ½|δ_x − δ_z| √((a−d)² + 4b²).

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::directions::{Allowed, Directions};
use crate::attitude::Attitude;
use crate::drift::{CoefficientMatrix, DriftCoefficient, drift_matrix};

/// Cosine of the angle within which a peak hides the lower ones beside it: 20°.
const BESIDE: f64 = 0.94;
/// What counts as high, relative to the highest.
const HIGH: f64 = 0.97;
/// Most peaks handed back.
const PEAKS: usize = 12;
/// Step of the numerical gradient, rad.
const STEP: f64 = 1e-3;
/// What angles on an index table may be off by, as a relative part of φ.
const TABLE_SLACK: f64 = 1e-6;

/// The allowed attitudes and the weights of the channels.
#[derive(Debug)]
pub(super) struct Attitudes<'a> {
    directions: &'a Directions,
    delta: [f64; 3],
}

/// The largest φ.
#[derive(Debug, Clone)]
pub(super) struct Peak {
    /// Upper bound over all allowed attitudes (or, where that was not asked for, the largest seen).
    pub value: f64,
    /// Where high values were seen, the highest first.
    pub places: Vec<Attitude>,
}

/// φ at one direction of gravity.
#[derive(Debug, Clone, Copy)]
struct PhiValue {
    /// Over all headings.
    mean: f64,
    /// How far the heading moves it up or down.
    swing: f64,
}

impl<'a> Attitudes<'a> {
    pub const fn new(directions: &'a Directions, delta: [f64; 3]) -> Self {
        Self { directions, delta }
    }

    /// Whether every attitude is allowed.
    pub const fn every_attitude(&self) -> bool {
        matches!(self.directions.allowed, Allowed::Everything)
    }

    /// The largest φ for a positive semidefinite B.
    pub fn peak(&self, b: &CoefficientMatrix, rigorous: bool) -> Peak {
        let grouped = Grouped::new(b);
        match &self.directions.allowed {
            Allowed::Table(attitudes) => self.table_peak(b, attitudes),
            Allowed::Everything => {
                let directions = &self.directions.sphere.directions;
                let values = self.values(&grouped, directions);
                let (top, bottom) = extremes(&values);
                let lost = libm::sin(2.0 * self.directions.sphere.radius).powi(2);
                let range = (top - bottom) / (1.0 - 2.0 * lost);
                Peak {
                    value: if rigorous { top + lost * range } else { top },
                    places: self.places(&grouped, directions, &values),
                }
            }
            Allowed::Cover { directions, radius } => {
                let values = self.values(&grouped, directions);
                let (top, _) = extremes(&values);
                let value = match rigorous {
                    true => self.cover_bound(&grouped, directions, &values, *radius),
                    false => top,
                };
                Peak {
                    value,
                    places: self.places(&grouped, directions, &values),
                }
            }
        }
    }

    fn values(&self, grouped: &Grouped, directions: &[Vector3<f64>]) -> Vec<PhiValue> {
        directions.iter().map(|g| self.value(grouped, g)).collect()
    }

    fn value(&self, grouped: &Grouped, g: &Vector3<f64>) -> PhiValue {
        let q = grouped.at(g);
        let (e1, e2) = plane(g);
        let (q1, q2) = (q * e1, q * e2);
        let (a, b, d) = (e1.dot(&q1), e1.dot(&q2), e2.dot(&q2));
        let [x, y, z] = self.delta;
        PhiValue {
            mean: 0.5 * (x + z) * (a + d) + y * g.dot(&(q * g)),
            swing: 0.5 * (x - z).abs() * libm::hypot(a - d, 2.0 * b),
        }
    }

    /// φ(x) ≤ mean(p) + |∇mean| ρ + 4 (M − m) ρ² + swing(p) + 4 ρ · (largest swing), M and m over
    /// the whole sphere.
    fn cover_bound(
        &self,
        grouped: &Grouped,
        directions: &[Vector3<f64>],
        values: &[PhiValue],
        radius: f64,
    ) -> f64 {
        let sphere = &self.directions.sphere;
        let everywhere = self.values(grouped, &sphere.directions);
        let lost = libm::sin(2.0 * sphere.radius).powi(2);
        let means = || everywhere.iter().map(|v| v.mean);
        let top = means().fold(0.0, f64::max);
        let bottom = means().fold(f64::INFINITY, f64::min);
        let range = (top - bottom) / (1.0 - 2.0 * lost);
        let swing = everywhere.iter().map(|v| v.swing).fold(0.0, f64::max);
        let swing = swing / libm::cos(4.0 * sphere.radius);
        let rest = 4.0 * range * radius * radius + 4.0 * radius * swing;
        let mut bound = 0.0_f64;
        for (g, v) in directions.iter().zip(values) {
            // Bernstein's largest slope decides which points can matter at all.
            if v.mean + v.swing + 2.0 * range * radius + rest <= bound {
                continue;
            }
            // A central difference is off by at most h²/6 · 4³ · (M − m)/2 in each direction.
            let slope = self.slope(grouped, g) + 8.0 * range * STEP * STEP;
            bound = bound.max(v.mean + v.swing + slope * radius + rest);
        }
        bound
    }

    /// |∇mean| on the sphere.
    fn slope(&self, grouped: &Grouped, g: &Vector3<f64>) -> f64 {
        let (e1, e2) = plane(g);
        let along = |e: &Vector3<f64>| {
            let at = |s: f64| {
                self.value(grouped, &(g * libm::cos(STEP) + e * (s * libm::sin(STEP))))
                    .mean
            };
            (at(1.0) - at(-1.0)) / (2.0 * STEP)
        };
        libm::hypot(along(&e1), along(&e2))
    }

    /// The highest directions that are not beside a higher one, each at its best heading.
    fn places(
        &self,
        grouped: &Grouped,
        directions: &[Vector3<f64>],
        values: &[PhiValue],
    ) -> Vec<Attitude> {
        let (top, _) = extremes(values);
        let mut high: Vec<(f64, usize)> = values
            .iter()
            .enumerate()
            .map(|(i, v)| (v.mean + v.swing, i))
            .filter(|(value, _)| *value > HIGH * top)
            .collect();
        high.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut chosen: Vec<usize> = Vec::new();
        for (_, i) in high {
            if chosen.len() >= PEAKS {
                break;
            }
            let beside = |&j: &usize| directions[i].dot(&directions[j]) > BESIDE;
            if !chosen.iter().any(beside) {
                chosen.push(i);
            }
        }
        let best = |i: &usize| self.best_heading(grouped, &directions[*i]);
        chosen.iter().map(best).collect()
    }

    /// The attitude with gravity along `g` and the heading that makes φ largest.
    fn best_heading(&self, grouped: &Grouped, g: &Vector3<f64>) -> Attitude {
        let q = grouped.at(g);
        let (e1, e2) = plane(g);
        let (a, b, d) = (e1.dot(&(q * e1)), e1.dot(&(q * e2)), e2.dot(&(q * e2)));
        let mut angle = 0.5 * libm::atan2(2.0 * b, a - d);
        if self.delta[0] < self.delta[2] {
            angle += std::f64::consts::FRAC_PI_2;
        }
        let up = -g;
        let north = e1 * libm::cos(angle) + e2 * libm::sin(angle);
        let east = north.cross(&up);
        let rows = [north.transpose(), up.transpose(), east.transpose()];
        Attitude::from_rotation(Rotation3::from_matrix_unchecked(Matrix3::from_rows(&rows)))
    }

    fn table_peak(&self, b: &CoefficientMatrix, attitudes: &[Attitude]) -> Peak {
        let value = |attitude: &Attitude| {
            let a = drift_matrix(attitude);
            let row = |i: usize| self.delta[i] * (a.row(i) * b).dot(&a.row(i));
            row(0) + row(1) + row(2)
        };
        let mut high: Vec<(f64, usize)> = attitudes
            .iter()
            .enumerate()
            .map(|(i, a)| (value(a), i))
            .collect();
        high.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let top = high.first().map_or(0.0, |h| h.0);
        Peak {
            value: top * (1.0 + TABLE_SLACK),
            places: high
                .iter()
                .take(PEAKS)
                .map(|(_, i)| attitudes[*i])
                .collect(),
        }
    }
}

fn extremes(values: &[PhiValue]) -> (f64, f64) {
    let top = values.iter().map(|v| v.mean + v.swing).fold(0.0, f64::max);
    let bottom = values.iter().map(|v| v.mean - v.swing);
    (top, bottom.fold(f64::INFINITY, f64::min))
}

/// An orthonormal basis of the plane at right angles to the unit vector `g`.
fn plane(g: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let mut axis = Vector3::zeros();
    axis[g.iamin()] = 1.0;
    let e1 = (axis - g * g.dot(&axis)).normalize();
    (e1, g.cross(&e1))
}

/// B grouped by gyro: Q(g)_pq = Σ s_i(g) s_j(g) B_ij over the coefficients i of gyro p, j of q.
struct Grouped {
    /// (coefficient, coefficient, B) for each pair of gyros.
    groups: [[Vec<(DriftCoefficient, DriftCoefficient, f64)>; 3]; 3],
}

impl Grouped {
    fn new(b: &CoefficientMatrix) -> Self {
        let mut groups: [[Vec<_>; 3]; 3] = Default::default();
        for i in DriftCoefficient::ALL {
            for j in DriftCoefficient::ALL {
                if i.gyro() <= j.gyro() {
                    groups[i.gyro()][j.gyro()].push((i, j, b[(i.index(), j.index())]));
                }
            }
        }
        Self { groups }
    }

    fn at(&self, g: &Vector3<f64>) -> Matrix3<f64> {
        let factors = DriftCoefficient::ALL.map(|c| c.factor(g));
        let mut q = Matrix3::zeros();
        for p in 0..3 {
            for r in p..3 {
                let terms = self.groups[p][r].iter();
                let sum: f64 = terms
                    .map(|(i, j, b)| factors[i.index()] * factors[j.index()] * b)
                    .sum();
                q[(p, r)] = sum;
                q[(r, p)] = sum;
            }
        }
        q
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::certificate::directions::Sphere;

    const DELTA: [f64; 3] = [1.0, 0.4, 1.6];

    /// B of rank two, another one for each number.
    fn matrix(k: usize) -> CoefficientMatrix {
        let entry = |i: usize, c: usize| ((i + 1) as f64 * (k as f64 + 1.7) * (c + 2) as f64).sin();
        let root = nalgebra::SMatrix::<f64, 12, 2>::from_fn(entry);
        root * root.transpose()
    }

    fn phi(attitude: &Attitude, b: &CoefficientMatrix) -> f64 {
        let a = drift_matrix(attitude);
        (0..3)
            .map(|i| DELTA[i] * (a.row(i) * b).dot(&a.row(i)))
            .sum()
    }

    /// The largest φ over headings at directions within `reach` of one of `near`, from below.
    fn seen(near: &[Vector3<f64>], reach: f64, b: &CoefficientMatrix) -> f64 {
        let fine = Sphere::new(0.06).directions;
        let allowed = |g: &&Vector3<f64>| near.iter().any(|n| n.dot(g) >= reach.cos());
        let headings = (0..12).map(|h| f64::from(h) * std::f64::consts::PI / 12.0);
        fine.iter()
            .filter(allowed)
            .flat_map(|g| headings.clone().map(move |h| (g, h)))
            .filter_map(|(g, h)| Attitude::with_gravity_along(*g, h))
            .map(|attitude| phi(&attitude, b))
            .fold(0.0, f64::max)
    }

    /// On coarse grids, where what may lie between their points is a good part of φ.
    #[test]
    fn nothing_between_the_points_of_a_coarse_grid_is_above_the_bound() {
        let sphere = Sphere::new(0.25);
        let free = Directions {
            sphere: sphere.clone(),
            allowed: Allowed::Everything,
        };
        // A cap, which leaves maxima on its edge.
        let middle = Vector3::new(0.48, -0.6, 0.64);
        let all = sphere.directions.iter().copied();
        let cap: Vec<Vector3<f64>> = all.filter(|g| g.dot(&middle) > 0.8).collect();
        let limited = Directions {
            allowed: Allowed::Cover {
                directions: cap.clone(),
                radius: sphere.radius,
            },
            sphere: sphere.clone(),
        };
        for k in 0..12 {
            let b = matrix(k);
            for (directions, near) in [(&free, &sphere.directions), (&limited, &cap)] {
                let attitudes = Attitudes::new(directions, DELTA);
                let most = seen(near, sphere.radius, &b);
                let bound = attitudes.peak(&b, true).value;
                let grid = attitudes.peak(&b, false);
                assert!(most <= bound, "{k}: {most} {bound}");
                assert!(bound <= 2.5 * most, "{k}: {most} {bound}");
                // What was seen on the grid was seen at the places handed back, the highest first.
                let at: Vec<f64> = grid.places.iter().map(|a| phi(a, &b)).collect();
                assert!((at[0] / grid.value - 1.0).abs() < 1e-12);
                assert!(at.windows(2).all(|w| w[0] >= w[1]));
                assert!(at.iter().all(|v| *v > HIGH * at[0]));
            }
        }
    }

    #[test]
    fn the_slope_is_that_of_the_steepest_way() {
        let directions = Directions {
            sphere: Sphere::new(0.5),
            allowed: Allowed::Everything,
        };
        let attitudes = Attitudes::new(&directions, DELTA);
        for (k, g) in directions.sphere.directions.iter().enumerate() {
            let grouped = Grouped::new(&matrix(k));
            let (e1, e2) = plane(g);
            let mean = |angle: f64, step: f64| {
                let way = e1 * angle.cos() + e2 * angle.sin();
                attitudes
                    .value(&grouped, &(g * step.cos() + way * step.sin()))
                    .mean
            };
            let steepest = (0..720)
                .map(|i| f64::from(i) * std::f64::consts::PI / 360.0)
                .map(|angle| (mean(angle, 1e-4) - mean(angle, -1e-4)) / 2e-4)
                .fold(0.0, f64::max);
            let slope = attitudes.slope(&grouped, g);
            assert!((slope - steepest).abs() < 1e-3 * (1.0 + steepest), "{k}");
        }
    }
}
