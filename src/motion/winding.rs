//! Whole turns counted: where the gimbals stand when every move goes on from the one before.
//!
//! A schedule names positions, and a whole turn makes no difference to one. A stand has cables: what
//! counts there is the net angle, the sum of all moves since the start.

use super::{Leg, Timeline};
use crate::attitude::Position;
use crate::units::{Angle, round_deg};

impl Timeline {
    /// Each leg's position as the gimbals then stand: congruent to it modulo 360°, and reached from the
    /// one before by the way that the move takes. The first is as it is given.
    pub fn net_positions(&self) -> Vec<Position> {
        let mut turns = [0.0; 3];
        let mut all: Vec<Position> = Vec::with_capacity(self.legs.len());
        let mut before: Option<&Leg> = None;
        for leg in &self.legs {
            let here = leg.position.degrees();
            if let (Some(before), Some(arrival)) = (before, &leg.arrival) {
                let from = before.position.degrees();
                for axis in 0..3 {
                    let way = Angle::from_rad(arrival.change[axis]).deg();
                    // A whole number but for rounding: the way leads from the one to the other.
                    turns[axis] += ((way - (here[axis] - from[axis])) / 360.0).round();
                }
            }
            let [a, b, g] = std::array::from_fn(|axis| here[axis] + 360.0 * turns[axis]);
            all.push(Position::from_deg(a, b, g));
            before = Some(leg);
        }
        all
    }

    /// How far each gimbal is from where the test began, at most: the largest |net angle − start| of α,
    /// β and γ at any instant, degrees. Start, what was done before and return included.
    ///
    /// ```
    /// use scheme_opt::internals::motion::Timeline;
    /// use scheme_opt::internals::platform::PlatformConfig;
    /// use scheme_opt::internals::attitude::Position;
    /// use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
    /// let at = |deg| ScheduledPosition::new(Position::from_deg(deg, 0.0, 0.0), 600.0);
    /// // Always 120° on.
    /// let schedule = Schedule::new(vec![at(0.0), at(120.0), at(-120.0), at(0.0), at(120.0)])?;
    /// let timeline = Timeline::new(&PlatformConfig::default().check()?.into(), &schedule)?;
    /// assert_eq!(timeline.winding_deg(), [480.0, 0.0, 0.0]);
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn winding_deg(&self) -> [f64; 3] {
        let net = self.net_positions();
        // On the way from one position to the next every axis turns one way: the ends are the farthest.
        std::array::from_fn(|axis| {
            let angle = |position: &Position| position.degrees()[axis];
            let off = net.iter().map(|p| (angle(p) - angle(&net[0])).abs());
            round_deg(off.fold(0.0, f64::max))
        })
    }
}
