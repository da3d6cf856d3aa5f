//! The kernel of a dwell: n filter periods composed into one element, in square-root form, as
//! [`crate::covariance::kernel`] does it for white noise.
//!
//! Over a dwell the state x of [`Layout`] obeys x ← Φ_x x + Γ_u u + noise with constant inputs u. n periods
//! tell as much about its start as scalars with unit noise, R11 x + R12 u (as many as x has components) and
//! R22 u; given them, x at the end is A_x x + A_u u plus noise of root U. Elements 1 then 2, with W the rows
//! [R11 R12; 0 R22]:
//!
//! ```text
//! rows  (I + W_2x U_1 U_1ᵀ W_2xᵀ)^−½ (W_2x (A_x1 x + A_u1 u) + W_2u u)   stacked with   W_1 (x, u),
//! A_2 (x_1 − U_1₊ U_1₊ᵀ W_2xᵀ (…)),   U_1₊ = U_1 (I + U_1ᵀ W_2xᵀ W_2x U_1)^−½,   U = root(A_x2 U_1₊, U_2).
//! ```
//!
//! Columns are eliminated block by block in the order of the layout, the inputs last, in each block North,
//! East, Up: in this order of columns R11 and R22 are upper triangular.

use std::any::Any;
use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

use nalgebra::{DMatrix, Matrix3};

use super::Layout;
use super::passage::Passed;
use crate::attitude::{EAST, NORTH, UP};
use crate::covariance::real::Real;
use crate::covariance::triangle::{inverse_of, one_and_rows, root_of_sum, stacked};
use crate::covariance::{CovarianceModel, Precision};

/// Doublings kept: up to 2^32 periods.
const DOUBLINGS: usize = 33;
/// How many durations (in periods) are remembered.
const REMEMBERED: usize = 4096;

/// The element of n periods of a dwell, split over x and the inputs.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ColouredKernel<T: Real = f64> {
    /// Sensitivity of the first scalars to x at the start, states × states.
    pub r11: DMatrix<T>,
    /// Sensitivity of the first scalars to the inputs, states × inputs.
    pub r12: DMatrix<T>,
    /// Sensitivity of the last scalars to the inputs, inputs × inputs.
    pub r22: DMatrix<T>,
    /// x at the end from x at the start, given the measurements, states × states.
    pub a_x: DMatrix<T>,
    /// x at the end from the inputs, given the measurements, states × inputs.
    pub a_u: DMatrix<T>,
    /// A root of the covariance of x at the end given the start and the measurements, states × states;
    /// of a dwell without a period zero.
    pub u: DMatrix<T>,
}

#[cfg(test)]
impl<T: Real> ColouredKernel<T> {
    /// U Uᵀ.
    pub fn c(&self) -> DMatrix<T> {
        &self.u * self.u.transpose()
    }
}

/// The rows of a measurement with unit noise: on x, and on the inputs.
pub(super) struct Seen<T: Real> {
    pub of_x: DMatrix<T>,
    /// Of b_y.
    pub of_bias: Vec<T>,
}

impl<T: Real> Seen<T> {
    /// A measurement of one period, of components of ψ^n with these noise variances (arcsec², North, Up,
    /// East), where biases along the axes of the blocks show in n as `biases` says.
    pub fn new(layout: &Layout, variance: [Option<f64>; 3], biases: &Matrix3<T>) -> Self {
        // z_3 = −ψ_x + b_3, z_1 = ψ_z + b_1, z_2 = b_2.
        let channels = [
            (Some(NORTH), variance[NORTH], Some((EAST, -1.0))),
            (Some(EAST), variance[EAST], Some((NORTH, 1.0))),
            (Some(UP), variance[UP], None),
            (
                None,
                variance[NORTH].filter(|_| layout.has_biases()),
                Some((UP, 1.0)),
            ),
        ];
        let measured: Vec<_> = channels
            .into_iter()
            .filter_map(|(psi, variance, bias)| Some((psi, variance?, bias)))
            .collect();
        let mut of_x = DMatrix::zeros(measured.len(), layout.states());
        let mut of_bias = vec![T::from(0.0); measured.len()];
        for (row, (psi, variance, bias)) in measured.into_iter().enumerate() {
            let weight = T::from(1.0) / T::from(variance).sqrt();
            match psi {
                Some(axis) => of_x[(row, axis)] = weight,
                None => of_bias[row] = weight,
            }
            let Some((axis, sign)) = bias else { continue };
            for at in layout.bias_blocks() {
                for j in 0..3 {
                    of_x[(row, at + j)] = biases[(axis, j)] * weight * T::from(sign);
                }
            }
        }
        Self { of_x, of_bias }
    }
}

/// The element in the form that composes.
#[derive(Debug, Clone)]
struct Element<T: Real> {
    states: usize,
    /// Rows on (x, u).
    w: DMatrix<T>,
    a_x: DMatrix<T>,
    a_u: DMatrix<T>,
    u: DMatrix<T>,
}

impl<T: Real> Element<T> {
    fn identity(layout: &Layout) -> Self {
        let (states, inputs) = (layout.states(), layout.inputs());
        Self {
            states,
            w: DMatrix::zeros(states + inputs, states + inputs),
            a_x: DMatrix::identity(states, states),
            a_u: DMatrix::zeros(states, inputs),
            u: DMatrix::zeros(states, states),
        }
    }

    /// Time at a position.
    fn held(layout: &Layout, model: &CovarianceModel, length_s: f64) -> Self {
        let passed = Passed::<T>::held(layout, &model.dynamics, model.drift_psd, length_s);
        let [_, gamma] = T::transition(&model.dynamics, length_s);
        let mut element = Self::identity(layout);
        element.a_x = passed.transition;
        element.a_u.view_mut((0, 0), (3, 3)).copy_from(&gamma);
        element.u = passed.u;
        element
    }

    /// A measurement.
    fn measured(layout: &Layout, model: &CovarianceModel) -> Self {
        let seen = Seen::new(layout, model.measured_variance(), &Matrix3::identity());
        let mut element = Self::identity(layout);
        for (row, of_bias) in seen.of_bias.iter().enumerate() {
            for j in 0..element.states {
                element.w[(row, j)] = seen.of_x[(row, j)];
            }
            if layout.has_biases() {
                element.w[(row, element.states + 3)] = *of_bias;
            }
        }
        element
    }

    /// This element, then `next`.
    fn then(&self, next: &Self) -> Self {
        let inputs = self.w.ncols() - self.states;
        let w2_x = next.w.columns(0, self.states).into_owned();
        let seen_x = &w2_x * &self.a_x;
        let seen_u = &w2_x * &self.a_u + next.w.columns(self.states, inputs);
        let mut seen = DMatrix::zeros(self.w.nrows(), self.w.ncols());
        seen.columns_mut(0, self.states).copy_from(&seen_x);
        seen.columns_mut(self.states, inputs).copy_from(&seen_u);
        let through = &w2_x * &self.u;
        let whitened = inverse_of(&one_and_rows(&through.transpose())).transpose() * seen;
        let shrink = inverse_of(&one_and_rows(&through));
        let conditional = &self.u * &shrink;
        let gain = &conditional * shrink.transpose() * through.transpose();
        Self {
            states: self.states,
            w: stacked_in_order(&self.w, &whitened),
            a_x: &next.a_x * (&self.a_x - &gain * seen_x),
            a_u: &next.a_x * (&self.a_u - &gain * seen_u) + &next.a_u,
            u: root_of_sum(&(&next.a_x * conditional), &next.u),
        }
    }

    fn split(&self) -> ColouredKernel<T> {
        let inputs = self.w.ncols() - self.states;
        let block = |i, j, rows, columns| self.w.view((i, j), (rows, columns)).into_owned();
        ColouredKernel {
            r11: block(0, 0, self.states, self.states),
            r12: block(0, self.states, self.states, inputs),
            r22: block(self.states, self.states, inputs, inputs),
            a_x: self.a_x.clone(),
            a_u: self.a_u.clone(),
            u: self.u.clone(),
        }
    }
}

/// W with WᵀW = W_1ᵀW_1 + W_2ᵀW_2, in every block North, East, Up.
fn stacked_in_order<T: Real>(w1: &DMatrix<T>, w2: &DMatrix<T>) -> DMatrix<T> {
    let columns = w1.ncols();
    // A last input alone stays where it is.
    let place = |j: usize| match j / 3 * 3 + 3 <= columns {
        true => j / 3 * 3 + [NORTH, EAST, UP][j % 3],
        false => j,
    };
    let ordered = |w: &DMatrix<T>| DMatrix::from_fn(w.nrows(), columns, |i, j| w[(i, place(j))]);
    let r = stacked(&ordered(w1), &ordered(w2));
    let mut w = DMatrix::zeros(columns, columns);
    for from in 0..columns {
        w.set_column(place(from), &r.column(from));
    }
    w
}

/// Kernels by number of periods, made when they are asked for, of elements of 2^k periods.
#[derive(Debug)]
pub(crate) struct ColouredDoublings<T: Real = f64> {
    layout: Layout,
    elements: [OnceLock<Box<Element<T>>>; DOUBLINGS],
    one_period: Element<T>,
    remembered: Box<[OnceLock<Box<ColouredKernel<T>>>]>,
}

/// The kernels of a platform: made once for all of its schedules, and shared between threads.
#[derive(Debug, Default)]
pub(crate) struct KeptKernels {
    /// [`ColouredDoublings`] in doubles, and in 32 digits.
    double: OnceLock<Arc<dyn Any + Send + Sync>>,
    extended: OnceLock<Arc<dyn Any + Send + Sync>>,
}

impl KeptKernels {
    /// Those of `model`, to which these belong.
    pub fn of<T: Real>(&self, model: &CovarianceModel) -> Arc<ColouredDoublings<T>> {
        let kept = match T::PRECISION {
            Precision::Double => &self.double,
            Precision::Extended => &self.extended,
        };
        let made = || Arc::new(ColouredDoublings::<T>::new(model));
        let kept = kept.get_or_init(|| -> Arc<dyn Any + Send + Sync> { made() });
        Arc::clone(kept).downcast().unwrap_or_else(|_| made())
    }
}

impl<T: Real> ColouredDoublings<T> {
    /// Of a model's noises and filter period.
    pub fn new(model: &CovarianceModel) -> Self {
        let layout = Layout::of(model);
        let held = Element::held(&layout, model, model.period_s);
        Self {
            one_period: held.then(&Element::measured(&layout, model)),
            elements: std::array::from_fn(|_| OnceLock::new()),
            remembered: (0..REMEMBERED).map(|_| OnceLock::new()).collect(),
            layout,
        }
    }

    /// The blocks.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// 2^k periods.
    fn element(&self, k: usize) -> &Element<T> {
        self.elements[k].get_or_init(|| {
            Box::new(match k {
                0 => self.one_period.clone(),
                _ => {
                    let half = self.element(k - 1);
                    half.then(half)
                }
            })
        })
    }

    /// The kernel of a dwell of `periods` filter periods.
    pub fn kernel(&self, periods: usize) -> Cow<'_, ColouredKernel<T>> {
        match self.remembered.get(periods) {
            Some(cell) => Cow::Borrowed(cell.get_or_init(|| Box::new(self.made(periods)))),
            None => Cow::Owned(self.made(periods)),
        }
    }

    fn made(&self, periods: usize) -> ColouredKernel<T> {
        let mut element = Element::identity(&self.layout);
        for k in 0..DOUBLINGS {
            if periods >> k & 1 == 1 {
                element = element.then(self.element(k));
            }
        }
        element.split()
    }
}

#[cfg(test)]
mod tests;
