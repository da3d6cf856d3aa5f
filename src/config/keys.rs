//! The keys of a platform file: the one place that lists them.

use std::sync::LazyLock;

use super::{CriterionKind, Mode};
use crate::drift::DriftCoefficient;
use crate::model;

/// What leaving a key out means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Absent {
    /// A value is assumed (a number, or "unlimited"), which a reader of results should know.
    Assumed,
    /// Nothing: the key is an alternative form or an addition.
    Nothing,
}

use Absent::{Assumed, Nothing};

/// Every key in dotted form, in the order of the file.
pub(super) static KNOWN: LazyLock<Vec<(String, Absent)>> = LazyLock::new(|| {
    let own = |(key, absent): &(&str, Absent)| ((*key).to_owned(), *absent);
    let errors = ["errors", "errors.considered"]
        .into_iter()
        .flat_map(error_keys);
    let errors = errors.map(|key| (key, Nothing));
    let test = OF_THE_TEST.iter().map(|key| ((*key).to_owned(), Nothing));
    let platform = test.chain(OF_THE_PLATFORM.iter().map(own));
    // The tables with a number per parameter stand behind what else there is in [objective].
    let (objective, rest): (Vec<_>, Vec<_>) = OF_THE_TASK
        .iter()
        .map(own)
        .partition(|(key, _)| key.starts_with("objective."));
    let per_parameter = per_parameter().map(|key| (key, Nothing));
    platform
        .chain(errors)
        .chain(objective)
        .chain(per_parameter)
        .chain(rest)
        .collect()
});

/// Keys of the tables with a number per parameter.
fn per_parameter() -> impl Iterator<Item = String> {
    let coefficients = || DriftCoefficient::ALL.map(|c| c.name()).into_iter();
    let others = || model::optional_groups().flat_map(|g| g.names).copied();
    let in_table = |table: &'static str, all: bool| {
        let others = others().filter(move |_| all);
        let names = ["default"].into_iter().chain(coefficients()).chain(others);
        names.map(move |name| format!("objective.{table}.{name}"))
    };
    in_table("weights", true)
        .chain(in_table("spec", true))
        .chain(in_table("spec_deg_per_h", false))
}

/// Keys of a table of errors.
fn error_keys(table: &str) -> impl Iterator<Item = String> {
    let groups = model::optional_groups().map(move |g| format!("{table}.{}", g.key));
    let names = model::optional_groups().flat_map(|g| g.names);
    groups.chain(names.map(move |name| format!("{table}.parameter.{name}")))
}

/// Keys that say whose test it is.
const OF_THE_TEST: &[&str] = &[
    "test.title",
    "test.serial",
    "test.stand",
    "test.operator",
    "test.note",
];

/// Keys of the platform but for its errors.
const OF_THE_PLATFORM: &[(&str, Absent)] = &[
    ("site.latitude_deg", Assumed),
    (NOISE, Assumed),
    (NOISE_DENSITY, Nothing),
    (
        "accelerometer.acceleration_random_walk_ug_per_sqrt_h",
        Nothing,
    ),
    ("accelerometer.bias_instability_ug", Nothing),
    ("accelerometer.bias_correlation_time_s", Nothing),
    (RANDOM_DRIFT, Assumed),
    (RANDOM_WALK, Nothing),
    ("gyro.rate_random_walk_deg_per_h_per_sqrt_h", Nothing),
    ("gyro.bias_instability_deg_per_h", Nothing),
    ("gyro.bias_correlation_time_s", Nothing),
    ("gyro.output_axis.X", Nothing),
    ("gyro.output_axis.Y", Nothing),
    ("gyro.output_axis.Z", Nothing),
    ("filter.period_s", Assumed),
    ("prior.misalignment_deg", Assumed),
    ("prior.constant_drift_deg_per_h", Assumed),
    ("prior.g_sensitive_drift_deg_per_h_per_g", Assumed),
    ("prior.g_sensitive_drift_deg_per_h_per_g.input", Nothing),
    ("prior.g_sensitive_drift_deg_per_h_per_g.output", Nothing),
    ("prior.g_sensitive_drift_deg_per_h_per_g.spin", Nothing),
    ("gimbals.alpha_deg", Assumed),
    ("gimbals.beta_deg", Assumed),
    ("gimbals.gamma_deg", Assumed),
    ("gimbals.step_deg", Assumed),
    ("gimbals.forbidden", Nothing),
    ("gimbals.max_winding_deg", Nothing),
    ("gimbals.allowed", Nothing),
    ("gimbals.axes", Nothing),
    ("stand.heading_deg", Nothing),
    ("stand.tilt_deg", Nothing),
    ("motion.repositioning", Assumed),
    ("motion.slew_rate_deg_per_s", Assumed),
    ("motion.acceleration_deg_per_s2", Nothing),
    ("motion.settle_s", Assumed),
    ("motion.measure_moves", Assumed),
    ("motion.min_dwell_s", Assumed),
    ("motion.start_deg", Nothing),
    ("motion.return_to_start", Assumed),
    ("azimuth.noise_arcsec", Nothing),
];

/// Keys of the task.
const OF_THE_TASK: &[(&str, Absent)] = &[
    ("objective.mode", Assumed),
    ("objective.criterion", Assumed),
    ("objective.total_time_s", Assumed),
    ("objective.use", Nothing),
    ("objective.score.covariance_weight", Assumed),
    ("objective.score.separability_weight", Assumed),
    ("objective.score.convergence_weight", Assumed),
    ("objective.score.minimum_separability", Assumed),
    ("objective.accept_unobservable", Nothing),
    ("search.max_positions", Assumed),
    ("search.allow_tumbling", Assumed),
    ("search.seed", Assumed),
    ("search.starts", Assumed),
    ("search.position_tolerance", Assumed),
    ("search.front_points", Assumed),
    ("search.threads", Nothing),
    ("search.time_limit_s", Nothing),
];

/// The noise of the accelerometers, of which [`NOISE_DENSITY`] is another form.
pub(super) const NOISE: &str = "accelerometer.noise_g";
/// The noise of the accelerometers as a density.
pub(super) const NOISE_DENSITY: &str = "accelerometer.noise_density_ug_per_sqrt_hz";
/// The random drift of the gyros, of which [`RANDOM_WALK`] is another form.
pub(super) const RANDOM_DRIFT: &str = "gyro.random_drift_deg_per_h";
/// The random drift of the gyros as an angle random walk.
pub(super) const RANDOM_WALK: &str = "gyro.angle_random_walk_deg_per_sqrt_h";

/// True when a value can be given for this key.
pub(super) fn is_value(path: &str) -> bool {
    KNOWN.iter().any(|(key, _)| key == path)
}

/// True when keys can be given inside this one.
pub(super) fn is_table(path: &str) -> bool {
    KNOWN.iter().any(|(key, _)| inside(path, key).is_some())
}

/// The names that can be given inside the table `path` (empty: the whole file).
pub(super) fn names_in(path: &str) -> Vec<&'static str> {
    let rest = KNOWN.iter().filter_map(|(key, _)| inside(path, key));
    let mut names: Vec<_> = rest.filter_map(|rest| rest.split('.').next()).collect();
    names.dedup();
    names
}

/// A known key whose last part is `name`, wherever it is; of several the one that has most in common
/// with the table `path`.
pub(super) fn elsewhere(path: &str, name: &str) -> Option<&'static str> {
    let common = |key: &str| {
        key.bytes()
            .zip(path.bytes())
            .take_while(|(a, b)| a == b)
            .count()
    };
    let keys = KNOWN.iter().map(|(key, _)| key.as_str());
    let named = keys.filter(|key| key.rsplit('.').next() == Some(name));
    // The first of equals.
    named.reduce(|best, key| match common(key) > common(best) {
        true => key,
        false => best,
    })
}

/// The part of `key` below the table `path`.
fn inside(path: &str, key: &'static str) -> Option<&'static str> {
    if path.is_empty() {
        return Some(key);
    }
    key.strip_prefix(path)?.strip_prefix('.')
}

/// The names to choose from, for keys that are such a choice.
pub(super) fn choices(path: &str) -> Option<Vec<&'static str>> {
    match path {
        "objective.mode" => Some(Mode::ALL.map(Mode::name).to_vec()),
        "objective.criterion" => Some(CriterionKind::ALL.map(CriterionKind::name).to_vec()),
        "motion.repositioning" => Some(vec!["slew", "frame-hold"]),
        "objective.accept_unobservable" => Some(DriftCoefficient::ALL.map(|c| c.name()).to_vec()),
        _ => None,
    }
}

/// True when any number of names can be given for this key.
pub(super) fn is_list(path: &str) -> bool {
    path == "objective.accept_unobservable"
}

/// What is given for a key whose type the reader has no words for.
pub(super) fn example(path: &str) -> Option<&'static str> {
    match path {
        "gimbals.forbidden" => {
            Some("a list of boxes, such as [ { beta_deg = [80, 100] } ], each angle [low, high]")
        }
        "gimbals.allowed" => Some("the name of a CSV file, in quotes"),
        _ => None,
    }
}

/// How many elements an array has that is given for this key, and what they are.
pub(super) fn array_shape(path: &str) -> Option<(usize, &'static str)> {
    if path == "gimbals.axes" {
        Some((3, "three axes such as [\"-x\", \"-y\", \"-z\"]"))
    } else if path == "stand.tilt_deg" {
        Some((2, "two angles [about x, about z]"))
    } else if matches!(
        path,
        "gimbals.alpha_deg" | "gimbals.beta_deg" | "gimbals.gamma_deg"
    ) {
        Some((2, "two numbers [low, high]"))
    } else if matches!(path, "gimbals.max_winding_deg" | "motion.start_deg") {
        Some((3, "three angles [alpha, beta, gamma]"))
    } else if path.starts_with("gyro.output_axis.") {
        Some((3, "an axis such as \"-z\", or a unit vector [x, y, z]"))
    } else if path.starts_with("prior.") || is_by_instrument(path) {
        Some((3, "a number, or three: [x, y, z]"))
    } else {
        None
    }
}

/// True for errors that can be given instrument by instrument.
fn is_by_instrument(path: &str) -> bool {
    let Some(rest) = path.strip_prefix("errors.") else {
        return false;
    };
    let key = rest.strip_prefix("considered.").unwrap_or(rest);
    let mut groups = model::optional_groups();
    groups.any(|g| g.key == key && g.names.len() > 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_tells_tables_from_values() {
        assert!(is_table("objective") && is_table("objective.score"));
        assert!(is_table("prior.g_sensitive_drift_deg_per_h_per_g"));
        assert!(is_value("prior.g_sensitive_drift_deg_per_h_per_g"));
        assert!(!is_table("site.latitude_deg") && !is_value("site") && !is_table("sit"));
        assert_eq!(
            names_in(""),
            [
                "test",
                "site",
                "accelerometer",
                "gyro",
                "filter",
                "prior",
                "gimbals",
                "stand",
                "motion",
                "azimuth",
                "errors",
                "objective",
                "search"
            ]
        );
        assert_eq!(names_in("filter"), ["period_s"]);
        assert_eq!(elsewhere("", "latitude_deg"), Some("site.latitude_deg"));
        let spec = elsewhere("objective.spec_deg_per_h", "T_XX");
        assert_eq!(spec, Some("objective.spec.T_XX"));
        assert_eq!(elsewhere("", "site"), None);
    }
}
