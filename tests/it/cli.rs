//! The program as a user runs it: every command, every kind of bad input, every exit code.

mod answers;
mod batches;
mod coloured;
mod commands;
mod comparison;
mod documents;
mod guides;
mod input_files;
mod interruption;
mod manual;
mod own_scheme;
mod pages;
mod provenance;
mod refusals;
mod resume;
mod schemas;
mod sheets;
mod specifications;
mod tables;
mod verdicts;
mod warnings;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

/// What a search writes.
const RESULTS: [&str; 7] = [
    "commands.csv",
    "report.html",
    "result.json",
    "schedule.csv",
    "schedule.json",
    "sheet.csv",
    "sheet.html",
];

/// A directory of its own to run the program in.
struct Desk(TempDir);

impl Desk {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), content).unwrap();
    }

    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.text(name)).unwrap()
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin!("scheme-opt"));
        command.args(args).current_dir(self.0.path());
        command.env_remove("RUST_BACKTRACE");
        command
    }

    fn run(&self, args: &[&str]) -> Run {
        Run::of(self.command(args).output().unwrap())
    }

    /// Runs what must succeed; gives its stdout.
    fn done(&self, args: &[&str]) -> String {
        let run = self.run(args);
        assert_eq!(run.code, Some(0), "{args:?}: {}", run.stderr);
        run.stdout
    }

    /// Names of the files here, sorted.
    fn files(&self) -> Vec<String> {
        names(self.0.path())
    }
}

fn names(directory: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(directory).unwrap();
    let mut names: Vec<String> = entries
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// What a run left behind.
struct Run {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

impl Run {
    fn of(output: Output) -> Self {
        Self {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }

    /// Refused as bad input, with a message that contains all of `parts`.
    fn refused(&self, parts: &[&str]) {
        assert_eq!(self.code, Some(2), "{}", self.stderr);
        assert_eq!(self.stdout, "");
        assert!(self.stderr.starts_with("error: "), "{}", self.stderr);
        assert!(!self.stderr.contains("panicked"), "{}", self.stderr);
        for part in parts {
            assert!(self.stderr.contains(part), "`{part}` in: {}", self.stderr);
        }
    }
}

/// Six oblique positions, which make everything observable.
const SCHEDULE: &str = "alpha_deg,beta_deg,gamma_deg,dwell_s\n\
                        10,20,30,1000\n50,-40,100,1500\n-120,30,0,1200\n\
                        170,10,-80,900\n-60,-50,200,1100\n95,55,-145,1300\n";
