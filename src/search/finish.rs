//! Working a start out to the end: allocate, drop, refine, round.

use super::allocate::allocate;
use super::context::Context;
use super::fit::brought_within;
use super::plan::Plan;
use super::plan::TIME_SLACK;
use super::rated::{Candidate, Refined, rate};
use super::refine::{refine, refine_angles};
use super::together::refine_all;
use super::workshop::Workshop;
use crate::attitude::{Position, decimal, deg_of_rad};
use crate::criterion::Smoothing;
use crate::motion::Test;
use crate::platform::{Platform, multiples};
use crate::schedule::periods;

/// L-BFGS iterations of a full refinement.
const FULL_ITERATIONS: u64 = 400;
/// L-BFGS iterations that show whether a proposal leads somewhere.
const TRIAL_ITERATIONS: u64 = 60;
/// L-BFGS iterations that a plan with one position fewer gets to make up for it.
const REMOVAL_ITERATIONS: u64 = 40;
/// Rounds of allocation and refinement.
const ROUNDS: usize = 3;
/// Power of the last power mean, within 0.9 % of the maximum at worst.
pub(super) const SHARPEST: f64 = 144.0;
/// Angles of a recommended schedule are multiples of this, degrees.
const ANGLE_STEP_DEG: f64 = 1e-3;

/// Work on angles that can be set freely.
pub(super) struct FreeAngles;

impl Workshop for FreeAngles {
    fn try_out(
        &self,
        context: Context<'_>,
        plans: Vec<Plan>,
        smoothing: Smoothing,
    ) -> Vec<Option<Refined>> {
        refine_all(context, plans, smoothing, TRIAL_ITERATIONS)
    }

    fn work_out(&self, context: Context<'_>, plan: Refined, smoothing: Smoothing) -> Refined {
        let better = refine(context, &plan.plan, smoothing, FULL_ITERATIONS);
        better.filter(|r| r.merit < plan.merit).unwrap_or(plan)
    }

    fn settle(&self, context: Context<'_>, plan: &Plan, smoothing: Smoothing) -> Option<Refined> {
        // A plan without spare time has no variables to refine.
        let current = refine(context, plan, smoothing, FULL_ITERATIONS)
            .or_else(|| rate(context, plan, smoothing))?;
        if context.must_stop() {
            return Some(current);
        }
        let current = settle_allocation(context, smoothing, current);
        Some(drop_idle(context, smoothing, current))
    }

    fn polish(&self, context: Context<'_>, mut current: Refined) -> Option<Candidate> {
        if context.evaluator.objective().criterion.has_kinks() {
            current = towards_the_kink(context, current);
        }
        round(context, &current.plan)
    }

    fn admit(&self, context: Context<'_>, plan: Plan) -> Plan {
        let (test, total_time_s) = (context.evaluator.test(), context.problem.total_time_s);
        if plan.clone().fitted(test, total_time_s).is_some() {
            return plan;
        }
        let with_room = |plan: Plan| plan.fitted(test, 0.95 * total_time_s);
        brought_within(test, &plan, with_room).unwrap_or(plan)
    }
}

/// From the power mean towards the criterion itself: ever sharper means, each from the last, and
/// of all of them the plan that is best by the criterion. The sharper the mean the harder it is to
/// refine, so the sharpest is not always the one.
pub(super) fn towards_the_kink(context: Context<'_>, mut current: Refined) -> Refined {
    let exact = |plan: &Plan| rate(context, plan, Smoothing::Exact);
    let mut best = exact(&current.plan);
    for power in [16.0, 48.0, SHARPEST, 432.0, 1296.0, 3888.0] {
        if context.must_stop() {
            break;
        }
        let smoothing = Smoothing::PowerMean(power);
        let Some(sharper) = refine(context, &current.plan, smoothing, FULL_ITERATIONS) else {
            break;
        };
        current = sharper;
        let found = exact(&current.plan);
        if let Some(found) = found
            && best.as_ref().is_none_or(|b| found.merit < b.merit)
        {
            best = Some(found);
        }
    }
    best.unwrap_or(current)
}

/// Allocation and refinement in turn until neither helps.
pub(super) fn settle_allocation(
    context: Context<'_>,
    smoothing: Smoothing,
    mut current: Refined,
) -> Refined {
    for _ in 0..ROUNDS {
        if context.must_stop() {
            break;
        }
        let before = current.merit;
        current = allocate(context, current, smoothing);
        let refined = refine(context, &current.plan, smoothing, FULL_ITERATIONS);
        if let Some(refined) = refined.filter(|r| r.merit < current.merit) {
            current = refined;
        }
        if before - current.merit < 1e-7 {
            break;
        }
    }
    current
}

/// Removes positions one by one, the most idle first, as long as the merit loses less than the
/// tolerance by it.
fn drop_idle(context: Context<'_>, smoothing: Smoothing, mut current: Refined) -> Refined {
    let (test, problem) = (context.evaluator.test(), context.problem);
    while current.plan.angles.len() > 1 && !context.must_stop() {
        let without = |k| {
            let fewer = current.plan.without(k);
            fewer.fitted(test, problem.total_time_s)
        };
        let free = (0..current.plan.angles.len()).filter(|k| !current.plan.is_held(*k));
        let fewer = free.filter_map(without).collect();
        let candidates = refine_all(context, fewer, smoothing, REMOVAL_ITERATIONS);
        let Some(best) = candidates.into_iter().flatten().reduce(Refined::better) else {
            break;
        };
        let best = refine(context, &best.plan, smoothing, FULL_ITERATIONS).unwrap_or(best);
        let too_many = current.plan.angles.len() > problem.max_positions;
        if best.merit - current.merit > problem.position_tolerance && !too_many {
            break;
        }
        current = best;
    }
    current
}

/// Rounds angles and dwells, refining the angles once more between where moves take no time.
fn round(context: Context<'_>, plan: &Plan) -> Option<Candidate> {
    let evaluator = context.evaluator;
    let test = evaluator.test();
    let total_time_s = context.problem.total_time_s;
    let mut plan = rounded_to_fit(test, plan, total_time_s)?;
    if test.platform().motion().slew.is_none() {
        // The dwells are final now; the angles settle around them. Where moves take time this
        // could lengthen them beyond the total time.
        let smoothing = match evaluator.objective().criterion.has_kinks() {
            true => Smoothing::PowerMean(SHARPEST),
            false => Smoothing::Exact,
        };
        let refined = refine_angles(context, &plan, smoothing, FULL_ITERATIONS);
        if let Some(refined) = refined {
            let settled = rounded(test.platform(), &refined.plan);
            // Where the criterion has a kink, the smooth form that was refined may be worse by it.
            if exact_merit(context, &settled) < exact_merit(context, &plan) {
                plan = settled;
            }
        }
    }
    final_figures(context, shift_periods(context, best_ways(context, plan)))
}

/// By how much the moves of a plan are shortened, in turn, until it fits when rounded.
const SHORTER_BY: [f64; 9] = [0.0, 1e-6, 4e-6, 1.6e-5, 6.4e-5, 2.5e-4, 1e-3, 4e-3, 1.6e-2];

/// Angles and dwells rounded. Where every dwell is at its minimum and the moves take all that is
/// left, rounding may lengthen them beyond the total time by some milliseconds; then the moves are
/// shortened by as little as it takes. Where that is not enough, because a start off the steps
/// leaves no time to turn to one, the angles stay as they are.
fn rounded_to_fit(test: &Test, plan: &Plan, total_time_s: f64) -> Option<Plan> {
    let as_rounded = SHORTER_BY.into_iter().find_map(|share| {
        let plan = match share > 0.0 {
            true => plan.with_shorter_moves(test, share),
            false => plan.clone(),
        };
        with_whole_periods(test, &rounded(test.platform(), &plan), total_time_s)
    });
    as_rounded.or_else(|| with_whole_periods(test, plan, total_time_s))
}

/// Ways turned the other way round as long as the criterion gets better by it and the test no
/// longer: a half turn is as long either way.
pub(super) fn best_ways(context: Context<'_>, mut plan: Plan) -> Plan {
    let test = context.evaluator.test();
    let total_time_s = plan.timeline(test).total_time_s();
    let mut merit = exact_merit(context, &plan);
    for _ in 0..3 * plan.angles.len() {
        let others = plan.other_ways(test).into_iter();
        let as_short =
            others.filter(|p| p.timeline(test).total_time_s() <= total_time_s * (1.0 + 1e-12));
        let rated = as_short.map(|p| (exact_merit(context, &p), p));
        match rated.reduce(|best, p| if p.0 < best.0 { p } else { best }) {
            Some((better, other)) if better < merit - 1e-9 && !context.must_stop() => {
                (merit, plan) = (better, other);
            }
            _ => break,
        }
    }
    plan
}

/// Moves of a period from one dwell to another, at most.
const SHIFTS: usize = 60;
/// Plans of more positions than this keep their rounded dwells: the pairs grow with the square.
const MOST_SHIFTED: usize = 40;

/// Moves single periods from dwell to dwell as long as the criterion gets better by it: what
/// rounding has cost is won back.
fn shift_periods(context: Context<'_>, mut plan: Plan) -> Plan {
    let platform = context.evaluator.test().platform();
    let (period_s, shortest_s) = (platform.period_s(), platform.shortest_dwell_s());
    let count = plan.dwell_s.len();
    if count > MOST_SHIFTED {
        return plan;
    }
    let mut merit = exact_merit(context, &plan);
    for _ in 0..SHIFTS {
        let mut best: Option<(f64, Plan)> = None;
        for from in (0..count).filter(|k| plan.dwell_s[*k] - period_s >= shortest_s) {
            for to in (0..count).filter(|to| *to != from) {
                let mut shifted = plan.clone();
                shifted.dwell_s[from] -= period_s;
                shifted.dwell_s[to] += period_s;
                let shifted_merit = exact_merit(context, &shifted);
                if shifted_merit < best.as_ref().map_or(merit - 1e-9, |b| b.0) {
                    best = Some((shifted_merit, shifted));
                }
            }
        }
        match best {
            Some((better, shifted)) if !context.must_stop() => (merit, plan) = (better, shifted),
            _ => break,
        }
    }
    plan
}

/// The merit of a finished plan by the criterion itself; infinite where it has none.
fn exact_merit(context: Context<'_>, plan: &Plan) -> f64 {
    context.work.count_evaluations(1);
    let test = context.evaluator.test();
    let timeline = plan.timeline(test);
    if !timeline.is_clear(test.platform()) {
        return f64::INFINITY;
    }
    let merit = context.evaluator.merit(&timeline, Smoothing::Exact);
    merit.unwrap_or(f64::INFINITY)
}

/// Rounds the dwells of a plan whose angles are final, and takes the best ways if those are free.
pub(super) fn settle_times(
    context: Context<'_>,
    plan: &Plan,
    ways_are_free: bool,
) -> Option<Candidate> {
    let test = context.evaluator.test();
    let mut plan = with_whole_periods(test, plan, context.problem.total_time_s)?;
    if ways_are_free {
        plan = best_ways(context, plan);
    }
    final_figures(context, shift_periods(context, plan))
}

/// The final figures of a plan.
pub(super) fn final_figures(context: Context<'_>, plan: Plan) -> Option<Candidate> {
    let evaluator = context.evaluator;
    context.work.count_evaluations(1);
    let timeline = plan.timeline(evaluator.test());
    // A plan that cannot be evaluated is no candidate.
    let merit = evaluator.merit(&timeline, Smoothing::Exact).ok()?;
    let (_, criterion) = evaluator.end_with_criterion(&timeline).ok()?;
    Some(Candidate {
        plan,
        merit,
        criterion,
    })
}

/// The plan with rounded angles; the ways stay.
fn rounded(platform: &Platform, plan: &Plan) -> Plan {
    let mut rounded = plan.clone();
    for (k, angles) in rounded.angles.iter_mut().enumerate() {
        if !plan.is_held(k) {
            *angles = round_angles(platform, *angles);
        }
    }
    rounded
}

/// Angles (rad) to multiples of 0.001° inside the ranges, whole turns kept.
pub(super) fn round_angles(platform: &Platform, angles: [f64; 3]) -> [f64; 3] {
    let deg = |axis: usize| round_angle_deg(platform, axis, angles[axis]);
    Position::from_deg(deg(0), deg(1), deg(2)).to_array()
}

/// One angle (rad) to a multiple of 0.001° inside the axis' range, in degrees.
fn round_angle_deg(platform: &Platform, axis: usize, angle: f64) -> f64 {
    let mut steps = (deg_of_rad(angle) / ANGLE_STEP_DEG).round();
    if let Some(range) = platform.gimbals().ranges[axis] {
        // Towards the middle where rounding would leave the range; a range narrower than a
        // step keeps its angle.
        let within = multiples(ANGLE_STEP_DEG, range.ends());
        if within.is_empty() {
            return deg_of_rad(angle);
        }
        steps = steps.clamp(f64::from(within.start), f64::from(within.end - 1));
    }
    decimal(steps * ANGLE_STEP_DEG)
}

/// Dwells to whole filter periods, as many as the total time leaves.
fn with_whole_periods(test: &Test, plan: &Plan, total_time_s: f64) -> Option<Plan> {
    let budget_s = total_time_s - plan.overhead_s(test);
    let rounded = Plan {
        dwell_s: whole_periods(test.platform(), &plan.dwell_s, budget_s)?,
        ..plan.clone()
    };
    let timeline = rounded.timeline(test);
    let fits = timeline.total_time_s() <= total_time_s * (1.0 + TIME_SLACK);
    (fits && timeline.is_clear(test.platform())).then_some(rounded)
}

/// Durations to whole filter periods, none shorter than the minimum dwell, filling `budget_s`
/// but for less than a period.
pub(super) fn whole_periods(
    platform: &Platform,
    duration_s: &[f64],
    budget_s: f64,
) -> Option<Vec<f64>> {
    let period_s = platform.period_s();
    let fewest = (platform.shortest_dwell_s() / period_s).round();
    periods::whole_periods(period_s, fewest, duration_s, budget_s)
}
