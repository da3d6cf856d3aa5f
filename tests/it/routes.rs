//! Every route to a number, on the whole battery: the judge, the exact chain, and the fast route
//! alone, in lanes and with its gradient.

use scheme_opt::internals::certificate::Certifier;
use scheme_opt::internals::covariance::filter::{step_by_step, step_by_step_extended};
use scheme_opt::internals::covariance::{
    CoefficientCovariance, CovarianceModel, EndCovariance, TickRule,
};
use scheme_opt::internals::criterion::{Criterion, Smoothing};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::Platform;
use scheme_opt::internals::schedule::standard::StandardScheme;
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

use crate::battery::{problems, reference::reference_cases, schedules::Case};

/// What covariances come from: a schedule on a platform.
struct Member {
    name: String,
    platform: Platform,
    schedule: Schedule,
}

impl Member {
    fn timeline(&self) -> Timeline {
        Timeline::new(&self.platform.clone().into(), &self.schedule).unwrap()
    }

    /// The same with every dwell so much longer, s.
    fn longer(&self, by_s: impl Fn(usize) -> f64) -> Timeline {
        let positions = self.schedule.positions().iter().enumerate();
        let longer = positions.map(|(k, p)| ScheduledPosition {
            dwell_s: p.dwell_s + by_s(k),
            ..*p
        });
        let schedule = Schedule::new(longer.collect()).unwrap();
        Timeline::new(&self.platform.clone().into(), &schedule).unwrap()
    }
}

/// The reference cases, a standard scheme on each platform that searches are measured on, and the
/// schedules that are timed.
fn battery() -> Vec<Member> {
    let references = reference_cases().into_iter().map(|case| Member {
        platform: case.config.check().unwrap(),
        name: case.name,
        schedule: case.schedule,
    });
    let problems = problems::all().into_iter().map(|problem| {
        let (evaluator, total_s) = (problem.evaluator(), problem.search_problem(1).total_time_s);
        let platform = evaluator.test().platform().clone();
        let fits = |scheme: &StandardScheme| scheme.schedule(total_s, evaluator.test()).ok();
        let first = [StandardScheme::Icosahedron12, StandardScheme::Axis24];
        let mut schemes = first.iter().chain(&StandardScheme::ALL);
        let schedule = schemes.find_map(fits).unwrap();
        Member {
            name: format!("{}, {}", problem.name, problem.what),
            platform,
            schedule,
        }
    });
    let cases = [
        Case::whole(8),
        Case::relaxed(12),
        Case::slews(),
        Case::whole(12).lasting(120_000.0),
    ];
    let timed = cases.map(|case| Member {
        name: format!("timed, {} positions", case.count),
        platform: case.platform(),
        schedule: case.schedule(0),
    });
    references.chain(problems).chain(timed).collect()
}

/// Largest relative difference of a σ.
fn apart(a: &EndCovariance, b: &EndCovariance) -> f64 {
    let drift = a.sigma_deg_per_h().component_div(&b.sigma_deg_per_h());
    let (psi, other) = (a.misalignment_sigma_arcsec(), b.misalignment_sigma_arcsec());
    let psi = psi.component_div(&other);
    drift
        .iter()
        .chain(psi.iter())
        .map(|r| (r - 1.0).abs())
        .fold(0.0, f64::max)
}

#[test]
fn the_judge_and_the_exact_chain_agree_on_the_whole_battery() {
    for member in battery() {
        let timeline = member.timeline();
        let model = CovarianceModel::new(&member.platform);
        let chain = model.end_covariance(&timeline, TickRule::Filter).unwrap();
        let judge = step_by_step(&member.platform, &timeline, &mut |_| {}).unwrap();
        let worst = apart(&chain, &judge);
        println!("{}: {worst:.1e}", member.name);
        // Ordinary problems lose three or four of sixteen digits in thousands of steps.
        assert!(worst < 1e-11, "{}: {worst:e}", member.name);
    }
}

/// What a filter in 32 digits says is what the same filter says in 16, as far as 16 reach.
#[test]
fn the_judge_agrees_with_itself_in_more_digits() {
    for member in battery()
        .into_iter()
        .filter(|m| m.timeline().total_time_s() < 15_000.0)
    {
        let timeline = member.timeline();
        let doubles = step_by_step(&member.platform, &timeline, &mut |_| {}).unwrap();
        let extended = step_by_step_extended(&member.platform, &timeline, &mut |_| {}).unwrap();
        let worst = apart(&doubles, &extended);
        println!("{}: {worst:.1e}", member.name);
        assert!(worst < 1e-11, "{}: {worst:e}", member.name);
    }
}

#[test]
fn the_fast_route_has_the_values_of_the_exact_chain_in_any_number_of_lanes() {
    let log = |p: &dyn CoefficientCovariance| Criterion::rms().log(p, Smoothing::Exact);
    let slope =
        |p: &dyn CoefficientCovariance| Criterion::rms().log_with_gradient(p, Smoothing::Exact);
    for member in battery() {
        let timelines: Vec<Timeline> = (0..5)
            .map(|i| member.longer(|k| 1.3 * f64::from(i) + 0.7 * k as f64))
            .collect();
        let model = CovarianceModel::new(&member.platform);
        for rule in [TickRule::Filter, TickRule::Relaxed] {
            let single: Vec<f64> = timelines
                .iter()
                .map(|t| model.value(t, rule, log).unwrap())
                .collect();
            for (timeline, value) in timelines.iter().zip(&single) {
                let end = model.end_covariance(timeline, rule).unwrap();
                let exact = Criterion::rms().log(&end, Smoothing::Exact).unwrap();
                // ln of the criterion: absolute is relative.
                let error = (value - exact).abs();
                assert!(error < 1e-11, "{} {rule:?}: {error:e}", member.name);
                // The gradient visits steps that a value leaves out where nothing is to be seen.
                let (by_gradient, _) = model.gradient(timeline, rule, slope).unwrap();
                let error = (by_gradient - exact).abs();
                assert!(error < 1e-11, "{} {rule:?}: {error:e}", member.name);
            }
            let in_lanes = |lanes: usize| -> Vec<f64> {
                let model = CovarianceModel::new(&member.platform).with_most_lanes(lanes);
                let several = model.values(&timelines, rule, log);
                several.into_iter().map(Result::unwrap).collect()
            };
            let (one, four, eight) = (in_lanes(1), in_lanes(4), in_lanes(8));
            assert_eq!(four, one, "{} {rule:?}", member.name);
            assert_eq!(eight, one, "{} {rule:?}", member.name);
            for (a, b) in one.iter().zip(&single) {
                let error = (a - b).abs();
                assert!(error < 1e-11, "{} {rule:?}: {error:e}", member.name);
            }
        }
    }
}

#[test]
fn the_gradient_by_dwells_is_the_slope_of_the_exact_chain() {
    let rule = TickRule::Relaxed;
    let slope =
        |p: &dyn CoefficientCovariance| Criterion::rms().log_with_gradient(p, Smoothing::Exact);
    for member in battery() {
        let model = CovarianceModel::new(&member.platform);
        // Between two ticks, where there is no kink; one dwell in the middle moves.
        let moved = member.schedule.positions().len() / 2;
        let within = 0.37 * member.platform.period_s();
        let h = 1e-3 * member.platform.period_s();
        let at = |by: f64| member.longer(|k| if k == moved { within + by } else { 0.0 });
        let timeline = at(0.0);
        let (_, legs) = model.gradient(&timeline, rule, slope).unwrap();
        let found = legs[timeline.positions().start + moved].dwell_s;
        let log = |by: f64| {
            let end = model.end_covariance(&at(by), rule).unwrap();
            Criterion::rms().log(&end, Smoothing::Exact).unwrap()
        };
        let numeric = (log(h) - log(-h)) / (2.0 * h);
        let error = (found - numeric).abs();
        println!("{}: {found:e}, off by {error:.1e}", member.name);
        // The difference quotient keeps ten digits less those of h.
        assert!(
            error < 1e-7 * found.abs() + 1e-13,
            "{}: {found:e} {numeric:e}",
            member.name
        );
    }
}

/// No search has found anything below what no schedule can beat.
#[test]
fn the_best_values_known_are_above_their_bounds() {
    for problem in problems::all() {
        let (evaluator, total_s) = (problem.evaluator(), problem.search_problem(1).total_time_s);
        let certifier = Certifier::new(evaluator.test().platform());
        let bound = certifier
            .criterion_bound(&evaluator.objective().criterion, total_s)
            .unwrap();
        println!(
            "{}: {:e} of {:e}",
            problem.name, bound.lower_bound, problem.best_known
        );
        // Best values are given to five digits.
        assert!(
            bound.lower_bound < problem.best_known * (1.0 + 1e-4),
            "{}",
            problem.name
        );
    }
}
