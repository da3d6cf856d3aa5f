//! The mark of a finished search in a directory of a batch: by what it is known not to be needed again.

use std::hash::Hasher;
use std::path::Path;

use serde::{Deserialize, Serialize};
use siphasher::sip128::{Hasher128, SipHasher};

use crate::error::{Error, Result};
use crate::results::{BatchRecord, TOOL_VERSION};
use crate::schedule::text;
use crate::study::Study;

use super::search::FILES;

/// Name and major version of the document.
const SCHEMA: &str = "scheme-opt/finished/1";
/// Largest file that is read, bytes.
const MAX_BYTES: u64 = 1 << 28;

/// What a search is asked, as a fingerprint.
pub(super) struct Finished {
    input: String,
}

/// The document.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FinishedDocument {
    schema: String,
    /// Fingerprint of the program's version and of all that the search depends on.
    input: String,
    /// Fingerprint of the files beside it.
    files: String,
    /// The line in the summary.
    platform: BatchRecord,
}

impl Finished {
    /// Name of the file.
    pub(super) const FILE: &str = "finished.json";

    /// Of all that the answer of `study` depends on: the values of its file and of the files that this
    /// names, but not how long or on how many threads it may be worked on.
    pub(super) fn of(study: &Study) -> Result<Self> {
        let mut config = study.config().clone();
        config.search.threads = None;
        config.search.time_limit_s = None;
        let config = serde_json::to_string(&config).map_err(|e| {
            Error::numerical(format!("the inputs cannot be written: {e}")).with_source(e)
        })?;
        // Other files are in the resolved values alone.
        let resolved = study.resolved();
        let defaulted = study.defaulted().join(",");
        Ok(Self {
            input: fingerprint(&[TOOL_VERSION, &config, &resolved, &defaulted]),
        })
    }

    /// The line of a search for the same that is finished in `directory`, its files as they were.
    pub(super) fn read(&self, directory: &Path) -> Option<BatchRecord> {
        let text = text::read_text(&directory.join(Self::FILE), MAX_BYTES).ok()?;
        let document: FinishedDocument = serde_json::from_str(&text).ok()?;
        let files = FILES.map(|name| text::read_text(&directory.join(name), MAX_BYTES));
        let files: Vec<String> = files.into_iter().collect::<Result<_>>().ok()?;
        let is_same = document.schema == SCHEMA
            && document.input == self.input
            && document.files == of_files(&files)
            && document.platform.status.is_finished();
        is_same.then_some(document.platform)
    }

    /// The mark of what was found, `record`, with the files in the order of [`FILES`].
    pub(super) fn written(&self, record: &BatchRecord, files: &[String]) -> Result<String> {
        let document = FinishedDocument {
            schema: SCHEMA.to_owned(),
            input: self.input.clone(),
            files: of_files(files),
            platform: record.clone(),
        };
        let text = serde_json::to_string_pretty(&document).map_err(|e| {
            Error::numerical(format!("the mark cannot be written as JSON: {e}")).with_source(e)
        })?;
        Ok(text + "\n")
    }
}

fn of_files(files: &[String]) -> String {
    let files: Vec<&str> = files.iter().map(String::as_str).collect();
    fingerprint(&files)
}

/// 128 bits of texts: the same with every version of the compiler and on every machine.
pub(super) fn fingerprint(texts: &[&str]) -> String {
    let mut hasher = SipHasher::new();
    for text in texts {
        // Where one text ends counts.
        hasher.write(&(text.len() as u64).to_le_bytes());
        hasher.write(text.as_bytes());
    }
    format!("{:032x}", hasher.finish128().as_u128())
}
