//! What a reader of a bound should know: what it does not cover, and why it is weak.

use std::fmt;

use super::minimum_time::MinimumTime;
use crate::criterion::KnownBefore;
use crate::error::Error;
use crate::observability::Combination;
use crate::observability::stand::Unseen;
use crate::wording::listed;

/// What a bound does not cover, or why it is weak. [`fmt::Display`] puts it into words, the same in
/// every document, report and terminal.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Remark {
    /// The criterion is 0 before any test.
    KnownBefore(KnownBefore),
    /// The bound consists of what was known before the test of these combinations, which no schedule on
    /// this stand can tell.
    RestsOnPriors(Vec<Combination>),
    /// Nothing is measured in so short a test.
    PriorItself,
    /// The criterion counts none of the drift coefficients.
    OnlyOthers,
    /// No majorant of the information was found.
    NoMajorant,
    /// Frame-hold repositioning turns the misalignment, so that all of it counts as measured.
    FrameHold,
    /// Only the isotropic majorant holds: all of the misalignment counts as measured.
    IsotropicMajorant,
    /// Only the isotropic majorant holds, with an azimuth: all of the misalignment counts as measured
    /// like the best measured part of it.
    MeasuredLikeTheBest,
    /// The bound is for an index table whose moves take no time.
    IndexTable,
    /// The platform has errors, of these groups, that the bound takes as known.
    TakenAsKnown(Vec<&'static str>),
    /// Noise of the platform wanders, all of which the bound leaves out.
    WanderingLeftOut,
    /// Biases of accelerometers wander, which the bound leaves out.
    BiasesLeftOut,
    /// Drift wanders, which counts in the constant drifts alone.
    WanderingInConstantDrift,
    /// What counts is known before the test and wanders in it, so that the bound for this duration *or
    /// shorter* is nothing.
    KnownAndWanders,
    /// At a pole the sum of the input-axis coefficients is never seen.
    Pole,
    /// What is known of the shortest time, where that is no number.
    Time(MinimumTime),
    /// The schedule found does not meet the specification either.
    SpecificationMissed,
    /// The bound could not be worked out.
    NoBound(Error),
}

impl Remark {
    /// What the bound consists of.
    pub(super) fn on_priors(unseen: &Unseen) -> Self {
        Self::RestsOnPriors(unseen.combinations.clone())
    }
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::KnownBefore(known) => return known.fmt(f),
            Self::Time(time) => return time.fmt(f),
            Self::RestsOnPriors(combinations) => {
                let names: Vec<String> = combinations.iter().map(ToString::to_string).collect();
                return write!(
                    f,
                    "the bound is what was known before the test of that which no schedule on this \
                     stand can tell: {}",
                    names.join("; ")
                );
            }
            Self::NoBound(e) => return write!(f, "no bound here, because {e}"),
            Self::TakenAsKnown(groups) => {
                let title = |key: &&'static str| crate::model::group(key).map_or(*key, |g| g.title);
                let titles: Vec<&str> = groups.iter().map(title).collect();
                return write!(
                    f,
                    "these errors are taken as known exactly, which can only lower the bound: {}",
                    listed(&titles)
                );
            }
            Self::WanderingLeftOut => {
                "noise that wanders is left out, as if all of it were known, which can only lower \
                 the bound"
            }
            Self::BiasesLeftOut => {
                "biases that wander are left out, as if they were known, which can only lower the \
                 bound"
            }
            Self::WanderingInConstantDrift => {
                "drift that wanders counts in the D_F; the other coefficients are bounded as if \
                 it were known, which can only lower the bound"
            }
            Self::KnownAndWanders => {
                "no useful bound here, because a drift that is known before the test wanders in \
                 it: the shorter the test, the better it is known at the end"
            }
            Self::PriorItself => {
                "nothing is measured in so short a test: the bound is the prior itself"
            }
            Self::OnlyOthers => {
                "no bound here, because the criterion counts only parameters that the bound takes \
                 as known"
            }
            Self::NoMajorant => {
                "no useful bound here, because without random drift and with so long a filter \
                 period none of the majorants holds"
            }
            Self::FrameHold => {
                "in frame-hold repositioning moves turn the misalignment: it is as if all three of \
                 its components were measured"
            }
            Self::IsotropicMajorant => {
                "weak bound, because the separated majorant does not hold here: it is as if all \
                 three components of the misalignment were measured"
            }
            Self::MeasuredLikeTheBest => {
                "it is as if every component of the misalignment were measured as well as the best \
                 measured one"
            }
            Self::IndexTable => {
                "for schedules on the index table whose moves take no time; while a move lasts, \
                 the drift is seen at attitudes off the table"
            }
            Self::Pole => {
                "at a pole the sum D_IX + D_IY + D_IZ is never seen: its prior is most of the bound"
            }
            Self::SpecificationMissed => "the schedule found does not meet it either",
        })
    }
}
