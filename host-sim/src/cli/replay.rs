//! `host-sim replay`.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use autoswing::heading::NoHeading;
use clap::Args;
use comfy_table::Table;
use log_analysis::log::LogError;
use log_analysis::log::csv::FieldUnit;
use log_analysis::replay::evaluation::{CompassEvaluation, EvaluationOptions, evaluate_flight};
use log_analysis::replay::parameter_export::{self, ParameterFormat};
use log_analysis::replay::verdict::Verdict;
use log_analysis::replay::{HeadingRow, RowSelection};
use log_analysis::report::{self, ReportOrigin};

use super::failure::Failure;
use super::files::read_log;
use super::print::{self, append_wrapped, command_line, content_table, right_aligned, write_report};
use super::progress::waiting;
use super::range::{integer, number, one_of};

const SAMPLES: &[(&str, RowSelection)] =
    &[("all", RowSelection::All), ("turns", RowSelection::Turns), ("flight", RowSelection::Flight)];

const PARAMETER_FORMATS: &[(&str, ParameterFormat)] =
    &[("ardupilot", ParameterFormat::ArduPilot), ("px4", ParameterFormat::Px4), ("inav", ParameterFormat::Inav)];

const UNITS: &[(&str, FieldUnit)] = &[("mg", FieldUnit::Milligauss), ("ut", FieldUnit::Microtesla)];

/// Evaluate the compasses of a flight log, and run the module's collection and solver on each.
///
/// Logs of ArduPilot (DataFlash .bin or .log, MAVLink .tlog), of PX4 (.ulg) and tables are recognised by content; `-`
/// is standard input. The autopilot's own correction is undone, the latency of the logged field is estimated from the
/// flight, and headings by the autopilot's parameters, a sphere fit, an ellipsoid fit and the module are compared with
/// the best reference heading in the log. A simulator's true attitude (SIM, SIMSTATE) is used as reference only.
///
/// A table has values separated by comma, semicolon or tab, with column names in the first line: t_s (seconds), mx, my,
/// mz (raw field; body axes forward, right, down), roll_deg, pitch_deg (right wing down, nose up positive). Optional:
/// `use` (0 excludes a row), p_dps, q_dps, r_dps (body rates, deg/s, each the mean since the row before), yaw_ref_deg
/// (reference heading), yaw_deg (the autopilot's, from true north), current_a, lat_deg, lon_deg, height_m, speed_m_s
/// and course_deg (over ground, from true north), armed (0 or 1), and mx2, my2, mz2 of a second compass, up to the
/// eighth. Invalid lines are skipped.
///
/// Exit codes: 0 the module would calibrate with at least one compass, 1 with none, 2 the file cannot be read.
#[derive(Args)]
pub struct Replay {
    /// The log; `-` is standard input
    file: PathBuf,
    /// Rows used for the fit: samples the module keeps in any flight until they suffice (`flight`); `all` usable rows,
    /// evenly thinned to the device's capacity; or the samples of its `turns` procedure
    #[arg(long, default_value = "flight", value_name = "flight|all|turns", value_parser = one_of(SAMPLES))]
    samples: RowSelection,
    /// Evaluate only this compass, by the autopilot's number, 1 to 8
    #[arg(long, value_name = "N", value_parser = integer(1_u8, 8))]
    compass: Option<u8>,
    /// MAVLink system to read if the log has several vehicles, 1 to 255 [default: the first autopilot received]
    #[arg(long, value_name = "N", value_parser = integer(1_u8, 255))]
    system: Option<u8>,
    /// Latency of the logged field at its time stamp, milliseconds, -200 to 500 [default: estimated from the flight]
    #[arg(long, value_name = "MS", allow_negative_numbers = true, value_parser = number(-200.0, 500.0))]
    age: Option<f64>,
    /// Write the parameters of the compasses that would have calibrated
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Format of the parameters [default: of the autopilot that wrote the log, else ArduPilot's]
    #[arg(long, value_name = "ardupilot|px4|inav", value_parser = one_of(PARAMETER_FORMATS))]
    params_for: Option<ParameterFormat>,
    /// Unit of mx, my, mz in a table: milligauss or microtesla
    #[arg(long, default_value = "mg", value_name = "mg|ut", value_parser = one_of(UNITS))]
    unit: FieldUnit,
    /// Inclination of the Earth field, degrees, -90 to 90, positive down [default: by the field model if the log has
    /// place and day and the samples do not contradict it, else estimated]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = number(-90.0, 90.0))]
    inclination: Option<f64>,
    /// Fit only rows before this time of the log, seconds, -1000000000 to 1000000000
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = number(-1e9, 1e9))]
    fit_until: Option<f64>,
    /// Write t_s,heading_deg,sigma_deg,status,smooth_deg,smooth_sigma_deg for every row of the first compass; the last
    /// two are empty without a smoothed heading
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the report page: a folder for its index.html, or a file (.html; .svg: only the before-and-after picture)
    #[arg(long, value_name = "DIR|FILE")]
    report: Option<PathBuf>,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
}

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
