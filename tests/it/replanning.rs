//! Planning the rest of an interrupted test: what is done is the prior of what follows.

use scheme_opt::internals::drift::COEFFICIENTS;
use scheme_opt::internals::evaluate::{Evaluation, Evaluator, Objective};
use scheme_opt::internals::motion::Test;
use scheme_opt::internals::platform::{PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use scheme_opt::internals::search::{Control, SearchProblem, search};

use crate::support::Random;

fn positions(random: &mut Random, count: usize) -> Vec<ScheduledPosition> {
    let held = |_| {
        let position = random.position();
        ScheduledPosition::new(position, random.between(100.0, 900.0))
    };
    (0..count).map(held).collect()
}

fn evaluate(test: &Test, schedule: &Schedule) -> Evaluation {
    let evaluator = Evaluator::new(test.clone(), Objective::default());
    evaluator.evaluate(schedule).unwrap()
}

/// The whole covariance carries over: the rest on the interrupted platform is the whole test.
fn same_as_the_whole(change: impl FnOnce(&mut PlatformConfig)) {
    let mut config = PlatformConfig::default();
    change(&mut config);
    let test = Test::from(config.check().unwrap());
    let mut random = Random(11);
    for _ in 0..4 {
        let all = positions(&mut random, 9);
        let whole = Schedule::new(all.clone()).unwrap();
        let rest = Schedule::new(all[5..].to_vec()).unwrap();
        // In two parts, which follow each other.
        let interrupted = test
            .clone()
            .interrupted_after(Schedule::new(all[..2].to_vec()).unwrap())
            .and_then(|test| test.interrupted_after(Schedule::new(all[2..5].to_vec()).unwrap()))
            .unwrap();
        let (a, b) = (evaluate(&test, &whole), evaluate(&interrupted, &rest));
        assert_eq!(a.end, b.end);
        assert_eq!(a.total_time_s, b.total_time_s);
        assert_eq!(b.convergence.positions.len(), 4);
        let dwelled: f64 = all[5..].iter().map(|p| p.dwell_s).sum();
        assert!((b.total_time_s - b.overhead_s - dwelled).abs() < 1e-6);
    }
}

#[test]
fn the_rest_of_a_test_starts_from_all_that_is_known() {
    same_as_the_whole(|_| {});
    same_as_the_whole(|c| {
        c.motion.slew_rate_deg_per_s = Some(0.5.into());
        c.motion.settle_s = 30.0;
        c.motion.start_deg = Some([10.0, -20.0, 30.0]);
        c.motion.return_to_start = true;
    });
    same_as_the_whole(|c| {
        c.motion.slew_rate_deg_per_s = Some(1.0.into());
        c.motion.measure_moves = true;
    });
    same_as_the_whole(|c| c.motion.repositioning = Repositioning::FrameHold);
}

/// After half of a scheme of faces the search adds what the scheme cannot show, within the time
/// that is left.
#[test]
fn a_search_continues_an_interrupted_test() {
    let mut config = PlatformConfig::default();
    config.motion.slew_rate_deg_per_s = Some(1.0.into());
    config.motion.settle_s = 20.0;
    let test = Test::from(config.check().unwrap());
    let faces = |deg: [f64; 3]| {
        let [a, b, c] = deg;
        ScheduledPosition::new(
            scheme_opt::internals::attitude::Position::from_deg(a, b, c),
            600.0,
        )
    };
    let done = vec![
        faces([0.0, 0.0, 0.0]),
        faces([90.0, 0.0, 0.0]),
        faces([180.0, 0.0, 0.0]),
        faces([0.0, 0.0, 90.0]),
    ];
    let interrupted = test
        .clone()
        .interrupted_after(Schedule::new(done.clone()).unwrap())
        .unwrap();
    let evaluator = Evaluator::new(interrupted, Objective::default());
    let problem = SearchProblem {
        total_time_s: 7200.0,
        max_positions: 10,
        starts: 4,
        ..SearchProblem::default()
    };
    let found = search(&evaluator, &problem, &Control::default()).unwrap();
    assert!(found.evaluation.total_time_s <= 7200.0 + 1e-6);
    let mut whole = done.clone();
    whole.extend(found.schedule.positions());
    let whole = evaluate(&test, &Schedule::new(whole).unwrap());
    assert_eq!(whole.end, found.evaluation.end);
    // Better than repeating what was done, and than a random continuation.
    let mut random = Random(3);
    for _ in 0..5 {
        let mut other = done.clone();
        other.extend(positions(&mut random, 8));
        let other = Schedule::new(other).unwrap().scaled_to(&test, 7200.0);
        let other = evaluate(&test, &other.unwrap());
        assert!(whole.rms_sigma_deg_per_h() < other.rms_sigma_deg_per_h());
    }
    assert_eq!(whole.observability.separability.len(), COEFFICIENTS);
    assert!(whole.observability.unobservable.is_empty());
}
