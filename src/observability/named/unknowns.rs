//! The unknowns by name, and the split of their signatures into what shows and what does not.

use nalgebra::{DMatrix, DVector};

use super::{
    MOST_WEAK, NamedCombination, NamedTerm, PSI, UNSEEN, WEAK, WRITTEN_OF_WEAK, WeakNamed,
};
use crate::covariance::CovarianceModel;
use crate::covariance::signatures::Signatures;
use crate::observability::singular::Singular;

/// The unknowns by name.
pub(super) struct Names {
    pub(super) name: Vec<&'static str>,
    pub(super) unit: Vec<&'static str>,
    /// 1σ before the test.
    pub(super) prior: Vec<f64>,
    /// Which belong together.
    pub(super) family: Vec<usize>,
}

impl Names {
    pub(super) fn new(model: &CovarianceModel) -> Self {
        let parameters = &model.errors.parameters()[..model.errors.estimated()];
        let mut groups: Vec<&str> = parameters.iter().map(|p| p.group).collect();
        groups.dedup();
        let family = |group: &str| groups.iter().position(|g| *g == group).unwrap_or(0);
        let psi = model.prior_psi.diagonal().map(f64::sqrt);
        let of_each = parameters.iter();
        Self {
            name: of_each.clone().map(|p| p.name).chain(PSI).collect(),
            unit: of_each
                .clone()
                .map(|p| p.unit.name())
                .chain(["arcsec"; 3])
                .collect(),
            prior: of_each
                .clone()
                .map(|p| p.prior_sigma)
                .chain(psi.iter().copied())
                .collect(),
            family: of_each
                .map(|p| family(p.group))
                .chain([groups.len(); 3])
                .collect(),
        }
    }

    /// Those not known exactly.
    pub(super) fn open(&self) -> Vec<usize> {
        (0..self.prior.len())
            .filter(|&j| self.prior[j] > 0.0)
            .collect()
    }

    /// The combination whose signatures, scaled to length one, have these weights.
    pub(super) fn combination(
        &self,
        open: &[usize],
        lengths: &[f64],
        vector: &DVector<f64>,
        written: f64,
    ) -> NamedCombination {
        let largest = vector.amax();
        // What shows nothing at all stands by itself.
        let length = |j: usize| match lengths[j] > 0.0 {
            true => lengths[j],
            false => 1.0,
        };
        // The first of those that are large leads.
        let lead = vector
            .iter()
            .position(|v| v.abs() >= 0.5 * largest)
            .unwrap_or(0);
        let unit = vector[lead] / length(open[lead]);
        let terms = vector.iter().enumerate().filter(|(_, v)| **v != 0.0);
        NamedCombination {
            terms: terms
                .map(|(k, v)| NamedTerm {
                    name: self.name[open[k]],
                    unit: self.unit[open[k]],
                    weight: v / length(open[k]) / unit,
                    share: v.abs() / largest,
                })
                .collect(),
            written,
        }
    }
}

/// The unknowns that are open, split into what shows and what does not.
pub(super) struct Split {
    pub(super) open: Vec<usize>,
    /// Directions that do not show, in signatures of length one.
    pub(super) null: DMatrix<f64>,
    pub(super) gap: [f64; 2],
    /// Singular values that count, with their directions, the smallest first.
    pub(super) seen: Vec<(f64, DVector<f64>)>,
}

impl Split {
    pub(super) fn of(signatures: &Signatures, open: &[usize]) -> Self {
        let svd = Singular::of(signatures.columns.nrows(), open.len(), |i, k| {
            signatures.columns[(i, open[k])]
        });
        let largest = svd.values.first().copied().unwrap_or(0.0);
        let rank = svd.values.iter().filter(|v| **v > UNSEEN * largest).count();
        let direction = |k: usize| DVector::from_fn(open.len(), |j, _| svd.vector(k, j));
        let relative = |k: Option<usize>| {
            let value = k.and_then(|k| svd.values.get(k)).copied().unwrap_or(0.0);
            if largest > 0.0 { value / largest } else { 0.0 }
        };
        let missing: Vec<DVector<f64>> = (rank..open.len()).map(direction).collect();
        Self {
            open: open.to_vec(),
            null: DMatrix::from_fn(open.len(), missing.len(), |j, k| missing[k][j]),
            gap: [relative(rank.checked_sub(1)), relative(Some(rank))],
            seen: (0..rank)
                .rev()
                .map(|k| (svd.values[k], direction(k)))
                .collect(),
        }
    }

    pub(super) fn weak(&self, signatures: &Signatures, names: &Names) -> Vec<WeakNamed> {
        let hardly = self.seen.iter().take_while(|(value, _)| *value < WEAK);
        hardly
            .take(MOST_WEAK)
            .map(|(value, direction)| {
                let combination =
                    names.combination(&self.open, &signatures.lengths, direction, WRITTEN_OF_WEAK);
                let leads = |t: &&NamedTerm| t.weight == 1.0;
                let lead = combination.terms.iter().find(leads);
                let at = lead.and_then(|t| names.name.iter().position(|n| *n == t.name));
                let size = lead.map_or(1.0, |t| t.share) * direction.amax();
                WeakNamed {
                    share: *value,
                    sigma: size / (at.map_or(1.0, |j| signatures.lengths[j]) * value),
                    combination,
                }
            })
            .collect()
    }
}
