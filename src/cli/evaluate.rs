//! `evaluate`: scores a given schedule.

use crate::error::Result;
use crate::report::html;
use crate::results::EvaluationDocument;

use super::Exit;
use super::args::EvaluateArgs;
use super::inputs::{self, GivenSchedule};
use super::output::Output;
use super::{page, report};

/// Runs the command.
pub(super) fn run(args: &EvaluateArgs, output: Output) -> Result<Exit> {
    let GivenSchedule {
        study,
        inputs,
        schedule,
        timeline,
    } = inputs::given_schedule(&args.given, &args.common)?;
    let evaluator = study.evaluator();
    let evaluation = evaluator.evaluate(&schedule)?;
    let document = EvaluationDocument::new(&evaluation, &schedule, evaluator.objective(), &inputs);
    let text = if args.common.json {
        document.to_json()?
    } else {
        report::evaluation(&document, study.platform(), &timeline)
    };
    page::write(args.report.as_deref(), output, || {
        html::evaluation(&document)
    })?;
    output.data(&text)?;
    Ok(Exit::Done)
}
