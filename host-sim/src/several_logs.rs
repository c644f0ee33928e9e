//! `host-sim replay` of several logs: one line each, the worst first.

use std::io::{IsTerminal as _, stdout};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use log_analysis::replay::parameter_export::ParameterFormat;
use log_analysis::replay::verdict::{CompassState, Verdict};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::command_failure::CommandFailure;
use crate::print::{self, append_wrapped};
use crate::progress::show_spinner;
use crate::replay::{ReplayArguments, evaluate_log, read_flight};

/// Names of logs in a folder end in one of these.
const LOG_EXTENSIONS: [&str; 5] = ["bin", "log", "tlog", "ulg", "csv"];

/// Result of a log.
struct LogLine {
    /// Order: unreadable first, then by state, then by error as logged, milli-degrees.
    rank: (u8, u64),
    exit_code: u8,
    verdict_text: String,
    json: Value,
}

/// Judges several logs, or the logs in folders.
///
/// # Errors
///
/// An option takes one log only, or a folder cannot be read.
pub fn replay_several_logs(options: &ReplayArguments) -> Result<ExitCode, CommandFailure> {
    if options.params.is_some() || options.params_for.is_some() || options.out.is_some() || options.report.is_some() {
        return Err(CommandFailure("--params, --params-for, --out and --report take one log".to_owned()));
    }
    let logs = expand_folders(&options.files)?;
    let bar = show_spinner("evaluating the logs");
    let mut lines: Vec<LogLine> = logs.par_iter().map(|log| judge_log(log, options)).collect();
    bar.finish_and_clear();
    lines.sort_by(|a, b| b.rank.cmp(&a.rank).then_with(|| a.verdict_text.cmp(&b.verdict_text)));
    for line in &lines {
        if options.json {
            print::print_line(&line.json);
        } else {
            print::print_text(&format_verdict_line(&line.verdict_text, stdout().is_terminal()));
        }
    }
    Ok(ExitCode::from(lines.iter().map(|line| line.exit_code).max().unwrap_or(2)))
}

/// The line of a log: wrapped on a terminal, whole in a file or pipe, for `grep` and `sort`.
fn format_verdict_line(verdict_text: &str, is_terminal: bool) -> String {
    if !is_terminal {
        return format!("{verdict_text}\n");
    }
    let mut wrapped = String::new();
    append_wrapped(&mut wrapped, "", verdict_text);
    wrapped
}

/// Paths of the given log files, and of the logs in the given folders sorted by name.
fn expand_folders(files: &[PathBuf]) -> Result<Vec<PathBuf>, CommandFailure> {
    let mut logs = Vec::new();
    for file in files {
        if !file.is_dir() {
            logs.push(file.clone());
            continue;
        }
        let unreadable = |error| CommandFailure(format!("cannot read {}: {error}", file.display()));
        let entries = std::fs::read_dir(file).map_err(unreadable)?;
        let paths = entries.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<PathBuf>>>();
        let mut folder_logs: Vec<PathBuf> =
            paths.map_err(unreadable)?.into_iter().filter(|path| is_log(path)).collect();
        folder_logs.sort();
        logs.extend(folder_logs);
    }
    if logs.is_empty() {
        return Err(CommandFailure(format!("no logs in these folders (.{})", LOG_EXTENSIONS.join(", ."))));
    }
    Ok(logs)
}

/// Whether the name of a file is that of a log.
#[must_use]
pub fn is_log(path: &Path) -> bool {
    let is_known =
        |ending: &std::ffi::OsStr| LOG_EXTENSIONS.iter().any(|extension| ending.eq_ignore_ascii_case(extension));
    path.extension().is_some_and(is_known)
}

fn judge_log(log: &Path, options: &ReplayArguments) -> LogLine {
    let name = log.display().to_string();
    let judgement = read_flight(log, options).and_then(|flight| {
        let evaluation = evaluate_log(log, &flight, options)?;
        let verdict = Verdict::new(&flight, &evaluation, ParameterFormat::for_autopilot(flight.autopilot));
        let mut json = verdict.json();
        json["file"] = json!(name);
        let in_use = verdict.compasses_in_use_first();
        let accuracy = in_use.first().and_then(|compass| compass.judgement.logged_accuracy);
        let state = verdict.state_of_compass_in_use();
        let sentences = verdict.summary_sentences().join(" ");
        Ok(LogLine {
            rank: (state_rank(state), accuracy.map_or(0, |accuracy| (accuracy.rms_deg * 1e3) as u64)),
            exit_code: u8::from(!verdict.is_good_or_correctable()),
            verdict_text: format!("{}: {name}: {sentences}", state.to_string().to_uppercase()),
            json,
        })
    });
    judgement.unwrap_or_else(|CommandFailure(why)| LogLine {
        rank: (u8::MAX, 0),
        exit_code: 2,
        verdict_text: format!("UNREADABLE: {why}"),
        json: json!({ "file": name, "error": why }),
    })
}

const fn state_rank(state: CompassState) -> u8 {
    match state {
        CompassState::Good => 0,
        CompassState::Unjudged => 1,
        CompassState::Fair => 2,
        CompassState::Bad => 3,
    }
}
