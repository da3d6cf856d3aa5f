//! Whatever the limits of a stand: no schedule that a search returns violates them, moves in
//! between included.

use proptest::prelude::*;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{Platform, PlatformConfig};
use scheme_opt::internals::schedule::ScheduledPosition;
use scheme_opt::internals::search::{Control, SearchOutcome, SearchProblem, search};

/// A range of a gimbal, or none; with zero inside, so that an index table has a setting.
fn range() -> impl Strategy<Value = Option<[f64; 2]>> {
    prop::option::of((-400.0..-5.0_f64, 5.0..400.0_f64).prop_map(|(low, high)| [low, high]))
}

prop_compose! {
    fn stand()(
        ranges in prop::array::uniform3(range()),
        step in prop::option::weighted(0.3, prop::sample::select(vec![7.5, 15.0, 30.0, 90.0])),
        slew in prop::option::weighted(0.8, 0.1..5.0_f64),
        acceleration in prop::option::of(0.01..1.0_f64),
        settle in 0.0..90.0_f64,
        min_dwell in 0.0..400.0_f64,
        measure_moves in any::<bool>(),
        start in prop::option::of(Just([0.0, 0.0, 0.0])),
        return_to_start in any::<bool>(),
    ) -> PlatformConfig {
        let mut c = PlatformConfig::default();
        [c.gimbals.alpha_deg, c.gimbals.beta_deg, c.gimbals.gamma_deg] = ranges;
        c.gimbals.step_deg = step;
        c.motion.slew_rate_deg_per_s = slew.map(Into::into);
        c.motion.acceleration_deg_per_s2 = acceleration.filter(|_| slew.is_some()).map(Into::into);
        c.motion.settle_s = settle;
        c.motion.min_dwell_s = min_dwell;
        c.motion.measure_moves = measure_moves;
        c.motion.start_deg = start;
        c.motion.return_to_start = return_to_start;
        c
    }
}

fn keeps_the_limits(platform: &Platform, problem: &SearchProblem, found: &SearchOutcome) {
    // A turn has two entries, its start and its end, and counts as one position.
    let ends_turn = |p: &&ScheduledPosition| p.dwell_s == 0.0 && p.move_s.is_some();
    let entries = found.schedule.positions();
    let count = entries.len() - entries.iter().filter(ends_turn).count();
    assert!(count <= problem.max_positions, "{count} positions");
    // Ranges at the positions, the index table and given moves are checked on the way.
    let timeline = Timeline::new(&platform.clone().into(), &found.schedule).unwrap();
    let total_s = timeline.total_time_s();
    assert!(
        total_s <= problem.total_time_s * (1.0 + 1e-12),
        "{total_s} s"
    );
    let least_s = platform.motion().min_dwell_s * (1.0 - 1e-12);
    for leg in timeline.position_legs() {
        // A measured move that turns slowly is a dwell of another kind.
        let held_s = match leg.arrival {
            Some(m) if m.measured && leg.dwell_s == 0.0 => m.duration_s,
            _ => leg.dwell_s,
        };
        let starts_turning = problem.allow_tumbling && leg.dwell_s == 0.0;
        assert!(held_s >= least_s || starts_turning, "{held_s} s");
    }
    for leg in timeline.legs() {
        let Some(m) = leg.arrival else { continue };
        for fraction in [0.0, 0.1, 0.37, 0.5, 0.8, 1.0] {
            for (angle, range) in m
                .angles_at(fraction)
                .into_iter()
                .zip(platform.gimbals().ranges)
            {
                if let Some(r) = range {
                    assert!((r.low_rad - 1e-9..=r.high_rad + 1e-9).contains(&angle));
                }
            }
        }
        if let Some(slew) = platform.motion().slew {
            for (change, rate) in m.change.iter().zip(slew.rate_rad_per_s) {
                let fastest = change.abs() * m.speed_at(0.5);
                assert!(fastest <= rate * m.duration_s * (1.0 + 1e-9) + 1e-12);
            }
            let accelerations = slew.acceleration_rad_per_s2.iter().flatten();
            for (change, most) in m.change.iter().zip(accelerations) {
                let ramp_s = m.ramp() * m.duration_s;
                let speeding_up = change.abs() * m.speed_at(0.5);
                assert!(speeding_up <= most * ramp_s * m.duration_s * (1.0 + 1e-9) + 1e-12);
            }
        }
    }
    if let Some(start) = platform.motion().start {
        assert_eq!(timeline.legs()[0].position, start);
    }
    if platform.motion().return_to_start {
        let legs = timeline.legs();
        assert_eq!(legs[legs.len() - 1].position, legs[0].position);
    }
}

/// The moves take all the time that four shortest dwells leave, so that every refined start ends
/// with no time to spare; rounding its angles must not lose it.
#[test]
fn a_plan_without_spare_time_is_rounded() {
    let mut config = PlatformConfig::default();
    config.motion.slew_rate_deg_per_s = Some(3.303767144730143.into());
    config.motion.min_dwell_s = 318.64467195648393;
    config.motion.start_deg = Some([0.0, 0.0, 0.0]);
    config.motion.return_to_start = true;
    let platform = config.check().unwrap();
    let evaluator = Evaluator::new(platform.clone(), Objective::default());
    let problem = SearchProblem {
        total_time_s: 1430.3265038857203,
        max_positions: 4,
        starts: 1,
        seed: 10427044617184570973,
        ..SearchProblem::default()
    };
    let found = search(&evaluator, &problem, &Control::default()).unwrap();
    keeps_the_limits(&platform, &problem, &found);
    assert_eq!(found.schedule.positions().len(), 4);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn no_limit_is_violated(
        config in stand(),
        total_time_s in 900.0..9000.0_f64,
        max_positions in 1..9_usize,
        allow_tumbling in any::<bool>(),
        seed in any::<u64>(),
    ) {
        let platform = config.check().unwrap();
        let evaluator = Evaluator::new(platform.clone(), Objective::default());
        let problem = SearchProblem {
            total_time_s,
            max_positions,
            starts: 2,
            seed,
            allow_tumbling: allow_tumbling && config.gimbals.step_deg.is_none(),
            ..SearchProblem::default()
        };
        match search(&evaluator, &problem, &Control::default()) {
            Ok(found) => keeps_the_limits(&platform, &problem, &found),
            Err(error) => prop_assert!(error.is_infeasible(), "{error}"),
        }
    }
}
