//! Schedules of a study side by side.

use super::Study;
use crate::compare::{self, Source, Terms};
use crate::error::Result;
use crate::results::ComparisonDocument;
use crate::schedule::Schedule;
use crate::schedule::standard::StandardScheme;

/// What a built-in scheme is called in documents, before its name.
const PREFIX: &str = "standard:";

/// A schedule to compare, with what it is called.
#[derive(Debug, Clone, PartialEq)]
pub struct Contender(compare::ComparisonEntry);

impl Contender {
    /// A schedule of one's own, with its own dwells.
    pub fn schedule(name: impl Into<String>, schedule: Schedule) -> Self {
        Self(compare::ComparisonEntry {
            name: name.into(),
            source: Source::Given(schedule),
        })
    }

    /// A built-in scheme, with equal dwells.
    pub fn standard(scheme: StandardScheme) -> Self {
        Self(compare::ComparisonEntry {
            name: format!("{PREFIX}{}", scheme.name()),
            source: Source::Standard(scheme),
        })
    }

    /// The built-in scheme that is called `standard:NAME`; none: the name is not of that form.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`](crate::Error::is_input) when there is no such scheme.
    pub fn from_name(name: &str) -> Result<Option<Self>> {
        let scheme = name.strip_prefix(PREFIX).map(StandardScheme::from_name);
        Ok(scheme.transpose()?.map(Self::standard))
    }

    /// Name and schedule of one's own; none: a built-in scheme.
    #[cfg(feature = "cli")]
    pub(crate) fn given(&self) -> Option<(&str, &Schedule)> {
        match &self.0.source {
            Source::Given(schedule) => Some((&self.0.name, schedule)),
            Source::Standard(_) => None,
        }
    }

    /// A name without what marks a built-in scheme; none: it is not one.
    #[cfg(feature = "cli")]
    pub(crate) fn standard_name(name: &str) -> Option<&str> {
        name.strip_prefix(PREFIX)
    }
}

/// How to compare.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct ComparisonOptions {
    /// Whether schedules of one's own are scaled to the study's total time; standard schemes always
    /// are.
    pub scale: bool,
    /// Whether schedules are tried in their best order too; dwells go with their positions.
    pub best_order: bool,
    /// Most steps that the search through all orders of one scheme may take.
    pub order_steps: u64,
}

impl Default for ComparisonOptions {
    /// All in the same time, orders as they are.
    fn default() -> Self {
        Self {
            scale: true,
            best_order: false,
            order_steps: compare::MOST_STEPS,
        }
    }
}

/// Schedules side by side.
#[derive(Debug, Clone, PartialEq)]
pub struct ComparisonResult {
    document: ComparisonDocument,
}

impl ComparisonResult {
    /// The comparison as data, in the form of `compare --json`.
    pub fn document(&self) -> &ComparisonDocument {
        &self.document
    }

    /// The report as one HTML page that needs nothing else.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the page cannot be made.
    #[cfg(feature = "report")]
    pub fn report_html(&self) -> Result<String> {
        crate::report::html::comparison(&self.document)
    }
}

impl Study {
    /// What each of the schedules reaches on the platform; one that it cannot run is skipped, with
    /// the reason. Ratios are to the first.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`](crate::Error::is_input) when the limits contradict each other.
    ///
    /// ```
    /// use scheme_opt::{ComparisonOptions, Contender, StandardScheme, Study};
    /// let study = Study::from_toml("[objective]\ntotal_time_s = 6000\n")?;
    /// let contenders = [StandardScheme::Icosahedron12, StandardScheme::Faces6];
    /// let contenders = contenders.map(Contender::standard);
    /// let compared = study.compare(&contenders, &ComparisonOptions::default())?;
    /// let [oblique, aligned] = &compared.document().schedules[..] else { unreachable!() };
    /// assert!(oblique.rms_sigma_deg_per_h < aligned.rms_sigma_deg_per_h);
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn compare(
        &self,
        contenders: &[Contender],
        options: &ComparisonOptions,
    ) -> Result<ComparisonResult> {
        self.check_limits()?;
        let terms = Terms {
            total_time_s: self.config().objective.total_time_s,
            scale: options.scale,
            best_order: options.best_order,
            seed: self.config().search.seed,
            most_steps: options.order_steps,
        };
        let contenders: Vec<compare::ComparisonEntry> =
            contenders.iter().map(|c| c.0.clone()).collect();
        let compared =
            self.on_threads(|| compare::compare(&self.evaluator, &contenders, &terms))?;
        let objective = self.evaluator.objective();
        let mut document = ComparisonDocument::new(&compared, &terms, objective, &self.inputs());
        for contender in &contenders {
            if let Source::Given(schedule) = &contender.source {
                document.warn_of(&contender.name, schedule);
            }
        }
        Ok(ComparisonResult { document })
    }

    /// A built-in scheme with equal dwells in the study's total time.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`](crate::Error::is_input) when the platform cannot take one of its
    /// positions, [`Error::is_infeasible`](crate::Error::is_infeasible) when it does not fit into
    /// the time.
    pub fn standard(&self, scheme: StandardScheme) -> Result<Schedule> {
        scheme.schedule(self.config().objective.total_time_s, self.checked.test())
    }
}
