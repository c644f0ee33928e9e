//! `host-sim replay`.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;

use autoswing::heading::NoHeading;
use comfy_table::Table;
use log_analysis::log::LogError;
use log_analysis::replay::HeadingRow;
use log_analysis::replay::evaluation::{CompassEvaluation, EvaluationOptions, evaluate_flight};
use log_analysis::replay::parameter_export::{self, ParameterFormat};
use log_analysis::replay::verdict::Verdict;
use log_analysis::report::{self, ReportOrigin};

use super::failure::Failure;
use super::files::read_log;
use super::print::{self, append_wrapped, command_line, content_table, right_aligned, write_report};
use super::{Replay, SAMPLES, waiting};

pub fn run(options: &Replay) -> Result<ExitCode, Failure> {
    let name = options.file.display();
    let bar = waiting("reading the log");
    let flight = read_log(&options.file, options.unit, options.system).map_err(|e| match e {
        LogError::Io(why) => {
            Failure(format!("cannot read {name}: {why}; give the path of a log, or - for standard input"))
        }
        other => Failure(format!("{name}: {other}")),
    })?;
    bar.set_message("evaluating the compasses");
    let evaluation = evaluate_flight(
        &flight,
        &EvaluationOptions {
            selected: options.samples,
            compass: options.compass,
            inclination_deg: options.inclination,
            fit_until_s: options.fit_until,
            age_s: options.age.map(|ms| ms / 1e3),
        },
    );
    bar.finish_and_clear();
    if evaluation.compasses.is_empty() {
        let numbers: Vec<String> = flight.compasses.iter().map(|compass| compass.number.to_string()).collect();
        return Err(Failure(format!("{name}: the log has no compass of this number; it has {}", numbers.join(", "))));
    }
    let format = options.params_for.unwrap_or_else(|| ParameterFormat::for_autopilot(flight.autopilot));
    let verdict = Verdict::new(&flight, &evaluation, format);
    let parameters = verdict.parameters();
    let parameter_file = || parameter_export::format_parameter_file(&flight, &parameters, format);
    if let Some(path) = &options.params {
        std::fs::write(path, parameter_file()).map_err(|e| cannot_write(path, &e))?;
    }
    if let Some(path) = &options.out {
        let headings = evaluation.compasses.first().map_or(&[][..], |compass| &compass.module.headings);
        write_headings(path, headings).map_err(|e| cannot_write(path, &e))?;
    }
    let text = verdict_text(&name.to_string(), &verdict);
    if let Some(path) = &options.report {
        let made = ReportOrigin {
            command: command_line(),
            settings: settings(options),
            terminal_output: text.clone(),
            parameters: (!parameters.is_empty()).then(|| {
                let end = if format == ParameterFormat::Inav { "txt" } else { "param" };
                [format!("compass.{end}"), parameter_file()]
            }),
        };
        write_report(&report::report_replay(&verdict, &name.to_string(), &made), path)?;
    }
    if options.json {
        print::print_line(verdict.json());
    } else {
        print::print_text(&text);
    }
    Ok(if verdict.is_accepted() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn settings(options: &Replay) -> Vec<[String; 2]> {
    let samples = SAMPLES.iter().find(|(_, value)| *value == options.samples).map_or("", |(name, _)| name).to_owned();
    let age = options.age.map_or_else(|| "estimated from the flight".to_owned(), |ms| format!("{ms} ms"));
    let mut settings = vec![["samples".to_owned(), samples], ["age of the field".to_owned(), age]];
    let given = [
        ("inclination", options.inclination.map(|deg| format!("{deg} deg"))),
        ("fitted until", options.fit_until.map(|s| format!("{s} s"))),
        ("compass", options.compass.map(|number| number.to_string())),
        ("system", options.system.map(|number| number.to_string())),
    ];
    settings.extend(given.into_iter().filter_map(|(name, value)| Some([name.to_owned(), value?])));
    settings
}

fn cannot_write(path: &Path, error: &std::io::Error) -> Failure {
    Failure(format!("cannot write {}: {error}", path.display()))
}

fn verdict_text(name: &str, verdict: &Verdict<'_>) -> String {
    let mut out = String::new();
    append_wrapped(&mut out, "", &format!("VERDICT: {}", verdict.outcome));
    append_wrapped(&mut out, "", &verdict.log_description(name));
    for compass in &verdict.compasses {
        let _ = writeln!(out, "\ncompass {}", compass.evaluation.number);
        for [name, value] in verdict.facts(compass) {
            append_wrapped(&mut out, "  ", &format!("{name}: {value}"));
        }
    }
    if let Some(reference) = &verdict.evaluation.reference {
        let name = reference.name();
        let difference = reference.difference_name();
        out.push('\n');
        append_wrapped(&mut out, "", &format!("Heading {difference} against {name}, deg RMS less mean:"));
        let _ = writeln!(out, "{}", table(verdict));
        append_wrapped(&mut out, "", &format!("{name}: {}", reference.limits()));
    }
    for note in &verdict.notes {
        append_wrapped(&mut out, "note: ", &note.to_string());
    }
    out
}

/// A row for each correction, a column for each compass, then percentages within one and two sigma.
fn table(verdict: &Verdict<'_>) -> Table {
    let compasses = &verdict.evaluation.compasses;
    let header = std::iter::once(String::new()).chain(compasses.iter().map(|c| format!("compass {}", c.number)));
    let mut table = content_table(header);
    let mut add = |name: &str, cells: Vec<Option<String>>| {
        if cells.iter().any(Option::is_some) {
            let cells = cells.into_iter().map(|cell| cell.unwrap_or_else(|| "-".to_owned()));
            table.add_row(std::iter::once(name.to_owned()).chain(cells).map(right_aligned));
        }
    };
    for (name, cells) in verdict.comparison_deg() {
        add(name, cells.into_iter().map(|deg| Some(format!("{:.2}", deg?))).collect());
    }
    let of_each = |cell: &dyn Fn(&CompassEvaluation) -> Option<String>| compasses.iter().map(cell).collect();
    add("ours, smooth", of_each(&|compass| Some(format!("{:.2}", compass.module.smoothed_score?.rms_deg))));
    add("ours, mean", of_each(&|compass| Some(format!("{:+.2}", compass.module.score?.mean_deg))));
    let within = |compass: &CompassEvaluation| {
        let [one, two] = compass.module.score?.within_percent;
        Some(format!("{one:.0}, {two:.0} %"))
    };
    add("ours, in 1 and 2 sigma", of_each(&within));
    table
}

/// Writes the heading of each row; the status shows whether the module would have sent it.
fn write_headings(path: &Path, shown: &[HeadingRow]) -> std::io::Result<()> {
    let mut out = std::io::BufWriter::new(std::fs::File::create(path)?);
    writeln!(out, "t_s,heading_deg,sigma_deg,status,smooth_deg,smooth_sigma_deg")?;
    for row in shown {
        let status = row.status.map_or_else(NoHeading::code, |()| "ok");
        let smooth =
            row.smooth_deg.map_or_else(|| ",".to_owned(), |[deg, sigma_deg]| format!("{deg:.2},{sigma_deg:.2}"));
        writeln!(out, "{:.3},{:.2},{:.2},{status},{smooth}", row.t_s, row.heading_deg, row.sigma_deg)?;
    }
    out.flush()
}
