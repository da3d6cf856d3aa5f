//! Separability of the coefficients: by SVD for reports, by Gram matrix with gradient for
//! searches.
//!
//! With X the weighted rows, columns scaled to length one, separability is
//! `1/√((XᵀX)⁻¹)_ii`: the inverse of coefficient i's variance inflation.

use faer::Mat;
use nalgebra::SMatrix;

use super::regressor::{Channel, Regressor, RowSource, UNKNOWNS};
use super::svd_failed;
use crate::covariance::CovarianceModel;
use crate::covariance::gradient::LegGradient;
use crate::drift::{COEFFICIENTS, CoefficientVector, DriftMatrix, drift_matrix_adjoint};
use crate::error::Result;
use crate::motion::Timeline;

/// Singular values below this, columns of length one, span what is not separable at all.
const NULL: f64 = 1e-10;

/// Separability of each coefficient, and the condition number of the scaled rows.
pub(super) fn by_svd(rows: &[[f64; UNKNOWNS]]) -> Result<(CoefficientVector, f64)> {
    let mut lengths = [0.0_f64; UNKNOWNS];
    for row in rows {
        for (sum, v) in lengths.iter_mut().zip(row) {
            *sum += v * v;
        }
    }
    let used: Vec<usize> = (0..UNKNOWNS).filter(|&j| lengths[j] > 0.0).collect();
    let mut separability = CoefficientVector::zeros();
    if used.is_empty() {
        return Ok((separability, f64::INFINITY));
    }
    // Rows of zeros make a short matrix square, so that its null space is part of the SVD.
    let height = rows.len().max(used.len());
    let scaled = Mat::from_fn(height, used.len(), |i, j| {
        rows.get(i)
            .map_or(0.0, |row| row[used[j]] / lengths[used[j]].sqrt())
    });
    let svd = scaled.thin_svd().map_err(|_| svd_failed())?;
    let values = svd.S().column_vector();
    for (j, &unknown) in used.iter().enumerate().filter(|(_, u)| **u < COEFFICIENTS) {
        let mut inflation = 0.0;
        for k in 0..used.len() {
            let along = svd.V()[(j, k)];
            if values[k] > NULL {
                inflation += (along / values[k]).powi(2);
            } else if along.abs() > 1e-7 {
                inflation = f64::INFINITY;
            }
        }
        separability[unknown] = 1.0 / inflation.sqrt();
    }
    // A coefficient that no row excites has no column: then nothing is well conditioned.
    let all_excited = used.iter().filter(|u| **u < COEFFICIENTS).count() == COEFFICIENTS;
    let smallest = values[used.len() - 1];
    let condition = match all_excited && smallest > NULL {
        true => values[0] / smallest,
        false => f64::INFINITY,
    };
    Ok((separability, condition))
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
        for row in regressor.weighted(&[Channel::X, Channel::Z, Channel::Y]) {
            let row = nalgebra::SVector::<f64, UNKNOWNS>::from(row);
            gram.ger(1.0, &row, &row, 1.0);
        }
        if !regressor.azimuth_unknown {
            gram[(COEFFICIENTS, COEFFICIENTS)] = 1.0;
        }
        let inverse = nalgebra::Cholesky::new(gram)?.inverse();
        let log = CoefficientVector::from_fn(|i, _| -0.5 * (inverse[(i, i)] * gram[(i, i)]).ln());
        // Rounding noise below this is not a separability.
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
            let position = crate::attitude::Position::from_array(m.angles_at(fraction));
            let angles = drift_matrix_adjoint(position, &position.attitude(), a_adjoint);
            for (i, angle) in angles.into_iter().enumerate() {
                gradient[leg].angles[i] += fraction * angle;
                gradient[leg - 1].angles[i] += (1.0 - fraction) * angle;
                // The tick's place is fixed in time, so its fraction shrinks as the move grows.
                gradient[leg].move_s -= fraction / m.duration_s * m.change[i] * angle;
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
    use crate::platform::PlatformConfig;
    use crate::schedule::{Schedule, ScheduledPosition};

    fn timeline(x: &[f64], measured: bool) -> (CovarianceModel, Timeline) {
        let mut config = PlatformConfig::default();
        config.motion.measure_moves = measured;
        let platform = config.check().unwrap();
        let positions = x.chunks(4).map(|c| ScheduledPosition {
            move_s: Some(203.0),
            ..ScheduledPosition::new(Position::from_rad(c[0], c[1], c[2]), c[3])
        });
        let schedule = Schedule::new(positions.collect()).unwrap();
        let timeline = Timeline::new(&platform, &schedule).unwrap();
        (CovarianceModel::new(&platform), timeline)
    }

    #[test]
    fn gram_form_equals_svd_and_its_gradient_is_the_derivative() {
        for measured in [false, true] {
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
}
