//! The `scheme-opt` program: see [`scheme_opt::cli`].

use std::process::ExitCode;

fn main() -> ExitCode {
    scheme_opt::internals::cli::run(std::env::args_os()).into()
}
