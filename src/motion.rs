//! From a schedule to a timeline: moves between positions, their duration and drift integral.
//!
//! In `slew` repositioning all gimbals go through the same share of their way at the same time and
//! arrive together, as quickly as the rate and the acceleration of each allow
//! ([`crate::platform::SlewLimits`]; in no time when no rate is given), and a settle time follows every
//! unmeasured move. Unlimited gimbals take the short way round,
//! ties positive, unless the schedule says another way (`change_deg`); limited ones go straight,
//! and so stay inside their ranges. While the platform moves the drift still
//! integrates: Δψ^n = ∫ Φ(t_end − t) A(R(t)) dt · D ([`Move::drift_integral`]).
//!
//! In `frame-hold` repositioning a move takes no time and ψ^n ← C_{k+1} C_kᵀ ψ^n.
//!
//! Nothing precedes the first position of a schedule, unless the platform has a start attitude
//! (`motion.start_deg`): then the move from there, and its settle, belong to the test. With
//! `motion.return_to_start` the test ends with the unmeasured move back. A timeline holds start
//! and return as legs of their own, which are held for no time; and so, with its dwells, what was
//! done before an interruption ([`Test::interrupted_after`]).

mod clear;
mod equivalents;
pub(crate) mod integral;
mod moves;
mod profile;
mod scaled;
mod test;
mod way;
mod winding;

pub use crate::schedule::periods::MAX_FILTER_PERIODS;

use std::ops::Range;

pub(crate) use clear::{clear_way, clear_ways, unit_s};
pub(crate) use equivalents::quickest_positions_but;
pub(crate) use equivalents::way_length;
pub use equivalents::{equivalent_positions, quickest_positions};
pub use moves::Move;
pub use test::Test;
use way::check_way;
pub use way::gimbal_change;
pub(crate) use way::way;
use way::way_between;

use crate::attitude::{Attitude, Degrees, NanoDegrees, Position};
use crate::error::{Error, Result};
use crate::platform::{Platform, Repositioning};
use crate::schedule::{Schedule, ScheduledPosition};

/// Angles closer than this, half of the last place that files carry, are the same.
const SAME_ANGLE_DEG: f64 = 0.5e-9;

/// A position with its angles taken apart.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    position: Position,
    angles: [Degrees; 3],
}

impl Place {
    #[inline]
    pub fn new(position: Position) -> Self {
        Self {
            position,
            angles: position.exact(),
        }
    }

    /// The angles in whole 1e-9°.
    fn nano(&self) -> [NanoDegrees; 3] {
        self.angles.map(|angle| angle.nano)
    }
}

/// One position of a timeline: the move to it, the settle, the dwell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// The move to the position; none for the first position.
    pub arrival: Option<Move>,
    /// Settling after the move, s; the filter does not measure.
    pub settle_s: f64,
    /// The position.
    pub position: Position,
    /// Its attitude.
    pub attitude: Attitude,
    /// How long it is held, s.
    pub dwell_s: f64,
}

impl Leg {
    /// Duration of move, settle and dwell, s.
    pub fn duration_s(&self) -> f64 {
        self.arrival.map_or(0.0, |m| m.duration_s) + self.settle_s + self.dwell_s
    }
}

/// A schedule resolved in a test on a platform: what happens when.
#[derive(Debug, Clone, PartialEq)]
pub struct Timeline {
    legs: Vec<Leg>,
    /// Which of the legs are positions of the schedule: the rest is start, what was done before,
    /// and return.
    positions: Range<usize>,
}

impl Timeline {
    /// Resolves `schedule`, what is planned of `test`.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] when a position lies outside a gimbal's range or off the index table,
    /// a `change_deg` does not lead to its position or leaves a range, a `move_s` would exceed a rate or an acceleration or is given in frame-hold repositioning, or the
    /// test is longer than the filter can be stepped through ([`MAX_FILTER_PERIODS`]).
    pub fn new(test: &Test, schedule: &Schedule) -> Result<Self> {
        let platform = test.platform();
        let mut from = test.standing();
        for (index, p) in schedule.positions().iter().enumerate() {
            check_reachable(platform, index, p.position)?;
            check_way(platform, index, from, p)?;
            from = Some(p.position);
        }
        let timeline = Self::unchecked(test, schedule.positions().iter().copied());
        for (index, p) in schedule.positions().iter().enumerate() {
            check_move(platform, index, p, &timeline.position_legs()[index])?;
        }
        timeline.check_clear(platform)?;
        let periods = timeline.total_time_s() / platform.period_s;
        if periods > MAX_FILTER_PERIODS {
            let error = Error::input("the test has too many filter periods")
                .with_key("filter.period_s")
                .with_value(platform.period_s)
                .with_allowed(format!(
                    "at most {MAX_FILTER_PERIODS:e} periods in the test"
                ));
            let moving_s = timeline.overhead_s();
            return Err(match moving_s > 0.5 * timeline.total_time_s() {
                true => error.with_hint(format!(
                    "moves and settles take {moving_s:.0} s of it: see motion.slew_rate_deg_per_s"
                )),
                false => error,
            });
        }
        Ok(timeline)
    }

    /// Start, positions and return, unchecked: for searches, which only propose what is
    /// reachable.
    pub(crate) fn unchecked(
        test: &Test,
        positions: impl ExactSizeIterator<Item = ScheduledPosition>,
    ) -> Self {
        Self::through(test, positions.map(|p| (p.position.exact(), p)))
    }

    /// The same through positions whose angles are taken apart already.
    pub(crate) fn through(
        test: &Test,
        positions: impl ExactSizeIterator<Item = ([Degrees; 3], ScheduledPosition)>,
    ) -> Self {
        let platform = test.platform();
        let motion = &platform.motion;
        let mut legs: Vec<Leg> = Vec::with_capacity(positions.len() + 2);
        // Angles are taken apart once for a position, not again as the next one's start.
        let mut from: Option<Place> = None;
        let mut add = |angles: [Degrees; 3], p: &ScheduledPosition| {
            let position = p.position;
            let to = Place { position, angles };
            legs.push(Self::leg_to(platform, from.as_ref(), &to, p));
            from = Some(to);
        };
        if let Some(start) = motion.start {
            add(start.exact(), &ScheduledPosition::new(start, 0.0));
        }
        let done = test.done().map_or(&[][..], Schedule::positions);
        done.iter().for_each(|p| add(p.position.exact(), p));
        positions.for_each(|(angles, p)| add(angles, &p));
        let first = usize::from(motion.start.is_some()) + done.len();
        let positions = first..legs.len();
        if let (true, Some(first), Some(last)) = (motion.return_to_start, legs.first(), legs.last())
        {
            let mut back = ScheduledPosition {
                move_measured: Some(false),
                ..ScheduledPosition::new(first.position, 0.0)
            };
            back.change_deg = match platform.obstacles.stop_moves() {
                true => Self::way_back(platform, &legs, &back),
                false => None,
            };
            let mut back = Self::leg(platform, Some(last.position), &back);
            // Nothing is measured any more.
            back.settle_s = 0.0;
            legs.push(back);
        }
        Self { legs, positions }
    }

    /// A way back that nothing is in, degrees; none: there is none, or it is the usual one.
    fn way_back(platform: &Platform, legs: &[Leg], back: &ScheduledPosition) -> Option<[f64; 3]> {
        let from = Place::new(legs.last()?.position);
        let to = Place::new(back.position);
        let way = clear_way(platform, &from, &to, None, Some(clear::wound(legs)))?;
        Some(way.map(Degrees::deg))
    }

    /// The same with other dwells at the positions of the schedule, s: the moves do not depend on them.
    pub(crate) fn with_dwells(mut self, dwell_s: impl IntoIterator<Item = f64>) -> Self {
        for (leg, dwell_s) in self.legs[self.positions.clone()].iter_mut().zip(dwell_s) {
            leg.dwell_s = dwell_s;
        }
        self
    }

    /// Position `index` exchanged for another one, its dwell kept: its leg and the arrival at the
    /// one that follows, and how much longer the whole takes, s. For timelines without moves of
    /// their own.
    pub(crate) fn exchange(
        &self,
        platform: &Platform,
        index: usize,
        position: Position,
    ) -> (Self, f64) {
        let at = self.positions.start + index;
        let last = self.legs.len() - 1;
        let returns = last == self.positions.end;
        // Without a start attitude a test returns to its first position.
        let home_is_here = returns && at == 0;
        let arrived_anew = |k: usize, from: Position| {
            let mut leg = self.legs[k];
            let is_return = returns && k == last;
            if is_return && home_is_here {
                leg.position = position;
                leg.attitude = platform.stand.attitude(position);
            }
            let held = ScheduledPosition {
                move_measured: is_return.then_some(false),
                ..ScheduledPosition::new(leg.position, leg.dwell_s)
            };
            let to = Place::new(leg.position);
            leg.arrival = Some(Self::arrival(platform, &Place::new(from), &to, &held));
            (leg, leg.duration_s() - self.legs[k].duration_s())
        };
        let before = at.checked_sub(1).map(|k| self.legs[k].position);
        let held = ScheduledPosition::new(position, self.legs[at].dwell_s);
        let mut part = self.part(at..at + 1);
        part.legs[0] = Self::leg(platform, before, &held);
        let mut more_s = part.legs[0].duration_s() - self.legs[at].duration_s();
        if let Some(next) = part.legs.get_mut(1) {
            let (leg, longer_s) = arrived_anew(at + 1, position);
            *next = Leg {
                dwell_s: 0.0,
                ..leg
            };
            more_s += longer_s;
        }
        if home_is_here && at + 1 < last {
            more_s += arrived_anew(last, self.legs[last - 1].position).1;
        }
        (part, more_s)
    }

    /// Some of the legs and the arrival at the one that follows, without its dwell.
    pub(crate) fn part(&self, range: Range<usize>) -> Self {
        let mut legs = self.legs[range.clone()].to_vec();
        if let Some(next) = self.legs.get(range.end) {
            legs.push(Leg {
                dwell_s: 0.0,
                ..*next
            });
        }
        let positions = 0..legs.len();
        Self { legs, positions }
    }

    /// Some of the legs alone.
    pub(crate) fn only(&self, range: Range<usize>) -> Self {
        let legs = self.legs[range].to_vec();
        let positions = 0..legs.len();
        Self { legs, positions }
    }

    /// The move to a position, from where there is one.
    #[inline]
    fn arrival(platform: &Platform, from: &Place, to: &Place, p: &ScheduledPosition) -> Move {
        let motion = &platform.motion;
        let way = way_between(platform, from.angles, to.angles, p.change_deg);
        let change = [way[0].rad(), way[1].rad(), way[2].rad()];
        let duration_s = match motion.repositioning {
            Repositioning::Slew => p.move_s.unwrap_or_else(|| {
                // What is left of a change by rounding angles is none: at a hundredth of a degree a
                // second it would take longer than the slack that times are compared with.
                let moves = way.iter().any(|c| c.deg().abs() > SAME_ANGLE_DEG);
                match motion.slew {
                    Some(slew) if moves => slew.shortest_s(&change),
                    _ => 0.0,
                }
            }),
            Repositioning::FrameHold => 0.0,
        };
        let measured = p.move_measured.unwrap_or(motion.measure_moves);
        let arrival = Move::new(from.position.to_array(), change, duration_s, measured);
        match motion.slew {
            Some(slew) if duration_s > 0.0 => arrival.with_ramp(slew.ramp(&change, duration_s)),
            _ => arrival,
        }
    }

    /// One leg, unchecked.
    fn leg(platform: &Platform, from: Option<Position>, p: &ScheduledPosition) -> Leg {
        let from = from.map(Place::new);
        Self::leg_to(platform, from.as_ref(), &Place::new(p.position), p)
    }

    #[inline]
    fn leg_to(platform: &Platform, from: Option<&Place>, to: &Place, p: &ScheduledPosition) -> Leg {
        let arrival = from.map(|from| Self::arrival(platform, from, to, p));
        Leg {
            arrival,
            settle_s: match arrival {
                Some(m) if !m.measured => platform.motion.settle_s,
                _ => 0.0,
            },
            position: p.position,
            attitude: platform.stand.attitude_of(to.angles),
            dwell_s: p.dwell_s,
        }
    }

    /// The leg of a position that is reached from another one, held for no time.
    pub(crate) fn arrival_leg(platform: &Platform, from: Option<Position>, to: Position) -> Leg {
        Self::leg(platform, from, &ScheduledPosition::new(to, 0.0))
    }

    /// The legs in order, start and return included.
    pub fn legs(&self) -> &[Leg] {
        &self.legs
    }

    /// Which of the legs are positions of the schedule.
    pub fn positions(&self) -> Range<usize> {
        self.positions.clone()
    }

    /// The legs of the schedule's positions, in its order.
    pub fn position_legs(&self) -> &[Leg] {
        &self.legs[self.positions()]
    }

    /// Duration of the whole test, moves and settles included, s.
    pub fn total_time_s(&self) -> f64 {
        self.legs.iter().map(Leg::duration_s).sum()
    }

    /// Time that is not the schedule's own dwells, s: moves, settles, and what was done before it.
    pub fn overhead_s(&self) -> f64 {
        let done: f64 = self.legs[..self.positions.start]
            .iter()
            .map(|l| l.dwell_s)
            .sum();
        let moving: f64 = self.legs.iter().map(|l| l.duration_s() - l.dwell_s).sum();
        moving + done
    }
}

/// Checks a position against the ranges and the index table.
fn check_reachable(platform: &Platform, index: usize, position: Position) -> Result<()> {
    const AXES: [&str; 3] = ["alpha_deg", "beta_deg", "gamma_deg"];
    let deg = position.to_deg();
    for (axis, angle) in position.degrees().into_iter().enumerate() {
        if let Some(allowed) = platform.gimbals.refusal(axis, angle) {
            let key = format!("positions[{index}].{}", AXES[axis]);
            return Err(Error::out_of_range(&key, deg[axis], &allowed));
        }
    }
    Ok(())
}

/// Checks a `move_s` against the repositioning mode and the slew rate.
fn check_move(platform: &Platform, index: usize, p: &ScheduledPosition, leg: &Leg) -> Result<()> {
    let (Some(m), Some(move_s)) = (leg.arrival, p.move_s) else {
        return Ok(());
    };
    let key = format!("positions[{index}].move_s");
    if platform.motion.repositioning == Repositioning::FrameHold && move_s != 0.0 {
        return Err(
            Error::input("a move takes no time in frame-hold repositioning")
                .with_key(key)
                .with_value(move_s)
                .with_allowed("0, or motion.repositioning = \"slew\""),
        );
    }
    if let Some(slew) = platform.motion.slew {
        let shortest = slew.shortest_s(&m.change);
        if move_s < shortest * (1.0 - 1e-9) {
            let what = match slew.acceleration_rad_per_s2 {
                None => "the move would exceed motion.slew_rate_deg_per_s",
                Some(_) => {
                    "the move would exceed motion.slew_rate_deg_per_s or \
                     motion.acceleration_deg_per_s2"
                }
            };
            return Err(Error::input(what)
                .with_key(key)
                .with_value(move_s)
                .with_allowed(format!("{shortest:.3} or more")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::PlatformConfig;
    use crate::units::Angle;

    fn platform(change: impl FnOnce(&mut PlatformConfig)) -> Platform {
        let mut config = PlatformConfig::default();
        change(&mut config);
        config.check().unwrap()
    }

    fn schedule(angles_deg: &[[f64; 3]]) -> Schedule {
        let positions = angles_deg
            .iter()
            .map(|a| ScheduledPosition::new(Position::from_deg(a[0], a[1], a[2]), 100.0));
        Schedule::new(positions.collect()).unwrap()
    }

    #[test]
    fn an_exchange_is_the_timeline_of_the_exchanged_positions() {
        for (start, returns, measured) in [
            (None, false, false),
            (None, true, true),
            (None, true, false),
            (Some([5.0; 3]), true, false),
        ] {
            let platform = platform(|c| {
                c.motion.slew_rate_deg_per_s = Some(0.7.into());
                c.motion.settle_s = 30.0;
                c.motion.measure_moves = measured;
                c.motion.start_deg = start;
                c.motion.return_to_start = returns;
            });
            let of =
                |angle: f64| ScheduledPosition::new(Position::from_deg(angle, 20.0, -angle), 300.0);
            let all = [of(10.0), of(-80.0), of(150.0), of(60.0)];
            let whole = |p: &[ScheduledPosition]| {
                Timeline::unchecked(&platform.clone().into(), p.iter().copied())
            };
            // One position alone, then more of them.
            for positions in (1..=all.len()).map(|n| &all[..n]) {
                let before = whole(positions);
                for k in 0..positions.len() {
                    let place = Position::from_deg(-33.0, 50.0, 7.0);
                    let mut exchanged = positions.to_vec();
                    exchanged[k].position = place;
                    let after = whole(&exchanged);
                    let (part, more_s) = before.exchange(&platform, k, place);
                    let at = before.positions().start + k;
                    assert_eq!(part, after.part(at..at + 1));
                    let expected_s = after.total_time_s() - before.total_time_s();
                    assert!(
                        (more_s - expected_s).abs() < 1e-9,
                        "{k}: {more_s} {expected_s}"
                    );
                }
            }
        }
    }

    #[test]
    fn unlimited_gimbals_take_the_short_way_and_half_turns_go_positive() {
        let p = platform(|_| {});
        let at = |a| Position::from_deg(a, 0.0, 0.0);
        let way = |from, to| Angle::from_rad(gimbal_change(&p, at(from), at(to))[0]).deg();
        assert!((way(170.0, -170.0) - 20.0).abs() < 1e-9);
        assert!((way(-170.0, 170.0) + 20.0).abs() < 1e-9);
        assert!((way(0.0, 180.0) - 180.0).abs() < 1e-9);
        assert!((way(180.0, 0.0) - 180.0).abs() < 1e-9);
    }

    #[test]
    fn limited_gimbals_go_straight() {
        let p = platform(|c| c.gimbals.alpha_deg = Some([-180.0, 180.0]));
        let way = gimbal_change(
            &p,
            Position::from_deg(170.0, 0.0, 0.0),
            Position::from_deg(-170.0, 0.0, 0.0),
        );
        assert!((Angle::from_rad(way[0]).deg() + 340.0).abs() < 1e-9);
    }

    #[test]
    fn total_time_counts_moves_and_settles_but_nothing_before_the_first_position() {
        let p = platform(|c| {
            c.motion.slew_rate_deg_per_s = Some(0.5.into());
            c.motion.settle_s = 30.0;
        });
        let s = schedule(&[[10.0, 20.0, 30.0], [10.0, 80.0, 20.0], [10.0, 80.0, 20.0]]);
        let t = Timeline::new(&p.clone().into(), &s).unwrap();
        // 60° at 0.5 °/s is 120 s; the zero-time move to the same position settles too.
        assert!((t.total_time_s() - (300.0 + 120.0 + 60.0)).abs() < 1e-9);
        assert!((t.overhead_s() - 180.0).abs() < 1e-9);
        let measured = platform(|c| {
            c.motion.slew_rate_deg_per_s = Some(0.5.into());
            c.motion.settle_s = 30.0;
            c.motion.measure_moves = true;
        });
        let t = Timeline::new(&measured.into(), &s).unwrap();
        assert!((t.total_time_s() - (300.0 + 120.0)).abs() < 1e-9);
    }

    #[test]
    fn start_and_return_are_moves_of_the_test() {
        let s = schedule(&[[10.0, 20.0, 30.0], [10.0, 80.0, 20.0]]);
        let total = |start_deg: Option<[f64; 3]>, return_to_start: bool| {
            let p = platform(|c| {
                c.motion.slew_rate_deg_per_s = Some(0.5.into());
                c.motion.settle_s = 30.0;
                c.motion.start_deg = start_deg;
                c.motion.return_to_start = return_to_start;
            });
            let t = Timeline::new(&p.clone().into(), &s).unwrap();
            assert_eq!(t.position_legs().len(), 2);
            assert_eq!(t.position_legs()[1].position, s.positions()[1].position);
            let dwells = 200.0;
            assert!((t.overhead_s() + dwells - t.total_time_s()).abs() < 1e-9);
            t.total_time_s()
        };
        // Two dwells, 60° at 0.5 °/s and a settle.
        let plain = 200.0 + 120.0 + 30.0;
        assert!((total(None, false) - plain).abs() < 1e-9);
        // Back to the first position: 60° again; nothing settles after the last measurement.
        assert!((total(None, true) - (plain + 120.0)).abs() < 1e-9);
        // From [0, 0, 0]: 30° and a settle before; 80° after.
        let start = Some([0.0; 3]);
        assert!((total(start, false) - (plain + 60.0 + 30.0)).abs() < 1e-9);
        assert!((total(start, true) - (plain + 60.0 + 30.0 + 160.0)).abs() < 1e-9);
    }

    #[test]
    fn nothing_is_measured_on_the_way_back() {
        let p = platform(|c| {
            c.motion.slew_rate_deg_per_s = Some(0.5.into());
            c.motion.measure_moves = true;
            c.motion.return_to_start = true;
        });
        let s = schedule(&[[10.0, 20.0, 30.0], [10.0, 80.0, 20.0]]);
        let t = Timeline::new(&p.clone().into(), &s).unwrap();
        let measured = |leg: &Leg| leg.arrival.map(|m| m.measured);
        let all: Vec<Option<bool>> = t.legs().iter().map(measured).collect();
        assert_eq!(all, [None, Some(true), Some(false)]);
    }

    #[test]
    fn what_was_done_before_counts_as_overhead() {
        let p = platform(|c| {
            c.motion.slew_rate_deg_per_s = Some(0.5.into());
            c.motion.settle_s = 30.0;
        });
        let done = schedule(&[[10.0, 20.0, 30.0], [10.0, 80.0, 20.0]]);
        let rest = schedule(&[[10.0, 20.0, 20.0]]);
        let test = Test::from(p).interrupted_after(done).unwrap();
        let t = Timeline::new(&test, &rest).unwrap();
        // Two dwells of 100 s, two moves of 60° with a settle each; then the one dwell left.
        assert!((t.overhead_s() - (200.0 + 2.0 * (120.0 + 30.0))).abs() < 1e-9);
        assert!((t.total_time_s() - t.overhead_s() - 100.0).abs() < 1e-9);
    }

    #[test]
    fn what_the_platform_cannot_do_is_refused_by_key() {
        let p = platform(|c| {
            c.gimbals.beta_deg = Some([-60.0, 60.0]);
            c.motion.slew_rate_deg_per_s = Some(1.0.into());
        });
        let s = schedule(&[[0.0, 0.0, 0.0], [0.0, 61.0, 0.0]]);
        let error = Timeline::new(&p.clone().into(), &s).unwrap_err();
        assert_eq!(error.key(), Some("positions[1].beta_deg"));
        assert!(error.allowed().unwrap().contains("-60 to 60"));

        let table = platform(|c| c.gimbals.step_deg = Some(15.0));
        let error =
            Timeline::new(&table.clone().into(), &schedule(&[[0.0, 20.0, 0.0]])).unwrap_err();
        assert_eq!(error.key(), Some("positions[0].beta_deg"));
        assert!(Timeline::new(&table.clone().into(), &schedule(&[[0.0, -165.0, 345.0]])).is_ok());

        let mut positions = schedule(&[[0.0; 3], [30.0, 0.0, 0.0]]).positions().to_vec();
        positions[1].move_s = Some(29.0);
        let fast = Schedule::new(positions.clone()).unwrap();
        let error = Timeline::new(&p.clone().into(), &fast).unwrap_err();
        assert_eq!(error.key(), Some("positions[1].move_s"));
        // 30° at 1 °/s, and a little slower.
        for enough in [30.0, 30.001] {
            positions[1].move_s = Some(enough);
            let schedule = Schedule::new(positions.clone()).unwrap();
            assert!(Timeline::new(&p.clone().into(), &schedule).is_ok());
        }
        let hold = platform(|c| c.motion.repositioning = Repositioning::FrameHold);
        assert!(Timeline::new(&hold.into(), &fast).unwrap_err().is_input());
    }
}
