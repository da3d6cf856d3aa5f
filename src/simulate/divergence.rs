//! Runs in which the filter lost the platform.
//!
//! A filter that linearises can settle on a trajectory that is not the true one. Its covariance
//! does not notice: that run is wrong by orders of magnitude, and its σ are as small as ever. One
//! such run in a hundred spoils every mean and hides in every average, so runs are looked at one
//! by one.
//!
//! # Definition
//!
//! A run **diverged** when at least one of these holds:
//!
//! - its error or its residuals are not finite;
//! - its NEES at the end, eᵀ P⁻¹ e, is beyond chance;
//! - its NIS, summed over the ticks, is beyond chance;
//! - an iterated filter's estimate still moved by more than its own 1σ in the last pass.
//!
//! Both normalised squares are χ² when the filter is right, with as many degrees of freedom as
//! there are uncertain states and measurements. *Beyond chance* means a tail probability below
//! [`FALSE_ALARM_PROBABILITY`] / 2N for N runs: by Bonferroni's inequality a filter that is right
//! about itself has a run called diverged, wrongly, in one of a million simulations, however many
//! runs each has.
//!
//! A filter that is told a third of the noise has all its errors three times too large. That is an
//! optimistic filter, not a hundred diverged runs. So before the comparison the squares are
//! divided by what the lower quartile of the runs exceeds that of χ² by, where it exceeds it: runs
//! diverge from the others. The lower quartile is right until three of four runs have diverged,
//! where a mean is spoilt by one; and beyond that its factor is bounded: errors of more than
//! a hundred times what the filter says are no optimism, however many runs have them. The verdict on the filter, which has no such factor, is in
//! [`judgement`](super::judgement).

use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Probability that a simulation of a filter that is right about itself has a run called diverged.
pub const FALSE_ALARM_PROBABILITY: f64 = 1e-6;

/// How many diverged runs are listed one by one.
pub const MOST_LISTED: usize = 20;

/// The largest factor between the squares and χ² that is put down to optimism: errors a hundred times
/// as large as the filter says. Beyond it most runs have diverged.
const MOST_OPTIMISTIC: f64 = 1e4;

/// An iterated filter has not settled when its last pass moved the estimate by more than this,
/// squared and in σ.
const UNSETTLED: f64 = 1.0;

/// By what a diverged run is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Sign {
    /// Its error or its residuals are not finite.
    NotFinite,
    /// Its NEES is beyond chance. Nobody at a stand sees that: it takes the truth.
    Error,
    /// Its NIS is beyond chance: the measurements contradict the filter, and the stand sees it.
    Residuals,
    /// The iterated filter did not settle, which the stand sees too.
    Unsettled,
}

/// What is known of one run at its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RunSquares {
    /// eᵀ P⁻¹ e over all states.
    pub nees: f64,
    /// Its degrees of freedom.
    pub nees_dof: usize,
    /// Sum over the ticks of νᵀ S⁻¹ ν.
    pub nis: f64,
    /// Its degrees of freedom.
    pub nis_dof: usize,
    /// How far the last pass of an iterated filter moved the estimate, squared and in σ.
    pub moved: Option<f64>,
    /// √(mean of the squared errors of the coefficients), °/h.
    pub rms_error_deg_per_h: f64,
}

/// A run that diverged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct DivergedRun {
    /// Its number, from 0: what [`Simulation::draw`](super::Simulation::draw) takes.
    pub run: u64,
    /// By what it is known.
    pub signs: Vec<Sign>,
    /// √(mean of the squared errors of the coefficients), °/h; null: not finite.
    pub rms_error_deg_per_h: Option<f64>,
}

/// The runs that diverged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Divergence {
    /// How many runs diverged.
    pub count: usize,
    /// Of how many.
    pub runs: usize,
    /// How many of them the stand would notice: residuals beyond chance, or no settling.
    pub noticed: usize,
    /// Probability that a filter that is right about itself has one called diverged.
    pub false_alarm_probability: f64,
    /// √(mean over the coefficients of the squared errors) of the other runs, °/h; null: there is
    /// none.
    pub rms_error_of_the_others_deg_per_h: Option<f64>,
    /// The first of them, [`MOST_LISTED`] at most.
    pub listed: Vec<DivergedRun>,
}

impl Divergence {
    /// Looks for the diverged ones of `runs`.
    pub(super) fn of(runs: &[RunSquares]) -> Self {
        let nees = Chance::new(runs.iter().map(|r| (r.nees, r.nees_dof)));
        let nis = Chance::new(runs.iter().map(|r| (r.nis, r.nis_dof)));
        let signs = |r: &RunSquares| {
            let finite = r.nees.is_finite() && r.nis.is_finite();
            let shown = [
                (
                    Sign::NotFinite,
                    !finite || !r.rms_error_deg_per_h.is_finite(),
                ),
                (Sign::Error, nees.is_beyond(r.nees, r.nees_dof)),
                (Sign::Residuals, nis.is_beyond(r.nis, r.nis_dof)),
                (Sign::Unsettled, r.moved.is_some_and(|m| m > UNSETTLED)),
            ];
            let shown = shown.into_iter().filter(|(_, is)| *is);
            shown.map(|(sign, _)| sign).collect::<Vec<Sign>>()
        };
        let all: Vec<Vec<Sign>> = runs.iter().map(signs).collect();
        let visible = |s: &Sign| !matches!(s, Sign::Error);
        let (mut sum, mut others) = (0.0, 0_usize);
        for (run, _) in runs.iter().zip(&all).filter(|(_, signs)| signs.is_empty()) {
            sum += run.rms_error_deg_per_h.powi(2);
            others += 1;
        }
        let diverged = || {
            (0..)
                .zip(all.iter().zip(runs))
                .filter(|(_, (s, _))| !s.is_empty())
        };
        Self {
            count: runs.len() - others,
            runs: runs.len(),
            noticed: diverged()
                .filter(|(_, (s, _))| s.iter().any(visible))
                .count(),
            false_alarm_probability: FALSE_ALARM_PROBABILITY,
            rms_error_of_the_others_deg_per_h: (others > 0).then(|| (sum / others as f64).sqrt()),
            listed: diverged()
                .take(MOST_LISTED)
                .map(|(run, (signs, squares))| DivergedRun {
                    run,
                    signs: signs.clone(),
                    rms_error_deg_per_h: Some(squares.rms_error_deg_per_h)
                        .filter(|e| e.is_finite()),
                })
                .collect(),
        }
    }
}

/// What counts as chance for one kind of square.
struct Chance {
    /// What the squares are divided by.
    scale: f64,
    /// Tail probability of one run.
    tail: f64,
}

impl Chance {
    fn new(squares: impl Iterator<Item = (f64, usize)>) -> Self {
        let all: Vec<(f64, usize)> = squares.collect();
        let count = all.len();
        // By the degrees of freedom, which are the same in every run of a simulation. What is not
        // finite sorts last.
        let dof = all.iter().map(|(_, dof)| *dof).max().unwrap_or(0);
        let mut values: Vec<f64> = all.iter().map(|(v, _)| v.abs()).collect();
        values.sort_by(f64::total_cmp);
        let quartile = ChiSquared::new(dof as f64).map(|c| c.inverse_cdf(0.25));
        let scale = match (quartile, values.get(count.saturating_sub(1) / 4)) {
            (Ok(expected), Some(found)) if found.is_finite() => {
                (found / expected).clamp(1.0, MOST_OPTIMISTIC)
            }
            _ => 1.0,
        };
        Self {
            scale,
            tail: FALSE_ALARM_PROBABILITY / (2 * count.max(1)) as f64,
        }
    }

    /// Whether a square is larger than chance has it.
    fn is_beyond(&self, square: f64, dof: usize) -> bool {
        // The upper tail itself and not 1 − cdf, which has no digits left out there.
        ChiSquared::new(dof as f64)
            .is_ok_and(|c| square.is_finite() && c.sf(square / self.scale) < self.tail)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::Distribution;

    fn run(nees: f64) -> RunSquares {
        RunSquares {
            nees,
            nees_dof: 15,
            nis: 2400.0,
            nis_dof: 2400,
            moved: Some(1e-4),
            rms_error_deg_per_h: 0.001,
        }
    }

    /// `count` runs of a filter that is right about itself.
    fn right(count: usize, seed: u64) -> Vec<RunSquares> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut draw = |dof: usize| {
            let chi = rand_distr::ChiSquared::new(dof as f64).unwrap();
            chi.sample(&mut random)
        };
        let runs = (0..count).map(|_| RunSquares {
            nis: draw(2400),
            ..run(draw(15))
        });
        runs.collect()
    }

    #[test]
    fn runs_that_are_all_lost_have_all_diverged() {
        for count in [2, 7, 40] {
            let lost = (0..count).map(|k| run(15.0 * 1e6 * (1.0 + k as f64)));
            let found = Divergence::of(&lost.collect::<Vec<_>>());
            assert_eq!(found.count, count);
            assert_eq!(found.rms_error_of_the_others_deg_per_h, None);
        }
        // A filter that is told a tenth of the noise is optimistic and no more.
        let optimistic: Vec<_> = right(40, 5)
            .into_iter()
            .map(|r| RunSquares {
                nees: 100.0 * r.nees,
                ..r
            })
            .collect();
        assert_eq!(Divergence::of(&optimistic).count, 0);
    }

    #[test]
    fn a_planted_divergence_is_found_by_its_sign() {
        type Plant = fn(&mut RunSquares);
        let plants: [(Plant, Sign, usize); 5] = [
            (|r| r.nees = 1e6, Sign::Error, 0),
            (|r| r.nees = 110.0, Sign::Error, 0),
            (|r| r.nis = 3000.0, Sign::Residuals, 1),
            (|r| r.moved = Some(1.5), Sign::Unsettled, 1),
            (|r| r.nees = f64::NAN, Sign::NotFinite, 1),
        ];
        for (plant, sign, noticed) in plants {
            let mut runs = right(100, 1);
            runs[37].rms_error_deg_per_h = 204.0;
            plant(&mut runs[37]);
            let found = Divergence::of(&runs);
            assert_eq!((found.count, found.runs, found.noticed), (1, 100, noticed));
            assert_eq!(found.listed[0].run, 37);
            assert_eq!(found.listed[0].signs, [sign]);
            assert_eq!(found.listed[0].rms_error_deg_per_h, Some(204.0));
            let others = found.rms_error_of_the_others_deg_per_h.unwrap();
            assert!((others / 0.001 - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn chance_is_not_divergence() {
        for seed in 0..200 {
            assert_eq!(Divergence::of(&right(100, seed)).count, 0, "seed {seed}");
        }
        assert_eq!(Divergence::of(&right(2, 1)).count, 0);
        assert_eq!(Divergence::of(&right(100_000, 1)).count, 0);
    }

    #[test]
    fn a_filter_wrong_in_all_runs_alike_has_not_diverged() {
        for factor in [1e-3, 9.0, 5e3] {
            let mut runs = right(100, 3);
            for r in &mut runs {
                r.nees *= factor;
                r.nis *= factor;
            }
            assert_eq!(Divergence::of(&runs).count, 0, "{factor}");
            runs[5].nees *= 1e3;
            assert_eq!(Divergence::of(&runs).count, usize::from(factor > 1.0));
        }
    }

    #[test]
    fn most_runs_may_diverge_and_are_still_counted() {
        let mut runs = right(100, 4);
        for r in &mut runs[30..] {
            r.nees = 1e7;
        }
        let found = Divergence::of(&runs);
        assert_eq!((found.count, found.listed.len()), (70, MOST_LISTED));
        for r in &mut runs {
            r.nees = f64::NAN;
        }
        let found = Divergence::of(&runs);
        assert_eq!(found.count, 100);
        assert_eq!(found.rms_error_of_the_others_deg_per_h, None);
    }

    #[test]
    fn what_is_known_exactly_cannot_diverge() {
        let known = RunSquares {
            nees: 0.0,
            nees_dof: 0,
            nis: 0.0,
            nis_dof: 0,
            moved: None,
            rms_error_deg_per_h: 0.0,
        };
        assert_eq!(Divergence::of(&[known; 3]).count, 0);
    }
}
