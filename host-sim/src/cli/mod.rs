//! Commands, their options, and how they end.

mod fly;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

/// Flies the firmware of the Autoswing heading module in a simulated aircraft.
///
/// Everything runs in virtual time and is a function of the seed: the same command prints the same bytes.
/// Exit codes: 0 calibrated, 1 the module refused, 2 the command was wrong.
#[derive(Parser)]
#[command(version, about, long_about, args_conflicts_with_subcommands = true)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    fly: Fly,
}

#[derive(Subcommand)]
enum Command {
    /// Take off uncalibrated, fly left and right turns, calibrate, restart, fly on with a right heading (the default)
    Fly(Fly),
}

/// Take off uncalibrated, fly left and right turns, calibrate, restart, fly on with a right heading.
///
/// The table compares heading errors before and after the calibration at twelve headings in level flight and in turns,
/// with exact field and true attitude. The error of the streamed headings in flight, with noise and age, is shown apart.
#[derive(Args)]
struct Fly {
    /// Seed of weather, noise and, for `random`, of the airframe and the place
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// Iron of the airframe: `table1` (the UAV of Liu 2007, table 1), `random` (drawn from the seed), or an airframe
    /// file such as host-sim/airframes/example.toml
    #[arg(long, default_value = "table1", value_name = "table1|random|FILE")]
    aircraft: String,
    /// Bank in the calibration turns, degrees
    #[arg(long, default_value_t = 25.0, value_name = "DEG", value_parser = bank)]
    bank: f64,
    /// Full circles each way
    #[arg(long, default_value_t = 4.0, value_name = "N", value_parser = circles)]
    circles: f64,
    /// Folder for the pictures and the page of the mission [default: report; none with --json]
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
    /// Show the console session, as the pilot saw it
    #[arg(long)]
    console: bool,
}

fn bank(text: &str) -> Result<f64, String> {
    within(text, 5.0, 60.0)
}

fn circles(text: &str) -> Result<f64, String> {
    within(text, 0.0, 100.0)
}

fn within(text: &str, min: f64, max: f64) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (min..=max).contains(&value) { Ok(value) } else { Err(format!("must lie in {min} to {max}")) }
}

/// Why a command could not be carried out at all; exit code 2.
struct Failure(String);

/// Reads the command line and carries it out.
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    let Command::Fly(options) = cli.command.unwrap_or(Command::Fly(cli.fly));
    match fly::run(&options) {
        Ok(code) => code,
        Err(Failure(why)) => {
            eprintln!("host-sim: {why}");
            ExitCode::from(2)
        }
    }
}
