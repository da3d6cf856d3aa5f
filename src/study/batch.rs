//! A search for each of many platforms.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use super::Study;
use crate::error::{Error, Result};
use crate::results::{BatchDocument, BatchRecord};
use crate::search::Control;

/// Many platforms, a search for each; what is wrong with one does not keep the others.
///
/// ```
/// use scheme_opt::{Batch, BatchControl, Study};
/// let file = |latitude| format!("[site]\nlatitude_deg = {latitude}\n[search]\nstarts = 2\nmax_positions = 4\n");
/// let batch = Batch::of([28.2, 95.0].map(|latitude| {
///     (format!("at-{latitude}.toml").into(), Study::from_toml(&file(latitude)))
/// }));
/// let found = batch.search(&BatchControl::default());
/// let [here, nowhere] = &found.document().platforms[..] else { panic!() };
/// assert!(here.rms_sigma_deg_per_h.is_some() && here.directory == "at-28.2");
/// assert!(nowhere.error.as_ref().is_some_and(|e| e.contains("latitude_deg")));
/// ```
#[derive(Debug)]
pub struct Batch {
    platforms: Vec<BatchPlatform>,
}

/// One platform of a [`Batch`].
#[derive(Debug)]
pub struct BatchPlatform {
    study: Result<Study>,
    /// Its line in the summary before anything is known.
    record: BatchRecord,
}

impl BatchPlatform {
    /// Its study, or why there is none.
    pub fn study(&self) -> std::result::Result<&Study, &Error> {
        self.study.as_ref()
    }

    /// The platform file as it was named.
    pub fn file(&self) -> &str {
        &self.record.file
    }

    /// The name of its directory, of no other platform of the batch.
    pub fn directory(&self) -> &str {
        &self.record.directory
    }

    /// Its line in the summary before anything is known.
    #[cfg(feature = "cli")]
    pub(crate) fn record(&self) -> &BatchRecord {
        &self.record
    }
}

/// How a [`Batch`] is run and stopped.
#[derive(Debug, Clone, Default)]
pub struct BatchControl {
    jobs: Option<NonZeroUsize>,
    cancel: Arc<AtomicBool>,
}

impl BatchControl {
    /// So many searches at a time; none given: one for each processor. The processors are divided among
    /// them, except where a platform says `search.threads`.
    #[must_use]
    pub fn with_jobs(mut self, jobs: Option<NonZeroUsize>) -> Self {
        self.jobs = jobs;
        self
    }

    /// Stops soon after `cancel` becomes true: the searches under way give their best so far, the others
    /// are not begun.
    #[must_use]
    pub fn with_cancel(mut self, cancel: Arc<AtomicBool>) -> Self {
        self.cancel = cancel;
        self
    }
}

/// What a batch found.
#[derive(Debug, Clone, PartialEq)]
pub struct BatchResult {
    document: BatchDocument,
}

impl BatchResult {
    /// The summary as data, in the form of `batch.json`.
    pub fn document(&self) -> &BatchDocument {
        &self.document
    }

    /// The summary as one HTML page that needs nothing else.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when the page cannot be made.
    #[cfg(feature = "report")]
    pub fn report_html(&self) -> Result<String> {
        crate::report::html::batch(&self.document)
    }
}

impl Batch {
    /// The platforms of these files. What cannot be read or is not acceptable is kept as its error.
    pub fn from_files<P: AsRef<Path>>(files: impl IntoIterator<Item = P>) -> Self {
        let read = |file: P| (file.as_ref().to_owned(), Study::from_file(file));
        Self::of(files.into_iter().map(read))
    }

    /// These studies, each with the name of its file.
    pub fn of(studies: impl IntoIterator<Item = (PathBuf, Result<Study>)>) -> Self {
        let mut taken = BTreeSet::new();
        let platforms = studies.into_iter().map(|(file, study)| {
            let stem = file.file_stem().unwrap_or("platform".as_ref());
            let stem = stem.to_string_lossy();
            let directory = unique(&stem, &mut taken);
            let given = study
                .as_ref()
                .ok()
                .and_then(|s| s.config().test.title.clone());
            let title = given.unwrap_or_else(|| stem.into_owned());
            let file = file.to_string_lossy();
            BatchPlatform {
                study,
                record: BatchRecord::not_started(&file, &title, &directory),
            }
        });
        Self {
            platforms: platforms.collect(),
        }
    }

    /// The platforms in the order given.
    pub fn platforms(&self) -> &[BatchPlatform] {
        &self.platforms
    }

    /// Searches for the best schedule of each, as [`Study::search`] does. The same platforms give the
    /// same document whatever runs at the same time.
    pub fn search(&self, control: &BatchControl) -> BatchResult {
        self.search_by(control, &|platform, study, control| {
            let found = study.search(control)?;
            Ok(platform
                .record
                .clone()
                .found(found.document(), found.is_acceptable()))
        })
    }

    /// The same where `search` says what is done for a platform.
    ///
    /// Plain threads take the platforms in turn, and each search computes on a pool of its own: in one
    /// pool for all, a search that waits would take up another one in between, and its time limit with it.
    pub(crate) fn search_by(
        &self,
        control: &BatchControl,
        search: &(dyn Fn(&BatchPlatform, &Study, &Control) -> Result<BatchRecord> + Sync),
    ) -> BatchResult {
        let processors = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
        let jobs = control.jobs.map_or(processors, NonZeroUsize::get);
        let jobs = jobs.clamp(1, self.platforms.len().max(1));
        let of_each = Control::default()
            .with_cancel(Arc::clone(&control.cancel))
            .with_threads((processors / jobs).max(1));
        let found: Vec<OnceLock<BatchRecord>> =
            self.platforms.iter().map(|_| OnceLock::new()).collect();
        let next = AtomicUsize::new(0);
        let work = || {
            loop {
                let index = next.fetch_add(1, Ordering::SeqCst);
                let Some(platform) = self.platforms.get(index) else {
                    break;
                };
                // Nobody else has this index.
                let _ = found[index].set(platform.searched(&of_each, search));
            }
        };
        std::thread::scope(|scope| {
            for _ in 0..jobs {
                scope.spawn(work);
            }
        });
        let records = found.into_iter().zip(&self.platforms);
        let records = records.map(|(found, p)| found.into_inner().unwrap_or(p.record.clone()));
        BatchResult {
            document: BatchDocument::new(records.collect()),
        }
    }
}

impl BatchPlatform {
    fn searched(
        &self,
        control: &Control,
        search: &(dyn Fn(&Self, &Study, &Control) -> Result<BatchRecord> + Sync),
    ) -> BatchRecord {
        let study = match &self.study {
            Ok(study) => study,
            Err(error) => return self.record.clone().failed(error),
        };
        if control.is_cancelled() {
            return self.record.clone();
        }
        search(self, study, control).unwrap_or_else(|error| self.record.clone().failed(&error))
    }
}

/// `name`, or with a number where it is taken; on some file systems upper and lower case are the same.
fn unique(name: &str, taken: &mut BTreeSet<String>) -> String {
    // The files of the summary are beside the directories.
    let reserved = |name: &str| name.starts_with("batch.") || name.starts_with('.');
    let name = match reserved(&name.to_lowercase()) {
        true => format!("platform-{}", name.trim_start_matches('.')),
        false => name.to_owned(),
    };
    let mut candidates = (1_usize..).map(|number| match number {
        1 => name.clone(),
        _ => format!("{name}-{number}"),
    });
    // There is a number for each of finitely many.
    candidates
        .find(|candidate| taken.insert(candidate.to_lowercase()))
        .unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directories_are_named_by_files_and_are_all_different() {
        let files = [
            "a/stand.toml",
            "b/stand.toml",
            "stand-2.toml",
            "Stand.toml",
            "north.v2.toml",
            "batch.json.toml",
            ".hidden",
        ];
        let study = || Study::from_toml("[site]\nlatitude_deg = 95\n");
        let batch = Batch::of(files.map(|file| (file.into(), study())));
        let directories: Vec<&str> = batch.platforms().iter().map(|p| p.directory()).collect();
        let expected = [
            "stand",
            "stand-2",
            "stand-2-2",
            "Stand-3",
            "north.v2",
            "platform-batch.json",
            "platform-hidden",
        ];
        assert_eq!(directories, expected);
    }

    #[test]
    fn a_batch_that_is_cancelled_begins_nothing() {
        let cancelled = BatchControl::default().with_cancel(Arc::new(AtomicBool::new(true)));
        let batch = Batch::of([("a.toml".into(), Study::embedded_default())]);
        let found = batch.search(&cancelled);
        let record = &found.document().platforms[0];
        assert_eq!(record.status, crate::results::BatchStatus::NotStarted);
        assert_eq!((record.criterion, &record.error), (None, &None));
    }
}
