//! The commands of `lab`.

mod accuracy;
mod bench;
mod emulate;
mod imu;
mod integrity;
mod serve;
mod table1;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use host_sim::command_failure::CommandFailure;
use host_sim::termination::TerminationSignals;
use host_sim::{commands, print};

/// The laboratory of the Autoswing heading module: serve it to other programs, emulate its firmware, measure it.
///
/// It has the commands of `host-sim`, too.
///
/// Everything but `serve` runs in virtual time and depends on the seed only: the same command prints the same bytes.
/// `serve` follows the wall clock and its inputs. Exit codes: 0 done, 1 refused or beyond a
/// limit, 2 wrong command; 130 ended by Ctrl-C, 141 the reader closed the pipe. docs/json.md describes the output of
/// --json.
#[derive(Debug, Parser)]
#[command(name = "lab", version = commands::VERSION, max_term_width = print::MAX_OUTPUT_COLUMNS)]
pub struct Cli {
    #[command(subcommand)]
    command: LabCommand,
    #[command(flatten)]
    color: commands::ColorOption,
}

/// In place of the examples of `fly`, whose options it has.
const EMULATE_EXAMPLE: &str = "Example: lab emulate --aircraft copter";

// No doc comments on these variants: they would replace the commands' own long help.
#[derive(Debug, Subcommand)]
enum LabCommand {
    #[command(flatten)]
    Pilot(commands::CliCommand),
    Serve(serve::ServeCommandOptions),
    #[command(after_help = EMULATE_EXAMPLE, after_long_help = EMULATE_EXAMPLE)]
    Emulate(emulate::EmulateOptions),
    Table1(table1::Table1Options),
    /// Measure accuracy or speed
    #[command(subcommand)]
    Bench(BenchCommand),
}

#[derive(Debug, Subcommand)]
enum BenchCommand {
    Accuracy(accuracy::AccuracyOptions),
    Imu(imu::ImuOptions),
    Integrity(integrity::IntegrityOptions),
    Speed(bench::SpeedOptions),
    Budget(bench::BudgetOptions),
}

/// Parses the command line, runs the command, and returns its exit code.
#[must_use]
pub fn run_program() -> ExitCode {
    let cli: Cli = commands::parse_command_line();
    cli.color.apply();
    commands::final_exit_code(execute_command(&cli.command))
}

fn execute_command(command: &LabCommand) -> Result<ExitCode, CommandFailure> {
    match command {
        // Commands that clean up after a termination signal.
        LabCommand::Emulate(_) | LabCommand::Serve(_) | LabCommand::Bench(BenchCommand::Budget(_)) => {}
        _ => TerminationSignals::install_immediate_exit()?,
    }
    match command {
        LabCommand::Pilot(command) => command.execute(),
        LabCommand::Serve(options) => serve::run_serve(options),
        LabCommand::Emulate(options) => emulate::run_emulate(options),
        LabCommand::Table1(options) => table1::run_table1(options),
        LabCommand::Bench(BenchCommand::Accuracy(options)) => accuracy::run_accuracy(options),
        LabCommand::Bench(BenchCommand::Imu(options)) => imu::run_imu(options),
        LabCommand::Bench(BenchCommand::Budget(options)) => bench::run_instruction_budget(options),
        LabCommand::Bench(BenchCommand::Integrity(options)) => integrity::run_integrity(options),
        LabCommand::Bench(BenchCommand::Speed(options)) => bench::run_speed(options),
    }
}

#[cfg(test)]
#[path = "../../../src/help_tests.rs"]
mod help_tests;
