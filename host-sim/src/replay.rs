//! `host-sim replay` of one log.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use autoswing::calibration::Orientation;
use autoswing::heading::NoHeading;
use clap::Args;
use comfy_table::Table;
use log_analysis::log::csv::FieldUnit;
use log_analysis::log::{LogError, LogFormat, LoggedFlight};
use log_analysis::replay::evaluation::{CompassEvaluation, EvaluationOptions, FlightEvaluation, evaluate_flight};
use log_analysis::replay::parameter_export::{self, ParameterFormat};
use log_analysis::replay::verdict::Verdict;
use log_analysis::replay::{ReferenceHeading, ReferenceKind, RowSelection};
use log_analysis::report::{self, ReportOrigin};

use crate::command_failure::CommandFailure;
use crate::file_options::read_log;
use crate::option_parsers::{integer_in_range, named_value, number_in_range, parse_log_time};
use crate::print::{self, append_wrapped, command_line, content_width_table, right_aligned, write_report};
use crate::progress::show_spinner;

const ROW_SELECTIONS: &[(&str, RowSelection)] = &[
    (RowSelection::All.selection_name(), RowSelection::All),
    (RowSelection::Turns.selection_name(), RowSelection::Turns),
    (RowSelection::Flight.selection_name(), RowSelection::Flight),
];

const PARAMETER_FORMATS: &[(&str, ParameterFormat)] =
    &[("ardupilot", ParameterFormat::ArduPilot), ("px4", ParameterFormat::Px4), ("inav", ParameterFormat::Inav)];

const REFERENCE_NAMES: &[(&str, ReferenceKind)] = &[
    ("simulator", ReferenceKind::Simulator),
    ("column", ReferenceKind::Column),
    ("gps-yaw", ReferenceKind::GpsYaw),
    ("gps-course", ReferenceKind::GpsCourse),
    ("autopilot", ReferenceKind::AutopilotYaw),
];

const FIELD_UNITS: &[(&str, FieldUnit)] = &[("mg", FieldUnit::Milligauss), ("ut", FieldUnit::Microtesla)];

/// Evaluate the compasses of a flight log, and run the module's collection and solver on each.
///
/// Logs of ArduPilot (DataFlash .bin or .log, MAVLink .tlog), also decoded by mavlogdump, of PX4 (.ulg) and tables are
/// recognised by content; `-` is standard input. The autopilot's own correction is undone, the latency of the logged field is estimated from the
/// flight, and headings as logged are compared with the best reference heading in the log. A simulator's true attitude (SIM, SIMSTATE) is used as reference only.
///
/// A table has values separated by comma, semicolon or tab, with column names in the first line: t_s (seconds), mx, my,
/// mz (raw field; body axes forward, right, down), roll_deg, pitch_deg (right wing down, nose up positive). Optional:
/// `use` (0 excludes a row), p_dps, q_dps, r_dps (body rates, deg/s, each the mean since the row before), yaw_ref_deg
/// (reference heading), yaw_deg (the autopilot's, from true north), current_a, lat_deg, lon_deg, height_m, speed_m_s
/// and course_deg (over ground, from true north), armed (0 or 1), and mx2, my2, mz2 of a second compass, up to the
/// eighth. Invalid lines are skipped.
///
/// The verdict is on each compass as the aircraft flies it now, the one in use first, and on what to do: load the
/// parameters, leave it, fly again, or replace it. With --module it is also compared with an Autoswing module.
///
/// Exit codes: 0 the compass in use is good or parameters for it are given, 1 neither, 2 the file cannot be read; of
/// several logs the highest.
#[derive(Debug, Args)]
pub struct ReplayArguments {
    /// The log, `-` is standard input; several logs, or folders of logs, give one line each, the worst first
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Compare with an Autoswing module on this flight, and with fits of a sphere and an ellipsoid. The module fits the
    /// samples it keeps in any flight until they suffice (`flight`, also without a name); `all` usable rows, evenly thinned
    /// to its capacity; or the samples of its `turns` procedure
    #[arg(long, value_name = "flight|all|turns", value_parser = named_value(ROW_SELECTIONS), num_args = 0..=1,
          require_equals = true, default_missing_value = "flight")]
    pub module: Option<RowSelection>,
    /// Evaluate only this compass, by the autopilot's number, 1 to 8
    #[arg(long, value_name = "N", value_parser = integer_in_range(1_u8, 8))]
    pub compass: Option<u8>,
    /// MAVLink system to read if the log has several vehicles, 1 to 255 [default: the first autopilot received]
    #[arg(long, value_name = "N", value_parser = integer_in_range(1_u8, 255))]
    pub system: Option<u8>,
    /// Latency of the logged field at its time stamp, milliseconds, -200 to 500 [default: estimated from the flight]
    #[arg(long, value_name = "MS", allow_negative_numbers = true, value_parser = number_in_range(-200.0, 500.0))]
    pub age: Option<f64>,
    /// Write the parameters to load; without any, an existing file is left as it is
    #[arg(long, value_name = "FILE")]
    pub params: Option<PathBuf>,
    /// Format of the parameters [default: of the autopilot that wrote the log, else ArduPilot's]
    #[arg(long, value_name = "ardupilot|px4|inav", value_parser = named_value(PARAMETER_FORMATS))]
    pub params_for: Option<ParameterFormat>,
    /// Unit of mx, my, mz in a table: milligauss or microtesla
    #[arg(long, default_value = "mg", value_name = "mg|ut", value_parser = named_value(FIELD_UNITS))]
    pub unit: FieldUnit,
    /// Orientation of the sensors by ArduPilot's names, such as yaw90, in place of that of the log's parameters; the
    /// field of a table is then that of the sensors' axes [default: that of the log]
    #[arg(long, value_name = "ORIENTATION", value_parser = parse_orientation)]
    pub mount: Option<Orientation>,
    /// Inclination of the Earth field, degrees, -90 to 90, positive down [default: by the field model if the log has
    /// place and day and the samples do not contradict it, else estimated]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = number_in_range(-90.0, 90.0))]
    pub inclination: Option<f64>,
    /// Use only rows from this time on, of the log's clock: seconds, M:SS or H:MM:SS
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, value_parser = parse_log_time)]
    pub from: Option<f64>,
    /// Use only rows up to this time, of the log's clock: seconds, M:SS or H:MM:SS
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, value_parser = parse_log_time)]
    pub to: Option<f64>,
    /// Heading that errors are measured against [default: the best in the log, in this order]
    #[arg(long, value_name = "simulator|column|gps-yaw|gps-course|autopilot", value_parser = named_value(REFERENCE_NAMES))]
    pub reference: Option<ReferenceKind>,
    /// Write the module's t_s,heading_deg,sigma_deg,status,smooth_deg,smooth_sigma_deg,readings for every reading of the first
    /// compass, at the log's time stamps; `readings` are averaged to one heading, smooth ones may be empty
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Write the report page: a folder for its index.html, or a file (.html; .svg: only the before-and-after picture)
    #[arg(long, value_name = "DIR|FILE")]
    pub report: Option<PathBuf>,
    /// Print one JSON object instead of the table
    #[arg(long)]
    pub json: bool,
}

/// Farthest reading from the row that it is averaged to, seconds: readings within 0.1 s are averaged.
const MAX_READING_TO_ROW_S: f64 = 0.06;

/// Reads a log.
///
/// # Errors
///
/// The file cannot be read, or holds no usable flight.
pub fn read_flight(file: &Path, options: &ReplayArguments) -> Result<LoggedFlight, CommandFailure> {
    let name = file.display();
    let mut flight = read_log(file, options.unit, options.system).map_err(|failure| match failure {
        LogError::Io(why) => {
            CommandFailure(format!("cannot read {name}: {why}; give the path of a log, or - for standard input"))
        }
        other => CommandFailure(format!("{name}: {other}")),
    })?;
    if let Some(mount) = options.mount {
        if flight.log_format == LogFormat::Csv {
            flight.rotate_fields_to_body(mount);
        } else {
            flight.set_orientation(mount, options.compass).map_err(|compass_number| {
                CommandFailure(format!(
                    "{name}: the orientation of compass {compass_number} is that of the autopilot's board, or unknown; give \
                     --compass with the number of another"
                ))
            })?;
        }
    }
    Ok(flight)
}

fn parse_orientation(name: &str) -> Result<Orientation, String> {
    Orientation::from_name(&name.to_ascii_lowercase()).ok_or_else(|| {
        let names: Vec<&str> = Orientation::all_orientations().map(Orientation::orientation_name).collect();
        format!("must be one of {}", names.join(", "))
    })
}

/// Evaluates a log.
///
/// # Errors
///
/// The log does not have the compass or the reference of the options.
pub fn evaluate_log(
    file: &Path,
    flight: &LoggedFlight,
    options: &ReplayArguments,
) -> Result<FlightEvaluation, CommandFailure> {
    let name = file.display();
    let window_s = [options.from.unwrap_or(f64::NEG_INFINITY), options.to.unwrap_or(f64::INFINITY)];
    let [first_s, last_s] = flight.time_range_s();
    if window_s[0] >= window_s[1] {
        return Err(CommandFailure("--to must be later than --from".to_owned()));
    }
    if window_s[0] > last_s || window_s[1] < first_s {
        return Err(CommandFailure(format!(
            "{name}: no rows between --from and --to: the log has {first_s:.0} to {last_s:.0} s"
        )));
    }
    let evaluation = evaluate_flight(
        flight,
        &EvaluationOptions {
            compared_module: options.module.or(options.out.is_some().then_some(RowSelection::Flight)),
            compass_number: options.compass,
            inclination_deg: options.inclination,
            time_window_s: window_s,
            reference_kind: options.reference,
            field_latency_s: options.age.map(|latency_ms| latency_ms / 1e3),
        },
    );
    if evaluation.compasses.is_empty() {
        let numbers: Vec<String> = flight.compasses.iter().map(|compass| compass.compass_number.to_string()).collect();
        return Err(CommandFailure(format!(
            "{name}: the log has no compass of this number; it has {}",
            numbers.join(", ")
        )));
    }
    if options.reference.is_some() && evaluation.reference.is_none() {
        let is_in_log =
            |(_, reference_kind): &&(&str, ReferenceKind)| ReferenceHeading::of_kind(flight, *reference_kind).is_some();
        let available_references: Vec<&str> = REFERENCE_NAMES.iter().filter(is_in_log).map(|(name, _)| *name).collect();
        return Err(CommandFailure(format!(
            "{name}: the log has no such reference; it has {}",
            available_references.join(", ")
        )));
    }
    Ok(evaluation)
}

/// Judges the compasses of a log.
///
/// # Errors
///
/// The log holds no usable flight, an option does not fit it, or a file cannot be written.
pub fn run_replay(file: &Path, options: &ReplayArguments) -> Result<ExitCode, CommandFailure> {
    if options.params_for.is_some() && options.params.is_none() && options.report.is_none() {
        return Err(CommandFailure(
            "--params-for chooses the format of a file: give --params FILE, or --report".to_owned(),
        ));
    }
    let name = file.display();
    let bar = show_spinner("reading the log");
    let flight = read_flight(file, options)?;
    bar.set_message("evaluating the compasses");
    let evaluation = evaluate_log(file, &flight, options)?;
    bar.finish_and_clear();
    let format = options.params_for.unwrap_or_else(|| ParameterFormat::for_autopilot(flight.autopilot));
    let verdict = Verdict::new(&flight, &evaluation, format);
    let parameters = verdict.exported_corrections();
    let parameter_file = || parameter_export::format_parameter_file(&flight, &parameters, format);
    if let Some(path) = &options.params {
        let numbers: Vec<String> = parameters.iter().map(|export| export.compass_number.to_string()).collect();
        if numbers.is_empty() {
            print::print_error(format_args!("host-sim: no parameters to load; {} is not written", path.display()));
        } else {
            std::fs::write(path, parameter_file()).map_err(|error| cannot_write(path, &error))?;
            print::print_error(format_args!("parameters of compass {}: {}", numbers.join(", "), path.display()));
        }
    }
    if let Some(path) = &options.out {
        let first = verdict.compasses_in_use_first().first().map(|compass| compass.evaluation);
        write_headings(path, &flight, first).map_err(|error| cannot_write(path, &error))?;
    }
    let text = verdict_text(&name.to_string(), &verdict);
    if let Some(path) = &options.report {
        let origin = ReportOrigin {
            command_line: command_line(),
            settings: settings_table(options),
            terminal_output: text.clone(),
            parameter_file: (!parameters.is_empty()).then(|| [format.file_name().to_owned(), parameter_file()]),
        };
        write_report(&report::report_replay(&verdict, &name.to_string(), &origin), path)?;
    }
    if options.json {
        print::print_line(verdict.json());
    } else {
        print::print_text(&text);
    }
    Ok(if verdict.is_good_or_correctable() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn settings_table(options: &ReplayArguments) -> Vec<[String; 2]> {
    let age =
        options.age.map_or_else(|| "estimated from the flight".to_owned(), |latency_ms| format!("{latency_ms} ms"));
    let mut settings = vec![["age of the field".to_owned(), age]];
    let given_options = [
        ("module", options.module.map(|selection| selection.selection_name().to_owned())),
        ("inclination", options.inclination.map(|inclination_deg| format!("{inclination_deg} deg"))),
        ("mount", options.mount.map(|mount| mount.orientation_name().to_owned())),
        ("from", options.from.map(|time_s| format!("{time_s} s"))),
        ("to", options.to.map(|time_s| format!("{time_s} s"))),
        (
            "reference",
            REFERENCE_NAMES
                .iter()
                .find(|(_, reference_kind)| Some(*reference_kind) == options.reference)
                .map(|(name, _)| (*name).to_owned()),
        ),
        ("compass", options.compass.map(|compass_number| compass_number.to_string())),
        ("system", options.system.map(|compass_number| compass_number.to_string())),
    ];
    settings.extend(given_options.into_iter().filter_map(|(name, value)| Some([name.to_owned(), value?])));
    settings
}

fn cannot_write(path: &Path, error: &std::io::Error) -> CommandFailure {
    CommandFailure(format!("cannot write {}: {error}", path.display()))
}

fn verdict_text(name: &str, verdict: &Verdict<'_>) -> String {
    let mut report_text = String::new();
    for (compass, sentence) in verdict.compasses_in_use_first().iter().zip(verdict.summary_sentences()) {
        append_wrapped(
            &mut report_text,
            &format!("{}: ", compass.judgement.compass_state.to_string().to_uppercase()),
            &sentence,
        );
    }
    append_wrapped(&mut report_text, "", &verdict.log_description(name));
    for compass in verdict.compasses_in_use_first() {
        let _ = writeln!(report_text, "\ncompass {}", compass.evaluation.compass_number);
        for [name, value] in verdict.key_facts(compass) {
            append_wrapped(&mut report_text, "  ", &format!("{name}: {value}"));
        }
    }
    if let Some(reference) = &verdict.evaluation.reference {
        let name = reference.reference_name();
        let difference = reference.difference_name();
        report_text.push('\n');
        append_wrapped(&mut report_text, "", &format!("Heading {difference} against {name}, deg RMS less mean:"));
        let _ = writeln!(report_text, "{}", verdict_table(verdict));
        append_wrapped(&mut report_text, "", &format!("{name}: {}", reference.accuracy_description()));
    }
    for note in &verdict.log_warnings {
        append_wrapped(&mut report_text, "note: ", &note.to_string());
    }
    report_text
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

/// Writes a line for each reading of the log at its own time stamp: the heading of the row that it is part of, the number
/// of readings averaged to that row, and whether the module would have sent the heading. After a refusal the status is
/// that of a module without a calibration.
fn write_headings(path: &Path, flight: &LoggedFlight, compass: Option<&CompassEvaluation>) -> std::io::Result<()> {
    let mut output_file = std::io::BufWriter::new(std::fs::File::create(path)?);
    writeln!(output_file, "t_s,heading_deg,sigma_deg,status,smooth_deg,smooth_sigma_deg,readings")?;
    let Some((compass, module)) = compass.and_then(|compass| Some((compass, compass.module_result.as_ref()?))) else {
        return output_file.flush();
    };
    let logged = flight.compasses.iter().find(|logged| logged.compass_number == compass.compass_number);
    let stamps_s: Vec<f64> =
        logged.map_or_else(Vec::new, |logged| logged.field.rows().iter().map(|row| row.t_s).collect());
    let headings = &module.headings;
    let nearest_row = |stamp_s: f64| {
        // Rows are at the time of the field, which is older than its time stamp.
        let at_s = stamp_s - compass.latency.used_s;
        let next = headings.partition_point(|row| row.t_s < at_s);
        let neighbours = [next.checked_sub(1), Some(next)].into_iter().flatten();
        let distance_s = |index: usize| headings.get(index).map_or(f64::INFINITY, |row| (row.t_s - at_s).abs());
        neighbours
            .min_by(|a, b| distance_s(*a).total_cmp(&distance_s(*b)))
            .filter(|index| distance_s(*index) < MAX_READING_TO_ROW_S)
    };
    let rows: Vec<Option<usize>> = stamps_s.iter().map(|stamp_s| nearest_row(*stamp_s)).collect();
    let mut readings = vec![0_u32; headings.len()];
    rows.iter().flatten().for_each(|index| readings[*index] += 1);
    let is_refused = module.acceptance.is_err();
    let missing_status = if is_refused { NoHeading::Uncalibrated.stable_code() } else { "left-out" };
    for (stamp_s, index) in stamps_s.iter().zip(rows) {
        let Some(index) = index else {
            writeln!(output_file, "{stamp_s:.6},,,{missing_status},,,0")?;
            continue;
        };
        let row = &headings[index];
        let status = if is_refused { Err(NoHeading::Uncalibrated) } else { row.status };
        let status = status.map_or_else(NoHeading::stable_code, |()| "ok");
        let smooth = row
            .smoothed_and_sigma_deg
            .map_or_else(|| ",".to_owned(), |[deg, sigma_deg]| format!("{deg:.2},{sigma_deg:.2}"));
        let reading_count = readings[index];
        writeln!(
            output_file,
            "{stamp_s:.6},{:.2},{:.2},{status},{smooth},{reading_count}",
            row.heading_deg, row.sigma_deg
        )?;
    }
    output_file.flush()
}
