//! Which of the coefficients that count stay unobservable: by a schedule, and on a stand whatever
//! the schedule.
//!
//! A coefficient counts when the criterion has a weight or a specification for it. It is observable
//! when it lies in the row space of the channels, with what is known exactly before the test (a
//! prior σ of zero) taken away. One that does not, and whose σ the test does not make
//! [`USEFUL`] times smaller by way of what it is mixed with, stays unobservable; within its
//! specification it is nobody's concern.
//!
//! Of a **stand** the space is that of all attitudes that it can take, and pass on the way
//! ([`crate::observability::stand`]): what lies outside it no schedule on this stand can observe, whatever
//! its positions and its time.

use std::fmt;

use crate::attitude::UP;
use crate::drift::{COEFFICIENTS, DriftCoefficient};
use crate::error::Result;
use crate::evaluate::{Evaluation, Evaluator};
use crate::motion::Timeline;
use crate::observability::Combination;
use crate::observability::regressor::{Channel, Regressor, UNKNOWNS};
use crate::observability::row_space::{RowSpace, unit};
use crate::observability::stand::rows_of_stand;
use crate::platform::Platform;
use crate::schedule::Schedule;

/// A σ that is this part of the prior's is an improvement, whatever the row space says.
pub const USEFUL: f64 = 0.1;

/// The coefficients that count and stay unobservable.
/// [`fmt::Display`] says which are not acceptable; nothing where none is.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Unobservable {
    /// Those that no schedule on this stand can observe.
    pub on_this_stand: Vec<DriftCoefficient>,
    /// Those that this schedule does not observe; another one, of more positions, could.
    pub by_this_schedule: Vec<DriftCoefficient>,
    /// Those of either sort that `objective.accept_unobservable` names; in neither list above.
    pub accepted: Vec<DriftCoefficient>,
    /// The combinations that no schedule on this stand can observe; empty where every coefficient
    /// that counts can be.
    pub combinations: Vec<Combination>,
}

impl Unobservable {
    /// Of `schedule`, whose `evaluation` was made by `evaluator`.
    ///
    /// ```
    /// use scheme_opt::internals::drift::DriftCoefficient as D;
    /// use scheme_opt::internals::evaluate::{Evaluator, Objective};
    /// use scheme_opt::internals::analysis::Unobservable;
    /// use scheme_opt::internals::platform::PlatformConfig;
    /// use scheme_opt::internals::schedule::standard::StandardScheme;
    /// let mut config = PlatformConfig::default();
    /// config.site.latitude_deg = 90.0;
    /// let evaluator = Evaluator::new(config.check()?, Objective::default());
    /// let schedule = StandardScheme::Icosahedron12.schedule(12_000.0, evaluator.test())?;
    /// let evaluation = evaluator.evaluate(&schedule)?;
    /// let found = Unobservable::of(&evaluator, &schedule, &evaluation)?;
    /// assert_eq!(found.on_this_stand, [D::IX, D::IY, D::IZ]);
    /// assert_eq!(found.combinations[0].to_string(), "D_IX + D_IY + D_IZ");
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when a singular value decomposition does
    /// not converge; as [`Timeline::new`].
    pub fn of(evaluator: &Evaluator, schedule: &Schedule, evaluation: &Evaluation) -> Result<Self> {
        let (platform, model) = (evaluator.test().platform(), evaluator.model());
        let timeline = Timeline::new(evaluator.test(), schedule)?;
        let regressor = Regressor::new(model, &timeline);
        let known = known(platform);
        let space = |rows: Vec<[f64; UNKNOWNS]>| {
            let all: Vec<_> = rows.into_iter().chain(known.iter().copied()).collect();
            RowSpace::of(&all)
        };
        let observed = space(regressor.geometry(&Channel::ALL));
        let missed = stays_unobservable(evaluator, evaluation, &observed);
        if missed.is_empty() {
            return Ok(Self::default());
        }
        let observable = space(rows_of_stand(platform));
        let accepts = |c: &DriftCoefficient| evaluator.objective().accept_unobservable[c.index()];
        // What only ω_N ψ_y(0) stands in the way of is known through the prior of the misalignment
        // by a schedule with enough positions: the stand is not to blame.
        let mut with_azimuth = rows_of_stand(platform);
        with_azimuth.push(unit(COEFFICIENTS));
        let reachable = space(with_azimuth);
        let hopeless = |c: &DriftCoefficient| !reachable.contains(&unit(c.index()));
        let (accepted, missed): (Vec<_>, Vec<_>) = missed.into_iter().partition(accepts);
        let by_stand = missed.iter().chain(&accepted).any(hopeless);
        let (on_this_stand, by_this_schedule) = missed.into_iter().partition(hopeless);
        let combinations = match by_stand {
            true => observable.missing(regressor.unknowns()),
            false => Vec::new(),
        };
        Ok(Self {
            on_this_stand,
            by_this_schedule,
            accepted,
            combinations: combinations
                .into_iter()
                .map(Combination::from_array)
                .collect(),
        })
    }

    /// Whether every coefficient that counts is observed, or may stay unobservable.
    pub fn is_acceptable(&self) -> bool {
        self.on_this_stand.is_empty() && self.by_this_schedule.is_empty()
    }
}

impl fmt::Display for Unobservable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let combinations: Vec<String> = self.combinations.iter().map(ToString::to_string).collect();
        f.write_str(&not_observed(
            &self.on_this_stand,
            &self.by_this_schedule,
            &combinations,
        ))
    }
}

/// That these coefficients are not observed, in words; `combinations` by name.
pub(crate) fn not_observed(
    on_this_stand: &[DriftCoefficient],
    by_this_schedule: &[DriftCoefficient],
    combinations: &[String],
) -> String {
    let names = |all: &[DriftCoefficient]| {
        let names: Vec<&str> = all.iter().map(|c| c.name()).collect();
        names.join(", ")
    };
    let mut parts = Vec::new();
    if !on_this_stand.is_empty() {
        parts.push(format!(
            "no schedule on this stand can observe {}, because it cannot tell {}",
            names(on_this_stand),
            combinations.join("; ")
        ));
    }
    if !by_this_schedule.is_empty() {
        parts.push(format!(
            "the schedule found does not observe {}",
            names(by_this_schedule)
        ));
    }
    parts.join("; ")
}

/// The coefficients that count, are not in the space that is `observed`, are not much better known
/// than before, and not within a specification.
fn stays_unobservable(
    evaluator: &Evaluator,
    evaluation: &Evaluation,
    observed: &RowSpace<UNKNOWNS>,
) -> Vec<DriftCoefficient> {
    let objective = evaluator.objective();
    let sigma = evaluation.end.sigma_deg_per_h();
    let prior = &evaluation.prior_sigma_deg_per_h;
    let stays = |c: &DriftCoefficient| {
        let i = c.index();
        let spec = objective.spec_deg_per_h.map_or(f64::INFINITY, |s| s[i]);
        let counts = objective.criterion.counts(*c) || spec.is_finite();
        let is_met = spec.is_finite() && sigma[i] <= spec;
        counts && !is_met && sigma[i] > USEFUL * prior[i] && !observed.contains(&unit(i))
    };
    DriftCoefficient::ALL.into_iter().filter(stays).collect()
}

/// A row for each unknown that is known exactly before the test.
fn known(platform: &Platform) -> Vec<[f64; UNKNOWNS]> {
    let prior = platform.prior_drift_rad_per_s();
    let coefficients = (0..COEFFICIENTS).filter(|&i| prior[i] == 0.0);
    let azimuth = (platform.prior_misalignment_rad()[UP] == 0.0).then_some(COEFFICIENTS);
    coefficients.chain(azimuth).map(unit).collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::attitude::Position;
    use crate::evaluate::Objective;
    use crate::platform::PlatformConfig;
    use crate::schedule::ScheduledPosition;
    use DriftCoefficient as D;

    fn evaluator(change: impl FnOnce(&mut PlatformConfig), objective: Objective) -> Evaluator {
        let mut config = PlatformConfig::default();
        change(&mut config);
        Evaluator::new(config.check().unwrap(), objective)
    }

    /// Positions within the ranges, well spread.
    fn of_schedule(evaluator: &Evaluator, count: usize) -> Unobservable {
        let ranges = evaluator.test().platform().gimbals().ranges;
        let at = |k: usize| {
            let k = k as f64;
            let spread = [0.3 + 2.1 * k, 1.1 * k * k - 0.7, 1.7 * k * k * k - 0.4];
            let angles = [0, 1, 2].map(|axis| match ranges[axis] {
                Some(r) => {
                    r.low_rad + (spread[axis] / TAU).rem_euclid(1.0) * (r.high_rad - r.low_rad)
                }
                None => spread[axis] % TAU,
            });
            ScheduledPosition::new(Position::from_array(angles), 1000.0)
        };
        let schedule = Schedule::new((0..count).map(at).collect()).unwrap();
        let evaluation = evaluator.evaluate(&schedule).unwrap();
        Unobservable::of(evaluator, &schedule, &evaluation).unwrap()
    }

    #[test]
    fn a_free_stand_leaves_nothing_and_few_positions_do() {
        let free = evaluator(|_| {}, Objective::default());
        assert_eq!(of_schedule(&free, 6), Unobservable::default());
        let two = of_schedule(&free, 2);
        assert!(two.on_this_stand.is_empty() && !two.by_this_schedule.is_empty());
        assert!(two.combinations.is_empty() && !two.is_acceptable());
    }

    /// Only the inner gimbal turns: gravity stays along one axis of the platform, and no schedule
    /// sees more than twenty positions do.
    #[test]
    fn a_stand_with_two_fixed_gimbals_is_proven_blind() {
        let fixed = evaluator(
            |c| {
                c.gimbals.alpha_deg = Some([0.0, 0.0]);
                c.gimbals.beta_deg = Some([0.0, 0.0]);
            },
            Objective::default(),
        );
        let many = of_schedule(&fixed, 20);
        assert!(many.by_this_schedule.is_empty(), "{many:?}");
        let mut config = PlatformConfig::default();
        config.gimbals.alpha_deg = Some([0.0, 0.0]);
        config.gimbals.beta_deg = Some([0.0, 0.0]);
        let turning = of_schedule(&evaluator(|c| *c = config.clone(), Objective::default()), 2);
        assert_eq!(turning.on_this_stand, many.on_this_stand);
        assert!(many.on_this_stand.contains(&D::OX) || many.on_this_stand.contains(&D::SX));
        assert!(!many.combinations.is_empty());
        // Accepting them all is enough.
        let mut accept_unobservable = [false; COEFFICIENTS];
        for c in &many.on_this_stand {
            accept_unobservable[c.index()] = true;
        }
        let accepting = evaluator(
            |c| *c = config,
            Objective {
                accept_unobservable,
                ..Objective::default()
            },
        );
        let accepted = of_schedule(&accepting, 20);
        assert!(accepted.is_acceptable());
        assert_eq!(accepted.accepted, many.on_this_stand);
        assert_eq!(accepted.combinations, many.combinations);
    }

    #[test]
    fn what_is_known_or_within_its_specification_is_nobodys_concern() {
        let blind = |c: &mut PlatformConfig| {
            c.gimbals.alpha_deg = Some([0.0, 0.0]);
            c.gimbals.beta_deg = Some([0.0, 0.0]);
        };
        let wide = Objective {
            spec_deg_per_h: Some(crate::drift::CoefficientVector::repeat(100.0)),
            ..Objective::default()
        };
        assert!(of_schedule(&evaluator(blind, wide), 6).is_acceptable());
        let all = of_schedule(&evaluator(blind, Objective::default()), 6);
        let g_known = evaluator(
            |c| {
                blind(c);
                c.prior.g_sensitive_drift_deg_per_h_per_g =
                    crate::platform::GSensitivePrior::All(crate::platform::AxisValue::All(0.0));
            },
            Objective::default(),
        );
        let left = of_schedule(&g_known, 6);
        assert!(
            left.on_this_stand.len() < all.on_this_stand.len(),
            "{left:?}"
        );
    }
}
