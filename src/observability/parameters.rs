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

use nalgebra::{DMatrix, DVector};

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
    let spaces = DriftSpaces::new(model, timeline);
    (COEFFICIENTS..COEFFICIENTS + count)
        .map(|k| spaces.order_of(&[(k, 1.0)]))
        .collect()
}

/// The row spaces of the channels over all drift by gravity.
struct DriftSpaces {
    first: Space,
    all: Space,
    unknowns: usize,
}

impl DriftSpaces {
    fn new(model: &CovarianceModel, timeline: &Timeline) -> Self {
        let count = model.errors.estimated() - COEFFICIENTS;
        let regressor = Regressor::new(model, timeline);
        let row = |t: &TaggedRow| -> Vec<f64> {
            let leg = &timeline.legs()[t.leg];
            let attitude = match (t.source, &leg.arrival) {
                (RowSource::Move { fraction }, Some(m)) => {
                    model.stand.attitude(m.position_at(fraction))
                }
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
        Self {
            first: space(regressor.first()),
            all: space(&Channel::ALL),
            unknowns: UNKNOWNS + count,
        }
    }

    /// Order of a combination of estimated parameters, by index.
    fn order_of(&self, terms: &[(usize, f64)]) -> Option<Order> {
        let mut vector = DVector::zeros(self.unknowns);
        for (parameter, weight) in terms {
            // ω_N ψ_y(0) stands after the twelve coefficients.
            let column = match *parameter < COEFFICIENTS {
                true => *parameter,
                false => parameter + UNKNOWNS - COEFFICIENTS,
            };
            vector[column] += weight;
        }
        match (self.first.contains(&vector), self.all.contains(&vector)) {
            (true, _) => Some(Order::First),
            (false, true) => Some(Order::Second),
            (false, false) => None,
        }
    }
}

/// A row space: an orthonormal basis of it.
struct Space(Vec<DVector<f64>>);

impl Space {
    fn of(rows: DMatrix<f64>) -> Self {
        let svd = match rows.nrows() {
            0 => None,
            _ => rows.try_svd(false, true, f64::EPSILON, 0),
        };
        let Some((values, directions)) = svd.and_then(|s| Some((s.singular_values, s.v_t?))) else {
            return Self(Vec::new());
        };
        let least = RANK_TOLERANCE * values.max();
        let counted = (0..values.len()).filter(|&k| values[k] > least);
        Self(counted.map(|k| directions.row(k).transpose()).collect())
    }

    /// Whether a vector lies in it; what is left of it is held against its length.
    fn contains(&self, vector: &DVector<f64>) -> bool {
        let parts = self.0.iter().map(|b| b.dot(vector).powi(2));
        let inside: f64 = parts.sum();
        1.0 - inside / vector.norm_squared() <= RANK_TOLERANCE
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

    /// Drift ε = λ(u) u, u the vertical in the platform, is of order 2 under every schedule, and every
    /// other drift by gravity is of order 1 under a good one: in any mounting.
    #[test]
    fn the_larger_trace_theorem() {
        use crate::attitude::Position;
        use crate::observability::named::vertical;
        use crate::platform::PlatformConfig;
        use crate::schedule::{Schedule, ScheduledPosition};

        const AXES: [[&str; 3]; 3] = [["-z", "-z", "+x"], ["+y", "+x", "-y"], ["-y", "+z", "+x"]];
        for (case, axes) in AXES.into_iter().enumerate() {
            let config: PlatformConfig = serde_json::from_value(serde_json::json!({
                "errors": { "quadratic_drift_deg_per_h_per_g2": 0.1 },
                "gyro": { "output_axis": { "X": axes[0], "Y": axes[1], "Z": axes[2] } },
            }))
            .unwrap();
            let platform = config.check().unwrap();
            let model = CovarianceModel::new(&platform);
            let parameters = model.errors.parameters();
            let index = |name: &str| parameters.iter().position(|p| p.name == name).unwrap();
            let combinations: Vec<Vec<(usize, f64)>> = vertical(&model.errors)
                .iter()
                .map(|c| c.terms.iter().map(|t| (index(t.name), t.weight)).collect())
                .collect();
            assert_eq!(combinations.len(), 4);
            if case == 0 {
                let names: Vec<String> = vertical(&model.errors).iter().map(|c| c.sum()).collect();
                let papers = [
                    "D_IX + D_IY + D_IZ",
                    "D_IIX + D_IOZ - D_ISY",
                    "D_IIY + D_ISX + D_ISZ",
                    "D_IIZ - D_IOX - D_IOY",
                ];
                assert_eq!(names, papers);
            }
            for count in [1, 2, 3, 5, 8, 13, 30] {
                let angles = |k: usize| {
                    let k = (k + 7 * case + 31 * count) as f64;
                    [2.1 * k + 0.3, 1.1 * k * k - 0.7, 1.7 * k * k * k - 0.4]
                        .map(|a| a % std::f64::consts::TAU)
                };
                let held = (0..count).map(|k| {
                    ScheduledPosition::new(Position::from_array(angles(k)), 700.0 + 10.0 * k as f64)
                });
                let schedule = Schedule::new(held.collect()).unwrap();
                let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
                let spaces = DriftSpaces::new(&model, &timeline);
                for combination in &combinations {
                    let order = spaces.order_of(combination);
                    assert!(
                        order.is_none_or(|o| o == Order::Second),
                        "{count}: {order:?}"
                    );
                    assert!(count < 30 || order == Some(Order::Second), "{case}");
                }
                if count < 30 {
                    continue;
                }
                // There are no others: what the first derivatives miss has their dimension, four.
                let unknowns = spaces.unknowns;
                assert_eq!(spaces.first.0.len(), unknowns - combinations.len());
                assert_eq!(spaces.all.0.len(), unknowns);
                // λ(u) of no kind but these: every other sum is of order 1 but for its part of them.
                let mixed: Vec<(usize, f64)> = (0..parameters.len())
                    .map(|k| (k, (1.3 * k as f64 + 0.2).sin()))
                    .collect();
                assert_eq!(spaces.order_of(&mixed), Some(Order::Second));
                let mut rest = DVector::zeros(parameters.len());
                mixed.iter().for_each(|(k, w)| rest[*k] = *w);
                // The four are at right angles.
                for combination in &combinations {
                    let mut v = DVector::zeros(parameters.len());
                    combination.iter().for_each(|(k, w)| v[*k] = *w);
                    let v = v.normalize();
                    rest -= &v * v.dot(&rest);
                }
                let rest: Vec<(usize, f64)> = rest.iter().copied().enumerate().collect();
                assert_eq!(spaces.order_of(&rest), Some(Order::First), "{case}");
            }
        }
    }
}
