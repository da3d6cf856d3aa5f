//! `man`: the manual, made from the command line's grammar.

use std::path::Path;

use clap::CommandFactory;

use crate::error::{Error, Result};

use super::args::{Cli, ManArgs};
use super::exit::Exit;
use super::files::{Existing, OutputFiles};
use super::output::Output;

/// Runs the command.
pub(super) fn run(args: &ManArgs, output: Output) -> Result<Exit> {
    let mut command = Cli::command();
    // Gives the pages of the commands their full names.
    command.build();
    let Some(directory) = &args.output else {
        output.data(&page(&command)?)?;
        return Ok(Exit::Done);
    };
    let mut names = vec!["scheme-opt.1".to_owned()];
    let mut pages = vec![page(&command)?];
    for sub in command.get_subcommands().filter(|c| c.get_name() != "help") {
        names.push(format!("scheme-opt-{}.1", sub.get_name()));
        pages.push(page(sub)?);
    }
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let files = OutputFiles::prepare(directory, &names, Existing::Replace)?;
    // Pages of a manual are nobody's results.
    let written = files.commit(&pages, Output::new(true))?;
    output.message(&format!(
        "written: {} pages in {}",
        written.len(),
        directory.display()
    ));
    Ok(Exit::Done)
}

fn page(command: &clap::Command) -> Result<String> {
    let mut text = Vec::new();
    clap_mangen::Man::new(command.clone())
        .render(&mut text)
        .map_err(|e| Error::io("write", Path::new("the manual"), e))?;
    Ok(String::from_utf8_lossy(&text).into_owned())
}
