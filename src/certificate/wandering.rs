//! What no schedule knows better of the D_F where drift wanders (`docs/certificate.md`, section 11).
//!
//! The drift rate of the three gyros, e(t) = D_F + d(t), reaches the measurements as u = C(t) e + what is
//! taken as known, so that the information on e is at most J(t) = C(t)ᵀ Δ(t) C(t). The variances are convex
//! in J, and equal gyros may change places and signs: the sum over m of them is least when each has the same
//! part of what J can be on them, the mean of the m largest of Δ. What is left is one gyro,
//! measured all the time with a known accuracy ([`riccati`](super::riccati)).

use super::conditions::Conditions;
use super::majorant::{Choice, Emphasis, Shaped, shaped};
use super::riccati::{Stretch, least_variance};
use super::{Certifier, CriterionBound, MARGIN, MajorantInUse};
use crate::criterion::Criterion;
use crate::drift::{CoefficientVector, DriftCoefficient, DriftKind};
use crate::error::Result;

const GYROS: usize = 3;
/// All sets of gyros, by bits.
const SETS: std::ops::Range<usize> = 1..1 << GYROS;

/// Lower bounds on the variances of the D_F, at the end of a test of a given duration or shorter.
#[derive(Debug, Clone)]
pub(super) struct Wandering {
    /// Place of each gyro's D_F.
    places: [usize; GYROS],
    /// Whether D_F counts at all: one that is known exactly does not, unless it walks.
    counts: [bool; GYROS],
    /// Prior variances, (°/h)².
    prior: [f64; GYROS],
    /// [m − 1][k]: mean variance of any m of them that are known before no better than k is.
    variances: [[f64; GYROS]; GYROS],
    /// A majorant it rests on.
    pub majorant: Option<MajorantInUse>,
}

impl Wandering {
    /// None where no drift wanders.
    pub fn new(conditions: &Conditions, total_time_s: f64) -> Option<Self> {
        let colour = &conditions.drift_colour;
        if colour.is_white() {
            return None;
        }
        let emphasis = Emphasis::on_constant_drift(Choice::Free);
        let found = shaped(conditions, total_time_s, &emphasis);
        let mut places = [0; GYROS];
        for (place, c) in places.iter_mut().zip(constant_drifts()) {
            *place = c.index();
        }
        let prior = places.map(|i| conditions.prior_sigma[i].powi(2));
        let mut variances = [[0.0; GYROS]; GYROS];
        for count in 1..=GYROS {
            for k in 0..GYROS {
                let same = (0..k).find(|&other| prior[other] == prior[k]);
                variances[count - 1][k] = match same {
                    Some(other) => variances[count - 1][other],
                    None => mean_variance(conditions, &found, count, prior[k]),
                };
            }
        }
        Some(Self {
            places,
            counts: prior.map(|v| v > 0.0 || colour.random_walk.is_some()),
            prior,
            variances,
            majorant: found.first().map(|s| s.in_use(total_time_s)),
        })
    }

    /// Mean variance of the D_F of a set of gyros.
    fn mean(&self, gyros: &[usize]) -> f64 {
        let least = gyros
            .iter()
            .copied()
            .min_by(|a, b| self.prior[*a].total_cmp(&self.prior[*b]));
        least.map_or(0.0, |k| self.variances[gyros.len() - 1][k])
    }

    /// Variance of each by itself, and the coefficient's place.
    fn alone(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        (0..GYROS).map(|k| (self.places[k], self.mean(&[k])))
    }

    /// Σ w σ² over the D_F: in layers of equal weight, the larger weights in more of them.
    fn weighted(&self, weights: &CoefficientVector) -> f64 {
        let weight = |k: &usize| weights[self.places[*k]];
        let mut gyros: Vec<usize> = (0..GYROS).filter(|&k| self.counts[k]).collect();
        gyros.sort_by(|a, b| weight(b).total_cmp(&weight(a)));
        let layered: f64 = (1..=gyros.len())
            .map(|m| {
                let next = gyros.get(m).map_or(0.0, weight);
                (weight(&gyros[m - 1]) - next) * m as f64 * self.mean(&gyros[..m])
            })
            .sum();
        let one_by_one = self.alone().map(|(i, v)| weights[i] * v).sum();
        layered.max(one_by_one)
    }

    /// max σ²/s² over the D_F, no less than the sum over any of them by the sum of s².
    fn worst(&self, spec: &CoefficientVector) -> f64 {
        SETS.map(|set| {
            let gyros: Vec<usize> = (0..GYROS).filter(|k| set & (1 << k) != 0).collect();
            let allowed: f64 = gyros.iter().map(|&k| spec[self.places[k]].powi(2)).sum();
            gyros.len() as f64 * self.mean(&gyros) / allowed
        })
        .fold(0.0, f64::max)
    }

    /// ln det of the covariance of those that count, and how many they are.
    fn log_determinant(&self) -> (f64, usize) {
        let gyros: Vec<usize> = (0..GYROS).filter(|&k| self.counts[k]).collect();
        if gyros.is_empty() {
            return (0.0, 0);
        }
        (
            gyros.len() as f64 * libm::log(self.mean(&gyros)),
            gyros.len(),
        )
    }
}

fn constant_drifts() -> impl Iterator<Item = DriftCoefficient> {
    let all = DriftCoefficient::ALL.into_iter();
    all.filter(|c| c.kind() == DriftKind::Constant)
}

fn mean_variance(conditions: &Conditions, found: &[Shaped], count: usize, prior: f64) -> f64 {
    let of = |shaped: &Shaped| {
        // The m largest of Δ are all that J can be on m gyros together.
        let mut delta = shaped.delta;
        delta.sort_by(|a, b| b.total_cmp(a));
        let share = delta[..count].iter().sum::<f64>() / count as f64;
        let cells = &shaped.cells;
        let stretches = shaped.profile.iter().enumerate().map(|(j, f)| Stretch {
            length_s: cells.inside_s(j),
            rate: share * f,
        });
        least_variance(&conditions.drift_colour, prior, stretches)
    };
    found.iter().map(of).fold(0.0, f64::max)
}

/// Without the weights on the D_F.
fn without_constant_drift(weights: &CoefficientVector) -> CoefficientVector {
    let mut rest = *weights;
    for c in constant_drifts() {
        rest[c.index()] = 0.0;
    }
    rest
}

impl Certifier {
    /// The larger of the bound by white noise alone, `white`, and of what drift that wanders makes
    /// of it. `criterion` is of the twelve coefficients.
    pub(super) fn with_wandering(
        &self,
        criterion: &Criterion,
        white: CriterionBound,
        total_time_s: f64,
    ) -> Result<CriterionBound> {
        let Some(wandering) = Wandering::new(&self.conditions, total_time_s) else {
            return Ok(white);
        };
        let (lower_bound, missing) = match criterion {
            Criterion::A { weights, .. } => {
                let rest = Criterion::weighted(without_constant_drift(weights));
                let of_rest = self.of_white_noise(&rest, total_time_s)?;
                let Criterion::A { weights: of, .. } = &rest else {
                    return Ok(white);
                };
                let rest_sum = of_rest.lower_bound.powi(2) * of.sum();
                let drift_sum = wandering.weighted(weights) * (1.0 - MARGIN).powi(2);
                let all = rest_sum + drift_sum;
                // Of the sum only the rest is a design.
                let share = if all > 0.0 { rest_sum / all } else { 0.0 };
                let value = (all / weights.sum()).sqrt();
                (value, of_rest.equivalence_gap * share)
            }
            Criterion::D => {
                return self.determinant_with_wandering(&wandering, white, total_time_s);
            }
            Criterion::E => {
                let of_each = CoefficientVector::repeat(1.0);
                (wandering.worst(&of_each).sqrt() * (1.0 - MARGIN), 0.0)
            }
            Criterion::MaxRatio { spec_deg_per_h, .. } => {
                (wandering.worst(spec_deg_per_h).sqrt() * (1.0 - MARGIN), 0.0)
            }
            Criterion::Use { .. } => return Ok(white),
        };
        if lower_bound.is_nan() || lower_bound <= white.lower_bound {
            return Ok(white);
        }
        Ok(CriterionBound {
            lower_bound,
            equivalence_gap: missing,
            majorant: white.majorant.or(wandering.majorant),
            rests_on_priors: false,
        })
    }

    /// ln det P = ln det P_FF + ln det of the rest for known D_F, and the latter is no less than for a d that
    /// is known as well: white noise alone.
    fn determinant_with_wandering(
        &self,
        wandering: &Wandering,
        white: CriterionBound,
        total_time_s: f64,
    ) -> Result<CriterionBound> {
        let mut conditions = self.conditions.clone();
        for c in constant_drifts() {
            conditions.prior_sigma[c.index()] = 0.0;
        }
        let known = Self {
            conditions,
            directions: self.directions.clone(),
            unlimited: self.unlimited.clone(),
            unseen: None,
        };
        let open = |certifier: &Self| {
            let sigma = certifier.conditions.prior_sigma.iter();
            sigma.filter(|s| **s > 0.0).count()
        };
        let rest = known.of_white_noise(&Criterion::D, total_time_s)?;
        let (log_drift, drifts) = wandering.log_determinant();
        let others = open(&known);
        let of_rest = match others {
            0 => 0.0,
            _ => 2.0 * others as f64 * libm::log(rest.lower_bound),
        };
        let count = (others + drifts) as f64;
        let value = libm::exp((of_rest + log_drift) / (2.0 * count)) * (1.0 - MARGIN);
        // Where a known D_F walks there are more to count than white noise knows of.
        let comparable = open(self) == others + drifts;
        if comparable && (value.is_nan() || value <= white.lower_bound) {
            return Ok(white);
        }
        Ok(CriterionBound {
            lower_bound: value,
            equivalence_gap: rest.equivalence_gap * others as f64 / count,
            majorant: white.majorant.or(wandering.majorant),
            rests_on_priors: false,
        })
    }

    /// `sigma` raised to what drift that wanders leaves of each D_F.
    pub(super) fn sigma_with_wandering(
        &self,
        mut sigma: CoefficientVector,
        total_time_s: f64,
    ) -> CoefficientVector {
        if let Some(wandering) = Wandering::new(&self.conditions, total_time_s) {
            for (i, variance) in wandering.alone() {
                sigma[i] = sigma[i].max(variance.sqrt() * (1.0 - MARGIN));
            }
        }
        sigma
    }
}

#[cfg(test)]
mod tests;
