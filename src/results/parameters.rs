//! The parameters of a full error model, and what ignoring some of them would do.

use serde::{Deserialize, Serialize};

use super::common::finite;
use crate::drift::{COEFFICIENTS, DriftCoefficient};
use crate::evaluate::{Evaluation, Objective};
use crate::model::Role;

/// Whether the filter knows of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum RoleRecord {
    /// A state of the filter.
    Estimated,
    /// In the platform, but not in the filter.
    Considered,
}

impl From<Role> for RoleRecord {
    fn from(role: Role) -> Self {
        match role {
            Role::Estimated => Self::Estimated,
            Role::Considered => Self::Considered,
        }
    }
}

/// What the test tells about one parameter, in its own unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ParameterRecord {
    /// `D_FX`, `T_XY`, `K_0Z` …
    pub name: String,
    /// The key of its group, in `[prior]` for the drift coefficients, in `[errors]` for others.
    pub group: String,
    /// `deg/h`, `deg/h/g`, `deg/h/g2`, `ppm`, `arcsec`, `ug`, `ug/g2` or `ug/g3`.
    pub unit: String,
    /// Whether the filter knows of it.
    pub role: RoleRecord,
    /// 1σ before the test.
    pub prior_sigma: f64,
    /// 1σ after the test: the truth; of a considered parameter the same as before.
    pub sigma: f64,
    /// 1σ after the test as the filter claims it; absent: nothing is considered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub claimed_sigma: Option<f64>,
    /// 1σ of the constant part of D_F under a rate random walk: `sigma` then is of the drift at the end of
    /// the test, the constant part and what the walk has come to; absent: no random walk.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub constant_part_sigma: Option<f64>,
    /// Specification, 1σ; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spec: Option<f64>,
    /// Highest derivative of the measurement that a solution needs; null: not observable, or not
    /// estimated.
    pub observability_order: Option<u8>,
    /// How far its signature is its own by the information without priors, 0 to 1; null: known exactly
    /// before the test, or not estimated.
    pub separability: Option<f64>,
}

/// What a filter would add to the errors of the drift coefficients that ignored a group of `[errors]`
/// and estimated the rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct BudgetRecord {
    /// The key of the group in `[errors]`.
    pub group: String,
    /// Considered: the filter ignores it already, and this is its share of the truth.
    pub role: RoleRecord,
    /// √(mean of the squared 1σ errors of the twelve coefficients), °/h.
    pub rms_error_if_ignored_deg_per_h: f64,
    /// The same divided by the RMS σ of the evaluation; null when that is zero.
    pub ratio: Option<f64>,
    /// The coefficient that suffers most beside its σ; null when every coefficient is known exactly.
    pub worst: Option<WorstRecord>,
}

/// The coefficient that suffers most.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct WorstRecord {
    /// Which.
    pub name: DriftCoefficient,
    /// Its error divided by its σ.
    pub ratio: f64,
}

/// The parameters of an evaluation.
pub(super) fn of(evaluation: &Evaluation, objective: &Objective) -> Vec<ParameterRecord> {
    let of_others = || objective.others.iter().zip(&objective.spec_of_others);
    let spec = |k: usize| match k < COEFFICIENTS {
        true => objective.spec_deg_per_h.map(|s| s[k]),
        false => of_others().find(|(at, _)| **at == k).map(|(_, spec)| *spec),
    };
    let record = |(k, known): (usize, &crate::evaluate::KnownParameter)| {
        let p = &known.parameter;
        ParameterRecord {
            name: p.name.to_owned(),
            group: p.group.to_owned(),
            unit: p.unit.name().to_owned(),
            role: p.role.into(),
            prior_sigma: p.prior_sigma,
            sigma: known.sigma,
            claimed_sigma: known.claimed_sigma,
            constant_part_sigma: known.constant_part_sigma,
            spec: spec(k).and_then(finite),
            observability_order: known.order.map(|o| o.number()),
            separability: known.separability,
        }
    };
    evaluation
        .parameters
        .iter()
        .enumerate()
        .map(record)
        .collect()
}

/// The budget of an evaluation.
pub(super) fn budget(evaluation: &Evaluation) -> Vec<BudgetRecord> {
    let sigma = evaluation.end.sigma_deg_per_h();
    let rms_sigma = evaluation.rms_sigma_deg_per_h();
    let groups = evaluation.budget.iter();
    groups
        .map(|group| {
            let ratio = |c: DriftCoefficient| {
                let ratio = group.error_deg_per_h[c.index()] / sigma[c.index()];
                finite(ratio).map(|ratio| WorstRecord { name: c, ratio })
            };
            let all = DriftCoefficient::ALL.into_iter().filter_map(ratio);
            let rms_error = group.rms_error_deg_per_h();
            BudgetRecord {
                group: group.group.to_owned(),
                role: group.role.into(),
                rms_error_if_ignored_deg_per_h: rms_error,
                ratio: finite(rms_error / rms_sigma),
                worst: all.max_by(|a, b| a.ratio.total_cmp(&b.ratio)),
            }
        })
        .collect()
}
