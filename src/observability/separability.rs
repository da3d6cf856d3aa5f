//! Separability of the coefficients by least squares within the row space, for reports; searches
//! have `LogSeparability`.
//!
//! With X the weighted rows, columns scaled to length one, separability is
//! `1/√((XᵀX)⁻¹)_ii`: the inverse of coefficient i's variance inflation.

use super::regressor::UNKNOWNS;
use super::row_space::{AllRows, RowSpace, unit};
use super::singular::Singular;
use crate::drift::{CoefficientVector, DriftCoefficient};

/// Separability of each coefficient by weighted `rows`, whose space is `space` up to their weights;
/// zero for those that have no order, and only for them.
pub(super) fn of_rows(
    rows: &[[f64; UNKNOWNS]],
    space: &RowSpace<UNKNOWNS>,
    has_order: impl Fn(DriftCoefficient) -> bool,
) -> CoefficientVector {
    let all = AllRows::new(space, rows);
    CoefficientVector::from_fn(|i, _| {
        if !has_order(DriftCoefficient::ALL[i]) {
            return 0.0;
        }
        let squares: f64 = rows.iter().map(|row| row[i] * row[i]).sum();
        // 1 but for rounding where no other coefficient has anything in common with this one.
        let inflation = |variance: f64| (squares * variance).max(1.0);
        all.variance(&unit(i))
            .map_or(0.0, |variance| inflation(variance).sqrt().recip())
    })
}

/// Condition number of weighted `rows` over the first `unknowns`, columns scaled to length one;
/// infinite when `space` is short of rank, and only then.
pub(super) fn condition_number(
    rows: &[[f64; UNKNOWNS]],
    space: &RowSpace<UNKNOWNS>,
    unknowns: usize,
) -> f64 {
    if space.rank() < unknowns {
        return f64::INFINITY;
    }
    let lengths: Vec<f64> = (0..unknowns)
        .map(|j| rows.iter().map(|row| row[j] * row[j]).sum::<f64>().sqrt())
        .collect();
    let svd = Singular::of(rows.len(), unknowns, |i, j| rows[i][j] / lengths[j]);
    let (largest, smallest) = (svd.values[0], svd.values[unknowns - 1]);
    // Weights may differ so much that doubles do not hold the smallest.
    largest / smallest.max(f64::EPSILON * largest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Position;
    use crate::covariance::CovarianceModel;
    use crate::motion::Timeline;
    use crate::observability::regressor::{Channel, Regressor};
    use crate::platform::PlatformConfig;
    use crate::schedule::{Schedule, ScheduledPosition};

    /// Separability of each coefficient at positions given in degrees, 1000 s each.
    fn separability_at(positions: &[[f64; 3]], channels: &[Channel]) -> CoefficientVector {
        let platform = PlatformConfig::default().check().unwrap();
        let held = positions
            .iter()
            .map(|p| ScheduledPosition::new(Position::from_deg(p[0], p[1], p[2]), 1000.0));
        let schedule = Schedule::new(held.collect()).unwrap();
        let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
        let regressor = Regressor::new(&CovarianceModel::new(&platform), &timeline);
        let space = RowSpace::of(&regressor.geometry(channels));
        of_rows(&regressor.weighted(channels), &space, |c| {
            space.contains(&unit(c.index()))
        })
    }

    #[test]
    fn rounding_noise_is_no_signature() {
        // The paper's two positions: D_FX and D_SX enter ε_x as (1, −1) and (1, 1).
        let two = separability_at(&[[0.0, 0.0, 0.0], [180.0, 0.0, 0.0]], &Channel::ALL);
        for (name, expected) in [("D_FX", 1.0), ("D_SX", 1.0), ("D_OX", 0.0), ("D_IX", 0.0)] {
            let c = crate::drift::DriftCoefficient::from_name(name).unwrap();
            assert!((two[c.index()] - expected).abs() < 1e-9, "{name}: {two}");
        }
        // All 24 axis-aligned positions treat the three constant drifts alike.
        let all = crate::schedule::standard::StandardScheme::from_name("axis-24").unwrap();
        let degrees: Vec<[f64; 3]> = all.positions().into_iter().map(Position::to_deg).collect();
        let first = separability_at(&degrees, &[Channel::X, Channel::Z]);
        assert!((first[0] - first[1]).abs() < 1e-9 && (first[1] - first[2]).abs() < 1e-9);
    }
}
