//! How a stand moves from position to position.

use serde::{Deserialize, Serialize};

use super::{AxisValue, Gimbals, Obstacles, SlewLimits, in_range};
use crate::attitude::Position;
use crate::error::{Error, Result};

/// How a change of position is modelled.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Repositioning {
    /// All gimbals go through the same share of their way at the same time, and arrive together; ψ^n is
    /// continuous and the drift integrates through the move.
    #[default]
    Slew,
    /// The paper's simulation: zero time, ψ in the platform frame is kept,
    /// ψ^n ← C_{k+1} C_kᵀ ψ^n.
    FrameHold,
}

/// How the platform moves between positions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct MotionConfig {
    /// Model of the change of position.
    pub repositioning: Repositioning,
    /// Slew rate, °/s, of all gimbals or `[α, β, γ]`; none: moves take no time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slew_rate_deg_per_s: Option<AxisValue>,
    /// Acceleration, °/s², of all gimbals or `[α, β, γ]`; none: they are at their rate at once.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceleration_deg_per_s2: Option<AxisValue>,
    /// Settling time after every unmeasured move, s.
    pub settle_s: f64,
    /// Whether the filter keeps measuring during moves.
    pub measure_moves: bool,
    /// Shortest dwell that a search proposes, s.
    pub min_dwell_s: f64,
    /// Where the platform stands before the test, (α, β, γ), degrees: the move to the first
    /// position is then part of the test. None: the test starts at the first position.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_deg: Option<[f64; 3]>,
    /// Whether the test ends with the move back to the start, or without one to the first
    /// position.
    pub return_to_start: bool,
}

impl Default for MotionConfig {
    fn default() -> Self {
        Self {
            repositioning: Repositioning::Slew,
            slew_rate_deg_per_s: None,
            acceleration_deg_per_s2: None,
            settle_s: 0.0,
            measure_moves: false,
            min_dwell_s: 60.0,
            start_deg: None,
            return_to_start: false,
        }
    }
}

/// The motion between positions, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Model of the change of position.
    pub repositioning: Repositioning,
    /// How fast the gimbals turn; none: moves take no time.
    pub slew: Option<SlewLimits>,
    /// Settling time after every unmeasured move, s.
    pub settle_s: f64,
    /// Whether the filter keeps measuring during moves.
    pub measure_moves: bool,
    /// Shortest dwell that a search proposes, s.
    pub min_dwell_s: f64,
    /// Where the platform stands before the test.
    pub start: Option<Position>,
    /// Whether the test ends with the move back to the start.
    pub return_to_start: bool,
}

impl MotionConfig {
    pub(super) fn check(&self, gimbals: &Gimbals, obstacles: &Obstacles) -> Result<Motion> {
        Ok(Motion {
            repositioning: self.repositioning,
            slew: SlewLimits::check(self.slew_rate_deg_per_s, self.acceleration_deg_per_s2)?,
            settle_s: in_range("motion.settle_s", self.settle_s, 0.0, 1e6, "0 to 1e6")?,
            measure_moves: self.measure_moves,
            min_dwell_s: in_range("motion.min_dwell_s", self.min_dwell_s, 0.0, 1e6, "0 to 1e6")?,
            start: self
                .start_deg
                .map(|deg| start(deg, gimbals, obstacles))
                .transpose()?,
            return_to_start: self.return_to_start,
        })
    }
}

/// The position before the test.
fn start(deg: [f64; 3], gimbals: &Gimbals, obstacles: &Obstacles) -> Result<Position> {
    const KEY: &str = "motion.start_deg";
    for v in deg {
        in_range(KEY, v, -36_000.0, 36_000.0, "angles from -36000 to 36000")?;
    }
    let position = Position::from_deg(deg[0], deg[1], deg[2]);
    for (axis, angle) in position.degrees().into_iter().enumerate() {
        if let Some(allowed) = gimbals.refusal(axis, angle) {
            return Err(Error::out_of_range(KEY, deg[axis], &allowed));
        }
    }
    let refused = |allowed: String| {
        let [alpha, beta, gamma] = deg;
        Err(Error::input("the platform cannot stand there")
            .with_key(KEY)
            .with_value(format!("[{alpha}, {beta}, {gamma}]"))
            .with_allowed(allowed))
    };
    if let Some(index) = obstacles.at(position.nano()) {
        return refused(format!(
            "outside gimbals.forbidden[{index}], {}",
            obstacles.shown(index)
        ));
    }
    if !obstacles.is_listed(position.nano()) {
        return refused("a position of gimbals.allowed".to_owned());
    }
    Ok(position)
}
