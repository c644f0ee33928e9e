//! The commands of `host-sim`, and exit codes.

use std::path::Path;
use std::process::ExitCode;

use clap::{Args, ColorChoice, CommandFactory as _, Parser, Subcommand};

use crate::command_failure::CommandFailure;
use crate::file_options::table_files;
use crate::termination::TerminationSignals;
use crate::{fly, print, replay, several_logs};

/// The version; with its commit if a script of this repository built the program (`scripts/foreign-target.sh`).
pub const VERSION: &str = match option_env!("AUTOSWING_VERSION") {
    Some(version) => version,
    None => env!("CARGO_PKG_VERSION"),
};

const EXAMPLES: &str = "Examples:
  host-sim replay flight.bin                         judge a log's compasses
  host-sim replay flight.bin --params compass.param  write parameters to load
  host-sim replay flight.bin --report flight.html    draw charts
  host-sim fly                                       fly a simulated aircraft
  host-sim help replay                               all options of a command";

/// Judge the compasses of flight logs, and fly the Autoswing module in simulation.
///
/// Everything runs in virtual time and depends on the log or the seed only: the same command prints the same bytes. Exit
/// codes: 0 good or calibrated, 1 not, 2 wrong command; 130 ended by Ctrl-C, 141 the reader closed the pipe. docs/json.md
/// describes the output of --json. The program `lab` serves the module to other programs, emulates its firmware, and
/// measures.
#[derive(Debug, Parser)]
#[command(name = "host-sim", version = VERSION, after_help = EXAMPLES, max_term_width = print::MAX_OUTPUT_COLUMNS)]
pub struct Cli {
    #[command(subcommand)]
    command: Option<CliCommand>,
    #[command(flatten)]
    color: ColorOption,
}

// A doc comment here would replace that of the program.
#[expect(missing_docs, reason = "a doc comment would replace the program's help")]
#[derive(Clone, Copy, Debug, Args)]
pub struct ColorOption {
    /// Colour of the output: auto, always or never
    #[arg(long, global = true, default_value = "auto", value_name = "WHEN", hide_possible_values = true)]
    color: ColorChoice,
}

impl ColorOption {
    /// Applies the choice to all later output.
    pub fn apply(self) {
        let choice = match self.color {
            ColorChoice::Auto => anstream::ColorChoice::Auto,
            ColorChoice::Always => anstream::ColorChoice::Always,
            ColorChoice::Never => anstream::ColorChoice::Never,
        };
        choice.write_global();
    }
}

// No doc comments on these variants: they would replace the commands' own long help.
/// A command of `host-sim`.
#[derive(Debug, Subcommand)]
pub enum CliCommand {
    #[expect(missing_docs, reason = "a doc comment would replace the command's long help")]
    Replay(replay::ReplayArguments),
    #[expect(missing_docs, reason = "a doc comment would replace the command's long help")]
    Fly(fly::FlyOptions),
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
                [file] if !file.is_dir() || !table_files(file).is_empty() => match replay::run_replay(file, options)? {
                    Some(exit_code) => Ok(exit_code),
                    None => several_logs::replay_several_logs(options),
                },
                _ => several_logs::replay_several_logs(options),
            },
        }
    }
}

/// Parses the command line, runs the command, and returns its exit code.
#[must_use]
pub fn run_program() -> ExitCode {
    let cli: Cli = parse_command_line();
    cli.color.apply();
    let Some(command) = cli.command else {
        print::print_text(&Cli::command().render_help().ansi().to_string());
        return print::final_exit_code(ExitCode::SUCCESS);
    };
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

#[cfg(test)]
mod tests {
    use super::*;

    /// What the program prints without a command.
    #[test]
    fn the_short_help_fits_a_screen_and_begins_with_replay() {
        let help = Cli::command().render_help().to_string();
        assert!(help.lines().count() < 24, "{help}");
        let [replay, fly] = ["  replay", "  fly"].map(|command| help.find(command));
        assert!(replay < fly && help.contains("host-sim fly"), "{help}");
    }
}
