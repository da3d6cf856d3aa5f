//! What a simulation shows, for people.

use crate::cli::report::wrap;
use crate::cli::table::Align::{Left, Right};
use crate::cli::table::render;
use crate::report::words;
use crate::results::{SimulationDocument, SweepRecord};
use crate::simulate::consistency::Consistency;
use crate::simulate::{SweepPoint, largest_without_optimism};
use crate::wording::{number, optional, seconds};

/// The whole report; `swept` as in the document.
pub(super) fn simulation(document: &SimulationDocument, swept: &[SweepPoint]) -> String {
    let mut text = head(document);
    text.push_str("\nErrors at the end\n\n");
    text.push_str(&coefficients(document));
    text.push_str(&misalignment(document));
    text.push('\n');
    text.push_str(&wrap(&format!(
        "ratio: RMS of error/sigma; 95 of 100 lie between {:.3} and {:.3} for a filter that is \
         right about itself. planned: sigma by the linear model, as `evaluate` has it.",
        document.ratio_bounds[0], document.ratio_bounds[1]
    )));
    text.push_str(&specification(document));
    text.push_str("\nConsistency\n\n");
    text.push_str(&consistency(document));
    text.push('\n');
    text.push_str(&wrap(words::BOUNDS));
    text.push_str(&wander(document));
    text.push_str(&sweep(document, swept));
    text
}

fn head(document: &SimulationDocument) -> String {
    let mut text = format!(
        "{} runs of {} s: {} truth, {} filter, seed {}\n",
        document.runs,
        seconds(document.total_time_s),
        document.truth,
        document.filter,
        document.seed,
    );
    let told = document.told_accelerometer_factor;
    if told != 1.0 {
        text.push_str(&format!(
            "The filter is told {told} times the true noise.\n"
        ));
    }
    for sentence in words::simulated(document) {
        text.push_str(&wrap(&sentence));
    }
    text
}

fn ratio(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |r| format!("{r:.3}"))
}

fn coefficients(document: &SimulationDocument) -> String {
    let rows = document.coefficients.iter().map(|c| {
        [
            c.name.name().to_owned(),
            number(c.rms_error_deg_per_h),
            number(c.sigma_deg_per_h),
            ratio(c.ratio),
            number(c.planned_sigma_deg_per_h),
        ]
    });
    let all = [
        "RMS of all".to_owned(),
        number(document.rms_error_deg_per_h),
        number(document.rms_sigma_deg_per_h),
        String::new(),
        number(document.rms_planned_sigma_deg_per_h),
    ];
    let columns = [
        ("coefficient", Left),
        ("RMS error, deg/h", Right),
        ("sigma, deg/h", Right),
        ("ratio", Right),
        ("planned, deg/h", Right),
    ];
    render(columns, rows.chain([all]).collect()) + "\n"
}

fn misalignment(document: &SimulationDocument) -> String {
    let rows = document.misalignment.iter().map(|m| {
        [
            m.name.clone(),
            number(m.rms_error_arcsec),
            number(m.sigma_arcsec),
            ratio(m.ratio),
            number(m.planned_sigma_arcsec),
        ]
    });
    let columns = [
        ("misalignment", Left),
        ("RMS error, arcsec", Right),
        ("sigma, arcsec", Right),
        ("ratio", Right),
        ("planned, arcsec", Right),
    ];
    render(columns, rows.collect())
}

fn consistency(document: &SimulationDocument) -> String {
    let row = |name: String, c: &Option<Consistency>| match c {
        None => [name, String::new(), "-".into(), "-".into(), "-".into()],
        Some(c) => {
            let [freedom, average, bounds, place] = words::consistency(c);
            [name, freedom, average, bounds, place]
        }
    };
    let mut rows = vec![
        row("NEES, all states".to_owned(), &document.nees),
        row("NEES, coefficients".to_owned(), &document.nees_coefficients),
        row("NIS".to_owned(), &document.nis),
    ];
    let last = document.positions.len().saturating_sub(1);
    for (i, p) in document.positions.iter().take(last).enumerate() {
        let name = format!("NEES at {} s (position {})", seconds(p.end_s), i + 1);
        rows.push(row(name, &p.nees));
    }
    let columns = [
        ("average of", Left),
        ("expected", Right),
        ("found", Right),
        ("95 % bounds", Right),
        ("it is", Left),
    ];
    render(columns, rows)
}

/// How far the platform went from where the plan has it.
fn wander(document: &SimulationDocument) -> String {
    let off = document.rms_largest_misalignment_deg;
    wrap(&format!(
        "The drift is not compensated during the test, and the plan has the platform at its \
         positions: at its farthest it is {off:.2} deg (RMS of the runs) off the computed frame."
    ))
}

/// Errors against the specification, if there is one.
fn specification(document: &SimulationDocument) -> String {
    let judgement = document.judgement.as_ref();
    let Some(check) = judgement.and_then(|j| j.specification.as_ref()) else {
        return String::new();
    };
    let rows = check.coefficients.iter().map(|c| {
        [
            c.name.name().to_owned(),
            number(c.spec_deg_per_h),
            optional(c.rms_error_deg_per_h, number),
            optional(c.interval_deg_per_h, |[low, _]| number(low)),
            optional(c.interval_deg_per_h, |[_, high]| number(high)),
            c.decision.to_string(),
        ]
    });
    let columns = [
        ("coefficient", Left),
        ("spec, deg/h", Right),
        ("RMS error", Right),
        ("sigma from", Right),
        ("to", Right),
        ("specification", Left),
    ];
    let mut text = "\nErrors against the specification\n\n".to_owned();
    text.push_str(&render(columns, rows.collect()));
    text.push('\n');
    text.push_str(&wrap(&words::intervals(check)));
    text
}

/// A number that somebody chose: without trailing zeros.
fn plain(value: f64) -> String {
    let text = number(value);
    match text.contains('.') && !text.contains('e') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

fn sweep(document: &SimulationDocument, swept: &[SweepPoint]) -> String {
    if swept.is_empty() {
        return String::new();
    }
    let rows = document.sweep.iter().map(|s: &SweepRecord| {
        [
            plain(s.misalignment_deg),
            plain(s.drift_factor),
            s.nees.map_or_else(|| "-".to_owned(), |n| number(n.average)),
            optional(s.rms_error_deg_per_h, number),
            s.diverged_runs.to_string(),
            number(s.rms_largest_misalignment_deg),
        ]
    });
    let columns = [
        ("misalignment, deg", Right),
        ("drift, times", Right),
        ("NEES", Right),
        ("RMS error, deg/h", Right),
        ("diverged", Right),
        ("farthest, deg", Right),
    ];
    let mut text = "\nPrior against linearisation\n\n".to_owned();
    text.push_str(&render(columns, rows.collect()));
    let by_drift = swept.iter().position(|p| p.size.drift_factor != 1.0);
    let (first, second) = swept.split_at(by_drift.unwrap_or(swept.len()));
    let misalignment = largest_without_optimism(first).map_or_else(
        || "no misalignment listed, with this drift".to_owned(),
        |p| format!("a misalignment of {} deg", plain(p.size.misalignment_deg)),
    );
    let drift = largest_without_optimism(second).map_or_else(
        || "no drift listed".to_owned(),
        |p| format!("{} times the drift", plain(p.size.drift_factor)),
    );
    text.push_str(&wrap(&format!(
        "The filter's linearisation bears {misalignment}; and {drift}, with the platform's own \
         misalignment."
    )));
    text
}
