//! How a search is watched and stopped.

use std::fmt;
use std::sync::Arc;
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
#[non_exhaustive]
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

/// What is told of every report.
type Watcher = dyn Fn(&Progress) + Send + Sync;

/// Watches and stops a search from outside. Owns what it holds, so that it can be kept, cloned and
/// handed to other threads and languages.
///
/// ```
/// use std::sync::Arc;
/// use std::sync::atomic::AtomicBool;
/// use scheme_opt::Control;
/// // Nobody watches, nobody stops it.
/// let quiet = Control::default();
/// assert!(!quiet.should_stop());
/// // Another thread stores `true` into `cancel` to stop it.
/// let cancel = Arc::new(AtomicBool::new(false));
/// let watched = Control::default()
///     .with_cancel(Arc::clone(&cancel))
///     .with_progress(|p| assert!(p.done <= p.total));
/// assert!(!watched.should_stop());
/// ```
#[derive(Clone, Default)]
pub struct Control {
    cancel: Arc<AtomicBool>,
    progress: Option<Arc<Watcher>>,
    deadline: Option<Instant>,
    journal: Option<Arc<Journal>>,
    threads: Option<usize>,
}

impl fmt::Debug for Control {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Control")
            .field("cancelled", &self.is_cancelled())
            .field("watched", &self.progress.is_some())
            .field("deadline", &self.deadline)
            .field("journal", &self.journal.is_some())
            .field("threads", &self.threads)
            .finish()
    }
}

impl Control {
    /// Stops soon after `cancel` becomes true, and then gives the best schedule so far.
    #[must_use]
    pub fn with_cancel(mut self, cancel: Arc<AtomicBool>) -> Self {
        self.cancel = cancel;
        self
    }

    /// Reports to `progress`, from several threads and in no fixed order.
    #[must_use]
    pub fn with_progress(mut self, progress: impl Fn(&Progress) + Send + Sync + 'static) -> Self {
        self.progress = Some(Arc::new(progress));
        self
    }

    /// Stops soon after `deadline`, if there is one.
    #[must_use]
    pub fn with_deadline(mut self, deadline: Option<Instant>) -> Self {
        self.deadline = deadline;
        self
    }

    /// Skips what `journal` has finished, and adds what gets finished.
    #[must_use]
    pub fn with_journal(mut self, journal: Arc<Journal>) -> Self {
        self.journal = Some(journal);
        self
    }

    /// Computes on so many threads unless `search.threads` says another number; the result does not depend
    /// on it.
    #[must_use]
    pub fn with_threads(mut self, threads: usize) -> Self {
        self.threads = Some(threads);
        self
    }

    /// The threads to compute on, if anything was said.
    pub(crate) fn threads(&self) -> Option<usize> {
        self.threads
    }

    pub(crate) fn journal(&self) -> Option<&Journal> {
        self.journal.as_deref()
    }

    /// The moment after which it stops, if any.
    pub(crate) fn deadline(&self) -> Option<Instant> {
        self.deadline
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
        if let Some(progress) = &self.progress {
            progress(&Progress {
                phase,
                done,
                total,
                criterion,
            });
        }
    }
}
