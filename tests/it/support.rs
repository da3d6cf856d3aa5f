//! What several subjects share: random schedules.

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::platform::{AxisValue, PlatformConfig};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

/// A small deterministic generator for test data (SplitMix64).
pub struct Random(pub u64);

impl Random {
    /// Of the case of a number.
    pub fn of_case(case: u64) -> Self {
        Self(case.wrapping_mul(0x2545_f491_4f6c_dd1d))
    }

    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub fn position(&mut self) -> Position {
        let mut angle = || self.between(-180.0, 180.0);
        Position::from_deg(angle(), angle(), angle())
    }
}

/// Gimbals that turn at some rate: each at its own, sometimes, and most of them in need of a while to
/// reach it, from far less than a move takes to more than it.
pub fn slewing(config: &mut PlatformConfig, random: &mut Random, low: f64, high: f64) {
    let mut value = |low: f64, high: f64| match random.unit() < 0.5 {
        true => AxisValue::All(random.between(low, high)),
        false => AxisValue::PerAxis(std::array::from_fn(|_| random.between(low, high))),
    };
    config.motion.slew_rate_deg_per_s = Some(value(low, high));
    let acceleration = value(0.01, 0.5);
    config.motion.acceleration_deg_per_s2 = (random.unit() < 0.6).then_some(acceleration);
}

/// The positions in turn, each held as long.
pub fn held(positions: &[Position], dwell_s: f64) -> Schedule {
    let held = positions
        .iter()
        .map(|p| ScheduledPosition::new(*p, dwell_s));
    Schedule::new(held.collect()).unwrap()
}

pub fn random_positions(random: &mut Random, count: usize) -> Vec<Position> {
    (0..count).map(|_| random.position()).collect()
}
