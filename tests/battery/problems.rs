//! The fixed set of problems, each with the best value known.

use scheme_opt::internals::criterion::Criterion;
use scheme_opt::internals::drift::{CoefficientVector, DriftCoefficient};
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::platform::{AxisValue, GSensitivePrior, PlatformConfig};
use scheme_opt::internals::search::SearchProblem;

/// A platform, a criterion and a total time.
pub struct Problem {
    pub name: &'static str,
    pub what: &'static str,
    /// The best value of the criterion that any run of any method has reached so far.
    pub best_known: f64,
    total_time_s: f64,
    criterion: Criterion,
    change: fn(&mut PlatformConfig),
}

impl Problem {
    pub fn evaluator(&self) -> Evaluator {
        let mut config = PlatformConfig::default();
        (self.change)(&mut config);
        let objective = Objective {
            criterion: self.criterion.clone(),
            ..Objective::default()
        };
        Evaluator::new(config.check().expect("the set is valid"), objective)
    }

    pub fn search_problem(&self, seed: u64) -> SearchProblem {
        SearchProblem {
            total_time_s: self.total_time_s,
            seed,
            ..SearchProblem::default()
        }
    }
}

fn slews(c: &mut PlatformConfig, rate_deg_per_s: f64, settle_s: f64) {
    c.motion.slew_rate_deg_per_s = Some(rate_deg_per_s.into());
    c.motion.settle_s = settle_s;
}

fn prior(c: &mut PlatformConfig, constant: f64, g_sensitive: f64) {
    c.prior.constant_drift_deg_per_h = AxisValue::All(constant);
    c.prior.g_sensitive_drift_deg_per_h_per_g = GSensitivePrior::All(AxisValue::All(g_sensitive));
}

/// The stand of the user guide: three gimbals, the middle one limited.
fn stand(c: &mut PlatformConfig) {
    c.gimbals.beta_deg = Some([-60.0, 60.0]);
    slews(c, 0.5, 30.0);
}

/// A specification of 0.005 °/h for all coefficients but one, which has a tenth of it.
fn tight_on_one() -> Criterion {
    let mut spec_deg_per_h = CoefficientVector::repeat(0.005);
    if let Some(c) = DriftCoefficient::from_name("D_IX") {
        spec_deg_per_h[c.index()] = 0.0005;
    }
    Criterion::max_ratio(spec_deg_per_h)
}

/// All problems, in the order of the table.
pub fn all() -> Vec<Problem> {
    let rms = Criterion::rms;
    let problem = |name, what, best_known, total_time_s, criterion, change| Problem {
        name,
        what,
        best_known,
        total_time_s,
        criterion,
        change,
    };
    vec![
        problem(
            "free",
            "§3 conditions, instantaneous moves",
            8.9864e-04,
            12_000.0,
            rms(),
            |_| {},
        ),
        problem(
            "free-short",
            "the same in half an hour",
            1.6474e-02,
            1_800.0,
            rms(),
            |_| {},
        ),
        problem(
            "free-long",
            "the same in a day",
            1.9224e-04,
            86_400.0,
            rms(),
            |_| {},
        ),
        problem(
            "slow",
            "0.5 °/s, settle 30 s, four hours",
            7.4281e-04,
            14_400.0,
            rms(),
            |c| {
                slews(c, 0.5, 30.0);
            },
        ),
        problem(
            "very-slow",
            "0.1 °/s, settle 60 s, four hours",
            7.6070e-04,
            14_400.0,
            rms(),
            |c| {
                slews(c, 0.1, 60.0);
            },
        ),
        problem(
            "stand",
            "|β| ≤ 60°, 0.5 °/s, settle 30 s, four hours",
            7.4334e-04,
            14_400.0,
            rms(),
            stand,
        ),
        problem(
            "stand-d",
            "the stand by criterion d",
            5.5271e-04,
            14_400.0,
            Criterion::D,
            stand,
        ),
        problem(
            "stand-e",
            "the stand by criterion e",
            1.8550e-03,
            14_400.0,
            Criterion::E,
            stand,
        ),
        problem(
            "tight-one",
            "the stand, D_IX specified ten times tighter",
            2.1418,
            14_400.0,
            tight_on_one(),
            stand,
        ),
        problem(
            "narrow",
            "|α| ≤ 180°, |β| ≤ 45°, |γ| ≤ 90°, 1 °/s, settle 20 s, three hours",
            1.0340e-03,
            10_800.0,
            rms(),
            |c| {
                c.gimbals.alpha_deg = Some([-180.0, 180.0]);
                c.gimbals.beta_deg = Some([-45.0, 45.0]);
                c.gimbals.gamma_deg = Some([-90.0, 90.0]);
                slews(c, 1.0, 20.0);
            },
        ),
        problem(
            "table-90",
            "index table of 90°, instantaneous",
            2.6531e-03,
            12_000.0,
            rms(),
            |c| {
                c.gimbals.step_deg = Some(90.0);
            },
        ),
        problem(
            "table-45",
            "index table of 45°, 2 °/s, settle 15 s",
            9.2660e-04,
            12_000.0,
            rms(),
            |c| {
                c.gimbals.step_deg = Some(45.0);
                slews(c, 2.0, 15.0);
            },
        ),
        problem(
            "table-15",
            "index table of 15°, |β| ≤ 60°, 1 °/s, settle 30 s",
            9.1213e-04,
            12_000.0,
            rms(),
            |c| {
                c.gimbals.step_deg = Some(15.0);
                c.gimbals.beta_deg = Some([-60.0, 60.0]);
                slews(c, 1.0, 30.0);
            },
        ),
        problem(
            "tactical",
            "tactical grade, 5 °/s, settle 5 s, half an hour",
            1.0521e-01,
            1_800.0,
            rms(),
            |c| {
                c.accelerometer.noise_g = Some(1e-4);
                c.gyro.random_drift_deg_per_h = Some(0.3);
                c.filter.period_s = 1.0;
                prior(c, 50.0, 30.0);
                c.motion.min_dwell_s = 20.0;
                slews(c, 5.0, 5.0);
            },
        ),
        problem(
            "navigation",
            "navigation grade, 1 °/s, settle 60 s, eight hours",
            4.1065e-05,
            28_800.0,
            rms(),
            |c| {
                c.accelerometer.noise_g = Some(2e-6);
                c.gyro.random_drift_deg_per_h = Some(0.001);
                prior(c, 0.5, 0.5);
                slews(c, 1.0, 60.0);
            },
        ),
        problem(
            "equator",
            "latitude 2°, 1 °/s, settle 30 s",
            8.4683e-04,
            12_000.0,
            rms(),
            |c| {
                c.site.latitude_deg = 2.0;
                slews(c, 1.0, 30.0);
            },
        ),
        problem(
            "north",
            "latitude 78°, 1 °/s, settle 30 s",
            2.9486e-03,
            12_000.0,
            rms(),
            |c| {
                c.site.latitude_deg = 78.0;
                slews(c, 1.0, 30.0);
            },
        ),
    ]
}
