//! The scheme that one has: where a search begins, and what of it stays.
//!
//! The scheme is one of the starts, and in the end it stands beside what was found, as it was given:
//! the result is never worse than it (`hold_the_promise`), unless it is beyond the limits that the
//! search keeps to (`StartingScheme::beyond`). Then its nearest allowed form is a start all the same.
//!
//! A **pinned** position keeps its angles, as they are written, and its place among the pinned ones;
//! a pinned first position stays first and a pinned last one last (a single one: first). Dwells are free, no shorter than the shortest
//! dwell. What is free comes before, between and behind them.
//!
//! With a [`Freedom`] of less than everything all positions stay (`super::only`).

use std::fmt;

use super::context::WorkDone;
use super::fit::brought_within;
use super::plan::{Pin, Plan, TIME_SLACK};
use super::problem::{SearchOutcome, SearchProblem};
use super::progress::Control;
use super::propose::within_ranges;
use super::reason::Reason;
use super::{Status, conclude};
use crate::attitude::{Degrees, Position};
use crate::error::{Error, Result};
use crate::evaluate::{Evaluation, Evaluator};
use crate::motion::{Test, Timeline, clear_ways, quickest_positions_but};
use crate::platform::Platform;
use crate::schedule::{Schedule, ScheduledPosition};
use crate::wording::{listed, seconds};

/// Most positions of a scheme that a search can begin with.
pub const MOST_POSITIONS: usize = 500;

/// What a search may change of the scheme it begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Freedom {
    /// Everything but what is pinned.
    #[default]
    Everything,
    /// Only how long the positions are held.
    Dwells,
    /// Only the order of the positions, and which way round the gimbals turn.
    Order,
    /// Both.
    DwellsAndOrder,
}

impl Freedom {
    /// Whether dwells may change.
    pub(crate) const fn dwells(self) -> bool {
        !matches!(self, Self::Order)
    }

    /// Whether the order may change.
    pub(crate) const fn order(self) -> bool {
        !matches!(self, Self::Dwells)
    }

    /// Whether angles and number of positions may change.
    pub(crate) const fn positions(self) -> bool {
        matches!(self, Self::Everything)
    }

    /// What alone may change, as options and documents name it; empty: everything may.
    pub const fn names(self) -> &'static [&'static str] {
        match self {
            Self::Everything => &[],
            Self::Dwells => &["dwells"],
            Self::Order => &["order"],
            Self::DwellsAndOrder => &["dwells", "order"],
        }
    }
}

/// A scheme that a search begins with.
#[derive(Debug, Clone, PartialEq)]
pub struct StartingScheme {
    /// What it is called: its file, for example.
    pub name: String,
    /// The scheme.
    pub schedule: Schedule,
    /// What may be changed of it.
    pub freedom: Freedom,
}

impl StartingScheme {
    /// A scheme, of which everything may change but what it pins.
    pub fn new(name: impl Into<String>, schedule: Schedule) -> Self {
        Self {
            name: name.into(),
            schedule,
            freedom: Freedom::Everything,
        }
    }

    /// The same, of which only so much may change.
    #[must_use]
    pub fn only(mut self, freedom: Freedom) -> Self {
        self.freedom = freedom;
        self
    }

    fn positions(&self) -> &[ScheduledPosition] {
        self.schedule.positions()
    }

    /// Numbers of the pinned positions, from 0.
    pub(crate) fn pinned(&self) -> impl Iterator<Item = usize> + '_ {
        let all = self.positions().iter().enumerate();
        all.filter(|(_, p)| p.pinned).map(|(k, _)| k)
    }

    /// Whether position `index` keeps its angles.
    fn is_held(&self, index: usize) -> bool {
        !self.freedom.positions() || self.positions()[index].pinned
    }

    /// Refuses a scheme that `problem` cannot begin with.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] for too many positions, for a position that has to stay and that the platform
    /// cannot take or is reached by a move of its own, and for tumbling where positions have to stay;
    /// [`Error::is_infeasible`] where those leave no time.
    pub(crate) fn check(&self, test: &Test, problem: &SearchProblem) -> Result<()> {
        let positions = self.positions();
        let count = positions.len();
        if count > MOST_POSITIONS {
            return Err(
                Error::input("too many positions for a search to begin with")
                    .with_key("positions")
                    .with_value(format!("{count} positions"))
                    .with_allowed(format!("1 to {MOST_POSITIONS} positions")),
            );
        }
        let held: Vec<usize> = (0..count).filter(|k| self.is_held(*k)).collect();
        if held.is_empty() {
            return Ok(());
        }
        if problem.allow_tumbling {
            return Err(Error::input(
                "positions that stay as they are do not turn while they are held",
            )
            .with_key("search.allow_tumbling")
            .with_value(true)
            .with_allowed("false, or no pinned positions and no --only"));
        }
        for &k in &held {
            let own = [
                ("move_s", positions[k].move_s.is_some()),
                ("move_measured", positions[k].move_measured.is_some()),
            ];
            if let Some((name, _)) = own.into_iter().find(|(_, given)| *given) {
                return Err(
                    Error::input("a position that stays is reached as the platform moves")
                        .with_key(format!("positions[{k}].{name}"))
                        .with_hint("leave it out, or let the search change the position"),
                );
            }
        }
        // As given: so that what is refused is said of the position's own number.
        let still = |k: usize| ScheduledPosition {
            change_deg: positions[k]
                .change_deg
                .filter(|_| !self.freedom.positions()),
            ..ScheduledPosition::new(positions[k].position, 0.0)
        };
        let mut all: Vec<_> = (0..count)
            .map(|k| match self.is_held(k) {
                true => still(k),
                false => still(held[0]),
            })
            .collect();
        // Where the short way is blocked another one may not be.
        let entries: Vec<_> = all.iter().map(|p| (p.position, p.change_deg)).collect();
        for (p, way) in all
            .iter_mut()
            .zip(clear_ways(test, entries.into_iter()).into_iter().flatten())
        {
            p.change_deg = way.map(|way| way.map(Degrees::deg)).or(p.change_deg);
        }
        Timeline::new(test, &Schedule::new(all)?)?;
        if self.freedom == Freedom::Order {
            // Dwells that stay take their time in whatever order.
            return Ok(());
        }
        let pinned = self.pinned().count();
        if self.freedom.positions() && pinned > problem.max_positions {
            return Err(Error::input("more positions are pinned than there may be")
                .with_key("search.max_positions")
                .with_value(problem.max_positions)
                .with_allowed(format!("{pinned} or more")));
        }
        let least = self.held_alone(test);
        let total_s = least.timeline(test).total_time_s();
        if self.freedom != Freedom::DwellsAndOrder
            && total_s > problem.total_time_s * (1.0 + TIME_SLACK)
        {
            return Err(
                Error::infeasible("the positions that have to stay do not fit into the time")
                    .with_key("objective.total_time_s")
                    .with_value(problem.total_time_s)
                    .with_allowed(format!(
                        "at least {total_s:.3} s for {} of them with moves, settles and the shortest dwells",
                        held.len()
                    )),
            );
        }
        Ok(())
    }

    /// The positions that stay, each held for the shortest dwell.
    fn held_alone(&self, test: &Test) -> Plan {
        let mut plan = self.plan(test);
        for k in (0..plan.angles.len()).rev() {
            if !plan.is_held(k) {
                plan.remove(k);
            }
        }
        plan.dwell_s.fill(test.platform().shortest_dwell_s());
        plan
    }

    /// The scheme as a plan of positions that the platform can take, dwells as they are.
    pub(super) fn plan(&self, test: &Test) -> Plan {
        let platform = test.platform();
        let positions = self.positions();
        let reachable = |k: usize| match self.is_held(k) {
            true => positions[k].position,
            false => reachable(platform, positions[k].position),
        };
        let angles: Vec<Position> = (0..positions.len()).map(reachable).collect();
        let dwell_s = positions.iter().map(|p| p.dwell_s).collect();
        let mut plan = Plan::new(angles.iter().map(|p| p.to_array()).collect(), dwell_s);
        for (k, p) in positions.iter().enumerate() {
            let same =
                angles[k] == p.position && (k == 0 || angles[k - 1] == positions[k - 1].position);
            plan.ways[k] = p
                .change_deg
                .filter(|_| same)
                .map(|deg| deg.map(f64::to_radians));
            plan.pins[k] = self.is_held(k).then_some(Pin {
                index: k,
                position: p.position,
                pinned: p.pinned,
            });
        }
        plan
    }

    /// The scheme as a start of a search in so much time; none where it comes to nothing.
    pub(super) fn start(&self, test: &Test, total_time_s: f64) -> Option<Plan> {
        brought_within(test, &self.plan(test), |plan| {
            plan.fitted(test, total_time_s)
        })
    }

    /// `plan` with the pinned positions among its own, as many as may be; none where that does not fit
    /// into the time.
    pub(super) fn among(&self, test: &Test, problem: &SearchProblem, plan: &Plan) -> Option<Plan> {
        let pins = self.held_alone(test);
        let count = pins.angles.len();
        let last = self.positions().len() - 1;
        let free = plan
            .angles
            .len()
            .min(problem.max_positions.saturating_sub(count));
        let (first_stays, last_stays) = (self.is_held(0), last > 0 && self.is_held(last));
        // Evenly between the pinned ones, before the first and behind the last where those are free.
        let gaps = count + 1 - usize::from(first_stays) - usize::from(last_stays);
        let mut merged = pins.clone();
        let dwell_s = problem.total_time_s / (count + free) as f64;
        merged.dwell_s.fill(dwell_s);
        for k in (0..if gaps > 0 { free } else { 0 }).rev() {
            let gap = k * gaps / free + usize::from(first_stays);
            merged.insert(gap, plan.angles[k], dwell_s);
        }
        let positions: Vec<Position> = (merged.angles.iter())
            .map(|a| Position::from_array(*a))
            .collect();
        let quickest = quickest_positions_but(test, &positions, &|k| merged.is_held(k));
        merged.set_positions(quickest);
        let full = |plan: Plan| plan.fitted(test, problem.total_time_s);
        let with_room = |plan: Plan| plan.fitted(test, 0.95 * problem.total_time_s);
        brought_within(test, &merged, with_room).or_else(|| brought_within(test, &merged, full))
    }

    /// In what the scheme goes beyond what a search keeps to; empty where in nothing.
    pub(crate) fn beyond(&self, test: &Test, problem: &SearchProblem) -> Vec<String> {
        let timeline = match Timeline::new(test, &self.schedule) {
            Ok(timeline) => timeline,
            Err(e) => return vec![e.to_string()],
        };
        let mut beyond = Vec::new();
        let (taken_s, most_s) = (timeline.total_time_s(), problem.total_time_s);
        if taken_s > most_s * (1.0 + 1e-9) {
            beyond.push(format!(
                "it takes {} s, more than objective.total_time_s = {} s",
                seconds(taken_s),
                seconds(most_s)
            ));
        }
        let least_s = test.platform().motion().min_dwell_s;
        let positions = || self.positions().iter().enumerate();
        let numbers = |of: &dyn Fn(usize, &ScheduledPosition) -> bool| -> Vec<String> {
            let those = positions().filter(|(k, p)| of(*k, p));
            those.map(|(k, _)| (k + 1).to_string()).collect()
        };
        let turns = |k: usize| {
            self.positions()
                .get(k)
                .is_some_and(|p| p.move_measured == Some(true))
        };
        // Where a turn that is measured begins or ends, no dwell is needed.
        let short = numbers(&|k, p| {
            let turning = p.dwell_s == 0.0 && (turns(k) || turns(k + 1));
            p.dwell_s < least_s * (1.0 - 1e-9) && !turning
        });
        if !short.is_empty() {
            beyond.push(format!(
                "shorter than motion.min_dwell_s = {} s is the dwell of position {}",
                seconds(least_s),
                listed(&short)
            ));
        }
        let turning = numbers(&|_, p| p.move_measured == Some(true));
        if !problem.allow_tumbling && !turning.is_empty() && !test.platform().motion().measure_moves
        {
            beyond.push(format!(
                "the filter measures during the move to position {}, and search.allow_tumbling = false",
                listed(&turning)
            ));
        }
        let count = self.positions().len() - turning.len();
        if self.freedom.positions() && count > problem.max_positions {
            beyond.push(format!(
                "it has {count} positions, more than search.max_positions = {}",
                problem.max_positions
            ));
        }
        beyond
    }
}

/// The same attitude by angles that the platform can take, or else the nearest of each axis.
fn reachable(platform: &Platform, position: Position) -> Position {
    if let Some(same) = within_ranges(platform, position) {
        return same;
    }
    let angles = position.to_array();
    Position::from_array(std::array::from_fn(|axis| {
        match platform.gimbals().ranges[axis] {
            Some(r) => angles[axis].clamp(r.low_rad, r.high_rad),
            None => angles[axis],
        }
    }))
}

impl SearchProblem {
    /// Whether a plan keeps what is pinned, and where.
    pub(super) fn admits(&self, plan: &Plan) -> bool {
        let Some(from) = &self.from else {
            return true;
        };
        let last = from.positions().len() - 1;
        let pinned = |k: usize| from.positions()[k].pinned;
        let index = |pin: &Option<Pin>| pin.map(|pin| pin.index);
        let at = |pin: Option<&Option<Pin>>| pin.and_then(index);
        let there = plan.pins.iter().filter_map(index).filter(|k| pinned(*k));
        there.eq(from.pinned())
            && (!pinned(0) || at(plan.pins.first()) == Some(0))
            && (last == 0 || !pinned(last) || at(plan.pins.last()) == Some(last))
    }
}

/// What came of the scheme that a search began with.
#[derive(Debug, Clone, PartialEq)]
pub struct Given {
    /// What it reaches as it is; none where the platform cannot run it.
    pub evaluation: Option<Evaluation>,
    /// In what it goes beyond what the search keeps to: there, nothing is promised.
    pub beyond: Vec<String>,
    /// Whether nothing better was found, and the result is the scheme as it was given.
    pub is_the_result: bool,
}

impl Given {
    /// Of the scheme of a problem; none without one.
    pub(super) fn of(evaluator: &Evaluator, problem: &SearchProblem) -> Result<Option<Self>> {
        let Some(from) = &problem.from else {
            return Ok(None);
        };
        let can_be_run = Timeline::new(evaluator.test(), &from.schedule).is_ok();
        let evaluation = can_be_run.then(|| evaluator.evaluate(&from.schedule));
        Ok(Some(Self {
            evaluation: evaluation.transpose()?,
            beyond: from.beyond(evaluator.test(), problem),
            is_the_result: false,
        }))
    }

    /// Its evaluation where the result has to be as good.
    pub(super) fn to_beat(&self) -> Option<&Evaluation> {
        self.evaluation.as_ref().filter(|_| self.beyond.is_empty())
    }
}

/// The outcome with what came of the scheme that the search began with; where that is better as it is, by
/// `is_better(scheme, found)`, it is the result.
pub(super) fn hold_the_promise(
    evaluator: &Evaluator,
    problem: &SearchProblem,
    control: &Control,
    work: &WorkDone,
    mut outcome: SearchOutcome,
    is_better: impl Fn(&Evaluation, &Evaluation) -> bool,
) -> Result<SearchOutcome> {
    let Some(mut given) = Given::of(evaluator, problem)? else {
        return Ok(outcome);
    };
    if let Some(from) = &problem.from
        && given
            .to_beat()
            .is_some_and(|s| is_better(s, &outcome.evaluation))
    {
        outcome = conclude(evaluator, control, work, from.schedule.clone())?;
        given.is_the_result = true;
    }
    outcome.from = Some(given);
    Ok(outcome)
}

/// Whether the one schedule has the better score: the least separability first, where one is asked for.
///
/// The weights are those of `searched`: where the criterion is 0 whatever the schedule, the search goes by
/// the separability alone.
pub(super) fn scores_better(searched: &Evaluator, one: &Evaluation, other: &Evaluation) -> bool {
    let score = |e: &Evaluation| match searched.objective().covariance_weight > 0.0 {
        true => e.score.value,
        false => e.score.separability_part,
    };
    match (
        one.score.meets_minimum_separability,
        other.score.meets_minimum_separability,
    ) {
        (true, false) => true,
        (false, true) => false,
        _ => score(one) < score(other),
    }
}

/// Whether the one schedule meets its specification in less time, or is nearer to it.
pub(super) fn is_sooner(searched: &Evaluator, one: &Evaluation, other: &Evaluation) -> bool {
    let meets = |e: &Evaluation| e.score.criterion <= 1.0 && e.score.meets_minimum_separability;
    match (meets(one), meets(other)) {
        (true, true) => one.total_time_s < other.total_time_s,
        (false, false) => scores_better(searched, one, other),
        (one, _) => one,
    }
}

/// The reason of a shortest test that meets its specification.
pub(super) fn specification_met(outcome: &mut SearchOutcome) {
    if outcome.status == Status::Converged && outcome.evaluation.score.criterion <= 1.0 {
        outcome.reason = Reason::SpecificationMet {
            total_time_s: outcome.evaluation.total_time_s,
            largest_ratio: outcome.evaluation.score.criterion,
        };
    }
}

impl fmt::Display for Freedom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Everything => "everything but pinned positions",
            Self::Dwells => "dwells alone",
            Self::Order => "the order alone",
            Self::DwellsAndOrder => "dwells and order alone",
        })
    }
}
