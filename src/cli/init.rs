//! `init`: writes a commented platform file.

use std::borrow::Cow;
use std::path::Path;

use crate::config::{DEFAULT_TOML, Grade};
use crate::error::{Error, Result};

use super::args::InitArgs;
use super::exit::Exit;
use super::files::write_file;
use super::output::Output;

/// Runs the command.
pub(super) fn run(args: &InitArgs, output: Output) -> Result<Exit> {
    let text: Cow<'_, str> = match (args.grade, args.full) {
        (None, false) => DEFAULT_TOML.into(),
        (grade, full) => grade
            .unwrap_or(Grade::Navigation)
            .platform_file(full)
            .into(),
    };
    if args.file == Path::new("-") {
        output.data(&text)?;
        return Ok(Exit::Done);
    }
    if !args.force && args.file.exists() {
        return Err(Error::input("the file exists already")
            .with_file(&args.file)
            .with_hint("--force overwrites it"));
    }
    write_file(&args.file, &text, args.force)?;
    output.message(&format!("written: {}", args.file.display()));
    Ok(Exit::Done)
}
