//! A timeline cut into the intervals that truth and filter step through.

use std::ops::Range;

use nalgebra::Matrix3;

use crate::attitude::Attitude;
use crate::covariance::split_periods;
use crate::drift::{DriftMatrix, times_drift_matrix};
use crate::dynamics::ErrorDynamics;
use crate::error::{Error, Result};
use crate::motion::{Move, Timeline};
use crate::platform::{Platform, Repositioning};

/// Most intervals of a simulated test: each is kept in memory, with the filter's gains.
pub const MAX_INTERVALS: f64 = 500_000.0;

/// Longest interval, s. The random drift is held over an interval; its effect then has the
/// covariance q t I but for a relative (ω_ie t)²/12, 1e-6 at this length.
const LONGEST_S: f64 = 50.0;

/// Largest turn of the platform in one Runge–Kutta step, rad: with h the step's turn the local
/// error is about h⁵/2880 of the drift's effect, 3e-9.
const LARGEST_TURN_RAD: f64 = 0.1;

/// One interval: constant random drift, and a measurement at its end or none.
#[derive(Debug, Clone)]
pub(super) struct DriftInterval {
    /// Index of the position being moved to or held.
    pub leg: usize,
    /// Length, s; zero where only `turn` happens.
    pub length_s: f64,
    /// Time since the start of the test at its end, s.
    pub end_s: f64,
    /// Whether the filter measures at its end.
    pub measured: bool,
    /// Frame-hold: ψ^n ← Q ψ^n before the interval.
    pub turn: Option<Matrix3<f64>>,
    /// C_c^n at the start, the middle and the end of every Runge–Kutta step (2 steps + 1 of
    /// them), or a single one when the platform holds.
    pub attitudes: Vec<Attitude>,
    /// Index into [`Program::transitions`].
    pub transition: usize,
}

impl DriftInterval {
    /// How many Runge–Kutta steps it takes.
    pub fn steps(&self) -> usize {
        (self.attitudes.len() / 2).max(1)
    }

    /// C_c^n at half step `i` of 0..=2·steps.
    pub fn attitude(&self, i: usize) -> &Attitude {
        &self.attitudes[i.min(self.attitudes.len() - 1)]
    }

    /// C_c^n at the end.
    pub fn end_attitude(&self) -> &Attitude {
        self.attitude(usize::MAX)
    }
}

/// Φ and B of the linear model over an interval: ψ^n ← Φ ψ^n + B D.
#[derive(Debug, Clone, Copy)]
pub(super) struct LinearTransition {
    pub phi: Matrix3<f64>,
    /// s (times g).
    pub b: DriftMatrix,
}

/// All intervals of a test in order.
#[derive(Debug)]
pub(super) struct Program {
    pub intervals: Vec<DriftInterval>,
    pub transitions: Vec<LinearTransition>,
    /// For each leg of the timeline, the index of its last interval.
    pub leg_ends: Vec<usize>,
    /// Which legs are positions of the schedule.
    pub positions: Range<usize>,
    /// How many intervals end with a measurement.
    pub ticks: usize,
}

impl Program {
    /// Cuts `timeline` into intervals no longer than a filter period.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] when there are more than [`MAX_INTERVALS`].
    pub fn new(platform: &Platform, timeline: &Timeline) -> Result<Self> {
        let period = platform.period_s();
        let count = timeline.total_time_s() / period.min(LONGEST_S);
        if count > MAX_INTERVALS {
            return Err(
                Error::input("the test has too many filter periods to simulate")
                    .with_key("filter.period_s")
                    .with_value(period)
                    .with_allowed(format!("at most {MAX_INTERVALS:e} periods in the test")),
            );
        }
        let mut builder = ProgramBuilder {
            dynamics: ErrorDynamics::new(platform.earth_rate_n()),
            period_s: period,
            program: Self {
                intervals: Vec::new(),
                transitions: Vec::new(),
                leg_ends: Vec::new(),
                positions: timeline.positions(),
                ticks: 0,
            },
            time_s: 0.0,
            leg: 0,
            turn: None,
        };
        let frame_hold = platform.motion().repositioning == Repositioning::FrameHold;
        for (index, leg) in timeline.legs().iter().enumerate() {
            builder.leg = index;
            if let Some(arrival) = &leg.arrival {
                if frame_hold {
                    let before = timeline.legs()[index - 1].attitude;
                    builder.turn = Some(leg.attitude.matrix() * before.matrix().transpose());
                } else {
                    builder.moving(arrival);
                }
            }
            builder.holding(leg.attitude, leg.settle_s, false);
            builder.holding(leg.attitude, leg.dwell_s, true);
            builder.end_leg(leg.attitude);
        }
        Ok(builder.program)
    }
}

/// What is being built, and how far it has come.
struct ProgramBuilder {
    dynamics: ErrorDynamics,
    period_s: f64,
    program: Program,
    time_s: f64,
    leg: usize,
    /// A turn that the next interval has to begin with.
    turn: Option<Matrix3<f64>>,
}

/// A piece of a move, settle or dwell.
struct Piece {
    start_s: f64,
    length_s: f64,
    measured: bool,
}

impl ProgramBuilder {
    /// Cuts a duration into filter periods and a remainder, and these into pieces short enough
    /// to hold the random drift; a tick ends each whole period where the filter measures.
    fn pieces(&self, duration_s: f64, measured: bool) -> Vec<Piece> {
        let (ticks, remainder) = split_periods(duration_s, self.period_s);
        let mut pieces = Vec::new();
        let mut cut = |start_s: f64, length_s: f64, tick: bool| {
            let count = (length_s / LONGEST_S - 1e-9).ceil().max(1.0) as usize;
            let each = length_s / count as f64;
            pieces.extend((0..count).map(|i| Piece {
                start_s: start_s + i as f64 * each,
                length_s: each,
                measured: tick && i + 1 == count,
            }));
        };
        for tick in 0..ticks {
            cut(tick as f64 * self.period_s, self.period_s, measured);
        }
        if remainder > 0.0 {
            cut(ticks as f64 * self.period_s, remainder, false);
        }
        pieces
    }

    fn holding(&mut self, attitude: Attitude, duration_s: f64, measured: bool) {
        let mut last: Option<(f64, usize)> = None;
        for piece in self.pieces(duration_s, measured) {
            let transition = match last {
                Some((length_s, index)) if length_s == piece.length_s => index,
                _ => {
                    let gamma = self.dynamics.integral(piece.length_s);
                    self.transition(piece.length_s, times_drift_matrix(&gamma, &attitude))
                }
            };
            last = Some((piece.length_s, transition));
            self.push(&piece, vec![attitude], transition);
        }
    }

    fn moving(&mut self, m: &Move) {
        let turn: f64 = m.change.iter().map(|c| c.abs()).sum();
        for piece in self.pieces(m.duration_s, m.measured) {
            let share = piece.length_s / m.duration_s;
            let steps = (turn * share / LARGEST_TURN_RAD).ceil().max(1.0) as usize;
            let attitudes = (0..=2 * steps)
                .map(|i| {
                    let t = piece.start_s + piece.length_s * i as f64 / (2 * steps) as f64;
                    m.position_at(t / m.duration_s).attitude()
                })
                .collect();
            let b = m.drift_integral(&self.dynamics, piece.start_s, piece.length_s);
            let transition = self.transition(piece.length_s, b);
            self.push(&piece, attitudes, transition);
        }
    }

    /// Closes a leg; one without any duration still has its turn and its end.
    fn end_leg(&mut self, attitude: Attitude) {
        let empty = self
            .program
            .intervals
            .last()
            .is_none_or(|i| i.leg != self.leg);
        if empty {
            let transition = self.transition(0.0, DriftMatrix::zeros());
            let nothing = Piece {
                start_s: 0.0,
                length_s: 0.0,
                measured: false,
            };
            self.push(&nothing, vec![attitude], transition);
        }
        self.program.leg_ends.push(self.program.intervals.len() - 1);
    }

    fn transition(&mut self, length_s: f64, b: DriftMatrix) -> usize {
        let phi = self.dynamics.transition(length_s);
        self.program.transitions.push(LinearTransition { phi, b });
        self.program.transitions.len() - 1
    }

    fn push(&mut self, piece: &Piece, attitudes: Vec<Attitude>, transition: usize) {
        self.time_s += piece.length_s;
        self.program.ticks += usize::from(piece.measured);
        self.program.intervals.push(DriftInterval {
            leg: self.leg,
            length_s: piece.length_s,
            end_s: self.time_s,
            measured: piece.measured,
            turn: self.turn.take(),
            attitudes,
            transition,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Position;
    use crate::platform::PlatformConfig;
    use crate::schedule::{Schedule, ScheduledPosition};

    fn program(config: &PlatformConfig, positions: &[(f64, f64)]) -> Program {
        let platform = config.check().unwrap();
        let positions = positions.iter().map(|&(alpha, dwell)| {
            ScheduledPosition::new(Position::from_deg(alpha, 0.0, 0.0), dwell)
        });
        let schedule = Schedule::new(positions.collect()).unwrap();
        let timeline = Timeline::new(&platform, &schedule).unwrap();
        Program::new(&platform, &timeline).unwrap()
    }

    #[test]
    fn ticks_fall_where_the_filter_has_them() {
        let mut config = PlatformConfig::default();
        config.motion.slew_rate_deg_per_s = Some(1.0);
        config.motion.settle_s = 25.0;
        let p = program(&config, &[(0.0, 35.0), (47.0, 20.0)]);
        let ticks: Vec<f64> = p
            .intervals
            .iter()
            .filter(|i| i.measured)
            .map(|i| i.end_s)
            .collect();
        // 35 s dwell, 47 s move and 25 s settle without measurements, then 20 s of dwell.
        assert_eq!(ticks, [10.0, 20.0, 30.0, 117.0, 127.0]);
        assert_eq!(p.ticks, 5);
        config.motion.measure_moves = true;
        let p = program(&config, &[(0.0, 35.0), (47.0, 20.0)]);
        assert_eq!(p.ticks, 3 + 4 + 2);
        assert!((p.intervals.last().unwrap().end_s - 102.0).abs() < 1e-9);
    }

    #[test]
    fn long_periods_are_cut_and_empty_legs_kept() {
        let mut config = PlatformConfig::default();
        config.filter.period_s = 120.0;
        config.motion.repositioning = Repositioning::FrameHold;
        let p = program(&config, &[(0.0, 240.0), (90.0, 0.0), (180.0, 120.0)]);
        assert_eq!(p.ticks, 3);
        assert!(p.intervals.iter().all(|i| i.length_s <= LONGEST_S));
        assert_eq!(p.leg_ends.len(), 3);
        let turns = p.intervals.iter().filter(|i| i.turn.is_some()).count();
        assert_eq!(turns, 2);
    }
}
