//! `schema`: the JSON Schema of a document.

use crate::error::Result;
use crate::results::schema::DocumentKind;

use super::args::SchemaArgs;
use super::exit::Exit;
use super::output::Output;
use super::table;

/// Runs the command.
pub(super) fn run(args: &SchemaArgs, output: Output) -> Result<Exit> {
    let text = match args.which {
        Some(which) => which.schema()?,
        None if args.json => DocumentKind::list_as_json()?,
        None => table::documents(),
    };
    output.data(&text)?;
    Ok(Exit::Done)
}
