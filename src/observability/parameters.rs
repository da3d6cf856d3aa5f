//! Order and separability of every estimated parameter of a full error model.
//!
//! **Separability** is read from the information E on the parameters without their priors:
//! s_i = 1/√(E_ii (E⁻¹)_ii), the share of its signature that is its own, 0 where E does not tell it.
//! It does not depend on units. Of the twelve coefficients the separability by the ε^n expansions, with
//! ψ_y(0) unknown, is beside it in [`Observability`]; this one knows ψ(0) as well as the prior does.
//!
//! **Orders** belong to the paper's channels, and drift parameters have them: of the quadratic ones by
//! the row spaces of the same channels over all drift parameters. The others have the order in which
//! they enter: errors of the accelerometers and of gravity show in δZ itself (0); torquer errors as
//! jumps of ψ^n over a move that is not measured (0), or else within dwells and measured moves (1).

use nalgebra::DMatrix;

use super::regressor::{Regressor, RowSource, TaggedRow};
use super::{Channel, Observability, Order, RANK_TOLERANCE, UNKNOWNS};
use crate::covariance::CovarianceModel;
use crate::drift::COEFFICIENTS;
use crate::model::{Instrument, Role};
use crate::motion::Timeline;

/// What a schedule makes of one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterObservability {
    /// Highest derivative of the measurement that a solution needs; none: not observable.
    pub order: Option<Order>,
    /// 0 to 1; none: known exactly before the test.
    pub separability: Option<f64>,
}

/// Of each estimated parameter; `triangle` is one of rows of the information on them, columns in any
/// units, zero where a parameter is known exactly.
pub(crate) fn of_parameters(
    model: &CovarianceModel,
    timeline: &Timeline,
    observability: &Observability,
    triangle: &DMatrix<f64>,
) -> Vec<ParameterObservability> {
    let parameters = model.errors.parameters();
    let effects = model.errors.effects();
    let separability = separability(triangle);
    let quadratic = quadratic_orders(model, timeline);
    let by_moves = match turns_unmeasured(model, timeline) {
        true => Order::Zero,
        false => Order::First,
    };
    let estimated = parameters.iter().take_while(|p| p.role == Role::Estimated);
    let of = |k: usize| {
        let on_gyro = effects[k]
            .iter()
            .any(|e| matches!(e.on, Instrument::Gyro(_)));
        match effects[k].iter().any(|e| e.feature.is_rate()) {
            true => Some(by_moves),
            false if on_gyro => quadratic.get(k - COEFFICIENTS).copied().flatten(),
            false => Some(Order::Zero),
        }
    };
    estimated
        .enumerate()
        .map(|(k, p)| {
            let separability = (p.prior_sigma > 0.0).then(|| separability[k]);
            let order = match k < COEFFICIENTS {
                true => observability.orders[k],
                false => of(k).filter(|_| separability != Some(0.0)),
            };
            ParameterObservability {
                order,
                separability,
            }
        })
        .collect()
}

/// 1/√(E_ii (E⁻¹)_ii) of each column of a triangle R with E = RᵀR; 0 where E is singular in its
/// direction.
fn separability(triangle: &DMatrix<f64>) -> Vec<f64> {
    let lengths: Vec<f64> = triangle.column_iter().map(|c| c.norm()).collect();
    let seen: Vec<usize> = (0..lengths.len()).filter(|&j| lengths[j] > 0.0).collect();
    let mut all = vec![0.0; lengths.len()];
    if seen.is_empty() {
        return all;
    }
    // With fewer rows than columns the decomposition would leave out directions without information.
    let height = triangle.nrows().max(seen.len());
    let unit = DMatrix::from_fn(height, seen.len(), |i, j| match i < triangle.nrows() {
        true => triangle[(i, seen[j])] / lengths[seen[j]],
        false => 0.0,
    });
    // It converges on numbers that are finite, and these are.
    let Some(svd) = unit.try_svd(false, true, f64::EPSILON, 0) else {
        return all;
    };
    let Some(directions) = &svd.v_t else {
        return all;
    };
    /// Of an information that double precision has added up: below this it is rounding.
    const ROUNDING: f64 = 1e-10;
    let least = ROUNDING * svd.singular_values.max();
    for (column, &j) in seen.iter().enumerate() {
        let (mut lost, mut spread) = (0.0, 0.0);
        for (k, value) in svd.singular_values.iter().enumerate() {
            let share = directions[(k, column)];
            match *value > least {
                true => spread += (share / value).powi(2),
                false => lost += share * share,
            }
        }
        if lost <= RANK_TOLERANCE * RANK_TOLERANCE {
            all[j] = spread.sqrt().recip().min(1.0);
        }
    }
    all
}

/// Whether the platform turns while nothing is measured, in a way that the torquers see.
fn turns_unmeasured(model: &CovarianceModel, timeline: &Timeline) -> bool {
    let moves = timeline.legs().iter().filter_map(|leg| leg.arrival);
    let turning = |m: &crate::motion::Move| {
        let measures = m.measured && m.duration_s > 0.0;
        !measures && m.change.iter().any(|c| *c != 0.0)
    };
    !model.frame_hold && moves.into_iter().any(|m| turning(&m))
}

/// Orders of the parameters after the twelve coefficients, as far as they are of drift by gravity.
fn quadratic_orders(model: &CovarianceModel, timeline: &Timeline) -> Vec<Option<Order>> {
    let count = model.errors.estimated() - COEFFICIENTS;
    if count == 0 {
        return Vec::new();
    }
    let regressor = Regressor::new(model, timeline);
    let row = |t: &TaggedRow| -> Vec<f64> {
        let leg = &timeline.legs()[t.leg];
        let attitude = match (t.source, &leg.arrival) {
            (RowSource::Move { fraction }, Some(m)) => m.position_at(fraction).attitude(),
            _ => leg.attitude,
        };
        let drift = model.drift_by_gravity(&attitude);
        let of_channel = |k: usize| match t.channel {
            Channel::Azimuth => 0.0,
            channel => drift[(channel.axis(), COEFFICIENTS + k)],
        };
        let more = (0..count).map(of_channel);
        let all = t.row.iter().copied().chain(more);
        all.map(|v| v * t.share).collect()
    };
    let space = |channels: &[Channel]| {
        let rows: Vec<Vec<f64>> = regressor.tagged(channels).iter().map(row).collect();
        let matrix = DMatrix::from_fn(rows.len(), UNKNOWNS + count, |i, j| rows[i][j]);
        Space::of(matrix)
    };
    let [first, all] = [space(regressor.first()), space(&Channel::ALL)];
    (0..count)
        .map(|k| {
            let column = UNKNOWNS + k;
            match (first.contains(column), all.contains(column)) {
                (true, _) => Some(Order::First),
                (false, true) => Some(Order::Second),
                (false, false) => None,
            }
        })
        .collect()
}

/// A row space: how much of each unknown lies in it.
struct Space(Vec<f64>);

impl Space {
    fn of(rows: DMatrix<f64>) -> Self {
        let columns = rows.ncols();
        let svd = match rows.nrows() {
            0 => None,
            _ => rows.try_svd(false, true, f64::EPSILON, 0),
        };
        let share = |column: usize| {
            let svd = svd.as_ref()?;
            let least = RANK_TOLERANCE * svd.singular_values.max();
            let values = svd.singular_values.iter().enumerate();
            let directions = svd.v_t.as_ref()?;
            let counted = values.filter(|(_, value)| **value > least);
            Some(counted.map(|(k, _)| directions[(k, column)].powi(2)).sum())
        };
        Self((0..columns).map(|j| share(j).unwrap_or(0.0)).collect())
    }

    fn contains(&self, column: usize) -> bool {
        1.0 - self.0[column] <= RANK_TOLERANCE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separability_is_the_share_of_a_column_that_is_its_own() {
        // Columns at 30°, one that is twice another, one on its own, one of nothing.
        let (c, s) = (0.75_f64.sqrt(), 0.5);
        let triangle = DMatrix::from_row_slice(
            4,
            6,
            &[
                1.0,
                7.0 * c,
                0.0,
                0.0,
                0.0,
                0.0, //
                0.0,
                7.0 * s,
                0.0,
                0.0,
                0.0,
                0.0, //
                0.0,
                0.0,
                1.0,
                2.0,
                0.0,
                0.0, //
                0.0,
                0.0,
                0.0,
                0.0,
                1e-9,
                0.0,
            ],
        );
        let found = separability(&triangle);
        for (found, expected) in found.iter().zip([0.5, 0.5, 0.0, 0.0, 1.0, 0.0]) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        // Nothing is told of what is known exactly.
        assert_eq!(separability(&DMatrix::zeros(3, 3)), [0.0; 3]);
        assert!(separability(&DMatrix::zeros(0, 0)).is_empty());
    }
}
