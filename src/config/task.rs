//! From a checked study to what the evaluator and the search take.

use super::{CheckedConfig, CriterionKind, Mode, SearchConfig};
use crate::criterion::Criterion;
use crate::drift::{CoefficientVector, DriftCoefficient};
use crate::evaluate::{Evaluator, Objective};
use crate::search::SearchProblem;

impl CheckedConfig {
    /// The evaluator's objective.
    pub fn evaluation_objective(&self) -> Objective {
        let score = &self.objective().score;
        Objective {
            criterion: self.criterion(),
            covariance_weight: score.covariance_weight,
            separability_weight: score.separability_weight,
            convergence_weight: score.convergence_weight,
            minimum_separability: score.minimum_separability,
            spec_deg_per_h: self.spec_deg_per_h().copied(),
            others: self.aims().others.clone(),
            spec_of_others: self.aims().spec_of_others.clone(),
            accept_unobservable: DriftCoefficient::ALL
                .map(|c| self.objective().accept_unobservable.contains(&c)),
        }
    }

    /// An evaluator on the study's platform by its objective.
    ///
    /// ```
    /// use scheme_opt::internals::schedule::standard::StandardScheme;
    /// use scheme_opt::internals::config::StudyConfig;
    /// let study = StudyConfig::default().check()?;
    /// let evaluator = study.evaluator();
    /// let scheme = StandardScheme::from_name("icosahedron-12")?;
    /// let schedule = scheme.schedule(study.objective().total_time_s, study.test())?;
    /// assert!(evaluator.evaluate(&schedule)?.rms_sigma_deg_per_h() < 0.01);
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn evaluator(&self) -> Evaluator {
        Evaluator::new(self.test().clone(), self.evaluation_objective())
    }

    /// The search's problem.
    pub fn search_problem(&self) -> SearchProblem {
        let search = self.search();
        SearchProblem {
            total_time_s: self.objective().total_time_s,
            max_positions: search
                .max_positions
                .unwrap_or(SearchConfig::default_positions(false)),
            starts: search.starts,
            seed: search.seed,
            position_tolerance: search.position_tolerance,
            allow_tumbling: search.allow_tumbling,
            from: None,
        }
    }

    fn criterion(&self) -> Criterion {
        // In mode `time` what counts is the specification, whatever the criterion.
        let kind = match self.objective().mode {
            Mode::Time => CriterionKind::MaxRatio,
            Mode::Accuracy | Mode::Pareto => self.objective().criterion,
        };
        let aims = self.aims();
        match kind {
            CriterionKind::A => Criterion::A {
                weights: *self.weights(),
                others: only_where_any(&aims.weights_of_others, |w| *w > 0.0),
            },
            CriterionKind::D => Criterion::D,
            CriterionKind::E => Criterion::E,
            CriterionKind::MaxRatio => Criterion::MaxRatio {
                // Without a specification the check of the study has refused this criterion.
                spec_deg_per_h: self
                    .spec_deg_per_h()
                    .copied()
                    .unwrap_or_else(|| CoefficientVector::repeat(f64::INFINITY)),
                others: only_where_any(&aims.spec_of_others, |s| s.is_finite()),
            },
            CriterionKind::Use => Criterion::Use {
                // Without a profile the check of the study has refused this criterion.
                weight: aims.use_weight.clone().unwrap_or_default(),
            },
        }
    }
}

/// Numbers of other parameters, none where they say nothing.
fn only_where_any(values: &[f64], says: impl Fn(&f64) -> bool) -> Vec<f64> {
    match values.iter().any(says) {
        true => values.to_vec(),
        false => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{PerCoefficient, StudyConfig};

    #[test]
    fn every_choice_of_the_file_reaches_the_computation() {
        let mut config = StudyConfig::default();
        config.objective.spec_deg_per_h = PerCoefficient::all(0.004);
        config.objective.score.separability_weight = 0.25;
        config.objective.score.minimum_separability = 0.125;
        config.search.starts = 3;
        config.search.seed = 9;
        config.objective.weights = PerCoefficient::all(2.0);
        let weights = CoefficientVector::repeat(2.0);
        let spec = CoefficientVector::repeat(0.004);
        for (kind, criterion) in [
            (CriterionKind::A, Criterion::weighted(weights)),
            (CriterionKind::D, Criterion::D),
            (CriterionKind::E, Criterion::E),
            (CriterionKind::MaxRatio, Criterion::max_ratio(spec)),
        ] {
            config.objective.criterion = kind;
            let study = config.check().unwrap();
            let objective = study.evaluation_objective();
            assert_eq!(objective.criterion, criterion);
            assert_eq!(objective.separability_weight, 0.25);
            assert_eq!(objective.minimum_separability, 0.125);
            assert_eq!(objective.spec_deg_per_h, Some(spec));
            assert_eq!(study.search_problem().starts, 3);
            assert_eq!(study.search_problem().seed, 9);
        }
    }

    #[test]
    fn the_defaults_of_file_and_library_are_the_same() {
        let study = StudyConfig::default().check().unwrap();
        assert_eq!(study.evaluation_objective(), Objective::default());
        assert_eq!(study.search_problem(), SearchProblem::default());
    }
}
