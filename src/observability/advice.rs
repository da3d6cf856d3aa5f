//! What to add to a schedule, in words.

use std::fmt;

use super::combinations::Combination;
use super::regressor::at_a_pole;
use super::row_space::RowSpace;
use super::{Observability, Regressor};
use crate::covariance::{CovarianceModel, split_periods};
use crate::motion::Timeline;

/// Filter periods that a dwell needs to tell a second derivative.
const PERIODS: usize = 3;

/// One piece of advice; its `Display` is the sentence.
#[derive(Debug, Clone, PartialEq)]
pub enum Advice {
    /// Some positions are held too briefly to tell all channels.
    LongerDwells {
        /// Their numbers, from 1.
        positions: Vec<usize>,
        /// The shortest dwell that tells a second derivative, s.
        at_least_s: f64,
    },
    /// Something stays unobservable that more positions would show.
    MorePositions {
        /// How many combinations are unobservable.
        unobservable: usize,
        /// Fewest positions that can show them: each has three channels.
        at_least: usize,
    },
    /// Something other than the trace is seen only through the second derivative.
    ObliquePositions {
        /// The combinations.
        combinations: Vec<Combination>,
        /// Fewest positions that can show them at order 1: each has two such channels.
        at_least: usize,
    },
    /// D_IX + D_IY + D_IZ: the same at every position, so that only time helps.
    MoreTime {
        /// Its σ now, °/h.
        sigma_deg_per_h: f64,
        /// Its σ with all dwells twice as long, °/h.
        sigma_at_twice_deg_per_h: f64,
    },
    /// At the poles no test shows D_IX + D_IY + D_IZ.
    OtherLatitude,
}

impl Advice {
    /// What the geometry of a schedule calls for; the trace's σ is filled in by
    /// [`Analysis`](crate::analysis::Analysis).
    pub(crate) fn of_geometry(
        model: &CovarianceModel,
        timeline: &Timeline,
        observability: &Observability,
    ) -> Vec<Self> {
        let mut advice = Vec::new();
        let brief = |dwell_s: f64| split_periods(dwell_s, model.period_s).0 < PERIODS;
        let positions: Vec<usize> = timeline
            .position_legs()
            .iter()
            .enumerate()
            .filter(|(_, leg)| leg.dwell_s > 0.0 && brief(leg.dwell_s))
            .map(|(i, _)| i + 1)
            .collect();
        if !positions.is_empty() {
            advice.push(Self::LongerDwells {
                positions,
                at_least_s: PERIODS as f64 * model.period_s,
            });
        }
        let pole = at_a_pole(model) && model.azimuth_variance.is_none();
        let hidden = usize::from(pole);
        let unobservable = observability.unobservable.len();
        if unobservable > hidden {
            let channels = if pole { 2 } else { 3 };
            advice.push(Self::MorePositions {
                unobservable: unobservable - hidden,
                at_least: (unobservable - hidden).div_ceil(channels),
            });
        } else {
            let combinations = order_two_beside_the_trace(model, timeline, observability);
            if !combinations.is_empty() {
                advice.push(Self::ObliquePositions {
                    at_least: combinations.len().div_ceil(2),
                    combinations,
                });
            }
        }
        if pole {
            advice.push(Self::OtherLatitude);
        }
        advice
    }
}

/// What the channels of order 1 miss beside the trace, which they always miss.
fn order_two_beside_the_trace(
    model: &CovarianceModel,
    timeline: &Timeline,
    observability: &Observability,
) -> Vec<Combination> {
    let regressor = Regressor::new(model, timeline);
    let mut rows = regressor.geometry(regressor.first());
    rows.push(*Combination::input_trace().as_array());
    let largest = observability.spaces.all.largest();
    let missing = RowSpace::beside(&rows, largest).missing(observability.unknowns);
    missing.into_iter().map(Combination::from_array).collect()
}

fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LongerDwells {
                positions,
                at_least_s,
            } => {
                let numbers: Vec<String> = positions.iter().map(usize::to_string).collect();
                write!(
                    f,
                    "Hold position{} {} for {at_least_s} s or more: a second derivative takes \
                     {PERIODS} measurements.",
                    plural(positions.len()),
                    numbers.join(", ")
                )
            }
            Self::MorePositions {
                unobservable,
                at_least,
            } => write!(
                f,
                "Add at least {at_least} position{} in other attitudes: {unobservable} \
                 combination{} unobservable, and a position shows at most three. Five positions \
                 in general attitude observe everything.",
                plural(*at_least),
                if *unobservable == 1 { " is" } else { "s are" }
            ),
            Self::ObliquePositions {
                combinations,
                at_least,
            } => {
                let names: Vec<String> = combinations.iter().map(Combination::to_string).collect();
                let (number, plural) = match at_least {
                    1 => ("one".to_owned(), ""),
                    n => (n.to_string(), "s"),
                };
                write!(
                    f,
                    "Add at least {number} oblique position{plural} (gravity along no axis of the \
                     platform): {} {} seen only through the second derivative of Z so far, and an \
                     oblique position shows two such combinations in the first.",
                    names.join("; "),
                    if names.len() == 1 { "is" } else { "are" }
                )
            }
            Self::MoreTime {
                sigma_deg_per_h,
                sigma_at_twice_deg_per_h,
            } => write!(
                f,
                "D_IX + D_IY + D_IZ is seen only through eps_y, the second derivative, and alike \
                 at every position: no position helps, only time does. Its sigma, scaled to \
                 length one, is {sigma_deg_per_h:.5} deg/h; with all dwells twice as long, \
                 {sigma_at_twice_deg_per_h:.5} deg/h."
            ),
            Self::OtherLatitude => f.write_str(
                "At a pole the Earth rate has no North component: no test shows \
                 D_IX + D_IY + D_IZ there.",
            ),
        }
    }
}
