//! `bound`: what no schedule can beat, without searching for one.

use crate::config::Mode;
use crate::error::Result;
use crate::report::words;
use crate::results::BoundDocument;
use crate::wording;

use super::args::BoundArgs;
use super::exit::Exit;
use super::inputs;
use super::output::Output;
use super::report::{headed, wrap};
use super::table;

/// Runs the command.
pub(super) fn run(args: &BoundArgs, output: Output) -> Result<Exit> {
    let study = inputs::load(args.platform.as_deref(), &args.common, None)?;
    let bound = study.bound()?;
    let document = bound.document();
    let text = if args.common.json {
        document.to_json()?
    } else {
        headed(&document.test, report(document))
    };
    output.data(&text)?;
    Ok(match study.config().objective.mode {
        Mode::Time if bound.specification_is_hopeless() => Exit::NoSchedule,
        _ => Exit::Done,
    })
}

/// The bound for people.
fn report(document: &BoundDocument) -> String {
    let mut text = String::new();
    if document.criterion != "a" || !document.inputs.objective.weights.is_empty() {
        let unit = words::unit(&document.criterion_unit);
        text.push_str(&format!(
            "No schedule of {} s or less has a criterion {} below {}{unit}\n",
            wording::seconds(document.total_time_s),
            document.criterion,
            wording::number(document.lower_bound),
        ));
    }
    text.push_str(&format!(
        "No schedule of {} s or less has an RMS sigma below {} deg/h\n",
        wording::seconds(document.total_time_s),
        wording::number(document.rms_sigma_lower_bound_deg_per_h),
    ));
    if let Some(minimum) = &document.minimum_time {
        let mut letters = minimum.chars();
        let first = letters.next().map(|c| c.to_uppercase().to_string());
        text.push_str(&wrap(&format!(
            "{}{}",
            first.unwrap_or_default(),
            letters.as_str()
        )));
    }
    text.push_str("\nEach coefficient by itself, 1 sigma; not all can be this good at once\n\n");
    text.push_str(&table::sigma_bounds(document));
    text.push('\n');
    for remark in &document.remarks {
        text.push_str(&wrap(&format!("Note: {remark}.")));
    }
    text.push_str(&wrap(&how(document)));
    text
}

/// What the bound rests on.
fn how(document: &BoundDocument) -> String {
    let Some(majorant) = &document.majorant else {
        return "Whatever the sequence, order, number and motion of the positions.".to_owned();
    };
    format!(
        "Whatever the sequence, order, number and motion of the positions; {majorant} majorant, \
         equivalence gap {:.0e}.",
        document.equivalence_gap
    )
}
