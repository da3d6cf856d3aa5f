//! Plans: what a search moves.

use super::ways::{in_deg, tidied};
use crate::attitude::{Degrees, Position};
use crate::error::Result;
use crate::motion::{Test, Timeline, clear_ways};
use crate::schedule::{Schedule, ScheduledPosition};

/// Times that differ by this share of the total are equal but for rounding.
pub(super) const TIME_SLACK: f64 = 1e-12;

/// A position of the scheme that a search begins with ([`super::given`]), in a plan: it keeps its angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pin {
    /// Its number in the scheme, from 0.
    pub(super) index: usize,
    /// As the scheme has it.
    pub(super) position: Position,
    /// Whether the scheme pins it, so that it keeps its place too.
    pub(super) pinned: bool,
}

/// Angles and dwells of a schedule under work.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// (α, β, γ) of each position, rad.
    pub angles: Vec<[f64; 3]>,
    /// Dwell at each position, s.
    pub dwell_s: Vec<f64>,
    /// About how the gimbals turn on the way to each position, rad: of the ways there are the
    /// nearest is taken. None: the short way.
    pub(super) ways: Vec<Option<[f64; 3]>>,
    /// The positions that keep their angles.
    pub(super) pins: Vec<Option<Pin>>,
}

impl Plan {
    /// Positions with angles in rad and dwells in s, each reached by the short way.
    pub fn new(angles: Vec<[f64; 3]>, dwell_s: Vec<f64>) -> Self {
        Self {
            ways: vec![None; angles.len()],
            pins: vec![None; angles.len()],
            angles,
            dwell_s,
        }
    }

    /// Whether position `k` keeps its angles, and may not be left out.
    pub(super) fn is_held(&self, k: usize) -> bool {
        self.pins.get(k).is_some_and(Option::is_some)
    }

    /// Whether some position keeps its angles.
    pub(super) fn holds_any(&self) -> bool {
        self.pins.iter().any(Option::is_some)
    }

    /// The positions as a schedule has them.
    pub(super) fn entries(&self) -> impl ExactSizeIterator<Item = ScheduledPosition> + '_ {
        self.taken_apart().map(|(_, entry)| entry)
    }

    /// The same, beside each its angles taken apart.
    fn taken_apart(&self) -> impl ExactSizeIterator<Item = ([Degrees; 3], ScheduledPosition)> + '_ {
        let held = self.angles.iter().zip(&self.dwell_s).zip(&self.ways);
        held.zip(&self.pins)
            .map(|(((angles, &dwell_s), way), pin)| {
                let (position, exact) = match pin {
                    Some(pin) => (pin.position, pin.position.exact()),
                    None => Position::exact_of_array(*angles),
                };
                let entry = ScheduledPosition {
                    change_deg: way.map(in_deg),
                    pinned: pin.is_some_and(|pin| pin.pinned),
                    ..ScheduledPosition::new(position, dwell_s)
                };
                (exact, entry)
            })
    }

    /// The plan as a timeline of `test`.
    pub fn timeline(&self, test: &Test) -> Timeline {
        Timeline::through(test, self.taken_apart())
    }

    /// The plan as a schedule for `test`: unlimited axes in (−180°, 180°], ways only where
    /// they are not the short ones.
    ///
    /// # Errors
    ///
    /// As [`Schedule::new`].
    pub fn to_schedule(&self, test: &Test) -> Result<Schedule> {
        Schedule::new(tidied(test, self.entries(), &|k| self.is_held(k)))
    }

    /// The same positions by ways that nothing is in, each the quickest after those before it; none
    /// where there is no such way.
    fn cleared(mut self, test: &Test) -> Option<Self> {
        let entries = self.entries().map(|p| (p.position, p.change_deg));
        let ways = clear_ways(test, entries)?.into_iter();
        self.ways = ways
            .map(|way| way.map(|way| way.map(Degrees::rad)))
            .collect();
        Some(self)
    }

    /// Time in moves and settles, s.
    pub fn overhead_s(&self, test: &Test) -> f64 {
        self.timeline(test).overhead_s()
    }

    /// The plan without position `index`.
    pub fn without(&self, index: usize) -> Self {
        let mut plan = self.clone();
        plan.remove(index);
        plan
    }

    /// The plan with every move from position to position shorter by `share` of it: all positions
    /// closer to the place the plan begins at, and so within the ranges too. Where positions keep
    /// their angles, the others come closer to the one of them before, or to the first.
    pub fn with_shorter_moves(&self, test: &Test, share: f64) -> Self {
        let mut angles = self.unwound(test);
        let Some(&first) = angles.first() else {
            return self.clone();
        };
        let first_held = (0..angles.len()).find(|k| self.is_held(*k));
        let mut anchor = match (test.standing(), first_held) {
            (Some(standing), _) => standing.to_array(),
            (None, Some(k)) => angles[k],
            (None, None) => first,
        };
        for (k, angles) in angles.iter_mut().enumerate() {
            if self.is_held(k) {
                anchor = *angles;
                continue;
            }
            for (angle, anchor) in angles.iter_mut().zip(anchor) {
                *angle -= share * (*angle - anchor);
            }
        }
        Self::of_unwound(test, angles, self.dwell_s.clone()).holding(self.pins.clone())
    }

    /// Scales the dwells so that the plan takes `total_time_s`, none shorter than the platform's
    /// minimum; none when that is impossible.
    pub fn fitted(self, test: &Test, total_time_s: f64) -> Option<Self> {
        Some(self.fitted_timeline(test, total_time_s)?.0)
    }

    /// The plan by ways that nothing is in, with its timeline; none where there are none.
    pub(super) fn passable(mut self, test: &Test) -> Option<(Self, Timeline)> {
        let mut timeline = self.timeline(test);
        if !timeline.is_clear(test.platform()) {
            self = self.cleared(test)?;
            timeline = self.timeline(test);
            if !timeline.is_clear(test.platform()) {
                return None;
            }
        }
        Some((self, timeline))
    }

    /// The fitted plan with its timeline, which had to be made to know how long the moves take.
    pub(super) fn fitted_timeline(
        self,
        test: &Test,
        total_time_s: f64,
    ) -> Option<(Self, Timeline)> {
        let (mut plan, timeline) = self.passable(test)?;
        let min_dwell_s = test.platform().shortest_dwell_s();
        let count = plan.angles.len() as f64;
        let budget = total_time_s - timeline.overhead_s();
        let spare = budget - count * min_dwell_s;
        if spare < -0.5 * TIME_SLACK * total_time_s || budget <= 0.0 {
            return None;
        }
        let spare = spare.max(0.0);
        let above: Vec<f64> = plan
            .dwell_s
            .iter()
            .map(|d| (d - min_dwell_s).max(0.0))
            .collect();
        let sum: f64 = above.iter().sum();
        for (dwell, above) in plan.dwell_s.iter_mut().zip(above) {
            let share = if sum > 0.0 { above / sum } else { 1.0 / count };
            *dwell = min_dwell_s + spare * share;
        }
        let timeline = timeline.with_dwells(plan.dwell_s.iter().copied());
        Some((plan, timeline))
    }
}
