//! What the stand is told and what its operator reads, against the timeline: angles that count on without
//! a jump, the same attitudes at every time, clocks and readings of the sheet.

use nalgebra::Matrix3;
use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::commands::{CommandTable, Segment};
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::{Leg, Test, Timeline};
use scheme_opt::internals::platform::{AxisValue, PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use scheme_opt::internals::sheet::{OperatorSheet, SheetRow, Stop};
use scheme_opt::internals::units::Angle;

use crate::support::{Random, slewing};

/// 1e-9 rad.
const SAME_ATTITUDE: f64 = 1e-9;

/// Angle between two attitudes that are close, rad: ‖A − B‖ is √8 sin(θ/2).
fn apart(a: &Matrix3<f64>, b: &Matrix3<f64>) -> f64 {
    (a - b).norm() / 2.0_f64.sqrt()
}

fn chance(random: &mut Random, probability: f64) -> bool {
    random.unit() < probability
}

/// A stand of any kind, its slew rates in °/s if it has them.
fn stand(random: &mut Random) -> (PlatformConfig, Option<[f64; 3]>) {
    let mut config = PlatformConfig::default();
    let ranges = [
        (&mut config.gimbals.alpha_deg, 300.0),
        (&mut config.gimbals.beta_deg, 80.0),
        (&mut config.gimbals.gamma_deg, 200.0),
    ];
    for (range, most) in ranges {
        if chance(random, 0.4) {
            *range = Some([-most, most]);
        }
    }
    if chance(random, 0.7) {
        slewing(&mut config, random, 0.2, 3.0);
    }
    let holds = chance(random, 0.15);
    if holds {
        config.motion.repositioning = Repositioning::FrameHold;
    }
    config.motion.settle_s = if chance(random, 0.5) { 20.0 } else { 0.0 };
    config.motion.measure_moves = chance(random, 0.3);
    config.motion.start_deg = chance(random, 0.4).then_some([10.0, -20.0, 30.0]);
    config.motion.return_to_start = chance(random, 0.4);
    let rates = config.motion.slew_rate_deg_per_s.map(AxisValue::to_array);
    (config, rates.filter(|_| !holds))
}

/// Positions in the ranges, some reached the long way round or by whole turns more, some slowly, some
/// passed without a stop.
fn positions(
    random: &mut Random,
    config: &PlatformConfig,
    mut from: Option<[f64; 3]>,
    count: usize,
) -> Vec<ScheduledPosition> {
    let gimbals = &config.gimbals;
    let ranges = [gimbals.alpha_deg, gimbals.beta_deg, gimbals.gamma_deg];
    let slews = config.motion.repositioning == Repositioning::Slew;
    let mut all = Vec::new();
    for _ in 0..count {
        let deg = ranges.map(|range| {
            let [low, high] = range.unwrap_or([-180.0, 180.0]);
            (random.between(low, high) * 1e3).round() / 1e3
        });
        let mut p = ScheduledPosition::new(Position::from_deg(deg[0], deg[1], deg[2]), 0.0);
        p.dwell_s = (random.between(0.0, 600.0) / 10.0).round() * 10.0;
        if let Some(from) = from.filter(|_| chance(random, 0.5)) {
            let turns = |random: &mut Random| (random.between(-2.5, 2.5)).round() * 360.0;
            p.change_deg = Some(std::array::from_fn(|axis| {
                let straight = deg[axis] - from[axis];
                match ranges[axis] {
                    Some(_) => straight,
                    None => straight + turns(random),
                }
            }));
        }
        if slews && chance(random, 0.2) {
            // Slower than any of these stands needs.
            p.move_s = Some(10_000.0);
            p.move_measured = Some(true);
            p.dwell_s = 0.0;
        }
        from = Some(deg);
        all.push(p);
    }
    all
}

/// A test, perhaps in the middle, and what is planned of it.
fn case(number: u64) -> (Test, Schedule, Option<[f64; 3]>) {
    let mut random = Random::of_case(number);
    let (config, rates) = stand(&mut random);
    let mut test = Test::from(config.check().unwrap());
    let mut from = config.motion.start_deg;
    if chance(&mut random, 0.3) {
        let mut done = positions(&mut random, &config, from, 3);
        // The last dwell was cut.
        done[2].dwell_s = 123.4;
        from = Some(done[2].position.to_deg());
        test = test
            .interrupted_after(Schedule::new(done).unwrap())
            .unwrap();
    }
    let planned = positions(&mut random, &config, from, 8);
    (test, Schedule::new(planned).unwrap(), rates)
}

/// The leg that lasts at `time_s`, and when it began.
fn leg_at(timeline: &Timeline, time_s: f64) -> (&Leg, f64) {
    let mut begins_s = 0.0;
    for leg in timeline.legs() {
        if time_s < begins_s + leg.duration_s() {
            return (leg, begins_s);
        }
        begins_s += leg.duration_s();
    }
    panic!("{time_s} s is after the end");
}

/// The attitude of a leg that began at `begins_s`, at `time_s`.
fn attitude_in(leg: &Leg, begins_s: f64, time_s: f64) -> Matrix3<f64> {
    let position = match &leg.arrival {
        Some(m) if m.duration_s > 0.0 && time_s - begins_s < m.duration_s => {
            m.position_at((time_s - begins_s) / m.duration_s)
        }
        _ => leg.position,
    };
    *position.attitude().matrix()
}

#[test]
fn command_tables_count_on_without_a_jump_and_are_where_the_timeline_is() {
    let mut beyond_a_turn = 0;
    for number in 0..150 {
        let (test, schedule, rates) = case(number);
        let timeline = Timeline::new(&test, &schedule).unwrap();
        let step_deg = Random::of_case(number).between(3.0, 45.0);
        let table = CommandTable::new(test.platform(), &timeline, step_deg).unwrap();
        let rows = table.commands();
        let first = timeline.legs()[0].position.to_array();
        let mut standing = first;
        let mut farthest = [0.0_f64; 3];
        for row in rows {
            assert_eq!(row.from_rad, standing, "case {number} at {} s", row.start_s);
            standing = row.to_rad;
            let holds = matches!(row.segment, Segment::Dwell | Segment::Settle);
            assert!(!holds || row.from_rad == row.to_rad);
            for axis in 0..3 {
                let turned = row.to_rad[axis] - row.from_rad[axis];
                farthest[axis] = farthest[axis].max((row.to_rad[axis] - first[axis]).abs());
                if let Some(rates) = row.gimbal_rates_rad_per_s {
                    assert!((turned - rates[axis] * row.duration_s).abs() < 1e-12);
                }
                if let Some(rates) = rates {
                    let most = Angle::from_deg(rates[axis]).rad() * row.duration_s;
                    assert!(
                        turned.abs() < most + 1e-10,
                        "case {number}: {turned} > {most}"
                    );
                }
            }
            if row.duration_s > 0.0 {
                let middle_s = row.start_s + 0.5 * row.duration_s;
                let (leg, begins_s) = leg_at(&timeline, middle_s);
                for part in [0.0, 0.25, 0.5, 0.75, 1.0] {
                    let angles: [f64; 3] = std::array::from_fn(|axis| {
                        row.from_rad[axis] + part * (row.to_rad[axis] - row.from_rad[axis])
                    });
                    let commanded = Position::from_array(angles).attitude();
                    let time_s = row.start_s + part * row.duration_s;
                    let planned = attitude_in(leg, begins_s, time_s);
                    let off = apart(commanded.matrix(), &planned);
                    // A row has one rate, and gimbals that speed up have not.
                    let in_between = part != 0.0 && part != 1.0;
                    let ramps = leg.arrival.is_some_and(|m| m.ramp() > 0.0);
                    let near = match in_between && ramps && !holds {
                        true => 3.0 * 0.02_f64.to_radians(),
                        false => SAME_ATTITUDE,
                    };
                    assert!(off < near, "case {number} at {time_s} s: {off:e}");
                }
            }
        }
        // The last row is where all moves together lead.
        let moves = timeline.legs().iter().filter_map(|leg| leg.arrival);
        let sum = moves.fold(first, |sum, m| {
            std::array::from_fn(|axis| sum[axis] + m.change[axis])
        });
        for axis in 0..3 {
            assert!((standing[axis] - sum[axis]).abs() < 1e-10, "case {number}");
            let winding = table.winding_deg()[axis];
            let found = Angle::from_rad(farthest[axis]).deg();
            assert!(
                (winding - found).abs() < 2e-9,
                "case {number}: {winding} {found}"
            );
            beyond_a_turn += u32::from(winding > 360.0);
        }
    }
    assert!(beyond_a_turn > 30, "{beyond_a_turn}");
}

#[test]
fn a_sheet_has_the_numbers_of_timeline_table_and_evaluation() {
    let mut seen = [0; 4];
    for number in 0..24 {
        let (test, schedule, _) = case(number);
        let timeline = Timeline::new(&test, &schedule).unwrap();
        let table = CommandTable::new(test.platform(), &timeline, 45.0).unwrap();
        let evaluator = Evaluator::new(test.clone(), Objective::default());
        let evaluation = evaluator.evaluate(&schedule).unwrap();
        let sheet = OperatorSheet::new(&test, &timeline);
        assert_eq!(sheet.rows().len(), timeline.legs().len());
        assert_eq!(sheet.winding_deg(), evaluation.winding_deg);
        let mut time_s = 0.0;
        for (row, leg) in sheet.rows().iter().zip(timeline.legs()) {
            assert!((row.move_starts_s - time_s).abs() < 1e-9);
            time_s += leg.duration_s();
            assert!((row.ends_s - time_s).abs() < 1e-9);
            assert!((row.ends_s - row.dwell_starts_s - leg.dwell_s).abs() < 1e-9);
            for angles in [row.angles_deg, row.wrapped_deg] {
                let shown = Position::from_deg(angles[0], angles[1], angles[2]).attitude();
                assert!(apart(shown.matrix(), leg.attitude.matrix()) < SAME_ATTITUDE);
            }
            assert!(row.wrapped_deg.iter().all(|a| *a > -180.0 && *a <= 180.0));
            seen[match row.stop {
                Stop::Start => 0,
                Stop::Done => 1,
                Stop::Position(_) => 2,
                Stop::Return => 3,
            }] += 1;
        }
        let held = |row: &&SheetRow| matches!(row.stop, Stop::Position(_));
        for (row, of) in sheet.rows().iter().filter(held).zip(&evaluation.positions) {
            assert_eq!(row.specific_force_g, of.specific_force_g.map(|f| f + 0.0));
            assert!((row.dwell_starts_s - of.starts_s).abs() < 1e-9);
            // Where the table dwells.
            let mut dwells = table.commands().iter();
            let dwell = dwells.find(|c| {
                c.segment == Segment::Dwell && c.position.map(Stop::Position) == Some(row.stop)
            });
            let dwells = row.ends_s > row.dwell_starts_s;
            assert_eq!(dwell.is_some(), dwells);
            if let Some(dwell) = dwell {
                assert!((dwell.start_s - row.dwell_starts_s).abs() < 1e-6);
                for axis in 0..3 {
                    let told = Angle::from_rad(dwell.from_rad[axis]).deg();
                    assert!((told - row.angles_deg[axis]).abs() < 1e-9);
                }
            }
        }
        is_in_csv(&sheet);
    }
    assert!(seen.iter().all(|count| *count > 0), "{seen:?}");
}

/// The text has the rows' numbers.
fn is_in_csv(sheet: &OperatorSheet) {
    let text = sheet.to_csv();
    let lines: Vec<&str> = text.lines().skip(1).collect();
    assert_eq!(lines.len(), sheet.rows().len());
    for (line, row) in lines.iter().zip(sheet.rows()) {
        // What to do is between quotes and has commas of its own.
        let parts: Vec<&str> = line.split('"').collect();
        let before: Vec<&str> = parts[0].split(',').collect();
        assert_eq!(
            (before[1], parts[1]),
            (row.stop.to_string().as_str(), row.words().as_str())
        );
        let number = |text: &str| text.parse::<f64>().unwrap();
        for axis in 0..3 {
            assert!((number(before[5 + axis]) - row.angles_deg[axis]).abs() < 1e-9);
            assert!((number(before[8 + axis]) - row.wrapped_deg[axis]).abs() < 1e-9);
            assert!((number(before[11 + axis]) - row.specific_force_g[axis]).abs() <= 5e-6);
        }
        let times = [row.move_starts_s, row.dwell_starts_s, row.ends_s];
        for (i, time_s) in times.into_iter().enumerate() {
            let clock: Vec<f64> = before[2 + i].split(':').map(number).collect();
            let shown = clock[0] * 3600.0 + clock[1] * 60.0 + clock[2];
            assert!((shown - time_s).abs() <= 0.5 + 1e-9);
            let exact = parts[2].split(',').nth(1 + i).unwrap();
            assert!((number(exact) - time_s).abs() < 1e-8);
        }
    }
}

/// Measured moves and tumbling are said in words, and what nobody has to dial is not.
#[test]
fn a_sheet_says_what_is_measured_on_the_way() {
    let mut config = PlatformConfig::default();
    config.motion.slew_rate_deg_per_s = Some(1.0.into());
    config.motion.settle_s = 30.0;
    config.motion.return_to_start = true;
    let turning = |deg: [f64; 3]| ScheduledPosition {
        move_s: Some(2000.0),
        move_measured: Some(true),
        ..ScheduledPosition::new(Position::from_deg(deg[0], deg[1], deg[2]), 0.0)
    };
    let at =
        |deg: [f64; 3]| ScheduledPosition::new(Position::from_deg(deg[0], deg[1], deg[2]), 900.0);
    let schedule = Schedule::new(vec![
        at([0.0; 3]),
        turning([170.0, 40.0, -90.0]),
        turning([-30.0, 40.0, 80.0]),
        at([-30.0, 40.0, 20.0]),
    ]);
    let test = Test::from(config.check().unwrap());
    let timeline = Timeline::new(&test, &schedule.unwrap()).unwrap();
    let sheet = OperatorSheet::new(&test, &timeline);
    let words: Vec<String> = sheet.rows().iter().map(SheetRow::words).collect();
    assert_eq!(words[0], "The test begins here. Measure 0:15:00.");
    assert_eq!(
        words[1],
        "MEASURED MOVE, keep recording: turn alpha +170 deg, beta +40 deg, gamma -90 deg, evenly in \
         0:33:20. Do not stop here: the next move follows at once."
    );
    assert_eq!(
        words[2],
        "MEASURED MOVE, keep recording: turn alpha +160 deg, gamma +170 deg, evenly in 0:33:20."
    );
    assert_eq!(
        words[3],
        "Move: turn gamma -60 deg in 0:01:00; settle 0:00:30. Measure 0:15:00."
    );
    assert_eq!(
        words[4],
        "Back to where the test began: turn alpha +30 deg, beta -40 deg, gamma -20 deg in 0:00:40."
    );
    assert_eq!(sheet.rows()[2].angles_deg, [330.0, 40.0, 80.0]);
    assert_eq!(sheet.rows()[4].angles_deg, [360.0, 0.0, 0.0]);
    assert_eq!(sheet.winding_deg(), [360.0, 40.0, 90.0]);
    #[cfg(feature = "report")]
    {
        let page = sheet.to_html().unwrap();
        assert!(
            page.contains("Operator's sheet: 4 positions, 1:38:50")
                || page.contains("Operator&#39;s sheet: 4 positions, 1:38:50"),
            "{page}"
        );
        assert!(page.contains("turn α\u{a0}+160°, γ\u{a0}+170°, evenly"));
        assert!(
            page.contains("<td class=\"angle\">330<br><small>(−30)</small></td>"),
            "{page}"
        );
        assert!(!page.contains("ω") && !sheet.to_csv().contains("omega"));
    }
}
