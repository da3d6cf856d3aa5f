//! The document of a batch: one line for each of many platforms.

use serde::{Deserialize, Serialize};

use super::common::TOOL_VERSION;
use super::result::ResultDocument;
use crate::error::{Error, Result};
use crate::search::Status;

/// Name and major version of the [`BatchDocument`].
pub const BATCH_SCHEMA: &str = "scheme-opt/batch/1";

/// What was found for many platforms, each in a line. The resolved inputs of each are in the `result.json`
/// of its directory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct BatchDocument {
    /// [`BATCH_SCHEMA`].
    pub schema: String,
    /// Version of the program that wrote it.
    pub tool_version: String,
    /// The platforms in the order given.
    pub platforms: Vec<BatchRecord>,
}

/// How it went with a platform of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum BatchStatus {
    /// All starts were worked through.
    Converged,
    /// The time limit ended the search; the schedule is the best found so far.
    TimeLimit,
    /// The search was interrupted; the schedule is the best found so far.
    Interrupted,
    /// No schedule meets what was asked; the schedule, if there is one, is the nearest found.
    Infeasible,
    /// Its file cannot be used, or the search refused to answer: see `error`.
    Failed,
    /// The batch was interrupted before its turn came.
    NotStarted,
}

impl BatchStatus {
    /// The name used in documents.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::TimeLimit => "time-limit",
            Self::Interrupted => "interrupted",
            Self::Infeasible => "infeasible",
            Self::Failed => "failed",
            Self::NotStarted => "not-started",
        }
    }

    /// Whether another run of the batch has nothing left to do for it.
    pub const fn is_finished(self) -> bool {
        matches!(self, Self::Converged | Self::Infeasible)
    }
}

impl From<Status> for BatchStatus {
    fn from(status: Status) -> Self {
        match status {
            Status::Converged => Self::Converged,
            Status::TimeLimit => Self::TimeLimit,
            Status::Interrupted => Self::Interrupted,
            Status::Infeasible => Self::Infeasible,
        }
    }
}

/// One platform of a batch. What is null was not found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct BatchRecord {
    /// The platform file as it was named.
    pub file: String,
    /// What people call it: `test.title`, or else the name of its file.
    pub title: String,
    /// How it went.
    pub status: BatchStatus,
    /// What the schedule reaches, in `criterion_unit`; in mode `time` its duration.
    pub criterion: Option<f64>,
    /// `a`, `d`, `e`, `max-ratio`, `use`; in mode `time`, `total-time`.
    pub criterion_name: Option<String>,
    /// `deg/h`, `1`, `arcsec`, `mixed`, `s`.
    pub criterion_unit: Option<String>,
    /// No schedule is below this, in `criterion_unit`; null: nothing can be said.
    pub lower_bound: Option<f64>,
    /// 100 (criterion/lower_bound − 1); null: there is no useful bound.
    pub gap_percent: Option<f64>,
    /// √(mean of the coefficient variances), °/h.
    pub rms_sigma_deg_per_h: Option<f64>,
    /// Duration of the test, moves and settles included, s.
    pub total_time_s: Option<f64>,
    /// Number of positions.
    pub positions: Option<usize>,
    /// Whether the specification is met; null: there is none.
    pub met: Option<bool>,
    /// Whether the schedule is what was asked: what `search` ends with exit code 0 for, not 1.
    pub acceptable: Option<bool>,
    /// Where its files are, in the directory of the batch.
    pub directory: String,
    /// Why it ended as it did, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Why there is no schedule.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

impl BatchRecord {
    /// A platform whose turn did not come.
    pub(crate) fn not_started(file: &str, title: &str, directory: &str) -> Self {
        Self {
            file: file.to_owned(),
            title: title.to_owned(),
            status: BatchStatus::NotStarted,
            criterion: None,
            criterion_name: None,
            criterion_unit: None,
            lower_bound: None,
            gap_percent: None,
            rms_sigma_deg_per_h: None,
            total_time_s: None,
            positions: None,
            met: None,
            acceptable: None,
            directory: directory.to_owned(),
            reason: None,
            error: None,
        }
    }

    /// The same platform, without a schedule because of `error`.
    pub(crate) fn failed(self, error: &Error) -> Self {
        let infeasible = error.is_infeasible();
        Self {
            status: match infeasible {
                true => BatchStatus::Infeasible,
                false => BatchStatus::Failed,
            },
            acceptable: infeasible.then_some(false),
            error: Some(error.to_string()),
            ..self
        }
    }

    /// The same platform with what was found for it.
    pub(crate) fn found(self, document: &ResultDocument, acceptable: bool) -> Self {
        let (evaluation, score) = (&document.evaluation, &document.evaluation.score);
        let certificate = document.certificate.as_ref();
        Self {
            status: document.status.into(),
            criterion: Some(certificate.map_or(score.criterion, |c| c.achieved)),
            criterion_name: Some(
                certificate.map_or_else(|| score.criterion_name.clone(), |c| c.criterion.clone()),
            ),
            criterion_unit: Some(
                certificate.map_or_else(|| score.criterion_unit.clone(), |c| c.unit.clone()),
            ),
            lower_bound: certificate.and_then(|c| c.lower_bound),
            gap_percent: certificate.and_then(|c| c.gap_percent),
            rms_sigma_deg_per_h: Some(evaluation.rms_sigma_deg_per_h),
            total_time_s: Some(evaluation.total_time_s),
            positions: Some(document.schedule.positions.len()),
            met: evaluation.meets_specification(),
            acceptable: Some(acceptable),
            reason: Some(document.reason.clone()),
            ..self
        }
    }

    /// The same for a file and a directory of other names.
    #[cfg(feature = "cli")]
    pub(crate) fn named_as(self, other: &Self) -> Self {
        Self {
            file: other.file.clone(),
            title: other.title.clone(),
            directory: other.directory.clone(),
            ..self
        }
    }
}

impl BatchDocument {
    /// The document of these platforms.
    pub(crate) fn new(platforms: Vec<BatchRecord>) -> Self {
        Self {
            schema: BATCH_SCHEMA.to_owned(),
            tool_version: TOOL_VERSION.to_owned(),
            platforms,
        }
    }

    /// The same table as CSV with a header line.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when it cannot be written.
    pub fn to_csv(&self) -> Result<String> {
        let failed = |e: Box<dyn std::error::Error + Send + Sync>| {
            Error::numerical(format!("the table cannot be written as CSV: {e}")).with_source(e)
        };
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(COLUMNS).map_err(|e| failed(e.into()))?;
        for p in &self.platforms {
            let number = |value: Option<f64>| value.map_or_else(String::new, |v| v.to_string());
            let truth = |value: Option<bool>| value.map_or_else(String::new, |v| v.to_string());
            let text = |value: &Option<String>| value.clone().unwrap_or_default();
            let row: [String; COLUMNS.len()] = [
                p.file.clone(),
                p.title.clone(),
                p.status.name().to_owned(),
                number(p.criterion),
                text(&p.criterion_name),
                text(&p.criterion_unit),
                number(p.lower_bound),
                number(p.gap_percent),
                number(p.rms_sigma_deg_per_h),
                number(p.total_time_s),
                p.positions.map_or_else(String::new, |n| n.to_string()),
                truth(p.met),
                truth(p.acceptable),
                p.directory.clone(),
                text(&p.reason),
                text(&p.error),
            ];
            writer.write_record(row).map_err(|e| failed(e.into()))?;
        }
        let bytes = writer
            .into_inner()
            .map_err(|e| failed(e.to_string().into()))?;
        String::from_utf8(bytes).map_err(|e| failed(e.into()))
    }
}

/// Columns of the CSV form.
const COLUMNS: [&str; 16] = [
    "file",
    "title",
    "status",
    "criterion",
    "criterion_name",
    "criterion_unit",
    "lower_bound",
    "gap_percent",
    "rms_sigma_deg_per_h",
    "total_time_s",
    "positions",
    "met",
    "acceptable",
    "directory",
    "reason",
    "error",
];
