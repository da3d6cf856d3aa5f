//! The rules for a platform file and the options that override it, with the reasons of their
//! limits.
//!
//! Grades of instruments: El-Sheimy & Youssef, *Inertial sensors technologies for navigation
//! applications: state of the art and future trends*, Satellite Navigation 1:2, 2020, table 1. Gyro
//! random walk: navigation grade below 0.002 °/√h, commercial several °/√h. Accelerometer bias:
//! strategic 0.1 to 1 µg, navigation below 100 µg.
//!
//! | value | suspicious when | because |
//! |---|---|---|
//! | latitude | 0.05 to 1.309 in size, with three decimals or more | as radians it is 2.9° to 75°, where stands are; as degrees it is within 1.3° of the equator, where few are |
//! | gimbal range | within ±2π, one end with two decimals or more | a gimbal of less than ±6.3° calibrates nothing, and is not built to hundredths of a degree |
//! | index step | no whole part of 360°, but of 2π | 0.2618 is 15° |
//! | start attitude | within ±2π, one angle beyond 0.1 with three decimals or more | as degrees it would be zero but for a scrap |
//! | slew rate | below 0.02 °/s | a half turn would take two and a half hours; Earth rate is 0.004 °/s |
//! | slew rate | above 400 °/s | more than a turn a second; gimbals of platforms reach some tens of °/s |
//! | prior of a drift | above 0 and below 2e-4 °/h | known better before the test than a strategic-grade gyro is stable; 15 °/h are 7e-5 rad/s |
//! | misalignment | below 0.02, four digits, and round as radians | 0.001745 is 0.1° |
//! | misalignment | above 15° | the gyros' gravity does not leave a platform that far off; 60″ is usual |
//! | random drift | as random walk a thousand times below navigation grade | no gyro is |
//! | random drift | as random walk ten times above commercial grade | no gyro of a platform is |
//! | accelerometer noise | averages in an hour to a thousandth of the best bias | no accelerometer does |
//! | accelerometer noise | averages in an hour to more than 100 µg | no accelerometer of a platform does |
//! | rate random walk, bias instability of gyros | below 1e-6 or above 1000 °/h(/√h) | a tenth of the best and ten times the worst gyro |
//! | acceleration random walk, bias instability of accelerometers | below 0.001 or above 10 000 µg(/√h) | likewise |
//! | noise density of accelerometers | below 0.01 or above 10 000 µg/√Hz | likewise |
//! | correlation time | below 10 s or above 1e6 s | hours, and milliseconds |
//! | specification | below 1e-6 °/h | a hundredth of a strategic-grade drift; 0.005 °/h are 2.4e-8 rad/s |
//! | weights | beside a criterion other than `a` | only `a` has weights |
//! | total time | less than 30 filter periods | 15 unknowns take more; 200 minutes are 12 000 s |
//! | total time | above 14 days | milliseconds |
//! | filter period, settling, shortest dwell | above 10 min, 2 h, 10 h | milliseconds |
//! | filter period | given, and a noise per period is not | the default noise then is another instrument's |

use super::warning::{NoiseSource, Rescaled, Suspicion, TimeUnit, Warning};
use crate::config::{CriterionKind, StudyConfig};
use crate::platform::{AxisValue, FilterConfig, GSensitivePrior};
use crate::units::{ARCSEC_PER_RAD, RAD_PER_DEG};

/// Largest angle that radians are taken for, a turn and its rounding.
pub(super) const TURN_RAD: f64 = 6.2842;
/// Latitudes that are suspicious, in size.
const LATITUDE: std::ops::RangeInclusive<f64> = 0.05..=1.309;
/// Angles of a start that count, degrees.
const SCRAP_DEG: f64 = 0.1;
/// Slowest and fastest slew, °/s.
const SLEW_DEG_PER_S: [f64; 2] = [0.02, 400.0];
/// Least uncertainty of a drift before a test, °/h (per g).
const PRIOR_DEG_PER_H: f64 = 2e-4;
/// Misalignments below this may be radians, above the other arc seconds, degrees.
const MISALIGNMENT_DEG: [f64; 2] = [0.02, 15.0];
/// Random walk of a navigation-grade gyro, °/√h.
const NAVIGATION_WALK: f64 = 0.002;
/// Random walk of a commercial gyro, °/√h.
const COMMERCIAL_WALK: f64 = 3.0;
/// Bias of a strategic-grade accelerometer, g.
const STRATEGIC_BIAS_G: f64 = 1e-7;
/// Bias of a navigation-grade accelerometer, g.
const NAVIGATION_BIAS_G: f64 = 1e-4;
/// How many times below the best or above the worst is beyond belief.
const BELOW: f64 = 1e3;
/// See [`BELOW`].
const ABOVE: f64 = 10.0;
/// Least specification, °/h (per g).
const SPEC_DEG_PER_H: f64 = 1e-6;
/// Fewest measurements of a test.
const FEWEST_PERIODS: f64 = 30.0;
/// Longest times, s: of a test, a period, a settle, a shortest dwell.
const LONGEST_S: [f64; 4] = [1_209_600.0, 600.0, 7_200.0, 36_000.0];

/// What is hard to believe of a study, of whose keys `defaulted` were not given.
pub(super) fn study(config: &StudyConfig, defaulted: &[String]) -> Vec<Warning> {
    let mut found = Warnings::default();
    found.latitude(config);
    found.gimbals(config);
    found.motion(config);
    found.priors(config);
    found.noises(config);
    found.0.extend(super::wandering::study(config));
    found.times(config);
    found.specification(config);
    found.weights(config);
    found.period_alone(config, defaulted);
    found.0
}

/// How many decimals a number is written with.
pub(super) fn decimals(value: f64) -> usize {
    let text = format!("{value}");
    text.split_once('.').map_or(0, |(_, d)| d.len())
}

/// How many digits a number is written with, zeros in front not counted.
fn digits(value: f64) -> usize {
    let text = format!("{value}").replace(['.', '-'], "");
    text.trim_start_matches('0').len()
}

/// Whether a number has a single digit but for its own rounding to four.
fn is_round(value: f64) -> bool {
    let scale = libm::pow(10.0, libm::log10(value.abs()).floor());
    let leading = value / scale;
    (leading / leading.round() - 1.0).abs() < 5e-4
}

/// The largest of the values, by size; of a range about zero its upper end.
pub(super) fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    let size = |largest: f64, v: f64| if v.abs() >= largest.abs() { v } else { largest };
    values.into_iter().fold(0.0, size)
}

fn list(values: &[f64]) -> String {
    let all: Vec<String> = values.iter().map(f64::to_string).collect();
    format!("[{}]", all.join(", "))
}

/// A suspicion that `given` is in radians.
fn radians(given: f64) -> Suspicion {
    Suspicion::Radians {
        given,
        degrees: given / RAD_PER_DEG,
    }
}

#[derive(Default)]
struct Warnings(Vec<Warning>);

impl Warnings {
    fn push(&mut self, key: &str, value: impl ToString, suspicion: Suspicion) {
        self.0.push(Warning {
            key: key.to_owned(),
            value: value.to_string(),
            suspicion,
        });
    }

    fn latitude(&mut self, config: &StudyConfig) {
        let latitude = config.platform.site.latitude_deg;
        if LATITUDE.contains(&latitude.abs()) && decimals(latitude) >= 3 {
            self.push("site.latitude_deg", latitude, radians(latitude));
        }
    }

    fn gimbals(&mut self, config: &StudyConfig) {
        let gimbals = &config.platform.gimbals;
        for (key, range) in [
            ("gimbals.alpha_deg", gimbals.alpha_deg),
            ("gimbals.beta_deg", gimbals.beta_deg),
            ("gimbals.gamma_deg", gimbals.gamma_deg),
        ] {
            let Some(range) = range else { continue };
            let small = range.iter().all(|v| v.abs() <= TURN_RAD);
            if small && range.iter().any(|v| decimals(*v) >= 2) {
                self.push(key, list(&range), radians(largest(range)));
            }
        }
        let Some(step) = gimbals.step_deg else { return };
        let divides = |turn: f64| {
            let parts = turn / step;
            (parts - parts.round()).abs() < 1e-3 * parts
        };
        let exact = (360.0 / step - (360.0 / step).round()).abs() < 1e-6;
        if step <= std::f64::consts::PI && !exact && divides(360.0 * RAD_PER_DEG) {
            self.push("gimbals.step_deg", step, radians(step));
        }
    }

    fn motion(&mut self, config: &StudyConfig) {
        let motion = &config.platform.motion;
        if let Some(start) = motion.start_deg {
            let small = start.iter().all(|v| v.abs() <= TURN_RAD);
            let telling = |v: &f64| v.abs() >= SCRAP_DEG && decimals(*v) >= 3;
            if small && start.iter().any(telling) {
                self.push("motion.start_deg", list(&start), radians(largest(start)));
            }
        }
        let Some(given) = motion.slew_rate_deg_per_s else {
            return;
        };
        let [slowest, fastest] = SLEW_DEG_PER_S;
        let key = "motion.slew_rate_deg_per_s";
        let rates = given.to_array();
        let [least, most] = [
            rates.iter().copied().fold(f64::MAX, f64::min),
            largest(rates),
        ];
        // A slow axis beside quick ones is what it is: an outer gimbal carries the others.
        if most < slowest {
            let suspicion = Suspicion::RadiansPerSecond {
                given: least,
                converted: least / RAD_PER_DEG,
                unit: "deg/s",
            };
            self.push(key, least, suspicion);
        } else if most > fastest {
            self.push(key, most, Suspicion::TooFast { given: most });
        }
    }

    fn priors(&mut self, config: &StudyConfig) {
        let prior = &config.platform.prior;
        let g_key = "prior.g_sensitive_drift_deg_per_h_per_g";
        self.drift(
            "prior.constant_drift_deg_per_h",
            prior.constant_drift_deg_per_h,
            "deg/h",
        );
        match prior.g_sensitive_drift_deg_per_h_per_g {
            GSensitivePrior::All(value) => self.drift(g_key, value, "deg/h per g"),
            GSensitivePrior::PerAxis {
                input,
                output,
                spin,
            } => {
                for (name, value) in [("input", input), ("output", output), ("spin", spin)] {
                    self.drift(&format!("{g_key}.{name}"), value, "deg/h per g");
                }
            }
        }
        let key = "prior.misalignment_deg";
        let angles = prior.misalignment_deg;
        let given = angles.to_array();
        let [small, large] = MISALIGNMENT_DEG;
        let as_radians =
            |v: &f64| *v > 0.0 && *v < small && digits(*v) >= 4 && is_round(*v / RAD_PER_DEG);
        if given.iter().any(as_radians) {
            self.push(key, written(angles), radians(largest(given)));
        } else if largest(given) > large {
            let given = largest(given);
            self.push(key, written(angles), Suspicion::ArcSeconds { given });
        }
    }

    fn drift(&mut self, key: &str, value: AxisValue, unit: &'static str) {
        let smallest = value.to_array().into_iter().filter(|v| *v > 0.0);
        let smallest = smallest.fold(f64::INFINITY, f64::min);
        if smallest < PRIOR_DEG_PER_H {
            let suspicion = Suspicion::RadiansPerSecond {
                given: smallest,
                converted: smallest * ARCSEC_PER_RAD,
                unit,
            };
            self.push(key, written(value), suspicion);
        }
    }

    fn noises(&mut self, config: &StudyConfig) {
        let platform = &config.platform;
        let hours = platform.filter.period_s / 3600.0;
        if let Some(noise_g) = platform.accelerometer.noise_g {
            self.noise(
                "accelerometer.noise_g",
                noise_g,
                (NoiseSource::Accelerometer, noise_g * hours.sqrt()),
                [STRATEGIC_BIAS_G, NAVIGATION_BIAS_G],
                None,
            );
        }
        if let Some(drift) = platform.gyro.random_drift_deg_per_h {
            self.noise(
                "gyro.random_drift_deg_per_h",
                drift,
                (NoiseSource::Gyro, drift * hours.sqrt()),
                [NAVIGATION_WALK, COMMERCIAL_WALK],
                Some(ARCSEC_PER_RAD),
            );
        }
        if let Some(walk) = platform.gyro.angle_random_walk_deg_per_sqrt_h {
            self.noise(
                "gyro.angle_random_walk_deg_per_sqrt_h",
                walk,
                (NoiseSource::Gyro, walk),
                [NAVIGATION_WALK, COMMERCIAL_WALK],
                // From rad/√s: degrees, and √3600 s in an hour.
                Some(60.0 / RAD_PER_DEG),
            );
        }
    }

    /// `comparable` is `given` in the unit of the best and worst instruments.
    fn noise(
        &mut self,
        key: &str,
        given: f64,
        (instrument, comparable): (NoiseSource, f64),
        [best, worst]: [f64; 2],
        from_radians: Option<f64>,
    ) {
        let above = match instrument {
            NoiseSource::Accelerometer => 1.0,
            NoiseSource::Gyro => ABOVE,
        };
        // No noise at all is a choice, and allowed for the gyros.
        if given > 0.0 && comparable < best / BELOW {
            let per_given = comparable / given;
            let credible = |v: &f64| {
                let comparable = v * per_given;
                comparable >= best / BELOW && comparable <= worst * above
            };
            let suspicion = Suspicion::Quieter {
                instrument,
                times: best / comparable,
                given,
                if_radians: from_radians.map(|factor| given * factor).filter(credible),
            };
            self.push(key, given, suspicion);
        } else if comparable > worst * above {
            let times = comparable / worst;
            self.push(key, given, Suspicion::Louder { instrument, times });
        }
    }

    fn times(&mut self, config: &StudyConfig) {
        let platform = &config.platform;
        let [test, period, settle, dwell] = LONGEST_S;
        let total = config.objective.total_time_s;
        for (key, given, longest) in [
            ("objective.total_time_s", total, test),
            ("filter.period_s", platform.filter.period_s, period),
            ("motion.settle_s", platform.motion.settle_s, settle),
            ("motion.min_dwell_s", platform.motion.min_dwell_s, dwell),
        ] {
            if given > longest {
                let unit = TimeUnit::Milliseconds;
                self.push(key, given, Suspicion::Time { given, unit });
            }
        }
        let few = total < FEWEST_PERIODS * platform.filter.period_s;
        // A period of minutes is no reason to doubt a total time of hours.
        if few && platform.filter.period_s <= period {
            let unit = match total <= 24.0 {
                true => TimeUnit::Hours,
                false => TimeUnit::Minutes,
            };
            let key = "objective.total_time_s";
            self.push(key, total, Suspicion::Time { given: total, unit });
        }
    }

    fn specification(&mut self, config: &StudyConfig) {
        let tables = [
            ("spec", &config.objective.spec),
            ("spec_deg_per_h", &config.objective.spec_deg_per_h),
        ];
        let of_drift = tables.iter().flat_map(|(table, spec)| {
            let named = spec.coefficients.iter().map(|(c, v)| (c.name(), *v));
            let default = spec.default.map(|v| ("default", v));
            default
                .into_iter()
                .chain(named)
                .map(move |given| (table, given))
        });
        for (table, (name, given)) in of_drift {
            if given > 0.0 && given < SPEC_DEG_PER_H {
                let suspicion = Suspicion::RadiansPerSecond {
                    given,
                    converted: given * ARCSEC_PER_RAD,
                    unit: "deg/h",
                };
                self.push(&format!("objective.{table}.{name}"), given, suspicion);
            }
        }
    }

    fn weights(&mut self, config: &StudyConfig) {
        let objective = &config.objective;
        if objective.criterion == CriterionKind::A || objective.weights.is_empty() {
            return;
        }
        let weights = &objective.weights;
        let default = weights.default.map(|w| ("default", w));
        let of_drift = weights.coefficients.iter().map(|(c, w)| (c.name(), *w));
        let others = weights.others.iter().map(|(name, w)| (*name, *w));
        let all = default.into_iter().chain(of_drift).chain(others);
        let all: Vec<String> = all.map(|(name, w)| format!("{name} = {w}")).collect();
        let criterion = objective.criterion.name();
        self.push(
            "objective.weights",
            format!("{{ {} }}", all.join(", ")),
            Suspicion::WeightsUnused { criterion },
        );
    }

    fn period_alone(&mut self, config: &StudyConfig, defaulted: &[String]) {
        let period = config.platform.filter.period_s;
        let usual = FilterConfig::default().period_s;
        if period == usual {
            return;
        }
        let is_default = |key: &str| defaulted.iter().any(|d| d == key);
        let rescaled = |per_period: f64, root_of: f64| Rescaled {
            per_period,
            meant: per_period * (usual / root_of).sqrt(),
            means: per_period * (period / root_of).sqrt(),
            same_instrument: per_period * (usual / period).sqrt(),
        };
        let accelerometer = is_default("accelerometer.noise_g")
            .then(|| rescaled(crate::platform::DEFAULT_NOISE_G, 1.0));
        let gyro = is_default("gyro.random_drift_deg_per_h")
            .then(|| rescaled(crate::platform::DEFAULT_RANDOM_DRIFT_DEG_PER_H, 3600.0));
        if accelerometer.is_some() || gyro.is_some() {
            let suspicion = Suspicion::PeriodAlone {
                accelerometer,
                gyro,
            };
            self.push("filter.period_s", period, suspicion);
        }
    }
}

/// A value of three axes, as it would be written.
fn written(value: AxisValue) -> String {
    match value {
        AxisValue::All(v) => v.to_string(),
        AxisValue::PerAxis(v) => list(&v),
    }
}
