//! The JSON documents: what an evaluation and a search found, as data.
//!
//! Every document names its schema and the program's version, and carries the resolved inputs
//! with a list of those that nobody gave, so that a result can be reproduced from itself. Keys
//! carry their unit; the g-sensitive coefficients are per g. A number that is not finite (the
//! condition number of a schedule that leaves something unobservable) is `null`.
//!
//! Fields may be added within a major version; none is renamed or dropped.

mod analysis;
mod bound;
mod comparison;
mod counters;
mod layout;
mod parameters;
#[cfg(feature = "schema")]
pub mod schema;
mod schemes;
mod simulation;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::baseline::Baseline;
use crate::certificate::Certifier;
use crate::config::StudyConfig;
use crate::covariance::Precision;
use crate::covariance::history::{ConvergenceHistory, PositionConvergence};
use crate::criterion::Criterion;
use crate::drift::{CoefficientVector, DriftCoefficient};
use crate::error::{Error, Result};
use crate::evaluate::{Disagreement, Evaluation, MISALIGNMENT_NAMES, Objective, Score};
use crate::observability::{Observability, Unobservable};
use crate::schedule::Schedule;
use crate::schedule::file::ScheduleDocument;
use crate::search::{FrontPoint, SearchOutcome};
use crate::suspicion;
pub use analysis::{
    ANALYSIS_SCHEMA, AnalysedCoefficient, AnalysedObservability, AnalysedPosition,
    AnalysisDocument, CorrelationRecord, Correlations, NearlyRecord, PiecewiseConstantRecord,
    ReconstructionRecord, SeenRecord, StandingRecord, StateRecord, SuggestionRecord, TermRecord,
    WeakRecord,
};

pub use crate::suspicion::WarningRecord;
pub use bound::{BOUND_SCHEMA, BoundDocument, CertificateRecord, DeltaRecord};
pub use comparison::{
    COMPARISON_SCHEMA, ComparedCoefficient, ComparedRecord, ComparisonDocument, SkippedContender,
};
pub use counters::{CounterRecord, RefinementRecord};
pub use parameters::{BudgetRecord, ParameterRecord, RoleRecord, WorstRecord};
pub use schemes::{SCHEMES_SCHEMA, SchemeListDocument, SchemeRecord};
pub use simulation::{
    SIMULATION_SCHEMA, SimulatedCoefficient, SimulatedMisalignment, SimulatedPosition,
    SimulationDocument, SweepRecord,
};

/// Name and major version of the [`EvaluationDocument`].
pub const EVALUATION_SCHEMA: &str = "scheme-opt/evaluation/1";
/// Name and major version of the [`ResultDocument`].
pub const RESULT_SCHEMA: &str = "scheme-opt/result/1";
/// Version of the program, as documents carry it.
pub const TOOL_VERSION: &str = env!("CARGO_PKG_VERSION");

/// The inputs of a run: the study as resolved, and which of its keys nobody gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Inputs {
    /// Every value, defaults and command-line overrides included.
    pub config: StudyConfig,
    /// Keys whose value is the default, in dotted form.
    pub defaulted: Vec<String>,
}

/// What is hard to believe of the inputs and of a schedule.
fn warnings(inputs: &Inputs, schedule: Option<&Schedule>) -> Vec<WarningRecord> {
    let found = suspicion::of(&inputs.config, &inputs.defaulted, schedule);
    found.iter().map(Into::into).collect()
}

/// All that is known of a schedule before the test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct EvaluationDocument {
    /// [`EVALUATION_SCHEMA`].
    pub schema: String,
    /// Version of the program that wrote it.
    pub tool_version: String,
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

/// The score: value = covariance_part + separability_part, lower is better.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ScoreRecord {
    /// The figure of merit; null when it is infinite.
    pub value: Option<f64>,
    /// Value of the criterion, in `criterion_unit`.
    pub criterion: f64,
    /// `a`, `d`, `e` or `max-ratio`.
    pub criterion_name: String,
    /// `deg/h`, or `1` for `max-ratio`.
    pub criterion_unit: String,
    /// Weight times ln(criterion); null when the criterion is zero.
    pub covariance_part: Option<f64>,
    /// −weight times mean ln(separability); null when a coefficient cannot be separated at all.
    pub separability_part: Option<f64>,
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

/// What a search found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ResultDocument {
    /// [`RESULT_SCHEMA`].
    pub schema: String,
    /// Version of the program that wrote it.
    pub tool_version: String,
    /// How the search ended: `converged`, `time-limit`, `interrupted`, `infeasible`.
    pub status: String,
    /// The same in words.
    pub reason: String,
    /// The recommended schedule.
    pub schedule: ScheduleDocument,
    /// Its evaluation.
    pub evaluation: EvaluationDocument,
    /// The coefficients that count and yet stay unobservable, on this stand or by this schedule.
    #[serde(default)]
    pub unobservable: Unobservable,
    /// The standard schemes at equal total time.
    pub baselines: Vec<BaselineRecord>,
    /// The standard schemes that cannot be run on this platform in this time.
    pub baselines_skipped: Vec<SkippedBaseline>,
    /// In mode `pareto`, the front of total time against criterion, shortest test first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pareto: Vec<ParetoRecord>,
    /// How far the schedule is from the best possible; absent when that was not computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certificate: Option<CertificateRecord>,
    /// Work done.
    pub counters: CounterRecord,
    /// Seed of the random streams.
    pub seed: u64,
    /// Duration of the search, s; the only field that may differ between two runs of the same
    /// input, and left out where results must be reproducible.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wall_time_s: Option<f64>,
    /// The study as resolved.
    pub inputs: StudyConfig,
    /// Keys of `inputs` that nobody gave.
    pub defaulted: Vec<String>,
    /// Values of the inputs that are allowed but hard to believe; left out when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<WarningRecord>,
}

/// One point of the front of total time against criterion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ParetoRecord {
    /// Duration of the test, moves and settles included, s.
    pub total_time_s: f64,
    /// Value of the criterion, in the score's `criterion_unit`.
    pub criterion: f64,
    /// √(mean of the coefficient variances), °/h.
    pub rms_sigma_deg_per_h: f64,
    /// No schedule of this duration or less has a smaller criterion; absent: not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lower_bound: Option<f64>,
    /// The schedule.
    pub schedule: ScheduleDocument,
}

impl From<&FrontPoint> for ParetoRecord {
    fn from(point: &FrontPoint) -> Self {
        Self {
            total_time_s: point.total_time_s,
            criterion: point.evaluation.score.criterion,
            rms_sigma_deg_per_h: point.evaluation.rms_sigma_deg_per_h(),
            lower_bound: None,
            schedule: ScheduleDocument::from(&point.schedule),
        }
    }
}

/// A standard scheme beside the schedule found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct BaselineRecord {
    /// Name of the scheme.
    pub name: String,
    /// How many positions it has.
    pub positions: usize,
    /// Its RMS σ, °/h.
    pub rms_sigma_deg_per_h: f64,
    /// Its RMS σ divided by that of the schedule found: how many times worse it is. Null when
    /// the latter is zero.
    pub ratio: Option<f64>,
    /// Its value of the criterion, in the score's `criterion_unit`.
    pub criterion: f64,
    /// The same divided by that of the schedule found.
    pub criterion_ratio: Option<f64>,
}

/// A standard scheme that could not be compared.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SkippedBaseline {
    /// Name of the scheme.
    pub name: String,
    /// Why it cannot be run.
    pub reason: String,
}

/// JSON knows finite numbers only.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
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
            parameters: parameters::of(evaluation, objective.spec_deg_per_h.as_ref()),
            budget: parameters::budget(evaluation),
            observability: ObservabilityRecord::from(&evaluation.observability),
            convergence: ConvergenceRecord::from(&evaluation.convergence),
            agreement: evaluation.agreement,
            precision: evaluation.precision.into(),
            first_disagreement: evaluation
                .first_disagreement
                .as_ref()
                .map(DisagreementRecord::from),
            schedule: ScheduleDocument::from(schedule),
            inputs: inputs.config.clone(),
            defaulted: inputs.defaulted.clone(),
            warnings: warnings(inputs, Some(schedule)),
        }
    }

    /// The document as JSON text.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when it cannot be written as JSON.
    pub fn to_json(&self) -> Result<String> {
        to_json(self)
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
            least_separability: score.least_separability,
            meets_minimum_separability: score.meets_minimum_separability,
            known_before: objective
                .criterion
                .known_before(prior_sigma)
                .map(|known| known.to_string()),
            weights: ScoreWeights {
                covariance: objective.covariance_weight,
                separability: objective.separability_weight,
                minimum_separability: objective.minimum_separability,
            },
        }
    }
}

/// The unit of a criterion's value.
const fn criterion_unit(criterion: &Criterion) -> &'static str {
    match criterion {
        Criterion::A { .. } | Criterion::D | Criterion::E => "deg/h",
        Criterion::MaxRatio { .. } => "1",
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

impl From<&Observability> for ObservabilityRecord {
    fn from(o: &Observability) -> Self {
        Self {
            rank: o.rank,
            unknowns: o.unknowns,
            condition_number: finite(o.condition_number),
            unobservable: o.unobservable.clone(),
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

impl ResultDocument {
    /// The document of a search's `outcome` beside the `baselines`; `wall_time_s` is left out
    /// where results must be reproducible.
    pub fn new(
        outcome: &SearchOutcome,
        baselines: &[Baseline],
        objective: &Objective,
        seed: u64,
        wall_time_s: Option<f64>,
        inputs: &Inputs,
    ) -> Self {
        let evaluation =
            EvaluationDocument::new(&outcome.evaluation, &outcome.schedule, objective, inputs);
        Self {
            schema: RESULT_SCHEMA.to_owned(),
            tool_version: TOOL_VERSION.to_owned(),
            status: outcome.status.name().to_owned(),
            reason: outcome.reason.clone(),
            schedule: ScheduleDocument::from(&outcome.schedule),
            unobservable: outcome.unobservable.clone(),
            baselines: compared(baselines, &evaluation),
            baselines_skipped: skipped(baselines),
            evaluation,
            pareto: outcome.front.iter().map(ParetoRecord::from).collect(),
            certificate: None,
            counters: CounterRecord::from(&outcome.counters),
            seed,
            wall_time_s: wall_time_s.and_then(finite),
            inputs: inputs.config.clone(),
            defaulted: inputs.defaulted.clone(),
            warnings: warnings(inputs, Some(&outcome.schedule)),
        }
    }

    /// The document as JSON text.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when it cannot be written as JSON.
    pub fn to_json(&self) -> Result<String> {
        to_json(self)
    }

    /// The same without what may differ between two runs of the same input: the duration of the
    /// search, and the number of threads, which has no part in the result.
    #[must_use]
    pub fn reproducible(mut self) -> Self {
        self.wall_time_s = None;
        self.inputs.search.threads = None;
        self.evaluation.inputs.search.threads = None;
        self
    }

    /// Attaches the certificate, and the lower bounds along the front.
    #[must_use]
    pub fn with_certificate(
        mut self,
        certificate: CertificateRecord,
        certifier: &Certifier,
        objective: &Objective,
    ) -> Self {
        let times: Vec<f64> = self.pareto.iter().map(|p| p.total_time_s).collect();
        let bounds = bound::front_bounds(certifier, objective, &times);
        for (point, lower_bound) in self.pareto.iter_mut().zip(bounds) {
            point.lower_bound = lower_bound;
        }
        self.certificate = Some(certificate);
        self
    }

    /// The baseline that is best by the criterion of the search, if any could be run.
    pub fn best_baseline(&self) -> Option<&BaselineRecord> {
        self.baselines
            .iter()
            .min_by(|a, b| a.criterion.total_cmp(&b.criterion))
    }
}

/// The baselines that could be run, beside `found`.
pub(crate) fn compared(baselines: &[Baseline], found: &EvaluationDocument) -> Vec<BaselineRecord> {
    let record = |b: &Baseline| {
        let accuracy = b.accuracy.as_ref().ok()?;
        Some(BaselineRecord {
            name: b.scheme.name().to_owned(),
            positions: b.positions,
            rms_sigma_deg_per_h: accuracy.rms_sigma_deg_per_h,
            ratio: finite(accuracy.rms_sigma_deg_per_h / found.rms_sigma_deg_per_h),
            criterion: accuracy.criterion,
            criterion_ratio: finite(accuracy.criterion / found.score.criterion),
        })
    };
    baselines.iter().filter_map(record).collect()
}

/// The baselines that could not be run, and why.
pub(crate) fn skipped(baselines: &[Baseline]) -> Vec<SkippedBaseline> {
    let record = |b: &Baseline| {
        b.accuracy.as_ref().err().map(|error| SkippedBaseline {
            name: b.scheme.name().to_owned(),
            reason: error.to_string(),
        })
    };
    baselines.iter().filter_map(record).collect()
}

fn to_json(document: &impl Serialize) -> Result<String> {
    let failed = |e: Box<dyn std::error::Error + Send + Sync>| {
        Error::numerical(format!("the document cannot be written as JSON: {e}")).with_source(e)
    };
    let mut bytes = Vec::new();
    let mut serializer =
        serde_json::Serializer::with_formatter(&mut bytes, layout::Layout::default());
    document
        .serialize(&mut serializer)
        .map_err(|e| failed(e.into()))?;
    bytes.push(b'\n');
    String::from_utf8(bytes).map_err(|e| failed(e.into()))
}
