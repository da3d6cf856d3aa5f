//! What cannot be told apart over all parameters, by name, and what to add.

use std::collections::BTreeMap;

use scheme_opt::internals::analysis::Analysis;
use scheme_opt::internals::analysis::additions::{Aim, TurnAxis};
use scheme_opt::internals::evaluate::{Evaluation, Evaluator, Objective};
use scheme_opt::internals::observability::Order;
use scheme_opt::internals::observability::named::{NamedObservability, PlatformAxis, Remedy};
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use serde_json::{Value, json};

use crate::battery::full::{FullCase, full_cases};
use crate::support::{Random, held, random_positions, slewing};

fn evaluator(config: &PlatformConfig) -> Evaluator {
    Evaluator::new(config.check().unwrap(), Objective::default())
}

fn config(value: Value) -> PlatformConfig {
    serde_json::from_value(value).unwrap()
}

fn evaluate(config: &PlatformConfig, schedule: &Schedule) -> Evaluation {
    evaluator(config).evaluate(schedule).unwrap()
}

fn case(name: &str) -> FullCase {
    full_cases().into_iter().find(|c| c.name == name).unwrap()
}

fn words(named: &NamedObservability) -> Vec<String> {
    named.unobserved.iter().map(ToString::to_string).collect()
}

/// Zeros are rounding, and what counts is far from it: the tolerance, 1e-12, stands in a gap of four
/// decades.
#[test]
fn nothing_lies_in_the_gap() {
    let (mut seen, mut unseen) = (f64::INFINITY, 0.0_f64);
    let mut look = |of: &str, named: &NamedObservability| {
        let [least, most] = named.gap;
        assert!(least > 1e-10 && most < 1e-14, "{of}: {:?}", named.gap);
        (seen, unseen) = (seen.min(least), unseen.max(most));
    };
    for case in full_cases() {
        let evaluation = evaluate(&case.config, &case.schedule);
        look(&case.name, evaluation.named.as_ref().unwrap());
    }
    for number in 0..30 {
        let random = &mut Random::of_case(8800 + number);
        let config = random_platform(random);
        let count = 1 + (random.unit() * 11.0) as usize;
        let schedule = held(
            &random_positions(random, count),
            random.between(40.0, 900.0),
        );
        let evaluation = evaluate(&config, &schedule);
        look(&format!("{number}"), evaluation.named.as_ref().unwrap());
    }
    println!("least that counts {seen:.1e}, most that does not {unseen:.1e}");
}

/// A platform with some of the errors, moving in some way.
fn random_platform(random: &mut Random) -> PlatformConfig {
    const GROUPS: [(&str, f64); 11] = [
        ("torquer_scale_factor_ppm", 1000.0),
        ("torquer_misalignment_arcsec", 60.0),
        ("quadratic_drift_deg_per_h_per_g2", 0.1),
        ("quadratic_output_drift_deg_per_h_per_g2", 0.1),
        ("accelerometer_bias_ug", 100.0),
        ("accelerometer_scale_factor_ppm", 200.0),
        ("accelerometer_misalignment_arcsec", 60.0),
        ("accelerometer_second_order_ug_per_g2", 20.0),
        ("accelerometer_third_order_ug_per_g3", 5.0),
        ("accelerometer_cross_coupling_ug_per_g2", 20.0),
        ("local_gravity_ug", 10.0),
    ];
    let mut errors = json!({ "considered": {} });
    for (key, sigma) in GROUPS {
        match random.unit() {
            c if c < 0.5 => errors[key] = sigma.into(),
            c if c < 0.6 => errors[key] = 0.0.into(),
            c if c < 0.7 => errors["considered"][key] = sigma.into(),
            _ => {}
        }
    }
    let mut config = config(json!({ "errors": errors }));
    config.site.latitude_deg = random.between(-80.0, 80.0);
    config.motion.measure_moves = random.unit() < 0.3;
    if random.unit() < 0.5 {
        slewing(&mut config, random, 0.3, 3.0);
    }
    if random.unit() < 0.3 {
        config.azimuth.noise_arcsec = Some(random.between(2.0, 200.0));
    }
    config
}

/// What is named rests on the priors: the exact σ is never below what is said, by itself it is that of
/// before, and it is so whatever the priors.
#[test]
fn what_is_named_rests_on_the_priors_and_nothing_else_does() {
    let mut combinations = 0;
    for number in 0..12 {
        let random = &mut Random::of_case(9100 + number);
        let mut config = random_platform(random);
        config.errors.considered = Default::default();
        let count = 1 + (random.unit() * 5.0) as usize;
        let schedule = held(&random_positions(random, count), 500.0);
        let evaluation = evaluate(&config, &schedule);
        let named = evaluation.named.as_ref().unwrap();
        assert_eq!(named.unknowns - named.rank, named.unobserved.len());
        let sigma: BTreeMap<&str, (f64, f64)> = evaluation
            .parameters
            .iter()
            .map(|p| (p.parameter.name, (p.sigma, p.parameter.prior_sigma)))
            .collect();
        for u in &named.unobserved {
            combinations += 1;
            for floor in &u.rests_on_priors {
                let Some((sigma, prior)) = sigma.get(floor.name) else {
                    assert!(floor.name.starts_with("psi_n"), "{}", floor.name);
                    continue;
                };
                assert!(*sigma >= floor.least_sigma * (1.0 - 1e-6), "{u}");
                if u.combination.terms.len() == 1 {
                    assert!((sigma / prior - 1.0).abs() < 1e-9, "{u}");
                }
            }
        }
        // Whatever is in no such combination keeps its σ, to a part in a thousand, when all priors are
        // a thousand times weaker; nearly so, since the prior tells a little where the test tells little.
        let in_some = |name: &str| {
            let terms = named.unobserved.iter().flat_map(|u| &u.combination.terms);
            terms.clone().any(|t| t.name == name)
        };
        let hidden: Vec<&str> = sigma.keys().copied().filter(|n| in_some(n)).collect();
        for p in &evaluation.parameters {
            if p.separability == Some(0.0) && p.parameter.prior_sigma > 0.0 {
                assert!(hidden.contains(&p.parameter.name), "{}", p.parameter.name);
            }
        }
    }
    assert!(combinations > 50, "{combinations}");
}

#[test]
fn the_papers_two_positions_name_what_they_leave_out() {
    let case = case("two-position");
    let evaluation = evaluate(&case.config, &case.schedule);
    let named = evaluation.named.as_ref().unwrap();
    assert_eq!((named.rank, named.unknowns), (12, 36));
    let words = words(named);
    for expected in [
        "T_ZZ: needs slews about z",
        "T_XZ: needs slews about z",
        "T_YZ: needs slews about z",
        "D_IX: needs other positions",
        "D_OZ: needs other positions",
        "K_1X: needs other positions",
        "K_0Y against K_2Y: needs other positions",
    ] {
        assert!(words.iter().any(|w| w == expected), "{expected}: {words:?}");
    }
    // One torquer error shows: the move turns about x.
    assert!(!words.iter().any(|w| w.contains("T_YX")));
    let t = evaluation
        .parameters
        .iter()
        .find(|p| p.parameter.name == "T_YX");
    assert_eq!(t.unwrap().order, Some(Order::Zero));
}

#[test]
fn the_scale_factors_against_gravity_are_found_exactly_once() {
    const EXPECTED: &str = "K_1X + K_1Y + K_1Z against G: give one of them";
    for name in ["all-sixteen-slews", "mounting"] {
        let case = case(name);
        let named = evaluate(&case.config, &case.schedule).named.unwrap();
        let of_both = words(&named);
        assert_eq!(
            of_both.iter().filter(|w| *w == EXPECTED).count(),
            1,
            "{of_both:?}"
        );
        let give = |w: &&String| w.contains("give one of them");
        assert_eq!(of_both.iter().filter(give).count(), 1);
    }
    // Also where most of it is not seen at all, and not where one of them is known.
    let platform = |gravity: f64| {
        config(json!({ "errors": {
            "accelerometer_bias_ug": 100.0, "accelerometer_scale_factor_ppm": 200.0,
            "local_gravity_ug": gravity,
        }}))
    };
    let schedule = case("two-position").schedule;
    let named = evaluate(&platform(10.0), &schedule).named.unwrap();
    assert_eq!(words(&named)[0], EXPECTED);
    assert!(
        named.unobserved[1..]
            .iter()
            .all(|u| u.remedy == Remedy::OtherPositions)
    );
    let named = evaluate(&platform(0.0), &schedule).named.unwrap();
    assert!(
        !words(&named).iter().any(|w| w.contains('G')),
        "{:?}",
        words(&named)
    );
}

#[test]
fn constant_drift_against_all_its_squares_needs_a_centrifuge() {
    let config = config(json!({ "errors": {
        "quadratic_drift_deg_per_h_per_g2": 0.1, "quadratic_output_drift_deg_per_h_per_g2": 0.2,
    }}));
    let random = &mut Random::of_case(77);
    let evaluation = evaluate(&config, &held(&random_positions(random, 16), 800.0));
    let named = evaluation.named.unwrap();
    let expected = ["X", "Y", "Z"]
        .map(|k| format!("D_F{k} against D_II{k} + D_SS{k} + D_OO{k}: needs a centrifuge"));
    assert_eq!(words(&named), expected);
    // 1/σ² of the sum: 1/15² + 2/0.1² + 1/0.2².
    let least = 1.0 / (1.0 / 225.0 + 2.0 / 0.01 + 1.0 / 0.04_f64).sqrt();
    for floor in &named.unobserved[0].rests_on_priors {
        assert!((floor.least_sigma / least - 1.0).abs() < 1e-9);
    }
    for p in evaluation
        .parameters
        .iter()
        .filter(|p| p.parameter.name == "D_FX")
    {
        assert!(
            p.sigma >= least && p.sigma < 1.1 * least,
            "{} {least}",
            p.sigma
        );
    }
}

#[test]
fn what_the_stand_cannot_show_is_told_from_what_the_schedule_leaves_out() {
    let mut config = config(json!({ "errors": {
        "torquer_scale_factor_ppm": 1000.0, "accelerometer_bias_ug": 100.0,
    }}));
    config.gimbals.alpha_deg = Some([0.0, 0.0]);
    config.gimbals.beta_deg = Some([0.0, 0.0]);
    let schedule = Schedule::new(
        [0.0, 90.0, 200.0]
            .map(|g| {
                let at = scheme_opt::Position::from_deg(0.0, 0.0, g);
                ScheduledPosition::new(at, 600.0)
            })
            .to_vec(),
    )
    .unwrap();
    let named = evaluate(&config, &schedule).named.unwrap();
    let of = |name: &str| {
        let single = named
            .unobserved
            .iter()
            .filter(|u| u.combination.terms.len() == 1);
        single
            .clone()
            .find(|u| u.combination.terms[0].name == name)
            .map(|u| u.remedy.clone())
    };
    // Gravity stays across the platform's z, which East or its opposite never leaves.
    assert_eq!(of("D_IZ"), Some(Remedy::OtherStand), "{:?}", words(&named));
    assert_eq!(of("T_ZZ"), None);
    let mut free = config.clone();
    free.gimbals.beta_deg = None;
    free.gimbals.alpha_deg = None;
    let named = evaluate(&free, &schedule).named.unwrap();
    assert!(
        named
            .unobserved
            .iter()
            .all(|u| u.remedy != Remedy::OtherStand)
    );
    // At a pole no schedule shows the trace of the input coefficients, but with the azimuth measured.
    free.site.latitude_deg = 90.0;
    let random = &mut Random::of_case(5);
    let many = held(&random_positions(random, 14), 600.0);
    let named = evaluate(&free, &many).named.unwrap();
    let other: Vec<_> = named
        .unobserved
        .iter()
        .filter(|u| u.remedy == Remedy::OtherLatitude)
        .collect();
    assert_eq!(other.len(), 1, "{:?}", words(&named));
    assert_eq!(other[0].combination.to_string(), "D_IX + D_IY + D_IZ");
    free.azimuth.noise_arcsec = Some(5.0);
    let with = evaluate(&free, &many);
    assert!(with.named.unwrap().unobserved.is_empty());
    assert_eq!(with.observability.orders[3], Some(Order::First));
}

#[test]
fn a_measured_azimuth_makes_the_input_coefficients_first_order() {
    let case = case("azimuth-eight");
    let evaluator = evaluator(&case.config);
    let evaluation = evaluator.evaluate(&case.schedule).unwrap();
    let o = &evaluation.observability;
    assert!(
        o.orders
            .iter()
            .chain(&o.strict_orders)
            .all(|o| *o == Some(Order::First))
    );
    assert_eq!(o.rank_first_order, o.unknowns);
    let analysis = Analysis::new(&evaluator, &case.schedule, &evaluation).unwrap();
    let remarks: Vec<String> = analysis.remarks.iter().map(ToString::to_string).collect();
    let says = |part: &str| remarks.iter().any(|r| r.contains(part));
    assert!(says("D_IX, D_IY and D_IZ are of order 1"), "{remarks:?}");
    assert_eq!(analysis.azimuth_order, Some(Order::Zero));
    assert!(
        analysis
            .solutions
            .iter()
            .all(|s| s.as_ref().is_ok_and(|s| s.residual < 1e-8))
    );
    // Nothing waits for time where nothing is of order 2.
    assert!(analysis.advice.is_empty(), "{:?}", analysis.advice);
    // Without it they are of order 2.
    let mut without = case.config.clone();
    without.azimuth.noise_arcsec = None;
    let orders = evaluate(&without, &case.schedule).observability.orders;
    assert!(orders[3..6].iter().all(|o| *o == Some(Order::Second)));
}

/// Beside D_IX + D_IY + D_IZ, which a good schedule knows well, the three that quadratic terms add are
/// the worst directions of drift.
#[test]
fn with_quadratic_drift_the_worst_directions_are_vertical() {
    let case = case("all-sixteen-slews");
    let evaluator = evaluator(&case.config);
    let evaluation = evaluator.evaluate(&case.schedule).unwrap();
    let worst = &evaluation.principal_drift;
    for (k, p) in worst.iter().enumerate().take(4) {
        assert_eq!(p.vertical > 0.9, k < 3, "{k}: {}", p.vertical);
    }
    assert!(worst[2].sigma > 2.0 * worst[3].sigma);
    let analysis = Analysis::new(&evaluator, &case.schedule, &evaluation).unwrap();
    let remarks: Vec<String> = analysis.remarks.iter().map(ToString::to_string).collect();
    for part in [
        "D_IIX + D_IOZ - D_ISY",
        "3 worst directions of drift are of this kind",
    ] {
        assert!(remarks[0].contains(part), "{remarks:?}");
    }
}

#[test]
fn what_is_known_exactly_is_no_unknown() {
    let random = &mut Random::of_case(31);
    let schedule = held(&random_positions(random, 3), 700.0);
    let papers = evaluate(&config(json!({})), &schedule).named.unwrap();
    let none = json!({
        "torquer_scale_factor_ppm": 0.0, "accelerometer_bias_ug": 0.0, "local_gravity_ug": 0.0,
    });
    let named = evaluate(&config(json!({ "errors": none })), &schedule)
        .named
        .unwrap();
    assert_eq!((named.rank, named.unknowns), (papers.rank, papers.unknowns));
    assert_eq!(words(&named), words(&papers));
    assert!(!papers.unobserved.is_empty());
    let aligned = config(json!({ "errors": none, "prior": { "misalignment_deg": 0.0 } }));
    let named = evaluate(&aligned, &schedule).named.unwrap();
    assert_eq!(named.unknowns, papers.unknowns - 3);
}

/// A schedule that turns about x alone: a turn about another axis helps the torquers most, and by as much
/// as the exact σ say.
#[test]
fn a_move_is_suggested_where_torquers_are_not_seen() {
    let config = config(json!({
        "errors": { "torquer_scale_factor_ppm": 1000.0, "torquer_misalignment_arcsec": 60.0 },
        "prior": { "g_sensitive_drift_deg_per_h_per_g": 0.0, "misalignment_deg": 0.001 },
        "motion": { "slew_rate_deg_per_s": 1.0 },
    }));
    let schedule = Schedule::new(
        [0.0, 180.0]
            .map(|a| {
                let at = scheme_opt::Position::from_deg(a, 0.0, 0.0);
                ScheduledPosition::new(at, 900.0)
            })
            .to_vec(),
    )
    .unwrap();
    let evaluator = evaluator(&config);
    let evaluation = evaluator.evaluate(&schedule).unwrap();
    let named = evaluation.named.as_ref().unwrap();
    let slews = |u: &&scheme_opt::internals::observability::named::Unobserved| matches!(&u.remedy, Remedy::Slews { axes } if !axes.contains(&PlatformAxis::X) || axes.len() > 1);
    assert!(
        named.unobserved.iter().filter(slews).count() > 0,
        "{:?}",
        words(named)
    );
    let analysis = Analysis::new(&evaluator, &schedule, &evaluation).unwrap();
    let additions = analysis.additions.unwrap().unwrap();
    assert!(matches!(&additions.aim, Aim::Unobserved { parameters } if !parameters.is_empty()));
    let turn = additions.turn.as_ref().unwrap();
    assert_ne!(turn.turn.unwrap().about, TurnAxis::PlatformX);
    assert!(turn.factor > 2.0 && !turn.helps.is_empty());
    for addition in [Some(turn), additions.position.as_ref()]
        .into_iter()
        .flatten()
    {
        let positions = [schedule.positions(), &addition.positions].concat();
        let with = evaluator
            .evaluate(&Schedule::new(positions).unwrap())
            .unwrap();
        assert!((with.total_time_s - addition.total_time_s).abs() < 1e-6);
        assert!((with.score.criterion / addition.criterion - 1.0).abs() < 1e-9);
        for helped in &addition.helps {
            let of = with
                .parameters
                .iter()
                .find(|p| p.parameter.name == helped.name);
            assert!((of.unwrap().sigma / helped.sigma_after - 1.0).abs() < 1e-9);
            let before = evaluation
                .parameters
                .iter()
                .find(|p| p.parameter.name == helped.name);
            assert_eq!(before.unwrap().sigma, helped.sigma);
            assert!(helped.sigma_after < helped.sigma_same_time);
        }
    }
    // The same by the better of both.
    assert!(additions.best().unwrap().factor >= turn.factor);
}

/// Where ψ stays with the platform no move turns a torquer, and none is suggested.
#[test]
fn frame_hold_has_no_move_to_suggest() {
    let case = case("frame-hold-six");
    let evaluator = evaluator(&case.config);
    let evaluation = evaluator.evaluate(&case.schedule).unwrap();
    let analysis = Analysis::new(&evaluator, &case.schedule, &evaluation).unwrap();
    let additions = analysis.additions.unwrap().unwrap();
    assert!(additions.turn.is_none() && additions.position.is_some());
    let named = evaluation.named.unwrap();
    assert!(!named.unobserved.is_empty());
    assert!(
        named
            .unobserved
            .iter()
            .all(|u| u.remedy == Remedy::OtherPositions)
    );
}
