//! Progress as a stream, and cancellation from another thread: what a planning program with a
//! window and a stop button does.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread;

use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::search::{Control, Progress, SearchProblem, search};

fn main() -> scheme_opt::Result<()> {
    let evaluator = Evaluator::new(PlatformConfig::default().check()?, Objective::default());
    let problem = SearchProblem {
        total_time_s: 6000.0,
        max_positions: 12,
        // More than anybody wants to wait for.
        starts: 10_000,
        ..SearchProblem::default()
    };
    let cancel = AtomicBool::new(false);
    let (sender, receiver) = mpsc::channel::<Progress>();
    // Reports come from several threads at once.
    let sender = Mutex::new(sender);
    let report = |progress: &Progress| {
        if let Ok(sender) = sender.lock() {
            // A window that was closed is no reason to stop.
            let _ = sender.send(*progress);
        }
    };

    let found = thread::scope(|scope| {
        // The window: shows every report, and stops the search when it has seen enough.
        let cancel = &cancel;
        scope.spawn(move || {
            for progress in receiver.iter().take(20) {
                println!(
                    "{:?} {} of {}, best so far {:?}",
                    progress.phase, progress.done, progress.total, progress.criterion
                );
            }
            cancel.store(true, Ordering::Relaxed);
        });
        search(&evaluator, &problem, &Control::new(cancel, &report))
    })?;

    println!("{}: {}", found.status.name(), found.reason);
    println!(
        "RMS sigma {:.6} deg/h, a schedule that can be run as it is",
        found.evaluation.rms_sigma_deg_per_h()
    );
    Ok(())
}
