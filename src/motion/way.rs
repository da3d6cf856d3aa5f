//! The way of the gimbals from one position to the next.

use crate::attitude::{Degrees, NanoDegrees, Position};
use crate::error::{Error, Result};
use crate::platform::Platform;
use crate::schedule::ScheduledPosition;

/// The way the gimbals take from one position to another unless told otherwise, rad: the short way
/// round on unlimited axes (a half turn goes positive), straight on limited ones.
pub fn gimbal_change(platform: &Platform, from: Position, to: Position) -> [f64; 3] {
    way(platform, from, to, None).map(Degrees::rad)
}

/// The way the gimbals take from one position to another. On unlimited axes that of all ways
/// between the two which is nearest to the one `given` (degrees), or else the short one, a half
/// turn positive; on limited axes straight.
pub(crate) fn way(
    platform: &Platform,
    from: Position,
    to: Position,
    given: Option<[f64; 3]>,
) -> [Degrees; 3] {
    way_between(platform, from.exact(), to.exact(), given)
}

/// The same between angles.
#[inline]
pub(super) fn way_between(
    platform: &Platform,
    from: [Degrees; 3],
    to: [Degrees; 3],
    given: Option<[f64; 3]>,
) -> [Degrees; 3] {
    let mut change = to;
    for i in 0..3 {
        let straight = to[i] - from[i];
        change[i] = match (platform.gimbals.ranges[i], given) {
            (Some(_), _) => straight,
            (None, None) => straight.wrapped(),
            (None, Some(given)) => {
                let given = NanoDegrees::nearest(given[i]);
                let off = (straight.nano - given).wrapped();
                Degrees {
                    nano: given + off,
                    ..straight
                }
            }
        };
    }
    change
}

/// Checks a way that is given against the positions it joins, and the ranges.
pub(super) fn check_way(
    platform: &Platform,
    index: usize,
    from: Option<Position>,
    p: &ScheduledPosition,
) -> Result<()> {
    let Some(given) = p.change_deg else {
        return Ok(());
    };
    let refused = |what: &str, allowed: String| {
        Err(Error::input(what)
            .with_key(format!("positions[{index}].change_deg"))
            .with_value(format!("{given:?}"))
            .with_allowed(allowed))
    };
    let Some(from) = from else {
        let allowed = "no change_deg, or motion.start_deg to come from".to_owned();
        return refused("nothing leads to the first position", allowed);
    };
    let taken = way(platform, from, p.position, Some(given));
    for (axis, name) in ["alpha", "beta", "gamma"].into_iter().enumerate() {
        // The positions and the way between them are each rounded to 1e-9°.
        let off = taken[axis].nano - NanoDegrees::nearest(given[axis]);
        if off.abs() > NanoDegrees::new(1) {
            let straight = taken[axis].nano.deg();
            return match platform.gimbals.ranges[axis] {
                Some(_) => refused(
                    &format!("the {name} axis is limited and goes straight"),
                    format!("{straight} for {name}"),
                ),
                None => refused(
                    &format!("this way does not lead the {name} axis to the position"),
                    format!("{straight} for {name}, or whole turns more or less"),
                ),
            };
        }
    }
    Ok(())
}
