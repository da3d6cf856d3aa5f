//! `standard`: lists the built-in schemes, or writes one.

use std::path::Path;

use crate::error::Result;
use crate::results::SchemeListDocument;
use crate::schedule::Schedule;
use crate::schedule::standard::StandardScheme;

use super::args::{Format, StandardArgs};
use super::exit::Exit;
use super::files::write_file;
use super::output::Output;
use super::{inputs, table};

/// Runs the command.
pub(super) fn run(args: &StandardArgs, output: Output) -> Result<Exit> {
    match &args.name {
        Some(name) => write(name, args, output)?,
        None if args.json => output.data(&SchemeListDocument::new().to_json()?)?,
        None => output.data(&table::schemes())?,
    }
    Ok(Exit::Done)
}

fn write(name: &str, args: &StandardArgs, output: Output) -> Result<()> {
    let scheme = StandardScheme::from_name(name)?;
    let study = inputs::load_with_total_time(args.platform.as_deref(), args.total_time_s, output)?;
    let schedule = study.standard(scheme)?;
    let text = written(&schedule, args.format, args.output.as_deref());
    let Some(path) = &args.output else {
        return output.data(&text);
    };
    write_file(path, &text, true)?;
    output.message(&format!("written: {}", path.display()));
    Ok(())
}

/// The schedule in the format asked for, else by the extension of the file, else as JSON.
pub(super) fn written(schedule: &Schedule, asked: Option<Format>, file: Option<&Path>) -> String {
    let extension = file.and_then(Path::extension);
    let is_csv = extension.is_some_and(|e| e.eq_ignore_ascii_case("csv"));
    match asked.unwrap_or(if is_csv { Format::Csv } else { Format::Json }) {
        Format::Json => schedule.to_json(),
        Format::Csv => schedule.to_csv(),
    }
}
