//! Where text goes: data to stdout, messages and errors to stderr.

use std::io::{self, ErrorKind, Write};
use std::path::Path;

use crate::error::{Error, Result};

/// The two streams of a run.
#[derive(Debug, Clone, Copy)]
pub(super) struct Output {
    quiet: bool,
}

impl Output {
    /// `quiet` drops messages, not data and not errors.
    pub(super) const fn new(quiet: bool) -> Self {
        Self { quiet }
    }

    /// Whether messages are dropped.
    pub(super) const fn is_quiet(self) -> bool {
        self.quiet
    }

    /// Writes data to stdout. A reader that has seen enough and closed the pipe is no error.
    pub(super) fn data(self, text: &str) -> Result<()> {
        let mut stdout = io::stdout().lock();
        let written = stdout
            .write_all(text.as_bytes())
            .and_then(|()| stdout.flush());
        match written {
            Err(e) if e.kind() != ErrorKind::BrokenPipe => {
                Err(Error::io("write", Path::new("standard output"), e))
            }
            _ => Ok(()),
        }
    }

    /// Writes a message to stderr, unless quiet.
    pub(super) fn message(self, text: &str) {
        if !self.quiet {
            to_stderr(text);
        }
    }
}

/// Writes an error to stderr, with its hint if it has one.
pub(super) fn error(error: &Error) {
    to_stderr(&format!("error: {error}"));
}

/// There is nowhere left to report a failure of stderr itself.
fn to_stderr(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}
