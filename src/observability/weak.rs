//! Combinations that a schedule tells worst, by name and by what they are seen through.
//!
//! The rows of all channels, weighted by 1/σ of their channel, columns in °/h (per g), ω_N ψ_y(0)
//! eliminated, have singular values 1/σ: the right singular vectors of the smallest are the
//! combinations that the schedule knows least. Those of value zero are unobservable.

use super::Order;
use super::combinations::Combination;
use super::regressor::{Channel, Regressor, TaggedRow};
use super::singular::Singular;
use crate::covariance::CovarianceModel;
use crate::drift::{COEFFICIENTS, CoefficientVector};
use crate::error::Result;
use crate::motion::Timeline;

/// Relative size below which a singular value counts as zero.
const NULL: f64 = 1e-10;
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
            Order::Second
        } else {
            Order::First
        }
    }
}

/// The singular values (1/σ in (°/h)⁻¹, largest first) and the combinations that belong to them,
/// weakest first, without those that are not seen at all.
///
/// # Errors
///
/// [`Error::is_numerical`](crate::Error::is_numerical) when the singular value decomposition
/// does not converge.
pub fn weak_combinations(
    model: &CovarianceModel,
    timeline: &Timeline,
) -> Result<(Vec<f64>, Vec<WeakCombination>)> {
    let tagged = Regressor::new(model, timeline).tagged(&Channel::ALL);
    let rows = without_azimuth(&tagged);
    if rows.is_empty() {
        return Ok((vec![0.0; COEFFICIENTS], Vec::new()));
    }
    let height = rows.len().max(COEFFICIENTS);
    let svd = Singular::of(height, COEFFICIENTS, |i, j| {
        rows.get(i).map_or(0.0, |r| r[j])
    })?;
    let values = &svd.values;
    let mut weak = Vec::new();
    for k in (0..COEFFICIENTS).rev() {
        if values[k] <= NULL * values[0] {
            continue;
        }
        let vector = CoefficientVector::from_fn(|j, _| svd.vector(k, j));
        weak.push(WeakCombination {
            combination: Combination::from_weights(&vector, 0.0),
            channel_sigma_deg_per_h: values[k].recip(),
            shares: shares(&tagged, &rows, &vector),
        });
    }
    Ok((svd.values, weak))
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
            .schedule(12_000.0, &platform)
            .unwrap();
        let timeline = Timeline::new(&platform, &schedule).unwrap();
        let (values, weak) =
            weak_combinations(&CovarianceModel::new(&platform), &timeline).unwrap();
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
