//! Durations as whole filter periods: the tick of the filter ends each of them.

/// Most filter periods a timeline may have: the step-by-step filter visits each of them.
pub const MAX_FILTER_PERIODS: f64 = 2e6;

/// Durations to whole periods by largest remainder, none of fewer than `fewest` periods, filling
/// `budget_s` but for less than a period; none when that is impossible.
pub(crate) fn whole_periods(
    period_s: f64,
    fewest: f64,
    duration_s: &[f64],
    budget_s: f64,
) -> Option<Vec<f64>> {
    let available = (budget_s / period_s + 1e-9).floor();
    if !(1.0..=MAX_FILTER_PERIODS).contains(&available) {
        return None;
    }
    let mut periods: Vec<f64> = duration_s
        .iter()
        .map(|d| (d / period_s + 1e-9).floor().max(fewest))
        .collect();
    let mut spare = available - periods.iter().sum::<f64>();
    // Too many because of the minimum: take from the longest.
    while spare < 0.0 {
        let longest = index_of_largest(&periods)?;
        if periods[longest] <= fewest {
            return None;
        }
        periods[longest] -= 1.0;
        spare += 1.0;
    }
    let mut order: Vec<usize> = (0..periods.len()).collect();
    let missing = |k: usize| duration_s[k] / period_s - periods[k];
    order.sort_by(|&a, &b| missing(b).total_cmp(&missing(a)).then(a.cmp(&b)));
    // Everyone gets the same whole share, the first in order one more.
    let share = (spare / periods.len() as f64).floor();
    let extra = (spare - share * periods.len() as f64) as usize;
    for (rank, k) in order.into_iter().enumerate() {
        periods[k] += share + if rank < extra { 1.0 } else { 0.0 };
    }
    Some(periods.iter().map(|n| n * period_s).collect())
}

fn index_of_largest(values: &[f64]) -> Option<usize> {
    (0..values.len()).reduce(|best, k| if values[k] > values[best] { k } else { best })
}

#[cfg(test)]
mod tests {
    use super::whole_periods;

    #[test]
    fn the_budget_is_filled_but_for_less_than_a_period() {
        let found = whole_periods(10.0, 2.0, &[33.0, 47.0, 5.0], 87.0).unwrap();
        assert_eq!(found, [30.0, 30.0, 20.0]);
        let found = whole_periods(10.0, 1.0, &[100.0, 100.0, 100.0], 309.0).unwrap();
        assert_eq!(found.iter().sum::<f64>(), 300.0);
        assert_eq!(whole_periods(10.0, 4.0, &[40.0, 40.0], 79.0), None);
        assert_eq!(whole_periods(10.0, 1.0, &[40.0], 9.0), None);
    }
}
