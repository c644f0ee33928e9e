//! The verdict on a log as text: a summary that fits a terminal, and all figures.

use std::fmt::Write as _;
use std::path::Path;

use comfy_table::Table;
use log_analysis::replay::evaluation::CompassEvaluation;
use log_analysis::replay::verdict::{CompassVerdict, Verdict};

use crate::print::{append_wrapped, content_width_table, program_name, quoted_word, right_aligned, styled_state};

/// What else the command writes.
#[derive(Clone, Copy, Debug)]
pub struct WrittenOutput {
    /// All figures before the summary.
    pub is_verbose: bool,
    /// A parameter file.
    pub has_parameter_file: bool,
    /// A report.
    pub has_report: bool,
}

/// Judgement of each compass and the next command, in at most 24 lines for three compasses.
#[must_use]
pub fn summary_text(file: &Path, written: WrittenOutput, verdict: &Verdict<'_>) -> String {
    let mut text = String::new();
    append_wrapped(&mut text, "", &verdict.log_description(&file.display().to_string()));
    if !written.is_verbose {
        append_wrapped(&mut text, "", &hidden_figures(verdict));
    }
    text.push('\n');
    for compass in verdict.compasses_in_use_first() {
        text.push_str(&verdict_sentence(compass));
    }
    let has_parameters = !verdict.exported_corrections().is_empty();
    if written.has_parameter_file || !has_parameters {
        let steps = verdict.next_steps();
        text.push_str(if steps.is_empty() { "" } else { "\n" });
        for (number, step) in (1..).zip(steps) {
            append_wrapped(&mut text, &format!("{number}. "), &step);
        }
    }
    let command = format!("{} replay {}", program_name(), quoted_word(&file.display().to_string()));
    if !written.has_parameter_file && has_parameters {
        let name = verdict.parameter_format.file_name();
        let _ = writeln!(text, "\nnext: {command} --params {name}");
    }
    if !written.has_report {
        let _ = writeln!(text, "charts: {command} --report report.html");
    }
    text
}

/// What the summary leaves to `--verbose`.
fn hidden_figures(verdict: &Verdict<'_>) -> String {
    let reference = verdict.evaluation.reference.as_ref();
    let compared = reference.map_or_else(
        || "no heading to compare with".to_owned(),
        |reference| format!("compared with {}", reference.reference_name()),
    );
    match verdict.log_warnings.len() {
        0 => format!("{compared}; --verbose prints all figures"),
        1 => format!("{compared}; --verbose prints all figures and a note"),
        count => format!("{compared}; --verbose prints all figures and {count} notes"),
    }
}

/// State and sentence of a compass, wrapped.
fn verdict_sentence(compass: &CompassVerdict<'_>) -> String {
    let word = compass.state_word().to_uppercase();
    let mut sentence = String::new();
    append_wrapped(&mut sentence, &format!("{word}: "), &compass.summary_sentence());
    sentence.replacen(&word, &styled_state(compass), 1)
}

/// All figures and notes.
#[must_use]
pub fn full_text(verdict: &Verdict<'_>) -> String {
    let mut text = String::new();
    for compass in verdict.compasses_in_use_first() {
        let _ = writeln!(text, "\ncompass {}", compass.evaluation.compass_number);
        for [name, value] in verdict.key_facts(compass) {
            append_wrapped(&mut text, "  ", &format!("{name}: {value}"));
        }
    }
    if let Some(reference) = &verdict.evaluation.reference {
        let name = reference.reference_name();
        let difference = reference.difference_name();
        text.push('\n');
        append_wrapped(&mut text, "", &format!("Heading {difference} against {name}, deg RMS less mean:"));
        let _ = writeln!(text, "{}", verdict_table(verdict));
        append_wrapped(&mut text, "", &format!("{name}: {}", reference.accuracy_description()));
    }
    let changes = verdict.parameter_changes();
    if !changes.is_empty() {
        let mut table = content_width_table(["parameter", "in the log", "to load"]);
        for change in changes {
            let logged = change.logged_value.map_or_else(|| "-".to_owned(), |value| value.to_string());
            table.add_row([change.name, logged, change.new_value].map(right_aligned));
        }
        let _ = writeln!(text, "\n{table}");
    }
    for note in &verdict.log_warnings {
        append_wrapped(&mut text, "note: ", note);
    }
    text.push('\n');
    text
}

/// A row for each correction, a column for each compass, then percentages within one and two sigma.
fn verdict_table(verdict: &Verdict<'_>) -> Table {
    let compasses = &verdict.evaluation.compasses;
    let header = std::iter::once(String::new())
        .chain(compasses.iter().map(|compass| format!("compass {}", compass.compass_number)));
    let mut table = content_width_table(header);
    let mut add_row = |name: &str, cells: Vec<Option<String>>| {
        if cells.iter().any(Option::is_some) {
            let cells = cells.into_iter().map(|cell| cell.unwrap_or_else(|| "-".to_owned()));
            table.add_row(std::iter::once(name.to_owned()).chain(cells).map(right_aligned));
        }
    };
    for (name, cells) in verdict.rms_by_correction_deg() {
        add_row(name, cells.into_iter().map(|error_deg| Some(format!("{:.2}", error_deg?))).collect());
    }
    let cells_of_compasses = |cell: &dyn Fn(&CompassEvaluation) -> Option<String>| compasses.iter().map(cell).collect();
    add_row(
        "module, smoothed",
        cells_of_compasses(&|compass| Some(format!("{:.2}", compass.module_result.as_ref()?.smoothed_score?.rms_deg))),
    );
    add_row(
        "module, mean",
        cells_of_compasses(&|compass| Some(format!("{:+.2}", compass.module_result.as_ref()?.score?.mean_deg))),
    );
    let within = |compass: &CompassEvaluation| {
        let [one, two] = compass.module_result.as_ref()?.score?.within_sigmas_percent;
        Some(format!("{one:.0}, {two:.0} %"))
    };
    add_row("module, within 1, 2 sigma", cells_of_compasses(&within));
    table
}
