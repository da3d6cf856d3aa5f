//! From a platform file and options to a checked study.

use std::path::Path;

use crate::config::{CheckedConfig, StudySource};
use crate::error::{Error, Result};
use crate::motion::Timeline;
use crate::schedule::{Schedule, file};
use crate::study::Study;
use crate::suspicion::{self, Warning};

use super::args::{Common, Given};
use super::output::Output;

/// A value of the study that an option may replace.
struct Override {
    /// Dotted key of the study.
    key: &'static str,
    /// Option that replaces it.
    option: &'static str,
    /// Whether the option was given.
    given: bool,
}

/// Puts the value of an option, if it was given, into its place in the study.
fn put<T>(slot: &mut T, value: Option<T>, key: &'static str, option: &'static str) -> Override {
    let given = value.is_some();
    if let Some(value) = value {
        *slot = value;
    }
    Override { key, option, given }
}

/// The study of `platform` (none: the built-in one) with the options in their place.
///
/// `starts` is the option of that name, which only a search has.
pub(super) fn load(
    platform: Option<&Path>,
    common: &Common,
    starts: Option<usize>,
) -> Result<Study> {
    load_and(StudySource::check, platform, common, starts)
}

/// The same for a command that is given its schedule: what limits a search may be at odds.
pub(super) fn load_for_evaluation(platform: Option<&Path>, common: &Common) -> Result<Study> {
    load_and(StudySource::check_for_evaluation, platform, common, None)
}

type Check = fn(&StudySource) -> Result<CheckedConfig>;

fn load_and(
    check: Check,
    platform: Option<&Path>,
    common: &Common,
    starts: Option<usize>,
) -> Result<Study> {
    let mut source = source(platform)?;
    let (objective, search) = (&mut source.config.objective, &mut source.config.search);
    let overrides = [
        put(&mut objective.mode, common.mode, "objective.mode", "--mode"),
        put(
            &mut objective.criterion,
            common.criterion,
            "objective.criterion",
            "--criterion",
        ),
        put(
            &mut objective.total_time_s,
            common.total_time_s,
            "objective.total_time_s",
            "--total-time-s",
        ),
        put(
            &mut search.max_positions,
            common.max_positions.map(Some),
            "search.max_positions",
            "--max-positions",
        ),
        put(&mut search.seed, common.seed, "search.seed", "--seed"),
        put(&mut search.starts, starts, "search.starts", "--starts"),
        put(
            &mut search.threads,
            common.threads.map(Some),
            "search.threads",
            "--threads",
        ),
        put(
            &mut search.time_limit_s,
            common.time_limit_s.map(Some),
            "search.time_limit_s",
            "--time-limit-s",
        ),
    ];
    checked(
        source,
        &overrides,
        check,
        Output::new(common.messages.quiet),
    )
}

/// A schedule that somebody gave, on the platform it is for.
pub(super) struct GivenSchedule {
    pub study: Study,
    pub schedule: Schedule,
    pub timeline: Timeline,
}

/// Reads platform and schedule, and puts the one on the other.
pub(super) fn given_schedule(given: &Given, common: &Common) -> Result<GivenSchedule> {
    let study = load_for_evaluation(given.platform.as_deref(), common)?;
    let (schedule, timeline) = on_platform(&given.schedule, &study)?;
    let output = Output::new(common.messages.quiet);
    warn_of_schedule(&given.schedule, &schedule, &study, output);
    Ok(GivenSchedule {
        study,
        schedule,
        timeline,
    })
}

/// The schedule of a file, resolved on the study's platform.
pub(super) fn on_platform(path: &Path, study: &Study) -> Result<(Schedule, Timeline)> {
    file::read_and(path, &|schedule| Timeline::new(study.test(), schedule))
}

/// Says what is hard to believe of a schedule that was read from `file`.
pub(super) fn warn_of_schedule(file: &Path, schedule: &Schedule, study: &Study, output: Output) {
    warn(
        &suspicion::of_schedule(schedule, study.config()),
        Some(file),
        output,
    );
}

/// Says what is hard to believe.
pub(super) fn warn(warnings: &[Warning], file: Option<&Path>, output: Output) {
    let file = file.map_or_else(String::new, |f| format!("{}: ", f.display()));
    for warning in warnings {
        output.message(&format!("warning: {file}{warning}"));
    }
}

/// The study of `platform` with another total time.
pub(super) fn load_with_total_time(
    platform: Option<&Path>,
    total_time_s: Option<f64>,
    output: Output,
) -> Result<Study> {
    let mut source = source(platform)?;
    let total_time = put(
        &mut source.config.objective.total_time_s,
        total_time_s,
        "objective.total_time_s",
        "--total-time-s",
    );
    checked(source, &[total_time], StudySource::check, output)
}

fn source(platform: Option<&Path>) -> Result<StudySource> {
    match platform {
        Some(path) => StudySource::read(path),
        None => Ok(StudySource::embedded_default()),
    }
}

fn checked(
    mut source: StudySource,
    overrides: &[Override],
    check: Check,
    output: Output,
) -> Result<Study> {
    for o in overrides.iter().filter(|o| o.given) {
        source.override_key(o.key);
    }
    let checked = check(&source).map_err(|e| name_option(e, overrides))?;
    let warnings = suspicion::of(checked.config(), source.defaulted(), None);
    let (of_options, of_file): (Vec<Warning>, Vec<Warning>) = warnings
        .into_iter()
        .partition(|w| overrides.iter().any(|o| o.given && o.key == w.key));
    warn(&of_file, source.file(), output);
    warn(&of_options, None, output);
    Study::from_source(source)
}

/// Says which option a refused number came from.
fn name_option(error: Error, overrides: &[Override]) -> Error {
    let culprit = overrides
        .iter()
        .find(|o| o.given && error.key() == Some(o.key));
    match culprit {
        // These two already carry advice: they are names, refused for what else is missing.
        Some(o) if !matches!(o.option, "--mode" | "--criterion") => {
            error.with_hint(format!("the value is that of the option {}", o.option))
        }
        _ => error,
    }
}
