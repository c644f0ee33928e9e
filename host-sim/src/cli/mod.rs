//! Commands, options and exit codes.

mod accuracy;
mod bench;
mod command_failure;
mod file_options;
mod fly;
mod integrity;
mod option_parsers;
mod print;
mod progress;
mod replay;
mod serve;
mod several_logs;
mod shell_files;
mod table1;
mod termination;

use std::path::Path;
use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, Subcommand};

use command_failure::CommandFailure;
use termination::TerminationSignals;

/// The version; with its commit if a script of this repository built the program (`scripts/foreign-target.sh`).
const VERSION: &str = match option_env!("AUTOSWING_VERSION") {
    Some(version) => version,
    None => env!("CARGO_PKG_VERSION"),
};

/// Fly the firmware of the Autoswing heading module in a simulated aircraft.
///
/// Everything runs in virtual time and depends on the seed only: the same command prints the same bytes. Only `serve`
/// and `console` follow the wall clock and their inputs. Exit codes: 0 calibrated, 1 the module refused, 2 wrong
/// command; 130 ended by Ctrl-C, 141 the reader closed the pipe. docs/json.md describes the output of --json.
#[derive(Parser)]
#[command(version = VERSION, about, long_about, args_conflicts_with_subcommands = true, max_term_width = print::MAX_OUTPUT_COLUMNS)]
struct Cli {
    #[command(subcommand)]
    command: Option<CliCommand>,
    #[command(flatten)]
    fly: fly::FlyOptions,
}

// No doc comments on these variants: they would replace the commands' own long help.
#[derive(Subcommand)]
enum CliCommand {
    Fly(fly::FlyOptions),
    Emulate(fly::EmulateOptions),
    Serve(serve::ServeCommandOptions),
    Console(serve::ConsoleOptions),
    Table1(table1::Table1Options),
    Replay(replay::ReplayArguments),
    /// Measure accuracy or speed
    #[command(subcommand)]
    Bench(BenchCommand),
    Completions(shell_files::CompletionsOptions),
    Man(shell_files::ManOptions),
}

#[derive(Subcommand)]
enum BenchCommand {
    Accuracy(accuracy::AccuracyOptions),
    Integrity(integrity::IntegrityOptions),
    Speed(bench::SpeedOptions),
    Budget(bench::BudgetOptions),
}

pub fn run_program() -> ExitCode {
    let cli = Cli::try_parse().unwrap_or_else(|error| {
        if let Some(log) = std::env::args().nth(1).filter(|word| several_logs::is_log(Path::new(word))) {
            print::print_error(format_args!("host-sim: {log} is a log; to evaluate it: host-sim replay {log}"));
            std::process::exit(2)
        }
        error.exit()
    });
    let command = cli.command.unwrap_or(CliCommand::Fly(cli.fly));
    print::final_exit_code(execute_command(&command).unwrap_or_else(|CommandFailure(message)| {
        print::print_error(format_args!("host-sim: {message}"));
        ExitCode::from(2)
    }))
}

fn execute_command(command: &CliCommand) -> Result<ExitCode, CommandFailure> {
    match command {
        // Commands that clean up after a termination signal.
        CliCommand::Emulate(_)
        | CliCommand::Serve(_)
        | CliCommand::Console(_)
        | CliCommand::Bench(BenchCommand::Budget(_)) => {}
        _ => TerminationSignals::install_immediate_exit()?,
    }
    match command {
        CliCommand::Fly(options) => fly::run_fly(options),
        CliCommand::Emulate(options) => fly::run_emulate(options),
        CliCommand::Serve(options) => serve::run_serve(options),
        CliCommand::Console(options) => serve::run_console(options),
        CliCommand::Table1(options) => table1::run_table1(options),
        CliCommand::Replay(options) => match options.files.as_slice() {
            [file] if !file.is_dir() => replay::run_replay(file, options),
            _ => several_logs::replay_several_logs(options),
        },
        CliCommand::Bench(BenchCommand::Accuracy(options)) => accuracy::run_accuracy(options),
        CliCommand::Bench(BenchCommand::Budget(options)) => bench::run_instruction_budget(options),
        CliCommand::Bench(BenchCommand::Integrity(options)) => integrity::run_integrity(options),
        CliCommand::Bench(BenchCommand::Speed(options)) => bench::run_speed(options),
        CliCommand::Completions(options) => Ok(shell_files::write_completions(options, Cli::command())),
        CliCommand::Man(options) => shell_files::write_man_pages(options, Cli::command()),
    }
}

#[cfg(test)]
mod tests {
    use super::print::MAX_OUTPUT_COLUMNS;
    use super::*;

    /// All commands with their full name, such as `bench speed`.
    fn commands() -> Vec<(Vec<String>, clap::Command)> {
        let mut cli = Cli::command();
        cli.build();
        let mut commands_with_names = vec![(vec![], cli)];
        let mut command_index = 0;
        while command_index < commands_with_names.len() {
            let (name, command) = commands_with_names[command_index].clone();
            commands_with_names.extend(command.get_subcommands().filter(|command| command.get_name() != "help").map(
                |command| {
                    let name = name.iter().cloned().chain([command.get_name().to_owned()]).collect();
                    (name, command.clone())
                },
            ));
            command_index += 1;
        }
        commands_with_names
    }

    #[test]
    fn no_help_is_wider_than_a_terminal() {
        let commands = commands();
        assert_eq!(commands.len(), 14, "itself, bench, and twelve that do something");
        for (name, mut command) in commands {
            for help in [command.render_help(), command.render_long_help()] {
                for line in help.to_string().lines() {
                    assert!(line.chars().count() <= MAX_OUTPUT_COLUMNS, "{name:?}: {line}");
                }
            }
        }
    }

    /// Ends of the last range `MIN to MAX` in a help or error text.
    fn last_range(text: &str) -> Option<(String, String)> {
        let is_number_char = |character: char| character.is_ascii_digit() || character == '.' || character == '-';
        let (before, after) = text.rsplit_once(" to ")?;
        let min = before.rsplit(|character| !is_number_char(character)).next()?;
        let max = after.split(|character| !is_number_char(character)).next()?;
        (!min.is_empty() && !max.is_empty()).then(|| (min.to_owned(), max.to_owned()))
    }

    fn parse_error(name: &[String], option: &str, value: &str, takes_a_file: bool) -> Option<String> {
        let argument = format!("--{option}={value}");
        let file = takes_a_file.then(|| "log.csv".to_owned());
        let arguments = ["host-sim".to_owned()].into_iter().chain(name.iter().cloned()).chain([argument]).chain(file);
        Cli::try_parse_from(arguments)
            .err()
            .map(|error| error.to_string().split_whitespace().collect::<Vec<_>>().join(" "))
    }

    /// The ends of the range in the help are accepted, values beyond are refused, and the error message has the same
    /// range.
    #[test]
    fn every_number_has_its_range_in_help_and_error_message() {
        let numbers = ["N", "DEG", "UT", "MINUTES", "MS", "SECONDS", "PORT"];
        let mut number_options = 0;
        for (name, command) in commands() {
            let takes_a_file = name == ["replay"];
            for option in command.get_arguments() {
                let is_number =
                    option.get_value_names().is_some_and(|value_names| numbers.contains(&value_names[0].as_str()));
                let Some(long) = option.get_long().filter(|_| is_number) else { continue };
                let help = option.get_long_help().or(option.get_help()).map(ToString::to_string).unwrap_or_default();
                // A help text may have two ranges; the first is the number's.
                let (min, max) = help
                    .match_indices(" to ")
                    .find_map(|(text_offset, _)| last_range(&help[..help.len().min(text_offset + 4 + 24)]))
                    .unwrap_or_else(|| panic!("{name:?} --{long} has no range: {help}"));
                let beyond = |range_end: &str, difference: i128| {
                    range_end
                        .parse::<i128>()
                        .map_or_else(|_| "-1".to_owned(), |range_end| (range_end + difference).to_string())
                };
                for accepted in [&min, &max] {
                    assert_eq!(parse_error(&name, long, accepted, takes_a_file), None, "{name:?} --{long} {accepted}");
                }
                for rejected in [beyond(&min, -1), beyond(&max, 1), "x".to_owned(), "nan".to_owned(), String::new()] {
                    let error = parse_error(&name, long, &rejected, takes_a_file)
                        .unwrap_or_else(|| panic!("{name:?} --{long} {rejected}"));
                    assert!(error.contains(&format!(", {min} to {max}")), "{name:?} --{long} {rejected}: {error}");
                }
                number_options += 1;
            }
        }
        assert!(number_options >= 25, "{number_options}");
    }

    /// Existing files that the help names, by their path from the repository's root.
    #[test]
    fn paths_in_the_help_exist_in_the_repository() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let mut path_count = 0;
        for (_, mut command) in commands() {
            let help = command.render_long_help().to_string();
            let is_path_char = |character: char| character.is_ascii_alphanumeric() || "/._-".contains(character);
            for word in help.split(|character| !is_path_char(character)).map(|word| word.trim_end_matches('.')) {
                let is_generated = word.starts_with("target/");
                let is_file = [".toml", ".csv", ".md", ".sh"].iter().any(|extension| word.ends_with(extension));
                if word.contains('/') && !is_generated && (is_file || word.starts_with("scripts/")) {
                    assert!(root.join(word).is_file(), "{word}");
                    path_count += 1;
                }
            }
        }
        assert!(path_count >= 8, "{path_count}");
    }
}
