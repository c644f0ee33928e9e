//! Tests of a program's help, for `host-sim` and, by its path, for `lab`.

use std::path::Path;

use clap::{CommandFactory as _, Parser as _};

use super::{Cli, print::MAX_OUTPUT_COLUMNS};

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
    for (name, mut command) in commands() {
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
    let arguments = ["program".to_owned()].into_iter().chain(name.iter().cloned()).chain([argument]).chain(file);
    Cli::try_parse_from(arguments).err().map(|error| error.to_string().split_whitespace().collect::<Vec<_>>().join(" "))
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
    assert!(number_options > 0);
}

/// Existing files that the help names, by their path from the repository's root.
#[test]
fn paths_in_the_help_exist_in_the_repository() {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = package.ancestors().find(|folder| folder.join("LICENSE-MIT").is_file()).unwrap();
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
    assert!(path_count > 0);
}

#[test]
fn every_command_has_an_example_in_its_help() {
    for (name, mut command) in commands().into_iter().filter(|(_, command)| !command.has_subcommands()) {
        for help in [command.render_help(), command.render_long_help()].map(|help| help.to_string()) {
            let words = name.join(" ");
            let program = if ["replay", "fly"].contains(&words.as_str()) { "host-sim" } else { "lab" };
            let example = help.split_once("Example").map_or("", |(_, example)| example);
            assert!(example.contains(&format!(" {program} {words}")), "{words}: {help}");
        }
    }
}

/// A doc comment on a variant of `CliCommand` would replace the command's long help.
#[test]
fn every_command_has_its_full_long_help() {
    Cli::command().debug_assert();
    for (name, command) in commands() {
        if !["bench", "speed"].contains(&command.get_name()) {
            let long = command.get_long_about().map(ToString::to_string).unwrap_or_default();
            assert!(long.lines().count() > 2, "{name:?}: {long}");
        }
    }
}
