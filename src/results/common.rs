//! What every document is made with.

use super::given::DoneRecord;
use crate::config::StudyConfig;
use crate::schedule::Schedule;
use crate::suspicion::{self, WarningRecord};

/// Version of the program, as documents carry it.
pub const TOOL_VERSION: &str = env!("CARGO_PKG_VERSION");

/// The inputs of a run: the study as resolved, and which of its keys nobody gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Inputs {
    /// Every value, defaults and command-line overrides included.
    pub config: StudyConfig,
    /// Keys whose value is the default, in dotted form.
    pub defaulted: Vec<String>,
    /// What of the test is done already.
    pub done: Option<DoneRecord>,
}

/// What is hard to believe of the inputs and of a schedule.
pub(super) fn warnings(inputs: &Inputs, schedule: Option<&Schedule>) -> Vec<WarningRecord> {
    let found = suspicion::of(&inputs.config, &inputs.defaulted, schedule);
    found.iter().map(Into::into).collect()
}

/// JSON knows finite numbers only.
pub(super) fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}
