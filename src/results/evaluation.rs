//! The document of an evaluation: all that is known of a schedule before the test.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::common::{Inputs, TOOL_VERSION, finite, warnings};
use super::given::DoneRecord;
use super::limits::LimitRecord;
use super::named::NamedObservabilityRecord;
use super::parameters::{self, BudgetRecord, ParameterRecord};
use crate::config::{StudyConfig, TestConfig};
use crate::covariance::Precision;
use crate::covariance::history::{ConvergenceHistory, PositionConvergence};
use crate::criterion::Criterion;
use crate::drift::{CoefficientVector, DriftCoefficient};
use crate::evaluate::{
    Disagreement, Evaluation, HeldPosition, MISALIGNMENT_NAMES, Objective, Score,
};
use crate::schedule::file::ScheduleDocument;
use crate::schedule::{Schedule, ScheduledPosition};
use crate::suspicion::WarningRecord;

/// Name and major version of the [`EvaluationDocument`].
pub const EVALUATION_SCHEMA: &str = "scheme-opt/evaluation/1";

/// All that is known of a schedule before the test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct EvaluationDocument {
    /// [`EVALUATION_SCHEMA`].
    pub schema: String,
    /// Version of the program that wrote it.
    pub tool_version: String,
    /// Whose test it is; left out where nobody said.
    #[serde(default, skip_serializing_if = "TestConfig::is_empty")]
    pub test: TestConfig,
    /// Duration of the test, moves and settles included, s.
    pub total_time_s: f64,
    /// Of which moves and settles, s.
    pub overhead_s: f64,
    /// √(mean of the coefficient variances), °/h.
    pub rms_sigma_deg_per_h: f64,
    /// Largest σ of a coefficient, °/h.
    pub max_sigma_deg_per_h: f64,
    /// σ of the worst combination of coefficients, √λ_max(P_D), °/h.
    pub max_eig_sigma_deg_per_h: f64,
    /// ln det P_D, P_D in (°/h)²; null when a coefficient is known exactly.
    pub logdet_deg_per_h: Option<f64>,
    /// The figure of merit of a search, and its parts.
    pub score: ScoreRecord,
    /// Accuracy of the platform's alignment at the end.
    pub misalignment: Vec<MisalignmentRecord>,
    /// The drift coefficients, D_FX to D_SZ.
    pub coefficients: Vec<CoefficientRecord>,
    /// Every parameter of the platform in its own unit: the drift coefficients, others that the filter
    /// estimates, and those that it does not know of.
    #[serde(default)]
    pub parameters: Vec<ParameterRecord>,
    /// What ignoring each group of `[errors]` would do to the drift coefficients; left out where there is
    /// none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub budget: Vec<BudgetRecord>,
    /// What would make the criterion better, the most helpful first; left out where that is not worked
    /// out (schedules of a comparison, the rest of a test).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub limits: Vec<LimitRecord>,
    /// What of the test is done already; left out at the beginning of a test.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub done: Option<DoneRecord>,
    /// What the schedule makes observable.
    pub observability: ObservabilityRecord,
    /// σ against time.
    pub convergence: ConvergenceRecord,
    /// Largest relative difference of a σ between the dwell kernels and the step-by-step filter.
    pub agreement: f64,
    /// The numbers that gave the covariance: 16 digits, or 32 where measurements tell so much more
    /// than the prior that 16 are too few.
    #[serde(default)]
    pub precision: PrecisionRecord,
    /// Where the two computations differed in 16 digits, before both were repeated in 32.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first_disagreement: Option<DisagreementRecord>,
    /// The positions as they are held: when, and what the accelerometers then read.
    #[serde(default)]
    pub positions: Vec<HeldPositionRecord>,
    /// Largest |net angle − start| of α, β and γ at any instant of the test, degrees: whole turns counted,
    /// what cables have to bear.
    #[serde(default)]
    pub winding_deg: [f64; 3],
    /// The schedule evaluated.
    pub schedule: ScheduleDocument,
    /// The study as resolved.
    pub inputs: StudyConfig,
    /// Keys of `inputs` that nobody gave.
    pub defaulted: Vec<String>,
    /// Values of the inputs that are allowed but hard to believe; left out when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<WarningRecord>,
}

/// A position as it is held in the test.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct HeldPositionRecord {
    /// Outer angle α, degrees.
    pub alpha_deg: f64,
    /// Middle angle β, degrees.
    pub beta_deg: f64,
    /// Inner angle γ, degrees.
    pub gamma_deg: f64,
    /// How long it is held, s.
    pub dwell_s: f64,
    /// When the move to it and its settling are over, from the start of the test, s.
    pub starts_s: f64,
    /// What perfect accelerometers along the platform's x, y and z read there, g: the second row of
    /// C_c^n. One look at them tells whether the stand turns as the angles mean.
    pub specific_force_g: [f64; 3],
}

/// The numbers that a covariance was worked out in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum PrecisionRecord {
    /// 16 digits.
    #[default]
    Double,
    /// 32 digits.
    Extended,
}

impl From<Precision> for PrecisionRecord {
    fn from(precision: Precision) -> Self {
        match precision {
            Precision::Double => Self::Double,
            Precision::Extended => Self::Extended,
        }
    }
}

/// Where the two computations of a number differed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct DisagreementRecord {
    /// `D_FX` … `D_SZ`, `psi_nx` …: σ of it; two names: their correlation.
    pub name: String,
    /// `deg/h`, `arcsec`, or `1` for a correlation.
    pub unit: String,
    /// By the dwell kernels; null when it is not finite.
    pub kernels: Option<f64>,
    /// By the step-by-step filter; null when it is not finite.
    pub filter: Option<f64>,
    /// Their difference, of a σ relative to it; null when it is not finite.
    pub difference: Option<f64>,
}

impl From<&Disagreement> for DisagreementRecord {
    fn from(found: &Disagreement) -> Self {
        Self {
            name: found.of.name(),
            unit: found.of.unit().to_owned(),
            kernels: finite(found.kernels),
            filter: finite(found.filter),
            difference: finite(found.difference),
        }
    }
}

/// The score: value = covariance_part + separability_part + convergence_part, lower is better.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ScoreRecord {
    /// The figure of merit; null when it is infinite.
    pub value: Option<f64>,
    /// Value of the criterion, in `criterion_unit`.
    pub criterion: f64,
    /// `a`, `d`, `e`, `max-ratio` or `use`.
    pub criterion_name: String,
    /// `deg/h`; `1` for `max-ratio`, `arcsec` for `use`, `mixed` for `a` with weights of other parameters.
    pub criterion_unit: String,
    /// Weight times ln(criterion); null when the criterion is zero.
    pub covariance_part: Option<f64>,
    /// −weight times mean ln(separability); null when a coefficient cannot be separated at all.
    pub separability_part: Option<f64>,
    /// Weight times the average of ln(criterion) over the test; absent without a weight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub convergence_part: Option<f64>,
    /// Smallest separability of a coefficient, 0 to 1.
    pub least_separability: f64,
    /// Whether every coefficient reaches the minimum separability asked for.
    pub meets_minimum_separability: bool,
    /// Why the criterion is 0 before any test, in words; absent: it depends on the schedule.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub known_before: Option<String>,
    /// Weights of the two parts, and the minimum asked for.
    pub weights: ScoreWeights,
}

/// What the parts of the score weigh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ScoreWeights {
    /// Of ln(criterion).
    pub covariance: f64,
    /// Of −mean ln(separability).
    pub separability: f64,
    /// Of the average of ln(criterion) over the test.
    #[serde(default)]
    pub convergence: f64,
    /// Smallest acceptable separability, 0 to 1; 0 asks for nothing.
    pub minimum_separability: f64,
}

/// Accuracy of one misalignment angle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct MisalignmentRecord {
    /// `psi_nx`, `psi_ny` or `psi_nz`: about North, Up, East.
    pub name: String,
    /// 1σ at the end of the test, arcsec.
    pub sigma_arcsec: f64,
}

/// What the test tells about one drift coefficient. g-sensitive coefficients: per g.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct CoefficientRecord {
    /// The coefficient.
    pub name: DriftCoefficient,
    /// 1σ before the test, °/h.
    pub prior_sigma_deg_per_h: f64,
    /// 1σ after the test, °/h.
    pub sigma_deg_per_h: f64,
    /// Highest derivative of the measurement that a solution needs; null: not observable.
    pub observability_order: Option<u8>,
    /// Separability by the order-1 channels alone, 0 to 1.
    pub separability_first_order: f64,
    /// Separability by all channels, 0 to 1.
    pub separability: f64,
    /// Specification, 1σ, °/h; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spec_deg_per_h: Option<f64>,
    /// When σ was within the specification for good, s; absent: never, or no specification.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_to_spec_s: Option<f64>,
}

/// What a schedule makes observable.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ObservabilityRecord {
    /// Rank of the rows of all channels.
    pub rank: usize,
    /// Number of unknowns: the coefficients and, except at the poles, ω_N ψ_y(0).
    pub unknowns: usize,
    /// Condition number of the weighted rows; null: infinite, the rank is short.
    pub condition_number: Option<f64>,
    /// The combinations that stay unobservable, by name.
    pub unobservable: Vec<String>,
    /// The same over all estimated parameters, with what would tell them; absent: it cannot be worked out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameters: Option<NamedObservabilityRecord>,
}

/// σ against time, and what each position contributed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ConvergenceRecord {
    /// Times since the start of the test, s.
    pub times_s: Vec<f64>,
    /// 1σ at those times, °/h, by coefficient.
    pub sigma_deg_per_h: BTreeMap<DriftCoefficient, Vec<f64>>,
    /// What each position did for the accuracy.
    pub positions: Vec<PositionConvergenceRecord>,
}

/// What one position, its move and settle included, did for the accuracy.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct PositionConvergenceRecord {
    /// Number of the position in the schedule, from 1; positions that take no time are left out.
    pub position: usize,
    /// When the move to it started, s.
    pub start_s: f64,
    /// When it was left, s.
    pub end_s: f64,
    /// RMS σ when it was left, °/h.
    pub rms_sigma_deg_per_h: f64,
    /// Convergence rate, decades of RMS σ per hour; null: nothing was left to converge.
    pub decades_per_h: Option<f64>,
    /// The coefficient whose σ shrank most, by ratio.
    pub most_improved: DriftCoefficient,
}

impl EvaluationDocument {
    /// The document of `evaluation`, made of `schedule` by `objective`.
    pub fn new(
        evaluation: &Evaluation,
        schedule: &Schedule,
        objective: &Objective,
        inputs: &Inputs,
    ) -> Self {
        let misalignment = evaluation.end.misalignment_sigma_arcsec();
        Self {
            schema: EVALUATION_SCHEMA.to_owned(),
            tool_version: TOOL_VERSION.to_owned(),
            test: inputs.config.test.clone(),
            total_time_s: evaluation.total_time_s,
            overhead_s: evaluation.overhead_s,
            rms_sigma_deg_per_h: evaluation.rms_sigma_deg_per_h(),
            max_sigma_deg_per_h: evaluation.max_sigma_deg_per_h(),
            max_eig_sigma_deg_per_h: evaluation.max_eig_sigma_deg_per_h(),
            logdet_deg_per_h: evaluation.logdet_deg_per_h().and_then(finite),
            score: ScoreRecord::new(
                &evaluation.score,
                objective,
                &evaluation.prior_sigma_deg_per_h,
            ),
            misalignment: MISALIGNMENT_NAMES
                .iter()
                .zip(misalignment.iter())
                .map(|(name, sigma)| MisalignmentRecord {
                    name: (*name).to_owned(),
                    sigma_arcsec: *sigma,
                })
                .collect(),
            coefficients: coefficients(evaluation, objective.spec_deg_per_h.as_ref()),
            parameters: parameters::of(evaluation, objective),
            budget: parameters::budget(evaluation),
            limits: Vec::new(),
            done: inputs.done.clone(),
            observability: ObservabilityRecord::new(evaluation),
            convergence: ConvergenceRecord::from(&evaluation.convergence),
            agreement: evaluation.agreement,
            precision: evaluation.precision.into(),
            first_disagreement: evaluation
                .first_disagreement
                .as_ref()
                .map(DisagreementRecord::from),
            positions: positions(evaluation, schedule),
            winding_deg: evaluation.winding_deg,
            schedule: ScheduleDocument::from(schedule),
            inputs: inputs.config.clone(),
            defaulted: inputs.defaulted.clone(),
            warnings: warnings(inputs, Some(schedule)),
        }
    }
}

impl EvaluationDocument {
    /// Whether every parameter with a specification is within it at the end of the test; none: nothing has
    /// one.
    pub fn meets_specification(&self) -> Option<bool> {
        let coefficients = self.coefficients.iter();
        let coefficients = coefficients.filter(|c| c.spec_deg_per_h.is_some());
        let others = self.parameters.iter().skip(self.coefficients.len());
        let others = others.filter_map(|p| p.spec.map(|spec| p.sigma <= spec));
        coefficients
            .map(|c| c.time_to_spec_s.is_some())
            .chain(others)
            .reduce(|all, this| all && this)
    }
}

impl ScoreRecord {
    fn new(score: &Score, objective: &Objective, prior_sigma: &CoefficientVector) -> Self {
        Self {
            value: finite(score.value),
            criterion: score.criterion,
            criterion_name: objective.criterion.name().to_owned(),
            criterion_unit: criterion_unit(&objective.criterion).to_owned(),
            covariance_part: finite(score.covariance_part),
            separability_part: finite(score.separability_part),
            convergence_part: match objective.convergence_weight > 0.0 {
                true => finite(score.convergence_part),
                false => None,
            },
            least_separability: score.least_separability,
            meets_minimum_separability: score.meets_minimum_separability,
            known_before: objective
                .criterion
                .known_before(prior_sigma)
                // A drift that is known and walks is not known at the end.
                .filter(|_| score.criterion <= 0.0)
                .map(|known| known.to_string()),
            weights: ScoreWeights {
                covariance: objective.covariance_weight,
                separability: objective.separability_weight,
                convergence: objective.convergence_weight,
                minimum_separability: objective.minimum_separability,
            },
        }
    }
}

/// The positions of the schedule, held.
fn positions(evaluation: &Evaluation, schedule: &Schedule) -> Vec<HeldPositionRecord> {
    let held = evaluation.positions.iter().zip(schedule.positions());
    let record = |(held, p): (&HeldPosition, &ScheduledPosition)| {
        let [alpha_deg, beta_deg, gamma_deg] = p.position.to_deg().map(|deg| deg + 0.0);
        HeldPositionRecord {
            alpha_deg,
            beta_deg,
            gamma_deg,
            dwell_s: p.dwell_s,
            starts_s: held.starts_s,
            specific_force_g: held.specific_force_g.map(|f| f + 0.0),
        }
    };
    held.map(record).collect()
}

/// The unit of a criterion's value.
pub(super) fn criterion_unit(criterion: &Criterion) -> &'static str {
    match criterion {
        Criterion::A { .. } if criterion.counts_others() => "mixed",
        Criterion::A { .. } | Criterion::D | Criterion::E => "deg/h",
        Criterion::MaxRatio { .. } => "1",
        Criterion::Use { .. } => "arcsec",
    }
}

fn coefficients(
    evaluation: &Evaluation,
    spec: Option<&CoefficientVector>,
) -> Vec<CoefficientRecord> {
    let sigma = evaluation.end.sigma_deg_per_h();
    let observability = &evaluation.observability;
    DriftCoefficient::ALL
        .into_iter()
        .map(|name| {
            let i = name.index();
            CoefficientRecord {
                name,
                prior_sigma_deg_per_h: evaluation.prior_sigma_deg_per_h[i],
                sigma_deg_per_h: sigma[i],
                observability_order: observability.orders[i].map(|o| o.number()),
                separability_first_order: observability.separability_first_order[i],
                separability: observability.separability[i],
                spec_deg_per_h: spec.and_then(|s| finite(s[i])),
                time_to_spec_s: evaluation.convergence.time_to_spec_s[i],
            }
        })
        .collect()
}

impl ObservabilityRecord {
    fn new(evaluation: &Evaluation) -> Self {
        let o = &evaluation.observability;
        Self {
            parameters: NamedObservabilityRecord::of(evaluation),
            rank: o.rank,
            unknowns: o.unknowns,
            condition_number: finite(o.condition_number),
            unobservable: o.unobservable.iter().map(ToString::to_string).collect(),
        }
    }
}

impl From<&ConvergenceHistory> for ConvergenceRecord {
    fn from(history: &ConvergenceHistory) -> Self {
        let curve = |c: DriftCoefficient| {
            let samples = history.sigma_deg_per_h.iter();
            samples.map(|sigma| sigma[c.index()]).collect()
        };
        Self {
            times_s: history.times_s.clone(),
            sigma_deg_per_h: DriftCoefficient::ALL
                .into_iter()
                .map(|c| (c, curve(c)))
                .collect(),
            positions: history.positions.iter().map(Into::into).collect(),
        }
    }
}

impl From<&PositionConvergence> for PositionConvergenceRecord {
    fn from(p: &PositionConvergence) -> Self {
        Self {
            position: p.position + 1,
            start_s: p.start_s,
            end_s: p.end_s,
            rms_sigma_deg_per_h: p.rms_sigma_deg_per_h,
            decades_per_h: finite(p.decades_per_h),
            most_improved: DriftCoefficient::ALL[p.most_improved],
        }
    }
}
