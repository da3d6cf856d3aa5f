//! `commands`: what the stand is told to do, as CSV.

use crate::error::{Error, Result};
use crate::suspicion;

use super::args::CommandsArgs;
use super::exit::Exit;
use super::files::write_file;
use super::inputs;
use super::output::Output;

/// Runs the command.
pub(super) fn run(args: &CommandsArgs, output: Output) -> Result<Exit> {
    let given = inputs::given_schedule(&args.given, &args.common)?;
    let table = given.study.commands(&given.schedule, args.step_deg);
    let table = table.map_err(name_option)?;
    let text = match args.common.json {
        true => {
            let (config, defaulted) = (given.study.config(), given.study.defaulted());
            let warnings = suspicion::of(config, defaulted, Some(&given.schedule));
            let mut document = table.document();
            document.test = config.test.clone();
            document.warnings = warnings.iter().map(Into::into).collect();
            document.to_json()?
        }
        false => table.to_csv(),
    };
    match &args.output {
        Some(path) => {
            write_file(path, &text, true)?;
            output.message(&format!("written: {}", path.display()));
        }
        None => output.data(&text)?,
    }
    Ok(Exit::Done)
}

/// Says which option a refused number came from.
fn name_option(error: Error) -> Error {
    match error.key() {
        Some("step_deg") => error.with_key("--step-deg"),
        _ => error,
    }
}
