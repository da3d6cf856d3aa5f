//! Whether a test keeps clear of what stands in the gimbals' way, and the ways that do.

use super::way::way_between;
use super::{Leg, Place, Test, Timeline};
use crate::attitude::{Degrees, NanoDegrees, Position, deg_of_rad};
use crate::error::{Error, Result};
use crate::platform::{Platform, Repositioning, SlewLimits};
use crate::units::RAD_PER_DEG;

/// What is in the way of a test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Obstruction {
    /// The leg that cannot be.
    leg: usize,
    kind: Hindrance,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Hindrance {
    /// Its position lies in that box.
    Held(usize),
    /// The move to it enters that box.
    Passed(usize),
    /// Its position is not on the list of those that the stand can hold.
    NotListed,
    /// The move to it winds up an axis too far.
    Wound { axis: usize, net: NanoDegrees },
}

/// The names of the axes.
const AXES: [&str; 3] = ["alpha", "beta", "gamma"];

impl Timeline {
    /// Whether nothing is in the way from the first position that is planned on.
    pub(crate) fn is_clear(&self, platform: &Platform) -> bool {
        platform.obstacles().is_empty() || self.obstruction(platform).is_none()
    }

    /// The first thing in the way; what was done before cannot be helped.
    fn obstruction(&self, platform: &Platform) -> Option<Obstruction> {
        let obstacles = platform.obstacles();
        let mut net = [NanoDegrees::default(); 3];
        let mut before = None;
        for (index, leg) in self.legs().iter().enumerate() {
            let found = |kind| Some(Obstruction { leg: index, kind });
            let here = leg.position.nano();
            let change = leg.arrival.map(|m| nano_of(m.change));
            if let Some(change) = change {
                net = std::array::from_fn(|axis| net[axis] + change[axis]);
            }
            if index >= self.positions().start {
                if let Some(held) = obstacles.at(here) {
                    return found(Hindrance::Held(held));
                }
                if !obstacles.is_listed(here) {
                    return found(Hindrance::NotListed);
                }
                if let (Some(before), Some(change)) = (before, change)
                    && let Some(passed) = obstacles.on_the_way(before, change)
                {
                    return found(Hindrance::Passed(passed));
                }
                if let Some(axis) = too_far(platform, net) {
                    let net = net[axis];
                    return found(Hindrance::Wound { axis, net });
                }
            }
            before = Some(here);
        }
        None
    }

    /// Refuses a test that something is in the way of.
    pub(super) fn check_clear(&self, platform: &Platform) -> Result<()> {
        let obstacles = platform.obstacles();
        if obstacles.is_empty() {
            return Ok(());
        }
        let Some(found) = self.obstruction(platform) else {
            return Ok(());
        };
        let leg = &self.legs()[found.leg];
        let index = found.leg - self.positions().start;
        let [alpha, beta, gamma] = leg.position.to_deg();
        let place = format!("[{alpha}, {beta}, {gamma}]");
        let (what, allowed) = match found.kind {
            Hindrance::Held(b) => (
                "the position lies in a forbidden box",
                format!("outside gimbals.forbidden[{b}], {}", obstacles.shown(b)),
            ),
            Hindrance::NotListed => (
                "the stand cannot hold the position",
                "a position of gimbals.allowed".to_owned(),
            ),
            Hindrance::Passed(b) => (
                "the move to the position enters a forbidden box",
                format!(
                    "a way that does not enter gimbals.forbidden[{b}], {}",
                    obstacles.shown(b)
                ),
            ),
            Hindrance::Wound { axis, .. } => (
                "the move to the position winds a gimbal up too far",
                format!(
                    "{} within {} degrees of its start (gimbals.max_winding_deg)",
                    AXES[axis],
                    obstacles.max_winding()[axis].map_or(0.0, NanoDegrees::deg)
                ),
            ),
        };
        let is_return = found.leg >= self.positions().end;
        let key = match is_return {
            true => "motion.return_to_start".to_owned(),
            false => format!("positions[{index}]"),
        };
        let value = match found.kind {
            Hindrance::Wound { axis, net } => format!("{} {}", AXES[axis], net.deg()),
            _ => place,
        };
        let error = Error::input(what)
            .with_key(key)
            .with_value(value)
            .with_allowed(allowed);
        Err(match found.kind {
            Hindrance::Passed(_) | Hindrance::Wound { .. } if !is_return => error.with_hint(
                "change_deg (in a CSV file the columns alpha_change_deg, beta_change_deg and \
                 gamma_change_deg) says which way a move goes; a position in between can lead around",
            ),
            _ => error,
        })
    }

    /// Net angles since the start of the test when what is planned begins, whole 1e-9°.
    pub(crate) fn wound_before(test: &Test) -> [NanoDegrees; 3] {
        let begun = Self::unchecked(test, std::iter::empty());
        wound(&begun.legs[..begun.positions.start])
    }
}

/// Net angles at the end of such legs, whole 1e-9°.
pub(super) fn wound(legs: &[Leg]) -> [NanoDegrees; 3] {
    let mut net = [NanoDegrees::default(); 3];
    for m in legs.iter().filter_map(|leg| leg.arrival) {
        let change = nano_of(m.change);
        net = std::array::from_fn(|axis| net[axis] + change[axis]);
    }
    net
}

/// A change in rad in whole 1e-9°.
fn nano_of(change: [f64; 3]) -> [NanoDegrees; 3] {
    change.map(|rad| NanoDegrees::nearest(deg_of_rad(rad)))
}

/// The axis that is wound up too far.
fn too_far(platform: &Platform, net: [NanoDegrees; 3]) -> Option<usize> {
    let most = platform.obstacles().max_winding();
    // Each change of the sum is rounded to 1e-9°.
    let slack = NanoDegrees::new(1_000);
    (0..3).find(|axis| most[*axis].is_some_and(|most| net[*axis].abs() > most + slack))
}

/// The quickest way from one place to another that nothing is in: the one `given`, or the usual one,
/// if that is clear; otherwise with one or more of the unlimited gimbals turning the other way round.
/// `net` is what each axis has turned so far; none: that is not asked.
pub(crate) fn clear_way(
    platform: &Platform,
    from: &Place,
    to: &Place,
    given: Option<[f64; 3]>,
    net: Option<[NanoDegrees; 3]>,
) -> Option<[Degrees; 3]> {
    let obstacles = platform.obstacles();
    let usual = way_between(platform, from.angles, to.angles, given);
    let is_clear = |way: &[Degrees; 3]| {
        let change = way.map(|axis| axis.nano);
        let wound = net.is_some_and(|net| {
            too_far(platform, std::array::from_fn(|i| net[i] + change[i])).is_some()
        });
        !wound && obstacles.on_the_way(from.nano(), change).is_none()
    };
    if is_clear(&usual) {
        return Some(usual);
    }
    let turn = NanoDegrees::TURN;
    let short = way_between(platform, from.angles, to.angles, None);
    let ways = std::array::from_fn::<Vec<Degrees>, 3, _>(|axis| {
        let short = short[axis];
        let mut ways = vec![short];
        if platform.gimbals().ranges[axis].is_none() {
            let turned = [short.nano - turn, short.nano + turn];
            let others = turned.into_iter().filter(|nano| nano.abs() <= turn);
            ways.extend(others.map(|nano| Degrees { nano, ..short }));
        }
        ways
    });
    let mut best: Option<(i64, [Degrees; 3])> = None;
    for &alpha in &ways[0] {
        for &beta in &ways[1] {
            for &gamma in &ways[2] {
                let way = [alpha, beta, gamma];
                let length = length(platform, &way);
                if best.is_none_or(|(least, _)| length < least) && is_clear(&way) {
                    best = Some((length, way));
                }
            }
        }
    }
    best.map(|(_, way)| way)
}

/// The ways that lead through these positions with nothing in them, each the quickest after those before
/// it, the one that is given first of all; none where one cannot be reached. Of each that it is the usual
/// way is said by none.
pub(crate) fn clear_ways(
    test: &Test,
    positions: impl Iterator<Item = (Position, Option<[f64; 3]>)>,
) -> Option<Vec<Option<[Degrees; 3]>>> {
    let mut net = Timeline::wound_before(test);
    let mut from = test.standing().map(Place::new);
    let ways = positions.map(|(position, given)| {
        let to = Place::new(position);
        let Some(from) = from.replace(to) else {
            return Some(None);
        };
        let way = clear_way(test.platform(), &from, &to, given, Some(net))?;
        net = std::array::from_fn(|axis| net[axis] + way[axis].nano);
        let usual = way_between(test.platform(), from.angles, to.angles, None);
        Some((way != usual).then_some(way))
    });
    ways.collect()
}

/// How long a way is, in whole numbers so that equal ways are equally long: the angle that the axis
/// that turns most does, 1e-9°, or in time, µs, where that does not tell.
pub(super) fn length(platform: &Platform, way: &[Degrees; 3]) -> i64 {
    match by_time(platform) {
        Some(slew) => (slew.shortest_s(&way.map(Degrees::rad)) * PER_S).round() as i64,
        None => way.iter().fold(0, |max, c| max.max(c.nano.abs().count())),
    }
}

/// Units of [`length`] in a second.
const PER_S: f64 = 1e6;

/// The limits where the time of a way is not in proportion to the angle of the axis that turns most.
fn by_time(platform: &Platform) -> Option<&SlewLimits> {
    let slew = platform.motion().slew.as_ref()?;
    let tells = slew.are_alike() && slew.acceleration_rad_per_s2.is_none();
    (!tells).then_some(slew)
}

/// How long a way of that [`length`] is in rad or s, a unit of [`unit_s`].
pub(super) fn in_units(platform: &Platform, length: i64) -> f64 {
    match by_time(platform) {
        Some(_) => length as f64 / PER_S,
        None => NanoDegrees::new(length).deg() * RAD_PER_DEG,
    }
}

/// The time of a unit, s: 1, or that of a rad; 0 where moves take no time.
pub(crate) fn unit_s(platform: &Platform) -> f64 {
    let motion = platform.motion();
    match (motion.repositioning, motion.slew) {
        (Repositioning::FrameHold, _) | (_, None) => 0.0,
        (Repositioning::Slew, Some(slew)) => match by_time(platform) {
            Some(_) => 1.0,
            None => slew.rate_rad_per_s[0].recip(),
        },
    }
}
