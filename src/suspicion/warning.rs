//! What is hard to believe, and its words.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::wandering::Wandering;
use crate::wording::number;

/// A unit of time that seconds are mistaken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeUnit {
    /// 0.001 s.
    Milliseconds,
    /// 60 s.
    Minutes,
    /// 3600 s.
    Hours,
}

impl TimeUnit {
    /// How many seconds it has.
    pub const fn seconds(self) -> f64 {
        match self {
            Self::Milliseconds => 1e-3,
            Self::Minutes => 60.0,
            Self::Hours => 3600.0,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Milliseconds => "milliseconds",
            Self::Minutes => "minutes",
            Self::Hours => "hours",
        }
    }

    const fn symbol(self) -> &'static str {
        match self {
            Self::Milliseconds => "ms",
            Self::Minutes => "min",
            Self::Hours => "h",
        }
    }
}

/// What noise a suspicion is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoiseSource {
    /// White noise of the accelerometers.
    Accelerometer,
    /// Random drift of the gyros.
    Gyro,
}

impl NoiseSource {
    const fn best(self) -> &'static str {
        match self {
            Self::Accelerometer => "a strategic-grade accelerometer (0.1 micro-g)",
            Self::Gyro => "a navigation-grade gyro (0.002 deg/sqrt(h))",
        }
    }

    const fn worst(self) -> &'static str {
        match self {
            Self::Accelerometer => "the bias of a navigation-grade accelerometer (100 micro-g)",
            Self::Gyro => "a consumer-grade gyro (3 deg/sqrt(h))",
        }
    }
}

/// A noise that a default has per filter period, before and after the period changed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rescaled {
    /// The default, per period.
    pub per_period: f64,
    /// What it means with the default period: g/√Hz, or °/√h.
    pub meant: f64,
    /// What it means with the period given.
    pub means: f64,
    /// What to give for the same instrument.
    pub same_instrument: f64,
}

/// What a value looks like, and the numbers that say so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Suspicion {
    /// An angle in radians.
    Radians {
        /// The largest of the angles, as given.
        given: f64,
        /// The same if it is in radians, degrees.
        degrees: f64,
    },
    /// All angles of a schedule in radians.
    ScheduleInRadians {
        /// The largest angle, as given.
        largest: f64,
        /// The same if it is in radians, degrees.
        degrees: f64,
    },
    /// A rate in rad/s.
    RadiansPerSecond {
        /// The smallest of the rates, as given.
        given: f64,
        /// The same if it is in rad/s, in the key's unit.
        converted: f64,
        /// The key's unit.
        unit: &'static str,
    },
    /// A misalignment in seconds of arc.
    ArcSeconds {
        /// As given.
        given: f64,
    },
    /// A rate faster than any stand: per minute or per hour.
    TooFast {
        /// As given, °/s.
        given: f64,
    },
    /// A time in another unit.
    Time {
        /// The time, as given.
        given: f64,
        /// The unit it looks like.
        unit: TimeUnit,
    },
    /// Every dwell of a schedule in another unit.
    Dwells {
        /// The longest dwell, as given.
        longest: f64,
        /// The unit they look like.
        unit: TimeUnit,
    },
    /// Less noise than any instrument has.
    Quieter {
        /// Of what.
        instrument: NoiseSource,
        /// How many times less than the best.
        times: f64,
        /// As given.
        given: f64,
        /// The same if it is in radians, in the key's unit.
        if_radians: Option<f64>,
    },
    /// More noise than any instrument has.
    Louder {
        /// Of what.
        instrument: NoiseSource,
        /// How many times more than the worst.
        times: f64,
    },
    /// What wanders, or a density of noise, as no instrument has it.
    Implausible {
        /// What.
        of: Wandering,
        /// As given.
        given: f64,
        /// Units it may be in, with what it would be then, in the key's unit.
        readings: [Option<(&'static str, f64)>; 2],
    },
    /// Weights beside a criterion that has none.
    WeightsUnused {
        /// Its name.
        criterion: &'static str,
    },
    /// The filter period was changed and the noises, which are per period, were not.
    PeriodAlone {
        /// White noise of the accelerometers, if it is the default; densities in g/√Hz.
        accelerometer: Option<Rescaled>,
        /// Random drift, if it is the default; densities in °/√h.
        gyro: Option<Rescaled>,
    },
}

/// A value that is allowed but hard to believe. [`fmt::Display`] has it in words.
#[derive(Debug, Clone, PartialEq)]
pub struct Warning {
    /// The key, in dotted form; `positions` for a schedule.
    pub key: String,
    /// The value, as it would be written.
    pub value: String,
    /// What it looks like.
    pub suspicion: Suspicion,
}

/// A value that is allowed but hard to believe, as documents have it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct WarningRecord {
    /// The key, in dotted form; `positions` for a schedule, with its name before it in a
    /// comparison.
    pub key: String,
    /// The value, as it would be written.
    pub value: String,
    /// What it looks like and what to do about it.
    pub message: String,
}

impl From<&Warning> for WarningRecord {
    fn from(w: &Warning) -> Self {
        Self {
            key: w.key.clone(),
            value: w.value.clone(),
            message: w.message(),
        }
    }
}

impl Warning {
    /// What the value looks like, and what to do about it.
    pub fn message(&self) -> String {
        format!("{}; {}", self.looks_like(), self.advice())
    }

    /// What the value looks like.
    pub fn looks_like(&self) -> String {
        match self.suspicion {
            Suspicion::Radians { given, degrees } => {
                format!("looks like radians: {given} rad is {} deg", number(degrees))
            }
            Suspicion::ScheduleInRadians { largest, degrees } => format!(
                "all angles look like radians: none is beyond 2 pi, and as degrees all positions \
                 are nearly the same; the largest, {largest} rad, is {} deg",
                number(degrees)
            ),
            Suspicion::RadiansPerSecond {
                given,
                converted,
                unit,
            } => format!(
                "looks like rad/s: {given} rad/s is {} {unit}",
                number(converted)
            ),
            Suspicion::ArcSeconds { given } => format!(
                "looks like seconds of arc: a platform is levelled better than that before a test, \
                 and {given} arcsec is {} deg",
                number(given / 3600.0)
            ),
            Suspicion::TooFast { given } => format!(
                "faster than any stand: looks like degrees per minute ({} deg/s) or per hour ({} \
                 deg/s)",
                number(given / 60.0),
                number(given / 3600.0)
            ),
            Suspicion::Time { given, unit } => format!(
                "looks like {}: {given} {} is {} s",
                unit.name(),
                unit.symbol(),
                number(given * unit.seconds())
            ),
            Suspicion::Dwells { longest, unit } => format!(
                "the dwells look like {}: the longest of {longest} {} is {} s",
                unit.name(),
                unit.symbol(),
                number(longest * unit.seconds())
            ),
            Suspicion::Quieter {
                instrument,
                times,
                given,
                if_radians,
            } => {
                let radians = if_radians.map_or_else(String::new, |v| {
                    format!(" Radians? {given} would then be {}", number(v))
                });
                format!(
                    "{} times better than {}.{radians}",
                    number(times),
                    instrument.best()
                )
            }
            Suspicion::Louder { instrument, times } => {
                format!("{} times {}", number(times), instrument.worst())
            }
            Suspicion::Implausible {
                of,
                given,
                readings,
            } => implausible(of, given, readings),
            Suspicion::WeightsUnused { criterion } => {
                format!("without effect: criterion `{criterion}` has no weights")
            }
            Suspicion::PeriodAlone {
                accelerometer,
                gyro,
            } => period_alone(accelerometer, gyro),
        }
    }

    /// What to do if the suspicion is right.
    pub fn advice(&self) -> String {
        let key = &self.key;
        match self.suspicion {
            Suspicion::Radians { .. } => format!("{key} is in degrees"),
            Suspicion::ScheduleInRadians { .. } => {
                "alpha_deg, beta_deg and gamma_deg are in degrees".to_owned()
            }
            Suspicion::RadiansPerSecond { unit, .. } => format!("{key} is in {unit}"),
            Suspicion::ArcSeconds { .. } => format!("{key} is in degrees"),
            Suspicion::TooFast { .. } => format!("{key} is in degrees per second"),
            Suspicion::Time { .. } => format!("{key} is in seconds"),
            Suspicion::Implausible { of, .. } => format!("{key} is in {}", of.unit()),
            Suspicion::Dwells { .. } => "dwell_s is in seconds".to_owned(),
            Suspicion::WeightsUnused { .. } => {
                format!("leave {key} out, or give criterion = \"a\"")
            }
            Suspicion::Quieter { instrument, .. } | Suspicion::Louder { instrument, .. } => {
                match instrument {
                    NoiseSource::Accelerometer => {
                        "it is 1 sigma of one sample, in g: 10 micro-g are 1e-5".to_owned()
                    }
                    NoiseSource::Gyro if key.ends_with("sqrt_h") => {
                        format!("{key} is in degrees per square root of an hour")
                    }
                    NoiseSource::Gyro => {
                        format!("{key} is 1 sigma of the average over one filter period, in deg/h")
                    }
                }
            }
            Suspicion::PeriodAlone {
                accelerometer,
                gyro,
            } => {
                let give = [
                    accelerometer.map(|r| ("accelerometer.noise_g", r)),
                    gyro.map(|r| ("gyro.random_drift_deg_per_h", r)),
                ];
                let give: Vec<String> = give
                    .into_iter()
                    .flatten()
                    .map(|(key, r)| format!("{key} = {}", short(r.same_instrument)))
                    .collect();
                format!(
                    "give your own, or for the same instruments as before {}",
                    give.join(" and ")
                )
            }
        }
    }
}

fn implausible(of: Wandering, given: f64, readings: [Option<(&'static str, f64)>; 2]) -> String {
    let ([best, worst], unit, instrument) = (of.range(), of.unit(), of.instrument());
    let beyond = match given < best {
        true => format!(
            "{} times better than the best {instrument} ({best} {unit})",
            number(best / given)
        ),
        false => format!(
            "{} times the worst {instrument} ({worst} {unit})",
            number(given / worst)
        ),
    };
    let readings = readings.into_iter().flatten();
    let readings = readings.map(|(mistaken, v)| {
        format!(
            ". In {mistaken}? {given} would then be {} {unit}",
            number(v)
        )
    });
    beyond + &readings.collect::<String>()
}

fn period_alone(accelerometer: Option<Rescaled>, gyro: Option<Rescaled>) -> String {
    let mut noises = Vec::new();
    if let Some(r) = accelerometer {
        noises.push(format!(
            "accelerometer.noise_g = {} was {} micro-g/sqrt(Hz) and is {} now",
            short(r.per_period),
            number(1e6 * r.meant),
            number(1e6 * r.means)
        ));
    }
    if let Some(r) = gyro {
        noises.push(format!(
            "gyro.random_drift_deg_per_h = {} was {} deg/sqrt(h) and is {} now",
            short(r.per_period),
            number(r.meant),
            number(r.means)
        ));
    }
    let which = match noises.len() {
        2 => "both default noises are",
        _ => "the default noise is",
    };
    format!(
        "{which} per filter period, so that the period alone changes the instruments: {}",
        noises.join(", ")
    )
}

/// A number for a file: four digits, without trailing zeros.
fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    match (1e-3..1e6).contains(&rounded.abs()) {
        true => format!("{rounded}"),
        false => format!("{rounded:e}"),
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {}: {}", self.key, self.value, self.message())
    }
}
