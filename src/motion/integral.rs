//! The drift integral of a move, B = ∫ Φ(t_end − t) A(R(t)) dt.
//!
//! With the angles linear in time, as they are at one rate, A(R(t)) is a trigonometric polynomial whose highest angular
//! frequency is 2 (|α̇| + |β̇| + |γ̇|): C_c^n has degree 1 in each angle and g^c too. A
//! Gauss–Legendre rule of n points integrates cos(κ x) over [−1, 1] with an error below
//! (e κ / 4n)^{2n}, so the number of points follows from κ, half the phase the integrand runs
//! through; long moves are cut into panels. Each rule goes as far as that error is 1e-13. Where the
//! gimbals speed up or slow down the angles are quadratic in time, and κ is that of the greatest rate. The
//! rules below keep the error under 1e-12 of the duration (tested against a rule of 64 points).

use std::sync::LazyLock;

use nalgebra::Matrix3;

use super::Move;
use crate::attitude::Stand;
use crate::drift::{DriftMatrix, times_drift_matrix};
use crate::dynamics::ErrorDynamics;
use crate::units::EARTH_RATE_RAD_PER_S;

/// A Gauss–Legendre rule on [0, 1]: nodes and weights.
#[derive(Debug)]
pub(crate) struct Rule {
    nodes: Vec<(f64, f64)>,
    /// The same four by four.
    fours: Vec<Group>,
}

/// Nodes that are visited together; the last group is filled with nodes of no weight.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Group {
    /// On [0, 1].
    pub places: [f64; 4],
    /// Their weights.
    pub weights: [f64; 4],
}

impl Group {
    fn new(nodes: &[(f64, f64)]) -> Self {
        let mut group = Self {
            places: [0.5; 4],
            weights: [0.0; 4],
        };
        for (i, (place, weight)) in nodes.iter().enumerate() {
            group.places[i] = *place;
            group.weights[i] = *weight;
        }
        group
    }
}

impl Rule {
    /// The rule of `n` points: roots of the Legendre polynomial P_n by Newton's method from the
    /// customary cosine guess, weights 2/((1 − x²) P_n'(x)²), mapped to [0, 1].
    fn gauss_legendre(n: usize) -> Self {
        let nodes = (0..n).map(|i| {
            let mut x = libm::cos(std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5));
            let mut slope = 0.0;
            for _ in 0..100 {
                let (mut p0, mut p1) = (1.0, x);
                for k in 2..=n {
                    let k = k as f64;
                    (p0, p1) = (p1, ((2.0 * k - 1.0) * x * p1 - (k - 1.0) * p0) / k);
                }
                slope = n as f64 * (x * p1 - p0) / (x * x - 1.0);
                let step = p1 / slope;
                x -= step;
                if step.abs() < 1e-16 {
                    break;
                }
            }
            (0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * slope * slope))
        });
        let nodes: Vec<(f64, f64)> = nodes.collect();
        Self {
            fours: nodes.chunks(4).map(Group::new).collect(),
            nodes,
        }
    }
}

/// How an interval is integrated: equal panels with one rule each.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Panels {
    /// The rule of each.
    rule: &'static Rule,
    /// How many.
    count: usize,
}

impl Panels {
    /// For half a phase of `kappa`.
    #[inline]
    pub fn of_half_phase(kappa: f64) -> Self {
        let (rule, count) = rule_for(kappa);
        Self { rule, count }
    }

    /// 1 by the number of panels.
    #[inline(always)]
    pub fn share(&self) -> f64 {
        1.0 / self.count as f64
    }

    /// Groups of nodes in all panels together.
    #[inline(always)]
    pub fn steps(&self) -> usize {
        self.count * self.rule.fours.len()
    }

    /// One of them, with the number of its panel.
    #[inline(always)]
    pub fn group(&self, step: usize) -> (f64, &'static Group) {
        let groups = &self.rule.fours;
        ((step / groups.len()) as f64, &groups[step % groups.len()])
    }
}

/// The rules, each with the largest κ it is used for.
static RULES: LazyLock<[(f64, Rule); 4]> = LazyLock::new(|| {
    [(0.7, 6), (2.0, 8), (5.5, 12), (10.0, 16)].map(|(kappa, n)| (kappa, Rule::gauss_legendre(n)))
});

/// The eight nodes of Gauss's rule on [0, 1], in order, with their weights.
pub(crate) fn eight_nodes() -> &'static [(f64, f64)] {
    &RULES[1].1.nodes
}

/// The sixteen nodes of Gauss's rule on [0, 1], in order, with their weights.
pub(crate) fn sixteen_nodes() -> &'static [(f64, f64)] {
    &RULES[3].1.nodes
}

/// Half the phase that the integrand runs through in an interval of the move, start and length in s, at
/// the greatest rate in it: the gimbals' turn, and the Earth's in Φ.
pub(crate) fn half_phase(m: &Move, (start_s, length_s): (f64, f64)) -> f64 {
    let turn: f64 = m.change.iter().map(|c| c.abs()).sum();
    let at_rate = turn * length_s / m.duration_s + 0.5 * EARTH_RATE_RAD_PER_S * length_s;
    match m.ramp() == 0.0 {
        true => at_rate,
        false => {
            let part = [start_s, length_s].map(|s| s / m.duration_s);
            at_rate * m.greatest_speed(part.into())
        }
    }
}

/// The rule and number of panels for half a phase of `kappa`.
fn rule_for(kappa: f64) -> (&'static Rule, usize) {
    let rules = &*RULES;
    for (limit, rule) in rules {
        if kappa <= *limit {
            return (rule, 1);
        }
    }
    let (limit, rule) = &rules[rules.len() - 1];
    (rule, (kappa / limit).ceil() as usize)
}

/// Calls `visit(time from the start of the interval, weight in s)` at every node of the interval, start
/// and length in s from the start of the move.
fn for_each_node(m: &Move, interval: (f64, f64), mut visit: impl FnMut(f64, f64)) {
    for part in m.smooth_parts(interval, m.duration_s) {
        let since_start = (part.0 - interval.0, part.1);
        for_each_node_of_panels(half_phase(m, part), since_start, &mut visit);
    }
}

/// The same of an interval without corners, whose integrand runs through half a phase of `kappa`.
fn for_each_node_of_panels(
    kappa: f64,
    (start, length): (f64, f64),
    visit: &mut impl FnMut(f64, f64),
) {
    let (rule, panels) = rule_for(kappa);
    let width = length / panels as f64;
    for panel in 0..panels {
        for &(x, w) in &rule.nodes {
            visit(start + width * (panel as f64 + x), width * w);
        }
    }
}

/// Calls `visit(share of the duration, weight)` at every node of a part of the move, start and length
/// as shares of its duration, for an integrand of `degree` in the angles; the weights add up to the
/// length. Also where the move takes no time.
pub(crate) fn for_each_share(
    m: &Move,
    part: (f64, f64),
    degree: f64,
    mut visit: impl FnMut(f64, f64),
) {
    let turn: f64 = m.change.iter().map(|c| c.abs()).sum();
    let earth = EARTH_RATE_RAD_PER_S * m.duration_s;
    for (start, length) in m.smooth_parts(part, 1.0) {
        let turn = turn * m.greatest_speed((start, length));
        let kappa = 0.5 * (turn * degree + earth) * length;
        for_each_node_of_panels(kappa, (start, length), &mut visit);
    }
}

impl Move {
    /// B = ∫ Φ(t_end − t) A(R(t)) dt over the interval of `length_s` that starts `start_s` into
    /// the move: what the drift D adds to ψ^n by the interval's end is B D. Unit s (times g).
    pub fn drift_integral(
        &self,
        stand: &Stand,
        dynamics: &ErrorDynamics,
        start_s: f64,
        length_s: f64,
    ) -> DriftMatrix {
        let mut b = DriftMatrix::zeros();
        for_each_node(self, (start_s, length_s), |t, weight| {
            let position = self.position_at((start_s + t) / self.duration_s);
            let phi: Matrix3<f64> = dynamics.transition(length_s - t) * weight;
            b += times_drift_matrix(&phi, &stand.attitude(position));
        });
        b
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::earth_rate_n;
    use crate::drift::drift_matrix;

    fn fine(m: &Move, dynamics: &ErrorDynamics, start: f64, length: f64) -> DriftMatrix {
        let rule = Rule::gauss_legendre(64);
        let mut b = DriftMatrix::zeros();
        // No panel has a corner of the rate inside.
        let mut ends: Vec<f64> = (0..=8).map(|k| f64::from(k) / 8.0 * length).collect();
        let corners = m.corners_s().map(|at_s| at_s - start);
        ends.extend(corners.into_iter().filter(|t| (0.0..=length).contains(t)));
        ends.sort_by(f64::total_cmp);
        for pair in ends.windows(2) {
            let width = pair[1] - pair[0];
            for &(x, w) in &rule.nodes {
                let t = pair[0] + width * x;
                let p = m.position_at((start + t) / m.duration_s);
                b += dynamics.transition(length - t) * drift_matrix(&p.attitude()) * (w * width);
            }
        }
        b
    }

    #[test]
    fn rules_integrate_polynomials_of_their_degree() {
        for n in [6, 8, 12, 16] {
            let rule = Rule::gauss_legendre(n);
            for degree in 0..2 * n as i32 {
                let sum: f64 = rule.nodes.iter().map(|&(x, w)| w * x.powi(degree)).sum();
                assert!((sum - 1.0 / (f64::from(degree) + 1.0)).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn drift_integral_is_accurate_to_1e_12() {
        let dynamics = ErrorDynamics::new(earth_rate_n(0.49));
        let changes = [
            [0.0, 0.0, 0.0],
            [0.2, -0.1, 0.1],
            [0.5, 0.5, -0.5],
            [-1.5, 1.0, 1.9],
            [3.1, -3.1, 3.1],
            [6.0, 2.0, -12.0],
        ];
        for change in changes {
            let m = Move::new([0.3, -0.8, 2.0], change, 360.0, false);
            for (start, length) in [(0.0, 360.0), (120.0, 10.0), (357.0, 3.0)] {
                let exact = fine(&m, &dynamics, start, length);
                let error =
                    (m.drift_integral(&Stand::PAPER, &dynamics, start, length) - exact).amax();
                assert!(error < 1e-12 * length, "{change:?}: {error:e}");
            }
            for ramp in [0.01, 0.2, 0.5] {
                let m = m.with_ramp(ramp);
                for (start, length) in [(0.0, 360.0), (60.0, 50.0), (100.0, 250.0), (357.0, 3.0)] {
                    let exact = fine(&m, &dynamics, start, length);
                    let found = m.drift_integral(&Stand::PAPER, &dynamics, start, length);
                    let error = (found - exact).amax();
                    assert!(error < 1e-12 * length, "{change:?}, {ramp}: {error:e}");
                }
            }
        }
    }

    #[test]
    fn a_slow_move_follows_the_earth() {
        let dynamics = ErrorDynamics::new(earth_rate_n(0.49));
        let m = Move::new([0.0; 3], [0.02, 0.0, 0.0], 2e5, false);
        let error = (m.drift_integral(&Stand::PAPER, &dynamics, 0.0, 2e5)
            - fine(&m, &dynamics, 0.0, 2e5))
        .amax();
        assert!(error < 1e-12 * 2e5, "{error:e}");
    }
}
