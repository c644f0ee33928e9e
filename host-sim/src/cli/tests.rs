//! What holds of every command.

use clap::CommandFactory as _;

use super::print::WIDTH;
use super::*;

/// Every command that does something, with its name in full: `bench speed`.
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

/// The last two numbers of a text with ` to ` between them.
fn range(text: &str) -> Option<(String, String)> {
    let is_of_a_number = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
    let (before, after) = text.rsplit_once(" to ")?;
    let min = before.rsplit(|c| !is_of_a_number(c)).next()?;
    let max = after.split(|c| !is_of_a_number(c)).next()?;
    (!min.is_empty() && !max.is_empty()).then(|| (min.to_owned(), max.to_owned()))
}

/// What is said of a value that was refused, in one line.
fn refused(name: &[String], option: &str, value: &str, takes_a_file: bool) -> Option<String> {
    let whole = format!("--{option}={value}");
    let file = takes_a_file.then(|| "log.csv".to_owned());
    let words = ["host-sim".to_owned()].into_iter().chain(name.iter().cloned()).chain([whole]).chain(file);
    Cli::try_parse_from(words).err().map(|error| error.to_string().split_whitespace().collect::<Vec<_>>().join(" "))
}

/// Every option that takes a number, on every command: the ends of what its help says are taken, what lies beyond is not,
/// and what is refused is told the same range.
#[test]
fn every_number_has_its_range_in_the_help_and_in_the_refusal() {
    let numbers = ["N", "DEG", "UT", "MINUTES", "MS", "SECONDS", "PORT"];
    let mut seen = 0;
    for (name, command) in commands() {
        let takes_a_file = name == ["replay"];
        for option in command.get_arguments() {
            let is_number = option.get_value_names().is_some_and(|of| numbers.contains(&of[0].as_str()));
            let Some(long) = option.get_long().filter(|_| is_number) else { continue };
            let help = option.get_long_help().or(option.get_help()).map(ToString::to_string).unwrap_or_default();
            // Of two ranges in a help the first is the number's.
            let (min, max) = help
                .match_indices(" to ")
                .find_map(|(at, _)| range(&help[..help.len().min(at + 4 + 24)]))
                .unwrap_or_else(|| panic!("{name:?} --{long} has no range: {help}"));
            let beyond = |end: &str, by: i128| {
                end.parse::<i128>().map_or_else(|_| "-1".to_owned(), |end| (end + by).to_string())
            };
            for good in [&min, &max] {
                assert_eq!(refused(&name, long, good, takes_a_file), None, "{name:?} --{long} {good}");
            }
            for bad in [beyond(&min, -1), beyond(&max, 1), "x".to_owned(), "nan".to_owned(), String::new()] {
                let error =
                    refused(&name, long, &bad, takes_a_file).unwrap_or_else(|| panic!("{name:?} --{long} {bad}"));
                assert!(error.contains(&format!(", {min} to {max}")), "{name:?} --{long} {bad}: {error}");
            }
            seen += 1;
        }
    }
    assert!(seen >= 25, "{seen}");
}

/// Files that are named in any help lie where they are said to, from the repository's root; where they are read.
#[test]
fn paths_in_the_help_are_those_of_the_repository() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut seen = 0;
    for (_, mut command) in commands() {
        let help = command.render_long_help().to_string();
        let is_of_a_path = |c: char| c.is_ascii_alphanumeric() || "/._-".contains(c);
        for word in help.split(|c| !is_of_a_path(c)).map(|word| word.trim_end_matches('.')) {
            let is_made = word.starts_with("target/");
            let is_file = [".toml", ".csv", ".md", ".sh"].iter().any(|end| word.ends_with(end));
            if word.contains('/') && !is_made && (is_file || word.starts_with("scripts/")) {
                assert!(root.join(word).is_file(), "{word}");
                seen += 1;
            }
        }
    }
    assert!(seen >= 8, "{seen}");
}
