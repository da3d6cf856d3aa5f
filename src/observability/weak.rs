//! Combinations that a schedule tells worst, by name and by what they are seen through.
//!
//! The rows of all channels, weighted by 1/σ of their channel, columns in °/h (per g), ω_N ψ_y(0)
//! eliminated, have singular values 1/σ: the right singular vectors of the smallest are the
//! combinations that the schedule knows least. Only combinations that are observable by rank are
//! looked at, so that the values of the others are zero and not what rounding makes of it.

use super::Order;
use super::combinations::Combination;
use super::regressor::{Channel, Regressor, TaggedRow};
use super::row_space::RowSpace;
use super::singular::Singular;
use crate::covariance::CovarianceModel;
use crate::drift::{COEFFICIENTS, CoefficientVector};
use crate::motion::Timeline;

/// Parts of a combination below this share of its largest are not named.
pub const NAMED: f64 = 0.05;

/// A combination of coefficients, how well it is known, and through what.
#[derive(Debug, Clone, PartialEq)]
pub struct WeakCombination {
    /// The combination, of length one.
    pub combination: Combination,
    /// 1σ by the channels of the dwells, each dwell on its own, °/h.
    pub channel_sigma_deg_per_h: f64,
    /// Shares of the information on it by the channels x, z, y; they add up to one.
    pub shares: [f64; 3],
    /// The order of the channel y: first where the azimuth is measured.
    pub vertical_order: Order,
}

impl WeakCombination {
    /// Its name: weights relative to the largest, small ones left out.
    pub fn name(&self) -> Combination {
        self.combination.rounded(NAMED)
    }

    /// The order through which it is seen: second where the order-1 channels show less than
    /// a millionth of it.
    pub fn seen_through(&self) -> Order {
        let [x, z, _] = self.shares;
        if x + z < 1e-6 {
            self.vertical_order
        } else {
            Order::First
        }
    }
}

/// The singular values (1/σ in (°/h)⁻¹, largest first, zero for what is not observable) and the
/// combinations that belong to them, weakest first, without those that are not observable.
pub fn weak_combinations(
    model: &CovarianceModel,
    timeline: &Timeline,
) -> (Vec<f64>, Vec<WeakCombination>) {
    let regressor = Regressor::new(model, timeline);
    let tagged = regressor.tagged(&Channel::ALL);
    let rows = without_azimuth(&tagged);
    let seen: Vec<CoefficientVector> = RowSpace::of(&regressor.geometry(&Channel::ALL))
        .without(COEFFICIENTS)
        .iter()
        .map(|vector| CoefficientVector::from_fn(|j, _| vector[j]))
        .collect();
    let svd = Singular::of(rows.len(), seen.len(), |i, k| rows[i].dot(&seen[k]));
    let mut weak = Vec::new();
    for k in (0..seen.len()).rev().filter(|&k| svd.values[k] > 0.0) {
        let parts = seen.iter().enumerate();
        let vector: CoefficientVector = parts.map(|(j, s)| s * svd.vector(k, j)).sum();
        weak.push(WeakCombination {
            combination: Combination::from_weights(&vector, 0.0),
            channel_sigma_deg_per_h: svd.values[k].recip(),
            shares: shares(&tagged, &rows, &vector),
            vertical_order: regressor.order(Channel::Y),
        });
    }
    let mut values = svd.values;
    values.resize(COEFFICIENTS, 0.0);
    (values, weak)
}

/// The weighted rows over the coefficients, the column of ω_N ψ_y(0) projected out.
fn without_azimuth(tagged: &[TaggedRow]) -> Vec<CoefficientVector> {
    let column: Vec<f64> = tagged
        .iter()
        .map(|t| t.row[COEFFICIENTS] * t.weight)
        .collect();
    let square: f64 = column.iter().map(|a| a * a).sum();
    let mut rows: Vec<CoefficientVector> = tagged
        .iter()
        .map(|t| CoefficientVector::from_fn(|j, _| t.row[j] * t.weight))
        .collect();
    if square > 0.0 {
        let mut along = CoefficientVector::zeros();
        for (row, a) in rows.iter().zip(&column) {
            along += row * (a / square);
        }
        for (row, a) in rows.iter_mut().zip(&column) {
            *row -= along * *a;
        }
    }
    rows
}

/// What the channels x, z, y contribute to the information on `vector`, as shares.
fn shares(
    tagged: &[TaggedRow],
    rows: &[CoefficientVector],
    vector: &CoefficientVector,
) -> [f64; 3] {
    let mut parts = [0.0; 3];
    for (t, row) in tagged.iter().zip(rows) {
        let part = match t.channel {
            Channel::X => 0,
            Channel::Z | Channel::Azimuth => 1,
            Channel::Y => 2,
        };
        parts[part] += row.dot(vector).powi(2);
    }
    let sum: f64 = parts.iter().sum();
    parts.map(|p| p / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::PlatformConfig;
    use crate::schedule::standard::StandardScheme;

    #[test]
    fn the_trace_is_weakest_and_seen_through_the_second_derivative_only() {
        let platform = PlatformConfig::default().check().unwrap();
        let schedule = StandardScheme::Icosahedron12
            .schedule(12_000.0, &platform.clone().into())
            .unwrap();
        let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
        let (values, weak) = weak_combinations(&CovarianceModel::new(&platform), &timeline);
        assert_eq!((values.len(), weak.len()), (12, 12));
        assert_eq!(weak[0].name().to_string(), "D_IX + D_IY + D_IZ");
        assert_eq!(weak[0].seen_through(), Order::Second);
        assert_eq!(weak[1].seen_through(), Order::First);
        assert!(weak[0].channel_sigma_deg_per_h > 3.0 * weak[1].channel_sigma_deg_per_h);
        for w in &weak {
            assert!((w.shares.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }
}
