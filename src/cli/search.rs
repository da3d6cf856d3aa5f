//! `search`: finds and writes the recommended schedule.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

use indicatif::ProgressBar;

use crate::baseline::baselines;
use crate::certificate::Certifier;
use crate::commands::CommandTable;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::motion::Timeline;
use crate::report::html;
use crate::results::{CertificateRecord, Inputs, ResultDocument};
use crate::schedule::file::{to_csv, to_json};
use crate::search::front::front;
use crate::search::shortest::shortest;
use crate::search::{Control, SearchOutcome, Status, search};
use crate::config::{Mode, Study};

use super::Exit;
use super::args::SearchArgs;
use super::checkpoint::Checkpoint;
use super::files::{Litter, OutputFiles};
use super::output::Output;
use super::progress::ProgressDisplay;
use super::{inputs, page, report};

/// What is written into the output directory.
const FILES: [&str; 5] = [
    "schedule.json",
    "schedule.csv",
    "commands.csv",
    "result.json",
    "report.html",
];

/// Runs the command.
pub(super) fn run(args: &SearchArgs, output: Output) -> Result<Exit> {
    let started = Instant::now();
    let platform = args.platform.as_deref();
    let (study, inputs) = inputs::load(platform, &args.common, args.starts)?;
    let in_file = |e| name_file(e, args);
    let evaluator = study.evaluator();
    let files = OutputFiles::prepare(&args.output, &FILES)?;
    let interval = checkpoint_interval(args)?;
    let checkpoint = Checkpoint::open(&args.output, &study, args.resume, output)?;
    let (stop_saving, stopped) = mpsc::channel();
    let outcome = std::thread::scope(|scope| {
        let saver = &checkpoint;
        scope.spawn(move || saver.keep_saving(interval, &stopped, output));
        let outcome = run_search(&study, &evaluator, &checkpoint, files.litter(), output);
        drop(stop_saving);
        outcome
    })
    .map_err(in_file)?;
    let unfinished = matches!(outcome.status, Status::Interrupted | Status::TimeLimit);
    if unfinished && let Err(e) = checkpoint.save() {
        output.message(&format!("note: no checkpoint is kept: {e}"));
    }
    let wall_time_s = (!args.reproducible).then(|| started.elapsed().as_secs_f64());
    let document = document(&study, &evaluator, &outcome, wall_time_s, inputs);
    let document =
        inputs::thread_pool(&study)?.install(|| certified(document, &study, &evaluator, &outcome));
    let json = document.to_json()?;
    let timeline = Timeline::new(study.platform(), &outcome.schedule)?;
    let step_deg = CommandTable::DEFAULT_STEP_DEG;
    let contents = [
        to_json(&outcome.schedule),
        to_csv(&outcome.schedule),
        CommandTable::new(study.platform(), &timeline, step_deg).map_or_else(
            |why| format!("# no command table: {why}\n"),
            |table| table.to_csv(),
        ),
        json.clone(),
        page::made(html::result(&document), output)?,
    ];
    // The result of a long search is shown even where it cannot be written.
    let committed = files.commit(&contents);
    let paths = committed.as_deref().unwrap_or_default();
    let written: Vec<String> = paths.iter().map(|p| p.display().to_string()).collect();
    if args.common.json {
        if !written.is_empty() {
            output.message(&format!("written: {}", written.join(", ")));
        }
        output.data(&json)?;
    } else {
        let text = report::search(&document, study.platform(), &timeline, &written);
        output.data(&text)?;
    }
    committed?;
    if !unfinished {
        checkpoint.discard();
    }
    Ok(match outcome.status {
        Status::Converged | Status::TimeLimit if outcome.unobservable.is_acceptable() => Exit::Done,
        Status::Converged | Status::TimeLimit => Exit::NoSchedule,
        Status::Infeasible => Exit::NoSchedule,
        Status::Interrupted => Exit::Interrupted,
    })
}

/// Says which file a refused value is in, unless an option replaced it.
fn name_file(error: Error, args: &SearchArgs) -> Error {
    let overridden = error.key() == Some("objective.mode") && args.common.mode.is_some();
    match &args.platform {
        Some(path) if error.is_input() && error.key().is_some() && !overridden => {
            error.with_file(path)
        }
        _ => error,
    }
}

/// The search on its own threads, watched and stoppable.
fn run_search(
    study: &Study,
    evaluator: &Evaluator,
    checkpoint: &Checkpoint,
    litter: Litter,
    output: Output,
) -> Result<SearchOutcome> {
    let pool = inputs::thread_pool(study)?;
    let cancel = Arc::new(AtomicBool::new(false));
    let display = ProgressDisplay::new(output);
    cancel_on_signal(Arc::clone(&cancel), display.bar(), litter, output);
    let report = |p: &_| display.report(p);
    let deadline = study.search().time_limit_s.and_then(deadline_after);
    let control = Control::new(&cancel, &report)
        .with_deadline(deadline)
        .with_journal(checkpoint.journal());
    let problem = study.search_problem();
    let outcome = pool.install(|| match study.objective().mode {
        Mode::Accuracy => search(evaluator, &problem, &control),
        Mode::Time => shortest(evaluator, &problem, &control),
        Mode::Pareto => front(evaluator, &problem, study.search().front_points, &control),
    });
    display.finish();
    outcome
}

fn checkpoint_interval(args: &SearchArgs) -> Result<Duration> {
    let seconds = args.checkpoint_interval_s;
    Duration::try_from_secs_f64(seconds)
        .map_err(|_| Error::out_of_range("--checkpoint-interval-s", seconds, "0 or more seconds"))
}

/// The moment that lies so far ahead; none: beyond what the clock can hold.
fn deadline_after(limit_s: f64) -> Option<Instant> {
    let limit = Duration::try_from_secs_f64(limit_s).ok()?;
    Instant::now().checked_add(limit)
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

/// The document with the certificate: how far the schedule is from the best possible.
fn certified(
    document: ResultDocument,
    study: &Study,
    evaluator: &Evaluator,
    outcome: &SearchOutcome,
) -> ResultDocument {
    let certifier = Certifier::new(study.platform());
    let certificate = CertificateRecord::new(
        &certifier,
        study.objective().mode,
        evaluator.objective(),
        study.objective().total_time_s,
        outcome,
    );
    document.with_certificate(certificate, &certifier, evaluator.objective())
}

fn document(
    study: &Study,
    evaluator: &Evaluator,
    outcome: &SearchOutcome,
    wall_time_s: Option<f64>,
    mut inputs: Inputs,
) -> ResultDocument {
    if wall_time_s.is_none() {
        // Reproducible: the number of threads has no part in the result.
        inputs.config.search.threads = None;
    }
    // The shortest test may end before the time allowed; the schemes get no more than it.
    let total_time_s = match study.objective().mode {
        Mode::Time => outcome.evaluation.total_time_s,
        Mode::Accuracy | Mode::Pareto => study.objective().total_time_s,
    };
    let baselines = baselines(evaluator, total_time_s);
    ResultDocument::new(
        outcome,
        &baselines,
        evaluator.objective(),
        study.search().seed,
        wall_time_s,
        &inputs,
    )
}
