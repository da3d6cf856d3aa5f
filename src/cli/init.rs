//! `init`: writes a commented platform file.

use std::path::Path;

use crate::config::DEFAULT_TOML;
use crate::error::{Error, Result};

use super::args::InitArgs;
use super::exit::Exit;
use super::files::write_file;
use super::output::Output;

/// Runs the command.
pub(super) fn run(args: &InitArgs, output: Output) -> Result<Exit> {
    if args.file == Path::new("-") {
        output.data(DEFAULT_TOML)?;
        return Ok(Exit::Done);
    }
    if !args.force && args.file.exists() {
        return Err(Error::input("the file exists already")
            .with_file(&args.file)
            .with_hint("--force overwrites it"));
    }
    write_file(&args.file, DEFAULT_TOML, args.force)?;
    output.message(&format!("written: {}", args.file.display()));
    Ok(Exit::Done)
}
