//! The task as a person describes it: the `[objective]` and `[search]` tables of a platform file.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::PerCoefficient;
use crate::drift::DriftCoefficient;
use crate::error::{Error, Result};
use crate::evaluate::Objective;
use crate::platform::in_range;
use crate::schedule::text;

/// What a search is to find.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// The best criterion in the total time.
    #[default]
    Accuracy,
    /// The shortest total time in which every coefficient meets its specification.
    Time,
    /// The front between accuracy and time.
    Pareto,
}

impl Mode {
    /// All modes.
    pub const ALL: [Self; 3] = [Self::Accuracy, Self::Time, Self::Pareto];

    /// The name used in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Accuracy => "accuracy",
            Self::Time => "time",
            Self::Pareto => "pareto",
        }
    }

    /// The mode of that name.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] listing the names, with the nearest one as a hint.
    pub fn from_name(name: &str) -> Result<Self> {
        by_name("objective.mode", name, &Self::ALL.map(|m| (m.name(), m)))
    }
}

/// What "accurate" means: which number of the coefficients' covariance P_D is minimised.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum CriterionKind {
    /// The root mean square of the σ of the coefficients.
    #[default]
    A,
    /// The determinant of P_D.
    D,
    /// The largest eigenvalue of P_D.
    E,
    /// The largest ratio of a σ to its specification.
    MaxRatio,
    /// The attitude error after the mission of `objective.use`.
    Use,
}

impl CriterionKind {
    /// All criteria.
    pub const ALL: [Self; 5] = [Self::A, Self::D, Self::E, Self::MaxRatio, Self::Use];

    /// The name used in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::A => "a",
            Self::D => "d",
            Self::E => "e",
            Self::MaxRatio => "max-ratio",
            Self::Use => "use",
        }
    }

    /// The criterion of that name.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] listing the names, with the nearest one as a hint.
    pub fn from_name(name: &str) -> Result<Self> {
        let named = Self::ALL.map(|c| (c.name(), c));
        by_name("objective.criterion", name, &named)
    }
}

pub(super) fn by_name<T: Copy>(key: &str, name: &str, named: &[(&'static str, T)]) -> Result<T> {
    if let Some((_, value)) = named.iter().find(|(known, _)| *known == name) {
        return Ok(*value);
    }
    let names: Vec<&str> = named.iter().map(|(known, _)| *known).collect();
    let error = Error::input("no such choice")
        .with_key(key)
        .with_value(text::shown(name))
        .with_allowed(names.join(", "));
    Err(text::with_nearest(error, name, names))
}

/// What is to be achieved; the `[objective]` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct ObjectiveConfig {
    /// What a search is to find.
    pub mode: Mode,
    /// What "accurate" means.
    pub criterion: CriterionKind,
    /// Duration of the test with its moves and settles, s. Greater than 0, to 1e7, and no
    /// shorter than the shortest dwell and one filter period.
    pub total_time_s: f64,
    /// How covariance and separability enter the score.
    pub score: ScoreConfig,
    /// Specific force over time after the test, a CSV file, for criterion `use`: time_s, f_x, f_y, f_z
    /// (g, platform axes) and, where it turns, w_x, w_y, w_z (°/s).
    #[serde(rename = "use", skip_serializing_if = "Option::is_none")]
    pub use_profile: Option<PathBuf>,
    /// Weights of the variances in criterion `a`, 0 to 1e6; 1 for drift coefficients without one, 0 for
    /// other parameters. The other criteria have none.
    #[serde(skip_serializing_if = "PerCoefficient::is_empty")]
    #[cfg_attr(feature = "schema", schemars(with = "super::per_coefficient::Named"))]
    pub weights: PerCoefficient,
    /// 1σ specification of any parameter in its own unit, greater than 0, to 1e12; `default` is for the
    /// drift coefficients.
    #[serde(skip_serializing_if = "PerCoefficient::is_empty")]
    #[cfg_attr(feature = "schema", schemars(with = "super::per_coefficient::Named"))]
    pub spec: PerCoefficient,
    /// 1σ specification of the drift coefficients, °/h (per g), greater than 0, to 1e12: `spec` for
    /// those alone.
    #[serde(skip_serializing_if = "PerCoefficient::is_empty")]
    #[cfg_attr(feature = "schema", schemars(with = "super::per_coefficient::Named"))]
    pub spec_deg_per_h: PerCoefficient,
    /// Coefficients with a weight or a specification that may stay unobservable; any other that
    /// does is no acceptable schedule.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub accept_unobservable: Vec<DriftCoefficient>,
}

impl Default for ObjectiveConfig {
    fn default() -> Self {
        Self {
            mode: Mode::default(),
            criterion: CriterionKind::default(),
            total_time_s: 12_000.0,
            score: ScoreConfig::default(),
            use_profile: None,
            weights: PerCoefficient::default(),
            spec: PerCoefficient::default(),
            spec_deg_per_h: PerCoefficient::default(),
            accept_unobservable: Vec::new(),
        }
    }
}

/// How covariance and separability enter the score; the `[objective.score]` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct ScoreConfig {
    /// Weight of the covariance criterion, 0 to 1e6.
    pub covariance_weight: f64,
    /// Weight of the separability of the coefficients, 0 to 1e6; 0: the covariance alone.
    pub separability_weight: f64,
    /// Weight of the average of ln(criterion) over the test, 0 to 1e6: rewards early convergence.
    pub convergence_weight: f64,
    /// Least separability that a schedule must give every coefficient, 0 to 1.
    pub minimum_separability: f64,
}

/// Whose test it is: told in every document and report.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct TestConfig {
    /// What it is called, 1 to 200 characters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub title: Option<String>,
    /// Serial number of the platform, 1 to 200 characters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// The stand that it is run on, 1 to 200 characters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stand: Option<String>,
    /// Who runs it, 1 to 200 characters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
    /// What else is to be said, 1 to 200 characters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

impl TestConfig {
    /// Longest text of a key, characters.
    const LONGEST: usize = 200;

    /// What is given, by key.
    pub(crate) fn given(&self) -> impl Iterator<Item = (&'static str, &str)> {
        let all = [
            ("title", &self.title),
            ("serial", &self.serial),
            ("stand", &self.stand),
            ("operator", &self.operator),
            ("note", &self.note),
        ];
        all.into_iter()
            .filter_map(|(name, text)| Some((name, text.as_deref()?)))
    }

    /// Whether nobody said anything.
    pub fn is_empty(&self) -> bool {
        self.given().next().is_none()
    }

    /// Texts go into terminals, pages and lines of messages.
    pub(super) fn check(&self) -> Result<()> {
        for (name, text) in self.given() {
            let length = text.chars().count();
            if text.trim().is_empty() || length > Self::LONGEST || text.contains(char::is_control) {
                return Err(Error::input("not a text of one line")
                    .with_key(format!("test.{name}"))
                    .with_value(format!("\"{}\"", crate::schedule::text::shown(text)))
                    .with_allowed(format!(
                        "1 to {} characters, none of them a line break or another control character",
                        Self::LONGEST
                    )));
            }
        }
        Ok(())
    }
}

impl Default for ScoreConfig {
    fn default() -> Self {
        Self {
            covariance_weight: 1.0,
            separability_weight: Objective::SEPARABILITY_WEIGHT,
            convergence_weight: 0.0,
            minimum_separability: 0.0,
        }
    }
}

impl ScoreConfig {
    pub(super) fn check(&self) -> Result<()> {
        const COVARIANCE: &str = "objective.score.covariance_weight";
        const SEPARABILITY: &str = "objective.score.separability_weight";
        const CONVERGENCE: &str = "objective.score.convergence_weight";
        const MINIMUM: &str = "objective.score.minimum_separability";
        in_range(COVARIANCE, self.covariance_weight, 0.0, 1e6, "0 to 1e6")?;
        in_range(SEPARABILITY, self.separability_weight, 0.0, 1e6, "0 to 1e6")?;
        in_range(CONVERGENCE, self.convergence_weight, 0.0, 1e6, "0 to 1e6")?;
        in_range(MINIMUM, self.minimum_separability, 0.0, 1.0, "0 to 1")?;
        let weights = [
            self.covariance_weight,
            self.separability_weight,
            self.convergence_weight,
        ];
        if weights.iter().all(|w| *w == 0.0) {
            return Err(Error::input("nothing is left to optimise")
                .with_key(COVARIANCE)
                .with_value(self.covariance_weight)
                .with_allowed(format!(
                    "more than 0, or {SEPARABILITY} or {CONVERGENCE} more than 0"
                )));
        }
        Ok(())
    }
}

/// How to search; the `[search]` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct SearchConfig {
    /// Most positions of a schedule, 1 to 500; none: 24, or 48 where the drift wanders, since more and
    /// shorter dwells then pay.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_positions: Option<usize>,
    /// Whether measured continuous moves may be part of a schedule.
    pub allow_tumbling: bool,
    /// Seed of the random starts.
    pub seed: u64,
    /// How many random starts, 1 to 1 000 000.
    pub starts: usize,
    /// A position is left out if the score grows by no more than this, 0 to 1; by default the
    /// score is the logarithm of the criterion, so that this is a fraction of it.
    pub position_tolerance: f64,
    /// Points of the front in mode `pareto`, 2 to 200.
    pub front_points: usize,
    /// Threads to use, 1 to 4096; none: one for each processor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threads: Option<usize>,
    /// Longest search, s, greater than 0, to 1e9; none: until it has converged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_limit_s: Option<f64>,
}

impl Default for SearchConfig {
    fn default() -> Self {
        Self {
            max_positions: None,
            allow_tumbling: false,
            seed: 1,
            starts: 64,
            position_tolerance: 2e-4,
            front_points: 12,
            threads: None,
            time_limit_s: None,
        }
    }
}

impl SearchConfig {
    /// Most positions where none is said; `wanders`: the drift does.
    pub(crate) const fn default_positions(wanders: bool) -> usize {
        if wanders { 48 } else { 24 }
    }

    pub(super) fn check(&self) -> Result<()> {
        let count = |key: &str, value: usize, most: usize, allowed: &str| {
            if (1..=most).contains(&value) {
                Ok(())
            } else {
                Err(Error::out_of_range(key, value, allowed))
            }
        };
        if let Some(most) = self.max_positions {
            count("search.max_positions", most, 500, "1 to 500")?;
        }
        count("search.starts", self.starts, 1_000_000, "1 to 1000000")?;
        if !(2..=200).contains(&self.front_points) {
            let key = "search.front_points";
            return Err(Error::out_of_range(key, self.front_points, "2 to 200"));
        }
        if let Some(threads) = self.threads {
            count("search.threads", threads, 4096, "1 to 4096")?;
        }
        let tolerance = self.position_tolerance;
        in_range("search.position_tolerance", tolerance, 0.0, 1.0, "0 to 1")?;
        if let Some(limit_s) = self.time_limit_s {
            in_range(
                "search.time_limit_s",
                limit_s,
                f64::MIN_POSITIVE,
                1e9,
                "greater than 0, to 1e9",
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_the_files() {
        for mode in Mode::ALL {
            let quoted = format!("\"{}\"", mode.name());
            assert_eq!(serde_json::to_string(&mode).unwrap(), quoted);
            assert_eq!(Mode::from_name(mode.name()), Ok(mode));
        }
        for criterion in CriterionKind::ALL {
            let quoted = format!("\"{}\"", criterion.name());
            assert_eq!(serde_json::to_string(&criterion).unwrap(), quoted);
            assert_eq!(CriterionKind::from_name(criterion.name()), Ok(criterion));
        }
        let error = CriterionKind::from_name("max_ratio").unwrap_err();
        assert!(error.to_string().contains("did you mean `max-ratio`?"));
        assert_eq!(error.key(), Some("objective.criterion"));
    }
}
