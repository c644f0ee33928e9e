//! The commands of `host-sim`, and exit codes.

use std::path::Path;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::command_failure::CommandFailure;
use crate::termination::TerminationSignals;
use crate::{fly, print, replay, several_logs};

/// The version; with its commit if a script of this repository built the program (`scripts/foreign-target.sh`).
pub const VERSION: &str = match option_env!("AUTOSWING_VERSION") {
    Some(version) => version,
    None => env!("CARGO_PKG_VERSION"),
};

/// Fly the firmware of the Autoswing heading module in a simulated aircraft, or judge the compasses of a log.
///
/// Everything runs in virtual time and depends on the seed only: the same command prints the same bytes. Exit codes: 0
/// calibrated, 1 the module refused, 2 wrong command; 130 ended by Ctrl-C, 141 the reader closed the pipe. docs/json.md
/// describes the output of --json. The program `lab` serves the module to other programs, emulates its firmware, and
/// measures: docs/simulator.md.
#[derive(Debug, Parser)]
#[command(name = "host-sim", version = VERSION, about, long_about, args_conflicts_with_subcommands = true, max_term_width = print::MAX_OUTPUT_COLUMNS)]
pub struct Cli {
    #[command(subcommand)]
    command: Option<CliCommand>,
    #[command(flatten)]
    pub(crate) fly: fly::FlyOptions,
}

// No doc comments on these variants: they would replace the commands' own long help.
/// A command of `host-sim`.
#[derive(Debug, Subcommand)]
pub enum CliCommand {
    #[expect(missing_docs, reason = "a doc comment would replace the command's long help")]
    Fly(fly::FlyOptions),
    #[expect(missing_docs, reason = "a doc comment would replace the command's long help")]
    Replay(replay::ReplayArguments),
}

impl CliCommand {
    /// Runs the command.
    ///
    /// # Errors
    ///
    /// An option or a file has no meaning, or a file cannot be written.
    pub fn execute(&self) -> Result<ExitCode, CommandFailure> {
        match self {
            Self::Fly(options) => fly::run_fly(options),
            Self::Replay(options) => match options.files.as_slice() {
                [file] if !file.is_dir() => replay::run_replay(file, options),
                _ => several_logs::replay_several_logs(options),
            },
        }
    }
}

/// Parses the command line, runs the command, and returns its exit code.
#[must_use]
pub fn run_program() -> ExitCode {
    let cli: Cli = parse_command_line();
    let command = cli.command.unwrap_or(CliCommand::Fly(cli.fly));
    final_exit_code(TerminationSignals::install_immediate_exit().and_then(|()| command.execute()))
}

/// The parsed command line; ends the program if it is wrong.
#[must_use]
pub fn parse_command_line<P: Parser>() -> P {
    P::try_parse().unwrap_or_else(|error| {
        if let Some(log) = std::env::args().nth(1).filter(|word| several_logs::is_log(Path::new(word))) {
            let program = print::program_name();
            print::print_error(format_args!("{program}: {log} is a log; to evaluate it: {program} replay {log}"));
            std::process::exit(2)
        }
        error.exit()
    })
}

/// Exit code of a command; prints why it failed.
#[must_use]
pub fn final_exit_code(result: Result<ExitCode, CommandFailure>) -> ExitCode {
    print::final_exit_code(result.unwrap_or_else(|CommandFailure(message)| {
        print::print_error(format_args!("{}: {message}", print::program_name()));
        ExitCode::from(2)
    }))
}

#[cfg(test)]
#[path = "help_tests.rs"]
mod help_tests;
