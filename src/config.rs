//! The configuration: platform and task as a person writes them, checked into what is computed with.
//!
//! A platform file (TOML) is read by [`StudySource`], which knows where each value came from;
//! its [`StudyConfig`] holds the values with units in their names, defaults filled in, and is
//! what result documents embed; [`StudyConfig::check`] tests every value and gives the
//! [`CheckedConfig`].
//!
//! ```
//! use scheme_opt::internals::config::StudySource;
//! let mut source = StudySource::parse("[site]\nlatitude_deg = 47.3\n", None)?;
//! // A command line option takes precedence over the file.
//! source.config.objective.total_time_s = 6000.0;
//! source.override_key("objective.total_time_s");
//! let study = source.check()?;
//! assert_eq!(study.objective().total_time_s, 6000.0);
//! assert!(source.defaulted().iter().any(|key| key == "filter.period_s"));
//! # Ok::<(), scheme_opt::Error>(())
//! ```

mod aims;
mod grade;
mod keys;
mod per_coefficient;
mod source;
mod tables;
mod task;

pub(crate) use aims::Aims;
pub use grade::Grade;
pub use per_coefficient::PerCoefficient;
pub use source::{DEFAULT_TOML, StudySource};
pub use tables::{CriterionKind, Mode, ObjectiveConfig, ScoreConfig, SearchConfig, TestConfig};

use serde::{Deserialize, Serialize};

use crate::drift::CoefficientVector;
use crate::error::{Error, Result};
use crate::motion::Test;
use crate::platform::{Platform, PlatformConfig, in_range};
use crate::schedule::Schedule;

/// A platform file: platform, objective and search, with units in the names.
///
/// The default is the embedded platform file: the seed paper's §3 at latitude 28.2°, 12 000 s.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct StudyConfig {
    /// The `[site]` … `[motion]` tables.
    #[serde(flatten)]
    pub platform: PlatformConfig,
    /// What is to be achieved.
    #[serde(default)]
    pub objective: ObjectiveConfig,
    /// How to search.
    #[serde(default)]
    pub search: SearchConfig,
    /// Whose test it is; left out where nobody said.
    #[serde(default, skip_serializing_if = "TestConfig::is_empty")]
    pub test: TestConfig,
}

const TOTAL_TIME: &str = "objective.total_time_s";

impl Default for StudyConfig {
    fn default() -> Self {
        let mut config = Self {
            platform: PlatformConfig::default(),
            objective: ObjectiveConfig::default(),
            search: SearchConfig::default(),
            test: TestConfig::default(),
        };
        config.resolve();
        config
    }
}

impl StudyConfig {
    /// Writes down the noise and the random drift that are assumed when neither of their forms is
    /// given, so that the configuration says by itself what is computed with.
    fn resolve(&mut self) {
        let accelerometer = &mut self.platform.accelerometer;
        if accelerometer.noise_g.is_none() && accelerometer.noise_density_ug_per_sqrt_hz.is_none() {
            accelerometer.noise_g = Some(crate::platform::DEFAULT_NOISE_G);
        }
        let gyro = &mut self.platform.gyro;
        if gyro.random_drift_deg_per_h.is_none() && gyro.angle_random_walk_deg_per_sqrt_h.is_none()
        {
            gyro.random_drift_deg_per_h = Some(crate::platform::DEFAULT_RANDOM_DRIFT_DEG_PER_H);
        }
    }

    /// Checks every value, and the values against each other.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] naming the key, the value and what is allowed.
    ///
    /// ```
    /// use scheme_opt::internals::config::{CriterionKind, StudyConfig};
    /// let mut config = StudyConfig::default();
    /// config.objective.criterion = CriterionKind::MaxRatio;
    /// let error = config.check().unwrap_err();
    /// assert_eq!(error.key(), Some("objective.criterion"));
    /// ```
    pub fn check(&self) -> Result<CheckedConfig> {
        let study = self.check_for_evaluation()?;
        self.check_limits_fit(study.test.platform())?;
        Ok(study)
    }

    /// The same, but for the limits of a search against each other: a schedule that is given can
    /// be evaluated on a platform whose total time is shorter than its minimum dwell.
    ///
    /// # Errors
    ///
    /// As [`StudyConfig::check`].
    pub fn check_for_evaluation(&self) -> Result<CheckedConfig> {
        self.test.check()?;
        let platform = self.platform.check()?;
        in_range(
            TOTAL_TIME,
            self.objective.total_time_s,
            f64::MIN_POSITIVE,
            1e7,
            "greater than 0, to 1e7",
        )?;
        self.objective.score.check()?;
        let aims = Aims::check(&self.objective, &platform)?;
        if aims.spec_deg_per_h.is_none() {
            self.check_works_without_spec()?;
        }
        self.search.check()?;
        let mut config = self.clone();
        config.resolve();
        let most = SearchConfig::default_positions(!platform.drift_colour().is_white());
        config.search.max_positions.get_or_insert(most);
        Ok(CheckedConfig {
            config,
            test: platform.into(),
            aims,
        })
    }

    fn check_limits_fit(&self, platform: &Platform) -> Result<()> {
        let total_s = self.objective.total_time_s;
        for (least, least_s, what) in [
            ("motion.min_dwell_s", platform.motion.min_dwell_s, "dwell"),
            ("filter.period_s", platform.period_s, "filter period"),
        ] {
            if total_s >= least_s {
                continue;
            }
            // About the one of the two that is not as it always is.
            let error = match total_s == ObjectiveConfig::default().total_time_s {
                true => Error::input(format!("one {what} is longer than the whole test"))
                    .with_key(least)
                    .with_value(least_s)
                    .with_allowed(format!("at most {TOTAL_TIME} = {total_s}")),
                false => Error::input(format!("shorter than one {what}"))
                    .with_key(TOTAL_TIME)
                    .with_value(total_s)
                    .with_allowed(format!("at least {least} = {least_s}")),
            };
            return Err(error.with_hint("all times are in seconds"));
        }
        Ok(())
    }

    fn check_works_without_spec(&self) -> Result<()> {
        let needs = |key: &str, value: &str| {
            Err(Error::input("needs a specification")
                .with_key(key)
                .with_value(format!("\"{value}\""))
                .with_allowed(format!(
                    "\"{value}\" together with objective.spec or objective.spec_deg_per_h"
                ))
                .with_hint("give [objective.spec_deg_per_h] with, for example, default = 0.005"))
        };
        if self.objective.criterion == CriterionKind::MaxRatio {
            return needs("objective.criterion", self.objective.criterion.name());
        }
        if self.objective.mode == Mode::Time {
            return needs("objective.mode", self.objective.mode.name());
        }
        Ok(())
    }
}

/// Platform and task with every value checked. Made by [`StudyConfig::check`].
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedConfig {
    config: StudyConfig,
    test: Test,
    aims: Aims,
}

impl CheckedConfig {
    /// The configuration, as result documents embed it.
    pub fn config(&self) -> &StudyConfig {
        &self.config
    }
    /// The test, its platform in SI.
    pub fn test(&self) -> &Test {
        &self.test
    }
    /// The same in the middle of a test, see [`Test::interrupted_after`].
    ///
    /// # Errors
    ///
    /// As there.
    pub(crate) fn interrupted_after(mut self, done: Schedule) -> Result<Self> {
        self.test = self.test.interrupted_after(done)?;
        Ok(self)
    }
    /// Lets a search use so many positions, if that is more.
    pub(crate) fn allow_positions(&mut self, count: usize) {
        let most = self.config.search.max_positions.get_or_insert(count);
        *most = count.clamp(*most, (*most).max(crate::search::given::MOST_POSITIONS));
    }
    /// What is to be achieved.
    pub fn objective(&self) -> &ObjectiveConfig {
        &self.config.objective
    }
    /// How to search.
    pub fn search(&self) -> &SearchConfig {
        &self.config.search
    }
    /// The weight of each coefficient's variance in criterion `a`.
    pub fn weights(&self) -> &CoefficientVector {
        &self.aims.weights
    }
    /// The 1σ specification of each coefficient, °/h (per g), infinite for those without one;
    /// `None` when nothing is specified.
    pub fn spec_deg_per_h(&self) -> Option<&CoefficientVector> {
        self.aims.spec_deg_per_h.as_ref()
    }
    /// The same for other parameters.
    pub(crate) fn aims(&self) -> &Aims {
        &self.aims
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drift::DriftCoefficient;
    use crate::platform::{AxisValue, ErrorTable, ForbiddenConfig, GSensitivePrior, OutputAxis};
    use crate::testing::assert_refused_by_key;
    use std::collections::BTreeSet;

    #[test]
    fn the_default_is_valid_and_says_its_random_drift() {
        let study = StudyConfig::default().check().unwrap();
        assert_eq!(
            study.config().platform.gyro.random_drift_deg_per_h,
            Some(0.01)
        );
        assert_eq!(study.spec_deg_per_h(), None);
        assert_eq!(
            study.test().platform(),
            &PlatformConfig::default().check().unwrap()
        );
    }

    #[test]
    fn each_value_out_of_range_is_refused_by_key() {
        type Spoil = fn(&mut StudyConfig);
        let table: [(&str, Spoil); 30] = [
            ("test.title", |c| c.test.title = Some(" ".to_owned())),
            ("test.serial", |c| {
                c.test.serial = Some("1\u{1b}[2J".to_owned())
            }),
            ("test.note", |c| c.test.note = Some("x".repeat(201))),
            ("site.latitude_deg", |c| c.platform.site.latitude_deg = 91.0),
            ("objective.total_time_s", |c| c.objective.total_time_s = 0.0),
            ("objective.total_time_s", |c| {
                c.objective.total_time_s = -1.0
            }),
            ("objective.total_time_s", |c| {
                c.objective.total_time_s = 1.1e7
            }),
            ("objective.total_time_s", |c| {
                c.objective.total_time_s = f64::NAN
            }),
            ("objective.total_time_s", |c| {
                c.objective.total_time_s = 59.0
            }),
            ("objective.total_time_s", |c| {
                c.platform.motion.min_dwell_s = 0.0;
                c.objective.total_time_s = 9.0;
            }),
            ("motion.min_dwell_s", |c| {
                c.platform.motion.min_dwell_s = 60_000.0;
            }),
            ("objective.criterion", |c| {
                c.objective.criterion = CriterionKind::MaxRatio;
            }),
            ("objective.mode", |c| c.objective.mode = Mode::Time),
            ("objective.score.covariance_weight", |c| {
                c.objective.score.covariance_weight = -1.0;
            }),
            ("objective.score.covariance_weight", |c| {
                c.objective.score.covariance_weight = 0.0;
                c.objective.score.separability_weight = 0.0;
            }),
            ("objective.score.separability_weight", |c| {
                c.objective.score.separability_weight = f64::INFINITY;
            }),
            ("objective.score.convergence_weight", |c| {
                c.objective.score.convergence_weight = f64::NAN;
            }),
            ("objective.spec.default", |c| {
                c.objective.spec = PerCoefficient::all(-1.0);
            }),
            ("objective.score.minimum_separability", |c| {
                c.objective.score.minimum_separability = 1.5;
            }),
            ("objective.spec_deg_per_h.default", |c| {
                c.objective.spec_deg_per_h = PerCoefficient::all(0.0);
            }),
            ("objective.spec_deg_per_h.D_OY", |c| {
                let spec = &mut c.objective.spec_deg_per_h;
                spec.coefficients.insert(DriftCoefficient::OY, f64::NAN);
            }),
            ("search.max_positions", |c| c.search.max_positions = Some(0)),
            ("search.max_positions", |c| {
                c.search.max_positions = Some(501)
            }),
            ("search.starts", |c| c.search.starts = 0),
            ("search.starts", |c| c.search.starts = 1_000_001),
            ("search.position_tolerance", |c| {
                c.search.position_tolerance = -0.1
            }),
            ("search.position_tolerance", |c| {
                c.search.position_tolerance = f64::NAN
            }),
            ("search.threads", |c| c.search.threads = Some(0)),
            ("search.time_limit_s", |c| c.search.time_limit_s = Some(0.0)),
            ("search.time_limit_s", |c| {
                c.search.time_limit_s = Some(f64::NAN)
            }),
        ];
        for (key, spoil) in table {
            let mut config = StudyConfig::default();
            spoil(&mut config);
            let error = config.check().unwrap_err();
            assert_refused_by_key(&error, key);
        }
    }

    #[test]
    fn a_specification_makes_time_and_ratio_possible() {
        let mut config = StudyConfig::default();
        config.objective.mode = Mode::Time;
        config.objective.criterion = CriterionKind::MaxRatio;
        config.objective.spec_deg_per_h = PerCoefficient::all(0.005);
        let study = config.check().unwrap();
        assert_eq!(study.spec_deg_per_h().unwrap()[11], 0.005);
    }

    fn every_error() -> ErrorTable {
        let mut table = serde_json::Map::new();
        for group in crate::model::optional_groups() {
            table.insert(group.key.to_owned(), 1.0.into());
        }
        let mut table: ErrorTable = serde_json::from_value(table.into()).unwrap();
        for group in crate::model::optional_groups() {
            let names = group.names.iter().map(|name| ((*name).to_owned(), 1.0));
            table.parameter.extend(names);
        }
        table
    }

    /// A configuration with something at every key.
    fn full() -> StudyConfig {
        let mut c = StudyConfig::default();
        c.search.max_positions = Some(24);
        let text = || Some("text".to_owned());
        c.test = TestConfig {
            title: text(),
            serial: text(),
            stand: text(),
            operator: text(),
            note: text(),
        };
        c.platform.gyro.angle_random_walk_deg_per_sqrt_h = Some(1.0);
        let one = AxisValue::All(1.0);
        c.platform.prior.g_sensitive_drift_deg_per_h_per_g = GSensitivePrior::PerAxis {
            input: one,
            output: one,
            spin: one,
        };
        let gimbals = &mut c.platform.gimbals;
        gimbals.alpha_deg = Some([0.0, 1.0]);
        gimbals.beta_deg = Some([0.0, 1.0]);
        gimbals.gamma_deg = Some([0.0, 1.0]);
        gimbals.step_deg = Some(1.0);
        gimbals.axes = Some(["-x", "-y", "-z"].map(str::to_owned));
        gimbals.forbidden = vec![ForbiddenConfig::new([None, Some([80.0, 100.0]), None])];
        gimbals.max_winding_deg = Some([720.0; 3]);
        gimbals.allowed = Some("positions.csv".into());
        c.platform.stand.heading_deg = Some(0.0);
        c.platform.stand.tilt_deg = Some([0.0; 2]);
        let axis = |name: &str| Some(OutputAxis::Named(name.to_owned()));
        let output = &mut c.platform.gyro.output_axis;
        (output.x, output.y, output.z) = (axis("+y"), axis("+z"), axis("+x"));
        c.platform.azimuth.noise_arcsec = Some(5.0);
        let gyro = &mut c.platform.gyro;
        gyro.rate_random_walk_deg_per_h_per_sqrt_h = Some(1e-3);
        gyro.bias_instability_deg_per_h = Some(3e-3);
        gyro.bias_correlation_time_s = Some(3600.0);
        let accelerometer = &mut c.platform.accelerometer;
        accelerometer.noise_density_ug_per_sqrt_hz = Some(30.0);
        accelerometer.acceleration_random_walk_ug_per_sqrt_h = Some(1.0);
        accelerometer.bias_instability_ug = Some(3.0);
        accelerometer.bias_correlation_time_s = Some(1800.0);
        let errors = &mut c.platform.errors;
        errors.estimated = every_error();
        errors.considered = every_error();
        c.platform.motion.slew_rate_deg_per_s = Some(1.0.into());
        c.platform.motion.acceleration_deg_per_s2 = Some(1.0.into());
        c.platform.motion.start_deg = Some([0.0; 3]);
        c.objective.spec_deg_per_h = PerCoefficient {
            default: Some(1.0),
            coefficients: DriftCoefficient::ALL.map(|c| (c, 1.0)).into(),
            others: Default::default(),
        };
        let names = crate::model::optional_groups().flat_map(|g| g.names);
        c.objective.spec = PerCoefficient {
            others: names.map(|name| (*name, 1.0)).collect(),
            ..c.objective.spec_deg_per_h.clone()
        };
        c.objective.weights = c.objective.spec.clone();
        c.objective.use_profile = Some("flight.csv".into());
        c.objective.accept_unobservable = vec![DriftCoefficient::IZ];
        c.search.threads = Some(1);
        c.search.time_limit_s = Some(1.0);
        c
    }

    fn leaves(path: &str, value: &serde_json::Value, into: &mut BTreeSet<String>) {
        match value {
            serde_json::Value::Object(map) => {
                for (key, value) in map {
                    let path = if path.is_empty() {
                        key.clone()
                    } else {
                        format!("{path}.{key}")
                    };
                    leaves(&path, value, into);
                }
            }
            _ => {
                into.insert(path.to_owned());
            }
        }
    }

    #[test]
    fn the_table_of_keys_is_what_a_configuration_holds() {
        let mut found = BTreeSet::new();
        let default = StudyConfig::default();
        leaves("", &serde_json::to_value(full()).unwrap(), &mut found);
        leaves("", &serde_json::to_value(&default).unwrap(), &mut found);
        let known: BTreeSet<_> = keys::KNOWN.iter().map(|(k, _)| k.clone()).collect();
        assert_eq!(found, known);
        assert_eq!(known.len(), keys::KNOWN.len(), "a key is listed twice");
    }

    #[test]
    fn a_configuration_reads_back_from_json() {
        for config in [full(), StudyConfig::default()] {
            let json = serde_json::to_string(&config).unwrap();
            assert_eq!(serde_json::from_str::<StudyConfig>(&json).unwrap(), config);
        }
    }
}
