//! `evaluate`: scores a given schedule.

use crate::error::Result;
use crate::motion::Timeline;
use crate::results::EvaluationDocument;
use crate::schedule::file;

use super::Exit;
use super::args::EvaluateArgs;
use super::output::Output;
use super::{inputs, report};

/// Runs the command.
pub(super) fn run(args: &EvaluateArgs, output: Output) -> Result<Exit> {
    let (study, inputs) = inputs::load_for_evaluation(args.platform.as_deref(), &args.common)?;
    let schedule = file::read(&args.schedule)?;
    let timeline = Timeline::new(study.platform(), &schedule).map_err(|e| {
        // What the platform cannot do is about a position of the schedule.
        match e.key() {
            Some(key) if key.starts_with("positions") => e.with_file(&args.schedule),
            _ => e,
        }
    })?;
    let evaluator = study.evaluator();
    let evaluation = evaluator.evaluate(&schedule)?;
    let document = EvaluationDocument::new(&evaluation, &schedule, evaluator.objective(), &inputs);
    let text = if args.common.json {
        document.to_json()?
    } else {
        report::evaluation(&document, study.platform(), &timeline)
    };
    output.data(&text)?;
    Ok(Exit::Done)
}
