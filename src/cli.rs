//! The command line: arguments, progress, tables, exit codes.
//!
//! Data goes to stdout, messages and progress to stderr; nothing else of the library writes to
//! either. [`run`] is all of it:
//!
//! ```no_run
//! std::process::exit(i32::from(scheme_opt::internals::cli::run(std::env::args_os()).code()));
//! ```

mod analyze;
mod args;
mod batch;
mod bound;
mod checkpoint;
mod commands;
mod compare;
mod completions;
mod convert;
mod evaluate;
mod exit;
mod files;
mod finished;
mod init;
mod inputs;
mod man;
mod named;
mod output;
mod page;
mod progress;
mod report;
mod schema;
mod screen;
mod search;
mod simulate;
mod standard;
mod table;

use std::ffi::OsString;

use clap::Parser;

use crate::error::Result;
use args::{Cli, Invocation};
pub use exit::Exit;
use output::Output;

/// Runs the command line `args`, the program's name first.
pub fn run(args: impl IntoIterator<Item = OsString>) -> Exit {
    let cli = match Cli::try_parse_from(args) {
        Ok(cli) => cli,
        Err(e) => {
            // Help and version come this way too. A closed pipe is nobody's concern.
            let _ = e.print();
            return match e.exit_code() {
                0 => Exit::Done,
                _ => Exit::Failed,
            };
        }
    };
    match dispatch(&cli.command) {
        Ok(exit) => exit,
        Err(error) => {
            output::error(&error);
            if error.is_infeasible() {
                Exit::NoSchedule
            } else {
                Exit::Failed
            }
        }
    }
}

fn dispatch(command: &Invocation) -> Result<Exit> {
    let output = Output::new(command.is_quiet());
    match command {
        Invocation::Search(args) => search::run(args, output),
        Invocation::Evaluate(args) => evaluate::run(args, output),
        Invocation::Analyze(args) => analyze::run(args, output),
        Invocation::Simulate(args) => simulate::run(args, output),
        Invocation::Compare(args) => compare::run(args, output),
        Invocation::Bound(args) => bound::run(args, output),
        Invocation::Batch(args) => batch::run(args, output),
        Invocation::Init(args) => init::run(args, output),
        Invocation::Standard(args) => standard::run(args, output),
        Invocation::Convert(args) => convert::run(args, output),
        Invocation::Commands(args) => commands::run(args, output),
        Invocation::Report(args) => page::run(args, output),
        Invocation::Schema(args) => schema::run(args, output),
        Invocation::Completions(args) => completions::run(args, output),
        Invocation::Man(args) => man::run(args, output),
    }
}
