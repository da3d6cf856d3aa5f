//! `analyze`: what a given schedule makes observable, and why.

mod text;

use crate::error::Result;
use crate::observability::analysis::Analysis;
use crate::results::AnalysisDocument;

use super::Exit;
use super::args::AnalyzeArgs;
use super::inputs::{self, GivenSchedule};
use super::output::Output;

/// Runs the command.
pub(super) fn run(args: &AnalyzeArgs, output: Output) -> Result<Exit> {
    let GivenSchedule {
        study,
        inputs,
        schedule,
        ..
    } = inputs::given_schedule(&args.given, &args.common)?;
    let evaluator = study.evaluator();
    let evaluation = evaluator.evaluate(&schedule)?;
    let analysis = Analysis::new(&evaluator, &schedule, &evaluation)?;
    let document = AnalysisDocument::new(&analysis, &evaluation, &schedule, &inputs);
    let text = if args.common.json {
        document.to_json()?
    } else {
        text::analysis(&document)
    };
    output.data(&text)?;
    Ok(Exit::Done)
}
