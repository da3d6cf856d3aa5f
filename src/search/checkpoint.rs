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

use super::context::{Context, WorkDone};
pub use super::journal::{Finished, FinishedPlan, HeldPlace, Journal};
use super::plan::{Pin, Plan};
use super::rated::{Candidate, Refined};
use crate::attitude::Position;

/// What a journal can hold.
pub(super) trait Memorable: Sized {
    fn to_finished(&self) -> FinishedPlan;
    fn from_finished(finished: FinishedPlan) -> Option<Self>;
}

impl Memorable for Refined {
    fn to_finished(&self) -> FinishedPlan {
        finished(&self.plan, self.merit, None)
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
        finished(&self.plan, self.merit, Some(self.criterion))
    }

    fn from_finished(finished: FinishedPlan) -> Option<Self> {
        Some(Self {
            merit: finished.merit,
            criterion: finished.criterion?,
            plan: plan(finished)?,
        })
    }
}

fn finished(plan: &Plan, merit: f64, criterion: Option<f64>) -> FinishedPlan {
    FinishedPlan {
        angles_rad: plan.angles.clone(),
        dwell_s: plan.dwell_s.clone(),
        // Left out where every move takes the short way.
        changes_rad: match plan.ways.iter().any(Option::is_some) {
            true => plan.ways.clone(),
            false => Vec::new(),
        },
        held: match plan.holds_any() {
            true => plan.pins.iter().map(|pin| Some(held(&(*pin)?))).collect(),
            false => Vec::new(),
        },
        merit,
        criterion,
    }
}

fn held(pin: &Pin) -> HeldPlace {
    HeldPlace {
        index: pin.index,
        angles_deg: pin.position.degrees(),
        pinned: pin.pinned,
    }
}

fn pin(held: &HeldPlace) -> Pin {
    let [alpha, beta, gamma] = held.angles_deg;
    Pin {
        index: held.index,
        position: Position::from_deg(alpha, beta, gamma),
        pinned: held.pinned,
    }
}

/// None for what no search wrote: a journal may come from a file.
fn plan(mut finished: FinishedPlan) -> Option<Plan> {
    if finished.changes_rad.is_empty() {
        finished.changes_rad = vec![None; finished.angles_rad.len()];
    }
    if finished.held.is_empty() {
        finished.held = vec![None; finished.angles_rad.len()];
    }
    let sound = finished.is_finite()
        && !finished.angles_rad.is_empty()
        && finished.angles_rad.len() == finished.dwell_s.len()
        && finished.angles_rad.len() == finished.changes_rad.len()
        && finished.angles_rad.len() == finished.held.len()
        && finished.dwell_s.iter().all(|d| *d >= 0.0);
    sound.then_some(Plan {
        angles: finished.angles_rad,
        dwell_s: finished.dwell_s,
        ways: finished.changes_rad,
        pins: (finished.held.iter())
            .map(|held| held.as_ref().map(pin))
            .collect(),
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
        let own = WorkDone::default();
        let result = work(Context { work: &own, ..self });
        self.put_down(name, result.as_ref(), &own);
        result
    }

    /// What came of a piece of work, where the journal has it done; its counters are added.
    pub(super) fn recalled<T: Memorable>(self, name: &str) -> Option<Option<T>> {
        let Finished { plan, counters } = self.control.journal()?.recall(name)?;
        let result = match plan {
            None => None,
            // An entry that no search could have written: the work is done anew.
            Some(plan) => Some(T::from_finished(plan)?),
        };
        self.work.add(counters);
        Some(result)
    }

    /// Hands a piece of work that was done apart, with counters of its `own`, to the journal, and
    /// adds the counters.
    pub(super) fn put_down<T: Memorable>(self, name: String, result: Option<&T>, own: &WorkDone) {
        let plan = result.map(T::to_finished);
        if own.was_cut_short() {
            self.work.cut_short();
        } else if let Some(journal) = self.control.journal()
            && !self.control.should_stop()
            && plan.as_ref().is_none_or(FinishedPlan::is_finite)
        {
            // A search that is to stop cuts its steps short, so what it does then is not what a
            // continued search would do and must not be remembered.
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
