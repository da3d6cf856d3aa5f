//! From the columns of a [`Shape`] to the parameters of a platform.
//!
//! A parameter's column of the drift matrix is a combination of the shape's: mounting, signs and
//! units are factors, what a platform does not have is left out. With L the matrix of these factors
//! the information on the parameters is Lᵀ E L, worked out once per schedule.

use super::posterior::Order;
use super::shape::{Catalogue, Instruments, Monomial, Shape};
use crate::model::{Effect, ErrorModel, Feature, Instrument};

/// Which shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// [`Instruments`].
    Instruments,
    /// [`Catalogue`].
    Catalogue,
}

/// A column of a parameter: columns of the shape, with factors in units of the prior σ.
type Column = Vec<(usize, f64)>;

/// How the parameters of a platform are made of the columns of a shape.
#[derive(Debug, Clone)]
pub(crate) struct Mixing {
    /// The smallest shape that has all columns.
    pub(super) kind: Kind,
    /// The parameters.
    pub(super) order: Order,
    /// Of every pair of parameters (i, j ≥ i), row by row: where its terms end in `terms`.
    ends: Vec<u32>,
    /// Entries of the tiles, and their factors.
    terms: Vec<(u32, f64)>,
    /// For every pair of parameters and of their columns: entry of the parameters' matrix, entry of
    /// the columns', both full, and factor.
    pulls: Vec<(u32, u32, f64)>,
    /// How many columns the shape has.
    columns: usize,
    /// The columns of the parameters.
    of: Vec<Column>,
}

/// An effect in powers of g^c: of which group of instruments, which of the three, and its factor.
pub(super) fn in_powers_of_g(effect: &Effect) -> (usize, usize, Monomial, f64) {
    // An accelerometer feels f = −g^c.
    let (group, axis, feels) = match effect.on {
        Instrument::Gyro(axis) => (0, axis, 1.0),
        Instrument::Accelerometer(axis) => (1, axis, -1.0),
    };
    let (monomial, sign) = match effect.feature {
        Feature::One => (Monomial::One, 1.0),
        Feature::Linear(i) => ([Monomial::X, Monomial::Y, Monomial::Z][i], feels),
        Feature::Product(i, j) => (Monomial::product(i, j), 1.0),
        Feature::Cube(i) => ([Monomial::XXX, Monomial::YYY, Monomial::ZZZ][i], feels),
        Feature::Rate(i) => ([Monomial::RateX, Monomial::RateY, Monomial::RateZ][i], 1.0),
    };
    (group, axis, monomial, sign * effect.factor)
}

/// The columns of `S` that make an effect; none if it does not have them.
fn expanded<S: Shape>(effect: &Effect) -> Option<Column> {
    let (group, axis, monomial, factor) = in_powers_of_g(effect);
    let find = |monomial: Monomial| {
        let quads = S::LAYOUT.iter().enumerate();
        let mut of = quads.filter(|(_, q)| q.group == group && q.axis == axis);
        of.find_map(|(q, layout)| {
            let features = &S::FEATURES[layout.block];
            let e = features.iter().position(|f| *f == monomial)?;
            Some(4 * q + e)
        })
    };
    if let Some(at) = find(monomial) {
        return Some(vec![(at, factor)]);
    }
    // g_x² + g_y² + g_z² = 1.
    let others = match monomial {
        Monomial::XX => [Monomial::YY, Monomial::ZZ],
        Monomial::YY => [Monomial::XX, Monomial::ZZ],
        Monomial::ZZ => [Monomial::XX, Monomial::YY],
        _ => return None,
    };
    Some(vec![
        (find(Monomial::One)?, factor),
        (find(others[0])?, -factor),
        (find(others[1])?, -factor),
    ])
}

/// The column of a parameter in `S`, in units of its prior σ.
fn column<S: Shape>(effects: &[Effect], prior_sigma: f64) -> Option<Column> {
    let mut all: Column = Vec::new();
    for effect in effects {
        for (at, factor) in expanded::<S>(effect)? {
            match all.iter_mut().find(|(known, _)| *known == at) {
                Some((_, sum)) => *sum += factor * prior_sigma,
                None => all.push((at, factor * prior_sigma)),
            }
        }
    }
    all.retain(|(_, factor)| *factor != 0.0);
    Some(all)
}

impl Mixing {
    /// Of the parameters of `errors` in their [`Order`], on the smallest shape that has all their features.
    #[allow(
        clippy::expect_used,
        reason = "the catalogue has the features of every family, which a test shows"
    )]
    pub fn new(errors: &ErrorModel, seen: &[usize]) -> Self {
        let order = Order::new(errors, seen);
        Self::on::<Instruments>(Kind::Instruments, errors, &order)
            .or_else(|| Self::on::<Catalogue>(Kind::Catalogue, errors, &order))
            .expect("the catalogue has every feature")
    }

    /// On the largest shape, whatever the parameters.
    #[cfg(test)]
    pub fn of_catalogue(errors: &ErrorModel) -> Self {
        Self::on::<Catalogue>(Kind::Catalogue, errors, &Order::new(errors, &[])).unwrap()
    }

    fn on<S: Shape>(kind: Kind, errors: &ErrorModel, order: &Order) -> Option<Self> {
        let effects = errors.effects();
        let known = order.places.iter().zip(&order.scale);
        let of: Option<Vec<Column>> = known
            .map(|(&i, sigma)| column::<S>(&effects[i], *sigma))
            .collect();
        let of = of?;
        let (size, columns) = (of.len(), 4 * S::QUADS);
        let (mut ends, mut terms, mut pulls) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..size {
            for j in 0..size {
                for &(a, by_a) in &of[i] {
                    for &(b, by_b) in &of[j] {
                        if j >= i {
                            let at = super::tiles::entry(S::QUADS, a, b);
                            terms.push((at as u32, by_a * by_b));
                        }
                        let (from, to) = (i * size + j, a * columns + b);
                        pulls.push((from as u32, to as u32, by_a * by_b));
                    }
                }
                if j >= i {
                    ends.push(terms.len() as u32);
                }
            }
        }
        Some(Self {
            kind,
            order: order.clone(),
            ends,
            terms,
            pulls,
            columns,
            of,
        })
    }

    /// Lᵀ E L in units of the prior σ, its upper triangle, row by row, full rows; from the entries of
    /// the tiles.
    #[inline(always)]
    pub(super) fn information<N: super::arithmetic::Number>(&self, zero: N, tiles: &[N]) -> Vec<N> {
        let size = self.order.size();
        let mut out = vec![zero; size * size];
        let (mut pair, mut first) = (0, 0);
        for i in 0..size {
            for j in i..size {
                let end = self.ends[pair] as usize;
                let mut sum = zero;
                for (k, &(at, factor)) in self.terms[first..end].iter().enumerate() {
                    let term = tiles[at as usize] * zero.constant(factor);
                    sum = if k == 0 { term } else { sum + term };
                }
                out[i * size + j] = sum;
                (pair, first) = (pair + 1, end);
            }
        }
        out
    }

    /// L Ē Lᵀ over the columns of the shape, full, from Ē over the parameters, full.
    #[inline(always)]
    pub(super) fn pulled<N: super::arithmetic::Number>(&self, zero: N, adjoint: &[N]) -> Vec<N> {
        let mut out = vec![zero; self.columns * self.columns];
        for &(from, to, factor) in &self.pulls {
            let to = &mut out[to as usize];
            *to = adjoint[from as usize].mul_add(zero.constant(factor), *to);
        }
        out
    }

    /// Rows over the columns of the shape as rows over the parameters, in units of the prior σ.
    pub(super) fn row(&self, of: impl Fn(usize) -> f64) -> Vec<f64> {
        let columns = self.of.iter();
        let sum = |c: &Column| c.iter().map(|&(at, factor)| of(at) * factor).sum();
        columns.map(sum).collect()
    }

    /// A row over the parameters, in units of the prior σ, as one over the columns: times Lᵀ.
    pub(super) fn columns_of(&self, row: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.columns];
        for (value, column) in row.iter().zip(&self.of) {
            for &(at, factor) in column {
                out[at] += value * factor;
            }
        }
        out
    }
}
