//! The operator's sheet: what a person does at the stand, position by position.
//!
//! For each position the clock (start of the move, start of the dwell, until when it is held), the angles
//! to dial in, what the accelerometers should then read, and in words how to get there. The angles are
//! those of the [command table](crate::commands): they count on through the whole test, so that the way
//! round is in the numbers. What the platform is torqued with is not on it.

use std::fmt::Write;

use crate::attitude::{NanoDegrees, Position, SignedAxis, Stand};
use crate::config::TestConfig;
use crate::motion::{Leg, Test, Timeline};
use crate::platform::{Platform, Repositioning};
use crate::results::TOOL_VERSION;
use crate::units::{Angle, round_deg};
use crate::wording::{decimals, h_mm_ss};

/// Which stop of a test a row of the sheet is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stop {
    /// The attitude that the stand starts from (`motion.start_deg`).
    Start,
    /// A position that was held before the test was interrupted.
    Done,
    /// A position of the schedule, by its number from 1.
    Position(usize),
    /// Back where the test began.
    Return,
}

impl std::fmt::Display for Stop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Start => f.write_str("start"),
            Self::Done => f.write_str("done"),
            Self::Position(number) => number.fmt(f),
            Self::Return => f.write_str("return"),
        }
    }
}

/// How a stop is reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// How far α, β and γ turn, degrees: the way actually taken.
    pub turn_deg: [f64; 3],
    /// How long the move takes, s; zero where the plan gives moves no time.
    pub move_s: f64,
    /// Whether the filter measures meanwhile.
    pub measured: bool,
    /// How long it settles afterwards, s.
    pub settle_s: f64,
}

/// One row of the sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SheetRow {
    /// Which stop it is.
    pub stop: Stop,
    /// How it is reached; none: the test begins here.
    pub approach: Option<Approach>,
    /// When the move to it begins, s since the start of the test.
    pub move_starts_s: f64,
    /// When move and settling are over, s since the start of the test.
    pub dwell_starts_s: f64,
    /// When it is left, s since the start of the test.
    pub ends_s: f64,
    /// (α, β, γ) to dial in, degrees, whole turns since the start counted.
    pub angles_deg: [f64; 3],
    /// The same within (−180°, 180°].
    pub wrapped_deg: [f64; 3],
    /// What perfect accelerometers along the platform's x, y and z read there, g.
    pub specific_force_g: [f64; 3],
    /// Whether the next move follows at once and is measured: tumbling does not stop here.
    pub passes: bool,
}

impl SheetRow {
    /// Whether whole turns make the angles differ from those within ±180°.
    pub fn is_wound(&self) -> bool {
        self.angles_deg != self.wrapped_deg
    }

    /// What to do, in plain letters.
    pub fn words(&self) -> String {
        let mut words = Vec::new();
        match &self.approach {
            None if self.stop == Stop::Start => {
                words.push("The stand starts from here.".to_owned());
            }
            None => words.push("The test begins here.".to_owned()),
            Some(approach) => words.push(approach.words(self.stop)),
        }
        let dwell_s = self.ends_s - self.dwell_starts_s;
        if self.passes {
            words.push("Do not stop here: the next move follows at once.".to_owned());
        } else if let Stop::Position(_) = self.stop
            && dwell_s > 0.0
        {
            words.push(format!("Measure {}.", h_mm_ss(dwell_s)));
        }
        words.join(" ")
    }
}

impl Approach {
    fn words(&self, stop: Stop) -> String {
        let turns: Vec<String> = ["alpha", "beta", "gamma"]
            .into_iter()
            .zip(self.turn_deg)
            .filter(|(_, deg)| *deg != 0.0)
            .map(|(name, deg)| format!("{name} {}{} deg", sign(deg), decimals(deg.abs(), 4)))
            .collect();
        let turns = match turns.is_empty() {
            true => "stay".to_owned(),
            false => format!("turn {}", turns.join(", ")),
        };
        let time = match self.move_s > 0.0 {
            true => format!(" in {}", h_mm_ss(self.move_s)),
            false => String::new(),
        };
        let settle = match self.settle_s > 0.0 {
            true => format!("; settle {}", h_mm_ss(self.settle_s)),
            false => String::new(),
        };
        match (stop, self.measured) {
            (Stop::Return, _) => format!("Back to where the test began: {turns}{time}."),
            (_, true) => format!("MEASURED MOVE, keep recording: {turns}, evenly{time}."),
            (_, false) => format!("Move: {turns}{time}{settle}."),
        }
    }
}

const fn sign(deg: f64) -> char {
    if deg < 0.0 { '-' } else { '+' }
}

/// What an operator has at the stand.
///
/// ```
/// use scheme_opt::{Schedule, Study};
/// let study = Study::from_toml("[motion]\nslew_rate_deg_per_s = 0.5\nsettle_s = 30\n")?;
/// let schedule = Schedule::from_csv(
///     "alpha_deg,beta_deg,gamma_deg,dwell_s\n0,0,0,1500\n170,0,0,1500\n-60,0,0,1500\n",
/// )?;
/// let sheet = study.operator_sheet(&schedule)?;
/// // From 170° on to 300°, which is −60°.
/// assert_eq!(sheet.rows()[2].angles_deg, [300.0, 0.0, 0.0]);
/// assert_eq!(sheet.rows()[2].wrapped_deg, [-60.0, 0.0, 0.0]);
/// assert!(sheet.to_csv().contains("\n,2,0:25:00,0:31:10,0:56:10,170,0,0,"));
/// # Ok::<(), scheme_opt::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct OperatorSheet {
    rows: Vec<SheetRow>,
    planned_for: String,
    winding_deg: [f64; 3],
    test: TestConfig,
}

/// Of rad what is one number of degrees where it is the same for all axes, or else three.
fn of_axes(rad: [f64; 3]) -> String {
    let deg = rad.map(|rad| decimals(round_deg(Angle::from_rad(rad).deg()), 6));
    match deg.iter().all(|d| *d == deg[0]) {
        true => deg[0].clone(),
        false => deg.join(", "),
    }
}

/// Header of the CSV form.
const HEADER: &str = "done,position,move_starts,dwell_starts,wait_until,\
    alpha_deg,beta_deg,gamma_deg,alpha_wrapped_deg,beta_wrapped_deg,gamma_wrapped_deg,\
    f_x_g,f_y_g,f_z_g,what_to_do,move_starts_s,dwell_starts_s,ends_s";

/// Decimals of angles and times in the CSV form.
const DECIMALS: usize = 9;
/// Decimals of what accelerometers read.
pub(crate) const FORCE_DECIMALS: usize = 5;

impl OperatorSheet {
    /// The sheet of a timeline of `test`.
    pub fn new(test: &Test, timeline: &Timeline) -> Self {
        let held = timeline.positions();
        let legs = timeline.legs();
        let starts_elsewhere = test.platform().motion().start.is_some();
        let mut time_s = 0.0;
        let mut rows = Vec::with_capacity(legs.len());
        for (index, (leg, net)) in legs.iter().zip(timeline.net_positions()).enumerate() {
            let stop = match index {
                _ if held.contains(&index) => Stop::Position(index - held.start + 1),
                _ if index >= held.end => Stop::Return,
                0 if starts_elsewhere => Stop::Start,
                _ => Stop::Done,
            };
            let move_starts_s = time_s;
            time_s += leg.duration_s();
            let next = legs.get(index + 1).and_then(|next| next.arrival);
            rows.push(SheetRow {
                stop,
                approach: leg.arrival.map(|_| approach(leg)),
                move_starts_s,
                dwell_starts_s: time_s - leg.dwell_s,
                ends_s: time_s,
                angles_deg: net.to_deg().map(|deg| deg + 0.0),
                wrapped_deg: wrapped(net),
                specific_force_g: leg.attitude.specific_force_c().map(|f| f + 0.0),
                passes: leg.dwell_s <= 0.0
                    && stop != Stop::Start
                    && next.is_some_and(|next| next.measured && next.duration_s > 0.0),
            });
        }
        Self {
            rows,
            planned_for: planned_for(test.platform()),
            winding_deg: timeline.winding_deg(),
            test: TestConfig::default(),
        }
    }

    /// The same, which says whose test it is.
    pub(crate) fn of_test(self, test: &TestConfig) -> Self {
        let test = test.clone();
        Self { test, ..self }
    }

    /// Whose test it is, as far as anybody said.
    pub fn test(&self) -> &TestConfig {
        &self.test
    }

    /// The rows in order: start, positions, return.
    pub fn rows(&self) -> &[SheetRow] {
        &self.rows
    }

    /// What stand it was planned for, in a line.
    pub fn planned_for(&self) -> &str {
        &self.planned_for
    }

    /// How far α, β and γ are from where the test began, at most, degrees.
    pub fn winding_deg(&self) -> [f64; 3] {
        self.winding_deg
    }

    /// The sheet as CSV with a header line: `done` is empty, for a tick; clocks are h:mm:ss since the start
    /// of the test, to the nearest second, and the last columns have them in seconds.
    pub fn to_csv(&self) -> String {
        let mut text = format!("{HEADER}\n");
        for row in &self.rows {
            let done = match row.stop {
                Stop::Done => "x",
                Stop::Start | Stop::Position(_) | Stop::Return => "",
            };
            let times = [row.move_starts_s, row.dwell_starts_s, row.ends_s];
            let [begins, dwells, ends] = times.map(h_mm_ss);
            // Writing to a string cannot fail.
            let _ = write!(text, "{done},{},{begins},{dwells},{ends}", row.stop);
            for deg in row.angles_deg.iter().chain(&row.wrapped_deg) {
                let _ = write!(text, ",{}", decimals(*deg, DECIMALS));
            }
            for f in row.specific_force_g {
                let _ = write!(text, ",{f:.FORCE_DECIMALS$}");
            }
            // No quotes are in the words.
            let _ = write!(text, ",\"{}\"", row.words());
            for time_s in times {
                let _ = write!(text, ",{}", decimals(time_s, DECIMALS));
            }
            text.push('\n');
        }
        text
    }

    /// The sheet as one HTML page to print on A4.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the page cannot be made.
    #[cfg(feature = "report")]
    pub fn to_html(&self) -> crate::Result<String> {
        crate::report::html::sheet::page(self)
    }

    /// The version of the program that made it.
    pub const fn tool_version(&self) -> &'static str {
        TOOL_VERSION
    }
}

fn approach(leg: &Leg) -> Approach {
    let change = leg.arrival.map_or([0.0; 3], |m| m.change);
    Approach {
        turn_deg: change.map(|rad| round_deg(Angle::from_rad(rad).deg()) + 0.0),
        move_s: leg.arrival.map_or(0.0, |m| m.duration_s),
        measured: leg.arrival.is_some_and(|m| m.measured),
        settle_s: leg.settle_s,
    }
}

/// The angles within (−180°, 180°], to the 1e-9° that files carry.
fn wrapped(position: Position) -> [f64; 3] {
    position
        .degrees()
        .map(|deg| NanoDegrees::nearest(deg).wrapped().deg() + 0.0)
}

/// What stands in the gimbals' way.
fn in_the_way(platform: &Platform) -> Vec<String> {
    let obstacles = platform.obstacles();
    let mut words: Vec<String> = obstacles
        .all_shown()
        .map(|shown| format!("never in {shown}"))
        .collect();
    for (name, most) in ["alpha", "beta", "gamma"]
        .into_iter()
        .zip(obstacles.max_winding())
    {
        if let Some(most) = most {
            let most = decimals(most.deg(), 4);
            words.push(format!("{name} within {most} deg of where it starts"));
        }
    }
    if let Some(stops) = obstacles.allowed() {
        words.push(format!("only {} listed positions", stops.len()));
    }
    words
}

/// How the base and the gimbals are set up, where not as in the paper.
fn set_up(stand: &Stand) -> Vec<String> {
    let mut words = Vec::new();
    if stand.axes() != Stand::PAPER.axes() {
        let [alpha, beta, gamma] = stand.axes().map(SignedAxis::name);
        words.push(format!(
            "alpha (outer) about {alpha}, beta about {beta}, gamma (inner) about {gamma}"
        ));
    }
    let heading = stand.heading_deg();
    if heading != 0.0 {
        words.push(format!(
            "base turned {} deg from north towards east",
            decimals(heading, 4)
        ));
    }
    let tilt = stand.tilt_deg();
    if tilt != [0.0; 2] {
        let [x, z] = tilt.map(|deg| decimals(deg, 4));
        words.push(format!("base tilted {x} deg about x, {z} deg about z"));
    }
    words
}

/// The stand in a line: what an operator can hold against the one in front of him.
fn planned_for(platform: &Platform) -> String {
    let motion = platform.motion();
    let mut words = Vec::new();
    for (name, range) in ["alpha", "beta", "gamma"]
        .into_iter()
        .zip(&platform.gimbals().ranges)
    {
        if let Some(range) = range {
            let ends = range.ends();
            let [low, high] = [ends.start(), ends.end()].map(|end| decimals(end.deg(), 4));
            words.push(format!("{name} {low} to {high} deg"));
        }
    }
    if words.is_empty() {
        words.push("all gimbals unlimited".to_owned());
    }
    words.push(match (motion.repositioning, motion.slew) {
        (Repositioning::FrameHold, _) => "frame-hold, moves take no time".to_owned(),
        (Repositioning::Slew, None) => "moves take no time".to_owned(),
        (Repositioning::Slew, Some(slew)) => {
            let rates = of_axes(slew.rate_rad_per_s);
            let accelerations = slew.acceleration_rad_per_s2.map(of_axes);
            let speeding_up = accelerations.map(|a| format!(", speeding up at {a} deg/s2"));
            format!("moves at {rates} deg/s{}", speeding_up.unwrap_or_default())
        }
    });
    if motion.settle_s > 0.0 {
        words.push(format!("settling {} s", decimals(motion.settle_s, 3)));
    }
    words.extend(in_the_way(platform));
    words.extend(set_up(platform.stand()));
    words.join("; ")
}
