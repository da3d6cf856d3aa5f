//! A timeline cut into the intervals that truth and filter step through.

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

use crate::attitude::{Attitude, Stand};
use crate::covariance::selection::{Mixing, Selection};
use crate::covariance::{CovarianceModel, split_periods};
use crate::drift::{DriftMatrix, times_drift_matrix};
use crate::dynamics::ErrorDynamics;
use crate::error::{Error, Result};
use crate::motion::{Move, Timeline};
use crate::platform::{Platform, Repositioning};

use super::states::{Drive, LinearTransition};
use super::wander::{Wandering, Whereabouts};

/// Most intervals of a simulated test: each is kept in memory, with the filter's gains.
pub const MAX_INTERVALS: f64 = 500_000.0;

/// Longest interval, s. The random drift is held over an interval; its effect then has the
/// covariance q t I but for a relative (ω_ie t)²/12, 1e-6 at this length.
const LONGEST_S: f64 = 50.0;

/// Largest phase of the drift matrix in one Runge–Kutta step, rad: the platform's turn times the
/// degree of A in the angles. With φ that phase the error is about φ⁴/2880 of the drift's effect in a
/// move, 6e-7; A of the twelve coefficients is of degree 2, with quadratic drift of degree 3.
const LARGEST_PHASE_RAD: f64 = 0.2;

/// One interval: constant random drift, and a measurement at its end or none. A move that takes no
/// time is one of no length, in which the torquers alone turn the platform.
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
    /// ω_nc^c of the gimbals at the same moments, rad/s, or rad for the whole of an interval of no
    /// length; empty when the platform holds, or when no torquer has an error.
    pub gimbal_rates: Vec<Vector3<f64>>,
    /// Index into [`Program::transitions`].
    pub transition: usize,
    /// Index into [`Program::outputs`] of where it ends.
    pub output: usize,
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

    /// How long the integration over it is: its length in s, or 1 where it takes no time.
    pub fn span(&self) -> f64 {
        match self.length_s > 0.0 {
            true => self.length_s,
            false => 1.0,
        }
    }

    /// How much time passes in a unit of that: 1 s, or none.
    pub fn pace(&self) -> f64 {
        f64::from(u8::from(self.length_s > 0.0))
    }

    /// The commanded rate ω = C_n^c ω_ie^n + ω_nc^c at half step `i`, for each unit of the span, rad.
    pub fn commanded(&self, i: usize, earth_rate_n: &Vector3<f64>) -> Vector3<f64> {
        let tracking = self.attitude(i).matrix().tr_mul(earth_rate_n) * self.pace();
        let gimbals = self.gimbal_rates.get(i.min(self.attitudes.len() - 1));
        gimbals.map_or(tracking, |rate| tracking + rate)
    }

    /// C_c^n at the end.
    pub fn end_attitude(&self) -> &Attitude {
        self.attitude(usize::MAX)
    }
}

/// All intervals of a test in order.
#[derive(Debug)]
pub(super) struct Program {
    pub intervals: Vec<DriftInterval>,
    pub transitions: Vec<LinearTransition>,
    /// δZ^n of the linear model at the ends of intervals, arcsec per unit of each parameter.
    pub outputs: Vec<Drive>,
    /// For each leg of the timeline, the index of its last interval.
    pub leg_ends: Vec<usize>,
    /// Which legs are positions of the schedule.
    pub positions: Range<usize>,
    /// How many intervals end with a measurement.
    pub ticks: usize,
}

impl Program {
    /// Cuts `timeline` into intervals no longer than a filter period, for a filter that knows of
    /// `wandering`.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] when there are more than [`MAX_INTERVALS`].
    pub fn new(
        platform: &Platform,
        timeline: &Timeline,
        wandering: Option<&Wandering>,
    ) -> Result<Self> {
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
        let model = CovarianceModel::new(platform);
        let mut builder = ProgramBuilder {
            dynamics: ErrorDynamics::new(platform.earth_rate_n()),
            stand: *platform.stand(),
            period_s: period,
            effects: LinearEffects::new(platform, &model),
            wandering,
            program: Self {
                intervals: Vec::new(),
                transitions: Vec::new(),
                outputs: Vec::new(),
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
                } else if arrival.duration_s > 0.0 {
                    builder.moving(arrival);
                } else {
                    builder.jumping(arrival);
                }
            }
            builder.holding(leg.attitude, leg.settle_s, false);
            builder.holding(leg.attitude, leg.dwell_s, true);
            builder.end_leg(leg.attitude);
        }
        Ok(builder.program)
    }
}

/// What the parameters do in the linear model.
struct LinearEffects<'a> {
    mixing: Mixing<f64>,
    /// The same along moves; none: there are the twelve coefficients in the paper's mounting alone.
    along_moves: Option<Selection<'a, f64>>,
    has_torquers: bool,
    has_accelerometers: bool,
    earth_rate_n: Vector3<f64>,
    stand: Stand,
}

impl<'a> LinearEffects<'a> {
    fn new(platform: &Platform, model: &'a CovarianceModel) -> Self {
        let errors = platform.errors();
        let mixing = Mixing::<f64>::new(&errors.effects());
        Self {
            has_torquers: mixing.has_torquers(),
            has_accelerometers: mixing.has_accelerometers(),
            mixing,
            along_moves: (!errors.is_of_the_paper()).then(|| Selection::new(model)),
            earth_rate_n: platform.earth_rate_n(),
            stand: *platform.stand(),
        }
    }

    fn nothing(&self) -> Drive {
        self.mixing.nothing()
    }

    /// Of A in the angles.
    fn degree(&self) -> f64 {
        self.along_moves.as_ref().map_or(2.0, Selection::degree)
    }

    /// X A at an attitude that is held.
    fn held(&self, x: &Matrix3<f64>, attitude: &Attitude) -> Drive {
        if self.along_moves.is_none() {
            return dynamic(&times_drift_matrix(x, attitude));
        }
        let c = attitude.matrix();
        let rate = c.tr_mul(&self.earth_rate_n);
        self.mixing.turned_drift(&(x * c), c, &rate, 1.0)
    }

    /// B of a part of a move that takes time.
    fn moved(&self, dynamics: &ErrorDynamics, m: &Move, piece: &Piece) -> Drive {
        match &self.along_moves {
            None => {
                dynamic(&m.drift_integral(&self.stand, dynamics, piece.start_s, piece.length_s))
            }
            Some(selection) => {
                let part = [piece.start_s, piece.length_s].map(|s| s / m.duration_s);
                selection.part_of_move(m, part.into())
            }
        }
    }

    /// B of a move that takes none.
    fn jump(&self, m: &Move) -> Drive {
        match &self.along_moves {
            None => self.nothing(),
            Some(selection) => selection.part_of_move(m, (0.0, 1.0)),
        }
    }
}

fn dynamic(b: &DriftMatrix) -> Drive {
    Drive::from_columns(&b.column_iter().collect::<Vec<_>>())
}

/// What is being built, and how far it has come.
struct ProgramBuilder<'a> {
    dynamics: ErrorDynamics,
    stand: Stand,
    period_s: f64,
    effects: LinearEffects<'a>,
    wandering: Option<&'a Wandering>,
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

impl Piece {
    /// Of no length.
    const NOTHING: Self = Self {
        start_s: 0.0,
        length_s: 0.0,
        measured: false,
    };
}

impl ProgramBuilder<'_> {
    /// Cuts a duration into filter periods and a remainder, and these into pieces short enough
    /// to hold the random drift, and where a move's rate has corners; a tick ends each whole period
    /// where the filter measures.
    fn pieces(&self, duration_s: f64, measured: bool, m: Option<&Move>) -> Vec<Piece> {
        let smooth_parts = |start_s: f64, length_s: f64| match m {
            Some(m) => m.smooth_parts((start_s, length_s), m.duration_s).collect(),
            None => vec![(start_s, length_s)],
        };
        let (ticks, remainder) = split_periods(duration_s, self.period_s);
        let mut pieces: Vec<Piece> = Vec::new();
        let mut cut = |start_s: f64, length_s: f64, tick: bool| {
            for (start_s, length_s) in smooth_parts(start_s, length_s) {
                let count = (length_s / LONGEST_S - 1e-9).ceil().max(1.0) as usize;
                let each = length_s / count as f64;
                pieces.extend((0..count).map(|i| Piece {
                    start_s: start_s + i as f64 * each,
                    length_s: each,
                    measured: false,
                }));
            }
            if let Some(last) = pieces.last_mut() {
                last.measured = tick;
            }
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
        for piece in self.pieces(duration_s, measured, None) {
            let transition = match last {
                Some((length_s, index)) if length_s == piece.length_s => index,
                _ => {
                    let gamma = self.dynamics.integral(piece.length_s);
                    let b = self.effects.held(&gamma, &attitude);
                    self.transition(piece.length_s, b, Whereabouts::At(&attitude))
                }
            };
            last = Some((piece.length_s, transition));
            self.push(&piece, Path::held(attitude), transition);
        }
    }

    fn moving(&mut self, m: &Move) {
        for piece in self.pieces(m.duration_s, m.measured, Some(m)) {
            let b = self.effects.moved(&self.dynamics, m, &piece);
            let at = Whereabouts::Moving(m, piece.start_s);
            let transition = self.transition(piece.length_s, b, at);
            let path = self.path(m, &piece, m.duration_s);
            self.push(&piece, path, transition);
        }
    }

    /// A move that takes no time: the torquers turn the platform all the same.
    fn jumping(&mut self, m: &Move) {
        if self.effects.has_torquers {
            let b = self.effects.jump(m);
            let transition = self.transition(0.0, b, Whereabouts::Moving(m, 0.0));
            let whole = Piece {
                start_s: 0.0,
                length_s: 1.0,
                measured: false,
            };
            let path = self.path(m, &whole, 1.0);
            self.push(&Piece::NOTHING, path, transition);
        }
    }

    /// The way through a piece of a move that is `duration` long, in the unit of the piece.
    fn path(&self, m: &Move, piece: &Piece, duration: f64) -> Path {
        let turn: f64 = m.change.iter().map(|c| c.abs()).sum();
        let (start, share) = (piece.start_s / duration, piece.length_s / duration);
        let turn = turn * m.greatest_speed((start, share));
        let largest_turn = LARGEST_PHASE_RAD / self.effects.degree();
        let steps = (turn * share / largest_turn).ceil().max(1.0) as usize;
        let nodes = (0..=2 * steps).map(|i| {
            let t = piece.start_s + piece.length_s * i as f64 / (2 * steps) as f64;
            t / duration
        });
        let rate_at = |fraction: f64| m.change.map(|c| c / duration * m.speed_at(fraction));
        Path {
            gimbal_rates: match self.effects.has_torquers {
                true => nodes
                    .clone()
                    .map(|at| {
                        let angles = m.position_at(at).to_array();
                        self.stand.gimbal_rate(angles, rate_at(at))
                    })
                    .collect(),
                false => Vec::new(),
            },
            attitudes: nodes
                .map(|at| self.stand.attitude(m.position_at(at)))
                .collect(),
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
            let nothing = self.effects.nothing();
            let transition = self.transition(0.0, nothing, Whereabouts::At(&attitude));
            self.push(&Piece::NOTHING, Path::held(attitude), transition);
        }
        self.program.leg_ends.push(self.program.intervals.len() - 1);
    }

    fn transition(&mut self, length_s: f64, b: Drive, at: Whereabouts<'_>) -> usize {
        let transition = match self.wandering {
            Some(wandering) => wandering.passed(&self.dynamics, at, &b, length_s),
            None => LinearTransition {
                phi: self.dynamics.transition(length_s),
                b,
                fading: None,
            },
        };
        self.program.transitions.push(transition);
        self.program.transitions.len() - 1
    }

    fn push(&mut self, piece: &Piece, path: Path, transition: usize) {
        self.time_s += piece.length_s;
        self.program.ticks += usize::from(piece.measured);
        let mut interval = DriftInterval {
            leg: self.leg,
            length_s: piece.length_s,
            end_s: self.time_s,
            measured: piece.measured,
            turn: self.turn.take(),
            attitudes: path.attitudes,
            gimbal_rates: path.gimbal_rates,
            transition,
            output: 0,
        };
        interval.output = self.output(&interval);
        self.program.intervals.push(interval);
    }

    /// What the accelerometers show at the end of `interval`.
    fn output(&mut self, interval: &DriftInterval) -> usize {
        let here = interval.end_attitude();
        let last = self.program.intervals.last();
        let same = last.is_some_and(|i| i.end_attitude() == here);
        let outputs = &mut self.program.outputs;
        let shows = |w: &Wandering| w.has_biases();
        let varies = self.effects.has_accelerometers || self.wandering.is_some_and(shows);
        if outputs.is_empty() || (varies && !same) {
            let output = self.effects.mixing.output(here.matrix());
            outputs.push(match self.wandering {
                Some(wandering) => wandering.shown(&output, here.matrix()),
                None => output,
            });
        }
        outputs.len() - 1
    }
}

/// The way of the platform through an interval.
struct Path {
    attitudes: Vec<Attitude>,
    gimbal_rates: Vec<Vector3<f64>>,
}

impl Path {
    fn held(attitude: Attitude) -> Self {
        Self {
            attitudes: vec![attitude],
            gimbal_rates: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Position;
    use crate::platform::{AxisValue, PlatformConfig};
    use crate::schedule::{Schedule, ScheduledPosition};

    fn program(config: &PlatformConfig, positions: &[(f64, f64)]) -> Program {
        let platform = config.check().unwrap();
        let positions = positions.iter().map(|&(alpha, dwell)| {
            ScheduledPosition::new(Position::from_deg(alpha, 0.0, 0.0), dwell)
        });
        let schedule = Schedule::new(positions.collect()).unwrap();
        let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
        Program::new(&platform, &timeline, None).unwrap()
    }

    #[test]
    fn ticks_fall_where_the_filter_has_them() {
        let mut config = PlatformConfig::default();
        config.motion.slew_rate_deg_per_s = Some(1.0.into());
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

    /// Against the difference of two attitudes: Ċ_c^n = C_c^n [ω_nc^c ×].
    #[test]
    fn the_gimbals_turn_the_platform() {
        let (angles, rate) = ([0.3, -1.2, 2.3], [0.3, -0.8, 0.5]);
        let at = |s: f64| {
            let [a, b, g]: [f64; 3] = std::array::from_fn(|i| angles[i] + s * rate[i]);
            *Position::from_rad(a, b, g).attitude().matrix()
        };
        let h = 1e-5;
        let slope = (at(h) - at(-h)) / (2.0 * h);
        let expected = at(0.0) * Stand::PAPER.gimbal_rate(angles, rate).cross_matrix();
        assert!((slope - expected).amax() < 1e-9);
    }

    #[test]
    fn a_move_without_duration_is_an_interval_where_torquers_have_errors() {
        let mut config = PlatformConfig::default();
        let positions = [(0.0, 20.0), (90.0, 20.0), (-90.0, 20.0)];
        let without = program(&config, &positions).intervals.len();
        config.errors.estimated.torquer_scale_factor_ppm = Some(AxisValue::All(1000.0));
        let p = program(&config, &positions);
        assert_eq!(p.intervals.len(), without + 2);
        let jumps: Vec<&DriftInterval> = p.intervals.iter().filter(|i| i.length_s == 0.0).collect();
        // T_XX turns it by 1 ppm of the quarter turn about x, and of the half turn that follows.
        for (jump, turn) in jumps.iter().zip([-1.0, -2.0]) {
            let b = p.transitions[jump.transition].b.column(12).into_owned();
            let expected = turn * 90.0 * 3600.0 * 1e-6;
            assert!(
                (b.x - expected).abs() < 1e-9 && b.yz().amax() < 1e-12,
                "{b}"
            );
            assert_eq!((jump.span(), jump.pace()), (1.0, 0.0));
        }
        config.motion.repositioning = Repositioning::FrameHold;
        assert_eq!(program(&config, &positions).intervals.len(), without);
    }
}
