//! The ways from position to position: which way round the unlimited gimbals turn.
//!
//! Between two positions an unlimited gimbal can turn either way round, and what the drift does
//! meanwhile differs. A plan says the way where it is not the short one. While the gradient moves
//! the angles, the whole turns of every way are held: otherwise a change that crosses the half turn
//! would jump to the other side, and the merit with it. The variables therefore are angles that are
//! not wrapped ([`Plan::unwound`]): the way is the difference of two of them. What no gradient
//! sees, the other way round, is tried for the moves near a half turn ([`Plan::other_ways`]).

use super::plan::{Pin, Plan};
use super::ways::{straight_ways, ways_count};
use crate::attitude::{Degrees, NanoDegrees, Position};
use crate::motion::{Test, way};

/// Where moves take time, changes of at least this are tried the other way round: 120°.
const NEAR_HALF_TURN: NanoDegrees = NanoDegrees::new(120_000_000_000);
/// Where only the torquers feel the way, all that are a change at all.
const ANY_TURN: NanoDegrees = NanoDegrees::new(1);

impl Plan {
    /// How the gimbals turn on the way to each position; none where nothing precedes it.
    fn changes(&self, test: &Test) -> Vec<Option<[Degrees; 3]>> {
        let mut from = test.standing();
        let entries = self.entries();
        let change = entries.map(|p| {
            let before = from.replace(p.position)?;
            Some(way(test.platform(), before, p.position, p.change_deg))
        });
        change.collect()
    }

    /// The angles of each position, rad, with the whole turns that the way from the position before
    /// gives them: the way is their difference.
    pub(super) fn unwound(&self, test: &Test) -> Vec<[f64; 3]> {
        let limited = test
            .platform()
            .gimbals()
            .ranges
            .map(|range| range.is_some());
        let mut at = test.standing().map(Position::to_array);
        let steps = self.angles.iter().zip(self.changes(test));
        steps
            .map(|(angles, change)| {
                let mut placed = *angles;
                if let (Some(at), Some(change)) = (at, change) {
                    for axis in (0..3).filter(|axis| !limited[*axis]) {
                        placed[axis] = at[axis] + change[axis].rad();
                    }
                }
                at = Some(placed);
                placed
            })
            .collect()
    }

    /// The plan of angles that are not wrapped.
    pub(super) fn of_unwound(test: &Test, angles: Vec<[f64; 3]>, dwell_s: Vec<f64>) -> Self {
        let ways = straight_ways(test, &angles);
        Self {
            pins: vec![None; angles.len()],
            angles,
            dwell_s,
            ways,
        }
    }

    /// The same with positions that keep their angles.
    pub(super) fn holding(mut self, pins: Vec<Option<Pin>>) -> Self {
        self.pins = pins;
        self
    }

    /// Puts another position in the place of position `k`, reached and left by the short way.
    pub(super) fn replace(&mut self, k: usize, angles: [f64; 3]) {
        self.angles[k] = angles;
        self.pins[k] = None;
        self.forget_way(k);
        self.forget_way(k + 1);
    }

    /// A new position `k`, reached and left by the short way.
    pub(super) fn insert(&mut self, k: usize, angles: [f64; 3], dwell_s: f64) {
        self.angles.insert(k, angles);
        self.dwell_s.insert(k, dwell_s);
        self.ways.insert(k, None);
        self.pins.insert(k, None);
        self.forget_way(k + 1);
    }

    /// Takes position `k` out; what followed it is reached by the short way.
    pub(super) fn remove(&mut self, k: usize) {
        self.angles.remove(k);
        self.dwell_s.remove(k);
        self.ways.remove(k);
        self.pins.remove(k);
        self.forget_way(k);
    }

    /// Positions `from..=to` the other way round, ways between them too.
    pub(super) fn reverse(&mut self, from: usize, to: usize) {
        self.angles[from..=to].reverse();
        self.dwell_s[from..=to].reverse();
        self.pins[from..=to].reverse();
        self.ways[from + 1..=to].reverse();
        for way in self.ways[from + 1..=to].iter_mut().flatten() {
            *way = way.map(|change| -change);
        }
        self.forget_way(from);
        self.forget_way(to + 1);
    }

    /// `length` positions taken out at `from` and put back before what then is position `to`.
    pub(super) fn displace(&mut self, from: usize, length: usize, to: usize) {
        let angles: Vec<_> = self.angles.drain(from..from + length).collect();
        let dwells: Vec<_> = self.dwell_s.drain(from..from + length).collect();
        let pins: Vec<_> = self.pins.drain(from..from + length).collect();
        let mut ways: Vec<_> = self.ways.drain(from..from + length).collect();
        ways[0] = None;
        self.forget_way(from);
        self.forget_way(to);
        self.angles.splice(to..to, angles);
        self.dwell_s.splice(to..to, dwells);
        self.pins.splice(to..to, pins);
        self.ways.splice(to..to, ways);
    }

    /// Other triples of the same attitudes; between two that stay the way does too.
    pub(super) fn set_positions(&mut self, positions: Vec<Position>) {
        let mut moved_before = false;
        for (k, position) in positions.into_iter().enumerate() {
            let moved = Position::from_array(self.angles[k]).nano() != position.nano();
            if moved || moved_before {
                self.ways[k] = None;
            }
            self.angles[k] = position.to_array();
            moved_before = moved;
        }
    }

    fn forget_way(&mut self, k: usize) {
        if let Some(way) = self.ways.get_mut(k) {
            *way = None;
        }
    }

    /// The plans in which one gimbal turns the other way round on one move, where that counts: those
    /// of the moves near a half turn, or of all where moves take no time.
    pub(super) fn other_ways(&self, test: &Test) -> Vec<Self> {
        let platform = test.platform();
        if !ways_count(platform) {
            return Vec::new();
        }
        let least = match platform.motion().slew {
            Some(_) => NEAR_HALF_TURN,
            None => ANY_TURN,
        };
        let ranges = platform.gimbals().ranges;
        let mut others = Vec::new();
        for (k, change) in self.changes(test).into_iter().enumerate() {
            let Some(change) = change else { continue };
            for axis in (0..3).filter(|axis| ranges[*axis].is_none()) {
                if change[axis].nano.abs() < least {
                    continue;
                }
                let mut turned = change;
                let turn = NanoDegrees::TURN;
                let back = change[axis].nano > NanoDegrees::default();
                turned[axis].nano = turned[axis].nano + if back { -turn } else { turn };
                let mut other = self.clone();
                other.ways[k] = Some(turned.map(Degrees::rad));
                others.push(other);
            }
        }
        others
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::deg_of_rad;
    use crate::motion::Timeline;
    use crate::platform::PlatformConfig;

    fn test(change: impl FnOnce(&mut PlatformConfig)) -> Test {
        let mut config = PlatformConfig::default();
        config.motion.slew_rate_deg_per_s = Some(0.5.into());
        change(&mut config);
        config.check().unwrap().into()
    }

    fn plan(alphas: &[f64]) -> Plan {
        let at = |deg: &f64| Position::from_deg(*deg, 0.0, 10.0).to_array();
        let dwells = (0..alphas.len()).map(|k| 100.0 + 10.0 * k as f64);
        Plan::new(alphas.iter().map(at).collect(), dwells.collect())
    }

    /// Changes of α on the way to each position but the first, degrees.
    fn turns(test: &Test, plan: &Plan) -> Vec<f64> {
        let changes = plan.changes(test).into_iter().flatten();
        changes.map(|change| change[0].deg()).collect()
    }

    #[test]
    fn the_other_way_round_is_offered_near_a_half_turn_only() {
        let free = test(|_| {});
        let plan = plan(&[30.0, 210.0, 90.0, 100.0]);
        assert_eq!(turns(&free, &plan), [180.0, -120.0, 10.0]);
        let others = plan.other_ways(&free);
        let found: Vec<_> = others.iter().map(|p| turns(&free, p)).collect();
        assert_eq!(found, [[-180.0, -120.0, 10.0], [180.0, 240.0, 10.0]]);
        // Twice the other way round is the first again.
        assert!(
            others[0]
                .other_ways(&free)
                .iter()
                .any(|again| { turns(&free, again) == turns(&free, &plan) })
        );
        let limited = test(|c| c.gimbals.alpha_deg = Some([-400.0, 400.0]));
        assert!(plan.other_ways(&limited).is_empty());
        let at_once = test(|c| c.motion.slew_rate_deg_per_s = None);
        assert!(plan.other_ways(&at_once).is_empty());
    }

    #[test]
    fn ways_survive_unwinding_rounding_and_the_file() {
        let test = test(|c| c.motion.start_deg = Some([-100.0, 0.0, 0.0]));
        let mut plan = plan(&[30.0, 210.0, 90.0, 100.0]);
        plan = plan.other_ways(&test)[1].clone();
        let expected = [130.0, -180.0, -120.0, 10.0];
        assert_eq!(turns(&test, &plan), expected);
        let unwound = plan.unwound(&test);
        assert!((deg_of_rad(unwound[2][0]) + 270.0).abs() < 1e-9);
        let again = Plan::of_unwound(&test, unwound, plan.dwell_s.clone());
        assert_eq!(turns(&test, &again), expected);
        for plan in [plan, again] {
            let schedule = plan.to_schedule(&test).unwrap();
            let said = schedule.positions().iter().map(|p| p.change_deg);
            let half = Some([-180.0, 0.0, 0.0]);
            assert_eq!(said.collect::<Vec<_>>(), [None, half, None, None]);
            let alphas = schedule.positions().iter().map(|p| p.position.to_deg()[0]);
            assert_eq!(alphas.collect::<Vec<_>>(), [30.0, -150.0, 90.0, 100.0]);
            let timeline = Timeline::new(&test, &schedule).unwrap();
            assert_eq!(
                timeline.legs()[2].arrival,
                plan.timeline(&test).legs()[2].arrival
            );
        }
    }

    #[test]
    fn changed_orders_keep_the_ways_that_are_left() {
        let free = test(|_| {});
        let mut long = plan(&[0.0, 10.0, 150.0, 100.0, 60.0]);
        long.ways[2] = Some([f64::to_radians(-220.0), 0.0, 0.0]);
        assert_eq!(turns(&free, &long), [10.0, -220.0, -50.0, -40.0]);
        let changed = |change: &dyn Fn(&mut Plan)| {
            let mut plan = long.clone();
            change(&mut plan);
            turns(&free, &plan)
        };
        assert_eq!(changed(&|p| p.reverse(1, 3)), [100.0, 50.0, 220.0, 50.0]);
        assert_eq!(changed(&|p| p.reverse(2, 3)), [10.0, 90.0, 50.0, -90.0]);
        assert_eq!(
            changed(&|p| p.displace(1, 2, 0)),
            [-220.0, -150.0, 100.0, -40.0]
        );
        assert_eq!(
            changed(&|p| p.displace(0, 1, 3)),
            [-220.0, -50.0, -100.0, 60.0]
        );
        assert_eq!(changed(&|p| p.remove(1)), [150.0, -50.0, -40.0]);
        assert_eq!(changed(&|p| p.remove(3)), [10.0, -220.0, -90.0]);
        assert_eq!(
            changed(&|p| p.replace(3, [0.0; 3])),
            [10.0, -220.0, -150.0, 60.0]
        );
        let inserted = changed(&|p| p.insert(2, [0.0; 3], 1.0));
        assert_eq!(inserted, [10.0, -10.0, 150.0, -50.0, -40.0]);
    }
}
