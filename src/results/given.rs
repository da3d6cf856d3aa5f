//! What a search was given beside its platform: a scheme to begin with, and what is done already.

use serde::{Deserialize, Serialize};

use super::common::finite;
use crate::config::Mode;
use crate::motion::{Test, Timeline};
use crate::schedule::file::ScheduleDocument;
use crate::search::{SearchOutcome, StartingScheme};

/// The scheme that a search began with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(rename = "From"))]
#[non_exhaustive]
pub struct FromRecord {
    /// What it is called: its file.
    pub name: String,
    /// What alone might change, `dwells`, `order` or both; left out: everything but what is pinned.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub only: Vec<String>,
    /// Numbers of its pinned positions, from 1; left out when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub pinned: Vec<usize>,
    /// Its value of the criterion as it was given, in the score's `criterion_unit`; null: the platform
    /// cannot run it.
    pub criterion: Option<f64>,
    /// The same divided by that of the schedule found, in mode `pareto` by that of the best test no
    /// longer than it: how many times better the result is.
    pub ratio: Option<f64>,
    /// In mode `time`, where both meet the specification, how many times as long it takes as the schedule
    /// found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_ratio: Option<f64>,
    /// Its score, which is what the result is never worse by (in mode `time`: its duration, where it meets
    /// the specification); null where it cannot be told.
    pub score: Option<f64>,
    /// How long it takes, s.
    pub total_time_s: Option<f64>,
    /// In what it goes beyond what the search keeps to: then the result may be worse than it. Left out
    /// where in nothing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub beyond: Vec<String>,
    /// Whether nothing better was found, and the result is the scheme as it was given.
    pub is_the_result: bool,
    /// The scheme.
    pub schedule: ScheduleDocument,
}

impl FromRecord {
    /// Of a scheme and what came of it; none where the search did not begin with one.
    pub(crate) fn new(from: &StartingScheme, mode: Mode, outcome: &SearchOutcome) -> Option<Self> {
        let given = outcome.from.as_ref()?;
        let evaluation = given.evaluation.as_ref();
        let beside = |total_time_s: f64| {
            let in_time = |e: &&crate::evaluate::Evaluation| e.total_time_s <= total_time_s;
            let front = outcome.front.iter().map(|p| &p.evaluation);
            let best = front.filter(in_time).map(|e| e.score.criterion);
            let best = best.min_by(f64::total_cmp);
            best.unwrap_or(outcome.evaluation.score.criterion)
        };
        let ratio = evaluation.map(|e| e.score.criterion / beside(e.total_time_s));
        Some(Self {
            name: from.name.clone(),
            only: (from.freedom.names().iter())
                .map(|name| (*name).to_owned())
                .collect(),
            pinned: from.pinned().map(|k| k + 1).collect(),
            criterion: evaluation.and_then(|e| finite(e.score.criterion)),
            ratio: ratio.and_then(finite),
            time_ratio: evaluation
                .filter(|e| mode == Mode::Time && e.score.criterion <= 1.0)
                .filter(|_| outcome.evaluation.score.criterion <= 1.0)
                .and_then(|e| finite(e.total_time_s / outcome.evaluation.total_time_s)),
            score: evaluation.and_then(|e| finite(e.score.value)),
            total_time_s: evaluation.map(|e| e.total_time_s),
            beyond: given.beyond.clone(),
            is_the_result: given.is_the_result,
            schedule: ScheduleDocument::from(&from.schedule),
        })
    }
}

/// What of a test is done already: the rest of it is what the document is about. Times count from the
/// beginning of the test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(rename = "Done"))]
#[non_exhaustive]
pub struct DoneRecord {
    /// How long it took, s.
    pub total_time_s: f64,
    /// What was run, as it was run.
    pub schedule: ScheduleDocument,
}

impl DoneRecord {
    /// Of a test; none at its beginning.
    pub(crate) fn of(test: &Test) -> Option<Self> {
        let schedule = ScheduleDocument::from(test.done()?);
        let timeline = Timeline::unchecked(test, std::iter::empty());
        let legs = &timeline.legs()[..timeline.positions().start];
        Some(Self {
            total_time_s: legs.iter().map(|leg| leg.duration_s()).sum(),
            schedule,
        })
    }
}
