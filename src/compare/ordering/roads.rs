//! What lies between the positions: the ways of the gimbals, their time, and the links.

use rayon::prelude::*;

use super::orders::Orders;
use crate::attitude::Position;
use crate::covariance::link::{Link, Reached};
use crate::evaluate::Evaluator;
use crate::motion::{Leg, Test, Timeline, unit_s, way_length};
use crate::schedule::ScheduledPosition;
use crate::units::RAD_PER_DEG;

/// Steps that all ways of a scheme may be multiples of, degrees, largest first.
const STEPS_DEG: [f64; 10] = [180.0, 90.0, 60.0, 45.0, 30.0, 22.5, 15.0, 10.0, 5.0, 1.0];

/// The positions, and what the gimbals turn between them.
#[derive(Debug)]
pub(super) struct Roads<'a> {
    pub orders: &'a Orders<'a>,
    /// For each position an earlier one that is the same.
    twins: Vec<Option<usize>>,
    /// How long the ways are between positions, rad or s.
    ways: Vec<f64>,
    /// From where the platform stands.
    starts: Vec<f64>,
    /// To where every test ends.
    homes: Option<Vec<f64>>,
    returns_to_the_first: bool,
    /// Time of a unit of them, s.
    unit_s: f64,
    /// Time for dwells but for the ways, s.
    budget_s: f64,
    /// The moves from position to position with their settles.
    arrivals: Vec<Option<Link>>,
    /// What is known on arrival at a first position.
    begin: Vec<Reached>,
    /// Least and most way from a position through all positions of a set to the end.
    to_go: Vec<[f64; 2]>,
}

impl<'a> Roads<'a> {
    pub fn new(orders: &'a Orders<'a>) -> Self {
        let test = orders.evaluator.test();
        let platform = test.platform();
        let positions = &orders.positions;
        let from_all = |to: Position| positions.iter().map(move |s| way_length(platform, *s, to));
        let standing = test.standing();
        let back = platform.motion().return_to_start;
        let start = |s: &Position| standing.map_or(0.0, |from| way_length(platform, from, *s));
        let mut roads = Self {
            orders,
            twins: twins(positions),
            ways: positions
                .iter()
                .flat_map(|from| positions.iter().map(|to| way_length(platform, *from, *to)))
                .collect(),
            starts: positions.iter().map(start).collect(),
            homes: test
                .home()
                .filter(|_| back)
                .map(|home| from_all(home).collect()),
            returns_to_the_first: back && test.home().is_none(),
            unit_s: unit_s(platform),
            budget_s: orders.total_time_s - fixed_s(test, positions),
            arrivals: Vec::new(),
            begin: Vec::new(),
            to_go: Vec::new(),
        };
        roads.link_up(test);
        roads.look_ahead();
        roads
    }

    /// The links of all moves, and what is known on arrival at the first position.
    fn link_up(&mut self, test: &Test) {
        let platform = test.platform();
        let model = self.orders.evaluator.model();
        let positions = &self.orders.positions;
        let head = Timeline::unchecked(test, std::iter::empty());
        let done = head.positions().start;
        let before = head.legs()[..done].last();
        let known = model.reached(&head.only(0..done));
        let begin = positions.iter().map(|s| match before {
            None => known.clone(),
            Some(before) => {
                let leg = Timeline::arrival_leg(platform, Some(before.position), *s);
                known.after(&model.arrival_link([before, &leg]))
            }
        });
        self.begin = begin.collect();
        let count = positions.len();
        self.arrivals = (0..count * count)
            .into_par_iter()
            .map(|k| {
                let [from, to] = [k / count, k % count];
                (from != to).then(|| {
                    let before = Timeline::arrival_leg(platform, None, positions[from]);
                    let leg = Timeline::arrival_leg(platform, Some(positions[from]), positions[to]);
                    model.arrival_link([&before, &leg])
                })
            })
            .collect();
    }

    /// Least and most to go from every position through every set.
    fn look_ahead(&mut self) {
        if !self.periods_differ() {
            return;
        }
        let count = self.count();
        self.to_go = vec![[0.0; 2]; count << count];
        for set in 0..=self.everywhere() {
            for last in 0..count {
                self.to_go[set as usize * count + last] = match set {
                    0 => self.ways_home(last),
                    _ => self.through(set, last),
                };
            }
        }
    }

    /// Least and most from a last position to the end, whatever the first was.
    fn ways_home(&self, last: usize) -> [f64; 2] {
        let all = (0..self.count()).map(|first| self.way_home(first, last));
        all.fold([f64::INFINITY, 0.0], |range: [f64; 2], way| {
            [range[0].min(way), range[1].max(way)]
        })
    }

    /// Least and most from a position through all positions of a set.
    fn through(&self, set: u32, last: usize) -> [f64; 2] {
        let next = (0..self.count()).filter(|next| set >> next & 1 == 1);
        next.fold([f64::INFINITY, 0.0], |range: [f64; 2], next| {
            let rest = (set & !(1 << next)) as usize * self.count() + next;
            let [least, most] = self.to_go[rest];
            let way = self.way(last, next);
            [range[0].min(way + least), range[1].max(way + most)]
        })
    }

    pub fn evaluator(&self) -> &'a Evaluator {
        self.orders.evaluator
    }

    /// How many positions there are.
    pub fn count(&self) -> usize {
        self.orders.positions.len()
    }

    /// The set of all positions.
    pub fn everywhere(&self) -> u32 {
        (1 << self.count()) - 1
    }

    /// From position to position.
    pub fn way(&self, from: usize, to: usize) -> f64 {
        self.ways[from * self.count() + to]
    }

    /// To a first position.
    pub fn start(&self, first: usize) -> f64 {
        self.starts[first]
    }

    /// From the last position of a test to where it ends.
    pub fn way_home(&self, first: usize, last: usize) -> f64 {
        match &self.homes {
            Some(homes) => homes[last],
            None if self.returns_to_the_first => self.way(last, first),
            None => 0.0,
        }
    }

    /// Whether a position may come next: not visited, and its twin has been.
    pub fn may_follow(&self, visited: u32, next: usize) -> bool {
        let been = |k: usize| visited >> k & 1 == 1;
        !been(next) && self.twins[next].is_none_or(been)
    }

    /// All first two positions.
    pub fn prefixes(&self) -> Vec<Vec<usize>> {
        let mut all = Vec::new();
        for first in (0..self.count()).filter(|k| self.may_follow(0, *k)) {
            if self.count() == 1 {
                all.push(vec![first]);
            }
            let seconds = (0..self.count()).filter(|k| self.may_follow(1 << first, *k));
            all.extend(seconds.map(|second| vec![first, second]));
        }
        all
    }

    /// Whether orders leave different numbers of periods.
    pub fn periods_differ(&self) -> bool {
        self.unit_s > 0.0
    }

    /// The periods that are left for dwells when the gimbals turn by `cost`.
    pub fn periods(&self, cost: f64) -> i64 {
        let left_s = self.budget_s - cost * self.unit_s;
        (left_s / self.evaluator().test().platform().period_s() + 1e-9).floor() as i64
    }

    /// Every number of periods that some order may leave, most first, as long as no dwell is
    /// shorter than the shortest.
    pub fn all_periods(&self) -> Vec<i64> {
        let fewest = self.orders.fewest_periods() as i64 * self.count() as i64;
        let mut all: Vec<i64> = match self.periods_differ() {
            false => vec![self.periods(0.0)],
            true => {
                let ranges =
                    (0..self.count()).map(|first| self.range(1 << first, first, self.start(first)));
                let [least, most] = ranges.fold([f64::INFINITY, 0.0], |all: [f64; 2], r| {
                    [all[0].min(r[0]), all[1].max(r[1])]
                });
                match self.step() {
                    Some(step) => ((least / step).floor() as i64..=(most / step).ceil() as i64)
                        .map(|k| self.periods(k as f64 * step))
                        .collect(),
                    None => (self.periods(most)..=self.periods(least)).rev().collect(),
                }
            }
        };
        all.dedup();
        all.retain(|periods| *periods >= fewest.max(1));
        all
    }

    /// The largest step that all ways are multiples of; none when there is none.
    fn step(&self) -> Option<f64> {
        let multiples = |step: &f64| {
            let homes = self.homes.iter().flatten();
            let mut ways = self.ways.iter().chain(&self.starts).chain(homes);
            ways.all(|way| {
                let times = way / step;
                (times - times.round()).abs() < 1e-9
            })
        };
        let steps = STEPS_DEG.map(|deg| deg * RAD_PER_DEG);
        steps.into_iter().find(multiples)
    }

    /// Least and most that the gimbals turn in an order that has come to `last` by `cost`.
    pub fn range(&self, visited: u32, last: usize, cost: f64) -> [f64; 2] {
        let left = (self.everywhere() & !visited) as usize * self.count();
        let [least, most] = self.to_go[left + last];
        // Sums of the same ways differ in their last bits by the order of adding up.
        [cost + least - 1e-12, cost + most + 1e-12]
    }
}

/// Time that any order spends otherwise than in dwells and on the way, s: settles, and what was
/// done before.
fn fixed_s(test: &Test, positions: &[Position]) -> f64 {
    let held = positions.iter().map(|p| ScheduledPosition::new(*p, 0.0));
    let timeline = Timeline::unchecked(test, held);
    let moves_s = |legs: &[Leg]| -> f64 {
        let moves = legs.iter().filter_map(|leg| leg.arrival);
        moves.map(|m| m.duration_s).sum()
    };
    let done = &timeline.legs()[..timeline.positions().start];
    timeline.overhead_s() - moves_s(timeline.legs()) + moves_s(done)
}

/// For each position an earlier one that is the same.
fn twins(positions: &[Position]) -> Vec<Option<usize>> {
    let same = |a: Position, b: Position| a.to_array() == b.to_array();
    (0..positions.len())
        .map(|k| {
            (0..k)
                .rev()
                .find(|&earlier| same(positions[earlier], positions[k]))
        })
        .collect()
}

/// The links of every move with the dwell after it, for one number of periods.
#[derive(Debug)]
pub(super) struct Hops {
    pub periods: i64,
    count: usize,
    /// Positions that are held a period longer: the first in order.
    longer: usize,
    begin: Vec<Reached>,
    /// With the longer dwell and the shorter.
    links: [Vec<Option<Link>>; 2],
}

impl Hops {
    pub fn new(roads: &Roads<'_>, periods: i64) -> Self {
        let count = roads.count();
        let longer = periods as usize % count;
        let shorter = periods as usize / count;
        let model = roads.evaluator().model();
        let platform = roads.evaluator().test().platform();
        let positions = roads.orders.positions.iter();
        let legs: Vec<Leg> = positions
            .map(|s| Timeline::arrival_leg(platform, None, *s))
            .collect();
        let links = |periods: usize| -> Vec<Option<Link>> {
            let dwells: Vec<Link> = legs.iter().map(|l| model.dwell_link(l, periods)).collect();
            let arrivals = roads.arrivals.par_iter().enumerate();
            arrivals
                .map(|(k, arrival)| Some(arrival.as_ref()?.then(&dwells[k % count])))
                .collect()
        };
        let first = shorter + usize::from(longer > 0);
        let begin = legs.iter().zip(&roads.begin);
        Self {
            periods,
            count,
            longer,
            begin: begin
                .map(|(leg, known)| known.after(&model.dwell_link(leg, first)))
                .collect(),
            links: [
                match longer > 1 {
                    true => links(shorter + 1),
                    false => Vec::new(),
                },
                links(shorter),
            ],
        }
    }

    /// What is known after the dwell at a first position.
    pub fn begin(&self, first: usize) -> Reached {
        self.begin[first].clone()
    }

    /// From a position to another one that is held as number `depth` of the order, from 0.
    pub fn hop(&self, depth: usize, from: usize, to: usize) -> &Link {
        let links = &self.links[usize::from(depth >= self.longer)];
        match &links[from * self.count + to] {
            Some(link) => link,
            None => unreachable!("no order visits a position twice in a row"),
        }
    }
}
