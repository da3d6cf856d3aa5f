//! What limits a test: what the criterion of a schedule would be if one thing were better.
//!
//! The total time stays, and time that is saved goes to the dwells in proportion. At an optimum this is
//! right to first order: how the schedule would change has no part in it. Wider ranges are what a
//! schedule does change for; there, angles and dwells are refined, within the ranges as they are and
//! within the wider ones.

use super::Study;
use crate::attitude::Position;
use crate::config::StudyConfig;
use crate::covariance::TickRule;
use crate::criterion::Smoothing;
use crate::error::Result;
use crate::evaluate::Evaluator;
use crate::model::Role;
use crate::motion::Timeline;
use crate::platform::{GimbalsConfig, PlatformConfig, Repositioning};
use crate::results::{Change, LimitRecord};
use crate::schedule::{Schedule, ScheduledPosition};
use crate::search::polished;

/// What is tried: a key, the change, and the platform changed; none where there is nothing to change.
type Trial = (String, Change, StudyConfig);

/// Noise of the azimuth reference that is tried, arcsec in a period.
const AZIMUTH_ARCSEC: f64 = 20.0;
/// A ratio of criteria up to which nothing got worse but by rounding.
const NO_WORSE: f64 = 1.0 + 1e-9;
/// By how much a range is widened at each end, degrees.
const WIDER_DEG: f64 = 15.0;

fn trials(config: &StudyConfig) -> Vec<Trial> {
    let mut all: Vec<Trial> = Vec::new();
    let mut push = |what: &str, change: Change, edit: &dyn Fn(&mut StudyConfig)| {
        let mut changed = config.clone();
        edit(&mut changed);
        all.push((what.to_owned(), change, changed));
    };
    let platform = &config.platform;
    if let Some(density) = platform.accelerometer.noise_density_ug_per_sqrt_hz {
        let change = Change::Halved(density, 0.5 * density);
        push("accelerometer.noise_density_ug_per_sqrt_hz", change, &|c| {
            c.platform.accelerometer.noise_density_ug_per_sqrt_hz = Some(0.5 * density);
        });
    } else if let Some(noise) = platform.accelerometer.noise_g {
        let change = Change::Halved(noise, 0.5 * noise);
        push("accelerometer.noise_g", change, &|c| {
            c.platform.accelerometer.noise_g = Some(0.5 * noise);
        });
    }
    if let Some(walk) = platform.gyro.angle_random_walk_deg_per_sqrt_h {
        let change = Change::Halved(walk, 0.5 * walk);
        push("gyro.angle_random_walk_deg_per_sqrt_h", change, &|c| {
            c.platform.gyro.angle_random_walk_deg_per_sqrt_h = Some(0.5 * walk);
        });
    } else if let Some(drift) = platform.gyro.random_drift_deg_per_h {
        let change = Change::Halved(drift, 0.5 * drift);
        push("gyro.random_drift_deg_per_h", change, &|c| {
            c.platform.gyro.random_drift_deg_per_h = Some(0.5 * drift);
        });
    }
    for (key, value, of) in wandering() {
        if let Some(size) = value(platform).filter(|size| *size > 0.0) {
            push(key, Change::Halved(size, 0.5 * size), &|c| {
                *of(&mut c.platform) = Some(0.5 * size);
            });
        }
    }
    if platform.motion.repositioning == Repositioning::Slew
        && let Some(rate) = platform.motion.slew_rate_deg_per_s
    {
        let twice = |value: f64| 2.0 * value;
        push("motion.slew_rate_deg_per_s", Change::doubled(rate), &|c| {
            c.platform.motion.slew_rate_deg_per_s = Some(rate.map(twice));
        });
        if let Some(acceleration) = platform.motion.acceleration_deg_per_s2 {
            push(
                "motion.acceleration_deg_per_s2",
                Change::doubled(acceleration),
                &|c| {
                    c.platform.motion.acceleration_deg_per_s2 = Some(acceleration.map(twice));
                },
            );
        }
    }
    let settle = platform.motion.settle_s;
    if settle > 0.0 {
        push(
            "motion.settle_s",
            Change::Halved(settle, 0.5 * settle),
            &|c| {
                c.platform.motion.settle_s *= 0.5;
            },
        );
    }
    if platform.azimuth.noise_arcsec.is_none() {
        push(
            "azimuth.noise_arcsec",
            Change::Added(AZIMUTH_ARCSEC),
            &|c| {
                c.platform.azimuth.noise_arcsec = Some(AZIMUTH_ARCSEC);
            },
        );
    }
    all
}

/// A key of what wanders, its value and where that is.
type Wandering = (
    &'static str,
    fn(&PlatformConfig) -> Option<f64>,
    fn(&mut PlatformConfig) -> &mut Option<f64>,
);

/// How much drift and biases wander.
fn wandering() -> [Wandering; 4] {
    [
        (
            "gyro.rate_random_walk_deg_per_h_per_sqrt_h",
            |p| p.gyro.rate_random_walk_deg_per_h_per_sqrt_h,
            |p| &mut p.gyro.rate_random_walk_deg_per_h_per_sqrt_h,
        ),
        (
            "gyro.bias_instability_deg_per_h",
            |p| p.gyro.bias_instability_deg_per_h,
            |p| &mut p.gyro.bias_instability_deg_per_h,
        ),
        (
            "accelerometer.acceleration_random_walk_ug_per_sqrt_h",
            |p| p.accelerometer.acceleration_random_walk_ug_per_sqrt_h,
            |p| &mut p.accelerometer.acceleration_random_walk_ug_per_sqrt_h,
        ),
        (
            "accelerometer.bias_instability_ug",
            |p| p.accelerometer.bias_instability_ug,
            |p| &mut p.accelerometer.bias_instability_ug,
        ),
    ]
}

/// A range made wider.
struct Wider {
    key: &'static str,
    axis: usize,
    before: [f64; 2],
    gimbals: GimbalsConfig,
}

/// Axes with a range that can be wider.
fn wider(gimbals: &GimbalsConfig) -> Vec<Wider> {
    const KEYS: [&str; 3] = ["gimbals.alpha_deg", "gimbals.beta_deg", "gimbals.gamma_deg"];
    let ranges = [gimbals.alpha_deg, gimbals.beta_deg, gimbals.gamma_deg];
    let widened = |(axis, range): (usize, Option<[f64; 2]>)| {
        let before = range?;
        // A whole turn is all that there is.
        if before[1] - before[0] >= 360.0 {
            return None;
        }
        let mut changed = gimbals.clone();
        let slot = match axis {
            0 => &mut changed.alpha_deg,
            1 => &mut changed.beta_deg,
            _ => &mut changed.gamma_deg,
        };
        *slot = Some([before[0] - WIDER_DEG, before[1] + WIDER_DEG]);
        Some(Wider {
            key: KEYS[axis],
            axis,
            before,
            gimbals: changed,
        })
    };
    ranges.into_iter().enumerate().filter_map(widened).collect()
}

impl Wider {
    /// The schedule with the angles of the axis spread over the range as it is now.
    fn spread(&self, schedule: &Schedule) -> Result<Schedule> {
        let [low, high] = self.before;
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let positions = schedule.positions().iter().map(|p| {
            let mut deg = p.position.degrees();
            if half > 0.0 {
                deg[self.axis] = middle + (deg[self.axis] - middle) * (half + WIDER_DEG) / half;
            }
            ScheduledPosition {
                position: Position::from_deg(deg[0], deg[1], deg[2]),
                // The usual way: that of before led elsewhere.
                change_deg: None,
                ..*p
            }
        });
        Schedule::new(positions.collect())
    }
}

impl Study {
    /// What would make the criterion of `schedule` better, the most helpful first; nothing in the middle
    /// of a test, or where the criterion does not depend on it.
    pub(crate) fn limits(&self, schedule: &Schedule) -> Vec<LimitRecord> {
        let evaluator = &self.evaluator;
        let test = self.checked.test();
        let known = evaluator
            .objective()
            .criterion
            .is_known(evaluator.model().prior_sigma_deg_per_h());
        if test.done().is_some() || known {
            return Vec::new();
        }
        let Ok(timeline) = Timeline::new(test, schedule) else {
            return Vec::new();
        };
        let total_time_s = timeline.total_time_s();
        let Ok(now) = criterion(evaluator, &timeline) else {
            return Vec::new();
        };
        let mut all = Vec::new();
        // What makes a test worse is no limit of it: less noise can, where the filter ignores something.
        let mut push = |what: String, change: Change, ratio: f64| {
            if ratio <= NO_WORSE {
                all.push(LimitRecord::new(what, change, ratio));
            }
        };
        for (what, change, config) in trials(self.config()) {
            if let Some(then) = criterion_of(&config, schedule, total_time_s) {
                push(what, change, then / now);
            }
        }
        for group in self.considered_groups() {
            let platform = test.platform().estimating(group);
            let evaluator = Evaluator::new(platform, evaluator.objective().clone());
            if let Ok(then) = criterion(&evaluator, &timeline) {
                let what = format!("errors.considered.{group}");
                push(what, Change::Estimated, then / now);
            }
        }
        let longer_s = 1.1 * total_time_s;
        if let Some(then) = criterion_of(self.config(), schedule, longer_s) {
            let change = Change::TenthMore(total_time_s, longer_s);
            push("objective.total_time_s".to_owned(), change, then / now);
        }
        for (what, ratio) in self.wider_ranges(schedule, total_time_s) {
            push(what.to_owned(), Change::Wider(WIDER_DEG), ratio);
        }
        all.sort_by(|a, b| a.criterion_ratio.total_cmp(&b.criterion_ratio));
        all
    }

    /// Groups that the filter does not know of.
    fn considered_groups(&self) -> Vec<&'static str> {
        let parameters = self.checked.test().platform().errors().parameters();
        let considered = parameters.iter().filter(|p| p.role == Role::Considered);
        let mut groups: Vec<&str> = considered.map(|p| p.group).collect();
        groups.dedup();
        groups
    }

    /// Axes whose range can be wider, with the criterion's ratio.
    fn wider_ranges(&self, schedule: &Schedule, total_time_s: f64) -> Vec<(&'static str, f64)> {
        let wider = wider(&self.config().platform.gimbals);
        let on_a_table = self.config().platform.gimbals.step_deg.is_some();
        if wider.is_empty() || on_a_table {
            return Vec::new();
        }
        let refined = |evaluator: &Evaluator, from: &Schedule| {
            let plan = polished(evaluator, from, total_time_s)?;
            let value = criterion(evaluator, &plan.timeline(evaluator.test())).ok()?;
            Some((plan, value))
        };
        let Some((plan, now)) = refined(&self.evaluator, schedule) else {
            return Vec::new();
        };
        // From the best within the ranges as they are, which the wider ones allow too.
        let Ok(best) = plan.to_schedule(self.evaluator.test()) else {
            return Vec::new();
        };
        let with = |wider: &Wider| {
            let mut config = self.config().clone();
            config.platform.gimbals = wider.gimbals.clone();
            let evaluator = config.check_for_evaluation().ok()?.evaluator();
            // Where moves take time the best often lies where two gimbals take the same, which no
            // gradient leads away from: once more from angles that use the new range.
            let starts = [Ok(best.clone()), wider.spread(&best)]
                .into_iter()
                .flatten();
            let found = starts.filter_map(|start| Some(refined(&evaluator, &start)?.1));
            Some(found.fold(now, f64::min) / now)
        };
        let all = wider.iter();
        all.filter_map(|wider| Some((wider.key, with(wider)?)))
            .collect()
    }
}

/// The criterion, continuous in the dwells.
fn criterion(evaluator: &Evaluator, timeline: &Timeline) -> Result<f64> {
    let model = evaluator.model();
    let criterion = &evaluator.objective().criterion;
    let log = model.value(timeline, TickRule::Relaxed, |p| {
        criterion.log(p, Smoothing::Exact)
    })?;
    Ok(libm::exp(log))
}

/// The criterion of `schedule` on another platform in so much time; none where it cannot be run there.
fn criterion_of(config: &StudyConfig, schedule: &Schedule, total_time_s: f64) -> Option<f64> {
    let checked = config.check_for_evaluation().ok()?;
    let evaluator = checked.evaluator();
    let timeline = Timeline::new(checked.test(), schedule).ok()?;
    let held_s: f64 = schedule.positions().iter().map(|p| p.dwell_s).sum();
    let factor = (held_s + total_time_s - timeline.total_time_s()) / held_s;
    if !(factor > 0.0 && factor.is_finite()) {
        return None;
    }
    let scaled = schedule.positions().iter().map(|p| ScheduledPosition {
        dwell_s: p.dwell_s * factor,
        ..*p
    });
    let timeline = Timeline::unchecked(checked.test(), scaled);
    criterion(&evaluator, &timeline).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::Control;

    const STAND: &str = "[gimbals]\nbeta_deg = [-30, 30]\n[motion]\nslew_rate_deg_per_s = 1\n\
                         settle_s = 60\n[search]\nstarts = 6\nmax_positions = 8\n";

    /// By the exact chain, each key of it halved.
    #[test]
    fn what_wanders_is_a_limit_too() {
        let toml = "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 0.003\n\
                    bias_instability_deg_per_h = 0.002\nbias_correlation_time_s = 600\n\
                    [accelerometer]\nacceleration_random_walk_ug_per_sqrt_h = 5\n\
                    bias_instability_ug = 4\nbias_correlation_time_s = 900\n[objective]\n\
                    total_time_s = 6000\n";
        let study = Study::from_toml(toml).unwrap();
        let schedule = study
            .standard(crate::StandardScheme::Icosahedron12)
            .unwrap();
        let of = |study: &Study| study.evaluate(&schedule).unwrap().document().clone();
        let found = of(&study);
        let mut least = 1.0_f64;
        for (key, _, place) in wandering() {
            let limit = found.limits.iter().find(|l| l.what == key);
            let ratio = limit.unwrap_or_else(|| panic!("{key}")).criterion_ratio;
            let mut config = study.config().clone();
            let size = place(&mut config.platform);
            *size = size.map(|v| 0.5 * v);
            let halved = of(&Study::from_config(config).unwrap());
            let expected = halved.score.criterion / found.score.criterion;
            assert!(
                (ratio / expected - 1.0).abs() < 1e-6,
                "{key}: {ratio} {expected}"
            );
            assert!(ratio <= 1.0 + 1e-9, "{key}: {ratio}");
            least = least.min(ratio);
        }
        assert!(least < 0.9, "{least}");
    }

    #[test]
    fn each_limit_is_the_criterion_with_one_thing_better() {
        let study = Study::from_toml(STAND).unwrap();
        let found = study.search(&Control::default()).unwrap();
        let limits = &found.document().evaluation.limits;
        let ratio = |what: &str| {
            let limit = limits.iter().find(|l| l.what == what);
            limit
                .unwrap_or_else(|| panic!("{what} in {limits:?}"))
                .criterion_ratio
        };
        // Everything helps, and the most helpful comes first.
        assert!(
            limits.iter().all(|l| l.criterion_ratio < 1.0 + 1e-9),
            "{limits:?}"
        );
        assert!(limits.is_sorted_by(|a, b| a.criterion_ratio <= b.criterion_ratio));
        let _ = ratio("gimbals.beta_deg");
        // What another study says of the same schedule.
        let quieter = StudyConfig {
            platform: {
                let mut platform = study.config().platform.clone();
                platform.accelerometer.noise_g = Some(0.5e-5);
                platform
            },
            ..study.config().clone()
        };
        let quieter = Study::from_config(quieter).unwrap();
        let evaluated = quieter.evaluate(found.schedule()).unwrap();
        let expected =
            evaluated.document().score.criterion / found.document().evaluation.score.criterion;
        assert!((ratio("accelerometer.noise_g") / expected - 1.0).abs() < 1e-6);
    }

    /// A range that is used to its ends costs something.
    #[test]
    fn a_narrow_range_is_a_limit() {
        let narrow = "[gimbals]\nalpha_deg = [-20, 20]\n[search]\nstarts = 6\nmax_positions = 8\n";
        let study = Study::from_toml(narrow).unwrap();
        let found = study.search(&Control::default()).unwrap();
        let limits = &found.document().evaluation.limits;
        let range = limits
            .iter()
            .find(|l| l.what == "gimbals.alpha_deg")
            .unwrap();
        assert!(range.criterion_ratio < 0.98, "{range:?}");
    }

    /// A schedule that is the best for a filter which ignores something is balanced for its noises: with
    /// less noise the filter trusts what it misreads. Estimating it is what helps.
    #[test]
    fn what_the_filter_ignores_is_a_limit() {
        let considered = "[errors.considered]\naccelerometer_bias_ug = 100\n";
        let study = Study::from_toml(&format!("{STAND}{considered}")).unwrap();
        let found = study.search(&Control::default()).unwrap();
        let first = &found.document().evaluation.limits[0];
        assert_eq!(first.what, "errors.considered.accelerometer_bias_ug");
        assert!(first.criterion_ratio < 0.9, "{first:?}");
    }

    /// Whatever the stand allows, it allows with wider ranges.
    #[test]
    fn wider_ranges_never_make_a_test_worse() {
        let schedule = Schedule::from_csv(
            "alpha_deg,beta_deg,gamma_deg,dwell_s\n-79.347,75,-85.626,110\n-87,-41,142.406,250\n\
             80,49.78,155.155,100\n-49,-3.582,-124.506,860\n28.956,-19,154.904,330\n",
        );
        let schedule = schedule.unwrap();
        for (latitude_deg, drift, motion) in [
            (89.0, 1e6, "repositioning = \"frame-hold\""),
            (28.2, 15.0, "slew_rate_deg_per_s = 2"),
            (-33.0, 0.5, "slew_rate_deg_per_s = 0.5\nsettle_s = 30"),
        ] {
            let study = Study::from_toml(&format!(
                "[site]\nlatitude_deg = {latitude_deg}\n[motion]\n{motion}\n\
                 [prior]\nconstant_drift_deg_per_h = {drift}\n\
                 g_sensitive_drift_deg_per_h_per_g = 0.5\n\
                 [gimbals]\nalpha_deg = [-100, 100]\nbeta_deg = [-45, 90]\ngamma_deg = [-180, 180]\n"
            ));
            let limits = study.unwrap().limits(&schedule);
            let of_ranges = limits.iter().filter(|l| l.what.starts_with("gimbals."));
            let ratios: Vec<f64> = of_ranges.map(|l| l.criterion_ratio).collect();
            assert_eq!(ratios.len(), 2);
            assert!(ratios.iter().all(|r| *r <= 1.0), "{motion}: {ratios:?}");
        }
    }
}
