//! The same by the rows that the chain has told, where sums of squares lose digits.
//!
//! A are the rows on what is estimated (e), in units of the prior σ, with the prior's I below them,
//! and C those on what is considered. With A Π = Q R, L = Π R⁻¹ and M = Qᵀ C
//!
//! ```text
//! N = L Lᵀ,   B = −L M,   P_ff = L_f L_fᵀ + B_f B_fᵀ,   (L_f, B_f) = Λ (Q_eᵀ, Q_cᵀ),
//! ```
//!
//! Λ a root of P_ff. With K = Λᵀ G Λ and q = x_e L of a row x (of a row that counts: its row of Q),
//! its product with Ē is
//!
//! ```text
//! (x Ē)_e = ((q M − x_c) Q_c − q Q_e) K Q_eᵀ Lᵀ + q Q_e K Q_cᵀ Mᵀ Lᵀ,   (x Ē)_c = −q Q_e K Q_cᵀ.
//! ```

use std::borrow::Cow;

use nalgebra::DMatrix;

use super::super::arithmetic::{Row, Single, four};
use super::super::course::{Legs, Step, Tape, on_the_way};
use super::super::earth::Earth;
use super::super::mixing::Mixing;
use super::super::posterior::Order;
use super::super::shape::{Shape, every};
use super::super::tiles::{WideAdjoint, vertical_row};
use super::super::{Place, entries_of};
use super::seen::{of_coefficients, padded, scaled};
use crate::covariance::{CoefficientCovariance, CovarianceRoot, Rooted, Slope, not_finite};
use crate::drift::{COEFFICIENTS, CoefficientMatrix};
use crate::error::Result;

/// A row over all parameters in units of the prior σ; `scale` times it has unit noise.
#[derive(Debug, Clone)]
pub(crate) struct Told {
    pub row: Vec<f64>,
    pub scale: f64,
}

/// The rows that the chain has told, in the order of the tape.
pub(super) fn told<A: Single, S: Shape>(
    ar: A,
    legs: &impl Legs<A>,
    earth: &Earth<f64>,
    tape: &Tape<A, S>,
    mixing: &Mixing,
) -> Vec<Told> {
    let mut all = Vec::new();
    let mut push = |row: &S::Quads<A::Quad>, scale: f64| {
        let row = mixing.row(|at| row[at / 4].get(at % 4));
        all.push(Told { row, scale });
    };
    for (leg, step) in &tape.steps {
        let place = || Place::<A, S>::new(ar, earth, legs.attitude(*leg));
        match step {
            Step::Dwell(dwell) => {
                let at = place();
                dwell.x.iter().for_each(|row| push(row, 1.0));
                let q_c = entries_of::<A, S>(&dwell.q_c);
                for i in 0..3 {
                    let mut row = every::<S, _>(at.h[0]);
                    for q in 0..S::QUADS {
                        let of = &S::LAYOUT[q];
                        row[q] = at.h[of.block].times(q_c[of.group][i][of.axis]);
                    }
                    push(&row, 1.0);
                }
                if S::GROUPS > 1 {
                    push(&vertical_row(ar, &at), legs.vertical(*leg).sqrt());
                }
            }
            Step::Measure(measure, ..) => {
                for (row, d) in measure.rows.iter().zip(measure.seen.d) {
                    push(row, (measure.seen.weight * d).sqrt());
                }
            }
            Step::Azimuth(step, ..) => {
                push(&step.row, (step.azimuth.weight * step.azimuth.d).sqrt());
            }
            Step::Vertical(weight, _, index) => {
                let at = match index {
                    Some(index) if index + 1 < legs.stretches(*leg) => {
                        on_the_way(ar, earth, &legs.stretch(*leg, *index), true).place
                    }
                    _ => place(),
                };
                push(&vertical_row(ar, &at), weight.sqrt());
            }
            _ => {}
        }
    }
    all
}

/// The rows, triangularised.
pub(crate) struct Stacked<'a> {
    order: &'a Order,
    /// Which parameters are estimated, and which considered.
    estimated: Vec<usize>,
    considered: Vec<usize>,
    /// L.
    l: DMatrix<f64>,
    m: DMatrix<f64>,
    /// Q_e over Q_c.
    of_root: DMatrix<f64>,
    /// q of every row, and its considered part.
    q: DMatrix<f64>,
    on_considered: DMatrix<f64>,
    /// Λ, in units of the prior σ.
    root: DMatrix<f64>,
    covariance: Rooted,
}

impl<'a> Stacked<'a> {
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when a row is not finite.
    pub fn new(told: &[Told], order: &'a Order) -> Result<Self> {
        let first = order.first_seen();
        let seen = order.size() - first;
        let considered: Vec<usize> = (order.estimated..first).collect();
        let estimated: Vec<usize> = (0..order.estimated).chain(first..order.size()).collect();
        let size = |t: &Told| t.scale * t.row.iter().fold(0.0_f64, |max, v| max.max(v.abs()));
        // Large rows first, as `covariance::rows` has it.
        let mut by_size: Vec<(f64, usize)> = told.iter().map(size).zip(0..).collect();
        if !by_size.iter().all(|(size, _)| size.is_finite()) {
            return Err(not_finite());
        }
        by_size.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let entry = |at: usize, j: usize| {
            let Told { row, scale } = &told[by_size[at].1];
            row[j] * scale
        };
        let rows = told.len();
        let a = DMatrix::from_fn(rows + estimated.len(), estimated.len(), |i, j| {
            match i.checked_sub(rows) {
                None => entry(i, estimated[j]),
                Some(i) if i == j => order.prior[estimated[i]],
                Some(_) => 0.0,
            }
        });
        let c = DMatrix::from_fn(rows, considered.len(), |i, j| entry(i, considered[j]));
        let qr = a.col_piv_qr();
        let mut l = DMatrix::identity(estimated.len(), estimated.len());
        if !qr.r().solve_upper_triangular_mut(&mut l) {
            return Err(not_finite());
        }
        qr.p().inv_permute_rows(&mut l);
        let of_rows = qr.q().rows(0, rows).into_owned();
        let m = of_rows.transpose() * c;
        // The coefficients first: then a corner of the triangle is a root of P_D.
        let weighted = seen - COEFFICIENTS;
        let order_of_seen: Vec<usize> = (weighted..seen).chain(0..weighted).collect();
        let l_f = l.rows(order.estimated, seen).select_rows(&order_of_seen);
        let b_f = -(&l_f * &m);
        let mut both = DMatrix::zeros(estimated.len() + considered.len(), seen);
        both.rows_mut(0, estimated.len())
            .copy_from(&l_f.transpose());
        both.rows_mut(estimated.len(), considered.len())
            .copy_from(&b_f.transpose());
        let qr_of_root = both.qr();
        // Rᵀ with its columns the other way round: rows from the last on make an upper triangle.
        let last = seen - 1;
        let r = qr_of_root.r();
        let mut root = DMatrix::zeros(seen, seen);
        for (i, to) in order_of_seen.iter().enumerate() {
            for k in 0..seen {
                root[(*to, k)] = r[(last - k, i)];
            }
        }
        let of_root = qr_of_root.q();
        let of_root = DMatrix::from_fn(of_root.nrows(), seen, |i, k| of_root[(i, last - k)]);
        let mut q = DMatrix::zeros(rows, estimated.len());
        for (at, (_, k)) in by_size.iter().enumerate() {
            let Told { row, scale } = &told[*k];
            if *scale > 0.0 {
                q.set_row(*k, &(of_rows.row(at) / *scale));
            } else {
                // A row that does not count yet.
                let row = DMatrix::from_fn(1, estimated.len(), |_, j| row[estimated[j]]);
                q.set_row(*k, &(row * &l).row(0));
            }
        }
        let on_considered =
            DMatrix::from_fn(rows, considered.len(), |i, j| told[i].row[considered[j]]);
        let sigma = order.seen_scale();
        let pivots = std::array::from_fn(|k| COEFFICIENTS - 1 - k);
        let in_units = of_coefficients(&root, sigma, &vec![1.0; seen]);
        let covariance = Rooted::new(CovarianceRoot::new(in_units, pivots));
        Ok(Self {
            order,
            estimated,
            considered,
            l,
            m,
            of_root,
            q,
            on_considered,
            root,
            covariance,
        })
    }

    /// Λᵀ G Λ.
    fn in_root(&self, slope: &Slope) -> DMatrix<f64> {
        let sigma = self.order.seen_scale();
        let of = |g: &DMatrix<f64>| self.root.transpose() * scaled(g, sigma) * &self.root;
        match slope {
            Slope::Variances(_) | Slope::InRoot(_) => {
                padded(&slope.in_root(&self.covariance), sigma.len())
            }
            Slope::SeenVariances(g) => of(&DMatrix::from_diagonal(g)),
            Slope::SeenCovariance(g) => of(g),
        }
    }

    /// Every row times Ē.
    pub fn times_adjoint(&self, slope: &Slope) -> Vec<Vec<f64>> {
        let k = self.in_root(slope);
        let count = self.estimated.len();
        let q_e = self.of_root.rows(0, count);
        let q_c = self.of_root.rows(count, self.considered.len());
        let through = &self.q * q_e;
        let left = (&self.q * &self.m - &self.on_considered) * q_c - &through;
        let second = &through * &k * q_c.transpose();
        let of_estimated =
            (left * k * q_e.transpose() + &second * self.m.transpose()) * self.l.transpose();
        let row = |i: usize| {
            let mut of = vec![0.0; self.order.size()];
            for (j, at) in self.estimated.iter().enumerate() {
                of[*at] = of_estimated[(i, j)];
            }
            for (j, at) in self.considered.iter().enumerate() {
                of[*at] = -second[(i, j)];
            }
            of
        };
        (0..self.q.nrows()).map(row).collect()
    }
}

/// Rows over the parameters as rows over the columns of the shape.
pub(super) fn by_columns<A: Single, S: Shape>(
    ar: A,
    mixing: &Mixing,
    rows: &[Vec<f64>],
) -> WideAdjoint<A, S> {
    let rows = rows.iter().map(|of| {
        let columns = mixing.columns_of(of);
        let mut row = every::<S, _>(ar.quad([0.0; 4]));
        for q in 0..S::QUADS {
            row[q] = ar.quad(four!(|e| columns[4 * q + e]));
        }
        row
    });
    WideAdjoint::Told(rows.collect())
}

impl CoefficientCovariance for Stacked<'_> {
    fn matrix(&self) -> &CoefficientMatrix {
        self.covariance.matrix()
    }
    fn root(&self) -> Cow<'_, CovarianceRoot> {
        self.covariance.root()
    }
    fn seen(&self) -> DMatrix<f64> {
        scaled(
            &(&self.root * self.root.transpose()),
            self.order.seen_scale(),
        )
    }
}
