//! What would tell a combination that does not show, and what rests on the priors.

use nalgebra::{DMatrix, DVector};

use super::unknowns::Names;
use super::{NamedCombination, NamedTerm, PlatformAxis, PriorFloor, Remedy, Unobserved};
use crate::attitude::Position;
use crate::covariance::CovarianceModel;
use crate::covariance::signatures::Signatures;
use crate::model::Alike;
use crate::motion::{Test, Timeline};
use crate::observability::RANK_TOLERANCE;
use crate::observability::regressor::at_a_pole;
use crate::schedule::{Schedule, ScheduledPosition};

/// Says what would tell a combination.
pub(super) struct Judge<'a> {
    pub(super) model: &'a CovarianceModel,
    pub(super) names: &'a Names,
    /// What positions all over the stand show; none: they cannot be run.
    pub(super) stand: Option<Signatures>,
}

impl Judge<'_> {
    pub(super) fn judged(&self, combination: NamedCombination) -> Unobserved {
        let weights = self.weights(&combination);
        Unobserved {
            remedy: self.remedy(&weights),
            rests_on_priors: self.floors(&weights),
            combination,
        }
    }

    /// The unknowns in a combination, by index.
    fn weights(&self, combination: &NamedCombination) -> Vec<(usize, f64)> {
        let at = |t: &NamedTerm| self.names.name.iter().position(|n| *n == t.name);
        let terms = combination.terms.iter();
        terms.filter_map(|t| Some((at(t)?, t.weight))).collect()
    }

    /// An orthonormal basis of combinations in signatures of length one.
    pub(super) fn in_signatures(
        &self,
        signatures: &Signatures,
        open: &[usize],
        combinations: &[NamedCombination],
    ) -> DMatrix<f64> {
        let mut basis: Vec<DVector<f64>> = Vec::new();
        for combination in combinations {
            let weights = self.weights(combination);
            let longest = weights
                .iter()
                .map(|(j, w)| w.abs() * signatures.lengths[*j])
                .fold(0.0, f64::max);
            let mut vector = DVector::zeros(open.len());
            for (j, weight) in weights {
                // What shows nothing counts as much as the rest.
                let part = match signatures.lengths[j] > 0.0 {
                    true => weight * signatures.lengths[j],
                    false if longest > 0.0 => weight.signum() * longest,
                    false => weight,
                };
                if let Some(k) = open.iter().position(|&o| o == j) {
                    vector[k] = part;
                }
            }
            let rest = basis
                .iter()
                .fold(vector.clone(), |rest, b| rest - b * b.dot(&vector));
            basis.push(rest.normalize());
        }
        DMatrix::from_fn(open.len(), basis.len(), |j, k| basis[k][j])
    }

    fn remedy(&self, weights: &[(usize, f64)]) -> Remedy {
        let errors = &self.model.errors;
        let estimated = errors.estimated();
        let of_parameters = weights.iter().all(|(j, _)| *j < estimated);
        if of_parameters {
            match errors.alike(weights) {
                Alike::Always => return Remedy::GiveOne,
                Alike::AtOneG => return Remedy::Centrifuge,
                Alike::No => {}
            }
        }
        let effects = errors.effects();
        let turned = |j: usize| {
            let of = effects.get(j).into_iter().flatten();
            of.filter_map(|e| e.feature.rate_axis()).next()
        };
        let drifts = errors.drifts_by_gravity();
        let is_drift = |j: usize| drifts.get(j).copied().unwrap_or(false);
        let of_stand = self.shown_on_stand(weights);
        if of_stand == Some(false) {
            let all_drift = weights.iter().all(|(j, _)| is_drift(*j));
            let pole = at_a_pole(self.model) && self.model.azimuth_variance.is_none();
            return match pole && all_drift {
                true => Remedy::OtherLatitude,
                false => Remedy::OtherStand,
            };
        }
        let mut axes: Vec<PlatformAxis> = weights
            .iter()
            .filter_map(|(j, _)| turned(*j))
            .map(|axis| PlatformAxis::ALL[axis])
            .collect();
        let only_turning = weights
            .iter()
            .all(|(j, _)| turned(*j).is_some() || is_drift(*j));
        // Where ψ stays with the platform, no move turns the torquers: they show in tracking alone.
        match only_turning && !axes.is_empty() && !self.model.frame_hold {
            true => {
                axes.sort();
                axes.dedup();
                Remedy::Slews { axes }
            }
            false => Remedy::OtherPositions,
        }
    }

    /// Whether positions all over the stand show the combination.
    fn shown_on_stand(&self, weights: &[(usize, f64)]) -> Option<bool> {
        let stand = self.stand.as_ref()?;
        let mut sum = DVector::zeros(stand.columns.nrows());
        let mut whole = 0.0;
        for (j, weight) in weights {
            let part = stand.columns.column(*j) * (weight * stand.lengths[*j]);
            whole += part.norm();
            sum += part;
        }
        Some(sum.norm() > RANK_TOLERANCE * whole)
    }

    fn floors(&self, weights: &[(usize, f64)]) -> Vec<PriorFloor> {
        let sum: f64 = weights
            .iter()
            .map(|(j, w)| (w / self.names.prior[*j]).powi(2))
            .sum();
        weights
            .iter()
            .map(|(j, w)| PriorFloor {
                name: self.names.name[*j],
                unit: self.names.unit[*j],
                least_sigma: w.abs() / sum.sqrt(),
                share_of_prior: w.abs() / sum.sqrt() / self.names.prior[*j],
            })
            .collect()
    }
}

/// Positions spread over all that the gimbals allow, held long enough, with the moves that the platform
/// makes; none where it cannot run them.
pub(super) fn positions_all_over(test: &Test) -> Option<Timeline> {
    /// More than enough for every parameter.
    const POSITIONS: usize = 24;
    /// Irrational turns that fill a cube evenly (Roberts).
    const TURNS: [f64; 3] = [
        0.819_172_513_396_164_4,
        0.671_043_606_703_789,
        0.549_700_477_901_970,
    ];
    let platform = test.platform();
    let gimbals = platform.gimbals();
    let angle = |axis: usize, share: f64| match gimbals.settings_deg(axis) {
        Some(settings) => {
            let settings: Vec<f64> = settings.collect();
            let at = (share * settings.len() as f64) as usize;
            settings[at.min(settings.len() - 1)]
        }
        None => match gimbals.ranges[axis] {
            Some(r) => {
                let (low, high) = r.ends().into_inner();
                low.deg() + share * (high.deg() - low.deg())
            }
            None => 360.0 * share - 180.0,
        },
    };
    let dwell_s = (60.0 * platform.period_s()).max(platform.shortest_dwell_s());
    let held = (0..POSITIONS).map(|k| {
        let [a, b, c] = [0, 1, 2].map(|axis| {
            let share = (0.5 + TURNS[axis] * (k + 1) as f64).fract();
            (angle(axis, share) * 1e6).round() / 1e6
        });
        ScheduledPosition::new(Position::from_deg(a, b, c), dwell_s)
    });
    Timeline::new(test, &Schedule::new(held.collect()).ok()?).ok()
}
