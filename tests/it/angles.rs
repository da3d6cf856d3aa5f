//! Angles as decimals of degrees: half turns, whole turns, equivalent triples, right angles, and
//! the way round that a schedule says. In radians none of them is exact, and what hung on the last
//! bit of an angle was wrong by up to 185 %.

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::commands::CommandTable;
use scheme_opt::internals::covariance::{CovarianceModel, TickRule};
use scheme_opt::internals::drift::DriftCoefficient;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::{Timeline, equivalent_positions};
use scheme_opt::internals::platform::{AxisValue, GSensitivePrior, Platform, PlatformConfig};
use scheme_opt::internals::schedule::file::{from_csv, from_json, to_csv, to_json};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use scheme_opt::internals::search::{Control, SearchProblem, search};

use crate::dense_filter;
use crate::support::Random;

fn platform(change: impl FnOnce(&mut PlatformConfig)) -> Platform {
    let mut config = PlatformConfig::default();
    change(&mut config);
    config.check().unwrap()
}

fn slewing() -> Platform {
    platform(|c| c.motion.slew_rate_deg_per_s = Some(0.5.into()))
}

fn position([alpha, beta, gamma]: [f64; 3]) -> Position {
    Position::from_deg(alpha, beta, gamma)
}

fn schedule(angles: &[[f64; 3]], dwell_s: f64) -> Schedule {
    let held = angles
        .iter()
        .map(|a| ScheduledPosition::new(position(*a), dwell_s));
    Schedule::new(held.collect()).unwrap()
}

/// RMS σ by both computations, °/h.
fn rms(platform: &Platform, schedule: &Schedule) -> f64 {
    let evaluator = Evaluator::new(platform.clone(), Objective::default());
    evaluator.evaluate(schedule).unwrap().rms_sigma_deg_per_h()
}

/// σ of the coefficients by the evaluator of searches, °/h.
fn sigmas(model: &CovarianceModel, platform: &Platform, schedule: &Schedule) -> Vec<f64> {
    let timeline = Timeline::new(&platform.clone().into(), schedule).unwrap();
    let end = model.end_covariance_by_gram(&timeline, TickRule::Filter);
    end.unwrap().sigma_deg_per_h().iter().copied().collect()
}

/// Six positions with half turns of α on the way.
const HALF_TURNS: [[f64; 3]; 6] = [
    [30.0, 0.0, 0.0],
    [210.0, 40.0, 20.0],
    [70.0, -60.0, 100.0],
    [40.0, 20.0, -150.0],
    [-30.0, 50.0, 60.0],
    [10.0, -20.0, -90.0],
];

#[test]
fn a_half_turn_goes_the_positive_way_whatever_the_radians_say() {
    let platform = slewing();
    let mut otherwise = HALF_TURNS;
    otherwise[1][0] = -150.0;
    let mut turned = HALF_TURNS;
    turned.iter_mut().for_each(|a| a[0] += 5.0);
    for (angles, expected) in [
        (HALF_TURNS, 0.004_457_6),
        (otherwise, 0.004_457_6),
        (turned, 0.004_306_4),
    ] {
        let found = rms(&platform, &schedule(&angles, 1500.0));
        assert!((found - expected).abs() < 5e-8, "{angles:?}: {found}");
    }
}

#[test]
fn every_half_turn_between_decimals_is_positive() {
    let platform = slewing();
    for tenths in -3600..=3600 {
        let deg = |tenths: i32| f64::from(tenths) / 10.0;
        for to in [tenths + 1800, tenths - 1800, tenths + 5400] {
            let way = [[deg(tenths), 0.0, 0.0], [deg(to), 0.0, deg(to)]];
            let timeline = Timeline::new(&platform.clone().into(), &schedule(&way, 100.0)).unwrap();
            let change = timeline.legs()[1].arrival.unwrap().change[0];
            assert_eq!(change, std::f64::consts::PI, "{way:?}");
        }
    }
}

/// Angles with half turns between them, right angles and gimbal lock among them.
fn angles_of_a_test(random: &mut Random) -> Vec<[f64; 3]> {
    let count = 2 + (random.unit() * 3.0) as usize;
    let mut all: Vec<[f64; 3]> = Vec::with_capacity(count);
    for k in 0..count {
        let decimals = [1.0, 1e1, 1e3, 1e9][(random.unit() * 4.0) as usize];
        let mut angles: [f64; 3] = std::array::from_fn(|_| {
            let deg = random.between(-180.0, 180.0);
            match random.unit() < 0.2 {
                true => (deg / 90.0).round() * 90.0,
                false => (deg * decimals).round() / decimals,
            }
        });
        if let Some(before) = k.checked_sub(1).map(|before| all[before]) {
            for (angle, before) in angles.iter_mut().zip(before) {
                if random.unit() < 0.4 {
                    *angle = rounded(before + if before > 0.0 { -180.0 } else { 180.0 });
                }
            }
        }
        all.push(angles);
    }
    all
}

/// The decimal of nine places, as somebody would write it.
fn rounded(deg: f64) -> f64 {
    (deg * 1e9).round() / 1e9
}

#[test]
fn whole_turns_on_unlimited_axes_change_nothing() {
    let mut random = Random(1);
    let stands = [
        slewing(),
        platform(|c| {
            c.motion.slew_rate_deg_per_s = Some(2.0.into());
            c.motion.measure_moves = true;
            c.motion.return_to_start = true;
        }),
        platform(|c| {
            c.motion.slew_rate_deg_per_s = Some(5.0.into());
            c.motion.settle_s = 20.0;
            c.motion.start_deg = Some([33.3, -180.0, 90.0]);
            c.gimbals.beta_deg = Some([-400.0, 400.0]);
        }),
    ];
    let models = stands.each_ref().map(CovarianceModel::new);
    for case in 0..10_000 {
        let stand = case % stands.len();
        let angles = angles_of_a_test(&mut random);
        let rewritten: Vec<[f64; 3]> = angles
            .iter()
            .map(|a| {
                std::array::from_fn(|axis| {
                    let turns = random.between(-3.5, 3.5).round();
                    match stands[stand].gimbals().ranges[axis] {
                        Some(_) => a[axis],
                        None => rounded(a[axis] + 360.0 * turns),
                    }
                })
            })
            .collect();
        let of =
            |angles: &[[f64; 3]]| sigmas(&models[stand], &stands[stand], &schedule(angles, 40.0));
        for (a, b) in of(&angles).into_iter().zip(of(&rewritten)) {
            assert!(
                (a / b - 1.0).abs() < 1e-9,
                "{angles:?} {rewritten:?}: {a} {b}"
            );
        }
    }
}

#[test]
fn equivalent_triples_are_one_attitude_and_where_no_path_matters_one_sigma() {
    let mut random = Random(2);
    let free = platform(|_| {});
    let model = CovarianceModel::new(&free);
    for _ in 0..10_000 {
        let angles = angles_of_a_test(&mut random);
        let mut others = angles.clone();
        for (angles, other) in angles.iter().zip(&mut others) {
            let given = position(*angles);
            let all = equivalent_positions(&free, given);
            for found in &all {
                let apart = given.attitude().matrix() - found.attitude().matrix();
                assert!(apart.amax() < 1e-15, "{angles:?} {found:?}: {apart}");
            }
            let k = (random.unit() * all.len() as f64) as usize;
            *other = all[k].degrees();
        }
        let of = |angles: &[[f64; 3]]| sigmas(&model, &free, &schedule(angles, 40.0));
        for (a, b) in of(&angles).into_iter().zip(of(&others)) {
            assert!((a / b - 1.0).abs() < 1e-9, "{angles:?} {others:?}: {a} {b}");
        }
    }
}

/// Both priors 1e12: the sixteenth digit of a sine is as much information as there is.
#[test]
fn no_digit_of_a_decimal_is_lost_before_the_sines() {
    let weak = platform(|c| {
        c.prior.constant_drift_deg_per_h = AxisValue::All(1e12);
        c.prior.g_sensitive_drift_deg_per_h_per_g = GSensitivePrior::All(AxisValue::All(1e12));
    });
    let evaluator = Evaluator::new(weak.clone(), Objective::default());
    let turned = [
        [10.0, 20.0, 30.0],
        [190.0, 160.0, 210.0],
        [370.0, 20.0, -330.0],
    ];
    let opposite = [[33.3, 0.0, 0.0], [213.3, 0.0, 0.0]];
    for (angles, name, expected, digits) in [
        (&turned[..], "D_IX", 9.501e11, 5e7),
        (&opposite[..], "D_FX", 0.003_319_8, 5e-8),
    ] {
        let schedule = schedule(angles, 200.0);
        let exact = dense_filter::run(&weak, &schedule).sigma_deg_per_h;
        let found = evaluator.evaluate(&schedule).unwrap().end.sigma_deg_per_h();
        for c in DriftCoefficient::ALL {
            let (found, exact) = (found[c.index()], exact[c.index()]);
            assert!(
                (found / exact - 1.0).abs() < 1e-9,
                "{}: {found} {exact}",
                c.name()
            );
            if c.name() == name {
                assert!((found - expected).abs() < digits, "{name}: {found}");
            }
        }
    }
}

/// The second of two positions, reached by the way that is given.
fn by_way(from: [f64; 3], to: [f64; 3], change_deg: [f64; 3]) -> Schedule {
    let second = ScheduledPosition {
        change_deg: Some(change_deg),
        ..ScheduledPosition::new(position(to), 600.0)
    };
    Schedule::new(vec![ScheduledPosition::new(position(from), 600.0), second]).unwrap()
}

#[test]
fn the_way_that_is_given_is_taken() {
    let platform = slewing();
    let (from, to) = ([30.0, 0.0, 0.0], [210.0, 40.0, 20.0]);
    let back = by_way(from, to, [-180.0, 40.0, 20.0]);
    let timeline = Timeline::new(&platform.clone().into(), &back).unwrap();
    let arrival = timeline.legs()[1].arrival.unwrap();
    assert_eq!(arrival.change[0], -std::f64::consts::PI);
    // The same attitudes and times, but another way: another σ; said or not, the usual way is one.
    let usual = by_way(from, to, [180.0, 40.0, 20.0]);
    assert!((rms(&platform, &back) / rms(&platform, &usual) - 1.0).abs() > 1e-6);
    assert_eq!(
        rms(&platform, &usual),
        rms(&platform, &schedule(&[from, to], 600.0))
    );
    // A whole turn more takes its time.
    let longer = by_way(from, to, [-180.0, 400.0, 20.0]);
    let longer = Timeline::new(&platform.clone().into(), &longer).unwrap();
    assert!((longer.total_time_s() - (1200.0 + 800.0)).abs() < 1e-9);
    // The stand is told so.
    let table = CommandTable::new(&platform, &timeline, 45.0).unwrap();
    let steps: Vec<_> = table
        .commands()
        .iter()
        .filter(|c| c.from_rad != c.to_rad)
        .collect();
    assert_eq!(steps.len(), 4);
    assert!((steps[3].to_rad[0] + 150.0_f64.to_radians()).abs() < 1e-12);
    for step in steps {
        assert!(step.gimbal_rates_rad_per_s.unwrap()[0] < 0.0);
    }
    // Both files carry it, bit for bit.
    assert_eq!(from_json(&to_json(&back)).unwrap(), back);
    assert_eq!(from_csv(&to_csv(&back)).unwrap(), back);
    // From the start attitude too; nothing else precedes a first position.
    let first = Schedule::new(back.positions()[1..].to_vec()).unwrap();
    let started = self::platform(|c| {
        c.motion.slew_rate_deg_per_s = Some(0.5.into());
        c.motion.start_deg = Some(from);
    });
    let timeline = Timeline::new(&started.clone().into(), &first).unwrap();
    assert_eq!(timeline.legs()[1].arrival.unwrap().change, arrival.change);
}

#[test]
fn ways_that_lead_elsewhere_are_refused_by_key() {
    let free = slewing();
    let limited = platform(|c| c.gimbals.alpha_deg = Some([-300.0, 300.0]));
    let (from, to) = ([33.3, 0.0, 0.0], [213.3, 40.0, 20.0]);
    let good = [180.0, 40.0, 20.0];
    for platform in [&free, &limited] {
        assert!(Timeline::new(&platform.clone().into(), &by_way(from, to, good)).is_ok());
    }
    assert!(
        Timeline::new(
            &free.clone().into(),
            &by_way(from, to, [-180.0, 400.0, -340.0])
        )
        .is_ok()
    );
    for (platform, change, says) in [
        (&free, [180.0, 41.0, 20.0], "beta"),
        (&free, [180.000_000_002, 40.0, 20.0], "alpha"),
        (&free, [0.0, 40.0, 20.0], "180 for alpha, or whole turns"),
        (&limited, [-180.0, 40.0, 20.0], "limited and goes straight"),
        (&limited, [540.0, 40.0, 20.0], "180 for alpha"),
    ] {
        let error = Timeline::new(&platform.clone().into(), &by_way(from, to, change)).unwrap_err();
        assert!(error.is_input());
        assert_eq!(error.key(), Some("positions[1].change_deg"));
        assert!(error.to_string().contains(says), "{error}");
    }
    let first = Schedule::new(by_way(from, to, good).positions()[1..].to_vec()).unwrap();
    let error = Timeline::new(&free.clone().into(), &first).unwrap_err();
    assert_eq!(error.key(), Some("positions[0].change_deg"));
    assert!(error.to_string().contains("start_deg"), "{error}");
}

/// With few positions and slow moves a search ends on half turns, and chooses which way they go.
#[test]
fn what_a_search_found_is_what_its_file_says() {
    let platform = platform(|c| {
        c.motion.slew_rate_deg_per_s = Some(0.5.into());
        c.motion.settle_s = 30.0;
    });
    let evaluator = Evaluator::new(platform, Objective::default());
    for seed in 1..=3 {
        let problem = SearchProblem {
            total_time_s: 6000.0,
            max_positions: 4,
            starts: 2,
            seed,
            ..SearchProblem::default()
        };
        let found = search(&evaluator, &problem, &Control::default()).unwrap();
        let known = found.evaluation.rms_sigma_deg_per_h();
        for read in [
            from_json(&to_json(&found.schedule)).unwrap(),
            from_csv(&to_csv(&found.schedule)).unwrap(),
        ] {
            assert_eq!(read, found.schedule);
            let again = evaluator.evaluate(&read).unwrap().rms_sigma_deg_per_h();
            assert!(
                (again / known - 1.0).abs() < 1e-12,
                "{seed}: {again} {known}"
            );
        }
        // No half turn is better the other way round.
        let timeline = Timeline::new(evaluator.test(), &found.schedule).unwrap();
        for (k, leg) in timeline.legs().iter().enumerate() {
            let Some(m) = leg.arrival else { continue };
            for axis in 0..3 {
                if m.change[axis].abs() == std::f64::consts::PI {
                    let mut positions = found.schedule.positions().to_vec();
                    let mut change = m.change.map(|c| rounded(c.to_degrees()));
                    change[axis] = -change[axis];
                    positions[k].change_deg = Some(change);
                    let other = Schedule::new(positions).unwrap();
                    let other = evaluator.evaluate(&other).unwrap().rms_sigma_deg_per_h();
                    assert!(other > known * (1.0 - 1e-6), "{seed}: {other} {known}");
                }
            }
        }
    }
}
