//! `host-sim replay` of one log.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use autoswing::calibration::Orientation;
use clap::Args;
use log_analysis::log::csv::FieldUnit;
use log_analysis::log::{self, LogError, LogFormat, LoggedFlight};
use log_analysis::replay::evaluation::{EvaluationOptions, FlightEvaluation};
use log_analysis::replay::judgement_request::{JudgementError, evaluate_as_requested, settings_table};
use log_analysis::replay::parameter_export::{CorrectedTerms, ParameterFormat};
use log_analysis::replay::verdict::Verdict;
use log_analysis::replay::{ReferenceKind, RowSelection};
use log_analysis::report::{self, ReportOrigin};

use crate::command_failure::CommandFailure;
use crate::file_options::visit_logs;
use crate::heading_file::write_headings;
use crate::option_parsers::{integer_in_range, number_in_range, one_of, parse_log_time};
use crate::print::{self, command_line, show_spinner, write_report};
use crate::verdict_text::{WrittenOutput, full_text, summary_text};

const EXAMPLES: &str = "Examples:
  host-sim replay flight.bin                          the verdict
  host-sim replay flight.bin --params compass.param   the parameters to load
  host-sim replay flight.bin --report flight.html     a page with charts
  host-sim replay logs/                               a line for each log in it";

/// Judge the compasses of a flight log; write parameters that correct them.
///
/// Logs of ArduPilot (DataFlash .bin or .log, MAVLink .tlog), also decoded by mavlogdump, of PX4 (.ulg), INAV and
/// Betaflight (blackbox), tables, and a .zip or .gz with these are recognised by content; `-` is standard input.
///
/// The verdict is on each compass as the aircraft flies it now, the one in use first, and on what to do: load the
/// parameters, leave it, fly again, or replace it. With --module it is also compared with an Autoswing module.
/// docs/how-replay-works.md has the columns of a table.
///
/// Exit codes: 0 the compass in use is good, parameters for it are given, or none is in use; 1 otherwise; 2 the log
/// cannot be judged; of several logs the highest.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ReplayArguments {
    /// The log, `-` is standard input; several logs, or folders of logs with their subfolders, give one line each, the worst
    /// first. A log of a file that holds several is named after the file: "LOG.TXT/flight 2"
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Write the parameters to load; without any, an existing file is left as it is. A name that ends in .params gives
    /// the five columns that QGroundControl loads
    #[arg(long, value_name = "FILE")]
    pub params: Option<PathBuf>,
    /// Write the report page: a folder for its index.html, or a file (.html; .svg: only the before-and-after picture)
    #[arg(long, value_name = "DIR|FILE")]
    pub report: Option<PathBuf>,
    /// Print every figure
    #[arg(long)]
    pub verbose: bool,
    /// Judge only this compass, by the autopilot's number, 1 to 8
    #[arg(long, value_name = "N", value_parser = integer_in_range(1_u8, 8))]
    pub compass: Option<u8>,
    /// Use only rows from this time on, of the log's clock: seconds, M:SS or H:MM:SS
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, value_parser = parse_log_time)]
    pub from: Option<f64>,
    /// Use only rows up to this time, of the log's clock: seconds, M:SS or H:MM:SS
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, value_parser = parse_log_time)]
    pub to: Option<f64>,
    /// Heading that errors are measured against [default: the best in the log, in this order]
    #[arg(long, value_name = "simulator|column|gps-yaw|gps-course|autopilot", value_parser = one_of::<ReferenceKind>("simulator|column|gps-yaw|gps-course|autopilot"))]
    pub reference: Option<ReferenceKind>,
    /// Format of the parameters [default: of the autopilot that wrote the log, else ArduPilot's]
    #[arg(long, value_name = "ardupilot|px4|inav", value_parser = one_of::<ParameterFormat>("ardupilot|px4|inav"))]
    pub params_for: Option<ParameterFormat>,
    /// What the parameters correct, if all of it makes the compass useful: offsets; offsets and one scale; or offsets,
    /// matrix, motor current and orientation. The report has the error of each
    #[arg(long, default_value = "all", value_name = "offsets|scale|all", value_parser = one_of::<CorrectedTerms>("offsets|scale|all"))]
    pub correct: CorrectedTerms,
    /// Compare with an Autoswing module on this flight, and with fits of a sphere and an ellipsoid. The module fits the
    /// samples it keeps in any flight until they suffice (`flight`, also without a name); `all` usable rows, evenly thinned
    /// to its capacity; or the samples of its `turns` procedure
    #[arg(long, value_name = "flight|all|turns", value_parser = one_of::<RowSelection>("all|turns|flight"), num_args = 0..=1,
          require_equals = true, default_missing_value = "flight")]
    pub module: Option<RowSelection>,
    /// MAVLink system to read if the log has several vehicles, 1 to 255 [default: the first autopilot received]
    #[arg(long, value_name = "N", value_parser = integer_in_range(1_u8, 255))]
    pub system: Option<u8>,
    /// Latency of the logged field at its time stamp, milliseconds, -200 to 500 [default: estimated from the flight]
    #[arg(long, value_name = "MS", allow_negative_numbers = true, value_parser = number_in_range(-200.0, 500.0))]
    pub age: Option<f64>,
    /// Unit of mx, my, mz in a table: milligauss or microtesla
    #[arg(long, default_value = "mg", value_name = "mg|ut", value_parser = one_of::<FieldUnit>("mg|ut"))]
    pub unit: FieldUnit,
    /// Orientation of the sensors by ArduPilot's names, such as yaw90, in place of that of the log's parameters; the
    /// field of a table is then that of the sensors' axes [default: that of the log]
    #[arg(long, value_name = "ORIENTATION", value_parser = parse_orientation)]
    pub mount: Option<Orientation>,
    /// Inclination of the Earth field, degrees, -90 to 90, positive down [default: by the field model if the log has
    /// place and day and the samples do not contradict it, else estimated]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = number_in_range(-90.0, 90.0))]
    pub inclination: Option<f64>,
    /// Write the module's t_s,heading_deg,sigma_deg,status,smooth_deg,smooth_sigma_deg,readings for every reading of the first
    /// compass, at the log's time stamps; `readings` are averaged to one heading, smooth ones may be empty
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Print one JSON object instead of the text
    #[arg(long)]
    pub json: bool,
}

impl ReplayArguments {
    /// Whether an option is of one log only.
    #[must_use]
    pub const fn takes_one_log(&self) -> bool {
        self.params.is_some() || self.params_for.is_some() || self.out.is_some() || self.report.is_some()
    }

    fn evaluation_options(&self) -> EvaluationOptions {
        EvaluationOptions {
            compared_module: self.module.or(self.out.is_some().then_some(RowSelection::Flight)),
            compass_number: self.compass,
            inclination_deg: self.inclination,
            time_window_s: [self.from.unwrap_or(f64::NEG_INFINITY), self.to.unwrap_or(f64::INFINITY)],
            reference_kind: self.reference,
            field_latency_s: self.age.map(|latency_ms| latency_ms / 1e3),
            corrected_terms: self.correct,
        }
    }

    fn settings_table(&self) -> Vec<[String; 2]> {
        let further_options = [
            ("mount", self.mount.map(|mount| mount.orientation_name().to_owned())),
            ("system", self.system.map(|system| system.to_string())),
        ];
        let further_options = further_options.into_iter().filter_map(|(name, value)| Some([name.to_owned(), value?]));
        settings_table(&self.evaluation_options()).into_iter().chain(further_options).collect()
    }
}

fn parse_orientation(name: &str) -> Result<Orientation, String> {
    Orientation::from_name(&name.to_ascii_lowercase()).ok_or_else(|| {
        let names: Vec<&str> = Orientation::all_orientations().map(Orientation::orientation_name).collect();
        format!("must be one of {}", names.join(", "))
    })
}

/// Reads a log.
///
/// # Errors
///
/// The file cannot be read, or holds no usable flight.
pub fn read_flight(file: &Path, options: &ReplayArguments) -> Result<LoggedFlight, JudgementError> {
    with_given_mount(log::only_flight(&mut |visit| visit_logs(file, options.unit, options.system, visit))?, options)
}

/// The flight with the orientation of the options.
///
/// # Errors
///
/// The orientation of a compass is that of the autopilot's board, or unknown.
pub fn with_given_mount(mut flight: LoggedFlight, options: &ReplayArguments) -> Result<LoggedFlight, JudgementError> {
    if let Some(mount) = options.mount {
        if flight.log_format == LogFormat::Csv {
            flight.rotate_fields_to_body(mount);
        } else {
            flight.set_orientation(mount, options.compass).map_err(JudgementError::FixedOrientation)?;
        }
    }
    Ok(flight)
}

/// Evaluates a log.
///
/// # Errors
///
/// The log does not have the compass, the reference or the part of the options.
pub fn evaluate_log(flight: &LoggedFlight, options: &ReplayArguments) -> Result<FlightEvaluation, JudgementError> {
    evaluate_as_requested(flight, &options.evaluation_options())
}

/// Failure of a log's judgement, with a remedy.
fn failure_of_log(file: &Path, error: &JudgementError) -> CommandFailure {
    let text = error.text_for_log(&file.display().to_string());
    CommandFailure(match error {
        JudgementError::Log(LogError::Io(_)) => format!("{text}; give the path of a log, or - for standard input"),
        JudgementError::Log(LogError::SeveralLogs(_)) => format!("{text}; give its name"),
        _ => text,
    })
}

/// Judges the compasses of a log; `None` if the file holds several logs.
///
/// # Errors
///
/// The log holds no usable flight, an option does not fit it, or a file cannot be written.
pub fn run_replay(file: &Path, options: &ReplayArguments) -> Result<Option<ExitCode>, CommandFailure> {
    if options.params_for.is_some() && options.params.is_none() && options.report.is_none() {
        return Err(CommandFailure(
            "--params-for chooses the format of a file: give --params FILE, or --report".to_owned(),
        ));
    }
    let bar = show_spinner("reading the log");
    let failed = |error: JudgementError| failure_of_log(file, &error);
    let flight = match read_flight(file, options) {
        Err(JudgementError::Log(LogError::SeveralLogs(_))) if file.as_os_str() != "-" && !options.takes_one_log() => {
            return Ok(None);
        }
        read => read.map_err(failed)?,
    };
    bar.set_message("evaluating the compasses");
    let evaluation = evaluate_log(&flight, options).map_err(failed)?;
    bar.finish_and_clear();
    let format = options.params_for.unwrap_or_else(|| ParameterFormat::for_autopilot(flight.autopilot));
    let verdict = Verdict::new(&flight, &evaluation, format);
    if options.json {
        print::print_line(verdict.json());
    } else {
        let text = if options.verbose { full_text(&verdict) } else { String::new() };
        let written = WrittenOutput {
            is_verbose: options.verbose,
            has_parameter_file: options.params.is_some(),
            has_report: options.report.is_some(),
        };
        print::print_text(&(text + &summary_text(file, written, &verdict)));
    }
    write_files(file, options, &verdict)?;
    Ok(Some(if verdict.is_good_or_correctable() { ExitCode::SUCCESS } else { ExitCode::FAILURE }))
}

fn write_files(file: &Path, options: &ReplayArguments, verdict: &Verdict<'_>) -> Result<(), CommandFailure> {
    if let Some(path) = &options.params {
        write_parameters(path, verdict)?;
    }
    if let Some(path) = &options.out {
        let first = verdict.compasses_in_use_first().first().map(|compass| compass.evaluation);
        write_headings(path, verdict.flight, first).map_err(|error| cannot_write(path, &error))?;
    }
    if let Some(path) = &options.report {
        let origin = ReportOrigin { command_line: command_line(), settings: options.settings_table() };
        write_report(&report::report_replay(verdict, &file.display().to_string(), &origin), path)?;
    }
    Ok(())
}

/// Writes the parameters in the columns that belong to the file's extension.
fn write_parameters(path: &Path, verdict: &Verdict<'_>) -> Result<(), CommandFailure> {
    let files = verdict.parameter_files();
    let has_extension_of = |name: &str| path.extension() == Path::new(name).extension();
    let Some(file) = files.iter().find(|file| has_extension_of(file.file_name)).or(files.first()) else {
        print::print_error(format_args!("host-sim: no parameters to load; {} is not written", path.display()));
        return Ok(());
    };
    std::fs::write(path, &file.text).map_err(|error| cannot_write(path, &error))?;
    let corrections = verdict.exported_corrections();
    let numbers: Vec<String> = corrections.iter().map(|export| export.compass_number.to_string()).collect();
    print::print_error(format_args!("parameters of compass {}: {}", numbers.join(", "), path.display()));
    Ok(())
}

fn cannot_write(path: &Path, error: &std::io::Error) -> CommandFailure {
    CommandFailure(format!("cannot write {}: {error}", path.display()))
}
