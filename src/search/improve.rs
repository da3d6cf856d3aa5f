//! Improvement of a plan beyond what its gradient sees: order, insertions, kicks.
//!
//! A refined plan is the best of its basin. What lies beyond is proposed in batches, each
//! proposal refined for a while, and the best taken if it is better than the plan:
//!
//! - **order** ([`super::reordering`]): the reversals and displacements of segments that the true
//!   evaluator likes best, slew time and information together;
//! - **insertion** ([`super::insert`]): positions where the exact directional derivative over the
//!   attitude set promises most; at the most positions allowed, in exchange for the one that
//!   pays least;
//! - **ways** ([`super::ways`]): one gimbal the other way round on one move near a half turn;
//! - **kicks**: a position replaced, segments reversed or moved at random, all angles jittered.
//!
//! When a proposal wins, the lists are made anew; when several batches in a row win nothing, the
//! plan is done. A plan with more positions has to be better by the position tolerance for each.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::context::Context;
use super::insert::insertions;
use super::plan::Plan;
use super::propose::random_position;
use super::rated::{Refined, rate};
use super::reordering::{moved, neighbours, reversed, with_quickest_positions};
use super::workshop::Workshop;
use crate::criterion::Smoothing;

/// Batches that may win nothing before a plan is done.
const PATIENCE: usize = 3;
/// Most batches of one plan.
const MOST_BATCHES: usize = 60;
/// Proposals of each kind in a batch.
const ORDERS: usize = 3;
const INSERTIONS: usize = 3;
const WAYS: usize = 2;
const KICKS: usize = 6;
/// A proposal has to gain this much.
const GAIN: f64 = 2e-5;
/// Random streams of the kicks begin here, those of the starts end before.
const FIRST_STREAM: u64 = 1 << 40;

/// Which of several plans is improved.
#[derive(Debug, Clone, Copy)]
pub(super) struct WhichPlan {
    /// Stage of the search.
    pub stage: u64,
    /// Tells the random streams of several plans apart.
    pub stream: u64,
}

/// The plan that proposals lead to from `best`.
pub(super) fn improve(
    context: Context<'_>,
    workshop: &impl Workshop,
    smoothing: Smoothing,
    mut best: Refined,
    place: WhichPlan,
) -> Refined {
    let mut random = ChaCha8Rng::seed_from_u64(context.problem.seed);
    random.set_stream(FIRST_STREAM + place.stream);
    let mut ideas = Ideas::of(context, smoothing, &best.plan);
    let mut idle = 0;
    for count in 0..MOST_BATCHES {
        if idle >= PATIENCE || context.must_stop() {
            break;
        }
        let batch = ideas.batch(context, &best.plan, &mut random);
        let WhichPlan { stage, stream } = place;
        let name = || format!("{stage}/batch/{stream}/{count}");
        let winner = context.remembered(name, |context| {
            let admitted = batch.into_par_iter();
            let admitted = admitted.map(|plan| workshop.admit(context, plan)).collect();
            let tried = workshop.try_out(context, admitted, smoothing);
            let charged = |r: &Refined| charged(context, r);
            let winner = tried
                .into_iter()
                .flatten()
                .reduce(|best, r| match charged(&r) < charged(&best) {
                    true => r,
                    false => best,
                })
                .filter(|r| charged(r) < charged(&best) - GAIN)?;
            Some(workshop.work_out(context, winner, smoothing))
        });
        match winner {
            Some(winner) => {
                best = winner;
                ideas = Ideas::of(context, smoothing, &best.plan);
                idle = 0;
            }
            None => idle += 1,
        }
    }
    best
}

/// The merit and what the positions cost.
fn charged(context: Context<'_>, refined: &Refined) -> f64 {
    let count = refined.plan.angles.len() as f64;
    refined.merit + context.problem.position_tolerance * count
}

/// Proposals not tried yet, the most promising last.
struct Ideas {
    orders: Vec<Plan>,
    insertions: Vec<Plan>,
    ways: Vec<Plan>,
}

impl Ideas {
    fn of(context: Context<'_>, smoothing: Smoothing, plan: &Plan) -> Self {
        let most = PATIENCE * ORDERS.max(INSERTIONS);
        let mut ideas = Self {
            orders: neighbours(context, smoothing, plan, most)
                .into_iter()
                .map(|r| r.plan)
                .collect(),
            insertions: insertions(context, smoothing, plan, most),
            ways: other_ways(context, smoothing, plan, PATIENCE * WAYS),
        };
        ideas.orders.reverse();
        ideas.insertions.reverse();
        ideas.ways.reverse();
        ideas
    }

    /// The next proposals: as many of each kind as there are, and kicks.
    fn batch(&mut self, context: Context<'_>, plan: &Plan, random: &mut ChaCha8Rng) -> Vec<Plan> {
        let mut batch = Vec::with_capacity(ORDERS + INSERTIONS + WAYS + KICKS);
        let take =
            |list: &mut Vec<Plan>, count: usize| list.split_off(list.len().saturating_sub(count));
        batch.extend(take(&mut self.orders, ORDERS));
        batch.extend(take(&mut self.insertions, INSERTIONS));
        batch.extend(take(&mut self.ways, WAYS));
        batch.extend((0..KICKS).map(|kind| kick(context, plan, kind, random)));
        batch.retain(|plan| context.problem.admits(plan));
        batch
    }
}

/// The `most` best plans in which one gimbal turns the other way round on one move, best first.
fn other_ways(context: Context<'_>, smoothing: Smoothing, plan: &Plan, most: usize) -> Vec<Plan> {
    let others = plan.other_ways(context.evaluator.test());
    let rated = others.iter().map(|plan| rate(context, plan, smoothing));
    let mut rated: Vec<Refined> = rated.flatten().collect();
    rated.sort_by(|a, b| a.merit.total_cmp(&b.merit));
    rated.into_iter().take(most).map(|r| r.plan).collect()
}

/// A random change of `plan`.
fn kick(context: Context<'_>, plan: &Plan, kind: usize, random: &mut ChaCha8Rng) -> Plan {
    let platform = context.evaluator.test().platform();
    let count = plan.angles.len();
    let mut kicked = plan.clone();
    match kind {
        0 | 1 => {
            for _ in 0..=kind {
                let k = random.random_range(0..count);
                kicked.replace(k, random_position(platform, random).to_array());
            }
        }
        2 => {
            let (i, j) = (random.random_range(0..count), random.random_range(0..count));
            kicked = reversed(plan, i.min(j), i.max(j));
            let k = random.random_range(0..count);
            kicked.replace(k, random_position(platform, random).to_array());
        }
        3 => {
            let length = random.random_range(1..=count.div_ceil(2));
            let from = random.random_range(0..=count - length);
            let to = random.random_range(0..=count - length);
            kicked = moved(plan, from, length, to);
        }
        _ => {
            let reach = if kind == 4 { 0.25 } else { 0.8 };
            for (k, angles) in kicked.angles.iter_mut().enumerate() {
                if plan.is_held(k) {
                    continue;
                }
                for (axis, angle) in angles.iter_mut().enumerate() {
                    let jittered = *angle + reach * random.random_range(-1.0..1.0);
                    *angle = match platform.gimbals().ranges[axis] {
                        Some(r) => jittered.clamp(r.low_rad, r.high_rad),
                        None => jittered,
                    };
                }
            }
        }
    }
    with_quickest_positions(context, kicked)
}
