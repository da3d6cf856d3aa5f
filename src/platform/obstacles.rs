//! What stands in the gimbals' way: boxes of angles that nothing may enter, cables that can be wound up
//! only so far, and stands that can hold some positions only. Decided in the 1e-9° that files carry.

use std::collections::HashSet;

use serde::{Deserialize, Serialize};

use super::Gimbals;
use crate::attitude::{NanoDegrees, Position};
use crate::error::{Error, Result};

/// A closed box of gimbal angles that no position and no move may enter. An axis that is left out
/// is forbidden at all its angles; on unlimited axes angles count modulo 360°.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct ForbiddenConfig {
    /// α from and to, degrees; none: all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha_deg: Option<[f64; 2]>,
    /// β from and to, degrees; none: all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beta_deg: Option<[f64; 2]>,
    /// γ from and to, degrees; none: all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gamma_deg: Option<[f64; 2]>,
}

/// The names of the axes, as keys have them.
const AXES: [&str; 3] = ["alpha_deg", "beta_deg", "gamma_deg"];

impl ForbiddenConfig {
    /// A box from and to those angles of α, β, γ, degrees; none: all angles of the axis.
    pub const fn new(deg: [Option<[f64; 2]>; 3]) -> Self {
        let [alpha_deg, beta_deg, gamma_deg] = deg;
        Self {
            alpha_deg,
            beta_deg,
            gamma_deg,
        }
    }

    const fn axes(&self) -> [Option<[f64; 2]>; 3] {
        [self.alpha_deg, self.beta_deg, self.gamma_deg]
    }

    /// As a person writes it.
    fn shown(&self) -> String {
        let axes = AXES.iter().zip(self.axes());
        let given =
            axes.filter_map(|(name, range)| range.map(|[a, b]| format!("{name} = [{a}, {b}]")));
        format!("{{ {} }}", given.collect::<Vec<_>>().join(", "))
    }
}

/// A box, checked: from and to in whole 1e-9°; none: all angles.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Forbidden {
    axes: [Option<[i64; 2]>; 3],
    shown: ForbiddenConfig,
}

/// What the gimbals of a platform have in their way.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Obstacles {
    boxes: Vec<Forbidden>,
    /// Most |net angle − start| of each axis, 1e-9°.
    max_winding: [Option<NanoDegrees>; 3],
    /// The positions that can be held, in their order; none: all.
    allowed: Option<Vec<Position>>,
    /// The same to look up.
    allowed_keys: HashSet<[i64; 3]>,
    /// Axes on which whole turns make no difference.
    unlimited: [bool; 3],
}

/// Part 0 to 1 of a move in which an axis is within a box.
type Share = (f64, f64);

/// Beside a box a search keeps this far away: rounded to the 0.001° of its schedules an angle is
/// still outside. 1e-9°.
const KEPT_AWAY: i64 = 1_500_000;

impl Obstacles {
    pub(super) fn new(
        forbidden: &[ForbiddenConfig],
        max_winding_deg: Option<[f64; 3]>,
        allowed: Option<&[[f64; 3]]>,
        gimbals: &Gimbals,
    ) -> Result<Self> {
        let unlimited = gimbals.ranges.map(|range| range.is_none());
        let boxes = forbidden.iter().enumerate();
        let boxes = boxes
            .map(|(index, one)| checked(index, one, unlimited))
            .collect::<Result<Vec<_>>>()?;
        let mut max_winding = [None; 3];
        if let Some(deg) = max_winding_deg {
            for (most, deg) in max_winding.iter_mut().zip(deg) {
                if !(0.0..=36_000.0).contains(&deg) {
                    return Err(Error::out_of_range(
                        "gimbals.max_winding_deg",
                        deg,
                        "0 to 36000 on each axis",
                    ));
                }
                *most = Some(NanoDegrees::nearest(deg));
            }
        }
        let mut obstacles = Self {
            boxes,
            max_winding,
            allowed: None,
            allowed_keys: HashSet::new(),
            unlimited,
        };
        if let Some(allowed) = allowed {
            obstacles.take_list(allowed, gimbals)?;
        }
        Ok(obstacles)
    }

    /// Takes the list of positions that can be held.
    fn take_list(&mut self, list: &[[f64; 3]], gimbals: &Gimbals) -> Result<()> {
        let mut kept = Vec::new();
        for (index, deg) in list.iter().enumerate() {
            for axis in 0..3 {
                if let Some(allowed) = gimbals.refusal(axis, deg[axis]) {
                    let key = format!("positions[{index}].{}", AXES[axis]);
                    return Err(Error::out_of_range(&key, deg[axis], &allowed));
                }
            }
            let position = Position::from_deg(deg[0], deg[1], deg[2]);
            if self.allowed_keys.insert(self.key(position.nano()))
                && self.at(position.nano()).is_none()
            {
                kept.push(position);
            }
        }
        if kept.is_empty() {
            return Err(Error::infeasible(
                "no position of the list can be held, all are in forbidden boxes",
            )
            .with_key("gimbals.allowed"));
        }
        self.allowed = Some(kept);
        Ok(())
    }

    /// Whether there is nothing in the way.
    pub fn is_empty(&self) -> bool {
        self.boxes.is_empty() && self.allowed.is_none() && self.max_winding == [None; 3]
    }

    /// Whether moves can be stopped by something.
    pub fn stop_moves(&self) -> bool {
        !self.boxes.is_empty() || self.max_winding != [None; 3]
    }

    /// The positions that can be held, where there is a list of them.
    pub fn allowed(&self) -> Option<&[Position]> {
        self.allowed.as_deref()
    }

    /// Most |net angle − start| of an axis, 1e-9°.
    pub const fn max_winding(&self) -> [Option<NanoDegrees>; 3] {
        self.max_winding
    }

    fn key(&self, angles: [NanoDegrees; 3]) -> [i64; 3] {
        std::array::from_fn(|axis| match self.unlimited[axis] {
            true => angles[axis].wrapped().count(),
            false => angles[axis].count(),
        })
    }

    /// Whether a position can be held: it is on the list, if there is one, and in no box.
    pub fn allow(&self, angles: [NanoDegrees; 3]) -> bool {
        self.is_listed(angles) && self.at(angles).is_none()
    }

    /// Whether a position is on the list, if there is one.
    pub fn is_listed(&self, angles: [NanoDegrees; 3]) -> bool {
        self.allowed.is_none() || self.allowed_keys.contains(&self.key(angles))
    }

    /// The box that holds an attitude of the gimbals.
    pub fn at(&self, angles: [NanoDegrees; 3]) -> Option<usize> {
        self.on_the_way(angles, [NanoDegrees::default(); 3])
    }

    /// The first of the boxes that a straight move enters.
    pub fn on_the_way(&self, from: [NanoDegrees; 3], change: [NanoDegrees; 3]) -> Option<usize> {
        self.boxes.iter().position(|forbidden| {
            let mut within = vec![(0.0, 1.0)];
            for axis in 0..3 {
                let Some(ends) = forbidden.axes[axis] else {
                    continue;
                };
                let shares = shares(ends, from[axis], change[axis], self.unlimited[axis]);
                within = both(&within, &shares);
                if within.is_empty() {
                    return false;
                }
            }
            true
        })
    }

    /// All boxes in words.
    pub fn all_shown(&self) -> impl Iterator<Item = String> + '_ {
        self.boxes.iter().map(|b| b.shown.shown())
    }

    /// A box in words.
    pub fn shown(&self, index: usize) -> String {
        self.boxes[index].shown.shown()
    }

    /// For each axis how far down and up from a position outside all boxes it can go, 1e-9°, so that
    /// any combination of the three axes is outside too: of every box one face is kept in front, the one
    /// that is farthest off.
    pub fn room(&self, angles: [NanoDegrees; 3]) -> [[Option<NanoDegrees>; 2]; 3] {
        let mut room = [[None::<i64>; 2]; 3];
        for forbidden in &self.boxes {
            let gaps = (0..3).filter_map(|axis| {
                let ends = forbidden.axes[axis]?;
                let [down, up] = gap(ends, angles[axis].count(), self.unlimited[axis])?;
                let nearest = down.unwrap_or(i64::MAX).min(up.unwrap_or(i64::MAX));
                Some((nearest, axis, [down, up]))
            });
            let Some((_, axis, gap)) = gaps.max_by_key(|(nearest, axis, _)| (*nearest, 3 - axis))
            else {
                continue;
            };
            for (room, gap) in room[axis].iter_mut().zip(gap) {
                let gap = gap.map(|gap| (gap - KEPT_AWAY).max(0));
                *room = match (*room, gap) {
                    (Some(a), Some(b)) => Some(a.min(b)),
                    (a, b) => a.or(b),
                };
            }
        }
        room.map(|axis| axis.map(|gap| gap.map(NanoDegrees::new)))
    }
}

/// One box of the file.
fn checked(index: usize, one: &ForbiddenConfig, unlimited: [bool; 3]) -> Result<Forbidden> {
    let refused = |value: String, allowed: &str| {
        Err(Error::input("is no box of angles")
            .with_key(format!("gimbals.forbidden[{index}]"))
            .with_value(value)
            .with_allowed(allowed))
    };
    let mut axes = [None; 3];
    for axis in 0..3 {
        let Some([low, high]) = one.axes()[axis] else {
            continue;
        };
        let shown = format!("{} = [{low}, {high}]", AXES[axis]);
        let near = |deg: f64| deg.abs() <= 36_000.0;
        if !(near(low) && near(high) && low <= high) {
            return refused(shown, "[low, high], low at most high, within 36000 degrees");
        }
        let ends = [NanoDegrees::nearest(low), NanoDegrees::nearest(high)].map(NanoDegrees::count);
        // All angles of the axis: as if it were left out.
        let whole = unlimited[axis] && ends[1] - ends[0] >= NanoDegrees::TURN.count();
        axes[axis] = (!whole).then_some(ends);
    }
    if axes == [None; 3] {
        return refused(
            one.shown(),
            "alpha_deg, beta_deg or gamma_deg, not all angles of all axes",
        );
    }
    Ok(Forbidden { axes, shown: *one })
}

/// The parts of a move in which an axis is between `ends`.
fn shares(ends: [i64; 2], from: NanoDegrees, change: NanoDegrees, unlimited: bool) -> Vec<Share> {
    let (from, change, turn) = (from.count(), change.count(), NanoDegrees::TURN.count());
    let (lowest, highest) = (from + change.min(0), from + change.max(0));
    // The copies of the box, a turn apart, that the axis comes to.
    let copies = match unlimited {
        true => {
            let first = -(ends[1] - lowest).div_euclid(turn);
            let last = (highest - ends[0]).div_euclid(turn);
            first..=last
        }
        false => 0..=0,
    };
    let share = |copy: i64| {
        let [low, high] = ends.map(|end| end + copy * turn - from);
        if change == 0 {
            return (low <= 0 && 0 <= high).then_some((0.0, 1.0));
        }
        let [a, b] = [low, high].map(|end| end as f64 / change as f64);
        let (enter, leave) = (a.min(b).max(0.0), a.max(b).min(1.0));
        (enter <= leave).then_some((enter, leave))
    };
    copies.filter_map(share).collect()
}

/// The parts common to both.
fn both(some: &[Share], others: &[Share]) -> Vec<Share> {
    let pairs = some.iter().flat_map(|a| others.iter().map(move |b| (a, b)));
    let common = pairs.map(|(a, b)| (a.0.max(b.0), a.1.min(b.1)));
    common.filter(|(enter, leave)| enter <= leave).collect()
}

/// How far an angle outside `ends` is from the box below it and from the one above it, 1e-9°; none
/// when it is inside.
fn gap(ends: [i64; 2], angle: i64, unlimited: bool) -> Option<[Option<i64>; 2]> {
    let [low, high] = ends;
    if !unlimited {
        return match angle {
            a if a < low => Some([None, Some(low - a)]),
            a if a > high => Some([Some(a - high), None]),
            _ => None,
        };
    }
    let turn = NanoDegrees::TURN.count();
    let above = (angle - low).rem_euclid(turn);
    let outside = above > high - low;
    outside.then(|| [Some(above - (high - low)), Some(turn - above)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nano(deg: [f64; 3]) -> [NanoDegrees; 3] {
        deg.map(NanoDegrees::nearest)
    }

    fn obstacles(boxes: &[[Option<[f64; 2]>; 3]], gimbals: &Gimbals) -> Obstacles {
        let boxes: Vec<_> = boxes.iter().map(|b| ForbiddenConfig::new(*b)).collect();
        Obstacles::new(&boxes, None, None, gimbals).unwrap()
    }

    #[test]
    fn a_box_is_closed_and_comes_again_a_turn_further_on() {
        let free = Gimbals::default();
        let wall = obstacles(&[[None, Some([80.0, 100.0]), None]], &free);
        for (beta, inside) in [
            (80.0, true),
            (79.999_999_999, false),
            (100.0, true),
            (100.000_000_001, false),
            (-270.0, true),
            (450.0, true),
            (-80.0, false),
        ] {
            assert_eq!(
                wall.at(nano([33.0, beta, -7.0])).is_some(),
                inside,
                "{beta}"
            );
        }
        // The short way from 70° to 110° leads through, the other way round does not.
        assert_eq!(
            wall.on_the_way(nano([0.0, 70.0, 0.0]), nano([5.0, 40.0, 5.0])),
            Some(0)
        );
        assert_eq!(
            wall.on_the_way(nano([0.0, 70.0, 0.0]), nano([5.0, -320.0, 5.0])),
            None
        );
        assert_eq!(
            wall.on_the_way(nano([0.0, 70.0, 0.0]), nano([0.0, 1000.0, 0.0])),
            Some(0)
        );
    }

    #[test]
    fn moves_are_stopped_exactly_where_a_walk_in_small_steps_is() {
        let free = Gimbals::default();
        let boxes = [
            [Some([-10.0, 25.0]), None, Some([170.0, 190.0])],
            [
                Some([100.0, 160.0]),
                Some([-30.0, 30.0]),
                Some([-60.0, 20.0]),
            ],
        ];
        let all = obstacles(&boxes, &free);
        let fraction = |i: usize, k: f64| (0.37 + i as f64 * k).fract();
        let (mut stopped, mut passed) = (0, 0);
        for i in 0..4000 {
            let from = [0.618_034, 0.754_878, 0.569_840].map(|k| 720.0 * fraction(i, k) - 360.0);
            let change = [0.445_042, 0.801_938, 0.331_234].map(|k| 500.0 * fraction(i, k) - 250.0);
            let inside = |share: f64| {
                boxes.iter().any(|b| {
                    (0..3).all(|axis| {
                        let angle = from[axis] + share * change[axis];
                        b[axis]
                            .is_none_or(|[low, high]| (angle - low).rem_euclid(360.0) <= high - low)
                    })
                })
            };
            let walked = (0..=3000).any(|step| inside(f64::from(step) / 3000.0));
            let found = all.on_the_way(nano(from), nano(change)).is_some();
            // A corner cut between two steps is all that a walk does not see.
            assert!(found || !walked, "{from:?} {change:?}");
            stopped += usize::from(walked);
            passed += usize::from(!found);
        }
        assert!(
            stopped > 300 && stopped + passed > 3990,
            "{stopped} {passed}"
        );
    }

    #[test]
    fn everything_within_the_room_of_a_position_is_outside() {
        let mut gimbals = Gimbals::default();
        gimbals.ranges[1] = Some(super::super::GimbalRange {
            low_rad: -2.0,
            high_rad: 2.0,
        });
        let boxes = [
            [Some([-10.0, 25.0]), None, Some([170.0, 190.0])],
            [
                Some([100.0, 160.0]),
                Some([-30.0, 30.0]),
                Some([-60.0, 20.0]),
            ],
            [None, Some([80.0, 100.0]), None],
        ];
        let all = obstacles(&boxes, &gimbals);
        let fraction = |i: usize, k: f64| (0.37 + i as f64 * k).fract();
        let mut tried = 0;
        for i in 0..3000 {
            let spread = [720.0, 220.0, 720.0];
            let k = [0.618_034, 0.754_878, 0.569_840];
            let at: [f64; 3] = std::array::from_fn(|a| spread[a] * (fraction(i, k[a]) - 0.5));
            let at = nano(at);
            if all.at(at).is_some() {
                continue;
            }
            let room = all.room(at);
            for corner in 0..27 {
                let place: [NanoDegrees; 3] = std::array::from_fn(|axis| {
                    let far = NanoDegrees::new(400_000_000_000);
                    let [down, up] = room[axis].map(|gap| gap.unwrap_or(far));
                    match corner / 3_usize.pow(axis as u32) % 3 {
                        0 => at[axis] - down,
                        1 => at[axis],
                        _ => at[axis] + up,
                    }
                });
                assert_eq!(all.at(place), None, "{at:?} {room:?} {corner}");
                tried += 1;
            }
        }
        assert!(tried > 50_000);
    }

    #[test]
    fn boxes_that_are_none_are_refused() {
        let free = Gimbals::default();
        for wrong in [
            [None, None, None],
            [Some([10.0, 5.0]), None, None],
            [None, Some([f64::NAN, 5.0]), None],
            [None, None, Some([0.0, 1e9])],
            [Some([-180.0, 180.0]), None, Some([0.0, 360.0])],
        ] {
            let refused = Obstacles::new(&[ForbiddenConfig::new(wrong)], None, None, &free);
            assert_eq!(
                refused.unwrap_err().key(),
                Some("gimbals.forbidden[0]"),
                "{wrong:?}"
            );
        }
        let refused = Obstacles::new(&[], Some([720.0, -1.0, 720.0]), None, &free);
        assert_eq!(refused.unwrap_err().key(), Some("gimbals.max_winding_deg"));
    }
}
