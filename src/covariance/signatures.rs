//! What the measurements of a test show of every estimated parameter and of the misalignment at its
//! start, whatever is known of any of them before.
//!
//! ψ^n(0) counts as three parameters more: V starts as the identity in their columns, and P at zero. So
//! the information holds no prior at all, and what only a prior tells is missing from it.

use nalgebra::{DMatrix, Matrix3, Matrix3xX};

use super::chain::{NoRecord, Reached, run_from};
use super::rows::Rows;
use super::selection::Selection;
use super::{CovarianceModel, TickRule, not_finite};
use crate::error::Result;
use crate::model::{Effect, Feature, Instrument};
use crate::motion::Timeline;

/// A column this much smaller than its parameter could make it at most is rounding: sin 180° is 1e-16 in
/// floating point.
const ROUNDING: f64 = 1e-9;

/// The signatures of unknowns: the estimated parameters, then ψ_x^n(0), ψ_y^n(0), ψ_z^n(0).
pub(crate) struct Signatures {
    /// Columns of length one, as many rows; zero where the test shows nothing of an unknown.
    pub columns: DMatrix<f64>,
    /// Length of each signature per unit of its unknown (arcsec for ψ), in units of the noise.
    pub lengths: Vec<f64>,
}

impl CovarianceModel {
    /// The signatures of `timeline`.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows.
    pub(crate) fn signatures(&self, timeline: &Timeline) -> Result<Signatures> {
        let estimated = self.errors.estimated();
        let mut effects = self.errors.effects();
        effects.truncate(estimated);
        let unknowns = estimated + 3;
        let of_gyros = |e: &&Effect| matches!(e.on, Instrument::Gyro(_));
        let shows_output = !effects.iter().flatten().all(|e| of_gyros(&e));
        effects.resize(unknowns, Vec::new());
        // Constants of the instruments, whose columns are as long as those of any feature of size one.
        let constant = |on| {
            vec![Effect {
                on,
                feature: Feature::One,
                factor: 1.0,
            }]
        };
        effects.extend((0..3).map(|k| constant(Instrument::Gyro(k))));
        if shows_output {
            effects.extend((0..3).map(|k| constant(Instrument::Accelerometer(k))));
        }
        let selection = Selection::<f64>::of_effects(self, &effects);
        let mut rows = Rows::on(&vec![1.0; effects.len()]);
        let mut of_psi = Matrix3xX::<f64>::zeros(effects.len());
        for axis in 0..3 {
            of_psi[(axis, estimated + axis)] = 1.0;
        }
        let start = Reached {
            v: of_psi,
            g: Matrix3::zeros(),
        };
        run_from(
            start,
            &selection,
            timeline,
            TickRule::Filter,
            &mut rows,
            &mut NoRecord,
        );
        rows.compress();
        let triangle = rows.first_columns(effects.len());
        if !triangle.iter().all(|v| v.is_finite()) {
            return Err(not_finite());
        }
        let length = |j: usize| triangle.column(j).norm();
        let longest = |columns: std::ops::Range<usize>| columns.map(length).fold(0.0, f64::max);
        let gyros = longest(unknowns..unknowns + 3);
        let outputs = longest(unknowns + 3..effects.len());
        let earth_rate = self.earth_rate_n.norm();
        let most = |e: &Effect| {
            let size = match e.feature.is_rate() {
                true => earth_rate,
                false => 1.0,
            };
            let of = match e.on {
                Instrument::Gyro(_) => gyros,
                Instrument::Accelerometer(_) => outputs,
            };
            e.factor.abs() * size * of
        };
        let psi = longest(estimated..unknowns);
        let lengths: Vec<f64> = (0..unknowns)
            .map(|j| {
                let possible = match j < estimated {
                    true => effects[j].iter().map(most).fold(0.0, f64::max),
                    false => psi,
                };
                match length(j) {
                    length if length > ROUNDING * possible => length,
                    _ => 0.0,
                }
            })
            .collect();
        let height = triangle.nrows().max(unknowns);
        let columns = DMatrix::from_fn(height, unknowns, |i, j| {
            match i < triangle.nrows() && lengths[j] > 0.0 {
                true => triangle[(i, j)] / lengths[j],
                false => 0.0,
            }
        });
        Ok(Signatures { columns, lengths })
    }
}
