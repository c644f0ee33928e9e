//! Progress of long commands, on the error output if that is a terminal.

use indicatif::{ProgressBar, ProgressStyle};

/// Progress bar.
pub fn progress(words: &str, total: u64) -> ProgressBar {
    let bar = ProgressBar::new(total);
    if let Ok(style) = ProgressStyle::with_template(&format!("{words} {{bar:40}} {{pos}}/{{len}} {{eta}}")) {
        bar.set_style(style);
    }
    bar
}

/// Spinner for a task of unknown duration.
pub fn waiting(words: &'static str) -> ProgressBar {
    let bar = ProgressBar::new_spinner().with_message(words);
    bar.enable_steady_tick(std::time::Duration::from_millis(100));
    bar
}
