//! Progress as a stream, and cancellation from another thread: what a planning program with a
//! window and a stop button does.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::thread;

use scheme_opt::{Control, Progress, Study};

/// More starts than anybody wants to wait for.
const TASK: &str = "
[objective]
total_time_s = 6000

[search]
max_positions = 12
starts = 10000
";

fn main() -> scheme_opt::Result<()> {
    let study = Study::from_toml(TASK)?;
    let cancel = Arc::new(AtomicBool::new(false));
    let (sender, receiver) = mpsc::channel::<Progress>();
    // Reports come from several threads at once.
    let sender = Mutex::new(sender);
    let control = Control::default()
        .with_cancel(Arc::clone(&cancel))
        .with_progress(move |progress| {
            if let Ok(sender) = sender.lock() {
                // A window that was closed is no reason to stop.
                let _ = sender.send(*progress);
            }
        });

    // The window: shows every report, and stops the search when it has seen enough.
    let window = thread::spawn(move || {
        for progress in receiver.iter().take(20) {
            println!(
                "{:?} {} of {}, best so far {:?}",
                progress.phase, progress.done, progress.total, progress.criterion
            );
        }
        cancel.store(true, Ordering::Relaxed);
    });
    let found = study.search(&control)?;
    // What it showed is on the screen; nothing comes back from it.
    let _ = window.join();

    let document = found.document();
    println!("{}: {}", document.status, document.reason);
    println!(
        "RMS sigma {:.6} deg/h, a schedule that can be run as it is",
        document.evaluation.rms_sigma_deg_per_h
    );
    Ok(())
}
