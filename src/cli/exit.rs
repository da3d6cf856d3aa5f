//! How a run ends.

use std::process::ExitCode;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Exit {
    /// Done.
    Done,
    /// No acceptable schedule: the specification or the limits cannot be met.
    NoSchedule,
    /// Done, and `simulate --check` found something to doubt.
    Doubtful,
    /// Usage or input error, or a computation that refused to answer.
    Failed,
    /// Interrupted; the best schedule so far is written.
    Interrupted,
}

impl Exit {
    /// The exit code of the process.
    pub const fn code(self) -> u8 {
        match self {
            Self::Done => 0,
            Self::NoSchedule | Self::Doubtful => 1,
            Self::Failed => 2,
            Self::Interrupted => 130,
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit.code())
    }
}
