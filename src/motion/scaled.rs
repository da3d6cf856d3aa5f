//! A schedule in another total time: what it takes depends on how the platform moves.

use super::{Test, Timeline};
use crate::error::{Error, Result};
use crate::schedule::{Schedule, ScheduledPosition, periods};

impl Schedule {
    /// The same test in another total time, s: dwells and measured moves of given duration are
    /// scaled by one factor, in whole filter periods that leave less than a period of the total.
    /// Moves and settles stay as they are.
    ///
    /// # Errors
    ///
    /// As [`Timeline::new`]; [`Error::is_infeasible`] when moves and settles, or a period for
    /// each dwell, need more than the total time.
    pub fn scaled_to(&self, test: &Test, total_time_s: f64) -> Result<Self> {
        let platform = test.platform();
        let timeline = Timeline::new(test, self)?;
        let mut scaled = self.positions().to_vec();
        // A measured move of given duration is measuring time like a dwell.
        let turning = |p: &ScheduledPosition| {
            let measured = p.move_measured.unwrap_or(platform.motion().measure_moves);
            p.move_s.filter(|s| measured && *s > 0.0)
        };
        let measuring: Vec<f64> = scaled
            .iter()
            .flat_map(|p| [turning(p), Some(p.dwell_s).filter(|d| *d > 0.0)])
            .flatten()
            .collect();
        let sum: f64 = measuring.iter().sum();
        let fixed_s = timeline.total_time_s() - sum;
        let budget_s = total_time_s - fixed_s;
        let durations: Vec<f64> = measuring.iter().map(|d| d * budget_s / sum).collect();
        let whole = periods::whole_periods(platform.period_s(), 1.0, &durations, budget_s);
        let needed_s = fixed_s + platform.period_s() * measuring.len() as f64;
        let mut whole = whole
            .ok_or_else(|| {
                Error::infeasible("the schedule does not fit into the time")
                    .with_key("total_time_s")
                    .with_value(total_time_s)
                    .with_allowed(format!("at least {needed_s:.3}"))
            })?
            .into_iter();
        for p in &mut scaled {
            if turning(p).is_some() {
                p.move_s = whole.next();
            }
            if p.dwell_s > 0.0 {
                p.dwell_s = whole.next().unwrap_or(p.dwell_s);
            }
        }
        Self::new(scaled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Position;

    #[test]
    fn scaling_keeps_the_moves_and_the_proportions() {
        let mut config = crate::platform::PlatformConfig::default();
        config.motion.slew_rate_deg_per_s = Some(0.5.into());
        config.motion.settle_s = 30.0;
        let test = Test::from(config.check().unwrap());
        let at = |deg: f64, dwell_s: f64| {
            ScheduledPosition::new(Position::from_deg(deg, 0.0, 0.0), dwell_s)
        };
        let turning = ScheduledPosition {
            move_s: Some(400.0),
            move_measured: Some(true),
            ..at(120.0, 0.0)
        };
        let schedule = Schedule::new(vec![at(0.0, 200.0), at(60.0, 400.0), turning]).unwrap();
        // 1000 s of measuring, 120 s of slewing, 30 s of settling.
        let scaled = schedule.scaled_to(&test, 2157.0).unwrap();
        let timeline = Timeline::new(&test, &scaled).unwrap();
        assert!((timeline.total_time_s() - 2150.0).abs() < 1e-9);
        let [a, b, c] = scaled.positions() else {
            unreachable!("three positions");
        };
        assert_eq!(
            (a.dwell_s, b.dwell_s, c.move_s),
            (400.0, 800.0, Some(800.0))
        );
        assert!(
            schedule
                .scaled_to(&test, 170.0)
                .unwrap_err()
                .is_infeasible()
        );
        // Twice the slew rate is refused, not driven.
        assert!(schedule.scaled_to(&test, 500.0).is_ok_and(|s| {
            Timeline::new(&test, &s).is_err() || s.positions()[2].move_s >= Some(120.0)
        }));
    }
}
