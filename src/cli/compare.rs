//! `compare`: schedules side by side in the same total time.

use std::path::Path;

use crate::compare::{PositionOrder, Proof};
use crate::error::Result;
use crate::report::words;
use crate::results::{ComparedRecord, ComparisonDocument};
use crate::schedule::Schedule;
use crate::schedule::standard::StandardScheme;
use crate::study::{ComparisonOptions, Contender};
use crate::wording;

use super::args::CompareArgs;
use super::exit::Exit;
use super::output::Output;
use super::table::{self, Align};
use super::{inputs, page, report};

/// Runs the command.
pub(super) fn run(args: &CompareArgs, output: Output) -> Result<Exit> {
    let study = inputs::load(args.platform.as_deref(), &args.common, None)?;
    let existing = args.existing.choice();
    page::check(args.report.as_deref(), existing)?;
    let contenders = contenders(args)?;
    for (name, schedule) in contenders.iter().filter_map(Contender::given) {
        inputs::warn_of_schedule(Path::new(name), schedule, &study, output);
    }
    let options = ComparisonOptions {
        scale: !args.as_given,
        best_order: args.best_order,
        order_steps: args.order_steps,
    };
    if args.best_order {
        output.message(&format!(
            "looking for the best order of {} schedules, one to two minutes each at the most; \
             --order-steps limits it",
            contenders.len()
        ));
    }
    let compared = study.compare(&contenders, &options)?;
    let document = compared.document();
    let text = match args.common.json {
        true => document.to_json()?,
        false => report::headed(&document.test, text(document)),
    };
    if !document.schedules.is_empty() {
        page::write(args.report.as_deref(), existing, output, || {
            compared.report_html()
        })?;
    }
    output.data(&text)?;
    Ok(match document.schedules.is_empty() {
        true => Exit::NoSchedule,
        false => Exit::Done,
    })
}

fn contenders(args: &CompareArgs) -> Result<Vec<Contender>> {
    let mut all = Vec::new();
    for name in &args.schedules {
        all.push(match Contender::from_name(name)? {
            Some(scheme) => scheme,
            None => Contender::schedule(name, Schedule::from_file(name)?),
        });
    }
    if args.standard {
        for contender in StandardScheme::ALL.map(Contender::standard) {
            if !all.contains(&contender) {
                all.push(contender);
            }
        }
    }
    Ok(all)
}

/// The comparison for people.
fn text(document: &ComparisonDocument) -> String {
    let mut text = String::new();
    if !document.schedules.is_empty() {
        text.push_str(&match document.total_time_s {
            Some(s) => format!(
                "Schedules in {} s, ratios to the first\n\n",
                wording::seconds(s)
            ),
            None => "Schedules as they are, ratios to the first\n\n".to_owned(),
        });
        text.push_str(&overview(document));
        text.push_str(
            "\nCoefficients after the test, 1 sigma, 1e-3 deg/h (D_I, D_O, D_S per g)\n\n",
        );
        text.push_str(&coefficients(document));
        text.push_str(&orders(document));
    }
    for skipped in &document.skipped {
        text.push_str(&report::wrap(&format!(
            "{}: not run, {}",
            label(&skipped.name, skipped.order),
            skipped.reason
        )));
    }
    text
}

/// What the marks behind names mean.
fn orders(document: &ComparisonDocument) -> String {
    let all = |proof: Proof| {
        document
            .schedules
            .iter()
            .any(|s| s.order_proof == Some(proof))
    };
    let notes = [
        (
            Proof::Complete,
            "* the same positions in their best order: all orders were gone through",
        ),
        (
            Proof::StepLimit,
            "+ the same positions in the best order found: a better one may exist; \
             --order-steps, raised, goes through more of them",
        ),
        (
            Proof::TooManyPositions,
            "+ the same positions in the best order found: a better one may exist; of more than \
             12 positions not all orders are gone through",
        ),
        (
            Proof::OtherErrors,
            "+ the same positions in the best order found: a better one may exist; with errors beyond \
             the twelve coefficients the other orders are not gone through",
        ),
        (
            Proof::OwnDwells,
            "+ the same positions with their dwells in the best order found: a better one may exist; where \
             dwells differ the other orders are not gone through",
        ),
        (
            Proof::OtherTriples,
            "+ the best order found, some attitudes by other Euler triples: better than every order \
             of the positions as they are, all of which were gone through; a better one may exist",
        ),
    ];
    let notes = notes.into_iter().filter(|(proof, _)| all(*proof));
    let text: String = notes.map(|(_, note)| report::wrap(note)).collect();
    match text.is_empty() {
        true => text,
        false => format!("\n{text}"),
    }
}

/// Name and order, short enough for a table: files without their directory.
fn label(name: &str, order: PositionOrder) -> String {
    let file = || Path::new(name).file_name().and_then(|f| f.to_str());
    let short = Contender::standard_name(name).or_else(file).unwrap_or(name);
    match order {
        PositionOrder::Best => format!("{short} *"),
        PositionOrder::BestFound => format!("{short} +"),
        PositionOrder::AsGiven => short.to_owned(),
    }
}

fn overview(document: &ComparisonDocument) -> String {
    let with_criterion =
        document.criterion_name != "a" || !document.inputs.objective.weights.is_empty();
    let criterion = words::criterion_column(&document.criterion_name, &document.criterion_unit);
    let has_spec = document
        .schedules
        .iter()
        .any(|s| s.time_to_spec_s.is_some());
    let mut columns = vec![
        ("schedule", Align::Left),
        ("positions", Align::Right),
        ("moving, s", Align::Right),
        ("RMS sigma, deg/h", Align::Right),
        ("ratio", Align::Right),
    ];
    if with_criterion {
        columns.push((&criterion, Align::Right));
        columns.push(("ratio", Align::Right));
    }
    columns.push(("separab.", Align::Right));
    if has_spec {
        columns.push(("in spec, s", Align::Right));
    }
    let ratio = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |r| format!("{r:.2}"));
    let row = |s: &ComparedRecord| {
        let mut row = vec![
            label(&s.name, s.order),
            s.positions.to_string(),
            wording::seconds(s.overhead_s),
            wording::number(s.rms_sigma_deg_per_h),
            ratio(s.ratio),
        ];
        if with_criterion {
            row.push(wording::number(s.criterion));
            row.push(ratio(s.criterion_ratio));
        }
        row.push(format!("{:.4}", s.least_separability));
        if has_spec {
            row.push(
                s.time_to_spec_s
                    .map_or_else(|| "missed".to_owned(), wording::seconds),
            );
        }
        row
    };
    table::render_rows(&columns, document.schedules.iter().map(row).collect())
}

/// One row per schedule, one column per coefficient: two tables of six, so that they fit.
fn coefficients(document: &ComparisonDocument) -> String {
    /// Coefficients of one table.
    const COLUMNS: usize = 6;
    let Some(first) = document.schedules.first() else {
        return String::new();
    };
    let mut tables = Vec::new();
    for from in (0..first.coefficients.len()).step_by(COLUMNS) {
        let shown = from..(from + COLUMNS).min(first.coefficients.len());
        let mut columns = vec![("schedule", Align::Left)];
        columns.extend(
            first.coefficients[shown.clone()]
                .iter()
                .map(|c| (c.name.name(), Align::Right)),
        );
        let row = |s: &ComparedRecord| {
            let mut row = vec![label(&s.name, s.order)];
            let sigma = s.coefficients[shown.clone()].iter();
            row.extend(sigma.map(|c| wording::number(1e3 * c.sigma_deg_per_h)));
            row
        };
        let rows = document.schedules.iter().map(row).collect();
        tables.push(table::render_rows(&columns, rows));
    }
    tables.join("\n")
}
