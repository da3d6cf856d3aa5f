//! Platform files with plausible numbers for instruments of a grade: where to start from.

use std::fmt::Write as _;

use super::DEFAULT_TOML;
use super::tables::by_name;
use crate::error::Result;

/// How good the instruments are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Grade {
    /// Gyros of degrees per hour, accelerometers of a milli-g.
    Tactical,
    /// Gyros of hundredths of a degree per hour, accelerometers of a tenth of a milli-g.
    Navigation,
    /// Gyros of a thousandth of a degree per hour and better, accelerometers of micro-g.
    Strategic,
}

/// What the default file says of a key that is left out, and what a file of a grade does.
const SHOWN_HERE: &str = "the value shown here";
const SHOWN_ELSEWHERE: &str = "the value that `init` without a grade shows";

/// A key of the platform file (table and name) with its values for the three grades.
type Line = (&'static str, &'static str, [f64; 3]);

/// What every file of a grade says.
const INSTRUMENTS: [Line; 7] = [
    ("accelerometer", "noise_g", [1e-4, 1e-5, 1e-6]),
    (
        "gyro",
        "angle_random_walk_deg_per_sqrt_h",
        [0.1, 0.002, 1e-4],
    ),
    ("prior", "misalignment_deg", [0.5, 0.1, 0.02]),
    ("prior", "constant_drift_deg_per_h", [10.0, 0.5, 0.05]),
    (
        "prior",
        "g_sensitive_drift_deg_per_h_per_g",
        [10.0, 0.5, 0.05],
    ),
    ("motion", "slew_rate_deg_per_s", [5.0, 2.0, 1.0]),
    ("motion", "settle_s", [10.0, 20.0, 30.0]),
];

/// What it says of the full error model too.
const ERRORS: [Line; 9] = [
    ("errors", "torquer_scale_factor_ppm", [1000.0, 300.0, 50.0]),
    ("errors", "torquer_misalignment_arcsec", [120.0, 30.0, 5.0]),
    (
        "errors",
        "quadratic_drift_deg_per_h_per_g2",
        [0.5, 0.05, 0.005],
    ),
    ("errors", "accelerometer_bias_ug", [1000.0, 100.0, 10.0]),
    (
        "errors",
        "accelerometer_scale_factor_ppm",
        [1000.0, 150.0, 20.0],
    ),
    (
        "errors",
        "accelerometer_misalignment_arcsec",
        [120.0, 30.0, 5.0],
    ),
    (
        "errors",
        "accelerometer_second_order_ug_per_g2",
        [100.0, 20.0, 2.0],
    ),
    (
        "errors",
        "accelerometer_third_order_ug_per_g3",
        [30.0, 5.0, 0.5],
    ),
    (
        "errors",
        "accelerometer_cross_coupling_ug_per_g2",
        [100.0, 20.0, 2.0],
    ),
];

/// What it shows, commented out, of noise that wanders: such keys are read from an Allan deviation of the
/// instrument at hand (docs/allan.md), and no grade vouches for them.
const WANDERING: [Line; 7] = [
    (
        "accelerometer",
        "noise_density_ug_per_sqrt_hz",
        [300.0, 30.0, 3.0],
    ),
    (
        "accelerometer",
        "acceleration_random_walk_ug_per_sqrt_h",
        [30.0, 3.0, 0.1],
    ),
    ("accelerometer", "bias_instability_ug", [100.0, 10.0, 0.5]),
    (
        "gyro",
        "rate_random_walk_deg_per_h_per_sqrt_h",
        [0.5, 0.003, 1e-4],
    ),
    ("gyro", "bias_instability_deg_per_h", [1.0, 0.003, 2e-4]),
    ("gyro", "bias_correlation_time_s", [600.0, 1800.0, 3600.0]),
    (
        "accelerometer",
        "bias_correlation_time_s",
        [600.0, 1800.0, 3600.0],
    ),
];

impl Grade {
    /// All grades.
    pub const ALL: [Self; 3] = [Self::Tactical, Self::Navigation, Self::Strategic];

    /// The name used on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tactical => "tactical",
            Self::Navigation => "navigation",
            Self::Strategic => "strategic",
        }
    }

    /// The grade of that name.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`](crate::Error::is_input) listing the names, with the nearest one as a hint.
    pub fn from_name(name: &str) -> Result<Self> {
        by_name("--grade", name, &Self::ALL.map(|g| (g.name(), g)))
    }

    /// The commented platform file; `full`: with the full error model.
    ///
    /// ```
    /// use scheme_opt::internals::config::{Grade, StudySource};
    /// let text = Grade::Navigation.platform_file(true);
    /// let study = StudySource::parse(&text, None)?.check()?;
    /// assert!(study.test().platform().errors().parameters().len() > 12);
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn platform_file(self, full: bool) -> String {
        let mut text = String::new();
        let _ = writeln!(
            text,
            "# Plausible numbers for instruments of {} grade, to be replaced by your own{}.\n#",
            self.name(),
            match full {
                true => ", with the full error model",
                false => "",
            }
        );
        let errors: &'static [Line] = if full { &ERRORS } else { &[] };
        let mut table = String::new();
        for line in DEFAULT_TOML.lines() {
            if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
                name.clone_into(&mut table);
            }
            let find = |lines: &'static [Line]| {
                let mut lines = lines.iter().filter(|(of, ..)| *of == table);
                lines.find(|(_, key, _)| is_line_of(line, key))
            };
            let given = find(&INSTRUMENTS).or_else(|| find(errors));
            let value = |values: &[f64; 3]| values[self as usize];
            let _ = match (given, find(&WANDERING)) {
                (Some((_, key, values)), _) => writeln!(text, "{key} = {:?}", value(values)),
                (None, Some((_, key, values))) => writeln!(text, "# {key} = {:?}", value(values)),
                // Given in another form.
                _ if is_line_of(line, "random_drift_deg_per_h") => writeln!(text, "# {line}"),
                // The default of a key is not this file's value for it.
                _ => writeln!(text, "{}", line.replace(SHOWN_HERE, SHOWN_ELSEWHERE)),
            };
        }
        text
    }
}

/// Whether `line` gives `key` a value, commented out or not.
fn is_line_of(line: &str, key: &str) -> bool {
    let line = line.strip_prefix("# ").unwrap_or(line);
    let rest = line.strip_prefix(key);
    rest.is_some_and(|rest| rest.starts_with(" = "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::StudySource;

    #[test]
    fn every_file_has_the_numbers_of_its_grade() {
        for (at, grade) in Grade::ALL.into_iter().enumerate() {
            assert_eq!(Grade::from_name(grade.name()), Ok(grade));
            for full in [false, true] {
                let text = grade.platform_file(full);
                let source = StudySource::parse(&text, None).unwrap();
                source.check().unwrap();
                assert!(text.contains(SHOWN_ELSEWHERE) && !text.contains(SHOWN_HERE));
                let json = serde_json::to_value(&source.config).unwrap();
                for (table, key, values) in INSTRUMENTS {
                    let found = json[table][key].as_f64();
                    assert_eq!(found, Some(values[at]), "{table}.{key}");
                }
                for (_, key, values) in WANDERING {
                    let line = format!("\n# {key} = {:?}\n", values[at]);
                    assert!(text.contains(&line), "{line}");
                }
                for (table, key, values) in ERRORS {
                    let expected = full.then_some(values[at]);
                    assert_eq!(json[table][key].as_f64(), expected, "{table}.{key}");
                }
            }
        }
    }
}
