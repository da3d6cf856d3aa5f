//! What is done of a search, so that an interrupted one can go on where it stopped.
//!
//! A search is a tree of pieces of work (a start screened, a finalist worked out, a batch of
//! proposals tried), each a function of the problem and of results before it alone. A finished
//! piece is handed to a [`Journal`] under a name that says where in the tree it is; before a piece
//! is begun, the journal is asked for it. A search with a journal filled by an earlier run of the
//! same problem therefore takes the same way, skips what is done, and ends with the same result and
//! the same counters. Pieces that were cut short are not handed over.
//!
//! The library keeps no files: where a journal comes from and where it goes is its owner's
//! business.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use super::Counters;
use super::pipeline::{Candidate, Context, Work};
use super::refine::Refined;
use super::variables::Plan;

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
    /// The figure of merit, lower is better.
    pub merit: f64,
    /// Value of the criterion (°/h; max-ratio: 1), where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub criterion: Option<f64>,
}

/// Remembers the finished pieces of a search. Used from several threads.
///
/// ```
/// use std::sync::atomic::AtomicBool;
/// use scheme_opt::evaluate::{Evaluator, Objective};
/// use scheme_opt::platform::PlatformConfig;
/// use scheme_opt::search::checkpoint::Journal;
/// use scheme_opt::search::{Control, SearchProblem, search};
///
/// let evaluator = Evaluator::new(PlatformConfig::default().check()?, Objective::default());
/// let problem = SearchProblem { max_positions: 2, starts: 1, ..SearchProblem::default() };
/// let (cancel, journal) = (AtomicBool::new(false), Journal::default());
/// let control = Control::new(&cancel, &|_| {}).with_journal(&journal);
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

    fn recall(&self, name: &str) -> Option<Finished> {
        self.lock().get(name).cloned()
    }

    fn record(&self, name: String, finished: Finished) {
        self.lock().insert(name, finished);
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, BTreeMap<String, Finished>> {
        // A panic elsewhere leaves whole entries.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a journal can hold.
pub(super) trait Memorable: Sized {
    fn to_finished(&self) -> FinishedPlan;
    fn from_finished(finished: FinishedPlan) -> Option<Self>;
}

impl Memorable for Refined {
    fn to_finished(&self) -> FinishedPlan {
        FinishedPlan {
            angles_rad: self.plan.angles.clone(),
            dwell_s: self.plan.dwell_s.clone(),
            changes_rad: said(&self.plan),
            merit: self.merit,
            criterion: None,
        }
    }

    fn from_finished(finished: FinishedPlan) -> Option<Self> {
        Some(Self {
            merit: finished.merit,
            plan: plan(finished)?,
        })
    }
}

impl Memorable for Candidate {
    fn to_finished(&self) -> FinishedPlan {
        FinishedPlan {
            angles_rad: self.plan.angles.clone(),
            dwell_s: self.plan.dwell_s.clone(),
            changes_rad: said(&self.plan),
            merit: self.merit,
            criterion: Some(self.criterion),
        }
    }

    fn from_finished(finished: FinishedPlan) -> Option<Self> {
        Some(Self {
            merit: finished.merit,
            criterion: finished.criterion?,
            plan: plan(finished)?,
        })
    }
}

impl FinishedPlan {
    fn is_finite(&self) -> bool {
        let angles = self.angles_rad.iter().flatten();
        let changes = self.changes_rad.iter().flatten().flatten();
        let numbers = angles.chain(&self.dwell_s).chain(changes);
        let numbers = numbers.chain(&self.criterion);
        self.merit.is_finite() && numbers.copied().all(f64::is_finite)
    }
}

/// The ways of a plan as far as there is something to say.
fn said(plan: &Plan) -> Vec<Option<[f64; 3]>> {
    match plan.ways.iter().any(Option::is_some) {
        true => plan.ways.clone(),
        false => Vec::new(),
    }
}

/// None for what no search wrote: a journal may come from a file.
fn plan(mut finished: FinishedPlan) -> Option<Plan> {
    if finished.changes_rad.is_empty() {
        finished.changes_rad = vec![None; finished.angles_rad.len()];
    }
    let sound = finished.is_finite()
        && !finished.angles_rad.is_empty()
        && finished.angles_rad.len() == finished.dwell_s.len()
        && finished.angles_rad.len() == finished.changes_rad.len()
        && finished.dwell_s.iter().all(|d| *d >= 0.0);
    sound.then_some(Plan {
        angles: finished.angles_rad,
        dwell_s: finished.dwell_s,
        ways: finished.changes_rad,
    })
}

impl Context<'_> {
    /// Does a piece of work, unless the journal has it done; `name` says where in the search it
    /// is.
    pub(super) fn remembered<T: Memorable>(
        self,
        name: impl FnOnce() -> String,
        work: impl FnOnce(Context<'_>) -> Option<T>,
    ) -> Option<T> {
        if self.control.journal().is_none() {
            return work(self);
        }
        let name = name();
        if let Some(known) = self.recalled(&name) {
            return known;
        }
        let own = Work::default();
        let result = work(Context { work: &own, ..self });
        self.put_down(name, result.as_ref(), &own);
        result
    }

    /// What came of a piece of work, where the journal has it done; its counters are added.
    pub(super) fn recalled<T: Memorable>(self, name: &str) -> Option<Option<T>> {
        let Finished { plan, counters } = self.control.journal()?.recall(name)?;
        let result = match plan {
            None => None,
            // What no search writes is done anew.
            Some(plan) => Some(T::from_finished(plan)?),
        };
        self.work.add(counters);
        Some(result)
    }

    /// Hands a piece of work that was done apart, with counters of its `own`, to the journal, and
    /// adds the counters.
    pub(super) fn put_down<T: Memorable>(self, name: String, result: Option<&T>, own: &Work) {
        let plan = result.map(T::to_finished);
        if own.was_cut_short() {
            self.work.cut_short();
        } else if let Some(journal) = self.control.journal()
            && !self.control.should_stop()
            && plan.as_ref().is_none_or(FinishedPlan::is_finite)
        {
            // Once a search is to stop, what is left of it goes another way.
            let counters = own.counters();
            journal.record(name, Finished { plan, counters });
        }
        self.work.add(own.counters());
    }

    /// Whether the journal has a piece of work done.
    pub(super) fn is_remembered(&self, name: impl FnOnce() -> String) -> bool {
        let journal = self.control.journal();
        journal.is_some_and(|journal| journal.lock().contains_key(&name()))
    }
}
