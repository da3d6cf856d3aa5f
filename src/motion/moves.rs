//! One change of position.

use crate::attitude::{Position, wrap_half_turn};

/// A change of position: all gimbals through the same share of their way at the same time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Move {
    /// (α, β, γ) at the start, rad.
    pub from: [f64; 3],
    /// Change of (α, β, γ), rad: the way actually taken, more than a half turn only on limited
    /// gimbals or where the schedule says so.
    pub change: [f64; 3],
    /// Duration, s.
    pub duration_s: f64,
    /// Whether the filter measures meanwhile.
    pub measured: bool,
    /// Share of the duration in which the gimbals speed up, and again slow down.
    pub(super) ramp: f64,
    /// `from` without whole turns, of a move that takes time: a search asks for it again and again.
    reduced_from: Option<[f64; 3]>,
}

impl Move {
    /// From where, by how much, how long in s, and whether the filter measures meanwhile.
    pub(crate) fn new(from: [f64; 3], change: [f64; 3], duration_s: f64, measured: bool) -> Self {
        Self {
            from,
            change,
            duration_s,
            measured,
            ramp: 0.0,
            reduced_from: (duration_s > 0.0).then(|| from.map(wrap_half_turn)),
        }
    }

    /// The same of gimbals that speed up, and again slow down, for a share of the duration.
    pub(crate) const fn with_ramp(self, ramp: f64) -> Self {
        Self { ramp, ..self }
    }

    /// The same in another time, s.
    pub(crate) const fn lasting(self, duration_s: f64) -> Self {
        Self { duration_s, ..self }
    }

    /// (α, β, γ) at the share `fraction` 0..1 of the duration, rad.
    pub fn angles_at(&self, fraction: f64) -> [f64; 3] {
        let done = self.done_at(fraction);
        std::array::from_fn(|i| self.from[i] + done * self.change[i])
    }

    /// The position at the share `fraction` 0..1 of the duration, without the whole turns of its start: the
    /// same whatever turn the start is written in.
    pub fn position_at(&self, fraction: f64) -> Position {
        self.position_after(self.done_at(fraction))
    }

    /// The same where the share `done` 0..1 of the way is done.
    pub(crate) fn position_after(&self, done: f64) -> Position {
        let from = self.reduced_from();
        Position::from_array(std::array::from_fn(|i| from[i] + done * self.change[i]))
    }

    /// (α, β, γ) at the start without whole turns, rad.
    #[inline]
    pub(crate) fn reduced_from(&self) -> [f64; 3] {
        self.reduced_from
            .unwrap_or_else(|| self.from.map(wrap_half_turn))
    }

    /// How far the axis turns that turns most, rad.
    pub fn largest_turn_rad(&self) -> f64 {
        self.change.iter().fold(0.0, |most, c| c.abs().max(most))
    }
}
