//! From the columns of a [`Shape`] to the parameters of a platform.
//!
//! A parameter's column of the drift matrix is a combination of the shape's: mounting, signs and
//! units are factors, what a platform does not have is left out. With L the matrix of these factors
//! the information on the parameters is Lᵀ E L, worked out once per schedule.
//!
//! In a mixing the parameters stand in the order: others that are estimated, those that are only
//! considered, those that a figure of merit sees besides, the twelve drift coefficients.

use super::shape::{Catalogue, Feature, Instruments, Shape, Torquers};
use crate::drift::COEFFICIENTS;

/// What has an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Instrument {
    /// A gyro by its input axis; its error is a drift, in °/h = arcsec/s.
    Gyro(usize),
    /// An accelerometer by its input axis; its error is an angle of tilt, in arcsec.
    Accelerometer(usize),
}

/// A share of a parameter in the error of an instrument: `factor` times the feature. Rates are in
/// rad/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term {
    /// The instrument that has the error.
    pub instrument: Instrument,
    /// What the error is proportional to.
    pub feature: Feature,
    /// °/h (gyros) or arcsec (accelerometers) per unit of the parameter and of the feature.
    pub factor: f64,
}

/// A parameter of the platform's error model.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// What it does, per unit of it.
    pub terms: Vec<Term>,
    /// 1σ before the test, in its unit.
    pub prior_sigma: f64,
}

/// The parameters of a platform by their roles.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// The drift coefficients, in their order.
    pub coefficients: [Parameter; COEFFICIENTS],
    /// What is estimated and seen by figures of merit besides.
    pub weighted: Vec<Parameter>,
    /// What is estimated besides.
    pub estimated: Vec<Parameter>,
    /// What the platform has and the filter does not know of.
    pub considered: Vec<Parameter>,
}

/// Which shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// [`Torquers`].
    Torquers,
    /// [`Instruments`].
    Instruments,
    /// [`Catalogue`].
    Catalogue,
}

/// A column of a parameter: columns of the shape, with factors in units of the prior σ.
type Column = Vec<(usize, f64)>;

/// How the parameters of a platform are made of the columns of a shape.
#[derive(Debug, Clone)]
pub struct Mixing {
    /// The smallest shape that has all columns.
    pub(super) kind: Kind,
    /// How many parameters are estimated beside those that are seen.
    pub(super) estimated: usize,
    /// How many are considered.
    pub(super) considered: usize,
    /// 1σ of all parameters before the test, in their units.
    pub(super) prior_sigma: Vec<f64>,
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

/// The columns of `S` that make a feature of an instrument; none if it does not have them.
fn expanded<S: Shape>(term: &Term) -> Option<Column> {
    let (group, axis) = match term.instrument {
        Instrument::Gyro(axis) => (0, axis),
        Instrument::Accelerometer(axis) => (1, axis),
    };
    let find = |feature: Feature| {
        let quads = S::LAYOUT.iter().enumerate();
        let mut of = quads.filter(|(_, q)| q.group == group && q.axis == axis);
        of.find_map(|(q, layout)| {
            let features = &S::FEATURES[layout.block];
            let e = features.iter().position(|f| *f == feature)?;
            Some(4 * q + e)
        })
    };
    if let Some(at) = find(term.feature) {
        return Some(vec![(at, term.factor)]);
    }
    // g_x² + g_y² + g_z² = 1.
    let others = match term.feature {
        Feature::XX => [Feature::YY, Feature::ZZ],
        Feature::YY => [Feature::XX, Feature::ZZ],
        Feature::ZZ => [Feature::XX, Feature::YY],
        _ => return None,
    };
    Some(vec![
        (find(Feature::One)?, term.factor),
        (find(others[0])?, -term.factor),
        (find(others[1])?, -term.factor),
    ])
}

/// The column of a parameter in `S`, in units of its prior σ.
fn column<S: Shape>(parameter: &Parameter) -> Option<Column> {
    let mut all: Column = Vec::new();
    for term in &parameter.terms {
        for (at, factor) in expanded::<S>(term)? {
            match all.iter_mut().find(|(known, _)| *known == at) {
                Some((_, sum)) => *sum += factor * parameter.prior_sigma,
                None => all.push((at, factor * parameter.prior_sigma)),
            }
        }
    }
    all.retain(|(_, factor)| *factor != 0.0);
    Some(all)
}

impl Mixing {
    /// Of `parameters`; none if no shape has all their features. Parameters that are known exactly
    /// are left out, but for those that are seen.
    pub fn new(parameters: &Parameters) -> Option<Self> {
        let is_open = |p: &&Parameter| p.prior_sigma != 0.0;
        let estimated: Vec<&Parameter> = parameters.estimated.iter().filter(is_open).collect();
        let considered: Vec<&Parameter> = parameters.considered.iter().filter(is_open).collect();
        let counts = (estimated.len(), considered.len());
        let all: Vec<&Parameter> = estimated
            .into_iter()
            .chain(considered)
            .chain(&parameters.weighted)
            .chain(&parameters.coefficients)
            .collect();
        None.or_else(|| Self::on::<Torquers>(Kind::Torquers, &all, counts))
            .or_else(|| Self::on::<Instruments>(Kind::Instruments, &all, counts))
            .or_else(|| Self::on::<Catalogue>(Kind::Catalogue, &all, counts))
    }

    fn on<S: Shape>(
        kind: Kind,
        all: &[&Parameter],
        (estimated, considered): (usize, usize),
    ) -> Option<Self> {
        let of: Option<Vec<Column>> = all.iter().map(|p| column::<S>(p)).collect();
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
            estimated,
            considered,
            prior_sigma: all.iter().map(|p| p.prior_sigma).collect(),
            ends,
            terms,
            pulls,
            columns,
            of,
        })
    }

    /// How many parameters there are.
    pub fn size(&self) -> usize {
        self.prior_sigma.len()
    }

    /// 1σ of what is seen before the test.
    pub(super) fn seen_sigma(&self) -> &[f64] {
        &self.prior_sigma[self.estimated + self.considered..]
    }

    /// Lᵀ E L in units of the prior σ, its upper triangle, row by row, full rows; from the entries of
    /// the tiles.
    #[inline(always)]
    pub(super) fn information<N: super::arithmetic::Number>(&self, zero: N, tiles: &[N]) -> Vec<N> {
        let size = self.size();
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
