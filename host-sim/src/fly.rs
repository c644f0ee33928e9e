//! `host-sim fly`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use autoswing::attitude::AttitudeSource;
use clap::Args;
use comfy_table::Table;
use indicatif::{ProgressBar, ProgressStyle};
use log_analysis::log::log_writers::{self, FlightRecording};
use log_analysis::report::ReportOrigin;
use log_analysis::score::ErrorStatistics;
use simulator::devices::sensor::SensorModel;
use simulator::heading_errors::HeadingErrors;
use simulator::mission::{self, MissionResult, MissionStep, OutputStatistics, TurnPlan};
use simulator::mission_report::{mission_json, report_mission};
use simulator::module::Module;
use simulator::recording::Recorder;
use simulator::rig::Rig;
use simulator::transcript::Refusal;
use simulator::world::WorldConfig;
use simulator::world::aircraft::VehicleKind;

use crate::command_failure::CommandFailure;
use crate::file_options::named_world;
use crate::option_parsers::{integer_in_range, named_value, number_in_range, one_of};
use crate::print::{self, append_wrapped, command_line, content_width_table, right_aligned, write_report};

/// Fly a simulated aircraft that calibrates the module.
///
/// It takes off uncalibrated, flies the calibration routine, restarts, and flies on with the calibrated heading.
/// The routine is flown or driven as by hand; those of all vehicles are listed below. The table compares heading errors
/// before and after the calibration at twelve headings in level flight and in turns, with exact field and true
/// attitude. The error of the headings streamed in flight, with noise and latency, is listed separately.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, after_long_help = format!("{EXAMPLES}\n\nRoutines, none longer than three and a half minutes; each ends automatically; `cal solve` ends it with the samples collected so far:\n\n{}", simulator::routine::all_instructions()))]
pub struct FlyOptions {
    /// Seed of weather, ground, waves, noise and, for `random`, of airframe and place, 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = integer_in_range(0, u64::MAX))]
    seed: u64,
    /// Kind of aircraft: `plane`, `copter`, `vtol`, `rover`, `boat` or `hand`; or an airframe as for --airframe [default: the kind
    /// in the airframe file, else plane]
    #[arg(long, value_name = "plane|copter|vtol|rover|boat|hand")]
    aircraft: Option<String>,
    /// Airframe's hard and soft iron: `table1` (the UAV of Liu 2007, table 1), `random` (drawn from the seed), or an
    /// airframe file such as host-sim/airframes/example.toml [default: table1]
    #[arg(long, value_name = "table1|random|FILE")]
    airframe: Option<String>,
    /// Motor-current interference in hover, level flight or on level ground, microtesla, 0 to 200; it follows the
    /// motors' current
    #[arg(long, default_value_t = 0.0, value_name = "UT", value_parser = number_in_range(0.0, 200.0))]
    current: f64,
    /// Let the autopilot measure and report the motors' current
    #[arg(long)]
    tell_current: bool,
    /// Magnetometer of the module: the reference board's LIS3MDL, or an RM3100
    #[arg(long, default_value = "lis3mdl", value_name = "lis3mdl|rm3100", value_parser = one_of::<SensorModel>("lis3mdl|rm3100"))]
    pub sensor: SensorModel,
    /// Roll and pitch: of the autopilot; own, of the module's gyro and accelerometer, without any autopilot; or auto, the
    /// autopilot's with the rates of the module's gyro
    #[arg(long, default_value = "autopilot", value_name = "autopilot|own|auto", value_parser = named_value(&AttitudeSource::NAMED_SOURCES))]
    attitude: AttitudeSource,
    /// Bank in an aeroplane's calibration turns, degrees, 5 to 60
    #[arg(long, default_value_t = 25.0, value_name = "DEG", value_parser = number_in_range(5.0, 60.0))]
    bank: f64,
    /// An aeroplane's full circles each way, 0 to 100
    #[arg(long, default_value_t = 4.0, value_name = "N", value_parser = number_in_range(0.0, 100.0))]
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

const EXAMPLES: &str = "Examples:
  host-sim fly                                      a page in report/index.html
  host-sim fly --aircraft copter --seed 3           another vehicle, other weather
  host-sim fly --aircraft boat --attitude own       without any autopilot
  host-sim fly --record flight.ulg                  a log to replay";

const DEFAULT_AIRFRAME: &str = "table1";

const DEFAULT_REPORT: &str = "report";

/// Flies the mission of the options in the simulator.
///
/// # Errors
///
/// The airframe is unknown, or a file cannot be written.
pub fn run_fly(options: &FlyOptions) -> Result<ExitCode, CommandFailure> {
    RecordedMission::fly(&mut Rig::new(options.world_config()?), options).report(options)
}

impl FlyOptions {
    /// The world of the options. `--aircraft` names a kind of aircraft, which replaces that of the file, or an airframe.
    ///
    /// # Errors
    ///
    /// The airframe is unknown, or its file cannot be read.
    pub fn world_config(&self) -> Result<WorldConfig, CommandFailure> {
        let named = |name: &str| named_world(name, self.seed);
        let airframe_name = self.airframe.as_deref();
        let world = match &self.aircraft {
            None => named(airframe_name.unwrap_or(DEFAULT_AIRFRAME))?,
            Some(aircraft) => match (VehicleKind::from_name(aircraft), airframe_name) {
                (Some(kind), _) => named(airframe_name.unwrap_or(DEFAULT_AIRFRAME))?.with_vehicle_kind(kind),
                (None, None) => named(aircraft)?,
                (None, Some(_)) => {
                    let kinds = VehicleKind::ALL_VEHICLES.map(VehicleKind::vehicle_name).join(", ");
                    return Err(CommandFailure(format!("--aircraft {aircraft}: with --airframe it is one of {kinds}")));
                }
            },
        };
        let world = if self.current > 0.0 { world.with_current_interference(self.current) } else { world };
        Ok(WorldConfig { reports_current: self.tell_current, sensor: self.sensor, attitude: self.attitude, ..world })
    }

    fn is_airframe_random(&self) -> bool {
        self.airframe.as_ref().or(self.aircraft.as_ref()).is_some_and(|name| name == "random")
    }
}

/// Result of a mission, with its recording if a log was requested.
#[derive(Debug)]
pub struct RecordedMission {
    result: MissionResult,
    recording: Option<FlightRecording>,
}

impl RecordedMission {
    /// Flies the mission of the options with a module.
    pub fn fly(module: &mut impl Module, options: &FlyOptions) -> Self {
        let mut recorder = options.record.is_some().then(|| Recorder::new(module));
        let result = fly_mission(module, options, recorder.as_mut());
        Self { result, recording: recorder.map(|recorder| recorder.recording) }
    }

    /// Prints the result, and writes log and report page as the options have it.
    ///
    /// # Errors
    ///
    /// A file cannot be written.
    pub fn report(&self, options: &FlyOptions) -> Result<ExitCode, CommandFailure> {
        if let (Some(path), Some(recording)) = (&options.record, &self.recording) {
            write_log(path, recording)?;
        }
        if options.json {
            print::print_line(mission_json(&self.result));
        } else {
            print::print_text(&format_result(options, &self.result));
        }
        let default = (!options.json).then(|| Path::new(DEFAULT_REPORT));
        if let Some(path) = options.report.as_deref().or(default) {
            write_report(&report_mission(&self.result, &report_origin(options)), path)?;
        }
        Ok(if self.result.calibration_result.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
    }
}

fn report_origin(options: &FlyOptions) -> ReportOrigin {
    let setting = |name: &str, value: String| [name.to_owned(), value];
    let mut settings = vec![
        setting("aircraft", options.aircraft.clone().unwrap_or_else(|| "that of the airframe".to_owned())),
        setting("airframe", options.airframe.clone().unwrap_or_else(|| DEFAULT_AIRFRAME.to_owned())),
        setting("seed", options.seed.to_string()),
    ];
    if options.current > 0.0 {
        let reported = if options.tell_current { ", reported" } else { "" };
        settings.push(setting("motor-current interference", format!("{} uT{reported}", options.current)));
    }
    settings.push(setting("turns", format!("{} circles each way, {} deg of bank", options.circles, options.bank)));
    ReportOrigin { command_line: command_line(), settings }
}

fn write_log(path: &Path, recording: &FlightRecording) -> Result<(), CommandFailure> {
    std::fs::write(path, log_writers::encode_for_path(path, recording)).map_err(|error| {
        CommandFailure(format!("cannot write {}: {error}; --record names another file", path.display()))
    })
}

/// Flies with a progress bar for each stage, on the error output if that is a terminal.
fn fly_mission(module: &mut impl Module, options: &FlyOptions, mut recorder: Option<&mut Recorder>) -> MissionResult {
    const PROGRESS_TICKS: u64 = 1000;
    let mut current: Option<(&'static str, ProgressBar)> = None;
    let plan = TurnPlan { bank_deg: options.bank, circles_per_side: options.circles };
    let mission_result =
        mission::fly_mission_of_module(module, plan, &mut |&MissionStep { stage, done, world, now_us, .. }| {
            if let Some(recorder) = &mut recorder {
                recorder.record_until(now_us, world);
            }
            if current.as_ref().is_none_or(|(displayed_stage, _)| *displayed_stage != stage) {
                finish_stage_bar(current.take());
                let bar = ProgressBar::new(PROGRESS_TICKS).with_message(stage);
                if let Ok(style) = ProgressStyle::with_template("{msg:24} {bar:40} {percent:>3} %") {
                    bar.set_style(style);
                }
                current = Some((stage, bar));
            }
            if let Some((_, bar)) = &current {
                bar.set_position((done * PROGRESS_TICKS as f64) as u64);
            }
        });
    finish_stage_bar(current);
    mission_result
}

fn finish_stage_bar(current: Option<(&'static str, ProgressBar)>) {
    if let Some((_, bar)) = current {
        bar.finish();
    }
}

fn format_result(options: &FlyOptions, mission_result: &MissionResult) -> String {
    let mut text = String::new();
    if options.console {
        let session = mission_result.transcript.replace("\r\n", "\n").replace("\r\u{1b}[2K", "");
        let _ = writeln!(text, "{session}\n");
    }
    let _ = writeln!(
        text,
        "Heading error in degrees, indicated less true\n{}",
        errors_table(&mission_result.errors_before, &mission_result.errors_after)
    );
    match &mission_result.calibration_result {
        Ok(shown) => {
            append_wrapped(
                &mut text,
                "",
                &format!(
                    "calibrated by {}: expected error {:.2} deg rms, sigma {:.2} at the worst heading; actual {}",
                    shown.method,
                    shown.expected_rms_deg,
                    shown.expected_worst_deg,
                    errors_text(&mission_result.errors_after.statistics())
                ),
            );
            append_wrapped(
                &mut text,
                "",
                &format!("uncalibrated: {}", errors_text(&mission_result.errors_before.statistics())),
            );
        }
        Err(Refusal { code, explanation }) => {
            append_wrapped(&mut text, "", &format!("the module refused: {code}: {explanation}"));
        }
    }
    if let Some(streamed) = &mission_result.streamed_statistics {
        let OutputStatistics { headings, rms_deg, max_deg, within_percent: [one, two], .. } = streamed;
        append_wrapped(
            &mut text,
            "",
            &format!(
                "streamed after the restart: {headings} headings, {rms_deg:.2} deg rms, {max_deg:.2} at most (attitude noise \
                 and age included)"
            ),
        );
        append_wrapped(
            &mut text,
            "",
            &format!("within one and two of the sigmas sent with them: {one:.0} and {two:.0} %"),
        );
    }
    let _ = writeln!(text, "{:.0} s of flight, seed {}", mission_result.duration_s, mission_result.world.seed);
    if options.is_airframe_random() {
        let _ = write!(
            text,
            "the airframe of this seed, as a file for --airframe:\n\n{}",
            mission_result.world.airframe_toml()
        );
    }
    text
}

fn errors_text(statistics: &ErrorStatistics) -> String {
    format!("{:.2} rms, {:.2} at worst, {:.2} constant", statistics.rms_deg, statistics.max_deg, statistics.mean_deg)
}

fn errors_table(errors_before: &HeadingErrors, errors_after: &HeadingErrors) -> Table {
    let mut table = content_width_table([
        "heading",
        "before:\nlevel",
        "\nright 25",
        "\nleft 25",
        "after:\nlevel",
        "\nright 25",
        "\nleft 25",
    ]);
    for step in 0..12 {
        let errors =
            errors_before.0.iter().chain(&errors_after.0).map(|bank| right_aligned(format!("{:.2}", bank[step])));
        table.add_row(std::iter::once(right_aligned(format!("{}", step * 30))).chain(errors));
    }
    table
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    #[derive(Debug, clap::Parser)]
    struct FlyCommand {
        #[command(flatten)]
        fly: FlyOptions,
    }

    fn world_of_arguments(arguments: &[&str]) -> Result<WorldConfig, String> {
        let command = FlyCommand::try_parse_from(std::iter::once("fly").chain(arguments.iter().copied()));
        command.map_err(|error| error.to_string())?.fly.world_config().map_err(|CommandFailure(message)| message)
    }

    #[test]
    fn aircraft_option_accepts_vehicle_kinds_and_airframes() {
        assert_eq!(world_of_arguments(&[]), Ok(WorldConfig::of_table1(1)));
        assert_eq!(world_of_arguments(&["--aircraft", "random", "--seed", "7"]), Ok(WorldConfig::random_world(7)));
        assert_eq!(world_of_arguments(&["--airframe", "random", "--seed", "7"]), Ok(WorldConfig::random_world(7)));
        for vehicle_kind in VehicleKind::ALL_VEHICLES {
            assert_eq!(
                world_of_arguments(&["--aircraft", vehicle_kind.vehicle_name()]),
                Ok(WorldConfig::of_table1(1).with_vehicle_kind(vehicle_kind))
            );
            let random =
                world_of_arguments(&["--aircraft", vehicle_kind.vehicle_name(), "--airframe", "random", "--seed", "3"]);
            assert_eq!(random, Ok(WorldConfig::random_world(3).with_vehicle_kind(vehicle_kind)));
        }
        let file = std::env::temp_dir().join(format!("autoswing-boat-{}.toml", std::process::id()));
        let example = include_str!("../airframes/example.toml");
        std::fs::write(&file, example.replace("kind = \"plane\"", "kind = \"boat\"")).unwrap();
        let kinds = [&[][..], &["--aircraft", "rover"]].map(|arguments| {
            let arguments = [&["--airframe", file.to_str().unwrap()], arguments].concat();
            world_of_arguments(&arguments).map(|world| world.aircraft.kind)
        });
        std::fs::remove_file(&file).unwrap();
        assert_eq!(kinds, [Ok(VehicleKind::Boat), Ok(VehicleKind::Rover)]);
        let current = world_of_arguments(&["--aircraft", "copter", "--current", "12"]);
        assert_eq!(
            current,
            Ok(WorldConfig::of_table1(1).with_vehicle_kind(VehicleKind::Copter).with_current_interference(12.0))
        );
    }

    #[test]
    fn an_unknown_aircraft_is_rejected_with_the_known_ones() {
        let conflict = world_of_arguments(&["--aircraft", "random", "--airframe", "table1"]).unwrap_err();
        assert!(conflict.contains("plane, copter, vtol, rover, boat"), "{conflict}");
        let unknown = world_of_arguments(&["--aircraft", "zeppelin"]).unwrap_err();
        assert!(
            unknown.starts_with("airframe-unreadable: zeppelin: ")
                && unknown.contains("`copter`")
                && unknown.contains("`table1`"),
            "{unknown}"
        );
        assert!(
            world_of_arguments(&["--current", "-1"]).is_err() && world_of_arguments(&["--current", "201"]).is_err()
        );
    }
}
