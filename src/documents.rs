//! The JSON documents as values. Each names its schema and the version that wrote it and carries the
//! resolved inputs, so that a result can be reproduced from itself; fields may be added, none is
//! renamed or dropped.

pub use crate::analysis::additions::{Aim, Helped, Turn, TurnAxis};
pub use crate::analysis::suggest::NoSuggestion;
pub use crate::certificate::Majorant;
pub use crate::commands::{CommandDocument, CommandRecord};
pub use crate::compare::{PositionOrder, Proof};
pub use crate::observability::named::{PlatformAxis, Remedy};
pub use crate::observability::solution::{NoSolution, RowsUsed};
pub use crate::observability::{Channel, Order};
pub use crate::results::*;
pub use crate::schedule::file::{PositionRecord, ScheduleDocument};
pub use crate::simulate::consistency::{Consistency, Verdict};
pub use crate::simulate::divergence::{DivergedRun, Divergence, Sign};
pub use crate::simulate::specification::{
    Decision, SpecificationCheck, SpecifiedCoefficient, SpecifiedParameter,
};
