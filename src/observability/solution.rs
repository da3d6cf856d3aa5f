//! The reconstruction that proves an order: which channels, at which positions, with which
//! weights, give a combination.
//!
//! A combination c is of order d because weights w exist with Σ w_k row_k = c over rows of
//! channels of order ≤ d. Such weights are seldom unique; we look for few of them, by orthogonal
//! least squares (Chen, Billings & Luo, *Orthogonal least squares methods and their application
//! to non-linear system identification*, Int. J. Control 50(5), 1989): rows are taken one by
//! one, each time the one whose new direction has most in common with what is left of c, until
//! nothing is left. At most as many rows as there are unknowns are taken. The weights on them
//! follow from their pseudo-inverse, and Σ w_k row_k is compared with c before anything is said.

use nalgebra::{DMatrix, DVector};

use super::combinations::Combination;
use super::regressor::{Channel, Regressor, RowSource, TaggedRow, UNKNOWNS};
use super::{Observability, Order};
use crate::covariance::CovarianceModel;
use crate::error::{Error, Result};
use crate::motion::Timeline;

/// What is left of a combination of length one when it counts as found.
const FOUND: f64 = 1e-10;
/// New part of a row, relative to the row, below which it is taken to be no new direction.
const NEW: f64 = 1e-6;
/// Largest acceptable error of Σ w_k row_k, relative to the combination.
const PROOF: f64 = 1e-8;

/// When a row was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Moment {
    /// While the position was held.
    Dwell,
    /// On the way to the position, measuring, this fraction into the move.
    Move {
        /// 0 at the start of the move, 1 at its end.
        fraction: f64,
    },
}

/// One term of a solution: a weight times what a channel tells at a position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term {
    /// Index of the position.
    pub position: usize,
    /// When.
    pub moment: Moment,
    /// The channel.
    pub channel: Channel,
    /// Its weight, dimensionless.
    pub weight: f64,
}

/// A combination as a weighted sum of what the channels tell: the proof of its order.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// What is solved for.
    pub combination: Combination,
    /// Its order.
    pub order: Order,
    /// The terms, by position.
    pub terms: Vec<Term>,
    /// Largest difference between the weighted sum of the rows and the combination.
    pub residual: f64,
    /// 1σ of the combination by these terms alone, each dwell on its own, °/h. The filter, which
    /// uses all rows and what dwells tell together, does better, unless the terms need the
    /// change of ψ_y^n: its error is not counted here.
    pub sigma_deg_per_h: f64,
    /// Whether the terms compare z channels of different dwells and so need the change of ψ_y^n
    /// in between, which (25) takes from Z̈ although (26) counts as order 1.
    pub uses_change_of_psi_y: bool,
}

impl Solution {
    /// The solution of `combination` by channels of the lowest possible order; none when it is
    /// not observable.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when the weights found do not give the combination.
    pub fn find(
        model: &CovarianceModel,
        timeline: &Timeline,
        observability: &Observability,
        combination: &Combination,
    ) -> Result<Option<Self>> {
        let Some(order) = observability.order_of(combination) else {
            return Ok(None);
        };
        let strict = observability.strict_order_of(combination) == Some(order);
        let channels: &[Channel] = match order {
            Order::Zero => &[Channel::Azimuth],
            Order::First if strict => &[Channel::X],
            Order::First => &Channel::FIRST,
            Order::Second => &Channel::ALL,
        };
        let rows = Regressor::new(model, timeline).tagged(channels);
        let chosen = choose(&rows, combination.as_array());
        Self::from_rows(*combination, order, &chosen).map(Some)
    }

    fn from_rows(combination: Combination, order: Order, rows: &[&TaggedRow]) -> Result<Self> {
        let target = DVector::from_row_slice(combination.as_array());
        let columns = DMatrix::from_fn(UNKNOWNS, rows.len(), |i, k| rows[k].row[i]);
        let weights = least_squares(&columns, &target).ok_or_else(|| {
            Error::numerical(format!(
                "the reconstruction of {combination} has no weights"
            ))
        })?;
        let residual = (columns * &weights - &target).amax();
        if residual > PROOF * target.amax() || !residual.is_finite() {
            return Err(Error::numerical(format!(
                "the reconstruction of {combination} fails by {residual:e}"
            )));
        }
        let smallest = 1e-9 * weights.amax();
        let mut terms = Vec::new();
        let mut variance = 0.0;
        for (row, &weight) in rows.iter().zip(weights.iter()) {
            if weight.abs() <= smallest {
                continue;
            }
            variance += (weight / row.weight).powi(2);
            terms.push(Term {
                position: row.leg,
                moment: match row.source {
                    RowSource::Dwell => Moment::Dwell,
                    RowSource::Move { fraction } => Moment::Move { fraction },
                },
                channel: row.channel,
                weight,
            });
        }
        terms.sort_by_key(|t| (t.position, t.channel.name()));
        let later = |t: &Term| t.channel == Channel::Z && t.position > 0;
        Ok(Self {
            combination,
            order,
            residual,
            sigma_deg_per_h: variance.sqrt(),
            uses_change_of_psi_y: terms.iter().any(later),
            terms,
        })
    }

    /// The channels that occur, in the order of [`Channel`].
    pub fn channels(&self) -> Vec<Channel> {
        let occurs = |c: &Channel| self.terms.iter().any(|t| t.channel == *c);
        Channel::ALL.into_iter().filter(occurs).collect()
    }
}

/// The pseudo-inverse of `columns`, which are independent, times `target`.
fn least_squares(columns: &DMatrix<f64>, target: &DVector<f64>) -> Option<DVector<f64>> {
    let qr = columns.clone().qr();
    let (q, r) = (qr.q(), qr.r());
    let solve = |rhs: &DVector<f64>| r.solve_upper_triangular(&q.tr_mul(rhs));
    let first = solve(target)?;
    // One step of refinement takes the residual to rounding size.
    let correction = solve(&(target - columns * &first))?;
    Some(first + correction)
}

/// Few rows that span `target`, by orthogonal least squares.
fn choose<'a>(rows: &'a [TaggedRow], target: &[f64; UNKNOWNS]) -> Vec<&'a TaggedRow> {
    let size = dot(target, target).sqrt();
    let mut rest = *target;
    let mut fresh: Vec<[f64; UNKNOWNS]> = rows.iter().map(|r| r.row).collect();
    let mut chosen = Vec::new();
    while dot(&rest, &rest).sqrt() > FOUND * size && chosen.len() < UNKNOWNS {
        let score = |k: usize| {
            let (new, old) = (&fresh[k], &rows[k].row);
            let length = dot(new, new);
            match length > NEW * NEW * dot(old, old) {
                true => dot(new, &rest).powi(2) / length,
                false => 0.0,
            }
        };
        // The first of equals, so that early positions are preferred.
        let (mut best, mut most) = (None, 0.0);
        for k in 0..rows.len() {
            let gain = score(k);
            if gain > most * (1.0 + 1e-9) {
                (best, most) = (Some(k), gain);
            }
        }
        // Where the rest is at right angles to every row, any new row brings it nearer.
        let Some(k) = best else { break };
        chosen.push(&rows[k]);
        let direction = normalised(&fresh[k]);
        remove(&mut rest, &direction);
        for row in &mut fresh {
            // Twice: what rounding leaves of the direction would pass for a new one.
            remove(row, &direction);
            remove(row, &direction);
        }
    }
    chosen
}

fn dot(a: &[f64; UNKNOWNS], b: &[f64; UNKNOWNS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn normalised(v: &[f64; UNKNOWNS]) -> [f64; UNKNOWNS] {
    let length = dot(v, v).sqrt();
    v.map(|x| x / length)
}

fn remove(v: &mut [f64; UNKNOWNS], direction: &[f64; UNKNOWNS]) {
    let along = dot(v, direction);
    for (v, d) in v.iter_mut().zip(direction) {
        *v -= along * d;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Position;
    use crate::drift::DriftCoefficient as D;
    use crate::platform::PlatformConfig;
    use crate::schedule::standard::StandardScheme;
    use crate::schedule::{Schedule, ScheduledPosition};

    fn solve(positions: &[Position], combination: &Combination) -> Option<Solution> {
        let platform = PlatformConfig::default().check().unwrap();
        let held = positions.iter().map(|p| ScheduledPosition::new(*p, 1000.0));
        let timeline = Timeline::new(&platform, &Schedule::new(held.collect()).unwrap()).unwrap();
        let model = CovarianceModel::new(&platform);
        let observability = Observability::analyze(&model, &timeline).unwrap();
        Solution::find(&model, &timeline, &observability, combination).unwrap()
    }

    #[test]
    fn the_papers_two_positions_give_d_fx_as_half_the_sum() {
        // (27), (28): D_FX = ½ (ε_x at p1 + ε_x at p2).
        let positions = [0.0, 180.0].map(|a| Position::from_deg(a, 0.0, 0.0));
        let s = solve(&positions, &Combination::single(D::FX)).unwrap();
        assert_eq!(s.order, Order::First);
        assert_eq!(s.channels(), [Channel::X]);
        assert!(!s.uses_change_of_psi_y);
        assert_eq!(s.terms.len(), 2);
        assert!(s.terms.iter().all(|t| (t.weight - 0.5).abs() < 1e-12));
        // D_FZ: ½ (z at p1 − z at p2) would leave ω_N ψ_y out: ψ^n is continuous.
        let s = solve(&positions, &Combination::single(D::FZ)).unwrap();
        assert_eq!(s.channels(), [Channel::Z]);
        assert!(s.uses_change_of_psi_y);
        let s = solve(&positions, &Combination::single(D::FY)).unwrap();
        assert_eq!((s.order, s.channels()), (Order::Second, vec![Channel::Y]));
        assert!(solve(&positions, &Combination::single(D::SZ)).is_none());
    }

    #[test]
    fn every_coefficient_of_a_good_scheme_is_proven() {
        for scheme in [StandardScheme::Axis24, StandardScheme::Icosahedron12] {
            let positions = scheme.positions();
            for c in D::ALL {
                let s = solve(&positions, &Combination::single(c)).unwrap();
                // The angles of schemes are rounded to 1e-9°.
                assert!(s.residual < 1e-10, "{} {:e}", c.name(), s.residual);
                assert!(s.terms.len() <= UNKNOWNS);
                let highest = s.channels().iter().map(|c| c.order()).max();
                assert_eq!(highest, Some(s.order));
                assert!(s.sigma_deg_per_h > 0.0);
            }
            let trace = solve(&positions, &Combination::input_trace()).unwrap();
            assert_eq!(trace.channels(), [Channel::Y]);
        }
    }
}
