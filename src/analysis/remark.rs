//! What is worth saying of a platform with more than the twelve coefficients.

use std::fmt;

use crate::covariance::CovarianceModel;
use crate::drift::DriftCoefficient;
use crate::evaluate::Evaluation;
use crate::observability::Order;
use crate::wording::{listed, number};

/// A principal direction is one of drift along the vertical where so much of it is.
const VERTICAL: f64 = 0.9;

/// A remark; its `Display` is the sentence.
#[derive(Debug, Clone, PartialEq)]
pub enum Remark {
    /// The azimuth is measured: ψ_y is of order 0, ε_y of order 1.
    AzimuthMeasured {
        /// The coefficients that are of order 1 by it; all three of the input axes, if observable.
        input_first: bool,
    },
    /// Drift or biases wander, which only part of an analysis counts.
    NoiseWanders,
    /// With quadratic terms: what is of order 2 under every schedule, the larger trace theorem.
    VerticalDrift {
        /// The combinations.
        combinations: Vec<String>,
        /// σ of the worst directions of drift that are of this kind, °/h at 1 g, the worst first.
        worst_sigma_deg_per_h: Vec<f64>,
        /// σ of the worst direction that is not.
        next_sigma_deg_per_h: Option<f64>,
        /// Whether the azimuth is measured, by which they are of order 1 all the same.
        azimuth_measured: bool,
    },
}

impl Remark {
    /// Of the schedule of which `evaluation` is the evaluation.
    pub(crate) fn of(model: &CovarianceModel, evaluation: &Evaluation) -> Vec<Self> {
        let mut remarks = Vec::new();
        let azimuth_measured = model.azimuth_variance.is_some();
        if azimuth_measured {
            let input = [
                DriftCoefficient::IX,
                DriftCoefficient::IY,
                DriftCoefficient::IZ,
            ];
            let order = |c: DriftCoefficient| evaluation.observability.orders[c.index()];
            remarks.push(Self::AzimuthMeasured {
                input_first: input.into_iter().all(|c| order(c) == Some(Order::First)),
            });
        }
        if !model.is_white() {
            remarks.push(Self::NoiseWanders);
        }
        let vertical = evaluation.named.as_ref().map_or(&[][..], |n| &n.vertical);
        if !evaluation.principal_drift.is_empty() && !vertical.is_empty() {
            let worst = evaluation.principal_drift.iter();
            let (of_kind, other): (Vec<_>, Vec<_>) = worst.partition(|p| p.vertical >= VERTICAL);
            remarks.push(Self::VerticalDrift {
                combinations: vertical.iter().map(|c| c.sum()).collect(),
                next_sigma_deg_per_h: other.first().map(|p| p.sigma),
                worst_sigma_deg_per_h: of_kind
                    .iter()
                    .map(|p| p.sigma)
                    .take_while(|s| other.first().is_none_or(|o| *s > o.sigma))
                    .collect(),
                azimuth_measured,
            });
        }
        remarks
    }

    /// The name of [`Remark::NoiseWanders`].
    pub(crate) const NOISE_WANDERS: &'static str = "noise-wanders";

    /// A short name.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::AzimuthMeasured { .. } => "azimuth-measured",
            Self::NoiseWanders => Self::NOISE_WANDERS,
            Self::VerticalDrift { .. } => "vertical-drift",
        }
    }
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AzimuthMeasured { input_first } => {
                f.write_str(
                    "The azimuth is measured: psi_y is of order 0, and eps_y shows in its first \
                     derivative, not in the second of Z.",
                )?;
                match input_first {
                    true => f.write_str(
                        " So D_IX, D_IY and D_IZ are of order 1, their sum D_IX + D_IY + D_IZ too.",
                    ),
                    false => Ok(()),
                }
            }
            Self::NoiseWanders => f.write_str(
                "What wanders counts in the sigma by the filter and in what is suggested. The orders, the \
                 separability of the coefficients, the reconstructions with their sigma, the Gramian and the \
                 sensitivity are of the white noise alone.",
            ),
            Self::VerticalDrift {
                combinations,
                worst_sigma_deg_per_h,
                next_sigma_deg_per_h,
                azimuth_measured,
            } => {
                write!(
                    f,
                    "Drift along the vertical is vertical at every attitude: {}.",
                    combinations.join("; ")
                )?;
                f.write_str(match azimuth_measured {
                    true => {
                        " No schedule shows it in a horizontal channel; the measured azimuth \
                         makes it order 1."
                    }
                    false => {
                        " It is of order 2 under every schedule, so that time and a measured \
                         azimuth help, and positions do not."
                    }
                })?;
                let sigma: Vec<String> = worst_sigma_deg_per_h.iter().map(|s| number(*s)).collect();
                match (sigma.len(), next_sigma_deg_per_h) {
                    (0, _) => Ok(()),
                    (count, next) => {
                        let directions = match count {
                            1 => "worst direction of drift is".to_owned(),
                            n => format!("{n} worst directions of drift are"),
                        };
                        write!(
                            f,
                            " The {directions} of this kind: sigma {} deg/h at 1 g",
                            listed(&sigma)
                        )?;
                        match next {
                            Some(next) => write!(f, ", the next {}.", number(*next)),
                            None => f.write_str("."),
                        }
                    }
                }
            }
        }
    }
}
