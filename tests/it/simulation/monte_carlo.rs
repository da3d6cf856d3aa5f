//! Many runs: consistency, divergence, the specification.

use std::collections::BTreeMap;

use scheme_opt::internals::drift::{COEFFICIENTS, CoefficientVector, DriftCoefficient};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::simulate::consistency::Verdict;
use scheme_opt::internals::simulate::divergence::Sign;
use scheme_opt::internals::simulate::judgement::Judgement;
use scheme_opt::internals::simulate::specification::Decision;
use scheme_opt::internals::simulate::{
    FilterModel, MonteCarlo, Simulation, SimulationOptions, ToldNoise, TruthModel,
};

use super::{monte_carlo, optimised, platform, simulation, twelve, with};

#[test]
fn errors_are_as_large_as_the_filter_says() {
    let found = monte_carlo(1.0, 500, SimulationOptions::default());
    println!(
        "NEES {:?}\ncoefficients {:?}\nNIS {:?}",
        found.nees, found.nees_coefficients, found.nis
    );
    for statistic in [found.nees, found.nees_coefficients, found.nis] {
        assert_eq!(statistic.unwrap().verdict, Verdict::Consistent);
    }
    assert_eq!(found.verdict(), Verdict::Consistent);
    // 15 ratios, each outside with one in twenty: three or more outside is one in thirty.
    let [low, high] = found.ratio_bounds;
    let ratios: Vec<f64> = found
        .coefficients
        .iter()
        .chain(&found.misalignment)
        .map(|c| c.ratio.unwrap())
        .collect();
    let outside = ratios.iter().filter(|r| !(low..=high).contains(*r)).count();
    assert!(outside <= 2, "{ratios:?} against {low} to {high}");
    assert!(ratios.iter().all(|r| (r - 1.0).abs() < 0.12), "{ratios:?}");
    for position in &found.positions {
        let nees = position.nees.unwrap();
        assert!((nees.average / 15.0 - 1.0).abs() < 0.06, "{position:?}");
    }
}

/// One run in a hundred goes to a wrong solution, and its filter is as sure of it as ever: the RMS
/// error is 15 000 times the plan, the σ of the filter are those of the plan.
#[test]
fn a_diverged_run_is_counted_and_nothing_is_met() {
    let platform = platform(4.0, |_| {});
    let simulation = simulation(&platform, &twelve(), SimulationOptions::default());
    let found = simulation.monte_carlo(100, 1).unwrap();
    let spec = CoefficientVector::repeat(0.005);
    let judged = Judgement::new(&found, Some(&spec), &BTreeMap::new());
    let sentences: Vec<String> = judged.findings.iter().map(ToString::to_string).collect();
    println!("{sentences:#?}");
    assert_eq!(found.divergence.count, 1);
    let lost = &found.divergence.listed[0];
    assert_eq!(lost.run, 94);
    assert!(lost.signs.contains(&Sign::Error) && lost.signs.contains(&Sign::Residuals));
    assert!(lost.rms_error_deg_per_h.unwrap() > 100.0);
    assert!(found.rms_error_deg_per_h() > 10.0 && found.rms_sigma_deg_per_h() < 0.002);
    assert!(found.divergence.rms_error_of_the_others_deg_per_h.unwrap() < 0.002);
    assert_eq!((judged.verdict, judged.passed), (Verdict::Diverged, false));
    assert_eq!(judged.specification.unwrap().decision, Decision::NotMet);
    assert!(sentences[0].starts_with("1 of 100 runs diverged"));
    for sentence in &sentences {
        let says_well = ["is met:", "is consistent", ", as planned"];
        assert!(
            !says_well.iter().any(|w| sentence.contains(w)),
            "{sentence}"
        );
    }
    // The run can be looked at by its number.
    let trajectory = simulation.trajectory(&simulation.draw(1, lost.run), 1, lost.run);
    assert!(trajectory.samples.last().unwrap().nees > 1e6);
}

/// The default platform with the extended filter: a fifth of the runs never gets over its first
/// points of linearisation.
#[test]
fn the_extended_filter_diverges_on_the_default_platform() {
    let options = with(TruthModel::Nonlinear, FilterModel::Extended);
    let simulation = simulation(&platform(1.0, |_| {}), &twelve(), options);
    let found = simulation.monte_carlo(100, 5).unwrap();
    let d = &found.divergence;
    println!("{d:?}");
    assert!((10..30).contains(&d.count), "{}", d.count);
    assert!(d.noticed < d.count);
    assert_eq!(found.verdict(), Verdict::Diverged);
    // The specification that the other runs keep is not shown to be met by all.
    let spec = CoefficientVector::repeat(1.0);
    let judged = Judgement::new(&found, Some(&spec), &BTreeMap::new());
    assert_eq!(judged.specification.unwrap().decision, Decision::NotDecided);
}

#[test]
fn the_specification_is_decided_by_the_errors_of_the_runs() {
    let found = monte_carlo(1.0, 100, SimulationOptions::default());
    let rms = found.coefficients.map(|c| c.rms_error);
    for (times, decision) in [
        (2.0, Decision::Met),
        (1.1, Decision::NotDecided),
        (0.95, Decision::NotDecided),
        (0.5, Decision::NotMet),
    ] {
        let spec = CoefficientVector::from_fn(|i, _| times * rms[i]);
        let judged = Judgement::new(&found, Some(&spec), &BTreeMap::new());
        let check = judged.specification.unwrap();
        assert_eq!(check.decision, decision, "{times}");
        assert_eq!(check.coefficients.len(), COEFFICIENTS);
        assert_eq!(judged.passed, decision == Decision::Met);
        let needed = check.runs_needed;
        assert_eq!(needed.is_some(), decision == Decision::NotDecided);
        assert!(needed.is_none_or(|n| n > 100), "{needed:?}");
    }
    let mut one = CoefficientVector::repeat(f64::INFINITY);
    assert_eq!(
        Judgement::new(&found, Some(&one), &BTreeMap::new()).specification,
        None
    );
    one[3] = 1.0;
    let check = Judgement::new(&found, Some(&one), &BTreeMap::new())
        .specification
        .unwrap();
    assert_eq!(check.coefficients[0].name, DriftCoefficient::IX);
    assert_eq!(
        Judgement::new(&found, None, &BTreeMap::new()).specification,
        None
    );
}

#[test]
fn a_filter_told_a_third_of_the_noise_is_found_out() {
    for (truth, filter) in [
        (TruthModel::Nonlinear, FilterModel::Iterated),
        (TruthModel::FirstOrder, FilterModel::Linear),
    ] {
        let told = |factor| with(truth, filter).with_told(ToldNoise::both(factor));
        let found = monte_carlo(1.0, 200, told(1.0 / 3.0));
        let nees = found.nees.unwrap();
        println!("{truth:?}, a third: NEES {:.1}", nees.average);
        assert_eq!(found.verdict(), Verdict::Optimistic);
        // All runs are wrong alike: none diverged.
        assert_eq!(found.divergence.count, 0);
        // Nine times the variance, in all that the test determines.
        assert!((nees.average / (9.0 * 15.0) - 1.0).abs() < 0.1);
        assert_eq!(found.nis.unwrap().verdict, Verdict::Optimistic);
        let modest = monte_carlo(1.0, 200, told(3.0));
        assert_eq!(modest.verdict(), Verdict::Pessimistic);
    }
}

#[test]
fn linear_truth_needs_no_more_than_the_linear_filter() {
    let found = monte_carlo(1.0, 500, with(TruthModel::FirstOrder, FilterModel::Linear));
    for statistic in [found.nees, found.nees_coefficients, found.nis] {
        assert_eq!(statistic.unwrap().verdict, Verdict::Consistent);
    }
    let ratio = found.rms_error_deg_per_h() / found.rms_planned_sigma_deg_per_h();
    assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let found: Vec<MonteCarlo> = [1, 2, 5]
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| monte_carlo(1.0, 12, SimulationOptions::default()))
        })
        .into();
    assert_eq!(found[0], found[1]);
    assert_eq!(found[0], found[2]);
}

#[test]
fn a_run_of_the_monte_carlo_can_be_looked_at() {
    let platform = platform(1.0, |_| {});
    let simulation = simulation(&platform, &optimised(), SimulationOptions::default());
    let found = simulation.monte_carlo(2, 7).unwrap();
    let nees: f64 = (0..2)
        .map(|run| {
            let trajectory = simulation.trajectory(&simulation.draw(7, run), 7, run);
            trajectory.samples.last().unwrap().nees
        })
        .sum();
    assert!((0.5 * nees / found.nees.unwrap().average - 1.0).abs() < 1e-12);
}

#[test]
fn what_cannot_be_simulated_is_refused() {
    let platform = platform(1.0, |c| c.filter.period_s = 0.01);
    let timeline = Timeline::new(&platform.clone().into(), &optimised()).unwrap();
    let error = Simulation::new(&platform, &timeline, SimulationOptions::default()).unwrap_err();
    assert_eq!(error.key(), Some("filter.period_s"));
    let platform = super::platform(1.0, |_| {});
    let options = SimulationOptions::default().with_told(ToldNoise::both(0.0));
    let timeline = Timeline::new(&platform.clone().into(), &optimised()).unwrap();
    assert!(Simulation::new(&platform, &timeline, options).is_err_and(|e| e.is_input()));
    let good = simulation(&platform, &optimised(), SimulationOptions::default());
    assert_eq!(good.monte_carlo(1, 1).unwrap_err().key(), Some("runs"));
}
