//! `report`: the page of a document; and the same for the commands that make the document.

use std::path::Path;

use crate::error::Result;
use crate::report::html;
use crate::schedule::text;

use super::args::ReportArgs;
use super::exit::Exit;
use super::files::{Existing, whose, write_file};
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
        write(Some(&args.output), Existing::Replace, output, || Ok(page))?;
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

/// Refuses, before the work, a page that is there already and is to be kept.
pub(super) fn check(path: Option<&Path>, existing: Existing) -> Result<()> {
    path.map_or(Ok(()), |path| existing.check(path))
}

/// Writes a page to `path`, if there is one.
pub(super) fn write(
    path: Option<&Path>,
    existing: Existing,
    output: Output,
    page: impl FnOnce() -> Result<String>,
) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let page = made(page(), output)?;
    let replaced = whose(&[path]);
    write_file(path, &page, existing == Existing::Replace)?;
    if let Some(replaced) = replaced {
        output.message(&replaced);
    }
    output.message(&format!("written: {}", path.display()));
    Ok(())
}
