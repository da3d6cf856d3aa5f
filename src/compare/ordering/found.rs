//! A good order by local search: descents from the given order and from random ones, and kicks.

use rand::seq::{IndexedRandom, SliceRandom};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::orders::{Orders, Rated, SAME};

/// Random orders that a descent begins at, besides the given one.
const RANDOM_ORDERS: usize = 4;
/// Kicks in a row that may win nothing before the search is done.
const PATIENCE: usize = 30;
/// Orders rated before no further kick is tried.
const MOST_RATED: usize = 60_000;
/// More changes than this are not tried at once; a random choice of them is.
const MOST_CHANGES: usize = 1_000;
/// Longest segment that is displaced.
const LONGEST_SEGMENT: usize = 3;

/// The best order that is found; none when no order that is tried has a merit.
pub(super) fn search(orders: &Orders<'_>, seed: u64) -> Option<Rated> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut rated = 0;
    let given: Vec<usize> = (0..orders.positions.len()).collect();
    let mut starts = vec![given.clone()];
    for _ in 0..RANDOM_ORDERS {
        let mut shuffled = given.clone();
        shuffled.shuffle(&mut random);
        starts.push(shuffled);
    }
    let descents = starts
        .into_iter()
        .filter_map(|start| descend(orders, start, &mut random, &mut rated));
    let mut best = descents.reduce(Rated::better)?;
    let mut idle = 0;
    while idle < PATIENCE && rated < MOST_RATED && given.len() > 3 {
        let kicked = kicked(&best.order, &mut random);
        let found = descend(orders, kicked, &mut random, &mut rated);
        match found.filter(|found| found.merit < best.merit - SAME) {
            Some(better) => (best, idle) = (better, 0),
            None => idle += 1,
        }
    }
    Some(best)
}

/// The best order that is found by rating about `most_rated` of them: from the given one, small changes in
/// random sequence, several at a time, the best of them taken as soon as it is better; none when no order
/// that is tried has a merit.
pub(super) fn quick(orders: &Orders<'_>, seed: u64, most_rated: usize) -> Option<Rated> {
    /// Changes that are rated at a time.
    const AT_A_TIME: usize = 16;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let given: Vec<usize> = (0..orders.positions.len()).collect();
    let mut best = orders.rated(&[given]).pop()?;
    let mut rated = 1;
    loop {
        let mut changed = changes(&best.order);
        changed.shuffle(&mut random);
        let mut better = None;
        for some in changed.chunks(AT_A_TIME) {
            if rated >= most_rated {
                return Some(best);
            }
            rated += some.len();
            let found = orders.rated(some).into_iter().reduce(Rated::better);
            better = found.filter(|found| found.merit < best.merit - SAME);
            if better.is_some() {
                break;
            }
        }
        match better {
            Some(better) => best = better,
            None => return Some(best),
        }
    }
}

/// The order that no change makes better.
fn descend(
    orders: &Orders<'_>,
    start: Vec<usize>,
    random: &mut ChaCha8Rng,
    rated: &mut usize,
) -> Option<Rated> {
    let mut current = orders.rated(std::slice::from_ref(&start)).pop();
    let mut order = start;
    loop {
        let mut changed = changes(&order);
        if changed.len() > MOST_CHANGES {
            changed = changed.sample(random, MOST_CHANGES).cloned().collect();
        }
        *rated += changed.len();
        let next = orders.rated(&changed).into_iter().reduce(Rated::better);
        // An order that does not fit into the time is left for any that does.
        match (next, &current) {
            (Some(next), Some(now)) if next.merit >= now.merit - SAME => return current,
            (None, _) => return current,
            (Some(next), _) => {
                order.clone_from(&next.order);
                current = Some(next);
            }
        }
    }
}

/// Every reversal of a segment, every displacement of a short one, either way round, and every
/// exchange of two positions.
fn changes(order: &[usize]) -> Vec<Vec<usize>> {
    let count = order.len();
    let mut all = Vec::new();
    for from in 0..count {
        for to in from + 1..count {
            let mut reversed = order.to_vec();
            reversed[from..=to].reverse();
            all.push(reversed);
            if to > from + 2 {
                let mut exchanged = order.to_vec();
                exchanged.swap(from, to);
                all.push(exchanged);
            }
        }
        for length in 1..=LONGEST_SEGMENT.min(count - from) {
            for to in (0..=count - length).filter(|to| *to != from) {
                let mut moved = order.to_vec();
                let mut segment: Vec<usize> = moved.drain(from..from + length).collect();
                let mut turned = moved.clone();
                moved.splice(to..to, segment.iter().copied());
                all.push(moved);
                if length > 1 {
                    segment.reverse();
                    turned.splice(to..to, segment);
                    all.push(turned);
                }
            }
        }
    }
    all
}

/// Four segments in another order, two of them exchanged: what no change above undoes at once.
fn kicked(order: &[usize], random: &mut ChaCha8Rng) -> Vec<usize> {
    let mut cuts = [0; 3].map(|_| random.random_range(0..=order.len()));
    cuts.sort_unstable();
    let [a, b, c] = cuts;
    let mut kicked = [&order[..a], &order[b..c], &order[a..b], &order[c..]].concat();
    let (i, j) = (
        random.random_range(0..order.len()),
        random.random_range(0..order.len()),
    );
    kicked.swap(i, j);
    kicked
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_change_is_another_order() {
        let order = [3, 1, 4, 0, 2, 6, 5];
        let changed = changes(&order);
        assert!(changed.len() > 100);
        for changed in changed {
            assert_ne!(changed, order);
            let mut sorted = changed;
            sorted.sort_unstable();
            assert_eq!(sorted, [0, 1, 2, 3, 4, 5, 6]);
        }
        assert!(changes(&[0]).is_empty());
    }

    #[test]
    fn a_kick_loses_nothing() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        for _ in 0..100 {
            let mut sorted = kicked(&[0, 1, 2, 3, 4], &mut random);
            sorted.sort_unstable();
            assert_eq!(sorted, [0, 1, 2, 3, 4]);
        }
    }
}
