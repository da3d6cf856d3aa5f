//! The parameters of a platform as the [`chain`](super::chain) takes them, in numbers of 16 or of 32
//! digits.

use nalgebra::{Matrix3, Matrix3xX};

use super::chain::{Effects, NoRecord, run};
use super::kernel::Kernel;
use super::kernel_table::Doublings;
use super::real::Real;
use super::rows::Rows;
use super::{CovarianceModel, EndCovariance, TickRule};
use crate::attitude::UP;
use crate::drift::{COEFFICIENTS, CoefficientMatrix, DriftCoefficient};
use crate::error::Result;
use crate::motion::{Leg, Move, Timeline};

/// The parameters of a platform.
pub(super) struct Selection<'a, T: Real> {
    model: &'a CovarianceModel,
    doublings: Doublings<T>,
}

/// An attitude with what the parameters do there.
pub(super) struct Place<T> {
    /// C_c^n.
    c: Matrix3<T>,
    /// A.
    a: Matrix3xX<T>,
}

impl<'a, T: Real> Selection<'a, T> {
    /// Of the model's platform.
    pub fn new(model: &'a CovarianceModel) -> Self {
        let noise = Some(model.noise_variance);
        Self {
            model,
            doublings: Doublings::new(
                &model.dynamics,
                model.period_s,
                model.drift_psd,
                [noise, None, noise],
            ),
        }
    }

    /// A.
    fn drift_matrix(&self, c: &Matrix3<T>) -> Matrix3xX<T> {
        let mut a = self.nothing();
        for of in DriftCoefficient::ALL {
            // g^c is minus the Up row of C_c^n.
            let factor = match of.excitation() {
                None => T::from(1.0),
                Some((axis, sign)) => c[(UP, axis)] * T::from(-sign),
            };
            a.set_column(of.index(), &(c.column(of.gyro()) * factor));
        }
        a
    }
}

impl<T: Real> Effects for Selection<'_, T> {
    type Number = T;
    type Drive = Matrix3xX<T>;
    type Place = Place<T>;

    fn model(&self) -> &CovarianceModel {
        self.model
    }
    fn nothing(&self) -> Matrix3xX<T> {
        Matrix3xX::zeros(COEFFICIENTS)
    }
    fn place(&self, leg: &Leg) -> Place<T> {
        let c = T::attitude(leg.position);
        Place {
            a: self.drift_matrix(&c),
            c,
        }
    }
    fn attitude(&self, place: &Place<T>) -> Matrix3<T> {
        place.c
    }
    fn held(&self, x: &Matrix3<T>, place: &Place<T>) -> Matrix3xX<T> {
        x * &place.a
    }
    fn moved(&self, m: &Move, start_s: f64, length_s: f64) -> Matrix3xX<T> {
        let b = m.drift_integral(&self.model.dynamics, start_s, length_s);
        Matrix3xX::from_fn(COEFFICIENTS, |i, j| T::from(b[(i, j)]))
    }
    fn kernel(&self, periods: usize) -> Kernel<T> {
        self.doublings.kernel(periods)
    }
}

impl CovarianceModel {
    /// The covariance at the end of `timeline` in numbers `T`, by the filter's tick rule.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the information overflows.
    pub(crate) fn end_covariance_in<T: Real>(&self, timeline: &Timeline) -> Result<EndCovariance> {
        let selection = Selection::<T>::new(self);
        let mut rows = Rows::on(self.prior_sigma.as_slice());
        let reached = run(
            &selection,
            timeline,
            TickRule::Filter,
            &mut rows,
            &mut NoRecord,
        );
        let all: Vec<usize> = (0..COEFFICIENTS).collect();
        let solved = rows.solve([&[], &all], &[])?;
        let v = reached.v.select_columns(&solved.pivots);
        let through_drift = v * &solved.root;
        let misalignment =
            reached.g * reached.g.transpose() + &through_drift * through_drift.transpose();
        let square = &solved.root * solved.root.transpose();
        let mut coefficients = CoefficientMatrix::zeros();
        for (i, &a) in solved.pivots.iter().enumerate() {
            for (j, &b) in solved.pivots.iter().enumerate() {
                coefficients[(a, b)] = square[(i, j)].f64();
            }
        }
        Ok(EndCovariance {
            coefficients,
            root: solved.of_coefficients()?,
            misalignment: misalignment.map(T::f64),
        })
    }
}
