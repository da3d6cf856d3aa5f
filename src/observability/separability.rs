//! Separability of the coefficients: by least squares within the row space for reports, by Gram
//! matrix with gradient for searches.
//!
//! With X the weighted rows, columns scaled to length one, separability is
//! `1/√((XᵀX)⁻¹)_ii`: the inverse of coefficient i's variance inflation.

use nalgebra::{Matrix3, SMatrix};

use super::regressor::{Change, Channel, Regressor, RowSource, UNKNOWNS};
use super::row_space::{AllRows, RowSpace, unit};
use super::singular::Singular;
use crate::attitude::UP;
use crate::covariance::CovarianceModel;
use crate::covariance::gradient::LegGradient;
use crate::drift::{
    COEFFICIENTS, CoefficientVector, DriftCoefficient, DriftMatrix, drift_matrix_adjoint,
};
use crate::motion::Timeline;

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

/// ln separability of each coefficient and a way back to the gradient of any function of them.
pub(crate) struct LogSeparability {
    regressor: Regressor,
    gram: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    inverse: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    /// ln s_i.
    pub log: CoefficientVector,
}

impl LogSeparability {
    /// Of all channels of `timeline`; none where some coefficient cannot be separated at all.
    pub fn new(model: &CovarianceModel, timeline: &Timeline) -> Option<Self> {
        let regressor = Regressor::new(model, timeline);
        let mut gram = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        for row in regressor.weighted(&Channel::ALL) {
            let row = nalgebra::SVector::<f64, UNKNOWNS>::from(row);
            gram.ger(1.0, &row, &row, 1.0);
        }
        if !regressor.azimuth_unknown {
            gram[(COEFFICIENTS, COEFFICIENTS)] = 1.0;
        }
        let inverse = nalgebra::Cholesky::new(gram)?.inverse();
        let log =
            CoefficientVector::from_fn(|i, _| -0.5 * libm::log(inverse[(i, i)] * gram[(i, i)]));
        // The Gram matrix has half the digits of its rows: below this it holds rounding.
        (log.min() > -20.0 && log.iter().all(|v| v.is_finite())).then_some(Self {
            regressor,
            gram,
            inverse,
            log,
        })
    }

    /// Adds the gradient of a function with derivatives `slopes` with respect to each ln s_i.
    ///
    /// d ln s_i = ½ q_iᵀ dG q_i/(G⁻¹)_ii − ½ dG_ii/G_ii with q_i column i of G⁻¹.
    pub fn add_gradient(
        &self,
        timeline: &Timeline,
        slopes: &CoefficientVector,
        gradient: &mut [LegGradient],
    ) {
        let mut gram_adjoint = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        for (i, &slope) in slopes.iter().enumerate() {
            let q = self.inverse.column(i);
            gram_adjoint += q * q.transpose() * (0.5 * slope / self.inverse[(i, i)]);
            gram_adjoint[(i, i)] -= 0.5 * slope / self.gram[(i, i)];
        }
        let mut azimuth_adjoint = vec![0.0; timeline.legs().len()];
        for block in &self.regressor.blocks {
            let mut a_adjoint = DriftMatrix::zeros();
            let mut duration = 0.0;
            for channel in [Channel::X, Channel::Z, Channel::Y] {
                let axis = channel.axis();
                let weight = block.weights[axis];
                if weight <= 0.0 || (channel == Channel::Y && !self.regressor.vertical_channel) {
                    continue;
                }
                let row =
                    nalgebra::SVector::<f64, UNKNOWNS>::from(self.regressor.row(block, channel));
                let pulled = gram_adjoint * row * (2.0 * weight);
                for j in 0..COEFFICIENTS {
                    a_adjoint[(axis, j)] = pulled[j] * weight;
                }
                if channel == Channel::Z {
                    azimuth_adjoint[block.leg] += pulled[COEFFICIENTS] * weight;
                }
                duration += pulled.dot(&row) * block.weight_rates[axis];
            }
            add_block(
                timeline,
                block.leg,
                block.source,
                &a_adjoint,
                duration,
                gradient,
            );
        }
        let azimuth_slope = gram_adjoint[(COEFFICIENTS, COEFFICIENTS)];
        self.add_changes(timeline, &azimuth_adjoint, azimuth_slope, gradient);
    }

    /// The part of the gradient that comes through the shares q_k of ψ_y(0) in frame-hold
    /// repositioning: `azimuth_adjoint` with respect to −q_k, leg by leg, and `azimuth_slope`
    /// with respect to the azimuth's own entry of the Gram matrix.
    fn add_changes(
        &self,
        timeline: &Timeline,
        azimuth_adjoint: &[f64],
        azimuth_slope: f64,
        gradient: &mut [LegGradient],
    ) {
        let legs = timeline.legs();
        // ∂f/∂q of the leg at hand, from the last to the first.
        let mut share_adjoint = 0.0;
        for change in self.regressor.changes.iter().rev() {
            let Change {
                leg,
                cosine,
                share,
                weight,
            } = *change;
            share_adjoint -= azimuth_adjoint[leg];
            // The row's square is w² q² (1 − c²); q₊ = c q.
            let slope = azimuth_slope * weight * weight;
            let cosine_adjoint = share * share_adjoint - 2.0 * slope * share * share * cosine;
            share_adjoint = cosine * share_adjoint + 2.0 * slope * share * (1.0 - cosine * cosine);
            let gravity = [leg - 1, leg].map(|k| legs[k].attitude.gravity_c());
            for (k, other) in [(leg - 1, gravity[1]), (leg, gravity[0])] {
                // c = g_k · g_{k−1}, and g is minus the Up row of C.
                let mut c_adjoint = Matrix3::zeros();
                c_adjoint.set_row(UP, &(-cosine_adjoint * other.transpose()));
                let angles = legs[k].attitude.angle_adjoint(legs[k].position, &c_adjoint);
                for (sum, angle) in gradient[k].angles.iter_mut().zip(angles) {
                    *sum += angle;
                }
            }
        }
    }
}

fn add_block(
    timeline: &Timeline,
    leg: usize,
    source: RowSource,
    a_adjoint: &DriftMatrix,
    duration: f64,
    gradient: &mut [LegGradient],
) {
    let l = &timeline.legs()[leg];
    match (source, &l.arrival) {
        (RowSource::Move { fraction }, Some(m)) => {
            let position = m.position_at(fraction);
            let angles = drift_matrix_adjoint(position, &position.attitude(), a_adjoint);
            for (i, angle) in angles.into_iter().enumerate() {
                gradient[leg].angles[i] += fraction * angle;
                gradient[leg - 1].angles[i] += (1.0 - fraction) * angle;
            }
            gradient[leg].move_s += duration;
        }
        _ => {
            let angles = drift_matrix_adjoint(l.position, &l.attitude, a_adjoint);
            for (sum, angle) in gradient[leg].angles.iter_mut().zip(angles) {
                *sum += angle;
            }
            gradient[leg].dwell_s += duration;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Position;
    use crate::platform::{PlatformConfig, Repositioning};
    use crate::schedule::{Schedule, ScheduledPosition};

    #[derive(Clone, Copy)]
    enum Moves {
        Unmeasured,
        Measured,
        FrameHold,
    }

    fn timeline(x: &[f64], moves: Moves) -> (CovarianceModel, Timeline) {
        let mut config = PlatformConfig::default();
        let mut move_s = Some(203.0);
        match moves {
            Moves::Unmeasured => {}
            Moves::Measured => config.motion.measure_moves = true,
            Moves::FrameHold => {
                config.motion.repositioning = Repositioning::FrameHold;
                move_s = None;
            }
        }
        let platform = config.check().unwrap();
        let positions = x.chunks(4).map(|c| ScheduledPosition {
            move_s,
            ..ScheduledPosition::new(Position::from_rad(c[0], c[1], c[2]), c[3])
        });
        let schedule = Schedule::new(positions.collect()).unwrap();
        let timeline = Timeline::new(&platform, &schedule).unwrap();
        (CovarianceModel::new(&platform), timeline)
    }

    #[test]
    fn gram_form_equals_svd_and_its_gradient_is_the_derivative() {
        for measured in [Moves::Unmeasured, Moves::Measured, Moves::FrameHold] {
            let x: Vec<f64> = (0..7)
                .flat_map(|k| {
                    let k = f64::from(k);
                    [
                        0.3 + 2.1 * k,
                        1.1 * k * k,
                        1.7 * k * k * k,
                        403.0 + 71.0 * k,
                    ]
                })
                .collect();
            let slopes = CoefficientVector::from_fn(|i, _| 1.0 - 0.1 * i as f64);
            let value = |x: &[f64]| {
                let (model, timeline) = timeline(x, measured);
                LogSeparability::new(&model, &timeline)
                    .unwrap()
                    .log
                    .dot(&slopes)
            };
            let (model, timeline) = timeline(&x, measured);
            let s = LogSeparability::new(&model, &timeline).unwrap();
            let reported = super::super::Observability::analyze(&model, &timeline).unwrap();
            assert!((s.log.map(f64::exp) - reported.separability).amax() < 1e-8);
            let mut gradient = vec![LegGradient::default(); timeline.legs().len()];
            s.add_gradient(&timeline, &slopes, &mut gradient);
            for i in 0..x.len() {
                let h = if i % 4 == 3 { 1e-2 } else { 1e-5 };
                let (mut hi, mut lo) = (x.clone(), x.clone());
                hi[i] += h;
                lo[i] -= h;
                let numeric = (value(&hi) - value(&lo)) / (2.0 * h);
                let leg = &gradient[i / 4];
                let exact = if i % 4 == 3 {
                    leg.dwell_s
                } else {
                    leg.angles[i % 4]
                };
                assert!((numeric - exact).abs() < 1e-5 * (1.0 + exact.abs()), "{i}");
            }
        }
    }

    /// Separability of each coefficient at positions given in degrees, 1000 s each.
    fn separability_at(positions: &[[f64; 3]], channels: &[Channel]) -> CoefficientVector {
        let platform = PlatformConfig::default().check().unwrap();
        let held = positions
            .iter()
            .map(|p| ScheduledPosition::new(Position::from_deg(p[0], p[1], p[2]), 1000.0));
        let schedule = Schedule::new(held.collect()).unwrap();
        let timeline = Timeline::new(&platform, &schedule).unwrap();
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
