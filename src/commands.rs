//! The command table: what the stand is told to do, second by second.
//!
//! A [`Timeline`] says where the platform is; a stand is driven by rates. Between two moments the
//! platform holds a constant rate ω_c in its own axes, relative to inertial space:
//!
//! ```text
//! dwell, settle:  ω_c = C_n^c ω_ie^n                     (it tracks the local level frame)
//! move:           ω_c = C_n^c ω_ie^n + C_n^c ω_nc^n      (the same plus the slew)
//! ```
//!
//! with ω_nc^n = −(φ_α α̇ + φ_β β̇ + φ_γ γ̇), from `dC = −[φ×] C` (on the paper's stand
//! e_x, Mx(α) e_y and C_c^n e_z; [`attitude`](crate::attitude)) and `Ċ_c^n = [ω_nc^n ×] C_c^n`. The gimbal rates are constant
//! during a move, ω_c is not; a move is therefore cut into steps of a few degrees, and each step
//! has *the* constant rate that takes the attitude at its start to the attitude at its end,
//!
//! ```text
//! ω_c = Log( C_n^c(t_k) exp([ω_ie^n ×] Δt) C_c^n(t_{k+1}) ) / Δt
//! ```
//!
//! so that a stand which integrates the commands, `Ċ_c^i = C_c^i [ω_c ×]`, is exactly at the
//! schedule's attitude after every step, whatever the size of the steps. Between the ends of a
//! step of θ it is off the straight line of the gimbal angles by θ²/8 at most.
//!
//! Moves that take no time (no slew rate, or frame-hold repositioning) have no rate: the row says
//! from where to where, and its duration is zero.
//!
//! Gimbal angles count on through the whole test: each row begins where the one before ended, so that a
//! gimbal which goes on turning one way passes 180° and whole turns ([`Timeline::net_positions`]). They
//! are the angles of the schedule up to whole turns.

use std::fmt::Write;

use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::Serialize;

use crate::attitude::{Attitude, Position, Stand};
use crate::config::TestConfig;
use crate::error::{Error, Result};
use crate::motion::{Leg, Move, Timeline};
use crate::platform::Platform;
use crate::suspicion::WarningRecord;
use crate::units::{Angle, AngularRate, RAD_PER_DEG};
use crate::wording::decimals;

/// What the platform does for the time of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Segment {
    /// It turns to a position, or a step of that.
    Move,
    /// It stands at a position, settling; nothing is measured.
    Settle,
    /// It stands at a position and the filter measures.
    Dwell,
    /// It turns back to where the test began.
    Return,
}

impl Segment {
    /// The name used in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Move => "move",
            Self::Settle => "settle",
            Self::Dwell => "dwell",
            Self::Return => "return",
        }
    }
}

/// One row of the table: constant rates for a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// When it begins, s since the start of the test.
    pub start_s: f64,
    /// How long it holds, s; zero for a move that takes no time.
    pub duration_s: f64,
    /// What it does.
    pub segment: Segment,
    /// Number of the position it leads to or holds, from 1; none on the way to the start attitude
    /// and back.
    pub position: Option<usize>,
    /// (α, β, γ) when it begins, rad: where the command before ended, whole turns counted.
    pub from_rad: [f64; 3],
    /// (α, β, γ) when it ends, rad: the way actually taken, not wrapped.
    pub to_rad: [f64; 3],
    /// Rates of (α, β, γ), rad/s; none for a move that takes no time.
    pub gimbal_rates_rad_per_s: Option<[f64; 3]>,
    /// ω_c: the platform's rate relative to inertial space in platform axes, rad/s; none for a
    /// move that takes no time.
    pub platform_rate_rad_per_s: Option<[f64; 3]>,
    /// Whether the filter measures meanwhile.
    pub measured: bool,
}

impl Command {
    /// When it ends, s since the start of the test.
    pub fn end_s(&self) -> f64 {
        self.start_s + self.duration_s
    }
}

/// The commands of a whole test.
///
/// ```
/// use scheme_opt::internals::attitude::Position;
/// use scheme_opt::internals::commands::CommandTable;
/// use scheme_opt::internals::motion::{Test, Timeline};
/// use scheme_opt::internals::platform::PlatformConfig;
/// use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
///
/// let mut config = PlatformConfig::default();
/// config.motion.slew_rate_deg_per_s = Some(0.5.into());
/// let test = Test::from(config.check()?);
/// let platform = test.platform();
/// let schedule = Schedule::new(vec![
///     ScheduledPosition::new(Position::from_deg(0.0, 0.0, 0.0), 600.0),
///     ScheduledPosition::new(Position::from_deg(60.0, 0.0, 0.0), 600.0),
/// ])?;
/// let timeline = Timeline::new(&test, &schedule)?;
/// let table = CommandTable::new(platform, &timeline, CommandTable::DEFAULT_STEP_DEG)?;
/// // A dwell, twelve steps of 5 degrees, a dwell.
/// assert_eq!(table.commands().len(), 14);
/// // Level and facing north, the platform follows the Earth about its own x and y axes.
/// let rate = table.commands()[0].platform_rate_rad_per_s.unwrap();
/// let earth = platform.earth_rate_n();
/// assert!((0..3).all(|i| (rate[i] - earth[i]).abs() < 1e-20));
/// # Ok::<(), scheme_opt::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct CommandTable {
    commands: Vec<Command>,
    winding_deg: [f64; 3],
}

/// Header of the CSV form.
const HEADER: &str = "clock,start_s,duration_s,segment,position,\
    alpha_from_deg,beta_from_deg,gamma_from_deg,alpha_to_deg,beta_to_deg,gamma_to_deg,\
    alpha_rate_deg_per_s,beta_rate_deg_per_s,gamma_rate_deg_per_s,\
    omega_x_deg_per_h,omega_y_deg_per_h,omega_z_deg_per_h,measured";

/// Decimals of durations, angles and rates: replaying the text of a test of hours is then off by
/// less than 1e-9 rad.
const DECIMALS: usize = 12;

/// Most rows of a table.
const MAX_COMMANDS: f64 = 1e6;

impl CommandTable {
    /// Largest turn of the platform in one step of a move unless told otherwise, degrees.
    pub const DEFAULT_STEP_DEG: f64 = 5.0;

    /// The commands of `timeline` on `platform`, moves cut into steps in which no gimbal turns by
    /// more than `step_deg`.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] for a step that is not within 0.01° to 45° (beyond that, the rotation
    /// of a step could not be told from its opposite), or one that would give a million rows.
    pub fn new(platform: &Platform, timeline: &Timeline, step_deg: f64) -> Result<Self> {
        if !(0.01..=45.0).contains(&step_deg) {
            return Err(Error::out_of_range("step_deg", step_deg, "0.01 to 45"));
        }
        let step = Angle::from_deg(step_deg).rad();
        let turns: f64 = timeline
            .legs()
            .iter()
            .filter_map(|leg| leg.arrival)
            .map(|m| m.largest_turn_rad())
            .sum();
        if turns / step > MAX_COMMANDS {
            return Err(Error::input("the steps of the moves are too many")
                .with_key("step_deg")
                .with_value(step_deg));
        }
        let mut builder = TableBuilder {
            earth_rate_n: platform.earth_rate_n(),
            stand: *platform.stand(),
            step,
            time_s: 0.0,
            commands: Vec::new(),
        };
        let held = timeline.positions();
        let net = timeline.net_positions();
        for (index, leg) in timeline.legs().iter().enumerate() {
            let position = held.contains(&index).then(|| index - held.start + 1);
            let from = net[index.saturating_sub(1)].to_array();
            let to = net[index].to_array();
            builder.leg(leg, (from, to), position, index >= held.end);
        }
        Ok(Self {
            commands: builder.commands,
            winding_deg: timeline.winding_deg(),
        })
    }

    /// How far α, β and γ are from where the test began, at most, degrees: what cables have to bear.
    pub fn winding_deg(&self) -> [f64; 3] {
        self.winding_deg
    }

    /// The rows in order.
    pub fn commands(&self) -> &[Command] {
        &self.commands
    }

    /// The commands from a time on, s since the start of the test.
    pub(crate) fn since(mut self, start_s: f64) -> Self {
        // Sums of the same times differ in their last digits.
        let slack_s = 1e-9 * start_s.max(1.0);
        self.commands.retain(|c| c.start_s >= start_s - slack_s);
        self
    }

    /// The table as CSV with a header line, in numbers with twelve decimals at most: a rate is held
    /// for a thousand seconds, and hundreds of rows follow each other.
    pub fn to_csv(&self) -> String {
        let mut text = format!("{HEADER}\n");
        for c in &self.commands {
            let position = c.position.map_or_else(String::new, |p| p.to_string());
            // Writing to a string cannot fail.
            let _ = write!(
                text,
                "{},{},{},{},{position}",
                clock(c.start_s),
                decimals(c.start_s, 9),
                decimals(c.duration_s, DECIMALS),
                c.segment.name(),
            );
            for angle in c.from_rad.iter().chain(&c.to_rad) {
                let _ = write!(
                    text,
                    ",{}",
                    decimals(Angle::from_rad(*angle).deg(), DECIMALS)
                );
            }
            for axis in 0..3 {
                let rate = c
                    .gimbal_rates_rad_per_s
                    .map(|r| Angle::from_rad(r[axis]).deg());
                let _ = write!(text, ",{}", optional(rate, DECIMALS));
            }
            for axis in 0..3 {
                let rate = c.platform_rate_rad_per_s.map(|r| r[axis]);
                let rate = rate.map(|r| AngularRate::from_rad_per_s(r).deg_per_h());
                let _ = write!(text, ",{}", optional(rate, DECIMALS));
            }
            let _ = writeln!(text, ",{}", c.measured);
        }
        text
    }
}

/// Name and major version of the table's JSON form.
pub const COMMANDS_SCHEMA: &str = "scheme-opt/commands/1";

/// The table as a document.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct CommandDocument {
    /// [`COMMANDS_SCHEMA`].
    pub schema: String,
    /// Version of the program that wrote it.
    pub tool_version: String,
    /// Whose test it is; left out where nobody said.
    #[serde(skip_serializing_if = "TestConfig::is_empty")]
    #[cfg_attr(feature = "schema", schemars(default))]
    pub test: TestConfig,
    /// The commands in order.
    pub commands: Vec<CommandRecord>,
    /// Largest |net angle − start| of α, β and γ at any instant, degrees.
    pub winding_deg: [f64; 3],
    /// Values of the inputs that are allowed but hard to believe; left out when there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[cfg_attr(feature = "schema", schemars(default))]
    pub warnings: Vec<WarningRecord>,
}

/// One command; see [`Command`].
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct CommandRecord {
    /// When it begins, s since the start of the test.
    pub start_s: f64,
    /// How long it holds, s.
    pub duration_s: f64,
    /// `move`, `settle`, `dwell` or `return`.
    pub segment: String,
    /// Number of the position it leads to or holds, from 1; null: start or return.
    pub position: Option<usize>,
    /// (α, β, γ) when it begins, degrees: where the command before ended, whole turns counted.
    pub from_deg: [f64; 3],
    /// (α, β, γ) when it ends, degrees, whole turns counted.
    pub to_deg: [f64; 3],
    /// Rates of (α, β, γ), °/s; null: it takes no time.
    pub gimbal_rates_deg_per_s: Option<[f64; 3]>,
    /// ω_c in platform axes, °/h; null: it takes no time.
    pub platform_rate_deg_per_h: Option<[f64; 3]>,
    /// Whether the filter measures meanwhile.
    pub measured: bool,
}

impl From<&Command> for CommandRecord {
    fn from(c: &Command) -> Self {
        let deg = |angles: [f64; 3]| angles.map(|rad| Angle::from_rad(rad).deg() + 0.0);
        Self {
            start_s: c.start_s,
            duration_s: c.duration_s,
            segment: c.segment.name().to_owned(),
            position: c.position,
            from_deg: deg(c.from_rad),
            to_deg: deg(c.to_rad),
            gimbal_rates_deg_per_s: c.gimbal_rates_rad_per_s.map(deg),
            platform_rate_deg_per_h: c
                .platform_rate_rad_per_s
                .map(|omega| omega.map(|v| AngularRate::from_rad_per_s(v).deg_per_h() + 0.0)),
            measured: c.measured,
        }
    }
}

impl CommandTable {
    /// The table as data.
    pub fn document(&self) -> CommandDocument {
        CommandDocument {
            schema: COMMANDS_SCHEMA.to_owned(),
            tool_version: env!("CARGO_PKG_VERSION").to_owned(),
            test: TestConfig::default(),
            commands: self.commands.iter().map(Into::into).collect(),
            winding_deg: self.winding_deg,
            warnings: Vec::new(),
        }
    }

    /// The table as JSON.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when it cannot be written as JSON.
    pub fn to_json(&self) -> Result<String> {
        self.document().to_json()
    }
}

impl CommandDocument {
    /// The document as JSON text.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when it cannot be written as JSON.
    pub fn to_json(&self) -> Result<String> {
        serde_json::to_string_pretty(self)
            .map(|text| text + "\n")
            .map_err(|e| {
                Error::numerical(format!("the table cannot be written as JSON: {e}")).with_source(e)
            })
    }
}

/// How far a row of one rate may be from gimbals that speed up or slow down meanwhile, rad (0.02°); where
/// a row ends it is where they are.
const OFF_A_RAMP_RAD: f64 = 0.02 * RAD_PER_DEG;

struct TableBuilder {
    earth_rate_n: Vector3<f64>,
    stand: Stand,
    step: f64,
    time_s: f64,
    commands: Vec<Command>,
}

impl TableBuilder {
    /// The commands of a leg between two net positions.
    fn leg(
        &mut self,
        leg: &Leg,
        (from, here): ([f64; 3], [f64; 3]),
        position: Option<usize>,
        returns: bool,
    ) {
        if let Some(m) = &leg.arrival {
            let segment = match returns {
                true => Segment::Return,
                false => Segment::Move,
            };
            let turn = m.largest_turn_rad();
            let rows = self.rows(m);
            let steps = rows.len();
            // A move to where the platform is already, in no time, is nothing to command.
            if m.duration_s > 0.0 || turn > 0.0 {
                // The move without its whole turns; its ends are those of its neighbours to the bit.
                let at = |k: usize| match k {
                    0 => from,
                    k if k == steps => here,
                    k => {
                        let angles = m.angles_at(rows[k - 1].0);
                        std::array::from_fn(|i| angles[i] + (from[i] - m.from[i]))
                    }
                };
                for (k, (_, duration_s)) in rows.iter().enumerate() {
                    let command = (segment, position, m.measured);
                    self.push(at(k), at(k + 1), *duration_s, command);
                }
            }
        }
        for (segment, duration_s) in [
            (Segment::Settle, leg.settle_s),
            (Segment::Dwell, leg.dwell_s),
        ] {
            if duration_s > 0.0 {
                let command = (segment, position, segment == Segment::Dwell);
                self.push(here, here, duration_s, command);
            }
        }
    }

    /// The rows of a move: where each ends, as a share of the duration, and how long it is, s. None turns
    /// further than a step, and where the gimbals speed up or slow down there are several.
    fn rows(&self, m: &Move) -> Vec<(f64, f64)> {
        if m.duration_s <= 0.0 {
            return vec![(1.0, 0.0)];
        }
        let turn = m.largest_turn_rad();
        let mut all = Vec::new();
        for (start, length) in m.smooth_parts((0.0, 1.0), 1.0) {
            let middle = start + 0.5 * length;
            let speed = m.greatest_speed((start, length));
            let least = match middle < m.ramp() || middle > 1.0 - m.ramp() {
                // In n rows of one rate each, the middle of a row is off by 1/4n² of the way.
                true => (turn * length * speed / (8.0 * OFF_A_RAMP_RAD)).sqrt(),
                false => 1.0,
            };
            let rows = turn * length * speed / self.step - 1e-9;
            let rows = rows.max(least).ceil().max(1.0);
            let duration_s = m.duration_s * length / rows;
            let ends = (1..=rows as usize).map(|k| start + length * k as f64 / rows);
            all.extend(ends.map(|end| (end, duration_s)));
        }
        all
    }

    fn push(
        &mut self,
        from: [f64; 3],
        to: [f64; 3],
        duration_s: f64,
        (segment, position, measured): (Segment, Option<usize>, bool),
    ) {
        let takes_time = duration_s > 0.0;
        let rates = || std::array::from_fn(|i| (to[i] - from[i]) / duration_s);
        let attitude = |angles| self.stand.attitude(Position::from_array(angles));
        let omega = || self.constant_rate(&attitude(from), &attitude(to), duration_s, from == to);
        self.commands.push(Command {
            start_s: self.time_s,
            duration_s,
            segment,
            position,
            from_rad: from,
            to_rad: to,
            gimbal_rates_rad_per_s: takes_time.then(rates),
            platform_rate_rad_per_s: takes_time.then(|| omega().into()),
            measured,
        });
        self.time_s += duration_s;
    }

    /// The rate that takes the platform from one attitude to the other, see the module text.
    fn constant_rate(
        &self,
        from: &Attitude,
        to: &Attitude,
        duration_s: f64,
        holds: bool,
    ) -> Vector3<f64> {
        if holds {
            return from.matrix().transpose() * self.earth_rate_n;
        }
        let earth = Rotation3::new(self.earth_rate_n * duration_s);
        let turn = from.matrix().transpose() * earth.matrix() * to.matrix();
        rotation_vector(&turn) / duration_s
    }
}

/// Log of a rotation by less than a half turn. By the arc tangent of its sine and cosine: the arc
/// cosine of the trace alone would lose half of the digits of a small turn.
fn rotation_vector(turn: &Matrix3<f64>) -> Vector3<f64> {
    let t = turn - turn.transpose();
    let axis_sine = 0.5 * Vector3::new(t[(2, 1)], t[(0, 2)], t[(1, 0)]);
    let (sine, cosine) = (axis_sine.norm(), 0.5 * (turn.trace() - 1.0));
    match sine > 0.0 {
        true => axis_sine * (libm::atan2(sine, cosine) / sine),
        false => Vector3::zeros(),
    }
}

/// Time of the test as hours, minutes and seconds.
pub fn clock(time_s: f64) -> String {
    let tenths = (time_s * 10.0).round() as u64;
    let (hours, minutes) = (tenths / 36_000, tenths / 600 % 60);
    format!(
        "{hours:02}:{minutes:02}:{:02}.{}",
        tenths / 10 % 60,
        tenths % 10
    )
}

fn optional(value: Option<f64>, most: usize) -> String {
    value.map_or_else(String::new, |v| decimals(v, most))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_read_well() {
        assert_eq!(clock(0.0), "00:00:00.0");
        assert_eq!(clock(14_395.14), "03:59:55.1");
        assert_eq!(clock(59.96), "00:01:00.0");
    }
}
