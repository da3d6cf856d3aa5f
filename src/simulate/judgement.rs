//! What a simulation says: one verdict, with its numbers and its words.
//!
//! Terminal, document and report take both from here, so that no two of them can disagree. The
//! words say the worst first: runs that diverged, what the errors are, whether the filter can be
//! believed, whether the specification is met.

use std::collections::BTreeMap;
use std::fmt;

use crate::drift::CoefficientVector;
use crate::wording::{listed, number};

use super::MonteCarlo;
use super::consistency::{Consistency, Verdict};
use super::divergence::Divergence;
use super::specification::{Decision, SpecificationCheck};

/// What a simulation says of a test and its filter.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// What is to be thought of the filter.
    pub verdict: Verdict,
    /// The runs that diverged.
    pub divergence: Divergence,
    /// The errors against the specification; none: none is given.
    pub specification: Option<SpecificationCheck>,
    /// Whether nothing is left to doubt: the filter is consistent, no run diverged, and the
    /// specification, if there is one, is shown to be met. What `simulate --check` asks.
    pub passed: bool,
    /// The findings in the order in which they are said; [`std::fmt::Display`] makes a sentence of
    /// each, with units in plain letters.
    pub findings: Vec<Finding>,
}

/// One thing that a simulation shows.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Finding {
    /// Runs diverged.
    Diverged(Divergence),
    /// What the errors of the runs are that did not diverge.
    Others {
        /// How many they are.
        runs: usize,
        /// Their RMS error, °/h.
        rms_error_deg_per_h: f64,
    },
    /// The RMS error of all runs beside what the filter says and what was planned, °/h.
    Errors {
        /// How many runs.
        runs: usize,
        /// The RMS error.
        rms_error_deg_per_h: f64,
        /// The RMS of the σ that they are compared with.
        rms_sigma_deg_per_h: f64,
        /// The RMS of what a filter claims that ignores parameters; none: it is the same.
        rms_claimed_sigma_deg_per_h: Option<f64>,
        /// The RMS of the planned σ.
        rms_planned_sigma_deg_per_h: f64,
    },
    /// The filter ignores parameters that the platform has, and errors are compared with the truth.
    Ignored {
        /// Their groups.
        groups: Vec<&'static str>,
        /// NEES of all states by what the filter claims.
        claimed: Option<Consistency>,
    },
    /// Whether the filter can be believed, and by which numbers.
    Filter {
        /// What is to be thought of it.
        verdict: Verdict,
        /// NEES, NEES of the estimated parameters where they are more than the coefficients, NEES of the
        /// coefficients, NIS.
        consistency: [Option<Consistency>; 4],
        /// Whether the filter ignores parameters: then its errors are beside the truth.
        ignores: bool,
    },
    /// Whether the errors of the runs show that the specification is met.
    Specification {
        /// The errors against it.
        check: SpecificationCheck,
        /// How many runs.
        runs: usize,
        /// Whether some diverged.
        diverged: bool,
    },
}

impl Judgement {
    /// Judges `found` against the specification, °/h (per g), infinite for coefficients without
    /// one, and that of other parameters by name, each in its unit.
    pub fn new(
        found: &MonteCarlo,
        spec_deg_per_h: Option<&CoefficientVector>,
        spec_of_others: &BTreeMap<&'static str, f64>,
    ) -> Self {
        let verdict = found.verdict();
        let specification =
            spec_deg_per_h.and_then(|s| SpecificationCheck::new(found, s, spec_of_others));
        let met = |s: &SpecificationCheck| s.decision == Decision::Met;
        let divergence = &found.divergence;
        let mut findings = Vec::new();
        if divergence.count > 0 {
            findings.push(Finding::Diverged(divergence.clone()));
            findings.extend(divergence.rms_error_of_the_others_deg_per_h.map(|error| {
                Finding::Others {
                    runs: divergence.runs - divergence.count,
                    rms_error_deg_per_h: error,
                }
            }));
        }
        findings.push(Finding::Errors {
            runs: found.runs,
            rms_error_deg_per_h: found.rms_error_deg_per_h(),
            rms_sigma_deg_per_h: found.rms_sigma_deg_per_h(),
            rms_claimed_sigma_deg_per_h: found.rms_claimed_sigma_deg_per_h(),
            rms_planned_sigma_deg_per_h: found.rms_planned_sigma_deg_per_h(),
        });
        findings.extend(found.claimed.map(|claimed| Finding::Ignored {
            groups: found.ignored_groups(),
            claimed: claimed.nees,
        }));
        findings.push(Finding::Filter {
            verdict,
            consistency: found.judged(),
            ignores: found.claimed.is_some(),
        });
        findings.extend(specification.as_ref().map(|check| Finding::Specification {
            check: check.clone(),
            runs: found.runs,
            diverged: divergence.count > 0,
        }));
        Self {
            verdict,
            divergence: divergence.clone(),
            passed: verdict == Verdict::Consistent && specification.as_ref().is_none_or(met),
            specification,
            findings,
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Diverged(divergence) => f.write_str(&diverged(divergence)),
            Self::Others {
                runs,
                rms_error_deg_per_h,
            } => write!(
                f,
                "The RMS error of the other {} is {} deg/h.",
                match runs {
                    1 => "run".to_owned(),
                    runs => format!("{runs} runs"),
                },
                number(*rms_error_deg_per_h)
            ),
            Self::Errors {
                runs,
                rms_error_deg_per_h: error,
                rms_sigma_deg_per_h: sigma,
                rms_claimed_sigma_deg_per_h: claimed,
                rms_planned_sigma_deg_per_h: planned,
            } => write!(
                f,
                "Over all {runs} runs the RMS error is {} deg/h, {}; the filter says {} deg/h, \
                 the plan {} deg/h.",
                number(*error),
                against_the_plan(error / planned),
                number(claimed.unwrap_or(*sigma)),
                number(*planned),
            ),
            Self::Ignored { groups, claimed } => f.write_str(&ignored(groups, claimed.as_ref())),
            Self::Filter {
                verdict,
                consistency,
                ignores,
            } => f.write_str(&filter(*verdict, consistency, *ignores)),
            Self::Specification {
                check,
                runs,
                diverged,
            } => f.write_str(&specified(check, *runs, *diverged)),
        }
    }
}

impl MonteCarlo {
    /// The averages that make the verdict.
    fn judged(&self) -> [Option<Consistency>; 4] {
        [
            self.nees,
            self.nees_parameters,
            self.nees_coefficients,
            self.nis,
        ]
    }

    /// What is to be thought of the filter: [`Verdict::Diverged`] when a run diverged, else what
    /// NEES of all states, of the parameters and of the coefficients and NIS say together.
    pub fn verdict(&self) -> Verdict {
        if self.divergence.count > 0 {
            return Verdict::Diverged;
        }
        let judged = self.judged();
        let says = |v: Verdict| judged.iter().flatten().any(|c| c.verdict == v);
        match (says(Verdict::Optimistic), says(Verdict::Pessimistic)) {
            (true, true) => Verdict::Inconsistent,
            (true, false) => Verdict::Optimistic,
            (false, true) => Verdict::Pessimistic,
            // Everything known exactly: there is nothing to be wrong about.
            (false, false) => Verdict::Consistent,
        }
    }
}

/// What happened in the runs that diverged.
fn diverged(d: &Divergence) -> String {
    /// How many are called by their number.
    const NAMED: usize = 5;
    let named: Vec<String> = d
        .listed
        .iter()
        .take(NAMED)
        .map(|r| match r.rms_error_deg_per_h {
            Some(error) => format!("{} deg/h in run {}", number(error), r.run),
            None => format!("no finite number in run {}", r.run),
        })
        .collect();
    let more = match d.count > named.len() {
        true => ", and more",
        false => "",
    };
    let noticed = match (d.noticed, d.count) {
        (0, 1) => "Its residuals do not show it: at the stand it would pass unnoticed.".to_owned(),
        (0, _) => "Their residuals do not show it: at the stand they would pass unnoticed.".into(),
        (n, count) if n == count => "The residuals show it: look at them at the stand.".to_owned(),
        (n, count) => format!(
            "The residuals show it in {n} of {count}; the rest would pass unnoticed at the stand."
        ),
    };
    format!(
        "{} of {} runs diverged, beyond all chance. RMS error of the coefficients: {}{more}. \
         {noticed}",
        d.count,
        d.runs,
        listed(&named),
    )
}

/// The RMS error as a ratio to what was planned, in words.
fn against_the_plan(ratio: f64) -> String {
    /// Beyond so many times the plan, percent are no help.
    const TIMES: f64 = 3.0;
    match ratio {
        r if r.is_nan() => "no number to compare with the plan".to_owned(),
        r if r >= TIMES => format!("{} times what was planned", number(r)),
        r if r >= 1.005 => format!("{:.0} % more than planned", 100.0 * (r - 1.0)),
        r if r <= 0.995 => format!("{:.0} % less than planned", 100.0 * (1.0 - r)),
        _ => "as planned".to_owned(),
    }
}

/// What a filter does not know of, and what becomes of its claims.
fn ignored(groups: &[&str], claimed: Option<&Consistency>) -> String {
    let groups: Vec<String> = groups.iter().map(|g| (*g).to_owned()).collect();
    let of_claims = claimed.map_or_else(String::new, |c| {
        let own = match c.verdict {
            Verdict::Consistent => "is not wrong",
            Verdict::Pessimistic => "is pessimistic",
            _ => "is optimistic",
        };
        format!(
            " By what it claims itself it {own} ({}).",
            against_bounds("NEES", c)
        )
    });
    format!(
        "The filter does not know of {}; errors are compared with the true sigma, in which these \
         count.{of_claims}",
        listed(&groups)
    )
}

/// Whether the filter can be believed, and by which numbers.
fn filter(verdict: Verdict, consistency: &[Option<Consistency>; 4], ignores: bool) -> String {
    let meaning = match verdict {
        Verdict::Consistent if ignores => {
            "The truth is as predicted: errors are as large as the true sigma says"
        }
        Verdict::Optimistic if ignores => {
            "The truth is worse than predicted: errors are larger than the true sigma says"
        }
        Verdict::Pessimistic if ignores => {
            "The truth is better than predicted: errors are smaller than the true sigma says"
        }
        Verdict::Inconsistent if ignores => {
            "The truth is not as predicted: some errors are larger and some smaller than the true \
             sigma says"
        }
        Verdict::Consistent => "The filter is consistent: its errors are as large as it says",
        Verdict::Optimistic => "The filter is optimistic: its errors are larger than it says",
        Verdict::Pessimistic => "The filter is pessimistic: its errors are smaller than it says",
        Verdict::Inconsistent => {
            "The filter is inconsistent: some of its errors are larger and some smaller than it \
             says"
        }
        Verdict::Diverged => "The filter diverged, and what it says of itself cannot be relied on",
    };
    let names = [
        "NEES",
        "NEES of the parameters",
        "NEES of the coefficients",
        match ignores {
            true => "NIS without what is ignored",
            false => "NIS",
        },
    ];
    let numbers: Vec<String> = names
        .into_iter()
        .zip(consistency)
        .filter_map(|(name, c)| c.map(|c| against_bounds(name, &c)))
        .collect();
    match numbers.is_empty() {
        true => format!("{meaning}."),
        false => format!("{meaning} ({}).", numbers.join("; ")),
    }
}

fn against_bounds(name: &str, c: &Consistency) -> String {
    let [low, high] = c.bounds;
    // As many digits as the bounds need to differ.
    let decimals = match high - low < 0.1 {
        true => 4,
        false => 2,
    };
    let average = match c.average < 1e4 {
        true => format!("{:.decimals$}", c.average),
        false => number(c.average),
    };
    format!("{name} {average}, expected {low:.decimals$} to {high:.decimals$}")
}

/// To two digits and no fewer.
fn rounded_up(count: usize) -> usize {
    let mut unit = 1;
    while count / unit >= 100 {
        unit *= 10;
    }
    count.div_ceil(unit) * unit
}

/// Whether the errors of the runs show that the specification is met.
fn specified(s: &SpecificationCheck, runs: usize, diverged: bool) -> String {
    let said = |name: &str, error: Option<f64>, spec: f64, unit: &str| {
        let error = error.map_or_else(|| "-".to_owned(), number);
        format!("{name} ({error} against {} {unit})", number(spec))
    };
    let of = |decision: Decision| -> Vec<String> {
        let coefficients = s.coefficients.iter().filter(|c| c.decision == decision);
        let coefficients = coefficients.map(|c| {
            let error = c.rms_error_deg_per_h;
            said(c.name.name(), error, c.spec_deg_per_h, "deg/h")
        });
        let parameters = s.parameters.iter().filter(|p| p.decision == decision);
        let parameters = parameters.map(|p| said(&p.name, p.rms_error, p.spec, &p.unit));
        coefficients.chain(parameters).collect()
    };
    let certain = 100.0 * s.probability;
    match s.decision {
        Decision::Met => format!(
            "The specification is met: the RMS errors of {runs} runs show it with {certain:.0} % \
             certainty."
        ),
        Decision::NotMet => format!(
            "The specification is not met: {}.",
            listed(&of(Decision::NotMet))
        ),
        Decision::NotDecided if diverged => format!(
            "Whether the specification is met is not decided: errors of runs that diverge have no \
             limit that {runs} runs could show."
        ),
        Decision::NotDecided => {
            let needed = s.runs_needed.map_or_else(String::new, |n| {
                format!(
                    "; about {} would, if the errors stay as they are",
                    rounded_up(n)
                )
            });
            format!(
                "Whether the specification is met is not decided by {runs} runs: {}{needed}.",
                listed(&of(Decision::NotDecided))
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_rounded_up() {
        for (count, rounded) in [(7, 7), (99, 99), (100, 100), (101, 110), (91_673, 92_000)] {
            assert_eq!(rounded_up(count), rounded);
        }
    }
}
