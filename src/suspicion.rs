//! Numbers that are allowed but hard to believe: radians under a key in degrees, minutes under one
//! in seconds, an instrument quieter than any that exists.
//!
//! Everything a person gives (platform file, options, schedules) is looked at here and nowhere
//! else. What is found never changes a result: a [`Warning`] names the value, what it looks like
//! and what to write if that is what was meant. Commands say it on the error stream, documents
//! carry it in `warnings`, and the report begins with it.
//!
//! A warning that cries wolf is not read, so every rule has a margin: what a stand could plausibly
//! have is on the quiet side of it. The rules and the reasons of their limits are in [`rules`].
//!
//! ```
//! use scheme_opt::internals::config::StudyConfig;
//! use scheme_opt::internals::suspicion::{self, Suspicion};
//! let mut config = StudyConfig::default();
//! assert!(suspicion::of(&config, &[], None).is_empty());
//! config.platform.site.latitude_deg = 0.4922;
//! let found = suspicion::of(&config, &[], None);
//! assert_eq!(found[0].key, "site.latitude_deg");
//! assert!(matches!(found[0].suspicion, Suspicion::Radians { .. }));
//! assert!(found[0].to_string().contains("0.4922 rad is 28.20 deg"));
//! ```

pub mod rules;
mod schedules;
mod wandering;
mod warning;

use crate::config::StudyConfig;
use crate::schedule::Schedule;
pub use wandering::Wandering;
pub use warning::{NoiseSource, Rescaled, Suspicion, TimeUnit, Warning, WarningRecord};

/// What is hard to believe of a study, of whose keys `defaulted` were not given, and of a schedule
/// for it.
pub fn of(config: &StudyConfig, defaulted: &[String], schedule: Option<&Schedule>) -> Vec<Warning> {
    let mut found = rules::study(config, defaulted);
    found.extend(
        schedule
            .into_iter()
            .flat_map(|s| schedules::schedule(s, config)),
    );
    found
}

/// The same of a schedule alone.
pub fn of_schedule(schedule: &Schedule, config: &StudyConfig) -> Vec<Warning> {
    schedules::schedule(schedule, config)
}

#[cfg(test)]
#[path = "suspicion/tests.rs"]
mod tests;
