//! What the paper says about observability, and what follows from it.

use scheme_opt::internals::analysis::suggest::Suggestion;
use scheme_opt::internals::analysis::{Analysis, PlatformState, state_orders_of_a_dwell};
use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::covariance::CovarianceModel;
use scheme_opt::internals::drift::{CoefficientVector, DriftCoefficient as D, DriftKind};
use scheme_opt::internals::evaluate::{Evaluation, Evaluator, Objective};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::observability::advice::Advice;
use scheme_opt::internals::observability::{Combination, Observability, Order};
use scheme_opt::internals::platform::{PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::standard::StandardScheme;
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

use crate::support::{Random, held, random_positions};

const FIRST: Option<Order> = Some(Order::First);
const SECOND: Option<Order> = Some(Order::Second);

fn analyze(config: &PlatformConfig, schedule: &Schedule) -> Observability {
    let platform = config.check().unwrap();
    let timeline = Timeline::new(&platform.clone().into(), schedule).unwrap();
    Observability::analyze(&CovarianceModel::new(&platform), &timeline).unwrap()
}

fn at(positions: &[Position]) -> Observability {
    analyze(&PlatformConfig::default(), &held(positions, 1000.0))
}

fn evaluator() -> Evaluator {
    let platform = PlatformConfig::default().check().unwrap();
    Evaluator::new(platform, Objective::default())
}

fn scheme(scheme: StandardScheme, evaluator: &Evaluator) -> (Schedule, Evaluation) {
    let schedule = scheme.schedule(12_000.0, evaluator.test()).unwrap();
    let evaluation = evaluator.evaluate(&schedule).unwrap();
    (schedule, evaluation)
}

fn sigma_of(evaluation: &Evaluation, combination: &Combination) -> f64 {
    let weights = combination.coefficients();
    weights.dot(&(evaluation.end.coefficients * weights)).sqrt()
}

// ---------------------------------------------------------------- orders

#[test]
fn orders_of_the_states_are_those_of_the_papers_table() {
    for latitude_deg in [28.2, -70.0, 0.0, 90.0] {
        let mut config = PlatformConfig::default();
        config.site.latitude_deg = latitude_deg;
        let model = CovarianceModel::new(&config.check().unwrap());
        let orders = state_orders_of_a_dwell(&model);
        for (state, order) in PlatformState::ALL.into_iter().zip(orders) {
            // At a pole ψ_y drops out of (10) and (12): ε_z stands alone, ε_y is hidden.
            let pole = latitude_deg == 90.0;
            let expected = match state {
                PlatformState::PsiX | PlatformState::PsiZ => Some(Order::Zero),
                PlatformState::EpsilonX | PlatformState::EpsilonZMinusAzimuth => FIRST,
                PlatformState::EpsilonZ if pole => FIRST,
                PlatformState::EpsilonY | PlatformState::PsiYRate if !pole => SECOND,
                _ => None,
            };
            assert_eq!(order, expected, "{} at {latitude_deg}", state.name());
        }
    }
}

#[test]
fn each_input_coefficient_is_of_order_two_for_1000_random_schedules() {
    let mut random = Random(7);
    let platform = PlatformConfig::default().check().unwrap();
    let model = CovarianceModel::new(&platform);
    for k in 0..1000 {
        let count = 11 + k % 8;
        let positions = (0..count)
            .map(|_| ScheduledPosition::new(random.position(), random.between(60.0, 1500.0)))
            .collect();
        let timeline =
            Timeline::new(&platform.clone().into(), &Schedule::new(positions).unwrap()).unwrap();
        let o = Observability::analyze(&model, &timeline).unwrap();
        for c in D::ALL {
            let expected = match c.kind() {
                DriftKind::Input => SECOND,
                _ => FIRST,
            };
            assert_eq!(o.orders[c.index()], expected, "{} of {k}", c.name());
            // With 11 positions x alone does it, and the strict count agrees.
            assert_eq!(o.strict_orders[c.index()], expected, "{} of {k}", c.name());
        }
        assert_eq!((o.rank, o.rank_first_order, o.rank_x), (13, 12, 11));
    }
}

#[test]
fn axis_aligned_positions_leave_all_of_the_input_coefficients_to_the_second_derivative() {
    let o = at(&StandardScheme::Axis24.positions());
    assert_eq!((o.rank, o.rank_first_order, o.rank_x), (13, 10, 9));
    for c in [D::IX, D::IY, D::IZ] {
        assert_eq!(o.orders[c.index()], SECOND);
    }
    let difference = Combination::of(&[(D::IX, 1.0), (D::IY, -1.0)]);
    assert_eq!(o.order_of(&difference), SECOND);
    assert_eq!(o.order_of(&Combination::input_trace()), SECOND);
}

#[test]
fn oblique_positions_show_the_differences_of_the_input_coefficients_at_order_one() {
    let oblique = at(&random_positions(&mut Random(3), 12));
    for (a, b) in [(D::IX, D::IY), (D::IX, D::IZ), (D::IY, D::IZ)] {
        let difference = Combination::of(&[(a, 1.0), (b, -1.0)]);
        assert_eq!(oblique.order_of(&difference), FIRST);
        assert_eq!(oblique.strict_order_of(&difference), FIRST);
    }
    assert_eq!(oblique.order_of(&Combination::input_trace()), SECOND);
    let scheme = at(&StandardScheme::Icosahedron12.positions());
    let difference = Combination::of(&[(D::IX, 1.0), (D::IY, -1.0)]);
    assert_eq!(scheme.order_of(&difference), FIRST);
}

#[test]
fn a_coefficient_is_never_observable_at_one_position() {
    let mut random = Random(11);
    let mut positions = StandardScheme::Axis24.positions();
    positions.extend(random_positions(&mut random, 50));
    for position in positions {
        let o = at(&[position]);
        assert_eq!(o.rank, 3);
        assert!(o.orders.iter().all(Option::is_none));
    }
}

#[test]
fn four_generic_positions_leave_one_combination_and_five_none() {
    let mut random = Random(5);
    for _ in 0..200 {
        let positions = random_positions(&mut random, 5);
        let four = at(&positions[..4]);
        assert_eq!((four.rank, four.unobservable.len()), (12, 1));
        let five = at(&positions);
        assert_eq!((five.rank, five.unobservable.len()), (13, 0));
        assert!(five.orders.iter().all(Option::is_some));
    }
}

// ---------------------------------------------------------------- the trace

#[test]
fn every_schedule_tells_as_much_about_the_trace_as_any_other_of_its_length() {
    // A(R) t is the same for every attitude, so tᵀ (P_D⁻¹) t is the same for every schedule.
    let evaluator = evaluator();
    let mut random = Random(13);
    let t = Combination::input_trace().coefficients().normalize();
    let mut information = Vec::new();
    for count in [2, 5, 12, 24] {
        let shares: Vec<f64> = (0..count).map(|_| random.between(1.0, 3.0)).collect();
        let sum: f64 = shares.iter().sum();
        let mut left = 1200.0;
        let positions = shares.iter().enumerate().map(|(k, share)| {
            let periods = match k + 1 == count {
                true => left,
                false => (1200.0 * share / sum).round(),
            };
            left -= periods;
            ScheduledPosition::new(random.position(), 10.0 * periods)
        });
        let schedule = Schedule::new(positions.collect()).unwrap();
        let p = evaluator.evaluate(&schedule).unwrap().end.coefficients;
        information.push(t.dot(&(p.try_inverse().unwrap() * t)));
    }
    println!("information on the trace: {information:?}");
    for i in &information {
        assert!((i / information[0] - 1.0).abs() < 1e-5, "{information:?}");
    }
}

#[test]
fn the_trace_is_known_from_the_whole_test_and_not_from_its_dwells() {
    // Z̈ within dwells of 1000 s tells the trace to 0.05 °/h; the filter knows it fourteen times
    // better, because ψ_y carries ε_y from dwell to dwell. But for what separating the others
    // costs, that is as well as one dwell of 12 000 s tells ε_y.
    let evaluator = evaluator();
    let (schedule, evaluation) = scheme(StandardScheme::Icosahedron12, &evaluator);
    let analysis = Analysis::new(&evaluator, &schedule, &evaluation).unwrap();
    let (weakest, sigma) = &analysis.weak[0];
    assert_eq!(weakest.name().to_string(), "D_IX + D_IY + D_IZ");
    println!(
        "trace/sqrt(3): filter {sigma:.5} deg/h, channels of the dwells {:.5} deg/h",
        weakest.channel_sigma_deg_per_h
    );
    assert!(weakest.channel_sigma_deg_per_h > 10.0 * sigma);
    // ε_y = −(D_IX + D_IY + D_IZ)/3.
    let of_epsilon_y = sigma_of(&evaluation, &Combination::input_trace()) / 3.0;
    let one_dwell = held(&[Position::default()], 12_000.0);
    let one = evaluator.evaluate(&one_dwell).unwrap();
    let alone = sigma_of(&one, &Combination::of(&[(D::FY, 1.0), (D::IY, -1.0)]));
    println!("eps_y: {of_epsilon_y:.5} in 12 dwells, {alone:.5} in one of the same length");
    assert!(of_epsilon_y > alone && of_epsilon_y < 2.0 * alone);
}

#[test]
fn oblique_schemes_know_the_input_coefficients_several_times_better() {
    let evaluator = evaluator();
    let (_, oblique) = scheme(StandardScheme::Icosahedron12, &evaluator);
    for aligned in [StandardScheme::Faces12, StandardScheme::Axis24] {
        let (_, aligned_evaluation) = scheme(aligned, &evaluator);
        let name = aligned.name();
        for (a, b) in [(D::IX, D::IY), (D::IX, D::IZ), (D::IY, D::IZ)] {
            let difference = Combination::of(&[(a, 1.0), (b, -1.0)]);
            let ratio =
                sigma_of(&aligned_evaluation, &difference) / sigma_of(&oblique, &difference);
            println!("{name}: {difference} {ratio:.1} times worse than icosahedron-12");
            assert!(ratio > 4.0);
        }
    }
}

#[test]
fn comparing_z_between_dwells_costs_what_the_change_of_psi_y_costs() {
    // The paper's two positions: D_FX from x and D_FZ from z are both of order 1 by (26), but z
    // needs the change of ψ_y, whose error is that of ε_y: the filter says so.
    let evaluator = evaluator();
    let positions = [0.0, 180.0].map(|a| Position::from_deg(a, 0.0, 0.0));
    let schedule = held(&positions, 1000.0);
    let evaluation = evaluator.evaluate(&schedule).unwrap();
    let o = &evaluation.observability;
    assert_eq!(
        (o.orders[D::FX.index()], o.orders[D::FZ.index()]),
        (FIRST, FIRST)
    );
    assert_eq!(o.strict_orders[D::FX.index()], FIRST);
    assert_eq!(o.strict_orders[D::FZ.index()], SECOND);
    let p = &evaluation.end.coefficients;
    let sigma = evaluation.end.sigma_deg_per_h();
    let (fz, iy) = (D::FZ.index(), D::IY.index());
    let correlation = p[(fz, iy)] / (sigma[fz] * sigma[iy]);
    println!(
        "D_FX {:.5}, D_FZ {:.5}, rho(D_FZ, D_IY) {correlation:.3}",
        sigma[0], sigma[2]
    );
    assert!(sigma[fz] > 3.0 * sigma[D::FX.index()] && correlation > 0.9);
}

#[test]
fn frame_hold_exchanges_what_the_azimuth_is_taken_for() {
    let positions = [0.0, 180.0].map(|a| Position::from_deg(a, 0.0, 0.0));
    let schedule = held(&positions, 1000.0);
    let slew = analyze(&PlatformConfig::default(), &schedule);
    let mut config = PlatformConfig::default();
    config.motion.repositioning = Repositioning::FrameHold;
    let hold = analyze(&config, &schedule);
    let azimuth = |c: D, o: &Observability| {
        let with = |sign: f64| {
            let mut d = CoefficientVector::zeros();
            d[c.index()] = 1.0;
            let name = Combination::from_weights(&d, sign).to_string();
            o.unobservable.iter().any(|c| c.to_string() == name)
        };
        with(1.0) || with(-1.0)
    };
    // The paper's simulation biases D_FZ; with ψ^n continuous it is D_SZ.
    assert!(
        azimuth(D::SZ, &slew) && !azimuth(D::FZ, &slew),
        "{:?}",
        slew.unobservable
    );
    assert!(
        azimuth(D::FZ, &hold) && !azimuth(D::SZ, &hold),
        "{:?}",
        hold.unobservable
    );
    assert_eq!(hold.orders[D::SZ.index()], FIRST);
    // Where a change of position tilts the vertical, frame-hold shows ψ_y in ψ_x and ψ_z.
    let tilted = [0.0, 50.0].map(|a| Position::from_deg(a, 0.0, 0.0));
    let o = analyze(&config, &held(&tilted, 1000.0));
    assert_eq!(o.order_of(&Combination::azimuth()), Some(Order::Zero));
    assert_eq!(at(&tilted).order_of(&Combination::azimuth()), None);
}

// ---------------------------------------------------------------- what to add

#[test]
fn the_suggested_position_helps_more_than_the_time_alone() {
    let evaluator = evaluator();
    let (schedule, evaluation) = scheme(StandardScheme::Axis24, &evaluator);
    let s = Suggestion::find(&evaluator, &schedule, &evaluation).unwrap();
    println!(
        "axis-24 and one oblique position: RMS {:.5} from {:.5} deg/h, time alone {:.5}",
        s.after.rms_sigma_deg_per_h, s.before.rms_sigma_deg_per_h, s.same_time.rms_sigma_deg_per_h
    );
    assert!(!s.target_unobservable);
    assert_eq!(
        (s.before.rank_first_order, s.after.rank_first_order),
        (10, 12)
    );
    assert!(s.after.target_sigma_deg_per_h < 0.3 * s.same_time.target_sigma_deg_per_h);
    assert!(s.after.rms_sigma_deg_per_h < 0.5 * s.same_time.rms_sigma_deg_per_h);
    assert!((s.after.total_time_s - s.same_time.total_time_s).abs() < 1e-6);
    assert_eq!(s.schedule.positions().len(), 25);
    // No other attitude does better: a finer look around and elsewhere.
    let mut random = Random(23);
    for _ in 0..40 {
        let mut positions = schedule.positions().to_vec();
        positions.push(ScheduledPosition::new(random.position(), s.dwell_s));
        let other = evaluator
            .evaluate(&Schedule::new(positions).unwrap())
            .unwrap();
        let target = s.target[0].coefficients().normalize();
        let variance = target.dot(&(other.end.coefficients * target));
        assert!(variance.sqrt() > 0.8 * s.after.target_sigma_deg_per_h);
    }
}

#[test]
fn the_suggested_position_is_one_that_the_stand_can_take() {
    let mut config = PlatformConfig::default();
    config.gimbals.beta_deg = Some([-20.0, 20.0]);
    // Many turns: a cable, not an end of the search.
    config.gimbals.gamma_deg = Some([-3000.0, 36_000.0]);
    config.gimbals.step_deg = Some(7.0);
    config.motion.slew_rate_deg_per_s = Some(1.0.into());
    let evaluator = Evaluator::new(config.check().unwrap(), Objective::default());
    let positions = [[0.0, 0.0, 0.0], [91.0, 7.0, 14.0]]
        .map(|a| ScheduledPosition::new(Position::from_deg(a[0], a[1], a[2]), 1000.0));
    let schedule = Schedule::new(positions.to_vec()).unwrap();
    let evaluation = evaluator.evaluate(&schedule).unwrap();
    // That it could be evaluated at all says that it is within the ranges and on the table.
    let s = Suggestion::find(&evaluator, &schedule, &evaluation).unwrap();
    assert!(s.target_unobservable);
    assert_eq!((s.before.rank, s.after.rank), (6, 9));
    for deg in s.position.to_deg() {
        assert!((deg / 7.0 - (deg / 7.0).round()).abs() < 1e-9);
    }
}

#[test]
fn advice_is_what_the_geometry_calls_for() {
    let evaluator = evaluator();
    let advice = |positions: &[Position], dwell_s: f64| {
        let schedule = held(positions, dwell_s);
        let evaluation = evaluator.evaluate(&schedule).unwrap();
        Analysis::new(&evaluator, &schedule, &evaluation)
            .unwrap()
            .advice
    };
    let generic = random_positions(&mut Random(29), 12);
    let four = advice(&generic[..4], 1000.0);
    assert!(
        four.contains(&Advice::MorePositions {
            unobservable: 1,
            at_least: 1
        }),
        "{four:?}"
    );
    let aligned = advice(&StandardScheme::Axis24.positions(), 500.0);
    let oblique = aligned.iter().find_map(|a| match a {
        Advice::ObliquePositions {
            combinations,
            at_least,
        } => Some((combinations.len(), *at_least)),
        _ => None,
    });
    assert_eq!(oblique, Some((2, 1)));
    assert!(
        aligned[0].to_string().contains("D_IX - D_IZ; D_IY - D_IZ"),
        "{}",
        aligned[0]
    );
    let all = advice(&generic, 1000.0);
    assert!(
        matches!(all.as_slice(), [Advice::MoreTime { .. }]),
        "{all:?}"
    );
    let brief = advice(&generic, 20.0);
    assert!(
        brief[0].to_string().contains("for 30 s or more"),
        "{}",
        brief[0]
    );
}

// ---------------------------------------------------------------- the command

#[cfg(feature = "cli")]
mod command {
    use serde_json::Value;

    fn run(args: &[&str], schedule: &str) -> (Option<i32>, String, String) {
        let desk = tempfile::tempdir().unwrap();
        std::fs::write(desk.path().join("s.csv"), schedule).unwrap();
        let output = std::process::Command::new(assert_cmd::cargo::cargo_bin!("scheme-opt"))
            .args(["analyze", "--schedule", "s.csv"])
            .args(args)
            .current_dir(desk.path())
            .output()
            .unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (
            output.status.code(),
            text(output.stdout),
            text(output.stderr),
        )
    }

    const TWO: &str = "alpha_deg,beta_deg,gamma_deg,dwell_s\n0,0,0,1000\n180,0,0,1000\n";
    const SIX: &str = "alpha_deg,beta_deg,gamma_deg,dwell_s\n10,20,30,1000\n50,-40,100,1500\n\
                       -120,30,0,1200\n170,10,-80,900\n-60,-50,200,1100\n95,55,-145,1300\n";

    #[test]
    fn tables_are_narrow_and_name_what_matters() {
        for schedule in [TWO, SIX] {
            let (code, text, stderr) = run(&[], schedule);
            assert_eq!((code, stderr.as_str()), (Some(0), ""));
            assert!(text.lines().all(|l| l.chars().count() <= 80), "{text}");
            assert!(text.contains("seen only through eps_y"), "{text}");
            assert!(
                text.contains("Of all attitudes the gimbals allow"),
                "{text}"
            );
        }
        let (_, text, _) = run(&[], TWO);
        for part in [
            "D_FX = 0.500 x@1 + 0.500 x@2",
            "  1  y  D_FY - D_IY",
            "D_SZ - omega_N psi_y(0)",
            "in other attitudes",
        ] {
            assert!(text.contains(part), "`{part}` in: {text}");
        }
    }

    #[test]
    fn the_document_carries_schema_orders_proof_and_inputs() {
        let (code, text, _) = run(&["--json"], SIX);
        assert_eq!(code, Some(0));
        let document: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(document["schema"], "scheme-opt/analysis/1");
        assert_eq!(document["observability"]["rank"], 13);
        assert_eq!(document["inputs"]["site"]["latitude_deg"], 28.2);
        assert!(
            document["defaulted"]
                .as_array()
                .is_some_and(|d| !d.is_empty())
        );
        let coefficients = document["coefficients"].as_array().unwrap();
        assert_eq!(coefficients.len(), 12);
        for c in coefficients {
            let input = c["name"].as_str().unwrap().starts_with("D_I");
            assert_eq!(c["observability_order"], if input { 2 } else { 1 });
            let proof = &c["reconstruction"];
            assert!(proof["residual"].as_f64().unwrap() < 1e-10);
            assert!(!proof["terms"].as_array().unwrap().is_empty());
        }
        assert_eq!(document["suggestion"]["before"]["total_time_s"], 7000.0);
        assert!(document["tool_version"].is_string() && document["advice"].is_array());
    }

    #[test]
    fn a_position_that_the_platform_cannot_take_is_refused() {
        let (code, stdout, stderr) = run(&["--platform", "none.toml"], TWO);
        assert_eq!((code, stdout.as_str()), (Some(2), ""));
        assert!(stderr.contains("none.toml"), "{stderr}");
    }
}
