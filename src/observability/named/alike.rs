//! Combinations that follow from the model alone: what is nothing at 1 g, and drift along the vertical;
//! and the principal directions of what is not known of the drift.

use nalgebra::{DMatrix, DVector};

use super::{NamedCombination, NamedTerm, UNSEEN, WRITTEN, WRITTEN_OF_WEAK};
use crate::drift::COEFFICIENTS;
use crate::model::{ErrorModel, Parameter};
use crate::observability::singular::Singular;
use crate::observability::sparse::sparse_basis;

/// Sums of open parameters that are nothing at 1 g, whatever the attitude.
pub(super) fn alike_at_one_g(
    errors: &ErrorModel,
    open: &[usize],
    families: &[usize],
) -> Vec<NamedCombination> {
    let estimated = &errors.parameters()[..errors.estimated()];
    let effects = errors.effects();
    let turns = |j: usize| effects[j].iter().any(|e| e.feature.is_rate());
    let (of, families): (Vec<usize>, Vec<usize>) = open
        .iter()
        .zip(families)
        .filter(|(j, _)| **j < estimated.len() && !turns(**j))
        .map(|(j, family)| (*j, *family))
        .unzip();
    let mut functions = errors.at_one_g(&of);
    let sizes: Vec<f64> = functions.column_iter().map(|c| c.norm()).collect();
    for (mut column, size) in functions.column_iter_mut().zip(&sizes) {
        column /= *size;
    }
    let none = DMatrix::zeros(of.len(), 0);
    sparse_basis(&null_space(&functions), &none, &families)
        .iter()
        .map(|vector| {
            let weights = DVector::from_fn(of.len(), |k, _| vector[k] / sizes[k]);
            of_parameters(estimated, &of, &weights, WRITTEN)
        })
        .collect()
}

/// An orthonormal basis of what a matrix takes to nothing.
fn null_space(m: &DMatrix<f64>) -> DMatrix<f64> {
    let width = m.ncols();
    let svd = Singular::of(m.nrows(), width, |i, j| m[(i, j)]);
    let largest = svd.values.first().copied().unwrap_or(0.0);
    let rank = svd.values.iter().filter(|v| **v > UNSEEN * largest).count();
    DMatrix::from_fn(width, width - rank, |j, k| svd.vector(rank + k, j))
}

/// Sums of drift parameters that are drift along the vertical at every attitude, ε(u) = λ(u) u, and not
/// nothing.
pub(crate) fn vertical(errors: &ErrorModel) -> Vec<NamedCombination> {
    let estimated = &errors.parameters()[..errors.estimated()];
    let by_gravity = errors.drifts_by_gravity();
    let of: Vec<usize> = (0..estimated.len()).filter(|&j| by_gravity[j]).collect();
    let [horizontal, whole] = errors.horizontal_and_whole(&of);
    // What is nothing at 1 g is no drift along the vertical.
    let nothing = null_space(&whole);
    let basis = null_space(&horizontal);
    let group = |j: usize| estimated.iter().position(|p| p.group == estimated[j].group);
    let groups: Vec<usize> = of.iter().filter_map(|&j| group(j)).collect();
    sparse_basis(&basis, &nothing, &groups)
        .iter()
        .map(|vector| of_parameters(estimated, &of, vector, WRITTEN))
        .collect()
}

/// A principal direction of what is not known of the drift after the test.
#[derive(Debug, Clone, PartialEq)]
pub struct PrincipalDrift {
    /// Drift parameters, of length one, small parts not in its name.
    pub combination: NamedCombination,
    /// 1σ of the combination scaled to length one, °/h (g-sensitive ones at 1 g).
    pub sigma: f64,
    /// Its part along the drift that is vertical at every attitude, 0 to 1.
    pub vertical: f64,
}

/// The principal directions of the covariance of the drift parameters, the worst first; none without
/// quadratic terms, where those of the coefficients say it all. `covariance` is of the estimated
/// parameters in their units.
pub(crate) fn principal_drift(
    errors: &ErrorModel,
    covariance: &DMatrix<f64>,
    vertical: &[NamedCombination],
) -> Vec<PrincipalDrift> {
    /// Beyond these there is nothing to tell them by.
    const MOST: usize = 8;
    let estimated = &errors.parameters()[..errors.estimated()];
    let by_gravity = errors.drifts_by_gravity();
    let of: Vec<usize> = (0..estimated.len()).filter(|&j| by_gravity[j]).collect();
    if of.len() == COEFFICIENTS {
        return Vec::new();
    }
    let p = DMatrix::from_fn(of.len(), of.len(), |i, j| covariance[(of[i], of[j])]);
    let eigen = p.symmetric_eigen();
    let mut order: Vec<usize> = (0..of.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let vector_of = |c: &NamedCombination| {
        DVector::from_fn(of.len(), |k, _| {
            let term = c.terms.iter().find(|t| t.name == estimated[of[k]].name);
            term.map_or(0.0, |t| t.weight)
        })
    };
    let mut basis: Vec<DVector<f64>> = Vec::new();
    for v in vertical.iter().map(vector_of) {
        let rest = basis.iter().fold(v.clone(), |rest, b| rest - b * b.dot(&v));
        basis.push(rest.normalize());
    }
    let principal = |&k: &usize| {
        let vector = eigen.eigenvectors.column(k).into_owned();
        let along: f64 = basis.iter().map(|b| b.dot(&vector).powi(2)).sum();
        PrincipalDrift {
            sigma: eigen.eigenvalues[k].max(0.0).sqrt(),
            vertical: along.sqrt().min(1.0),
            combination: of_parameters(estimated, &of, &vector, WRITTEN_OF_WEAK),
        }
    };
    order.iter().take(MOST).map(principal).collect()
}

/// Parameters `of` the estimated ones by these weights, shares in one unit of each.
fn of_parameters(
    estimated: &[Parameter],
    of: &[usize],
    vector: &DVector<f64>,
    written: f64,
) -> NamedCombination {
    let largest = vector.amax();
    let lead = vector
        .iter()
        .position(|v| v.abs() > 0.5 * largest)
        .unwrap_or(0);
    let terms = vector.iter().zip(of).filter(|(v, _)| **v != 0.0);
    NamedCombination {
        terms: terms
            .map(|(v, &j)| NamedTerm {
                name: estimated[j].name,
                unit: estimated[j].unit.name(),
                weight: v / vector[lead],
                share: v.abs() / largest,
            })
            .collect(),
        written,
    }
}
