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
//!
//! Where no few rows do, all of them are taken: the weights of least variance, and if those cannot
//! be proven either, the shortest. What counts as nothing is [`RANK_TOLERANCE`], as in the order
//! that is to be proven. A combination whose weights fail even so goes without, for the
//! [`NoSolution`] given; nothing else is lost by that.

use nalgebra::{DMatrix, DVector};

use super::combinations::Combination;
use super::regressor::{Channel, Regressor, RowSource, TaggedRow, UNKNOWNS};
use super::row_space::{AllRows, RANK_TOLERANCE, RowSpace, counts, dot, length};
use super::{Observability, Order};
use crate::covariance::CovarianceModel;
use crate::motion::Timeline;
use serde::{Deserialize, Serialize};

/// Largest acceptable error of Σ w_k row_k, relative to the combination: what lies outside the
/// rows' space without counting, and as much again for the rounding of the weights.
const PROOF: f64 = 2.0 * RANK_TOLERANCE;

/// When a row was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SeenDuring {
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
    pub moment: SeenDuring,
    /// The channel.
    pub channel: Channel,
    /// Its weight, dimensionless.
    pub weight: f64,
}

/// Which rows a solution weighs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(rename = "Rows"))]
#[serde(rename_all = "kebab-case")]
pub enum RowsUsed {
    /// As few as were found to do.
    Few,
    /// All there are, since no few do.
    All,
}

/// Why a combination has no solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum NoSolution {
    /// It is not observable.
    NotObservable,
    /// It is observable by rank, but no weights that doubles hold give it to the tolerance.
    NotProven,
}

impl std::fmt::Display for NoSolution {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::NotObservable => "not observable",
            Self::NotProven => "observable by rank, but by no weights that hold to the tolerance",
        })
    }
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
    /// Whether these are few of the rows or all.
    pub rows: RowsUsed,
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
    /// The solution of `combination` by channels of the lowest possible order.
    ///
    /// # Errors
    ///
    /// [`NoSolution`]: why there is none.
    pub fn find(
        model: &CovarianceModel,
        timeline: &Timeline,
        observability: &Observability,
        combination: &Combination,
    ) -> Result<Self, NoSolution> {
        let order = observability
            .order_of(combination)
            .ok_or(NoSolution::NotObservable)?;
        let strict = observability.strict_order_of(combination) == Some(order);
        let spaces = &observability.spaces;
        let regressor = Regressor::new(model, timeline);
        let measured = regressor.measured_azimuth.is_some();
        let (channels, space): (&[Channel], _) = match order {
            Order::Zero => (&[Channel::Azimuth], &spaces.zero),
            Order::First if strict && !measured => (&[Channel::X], &spaces.x),
            Order::First => (regressor.first(), &spaces.first),
            Order::Second => (&Channel::ALL, &spaces.all),
        };
        let rows = regressor.tagged(channels);
        let claim = Claim {
            combination: *combination,
            order,
            azimuth_measured: measured,
        };
        claim
            .by_few(&rows)
            .or_else(|| claim.by_all(&rows, space, |row| row.weight))
            .or_else(|| claim.by_all(&rows, space, |row| row.share))
            .ok_or(NoSolution::NotProven)
    }

    /// The channels that occur, in the order of [`Channel`].
    pub fn channels(&self) -> Vec<Channel> {
        let occurs = |c: &Channel| self.terms.iter().any(|t| t.channel == *c);
        Channel::ALL.into_iter().filter(occurs).collect()
    }
}

/// What is to be proven.
struct Claim {
    combination: Combination,
    order: Order,
    azimuth_measured: bool,
}

impl Claim {
    fn by_few(&self, rows: &[TaggedRow]) -> Option<Solution> {
        let chosen = choose(rows, self.combination.as_array());
        let target = DVector::from_row_slice(self.combination.as_array());
        let columns = DMatrix::from_fn(UNKNOWNS, chosen.len(), |i, k| chosen[k].row[i]);
        let weights = least_squares(&columns, &target)?;
        self.proven(&chosen, weights.as_slice(), RowsUsed::Few)
    }

    /// By all rows, those of a large `size` before those of a small one.
    fn by_all(
        &self,
        rows: &[TaggedRow],
        space: &RowSpace<UNKNOWNS>,
        size: impl Fn(&TaggedRow) -> f64,
    ) -> Option<Solution> {
        let scaled: Vec<[f64; UNKNOWNS]> = rows
            .iter()
            .map(|row| row.row.map(|v| v * size(row)))
            .collect();
        let all = AllRows::new(space, &scaled);
        let rows: Vec<&TaggedRow> = rows.iter().collect();
        let mut weights = vec![0.0; rows.len()];
        // The second time refines the first.
        for _ in 0..2 {
            let rest = self.rest(&rows, &weights);
            let more = all.weights(&rest)?;
            for ((weight, more), row) in weights.iter_mut().zip(more.iter()).zip(&rows) {
                *weight += more * size(row);
            }
        }
        self.proven(&rows, &weights, RowsUsed::All)
    }

    /// The combination without Σ w_k row_k.
    fn rest(&self, rows: &[&TaggedRow], weights: &[f64]) -> [f64; UNKNOWNS] {
        let mut rest = *self.combination.as_array();
        for (row, weight) in rows.iter().zip(weights) {
            for (rest, entry) in rest.iter_mut().zip(&row.row) {
                *rest -= weight * entry;
            }
        }
        rest
    }

    /// The solution by these weights, if they are one.
    fn proven(&self, rows: &[&TaggedRow], weights: &[f64], kind: RowsUsed) -> Option<Solution> {
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        // Rounding is no term; what is left out counts as error.
        let smallest = 1e-9 * largest(weights).min(1.0);
        let terms = rows.iter().zip(weights);
        let (rows, weights): (Vec<&TaggedRow>, Vec<f64>) =
            terms.filter(|(_, w)| w.abs() > smallest).unzip();
        let residual = largest(&self.rest(&rows, &weights));
        let variance: f64 = rows
            .iter()
            .zip(&weights)
            .map(|(row, weight)| (weight / row.weight).powi(2))
            .sum();
        let holds = residual <= PROOF * largest(self.combination.as_array());
        if !holds || !variance.is_finite() {
            return None;
        }
        let mut terms: Vec<Term> = rows
            .iter()
            .zip(&weights)
            .map(|(row, &weight)| Term {
                position: row.leg,
                moment: match row.source {
                    RowSource::Dwell => SeenDuring::Dwell,
                    RowSource::Move { fraction } => SeenDuring::Move { fraction },
                },
                channel: row.channel,
                weight,
            })
            .collect();
        terms.sort_by_key(|t| (t.position, t.channel.name()));
        let measured = self.azimuth_measured;
        let later = |t: &Term| !measured && t.channel == Channel::Z && t.position > 0;
        Some(Solution {
            combination: self.combination,
            order: self.order,
            rows: kind,
            residual,
            sigma_deg_per_h: variance.sqrt(),
            uses_change_of_psi_y: terms.iter().any(later),
            terms,
        })
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
    let size = length(target);
    let mut rest = *target;
    let mut fresh: Vec<[f64; UNKNOWNS]> = rows.iter().map(|r| r.row).collect();
    let mut chosen = Vec::new();
    while counts(length(&rest), size) && chosen.len() < UNKNOWNS {
        let score = |k: usize| {
            let (new, old) = (&fresh[k], &rows[k].row);
            match counts(length(new), length(old)) {
                true => (dot(new, &rest) / length(new)).powi(2),
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

fn normalised(v: &[f64; UNKNOWNS]) -> [f64; UNKNOWNS] {
    let size = length(v);
    v.map(|x| x / size)
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

    fn solve(positions: &[Position], combination: &Combination) -> Result<Solution, NoSolution> {
        let platform = PlatformConfig::default().check().unwrap();
        let held = positions.iter().map(|p| ScheduledPosition::new(*p, 1000.0));
        let timeline = Timeline::new(
            &platform.clone().into(),
            &Schedule::new(held.collect()).unwrap(),
        )
        .unwrap();
        let model = CovarianceModel::new(&platform);
        let observability = Observability::analyze(&model, &timeline).unwrap();
        Solution::find(&model, &timeline, &observability, combination)
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
        let none = solve(&positions, &Combination::single(D::SZ));
        assert_eq!(none, Err(NoSolution::NotObservable));
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
