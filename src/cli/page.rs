//! `report`: the page of a document; and the same for the commands that make the document.

use std::path::Path;

use crate::error::{Error, Result};
use crate::report::html;

use super::Exit;
use super::args::ReportArgs;
use super::files::write_file;
use super::output::Output;

/// Runs the command.
pub(super) fn run(args: &ReportArgs, output: Output) -> Result<Exit> {
    let path = &args.document;
    let text = std::fs::read_to_string(path).map_err(|e| Error::io("read the file", path, &e))?;
    let page = html::from_json(&text).map_err(|e| e.with_file(path))?;
    if args.output == Path::new("-") {
        output.data(&page)?;
    } else {
        write(Some(&args.output), output, || Ok(page))?;
    }
    Ok(Exit::Done)
}

/// Writes a page to `path`, if there is one.
pub(super) fn write(
    path: Option<&Path>,
    output: Output,
    page: impl FnOnce() -> Result<String>,
) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    write_file(path, &page()?, true)?;
    output.message(&format!("written: {}", path.display()));
    Ok(())
}
