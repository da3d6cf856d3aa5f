//! What fits into the time: the least that any schedule takes, and plans brought within it.
//!
//! A schedule takes at least the time of one position, held for the shortest dwell, where the
//! platform stands already: a way over other positions is no shorter than the direct one (the turn
//! of the slowest axis obeys the triangle inequality, on limited axes and around unlimited ones),
//! and where the platform stands is a position it can take. So [`LeastTime`] is exact: with less
//! time there is no schedule, with as much there is one.

use crate::error::{Error, Result};
use crate::motion::Test;

use super::plan::{Plan, TIME_SLACK};

/// The shortest time in which the platform can do anything at all, and what it is made of, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LeastTime {
    /// What is done already.
    done_s: f64,
    /// Settling after the arrival at the first position.
    settle_s: f64,
    /// One dwell: the minimum in whole filter periods.
    dwell_s: f64,
    /// The way back to where the test began.
    return_s: f64,
}

impl LeastTime {
    pub fn of(test: &Test) -> Self {
        let plan = Plan::new(
            vec![test.standing().unwrap_or_default().to_array()],
            vec![test.platform().shortest_dwell_s()],
        );
        let timeline = plan.timeline(test);
        let held = timeline.positions();
        let done = test.done().is_some();
        let duration = |legs: &[crate::motion::Leg]| legs.iter().map(|l| l.duration_s()).sum();
        Self {
            done_s: match done {
                true => duration(&timeline.legs()[..held.start]),
                false => 0.0,
            },
            settle_s: timeline.position_legs()[0].settle_s,
            dwell_s: plan.dwell_s[0],
            return_s: duration(&timeline.legs()[held.end..]),
        }
    }

    /// All of it, s.
    pub fn total_s(&self) -> f64 {
        self.done_s + self.settle_s + self.dwell_s + self.return_s
    }

    /// Refuses a total time that no schedule fits into, and says what the least is made of.
    pub fn check(&self, total_time_s: f64) -> Result<()> {
        if self.total_s() <= total_time_s * (1.0 + TIME_SLACK) {
            return Ok(());
        }
        let parts = [
            ("for what is done already", self.done_s),
            (
                "to settle at the first position (motion.settle_s)",
                self.settle_s,
            ),
            (
                "for the shortest dwell (motion.min_dwell_s in whole filter periods, one at least)",
                self.dwell_s,
            ),
            ("for the way back (motion.return_to_start)", self.return_s),
        ];
        let parts: Vec<String> = parts
            .iter()
            .filter(|(_, s)| *s > 0.0)
            .map(|(what, s)| format!("{} s {what}", enough_s(*s)))
            .collect();
        Err(Error::infeasible("no schedule fits into the time")
            .with_key("objective.total_time_s")
            .with_value(total_time_s)
            .with_allowed(format!(
                "at least {} s: {}",
                enough_s(self.total_s()),
                parts.join(", ")
            )))
    }
}

/// A time to the microsecond, rounded up: what is printed is enough.
fn enough_s(time_s: f64) -> f64 {
    (time_s * 1e6 - 1e-3).ceil() / 1e6
}

/// By how much the moves of a plan are shortened, in turn, until it is within the time. In the end
/// the platform stays where it stands.
const SHORTER_BY: [f64; 23] = [
    1e-6, 4e-6, 1.6e-5, 6.4e-5, 2.5e-4, 1e-3, 4e-3, 1.6e-2, 0.06, 0.12, 0.25, 0.37, 0.5, 0.62,
    0.75, 0.87, 0.94, 0.97, 0.985, 0.992, 0.996, 0.999, 1.0,
];

/// What `ready` makes of `plan`; where that is nothing, because the plan does not fit into the
/// time, of the plan with its moves shortened by as little as it takes, and with so many of its
/// positions as fit at all.
pub(super) fn brought_within<T>(
    test: &Test,
    plan: &Plan,
    ready: impl Fn(Plan) -> Option<T>,
) -> Option<T> {
    if let Some(ready) = ready(plan.clone()) {
        return Some(ready);
    }
    let shorter = |plan: &Plan, share: f64| ready(plan.with_shorter_moves(test, share));
    let mut plan = plan.clone();
    while shorter(&plan, 1.0).is_none() {
        let last = (0..plan.angles.len()).rev().find(|k| !plan.is_held(*k))?;
        if plan.angles.len() < 2 {
            return None;
        }
        plan = plan.without(last);
    }
    SHORTER_BY
        .into_iter()
        .find_map(|share| shorter(&plan, share))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Position;
    use crate::motion::Timeline;
    use crate::platform::PlatformConfig;
    use crate::schedule::Schedule;
    use crate::schedule::ScheduledPosition;
    use crate::search::still::{still, stillest};

    fn test(change: impl FnOnce(&mut PlatformConfig)) -> Test {
        crate::testing::platform(change).into()
    }

    #[test]
    fn the_least_time_is_that_of_staying_where_the_platform_stands() {
        let moving = test(|c| {
            c.motion.slew_rate_deg_per_s = Some(1.0.into());
            c.motion.settle_s = 7.0;
            c.motion.min_dwell_s = 25.0;
            c.motion.start_deg = Some([10.0, 20.0, 30.0]);
            c.motion.return_to_start = true;
        });
        let least = LeastTime::of(&moving);
        assert_eq!(least.total_s(), 37.0);
        assert!(least.check(37.0).is_ok());
        let error = least.check(36.9).unwrap_err();
        assert!(error.is_infeasible());
        let words = error.to_string();
        assert!(words.contains("at least 37 s: 7 s to settle"), "{words}");
        assert!(words.contains("30 s for the shortest dwell"), "{words}");
        // Exactly as long as a schedule of it.
        let schedule = stillest(&moving).unwrap();
        let timeline = Timeline::new(&moving, &schedule).unwrap();
        assert_eq!(timeline.total_time_s(), 37.0);
        // Half way through a test, the rest has to lead back.
        let at = |deg| ScheduledPosition::new(Position::from_deg(deg, 20.0, 30.0), 100.0);
        let done = Schedule::new(vec![at(50.0)]).unwrap();
        let later = moving.interrupted_after(done).unwrap();
        // 40 s there, 7 s, 100 s, then 7 s, 30 s, and 40 s back.
        assert!((LeastTime::of(&later).total_s() - 224.0).abs() < 1e-9);
    }

    #[test]
    fn rounding_of_the_times_does_not_refuse() {
        let rounded = test(|c| {
            c.filter.period_s = 0.1;
            c.motion.settle_s = 0.1;
            c.motion.min_dwell_s = 0.2;
            c.motion.start_deg = Some([0.0; 3]);
        });
        assert!(LeastTime::of(&rounded).check(0.3).is_ok());
        let plan = still(&rounded).unwrap();
        assert!(plan.fitted(&rounded, 0.3).is_some());
        // More places than a plan keeps, on a stand so slow that the last of them would take time.
        let slow = test(|c| {
            c.filter.period_s = 0.1;
            c.motion.min_dwell_s = 0.2;
            c.motion.slew_rate_deg_per_s = Some(0.005.into());
            c.motion.start_deg = Some([233.906_559_076_442_7, -400.0, -49.354_224_943_479_38]);
            c.motion.return_to_start = true;
        });
        let plan = still(&slow).unwrap();
        assert!(plan.fitted(&slow, 0.2).is_some());
    }

    #[test]
    fn any_plan_is_brought_within_the_least_time() {
        let slow = test(|c| {
            c.motion.slew_rate_deg_per_s = Some(0.01.into());
            c.motion.settle_s = 7.0;
            c.motion.start_deg = Some([10.0, 20.0, 30.0]);
            c.motion.return_to_start = true;
        });
        let plan = Plan::new(
            (0..5).map(|k| [f64::from(k), 0.5, -1.0]).collect(),
            vec![100.0; 5],
        );
        for (total_time_s, positions) in [(67.0, 1), (140.0, 2), (1e4, 5)] {
            let fit = |plan: Plan| plan.fitted(&slow, total_time_s);
            let found = brought_within(&slow, &plan, fit).unwrap();
            assert_eq!(found.angles.len(), positions, "{total_time_s}");
        }
        assert!(brought_within(&slow, &plan, |p| p.fitted(&slow, 66.0)).is_none());
    }

    #[test]
    fn a_position_is_found_on_any_stand() {
        for (alpha, step) in [
            (Some([33.0, 33.0]), None),
            (Some([33.0, 80.0]), Some(40.0)),
            (None, Some(7.0)),
            (Some([-900.0, -700.0]), None),
        ] {
            let odd = test(|c| {
                c.gimbals.alpha_deg = alpha;
                c.gimbals.step_deg = step;
            });
            let schedule = stillest(&odd).unwrap();
            assert!(Timeline::new(&odd, &schedule).is_ok(), "{alpha:?} {step:?}");
        }
        let nowhere = test(|c| {
            c.gimbals.alpha_deg = Some([33.0, 34.0]);
            c.gimbals.step_deg = Some(40.0);
        });
        assert!(stillest(&nowhere).unwrap_err().is_infeasible());
    }
}
