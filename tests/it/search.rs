//! The search as a library caller sees it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use scheme_opt::internals::criterion::Criterion;
use scheme_opt::internals::drift::CoefficientVector;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::schedule::standard::StandardScheme;
use scheme_opt::internals::search::front::front;
use scheme_opt::internals::search::shortest::shortest;
use scheme_opt::internals::search::{
    Control, EnoughTime, Reason, SearchOutcome, SearchProblem, Status, search,
};

fn evaluator(objective: Objective, change: impl FnOnce(&mut PlatformConfig)) -> Evaluator {
    let mut config = PlatformConfig::default();
    change(&mut config);
    Evaluator::new(config.check().unwrap(), objective)
}

fn run(evaluator: &Evaluator, problem: &SearchProblem) -> SearchOutcome {
    search(evaluator, problem, &Control::default()).unwrap()
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
            let standard = scheme.schedule(12_000.0, evaluator.test()).unwrap();
            let standard = evaluator.evaluate(&standard).unwrap();
            assert!(standard.rms_sigma_deg_per_h() > 4.0 * rms, "{name}");
        }
    }
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let evaluator = evaluator(Objective::default(), |c| {
        c.motion.slew_rate_deg_per_s = Some(0.5.into());
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
        c.motion.slew_rate_deg_per_s = Some(0.5.into());
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
    let timeline = Timeline::new(evaluator.test(), &found.schedule).unwrap();
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
        Criterion::max_ratio(spec),
    ];
    let problem = SearchProblem {
        starts: 12,
        ..SearchProblem::default()
    };
    let found = criteria.clone().map(|criterion| {
        let objective = Objective {
            criterion,
            ..Objective::default()
        };
        run(&evaluator(objective, |_| {}), &problem).evaluation
    });
    // Each winner is the best of the four by its own criterion.
    for (i, criterion) in criteria.iter().enumerate() {
        let own = criterion.value(&found[i].end).unwrap();
        for other in &found {
            let theirs = criterion.value(&other.end).unwrap();
            assert!(own <= theirs * 1.002, "{criterion:?}: {own} {theirs}");
        }
    }
}

#[test]
fn separability_can_be_asked_for() {
    let problem = SearchProblem {
        starts: 8,
        ..SearchProblem::default()
    };
    let plain = run(&evaluator(Objective::default(), |_| {}), &problem).evaluation;
    let least = plain.score.least_separability;
    let asking = |minimum_separability| Objective {
        minimum_separability,
        ..Objective::default()
    };
    let wanted = 1.3 * least;
    let asked = run(&evaluator(asking(wanted), |_| {}), &problem);
    assert_eq!(asked.status, Status::Converged, "{}", asked.reason);
    let score = asked.evaluation.score;
    assert!(score.least_separability >= wanted && score.meets_minimum_separability);
    assert!(score.criterion >= plain.score.criterion * 0.999);
    // At the pole the input coefficients' sum is never seen: what cannot be had is said, beside
    // the nearest schedule.
    let at_pole = evaluator(asking(0.1), |c| c.site.latitude_deg = 90.0);
    let impossible = run(&at_pole, &problem);
    assert_eq!(impossible.status, Status::Infeasible);
    let Reason::SeparabilityMissed { minimum, nearest } = impossible.reason else {
        panic!("{}", impossible.reason);
    };
    assert!(minimum == 0.1 && nearest < 0.1, "{nearest}");
    // Two positions cannot separate twelve coefficients either.
    let few = SearchProblem {
        max_positions: 2,
        ..problem
    };
    let impossible = run(&evaluator(asking(0.01), |_| {}), &few);
    assert_eq!(impossible.status, Status::Infeasible);
}

#[test]
fn the_smallest_tests_are_planned_too() {
    // Exactly one dwell; periods that do not divide the minimum dwell; one long period.
    let cases = [
        (10.0, 60.0, 60.0),
        (100.0, 60.0, 1200.0),
        (600.0, 60.0, 3600.0),
        (10.0, 15.0, 20.0),
    ];
    for (period_s, min_dwell_s, total_time_s) in cases {
        let evaluator = evaluator(Objective::default(), |c| {
            c.filter.period_s = period_s;
            c.motion.min_dwell_s = min_dwell_s;
        });
        let problem = SearchProblem {
            total_time_s,
            starts: 4,
            ..SearchProblem::default()
        };
        let found = run(&evaluator, &problem);
        assert!(found.evaluation.total_time_s <= total_time_s);
        for p in found.schedule.positions() {
            assert!(p.dwell_s >= min_dwell_s);
        }
    }
}

#[test]
fn a_search_can_be_stopped_and_then_has_a_best_so_far() {
    let evaluator = evaluator(Objective::default(), |_| {});
    let problem = SearchProblem {
        starts: 100_000,
        ..SearchProblem::default()
    };
    let cancel = Arc::new(AtomicBool::new(false));
    let reports = Arc::new(AtomicU64::new(0));
    let (stop, count) = (Arc::clone(&cancel), Arc::clone(&reports));
    let control = Control::default()
        .with_cancel(cancel)
        .with_progress(move |_| {
            count.fetch_add(1, Ordering::Relaxed);
            stop.store(true, Ordering::Relaxed);
        });
    let found = search(&evaluator, &problem, &control).unwrap();
    assert_eq!(found.status, Status::Interrupted);
    assert!(found.counters.starts < 100);
    assert!(found.evaluation.rms_sigma_deg_per_h() < 0.01);
    assert!(reports.load(Ordering::Relaxed) > 0);

    let control =
        Control::default().with_deadline(Some(Instant::now() + Duration::from_millis(30)));
    let found = search(&evaluator, &problem, &control).unwrap();
    assert_eq!(found.status, Status::TimeLimit);
    assert!(found.evaluation.rms_sigma_deg_per_h() < 0.01);
}

#[test]
fn what_cannot_be_searched_is_refused() {
    let table = evaluator(Objective::default(), |c| c.gimbals.step_deg = Some(15.0));
    let control = Control::default();
    let turning = SearchProblem {
        allow_tumbling: true,
        ..SearchProblem::default()
    };
    let error = search(&table, &turning, &control).unwrap_err();
    assert_eq!(error.key(), Some("search.allow_tumbling"));
    let nowhere = evaluator(Objective::default(), |c| {
        c.gimbals.step_deg = Some(90.0);
        c.gimbals.beta_deg = Some([10.0, 60.0]);
    });
    let error = search(&nowhere, &SearchProblem::default(), &control).unwrap_err();
    assert!(error.is_infeasible());
    let short = SearchProblem {
        total_time_s: 20.0,
        ..SearchProblem::default()
    };
    let free = evaluator(Objective::default(), |_| {});
    assert!(search(&free, &short, &control).unwrap_err().is_infeasible());
    assert!(shortest(&free, &short, &control).unwrap_err().is_input());
}

#[test]
fn turning_during_the_dwells_is_better_still() {
    let evaluator = evaluator(Objective::default(), |_| {});
    let problem = SearchProblem {
        starts: 24,
        allow_tumbling: true,
        ..SearchProblem::default()
    };
    let found = run(&evaluator, &problem).evaluation;
    assert!(
        found.rms_sigma_deg_per_h() < 0.000_903,
        "{}",
        found.rms_sigma_deg_per_h()
    );
    assert!((found.total_time_s - 12_000.0).abs() < 1e-6);
}

/// Turning round and round while it measures shows much to so few positions; but without tumbling a
/// gimbal turns once at the most on the way to a position.
#[test]
fn a_fast_stand_that_measures_is_not_wound_up() {
    let evaluator = evaluator(Objective::default(), |c| {
        c.motion.slew_rate_deg_per_s = Some(100.0.into());
        c.motion.measure_moves = true;
        c.motion.return_to_start = true;
    });
    for seed in 1..=4 {
        let problem = SearchProblem {
            total_time_s: 3000.0,
            max_positions: 2,
            starts: 4,
            seed,
            ..SearchProblem::default()
        };
        let found = run(&evaluator, &problem);
        let timeline = Timeline::new(evaluator.test(), &found.schedule).unwrap();
        for leg in timeline.legs() {
            for change in leg.arrival.map_or([0.0; 3], |m| m.change) {
                assert!(change.to_degrees().abs() < 360.0 + 1e-6, "{change}");
            }
        }
    }
}

#[test]
fn positions_on_an_index_table_are_on_the_table() {
    for (step, bound, starts) in [(90.0, 0.0037, 12), (45.0, 0.00098, 8), (15.0, 0.00095, 2)] {
        let evaluator = evaluator(Objective::default(), |c| c.gimbals.step_deg = Some(step));
        let problem = SearchProblem {
            starts,
            ..SearchProblem::default()
        };
        let found = run(&evaluator, &problem);
        // The evaluation has checked that every angle is a multiple of the step.
        let rms = found.evaluation.rms_sigma_deg_per_h();
        println!("{step}: {rms}");
        assert!(rms < bound, "{step}: {rms}");
    }
}

#[test]
fn shortest_and_most_accurate_agree() {
    let spec_deg_per_h = CoefficientVector::repeat(0.002);
    let objective = Objective {
        spec_deg_per_h: Some(spec_deg_per_h),
        ..Objective::default()
    };
    let evaluator = evaluator(objective.clone(), |_| {});
    let problem = SearchProblem {
        total_time_s: 14_400.0,
        starts: 4,
        ..SearchProblem::default()
    };
    let control = Control::default();
    let found = shortest(&evaluator, &problem, &control).unwrap();
    assert_eq!(found.status, Status::Converged);
    assert!(found.evaluation.end.sigma_deg_per_h().max() <= 0.002);
    // One per cent less time is not enough.
    let ratio = Objective {
        criterion: Criterion::max_ratio(spec_deg_per_h),
        ..objective
    };
    let less = SearchProblem {
        total_time_s: 0.99 * found.evaluation.total_time_s,
        ..problem.clone()
    };
    let evaluator = Evaluator::new(evaluator.test().clone(), ratio);
    assert!(run(&evaluator, &less).evaluation.score.criterion > 1.0);

    // In 8000 s it cannot be met, and what would be needed is said.
    let hasty = SearchProblem {
        total_time_s: 8000.0,
        starts: 4,
        ..problem
    };
    let missed = shortest(&evaluator, &hasty, &control).unwrap();
    assert_eq!(missed.status, Status::Infeasible);
    let words = missed.reason.to_string();
    let Reason::NotInTime { enough, .. } = missed.reason else {
        panic!("{words}");
    };
    assert!(
        matches!(enough, EnoughTime::Found(t) if t > hasty.total_time_s),
        "{enough:?}"
    );
    assert!(words.contains("can be met in"), "{words}");
}

#[test]
fn the_front_falls() {
    let evaluator = evaluator(Objective::default(), |_| {});
    let problem = SearchProblem {
        starts: 8,
        ..SearchProblem::default()
    };
    let found = front(&evaluator, &problem, 5, &Control::default()).unwrap();
    assert_eq!(found.status, Status::Converged);
    assert_eq!(found.front.len(), 5);
    for pair in found.front.windows(2) {
        assert!(pair[0].total_time_s < pair[1].total_time_s);
        assert!(pair[0].evaluation.score.value > pair[1].evaluation.score.value);
    }
    assert!(found.front[4].evaluation.rms_sigma_deg_per_h() < 0.000_91);
}
