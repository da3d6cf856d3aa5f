//! What a simulation shows, for people.

use crate::cli::report::wrap;
use crate::cli::table::Align::{Left, Right};
use crate::cli::table::{render, render_rows};
use crate::report::words;
use crate::results::{RoleRecord, SimulatedParameter, SimulationDocument, SweepRecord};
use crate::simulate::consistency::Consistency;
use crate::simulate::{SweepPoint, largest_without_optimism};
use crate::wording::{number, optional, seconds};

/// The whole report; `swept` as in the document.
pub(super) fn simulation(document: &SimulationDocument, swept: &[SweepPoint]) -> String {
    let mut text = head(document);
    text.push_str("\nErrors at the end\n\n");
    text.push_str(&coefficients(document));
    text.push_str(&misalignment(document));
    let others = words::other_parameters(document);
    if !others.is_empty() {
        text.push_str("\nOther parameters at the end\n");
        text.push_str(&parameters(others));
    }
    text.push('\n');
    text.push_str(&wrap(&words::columns(document)));
    text.push_str(&specification(document));
    text.push_str("\nConsistency\n\n");
    text.push_str(&consistency(document));
    text.push('\n');
    text.push_str(&wrap(&words::bounds(document)));
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

/// A table of errors: a column of what the filter claims only where that is not the truth.
struct ErrorTable<'a> {
    /// What the rows are, and the unit of the numbers.
    heading: [&'a str; 2],
    claims: bool,
    rows: Vec<Vec<String>>,
}

impl<'a> ErrorTable<'a> {
    fn new(of: &'a str, unit: &'a str, claims: bool) -> Self {
        Self {
            heading: [of, unit],
            claims,
            rows: Vec::new(),
        }
    }

    fn row(
        &mut self,
        name: String,
        [error, sigma, planned]: [f64; 3],
        claimed: Option<f64>,
        ratio: String,
    ) {
        let mut row = vec![name, number(error), number(sigma)];
        if self.claims {
            row.push(optional(claimed, number));
        }
        row.extend([ratio, number(planned)]);
        self.rows.push(row);
    }

    fn text(self) -> String {
        let [of, unit] = self.heading;
        let of_unit = |what: &str| format!("{what}, {unit}");
        let mut names = vec![of.to_owned(), of_unit("RMS error"), of_unit("sigma")];
        if self.claims {
            names.push("claimed".to_owned());
        }
        names.extend(["ratio".to_owned(), of_unit("planned")]);
        let columns: Vec<_> = names
            .iter()
            .enumerate()
            .map(|(i, name)| (name.as_str(), if i == 0 { Left } else { Right }))
            .collect();
        render_rows(&columns, self.rows)
    }
}

fn coefficients(document: &SimulationDocument) -> String {
    let claimed = document.rms_claimed_sigma_deg_per_h;
    let mut table = ErrorTable::new("coefficient", "deg/h", claimed.is_some());
    for c in &document.coefficients {
        let numbers = [
            c.rms_error_deg_per_h,
            c.sigma_deg_per_h,
            c.planned_sigma_deg_per_h,
        ];
        let claimed = c.claimed_sigma_deg_per_h;
        table.row(c.name.name().to_owned(), numbers, claimed, ratio(c.ratio));
    }
    let all = [
        document.rms_error_deg_per_h,
        document.rms_sigma_deg_per_h,
        document.rms_planned_sigma_deg_per_h,
    ];
    table.row("RMS of all".to_owned(), all, claimed, String::new());
    table.text() + "\n"
}

fn misalignment(document: &SimulationDocument) -> String {
    let claims = document.rms_claimed_sigma_deg_per_h.is_some();
    let mut table = ErrorTable::new("misalignment", "arcsec", claims);
    for m in &document.misalignment {
        let numbers = [m.rms_error_arcsec, m.sigma_arcsec, m.planned_sigma_arcsec];
        table.row(
            m.name.clone(),
            numbers,
            m.claimed_sigma_arcsec,
            ratio(m.ratio),
        );
    }
    table.text()
}

/// Parameters beside the coefficients, a table for each group.
fn parameters(others: &[SimulatedParameter]) -> String {
    let mut text = String::new();
    for group in others.chunk_by(|a, b| (&a.group, a.role) == (&b.group, b.role)) {
        let claims = group.iter().any(|p| p.claimed_sigma.is_some());
        let ignored = match group[0].role {
            RoleRecord::Estimated => "",
            RoleRecord::Considered => ", not known to the filter: the values of the runs",
        };
        text.push_str(&format!("\n{}{ignored}\n\n", group[0].group));
        let mut table = ErrorTable::new("parameter", &group[0].unit, claims);
        for p in group {
            let numbers = [p.rms_error, p.sigma, p.planned_sigma];
            table.row(p.name.clone(), numbers, p.claimed_sigma, ratio(p.ratio));
        }
        text.push_str(&table.text());
    }
    text
}

fn consistency(document: &SimulationDocument) -> String {
    let row = |name: String, c: &Option<Consistency>| match c {
        None => [name, String::new(), "-".into(), "-".into(), "-".into()],
        Some(c) => {
            let [freedom, average, bounds, place] = words::consistency(c);
            [name, freedom, average, bounds, place]
        }
    };
    let mut rows: Vec<_> = words::averages(document)
        .into_iter()
        .map(|(name, c)| row(name.to_owned(), c))
        .collect();
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
    let coefficients = check.coefficients.iter().map(|c| {
        [
            c.name.name().to_owned(),
            "deg/h".to_owned(),
            number(c.spec_deg_per_h),
            optional(c.rms_error_deg_per_h, number),
            optional(c.interval_deg_per_h, |[low, _]| number(low)),
            optional(c.interval_deg_per_h, |[_, high]| number(high)),
            c.decision.to_string(),
        ]
    });
    let parameters = check.parameters.iter().map(|p| {
        [
            p.name.clone(),
            p.unit.clone(),
            number(p.spec),
            optional(p.rms_error, number),
            optional(p.interval, |[low, _]| number(low)),
            optional(p.interval, |[_, high]| number(high)),
            p.decision.to_string(),
        ]
    });
    let columns = [
        ("name", Left),
        ("unit", Left),
        ("spec", Right),
        ("RMS error", Right),
        ("sigma from", Right),
        ("to", Right),
        ("specification", Left),
    ];
    let mut text = "\nErrors against the specification\n\n".to_owned();
    text.push_str(&render(columns, coefficients.chain(parameters).collect()));
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
    if !words::other_parameters(document).is_empty() {
        text.push_str(&wrap(words::SWEPT));
    }
    text
}
