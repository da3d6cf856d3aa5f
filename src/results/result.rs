//! The document of a search: what it found, beside the standard schemes.

use serde::{Deserialize, Serialize};

use super::bound::{CertificateRecord, front_bounds};
use super::common::{Inputs, TOOL_VERSION, finite, warnings};
use super::counters::CounterRecord;
use super::evaluation::EvaluationDocument;
use super::given::{DoneRecord, FromRecord};
use crate::analysis::Unobservable;
#[cfg(feature = "cli")]
use crate::analysis::not_observed;
use crate::baseline::Baseline;
use crate::certificate::Certifier;
use crate::config::{StudyConfig, TestConfig};
use crate::drift::DriftCoefficient;
use crate::evaluate::Objective;
use crate::schedule::file::ScheduleDocument;
use crate::search::{FrontPoint, SearchOutcome, Status};
use crate::suspicion::WarningRecord;

/// Name and major version of the [`ResultDocument`].
pub const RESULT_SCHEMA: &str = "scheme-opt/result/1";

/// What a search found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ResultDocument {
    /// [`RESULT_SCHEMA`].
    pub schema: String,
    /// Version of the program that wrote it.
    pub tool_version: String,
    /// Whose test it is; left out where nobody said.
    #[serde(default, skip_serializing_if = "TestConfig::is_empty")]
    pub test: TestConfig,
    /// How the search ended.
    pub status: Status,
    /// The same in words.
    pub reason: String,
    /// The recommended schedule.
    pub schedule: ScheduleDocument,
    /// Its evaluation.
    pub evaluation: EvaluationDocument,
    /// The coefficients that count and yet stay unobservable, on this stand or by this schedule.
    #[serde(default)]
    pub unobservable: UnobservableRecord,
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
    /// The scheme that the search began with; left out when it began with none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<FromRecord>,
    /// What of the test was done already; left out at the beginning of a test.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub done: Option<DoneRecord>,
    /// Values of the inputs that are allowed but hard to believe; left out when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<WarningRecord>,
}

/// The coefficients that count and stay unobservable.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(rename = "Unobservable"))]
#[non_exhaustive]
pub struct UnobservableRecord {
    /// Those that no schedule on this stand can observe.
    pub on_this_stand: Vec<DriftCoefficient>,
    /// Those that this schedule does not observe; another one, of more positions, could.
    pub by_this_schedule: Vec<DriftCoefficient>,
    /// Those of either sort that `objective.accept_unobservable` names; in neither list above.
    pub accepted: Vec<DriftCoefficient>,
    /// The combinations that no schedule on this stand can observe, by name; empty where every
    /// coefficient that counts can be.
    pub combinations: Vec<String>,
}

impl UnobservableRecord {
    /// Whether every coefficient that counts is observed, or may stay unobservable.
    pub fn is_acceptable(&self) -> bool {
        self.on_this_stand.is_empty() && self.by_this_schedule.is_empty()
    }

    #[cfg(feature = "cli")]
    /// Whether `reason` says nothing but this.
    pub(crate) fn is_all_of(&self, reason: &str) -> bool {
        not_observed(
            &self.on_this_stand,
            &self.by_this_schedule,
            &self.combinations,
        ) == reason
    }
}

impl From<&Unobservable> for UnobservableRecord {
    fn from(found: &Unobservable) -> Self {
        Self {
            on_this_stand: found.on_this_stand.clone(),
            by_this_schedule: found.by_this_schedule.clone(),
            accepted: found.accepted.clone(),
            combinations: found.combinations.iter().map(ToString::to_string).collect(),
        }
    }
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
    /// The same positions in the best order that was found for them; left out where none was looked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub best_order: Option<BestOrderRecord>,
}

/// A standard scheme in the best order that was found for it, by a local search: a better one may exist.
/// Dwells are equal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(rename = "BestOrder"))]
#[non_exhaustive]
pub struct BestOrderRecord {
    /// Its RMS σ, °/h.
    pub rms_sigma_deg_per_h: f64,
    /// Its RMS σ divided by that of the schedule found.
    pub ratio: Option<f64>,
    /// Its value of the criterion, in the score's `criterion_unit`.
    pub criterion: f64,
    /// The same divided by that of the schedule found.
    pub criterion_ratio: Option<f64>,
}

impl BaselineRecord {
    /// The criterion in the best order that is known.
    pub(crate) fn yardstick(&self) -> f64 {
        let best = self.best_order.as_ref();
        best.map_or(self.criterion, |best| best.criterion)
    }

    /// The same divided by that of the schedule found.
    pub(crate) fn yardstick_ratio(&self) -> Option<f64> {
        let best = self.best_order.as_ref();
        best.map_or(self.criterion_ratio, |best| best.criterion_ratio)
    }
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
            test: inputs.config.test.clone(),
            status: outcome.status,
            reason: outcome.reason.to_string(),
            schedule: ScheduleDocument::from(&outcome.schedule),
            unobservable: (&outcome.unobservable).into(),
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
            from: None,
            done: inputs.done.clone(),
            warnings: warnings(inputs, Some(&outcome.schedule)),
        }
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
        let bounds = front_bounds(certifier, objective, &times);
        for (point, lower_bound) in self.pareto.iter_mut().zip(bounds) {
            point.lower_bound = lower_bound;
        }
        self.certificate = Some(certificate);
        self
    }

    /// The baseline that is best by the criterion of the search, each in the best order that was found
    /// for it, if any could be run.
    pub fn best_baseline(&self) -> Option<&BaselineRecord> {
        self.baselines
            .iter()
            .min_by(|a, b| a.yardstick().total_cmp(&b.yardstick()))
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
            best_order: b.in_best_order.map(|best| BestOrderRecord {
                rms_sigma_deg_per_h: best.rms_sigma_deg_per_h,
                ratio: finite(best.rms_sigma_deg_per_h / found.rms_sigma_deg_per_h),
                criterion: best.criterion,
                criterion_ratio: finite(best.criterion / found.score.criterion),
            }),
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
