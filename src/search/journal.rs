//! The finished pieces of a search, by name ([`super::checkpoint`]).

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};

use super::problem::Counters;

/// A finished piece of work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finished {
    /// What came of it; none: nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<FinishedPlan>,
    /// Work it took.
    pub counters: Counters,
}

/// The plan that came of a piece of work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FinishedPlan {
    /// (α, β, γ) of each position, rad.
    pub angles_rad: Vec<[f64; 3]>,
    /// Dwell at each position, s.
    pub dwell_s: Vec<f64>,
    /// Changes of (α, β, γ) on the way to each position, rad, where it is not the short one; empty
    /// where none is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes_rad: Vec<Option<[f64; 3]>>,
    /// The positions of the scheme that the search began with which keep their angles; empty where
    /// none does.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub held: Vec<Option<HeldPlace>>,
    /// The figure of merit, lower is better.
    pub merit: f64,
    /// Value of the criterion (°/h; max-ratio: 1), where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub criterion: Option<f64>,
}

/// A position of the scheme that a search began with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HeldPlace {
    /// Its number in the scheme, from 0.
    pub index: usize,
    /// Its angles (α, β, γ), degrees.
    pub angles_deg: [f64; 3],
    /// Whether it keeps its place too.
    pub pinned: bool,
}

impl FinishedPlan {
    pub(super) fn is_finite(&self) -> bool {
        let angles = self.angles_rad.iter().flatten();
        let changes = self.changes_rad.iter().flatten().flatten();
        let numbers = angles.chain(&self.dwell_s).chain(changes);
        let numbers = numbers.chain(&self.criterion);
        self.merit.is_finite() && numbers.copied().all(f64::is_finite)
    }
}

/// Remembers the finished pieces of a search. Used from several threads.
///
/// ```
/// use std::sync::Arc;
/// use scheme_opt::internals::evaluate::{Evaluator, Objective};
/// use scheme_opt::internals::platform::PlatformConfig;
/// use scheme_opt::internals::search::checkpoint::Journal;
/// use scheme_opt::internals::search::{Control, SearchProblem, search};
///
/// let evaluator = Evaluator::new(PlatformConfig::default().check()?, Objective::default());
/// let problem = SearchProblem { max_positions: 2, starts: 1, ..SearchProblem::default() };
/// let control = Control::default().with_journal(Arc::new(Journal::default()));
/// let first = search(&evaluator, &problem, &control)?;
/// // All of it is remembered now.
/// assert_eq!(search(&evaluator, &problem, &control)?, first);
/// # Ok::<(), scheme_opt::Error>(())
/// ```
#[derive(Debug, Default)]
pub struct Journal(Mutex<BTreeMap<String, Finished>>);

impl Journal {
    /// A journal of what was finished before, by name.
    pub fn new(finished: BTreeMap<String, Finished>) -> Self {
        Self(Mutex::new(finished))
    }

    /// What is finished, by name.
    pub fn finished(&self) -> BTreeMap<String, Finished> {
        self.lock().clone()
    }

    /// How many pieces are finished.
    pub fn len(&self) -> usize {
        self.lock().len()
    }

    /// Whether nothing is finished.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub(super) fn recall(&self, name: &str) -> Option<Finished> {
        self.lock().get(name).cloned()
    }

    pub(super) fn record(&self, name: String, finished: Finished) {
        self.lock().insert(name, finished);
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Finished>> {
        // A thread that panicked holding the lock left whole entries: each is inserted at once.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
