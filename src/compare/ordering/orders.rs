//! The problem of the best order, and orders with their merit.

use rayon::prelude::*;

use crate::attitude::Position;
use crate::evaluate::Evaluator;
use crate::motion::{Timeline, quickest_positions};
use crate::schedule::periods::whole_periods;
use crate::schedule::{Schedule, ScheduledPosition};

/// Merits this close count as equal: ln of the criterion.
pub(super) const SAME: f64 = 1e-9;

/// Orders that one thread rates at a time.
const AT_ONCE: usize = 16;

/// The problem of the best order.
#[derive(Debug)]
pub(super) struct Orders<'a> {
    pub evaluator: &'a Evaluator,
    pub positions: Vec<Position>,
    /// Whether every order takes the triples that are quickest in it, not those of the positions.
    pub quickest: bool,
    pub total_time_s: f64,
    /// In what proportion the positions are held, dwells going with them; none: equally long.
    pub proportions: Option<Vec<f64>>,
}

/// An order with its merit, the score; lower is better.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rated {
    pub merit: f64,
    pub order: Vec<usize>,
}

impl Rated {
    /// The better of two; of equal ones the first.
    pub fn better(self, other: Self) -> Self {
        match other.merit < self.merit - SAME {
            true => other,
            false => self,
        }
    }
}

impl Orders<'_> {
    /// The order as it is driven; none when it does not fit into the time.
    pub fn schedule(&self, order: &[usize]) -> Option<Schedule> {
        let test = self.evaluator.test();
        let visited: Vec<Position> = order.iter().map(|&k| self.positions[k]).collect();
        let visited = match self.quickest {
            true => quickest_positions(test, &visited),
            false => visited,
        };
        let held = |dwell_s: &[f64]| {
            let held = visited.iter().zip(dwell_s);
            held.map(|(p, &dwell_s)| ScheduledPosition::new(*p, dwell_s))
                .collect::<Vec<_>>()
        };
        let no_time = vec![0.0; order.len()];
        let moving = Timeline::unchecked(test, held(&no_time).into_iter());
        if !moving.is_clear(test.platform()) {
            return None;
        }
        let budget_s = self.total_time_s - moving.overhead_s();
        let dwell_s = match &self.proportions {
            None => vec![budget_s / order.len() as f64; order.len()],
            Some(all) => {
                let sum: f64 = all.iter().sum();
                order.iter().map(|&k| budget_s * all[k] / sum).collect()
            }
        };
        let dwell_s = whole_periods(
            test.platform().period_s(),
            self.fewest_periods(),
            &dwell_s,
            budget_s,
        )?;
        // Angles of a standard scheme and dwells of whole periods make a valid schedule.
        Schedule::new(held(&dwell_s)).ok()
    }

    /// Periods of the shortest dwell.
    pub fn fewest_periods(&self) -> f64 {
        let platform = self.evaluator.test().platform();
        (platform.shortest_dwell_s() / platform.period_s()).round()
    }

    /// Those of the orders that can be driven, with their merits.
    pub fn rated(&self, orders: &[Vec<usize>]) -> Vec<Rated> {
        let rate = |some: &[Vec<usize>]| {
            let test = self.evaluator.test();
            let driven: Vec<_> = some
                .iter()
                .filter_map(|order| Some((order, self.schedule(order)?)))
                .collect();
            let timelines: Vec<Timeline> = driven
                .iter()
                .map(|(_, s)| Timeline::unchecked(test, s.positions().iter().copied()))
                .collect();
            let merits = self.evaluator.merits_by_filter(&timelines);
            let rated = merits.into_iter().zip(driven);
            // An order whose merit cannot be computed is not a candidate; that none can is said.
            rated
                .filter_map(|(merit, (order, _))| {
                    let merit = merit.ok().filter(|m| m.is_finite())?;
                    // To eleven digits, so that equal ones are equal on every machine.
                    Some(Rated {
                        merit: (merit * 1e11).round() * 1e-11,
                        order: order.clone(),
                    })
                })
                .collect::<Vec<_>>()
        };
        orders.par_chunks(AT_ONCE).flat_map_iter(rate).collect()
    }
}
