//! What is asked of a search, and what it answers.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::given::{Given, StartingScheme};
use super::reason::Reason;
use super::termination::RefinementCounters;
use crate::analysis::Unobservable;
use crate::evaluate::Evaluation;
use crate::schedule::Schedule;

/// What to search for.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchProblem {
    /// Duration of the test, moves and settles included, s.
    pub total_time_s: f64,
    /// Most positions of the schedule; a turn, with its start and its end, counts as one.
    pub max_positions: usize,
    /// How many starts.
    pub starts: usize,
    /// Seed of the random streams.
    pub seed: u64,
    /// A position is dropped when the score gets worse by less than this without it.
    pub position_tolerance: f64,
    /// Whether the platform may turn slowly while it measures: each position then is a measured
    /// continuous move.
    pub allow_tumbling: bool,
    /// The scheme that it begins with, if there is one.
    pub from: Option<StartingScheme>,
}

impl Default for SearchProblem {
    fn default() -> Self {
        Self {
            total_time_s: 12_000.0,
            max_positions: 24,
            starts: 64,
            seed: 1,
            position_tolerance: 2e-4,
            allow_tumbling: false,
            from: None,
        }
    }
}

/// How a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// All starts were worked through.
    Converged,
    /// The time limit ended it; the schedule is the best found so far.
    TimeLimit,
    /// It was cancelled; the schedule is the best found so far.
    Interrupted,
    /// No schedule meets what was asked; the schedule is the nearest found.
    Infeasible,
}

impl Status {
    /// The name used in documents.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::TimeLimit => "time-limit",
            Self::Interrupted => "interrupted",
            Self::Infeasible => "infeasible",
        }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// How much work a search did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Counters {
    /// Values of schedules computed without gradient.
    pub evaluations: u64,
    /// Values computed with gradient.
    pub gradients: u64,
    /// Starts worked through.
    pub starts: u64,
    /// How the refinements ended.
    #[serde(default)]
    pub refinements: RefinementCounters,
}

/// One point of the front.
#[derive(Debug, Clone, PartialEq)]
pub struct FrontPoint {
    /// Duration of the test, moves and settles included, s.
    pub total_time_s: f64,
    /// The best schedule found for it.
    pub schedule: Schedule,
    /// Its evaluation, both computations agreeing.
    pub evaluation: Evaluation,
}

/// The result of a search.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchOutcome {
    /// How it ended.
    pub status: Status,
    /// Why.
    pub reason: Reason,
    /// Whether the schedule is less than what was asked, by its specification where that is the
    /// criterion, by what it observes or by its separability; however the search ended.
    pub lacking: bool,
    /// The recommended schedule.
    pub schedule: Schedule,
    /// Its evaluation, both computations agreeing.
    pub evaluation: Evaluation,
    /// What counts and yet stays unobservable, on this stand or by this schedule.
    pub unobservable: Unobservable,
    /// In mode `pareto` the front of total time against criterion, shortest test first; its
    /// last point is the schedule above. Empty otherwise.
    pub front: Vec<FrontPoint>,
    /// What came of the scheme that it began with.
    pub from: Option<Given>,
    /// Work done.
    pub counters: Counters,
}
