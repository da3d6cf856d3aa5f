//! JSON Schemas (2020-12) of the documents, made from the types that write them.
//!
//! ```
//! use scheme_opt::internals::results::schema::DocumentKind;
//! let schema = DocumentKind::Schedule.schema()?;
//! assert!(schema.contains("\"dwell_s\""));
//! # Ok::<(), scheme_opt::Error>(())
//! ```

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Serialize;

use super::analysis::AnalysisDocument;
use super::batch::BatchDocument;
use super::bound::BoundDocument;
use super::common::TOOL_VERSION;
use super::comparison::ComparisonDocument;
use super::evaluation::EvaluationDocument;
use super::json::to_json;
use super::result::ResultDocument;
use super::schemes::SchemeListDocument;
use super::simulation::SimulationDocument;
use crate::commands::CommandDocument;
use crate::config::StudyConfig;
use crate::error::{Error, Result};
use crate::schedule::file::ScheduleDocument;
use crate::schedule::text::{shown, with_nearest};

/// A document that this program reads or writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DocumentKind {
    /// The platform file, as JSON: the same keys as in TOML.
    Platform,
    /// A schedule.
    Schedule,
    /// What `search` finds.
    Result,
    /// What `evaluate` finds.
    Evaluation,
    /// What `analyze` finds.
    Analysis,
    /// What `simulate` finds.
    Simulation,
    /// What `compare` finds.
    Comparison,
    /// What `bound` finds.
    Bound,
    /// What `batch` finds for many platforms.
    Batch,
    /// The command table.
    Commands,
    /// The list of the built-in schemes.
    Standard,
    /// The list of these documents.
    Documents,
}

impl DocumentKind {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::Platform,
        Self::Schedule,
        Self::Result,
        Self::Evaluation,
        Self::Analysis,
        Self::Simulation,
        Self::Comparison,
        Self::Bound,
        Self::Batch,
        Self::Commands,
        Self::Standard,
        Self::Documents,
    ];

    /// The name used on the command line and for the file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Platform => "platform",
            Self::Schedule => "schedule",
            Self::Result => "result",
            Self::Evaluation => "evaluation",
            Self::Analysis => "analysis",
            Self::Simulation => "simulation",
            Self::Comparison => "comparison",
            Self::Bound => "bound",
            Self::Batch => "batch",
            Self::Commands => "commands",
            Self::Standard => "standard",
            Self::Documents => "documents",
        }
    }

    /// Where the document comes from.
    pub const fn description(self) -> &'static str {
        match self {
            Self::Platform => "platform file: its TOML has the keys of this schema",
            Self::Schedule => "schedule.json of search; --schedule of other commands",
            Self::Result => "result.json of search; search --json",
            Self::Evaluation => "evaluate --json; `evaluation` in result.json",
            Self::Analysis => "analyze --json",
            Self::Simulation => "simulation.json of simulate; simulate --json",
            Self::Comparison => "compare --json",
            Self::Bound => "bound --json",
            Self::Batch => "batch.json of batch; batch --json",
            Self::Commands => "commands --json",
            Self::Standard => "standard --json",
            Self::Documents => "schema --json",
        }
    }

    /// The document of that name.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] listing the names, with the nearest one as a hint.
    pub fn from_name(name: &str) -> Result<Self> {
        let names = Self::ALL.map(Self::name);
        let known = Self::ALL.into_iter().find(|d| d.name() == name);
        known.ok_or_else(|| {
            let error = Error::input("no such document")
                .with_value(shown(name))
                .with_allowed(names.join(", "));
            with_nearest(error, name, names.to_vec())
        })
    }

    /// Its JSON Schema, as text.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when it cannot be written as JSON.
    pub fn schema(self) -> Result<String> {
        let mut schema = match self {
            Self::Platform => of::<StudyConfig>(),
            Self::Schedule => of::<ScheduleDocument>(),
            Self::Result => of::<ResultDocument>(),
            Self::Evaluation => of::<EvaluationDocument>(),
            Self::Analysis => of::<AnalysisDocument>(),
            Self::Simulation => of::<SimulationDocument>(),
            Self::Comparison => of::<ComparisonDocument>(),
            Self::Bound => of::<BoundDocument>(),
            Self::Batch => of::<BatchDocument>(),
            Self::Commands => of::<CommandDocument>(),
            Self::Standard => of::<SchemeListDocument>(),
            Self::Documents => of::<DocumentListDocument>(),
        };
        schema.insert(
            "title".to_owned(),
            format!("scheme-opt {}", self.name()).into(),
        );
        to_json(&schema)
    }

    /// The list of all documents, as JSON text.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when it cannot be written as JSON.
    pub fn list_as_json() -> Result<String> {
        let record = |d: Self| DocumentListRecord {
            name: d.name().to_owned(),
            description: d.description().to_owned(),
        };
        to_json(&DocumentListDocument {
            schema: "scheme-opt/documents/1".to_owned(),
            tool_version: TOOL_VERSION.to_owned(),
            documents: Self::ALL.into_iter().map(record).collect(),
        })
    }
}

/// The documents that have a schema.
#[derive(Serialize, JsonSchema)]
struct DocumentListDocument {
    /// `scheme-opt/documents/1`.
    schema: String,
    /// Version of the program that wrote it.
    tool_version: String,
    /// The documents.
    documents: Vec<DocumentListRecord>,
}

/// A document.
#[derive(Serialize, JsonSchema)]
struct DocumentListRecord {
    /// Its name: what `schema` takes.
    name: String,
    /// Where it comes from.
    description: String,
}

fn of<T: JsonSchema>() -> Schema {
    SchemaGenerator::default().into_root_schema_for::<T>()
}
