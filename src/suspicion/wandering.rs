//! Drift and biases that wander, and the accelerometers' noise as a density: what instruments have, and
//! the units that are mistaken for those of the keys.
//!
//! Ranges: IEEE Std 952, annex C, has the terms; El-Sheimy & Youssef 2020 (see [`super::rules`]), table 1,
//! bias stability of gyros from below 1e-4 °/h (strategic) to 30 °/h and more (consumer), of accelerometers
//! from 0.1 µg to above 1 mg. A decade beyond either is left to instruments that nobody has told of.

use super::warning::{Suspicion, TimeUnit, Warning};
use crate::config::StudyConfig;
use crate::units::ARCSEC_PER_RAD;

/// Shortest and longest correlation time, s: bends of an Allan deviation lie between seconds and days.
const CORRELATION_S: [f64; 2] = [10.0, 1e6];

/// µg in 1 m/s².
const MICRO_G_PER_SI: f64 = 1e6 / 9.80665;

/// How an instrument wanders, or the density of its noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wandering {
    /// Rate random walk of a gyro.
    RateRandomWalk,
    /// Bias instability of a gyro.
    DriftInstability,
    /// Acceleration random walk of an accelerometer.
    AccelerationRandomWalk,
    /// Bias instability of an accelerometer.
    BiasInstability,
    /// White noise of an accelerometer.
    NoiseDensity,
}

impl Wandering {
    /// The unit of its key.
    pub(super) const fn unit(self) -> &'static str {
        match self {
            Self::RateRandomWalk => "deg/h/sqrt(h)",
            Self::DriftInstability => "deg/h",
            Self::AccelerationRandomWalk => "micro-g/sqrt(h)",
            Self::BiasInstability => "micro-g",
            Self::NoiseDensity => "micro-g/sqrt(Hz)",
        }
    }

    /// The instrument, with its article.
    pub(super) const fn instrument(self) -> &'static str {
        match self {
            Self::RateRandomWalk | Self::DriftInstability => "gyro",
            Self::AccelerationRandomWalk | Self::BiasInstability | Self::NoiseDensity => {
                "accelerometer"
            }
        }
    }

    /// What the best and the worst instruments have.
    pub(super) const fn range(self) -> [f64; 2] {
        match self {
            Self::RateRandomWalk | Self::DriftInstability => [1e-5, 100.0],
            Self::AccelerationRandomWalk | Self::BiasInstability => [0.01, 1000.0],
            Self::NoiseDensity => [0.1, 1000.0],
        }
    }

    /// How many times beyond them is beyond belief.
    const BEYOND: f64 = 10.0;

    /// Units that are mistaken for that of the key, with how many of it they are.
    fn mistaken(self) -> [(&'static str, f64); 2] {
        const HOUR: f64 = 3600.0;
        const ROOT_HOUR: f64 = 60.0;
        match self {
            Self::RateRandomWalk => [
                ("rad/s/sqrt(s)", ARCSEC_PER_RAD * ROOT_HOUR),
                ("deg/s/sqrt(s)", HOUR * ROOT_HOUR),
            ],
            Self::DriftInstability => [("rad/s", ARCSEC_PER_RAD), ("deg/s", HOUR)],
            Self::AccelerationRandomWalk => [
                ("g/sqrt(h)", 1e6),
                ("m/s^2/sqrt(s)", MICRO_G_PER_SI * ROOT_HOUR),
            ],
            Self::BiasInstability => [("g", 1e6), ("m/s^2", MICRO_G_PER_SI)],
            Self::NoiseDensity => [("g/sqrt(Hz)", 1e6), ("m/s^2/sqrt(Hz)", MICRO_G_PER_SI)],
        }
    }

    /// What is hard to believe of a value.
    fn doubt(self, given: f64) -> Option<Suspicion> {
        let [best, worst] = self.range();
        let beyond = Self::BEYOND;
        let believable = |v: f64| v >= best / beyond && v <= worst * beyond;
        // None at all is a choice.
        if given <= 0.0 || believable(given) {
            return None;
        }
        let read = |(unit, factor): (&'static str, f64)| {
            let value = given * factor;
            (value >= best && value <= worst).then_some((unit, value))
        };
        Some(Suspicion::Implausible {
            of: self,
            given,
            readings: self.mistaken().map(read),
        })
    }
}

/// What is hard to believe of what wanders.
pub(super) fn study(config: &StudyConfig) -> Vec<Warning> {
    let (gyro, accelerometer) = (&config.platform.gyro, &config.platform.accelerometer);
    let sizes = [
        (
            "gyro.rate_random_walk_deg_per_h_per_sqrt_h",
            gyro.rate_random_walk_deg_per_h_per_sqrt_h,
            Wandering::RateRandomWalk,
        ),
        (
            "gyro.bias_instability_deg_per_h",
            gyro.bias_instability_deg_per_h,
            Wandering::DriftInstability,
        ),
        (
            "accelerometer.acceleration_random_walk_ug_per_sqrt_h",
            accelerometer.acceleration_random_walk_ug_per_sqrt_h,
            Wandering::AccelerationRandomWalk,
        ),
        (
            "accelerometer.bias_instability_ug",
            accelerometer.bias_instability_ug,
            Wandering::BiasInstability,
        ),
        (
            "accelerometer.noise_density_ug_per_sqrt_hz",
            accelerometer.noise_density_ug_per_sqrt_hz,
            Wandering::NoiseDensity,
        ),
    ];
    let times = [
        ("gyro.bias_correlation_time_s", gyro.bias_correlation_time_s),
        (
            "accelerometer.bias_correlation_time_s",
            accelerometer.bias_correlation_time_s,
        ),
    ];
    let sizes = sizes.into_iter().filter_map(|(key, given, of)| {
        let given = given?;
        Some((key, given, of.doubt(given)?))
    });
    let times = times.into_iter().filter_map(|(key, given)| {
        let given = given?;
        Some((key, given, doubtful_time(given)?))
    });
    let warning = |(key, value, suspicion): (&str, f64, Suspicion)| Warning {
        key: key.to_owned(),
        value: value.to_string(),
        suspicion,
    };
    sizes.chain(times).map(warning).collect()
}

/// What is hard to believe of a correlation time, s.
fn doubtful_time(given: f64) -> Option<Suspicion> {
    let [shortest, longest] = CORRELATION_S;
    let unit = match given {
        t if t < shortest => TimeUnit::Hours,
        t if t > longest => TimeUnit::Milliseconds,
        _ => return None,
    };
    Some(Suspicion::Time { given, unit })
}
