//! The search as a library caller sees it.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use scheme_opt::criterion::Criterion;
use scheme_opt::drift::CoefficientVector;
use scheme_opt::evaluate::{Evaluator, Objective};
use scheme_opt::motion::Timeline;
use scheme_opt::platform::PlatformConfig;
use scheme_opt::schedule::standard::StandardScheme;
use scheme_opt::search::{Control, SearchOutcome, SearchProblem, Status, search};

fn evaluator(objective: Objective, change: impl FnOnce(&mut PlatformConfig)) -> Evaluator {
    let mut config = PlatformConfig::default();
    change(&mut config);
    Evaluator::new(config.check().unwrap(), objective)
}

fn run(evaluator: &Evaluator, problem: &SearchProblem) -> SearchOutcome {
    let cancel = AtomicBool::new(false);
    search(evaluator, problem, &Control::new(&cancel, &|_| {})).unwrap()
}

#[test]
fn default_search_is_better_than_the_axis_aligned_schemes_by_far() {
    let evaluator = evaluator(Objective::default(), |_| {});
    for seed in 1..=3 {
        let problem = SearchProblem {
            seed,
            ..SearchProblem::default()
        };
        let found = run(&evaluator, &problem);
        assert_eq!(found.status, Status::Converged);
        let rms = found.evaluation.rms_sigma_deg_per_h();
        assert!(rms <= 0.000_906, "seed {seed}: {rms}");
        assert!((found.evaluation.total_time_s - 12_000.0).abs() < 1e-6);
        assert!(found.schedule.positions().len() <= 24);
        for name in ["faces-6", "faces-12", "axis-24"] {
            let scheme = StandardScheme::from_name(name).unwrap();
            let standard = scheme.schedule(12_000.0, evaluator.platform()).unwrap();
            let standard = evaluator.evaluate(&standard).unwrap();
            assert!(standard.rms_sigma_deg_per_h() > 4.0 * rms, "{name}");
        }
    }
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let evaluator = evaluator(Objective::default(), |c| {
        c.motion.slew_rate_deg_per_s = Some(0.5);
    });
    let problem = SearchProblem {
        starts: 8,
        ..SearchProblem::default()
    };
    let outcomes: Vec<SearchOutcome> = [1, 2, 3]
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| run(&evaluator, &problem))
        })
        .into();
    assert_eq!(outcomes[0], outcomes[1]);
    assert_eq!(outcomes[0], outcomes[2]);
}

#[test]
fn a_real_stand_is_respected() {
    let evaluator = evaluator(Objective::default(), |c| {
        c.gimbals.beta_deg = Some([-60.0, 60.0]);
        c.gimbals.gamma_deg = Some([-170.0, 170.0]);
        c.motion.slew_rate_deg_per_s = Some(0.5);
        c.motion.settle_s = 30.0;
        c.motion.min_dwell_s = 200.0;
    });
    let problem = SearchProblem {
        total_time_s: 14_400.0,
        starts: 8,
        ..SearchProblem::default()
    };
    let found = run(&evaluator, &problem);
    // Timeline::new checks ranges; the moves between lie between their ends.
    let timeline = Timeline::new(evaluator.platform(), &found.schedule).unwrap();
    assert!(timeline.total_time_s() <= 14_400.0 + 1e-6);
    assert!(timeline.total_time_s() > 14_380.0);
    for p in found.schedule.positions() {
        assert!(p.dwell_s >= 200.0);
        assert_eq!(p.dwell_s % 10.0, 0.0);
    }
    assert!(found.evaluation.rms_sigma_deg_per_h() < 0.0013);
}

#[test]
fn every_criterion_is_improved_by_searching_for_it() {
    let spec = CoefficientVector::from_fn(|i, _| if i == 4 { 0.0005 } else { 0.005 });
    let criteria = [
        Criterion::rms(),
        Criterion::D,
        Criterion::E,
        Criterion::MaxRatio {
            spec_deg_per_h: spec,
        },
    ];
    let problem = SearchProblem {
        starts: 12,
        ..SearchProblem::default()
    };
    let found = criteria.map(|criterion| {
        let objective = Objective {
            criterion,
            ..Objective::default()
        };
        run(&evaluator(objective, |_| {}), &problem).evaluation
    });
    // Each winner is the best of the four by its own criterion.
    for (i, criterion) in criteria.iter().enumerate() {
        let own = criterion.value(&found[i].end.coefficients).unwrap();
        for other in &found {
            let theirs = criterion.value(&other.end.coefficients).unwrap();
            assert!(own <= theirs * 1.002, "{criterion:?}: {own} {theirs}");
        }
    }
}

#[test]
fn separability_can_be_asked_for() {
    let plain = run(
        &evaluator(Objective::default(), |_| {}),
        &SearchProblem {
            starts: 8,
            ..SearchProblem::default()
        },
    );
    let least = plain.evaluation.score.least_separability;
    let objective = Objective {
        minimum_separability: 1.2 * least,
        ..Objective::default()
    };
    let asked = run(
        &evaluator(objective, |_| {}),
        &SearchProblem {
            starts: 8,
            ..SearchProblem::default()
        },
    );
    assert!(asked.evaluation.score.least_separability > 1.19 * least);
    assert!(asked.evaluation.score.criterion >= plain.evaluation.score.criterion * 0.999);
    // What cannot be had is said.
    let objective = Objective {
        minimum_separability: 0.99,
        ..Objective::default()
    };
    let problem = SearchProblem {
        starts: 2,
        ..SearchProblem::default()
    };
    let impossible = run(&evaluator(objective, |_| {}), &problem);
    assert_eq!(impossible.status, Status::Infeasible);
    assert!(impossible.reason.contains("0.99"));
}

#[test]
fn a_search_can_be_stopped_and_then_has_a_best_so_far() {
    let evaluator = evaluator(Objective::default(), |_| {});
    let problem = SearchProblem {
        starts: 100_000,
        ..SearchProblem::default()
    };
    let cancel = AtomicBool::new(false);
    let reports = Mutex::new(0);
    let progress = |_: &_| {
        *reports.lock().unwrap() += 1;
        cancel.store(true, Ordering::Relaxed);
    };
    let found = search(&evaluator, &problem, &Control::new(&cancel, &progress)).unwrap();
    assert_eq!(found.status, Status::Interrupted);
    assert!(found.counters.starts < 100);
    assert!(found.evaluation.rms_sigma_deg_per_h() < 0.01);
    assert!(*reports.lock().unwrap() > 0);

    let cancel = AtomicBool::new(false);
    let control = Control::new(&cancel, &|_| {})
        .with_deadline(Some(Instant::now() + Duration::from_millis(30)));
    let found = search(&evaluator, &problem, &control).unwrap();
    assert_eq!(found.status, Status::TimeLimit);
    assert!(found.evaluation.rms_sigma_deg_per_h() < 0.01);
}

#[test]
fn what_cannot_be_searched_is_refused() {
    let table = evaluator(Objective::default(), |c| c.gimbals.step_deg = Some(15.0));
    let cancel = AtomicBool::new(false);
    let control = Control::new(&cancel, &|_| {});
    let error = search(&table, &SearchProblem::default(), &control).unwrap_err();
    assert_eq!(error.key(), Some("gimbals.step_deg"));
    let short = SearchProblem {
        total_time_s: 20.0,
        ..SearchProblem::default()
    };
    let free = evaluator(Objective::default(), |_| {});
    assert!(search(&free, &short, &control).unwrap_err().is_infeasible());
}
