//! The command table, replayed: a stand that integrates the rates as printed arrives at the
//! schedule's attitudes.

use nalgebra::{Matrix3, Rotation3, Vector3};
use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::commands::{CommandTable, Segment};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{AxisValue, Platform, PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use scheme_opt::internals::units::{Angle, AngularRate};

use crate::support::Random;

/// One row of the CSV text, as a stand's program would read it.
struct Row {
    duration_s: f64,
    segment: String,
    from_deg: [f64; 3],
    to_deg: [f64; 3],
    gimbal_deg_per_s: Option<[f64; 3]>,
    omega_deg_per_h: Option<[f64; 3]>,
    measured: bool,
}

fn rows(csv: &str) -> Vec<Row> {
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let three = |from: usize| -> Option<[f64; 3]> {
            let values: Option<Vec<f64>> =
                (from..from + 3).map(|i| cells[i].parse().ok()).collect();
            values.map(|v| [v[0], v[1], v[2]])
        };
        Row {
            duration_s: cells[2].parse().unwrap(),
            segment: cells[3].to_owned(),
            from_deg: three(5).unwrap(),
            to_deg: three(8).unwrap(),
            gimbal_deg_per_s: three(11),
            omega_deg_per_h: three(14),
            measured: cells[17].parse().unwrap(),
        }
    };
    csv.lines().skip(1).map(row).collect()
}

/// C_c^n by its definition: turns about the gimbals' axes, on a base that is turned and tilted.
pub fn attitude(platform: &Platform, deg: [f64; 3]) -> Matrix3<f64> {
    let stand = platform.stand();
    let [tilt_x, tilt_z] = stand.tilt_deg();
    let base = [
        (-Vector3::y(), stand.heading_deg()),
        (Vector3::x(), tilt_x),
        (Vector3::z(), tilt_z),
    ];
    let gimbals = stand.axes().into_iter().zip(deg);
    let gimbals = gimbals.map(|(axis, deg)| (axis.vector(), deg));
    let turns = base.into_iter().chain(gimbals);
    turns.fold(Matrix3::identity(), |c, (axis, deg)| {
        c * Rotation3::new(axis * Angle::from_deg(deg).rad()).matrix()
    })
}

/// Angle between two attitudes that are close, rad: ‖A − B‖ is √8 sin(θ/2).
fn apart(a: &Matrix3<f64>, b: &Matrix3<f64>) -> f64 {
    (a - b).norm() / 2.0_f64.sqrt()
}

/// Integrates the rates of the text: Ċ_c^i = C_c^i [ω_c ×], with n turning at the Earth rate.
/// Checks the attitude whenever a position is held.
pub fn replay(platform: &Platform, timeline: &Timeline, step_deg: f64) -> usize {
    let table = CommandTable::new(platform, timeline, step_deg).unwrap();
    let rows = rows(&table.to_csv());
    assert_eq!(rows.len(), table.commands().len());
    let attitude = |deg| attitude(platform, deg);
    let mut c = *timeline.legs()[0].attitude.matrix();
    let mut gimbals = timeline.legs()[0].position.to_deg();
    let mut measured_s = 0.0;
    for row in &rows {
        match (row.omega_deg_per_h, row.gimbal_deg_per_s) {
            (Some(omega), Some(rates)) => {
                let omega =
                    Vector3::from(omega.map(|v| AngularRate::from_deg_per_h(v).rad_per_s()));
                let earth = Rotation3::new(-platform.earth_rate_n() * row.duration_s);
                let own = Rotation3::new(omega * row.duration_s);
                c = earth.matrix() * c * own.matrix();
                for (angle, rate) in gimbals.iter_mut().zip(rates) {
                    *angle += rate * row.duration_s;
                }
            }
            _ => {
                // In no time.
                assert_eq!(row.duration_s, 0.0);
                c = attitude(row.to_deg);
                gimbals = row.to_deg;
            }
        }
        measured_s += if row.measured { row.duration_s } else { 0.0 };
        let (by_rates, by_gimbals) = (apart(&c, &attitude(row.to_deg)), {
            apart(&attitude(gimbals), &attitude(row.to_deg))
        });
        assert!(by_rates < 1e-9, "{} {by_rates:e}", row.segment);
        assert!(by_gimbals < 1e-9, "{} {by_gimbals:e}", row.segment);
        if row.segment == "settle" || row.segment == "dwell" {
            assert_eq!(row.from_deg, row.to_deg);
        }
    }
    // The table says the same as the timeline.
    for (index, leg) in timeline.position_legs().iter().enumerate() {
        let last = table.commands().iter().rev();
        let held = last.clone().find(|k| k.position == Some(index + 1));
        let held = held.unwrap();
        assert!(
            apart(
                &attitude(held.to_rad.map(|a| Angle::from_rad(a).deg())),
                leg.attitude.matrix()
            ) < 1e-9
        );
    }
    let end = table.commands().last().unwrap().end_s();
    assert!((end - timeline.total_time_s()).abs() < 1e-6);
    let measured: f64 = timeline
        .legs()
        .iter()
        .map(|l| {
            l.dwell_s
                + l.arrival
                    .filter(|m| m.measured)
                    .map_or(0.0, |m| m.duration_s)
        })
        .sum();
    assert!((measured_s - measured).abs() < 1e-6);
    rows.len()
}

fn schedule(random: &mut Random, beta: f64, positions: usize) -> Schedule {
    let position = |_| {
        let deg = [
            random.between(-180.0, 180.0),
            random.between(-beta, beta),
            random.between(-180.0, 180.0),
        ];
        ScheduledPosition::new(
            Position::from_deg(deg[0], deg[1], deg[2]),
            random.between(0.0, 900.0),
        )
    };
    Schedule::new((0..positions).map(position).collect()).unwrap()
}

fn check(change: impl Fn(&mut PlatformConfig)) {
    let mut config = PlatformConfig::default();
    change(&mut config);
    let platform = config.check().unwrap();
    let mut random = Random(7);
    for _ in 0..8 {
        let schedule = schedule(&mut random, 60.0, 14);
        let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
        let rough = replay(&platform, &timeline, 45.0);
        let fine = replay(&platform, &timeline, 1.0);
        assert!(fine >= rough);
    }
}

#[test]
fn replayed_commands_arrive_at_the_attitudes_of_the_schedule() {
    check(|c| {
        c.gimbals.beta_deg = Some([-60.0, 60.0]);
        c.motion.slew_rate_deg_per_s = Some(0.5.into());
        c.motion.settle_s = 30.0;
    });
}

#[test]
fn replayed_commands_arrive_with_limited_outer_gimbals_measured_moves_start_and_return() {
    check(|c| {
        c.gimbals.alpha_deg = Some([-180.0, 180.0]);
        c.motion.slew_rate_deg_per_s = Some(2.0.into());
        c.motion.measure_moves = true;
        c.motion.start_deg = Some([10.0, -20.0, 30.0]);
        c.motion.return_to_start = true;
        c.site.latitude_deg = -71.0;
    });
}

#[test]
fn replayed_commands_arrive_where_gimbals_speed_up_and_slow_down() {
    for measure_moves in [false, true] {
        check(|c| {
            c.gimbals.beta_deg = Some([-60.0, 60.0]);
            c.motion.slew_rate_deg_per_s = Some(AxisValue::PerAxis([0.5, 1.0, 2.0]));
            c.motion.acceleration_deg_per_s2 = Some(AxisValue::PerAxis([0.05, 0.02, 0.1]));
            c.motion.measure_moves = measure_moves;
            c.motion.return_to_start = true;
        });
    }
}

#[test]
fn replayed_commands_arrive_in_frame_hold_and_without_a_slew_rate() {
    check(|c| c.motion.repositioning = Repositioning::FrameHold);
    check(|c| {
        c.motion.settle_s = 30.0;
        c.motion.return_to_start = true;
    });
}

#[test]
fn a_tumbling_schedule_is_commanded_by_moves_alone() {
    let turning = |deg: [f64; 3], move_s| ScheduledPosition {
        move_s: Some(move_s),
        move_measured: Some(true),
        ..ScheduledPosition::new(Position::from_deg(deg[0], deg[1], deg[2]), 0.0)
    };
    let start = ScheduledPosition::new(Position::from_deg(0.0, 0.0, 0.0), 100.0);
    let schedule = Schedule::new(vec![
        start,
        turning([170.0, 40.0, -90.0], 2000.0),
        turning([-30.0, -50.0, 80.0], 3000.0),
    ]);
    let platform = PlatformConfig::default().check().unwrap();
    let timeline = Timeline::new(&platform.clone().into(), &schedule.unwrap()).unwrap();
    replay(&platform, &timeline, 5.0);
    let table = CommandTable::new(&platform, &timeline, 5.0).unwrap();
    let moves = table.commands().iter().skip(1);
    assert!(
        moves
            .clone()
            .all(|c| c.segment == Segment::Move && c.measured)
    );
}

/// While it slews about one axis at β = γ = 0 the rate is the Earth's plus the slew about −x:
/// the rotations of (19) are those of the frame.
#[test]
fn a_slew_adds_to_the_earth_rate() {
    let mut config = PlatformConfig::default();
    config.motion.slew_rate_deg_per_s = Some(0.5.into());
    let platform = config.check().unwrap();
    let at = |a| ScheduledPosition::new(Position::from_deg(a, 0.0, 0.0), 60.0);
    let schedule = Schedule::new(vec![at(0.0), at(60.0)]).unwrap();
    let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
    let table = CommandTable::new(&platform, &timeline, 5.0).unwrap();
    let slewing = table.commands()[1].platform_rate_rad_per_s.unwrap();
    let north = platform.earth_rate_n().x;
    let expected = north - Angle::from_deg(0.5).rad();
    assert!(
        (slewing[0] - expected).abs() < 1e-9,
        "{} {expected}",
        slewing[0]
    );
    let refused = CommandTable::new(&platform, &timeline, 90.0).unwrap_err();
    assert!(refused.is_input());
}
