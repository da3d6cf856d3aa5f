//! `batch`: a search for each of many platforms, with one summary over all.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::Duration;

use crate::error::{Error, Result};
use crate::results::{BatchDocument, BatchRecord, BatchStatus};
use crate::search::{Control, Status};
use crate::study::{Batch, BatchControl, BatchPlatform, Study};

use super::args::BatchArgs;
use super::checkpoint::Checkpoint;
use super::exit::Exit;
use super::files::{Existing, Litter, OutputFiles};
use super::finished::Finished;
use super::output::{self, Output};
use super::search::{self, FILES};
use super::{inputs, report, table};
use crate::report::words;

/// The summary's files.
const SUMMARY: [&str; 3] = ["batch.json", "batch.csv", "batch.html"];

/// Least time between two checkpoints of a search.
const CHECKPOINT_INTERVAL: Duration = Duration::from_secs(5);

/// Runs the command.
pub(super) fn run(args: &BatchArgs, output: Output) -> Result<Exit> {
    let read = args.platforms.iter().map(|file| {
        let study = inputs::load(Some(file), &args.common, args.starts);
        if let Err(error) = &study {
            output::error(error);
        }
        (file.clone(), study)
    });
    let batch = Batch::of(read);
    let summary = OutputFiles::prepare(&args.output, &SUMMARY, Existing::Replace)?;
    let run = Run {
        args,
        output,
        litter: Arc::default(),
        count: batch.platforms().len(),
    };
    run.litter_is(summary.litter());
    let cancel = Arc::new(AtomicBool::new(false));
    cancel_on_signal(Arc::clone(&cancel), Arc::clone(&run.litter), output);
    let control = BatchControl::default()
        .with_jobs(args.jobs)
        .with_cancel(cancel);
    let found = batch.search_by(&control, &|platform, study, control| {
        run.one(platform, study, control).inspect_err(output::error)
    });
    let document = found.document();
    let contents = [
        document.to_json()?,
        document.to_csv()?,
        found.report_html()?,
    ];
    // The summary is shown even where it cannot be written.
    let written = summary.commit(&contents, output);
    match args.common.json {
        true => output.data(&contents[0])?,
        false => output.data(&shown(document))?,
    }
    for path in written? {
        output.message(&format!("written: {}", path.display()));
    }
    Ok(exit(document))
}

/// What every platform of a run needs.
struct Run<'a> {
    args: &'a BatchArgs,
    output: Output,
    litter: Arc<Mutex<Vec<Litter>>>,
    count: usize,
}

impl Run<'_> {
    /// Searches for one platform, or takes what is finished already.
    fn one(
        &self,
        platform: &BatchPlatform,
        study: &Study,
        control: &Control,
    ) -> Result<BatchRecord> {
        let directory = self.args.output.join(platform.directory());
        let finished = Finished::of(study)?;
        if let Some(record) = finished.read(&directory) {
            let record = record.named_as(platform.record());
            self.say(&record, "finished already");
            return Ok(record);
        }
        let names: Vec<&str> = FILES.into_iter().chain([Finished::FILE]).collect();
        let files = OutputFiles::prepare(&directory, &names, Existing::Replace)?;
        self.litter_is(files.litter());
        let checkpoint = self.checkpoint(&directory, study)?;
        let (stop_saving, stopped) = mpsc::channel();
        let found = std::thread::scope(|scope| {
            let saver = &checkpoint;
            scope.spawn(move || saver.keep_saving(CHECKPOINT_INTERVAL, &stopped, self.output));
            let found = study.search(&control.clone().with_journal(checkpoint.journal()));
            drop(stop_saving);
            found
        })?
        .reproducible();
        let unfinished = matches!(found.status(), Status::Interrupted | Status::TimeLimit);
        if unfinished && let Err(e) = checkpoint.save() {
            self.output
                .message(&format!("note: no checkpoint is kept: {e}"));
        }
        let record = platform.record().clone();
        let record = record.found(found.document(), found.is_acceptable());
        let mut contents = search::contents(study, &found, self.output)?.to_vec();
        contents.push(finished.written(&record, &contents)?);
        files.commit(&contents, self.output)?;
        if !unfinished {
            checkpoint.discard();
        }
        self.say(&record, record.status.name());
        Ok(record)
    }

    /// What an interrupted run has done of this search, if it is the same one.
    fn checkpoint(&self, directory: &Path, study: &Study) -> Result<Checkpoint> {
        let silent = Output::new(true);
        Checkpoint::open(directory, study, true, silent).or_else(|why| {
            self.output
                .message(&format!("note: starting from the beginning: {why}"));
            Checkpoint::open(directory, study, false, silent)
        })
    }

    /// That it is done with a platform, on stderr.
    fn say(&self, record: &BatchRecord, how: &str) {
        let value = record.rms_sigma_deg_per_h.map_or_else(String::new, |rms| {
            format!(", RMS sigma {} deg/h", crate::wording::number(rms))
        });
        let (directory, count) = (&record.directory, self.count);
        let of = if count == 1 { "platform" } else { "platforms" };
        self.output
            .message(&format!("{directory} (of {count} {of}): {how}{value}"));
    }

    /// What to remove if the process has to end at once.
    fn litter_is(&self, litter: Litter) {
        let mut all = self.litter.lock().unwrap_or_else(PoisonError::into_inner);
        all.push(litter);
    }
}

/// The summary for people.
fn shown(document: &BatchDocument) -> String {
    let mut text = report::wrap(&words::batch(document));
    text.push('\n');
    text.push_str(&table::batch(&document.platforms));
    let reasons = document.platforms.iter().filter_map(|p| {
        let why = words::why_not(p)?;
        Some(report::wrap(&format!("{}: {why}", p.directory)))
    });
    let reasons: String = reasons.collect();
    if !reasons.is_empty() {
        text.push('\n');
        text.push_str(&reasons);
    }
    text
}

/// The exit code of the whole: the gravest of its platforms.
fn exit(document: &BatchDocument) -> Exit {
    let any = |is: &dyn Fn(&BatchRecord) -> bool| document.platforms.iter().any(is);
    let unfinished = [BatchStatus::Interrupted, BatchStatus::NotStarted];
    if any(&|p| unfinished.contains(&p.status)) {
        Exit::Interrupted
    } else if any(&|p| p.status == BatchStatus::Failed) {
        Exit::Failed
    } else if any(&|p| p.acceptable == Some(false)) {
        Exit::NoSchedule
    } else {
        Exit::Done
    }
}

/// The first signal asks the searches for their best so far, the second ends the process.
fn cancel_on_signal(cancel: Arc<AtomicBool>, litter: Arc<Mutex<Vec<Litter>>>, output: Output) {
    let installed = ctrlc::set_handler(move || {
        if cancel.swap(true, Ordering::SeqCst) {
            let all = litter.lock().unwrap_or_else(PoisonError::into_inner);
            all.iter().for_each(Litter::remove);
            std::process::exit(i32::from(Exit::Interrupted.code()));
        }
        output.message(
            "interrupted: writing the best schedules so far; the same command goes on from here; once \
             more to stop at once",
        );
    });
    if let Err(e) = installed {
        let why = Error::input(format!("an interruption will lose the searches: {e}"));
        output.message(&format!("note: {why}"));
    }
}
