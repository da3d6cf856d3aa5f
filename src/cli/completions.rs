//! `completions`: for the user's shell.

use clap::CommandFactory;

use crate::error::Result;

use super::args::{Cli, CompletionsArgs};
use super::exit::Exit;
use super::output::Output;

/// Runs the command.
pub(super) fn run(args: &CompletionsArgs, output: Output) -> Result<Exit> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "scheme-opt", &mut text);
    output.data(&String::from_utf8_lossy(&text))?;
    Ok(Exit::Done)
}
