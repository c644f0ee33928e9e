//! `host-sim replay` of several logs: one line each, the worst first; on a terminal a short row as soon as it is known.

use std::io::{IsTerminal as _, stdout};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use log_analysis::log::{LogError, LoggedFlight};
use log_analysis::replay::judgement_request::JudgementError;
use log_analysis::replay::parameter_export::ParameterFormat;
use log_analysis::replay::verdict::{CompassAction, CompassState, CompassVerdict, Verdict};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::command_failure::CommandFailure;
use crate::file_options::{table_files, visit_logs};
use crate::print;
use crate::print::progress_bar;
use crate::replay::{ReplayArguments, evaluate_log, with_given_mount};

/// Names of logs end in one of these.
const LOG_EXTENSIONS: [&str; 10] = ["bin", "log", "tlog", "rlog", "ulg", "ulog", "px4log", "csv", "bbl", "bfl"];

/// Result of a log.
struct LogLine {
    /// Order: unreadable first, then by state, then by error as logged, milli-degrees.
    rank: (u8, u64),
    exit_code: u8,
    verdict_text: String,
    /// State, error as logged, action and name.
    table_row: String,
    json: Value,
}

/// Judges several logs, or the logs in folders.
///
/// # Errors
///
/// An option takes one log only, or a folder cannot be read.
pub fn replay_several_logs(options: &ReplayArguments) -> Result<ExitCode, CommandFailure> {
    if options.takes_one_log() {
        return Err(CommandFailure("--params, --params-for, --out and --report take one log".to_owned()));
    }
    let files = expand_folders(&options.files)?;
    let is_table_shown = stdout().is_terminal() && !options.json;
    let bar = progress_bar("logs", files.len() as u64);
    let mut lines: Vec<LogLine> = files
        .par_iter()
        .flat_map_iter(|file| {
            let lines = judge_logs(file, options);
            bar.inc(1);
            for line in lines.iter().filter(|_| is_table_shown) {
                bar.suspend(|| print::print_text(&line.table_row));
            }
            lines
        })
        .collect();
    bar.finish_and_clear();
    if lines.is_empty() {
        return Err(CommandFailure("no logs in these folders".to_owned()));
    }
    lines.sort_by(|a, b| b.rank.cmp(&a.rank).then_with(|| a.verdict_text.cmp(&b.verdict_text)));
    for line in lines.iter().filter(|_| !is_table_shown) {
        if options.json {
            print::print_line(&line.json);
        } else {
            print::print_line(&line.verdict_text);
        }
    }
    Ok(ExitCode::from(lines.iter().map(|line| line.exit_code).max().unwrap_or(2)))
}

/// The given files, and all files in the given folders and their subfolders, sorted by name. A folder with tables of one log is
/// in place of its tables.
fn expand_folders(paths: &[PathBuf]) -> Result<Vec<PathBuf>, CommandFailure> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let unreadable = |error| CommandFailure(format!("cannot read {}: {error}", path.display()));
        let entries = std::fs::read_dir(path).map_err(unreadable)?;
        let entries = entries.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<PathBuf>>>();
        // A link to a folder may be one to a folder around it.
        let mut entries = entries.map_err(unreadable)?;
        entries.retain(|entry| entry.is_file() || entry.is_dir() && !entry.is_symlink());
        entries.sort();
        if !table_files(path).is_empty() {
            // `meta` is phyphox's description of the phone.
            entries.retain(|entry| {
                entry.extension().is_none_or(|extension| extension != "csv") && !entry.ends_with("meta")
            });
            files.push(path.clone());
        }
        files.extend(expand_folders(&entries)?);
    }
    Ok(files)
}

/// Whether the name of a file is that of a log.
#[must_use]
pub fn is_log(path: &Path) -> bool {
    let is_known =
        |ending: &std::ffi::OsStr| LOG_EXTENSIONS.iter().any(|extension| ending.eq_ignore_ascii_case(extension));
    path.extension().is_some_and(is_known)
}

/// Lines of the logs in a file; none of a file in a folder that is no log by content and name.
fn judge_logs(file: &Path, options: &ReplayArguments) -> Vec<LogLine> {
    let file_name = file.display().to_string();
    let mut lines = Vec::new();
    let visited = visit_logs(file, options.unit, options.system, &mut |name, flight| {
        lines.push(judge_log(name, flight, options));
    });
    let is_in_folder = !options.files.iter().any(|given| given == file);
    match visited {
        Err(LogError::UnknownFormat | LogError::Empty | LogError::ArchiveWithoutLog(_))
            if is_in_folder && !is_log(file) => {}
        Err(error) => lines.push(judge_log(&file_name, Err(error), options)),
        Ok(()) => {}
    }
    lines
}

fn judge_log(name: &str, flight: Result<LoggedFlight, LogError>, options: &ReplayArguments) -> LogLine {
    let judgement = flight.map_err(JudgementError::from).and_then(|flight| {
        let flight = with_given_mount(flight, options)?;
        let evaluation = evaluate_log(&flight, options)?;
        let verdict = Verdict::new(&flight, &evaluation, ParameterFormat::for_autopilot(flight.autopilot));
        Ok(judged_line(name, &verdict))
    });
    judgement.unwrap_or_else(|error| {
        let why = error.text_for_log(name);
        LogLine {
            rank: (u8::MAX, 0),
            exit_code: 2,
            verdict_text: format!("UNREADABLE: {why}"),
            table_row: format!("{UNREADABLE:<11} {why}\n"),
            json: json!({ "file": name, "code": error.stable_code(), "error": why }),
        }
    })
}

const UNREADABLE: &str = "UNREADABLE";

fn judged_line(name: &str, verdict: &Verdict<'_>) -> LogLine {
    let mut json = verdict.json();
    json["file"] = json!(name);
    let first = verdict.compasses_in_use_first().first().copied();
    let judgement = first.map(|compass| &compass.judgement);
    let rms_deg = judgement.and_then(|judgement| judgement.logged_accuracy).map(|accuracy| accuracy.rms_deg);
    let word = first.map_or("", CompassVerdict::state_word);
    let action = judgement.map_or("", |judgement| action_words(judgement.recommended_action));
    let error = rms_deg.map_or_else(|| "-".to_owned(), |rms_deg| format!("{rms_deg:.1} deg"));
    let padding = " ".repeat(UNREADABLE.len().saturating_sub(word.len()));
    let styled_word = first.map_or_else(String::new, print::styled_state);
    let rank = first.and_then(CompassVerdict::state_in_use).map_or(0, state_rank);
    LogLine {
        rank: (rank, rms_deg.map_or(0, |rms_deg| (rms_deg * 1e3) as u64)),
        exit_code: u8::from(!verdict.is_good_or_correctable()),
        verdict_text: format!("{}: {name}: {}", word.to_uppercase(), verdict.summary_sentences().join(" ")),
        table_row: format!("{styled_word}{padding} {error:>9}  {action:<15}  {name}\n"),
        json,
    }
}

const fn state_rank(state: CompassState) -> u8 {
    match state {
        CompassState::Good => 0,
        CompassState::Unjudged => 1,
        CompassState::Fair => 2,
        CompassState::Bad => 3,
    }
}

const fn action_words(action: CompassAction) -> &'static str {
    match action {
        CompassAction::LoadParameters => "load parameters",
        CompassAction::LeaveUnchanged => "leave",
        CompassAction::FlyAgain => "fly again",
        CompassAction::Replace => "replace or move",
        CompassAction::CorrectReading => "correct reading",
    }
}
