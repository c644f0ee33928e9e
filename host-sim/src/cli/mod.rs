//! Commands, their options, and how they end.

mod accuracy;
mod bench;
mod fly;
mod integrity;
mod interruption;
mod print;
mod range;
mod replay;
mod serve;
mod table1;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand, ValueEnum};
use host_sim::integrity::Source;
use host_sim::world::WorldConfig;
use host_sim::world::airframe::Description;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};

use interruption::Interruption;
use range::{
    age, airframes, any, bank, circles, compass, current, draws, flights, inclination, minutes, seconds, system,
};

/// Flies the firmware of the Autoswing heading module in a simulated aircraft.
///
/// Everything runs in virtual time and is a function of the seed: the same command prints the same bytes. Only `serve` and
/// `console` go with the clock on the wall, and with what comes in.
/// Exit codes: 0 calibrated, 1 the module refused, 2 the command was wrong; 130 ended by Ctrl-C, 141 nobody reads what is
/// printed. What --json prints is described in docs/json.md.
#[derive(Parser)]
#[command(version, about, long_about, args_conflicts_with_subcommands = true, term_width = print::WIDTH)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    fly: Fly,
}

// What each does is said where its options are: here it would hide all but the first line of that.
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
/// The airframe is the one fitted to the published errors. It stands at pitch zero, tilted 20 deg to either side, as in
/// the paper's experiment: at twelve headings without noise, and at 256 with a LIS3MDL's.
#[derive(Args)]
struct Table1 {
    /// Seed of the sensor's noise: 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = any)]
    seed: u64,
    /// Print one JSON object instead of the tables
    #[arg(long)]
    json: bool,
}

/// Random airframes: heading error of each method over the Cramer-Rao bound, and whether sigma is true.
///
/// Soft iron to 30 %, hard iron to 3 times the horizontal field, mounting to 20 deg, inclination -70 to 75 deg, turns
/// at 15 to 45 deg of bank that wander by 2 deg, 192 samples a side, sensor noise 0.3 to 1 %, attitude noise 0.2 to 1
/// deg. The bound has heading, roll and pitch of every sample among its unknowns. 500 airframes take about two minutes.
///
/// Of a copter or a VTOL, or with --pattern or --minutes, whole flights are flown, ten samples a second, of which the module
/// keeps what it can; the attitude noise grows by 0.4 deg for each m/s^2 of acceleration. The bound is then that of as many
/// readings, the best of the flight, chosen afterwards (greedy, D-optimal); the errors are those level and at 20 deg of
/// tilt to eight sides, of an aeroplane level and at 30 deg of bank.
#[derive(Args)]
struct Accuracy {
    /// What flies
    #[arg(long, value_enum, default_value = "plane", value_name = "plane|copter|vtol")]
    aircraft: AircraftArgument,
    /// What is flown, or these, one row each [default: all three; of an aeroplane turns alone, all of them solved]
    #[arg(long = "pattern", value_enum, value_name = "routine|mirrored|wandering")]
    patterns: Vec<PatternArgument>,
    /// How long a flight is, minutes, 1 to 120 [default: 3]
    #[arg(long, value_name = "MINUTES", value_parser = minutes)]
    minutes: Option<f64>,
    /// Airframes, 1 to 1000000
    #[arg(long, default_value_t = 500, value_name = "N", value_parser = airframes)]
    airframes: u64,
    /// Draws of the noise for each airframe, 1 to 100000
    #[arg(long, default_value_t = 60, value_name = "N", value_parser = draws)]
    draws: u64,
    /// Seed of the first airframe; the others follow: 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = any)]
    seed: u64,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
}

/// What flies in a study.
#[derive(Clone, Copy, ValueEnum)]
enum AircraftArgument {
    Plane,
    Copter,
    Vtol,
}

impl From<AircraftArgument> for host_sim::world::aircraft::Kind {
    fn from(argument: AircraftArgument) -> Self {
        match argument {
            AircraftArgument::Plane => Self::Plane,
            AircraftArgument::Copter => Self::Copter,
            AircraftArgument::Vtol => Self::Vtol,
        }
    }
}

/// What is flown in a study.
#[derive(Clone, Copy, ValueEnum)]
enum PatternArgument {
    Routine,
    Mirrored,
    Wandering,
}

impl From<PatternArgument> for host_sim::accuracy::flight::Pattern {
    fn from(argument: PatternArgument) -> Self {
        match argument {
            PatternArgument::Routine => Self::Routine,
            PatternArgument::Mirrored => Self::Mirrored,
            PatternArgument::Wandering => Self::Wandering,
        }
    }
}

/// Faults in flight and while calibrating: how much of what is sent as good is not.
///
/// Random airframes at random places calibrate and fly on for three minutes with the firmware's own tasks; something is
/// wrong with the sensor, the attitude source, the airframe's iron or the place. A heading is bad when its error is
/// more than four of the sigmas sent with it and more than 5 deg. A calibration is wrong when its true error is more
/// than three times the one it expects. An alarm is a period without headings that begins while nothing is wrong. 100
/// flights of every case take some five minutes on two cores.
#[derive(Args)]
struct Integrity {
    /// What flies: a copter or a VTOL calibrates by its routine, and is turned and pushed about in hover
    #[arg(long, value_enum, default_value = "plane", value_name = "plane|copter|vtol")]
    aircraft: AircraftArgument,
    /// Flights of each case, 1 to 100000; of the flight of ten hours one
    #[arg(long, default_value_t = 100, value_name = "N", value_parser = flights)]
    flights: u64,
    /// Seed of the first flight; the others follow: 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = any)]
    seed: u64,
    /// Only this case, or these; `list` shows them
    #[arg(long = "case", value_name = "NAME")]
    cases: Vec<String>,
    /// What the attitude comes by
    #[arg(long, value_enum, default_value = "mavlink", value_name = "mavlink|msp")]
    source: SourceArgument,
    /// Which heading is sent: the raw one, or the smooth one where there is one
    #[arg(long, value_enum, default_value = "smooth", value_name = "raw|smooth")]
    heading: HeadingArgument,
    /// Print a JSON list of one object a case instead of the table
    #[arg(long)]
    json: bool,
}

/// Which heading is sent.
#[derive(Clone, Copy, ValueEnum)]
enum HeadingArgument {
    Raw,
    Smooth,
}

impl From<HeadingArgument> for autoswing::settings::HeadingKind {
    fn from(argument: HeadingArgument) -> Self {
        match argument {
            HeadingArgument::Raw => Self::Raw,
            HeadingArgument::Smooth => Self::Smooth,
        }
    }
}

/// Protocols of attitude sources.
#[derive(Clone, Copy, ValueEnum)]
enum SourceArgument {
    /// With body rates
    Mavlink,
    /// Asked for, in tenths of a degree, without rates
    Msp,
}

impl From<SourceArgument> for Source {
    fn from(argument: SourceArgument) -> Self {
        match argument {
            SourceArgument::Mavlink => Self::Mavlink,
            SourceArgument::Msp => Self::Msp,
        }
    }
}

/// Time of a solve by each method, and simulated seconds a second of flight, on this machine
#[derive(Args)]
struct Speed {
    /// Print one JSON object instead of the text
    #[arg(long)]
    json: bool,
}

/// Judge the compasses of a flight from its log, and send each through the module's own collection and solver.
///
/// Logs of ArduPilot (DataFlash .bin or .log, MAVLink .tlog), of PX4 (.ulg), and tables are known by their content; `-` is
/// standard input. What the autopilot had applied to the field is undone, the age of the logged field is found from the
/// flight, and headings by the autopilot's own parameters, by a sphere, an ellipsoid and the module are compared with the
/// best heading that the log has. A simulator's own attitude (SIM, SIMSTATE) is used for that where there is one, and for
/// nothing else.
///
/// A table has values separated by comma, semicolon or tab, with names in the first line: t_s (seconds), mx, my, mz (raw
/// field; body axes forward, right, down), roll_deg, pitch_deg (right wing down, nose up positive). Optional: `use` (0 keeps
/// a row out), p_dps, q_dps, r_dps (body rates, deg/s, each the mean since the row before), yaw_ref_deg (to compare with),
/// yaw_deg (the autopilot's, from true north), current_a, lat_deg, lon_deg, height_m, speed_m_s and course_deg (over ground,
/// from true north), armed (0 or 1), and mx2, my2, mz2 of a second compass, up to the eighth. A line that cannot be read
/// costs that line.
///
/// Exit codes: 0 the module would calibrate with one of the compasses, 1 with none, 2 the file cannot be read.
#[derive(Args)]
struct Replay {
    /// The log; `-` is standard input
    file: PathBuf,
    /// Which rows the module is given: what it would have kept of whatever was flown (`flight`), until that is good enough;
    /// `all` usable ones, evenly thinned to what the device holds; or what its `turns` detector would have kept
    #[arg(long, value_enum, default_value = "flight", value_name = "flight|all|turns")]
    samples: SamplesArgument,
    /// Only this compass, 1 to 8, as the autopilot counts them
    #[arg(long, value_name = "N", value_parser = compass)]
    compass: Option<u8>,
    /// Of a MAVLink log with several vehicles this one, 1 to 255, by the number of its system; without it, the first that is
    /// heard
    #[arg(long, value_name = "N", value_parser = system)]
    system: Option<u8>,
    /// How old the logged field is at its time stamp, milliseconds, -200 to 500; without it, it is found from the flight
    #[arg(long, value_name = "MS", allow_negative_numbers = true, value_parser = age)]
    age: Option<f64>,
    /// Write the parameters of the compasses that would have calibrated
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Whose parameters [default: those of the autopilot that wrote the log, else ArduPilot's]
    #[arg(long, value_enum, value_name = "ardupilot|px4|inav")]
    params_for: Option<DialectArgument>,
    /// Unit of mx, my, mz in a table: milligauss or microtesla
    #[arg(long, value_enum, default_value = "mg", value_name = "mg|ut")]
    unit: UnitArgument,
    /// Inclination of the Earth field there, degrees, -90 to 90, positive down; without it, that of the field model where
    /// the log tells place and day, unless the samples contradict it, or else what they show
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = inclination)]
    inclination: Option<f64>,
    /// Fit only to rows before this time, seconds of the log, -1000000000 to 1000000000
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = seconds)]
    fit_until: Option<f64>,
    /// Write t_s,heading_deg,sigma_deg,status,smooth_deg,smooth_sigma_deg of every row of the first compass; the last two
    /// are empty where there is no smooth heading
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the page: a folder for its index.html, or a file (.html; a .svg gets the picture of before and after alone)
    #[arg(long, value_name = "DIR|FILE")]
    report: Option<PathBuf>,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum SamplesArgument {
    All,
    Turns,
    Flight,
}

impl From<SamplesArgument> for host_sim::replay::Selected {
    fn from(argument: SamplesArgument) -> Self {
        match argument {
            SamplesArgument::All => Self::All,
            SamplesArgument::Turns => Self::Turns,
            SamplesArgument::Flight => Self::Flight,
        }
    }
}

/// Whose parameters are written.
#[derive(Clone, Copy, ValueEnum)]
enum DialectArgument {
    Ardupilot,
    Px4,
    Inav,
}

impl From<DialectArgument> for host_sim::replay::parameters::Dialect {
    fn from(argument: DialectArgument) -> Self {
        match argument {
            DialectArgument::Ardupilot => Self::ArduPilot,
            DialectArgument::Px4 => Self::Px4,
            DialectArgument::Inav => Self::Inav,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum UnitArgument {
    Mg,
    Ut,
}

impl From<UnitArgument> for host_sim::log::csv::Unit {
    fn from(argument: UnitArgument) -> Self {
        match argument {
            UnitArgument::Mg => Self::Milligauss,
            UnitArgument::Ut => Self::Microtesla,
        }
    }
}

/// Take off uncalibrated, fly the calibration routine, restart, fly on with a right heading (the default).
///
/// The routine is what a person flies, drives or steers by hand with such a vehicle; all of them are listed below. The
/// table compares heading errors before and after the calibration at twelve headings in level flight and in turns, with
/// exact field and true attitude. The error of the streamed headings in flight, with noise and age, is shown apart.
#[derive(Args)]
#[command(after_long_help = format!("Routines, none longer than three minutes; each solves by itself, `cal solve` at its end takes what there is:\n\n{}", host_sim::routine::all_words()))]
struct Fly {
    /// Seed of weather, ground, waves, noise and, for `random`, of the airframe and the place: 0 to 18446744073709551615
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = any)]
    seed: u64,
    /// What flies: `plane`, `copter`, `vtol`, `rover` or `boat`; or an aeroplane with the iron that --airframe would name
    #[arg(long, default_value = "plane", value_name = "plane|copter|vtol|rover|boat")]
    aircraft: String,
    /// Iron of it: `table1` (the UAV of Liu 2007, table 1), `random` (drawn from the seed), or an airframe file such as
    /// host-sim/airframes/example.toml [default: table1]
    #[arg(long, value_name = "table1|random|FILE")]
    airframe: Option<String>,
    /// Iron by current: what the motors add in hover, in level flight or on the flat, microtesla, 0 to 200; it
    /// follows their current
    #[arg(long, default_value_t = 0.0, value_name = "UT", value_parser = current)]
    current: f64,
    /// The autopilot measures that current, and tells it
    #[arg(long)]
    tell_current: bool,
    /// Bank in an aeroplane's calibration turns, degrees, 5 to 60
    #[arg(long, default_value_t = 25.0, value_name = "DEG", value_parser = bank)]
    bank: f64,
    /// An aeroplane's full circles each way, 0 to 100
    #[arg(long, default_value_t = 4.0, value_name = "N", value_parser = circles)]
    circles: f64,
    /// The page of the mission: a folder for its index.html, or a file (.html; a .svg gets the picture of before and after
    /// alone) [default: report; none with --json]
    #[arg(long, value_name = "DIR|FILE")]
    report: Option<PathBuf>,
    /// Write what the autopilot would have logged, the field raw, ten rows a second: a table, or by the name's end a log of
    /// ArduPilot (.bin, .log), PX4 (.ulg) or MAVLink (.tlog); `replay` reads them all
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
    /// Show the console session, as the pilot saw it
    #[arg(long)]
    console: bool,
}

/// The same with the firmware as ARM code, in QEMU.
///
/// QEMU's mps2-an386 is a Cortex-M4F with QEMU's own magnetometer.
///
/// Needs qemu-system-arm, and the image that scripts/build-firmware makes. World and machine move in lockstep, so that
/// a run is a function of its seed here, too, but for a microsecond at a restart. It takes a minute or two.
#[derive(Args)]
struct Emulate {
    #[command(flatten)]
    fly: Fly,
    /// The firmware [default: target/firmware/mps2-an386.elf]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
}

/// Instructions of a Cortex-M4 against their limits, counted in QEMU.
///
/// Needs qemu-system-arm, and the bench image that scripts/build-firmware makes. Exit code 1 when a limit is broken.
#[derive(Args)]
struct Budget {
    /// The bench image [default: target/firmware/mps2-an386-bench.elf]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
}

/// Why a command could not be carried out at all; exit code 2.
struct Failure(String);

/// The world of an iron's name or airframe file.
fn iron(name: &str, seed: u64) -> Result<WorldConfig, Failure> {
    WorldConfig::named(name, seed).map_err(|error| Failure(format!("{}: {error}", error.code())))
}

/// What a person may want to know of iron and place.
fn iron_of(world: &WorldConfig) -> Value {
    let Description { soft_iron, hard_iron_ut, mounting_deg } = Description::from(&world.airframe);
    json!({
        "soft_iron": soft_iron.map(|row| row.map(|number| print::rounded(number, 4))),
        "hard_iron_ut": hard_iron_ut,
        "mounting_deg": mounting_deg,
        "total_ut": world.earth.total_ut,
        "inclination_deg": world.earth.inclination_deg,
    })
}

/// How far something is that takes long: on the error output, and only where that is a terminal.
fn progress(words: &str, of: u64) -> ProgressBar {
    let bar = ProgressBar::new(of);
    if let Ok(style) = ProgressStyle::with_template(&format!("{words} {{bar:40}} {{pos}}/{{len}} {{eta}}")) {
        bar.set_style(style);
    }
    bar
}

/// That something takes long, where nobody knows how far it is.
fn waiting(words: &'static str) -> ProgressBar {
    let bar = ProgressBar::new_spinner().with_message(words);
    bar.enable_steady_tick(std::time::Duration::from_millis(100));
    bar
}

/// Reads the command line and carries it out.
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    let command = cli.command.unwrap_or(Command::Fly(cli.fly));
    print::ending(carry_out(&command).unwrap_or_else(|Failure(why)| {
        print::complain(format_args!("host-sim: {why}"));
        ExitCode::from(2)
    }))
}

fn carry_out(command: &Command) -> Result<ExitCode, Failure> {
    match command {
        // These have something to clear away first.
        Command::Emulate(_) | Command::Serve(_) | Command::Console(_) | Command::Bench(Bench::Budget(_)) => {}
        _ => Interruption::ends()?,
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
mod tests;
