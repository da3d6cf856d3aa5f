//! `analyze`: what a given schedule makes observable, and why.

mod text;

use crate::error::Result;
use crate::motion::Timeline;
use crate::observability::analysis::Analysis;
use crate::results::AnalysisDocument;
use crate::schedule::file;

use super::Exit;
use super::args::AnalyzeArgs;
use super::inputs;
use super::output::Output;

/// Runs the command.
pub(super) fn run(args: &AnalyzeArgs, output: Output) -> Result<Exit> {
    let (study, inputs) = inputs::load_for_evaluation(args.platform.as_deref(), &args.common)?;
    let schedule = file::read(&args.schedule)?;
    Timeline::new(study.platform(), &schedule).map_err(|e| {
        // What the platform cannot do is about a position of the schedule.
        match e.key() {
            Some(key) if key.starts_with("positions") => e.with_file(&args.schedule),
            _ => e,
        }
    })?;
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
