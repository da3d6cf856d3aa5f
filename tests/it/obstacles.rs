//! Whatever stands in the gimbals' way: no schedule that a search returns goes there, no move in
//! between either, and what is given is refused by what is in the way.

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::{Test, Timeline};
use scheme_opt::internals::platform::{ForbiddenConfig, PlatformConfig};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use scheme_opt::internals::search::{Control, SearchOutcome, SearchProblem, search};

use crate::support::{Random, slewing};

/// From and to of the three axes, degrees; none: all angles.
type Box3 = [Option<[f64; 2]>; 3];

fn one_box(random: &mut Random) -> Box3 {
    let mut axes: Box3 = std::array::from_fn(|_| {
        let low = random.between(-180.0, 180.0);
        let wide = random.between(5.0, 120.0);
        (random.unit() < 0.6).then_some([low, low + wide])
    });
    if axes == [None; 3] {
        axes[1] = Some([60.0, 110.0]);
    }
    axes
}

fn problem() -> SearchProblem {
    SearchProblem {
        total_time_s: 5400.0,
        max_positions: 8,
        starts: 12,
        ..SearchProblem::default()
    }
}

fn searched(config: &PlatformConfig, problem: &SearchProblem) -> SearchOutcome {
    let objective = Objective {
        separability_weight: 0.0,
        ..Objective::default()
    };
    let evaluator = Evaluator::new(config.check().unwrap(), objective);
    search(&evaluator, problem, &Control::default()).unwrap()
}

/// Walks through the test in small steps: the judge knows nothing of intervals.
fn walk(config: &PlatformConfig, found: &SearchOutcome) -> usize {
    let boxes: Vec<Box3> = config
        .gimbals
        .forbidden
        .iter()
        .map(|b| [b.alpha_deg, b.beta_deg, b.gamma_deg])
        .collect();
    let limited = [
        config.gimbals.alpha_deg,
        config.gimbals.beta_deg,
        config.gimbals.gamma_deg,
    ]
    .map(|range| range.is_some());
    let inside = |angles: [f64; 3]| {
        boxes.iter().any(|b| {
            (0..3).all(|axis| {
                b[axis].is_none_or(|[low, high]| match limited[axis] {
                    true => (low..=high).contains(&angles[axis]),
                    // Half of the last place of the angles: both are sums.
                    false => (angles[axis] - low).rem_euclid(360.0) <= high - low - 1e-8,
                })
            })
        })
    };
    let test = Test::from(config.check().unwrap());
    let timeline = Timeline::new(&test, &found.schedule).unwrap();
    let mut net = [0.0; 3];
    let mut steps = 0;
    for leg in timeline.legs() {
        assert!(!inside(leg.position.to_deg()), "{:?}", leg.position);
        let Some(m) = leg.arrival else { continue };
        let [from, change] = [m.from, m.change].map(|a| a.map(f64::to_degrees));
        let count = change.iter().fold(0.0_f64, |most, c| most.max(c.abs())) / 0.05;
        for step in 0..=count.ceil() as usize {
            let share = step as f64 / count.ceil().max(1.0);
            let at: [f64; 3] = std::array::from_fn(|i| from[i] + share * change[i]);
            assert!(!inside(at), "{at:?} on the way to {:?}", leg.position);
            steps += 1;
        }
        for axis in 0..3 {
            net[axis] += change[axis];
            let most = config.gimbals.max_winding_deg.map(|most| most[axis]);
            assert!(
                most.is_none_or(|most| net[axis].abs() <= most + 1e-6),
                "{net:?}"
            );
        }
    }
    steps
}

/// Stops that a stand may have: any, and where it begins.
fn stops(random: &mut Random) -> Vec<[f64; 3]> {
    let mut all = vec![[0.0; 3]];
    all.extend((0..60).map(|_| {
        let mut angle = || random.between(-180.0, 180.0).round();
        [angle(), angle(), angle()]
    }));
    all
}

fn csv_of(stops: &[[f64; 3]]) -> String {
    let mut text = "alpha_deg,beta_deg,gamma_deg\n".to_owned();
    for [a, b, g] in stops {
        text += &format!("{a},{b},{g}\n");
    }
    text
}

/// How far an angle is from whole turns, degrees.
fn turned_by(deg: f64) -> f64 {
    (deg - 360.0 * (deg / 360.0).round()).abs()
}

#[test]
fn no_position_move_or_winding_violates_what_is_in_the_way_and_freedom_never_hurts() {
    let dir = tempfile::tempdir().unwrap();
    let mut walked = 0;
    for case in 0..8 {
        let mut random = Random::of_case(case);
        let mut config = PlatformConfig::default();
        if case % 4 != 3 {
            slewing(&mut config, &mut random, 0.4, 4.0);
        }
        config.motion.settle_s = random.between(0.0, 40.0);
        if case % 3 == 1 {
            config.motion.start_deg = Some([0.0; 3]);
            config.motion.return_to_start = true;
        }
        if case % 4 == 2 {
            config.gimbals.step_deg = Some(15.0);
        }
        if case == 4 {
            config.gimbals.beta_deg = Some([-75.0, 75.0]);
        }
        // Free is a stand without a list, of which all that is on it can be had.
        let is_listed = case == 5;
        if is_listed {
            config.gimbals.step_deg = None;
        }
        let free = searched(&config, &problem());
        let boxes = (0..1 + case % 3).map(|_| one_box(&mut random));
        config.gimbals.forbidden = boxes
            // Where the platform stands nothing stands in the way.
            .filter(|b| !(0..3).all(|i| b[i].is_none_or(|[l, h]| (-l).rem_euclid(360.0) <= h - l)))
            .map(ForbiddenConfig::new)
            .collect();
        if case % 2 == 0 {
            config.gimbals.max_winding_deg = Some([0, 1, 2].map(|_| random.between(180.0, 500.0)));
        }
        let listed = is_listed.then(|| stops(&mut random));
        if let Some(stops) = &listed {
            let path = dir.path().join(format!("stops-{case}.csv"));
            std::fs::write(&path, csv_of(stops)).unwrap();
            config.gimbals.allowed = Some(path);
        }
        let hindered = searched(&config, &problem());
        if let Some(stops) = &listed {
            for p in hindered.schedule.positions() {
                let here = p.position.to_deg();
                let is_at = |stop: &[f64; 3]| (0..3).all(|i| turned_by(here[i] - stop[i]) < 1e-8);
                assert!(stops.iter().any(is_at), "case {case}: {here:?}");
            }
        }
        walked += walk(&config, &hindered);
        let [free, hindered] =
            [&free, &hindered].map(|found| found.evaluation.rms_sigma_deg_per_h());
        println!("case {case}: free {free:.6}, hindered {hindered:.6}");
        assert!(free <= hindered * 1.005, "case {case}: {free} {hindered}");
    }
    assert!(walked > 20_000, "{walked}");
}

#[test]
fn a_list_of_all_settings_is_the_index_table() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stops.csv");
    let mut text = "name;alpha_deg;beta_deg;gamma_deg\n".to_owned();
    for k in 0..64 {
        let [a, b, g] = [k / 16, k / 4 % 4, k % 4].map(|n| -90 + 90 * n);
        text += &format!("stop {k};{a};{b};{g},0\n");
    }
    std::fs::write(&path, text).unwrap();
    let mut table = PlatformConfig::default();
    table.gimbals.step_deg = Some(90.0);
    let mut listed = PlatformConfig::default();
    listed.gimbals.allowed = Some(path);
    let [on_table, on_list] = [&table, &listed].map(|config| {
        let found = searched(config, &problem());
        Timeline::new(&Test::from(table.check().unwrap()), &found.schedule).unwrap();
        found.evaluation.rms_sigma_deg_per_h()
    });
    assert!(
        (on_list / on_table - 1.0).abs() < 0.005,
        "{on_list} {on_table}"
    );
    // And what is not on it is refused.
    let test = Test::from(listed.check().unwrap());
    let off = ScheduledPosition::new(Position::from_deg(90.0, 45.0, 0.0), 100.0);
    let error = Timeline::new(&test, &Schedule::new(vec![off]).unwrap()).unwrap_err();
    assert_eq!(error.key(), Some("positions[0]"));
    assert!(error.to_string().contains("gimbals.allowed"), "{error}");
}

#[test]
fn what_is_in_the_way_of_a_given_schedule_is_said() {
    let wall: Box3 = [None, Some([80.0, 100.0]), None];
    let mut config = PlatformConfig::default();
    config.motion.slew_rate_deg_per_s = Some(1.0.into());
    config.motion.start_deg = Some([0.0; 3]);
    config.gimbals.forbidden = vec![ForbiddenConfig::new(wall)];
    config.gimbals.max_winding_deg = Some([400.0, 400.0, 400.0]);
    let at = |a, b, g| ScheduledPosition::new(Position::from_deg(a, b, g), 100.0);
    let around = |p: ScheduledPosition, change| ScheduledPosition {
        change_deg: Some(change),
        ..p
    };
    let refused = |positions: Vec<ScheduledPosition>| {
        let test = Test::from(config.check().unwrap());
        let error = Timeline::new(&test, &Schedule::new(positions).unwrap()).err()?;
        Some((error.key().unwrap().to_owned(), error.to_string()))
    };
    // Inside, through, around the other way.
    let (key, text) = refused(vec![at(0.0, 85.0, 0.0)]).unwrap();
    assert!(
        key == "positions[0]" && text.contains("beta_deg = [80, 100]"),
        "{text}"
    );
    let (key, text) = refused(vec![at(0.0, 10.0, 0.0), at(0.0, 150.0, 0.0)]).unwrap();
    assert!(key == "positions[1]" && text.contains("enters"), "{text}");
    let other_way = around(at(0.0, 150.0, 0.0), [0.0, -220.0, 0.0]);
    assert_eq!(refused(vec![at(0.0, 10.0, 0.0), other_way]), None);
    // Wound up: 170° three times.
    let turns = (1..=3)
        .map(|k| at(170.0 * f64::from(k), 0.0, 0.0))
        .collect();
    let (key, text) = refused(turns).unwrap();
    assert!(
        key == "positions[2]" && text.contains("max_winding_deg"),
        "{text}"
    );
    // The way back is chosen so that it is clear: not the short way from 150° to 0.
    let mut returns = config.clone();
    returns.motion.return_to_start = true;
    let test = Test::from(returns.check().unwrap());
    let schedule = Schedule::new(vec![around(at(0.0, 150.0, 0.0), [0.0, -210.0, 0.0])]).unwrap();
    let timeline = Timeline::new(&test, &schedule).unwrap();
    let back = timeline.legs()[2].arrival.unwrap().change[1].to_degrees();
    assert!((back - 210.0).abs() < 1e-9, "{back}");
    // Where the platform stands, and nowhere at all.
    let mut inside = config.clone();
    inside.motion.start_deg = Some([0.0, 90.0, 0.0]);
    assert_eq!(inside.check().unwrap_err().key(), Some("motion.start_deg"));
    let mut nowhere = PlatformConfig::default();
    nowhere.gimbals.beta_deg = Some([-60.0, 60.0]);
    nowhere.gimbals.forbidden = vec![ForbiddenConfig::new([None, Some([-60.0, 60.0]), None])];
    let evaluator = Evaluator::new(nowhere.check().unwrap(), Objective::default());
    let error = search(&evaluator, &problem(), &Control::default()).unwrap_err();
    assert!(
        error.is_infeasible() && error.key() == Some("gimbals.forbidden"),
        "{error}"
    );
}
