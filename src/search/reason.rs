//! Why a search ended as it did, as data.

use std::fmt;

use crate::analysis::Unobservable;
use crate::criterion::KnownBefore;
use crate::drift::DriftCoefficient;
use crate::error::Error;
use crate::evaluate::{Evaluation, Objective};

/// Why a search ended as it did. [`fmt::Display`] puts it into words, the same in every document,
/// report and terminal.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Reason {
    /// It was cancelled.
    Interrupted {
        /// What the schedule lacks all the same; none: nothing.
        lacks: Option<Box<Reason>>,
    },
    /// Its time was up.
    TimeLimit {
        /// What the schedule lacks all the same; none: nothing.
        lacks: Option<Box<Reason>>,
    },
    /// All was worked through. A specification need not be met, unless it is the criterion.
    Finished {
        /// The parameters that miss their specification.
        missed: Vec<MissedSpecification>,
    },
    /// Every point of the front was worked out.
    FrontFinished,
    /// The criterion is 0 before any test, and nothing else is asked for.
    NoTestNeeded(KnownBefore),
    /// The shortest test that meets the specification was found.
    SpecificationMet {
        /// Its duration, s.
        total_time_s: f64,
        /// Largest ratio of a σ to its specification.
        largest_ratio: f64,
    },
    /// No schedule found reaches the minimum separability.
    SeparabilityMissed {
        /// What is asked for.
        minimum: f64,
        /// The least separability of a coefficient in the nearest schedule.
        nearest: f64,
    },
    /// Coefficients that count stay unobservable.
    Unobservable(Unobservable),
    /// The most accurate schedule found does not meet the specification.
    SpecificationMissed {
        /// Its duration, s.
        total_time_s: f64,
        /// By which parameters.
        missed: Vec<MissedSpecification>,
        /// A specification so many times as wide is met.
        times_as_wide: f64,
    },
    /// No test within the time that is allowed meets the specification.
    NotInTime {
        /// What stays unobservable.
        unobservable: Unobservable,
        /// The time that is allowed, s.
        allowed_s: f64,
        /// The parameters that miss their specification.
        missed: Vec<MissedSpecification>,
        /// A specification so many times as wide is met.
        times_as_wide: f64,
        /// What time would be enough.
        enough: EnoughTime,
    },
}

/// What time would be enough for a specification.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum EnoughTime {
    /// So long, s.
    Found(f64),
    /// No test of any length that was tried meets it.
    NotFound,
    /// A longer test could not be worked out.
    Failed(Error),
}

/// A parameter that misses its specification. [`fmt::Display`] gives both numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissedSpecification {
    /// Its name: `D_FX`, `T_XY` …
    pub name: &'static str,
    /// 1σ after the test in its unit.
    pub sigma: f64,
    /// What is asked for, 1σ.
    pub spec: f64,
    /// The unit, without what it is per: `deg/h`, `ppm` …
    pub unit: &'static str,
}

impl MissedSpecification {
    /// All of an evaluation, D_FX first and the coefficients before other parameters; none without a
    /// specification.
    pub(super) fn all(objective: &Objective, evaluation: &Evaluation) -> Vec<Self> {
        let sigma = evaluation.end.sigma_deg_per_h();
        let of_drift = objective.spec_deg_per_h.into_iter().flat_map(|spec| {
            DriftCoefficient::ALL.map(|c| Self {
                name: c.name(),
                sigma: sigma[c.index()],
                spec: spec[c.index()],
                unit: "deg/h",
            })
        });
        let others = objective.others.iter().zip(&objective.spec_of_others);
        let of_others = others.filter_map(|(&at, &spec)| {
            let known = evaluation.parameters.get(at)?;
            Some(Self {
                name: known.parameter.name,
                sigma: known.sigma,
                spec,
                unit: known.parameter.unit.name(),
            })
        });
        let all = of_drift.chain(of_others);
        all.filter(|c| c.sigma > c.spec).collect()
    }
}

impl fmt::Display for MissedSpecification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} ({:.3e} > {:.3e} {})",
            self.name, self.sigma, self.spec, self.unit
        )
    }
}

/// The parameters with their numbers, separated by commas.
struct Listed<'a>(&'a [MissedSpecification]);

impl fmt::Display for Listed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, missed) in self.0.iter().enumerate() {
            write!(f, "{}{missed}", if k == 0 { "" } else { ", " })?;
        }
        Ok(())
    }
}

impl fmt::Display for EnoughTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Found(t) => write!(f, "the specification can be met in {t:.0} s"),
            Self::NotFound => f.write_str("no test of any length that was tried meets it"),
            Self::Failed(e) => write!(f, "a longer test could not be worked out: {e}"),
        }
    }
}

/// What a schedule lacks, after something else has been said of it.
fn lacking(f: &mut fmt::Formatter<'_>, lacks: Option<&Reason>) -> fmt::Result {
    match lacks {
        Some(why) => write!(f, "; {why}"),
        None => Ok(()),
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Interrupted { lacks } => {
                f.write_str("interrupted; the schedule is the best found so far")?;
                lacking(f, lacks.as_deref())
            }
            Self::TimeLimit { lacks } => {
                f.write_str(
                    "the time limit was reached; the schedule is the best found so far, confirmed \
                     by the step-by-step filter after the limit",
                )?;
                lacking(f, lacks.as_deref())
            }
            Self::Finished { missed } => {
                f.write_str(
                    "all starts were screened, the best improved until nothing tried made them \
                     better, and the winner was confirmed by the step-by-step filter",
                )?;
                match missed.is_empty() {
                    true => Ok(()),
                    false => write!(f, "; the specification is missed by {}", Listed(missed)),
                }
            }
            Self::FrontFinished => f.write_str(
                "every point of the front was worked out and confirmed by the step-by-step filter",
            ),
            Self::NoTestNeeded(known) => write!(
                f,
                "{known}; no test is needed, and this is the shortest there is"
            ),
            Self::SpecificationMet {
                total_time_s,
                largest_ratio,
            } => write!(
                f,
                "every coefficient is within its specification after {total_time_s:.1} s; the \
                 largest ratio of a sigma to its specification is {largest_ratio:.4}"
            ),
            Self::SeparabilityMissed { minimum, nearest } => write!(
                f,
                "no schedule found reaches the minimum separability {minimum}; the nearest has \
                 {nearest:.4}"
            ),
            Self::Unobservable(unobservable) => unobservable.fmt(f),
            Self::SpecificationMissed {
                total_time_s,
                missed,
                times_as_wide,
            } => write!(
                f,
                "no schedule found meets the specification in {total_time_s:.0} s: missed by {}; \
                 one {times_as_wide:.4} times as wide is met",
                Listed(missed)
            ),
            Self::NotInTime {
                unobservable,
                allowed_s,
                missed,
                times_as_wide,
                enough,
            } => {
                if !unobservable.is_acceptable() {
                    write!(f, "{unobservable}; ")?;
                }
                write!(
                    f,
                    "the specification is not met in {allowed_s:.0} s, missed by {}; a \
                     specification {times_as_wide:.4} times as wide can be; {enough}",
                    Listed(missed)
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn missed() -> Vec<MissedSpecification> {
        [("D_FX", 0.003), ("D_IZ", 0.0125)]
            .map(|(name, sigma)| MissedSpecification {
                name,
                sigma,
                spec: 0.002,
                unit: "deg/h",
            })
            .into()
    }

    #[test]
    fn reasons_have_the_words_that_documents_have() {
        let listed = "D_FX (3.000e-3 > 2.000e-3 deg/h), D_IZ (1.250e-2 > 2.000e-3 deg/h)";
        let not_in_time = |unobservable: Unobservable, enough: EnoughTime| Reason::NotInTime {
            unobservable,
            allowed_s: 3600.0,
            missed: missed(),
            times_as_wide: 6.25,
            enough,
        };
        let blind = Unobservable {
            by_this_schedule: vec![DriftCoefficient::OY],
            ..Unobservable::default()
        };
        let missed_in_time = format!(
            "the specification is not met in 3600 s, missed by {listed}; a specification 6.2500 \
             times as wide can be; "
        );
        for (reason, words) in [
            (
                Reason::Finished { missed: missed() },
                format!(
                    "all starts were screened, the best improved until nothing tried made them \
                     better, and the winner was confirmed by the step-by-step filter; the specification is missed by {listed}"
                ),
            ),
            (
                Reason::SpecificationMissed {
                    total_time_s: 3600.0,
                    missed: missed(),
                    times_as_wide: 6.25,
                },
                format!(
                    "no schedule found meets the specification in 3600 s: missed by {listed}; one \
                     6.2500 times as wide is met"
                ),
            ),
            (
                not_in_time(Unobservable::default(), EnoughTime::Found(13_317.2)),
                format!("{missed_in_time}the specification can be met in 13317 s"),
            ),
            (
                not_in_time(blind.clone(), EnoughTime::NotFound),
                format!(
                    "the schedule found does not observe D_OY; {missed_in_time}no test of any \
                     length that was tried meets it"
                ),
            ),
            (
                Reason::Unobservable(blind.clone()),
                "the schedule found does not observe D_OY".to_owned(),
            ),
            (
                Reason::TimeLimit { lacks: None },
                "the time limit was reached; the schedule is the best found so far, confirmed by \
                 the step-by-step filter after the limit"
                    .to_owned(),
            ),
            (
                Reason::Interrupted {
                    lacks: Some(Box::new(Reason::Unobservable(blind))),
                },
                "interrupted; the schedule is the best found so far; the schedule found does not \
                 observe D_OY"
                    .to_owned(),
            ),
            (
                Reason::SeparabilityMissed {
                    minimum: 0.1,
                    nearest: 0.0123456,
                },
                "no schedule found reaches the minimum separability 0.1; the nearest has 0.0123"
                    .to_owned(),
            ),
        ] {
            assert_eq!(reason.to_string(), words);
        }
    }
}
