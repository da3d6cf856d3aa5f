//! The checkpoint of a search: a file in the output directory, from which `--resume` goes on.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::{Error, Result};
use crate::results::TOOL_VERSION;
use crate::schedule::file::ScheduleDocument;
use crate::schedule::text;
use crate::search::checkpoint::{Finished, Journal};
use crate::study::Study;

use super::files::write_file;
use super::finished::fingerprint;
use super::output::Output;

/// Name of the file in the output directory.
const FILE: &str = "checkpoint.json";
/// Name and major version of the document.
const SCHEMA: &str = "scheme-opt/checkpoint/2";
/// Largest checkpoint that is read, bytes.
const MAX_BYTES: u64 = 1 << 30;
/// Share of the time that may go into writing checkpoints.
const MOST_EFFORT: u32 = 20;

/// The document.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CheckpointDocument {
    schema: String,
    tool_version: String,
    /// The problem: another one does not take the same way.
    inputs: Value,
    /// Fingerprint of the same resolved: of what the files hold that the inputs name, too.
    #[serde(default)]
    resolved: String,
    finished: BTreeMap<String, Finished>,
}

/// What is done of a search, and where that is kept.
pub(super) struct Checkpoint {
    path: PathBuf,
    inputs: Value,
    resolved: String,
    journal: Arc<Journal>,
    /// Whether the file is this run's: read or written by it.
    own: Mutex<bool>,
}

impl Checkpoint {
    /// The checkpoint of a search for `study` in `directory`: what is there if the search is
    /// resumed, otherwise empty.
    pub(super) fn open(
        directory: &Path,
        study: &Study,
        resume: bool,
        output: Output,
    ) -> Result<Self> {
        let mut checkpoint = Self {
            path: directory.join(FILE),
            inputs: problem(study)?,
            resolved: fingerprint(&[&study.resolved()]),
            journal: Arc::default(),
            own: Mutex::new(false),
        };
        let exists = checkpoint.path.exists();
        match (exists, resume) {
            (true, true) => {
                checkpoint.journal = Arc::new(checkpoint.read()?);
                checkpoint.own = Mutex::new(true);
                let count = checkpoint.journal.len();
                output.message(&format!(
                    "resuming: {count} pieces of work are done already"
                ));
            }
            (true, false) => output.message(&format!(
                "note: {} is of an unfinished search and will be replaced; --resume continues it",
                checkpoint.path.display()
            )),
            (false, true) => {
                output.message("note: no checkpoint there, starting from the beginning")
            }
            (false, false) => {}
        }
        Ok(checkpoint)
    }

    /// Refuses a directory with the checkpoint of an unfinished search, which a new one would replace.
    pub(super) fn refuse_unfinished(directory: &Path) -> Result<()> {
        let path = directory.join(FILE);
        match path.exists() {
            true => Err(
                Error::input("an unfinished search is there, and --no-clobber keeps it")
                    .with_file(path)
                    .with_hint("--resume continues it; or choose another directory with -o"),
            ),
            false => Ok(()),
        }
    }

    /// What is done.
    pub(super) fn journal(&self) -> Arc<Journal> {
        Arc::clone(&self.journal)
    }

    fn read(&self) -> Result<Journal> {
        let text = text::read_text(&self.path, MAX_BYTES)?;
        let document: CheckpointDocument = serde_json::from_str(&text).map_err(|e| {
            Error::input("not a checkpoint")
                .with_file(&self.path)
                .with_line(e.line().max(1))
                .with_source(e)
        })?;
        let refused = |what: &str| {
            Err(Error::input(what)
                .with_file(&self.path)
                .with_hint("without --resume the search starts from the beginning"))
        };
        if (document.schema.as_str(), document.tool_version.as_str()) != (SCHEMA, TOOL_VERSION) {
            return refused("the checkpoint is of another version of the program");
        }
        if let Some(key) = first_difference("", &document.inputs, &self.inputs) {
            return refused(&format!(
                "the checkpoint is of another problem: {key} differs"
            ));
        }
        if document.resolved != self.resolved {
            return refused(
                "the checkpoint is of another problem: a file that it names has changed",
            );
        }
        Ok(Journal::new(document.finished))
    }

    /// Writes the file, if anything is done.
    pub(super) fn save(&self) -> Result<()> {
        let document = CheckpointDocument {
            schema: SCHEMA.to_owned(),
            tool_version: TOOL_VERSION.to_owned(),
            inputs: self.inputs.clone(),
            resolved: self.resolved.clone(),
            finished: self.journal.finished(),
        };
        if document.finished.is_empty() {
            return Ok(());
        }
        let content = serde_json::to_string(&document).map_err(|e| {
            Error::numerical(format!("the checkpoint cannot be written: {e}")).with_source(e)
        })?;
        if let Some(directory) = self.path.parent() {
            std::fs::create_dir_all(directory)
                .map_err(|e| Error::io("create the output directory", directory, e))?;
        }
        write_file(&self.path, &(content + "\n"), true)?;
        self.take_over();
        Ok(())
    }

    /// Writes the file now and then until `stop` hangs up.
    pub(super) fn keep_saving(&self, interval: Duration, stop: &Receiver<()>, output: Output) {
        let (mut pause, mut saved, mut warned) = (interval, self.journal.len(), false);
        while let Err(RecvTimeoutError::Timeout) = stop.recv_timeout(pause) {
            let done = self.journal.len();
            if done == saved {
                continue;
            }
            let began = Instant::now();
            match self.save() {
                Ok(()) => saved = done,
                Err(e) if !warned => {
                    warned = true;
                    output.message(&format!("note: no checkpoint is kept: {e}"));
                }
                // Said once; the last attempt, at the end of the search, says it again.
                Err(_) => {}
            }
            pause = interval.max(began.elapsed() * MOST_EFFORT);
        }
    }

    /// Removes the file of a search that is finished, if it is this run's.
    pub(super) fn discard(&self) {
        if self.is_own() {
            // Left behind it does no harm: the same search resumed ends at once.
            let _ = std::fs::remove_file(&self.path);
        }
    }

    fn is_own(&self) -> bool {
        *self.own.lock().unwrap_or_else(|e| e.into_inner())
    }

    fn take_over(&self) {
        *self.own.lock().unwrap_or_else(|e| e.into_inner()) = true;
    }
}

/// The study without what has no part in the result.
fn problem(study: &Study) -> Result<Value> {
    let mut config = study.config().clone();
    config.search.threads = None;
    config.search.time_limit_s = None;
    let written = |value: serde_json::Result<Value>| {
        value.map_err(|e| {
            Error::numerical(format!("the inputs cannot be written: {e}")).with_source(e)
        })
    };
    let mut inputs = written(serde_json::to_value(&config))?;
    if let Value::Object(inputs) = &mut inputs {
        if let Some(from) = study.begins_with() {
            let schedule = ScheduleDocument::from(&from.schedule);
            let schedule = written(serde_json::to_value(&schedule))?;
            let only = written(serde_json::to_value(from.freedom.names()))?;
            inputs.insert("from".to_owned(), schedule);
            inputs.insert("only".to_owned(), only);
        }
        if let Some(done) = study.inputs().done {
            inputs.insert("done".to_owned(), written(serde_json::to_value(&done))?);
        }
    }
    Ok(inputs)
}

/// The dotted key of the first value that differs.
fn first_difference(key: &str, a: &Value, b: &Value) -> Option<String> {
    if let (Value::Object(a), Value::Object(b)) = (a, b) {
        return a.keys().chain(b.keys()).find_map(|name| {
            let inner = match key {
                "" => name.clone(),
                _ => format!("{key}.{name}"),
            };
            let missing = Value::Null;
            let [a, b] = [a, b].map(|map| map.get(name).unwrap_or(&missing));
            first_difference(&inner, a, b)
        });
    }
    (a != b).then(|| key.to_owned())
}
