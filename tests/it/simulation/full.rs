//! Platforms with more errors than the twelve coefficients.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use scheme_opt::internals::covariance::CovarianceModel;
use scheme_opt::internals::drift::{COEFFICIENTS, CoefficientVector};
use scheme_opt::internals::model::Role;
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{AxisValue, Platform, PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::Schedule;
use scheme_opt::internals::simulate::consistency::{Consistency, Verdict};
use scheme_opt::internals::simulate::judgement::Judgement;
use scheme_opt::internals::simulate::{
    FilterModel, InitialTruth, MonteCarlo, Simulation, SimulationOptions, StateCheck, TruthModel,
    TruthNoise,
};

use super::{moving, simulation, with};
use crate::battery::full::{FullCase, full_cases};
use crate::support::Random;

fn case(name: &str) -> FullCase {
    let mut all = full_cases().into_iter();
    all.find(|case| case.name == name).unwrap()
}

/// 33 parameters and twelve oblique positions; priors of the drift times `drift`.
fn thirty_three(drift: f64, change: impl FnOnce(&mut PlatformConfig)) -> (Platform, Schedule) {
    let FullCase {
        mut config,
        schedule,
        ..
    } = case("full-oblique-twelve");
    let small = super::platform_config(drift);
    config.prior = small.prior;
    change(&mut config);
    (config.check().unwrap(), schedule)
}

fn monte_carlo(
    (platform, schedule): &(Platform, Schedule),
    runs: usize,
    options: SimulationOptions,
) -> MonteCarlo {
    let simulation = simulation(platform, schedule, options);
    simulation.monte_carlo(runs, 2).unwrap()
}

fn all_judged(found: &MonteCarlo) -> [Consistency; 4] {
    [
        found.nees,
        found.nees_parameters,
        found.nees_coefficients,
        found.nis,
    ]
    .map(Option::unwrap)
}

fn assert_consistent(found: &MonteCarlo) {
    for statistic in all_judged(found) {
        println!("{statistic:?}");
        assert_eq!(statistic.verdict, Verdict::Consistent);
    }
    assert_eq!(found.verdict(), Verdict::Consistent);
}

// ------------------------------------------------------------------------------ filter

/// The gains of the linear filter, and what it does not know, are those of other people's filters.
#[test]
fn the_linear_filters_sigma_is_that_of_the_reference() {
    let options = with(TruthModel::FirstOrder, FilterModel::Linear);
    let close = |found: f64, expected: f64| (found / expected - 1.0).abs() < 1e-6;
    for case in full_cases() {
        let platform = case.config.check().unwrap();
        let found = monte_carlo(&(platform, case.schedule.clone()), 2, options);
        let mut known = 0;
        for p in &found.parameters {
            let (name, check) = (p.parameter.name, &p.check);
            if p.parameter.role == Role::Considered {
                assert_eq!(check.planned_sigma, p.parameter.prior_sigma);
                continue;
            }
            known += 1;
            assert!(close(check.planned_sigma, case.sigma[name]), "{name}");
            // The linear filter has one covariance, whatever it measures.
            assert!(close(check.sigma, case.sigma[name]), "{name}");
            match case.claimed_sigma.get(name) {
                Some(claimed) => assert!(close(check.claimed_sigma.unwrap(), *claimed), "{name}"),
                None => assert_eq!(check.claimed_sigma, None),
            }
        }
        assert_eq!(known, case.sigma.len(), "{}", case.name);
        for (check, expected) in found
            .misalignment
            .iter()
            .zip(case.misalignment_arcsec.iter().flatten())
        {
            assert!(close(check.planned_sigma, *expected), "{}", case.name);
        }
    }
}

/// Each error in turn is in the platform alone and the filter does not know of it. Without noise its
/// estimates are then wrong by just what the covariance says they are, which knows the error by another
/// table, other attitudes and another integral.
#[test]
fn the_truth_of_every_error_is_that_of_the_covariance() {
    let bases: [PlatformConfig; 4] = [
        serde_json::json!({ "motion": { "slew_rate_deg_per_s": 0.5, "settle_s": 25.0 } }),
        serde_json::json!({ "motion": { "slew_rate_deg_per_s": 0.5, "measure_moves": true },
            "gyro": { "output_axis": { "X": "+y", "Y": [0.6, 0.0, -0.8], "Z": "-y" } },
            "gimbals": { "axes": ["+z", "-x", "+z"] },
            "stand": { "heading_deg": 25.0, "tilt_deg": [3.0, -70.0] } }),
        serde_json::json!({ "motion": { "return_to_start": true, "start_deg": [10, -50, 30] } }),
        serde_json::json!({ "motion": { "repositioning": "frame-hold" } }),
    ]
    .map(|config| serde_json::from_value(config).unwrap());
    for (k, base) in bases.iter().enumerate() {
        for name in ALL_ERRORS {
            let mut config = base.clone();
            // Large beside what noise does.
            let value = if name.starts_with('D') { 20.0 } else { 1e4 };
            config
                .errors
                .considered
                .parameter
                .insert(name.into(), value);
            let schedule = moving().1;
            let mut positions = schedule.positions().to_vec();
            for (i, p) in positions.iter_mut().enumerate() {
                p.dwell_s = 200.0 + 37.0 * i as f64;
            }
            if k == 1 {
                positions[1].move_measured = Some(false);
            }
            let schedule = Schedule::new(positions).unwrap();
            let platform = config.check().unwrap();
            let options =
                with(TruthModel::FirstOrder, FilterModel::Linear).with_noise(TruthNoise::None);
            let simulation = simulation(&platform, &schedule, options);
            let initial = InitialTruth {
                misalignment_n_arcsec: Vector3::zeros(),
                drift_deg_per_h: CoefficientVector::zeros(),
                others: vec![value],
            };
            let run = simulation.trajectory(&initial, 1, 0);
            let end = run.samples.last().unwrap();
            let found = simulation.monte_carlo(2, 1).unwrap();
            let drift = off(&found.coefficients, end.drift_estimate_deg_per_h.as_slice());
            let psi = off(
                &found.misalignment,
                end.misalignment_n_error_arcsec.as_slice(),
            );
            assert!(drift < 1e-5, "{name} in {k}: drift off by {drift:e}");
            assert!(psi < 1e-5, "{name} in {k}: psi off by {psi:e}");
        }
    }
}

/// How far `errors` are from what the checks say that the ignored parameter does, by the largest sigma.
fn off(checks: &[StateCheck], errors: &[f64]) -> f64 {
    let ignored = |c: &StateCheck| {
        let square = c.sigma.powi(2) - c.claimed_sigma.unwrap().powi(2);
        square.max(0.0).sqrt()
    };
    let expected: Vec<f64> = checks.iter().map(ignored).collect();
    let largest = checks.iter().map(|c| c.sigma).fold(0.0, f64::max);
    let pairs = errors.iter().zip(&expected);
    let off = pairs.map(|(error, expected)| (error.abs() - expected).abs());
    off.fold(0.0, f64::max) / largest
}

const ALL_ERRORS: [&str; 49] = [
    "D_IIX", "D_IIY", "D_IIZ", "D_SSX", "D_SSY", "D_SSZ", "D_IOX", "D_IOY", "D_IOZ", "D_ISX",
    "D_ISY", "D_ISZ", "D_OSX", "D_OSY", "D_OSZ", "D_OOX", "D_OOY", "D_OOZ", "T_XX", "T_YY", "T_ZZ",
    "T_XY", "T_XZ", "T_YX", "T_YZ", "T_ZX", "T_ZY", "K_0X", "K_0Y", "K_0Z", "K_1X", "K_1Y", "K_1Z",
    "M_YX", "M_ZX", "M_ZY", "K_2X", "K_2Y", "K_2Z", "K_3X", "K_3Y", "K_3Z", "K_IPX", "K_IPY",
    "K_IPZ", "K_IOX", "K_IOY", "K_IOZ", "G",
];

#[test]
fn nonlinear_truth_of_all_errors_agrees_with_the_linear_model_to_second_order() {
    let mut random = Random(5);
    for mode in [
        "slew_rate_deg_per_s = 0.5",
        "settle_s = 10",
        "repositioning = \"frame-hold\"",
    ] {
        let mut config: PlatformConfig = toml::from_str(&format!("[motion]\n{mode}\n")).unwrap();
        for (k, name) in ALL_ERRORS.iter().enumerate() {
            let table = match k % 2 {
                0 => &mut config.errors.estimated,
                _ => &mut config.errors.considered,
            };
            table.parameter.insert((*name).into(), 1.0);
        }
        let (platform, schedule) = (config.check().unwrap(), moving().1);
        let parameters = &platform.errors().parameters()[COEFFICIENTS..];
        let sizes = parameters.iter().map(|p| match p.group {
            group if group.contains("torquer") => 2000.0,
            group if group.contains("drift") => 5.0,
            _ => 500.0,
        });
        let direction: Vec<f64> = sizes.map(|size| random.between(-size, size)).collect();
        let drift = CoefficientVector::from_fn(|_, _| random.between(-10.0, 10.0));
        let path = |truth, scale: f64| -> Vec<Vector3<f64>> {
            let options = with(truth, FilterModel::Linear).with_noise(TruthNoise::None);
            let initial = InitialTruth {
                misalignment_n_arcsec: Vector3::new(300.0, -100.0, 200.0) * scale,
                drift_deg_per_h: drift * scale,
                others: direction.iter().map(|v| v * scale).collect(),
            };
            let run = simulation(&platform, &schedule, options).trajectory(&initial, 1, 0);
            let samples = run.samples.iter();
            samples.map(|s| s.misalignment_n_arcsec).collect()
        };
        let difference = |scale: f64| -> f64 {
            let (exact, first) = (
                path(TruthModel::Nonlinear, scale),
                path(TruthModel::FirstOrder, scale),
            );
            let pairs = exact.iter().zip(&first);
            pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
        };
        let (large, small) = (difference(1e-2), difference(1e-3));
        println!("{mode}: {large:e} arcsec at 1/100, {small:e} at 1/1000");
        let order = (large / small).log10();
        assert!((order - 2.0).abs() < 0.02, "{mode}: order {order}");
    }
}

// --------------------------------------------------------------------------- many runs

#[test]
fn errors_of_33_parameters_are_as_large_as_the_linear_filter_says() {
    let options = with(TruthModel::FirstOrder, FilterModel::Linear);
    let found = monte_carlo(&thirty_three(1.0, |_| {}), 500, options);
    assert_consistent(&found);
    assert_eq!(
        all_judged(&found).map(|c| c.degrees_of_freedom),
        [36, 33, 12, 3]
    );
    let checks = found.parameters.iter().map(|p| p.check);
    let ratios: Vec<f64> = checks
        .chain(found.misalignment)
        .map(|c| c.ratio.unwrap())
        .collect();
    // One in twenty by chance, of 36: more than five would be one in a hundred.
    let [low, high] = found.ratio_bounds;
    let outside = ratios.iter().filter(|r| !(low..=high).contains(*r)).count();
    assert!(outside <= 5, "{ratios:?}");
    assert!(ratios.iter().all(|r| (r - 1.0).abs() < 0.12), "{ratios:?}");
    let ratio = found.rms_error_deg_per_h() / found.rms_planned_sigma_deg_per_h();
    assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
    assert!(found.claimed.is_none() && found.rms_claimed_sigma_deg_per_h().is_none());
}

#[test]
fn errors_of_33_parameters_are_as_large_as_the_iterated_filter_says() {
    let found = monte_carlo(
        &thirty_three(0.01, |_| {}),
        100,
        SimulationOptions::default(),
    );
    assert_consistent(&found);
    assert_eq!(found.divergence.count, 0);
    let ratio = found.rms_error_deg_per_h() / found.rms_planned_sigma_deg_per_h();
    assert!((ratio - 1.0).abs() < 0.08, "{ratio}");
    for position in &found.positions {
        let nees = position.nees_parameters.unwrap();
        assert!((nees.average / 33.0 - 1.0).abs() < 0.1, "{position:?}");
    }
}

/// Everything at once: all families, another mounting, slews that are measured, azimuth.
#[test]
fn a_platform_with_every_error_is_estimated_while_it_moves() {
    let mut full = case("all-sixteen-slews");
    full.config.prior = super::platform_config(0.01).prior;
    full.config.azimuth.noise_arcsec = Some(20.0);
    full.config.motion.measure_moves = true;
    let platform = full.config.check().unwrap();
    let estimated = platform.errors().estimated();
    let found = monte_carlo(&(platform, full.schedule), 30, SimulationOptions::default());
    assert_consistent(&found);
    let nees = found.nees_parameters.unwrap();
    assert_eq!(nees.degrees_of_freedom, estimated);
    assert_eq!(found.nis.unwrap().degrees_of_freedom, 4);
}

/// The bias of the accelerometers is in the platform and not in the filter.
fn considered(drift: f64) -> (Platform, Schedule) {
    thirty_three(drift, |config| {
        let bias = config.errors.estimated.accelerometer_bias_ug.take();
        config.errors.considered.accelerometer_bias_ug = bias;
    })
}

#[test]
fn what_the_filter_ignores_shows_as_the_budget_says() {
    let ignoring = considered(1.0);
    let (platform, schedule) = &ignoring;
    let options = with(TruthModel::FirstOrder, FilterModel::Linear);
    let found = monte_carlo(&ignoring, 500, options);
    assert_consistent(&found);
    let timeline = Timeline::new(&platform.clone().into(), schedule).unwrap();
    let full = CovarianceModel::new(platform)
        .full_covariance(&timeline)
        .unwrap();
    let budget = full
        .budget
        .iter()
        .find(|g| g.role == Role::Considered)
        .unwrap();
    assert_eq!(found.ignored_groups(), [budget.group]);
    let claimed = found.rms_claimed_sigma_deg_per_h().unwrap();
    let error = found.rms_error_deg_per_h();
    let added = (error.powi(2) - claimed.powi(2)).sqrt();
    let predicted = budget.rms_error_deg_per_h();
    println!("adds {added} deg/h, by the budget {predicted}, of {error}; claimed {claimed}");
    assert!((added / predicted - 1.0).abs() < 0.1);
    let truth = (full.parameters.view((0, 0), (12, 12)).trace() / 12.0).sqrt();
    assert!((error / truth - 1.0).abs() < 0.1 && error > 15.0 * claimed);
    // A filter that knew as little as it claims would be wrong beyond all bounds.
    let own = found.claimed.unwrap();
    assert_eq!(own.nees.unwrap().verdict, Verdict::Optimistic);
    assert!(own.nees.unwrap().average > 1000.0 * 33.0);
    let judged = Judgement::new(&found, None, &BTreeMap::new());
    let sentences: Vec<String> = judged.findings.iter().map(ToString::to_string).collect();
    let all = sentences.join("\n");
    for part in [
        "does not know of accelerometer_bias_ug",
        "compared with the true sigma",
        "By what it claims itself it is optimistic",
        "The truth is as predicted",
    ] {
        assert!(all.contains(part), "{part} in {all}");
    }
    assert!(judged.passed);
}

#[test]
fn what_a_filter_ignores_does_not_make_a_nonlinear_run_diverge() {
    let found = monte_carlo(&considered(0.01), 60, SimulationOptions::default());
    assert_consistent(&found);
    assert_eq!(found.divergence.count, 0);
    // The stand would see it.
    let own = found.claimed.unwrap();
    assert_eq!(own.nis.unwrap().verdict, Verdict::Optimistic);
}

/// Torquers that the filter does not know of ruin a test of moves without duration.
#[test]
fn moves_without_duration_turn_the_torquers() {
    let ignoring = |mode| {
        thirty_three(1.0, |config| {
            config.errors.estimated = Default::default();
            config.errors.considered.torquer_scale_factor_ppm = Some(AxisValue::All(1000.0));
            config.motion.repositioning = mode;
        })
    };
    let options = with(TruthModel::FirstOrder, FilterModel::Linear);
    let [slew, hold] = [Repositioning::Slew, Repositioning::FrameHold]
        .map(|mode| monte_carlo(&ignoring(mode), 300, options));
    for found in [&slew, &hold] {
        assert_eq!(found.verdict(), Verdict::Consistent);
        let ratio = found.rms_error_deg_per_h() / found.rms_planned_sigma_deg_per_h();
        assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
    }
    let times = |f: &MonteCarlo| f.rms_error_deg_per_h() / f.rms_claimed_sigma_deg_per_h().unwrap();
    println!(
        "slew {} times, frame-hold {} times",
        times(&slew),
        times(&hold)
    );
    // Frame-hold has no such moves; what is left is the Earth's rate.
    assert!(times(&slew) > 50.0 && times(&hold) < 0.2 * times(&slew));
}

// ------------------------------------------------------------------------------- edges

#[test]
fn errors_known_exactly_leave_everything_as_it_is() {
    let known = thirty_three(1.0, |config| {
        let mut zero = config.errors.estimated.clone();
        for value in [
            &mut zero.torquer_scale_factor_ppm,
            &mut zero.torquer_misalignment_arcsec,
            &mut zero.accelerometer_bias_ug,
            &mut zero.accelerometer_scale_factor_ppm,
            &mut zero.accelerometer_misalignment_arcsec,
            &mut zero.accelerometer_second_order_ug_per_g2,
        ] {
            *value = Some(AxisValue::All(0.0));
        }
        config.errors.estimated = zero;
        config.errors.considered.local_gravity_ug = Some(0.0);
    });
    let absent = thirty_three(1.0, |config| config.errors = Default::default());
    for filter in FilterModel::ALL {
        let options = with(TruthModel::FirstOrder, filter);
        let [known, absent] = [&known, &absent].map(|p| monte_carlo(p, 2, options));
        for (a, b) in known.coefficients.iter().zip(&absent.coefficients) {
            assert!((a.planned_sigma / b.planned_sigma - 1.0).abs() < 1e-12);
        }
        let freedom = |c: Option<Consistency>| c.unwrap().degrees_of_freedom;
        assert_eq!(freedom(known.nees), freedom(absent.nees));
        assert_eq!(freedom(known.nees_parameters), COEFFICIENTS);
        assert_eq!(absent.nees_parameters, None);
        for p in &known.parameters[COEFFICIENTS..] {
            assert_eq!(
                (p.check.rms_error, p.check.sigma, p.check.ratio),
                (0.0, 0.0, None)
            );
        }
    }
}

#[test]
fn a_run_of_a_full_monte_carlo_can_be_looked_at() {
    let (platform, schedule) = considered(0.01);
    let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
    for filter in [FilterModel::Linear, FilterModel::Extended] {
        let options = with(TruthModel::FirstOrder, filter);
        let simulation = Simulation::new(&platform, &timeline, options).unwrap();
        let found = simulation.monte_carlo(2, 7).unwrap();
        let runs = [0, 1].map(|run| simulation.trajectory(&simulation.draw(7, run), 7, run));
        let nees = runs.iter().map(|run| run.samples.last().unwrap().nees);
        let average = 0.5 * nees.sum::<f64>();
        assert!((average / found.nees.unwrap().average - 1.0).abs() < 1e-12);
        let width = 2 + 4 * (3 + 30) + 2;
        let csv = runs[0].to_csv();
        assert!(csv.lines().all(|line| line.split(',').count() == width));
        assert!(csv.starts_with("time_s,position,psi_nx_true_arcsec"));
        for column in ["T_XX_true_ppm", "K_2Z_sigma_ug_per_g2", "M_ZY_error_arcsec"] {
            assert!(csv.contains(column), "{column}");
        }
        assert!(!csv.contains("K_0X") && runs[0].ignores);
    }
}
