//! Every suspicion with a value that raises it and a near one that does not, and nothing for what
//! stands have.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::attitude::Position;
use crate::config::{PerCoefficient, StudySource};
use crate::platform::{AxisValue, GSensitivePrior};
use crate::schedule::ScheduledPosition;

/// What a platform file raises: keys and messages.
fn of_file(text: &str) -> Vec<Warning> {
    let source = StudySource::parse(text, None).unwrap();
    of(&source.config, source.defaulted(), None)
}

fn of_positions(positions: &[[f64; 4]]) -> Vec<Warning> {
    let position =
        |p: &[f64; 4]| ScheduledPosition::new(Position::from_deg(p[0], p[1], p[2]), p[3]);
    let schedule = Schedule::new(positions.iter().map(position).collect()).unwrap();
    of_schedule(&schedule, &StudyConfig::default())
}

#[test]
fn each_doubtful_value_is_named_and_a_near_one_is_not() {
    // Table, what raises, part of the message, what does not.
    let table: &[(&str, &str, &str, &str)] = &[
        (
            "[site]\nlatitude_deg = 0.4922",
            "site.latitude_deg",
            "0.4922 rad is 28.20 deg",
            "[site]\nlatitude_deg = 0.5",
        ),
        (
            "[site]\nlatitude_deg = -1.021",
            "site.latitude_deg",
            "radians",
            "[site]\nlatitude_deg = -1.371",
        ),
        (
            "[site]\nlatitude_deg = 0.696",
            "site.latitude_deg",
            "39.88 deg",
            "[site]\nlatitude_deg = 1.352",
        ),
        (
            "[gimbals]\nbeta_deg = [-1.0472, 1.0472]",
            "gimbals.beta_deg",
            "1.0472 rad is 60.00 deg",
            "[gimbals]\nbeta_deg = [-5, 5]",
        ),
        (
            "[gimbals]\nalpha_deg = [-3.14, 3.14]",
            "gimbals.alpha_deg",
            "179.9 deg",
            "[gimbals]\nalpha_deg = [-7.25, 7.25]",
        ),
        (
            "[gimbals]\ngamma_deg = [0, 6.2832]",
            "gimbals.gamma_deg",
            "360.0 deg",
            "[gimbals]\ngamma_deg = [0, 360]",
        ),
        (
            "[gimbals]\nstep_deg = 0.2618",
            "gimbals.step_deg",
            "15.00 deg",
            "[gimbals]\nstep_deg = 0.25",
        ),
        (
            "[gimbals]\nstep_deg = 1.5708",
            "gimbals.step_deg",
            "90.00 deg",
            "[gimbals]\nstep_deg = 1.6",
        ),
        (
            "[motion]\nstart_deg = [0, 0.7854, 0]",
            "motion.start_deg",
            "45.00 deg",
            "[motion]\nstart_deg = [0.013, 0.025, 0]",
        ),
        (
            "[motion]\nslew_rate_deg_per_s = 0.0087",
            "motion.slew_rate_deg_per_s",
            "0.0087 rad/s is 0.4985 deg/s",
            "[motion]\nslew_rate_deg_per_s = 0.05",
        ),
        (
            "[motion]\nslew_rate_deg_per_s = 1800",
            "motion.slew_rate_deg_per_s",
            "per minute",
            "[motion]\nslew_rate_deg_per_s = 200",
        ),
        (
            "[prior]\nconstant_drift_deg_per_h = 7.27e-5",
            "prior.constant_drift_deg_per_h",
            "15.00 deg/h",
            "[prior]\nconstant_drift_deg_per_h = 0.001",
        ),
        (
            "[prior]\nconstant_drift_deg_per_h = [15, 15, 7.27e-5]",
            "prior.constant_drift_deg_per_h",
            "rad/s",
            "[prior]\nconstant_drift_deg_per_h = [15, 15, 0]",
        ),
        (
            "[prior]\ng_sensitive_drift_deg_per_h_per_g = 3.88e-5",
            "prior.g_sensitive_drift_deg_per_h_per_g",
            "8.003 deg/h per g",
            "[prior]\ng_sensitive_drift_deg_per_h_per_g = 0.01",
        ),
        (
            "[prior]\ng_sensitive_drift_deg_per_h_per_g = { input = 8, output = 8, spin = 3.9e-5 }",
            "prior.g_sensitive_drift_deg_per_h_per_g.spin",
            "rad/s",
            "[prior]\ng_sensitive_drift_deg_per_h_per_g = { input = 8, output = 8, spin = 0 }",
        ),
        (
            "[prior]\nmisalignment_deg = 0.001745",
            "prior.misalignment_deg",
            "0.09998 deg",
            "[prior]\nmisalignment_deg = 0.0017",
        ),
        (
            "[prior]\nmisalignment_deg = 60",
            "prior.misalignment_deg",
            "seconds of arc",
            "[prior]\nmisalignment_deg = 10",
        ),
        (
            "[gyro]\nrandom_drift_deg_per_h = 3e-7",
            "gyro.random_drift_deg_per_h",
            "Radians? 0.0000003 would then be 0.06188",
            "[gyro]\nrandom_drift_deg_per_h = 1e-4",
        ),
        (
            "[gyro]\nrandom_drift_deg_per_h = 4.85e-8",
            "gyro.random_drift_deg_per_h",
            "better than a navigation-grade gyro",
            "[gyro]\nrandom_drift_deg_per_h = 0",
        ),
        (
            "[gyro]\nangle_random_walk_deg_per_sqrt_h = 1.5e-7",
            "gyro.angle_random_walk_deg_per_sqrt_h",
            "Radians?",
            "[gyro]\nangle_random_walk_deg_per_sqrt_h = 1e-5",
        ),
        (
            "[gyro]\nrandom_drift_deg_per_h = 3600",
            "gyro.random_drift_deg_per_h",
            "consumer-grade",
            "[gyro]\nrandom_drift_deg_per_h = 20",
        ),
        (
            "[accelerometer]\nnoise_g = 1e-10",
            "accelerometer.noise_g",
            "strategic-grade accelerometer",
            "[accelerometer]\nnoise_g = 1e-8",
        ),
        (
            "[accelerometer]\nnoise_g = 0.01",
            "accelerometer.noise_g",
            "5.270 times the bias",
            "[accelerometer]\nnoise_g = 1e-3",
        ),
        (
            "[accelerometer]\nnoise_density_ug_per_sqrt_hz = 20000",
            "accelerometer.noise_density_ug_per_sqrt_hz",
            "20.00 times the worst accelerometer",
            "[accelerometer]\nnoise_density_ug_per_sqrt_hz = 5000",
        ),
        (
            "[accelerometer]\nnoise_density_ug_per_sqrt_hz = 0.003",
            "accelerometer.noise_density_ug_per_sqrt_hz",
            "In m/s^2/sqrt(Hz)? 0.003 would then be 305.9 micro-g/sqrt(Hz)",
            "[accelerometer]\nnoise_density_ug_per_sqrt_hz = 0.03",
        ),
        (
            "[accelerometer]\nacceleration_random_walk_ug_per_sqrt_h = 1e-6",
            "accelerometer.acceleration_random_walk_ug_per_sqrt_h",
            "In g/sqrt(h)? 0.000001 would then be 1.000 micro-g/sqrt(h)",
            "[accelerometer]\nacceleration_random_walk_ug_per_sqrt_h = 0.01",
        ),
        (
            "[accelerometer]\nbias_instability_ug = 3e-5\nbias_correlation_time_s = 1800",
            "accelerometer.bias_instability_ug",
            "In g? 0.00003 would then be 30.00 micro-g",
            "[accelerometer]\nbias_instability_ug = 0\nbias_correlation_time_s = 1800",
        ),
        (
            "[accelerometer]\nbias_instability_ug = 3\nbias_correlation_time_s = 2e6",
            "accelerometer.bias_correlation_time_s",
            "2000000 ms is 2000 s",
            "[accelerometer]\nbias_instability_ug = 3\nbias_correlation_time_s = 2e5",
        ),
        (
            "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 2.4e-10",
            "gyro.rate_random_walk_deg_per_h_per_sqrt_h",
            "In rad/s/sqrt(s)? 0.00000000024 would then be 0.002970 deg/h/sqrt(h)",
            "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 1e-5",
        ),
        (
            "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 1.4e-8",
            "gyro.rate_random_walk_deg_per_h_per_sqrt_h",
            "In deg/s/sqrt(s)? 0.000000014 would then be 0.003024 deg/h/sqrt(h)",
            "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 500",
        ),
        (
            "[gyro]\nbias_instability_deg_per_h = 1.5e-8\nbias_correlation_time_s = 600",
            "gyro.bias_instability_deg_per_h",
            "In rad/s? 0.000000015 would then be 0.003094 deg/h",
            "[gyro]\nbias_instability_deg_per_h = 1e-4\nbias_correlation_time_s = 600",
        ),
        (
            "[gyro]\nbias_instability_deg_per_h = 5000\nbias_correlation_time_s = 600",
            "gyro.bias_instability_deg_per_h",
            "50.00 times the worst gyro (100 deg/h)",
            "[gyro]\nbias_instability_deg_per_h = 50\nbias_correlation_time_s = 600",
        ),
        (
            "[gyro]\nbias_instability_deg_per_h = 0.01\nbias_correlation_time_s = 1",
            "gyro.bias_correlation_time_s",
            "1 h is 3600 s",
            "[gyro]\nbias_instability_deg_per_h = 0.01\nbias_correlation_time_s = 60",
        ),
        (
            "[objective]\ntotal_time_s = 200",
            "objective.total_time_s",
            "200 min is 12000 s",
            "[objective]\ntotal_time_s = 600",
        ),
        (
            "[objective]\ntotal_time_s = 4",
            "objective.total_time_s",
            "4 h is 14400 s",
            "[objective]\ntotal_time_s = 300",
        ),
        (
            "[objective]\ntotal_time_s = 7.2e6",
            "objective.total_time_s",
            "7200 s",
            "[objective]\ntotal_time_s = 604800",
        ),
        (
            "[motion]\nsettle_s = 30000",
            "motion.settle_s",
            "30.00 s",
            "[motion]\nsettle_s = 3600",
        ),
        (
            "[motion]\nmin_dwell_s = 60000",
            "motion.min_dwell_s",
            "60.00 s",
            "[motion]\nmin_dwell_s = 1800",
        ),
        (
            "[objective.spec_deg_per_h]\ndefault = 2.4e-8",
            "objective.spec_deg_per_h.default",
            "0.004950 deg/h",
            "[objective.spec_deg_per_h]\ndefault = 1e-5",
        ),
        (
            "[objective.spec_deg_per_h]\nD_IX = 2.4e-8",
            "objective.spec_deg_per_h.D_IX",
            "rad/s",
            "[objective.spec_deg_per_h]\nD_IX = 1e-4",
        ),
        (
            "[filter]\nperiod_s = 1",
            "filter.period_s",
            "both default noises are per filter period",
            "[filter]\nperiod_s = 1\n[accelerometer]\nnoise_g = 3e-5\n[gyro]\nrandom_drift_deg_per_h = 0.03",
        ),
        (
            "[filter]\nperiod_s = 1\n[gyro]\nangle_random_walk_deg_per_sqrt_h = 5e-4",
            "filter.period_s",
            "noise_g = 3.162e-5",
            "[filter]\nperiod_s = 10",
        ),
        (
            "[filter]\nperiod_s = 1\n[accelerometer]\nnoise_density_ug_per_sqrt_hz = 30",
            "filter.period_s",
            "random_drift_deg_per_h = 0.03162",
            "[filter]\nperiod_s = 1\n[accelerometer]\nnoise_density_ug_per_sqrt_hz = 30\n\
             [gyro]\nangle_random_walk_deg_per_sqrt_h = 5e-4",
        ),
    ];
    for (doubtful, key, part, near) in table {
        let found = of_file(doubtful);
        assert_eq!(found.len(), 1, "{doubtful}: {found:?}");
        assert_eq!(found[0].key, *key);
        let words = found[0].to_string();
        assert!(
            words.starts_with(&format!("{key} = ")) && words.contains(part),
            "{words}"
        );
        assert_eq!(of_file(near), [], "{near}");
    }
}

#[test]
fn a_period_alone_says_what_the_defaults_mean_now() {
    let found = of_file("[filter]\nperiod_s = 1");
    let Suspicion::PeriodAlone {
        accelerometer: Some(noise),
        gyro: Some(drift),
    } = found[0].suspicion
    else {
        panic!("{found:?}");
    };
    // σ √T: 10 µg at 10 s and at 1 s; 0.01 °/h likewise, T in hours.
    assert!((noise.meant - 1e-5 * 10.0_f64.sqrt()).abs() < 1e-18);
    assert!((noise.means - 1e-5).abs() < 1e-18);
    assert!((drift.meant - 0.01 * (10.0_f64 / 3600.0).sqrt()).abs() < 1e-15);
    assert!((drift.means - 0.01 / 60.0).abs() < 1e-15);
    assert!(
        found[0].advice().ends_with(
            "accelerometer.noise_g = 3.162e-5 and gyro.random_drift_deg_per_h = 0.03162"
        )
    );
    // With the advice followed the platform is the same to the digits of the advice.
    let same = StudySource::parse(
        "[filter]\nperiod_s = 1\n[accelerometer]\nnoise_g = 3.162e-5\n\
         [gyro]\nrandom_drift_deg_per_h = 0.03162",
        None,
    )
    .unwrap()
    .check()
    .unwrap();
    let usual = StudyConfig::default().check().unwrap();
    let ratio = same.test().platform().drift_psd_rad2_per_s()
        / usual.test().platform().drift_psd_rad2_per_s();
    assert!((ratio - 1.0).abs() < 1e-3);
}

#[test]
#[allow(
    clippy::approx_constant,
    reason = "what somebody writes who writes radians"
)]
fn schedules_in_other_units_are_recognised() {
    let turns = [
        [0.0, 0.0, 0.0, 1000.0],
        [1.0472, 0.0, 0.0, 1000.0],
        [2.9671, 0.8727, -2.3562, 1000.0],
    ];
    let found = of_positions(&turns);
    assert_eq!((found.len(), found[0].key.as_str()), (1, "positions"));
    assert!(
        found[0].message().contains("2.9671 rad, is 170.0 deg"),
        "{}",
        found[0]
    );
    let whole = turns.map(|[a, b, c, s]| [a.round(), b.round(), c.round(), s]);
    let near_zero = turns.map(|[a, b, c, s]| [a * 0.1, b * 0.1, c * 0.1, s]);
    let one_beyond = [turns[1], turns[2], [90.0, 0.0, 0.0, 1000.0]];
    assert_eq!(of_positions(&whole), []);
    assert_eq!(of_positions(&near_zero), []);
    assert_eq!(of_positions(&one_beyond), []);
    for (dwells, unit) in [
        ([10.0, 20.0, 15.0], Some("20 min is 1200 s")),
        ([0.2, 0.3, 0.25], Some("0.3 h is 1080 s")),
        ([6e5, 1.2e6, 6e5], Some("1200000 ms is 1200 s")),
        ([10.0, 20.0, 60.0], None),
        ([600.0, 1200.0, 86_400.0], None),
        ([0.0, 0.0, 0.0], None),
    ] {
        let positions = [30.0, 140.0, -70.0].map(|a| [a, 10.0, 20.0]);
        let positions: Vec<[f64; 4]> = (0..3)
            .map(|i| [positions[i][0], 10.0, 20.0, dwells[i]])
            .collect();
        let found = of_positions(&positions);
        match unit {
            None => assert_eq!(found, []),
            Some(part) => assert!(
                found.len() == 1 && found[0].message().contains(part),
                "{found:?}"
            ),
        }
    }
    // A platform file that thinks such dwells worth while.
    let mut quick = StudyConfig::default();
    quick.platform.motion.min_dwell_s = 5.0;
    let position = ScheduledPosition::new(Position::from_deg(30.0, 0.0, 0.0), 20.0);
    let schedule = Schedule::new(vec![position; 2]).unwrap();
    assert_eq!(of_schedule(&schedule, &quick), []);
    assert_eq!(of_schedule(&schedule, &StudyConfig::default()).len(), 1);
    // A turn that is measured takes its time in the move.
    let mut turning = position;
    (turning.dwell_s, turning.move_s) = (0.0, Some(3000.0));
    let schedule = Schedule::new(vec![position, turning]).unwrap();
    assert_eq!(of_schedule(&schedule, &StudyConfig::default()), []);
}

/// To three digits, as people write.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap()
}

struct Draw(ChaCha8Rng);

impl Draw {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }
    /// Uniform in the logarithm.
    fn spread(&mut self, low: f64, high: f64) -> f64 {
        rounded(self.between(low.ln(), high.ln()).exp())
    }
    fn axes(&mut self, low: f64, high: f64) -> AxisValue {
        match self.0.random_range(0..2) {
            0 => AxisValue::All(self.spread(low, high)),
            _ => AxisValue::PerAxis([0; 3].map(|_| self.spread(low, high))),
        }
    }
    /// Anything that a stand could have.
    fn platform(&mut self) -> StudyConfig {
        let mut c = StudyConfig::default();
        let south = self.0.random_range(0..2) == 0;
        let latitude = (self.between(1.5, 75.0) * 1e4).round() / 1e4;
        c.platform.site.latitude_deg = if south { -latitude } else { latitude };
        let period = *[0.01, 0.1, 1.0, 5.0, 10.0, 30.0, 60.0]
            .get(self.0.random_range(0..7))
            .unwrap();
        c.platform.filter.period_s = period;
        let noise = rounded(self.spread(1e-7, 1e-3) / period.sqrt());
        c.platform.accelerometer.noise_g = Some(noise);
        let walk = self.spread(1e-5, 1.0);
        let gyro = &mut c.platform.gyro;
        match self.0.random_range(0..2) {
            0 => gyro.random_drift_deg_per_h = Some(rounded(walk / (period / 3600.0).sqrt())),
            _ => {
                gyro.random_drift_deg_per_h = None;
                gyro.angle_random_walk_deg_per_sqrt_h = Some(walk);
            }
        }
        c.platform.prior.misalignment_deg = self.axes(0.003, 5.0);
        c.platform.prior.constant_drift_deg_per_h = self.axes(0.001, 100.0);
        c.platform.prior.g_sensitive_drift_deg_per_h_per_g =
            GSensitivePrior::All(self.axes(0.001, 100.0));
        let gimbals = &mut c.platform.gimbals;
        let end = (self.between(20.0, 360.0) * 10.0).round() / 10.0;
        gimbals.beta_deg = Some([-end, end]);
        if self.0.random_range(0..3) == 0 {
            let steps = [0.5, 1.0, 2.5, 5.0, 7.5, 10.0, 15.0, 22.5, 30.0, 45.0, 90.0];
            gimbals.step_deg = Some(steps[self.0.random_range(0..steps.len())]);
        }
        let motion = &mut c.platform.motion;
        motion.slew_rate_deg_per_s = Some(self.spread(0.03, 100.0).into());
        motion.settle_s = rounded(self.between(0.0, 600.0));
        motion.min_dwell_s = rounded(self.between(5.0, 600.0));
        motion.start_deg = Some([0.0, 0.0, -90.0]);
        c.objective.total_time_s = rounded(self.between(1800.0, 200_000.0));
        c.objective.spec_deg_per_h = PerCoefficient::all(self.spread(1e-4, 1.0));
        self.wandering(&mut c);
        c
    }
    fn wandering(&mut self, c: &mut StudyConfig) {
        let gyro = &mut c.platform.gyro;
        gyro.rate_random_walk_deg_per_h_per_sqrt_h = Some(self.spread(1e-5, 100.0));
        gyro.bias_instability_deg_per_h = Some(self.spread(1e-5, 100.0));
        gyro.bias_correlation_time_s = Some(self.spread(20.0, 2e5));
        let accelerometer = &mut c.platform.accelerometer;
        accelerometer.acceleration_random_walk_ug_per_sqrt_h = Some(self.spread(0.01, 1000.0));
        accelerometer.bias_instability_ug = Some(self.spread(0.01, 1000.0));
        accelerometer.bias_correlation_time_s = Some(self.spread(20.0, 2e5));
        if self.0.random_range(0..2) == 0 {
            accelerometer.noise_g = None;
            accelerometer.noise_density_ug_per_sqrt_hz = Some(self.spread(0.1, 1000.0));
        }
    }
    fn schedule(&mut self) -> Schedule {
        let positions = (0..self.0.random_range(2..24)).map(|_| {
            let angles = [0; 3].map(|_| (self.between(-180.0, 180.0) * 1e3).round() / 1e3);
            let [a, b, c] = angles;
            let dwell_s = self.between(60.0, 4000.0).round();
            ScheduledPosition::new(Position::from_deg(a, b, c), dwell_s)
        });
        Schedule::new(positions.collect()).unwrap()
    }
}

#[test]
fn what_stands_have_raises_nothing() {
    let default = StudySource::embedded_default();
    assert_eq!(of(&default.config, default.defaulted(), None), []);
    assert_eq!(of_file(crate::config::DEFAULT_TOML), []);
    let mut draw = Draw(ChaCha8Rng::seed_from_u64(1));
    for number in 0..1000 {
        let (config, schedule) = (draw.platform(), draw.schedule());
        assert!(config.check().is_ok(), "{number}");
        assert_eq!(of(&config, &[], Some(&schedule)), [], "{number}");
    }
}
