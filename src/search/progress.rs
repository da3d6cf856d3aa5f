//! How a search is watched and stopped.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::journal::Journal;

/// What a search is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Phase {
    /// Refining the starts.
    Screening,
    /// Working the best starts out to the end.
    Finishing,
    /// Trying other orders, positions and kicks on the best of them.
    Improving,
    /// Confirming the winner with the step-by-step filter.
    Checking,
}

impl Phase {
    /// The name used in checkpoints.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Screening => "screening",
            Self::Finishing => "finishing",
            Self::Improving => "improving",
            Self::Checking => "checking",
        }
    }
}

/// One report of progress. Reports come from several threads, in no fixed order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// What is being done.
    pub phase: Phase,
    /// Pieces of work of this phase done.
    pub done: u64,
    /// Pieces of work of this phase in all.
    pub total: u64,
    /// Value of the criterion of the piece just done (°/h; max-ratio: 1), if it led anywhere.
    pub criterion: Option<f64>,
}

/// Watches and stops a search from outside.
///
/// ```
/// use std::sync::atomic::AtomicBool;
/// use scheme_opt::internals::search::Control;
/// let cancel = AtomicBool::new(false);
/// let control = Control::new(&cancel, &|p| assert!(p.done <= p.total));
/// ```
pub struct Control {
    cancel: &'a AtomicBool,
    progress: &'a (dyn Fn(&Progress) + Sync),
    deadline: Option<Instant>,
    journal: Option<&'a Journal>,
}

impl<'a> Control {
    /// Reports to `progress`; stops soon after `cancel` becomes true.
    pub fn new(cancel: &'a AtomicBool, progress: &'a (dyn Fn(&Progress) + Sync)) -> Self {
        Self {
            cancel,
            progress,
            deadline: None,
            journal: None,
        }
    }

    /// Stops soon after `deadline`.
    #[must_use]
    pub fn with_deadline(mut self, deadline: Option<Instant>) -> Self {
        self.deadline = deadline;
        self
    }

    /// Skips what `journal` has finished, and adds what gets finished.
    #[must_use]
    pub fn with_journal(mut self, journal: &'a Journal) -> Self {
        self.journal = Some(journal);
        self
    }

    pub(crate) fn journal(&self) -> Option<&'a Journal> {
        self.journal
    }

    /// Whether the search was cancelled.
    pub fn is_cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }

    /// Whether the deadline has passed.
    pub fn is_out_of_time(&self) -> bool {
        self.deadline.is_some_and(|d| Instant::now() >= d)
    }

    /// Whether to stop.
    pub fn should_stop(&self) -> bool {
        self.is_cancelled() || self.is_out_of_time()
    }

    pub(crate) fn report(&self, phase: Phase, done: u64, total: u64, criterion: Option<f64>) {
        (self.progress)(&Progress {
            phase,
            done,
            total,
            criterion,
        });
    }
}
