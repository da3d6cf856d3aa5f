//! The JSON documents: what an evaluation and a search found, as data.
//!
//! Every document names its schema and the program's version, and carries the resolved inputs
//! with a list of those that nobody gave, so that a result can be reproduced from itself. Keys
//! carry their unit; the g-sensitive coefficients are per g. A number that is not finite (the
//! condition number of a schedule that leaves something unobservable) is `null`.
//!
//! Fields may be added within a major version; none is renamed or dropped.

mod analysis;
mod batch;
mod bound;
mod common;
mod comparison;
mod counters;
mod evaluation;
mod given;
mod json;
mod layout;
mod limits;
mod named;
mod parameters;
mod result;
#[cfg(feature = "schema")]
pub mod schema;
mod schemes;
mod simulation;

pub use crate::suspicion::WarningRecord;
pub use analysis::{
    ANALYSIS_SCHEMA, AnalysedCoefficient, AnalysedObservability, AnalysedPosition,
    AnalysisDocument, CorrelationRecord, Correlations, NearlyRecord, PiecewiseConstantRecord,
    ReconstructionRecord, SeenRecord, Standing, StateRecord, SuggestionRecord, TermRecord,
    WeakRecord,
};
pub use batch::{BATCH_SCHEMA, BatchDocument, BatchRecord, BatchStatus};
pub use bound::{BOUND_SCHEMA, BoundDocument, CertificateRecord, DeltaRecord};
pub use common::{Inputs, TOOL_VERSION};
pub use comparison::{
    COMPARISON_SCHEMA, ComparedCoefficient, ComparedRecord, ComparisonDocument, SkippedContender,
};
pub use counters::{CounterRecord, RefinementCounters};
pub use evaluation::{
    CoefficientRecord, ConvergenceRecord, DisagreementRecord, EVALUATION_SCHEMA,
    EvaluationDocument, MisalignmentRecord, ObservabilityRecord, PositionConvergenceRecord,
    PrecisionRecord, ScoreRecord, ScoreWeights,
};
pub use given::{DoneRecord, FromRecord};
pub(crate) use limits::Change;
pub use limits::LimitRecord;
pub use named::{
    AdditionRecord, AdditionsRecord, CombinationRecord, CombinationTermRecord,
    NamedObservabilityRecord, PriorFloorRecord, RemarkRecord, UnobservedRecord, WeakNamedRecord,
    WorstDriftRecord,
};
pub use parameters::{BudgetRecord, ParameterRecord, RoleRecord, WorstRecord};
pub use result::{
    BaselineRecord, BestOrderRecord, ParetoRecord, RESULT_SCHEMA, ResultDocument, SkippedBaseline,
    UnobservableRecord,
};
#[cfg(feature = "report")]
pub(crate) use result::{compared, skipped};
pub use schemes::{SCHEMES_SCHEMA, SchemeListDocument, SchemeRecord};
pub use simulation::{
    ComparedWith, JudgementRecord, SIMULATION_SCHEMA, SimulatedCoefficient, SimulatedMisalignment,
    SimulatedParameter, SimulatedPosition, SimulationDocument, SweepRecord,
};
