//! The plan that stays where it is: where little fits, it does.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::index_table::IndexTable;
use super::plan::Plan;
use super::propose::random_position;
use crate::attitude::Position;
use crate::error::{Error, Result};
use crate::motion::{Test, equivalent_positions};
use crate::platform::{GimbalRange, Platform};
use crate::schedule::Schedule;

/// The plan that does nothing but hold one position: where the platform stands, or any that it can
/// take. None only on an index table without a setting, or where nothing is free.
pub(super) fn still(test: &Test) -> Option<Plan> {
    let position = match test.standing() {
        Some(position) => position,
        None => anywhere(test.platform())?,
    };
    Some(Plan::new(
        vec![position.to_array()],
        vec![test.platform().shortest_dwell_s()],
    ))
}

/// The same as a schedule of the least time.
pub(super) fn stillest(test: &Test) -> Result<Schedule> {
    let still = still(test).ok_or_else(|| no_setting(test.platform()))?;
    still.to_schedule(test)
}

/// No position can be set.
pub(super) fn no_setting(platform: &Platform) -> Error {
    match IndexTable::new(platform) {
        Some(table) if table.is_empty() => {
            Error::infeasible("no multiple of the index step lies within a gimbal's range")
                .with_key("gimbals.step_deg")
        }
        _ => Error::infeasible("no position was found outside the forbidden boxes")
            .with_key("gimbals.forbidden"),
    }
}

/// A position that the platform can take: zero, or what is nearest to it.
fn anywhere(platform: &Platform) -> Option<Position> {
    let ranges = platform.gimbals().ranges;
    let nearest = |range: Option<GimbalRange>| match range {
        Some(r) => 0.0_f64.clamp(r.low_rad, r.high_rad),
        None => 0.0,
    };
    let angles = ranges.map(nearest);
    let angles = match IndexTable::new(platform) {
        Some(table) if table.is_empty() => return None,
        Some(table) => table.snap(platform, angles),
        None => angles,
    };
    let position = Position::from_array(angles);
    let all = equivalent_positions(platform, position);
    if platform.obstacles().is_empty() {
        return Some(all.into_iter().next().unwrap_or(position));
    }
    let elsewhere = || match IndexTable::new(platform) {
        Some(table) => free(platform, table.sample(usize::MAX).into_iter()),
        None => {
            let mut random = ChaCha8Rng::seed_from_u64(0);
            free(
                platform,
                (0..ATTEMPTS).map(|_| random_position(platform, &mut random)),
            )
        }
    };
    all.into_iter().next().or_else(elsewhere)
}

/// How many positions are tried before it is said that none is free.
const ATTEMPTS: usize = 100_000;

/// The first of these that nothing is in the way of.
fn free(platform: &Platform, mut positions: impl Iterator<Item = Position>) -> Option<Position> {
    positions.find(|p| platform.obstacles().allow(p.nano()))
}
