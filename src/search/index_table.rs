//! Index tables: positions only at multiples of a step.
//!
//! A continuous search is of little use on a coarse table, so the table has its own: a start is
//! snapped to the table, then improved by **coordinate exchange**: position by position, every
//! place of the table (on a fine table: its neighbours, and every angle of one axis at a time) is
//! tried in the true merit and the best is kept, until a whole sweep changes nothing. Between sweeps the
//! dwells are allocated and idle positions dropped, as for free angles.

mod estimates;

use std::collections::HashMap;
use std::sync::OnceLock;

use rayon::prelude::*;

use super::allocate::allocate;
use super::context::Context;
use super::cost::detour_s;
use super::fit::brought_within;
use super::plan::Plan;
use super::rated::{Candidate, Refined, rate};
use super::workshop::Workshop;
use crate::attitude::{NanoDegrees, Position, Stand, deg_of_rad};
use crate::criterion::Smoothing;
use crate::motion::{Test, Timeline};
use crate::platform::Platform;
use crate::units::RAD_PER_DEG;
use estimates::Estimates;

/// Up to this many places of the table (45° and coarser) every start is improved by exchange.
const COARSE: usize = 1_000;
/// Up to this many (15°) an exchange tries them all in the end.
const ALL_PLACES: usize = 14_000;
/// Most angles of one axis that an exchange tries, around the present one.
const AXIS_ANGLES: usize = 720;
/// Sweeps of exchange per round.
const SWEEPS: usize = 12;
/// Rounds of exchange and allocation.
const ROUNDS: usize = 6;
/// An exchange has to gain this much.
const GAIN: f64 = 1e-10;
/// Where drift or biases wander, positions of which it is tried what the dwells make of their absence.
const DROPPED: usize = 4;

/// Which places an exchange tries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reach {
    /// On a coarse table all; on a fine one the neighbours and single axes.
    Near,
    /// All, as long as the table is not too fine.
    All,
}

/// The positions that can be held where not all can: the angles each axis can be set to, rad, in any
/// combination, or a list of positions.
#[derive(Debug, Clone)]
pub(super) struct IndexTable {
    stand: Stand,
    angles: [Vec<f64>; 3],
    /// The positions themselves, where the stand has a list of them.
    list: Option<Vec<[f64; 3]>>,
    /// The places by attitude, each with all its triples; empty when there are too many. Worked
    /// out when first wanted: few users of a table ask for them.
    attitudes: OnceLock<Vec<Vec<[f64; 3]>>>,
}

impl IndexTable {
    /// The table of `platform`; none without an index step or a list of positions.
    pub fn new(platform: &Platform) -> Option<Self> {
        if let Some(allowed) = platform.obstacles().allowed() {
            return Some(Self {
                stand: *platform.stand(),
                angles: Default::default(),
                list: Some(allowed.iter().map(|p| p.to_array()).collect()),
                attitudes: OnceLock::new(),
            });
        }
        let settings = |axis| -> Option<Vec<f64>> {
            let deg = platform.gimbals().settings_deg(axis)?;
            Some(deg.map(|deg| deg * RAD_PER_DEG).collect())
        };
        Some(Self {
            stand: *platform.stand(),
            angles: [settings(0)?, settings(1)?, settings(2)?],
            list: None,
            attitudes: OnceLock::new(),
        })
    }

    /// Whether any position can be set at all.
    pub fn is_empty(&self) -> bool {
        self.list.is_none() && self.angles.iter().any(Vec::is_empty)
    }

    /// Whether every start can be improved by trying every place.
    pub fn is_coarse(&self) -> bool {
        self.count().is_some_and(|n| n <= COARSE)
    }

    /// The places by attitude; none when there are too many.
    fn attitudes(&self) -> &[Vec<[f64; 3]>] {
        let of = |triples: &mut dyn Iterator<Item = [f64; 3]>| by_attitude(&self.stand, triples);
        self.attitudes
            .get_or_init(|| match (&self.list, self.count()) {
                (Some(list), _) => of(&mut list.iter().copied()),
                (None, Some(n)) if n <= ALL_PLACES => of(&mut combinations(&self.angles)),
                _ => Vec::new(),
            })
    }

    /// How many places there are.
    fn count(&self) -> Option<usize> {
        if let Some(list) = &self.list {
            return Some(list.len());
        }
        self.angles
            .iter()
            .try_fold(1_usize, |n, axis| n.checked_mul(axis.len()))
    }

    /// About `most` places spread over the table.
    pub fn sample(&self, most: usize) -> Vec<Position> {
        if let Some(list) = &self.list {
            let stride = list.len().div_ceil(most).max(1);
            let some = list.iter().step_by(stride);
            return some.map(|angles| Position::from_array(*angles)).collect();
        }
        let count = self.count().unwrap_or(usize::MAX);
        let stride = count.div_ceil(most).max(1);
        // A stride that shares a factor with an axis would leave out some of its angles.
        let lengths = self.angles.each_ref().map(Vec::len);
        let coprime = |s: &usize| lengths.iter().all(|n| gcd(*s, *n) == 1);
        let stride = if stride == 1 {
            1
        } else {
            (stride..).find(coprime).unwrap_or(stride)
        };
        (0..count)
            .step_by(stride)
            .map(|i| {
                let [a, b, g] = &self.angles;
                let index = [i / g.len() / b.len(), i / g.len() % b.len(), i % g.len()];
                Position::from_rad(a[index[0]], b[index[1]], g[index[2]])
            })
            .collect()
    }

    /// The plan with every angle at its nearest setting.
    fn snapped(&self, context: Context<'_>, plan: &Plan) -> Plan {
        let platform = context.evaluator.test().platform();
        let mut snapped = plan.clone();
        for (k, angles) in snapped.angles.iter_mut().enumerate() {
            if !plan.is_held(k) {
                *angles = self.snap(platform, *angles);
            }
        }
        snapped
    }

    /// `plan` on the table and within the time, as little changed as that takes; none where it has
    /// no merit.
    fn placed(&self, context: Context<'_>, plan: &Plan, smoothing: Smoothing) -> Option<Refined> {
        let test = context.evaluator.test();
        brought_within(test, plan, |plan| {
            rate(context, &self.snapped(context, &plan), smoothing)
        })
    }

    /// The nearest setting of each axis; an angle that can be set stays as it is, beyond the
    /// settings listed too (where the step does not divide a turn, more turns have others).
    pub(super) fn snap(&self, platform: &Platform, angles: [f64; 3]) -> [f64; 3] {
        if let Some(list) = &self.list {
            return nearest_attitude(&self.stand, list, angles);
        }
        std::array::from_fn(|axis| {
            let limited = platform.gimbals().ranges[axis].is_some();
            // In whole 1e-9°: of two that are equally near, the lower one.
            let wanted = nano(angles[axis]);
            let distance = |a: &f64| {
                let apart = nano(*a) - wanted;
                let apart = if limited { apart } else { apart.wrapped() };
                apart.abs()
            };
            let nearest = self.angles[axis].iter().copied().min_by_key(distance);
            let deg = deg_of_rad(angles[axis]);
            let can_be_set = || platform.gimbals().allows(axis, deg);
            match nearest {
                Some(a) if distance(&a) == NanoDegrees::default() || !can_be_set() => a,
                _ => angles[axis],
            }
        })
    }

    /// The settings of an axis next to `angle`, itself included.
    fn neighbours(&self, axis: usize, angle: f64) -> Vec<f64> {
        let settings = &self.angles[axis];
        let here = settings.partition_point(|a| nano(*a) < nano(angle));
        settings[here.saturating_sub(1)..(here + 2).min(settings.len())].to_vec()
    }

    /// The places that an exchange of position `k` tries.
    fn places(&self, test: &Test, plan: &Plan, k: usize, reach: Reach) -> Vec<[f64; 3]> {
        let angles = plan.angles[k];
        let obstacles = test.platform().obstacles();
        let is_free = |place: &[f64; 3]| {
            obstacles.is_empty() || obstacles.allow(Position::from_array(*place).nano())
        };
        let all = reach == Reach::All || self.is_coarse() || self.list.is_some();
        if all && !self.attitudes().is_empty() {
            let others = plan.without(k);
            let quickest = |triples: &Vec<[f64; 3]>| {
                let detours = triples.iter().map(|t| {
                    let position = Position::from_array(*t);
                    (detour_s(test, &others, k, position), *t)
                });
                let best = detours.reduce(|best, d| if d.0 < best.0 { d } else { best });
                best.map_or(angles, |(_, triple)| triple)
            };
            let places = self.attitudes().iter().map(quickest);
            return places.filter(is_free).collect();
        }
        let mut places = Vec::new();
        // All combinations of neighbouring settings,
        let near = [0, 1, 2].map(|axis| self.neighbours(axis, angles[axis]));
        for &a in &near[0] {
            for &b in &near[1] {
                for &g in &near[2] {
                    places.push([a, b, g]);
                }
            }
        }
        for axis in 0..3 {
            // and, axis by axis, coarse steps over the whole axis and all steps near the present angle.
            let settings = &self.angles[axis];
            let stride = settings.len().div_ceil(AXIS_ANGLES).max(1);
            let here = settings.partition_point(|a| nano(*a) < nano(angles[axis]));
            for (k, &a) in settings.iter().enumerate() {
                if k % stride == 0 || k.abs_diff(here) <= 2 * stride {
                    let mut place = angles;
                    place[axis] = a;
                    places.push(place);
                }
            }
        }
        places.retain(is_free);
        places
    }
}

/// Every combination of the settings of three axes.
fn combinations(angles: &[Vec<f64>; 3]) -> impl Iterator<Item = [f64; 3]> + '_ {
    let [alpha, beta, gamma] = angles;
    let pairs = alpha
        .iter()
        .flat_map(move |a| beta.iter().map(move |b| (*a, *b)));
    pairs.flat_map(move |(a, b)| gamma.iter().map(move |g| [a, b, *g]))
}

/// Triples by the attitude they are.
fn by_attitude(stand: &Stand, triples: &mut dyn Iterator<Item = [f64; 3]>) -> Vec<Vec<[f64; 3]>> {
    let mut known: HashMap<[i64; 3], usize> = HashMap::new();
    let mut attitudes: Vec<Vec<[f64; 3]>> = Vec::new();
    for triple in triples {
        let key = stand.attitude_key(Position::from_array(triple));
        let index = *known.entry(key).or_insert_with(|| {
            attitudes.push(Vec::new());
            attitudes.len() - 1
        });
        attitudes[index].push(triple);
    }
    attitudes
}

/// The position of a list whose attitude is nearest; itself if it is on the list, and of equally near
/// ones the first.
fn nearest_attitude(stand: &Stand, list: &[[f64; 3]], angles: [f64; 3]) -> [f64; 3] {
    if list.contains(&angles) {
        return angles;
    }
    let matrix = |angles: [f64; 3]| *stand.attitude(Position::from_array(angles)).matrix();
    let wanted = matrix(angles);
    // tr(AᵀB) = 1 + 2 cos of the angle between two attitudes.
    let likeness = |listed: &[f64; 3]| wanted.dot(&matrix(*listed));
    let alike = list.iter().map(|listed| (likeness(listed), *listed));
    let best = alike.reduce(|best, other| if other.0 > best.0 { other } else { best });
    best.map_or(angles, |(_, listed)| listed)
}

/// An angle (rad) in the whole 1e-9° that tell settings apart.
fn nano(rad: f64) -> NanoDegrees {
    NanoDegrees::nearest(deg_of_rad(rad))
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// A start snapped to a coarse table and improved by exchange, its dwells as they come.
pub(super) fn screen_on_table(
    context: Context<'_>,
    table: &IndexTable,
    plan: &Plan,
) -> Option<Refined> {
    let smoothing = context.first_smoothing();
    let snapped = table.placed(context, plan, smoothing)?;
    Some(exchange(context, table, smoothing, Reach::Near, snapped))
}

/// Work on an index table.
pub(super) struct OnTable(pub IndexTable);

impl Workshop for OnTable {
    fn try_out(
        &self,
        context: Context<'_>,
        plans: Vec<Plan>,
        smoothing: Smoothing,
    ) -> Vec<Option<Refined>> {
        let try_one = |plan| {
            let snapped = rate(context, &plan, smoothing)?;
            // The dwells first: a position that is new has one that is a guess.
            let allocated = allocate(context, snapped, smoothing);
            let once = exchange_once(context, &self.0, smoothing, Reach::Near, allocated);
            Some(allocate(context, once, smoothing))
        };
        plans.into_par_iter().map(try_one).collect()
    }

    fn work_out(&self, context: Context<'_>, plan: Refined, smoothing: Smoothing) -> Refined {
        self.in_rounds(context, smoothing, Reach::Near, plan, |r| r)
    }

    fn settle(&self, context: Context<'_>, plan: &Plan, smoothing: Smoothing) -> Option<Refined> {
        let snapped = self.0.placed(context, plan, smoothing)?;
        let drop = |r| drop_idle(context, smoothing, r);
        Some(self.in_rounds(context, smoothing, Reach::Near, snapped, drop))
    }

    fn polish(&self, context: Context<'_>, mut current: Refined) -> Option<Candidate> {
        let mut smoothing = context.first_smoothing();
        if context.evaluator.objective().criterion.has_kinks() {
            smoothing = Smoothing::PowerMean(super::finish::SHARPEST);
            current = rate(context, &current.plan, smoothing)?;
        }
        let current = self.in_rounds(context, smoothing, Reach::All, current, |r| r);
        let current = drop_idle(context, smoothing, current);
        super::finish::settle_times(context, &current.plan, true)
    }

    fn admit(&self, context: Context<'_>, plan: Plan) -> Plan {
        let snapped = self.0.snapped(context, &plan);
        let (test, total_time_s) = (context.evaluator.test(), context.problem.total_time_s);
        let fits = |plan: Plan| plan.fitted(test, total_time_s);
        if fits(snapped.clone()).is_some() {
            return snapped;
        }
        let placed = |plan: Plan| fits(self.0.snapped(context, &plan));
        brought_within(test, &plan, placed).unwrap_or(snapped)
    }
}

impl OnTable {
    /// Exchange and allocation in turn, and `then` what else a round does, until none helps.
    fn in_rounds(
        &self,
        context: Context<'_>,
        smoothing: Smoothing,
        reach: Reach,
        mut current: Refined,
        then: impl Fn(Refined) -> Refined,
    ) -> Refined {
        for _ in 0..ROUNDS {
            let before = current.merit;
            current = exchange(context, &self.0, smoothing, reach, current);
            current = then(allocate(context, current, smoothing));
            if context.must_stop() || before - current.merit < 1e-6 {
                break;
            }
        }
        current
    }
}

/// Sweeps of exchanges until one changes nothing.
///
/// Every place is estimated at the cost of one dwell ([`Estimates`]); the time that its moves take
/// more or less is counted at the price of time. The best few are rated in full.
fn exchange(
    context: Context<'_>,
    table: &IndexTable,
    smoothing: Smoothing,
    reach: Reach,
    mut current: Refined,
) -> Refined {
    for _ in 0..SWEEPS {
        let before = current.merit;
        current = exchange_once(context, table, smoothing, reach, current);
        if context.must_stop() || before - current.merit < 1e-7 {
            break;
        }
    }
    current
}

/// One sweep of exchanges.
fn exchange_once(
    context: Context<'_>,
    table: &IndexTable,
    smoothing: Smoothing,
    reach: Reach,
    mut current: Refined,
) -> Refined {
    let test = context.evaluator.test();
    let mut positions = 0..current.plan.angles.len();
    while !positions.is_empty() {
        // The estimates rest on the plan as it is: they serve one position after the other until
        // one of them is exchanged, and are made anew then.
        let timeline = current.plan.timeline(test);
        let estimates = Estimates::new(context, smoothing, &current.plan, &timeline);
        for k in positions.by_ref() {
            if context.must_stop() {
                return current;
            }
            if current.plan.is_held(k) {
                continue;
            }
            let places = table.places(test, &current.plan, k, reach);
            let best = estimates.best(k, places);
            let tried = best.into_iter().map(|place| {
                let mut plan = current.plan.clone();
                plan.replace(k, place);
                plan
            });
            let best = rate_all(context, tried.collect(), smoothing);
            let best = best.into_iter().reduce(Refined::better);
            if let Some(better) = best.filter(|b| b.merit < current.merit - GAIN) {
                current = better;
                break;
            }
        }
    }
    current
}

/// As [`rate`], of plans that have a merit.
fn rate_all(context: Context<'_>, plans: Vec<Plan>, smoothing: Smoothing) -> Vec<Refined> {
    let evaluator = context.evaluator;
    if evaluator.model().is_white() {
        let rated = plans
            .iter()
            .filter_map(|plan| rate(context, plan, smoothing));
        return rated.collect();
    }
    // Where something wanders a few at once take hardly longer than one.
    let (test, total_time_s) = (evaluator.test(), context.problem.total_time_s);
    let fitted = plans
        .into_iter()
        .filter_map(|plan| plan.fitted_timeline(test, total_time_s));
    let (plans, timelines): (Vec<Plan>, Vec<Timeline>) = fitted.unzip();
    context.work.count_evaluations(plans.len() as u64);
    let merits = evaluator.merits(&timelines, smoothing);
    let rated = merits.into_iter().zip(plans).filter_map(|(merit, plan)| {
        let merit = merit.ok().filter(|m| m.is_finite())?;
        Some(Refined { plan, merit })
    });
    rated.collect()
}

/// Removes positions one by one, the most idle first, as long as the merit loses less than the
/// tolerance by it.
fn drop_idle(context: Context<'_>, smoothing: Smoothing, mut current: Refined) -> Refined {
    while current.plan.angles.len() > 1 && !context.must_stop() {
        let positions = (0..current.plan.angles.len()).filter(|k| !current.plan.is_held(*k));
        let without = positions.map(|k| current.plan.without(k)).collect();
        let mut fewer = rate_all(context, without, smoothing);
        if !context.evaluator.model().is_white() {
            // An allocation takes as long as many ratings there, and positions are twice as many.
            fewer.sort_by(|a, b| a.merit.total_cmp(&b.merit));
            fewer.truncate(DROPPED);
        }
        let fewer = fewer
            .into_iter()
            .map(|refined| allocate(context, refined, smoothing))
            .reduce(Refined::better);
        match fewer {
            Some(fewer) if fewer.merit - current.merit <= context.problem.position_tolerance => {
                current = fewer;
            }
            _ => break,
        }
    }
    current
}

#[cfg(test)]
mod tests {
    use std::ops::RangeInclusive;

    use super::*;
    use crate::evaluate::{Evaluator, Objective};
    use crate::platform::PlatformConfig;
    use crate::search::context::WorkDone;
    use crate::search::{Control, SearchProblem, search};

    fn evaluator() -> Evaluator {
        evaluator_with(|_| {})
    }

    fn evaluator_with(change: impl FnOnce(&mut PlatformConfig)) -> Evaluator {
        let mut config = PlatformConfig::default();
        config.gimbals.step_deg = Some(90.0);
        change(&mut config);
        // What is enumerated is rated by the criterion.
        let objective = Objective {
            separability_weight: 0.0,
            ..Objective::default()
        };
        Evaluator::new(config.check().unwrap(), objective)
    }

    #[test]
    fn a_quarter_turn_table_holds_the_24_rotations_of_the_cube() {
        let evaluator = evaluator();
        let table = IndexTable::new(evaluator.test().platform()).unwrap();
        assert_eq!(table.attitudes().len(), 24);
        assert_eq!(table.attitudes().iter().map(Vec::len).sum::<usize>(), 64);
        assert_eq!(table.sample(1000).len(), 64);
        // A stride that shares no factor with an axis reaches every angle of each.
        let some = table.sample(16);
        for axis in 0..3 {
            let mut angles: Vec<i64> = some
                .iter()
                .map(|p| (p.to_array()[axis] * 1e6) as i64)
                .collect();
            angles.sort_unstable();
            angles.dedup();
            assert_eq!(angles.len(), 4);
        }
    }

    /// Every sequence of `count` of the attitudes, no two the same in a row, with equal dwells.
    fn sequences(context: Context<'_>, count: usize) -> Vec<Refined> {
        let table = IndexTable::new(context.evaluator.test().platform()).unwrap();
        let places: Vec<[f64; 3]> = table.attitudes().iter().map(|a| a[0]).collect();
        let n = places.len();
        (0..n.pow(count as u32))
            .into_par_iter()
            .filter_map(|mut index| {
                let mut angles = Vec::with_capacity(count);
                let mut last = n;
                for _ in 0..count {
                    let k = index % n;
                    if k == last {
                        return None;
                    }
                    (last, index) = (k, index / n);
                    angles.push(places[k]);
                }
                let dwell_s = vec![1.0; count];
                rate(context, &Plan::new(angles, dwell_s), Smoothing::Exact)
            })
            .collect()
    }

    /// Proof by enumeration: all 24^K sequences with equal dwells; of the best of them, more than
    /// any reallocation makes up for, with dwells allocated too.
    #[test]
    fn up_to_four_positions_are_the_exact_optimum() {
        are_the_exact_optimum(&evaluator(), 1..=4);
    }

    /// Where exchanges are estimated with what wanders.
    #[test]
    fn where_drift_walks_up_to_three_positions_are_the_exact_optimum() {
        let walking = evaluator_with(|config| {
            config.gyro.rate_random_walk_deg_per_h_per_sqrt_h = Some(0.003);
        });
        are_the_exact_optimum(&walking, 1..=3);
    }

    fn are_the_exact_optimum(evaluator: &Evaluator, counts: RangeInclusive<usize>) {
        /// Sequences whose dwells are allocated.
        const ALLOCATED: usize = 400;
        let work = WorkDone::default();
        let control = Control::default();
        for count in counts {
            let problem = SearchProblem {
                max_positions: count,
                position_tolerance: 0.0,
                ..SearchProblem::default()
            };
            let context = Context {
                evaluator,
                problem: &problem,
                control: &control,
                work: &work,
            };
            let mut all = sequences(context, count);
            all.sort_by(|a, b| a.merit.total_cmp(&b.merit));
            all.truncate(ALLOCATED);
            let last_equal = all[all.len() - 1].merit;
            let allocated: Vec<(f64, f64)> = all
                .into_par_iter()
                .map(|r| (r.merit, allocate(context, r, Smoothing::Exact).merit))
                .collect();
            let optimum = allocated.iter().map(|a| a.1).fold(f64::INFINITY, f64::min);
            let most_gained = allocated.iter().map(|a| a.0 - a.1).fold(0.0, f64::max);
            // What was left out would have to gain more than any did.
            if allocated.len() == ALLOCATED {
                assert!(last_equal - most_gained > optimum, "{count} positions");
            }
            let found = search(evaluator, &problem, &control).unwrap();
            let found = found.evaluation.score.criterion.ln();
            // Whole filter periods cost a few millionths, and an allocation stops about as far
            // from its best.
            assert!(
                (found - optimum).abs() < 3e-5,
                "{count} positions: {found} for {optimum}"
            );
        }
    }
}
