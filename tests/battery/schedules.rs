//! Schedules of any number of positions, spread over all angles: what is timed.

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::platform::{Platform, PlatformConfig};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

/// Duration of the test, s.
const TOTAL_S: f64 = 12_000.0;

/// What the schedules of a case have.
#[derive(Clone, Copy)]
pub struct Case {
    pub count: usize,
    total_s: f64,
    /// On every dwell, s: zero for whole filter periods.
    more_s: f64,
    /// How far dwells differ from schedule to schedule, s.
    spread_s: f64,
    slews: bool,
}

impl Case {
    pub fn whole(count: usize) -> Self {
        Self {
            count,
            total_s: TOTAL_S,
            more_s: 0.0,
            spread_s: 0.0,
            slews: false,
        }
    }

    /// What a search sees: dwells of any length, and the relaxed measurement at their ends.
    pub fn relaxed(count: usize) -> Self {
        Self {
            more_s: 3.7,
            spread_s: 40.0,
            ..Self::whole(count)
        }
    }

    /// Twenty positions on a stand that turns at 0.5 °/s and settles for 30 s.
    pub fn slews() -> Self {
        Self {
            slews: true,
            ..Self::relaxed(20)
        }
    }

    /// The same in another total time, s.
    pub fn lasting(self, total_s: f64) -> Self {
        Self { total_s, ..self }
    }

    pub fn platform(&self) -> Platform {
        let mut config = PlatformConfig::default();
        if self.slews {
            config.motion.slew_rate_deg_per_s = Some(0.5.into());
            config.motion.settle_s = 30.0;
        }
        config.check().unwrap()
    }

    /// Schedule `index` of the case.
    pub fn schedule(&self, index: usize) -> Schedule {
        let dwell = (self.total_s / self.count as f64 / 10.0).floor() * 10.0 + self.more_s;
        let positions = (0..self.count).map(|k| {
            let (k, i) = (k as f64, index as f64);
            let angles = [0.3 + 2.1 * k + i, 1.1 * k * k - i, 1.7 * k * k * k];
            let angles = angles.map(|a| a % std::f64::consts::TAU);
            let dwell_s = dwell + self.spread_s * (1.7 * i + k).sin();
            ScheduledPosition::new(Position::from_array(angles), dwell_s)
        });
        Schedule::new(positions.collect()).unwrap()
    }
}
