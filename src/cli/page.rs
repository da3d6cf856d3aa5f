//! `report`: the page of a document; and the same for the commands that make the document.

use std::path::Path;

use crate::error::Result;
use crate::report::html;
use crate::schedule::text;

use super::args::ReportArgs;
use super::exit::Exit;
use super::files::write_file;
use super::output::Output;

/// Largest document that is read, bytes: a long front with all its schedules has a tenth of it.
const MAX_BYTES: u64 = 1 << 28;

/// Runs the command.
pub(super) fn run(args: &ReportArgs, output: Output) -> Result<Exit> {
    let path = &args.document;
    let text = text::read_text(path, MAX_BYTES)?;
    let page = html::from_json(&text).map_err(|e| e.with_file(path))?;
    if args.output == Path::new("-") {
        output.data(&page)?;
    } else {
        write(Some(&args.output), output, || Ok(page))?;
    }
    Ok(Exit::Done)
}

/// The page, or one that says why there is none: what it explains is not lost with it.
pub(super) fn made(page: Result<String>, output: Output) -> Result<String> {
    page.or_else(|why| {
        output.message(&format!("note: the report could not be made: {why}"));
        html::absent(&why)
    })
}

/// Writes a page to `path`, if there is one.
pub(super) fn write(
    path: Option<&Path>,
    output: Output,
    page: impl FnOnce() -> Result<String>,
) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    write_file(path, &made(page(), output)?, true)?;
    output.message(&format!("written: {}", path.display()));
    Ok(())
}
