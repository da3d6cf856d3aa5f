//! `analyze`: what a given schedule makes observable, and why.

mod text;

use crate::error::Result;

use super::args::AnalyzeArgs;
use super::exit::Exit;
use super::inputs::{self, GivenSchedule};
use super::output::Output;

/// Runs the command.
pub(super) fn run(args: &AnalyzeArgs, output: Output) -> Result<Exit> {
    let GivenSchedule {
        study, schedule, ..
    } = inputs::given_schedule(&args.given, &args.common)?;
    let analysed = study.analyze(&schedule)?;
    let document = analysed.document();
    let text = if args.common.json {
        document.to_json()?
    } else {
        super::report::headed(&document.test, text::analysis(document))
    };
    output.data(&text)?;
    Ok(Exit::Done)
}
