//! Observability order and separability from the ε^n expansions (22), (23).
//!
//! Within one dwell the measurement Z and its derivatives give (13)–(18), (25), (26): ψ_x^n and
//! ψ_z^n from Z itself; ε_x^n and ε_z^n − ω_N ψ_y^n from Ż; ε_y^n and ψ̇_y^n from Z̈. Over a
//! schedule, every position adds one row per channel in the unknowns D and ω_N ψ_y^n(0):
//!
//! ```text
//! x (order 1): A_x D = ε_x       z (order 1): A_z D − ω_N ψ_y(0) = η_z      y (order 2): A_y D = ε_y
//! ```
//!
//! (the drift of ψ_y with time is known once ε_y is, so it is of order 2). The **observability
//! order** of a combination is the smallest d such that it lies in the row space of the channels
//! of order ≤ d; the paper's observable degree is its inverse. It is geometry only: 0.01° off an
//! axis already counts as oblique.
//!
//! **Separability** measures how far: of coefficient i, ‖(I − Π_{−i}) s_i‖ / ‖s_i‖ with s_i its
//! column of the stacked rows, each weighted by 1/σ of its channel in its dwell, and Π_{−i} the
//! projector on the other columns. 1: its signature is its own; 0: not separable.

mod regressor;
pub mod separability;

use faer::Mat;

use crate::covariance::CovarianceModel;
use crate::drift::{COEFFICIENTS, CoefficientVector, DriftCoefficient};
use crate::error::{Error, Result};
use crate::motion::Timeline;
pub use regressor::Channel;
use regressor::{Regressor, UNKNOWNS};

/// Relative size below which a singular value counts as zero, and a residual as none.
const RANK_TOLERANCE: f64 = 1e-9;

/// Observability order: the highest derivative of the measurement that a solution needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Order {
    /// From the measurement itself.
    Zero,
    /// Needs its first derivative.
    First,
    /// Needs its second derivative.
    Second,
}

impl Order {
    /// As a number: 0, 1, 2.
    pub const fn number(self) -> u8 {
        match self {
            Self::Zero => 0,
            Self::First => 1,
            Self::Second => 2,
        }
    }
}

/// What a schedule makes observable.
#[derive(Debug, Clone, PartialEq)]
pub struct Observability {
    /// Order of each coefficient; none: not observable.
    pub orders: [Option<Order>; COEFFICIENTS],
    /// Separability of each coefficient by the order-1 channels alone, 0 to 1.
    pub separability_first_order: CoefficientVector,
    /// Separability of each coefficient by all channels, 0 to 1.
    pub separability: CoefficientVector,
    /// Rank of the rows of all channels.
    pub rank: usize,
    /// Number of unknowns: the coefficients and ω_N ψ_y(0), the latter not at the poles.
    pub unknowns: usize,
    /// Condition number of the weighted rows, columns scaled to length one; infinite when the
    /// rank is short.
    pub condition_number: f64,
    /// The combinations that stay unobservable, by name.
    pub unobservable: Vec<String>,
}

impl Observability {
    /// Analyses `timeline`.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when a singular value decomposition does not converge.
    pub fn analyze(model: &CovarianceModel, timeline: &Timeline) -> Result<Self> {
        let regressor = Regressor::new(model, timeline);
        let unknowns = regressor.unknowns();
        let first = RowSpace::of(&regressor.geometry(&[Channel::X, Channel::Z]))?;
        let all = RowSpace::of(&regressor.geometry(&[Channel::X, Channel::Z, Channel::Y]))?;
        let orders = DriftCoefficient::ALL.map(|c| {
            if first.contains_unit(c.index()) {
                Some(Order::First)
            } else if all.contains_unit(c.index()) {
                Some(Order::Second)
            } else {
                None
            }
        });
        let (separability_first_order, _) =
            separability::by_svd(&regressor.weighted(&[Channel::X, Channel::Z]))?;
        let (separability, condition_number) =
            separability::by_svd(&regressor.weighted(&[Channel::X, Channel::Z, Channel::Y]))?;
        Ok(Self {
            orders,
            separability_first_order,
            separability,
            rank: all.rank(),
            unknowns,
            condition_number,
            unobservable: all.missing_combinations(unknowns),
        })
    }
}

/// An orthonormal basis of the row space of some rows.
struct RowSpace {
    /// Basis vectors.
    basis: Vec<[f64; UNKNOWNS]>,
}

impl RowSpace {
    fn of(rows: &[[f64; UNKNOWNS]]) -> Result<Self> {
        if rows.is_empty() {
            return Ok(Self { basis: Vec::new() });
        }
        let matrix = Mat::from_fn(rows.len(), UNKNOWNS, |i, j| rows[i][j]);
        let svd = matrix.thin_svd().map_err(|_| svd_failed())?;
        let values = svd.S().column_vector();
        let largest = values[0];
        let basis = (0..values.nrows())
            .filter(|&k| values[k] > RANK_TOLERANCE * largest)
            .map(|k| std::array::from_fn(|j| svd.V()[(j, k)]))
            .collect();
        Ok(Self { basis })
    }

    fn rank(&self) -> usize {
        self.basis.len()
    }

    /// What is left of unit vector `i` outside the space.
    fn residual(&self, i: usize) -> [f64; UNKNOWNS] {
        let mut rest = [0.0; UNKNOWNS];
        rest[i] = 1.0;
        for b in &self.basis {
            let along = b[i];
            for (r, v) in rest.iter_mut().zip(b) {
                *r -= along * v;
            }
        }
        rest
    }

    fn contains_unit(&self, i: usize) -> bool {
        self.residual(i).iter().all(|r| r.abs() < 1e-7)
    }

    /// The orthogonal complement within the first `unknowns` coordinates, as readable
    /// combinations: reduced to echelon form, so that each starts with a coefficient of one.
    fn missing_combinations(&self, unknowns: usize) -> Vec<String> {
        let mut rows: Vec<[f64; UNKNOWNS]> = (0..unknowns).map(|i| self.residual(i)).collect();
        let mut echelon: Vec<[f64; UNKNOWNS]> = Vec::new();
        for column in 0..unknowns {
            let pivot = (0..rows.len())
                .max_by(|&a, &b| rows[a][column].abs().total_cmp(&rows[b][column].abs()));
            let Some(pivot) = pivot else { break };
            if rows[pivot][column].abs() < 1e-7 {
                continue;
            }
            let mut row = rows.swap_remove(pivot);
            let scale = row[column];
            row.iter_mut().for_each(|v| *v /= scale);
            for other in rows.iter_mut().chain(echelon.iter_mut()) {
                let factor = other[column];
                for (o, r) in other.iter_mut().zip(&row) {
                    *o -= factor * r;
                }
            }
            echelon.push(row);
        }
        echelon.iter().map(name_combination).collect()
    }
}

fn svd_failed() -> Error {
    Error::numerical("the singular value decomposition of the regressor did not converge")
}

/// "D_IX + D_IY + 0.5 D_IZ".
fn name_combination(row: &[f64; UNKNOWNS]) -> String {
    let mut text = String::new();
    for (i, &value) in row.iter().enumerate() {
        if value.abs() < 1e-6 {
            continue;
        }
        let name = match DriftCoefficient::ALL.get(i) {
            Some(c) => c.name(),
            None => "omega_N psi_y(0)",
        };
        let sign = match (text.is_empty(), value < 0.0) {
            (true, false) => "",
            (true, true) => "-",
            (false, false) => " + ",
            (false, true) => " - ",
        };
        text.push_str(sign);
        if (value.abs() - 1.0).abs() > 1e-6 {
            text.push_str(&format!("{:.3} ", value.abs()));
        }
        text.push_str(name);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{Attitude, Position};
    use crate::platform::PlatformConfig;
    use crate::schedule::{Schedule, ScheduledPosition};

    fn analyze_at(latitude_deg: f64, positions: &[Position]) -> Observability {
        let mut config = PlatformConfig::default();
        config.site.latitude_deg = latitude_deg;
        let platform = config.check().unwrap();
        let held = positions.iter().map(|p| ScheduledPosition::new(*p, 1000.0));
        let schedule = Schedule::new(held.collect()).unwrap();
        let timeline = Timeline::new(&platform, &schedule).unwrap();
        Observability::analyze(&CovarianceModel::new(&platform), &timeline).unwrap()
    }

    fn analyze(positions: &[Position]) -> Observability {
        analyze_at(28.2, positions)
    }

    fn generic(count: usize) -> Vec<Position> {
        (0..count)
            .map(|k| {
                let k = k as f64;
                let angles = [0.3 + 2.1 * k, 1.1 * k * k - 0.7, 1.7 * k * k * k - 0.4];
                Position::from_array(angles.map(|a| a % std::f64::consts::TAU))
            })
            .collect()
    }

    fn axis_aligned() -> Vec<Position> {
        let quarter = std::f64::consts::FRAC_PI_2;
        let mut all = Vec::new();
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                for turn in 0..4 {
                    let mut u = nalgebra::Vector3::zeros();
                    u[axis] = sign;
                    let heading = f64::from(turn) * quarter;
                    all.push(Attitude::with_gravity_along(u, heading).unwrap().position());
                }
            }
        }
        all
    }

    #[test]
    fn five_generic_positions_observe_everything_and_four_leave_one_combination() {
        let four = analyze(&generic(4));
        assert_eq!(
            (four.rank, four.unknowns, four.unobservable.len()),
            (12, 13, 1)
        );
        let five = analyze(&generic(5));
        assert_eq!((five.rank, five.unobservable.len()), (13, 0));
        assert!(five.condition_number.is_finite());
        assert!(five.orders.iter().all(Option::is_some));
    }

    #[test]
    fn input_coefficients_are_of_order_two_always_and_the_others_of_order_one() {
        for positions in [generic(12), axis_aligned()] {
            let o = analyze(&positions);
            for c in DriftCoefficient::ALL {
                let input = c.kind() == crate::drift::DriftKind::Input;
                let expected = if input { Order::Second } else { Order::First };
                assert_eq!(o.orders[c.index()], Some(expected), "{}", c.name());
                let first = o.separability_first_order[c.index()];
                assert_eq!(first < 1e-6, input, "{} {first}", c.name());
                assert!(o.separability[c.index()] > 1e-3);
                assert!(o.separability[c.index()] <= 1.0 + 1e-12);
            }
        }
    }

    #[test]
    fn ranks_of_epsilon_x_are_11_and_9() {
        let model = CovarianceModel::new(&PlatformConfig::default().check().unwrap());
        let rank = |positions: &[Position]| {
            let held = positions.iter().map(|p| ScheduledPosition::new(*p, 1000.0));
            let platform = PlatformConfig::default().check().unwrap();
            let schedule = Schedule::new(held.collect()).unwrap();
            let timeline = Timeline::new(&platform, &schedule).unwrap();
            let rows = Regressor::new(&model, &timeline).geometry(&[Channel::X]);
            RowSpace::of(&rows).unwrap().rank()
        };
        assert_eq!(rank(&generic(30)), 11);
        assert_eq!(rank(&axis_aligned()), 9);
    }

    #[test]
    fn one_position_names_what_it_cannot_tell() {
        let o = analyze(&[Position::default()]);
        // (27): only D_FX − D_SX, D_FY − D_IY and D_FZ − D_SZ − ω_N ψ_y are seen.
        assert_eq!(o.rank, 3);
        assert!(
            o.unobservable.contains(&"D_FX + D_SX".to_owned()),
            "{:?}",
            o.unobservable
        );
        assert!(o.unobservable.contains(&"D_FY + D_IY".to_owned()));
        assert!(o.unobservable.contains(&"D_OX".to_owned()));
        assert!(o.condition_number.is_infinite());
        assert!(o.orders.iter().all(Option::is_none));
        assert_eq!(o.separability.max(), 0.0);
    }

    #[test]
    fn at_the_poles_psi_y_is_no_unknown_and_the_input_trace_is_lost() {
        let o = analyze_at(90.0, &generic(12));
        assert_eq!(o.unknowns, 12);
        assert_eq!(o.rank, 11);
        assert_eq!(o.unobservable, ["D_IX + D_IY + D_IZ"]);
    }
}
