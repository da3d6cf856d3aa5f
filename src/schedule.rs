//! Schedules: positions, how long each is held, and how it is reached.
//!
//! A [`Schedule`] is valid by construction (finite angles, non-negative times, at least one
//! position); whether it fits a given platform (ranges, slew rate) is for
//! [`Timeline::new`](crate::motion::Timeline::new) to say, which resolves it into moves, settles
//! and dwells.

pub mod file;
pub(crate) mod periods;
pub mod standard;
pub(crate) mod text;

use std::collections::BTreeMap;

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
    /// The way taken from the position before (the first: from the start attitude), changes of
    /// (α, β, γ) in degrees, congruent to the target; none: the short way on unlimited axes, a
    /// half turn positive. Limited axes go straight.
    pub change_deg: Option<[f64; 3]>,
    /// Whether a search that begins with the schedule keeps the position: its angles, and its place
    /// among the other pinned ones; the first and the last of a schedule stay first and last. The
    /// dwell is free. Nothing else is made of it.
    pub pinned: bool,
}

impl ScheduledPosition {
    /// A position held for `dwell_s`, reached as the platform moves by default.
    pub const fn new(position: Position, dwell_s: f64) -> Self {
        Self {
            position,
            dwell_s,
            move_s: None,
            move_measured: None,
            change_deg: None,
            pinned: false,
        }
    }
}

/// A torquing scheme: positions in order, at least one.
///
/// ```
/// use scheme_opt::internals::attitude::Position;
/// use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
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
    /// What else was said of each position; empty where nothing was.
    notes: Vec<Notes>,
}

/// What a file says of a position beside what the program understands: heading and text.
pub type Notes = BTreeMap<String, String>;

impl Schedule {
    /// A schedule of these positions.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] for no position, too many, an angle or a change of one that is not
    /// finite or beyond a hundred turns, or a time that is negative, not finite or absurdly long;
    /// the key names the position (`positions[3].dwell_s`).
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
        let notes = Vec::new();
        Ok(Self { positions, notes })
    }

    /// The same with notes, one for each position in order.
    pub(crate) fn with_notes(mut self, notes: Vec<Notes>) -> Self {
        self.notes = notes;
        // Without any, it is equal to a schedule that never had some.
        if self.notes.iter().all(Notes::is_empty) {
            self.notes.clear();
        }
        self
    }

    /// What else was said of a position in the file that the schedule is from.
    pub fn notes(&self, index: usize) -> &Notes {
        static NONE: Notes = Notes::new();
        self.notes.get(index).unwrap_or(&NONE)
    }

    /// The schedule of a file: CSV or JSON, told apart by their content.
    ///
    /// # Errors
    ///
    /// [`Error::is_io`] when the file cannot be read; [`Error::is_input`] with file, line or key,
    /// value and what is allowed.
    pub fn from_file(path: impl AsRef<std::path::Path>) -> Result<Self> {
        file::read(path.as_ref())
    }

    /// The schedule of CSV text.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] with line, column and what is allowed.
    pub fn from_csv(text: &str) -> Result<Self> {
        file::from_csv(text)
    }

    /// The schedule of JSON text.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] with line, key and what is allowed.
    pub fn from_json(text: &str) -> Result<Self> {
        file::from_json(text)
    }

    /// The schedule as CSV text.
    pub fn to_csv(&self) -> String {
        file::to_csv(self)
    }

    /// The schedule as JSON text.
    pub fn to_json(&self) -> String {
        file::to_json(self)
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
    let allowed = -MAX_ANGLE_DEG..=MAX_ANGLE_DEG;
    let names = ["alpha_deg", "beta_deg", "gamma_deg"];
    for (name, deg) in names.into_iter().zip(p.position.degrees()) {
        if !allowed.contains(&deg) {
            return Err(Error::out_of_range(&key(name), deg, "-36000 to 36000"));
        }
    }
    for change in p.change_deg.into_iter().flatten() {
        if !allowed.contains(&change) {
            let key = key("change_deg");
            return Err(Error::out_of_range(&key, change, "-36000 to 36000"));
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
                "positions[1].change_deg",
                ScheduledPosition {
                    change_deg: Some([0.0, f64::NEG_INFINITY, 0.0]),
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
