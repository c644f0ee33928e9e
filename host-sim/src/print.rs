//! Common output functions, and handling of closed output.

use std::io::{self, ErrorKind, Write as _};
use std::path::Path;
use std::process::ExitCode;
use std::sync::{Mutex, OnceLock, PoisonError};

use anstyle::{AnsiColor, Style};
use comfy_table::{Cell, CellAlignment, ContentArrangement, Table, presets};
use indicatif::{ProgressBar, ProgressStyle};
use log_analysis::numbers::round_all_numbers;
use log_analysis::replay::verdict::{CompassState, CompassVerdict};
use log_analysis::report::Report;
use serde::Serialize;
use terminal_size::terminal_size_of;

use crate::command_failure::CommandFailure;
use crate::file_options::write_report_file;

/// Width of the output in columns; a narrower terminal has its own.
pub const MAX_OUTPUT_COLUMNS: usize = 80;

/// Least width, which the longest words need.
const MIN_OUTPUT_COLUMNS: usize = 40;

static FIRST_WRITE_ERROR: OnceLock<io::Error> = OnceLock::new();

/// Exit code of a program ended by SIGPIPE: 128 plus the signal's number, 13.
const CLOSED_PIPE_EXIT_CODE: u8 = 141;

/// Width of the output: that of the terminal, at most [`MAX_OUTPUT_COLUMNS`], which is also that of files and pipes.
pub fn output_width() -> usize {
    static OUTPUT_COLUMNS: OnceLock<usize> = OnceLock::new();
    *OUTPUT_COLUMNS.get_or_init(|| {
        let columns = terminal_size_of(io::stdout()).map_or(0, |(columns, _)| usize::from(columns.0));
        if columns == 0 { MAX_OUTPUT_COLUMNS } else { columns.clamp(MIN_OUTPUT_COLUMNS, MAX_OUTPUT_COLUMNS) }
    })
}

/// Prints text, or drops it once the output has failed, so that clean-up still takes place. Styles are removed where the
/// output has none: in files and pipes, with NO_COLOR, and with `--color never`.
pub fn print_text(text: &str) {
    if has_output_failed() {
        return;
    }
    let mut stdout = anstream::stdout().lock();
    if let Err(error) = stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        let _ = FIRST_WRITE_ERROR.set(error);
    }
}

/// The state of a compass in capitals, bold in its colour; an unused one is plain.
#[must_use]
pub fn styled_state(compass: &CompassVerdict<'_>) -> String {
    let word = compass.state_word().to_uppercase();
    let Some(state) = compass.state_in_use() else { return word };
    let color = match state {
        CompassState::Good => AnsiColor::Green,
        CompassState::Bad => AnsiColor::Red,
        CompassState::Fair | CompassState::Unjudged => AnsiColor::Yellow,
    };
    let style = Style::new().bold().fg_color(Some(color.into()));
    format!("{style}{word}{style:#}")
}

/// Prints a line, as [`print_text`] does.
pub fn print_line(text: impl std::fmt::Display) {
    print_text(&format!("{text}\n"));
}

/// Whether a write to the standard output has failed.
fn has_output_failed() -> bool {
    FIRST_WRITE_ERROR.get().is_some()
}

/// Polls whether the reader has closed the pipe, for commands that rarely print. Windows cannot be asked: there the
/// next output fails.
pub fn poll_output_closed() -> bool {
    #[cfg(unix)]
    if is_pipe_closed() {
        let _ = FIRST_WRITE_ERROR.set(ErrorKind::BrokenPipe.into());
    }
    has_output_failed()
}

#[cfg(unix)]
fn is_pipe_closed() -> bool {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    let stdout = io::stdout();
    let mut poll_descriptors = [PollFd::new(&stdout, PollFlags::empty())];
    let now = Timespec { tv_sec: 0, tv_nsec: 0 };
    // `poll` reports `ERR` for a pipe whose reader closed it, not for files and terminals.
    poll(&mut poll_descriptors, Some(&now)).is_ok() && poll_descriptors[0].revents().contains(PollFlags::ERR)
}

/// Prints a line to the error output; ignores errors.
pub fn print_error(text: impl std::fmt::Display) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// Exit code of a command: replaced by 141 after a closed pipe, without a message, and by 2 after another write error.
pub fn final_exit_code(code: ExitCode) -> ExitCode {
    match FIRST_WRITE_ERROR.get() {
        None => code,
        Some(error) if error.kind() == ErrorKind::BrokenPipe => ExitCode::from(CLOSED_PIPE_EXIT_CODE),
        Some(error) => {
            print_error(format_args!("{}: cannot write to the standard output: {error}", program_name()));
            ExitCode::from(2)
        }
    }
}

/// Prints a value as one line of JSON with rounded numbers; see docs/json.md.
///
/// # Errors
///
/// The value has no JSON.
pub fn print_json(value: impl Serialize) -> Result<(), CommandFailure> {
    let mut value = serde_json::to_value(value).map_err(|error| CommandFailure(error.to_string()))?;
    round_all_numbers(&mut value);
    print_line(value);
    Ok(())
}

/// Writes a report and prints its path on the error output, since standard output may be JSON.
///
/// # Errors
///
/// The file cannot be written.
pub fn write_report(report: &Report, path: &Path) -> Result<(), CommandFailure> {
    let written = write_report_file(report, path).map_err(|error| {
        CommandFailure(format!(
            "cannot write the report to {}: {error}; --report names another file or folder",
            path.display()
        ))
    })?;
    if !has_output_failed() {
        print_error(format_args!("report: {}", written.display()));
    }
    Ok(())
}

/// Bare name of the running program.
#[must_use]
pub fn program_name() -> String {
    let path = std::env::args_os().next().unwrap_or_default();
    Path::new(&path).file_stem().map_or_else(|| "host-sim".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// The command line, quoted for a shell, with the program's bare name.
#[must_use]
pub fn command_line() -> String {
    let quoted_words = std::env::args().skip(1).map(|word| quoted_word(&word));
    std::iter::once(program_name()).chain(quoted_words).collect::<Vec<_>>().join(" ")
}

/// A word of a command line, quoted for a shell where it needs to be.
#[must_use]
pub fn quoted_word(word: &str) -> String {
    let is_plain = |character: char| character.is_ascii_alphanumeric() || "-_./=,:+@%".contains(character);
    let is_word = !word.is_empty() && word.chars().all(is_plain);
    if is_word { word.to_owned() } else { format!("'{}'", word.replace('\'', "'\\''")) }
}

/// A cell of a table, aligned to the right.
pub fn right_aligned(text: impl ToString) -> Cell {
    Cell::new(text).set_alignment(CellAlignment::Right)
}

/// An empty table as wide as its content, wrapped only on a narrow terminal; headers wrap at their line breaks.
pub fn content_width_table<T: ToString>(names: impl IntoIterator<Item = T>) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    if output_width() < MAX_OUTPUT_COLUMNS {
        table.set_content_arrangement(ContentArrangement::Dynamic).set_width(output_width() as u16);
    }
    table.set_header(names.into_iter().map(right_aligned));
    table
}

/// A table with reduced padding, for many columns.
pub fn narrow_table<T: ToString>(names: impl IntoIterator<Item = T>) -> Table {
    let mut table = content_width_table(names);
    table.column_iter_mut().for_each(|column| {
        column.set_padding((0, 1));
    });
    table
}

/// Name of a column, and the text of a row's cell in it.
pub type Column<'a, Row> = (&'a str, fn(&Row) -> String);

/// A narrow table of rows.
pub fn table_of<Row>(rows: &[Row], columns: &[Column<'_, Row>]) -> Table {
    let mut table = narrow_table(columns.iter().map(|(name, _)| name));
    table.add_rows(rows.iter().map(|row| columns.iter().map(|(_, cell)| right_aligned(cell(row)))));
    table
}

/// A table whose text wraps at [`output_width`].
#[must_use]
pub fn wrapped_table<const N: usize>(names: [&str; N]) -> Table {
    let mut table = content_width_table([""; N]);
    table.set_header(names);
    table.set_content_arrangement(ContentArrangement::Dynamic).set_width(output_width() as u16);
    table
}

/// Appends text wrapped at [`output_width`]; continuation lines are indented by two more.
pub fn append_wrapped(wrapped: &mut String, indent: &str, text: &str) {
    let continuation_indent = " ".repeat(indent.len() + 2);
    let mut line = indent.to_owned();
    let mut has_word = false;
    for word in text.split(' ') {
        if has_word && line.chars().count() + 1 + word.chars().count() > output_width() {
            wrapped.push_str(&line);
            wrapped.push('\n');
            line.clone_from(&continuation_indent);
        } else if has_word {
            line.push(' ');
        }
        line.push_str(word);
        has_word = true;
    }
    wrapped.push_str(&line);
    wrapped.push('\n');
}

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
