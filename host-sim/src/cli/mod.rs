//! Commands, options and exit codes.

mod accuracy;
mod bench;
mod failure;
mod files;
mod fly;
mod integrity;
mod print;
mod range;
mod replay;
mod serve;
mod table1;
mod termination;

use std::path::PathBuf;
use std::process::ExitCode;

use autoswing::settings::HeadingKind;
use clap::{Args, Parser, Subcommand};
use host_sim::studies::accuracy::flight::FlightPattern;
use host_sim::studies::integrity::AttitudeProtocol;
use indicatif::{ProgressBar, ProgressStyle};
use log_analysis::log::csv::FieldUnit;
use log_analysis::numbers::round_to;
use log_analysis::replay::RowSelection;
use log_analysis::replay::parameter_export::ParameterFormat;
use serde_json::{Value, json};
use simulator::world::WorldConfig;
use simulator::world::aircraft::VehicleKind;
use simulator::world::airframe::AirframeDescription;

use failure::Failure;
use range::{integer, number, one_of};
use termination::TerminationSignals;

/// Vehicles of the studies.
const AIRCRAFT: &[(&str, VehicleKind)] =
    &[("plane", VehicleKind::Plane), ("copter", VehicleKind::Copter), ("vtol", VehicleKind::Vtol)];

const PATTERNS: &[(&str, FlightPattern)] = &[
    ("routine", FlightPattern::Routine),
    ("mirrored", FlightPattern::Mirrored),
    ("wandering", FlightPattern::Wandering),
];

const HEADINGS: &[(&str, HeadingKind)] = &[("raw", HeadingKind::Raw), ("smooth", HeadingKind::Smooth)];

const SOURCES: &[(&str, AttitudeProtocol)] = &[("mavlink", AttitudeProtocol::Mavlink), ("msp", AttitudeProtocol::Msp)];

const SAMPLES: &[(&str, RowSelection)] =
    &[("all", RowSelection::All), ("turns", RowSelection::Turns), ("flight", RowSelection::Flight)];

const PARAMETER_FORMATS: &[(&str, ParameterFormat)] =
    &[("ardupilot", ParameterFormat::ArduPilot), ("px4", ParameterFormat::Px4), ("inav", ParameterFormat::Inav)];

const UNITS: &[(&str, FieldUnit)] = &[("mg", FieldUnit::Milligauss), ("ut", FieldUnit::Microtesla)];

/// Fly the firmware of the Autoswing heading module in a simulated aircraft.
///
/// Everything runs in virtual time and depends on the seed only: the same command prints the same bytes. Only `serve`
/// and `console` follow the wall clock and their inputs. Exit codes: 0 calibrated, 1 the module refused, 2 wrong
/// command; 130 ended by Ctrl-C, 141 the reader closed the pipe. docs/json.md describes the output of --json.
#[derive(Parser)]
#[command(version, about, long_about, args_conflicts_with_subcommands = true, term_width = print::WIDTH)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    fly: Fly,
}

// No doc comments on these variants: they would replace the commands' own long help.
#[derive(Subcommand)]
enum Command {
    Fly(Fly),
    Emulate(Emulate),
    Serve(serve::Serve),
    Console(serve::Console),
    Table1(Table1),
    Replay(Replay),
    /// Measure accuracy or speed
    #[command(subcommand)]
    Bench(Bench),
}

#[derive(Subcommand)]
enum Bench {
    Accuracy(Accuracy),
    Integrity(Integrity),
    Speed(Speed),
    Budget(Budget),
}

/// Compare the methods on the aircraft of Liu 2007 table 1.
///
/// The airframe is fitted to the published errors. As in the paper's experiment it is tilted 20 deg to either side at
/// zero pitch: at 12 headings without noise, and at 256 with the noise of a LIS3MDL.
#[derive(Args)]
struct Table1 {
    /// Seed of the sensor's noise, 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = integer(0, u64::MAX))]
    seed: u64,
    /// Print one JSON object instead of the tables
    #[arg(long)]
    json: bool,
}

/// Random airframes: heading error of each method relative to the Cramer-Rao bound, and accuracy of sigma.
///
/// Soft iron to 30 %, hard iron to 3 times the horizontal field, mounting to 20 deg, inclination -70 to 75 deg, turns
/// at 15 to 45 deg of bank that wander by 2 deg, 192 samples a side, sensor noise 0.3 to 1 %, attitude noise 0.2 to 1
/// deg. Heading, roll and pitch of every sample are unknowns of the bound. 500 airframes take about two minutes.
///
/// For a copter or a VTOL, or with --pattern or --minutes, whole flights are flown at ten samples a second, from which
/// the module selects; attitude noise grows by 0.4 deg for each m/s^2 of acceleration. The bound is that of equally
/// many readings, the best of the flight, selected afterwards (greedy, D-optimal); errors are evaluated level and at 20
/// deg of tilt to eight sides, for an aeroplane level and at 30 deg of bank.
#[derive(Args)]
struct Accuracy {
    /// Kind of aircraft
    #[arg(long, default_value = "plane", value_name = "plane|copter|vtol", value_parser = one_of(AIRCRAFT))]
    aircraft: VehicleKind,
    /// Flight patterns, one row each [default: all three; for an aeroplane turns only, all of them solved]
    #[arg(long = "pattern", value_name = "routine|mirrored|wandering", value_parser = one_of(PATTERNS))]
    patterns: Vec<FlightPattern>,
    /// Duration of a flight, minutes, 1 to 120 [default: 3]
    #[arg(long, value_name = "MINUTES", value_parser = number(1.0, 120.0))]
    minutes: Option<f64>,
    /// Number of airframes, 1 to 1000000
    #[arg(long, default_value_t = 500, value_name = "N", value_parser = integer(1_u64, 1_000_000))]
    airframes: u64,
    /// Draws of the noise for each airframe, 1 to 100000
    #[arg(long, default_value_t = 60, value_name = "N", value_parser = integer(1_u64, 100_000))]
    draws: u64,
    /// Seed of the first airframe, incremented for the others, 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = integer(0, u64::MAX))]
    seed: u64,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
}

/// Faults in flight and during calibration: fraction of wrong headings among those sent as good.
///
/// Random airframes at random places calibrate and fly on for three minutes with the firmware's own tasks, with a fault
/// of the sensor, the attitude source, the airframe's iron or the place. A heading is bad if its error exceeds four of
/// the sigmas sent with it and 5 deg. A calibration is wrong if its true error is more than three times the expected
/// one. An alarm is a period without headings that begins without a fault. 100 flights of every case take about five
/// minutes on two cores.
#[derive(Args)]
struct Integrity {
    /// Kind of aircraft; a copter or a VTOL calibrates by its routine, and turns and accelerates in hover
    #[arg(long, default_value = "plane", value_name = "plane|copter|vtol", value_parser = one_of(AIRCRAFT))]
    aircraft: VehicleKind,
    /// Flights of each case, 1 to 100000; the ten-hour case is flown once
    #[arg(long, default_value_t = 100, value_name = "N", value_parser = integer(1_u64, 100_000))]
    flights: u64,
    /// Seed of the first flight, incremented for the others, 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = integer(0, u64::MAX))]
    seed: u64,
    /// Run only this case; may be repeated; `list` shows the cases
    #[arg(long = "case", value_name = "NAME")]
    cases: Vec<String>,
    /// Protocol of the attitude source: MAVLink with body rates, or MSP, which is polled, in tenths of a degree, without
    /// body rates
    #[arg(long, default_value = "mavlink", value_name = "mavlink|msp", value_parser = one_of(SOURCES))]
    source: AttitudeProtocol,
    /// Heading that is sent: raw, or smoothed if available
    #[arg(long, default_value = "smooth", value_name = "raw|smooth", value_parser = one_of(HEADINGS))]
    heading: HeadingKind,
    /// Print a JSON list of one object a case instead of the table
    #[arg(long)]
    json: bool,
}

/// Solve time of each method, and simulated seconds a second, on this machine
#[derive(Args)]
struct Speed {
    /// Print one JSON object instead of the text
    #[arg(long)]
    json: bool,
}

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
struct Replay {
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

/// Take off uncalibrated, fly the calibration routine, restart, and fly on with the calibrated heading (the default).
///
/// The routine is flown or driven as by hand; those of all vehicles are listed below. The table compares heading errors
/// before and after the calibration at twelve headings in level flight and in turns, with exact field and true
/// attitude. The error of the headings streamed in flight, with noise and latency, is listed separately.
#[derive(Args)]
#[command(after_long_help = format!("Routines, none longer than three minutes; each ends automatically; `cal solve` ends it with the samples collected so far:\n\n{}", simulator::routine::all_instructions()))]
struct Fly {
    /// Seed of weather, ground, waves, noise and, for `random`, of airframe and place, 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = integer(0, u64::MAX))]
    seed: u64,
    /// Kind of aircraft: `plane`, `copter`, `vtol`, `rover` or `boat`; or an airframe as for --airframe, flown as an
    /// aeroplane
    #[arg(long, default_value = "plane", value_name = "plane|copter|vtol|rover|boat")]
    aircraft: String,
    /// Airframe's hard and soft iron: `table1` (the UAV of Liu 2007, table 1), `random` (drawn from the seed), or an
    /// airframe file such as host-sim/airframes/example.toml [default: table1]
    #[arg(long, value_name = "table1|random|FILE")]
    airframe: Option<String>,
    /// Motor-current interference in hover, level flight or on level ground, microtesla, 0 to 200; it follows the
    /// motors' current
    #[arg(long, default_value_t = 0.0, value_name = "UT", value_parser = number(0.0, 200.0))]
    current: f64,
    /// Let the autopilot measure and report that current
    #[arg(long)]
    tell_current: bool,
    /// Bank in an aeroplane's calibration turns, degrees, 5 to 60
    #[arg(long, default_value_t = 25.0, value_name = "DEG", value_parser = number(5.0, 60.0))]
    bank: f64,
    /// An aeroplane's full circles each way, 0 to 100
    #[arg(long, default_value_t = 4.0, value_name = "N", value_parser = number(0.0, 100.0))]
    circles: f64,
    /// Write the report page: a folder for its index.html, or a file (.html; .svg: only the before-and-after picture)
    /// [default: report; none with --json]
    #[arg(long, value_name = "DIR|FILE")]
    report: Option<PathBuf>,
    /// Write a log as the autopilot would, raw field, ten rows a second: by the file's extension of ArduPilot (.bin,
    /// .log), PX4 (.ulg) or MAVLink (.tlog), else a table; `replay` reads all of them
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
    /// Show the console session as the pilot sees it
    #[arg(long)]
    console: bool,
}

/// Fly the mission with the firmware as ARM code, in QEMU.
///
/// QEMU's mps2-an386 is a Cortex-M4F with QEMU's own magnetometer.
///
/// Needs qemu-system-arm and the image from scripts/build-firmware. World and machine run in lockstep, so the result
/// depends on the seed only, except for a microsecond at a restart. It takes a minute or two.
#[derive(Args)]
struct Emulate {
    #[command(flatten)]
    fly: Fly,
    /// Firmware image [default: target/firmware/mps2-an386.elf]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
}

/// Instruction counts on a Cortex-M4 against their limits, measured in QEMU.
///
/// Needs qemu-system-arm and the bench image from scripts/build-firmware. Exit code 1 if a limit is exceeded.
#[derive(Args)]
struct Budget {
    /// Bench image [default: target/firmware/mps2-an386-bench.elf]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
}

fn airframe_json(world: &WorldConfig) -> Value {
    let AirframeDescription { soft_iron, hard_iron_ut, mounting_deg } = AirframeDescription::from(&world.airframe);
    json!({
        "soft_iron": soft_iron.map(|row| row.map(|number| round_to(number, 4))),
        "hard_iron_ut": hard_iron_ut,
        "mounting_deg": mounting_deg,
        "total_ut": world.earth.total_ut,
        "inclination_deg": world.earth.inclination_deg,
    })
}

/// Progress bar on the error output, if that is a terminal.
fn progress(words: &str, total: u64) -> ProgressBar {
    let bar = ProgressBar::new(total);
    if let Ok(style) = ProgressStyle::with_template(&format!("{words} {{bar:40}} {{pos}}/{{len}} {{eta}}")) {
        bar.set_style(style);
    }
    bar
}

/// Spinner for a task of unknown duration.
fn waiting(words: &'static str) -> ProgressBar {
    let bar = ProgressBar::new_spinner().with_message(words);
    bar.enable_steady_tick(std::time::Duration::from_millis(100));
    bar
}

pub fn run() -> ExitCode {
    let cli = Cli::parse();
    let command = cli.command.unwrap_or(Command::Fly(cli.fly));
    print::final_exit_code(carry_out(&command).unwrap_or_else(|Failure(message)| {
        print::print_error(format_args!("host-sim: {message}"));
        ExitCode::from(2)
    }))
}

fn carry_out(command: &Command) -> Result<ExitCode, Failure> {
    match command {
        // These commands need clean-up.
        Command::Emulate(_) | Command::Serve(_) | Command::Console(_) | Command::Bench(Bench::Budget(_)) => {}
        _ => TerminationSignals::exit_immediately()?,
    }
    match command {
        Command::Fly(options) => fly::run(options),
        Command::Emulate(options) => fly::emulate(options),
        Command::Serve(options) => serve::serve(options),
        Command::Console(options) => serve::console(options),
        Command::Table1(options) => table1::run(options),
        Command::Replay(options) => replay::run(options),
        Command::Bench(Bench::Accuracy(options)) => accuracy::run(options),
        Command::Bench(Bench::Budget(options)) => bench::budget(options),
        Command::Bench(Bench::Integrity(options)) => integrity::run(options),
        Command::Bench(Bench::Speed(options)) => bench::speed(options),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::print::WIDTH;
    use super::*;

    /// All commands with their full name, such as `bench speed`.
    fn commands() -> Vec<(Vec<String>, clap::Command)> {
        let mut cli = Cli::command();
        cli.build();
        let mut found = vec![(vec![], cli)];
        let mut at = 0;
        while at < found.len() {
            let (name, command) = found[at].clone();
            found.extend(command.get_subcommands().filter(|command| command.get_name() != "help").map(|command| {
                let name = name.iter().cloned().chain([command.get_name().to_owned()]).collect();
                (name, command.clone())
            }));
            at += 1;
        }
        found
    }

    #[test]
    fn no_help_is_wider_than_a_terminal() {
        let commands = commands();
        assert_eq!(commands.len(), 12, "itself, bench, and ten that do something");
        for (name, mut command) in commands {
            for help in [command.render_help(), command.render_long_help()] {
                for line in help.to_string().lines() {
                    assert!(line.chars().count() <= WIDTH, "{name:?}: {line}");
                }
            }
        }
    }

    /// The last range `MIN to MAX` in a text.
    fn range(text: &str) -> Option<(String, String)> {
        let is_number_char = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
        let (before, after) = text.rsplit_once(" to ")?;
        let min = before.rsplit(|c| !is_number_char(c)).next()?;
        let max = after.split(|c| !is_number_char(c)).next()?;
        (!min.is_empty() && !max.is_empty()).then(|| (min.to_owned(), max.to_owned()))
    }

    fn parse_error(name: &[String], option: &str, value: &str, takes_a_file: bool) -> Option<String> {
        let whole = format!("--{option}={value}");
        let file = takes_a_file.then(|| "log.csv".to_owned());
        let words = ["host-sim".to_owned()].into_iter().chain(name.iter().cloned()).chain([whole]).chain(file);
        Cli::try_parse_from(words).err().map(|error| error.to_string().split_whitespace().collect::<Vec<_>>().join(" "))
    }

    /// The ends of the range in the help are accepted, values beyond are refused, and the error message has the same range.
    #[test]
    fn every_number_has_its_range_in_help_and_error_message() {
        let numbers = ["N", "DEG", "UT", "MINUTES", "MS", "SECONDS", "PORT"];
        let mut seen = 0;
        for (name, command) in commands() {
            let takes_a_file = name == ["replay"];
            for option in command.get_arguments() {
                let is_number = option.get_value_names().is_some_and(|of| numbers.contains(&of[0].as_str()));
                let Some(long) = option.get_long().filter(|_| is_number) else { continue };
                let help = option.get_long_help().or(option.get_help()).map(ToString::to_string).unwrap_or_default();
                // A help text may have two ranges; the first is the number's.
                let (min, max) = help
                    .match_indices(" to ")
                    .find_map(|(at, _)| range(&help[..help.len().min(at + 4 + 24)]))
                    .unwrap_or_else(|| panic!("{name:?} --{long} has no range: {help}"));
                let beyond = |end: &str, by: i128| {
                    end.parse::<i128>().map_or_else(|_| "-1".to_owned(), |end| (end + by).to_string())
                };
                for good in [&min, &max] {
                    assert_eq!(parse_error(&name, long, good, takes_a_file), None, "{name:?} --{long} {good}");
                }
                for bad in [beyond(&min, -1), beyond(&max, 1), "x".to_owned(), "nan".to_owned(), String::new()] {
                    let error = parse_error(&name, long, &bad, takes_a_file)
                        .unwrap_or_else(|| panic!("{name:?} --{long} {bad}"));
                    assert!(error.contains(&format!(", {min} to {max}")), "{name:?} --{long} {bad}: {error}");
                }
                seen += 1;
            }
        }
        assert!(seen >= 25, "{seen}");
    }

    /// Existing files that the help names, by their path from the repository's root.
    #[test]
    fn paths_in_the_help_exist_in_the_repository() {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let mut seen = 0;
        for (_, mut command) in commands() {
            let help = command.render_long_help().to_string();
            let is_path_char = |c: char| c.is_ascii_alphanumeric() || "/._-".contains(c);
            for word in help.split(|c| !is_path_char(c)).map(|word| word.trim_end_matches('.')) {
                let is_generated = word.starts_with("target/");
                let is_file = [".toml", ".csv", ".md", ".sh"].iter().any(|end| word.ends_with(end));
                if word.contains('/') && !is_generated && (is_file || word.starts_with("scripts/")) {
                    assert!(root.join(word).is_file(), "{word}");
                    seen += 1;
                }
            }
        }
        assert!(seen >= 8, "{seen}");
    }
}
