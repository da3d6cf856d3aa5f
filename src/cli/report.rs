//! Reports for people, as text.

use crate::config::TestConfig;
use crate::motion::Timeline;
use crate::platform::Platform;
use crate::report::words;
use crate::results::{
    BudgetRecord, EvaluationDocument, PrecisionRecord, ResultDocument, RoleRecord,
};
use crate::search::Status;
use crate::wording::{number, seconds};

use super::named;
use super::screen::Screen;
use super::table;

/// What a search found.
pub(super) fn search(
    document: &ResultDocument,
    platform: &Platform,
    timeline: &Timeline,
    files: &[String],
) -> String {
    let found = &document.evaluation;
    let mut text = String::new();
    for first in words::preface(document) {
        text.push_str(&wrap(&first));
    }
    text.push_str(&words::verdict(document));
    let known = found.score.known_before.is_some();
    if let Some(certificate) = document.certificate.as_ref().filter(|_| !known) {
        text.push_str(&wrap(&words::within(certificate)));
    }
    if let Some(from) = &document.from {
        text.push_str(&wrap(&words::from(document, from)));
    }
    if let Some(claims) = words::claims(found) {
        text.push_str(&wrap(&claims));
    }
    // What stays unobservable has been said.
    let is_said = document.unobservable.is_all_of(&document.reason);
    if document.status != Status::Converged && !is_said {
        text.push_str(&wrap(&format!("{}: {}", document.status, document.reason)));
    }
    if !document.pareto.is_empty() {
        text.push_str("\nTotal time against criterion; what follows is the longest test\n\n");
        let score = &found.score;
        text.push_str(&table::front(
            &score.criterion_name,
            &score.criterion_unit,
            &document.pareto,
        ));
    }
    text.push_str("\nSchedule\n\n");
    text.push_str(&table::schedule(platform, timeline));
    text.push_str("\nCoefficients after the test, 1 sigma\n\n");
    text.push_str(&table::coefficients(found));
    text.push_str(&constant_part(found));
    text.push_str(&other_parameters(found));
    text.push('\n');
    text.push_str(&wrap(&words::observability(found)));
    text.push_str(&limits(found));
    text.push_str("\nBeside the standard schemes in the same time\n\n");
    text.push_str(&table::baselines(found, &document.baselines));
    for skipped in &document.baselines_skipped {
        text.push_str(&wrap(&format!(
            "{}: not run, {}",
            skipped.name, skipped.reason
        )));
    }
    text.push('\n');
    text.push_str(&wrap(&words::perfect(&document.inputs)));
    text.push('\n');
    text.push_str(&work(document));
    if !files.is_empty() {
        text.push_str(&format!("\nWritten: {}\n", files.join("\n         ")));
    }
    text
}

/// A text for people, under whose test it is about.
pub(super) fn headed(test: &TestConfig, text: String) -> String {
    match words::test(test) {
        Some(test) => format!("{}\n{text}", wrap(&test)),
        None => text,
    }
}

/// Status and work done.
fn work(document: &ResultDocument) -> String {
    let c = &document.counters;
    let time = document
        .wall_time_s
        .map_or_else(String::new, |s| format!(" in {s:.1} s"));
    wrap(&format!(
        "{}: {} starts (standard schemes included), {} values, {} gradients{time}; seed {}; two \
         computations of every sigma agree to {:.0e}.",
        document.status,
        c.starts,
        c.evaluations,
        c.gradients,
        document.seed,
        document.evaluation.agreement,
    ))
}

/// What D_F means where it walks; empty where it does not.
fn constant_part(document: &EvaluationDocument) -> String {
    words::constant_part(document).map_or_else(String::new, |said| wrap(&said))
}

/// What the test tells about the parameters beside the coefficients; empty where there are none.
fn other_parameters(document: &EvaluationDocument) -> String {
    let others = document.parameters.get(document.coefficients.len()..);
    match others {
        None | Some([]) => String::new(),
        Some(others) => format!(
            "\nOther parameters after the test, 1 sigma\n{}",
            table::parameters(others)
        ),
    }
}

/// What is known of a given schedule.
pub(super) fn evaluation(
    document: &EvaluationDocument,
    platform: &Platform,
    timeline: &Timeline,
) -> String {
    let mut text = words::known_before(document).map_or_else(String::new, |w| wrap(&w));
    text.push_str(&totals(document));
    if let Some(claims) = words::claims(document) {
        text.push_str(&wrap(&claims));
    }
    text.push_str("\nSchedule\n\n");
    text.push_str(&table::schedule(platform, timeline));
    text.push_str(&beyond_limits(document, platform, timeline));
    text.push_str("\nWhat the accelerometers read there, if the angles are meant as here\n\n");
    text.push_str(&table::specific_force(timeline));
    text.push_str("\nCoefficients after the test, 1 sigma\n\n");
    text.push_str(&table::coefficients(document));
    text.push_str(&constant_part(document));
    text.push_str(&other_parameters(document));
    if !document.budget.is_empty() {
        text.push('\n');
        text.push_str(&wrap(
            "What ignoring a group would add to the errors of the coefficients: RMS of the twelve, \
             the same beside their RMS sigma, and the worst beside its own",
        ));
        text.push('\n');
        text.push_str(&table::budget(document));
        text.push_str(&ignored_already(document));
    }
    text.push('\n');
    text.push_str(&table::misalignment(document));
    text.push('\n');
    text.push_str(&wrap(&words::observability(document)));
    // Of the coefficients alone that has been said.
    if document.parameters.len() > document.coefficients.len()
        && let Some(named) = &document.observability.parameters
    {
        text.push('\n');
        text.push_str(&named::unobservable(named));
    }
    text.push_str(&limits(document));
    text.push('\n');
    text.push_str(&wrap(&words::perfect(&document.inputs)));
    text
}

/// What would help most; empty where that is not known.
fn limits(document: &EvaluationDocument) -> String {
    match document.limits.is_empty() {
        true => String::new(),
        false => format!(
            "\nWhat limits this test\n\n{}{}",
            table::limits(document),
            wrap(words::LIMITS)
        ),
    }
}

/// In what a given schedule goes beyond what limits a search; empty where in nothing.
fn beyond_limits(
    document: &EvaluationDocument,
    platform: &Platform,
    timeline: &Timeline,
) -> String {
    let mut beyond = Vec::new();
    let (taken_s, most_s) = (
        timeline.total_time_s(),
        document.inputs.objective.total_time_s,
    );
    if taken_s > most_s * (1.0 + 1e-9) {
        beyond.push(format!(
            "it takes {} s, more than objective.total_time_s ({} s)",
            seconds(taken_s),
            seconds(most_s)
        ));
    }
    let least_s = platform.motion().min_dwell_s;
    let short: Vec<String> = (1..)
        .zip(timeline.position_legs())
        .filter(|(_, leg)| leg.dwell_s > 0.0 && leg.dwell_s < least_s * (1.0 - 1e-9))
        .map(|(number, _)| number.to_string())
        .collect();
    if !short.is_empty() {
        beyond.push(format!(
            "shorter than motion.min_dwell_s ({} s) is the dwell of position {}",
            seconds(least_s),
            short.join(", ")
        ));
    }
    match beyond.is_empty() {
        true => String::new(),
        false => format!(
            "\n{}",
            wrap(&format!(
                "A search would not propose this schedule: {}.",
                beyond.join("; ")
            ))
        ),
    }
}

/// The groups that the filter does not know of.
fn ignored_already(document: &EvaluationDocument) -> String {
    let is_ignored = |b: &&BudgetRecord| b.role == RoleRecord::Considered;
    let ignored = document.budget.iter().filter(is_ignored);
    let names: Vec<&str> = ignored.map(|b| b.group.as_str()).collect();
    match names.is_empty() {
        true => String::new(),
        false => wrap(&format!(
            "Ignored already, and part of every sigma: {}.",
            names.join(", ")
        )),
    }
}

fn totals(document: &EvaluationDocument) -> String {
    let score = &document.score;
    let missing = || "none".to_owned();
    format!(
        "RMS sigma          {} deg/h\n\
         largest sigma      {} deg/h\n\
         worst combination  {} deg/h\n\
         ln det P_D         {} (P_D in (deg/h)^2)\n\
         {:<18} {}{}\n\
         score              {}\n\
         total time         {} s, of which {} s moves and settles\n\
         agreement          {:.0e} between two computations of every sigma{}\n",
        number(document.rms_sigma_deg_per_h),
        number(document.max_sigma_deg_per_h),
        number(document.max_eig_sigma_deg_per_h),
        document.logdet_deg_per_h.map_or_else(missing, number),
        format!("criterion {}", score.criterion_name),
        number(score.criterion),
        words::unit(&score.criterion_unit),
        score.value.map_or_else(missing, number),
        seconds(document.total_time_s),
        seconds(document.overhead_s),
        document.agreement,
        match document.precision {
            PrecisionRecord::Double => "",
            PrecisionRecord::Extended => ", in 32 digits",
        },
    )
}

/// Breaks running text into lines.
pub(super) fn wrap(text: &str) -> String {
    let longest = usize::from(Screen::of_stdout().width.min(Screen::WIDTH));
    let mut lines = String::new();
    let mut width = 0;
    for word in text.split_whitespace() {
        let length = word.chars().count();
        if width > 0 && width + 1 + length > longest {
            lines.push('\n');
            width = 0;
        } else if width > 0 {
            lines.push(' ');
            width += 1;
        }
        lines.push_str(word);
        width += length;
    }
    lines.push('\n');
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_text_is_broken_into_lines() {
        let text = wrap(&"seventeen letters ".repeat(30));
        assert!(
            text.lines()
                .all(|line| line.len() <= usize::from(Screen::WIDTH) && !line.ends_with(' '))
        );
        assert_eq!(text.split_whitespace().count(), 60);
    }
}
