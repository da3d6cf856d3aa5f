//! The whole of the allowed ranges: the two computations agree to 1e-6, or both are withheld with
//! a reason; nothing panics, nothing hangs.

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::evaluate::{AGREEMENT, Evaluator, Objective};
use scheme_opt::internals::platform::{AxisValue, GSensitivePrior, PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

use crate::support::Random;

/// Powers of ten between the exponents; now and then one of the ends.
fn power(random: &mut Random, low: f64, high: f64) -> f64 {
    let exponent = match random.unit() {
        u if u < 0.08 => low,
        u if u < 0.16 => high,
        _ => random.between(low, high),
    };
    10.0_f64.powf(exponent)
}

/// A prior of 1e-6 to 1e`most` °/h, or zero.
fn prior(random: &mut Random, most: f64) -> AxisValue {
    let one = |random: &mut Random| match random.unit() < 0.1 {
        true => 0.0,
        false => power(random, -6.0, most),
    };
    match random.unit() < 0.5 {
        true => AxisValue::All(one(random)),
        false => AxisValue::PerAxis(std::array::from_fn(|_| one(random))),
    }
}

pub fn extreme_platform(random: &mut Random, most: f64) -> PlatformConfig {
    let mut c = PlatformConfig::default();
    c.site.latitude_deg = match random.unit() {
        u if u < 0.1 => 90.0,
        u if u < 0.2 => -90.0,
        u if u < 0.3 => 0.0,
        _ => random.between(-90.0, 90.0),
    };
    c.accelerometer.noise_g = Some(power(random, -9.0, -1.0));
    c.gyro.random_drift_deg_per_h = Some(match random.unit() < 0.15 {
        true => 0.0,
        false => power(random, -6.0, 3.0),
    });
    c.filter.period_s = power(random, -2.0, 3.0);
    c.prior.misalignment_deg = AxisValue::All(match random.unit() < 0.15 {
        true => 0.0,
        false => power(random, -6.0, 1.9),
    });
    c.prior.constant_drift_deg_per_h = prior(random, most);
    c.prior.g_sensitive_drift_deg_per_h_per_g = match random.unit() < 0.5 {
        true => GSensitivePrior::All(prior(random, most)),
        false => GSensitivePrior::PerAxis {
            input: prior(random, most),
            output: prior(random, most),
            spin: prior(random, most),
        },
    };
    match random.unit() {
        u if u < 0.3 => c.motion.slew_rate_deg_per_s = Some(power(random, -1.0, 2.0).into()),
        u if u < 0.4 => c.motion.repositioning = Repositioning::FrameHold,
        _ => {}
    }
    c
}

/// 1 to 500 positions, dwells of 0 to 1e6 s, at most `periods` filter periods in all.
pub fn extreme_schedule(random: &mut Random, period_s: f64, periods: f64) -> Schedule {
    let count = power(random, 0.0, 500.0_f64.log10()).round().min(500.0);
    let longest_s = (period_s * periods / count).min(1e6);
    let axis_aligned = random.unit() < 0.3;
    let positions = (0..count as usize).map(|_| {
        let mut angle = || match axis_aligned {
            true => 90.0 * random.between(-2.0, 3.0).floor(),
            false => random.between(-180.0, 180.0),
        };
        let position = Position::from_deg(angle(), angle(), angle());
        let dwell_s = match random.unit() {
            u if u < 0.1 => 0.0,
            u if u < 0.3 => longest_s * random.unit(),
            _ => (longest_s * random.unit() / period_s).floor() * period_s,
        };
        ScheduledPosition::new(position, dwell_s)
    });
    Schedule::new(positions.collect()).unwrap()
}

/// What became of some cases.
struct Outcome {
    /// Both computations withheld.
    refused: u64,
    /// Slow slews take more periods of a hundredth of a second than are allowed.
    too_long: u64,
}

/// Evaluates `cases` of them with priors up to 1e`most`.
fn evaluate(cases: u64, first: u64, periods: f64, most: f64) -> Outcome {
    let mut outcome = Outcome {
        refused: 0,
        too_long: 0,
    };
    let mut worst = 0.0_f64;
    for case in first..first + cases {
        let random = &mut Random::of_case(case);
        let config = extreme_platform(random, most);
        let schedule = extreme_schedule(random, config.filter.period_s, periods);
        let evaluator = Evaluator::new(config.check().unwrap(), Objective::default());
        match evaluator.evaluate(&schedule) {
            Ok(found) => {
                assert!(found.agreement <= AGREEMENT, "case {case}");
                worst = worst.max(found.agreement);
                let sigma = found.end.sigma_deg_per_h();
                let prior = found.prior_sigma_deg_per_h;
                for (s, p) in sigma.iter().zip(prior.iter()) {
                    assert!(s.is_finite() && *s >= 0.0, "case {case}");
                    assert!(*s <= p * (1.0 + 1e-9), "case {case}: {s:e} {p:e}");
                    assert_eq!(*s == 0.0, *p == 0.0, "case {case}");
                }
            }
            Err(error) if error.key() == Some("filter.period_s") => outcome.too_long += 1,
            Err(error) => {
                let text = error.to_string();
                assert!(
                    error.is_numerical() || error.is_disagreement(),
                    "case {case}: {text}"
                );
                println!("case {case}: {text}\n{config:?}");
                println!("{} positions", schedule.positions().len());
                outcome.refused += 1;
            }
        }
    }
    println!(
        "priors to 1e{most}: {cases} cases, {} refused, {} too long, agreement {worst:.1e}",
        outcome.refused, outcome.too_long
    );
    outcome
}

#[test]
fn both_computations_agree_over_the_ranges() {
    let found = evaluate(250, 1, 400.0, 6.0);
    assert_eq!((found.refused, found.too_long), (0, 0));
}

#[test]
fn with_the_weakest_priors_they_agree_too() {
    let found = evaluate(250, 1000, 400.0, 12.0);
    assert_eq!((found.refused, found.too_long), (0, 2));
}

/// A misalignment of 79° against measurements of 1e-9 g: beside 1e18, in doubles, the I of
/// I + R11 P R11ᵀ is lost, and its root is of a negative number.
#[test]
fn the_widest_misalignment_beside_the_quietest_accelerometers_is_not_lost() {
    for case in [11_319, 11_423] {
        assert_eq!(evaluate(1, case, 2000.0, 6.0).refused, 0);
    }
}

/// `cargo test --release --test it in_many_and_longer -- --ignored --nocapture`
#[test]
#[ignore = "the long form of the tests above"]
fn both_computations_agree_in_many_and_longer_tests_or_refuse() {
    let usual = evaluate(3000, 10_000, 2000.0, 6.0);
    let weakest = evaluate(3000, 20_000, 2000.0, 12.0);
    assert_eq!(usual.refused, 0);
    assert!(weakest.refused <= 3, "{} of 3000 refused", weakest.refused);
}
