//! What every step of a search is given: what is asked, who may stop it, what it has done.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::lbfgs::Ended;
use super::problem::{Counters, SearchProblem};
use super::progress::Control;
use super::termination::RefinementCounters;
use crate::criterion::Smoothing;
use crate::evaluate::Evaluator;

/// What every step of a search needs to know.
#[derive(Clone, Copy)]
pub(crate) struct Context<'a> {
    pub evaluator: &'a Evaluator,
    pub problem: &'a SearchProblem,
    pub control: &'a Control,
    pub work: &'a WorkDone,
}

impl Context<'_> {
    /// The same for another problem.
    pub fn on<'b>(&'b self, problem: &'b SearchProblem) -> Context<'b> {
        Context { problem, ..*self }
    }

    /// Whether to stop, remembering that work was left undone.
    pub fn must_stop(&self) -> bool {
        let stop = self.control.should_stop();
        if stop {
            self.work.cut_short();
        }
        stop
    }

    /// What smoothing a search begins with: a mild power mean where the criterion has kinks.
    pub fn first_smoothing(&self) -> Smoothing {
        match self.evaluator.objective().criterion.has_kinks() {
            true => Smoothing::PowerMean(6.0),
            false => Smoothing::Exact,
        }
    }
}

/// Work counters shared between threads, and whether any work was left undone.
#[derive(Debug, Default)]
pub(crate) struct WorkDone {
    evaluations: AtomicU64,
    gradients: AtomicU64,
    starts: AtomicU64,
    refinements: Mutex<RefinementCounters>,
    /// Stages of the search begun: a stage is one problem's starts worked through, or one plan
    /// worked out on the way. They follow one another, whatever the number of threads.
    stages: AtomicU64,
    cut_short: AtomicBool,
}

impl WorkDone {
    pub fn count_evaluations(&self, n: u64) {
        self.evaluations.fetch_add(n, Ordering::Relaxed);
    }

    pub fn count_start(&self) {
        self.starts.fetch_add(1, Ordering::Relaxed);
    }

    /// A refinement with the gradients it took.
    pub fn count_refinement(&self, ended: Ended) {
        self.gradients.fetch_add(ended.gradients, Ordering::Relaxed);
        self.refinements().count(ended.termination, ended.restarts);
    }

    fn refinements(&self) -> MutexGuard<'_, RefinementCounters> {
        // A thread that panicked holding the lock left counters that are right as far as it got.
        self.refinements
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    pub fn counters(&self) -> Counters {
        Counters {
            evaluations: self.evaluations.load(Ordering::Relaxed),
            gradients: self.gradients.load(Ordering::Relaxed),
            starts: self.starts.load(Ordering::Relaxed),
            refinements: *self.refinements(),
        }
    }

    /// Adds work that was done elsewhere.
    pub fn add(&self, counters: Counters) {
        self.count_evaluations(counters.evaluations);
        self.gradients
            .fetch_add(counters.gradients, Ordering::Relaxed);
        self.starts.fetch_add(counters.starts, Ordering::Relaxed);
        self.refinements().add(counters.refinements);
    }

    /// The number of the stage that begins now.
    pub fn next_stage(&self) -> u64 {
        self.stages.fetch_add(1, Ordering::Relaxed)
    }

    /// Remembers that work was left undone.
    pub fn cut_short(&self) {
        self.cut_short.store(true, Ordering::Relaxed);
    }

    pub fn was_cut_short(&self) -> bool {
        self.cut_short.load(Ordering::Relaxed)
    }
}
