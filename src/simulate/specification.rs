//! Whether simulated runs show that a specification is met.
//!
//! The sum of N squared errors of 1σ = s, divided by s², is χ² with N degrees of freedom. So s lies
//! with certainty 1 − p within
//!
//! ```text
//! RMS √(N / χ²_{1−p/2}(N)) ≤ s ≤ RMS √(N / χ²_{p/2}(N))
//! ```
//!
//! With m parameters that have a specification p is 0.05/m, so that all m intervals hold their s
//! together in 95 of 100 simulations. A specification is **met** when the whole interval is within
//! it, **not met** when the whole interval is beyond it, and otherwise these runs do not decide.
//!
//! The interval takes errors of one normal distribution. A simulation with diverged runs is a
//! mixture of which it has seen a few samples: it can show that the specification is not met, but
//! not that it is.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::drift::{CoefficientVector, DriftCoefficient};

use super::consistency::PROBABILITY;
use super::monte_carlo::ParameterCheck;
use super::{MAX_RUNS, MonteCarlo};

/// What the runs say of a specification.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Decision {
    /// The runs show that it is met.
    Met,
    /// The runs show that it is not met.
    NotMet,
    /// So many runs do not decide.
    NotDecided,
}

impl fmt::Display for Decision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Met => "met",
            Self::NotMet => "not met",
            Self::NotDecided => "not decided",
        })
    }
}

/// One coefficient against its specification.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SpecifiedCoefficient {
    /// The coefficient.
    pub name: DriftCoefficient,
    /// Specification, 1σ, °/h.
    pub spec_deg_per_h: f64,
    /// RMS error of the runs, °/h; null: not finite.
    pub rms_error_deg_per_h: Option<f64>,
    /// Between what 1σ of the error lies, °/h, all intervals together with certainty
    /// `probability`; null: not finite.
    pub interval_deg_per_h: Option<[f64; 2]>,
    /// What that says.
    pub decision: Decision,
}

/// One parameter beside the coefficients against its specification.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SpecifiedParameter {
    /// `T_XY`, `K_0Z` …
    pub name: String,
    /// Unit of the numbers that follow: `ppm`, `arcsec`, `ug` …
    pub unit: String,
    /// Specification, 1σ.
    pub spec: f64,
    /// RMS error of the runs; null: not finite.
    pub rms_error: Option<f64>,
    /// Between what 1σ of the error lies, all intervals together with certainty `probability`; null:
    /// not finite.
    pub interval: Option<[f64; 2]>,
    /// What that says.
    pub decision: Decision,
}

/// A simulation against the specification.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SpecificationCheck {
    /// What the runs say of all coefficients and parameters that have a specification.
    pub decision: Decision,
    /// Certainty with which all intervals hold.
    pub probability: f64,
    /// How many runs would decide, if the RMS errors stay what they are; null: they decide
    /// already, diverged runs stand in the way, or it would take more than can be asked for.
    pub runs_needed: Option<usize>,
    /// The coefficients that have a specification.
    pub coefficients: Vec<SpecifiedCoefficient>,
    /// The other parameters that have one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<SpecifiedParameter>,
}

/// What the runs say of one 1σ: RMS error, interval, decision.
struct Decided {
    rms_error: Option<f64>,
    interval: Option<[f64; 2]>,
    decision: Decision,
}

impl Decided {
    fn new(rms: f64, spec: f64, factors: [f64; 2], any_diverged: bool) -> Self {
        let interval = factors.map(|f| rms * f);
        Self {
            rms_error: Some(rms).filter(|r| r.is_finite()),
            interval: Some(interval).filter(|_| rms.is_finite()),
            decision: decide(interval, spec, any_diverged),
        }
    }
}

impl SpecificationCheck {
    /// `found` against `spec`, °/h (per g), infinite for coefficients without one, and against that of
    /// other parameters by name, each in its unit; none when none has one.
    pub fn new(
        found: &MonteCarlo,
        spec: &CoefficientVector,
        of_others: &BTreeMap<&'static str, f64>,
    ) -> Option<Self> {
        let specified: Vec<DriftCoefficient> = DriftCoefficient::ALL
            .into_iter()
            .filter(|c| spec[c.index()].is_finite())
            .collect();
        let others: Vec<(&ParameterCheck, f64)> = found
            .parameters
            .iter()
            .filter_map(|p| Some((p, *of_others.get(p.parameter.name)?)))
            .collect();
        let tail = 0.5 * (1.0 - PROBABILITY) / (specified.len() + others.len()) as f64;
        let factors = interval_factors(found.runs, tail)?;
        let any_diverged = found.divergence.count > 0;
        let decided = |rms, spec| Decided::new(rms, spec, factors, any_diverged);
        let coefficients: Vec<SpecifiedCoefficient> = specified
            .iter()
            .map(|c| {
                let spec = spec[c.index()];
                let of = decided(found.coefficients[c.index()].rms_error, spec);
                SpecifiedCoefficient {
                    name: *c,
                    spec_deg_per_h: spec,
                    rms_error_deg_per_h: of.rms_error,
                    interval_deg_per_h: of.interval,
                    decision: of.decision,
                }
            })
            .collect();
        let parameters: Vec<SpecifiedParameter> = others
            .iter()
            .map(|(p, spec)| {
                let of = decided(p.check.rms_error, *spec);
                SpecifiedParameter {
                    name: p.parameter.name.to_owned(),
                    unit: p.parameter.unit.name().to_owned(),
                    spec: *spec,
                    rms_error: of.rms_error,
                    interval: of.interval,
                    decision: of.decision,
                }
            })
            .collect();
        // Decision, and the RMS error beside the specification.
        let of_coefficients = coefficients.iter().map(|c| {
            (
                c.decision,
                c.rms_error_deg_per_h.map(|e| e / c.spec_deg_per_h),
            )
        });
        let of_parameters = parameters
            .iter()
            .map(|p| (p.decision, p.rms_error.map(|e| e / p.spec)));
        let all: Vec<(Decision, Option<f64>)> = of_coefficients.chain(of_parameters).collect();
        let has = |d: Decision| all.iter().any(|(of, _)| *of == d);
        let decision = match (has(Decision::NotMet), has(Decision::NotDecided)) {
            (true, _) => Decision::NotMet,
            (false, true) => Decision::NotDecided,
            (false, false) => Decision::Met,
        };
        let closest = all
            .iter()
            .filter(|(of, _)| *of == Decision::NotDecided)
            .filter_map(|(_, ratio)| *ratio)
            .min_by(|a, b| (a - 1.0).abs().total_cmp(&(b - 1.0).abs()));
        let runs_needed = match decision {
            Decision::NotDecided if !any_diverged => closest.and_then(|r| runs_for(r, tail)),
            _ => None,
        };
        Some(Self {
            decision,
            probability: PROBABILITY,
            runs_needed,
            coefficients,
            parameters,
        })
    }
}

fn decide([low, high]: [f64; 2], spec: f64, any_diverged: bool) -> Decision {
    // NaN, from a run that lost itself altogether, is within nothing.
    if low > spec || low.is_nan() {
        Decision::NotMet
    } else if high <= spec && !any_diverged {
        Decision::Met
    } else {
        Decision::NotDecided
    }
}

/// What the RMS of that many errors is multiplied by for the ends of the interval of σ, `tail` on
/// either side.
fn interval_factors(runs: usize, tail: f64) -> Option<[f64; 2]> {
    let chi = ChiSquared::new(runs as f64).ok()?;
    // Not finite: nothing has a specification.
    (tail.is_finite())
        .then(|| [1.0 - tail, tail].map(|p| (runs as f64 / chi.inverse_cdf(p)).sqrt()))
}

/// How many runs decide about an RMS error that is `ratio` of its specification.
fn runs_for(ratio: f64, tail: f64) -> Option<usize> {
    let decides = |runs: usize| {
        interval_factors(runs, tail).is_some_and(|f| ratio * f[0] > 1.0 || ratio * f[1] <= 1.0)
    };
    let mut enough = 2;
    while !decides(enough) {
        enough *= 2;
        if enough > MAX_RUNS {
            return None;
        }
    }
    let mut short = enough / 2;
    while enough - short > 1 {
        let middle = short + (enough - short) / 2;
        match decides(middle) {
            true => enough = middle,
            false => short = middle,
        }
    }
    Some(enough)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_those_of_the_tables() {
        // Abramowitz & Stegun, table 26.8, 100 degrees of freedom: 74.2219 and 129.561.
        let [low, high] = interval_factors(100, 0.025).unwrap();
        assert!((low - (100.0_f64 / 129.561).sqrt()).abs() < 1e-5);
        assert!((high - (100.0_f64 / 74.2219).sqrt()).abs() < 1e-5);
    }

    #[test]
    fn decisions_follow_the_interval() {
        for (interval, spec, diverged, decision) in [
            ([0.8, 0.9], 1.0, false, Decision::Met),
            ([0.8, 0.9], 1.0, true, Decision::NotDecided),
            ([0.8, 1.1], 1.0, false, Decision::NotDecided),
            ([1.1, 1.3], 1.0, false, Decision::NotMet),
            ([1.1, 1.3], 1.0, true, Decision::NotMet),
            ([f64::NAN; 2], 1.0, false, Decision::NotMet),
            ([0.0, 0.0], 1.0, false, Decision::Met),
        ] {
            assert_eq!(decide(interval, spec, diverged), decision, "{interval:?}");
        }
    }

    #[test]
    fn the_runs_needed_are_just_enough() {
        for ratio in [0.5, 0.9, 0.97, 1.03, 2.0] {
            let runs = runs_for(ratio, 0.002).unwrap();
            let decides = |n| {
                let [low, high] = interval_factors(n, 0.002).unwrap();
                ratio * low > 1.0 || ratio * high <= 1.0
            };
            assert!(
                decides(runs) && (runs == 2 || !decides(runs - 1)),
                "{ratio}: {runs}"
            );
        }
        assert_eq!(runs_for(1.0, 0.002), None);
    }
}
