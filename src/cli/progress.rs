//! The progress display of a search: on a terminal only, on stderr.

use std::fmt::Write;
use std::io::IsTerminal;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use crate::search::{Phase, Progress};

use super::output::Output;

/// Bar, count, rate, best so far and time left.
const TEMPLATE: &str = "{prefix:<9} [{bar:20}] {pos}/{len}  {rate}  {msg}  ETA {eta}";

/// Shows what a search is doing.
pub(super) struct ProgressDisplay {
    bar: ProgressBar,
    state: Mutex<DisplayState>,
}

struct DisplayState {
    phase: Option<Phase>,
    done: u64,
    best: f64,
}

impl ProgressDisplay {
    /// Invisible unless stderr is a terminal and messages are wanted.
    pub(super) fn new(output: Output) -> Self {
        let visible = !output.is_quiet() && std::io::stderr().is_terminal();
        let bar = if visible {
            ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr())
        } else {
            ProgressBar::hidden()
        };
        if let Ok(style) = ProgressStyle::with_template(TEMPLATE) {
            let style = style.with_key("rate", |state: &ProgressState, out: &mut dyn Write| {
                let rate = state.per_sec();
                let decimals = if rate < 10.0 { 1 } else { 0 };
                // There is nowhere to report that a progress bar cannot be drawn.
                let _ = write!(out, "{rate:.decimals$}/s");
            });
            bar.set_style(style.progress_chars("=> "));
        }
        Self {
            bar,
            state: Mutex::new(DisplayState {
                phase: None,
                done: 0,
                best: f64::INFINITY,
            }),
        }
    }

    /// Takes a report; they come from several threads, in no fixed order.
    pub(super) fn report(&self, progress: &Progress) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if state.phase.is_none() {
            self.bar.enable_steady_tick(Duration::from_millis(250));
        }
        if state.phase != Some(progress.phase) {
            state.phase = Some(progress.phase);
            state.done = 0;
            self.bar.reset();
            self.bar.set_length(progress.total);
            self.bar.set_prefix(name(progress.phase));
        }
        state.done = state.done.max(progress.done);
        self.bar.set_position(state.done);
        if let Some(criterion) = progress.criterion
            && criterion < state.best
        {
            state.best = criterion;
            let best = crate::wording::number(criterion);
            self.bar.set_message(format!("best {best}"));
        }
    }

    /// The bar, for messages that must not be drawn over.
    pub(super) fn bar(&self) -> ProgressBar {
        self.bar.clone()
    }

    /// Removes the display.
    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

const fn name(phase: Phase) -> &'static str {
    match phase {
        Phase::Screening => "starts",
        Phase::Finishing => "finishing",
        Phase::Improving => "improving",
        Phase::Checking => "checking",
    }
}
