//! `search`: finds and writes the recommended schedule.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

use indicatif::ProgressBar;

use crate::commands::CommandTable;
use crate::error::{Error, Result};
use crate::motion::Timeline;
use crate::schedule::{Schedule, file};
use crate::search::{Control, Freedom, StartingScheme, Status};
use crate::study::{SearchResult, Study};

use super::args::{Changeable, SearchArgs};
use super::checkpoint::Checkpoint;
use super::exit::Exit;
use super::files::{Existing, Litter, OutputFiles};
use super::output::Output;
use super::progress::ProgressDisplay;
use super::{inputs, page, report};

/// What is written into the output directory.
pub(super) const FILES: [&str; 7] = [
    "schedule.json",
    "schedule.csv",
    "commands.csv",
    "sheet.html",
    "sheet.csv",
    "result.json",
    "report.html",
];

/// Runs the command.
pub(super) fn run(args: &SearchArgs, output: Output) -> Result<Exit> {
    let study = inputs::load(args.platform.as_deref(), &args.common, args.starts)?;
    let study = with_schemes(study, args, output)?;
    let is_open = study
        .defaulted()
        .iter()
        .any(|key| key == "search.max_positions");
    if is_open
        && !study.test().platform().drift_colour().is_white()
        && let Some(most) = study.config().search.max_positions
    {
        output.message(&format!(
            "up to {most} positions: the drift wanders, and more and shorter dwells pay"
        ));
    }
    let existing = args.existing.choice();
    if existing == Existing::Keep {
        Checkpoint::refuse_unfinished(&args.output)?;
    }
    let files = OutputFiles::prepare(&args.output, &FILES, existing)?;
    let interval = checkpoint_interval(args)?;
    let checkpoint = Checkpoint::open(&args.output, &study, args.resume, output)?;
    let (stop_saving, stopped) = mpsc::channel();
    let found = std::thread::scope(|scope| {
        let saver = &checkpoint;
        scope.spawn(move || saver.keep_saving(interval, &stopped, output));
        let found = watched(&study, &checkpoint, files.litter(), output);
        drop(stop_saving);
        found
    })?;
    let found = match args.reproducible {
        true => found.reproducible(),
        false => found,
    };
    let unfinished = matches!(found.status(), Status::Interrupted | Status::TimeLimit);
    if unfinished && let Err(e) = checkpoint.save() {
        output.message(&format!("note: no checkpoint is kept: {e}"));
    }
    // The result of a long search is shown even where it cannot be written.
    let committed = files.commit(&contents(&study, &found, output)?, output);
    show(
        args,
        &study,
        &found,
        committed.as_deref().unwrap_or_default(),
        output,
    )?;
    committed?;
    if !unfinished {
        checkpoint.discard();
    }
    Ok(match found.status() {
        Status::Converged | Status::TimeLimit if found.is_acceptable() => Exit::Done,
        Status::Converged | Status::TimeLimit => Exit::NoSchedule,
        Status::Infeasible => Exit::NoSchedule,
        Status::Interrupted => Exit::Interrupted,
    })
}

/// The study with what is done of its test, and the scheme that the search begins with.
fn with_schemes(mut study: Study, args: &SearchArgs, output: Output) -> Result<Study> {
    if let Some(path) = &args.done {
        let (schedule, _) = inputs::on_platform(path, &study)?;
        inputs::warn_of_schedule(path, &schedule, &study, output);
        study = study.after(schedule)?;
    }
    let Some(path) = &args.from else {
        return Ok(study);
    };
    let name = path.display().to_string();
    let has = |what: Changeable| args.only.contains(&what);
    let freedom = match (has(Changeable::Dwells), has(Changeable::Order)) {
        (false, false) => Freedom::Everything,
        (true, false) => Freedom::Dwells,
        (false, true) => Freedom::Order,
        (true, true) => Freedom::DwellsAndOrder,
    };
    let begun =
        |schedule: &Schedule| StartingScheme::new(name.clone(), schedule.clone()).only(freedom);
    let (schedule, ()) = file::read_and(path, &|schedule| study.check_start(&begun(schedule)))?;
    inputs::warn_of_schedule(path, &schedule, &study, output);
    study.starting_from(begun(&schedule))
}

/// The files' contents, in the order of [`FILES`].
pub(super) fn contents(study: &Study, found: &SearchResult, output: Output) -> Result<[String; 7]> {
    let schedule = found.schedule();
    let commands = study.commands(schedule, CommandTable::DEFAULT_STEP_DEG);
    let sheet = study.operator_sheet(schedule)?;
    Ok([
        schedule.to_json(),
        schedule.to_csv(),
        commands.map_or_else(
            |why| format!("# no command table: {why}\n"),
            |table| table.to_csv(),
        ),
        sheet.to_html()?,
        sheet.to_csv(),
        found.document().to_json()?,
        page::made(found.report_html(), output)?,
    ])
}

/// The result for people, or its document.
fn show(
    args: &SearchArgs,
    study: &Study,
    found: &SearchResult,
    written: &[PathBuf],
    output: Output,
) -> Result<()> {
    let written: Vec<String> = written.iter().map(|p| p.display().to_string()).collect();
    if args.common.json {
        if !written.is_empty() {
            output.message(&format!("written: {}", written.join(", ")));
        }
        return output.data(&found.document().to_json()?);
    }
    let timeline = Timeline::new(study.test(), found.schedule())?;
    let document = found.document();
    let text = report::search(document, study.test().platform(), &timeline, &written);
    output.data(&report::headed(&document.test, text))
}

/// The search, watched and stoppable.
fn watched(
    study: &Study,
    checkpoint: &Checkpoint,
    litter: Litter,
    output: Output,
) -> Result<SearchResult> {
    let cancel = Arc::new(AtomicBool::new(false));
    let display = Arc::new(ProgressDisplay::new(output));
    cancel_on_signal(Arc::clone(&cancel), display.bar(), litter, output);
    let shown = Arc::clone(&display);
    let control = Control::default()
        .with_cancel(cancel)
        .with_progress(move |p| shown.report(p))
        .with_journal(checkpoint.journal());
    let found = study.search(&control);
    display.finish();
    found
}

fn checkpoint_interval(args: &SearchArgs) -> Result<Duration> {
    let seconds = args.checkpoint_interval_s;
    Duration::try_from_secs_f64(seconds)
        .map_err(|_| Error::out_of_range("--checkpoint-interval-s", seconds, "0 or more seconds"))
}

/// The first signal asks the search for its best so far, the second ends the process.
fn cancel_on_signal(cancel: Arc<AtomicBool>, bar: ProgressBar, litter: Litter, output: Output) {
    let installed = ctrlc::set_handler(move || {
        if cancel.swap(true, Ordering::SeqCst) {
            litter.remove();
            std::process::exit(i32::from(Exit::Interrupted.code()));
        }
        bar.suspend(|| {
            output.message(
                "interrupted: writing the best schedule so far; once more to stop at once",
            );
        });
    });
    if let Err(e) = installed {
        output.message(&format!("note: an interruption will lose the search: {e}"));
    }
}
