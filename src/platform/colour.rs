//! Noise of gyros and accelerometers that wanders, and the accelerometers' white noise: the keys of
//! `[gyro]` and `[accelerometer]`, and the one place that converts them.

use super::{AccelerometerConfig, DEFAULT_NOISE_G, GyroConfig, Platform, both_given, in_range};
use crate::error::{Error, Result};
use crate::model::{Colour, Markov};
use crate::units::AngularRate;

const RATE_RANDOM_WALK: &str = "gyro.rate_random_walk_deg_per_h_per_sqrt_h";
const DRIFT_INSTABILITY: &str = "gyro.bias_instability_deg_per_h";
const ACCELERATION_RANDOM_WALK: &str = "accelerometer.acceleration_random_walk_ug_per_sqrt_h";
const BIAS_INSTABILITY: &str = "accelerometer.bias_instability_ug";

const SECONDS_PER_HOUR: f64 = 3600.0;
/// g in a micro-g.
const MICRO: f64 = 1e-6;

impl Platform {
    /// The keys that make drift wander.
    pub(crate) fn keys_of_wandering_drift(&self) -> Vec<&'static str> {
        given(self.drift_colour(), [RATE_RANDOM_WALK, DRIFT_INSTABILITY])
    }

    /// The keys that make the accelerometers' biases wander.
    pub(crate) fn keys_of_wandering_biases(&self) -> Vec<&'static str> {
        given(
            self.accelerometer_colour(),
            [ACCELERATION_RANDOM_WALK, BIAS_INSTABILITY],
        )
    }
}

/// Of the keys of random walk and instability those that are there.
fn given(colour: &Colour, keys: [&'static str; 2]) -> Vec<&'static str> {
    let is_given = [colour.random_walk.is_some(), colour.markov.is_some()];
    let both = keys.into_iter().zip(is_given);
    both.filter_map(|(key, is_given)| is_given.then_some(key))
        .collect()
}

/// The keys of one kind of instrument, with the values that are given.
struct Keys {
    random_walk: (&'static str, Option<f64>),
    instability: (&'static str, Option<f64>),
    time: (&'static str, Option<f64>),
    /// The largest random walk and instability, and its words.
    most: (f64, &'static str),
}

impl Keys {
    /// Converted by `si`, which takes one of the instrument's units.
    fn check(&self, si: impl Fn(f64) -> f64) -> Result<Colour> {
        let (most, allowed) = self.most;
        // No noise at all is a choice, and the same as leaving it out.
        let size = |(key, value): (&str, Option<f64>)| match value {
            Some(value) => Ok(Some(in_range(key, value, 0.0, most, allowed)?)),
            None => Ok::<_, Error>(None),
        };
        let random_walk = size(self.random_walk)?.filter(|v| *v > 0.0);
        let instability = size(self.instability)?;
        let ((instability_key, _), (time_key, _)) = (self.instability, self.time);
        let lonely = |key: &str, value: f64, missing: &str| {
            Err(Error::input(format!("given without {missing}"))
                .with_key(key)
                .with_value(value)
                .with_allowed("both or neither"))
        };
        let markov = match (instability, self.time.1) {
            // No instability has no correlation time.
            (Some(0.0), None) => None,
            (Some(sigma), None) => return lonely(instability_key, sigma, time_key),
            (None, Some(time_s)) => return lonely(time_key, time_s, instability_key),
            (None, None) => None,
            (Some(sigma), Some(time_s)) => {
                let time_s = in_range(time_key, time_s, 1.0, 1e9, "1 to 1e9")?;
                (sigma > 0.0).then(|| Markov {
                    sigma: si(sigma),
                    time_s,
                })
            }
        };
        Ok(Colour {
            random_walk: random_walk.map(|k| si(k) * si(k) / SECONDS_PER_HOUR),
            markov,
        })
    }
}

impl GyroConfig {
    /// In rad/s.
    pub(super) fn colour(&self) -> Result<Colour> {
        let keys = Keys {
            random_walk: (RATE_RANDOM_WALK, self.rate_random_walk_deg_per_h_per_sqrt_h),
            instability: (DRIFT_INSTABILITY, self.bias_instability_deg_per_h),
            time: ("gyro.bias_correlation_time_s", self.bias_correlation_time_s),
            most: (1e4, "0 (none) to 10000"),
        };
        keys.check(|v| AngularRate::from_deg_per_h(v).rad_per_s())
    }
}

impl AccelerometerConfig {
    /// White noise of a sample, 1σ, g.
    pub(super) fn noise(&self, period_s: f64) -> Result<f64> {
        const DENSITY: &str = "accelerometer.noise_density_ug_per_sqrt_hz";
        const NOISE: &str = "accelerometer.noise_g";
        match (self.noise_g, self.noise_density_ug_per_sqrt_hz) {
            (Some(_), Some(density)) => Err(both_given(DENSITY, density, NOISE)),
            (None, Some(density)) => {
                let density = in_range(DENSITY, density, 1e-3, 3e4, "0.001 to 30000")?;
                Ok(density * MICRO / period_s.sqrt())
            }
            (noise, None) => in_range(
                NOISE,
                noise.unwrap_or(DEFAULT_NOISE_G),
                1e-12,
                1.0,
                "1e-12 to 1 (a noise of zero would make every answer exact)",
            ),
        }
    }

    /// In g.
    pub(super) fn colour(&self) -> Result<Colour> {
        let keys = Keys {
            random_walk: (
                ACCELERATION_RANDOM_WALK,
                self.acceleration_random_walk_ug_per_sqrt_h,
            ),
            instability: (BIAS_INSTABILITY, self.bias_instability_ug),
            time: (
                "accelerometer.bias_correlation_time_s",
                self.bias_correlation_time_s,
            ),
            most: (1e6, "0 (none) to 1e6"),
        };
        keys.check(|v| v * MICRO)
    }
}

#[cfg(test)]
mod tests {
    use crate::platform::PlatformConfig;
    use crate::units::ARCSEC_PER_RAD;

    fn config(toml: &str) -> PlatformConfig {
        toml::from_str(toml).unwrap()
    }

    #[test]
    fn values_reach_the_platform_in_its_units() {
        let p = config(
            "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 0.003\n\
             bias_instability_deg_per_h = 0.002\nbias_correlation_time_s = 1200\n\
             [accelerometer]\nnoise_density_ug_per_sqrt_hz = 30\n\
             acceleration_random_walk_ug_per_sqrt_h = 2\n\
             bias_instability_ug = 3\nbias_correlation_time_s = 900\n[filter]\nperiod_s = 4\n",
        )
        .check()
        .unwrap();
        assert!((p.noise_g() / 15e-6 - 1.0).abs() < 1e-14);
        // 1 °/h is 1 arcsec/s; after four hours the walk has come to twice K.
        let drift = p.drift_colour().times(ARCSEC_PER_RAD);
        let after = drift.random_walk.unwrap() * 4.0 * 3600.0;
        assert!((after.sqrt() / 0.006 - 1.0).abs() < 1e-14);
        let markov = drift.markov.unwrap();
        assert!((markov.sigma / 0.002 - 1.0).abs() < 1e-14 && markov.time_s == 1200.0);
        let of = p.accelerometer_colour();
        let after = of.random_walk.unwrap() * 9.0 * 3600.0;
        assert!((after.sqrt() / 6e-6 - 1.0).abs() < 1e-14);
        assert!((of.markov.unwrap().sigma / 3e-6 - 1.0).abs() < 1e-14);
        assert!(!p.is_white() && !p.is_of_the_paper());
    }

    #[test]
    fn nothing_given_and_noughts_are_white() {
        for toml in [
            "",
            "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 0\n",
            "[gyro]\nbias_instability_deg_per_h = 0\nbias_correlation_time_s = 600\n",
            "[gyro]\nbias_instability_deg_per_h = 0\n",
            "[accelerometer]\nbias_instability_ug = 0.0\n",
            "[accelerometer]\nbias_instability_ug = -0.0\n",
            "[accelerometer]\nbias_instability_ug = 0\nbias_correlation_time_s = 600\n",
        ] {
            let p = config(toml).check().unwrap();
            assert!(p.is_white() && p.is_of_the_paper(), "{toml}");
        }
    }

    #[test]
    fn bad_values_are_refused_by_key() {
        for (table, rest, key, allowed) in [
            (
                "gyro",
                "rate_random_walk_deg_per_h_per_sqrt_h = -1",
                "rate_random_walk_deg_per_h_per_sqrt_h",
                "0 (none)",
            ),
            (
                "gyro",
                "rate_random_walk_deg_per_h_per_sqrt_h = nan",
                "rate_random_walk_deg_per_h_per_sqrt_h",
                "0 (none)",
            ),
            (
                "gyro",
                "rate_random_walk_deg_per_h_per_sqrt_h = inf",
                "rate_random_walk_deg_per_h_per_sqrt_h",
                "0 (none)",
            ),
            (
                "gyro",
                "bias_instability_deg_per_h = 0.1",
                "bias_instability_deg_per_h",
                "both or neither",
            ),
            (
                "gyro",
                "bias_correlation_time_s = 100",
                "bias_correlation_time_s",
                "both or neither",
            ),
            (
                "gyro",
                "bias_instability_deg_per_h = 0.1\nbias_correlation_time_s = 0",
                "bias_correlation_time_s",
                "1 to 1e9",
            ),
            (
                "gyro",
                "bias_instability_deg_per_h = 0.1\nbias_correlation_time_s = -5",
                "bias_correlation_time_s",
                "1 to 1e9",
            ),
            (
                "gyro",
                "bias_instability_deg_per_h = 0.1\nbias_correlation_time_s = inf",
                "bias_correlation_time_s",
                "1 to 1e9",
            ),
            (
                "gyro",
                "bias_instability_deg_per_h = -0.1\nbias_correlation_time_s = 5",
                "bias_instability_deg_per_h",
                "0 (none)",
            ),
            (
                "gyro",
                "bias_instability_deg_per_h = 2e4\nbias_correlation_time_s = 5",
                "bias_instability_deg_per_h",
                "0 (none)",
            ),
            (
                "accelerometer",
                "noise_density_ug_per_sqrt_hz = 0",
                "noise_density_ug_per_sqrt_hz",
                "0.001 to 30000",
            ),
            (
                "accelerometer",
                "noise_density_ug_per_sqrt_hz = nan",
                "noise_density_ug_per_sqrt_hz",
                "0.001 to 30000",
            ),
            (
                "accelerometer",
                "noise_g = 1e-5\nnoise_density_ug_per_sqrt_hz = 3",
                "noise_density_ug_per_sqrt_hz",
                "one of the two",
            ),
            (
                "accelerometer",
                "acceleration_random_walk_ug_per_sqrt_h = -1",
                "acceleration_random_walk_ug_per_sqrt_h",
                "0 (none)",
            ),
            (
                "accelerometer",
                "bias_instability_ug = 1",
                "bias_instability_ug",
                "both or neither",
            ),
            (
                "accelerometer",
                "bias_correlation_time_s = 1",
                "bias_correlation_time_s",
                "both or neither",
            ),
            (
                "accelerometer",
                "bias_instability_ug = nan\nbias_correlation_time_s = 60",
                "bias_instability_ug",
                "0 (none)",
            ),
            (
                "accelerometer",
                "bias_instability_ug = 1\nbias_correlation_time_s = 0",
                "bias_correlation_time_s",
                "1 to 1e9",
            ),
        ] {
            let error = config(&format!("[{table}]\n{rest}\n")).check().unwrap_err();
            assert!(error.is_input(), "{rest}");
            assert_eq!(
                error.key(),
                Some(format!("{table}.{key}").as_str()),
                "{rest}"
            );
            assert!(error.value().is_some(), "{rest}");
            let found = error.allowed().unwrap_or_default();
            assert!(found.contains(allowed), "{rest}: {found}");
        }
    }

    #[test]
    fn without_the_keys_nothing_is_written() {
        let written = serde_json::to_string(&PlatformConfig::default()).unwrap();
        for key in [
            "walk_deg_per_h_per",
            "bias",
            "density",
            "acceleration_random",
        ] {
            assert!(!written.contains(key), "{written}");
        }
    }
}
