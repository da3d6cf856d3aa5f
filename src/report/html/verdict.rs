//! The sentences that a page opens with.

use super::subject::Subject;
use super::tables;
use crate::report::words;
use crate::results::{
    BaselineRecord, ComparedRecord, ComparisonDocument, EvaluationDocument, ResultDocument,
};
use crate::wording::{listed, number, seconds};

/// How a page speaks of the specification.
pub(super) type OnSpecification = fn(&EvaluationDocument) -> Option<String>;

/// How accurate, how long, and whether that is enough.
pub(super) fn accuracy_words(subject: &Subject, on_specification: OnSpecification) -> Vec<String> {
    let d = &subject.document;
    let positions = d.schedule.positions.len();
    let largest = d
        .coefficients
        .iter()
        .max_by(|a, b| a.sigma_deg_per_h.total_cmp(&b.sigma_deg_per_h));
    let largest = largest.map_or_else(String::new, |c| {
        format!(
            "; at worst {} for {}",
            number(c.sigma_deg_per_h),
            c.name.name()
        )
    });
    let mut words = vec![format!(
        "Accuracy {} °/h (RMS of the twelve 1σ{largest}) after {} s with {positions} position{}, \
         of which {} s moving and settling.",
        number(d.rms_sigma_deg_per_h),
        seconds(d.total_time_s),
        if positions == 1 { "" } else { "s" },
        seconds(d.overhead_s),
    )];
    if !words::is_the_rms(d) {
        words.push(format!(
            "Criterion {}: {}{}.",
            d.score.criterion_name,
            number(d.score.criterion),
            words::unit(&d.score.criterion_unit)
        ));
    }
    words.extend(on_specification(d));
    words
}

/// What the standard schemes make of the same time.
pub(super) fn gain(baselines: &[BaselineRecord]) -> Option<String> {
    let best = baselines
        .iter()
        .min_by(|a, b| a.yardstick().total_cmp(&b.yardstick()))?;
    let compared = words::compared(best.yardstick_ratio());
    let name = words::in_order(best);
    Some(format!(
        "In the same time {compared} the best standard scheme, {name}."
    ))
}

/// Which coefficients are weak, and why.
pub(super) fn weakness(subject: &Subject) -> Vec<String> {
    /// A coefficient is called weak when its σ is so many times the median.
    const WEAK: f64 = 1.5;
    let d = &subject.document;
    let mut sigmas: Vec<f64> = d.coefficients.iter().map(|c| c.sigma_deg_per_h).collect();
    sigmas.sort_by(f64::total_cmp);
    let median = sigmas[sigmas.len() / 2];
    let weak: Vec<&str> = d
        .coefficients
        .iter()
        .filter(|c| c.sigma_deg_per_h > WEAK * median)
        .map(|c| c.name.name())
        .collect();
    let mut words = Vec::new();
    if !d.observability.unobservable.is_empty() {
        words.push(words::observability(d));
    }
    match weak.is_empty() {
        true => words.push("No coefficient is much weaker than the others.".to_owned()),
        false => words.push(format!(
            "Weak: {}, with more than {WEAK} times the σ of the median coefficient.",
            listed(&weak)
        )),
    }
    words.extend(subject.analysis.advice.iter().cloned());
    words
}

/// How the search went.
pub(super) fn search_words(document: &ResultDocument) -> String {
    let c = &document.counters;
    format!(
        "Search {}: {} ({} starts, {} values, {} gradients, seed {}).",
        document.status, document.reason, c.starts, c.evaluations, c.gradients, document.seed
    )
}

/// Who is best, and by how much.
pub(super) fn side_by_side(
    document: &ComparisonDocument,
    best: &ComparedRecord,
    name: &str,
) -> String {
    let time = match document.total_time_s {
        Some(s) => format!("in {} s each", seconds(s)),
        None => "each in its own time".to_owned(),
    };
    let second = document
        .schedules
        .iter()
        .filter(|s| !std::ptr::eq(*s, best))
        .min_by(|a, b| a.criterion.total_cmp(&b.criterion));
    let second = second.map_or_else(String::new, |s| {
        let ratio = words::compared(Some(s.criterion / best.criterion));
        format!(", {ratio} the next, {}", tables::name(&s.name, s.order))
    });
    format!(
        "Best of {} schedules, {time}: {name}{second}. What follows is about it.",
        document.schedules.len()
    )
}
