//! The ways from position to position in degrees, and as a schedule says them.

use std::f64::consts::TAU;

use crate::attitude::{Degrees, Position, deg_of_rad};
use crate::motion::{Test, way};
use crate::platform::{Platform, Repositioning};
use crate::schedule::ScheduledPosition;

/// The ways that are the differences of angles which are not wrapped, rad; of more than a whole turn
/// the turns are left out. Where moves are measured, turning round and round shows much, and a search
/// would wind a gimbal up without end: that is what tumbling is for, where it is allowed.
pub(super) fn straight_ways(test: &Test, angles: &[[f64; 3]]) -> Vec<Option<[f64; 3]>> {
    let mut from = test.standing().map(Position::to_array);
    let limited = test
        .platform()
        .gimbals()
        .ranges
        .map(|range| range.is_some());
    let ways = angles.iter().map(|to| {
        let before = from.replace(*to)?;
        Some(std::array::from_fn(|axis| {
            let straight = to[axis] - before[axis];
            match limited[axis] {
                true => straight,
                false => straight - (straight / TAU).trunc() * TAU,
            }
        }))
    });
    ways.collect()
}

/// Whether it counts which way a move goes: where moves take time, and where torquers have errors,
/// which turn ψ by the way itself, in no time too. In frame-hold repositioning it does not. And wherever
/// something stands in the gimbals' way.
pub(super) fn ways_count(platform: &Platform) -> bool {
    let motion = platform.motion();
    let felt = motion.slew.is_some() || platform.errors().feels_rates();
    let is_felt = felt && motion.repositioning == Repositioning::Slew;
    is_felt || platform.obstacles().stop_moves()
}

/// A way as a schedule has it, degrees.
pub(super) fn in_deg(way: [f64; 3]) -> [f64; 3] {
    way.map(deg_of_rad)
}

/// The same test as a person would write it: unlimited axes in (−180°, 180°], and the way only
/// where it counts and is not the one taken anyway. Positions that are `held` keep the angles they are
/// written with.
pub(super) fn tidied(
    test: &Test,
    positions: impl Iterator<Item = ScheduledPosition>,
    held: &dyn Fn(usize) -> bool,
) -> Vec<ScheduledPosition> {
    let platform = test.platform();
    let ranges = platform.gimbals().ranges;
    let any_way = !ways_count(platform);
    let mut from = test.standing();
    let tidied = positions.enumerate().map(|(k, mut p)| {
        let exact = p.position.exact();
        let wrapped: [f64; 3] = std::array::from_fn(|axis| {
            let (given, wrapped) = (p.position.degrees()[axis], exact[axis].wrapped().deg());
            // On an index table whose step does not divide a turn the same direction may be a setting
            // one turn further on only.
            let can_be_set = platform.gimbals().allows(axis, wrapped);
            match ranges[axis].is_none() && can_be_set {
                true => wrapped,
                false => given,
            }
        });
        if !held(k) {
            p.position = Position::from_deg(wrapped[0], wrapped[1], wrapped[2]);
        }
        p.change_deg = from.replace(p.position).and_then(|from| {
            let taken = way(platform, from, p.position, p.change_deg);
            let usual = way(platform, from, p.position, None);
            let unusual = (0..3).any(|axis| taken[axis].nano != usual[axis].nano);
            let does_not_count = any_way && p.move_s.is_none();
            (unusual && !does_not_count).then(|| taken.map(Degrees::deg))
        });
        p
    });
    tidied.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::PlatformConfig;

    #[test]
    fn no_way_is_longer_than_a_turn() {
        let mut config = PlatformConfig::default();
        config.gimbals.beta_deg = Some([-4000.0, 4000.0]);
        let test = Test::from(config.check().unwrap());
        let deg = |angles: [f64; 3]| angles.map(f64::to_radians);
        let angles = [[10.0, 0.0, 0.0], [980.0, 1000.0, -720.5], [700.0, 0.0, 0.0]].map(deg);
        let ways = straight_ways(&test, &angles);
        assert_eq!(ways[0], None);
        for (way, expected) in ways[1..]
            .iter()
            .zip([[250.0, 1000.0, -0.5], [-280.0, -1000.0, 0.5]])
        {
            let way = way.unwrap().map(f64::to_degrees);
            for (found, expected) in way.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-9, "{way:?}");
            }
        }
    }
}
