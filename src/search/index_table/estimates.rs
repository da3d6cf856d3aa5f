//! Estimates of exchanges.

use rayon::prelude::*;

use crate::attitude::Position;
use crate::covariance::TickRule;
use crate::covariance::fast::coloured::cuts::Cuts as WanderingCuts;
use crate::covariance::fast::cuts::Cuts;
use crate::criterion::Smoothing;
use crate::error::Result;
use crate::motion::Timeline;
use crate::search::context::Context;
use crate::search::cost::price_of_time;
use crate::search::plan::Plan;

/// Places of an exchange that are rated in full, by their estimates.
const RATED: usize = 4;
/// Where drift or biases wander, places that are estimated with it, by their estimates without.
const ESTIMATED_TWICE: usize = 32;
/// An exchange that changes the mean ln(separability) by more than this is not looked for.
const SEPARABILITY_CHANGE: f64 = 0.3;

/// Estimates of a plan's exchanges, every place at the cost of one dwell and its moves, several
/// at once.
///
/// Where drift or biases wander the best of all places by the white model are estimated once more by the
/// true one.
pub(super) struct Estimates<'a> {
    context: Context<'a>,
    smoothing: Smoothing,
    timeline: &'a Timeline,
    /// None where the merit is more than the covariance's.
    cuts: Option<Cuts<'a>>,
    /// The same with what wanders; none where nothing does.
    wandering: Option<WanderingCuts<'a>>,
    /// Where the plan is now.
    present: Vec<[f64; 3]>,
    /// What a second of moves is worth.
    price: f64,
}

/// Places that one thread estimates at a time.
const AT_ONCE: usize = 64;

impl<'a> Estimates<'a> {
    pub fn new(
        context: Context<'a>,
        smoothing: Smoothing,
        plan: &Plan,
        timeline: &'a Timeline,
    ) -> Self {
        let evaluator = context.evaluator;
        // Estimates leave the separability out: only where it is no more than a tie-breaker.
        let by_covariance = !evaluator.objective().is_led_by_separability();
        let slews = evaluator.test().platform().motion().slew.is_some();
        let wandering = by_covariance
            .then(|| evaluator.model().coloured_cuts(timeline, TickRule::Relaxed))
            .flatten();
        Self {
            context,
            smoothing,
            timeline,
            // Without it the white model has to do.
            wandering: wandering.and_then(Result::ok),
            present: plan.angles.clone(),
            cuts: by_covariance.then(|| Cuts::new(evaluator.model(), timeline, TickRule::Relaxed)),
            price: match by_covariance && slews {
                true => price_of_time(context, smoothing, plan).unwrap_or(0.0),
                false => 0.0,
            },
        }
    }

    /// The places worth rating for position `k`, best first, in the order of the table where they
    /// are equal.
    pub fn best(&self, k: usize, places: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
        let Some(cuts) = &self.cuts else {
            return places;
        };
        self.context.work.count_evaluations(places.len() as u64);
        let leg = self.timeline.positions().start + k;
        let around = cuts.around(leg..leg + 1);
        let evaluator = self.context.evaluator;
        let white = |parts: &[Timeline]| {
            evaluator
                .model()
                .values_between(parts, TickRule::Relaxed, &around, |p| {
                    evaluator.estimate_of_covariance(p, self.smoothing)
                })
        };
        let estimates = self.sorted(k, &places, AT_ONCE, &white);
        let Some(cuts) = &self.wandering else {
            return estimates.into_iter().take(RATED).map(|(_, p)| p).collect();
        };
        let around = cuts.around(leg..leg + 1);
        let wandering = |parts: &[Timeline]| {
            evaluator
                .model()
                .coloured_values_between(parts, TickRule::Relaxed, &around, |p| {
                    evaluator.merit_of_covariance(p, self.smoothing)
                })
        };
        let best = estimates.into_iter().take(ESTIMATED_TWICE);
        let present = self.present[k];
        let looked_at: Vec<[f64; 3]> = std::iter::once(present).chain(best.map(|e| e.1)).collect();
        self.context.work.count_evaluations(looked_at.len() as u64);
        let estimates = self.sorted(k, &looked_at, AT_ONCE / 4, &wandering);
        // No more than the separability can make up for.
        let enough = self.separability_slack();
        let now = estimates.iter().find(|(_, place)| *place == present);
        let enough = now.map_or(f64::INFINITY, |(merit, _)| merit + enough);
        let better = |(merit, place): &(f64, [f64; 3])| *merit < enough && *place != present;
        let better = estimates.into_iter().filter(better);
        better.take(RATED).map(|(_, place)| place).collect()
    }

    /// How much the separability may make up for in an exchange.
    fn separability_slack(&self) -> f64 {
        let objective = self.context.evaluator.objective();
        SEPARABILITY_CHANGE * objective.separability_weight
    }

    /// The places by their estimates, so many at once.
    fn sorted(
        &self,
        k: usize,
        places: &[[f64; 3]],
        at_once: usize,
        merits: &(impl Fn(&[Timeline]) -> Vec<Result<f64>> + Sync),
    ) -> Vec<(f64, [f64; 3])> {
        let mut estimates: Vec<(f64, [f64; 3])> = places
            .par_chunks(at_once)
            .flat_map_iter(|some| self.estimates(k, some, merits))
            .collect();
        estimates.sort_by(|a, b| a.0.total_cmp(&b.0));
        estimates
    }

    fn estimates(
        &self,
        k: usize,
        places: &[[f64; 3]],
        merits: &(impl Fn(&[Timeline]) -> Vec<Result<f64>> + Sync),
    ) -> Vec<(f64, [f64; 3])> {
        let evaluator = self.context.evaluator;
        let platform = evaluator.test().platform();
        let mut more_s = Vec::with_capacity(places.len());
        let parts: Vec<Timeline> = places
            .iter()
            .map(|place| {
                let position = Position::from_array(*place);
                let (part, more) = self.timeline.exchange(platform, k, position);
                more_s.push(more);
                part
            })
            .collect();
        let all = merits(&parts).into_iter().zip(more_s).zip(places);
        all.filter_map(|((merit, more_s), place)| {
            let merit = merit.ok()? - self.price * more_s;
            merit.is_finite().then_some((merit, *place))
        })
        .collect()
    }
}
