//! Whether errors are as large as a filter says: averages of χ² statistics against their bounds
//! (Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and Navigation*,
//! 2001, section 5.4).
//!
//! The sum of N independent χ² statistics with m degrees of freedom is χ² with N m. The average
//! of a consistent filter lies between the 2.5 % and the 97.5 % quantile of that, divided by N,
//! in 95 of 100 experiments, and outside in the other five. Where several averages together make
//! one verdict, their bounds are wider, so that all of them lie within in 95 of 100 experiments
//! (Bonferroni's inequality).

use std::fmt;

use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability with which a consistent filter lies within the bounds.
pub const PROBABILITY: f64 = 0.95;

/// What the comparison says of a filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Errors are as large as the filter says.
    Consistent,
    /// Errors are larger: the filter claims more than it knows.
    Optimistic,
    /// Errors are smaller: the filter knows more than it claims.
    Pessimistic,
    /// Some averages are larger and some smaller than the filter says: its model is wrong.
    Inconsistent,
    /// The filter lost the platform in some run, see [`divergence`](super::divergence): whatever
    /// averages say, it cannot be relied on.
    Diverged,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Consistent => "consistent",
            Self::Optimistic => "optimistic",
            Self::Pessimistic => "pessimistic",
            Self::Inconsistent => "inconsistent",
            Self::Diverged => "diverged",
        })
    }
}

/// An average of χ² statistics, its bounds and the verdict.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Consistency {
    /// The average; its expected value is `degrees_of_freedom`.
    pub average: f64,
    /// Degrees of freedom of one statistic.
    pub degrees_of_freedom: usize,
    /// How many statistics are averaged.
    pub count: usize,
    /// Lower and upper bound of the average.
    pub bounds: [f64; 2],
    /// Probability with which the average of a consistent filter lies between them.
    #[serde(default = "alone")]
    pub probability: f64,
    /// What that says.
    pub verdict: Verdict,
}

/// The probability of bounds in documents that do not say it.
fn alone() -> f64 {
    PROBABILITY
}

impl Consistency {
    /// From the `sum` of `count` statistics with `degrees_of_freedom` each: one of `among` averages
    /// that a consistent filter has all within their bounds in 95 of 100 experiments.
    ///
    /// `None` when nothing was summed.
    ///
    /// ```
    /// use scheme_opt::internals::simulate::consistency::{Consistency, Verdict};
    /// let c = Consistency::of_sum(1, 1500.0, 15, 100).unwrap();
    /// assert_eq!((c.average, c.verdict), (15.0, Verdict::Consistent));
    /// assert!(c.bounds[0] > 13.9 && c.bounds[1] < 16.1);
    /// let c = Consistency::of_sum(1, 2000.0, 15, 100).unwrap();
    /// assert_eq!(c.verdict, Verdict::Optimistic);
    /// ```
    pub fn of_sum(among: usize, sum: f64, degrees_of_freedom: usize, count: usize) -> Option<Self> {
        let average = sum / count as f64;
        let probability = 1.0 - (1.0 - PROBABILITY) / among as f64;
        Self::new(average, degrees_of_freedom, count, probability)
    }

    /// The same average with the bounds that it has when nothing else is looked at.
    pub(super) fn by_itself(&self) -> Option<Self> {
        Self::new(
            self.average,
            self.degrees_of_freedom,
            self.count,
            PROBABILITY,
        )
    }

    fn new(
        average: f64,
        degrees_of_freedom: usize,
        count: usize,
        probability: f64,
    ) -> Option<Self> {
        let bounds = quantiles(degrees_of_freedom * count, probability)?.map(|q| q / count as f64);
        // NaN, from a run that lost itself altogether, is anything but consistent.
        let verdict = if average < bounds[0] {
            Verdict::Pessimistic
        } else if average <= bounds[1] {
            Verdict::Consistent
        } else {
            Verdict::Optimistic
        };
        Some(Self {
            average,
            degrees_of_freedom,
            count,
            bounds,
            probability,
            verdict,
        })
    }
}

/// The 2.5 % and 97.5 % quantiles of χ² with that many degrees of freedom; none for zero.
pub fn chi_squared_bounds(degrees_of_freedom: usize) -> Option<[f64; 2]> {
    quantiles(degrees_of_freedom, PROBABILITY)
}

/// The quantiles of χ² with `probability` between them and as much on either side.
fn quantiles(degrees_of_freedom: usize, probability: f64) -> Option<[f64; 2]> {
    // Zero degrees of freedom are all that it refuses.
    let distribution = ChiSquared::new(degrees_of_freedom as f64).ok()?;
    let tail = 0.5 * (1.0 - probability);
    Some([
        distribution.inverse_cdf(tail),
        distribution.inverse_cdf(1.0 - tail),
    ])
}

/// Bounds of √(mean of squares) of `count` standard normal numbers: the band of an RMS error
/// divided by its predicted σ. `None` for a count of zero.
pub fn rms_ratio_bounds(count: usize) -> Option<[f64; 2]> {
    Some(chi_squared_bounds(count)?.map(|q| (q / count as f64).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        // Abramowitz & Stegun, table 26.8: χ²(0.975 and 0.025 upper tail).
        for (dof, low, high) in [
            (1, 0.000_982_069, 5.02389),
            (10, 3.24697, 20.4831),
            (100, 74.2219, 129.561),
        ] {
            let [l, h] = chi_squared_bounds(dof).unwrap();
            assert!((l / low - 1.0).abs() < 1e-5 && (h / high - 1.0).abs() < 1e-5);
        }
        // Wilson–Hilferty where the tables end.
        let n = 1.2e6_f64;
        let expected = [-1.959_964, 1.959_964].map(|z| {
            let s = 2.0 / (9.0 * n);
            n * (1.0 - s + z * s.sqrt()).powi(3)
        });
        let found = chi_squared_bounds(1_200_000).unwrap();
        for (f, e) in found.iter().zip(expected) {
            assert!((f / e - 1.0).abs() < 1e-6);
        }
        assert_eq!(chi_squared_bounds(0), None);
    }

    #[test]
    fn bounds_among_others_are_wider() {
        let alone = Consistency::of_sum(1, 15.0 * 100.0, 15, 100).unwrap();
        let among = Consistency::of_sum(3, 15.0 * 100.0, 15, 100).unwrap();
        assert!(among.bounds[0] < alone.bounds[0] && alone.bounds[1] < among.bounds[1]);
        assert_eq!(alone.probability, PROBABILITY);
        assert!((1.0 - among.probability - 0.05 / 3.0).abs() < 1e-15);
        // 1500 − 2.394 √3000 and the same above, to the skewness of χ².
        assert!((among.bounds[0] - 13.72).abs() < 0.03 && (among.bounds[1] - 16.34).abs() < 0.03);
    }

    #[test]
    fn a_sum_that_is_no_number_is_not_consistent() {
        let c = Consistency::of_sum(1, f64::NAN, 15, 10).unwrap();
        assert_eq!(c.verdict, Verdict::Optimistic);
    }
}
