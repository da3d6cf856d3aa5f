//! The parameters of a platform as columns.
//!
//! A parameter's column of the drift matrix is C_j φ times a factor, C_j a column of C_c^n and φ a
//! feature of the attitude or the rate ([`Monomial`]); of some parameters it is a sum of such [`Term`]s.

use crate::covariance::fast::arithmetic::{Arithmetic, Number, Row, four};
use crate::covariance::fast::mixing::in_powers_of_g;
use crate::covariance::fast::posterior::Order;
use crate::covariance::fast::shape::{Basis, Facts, Monomial};
use crate::covariance::fast::square::Entries;
use crate::drift::COEFFICIENTS;
use crate::model::{Colour, ErrorModel};

/// A part of a parameter's column: `factor` times a feature along an axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Term {
    pub column: usize,
    pub axis: usize,
    pub feature: Monomial,
    /// In the units of [`Order::scale`].
    pub factor: f64,
}

/// The parameters of a platform as columns, in their [`Order`].
///
/// Under a random walk of the drift D_F is what it has come to at the end of the test. Until then the
/// walk is what it still has to go, D_F(t) − D_F(T): its σ before the test is that of D_F(0), of D_F
/// nothing else is known then, and at the end it is 0, known exactly.
#[derive(Debug, Clone)]
pub(crate) struct Columns {
    /// The parameters.
    pub(super) order: Order,
    /// Quads in a row over the parameters.
    pub(super) width: usize,
    pub(super) gyros: Vec<Term>,
    pub(super) accelerometers: Vec<Term>,
    /// D_F with the opposite sign: what the random walk is of it before the test. Empty: it has none.
    pub(super) walked: Vec<Term>,
    /// σ of D_F of the three gyros at the start, °/h.
    pub(super) walked_sigma: [f64; 3],
    /// What the gyros' columns are made of, each once.
    pub(super) features: Vec<Monomial>,
    /// Of every term of the gyros, its feature's place among those.
    places: Vec<usize>,
}

impl Columns {
    /// Of all parameters of `errors`, those at `seen` seen by figures of merit besides the twelve
    /// coefficients; `drift` is how the drift wanders, in °/h.
    pub fn new(errors: &ErrorModel, seen: &[usize], drift: &Colour) -> Self {
        let mut order = Order::new(errors, seen);
        let size = order.size();
        let first = size - COEFFICIENTS;
        let mut walked_sigma = [0.0; 3];
        if let Some(k2) = drift.random_walk {
            for (k, sigma) in walked_sigma.iter_mut().enumerate() {
                *sigma = order.scale[first + k];
                // Where D_F is known before the test, what it comes to in an hour.
                order.scale[first + k] = (*sigma * *sigma + 3600.0 * k2).sqrt();
                order.prior[first + k] = 0.0;
            }
        }
        let effects = errors.effects();
        let (mut gyros, mut accelerometers) = (Vec::new(), Vec::new());
        for (column, &i) in order.places.iter().enumerate() {
            for effect in &effects[i] {
                let (group, axis, feature, factor) = in_powers_of_g(effect);
                let factor = factor * order.scale[column];
                if factor != 0.0 {
                    let to: &mut Vec<Term> = match group {
                        0 => &mut gyros,
                        _ => &mut accelerometers,
                    };
                    to.push(Term {
                        column,
                        axis,
                        feature,
                        factor,
                    });
                }
            }
        }
        let is_walked =
            |t: &&Term| drift.random_walk.is_some() && (first..first + 3).contains(&t.column);
        let reversed = |t: &Term| Term {
            factor: -t.factor,
            ..*t
        };
        let walked = gyros.iter().filter(is_walked).map(reversed).collect();
        let mut features: Vec<Monomial> = Vec::new();
        let mut places = Vec::with_capacity(gyros.len());
        for term in &gyros {
            let known = features.iter().position(|f| *f == term.feature);
            places.push(known.unwrap_or_else(|| {
                features.push(term.feature);
                features.len() - 1
            }));
        }
        Self {
            order,
            width: size.div_ceil(4),
            gyros,
            accelerometers,
            walked,
            walked_sigma,
            features,
            places,
        }
    }

    /// Whether accelerometers have errors.
    pub(super) fn has_accelerometers(&self) -> bool {
        !self.accelerometers.is_empty()
    }

    /// Whether torquers have errors: then moves without duration count.
    pub(super) fn has_torquers(&self) -> bool {
        self.features.iter().any(|f| f.is_rate())
    }

    /// What a timeline has to know of them.
    pub(super) fn facts(&self) -> Facts {
        // Degree of the drift of a gyro in the angles, with C.
        let degree = match self.features.iter().any(|f| f.is_square()) {
            true => 3.0,
            false => 2.0,
        };
        Facts {
            // Whatever wanders turns with the platform, in no time too.
            jumps: true,
            phase: degree / 2.0,
        }
    }

    /// Three rows whose terms are the sums of `of` over [`Columns::features`], (row, axis, feature).
    #[inline(always)]
    pub(super) fn spread<A: Arithmetic>(&self, ar: A, of: &[A::Number]) -> Vec<A::Quad> {
        let (columns, count) = (4 * self.width, self.features.len());
        let mut out = vec![ar.number(0.0); 3 * columns];
        for (term, feature) in self.gyros.iter().zip(&self.places) {
            let factor = ar.number(term.factor);
            for i in 0..3 {
                let to = &mut out[i * columns + term.column];
                *to = of[(3 * i + term.axis) * count + feature].mul_add(factor, *to);
            }
        }
        packed(ar, &out)
    }

    /// Reverse mode of [`Columns::spread`].
    #[inline(always)]
    pub(super) fn collected<A: Arithmetic>(&self, ar: A, adjoint: &[A::Quad]) -> Vec<A::Number> {
        let (columns, count) = (4 * self.width, self.features.len());
        let adjoint = unpacked(adjoint);
        let mut out = vec![ar.number(0.0); 9 * count];
        for (term, feature) in self.gyros.iter().zip(&self.places) {
            let factor = ar.number(term.factor);
            for i in 0..3 {
                let to = &mut out[(3 * i + term.axis) * count + feature];
                *to = adjoint[i * columns + term.column].mul_add(factor, *to);
            }
        }
        out
    }

    /// Adds the columns of `terms` in an attitude with those features, three rows.
    #[inline(always)]
    pub(super) fn add_terms<N: Number>(
        &self,
        to: &mut [N],
        terms: &[Term],
        c: &Entries<N>,
        of: &Basis<N>,
    ) {
        let columns = 4 * self.width;
        for term in terms {
            let factor = of[term.feature as usize] * c[0][0].constant(term.factor);
            for i in 0..3 {
                let to = &mut to[i * columns + term.column];
                *to = c[i][term.axis].mul_add(factor, *to);
            }
        }
    }
}

/// Numbers four by four.
#[inline(always)]
pub(super) fn packed<A: Arithmetic>(ar: A, of: &[A::Number]) -> Vec<A::Quad> {
    let mut out = Vec::with_capacity(of.len() / 4);
    for of in of.chunks_exact(4) {
        out.push(ar.quad(four!(|e| of[e])));
    }
    out
}

/// The numbers of quads.
#[inline(always)]
pub(super) fn unpacked<Q: Row>(of: &[Q]) -> Vec<Q::Number> {
    let mut out = Vec::with_capacity(4 * of.len());
    for of in of {
        out.extend_from_slice(&four!(|e| of.get(e)));
    }
    out
}
