//! The search of a study, in all of its modes.

use std::time::{Duration, Instant};

use super::Study;
use crate::baseline::baselines;
use crate::certificate::Certifier;
use crate::config::Mode;
use crate::error::Result;
use crate::results::{CertificateRecord, FromRecord, ResultDocument};
use crate::schedule::Schedule;
use crate::search::front::front;
use crate::search::shortest::shortest;
use crate::search::{Control, SearchOutcome, SearchProblem, Status, search};

/// What a search found.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchResult {
    document: ResultDocument,
    schedule: Schedule,
    status: Status,
    acceptable: bool,
}

impl SearchResult {
    /// The result as data, in the form of `result.json`.
    pub fn document(&self) -> &ResultDocument {
        &self.document
    }

    /// The recommended schedule; in mode `pareto` the longest of the front.
    pub fn schedule(&self) -> &Schedule {
        &self.schedule
    }

    /// How the search ended.
    pub fn status(&self) -> Status {
        self.status
    }

    /// Whether the schedule is what was asked, however the search ended: every coefficient that counts
    /// (by a weight or a specification, and not named in `objective.accept_unobservable`) is observed,
    /// the least separability is reached, and so is a specification that is the criterion (`max-ratio`,
    /// and mode `time`).
    pub fn is_acceptable(&self) -> bool {
        self.acceptable
    }

    /// The same result without what may differ between two runs of the same input: the duration of
    /// the search and the number of threads.
    #[must_use]
    pub fn reproducible(mut self) -> Self {
        self.document = self.document.reproducible();
        self
    }

    /// The report as one HTML page that needs nothing else.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the page cannot be made.
    #[cfg(feature = "report")]
    pub fn report_html(&self) -> Result<String> {
        crate::report::html::result(&self.document)
    }
}

impl Study {
    /// Searches for the best schedule: in mode `accuracy` the best criterion in the total time, in
    /// mode `time` the shortest test that meets the specification, in mode `pareto` the front
    /// between the two. Stops early as `control` says, or after `search.time_limit_s`, and then
    /// gives the best so far. The same study and seed give the same schedule at any number of
    /// threads.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`](crate::Error::is_input) when the limits contradict each other,
    /// [`Error::is_infeasible`](crate::Error::is_infeasible) when no schedule fits into them,
    /// [`Error::is_disagreement`](crate::Error::is_disagreement) when the winner's two
    /// computations differ.
    ///
    /// ```
    /// use scheme_opt::{Control, Study};
    /// let study = Study::from_toml("[search]\nmax_positions = 6\nstarts = 4\n")?;
    /// let found = study.search(&Control::default())?;
    /// assert!(found.document().evaluation.rms_sigma_deg_per_h < 0.01);
    /// assert!(found.schedule().positions().len() <= 6);
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn search(&self, control: &Control) -> Result<SearchResult> {
        let began = Instant::now();
        self.check_limits()?;
        let control = self.limited(control);
        let outcome = self
            .on_threads_or(control.threads(), || self.outcome(&control))?
            .map_err(|e| match e.is_input() {
                true => self.source.located(e),
                false => e,
            })?;
        let document =
            self.on_threads_or(control.threads(), || self.result_document(&outcome, began))?;
        Ok(SearchResult {
            document,
            acceptable: !outcome.lacking,
            schedule: outcome.schedule,
            status: outcome.status,
        })
    }

    /// With the study's own time limit, if that is the earlier.
    fn limited(&self, control: &Control) -> Control {
        // A limit beyond what the clock can hold is none.
        let limit = self.config().search.time_limit_s;
        let limit = limit.and_then(|s| Duration::try_from_secs_f64(s).ok());
        let own = limit.and_then(|limit| Instant::now().checked_add(limit));
        let given = control.deadline();
        let earlier = match (given, own) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
        control.clone().with_deadline(earlier)
    }

    fn outcome(&self, control: &Control) -> Result<SearchOutcome> {
        let problem = SearchProblem {
            from: self.from.clone(),
            ..self.checked.search_problem()
        };
        let evaluator = &self.evaluator;
        match self.config().objective.mode {
            Mode::Accuracy => search(evaluator, &problem, control),
            Mode::Time => shortest(evaluator, &problem, control),
            Mode::Pareto => {
                let points = self.config().search.front_points;
                front(evaluator, &problem, points, control)
            }
        }
    }

    /// The document, with the standard schemes beside the schedule and the certificate.
    fn result_document(&self, outcome: &SearchOutcome, began: Instant) -> ResultDocument {
        let objective = &self.config().objective;
        // A test that ends before the time allowed, for being the shortest, for the longest of the front
        // being cut short, or for a drift that is known before and walks: the schemes get no more
        // than it. Whole periods leave less than one.
        let taken_s = outcome.evaluation.total_time_s;
        let left_s = objective.total_time_s - taken_s;
        let period_s = self.checked.test().platform().period_s();
        let total_time_s = match objective.mode {
            Mode::Accuracy | Mode::Pareto if left_s < period_s => objective.total_time_s,
            Mode::Time | Mode::Accuracy | Mode::Pareto => taken_s,
        };
        let evaluator = &self.evaluator;
        let mut document = ResultDocument::new(
            outcome,
            &baselines(evaluator, total_time_s),
            evaluator.objective(),
            self.config().search.seed,
            Some(began.elapsed().as_secs_f64()),
            &self.inputs(),
        );
        let from = self.from.as_ref();
        document.from = from.and_then(|from| FromRecord::new(from, objective.mode, outcome));
        document.evaluation.limits = self.limits(&outcome.schedule);
        let certifier = Certifier::new(self.checked.test().platform());
        let certificate = CertificateRecord::new(
            &certifier,
            objective.mode,
            evaluator.objective(),
            match objective.mode {
                Mode::Pareto => total_time_s,
                Mode::Time | Mode::Accuracy => objective.total_time_s,
            },
            outcome,
        );
        document.with_certificate(certificate, &certifier, evaluator.objective())
    }
}
