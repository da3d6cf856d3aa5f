//! The JSON documents as values. Each names its schema and the version that wrote it and carries the
//! resolved inputs, so that a result can be reproduced from itself; fields may be added, none is
//! renamed or dropped.

pub use crate::commands::{CommandDocument, CommandRecord};
pub use crate::results::*;
pub use crate::schedule::file::{PositionRecord, ScheduleDocument};
