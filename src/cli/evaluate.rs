//! `evaluate`: scores a given schedule.

use crate::error::Result;

use super::args::EvaluateArgs;
use super::exit::Exit;
use super::files::Existing;
use super::inputs::{self, GivenSchedule};
use super::output::Output;
use super::{page, report};

/// Runs the command.
pub(super) fn run(args: &EvaluateArgs, output: Output) -> Result<Exit> {
    let GivenSchedule {
        study,
        schedule,
        timeline,
    } = inputs::given_schedule(&args.given, &args.common)?;
    let evaluated = study.evaluate(&schedule)?;
    let document = evaluated.document();
    let text = if args.common.json {
        document.to_json()?
    } else {
        let text = report::evaluation(document, study.test().platform(), &timeline);
        report::headed(&document.test, text)
    };
    page::write(args.report.as_deref(), Existing::Replace, output, || {
        evaluated.report_html()
    })?;
    output.data(&text)?;
    Ok(Exit::Done)
}
