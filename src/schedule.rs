//! Schedules: positions, how long each is held, and how it is reached.
//!
//! A [`Schedule`] is valid by construction (finite angles, non-negative times, at least one
//! position); whether it fits a given platform (ranges, slew rate) is for
//! [`Timeline::new`](crate::motion::Timeline::new) to say, which resolves it into moves, settles
//! and dwells.

pub mod file;
pub mod standard;
pub(crate) mod text;

use crate::attitude::Position;
use crate::error::{Error, Result};

/// Longest dwell or move a schedule may hold, s (about 116 days).
pub const MAX_DURATION_S: f64 = 1e7;

/// Most positions a schedule may hold.
pub const MAX_POSITIONS: usize = 10_000;

/// One position of a schedule: where, how long, and how it is reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScheduledPosition {
    /// The position.
    pub position: Position,
    /// How long it is held with the filter measuring, s.
    pub dwell_s: f64,
    /// Duration of the move to it, s; none: as the slew rate has it.
    pub move_s: Option<f64>,
    /// Whether the filter measures during that move; none: as the platform has it.
    pub move_measured: Option<bool>,
}

impl ScheduledPosition {
    /// A position held for `dwell_s`, reached as the platform moves by default.
    pub const fn new(position: Position, dwell_s: f64) -> Self {
        Self {
            position,
            dwell_s,
            move_s: None,
            move_measured: None,
        }
    }
}

/// A torquing scheme: positions in order, at least one.
///
/// ```
/// use scheme_opt::attitude::Position;
/// use scheme_opt::schedule::{Schedule, ScheduledPosition};
/// let schedule = Schedule::new(vec![
///     ScheduledPosition::new(Position::from_deg(0.0, 0.0, 0.0), 1000.0),
///     ScheduledPosition::new(Position::from_deg(180.0, 0.0, 0.0), 1000.0),
/// ])?;
/// assert_eq!(schedule.positions().len(), 2);
/// # Ok::<(), scheme_opt::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Schedule {
    positions: Vec<ScheduledPosition>,
}

impl Schedule {
    /// A schedule of these positions.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] for no position, too many, a non-finite angle, or a time that is
    /// negative, not finite or absurdly long; the key names the position (`positions[3].dwell_s`).
    pub fn new(positions: Vec<ScheduledPosition>) -> Result<Self> {
        if positions.is_empty() || positions.len() > MAX_POSITIONS {
            return Err(Error::input("a schedule needs at least one position")
                .with_key("positions")
                .with_value(format!("{} positions", positions.len()))
                .with_allowed(format!("1 to {MAX_POSITIONS} positions")));
        }
        for (i, p) in positions.iter().enumerate() {
            check_position(i, p)?;
        }
        Ok(Self { positions })
    }

    /// The positions in order.
    pub fn positions(&self) -> &[ScheduledPosition] {
        &self.positions
    }

    /// The sum of the dwells, s (moves and settles not included).
    pub fn dwell_sum_s(&self) -> f64 {
        self.positions.iter().map(|p| p.dwell_s).sum()
    }
}

/// Largest angle a file may hold, degrees.
const MAX_ANGLE_DEG: f64 = 36_000.0;

fn check_position(index: usize, p: &ScheduledPosition) -> Result<()> {
    let key = |name: &str| format!("positions[{index}].{name}");
    let angles = [
        ("alpha_deg", p.position.alpha),
        ("beta_deg", p.position.beta),
        ("gamma_deg", p.position.gamma),
    ];
    for (name, rad) in angles {
        let deg = rad / crate::units::RAD_PER_DEG;
        if deg.is_nan() || deg.abs() > MAX_ANGLE_DEG * (1.0 + 1e-12) {
            return Err(Error::out_of_range(&key(name), deg, "-36000 to 36000"));
        }
    }
    let times = [("dwell_s", Some(p.dwell_s)), ("move_s", p.move_s)];
    for (name, value) in times {
        if let Some(value) = value
            && !(0.0..=MAX_DURATION_S).contains(&value)
        {
            return Err(Error::out_of_range(&key(name), value, "0 to 1e7"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_schedules_are_refused_by_key() {
        assert!(Schedule::new(Vec::new()).unwrap_err().is_input());
        let good = ScheduledPosition::new(Position::default(), 10.0);
        let table = [
            (
                "positions[1].dwell_s",
                ScheduledPosition {
                    dwell_s: -1.0,
                    ..good
                },
            ),
            (
                "positions[1].dwell_s",
                ScheduledPosition {
                    dwell_s: f64::NAN,
                    ..good
                },
            ),
            (
                "positions[1].move_s",
                ScheduledPosition {
                    move_s: Some(f64::INFINITY),
                    ..good
                },
            ),
            (
                "positions[1].beta_deg",
                ScheduledPosition::new(Position::from_rad(0.0, f64::NAN, 0.0), 1.0),
            ),
        ];
        for (key, bad) in table {
            let error = Schedule::new(vec![good, bad]).unwrap_err();
            assert_eq!(error.key(), Some(key));
        }
    }
}
