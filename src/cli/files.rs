//! Output files: tried before the long run, written completely or not at all.

use std::io::Write;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::output::Output;
use crate::config::TestConfig;
use crate::error::{Error, Result};
use crate::report::words;
use crate::schedule::text;

/// What becomes of a file that is there already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Existing {
    /// It is replaced, and said whose it was.
    Replace,
    /// It stays, and writing is refused.
    Keep,
}

impl Existing {
    /// Refuses what is there and is to stay.
    pub(super) fn check(self, path: &Path) -> Result<()> {
        match self == Self::Keep && path.is_file() {
            true => Err(
                Error::input("results are there already, and --no-clobber keeps them")
                    .with_file(path)
                    .with_hint("choose another place for the new ones"),
            ),
            false => Ok(()),
        }
    }
}

/// Whose results are in these files, as far as they are there: the first of them, how many more, what
/// they say of their test, and when they were written; none where there are none.
pub(super) fn whose(paths: &[&Path]) -> Option<String> {
    let mut there: Vec<&Path> = paths.iter().copied().filter(|p| p.is_file()).collect();
    // A document says most, and a page is the next best.
    let is_json = |p: &Path| p.extension().is_some_and(|e| e == "json");
    there.sort_by_key(|p| (!is_json(p), titled(p).is_none()));
    let first = there.first()?;
    let title = match titled(first) {
        Some(title) => format!("of {title}"),
        None => "of a test without a title".to_owned(),
    };
    let more = match there.len() {
        1 => String::new(),
        n => format!(" and {} more", n - 1),
    };
    let written = std::fs::metadata(first).and_then(|m| m.modified());
    let written = written.map_or_else(
        |_| String::new(),
        |time| format!(", written {}", httpdate::fmt_http_date(time)),
    );
    let shown = first.display();
    Some(format!("replaced: {shown}{more}, {title}{written}"))
}

/// What a document or a page says of its test; none where nothing.
fn titled(path: &Path) -> Option<String> {
    /// Longest file that is looked into, bytes.
    const MOST: u64 = 1 << 26;
    #[derive(serde::Deserialize)]
    struct Head {
        #[serde(default)]
        test: TestConfig,
    }
    let extension = path.extension()?.to_str()?;
    if !matches!(extension, "json" | "html") {
        return None;
    }
    let text = text::read_text(path, MOST).ok()?;
    let said = match extension {
        "json" => words::test(&serde_json::from_str::<Head>(&text).ok()?.test)?,
        _ => {
            let (_, rest) = text.split_once("<title>")?;
            unescaped(rest.split_once("</title>")?.0)
        }
    };
    Some(text::shown(&said))
}

/// The text that a page has escaped.
fn unescaped(html: &str) -> String {
    // The ampersand last: what it is part of is no escape any more.
    let escapes = [
        ("&#39;", "'"),
        ("&#34;", "\""),
        ("&#60;", "<"),
        ("&#62;", ">"),
        ("&#38;", "&"),
    ];
    let text = html.to_owned();
    escapes
        .iter()
        .fold(text, |text, (escape, of)| text.replace(escape, of))
}

/// Files that are going to be written into one directory.
///
/// The directory and temporary files in it exist from the start, so that an output that cannot
/// be written is reported before the work and not after it. Dropped without
/// [`OutputFiles::commit`], it leaves nothing behind.
pub(super) struct OutputFiles {
    files: Vec<(PathBuf, NamedTempFile)>,
    existing: Existing,
    litter: Litter,
}

/// What to remove when nothing was written.
#[derive(Debug, Clone, Default)]
pub(super) struct Litter {
    files: Vec<PathBuf>,
    /// Directories made by this run, innermost first.
    directories: Vec<PathBuf>,
}

impl Litter {
    /// Removes temporary files, and the directories that were made if they are empty.
    pub(super) fn remove(&self) {
        for file in &self.files {
            // A file already renamed to its place is no litter, and not there any more.
            let _ = std::fs::remove_file(file);
        }
        for directory in &self.directories {
            let _ = std::fs::remove_dir(directory);
        }
    }
}

impl OutputFiles {
    /// Makes `directory` if need be, and temporary files for `names` in it.
    ///
    /// # Errors
    ///
    /// [`Error::is_io`] where that cannot be done; [`Error::is_input`] for what is in the way, or is there
    /// and to be kept.
    pub(super) fn prepare(directory: &Path, names: &[&str], existing: Existing) -> Result<Self> {
        for name in names {
            existing.check(&directory.join(name))?;
        }
        // Field order matters: dropped half-made, the files go before their directories.
        let mut outputs = Self {
            files: Vec::with_capacity(names.len()),
            existing,
            litter: Litter {
                files: Vec::new(),
                directories: missing_directories(directory),
            },
        };
        std::fs::create_dir_all(directory)
            .map_err(|e| Error::io("create the output directory", directory, e))?;
        for name in names {
            let target = directory.join(name);
            if target.is_dir() {
                return Err(
                    Error::input("a directory is in the place of the output file")
                        .with_file(target),
                );
            }
            let file = temporary_in(directory)
                .map_err(|e| Error::io("write into the output directory", directory, e))?;
            outputs.litter.files.push(file.path().to_owned());
            outputs.files.push((target, file));
        }
        Ok(outputs)
    }

    /// What to remove if the process has to end at once.
    pub(super) fn litter(&self) -> Litter {
        self.litter.clone()
    }

    /// Writes the `contents`, one for each name; only when all are on the disk does the first
    /// take its place. Gives the paths. A directory that vanished meanwhile is made again.
    /// Says whose results were replaced.
    pub(super) fn commit(mut self, contents: &[String], output: Output) -> Result<Vec<PathBuf>> {
        for ((target, file), content) in self.files.iter_mut().zip(contents) {
            let cannot_write = |e: std::io::Error| Error::io("write the file", target, e);
            if !file.path().exists() {
                *file = made_again(target).map_err(cannot_write)?;
            }
            fill(file, content).map_err(cannot_write)?;
        }
        let targets: Vec<&Path> = self.files.iter().map(|(target, _)| &**target).collect();
        let replaced = whose(&targets);
        // What another run has put there meanwhile.
        for target in targets {
            self.existing.check(target)?;
        }
        let replace = self.existing == Existing::Replace;
        let mut written = Vec::with_capacity(contents.len());
        for (target, file) in self.files.drain(..) {
            persist(file, &target, replace).map_err(|e| Error::io("write the file", &target, e))?;
            written.push(target);
        }
        if let Some(replaced) = replaced {
            output.message(&replaced);
        }
        Ok(written)
    }
}

/// A temporary file for `target` in place of one that is gone, its directory too perhaps.
fn made_again(target: &Path) -> std::io::Result<NamedTempFile> {
    let directory = directory_of(target);
    std::fs::create_dir_all(directory)?;
    temporary_in(directory)
}

impl Drop for OutputFiles {
    fn drop(&mut self) {
        self.files.clear();
        self.litter.remove();
    }
}

/// Writes one file, completely or not at all. An existing file is an error unless `overwrite`;
/// devices and pipes are written to as they are.
pub(super) fn write_file(path: &Path, content: &str, overwrite: bool) -> Result<()> {
    let failed = |e: std::io::Error| Error::io("write the file", path, e);
    if path.exists() && !path.is_file() && !path.is_dir() {
        return std::fs::write(path, content).map_err(failed);
    }
    let mut file = temporary_in(directory_of(path)).map_err(failed)?;
    fill(&mut file, content).map_err(failed)?;
    persist(file, path, overwrite).map_err(failed)
}

fn directory_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    }
}

/// Gives a finished temporary file its name, and has the directory remember it.
fn persist(file: NamedTempFile, target: &Path, overwrite: bool) -> std::io::Result<()> {
    match overwrite {
        true => file.persist(target),
        false => file.persist_noclobber(target),
    }
    .map_err(|e| e.error)?;
    // The name is on the disk only after this. Some file systems cannot do it for a directory;
    // the file itself is safe by then.
    #[cfg(unix)]
    if let Ok(directory) = std::fs::File::open(directory_of(target)) {
        let _ = directory.sync_all();
    }
    Ok(())
}

/// Ends the process when it is interrupted, without leaving `litter` behind.
pub(super) fn remove_on_signal(litter: Litter) {
    // Without a handler a signal ends the process too, only less tidily.
    let _ = ctrlc::set_handler(move || {
        litter.remove();
        std::process::exit(i32::from(super::exit::Exit::Interrupted.code()));
    });
}

fn fill(file: &mut NamedTempFile, content: &str) -> std::io::Result<()> {
    file.write_all(content.as_bytes())?;
    file.as_file().sync_all()
}

/// A temporary file with the permissions that any new file gets.
fn temporary_in(directory: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".scheme-opt-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The umask takes away from it.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(directory)
}

/// The directories on the way to `directory` that do not exist yet, innermost first.
fn missing_directories(directory: &Path) -> Vec<PathBuf> {
    directory
        .ancestors()
        .take_while(|d| *d != Path::new("") && !d.exists())
        .map(Path::to_owned)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn abandoned_outputs_leave_nothing_behind() {
        let root = tempfile::tempdir().unwrap();
        let directory = root.path().join("a/b");
        let outputs = OutputFiles::prepare(&directory, &["x", "y"], Existing::Keep).unwrap();
        assert_eq!(std::fs::read_dir(&directory).unwrap().count(), 2);
        drop(outputs);
        assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 0);
    }

    #[test]
    fn committed_outputs_replace_what_was_there() {
        let root = tempfile::tempdir().unwrap();
        std::fs::write(root.path().join("x"), "old").unwrap();
        let outputs = OutputFiles::prepare(root.path(), &["x", "y"], Existing::Replace).unwrap();
        let litter = outputs.litter();
        assert_eq!(
            std::fs::read_to_string(root.path().join("x")).unwrap(),
            "old"
        );
        let contents = ["1".to_owned(), "2".to_owned()];
        outputs.commit(&contents, Output::new(true)).unwrap();
        litter.remove();
        assert_eq!(std::fs::read_to_string(root.path().join("x")).unwrap(), "1");
        assert_eq!(std::fs::read_to_string(root.path().join("y")).unwrap(), "2");
        assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 2);
    }

    #[test]
    fn obstacles_are_reported_before_the_work() {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join("file");
        std::fs::write(&file, "").unwrap();
        assert!(OutputFiles::prepare(&file, &["x"], Existing::Replace).is_err_and(|e| e.is_io()));
        std::fs::create_dir(root.path().join("x")).unwrap();
        assert!(
            OutputFiles::prepare(root.path(), &["x"], Existing::Replace)
                .is_err_and(|e| e.is_input())
        );
    }

    #[test]
    fn an_existing_file_is_kept_unless_told_otherwise() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("file");
        write_file(&path, "1", false).unwrap();
        assert!(write_file(&path, "2", false).is_err_and(|e| e.is_io()));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "1");
        write_file(&path, "2", true).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "2");
    }
}
