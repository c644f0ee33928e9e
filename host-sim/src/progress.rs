//! Progress of long commands, on the error output if that is a terminal.

use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressStyle};

static DISPLAYED_PROGRESS: Mutex<Option<ProgressBar>> = Mutex::new(None);

fn show_progress(bar: ProgressBar) -> ProgressBar {
    *DISPLAYED_PROGRESS.lock().unwrap_or_else(PoisonError::into_inner) = Some(bar.clone());
    bar
}

/// Removes the displayed progress bar, before the program is ended by a signal.
pub fn clear_progress_line() {
    if let Some(bar) = DISPLAYED_PROGRESS.lock().unwrap_or_else(PoisonError::into_inner).take() {
        bar.finish_and_clear();
    }
}

/// Bar that shows how many of `total` steps are done.
#[must_use]
pub fn progress_bar(label: &str, total: u64) -> ProgressBar {
    let bar = ProgressBar::new(total);
    if let Ok(style) = ProgressStyle::with_template(&format!("{label} {{bar:40}} {{pos}} of {{len}} {{eta}}")) {
        bar.set_style(style);
    }
    bar.tick();
    show_progress(bar)
}

/// Spinner for a task of unknown duration.
#[must_use]
pub fn show_spinner(label: &'static str) -> ProgressBar {
    let bar = ProgressBar::new_spinner().with_message(label);
    bar.enable_steady_tick(std::time::Duration::from_millis(100));
    show_progress(bar)
}
