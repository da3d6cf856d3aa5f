//! The study: one platform, one objective, and all that can be asked of them.
//!
//! A [`Study`] is made of a platform file, of TOML text or of a [`StudyConfig`], with every value
//! checked. It evaluates, analyses, simulates and compares schedules, searches for the best one,
//! says what no schedule can beat, and gives the commands for the stand. Every answer is a value of
//! its own that holds the JSON document the command line writes (`.document()`), so that library and
//! command line never say different things.
//!
//! ```
//! use scheme_opt::{Schedule, Study};
//! let study = Study::from_toml("[motion]\nslew_rate_deg_per_s = 0.5\nsettle_s = 30\n")?;
//! let schedule = Schedule::from_csv(
//!     "alpha_deg,beta_deg,gamma_deg,dwell_s\n\
//!      0,0,0,1500\n\
//!      180,0,0,1500\n\
//!      90,45,10,1500\n",
//! )?;
//! let evaluated = study.evaluate(&schedule)?;
//! assert!(evaluated.document().rms_sigma_deg_per_h < 4.0);
//! # Ok::<(), scheme_opt::Error>(())
//! ```

mod answers;
mod batch;
mod compared;
mod limits;
mod searched;
mod simulated;

use std::path::Path;

pub use answers::{AnalysisResult, BoundResult, EvaluationResult};
pub use batch::{Batch, BatchControl, BatchPlatform, BatchResult};
pub use compared::{ComparisonOptions, ComparisonResult, Contender};
pub use searched::SearchResult;
pub use simulated::{SimulationRequest, SimulationResult};

use crate::analysis::Analysis;
use crate::certificate::Certifier;
use crate::commands::CommandTable;
use crate::config::{CheckedConfig, StudyConfig, StudySource};
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::motion::Timeline;
use crate::results::{AnalysisDocument, BoundDocument, DoneRecord, EvaluationDocument, Inputs};
use crate::schedule::Schedule;
use crate::search::StartingScheme;
use crate::sheet::OperatorSheet;

/// One platform and one objective, checked, and all that can be asked of them.
///
/// Work that takes long runs on `search.threads` threads (none given: one for each processor); no
/// answer depends on their number.
#[derive(Debug)]
pub struct Study {
    source: StudySource,
    checked: CheckedConfig,
    evaluator: Evaluator,
    /// The scheme that a search begins with.
    from: Option<StartingScheme>,
}

impl Study {
    /// The study of a platform file (TOML); every key that it leaves out has its default.
    ///
    /// # Errors
    ///
    /// [`Error::is_io`] when the file cannot be read; [`Error::is_input`] with file, line, key,
    /// value and what is allowed, for whatever in it is not acceptable.
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self> {
        Self::from_source(StudySource::read(path.as_ref())?)
    }

    /// The study of the text of a platform file.
    ///
    /// # Errors
    ///
    /// As [`Study::from_file`].
    ///
    /// ```
    /// let error = scheme_opt::Study::from_toml("[site]\nlatitude_deg = 95\n").unwrap_err();
    /// assert_eq!(error.key(), Some("site.latitude_deg"));
    /// assert_eq!(error.line(), Some(2));
    /// ```
    pub fn from_toml(text: &str) -> Result<Self> {
        Self::from_source(StudySource::parse(text, None)?)
    }

    /// The study of values that a program has put together.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] with key, value and what is allowed.
    ///
    /// ```
    /// use scheme_opt::{Study, StudyConfig};
    /// let mut config = StudyConfig::default();
    /// config.platform.gimbals.beta_deg = Some([-60.0, 60.0]);
    /// config.objective.total_time_s = 14_400.0;
    /// let study = Study::from_config(config)?;
    /// assert_eq!(study.config().objective.total_time_s, 14_400.0);
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn from_config(config: StudyConfig) -> Result<Self> {
        Self::from_source(StudySource::of_config(config))
    }

    /// The embedded default: the seed paper's §3 at latitude 28.2°, 12 000 s.
    ///
    /// # Errors
    ///
    /// None; the signature is that of the others.
    pub fn embedded_default() -> Result<Self> {
        Self::from_source(StudySource::embedded_default())
    }

    /// The study of values whose origin is known: what errors point to.
    pub(crate) fn from_source(source: StudySource) -> Result<Self> {
        let checked = source.check_for_evaluation()?;
        Ok(Self {
            evaluator: checked.evaluator(),
            checked,
            source,
            from: None,
        })
    }

    /// The same study in the middle of a test: `done` has been run, as it was (an interrupted dwell
    /// with the time it got), and whatever is asked from now on is about how to go on. Total times
    /// count from the beginning of the test. Asked twice, the second part follows the first.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] when the platform could not have run `done`.
    ///
    /// ```
    /// use scheme_opt::{Position, Schedule, ScheduledPosition, Study};
    /// let at = |deg| ScheduledPosition::new(Position::from_deg(deg, 20.0, 40.0), 900.0);
    /// let of = |positions| Schedule::new(positions);
    /// let study = Study::embedded_default()?;
    /// let whole = study.evaluate(&of(vec![at(0.0), at(120.0)])?)?;
    /// let interrupted = study.after(of(vec![at(0.0)])?)?;
    /// let rest = interrupted.evaluate(&of(vec![at(120.0)])?)?;
    /// assert_eq!(rest.sigma_deg_per_h(), whole.sigma_deg_per_h());
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn after(self, done: Schedule) -> Result<Self> {
        let checked = self.checked.interrupted_after(done)?;
        Ok(Self {
            evaluator: checked.evaluator(),
            checked,
            source: self.source,
            from: self.from,
        })
    }

    /// The same study, whose search begins with a scheme that is there already: it is one of the starts,
    /// and the result is never worse than it, by the score, as long as the scheme keeps to the limits of
    /// the search. Its pinned positions keep their angles and their order, a pinned first position stays
    /// first and a pinned last one last; with a [`Freedom`](crate::Freedom) of less than everything all
    /// positions stay, and none vanishes. Where nobody gave `search.max_positions`, there may be as many
    /// as the scheme has.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] for a scheme of more than 500 positions, for one with positions that have to
    /// stay and that the platform cannot take or is to reach by moves of their own, and where tumbling
    /// is allowed beside positions that have to stay; [`Error::is_infeasible`] where those do not fit
    /// into the time.
    ///
    /// ```
    /// use scheme_opt::{Control, Freedom, Schedule, StartingScheme, Study};
    /// let study = Study::from_toml("[search]\nstarts = 2\nmax_positions = 4\n")?;
    /// let scheme = Schedule::from_csv(
    ///     "alpha_deg,beta_deg,gamma_deg,dwell_s\n\
    ///      10,20,30,3000\n-80,50,120,3000\n150,-40,-70,3000\n60,-20,-160,3000\n",
    /// )?;
    /// let given = study.evaluate(&scheme)?.document().score.value;
    /// let scheme = StartingScheme::new("mine", scheme).only(Freedom::Dwells);
    /// let found = study.starting_from(scheme)?.search(&Control::default())?;
    /// assert!(found.document().evaluation.score.value <= given);
    /// assert_eq!(found.schedule().positions()[1].position.to_deg(), [-80.0, 50.0, 120.0]);
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn starting_from(mut self, scheme: StartingScheme) -> Result<Self> {
        self.check_start(&scheme)?;
        if self.may_have_more_positions() {
            self.checked
                .allow_positions(scheme.schedule.positions().len());
        }
        self.from = Some(scheme);
        Ok(self)
    }

    /// Refuses a scheme that a search cannot begin with.
    pub(crate) fn check_start(&self, scheme: &StartingScheme) -> Result<()> {
        let mut checked = self.checked.clone();
        if self.may_have_more_positions() {
            checked.allow_positions(scheme.schedule.positions().len());
        }
        let checked = scheme.check(checked.test(), &checked.search_problem());
        checked.map_err(
            |e| match e.key().is_some_and(|key| key.starts_with("positions")) {
                true => e,
                false => self.source.located(e),
            },
        )
    }

    /// Whether nobody said how many positions there may be.
    fn may_have_more_positions(&self) -> bool {
        let is_open = |key: &String| key == "search.max_positions";
        self.defaulted().iter().any(is_open)
    }

    /// The scheme that a search begins with.
    #[cfg(feature = "cli")]
    pub(crate) fn begins_with(&self) -> Option<&StartingScheme> {
        self.from.as_ref()
    }

    /// Every value in force, defaults filled in; what documents carry as `inputs`.
    pub fn config(&self) -> &StudyConfig {
        self.checked.config()
    }

    /// The keys that nobody gave, in dotted form.
    pub fn defaulted(&self) -> &[String] {
        self.source.defaulted()
    }

    /// What is known of `schedule` before the test: σ of every coefficient, by two computations
    /// that have to agree, observability orders, separability, convergence.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] when the platform cannot run the schedule, [`Error::is_numerical`] when
    /// a number cannot be trusted, [`Error::is_disagreement`] when the two computations differ.
    pub fn evaluate(&self, schedule: &Schedule) -> Result<EvaluationResult> {
        let evaluation = self.evaluator.evaluate(schedule)?;
        let objective = self.evaluator.objective();
        let mut document =
            EvaluationDocument::new(&evaluation, schedule, objective, &self.inputs());
        document.limits = self.limits(schedule);
        Ok(EvaluationResult::new(&evaluation, document))
    }

    /// What `schedule` makes observable and why, what it tells worst, and what to add to it.
    ///
    /// # Errors
    ///
    /// As [`Study::evaluate`].
    pub fn analyze(&self, schedule: &Schedule) -> Result<AnalysisResult> {
        let evaluation = self.evaluator.evaluate(schedule)?;
        let analyse = || Analysis::new(&self.evaluator, schedule, &evaluation);
        let analysis = self.on_threads(analyse)??;
        let document = AnalysisDocument::new(
            &analysis,
            &evaluation,
            schedule,
            self.evaluator.objective(),
            &self.inputs(),
        );
        Ok(AnalysisResult::new(document))
    }

    /// What no schedule of the total time can beat, whatever its sequence, order, number of
    /// positions and motion; with a specification, the shortest conceivable time.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] when the limits contradict each other, [`Error::is_numerical`] when no
    /// bound can be computed.
    pub fn bound(&self) -> Result<BoundResult> {
        self.check_limits()?;
        let objective = self.evaluator.objective();
        let total_time_s = self.config().objective.total_time_s;
        let (bound, minimum) = self.on_threads(|| {
            let certifier = Certifier::new(self.checked.test().platform());
            let bound = certifier.bound(&objective.criterion, total_time_s)?;
            let spec = objective.spec_deg_per_h.as_ref();
            let minimum = spec.map(|spec| certifier.minimum_time(spec, total_time_s));
            let others = objective.specifies_others();
            Ok::<_, Error>((bound, minimum.transpose()?.map(|m| m.beside(others))))
        })??;
        let document = BoundDocument::new(&bound, minimum, objective, &self.inputs());
        Ok(BoundResult::new(document, minimum, total_time_s))
    }

    /// What the stand is told to do in `schedule`, moves cut into steps in which no gimbal turns by
    /// more than `step_deg`, 0.01° to 45° ([`CommandTable::DEFAULT_STEP_DEG`] is the usual).
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] when the platform cannot run the schedule, or for such a step.
    pub fn commands(&self, schedule: &Schedule, step_deg: f64) -> Result<CommandTable> {
        let test = self.checked.test();
        let timeline = Timeline::new(test, schedule)?;
        let table = CommandTable::new(test.platform(), &timeline, step_deg)?;
        // What is done needs no commands; the clock goes on.
        Ok(match DoneRecord::of(test) {
            Some(done) => table.since(done.total_time_s),
            None => table,
        })
    }

    /// What an operator has at the stand for `schedule`: clock, angles, what the accelerometers read, and
    /// what to do, position by position.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] when the platform cannot run the schedule.
    pub fn operator_sheet(&self, schedule: &Schedule) -> Result<OperatorSheet> {
        let test = self.checked.test();
        let timeline = Timeline::new(test, schedule)?;
        Ok(OperatorSheet::new(test, &timeline).of_test(&self.config().test))
    }

    /// The inputs as documents carry them.
    pub(crate) fn inputs(&self) -> Inputs {
        Inputs {
            config: self.config().clone(),
            defaulted: self.defaulted().to_vec(),
            done: DoneRecord::of(self.checked.test()),
        }
    }

    /// All that answers depend on, resolved, as text: what files named in the platform file hold too.
    #[cfg(feature = "cli")]
    pub(crate) fn resolved(&self) -> String {
        format!("{:?} {:?}", self.checked.test(), self.evaluator.objective())
    }

    /// The test, its platform in SI: for the tables of the command line.
    #[cfg(feature = "cli")]
    pub(crate) fn test(&self) -> &crate::motion::Test {
        self.checked.test()
    }

    /// Refuses limits of a search that contradict each other; a schedule that is given can be
    /// evaluated all the same.
    fn check_limits(&self) -> Result<()> {
        self.source.check().map(|_| ())
    }

    /// Does `work` on the threads that the study asks for.
    fn on_threads<T: Send>(&self, work: impl FnOnce() -> T + Send) -> Result<T> {
        self.on_threads_or(None, work)
    }

    /// The same, on `threads` where the study asks for no number of them.
    fn on_threads_or<T: Send>(
        &self,
        threads: Option<usize>,
        work: impl FnOnce() -> T + Send,
    ) -> Result<T> {
        let threads = self.config().search.threads.or(threads).unwrap_or(0);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| {
                Error::input(format!("cannot start the threads: {e}"))
                    .with_key("search.threads")
                    .with_value(threads)
                    .with_source(e)
            })?;
        Ok(pool.install(work))
    }
}
