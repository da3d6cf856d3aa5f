//! The position or the move that helps a schedule of a platform with more errors than the twelve
//! coefficients most.
//!
//! Errors of the torquers show in slews alone, those of the accelerometers in attitudes. So both are
//! tried: one position or two held for the mean dwell of the schedule, and a turn of one gimbal at a finite rate,
//! from where the schedule ends or from an attitude in which the gimbal's axis lies along an axis of the
//! platform. Each is rated by the exact chain, `CovarianceModel::truth`, of the schedule with it: by the
//! σ, geometric mean, of what the schedule does not tell, or else by the criterion. What the same time
//! would do in longer dwells is beside it.

use std::collections::BTreeSet;
use std::fmt;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::suggest::{GimbalAxis, NoSuggestion, gains, new_dwell_s, stretched};
use crate::attitude::{Degrees, Position, Stand};
use crate::covariance::CovarianceModel;
use crate::covariance::full::FullCovariance;
use crate::error::Result;
use crate::evaluate::{Evaluation, Evaluator};
use crate::motion::Timeline;
use crate::observability::named::{PlatformAxis, Remedy};
use crate::platform::Repositioning;
use crate::schedule::{Schedule, ScheduledPosition};
use crate::units::{Angle, AngularRate, round_deg};
use crate::wording::{listed, number, seconds};

/// Distance of the attitudes that are tried, degrees.
const GRID_DEG: f64 = 60.0;
/// From the best of them in ever smaller steps, degrees.
const STEPS_DEG: [f64; 4] = [30.0, 15.0, 7.5, 2.5];
/// Rate of a turn where the platform gives none, °/s.
const RATE_DEG_PER_S: f64 = 1.0;
/// Turns that are tried, degrees.
const TURNS_DEG: [f64; 5] = [90.0, -90.0, 180.0, -180.0, 360.0];
/// Attitudes in which gimbal axes lie along axes of the platform, degrees.
const ALIGNED_DEG: [[f64; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [0.0, 0.0, 90.0],
    [90.0, 0.0, 0.0],
    [90.0, 0.0, 90.0],
];
/// Parameters that are said to gain.
const MOST_HELPED: usize = 6;
/// A σ that shrinks by less is not said to.
const HELPED: f64 = 1.02;

/// What an addition is rated by.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Aim {
    /// The σ of what the schedule does not tell and another might, geometric mean.
    Unobserved {
        /// The parameters.
        parameters: Vec<String>,
    },
    /// The criterion of the objective.
    Criterion,
}

/// What a turn is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum TurnAxis {
    /// The platform's x.
    PlatformX,
    /// The platform's y.
    PlatformY,
    /// The platform's z.
    PlatformZ,
    /// The outer gimbal, along no axis of the platform.
    OuterGimbal,
    /// The middle gimbal, along no axis of the platform.
    MiddleGimbal,
}

impl TurnAxis {
    /// Of gimbal `axis` (0 outer) at `position`; the inner one is along an axis of the platform.
    fn of(stand: &Stand, axis: usize, position: Position) -> Self {
        /// What counts as along an axis.
        const ALONG: f64 = 1.0 - 1e-9;
        let attitude = stand.attitude(position);
        let in_n = stand.rotation_axes(&attitude, position)[axis];
        let in_platform = attitude.matrix().transpose() * in_n;
        let along = PlatformAxis::ALL
            .into_iter()
            .zip(in_platform.iter())
            .find(|(_, part)| part.abs() >= ALONG);
        match along {
            Some((PlatformAxis::X, _)) => Self::PlatformX,
            Some((PlatformAxis::Y, _)) => Self::PlatformY,
            Some((PlatformAxis::Z, _)) => Self::PlatformZ,
            None if axis == 0 => Self::OuterGimbal,
            None => Self::MiddleGimbal,
        }
    }

    /// What it is, in words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::PlatformX => "the platform's x axis",
            Self::PlatformY => "the platform's y axis",
            Self::PlatformZ => "the platform's z axis",
            Self::OuterGimbal => "the outer gimbal's axis",
            Self::MiddleGimbal => "the middle gimbal's axis",
        }
    }
}

/// A turn of one gimbal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Turn {
    /// What it is about.
    pub about: TurnAxis,
    /// How far, degrees.
    pub degrees: f64,
    /// How fast, °/s.
    pub rate_deg_per_s: f64,
}

/// What an addition does for one parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Helped {
    /// `D_FX` ….
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// 1σ with the schedule as it is.
    pub sigma: f64,
    /// 1σ with the same time in longer dwells.
    pub sigma_same_time: f64,
    /// 1σ with the addition.
    pub sigma_after: f64,
}

/// Something to add at the end of a schedule, with what it does; its `Display` says so.
#[derive(Debug, Clone, PartialEq)]
pub struct Addition {
    /// The positions to add: one, or where a turn starts and ends.
    pub positions: Vec<ScheduledPosition>,
    /// The turn to the last of them; none: the position matters, not the way.
    pub turn: Option<Turn>,
    /// Duration of the test with it, s.
    pub total_time_s: f64,
    /// Value of the criterion with it.
    pub criterion: f64,
    /// The same with the same time in longer dwells.
    pub criterion_same_time: f64,
    /// How many times smaller than with the same time in longer dwells what it is rated by becomes.
    pub factor: f64,
    /// The parameters whose σ shrink most, most first.
    pub helps: Vec<Helped>,
}

impl fmt::Display for Addition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let at = |p: &ScheduledPosition| {
            let [a, b, c] = p.position.to_deg().map(|deg| format!("{:.3}", deg + 0.0));
            format!("alpha {a}, beta {b}, gamma {c} deg")
        };
        let held = |p: &ScheduledPosition| format!("{} for {} s", at(p), seconds(p.dwell_s));
        match (&self.turn, self.positions.as_slice()) {
            (Some(turn), [.., last]) => {
                if let [first, _] = self.positions.as_slice() {
                    write!(f, "hold {}, then ", held(first))?;
                }
                write!(
                    f,
                    "turn by {} deg about {} at {} deg/s and hold {}",
                    number(turn.degrees),
                    turn.about.name(),
                    number(turn.rate_deg_per_s),
                    held(last)
                )?;
            }
            (None, positions) => {
                let all: Vec<String> = positions.iter().map(held).collect();
                write!(f, "hold {}", all.join(", then "))?;
            }
            (Some(_), []) => f.write_str("nothing")?,
        }
        let helps: Vec<String> = self
            .helps
            .iter()
            .map(|h| {
                format!(
                    "{} from {} to {} {} (the time alone {})",
                    h.name,
                    number(h.sigma),
                    number(h.sigma_after),
                    h.unit,
                    number(h.sigma_same_time)
                )
            })
            .collect();
        match helps.is_empty() {
            true => f.write_str(": no parameter gains more than by the time alone"),
            false => write!(f, ": {}", listed(&helps)),
        }
    }
}

/// What to add to a schedule.
#[derive(Debug, Clone, PartialEq)]
pub struct Additions {
    /// What they are rated by.
    pub aim: Aim,
    /// The best position; none: no attitude can be taken.
    pub position: Option<Addition>,
    /// The best move; none: no gimbal can turn, or moves turn no torquer (frame-hold repositioning).
    pub turn: Option<Addition>,
    /// How many were tried.
    pub examined: usize,
}

impl Additions {
    /// The better of both.
    pub fn best(&self) -> Option<&Addition> {
        match (&self.position, &self.turn) {
            (Some(position), Some(turn)) => Some(if gains(turn.factor, position.factor) {
                turn
            } else {
                position
            }),
            (position, turn) => position.as_ref().or(turn.as_ref()),
        }
    }

    /// Of `schedule`, of which `evaluation` is the evaluation.
    ///
    /// # Errors
    ///
    /// [`NoSuggestion`]: why there is nothing.
    pub fn find(
        evaluator: &Evaluator,
        schedule: &Schedule,
        evaluation: &Evaluation,
    ) -> std::result::Result<Self, NoSuggestion> {
        let search = Search::new(evaluator, schedule, evaluation);
        let (position, of_positions) = search.best_position();
        let (turn, of_turns) = search.best_turn();
        let [position, turn] = [position, turn].map(|found| found.and_then(|f| search.told(f)));
        if position.is_none() && turn.is_none() {
            return Err(NoSuggestion::NotExecutable);
        }
        Ok(Self {
            aim: search.aim,
            position,
            turn,
            examined: of_positions + of_turns,
        })
    }
}

/// A candidate with its rating, the smaller the better.
struct Found {
    rating: f64,
    positions: Vec<ScheduledPosition>,
    turn: Option<Turn>,
}

/// Attitudes along the axes and of a grid over all that the gimbals allow, each once.
fn different_attitudes(
    stand: &Stand,
    axes: &[GimbalAxis; 3],
    position: impl Fn([i64; 3]) -> Position,
) -> Vec<[i64; 3]> {
    const QUARTERS_DEG: [f64; 4] = [0.0, 90.0, -90.0, 180.0];
    let along = axes.each_ref().map(|axis| {
        let quarters = QUARTERS_DEG.into_iter();
        quarters.filter_map(|deg| axis.setting(deg)).collect()
    });
    let spread = axes.each_ref().map(|axis| axis.grid(GRID_DEG));
    let mut seen = BTreeSet::new();
    let mut grid = Vec::new();
    for [alphas, betas, gammas] in [along, spread] {
        for &alpha in &alphas {
            for &beta in &betas {
                for &gamma in &gammas {
                    let at = [alpha, beta, gamma];
                    if seen.insert(stand.attitude_key(position(at))) {
                        grid.push(at);
                    }
                }
            }
        }
    }
    grid
}

struct Search<'a> {
    evaluator: &'a Evaluator,
    schedule: &'a Schedule,
    evaluation: &'a Evaluation,
    /// The time to add, s.
    dwell_s: f64,
    aim: Aim,
    /// Indices of the parameters aimed at; none: the criterion.
    aimed: Vec<usize>,
}

impl<'a> Search<'a> {
    fn new(evaluator: &'a Evaluator, schedule: &'a Schedule, evaluation: &'a Evaluation) -> Self {
        let parameters = &evaluation.parameters;
        let unobserved = evaluation.named.iter().flat_map(|n| &n.unobserved);
        let can_be_told = unobserved
            .filter(|u| matches!(u.remedy, Remedy::Slews { .. } | Remedy::OtherPositions));
        let names: Vec<&str> = can_be_told
            .flat_map(|u| &u.rests_on_priors)
            .filter(|p| p.share_of_prior > 0.5)
            .map(|p| p.name)
            .collect();
        let aimed: Vec<usize> = (0..parameters.len())
            .filter(|&k| names.contains(&parameters[k].parameter.name))
            .collect();
        let aim = match aimed.as_slice() {
            [] => Aim::Criterion,
            aimed => Aim::Unobserved {
                parameters: aimed
                    .iter()
                    .map(|&k| parameters[k].parameter.name.to_owned())
                    .collect(),
            },
        };
        Self {
            dwell_s: new_dwell_s(evaluator.test().platform(), schedule),
            evaluator,
            schedule,
            evaluation,
            aim,
            aimed,
        }
    }

    fn model(&self) -> &CovarianceModel {
        self.evaluator.model()
    }

    fn with(&self, added: &[ScheduledPosition]) -> Result<Timeline> {
        let all = self.schedule.positions().iter().chain(added).copied();
        Timeline::new(self.evaluator.test(), &Schedule::new(all.collect())?)
    }

    /// What a truth is rated by: a logarithm.
    fn rating(&self, truth: &FullCovariance) -> Result<f64> {
        if self.aimed.is_empty() {
            return Ok(libm::log(self.evaluator.criterion_of(truth)?));
        }
        let sigma = truth.sigma();
        let logs = self.aimed.iter().map(|&k| libm::log(sigma[k]));
        Ok(logs.sum::<f64>() / self.aimed.len() as f64)
    }

    /// The rating of the schedule with these; none: it cannot be run or worked out.
    fn rated(&self, added: &[ScheduledPosition]) -> Option<f64> {
        let timeline = self.with(added).ok()?;
        self.rating(&self.model().truth(&timeline).ok()?).ok()
    }

    /// The best position and how many were tried.
    fn best_position(&self) -> (Option<Found>, usize) {
        let platform = self.evaluator.test().platform();
        let axes: [GimbalAxis; 3] = std::array::from_fn(|i| GimbalAxis::new(platform, i));
        let position = |at: [i64; 3]| {
            let deg: [f64; 3] = std::array::from_fn(|i| round_deg(axes[i].tidy(at[i])));
            let place = Position::from_deg(deg[0], deg[1], deg[2]);
            ScheduledPosition::new(place, self.dwell_s)
        };
        let grid = different_attitudes(self.evaluator.test().platform().stand(), &axes, |at| {
            position(at).position
        });
        let rated: Vec<Option<f64>> = grid
            .par_iter()
            .map(|&at| self.rated(&[position(at)]))
            .collect();
        let mut examined = grid.len();
        let mut best: Option<(f64, [i64; 3])> = None;
        let better = |rating: f64, best: &Option<(f64, [i64; 3])>| {
            best.is_none_or(|(least, _)| gains(-rating, -least))
        };
        for (rating, &at) in rated.into_iter().zip(&grid) {
            if let Some(rating) = rating
                && better(rating, &best)
            {
                best = Some((rating, at));
            }
        }
        for step_deg in STEPS_DEG {
            let Some((_, from)) = best else { break };
            let around: Vec<[i64; 3]> = (0..3)
                .flat_map(|i| [1, -1].map(|sign| (i, sign * axes[i].steps(step_deg))))
                .filter_map(|(i, by)| {
                    let mut at = from;
                    at[i] = axes[i].moved(from[i], by)?;
                    Some(at)
                })
                .collect();
            examined += around.len();
            let rated: Vec<Option<f64>> = around
                .par_iter()
                .map(|&at| self.rated(&[position(at)]))
                .collect();
            for (rating, at) in rated.into_iter().zip(around) {
                if let Some(rating) = rating
                    && better(rating, &best)
                {
                    best = Some((rating, at));
                }
            }
        }
        let found = best.map(|(rating, at)| Found {
            rating,
            positions: vec![position(at)],
            turn: None,
        });
        let second: Vec<ScheduledPosition> = grid.into_iter().map(position).collect();
        examined += second.len();
        (
            found.map(|first| self.better_of_two(first, &second)),
            examined,
        )
    }

    /// A position, or in the same time that and one of `second`, where it is better: a turn has two
    /// attitudes as well.
    fn better_of_two(&self, first: Found, second: &[ScheduledPosition]) -> Found {
        let period = self.evaluator.test().platform().period_s();
        let dwell_s = (0.5 * self.dwell_s / period).round().max(3.0) * period;
        let both = |p: &ScheduledPosition| {
            [first.positions[0], *p].map(|p| ScheduledPosition { dwell_s, ..p })
        };
        let rated: Vec<Option<f64>> = second.par_iter().map(|p| self.rated(&both(p))).collect();
        let mut best = (first.rating, None);
        for (rating, p) in rated.into_iter().zip(second) {
            if let Some(rating) = rating
                && gains(-rating, -best.0)
            {
                best = (rating, Some(both(p)));
            }
        }
        match best {
            (rating, Some(positions)) => Found {
                rating,
                positions: positions.to_vec(),
                turn: None,
            },
            _ => first,
        }
    }

    /// The best turn and how many were tried.
    fn best_turn(&self) -> (Option<Found>, usize) {
        let platform = self.evaluator.test().platform();
        if platform.motion().repositioning == Repositioning::FrameHold {
            return (None, 0);
        }
        let positions = self.schedule.positions();
        let last = positions[positions.len() - 1].position;
        let aligned = ALIGNED_DEG.map(|[a, b, c]| Position::from_deg(a, b, c));
        let starts = std::iter::once(None).chain(aligned.into_iter().map(Some));
        let mut all = Vec::new();
        for start in starts {
            for axis in 0..3 {
                for degrees in TURNS_DEG {
                    all.push(self.turn(start, last, axis, degrees));
                }
            }
        }
        let rated: Vec<Option<f64>> = all
            .par_iter()
            .map(|(positions, _)| self.rated(positions))
            .collect();
        let examined = all.len();
        let mut best: Option<Found> = None;
        for (rating, (positions, turn)) in rated.into_iter().zip(all) {
            let Some(rating) = rating else { continue };
            if best.as_ref().is_none_or(|b| gains(-rating, -b.rating)) {
                best = Some(Found {
                    rating,
                    positions,
                    turn: Some(turn),
                });
            }
        }
        (best, examined)
    }

    /// A turn of gimbal `axis` from `start`, or from where the schedule ends.
    fn turn(
        &self,
        start: Option<Position>,
        last: Position,
        axis: usize,
        degrees: f64,
    ) -> (Vec<ScheduledPosition>, Turn) {
        let platform = self.evaluator.test().platform();
        let from = start.unwrap_or(last);
        let slew = platform.motion().slew;
        let mut change = [0.0; 3];
        change[axis] = degrees;
        let rate_deg_per_s = slew.map_or(RATE_DEG_PER_S, |slew| {
            AngularRate::from_rad_per_s(slew.rate_rad_per_s[axis]).deg_per_s()
        });
        let move_s = match slew {
            Some(slew) => slew.shortest_s(&change.map(|deg| Angle::from_deg(deg).rad())),
            None => degrees.abs() / rate_deg_per_s,
        };
        // The turn is part of the time that is added.
        let period = platform.period_s();
        let parts = if start.is_some() { 2.0 } else { 1.0 };
        let share = (self.dwell_s - move_s) / parts;
        let dwell_s = (share / period).round().max(3.0) * period;
        let mut to = from.to_deg();
        to[axis] = round_deg(to[axis] + degrees);
        let range = platform.gimbals().ranges[axis];
        if range.is_none() {
            to[axis] = Degrees::new(to[axis]).wrapped().deg();
        }
        let mut positions = Vec::new();
        positions.extend(start.map(|start| ScheduledPosition::new(start, dwell_s)));
        positions.push(ScheduledPosition {
            // The platform's own rate, where it has one.
            move_s: slew.is_none().then_some(move_s),
            change_deg: Some(change),
            ..ScheduledPosition::new(Position::from_deg(to[0], to[1], to[2]), dwell_s)
        });
        let turn = Turn {
            about: TurnAxis::of(self.evaluator.test().platform().stand(), axis, from),
            degrees,
            rate_deg_per_s,
        };
        (positions, turn)
    }

    /// What one does, beside the same time in longer dwells; none: that cannot be worked out.
    fn told(&self, found: Found) -> Option<Addition> {
        let timeline = self.with(&found.positions).ok()?;
        let after = self.model().truth(&timeline).ok()?;
        let total_time_s = timeline.total_time_s();
        let dwells_s = total_time_s - self.evaluation.overhead_s;
        let longer = stretched(self.schedule, dwells_s).ok()?;
        let longer = Timeline::new(self.evaluator.test(), &longer).ok()?;
        let same_time = self.model().truth(&longer).ok()?;
        let [sigma_after, sigma_same] = [&after, &same_time].map(FullCovariance::sigma);
        let mut helps: Vec<(f64, Helped)> = self
            .evaluation
            .parameters
            .iter()
            .zip(sigma_after.iter().zip(&sigma_same))
            .map(|(p, (after, same))| {
                let helped = Helped {
                    name: p.parameter.name.to_owned(),
                    unit: p.parameter.unit.name().to_owned(),
                    sigma: p.sigma,
                    sigma_same_time: *same,
                    sigma_after: *after,
                };
                (same / after, helped)
            })
            .filter(|(ratio, _)| *ratio >= HELPED)
            .collect();
        helps.sort_by(|a, b| b.0.total_cmp(&a.0));
        helps.truncate(MOST_HELPED);
        Some(Addition {
            factor: libm::exp(self.rating(&same_time).ok()? - self.rating(&after).ok()?),
            criterion: self.evaluator.criterion_of(&after).ok()?,
            criterion_same_time: self.evaluator.criterion_of(&same_time).ok()?,
            helps: helps.into_iter().map(|(_, helped)| helped).collect(),
            positions: found.positions,
            turn: found.turn,
            total_time_s,
        })
    }
}
