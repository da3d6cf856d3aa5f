//! All orders, prefix by prefix: branch and bound.
//!
//! The dwells depend on what the moves of the whole order leave of the time, so the orders are
//! gone through once for each number of filter periods that may be left, longest dwells first, and
//! each time only those that leave just as many. Then everything before a position is known
//! exactly when it is reached (V, P, E of the [chain](crate::covariance::chain)), and a further
//! position costs one [`Link`](crate::covariance::link::Link).
//!
//! A prefix is left when what follows cannot make it better than the best order known: when what
//! it knows, joined with a bound on the information of every order of the rest
//! ([`upper`](super::upper)), does not come to a better score; or when no order of the rest leaves
//! the number of periods in hand. Positions that are given twice are visited in the order given.
//!
//! Work is dealt out in batches of prefixes of two positions; the best order known is that at the
//! start of the batch and what the prefix itself has found, so that the steps made, and with
//! them where a limit ends them, do not depend on the number of threads.

use rayon::prelude::*;

use super::orders::{Orders, Rated, SAME};
use super::roads::{Hops, Roads};
use super::upper::Upper;
use crate::covariance::Rooted;
use crate::covariance::link::Reached;
use crate::criterion::Smoothing;
use crate::drift::CoefficientMatrix;

/// Prefixes worked on before the best order is settled between them.
const BATCH: usize = 24;
/// So few positions to go, whether their moves leave the periods in hand is tried out.
const TRIED_OUT: usize = 4;

/// What going through the orders came to.
#[derive(Debug)]
pub(super) struct Gone {
    /// The best order known.
    pub best: Option<Rated>,
    /// Whether all of them were gone through.
    pub complete: bool,
    /// Positions added to prefixes, and what bounds took in such steps.
    pub steps: u64,
}

/// Goes through the orders of at most [`super::MOST_PROVEN`] positions, `found` known before.
pub(super) fn go_through(orders: &Orders<'_>, found: Option<Rated>, most_steps: u64) -> Gone {
    let roads = Roads::new(orders);
    let prefixes = roads.prefixes();
    let all_periods = roads.all_periods();
    // Bounds may take a third of the steps that going through all orders without them would.
    let orders_count: u64 = (1..=roads.count() as u64).product();
    let most_for_bounds = orders_count / all_periods.len().max(1) as u64;
    let mut gone = Gone {
        best: found,
        complete: true,
        steps: 0,
    };
    for periods in all_periods {
        let hops = Hops::new(&roads, periods);
        let best = gone.best.as_ref().map(|best| best.order.as_slice());
        let upper = best.and_then(|best| Upper::new(&roads, &hops, best, most_for_bounds));
        gone.steps += upper.as_ref().map_or(0, |upper| upper.steps);
        for batch in prefixes.chunks(BATCH) {
            if gone.steps >= most_steps {
                gone.complete = false;
            }
            if !gone.complete {
                return gone;
            }
            let known = &gone;
            let walked: Vec<Walk<'_>> = batch
                .par_iter()
                .map(|prefix| {
                    let mut walk = Walk {
                        roads: &roads,
                        hops: &hops,
                        upper: upper.as_ref(),
                        order: Vec::with_capacity(roads.count()),
                        best: None,
                        merit: known.best.as_ref().map_or(f64::INFINITY, |b| b.merit),
                        steps: 0,
                        most_steps: most_steps - known.steps,
                        cut: false,
                    };
                    walk.begin(prefix);
                    walk
                })
                .collect();
            for walk in walked {
                gone.steps += walk.steps;
                gone.complete &= !walk.cut;
                gone.best = match (gone.best.take(), walk.best) {
                    (Some(a), Some(b)) => Some(a.better(b)),
                    (a, b) => a.or(b),
                };
            }
        }
    }
    gone
}

/// A beginning of an order.
#[derive(Debug, Clone)]
struct Prefix {
    visited: u32,
    first: usize,
    last: usize,
    /// What the gimbals have turned, rad.
    cost: f64,
    reached: Reached,
}

/// One thread's way through the orders.
struct Walk<'a> {
    roads: &'a Roads<'a>,
    hops: &'a Hops,
    upper: Option<&'a Upper>,
    order: Vec<usize>,
    best: Option<Rated>,
    /// The merit to be better than.
    merit: f64,
    steps: u64,
    most_steps: u64,
    cut: bool,
}

impl Walk<'_> {
    /// All orders that begin with these positions.
    fn begin(&mut self, positions: &[usize]) {
        let mut at = None;
        for &next in positions {
            at = self.with(at.as_ref(), next);
            if at.is_none() {
                return;
            }
        }
        if let Some(at) = at {
            self.go_on(&at);
        }
    }

    /// All orders that begin with the prefix.
    fn go_on(&mut self, at: &Prefix) {
        if self.order.len() == self.roads.count() {
            return self.arrive(at);
        }
        for next in 0..self.roads.count() {
            if self.steps >= self.most_steps {
                self.cut = true;
            }
            if self.cut {
                return;
            }
            if self.roads.may_follow(at.visited, next)
                && let Some(further) = self.with(Some(at), next)
            {
                self.go_on(&further);
                self.order.pop();
            }
        }
    }

    /// The prefix with one more position, put at the end of the order in hand; none when nothing
    /// better can follow.
    fn with(&mut self, at: Option<&Prefix>, next: usize) -> Option<Prefix> {
        let roads = self.roads;
        let (visited, first, cost) = match at {
            None => (1 << next, next, roads.start(next)),
            Some(at) => (
                at.visited | 1 << next,
                at.first,
                at.cost + roads.way(at.last, next),
            ),
        };
        if !self.may_leave_the_periods(visited, first, next, cost) {
            return None;
        }
        let reached = match at {
            None => self.hops.begin(next),
            Some(at) => at
                .reached
                .after(self.hops.hop(self.order.len(), at.last, next)),
        };
        self.steps += 1;
        self.may_become_better(&reached, visited, next).then(|| {
            self.order.push(next);
            Prefix {
                visited,
                first,
                last: next,
                cost,
                reached,
            }
        })
    }

    /// Whether some order of the rest leaves the number of periods in hand.
    fn may_leave_the_periods(&self, visited: u32, first: usize, last: usize, cost: f64) -> bool {
        let roads = self.roads;
        if !roads.periods_differ() {
            return true;
        }
        let [least, most] = roads.range(visited, last, cost);
        if !(roads.periods(most)..=roads.periods(least)).contains(&self.hops.periods) {
            return false;
        }
        let to_go = roads.count() - visited.count_ones() as usize;
        to_go > TRIED_OUT || self.leaves_the_periods(visited, first, last, cost)
    }

    /// The same, by trying out every order of the rest.
    fn leaves_the_periods(&self, visited: u32, first: usize, last: usize, cost: f64) -> bool {
        let roads = self.roads;
        if visited == roads.everywhere() {
            return roads.periods(cost + roads.way_home(first, last)) == self.hops.periods;
        }
        (0..roads.count())
            .filter(|&next| roads.may_follow(visited, next))
            .any(|next| {
                let cost = cost + roads.way(last, next);
                self.leaves_the_periods(visited | 1 << next, first, next, cost)
            })
    }

    /// Whether the best that the rest might tell would make it better than the best order known.
    fn may_become_better(&self, reached: &Reached, visited: u32, last: usize) -> bool {
        let left = self.roads.everywhere() & !visited;
        match self.upper.and_then(|upper| upper.rest(left, last)) {
            // Without a merit of the bound the prefix is not ruled out.
            Some(rest) => {
                let merit = self.merit(&reached.joined(rest));
                merit.is_none_or(|merit| merit < self.merit - SAME)
            }
            None => true,
        }
    }

    /// The covariance's part of the merit; separability only adds to it.
    fn merit(&self, information: &CoefficientMatrix) -> Option<f64> {
        let evaluator = self.roads.evaluator();
        let prior = evaluator.model().prior_sigma_deg_per_h();
        let covariance = Rooted::of_information(information, prior)?;
        // Without a merit there is no bound, and nothing is ruled out by it.
        evaluator
            .estimate_of_covariance(&covariance, Smoothing::Exact)
            .ok()
    }

    /// A whole order.
    fn arrive(&mut self, at: &Prefix) {
        // An order whose sum of squares gives no merit is rated in full.
        let merit = self.merit(&at.reached.e).unwrap_or(f64::NEG_INFINITY);
        if merit < self.merit - SAME {
            let rated = self.roads.orders.rated(std::slice::from_ref(&self.order));
            if let Some(rated) = rated.into_iter().find(|r| r.merit < self.merit - SAME) {
                self.merit = rated.merit;
                self.best = Some(rated);
            }
        }
    }
}
