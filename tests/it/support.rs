//! What several subjects share: random schedules.

use scheme_opt::internals::attitude::Position;
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
