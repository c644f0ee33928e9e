//! Parser, completion and help of console lines, based on the table of commands.

use core::fmt::{self, Display};

use super::command_table::{
    ArgumentKind, ArgumentSpec, ArgumentValue, Arguments, CommandArgument, CommandForm, CommandSpec, ConsoleCommand,
    Request, all_commands,
};
use super::line_editor::LINE_CAPACITY;
use crate::console::wrapped_lines::WrappedLines;
use crate::wire::mavlink::key_from_passphrase;
use autoswing::decimal::{self, ShortestDecimal};
use autoswing_module::compass::Command;
use autoswing_module::settings::{Field, Setting, SettingChange, SettingValue, Settings};

/// Reason why a line is invalid.
#[derive(Clone, Copy, Debug)]
pub enum LineError {
    /// Unknown first word, or unknown second word after a known first one.
    UnknownCommand {
        /// The known first word.
        first: Option<&'static str>,
        /// The command that was probably meant.
        nearest: Option<ConsoleCommand>,
    },
    /// Missing second word; contains the first.
    MissingWord(&'static str),
    /// Missing argument.
    MissingArgument(CommandArgument),
    /// Invalid argument.
    BadValue(CommandArgument),
    /// More arguments than the command takes.
    UnexpectedArgument(ConsoleCommand),
    /// Destructive command without its confirmation word.
    MissingConfirmation(ConsoleCommand),
    /// Line beyond the capacity.
    TooLong,
}

impl LineError {
    /// Stable code in kebab-case.
    #[must_use]
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::UnknownCommand { .. } => "unknown-command",
            Self::MissingWord(_) | Self::MissingArgument(_) => "missing-argument",
            Self::BadValue(_) => "bad-value",
            Self::UnexpectedArgument(_) => "unexpected-argument",
            Self::MissingConfirmation(_) => "needs-word",
            Self::TooLong => "line-too-long",
        }
    }
}

/// Writes which input was expected.
impl Display for LineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownCommand { nearest: Some(nearest), .. } => {
                let [first, second] = nearest.words();
                let space = if second.is_empty() { "" } else { " " };
                write!(f, "unknown command; did you mean {first}{space}{second}?")
            }
            Self::UnknownCommand { first: None, .. } => f.write_str("unknown command; help lists all"),
            Self::UnknownCommand { first: Some(first), .. } | Self::MissingWord(first) => {
                let nth_word = |number| ExpectedElement::SecondWord(first).nth_word(number);
                if nth_word(MAX_LISTED_WORDS).is_some() {
                    return write!(f, "after {first} expected a word that help {first} lists");
                }
                write!(f, "after {first} expected ")?;
                write_list(f, &nth_word, " or ")
            }
            Self::MissingArgument(slot) => write!(f, "<{}> is missing; expected {slot}", slot.name()),
            Self::BadValue(slot) => write!(f, "expected {slot}"),
            Self::UnexpectedArgument(row) => write!(f, "too many words; it is {row}"),
            Self::MissingConfirmation(row) => write!(f, "this cannot be undone; type {row}"),
            Self::TooLong => write!(f, "a line holds {LINE_CAPACITY} characters"),
        }
    }
}

impl core::error::Error for LineError {}

/// Parses a line; none for an empty line. Case is ignored.
///
/// # Errors
///
/// The first [`LineError`] from the left.
#[must_use]
pub fn parse_request(line: &str) -> Option<Result<Request, LineError>> {
    let mut words = split_words(line);
    words.next().map(|first| parse_words(first, words))
}

fn split_words(line: &str) -> impl Iterator<Item = &str> {
    line.split(' ').filter(|word| !word.is_empty())
}

/// Splits a line before its last word, which is empty after a space.
fn split_last_word(line: &str) -> (&str, &str) {
    let begin = line.bytes().rposition(|byte| byte == b' ').map_or(0, |space| space + 1);
    line.split_at_checked(begin).unwrap_or((line, ""))
}

fn parse_words<'a>(first: &str, mut words: impl Iterator<Item = &'a str>) -> Result<Request, LineError> {
    let mut command = find_command([first, ""]).ok_or_else(|| unknown_command(None, first))?;
    if let ConsoleCommand::Own(CommandSpec { command_form: CommandForm::Help, .. }) = command {
        return words.next().map_or(Ok(Request::Help(None)), |topic| parse_help(topic, words));
    }
    if command.is_group() {
        let [first, _] = command.words();
        let second = words.next().ok_or(LineError::MissingWord(first))?;
        command = find_command([first, second]).ok_or_else(|| unknown_command(Some(first), second))?;
    }
    parse_arguments(command, words)
}

fn parse_help<'a>(first: &str, mut words: impl Iterator<Item = &'a str>) -> Result<Request, LineError> {
    let command = find_command([first, ""]).or_else(|| find_command(["set", first]));
    let mut command = command.ok_or_else(|| unknown_command(None, first))?;
    if let Some(second) = words.next() {
        if !command.is_group() {
            return Err(LineError::UnexpectedArgument(command));
        }
        let [first, _] = command.words();
        command = find_command([first, second]).ok_or_else(|| unknown_command(Some(first), second))?;
    }
    if words.next().is_some() { Err(LineError::UnexpectedArgument(command)) } else { Ok(Request::Help(Some(command))) }
}

/// Largest number of second words that an error lists.
const MAX_LISTED_WORDS: usize = 10;

/// Longest word that is compared by its letters; no command is longer.
const MAX_COMPARED_LETTERS: usize = 24;

/// Largest number of letters to insert, delete or replace in a word that is suggested; less than half of its letters.
const MAX_LETTER_CHANGES: usize = 2;

fn unknown_command(first: Option<&'static str>, typed: &str) -> LineError {
    let near_commands = all_commands().filter_map(|command| {
        let word = match (command.words(), first) {
            ([word, ""] | [_, word], None) => word,
            ([own_first, word], Some(first)) => (own_first == first && !word.is_empty()).then_some(word)?,
        };
        let changes = letter_changes(word, typed)?;
        (changes <= MAX_LETTER_CHANGES && 2 * changes < word.len()).then_some((changes, command))
    });
    let nearest = near_commands.min_by_key(|(changes, _)| *changes);
    LineError::UnknownCommand { first, nearest: nearest.map(|(_, command)| command) }
}

/// Number of letters to insert, delete or replace (Levenshtein distance), without regard to case; none if a word is too
/// long.
fn letter_changes(word: &str, typed: &str) -> Option<usize> {
    let mut distances: [usize; MAX_COMPARED_LETTERS + 1] = core::array::from_fn(|column| column);
    let distances = distances.get_mut(..=word.len())?;
    for (row, typed) in typed.bytes().enumerate() {
        let mut diagonal = row;
        let mut left = row + 1;
        for (column, letter) in word.bytes().enumerate() {
            let (above, replaced) =
                (distances[column + 1], diagonal + usize::from(!letter.eq_ignore_ascii_case(&typed)));
            distances[column] = left;
            (diagonal, left) = (above, replaced.min(above + 1).min(left + 1));
        }
        distances[word.len()] = left;
    }
    Some(distances[word.len()])
}

fn is_help(first: &str) -> bool {
    first == "help"
}

fn find_command(words: [&str; 2]) -> Option<ConsoleCommand> {
    all_commands()
        .find(|command| command.words().iter().zip(words).all(|(word, typed)| word.eq_ignore_ascii_case(typed)))
}

fn parse_arguments<'a>(
    command: ConsoleCommand,
    mut words: impl Iterator<Item = &'a str>,
) -> Result<Request, LineError> {
    let mut arguments = Arguments([ArgumentValue::Absent; 2]);
    for (argument, value) in command.arguments().zip(&mut arguments.0) {
        let is_confirmation = matches!(
            argument,
            CommandArgument::Own(ArgumentSpec { argument_kind: ArgumentKind::Confirmation(_), is_optional: false, .. })
        );
        let parsed = match words.next() {
            Some(word) => parse_value(argument, word).ok_or(LineError::BadValue(argument)),
            None if argument.is_optional() => break,
            None => Err(LineError::MissingArgument(argument)),
        };
        *value =
            parsed.map_err(|error| if is_confirmation { LineError::MissingConfirmation(command) } else { error })?;
        // No argument follows a word in place of a number.
        if *value == ArgumentValue::Absent {
            break;
        }
    }
    if words.next().is_some() {
        return Err(LineError::UnexpectedArgument(command));
    }
    Ok(match (command, &arguments.0) {
        (ConsoleCommand::Own(CommandSpec { command_form: CommandForm::Request(_, to_request), .. }), _) => {
            to_request(&arguments)
        }
        (ConsoleCommand::Setting(setting), &[ArgumentValue::Setting(value), _]) => {
            Command::Set(SettingChange { setting, value }).into()
        }
        _ => Request::Help(Some(command)),
    })
}

fn parse_value(argument: CommandArgument, typed: &str) -> Option<ArgumentValue> {
    let word = (0..).map_while(|number| argument.nth_word(number)).position(|word| word.eq_ignore_ascii_case(typed));
    match (argument, word) {
        (CommandArgument::Own(ArgumentSpec { argument_kind: ArgumentKind::Heading(_), .. }), None) => {
            decimal::parse_decimal(typed).map(ArgumentValue::Number)
        }
        (CommandArgument::Own(ArgumentSpec { argument_kind: ArgumentKind::Heading(_), .. }), Some(_)) => {
            Some(ArgumentValue::Absent)
        }
        (CommandArgument::Own(_), word) => word.map(ArgumentValue::Choice),
        (CommandArgument::Setting(setting), Some(index)) => {
            setting.nth_word(index).map(|(_, value)| ArgumentValue::Setting(value))
        }
        (CommandArgument::Setting(setting), None) => parse_setting_value(setting, typed).map(ArgumentValue::Setting),
    }
}

/// Parses a value that is not one of the setting's words.
fn parse_setting_value(setting: &'static Setting, typed: &str) -> Option<SettingValue> {
    let value = match (setting.field)(&mut { Settings::DEFAULT }) {
        Field::Choice(_) => return None,
        Field::Whole(_) | Field::Number(_) | Field::Angle(_) => {
            SettingValue::Number(Some(decimal::parse_decimal(typed)?))
        }
        Field::Key(_) => SettingValue::Key(Some(key_from_passphrase(typed))),
    };
    setting.change_to(value).map(|change| change.value)
}

/// Syntax element expected next in a line.
#[derive(Clone, Copy)]
enum ExpectedElement {
    FirstWord,
    SecondWord(&'static str),
    Argument(CommandArgument),
    Nothing,
}

impl ExpectedElement {
    /// Element expected after complete words.
    fn after_words(line: &str) -> Self {
        let mut words = split_words(line);
        let Some(mut first) = words.next() else { return Self::FirstWord };
        let is_explained = is_help(first);
        if is_explained {
            let Some(explained) = words.next() else { return Self::FirstWord };
            first = explained;
        }
        let Some(mut command) = find_command([first, ""]) else { return Self::Nothing };
        if command.is_group() {
            let Some(second) = words.next() else { return Self::SecondWord(command.words()[0]) };
            let Some(second) = find_command([first, second]) else { return Self::Nothing };
            command = second;
        }
        let argument = if is_explained { None } else { command.nth_argument(words.count()) };
        argument.map_or(Self::Nothing, Self::Argument)
    }

    /// Allowed word with this index.
    fn nth_word(self, number: usize) -> Option<&'static str> {
        match self {
            Self::FirstWord => nth_command_word(None, number),
            Self::SecondWord(first) => nth_command_word(Some(first), number),
            Self::Argument(slot) => slot.nth_word(number),
            Self::Nothing => None,
        }
    }
}

/// First word of a command, or second word after a first one.
fn nth_command_word(first_word: Option<&str>, number: usize) -> Option<&'static str> {
    let mut words = all_commands().map(ConsoleCommand::words).filter_map(|[first, second]| match first_word {
        None => second.is_empty().then_some(first),
        Some(first_word) => (first == first_word && !second.is_empty()).then_some(second),
    });
    words.nth(number)
}

/// Completion of the last word of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Completion {
    /// Common continuation of all matching words.
    pub continuation: &'static str,
    /// Number of matching words.
    pub match_count: usize,
}

/// Completes the last word of a line, which is empty after a space; passes each matching word to the callback.
pub fn complete_line(line: &str, report_match: &mut dyn FnMut(&'static str)) -> Completion {
    let (complete_words, typed) = split_last_word(line);
    let expected = ExpectedElement::after_words(complete_words);
    let mut continuation: Option<&'static str> = None;
    let mut match_count = 0;
    for word in (0..).map_while(|number| expected.nth_word(number)) {
        let Some(ending) = completion_suffix(word, typed) else { continue };
        report_match(word);
        match_count += 1;
        continuation = Some(continuation.map_or(ending, |continuation| common_prefix(continuation, ending)));
    }
    Completion { continuation: continuation.unwrap_or_default(), match_count }
}

/// Rest of a word after its typed beginning; none if the beginning differs.
fn completion_suffix(word: &'static str, typed: &str) -> Option<&'static str> {
    word.get(..typed.len())
        .filter(|beginning| beginning.eq_ignore_ascii_case(typed))
        .and_then(|_| word.get(typed.len()..))
}

fn common_prefix(first: &'static str, second: &str) -> &'static str {
    let length = first.bytes().zip(second.bytes()).take_while(|(a, b)| a == b).count();
    first.get(..length).unwrap_or_default()
}

/// Writes a list of words with commas, and `last_separator` before the final word.
fn write_list(
    f: &mut fmt::Formatter<'_>,
    word: &dyn Fn(usize) -> Option<&'static str>,
    last_separator: &str,
) -> fmt::Result {
    let mut number = 0;
    while let Some(item) = word(number) {
        let is_last = word(number + 1).is_none();
        f.write_str(if number == 0 {
            ""
        } else if is_last {
            last_separator
        } else {
            ", "
        })?;
        f.write_str(item)?;
        number += 1;
    }
    Ok(())
}

impl Display for ConsoleCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [first, second] = self.words();
        f.write_str(first)?;
        if !second.is_empty() {
            write!(f, " {second}")?;
        }
        for argument in self.arguments() {
            let (opening, closing) = if argument.is_optional() { ("[", "]") } else { ("", "") };
            write!(f, " {opening}{}{closing}", argument.name())?;
        }
        Ok(())
    }
}

impl Display for CommandArgument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let write_words = |f: &mut _| write_list(f, &|number| self.nth_word(number), " or ");
        match self {
            Self::Own(ArgumentSpec { argument_kind: ArgumentKind::Heading(_), .. }) => {
                f.write_str("a number, 0 to 360 deg")?;
            }
            Self::Own(_) => return write_words(f),
            Self::Setting(setting) => match (setting.field)(&mut { Settings::DEFAULT }) {
                Field::Choice(_) => return write_words(f),
                Field::Key(_) => f.write_str("one word, upper and lower case differ, such as Heron-4711")?,
                field @ (Field::Whole(_) | Field::Number(_) | Field::Angle(_)) => {
                    let whole = if let Field::Whole(_) = field { "whole " } else { "" };
                    let [least, most] = setting.range.map(|number| ShortestDecimal(number, 0));
                    write!(f, "a {whole}number, {least} to {most} {}", setting.unit)?;
                }
            },
        }
        self.nth_word(0).map_or(Ok(()), |word| write!(f, ", or {word}"))
    }
}

/// Writes the reply to `help`, for all commands or for one.
///
/// # Errors
///
/// Those of `out`.
pub fn write_help(out: &mut dyn fmt::Write, topic: Option<ConsoleCommand>) -> fmt::Result {
    let out: &mut dyn fmt::Write = &mut WrappedLines::new(out);
    let Some(topic) = topic else {
        writeln!(out, "ok help COMMAND explains one")?;
        return write_help_of_next_words(out, ExpectedElement::FirstWord);
    };
    writeln!(out, "ok {topic}: {}", topic.help_text())?;
    for argument in topic.arguments() {
        writeln!(out, "{}: {argument}", argument.name())?;
    }
    let [first, second] = topic.words();
    if second.is_empty() { write_help_of_next_words(out, ExpectedElement::SecondWord(first)) } else { Ok(()) }
}

/// Writes the help of each word allowed next.
fn write_help_of_next_words(out: &mut dyn fmt::Write, expected: ExpectedElement) -> fmt::Result {
    for word in (0..).map_while(|number| expected.nth_word(number)) {
        let words = if let ExpectedElement::SecondWord(first) = expected { [first, word] } else { [word, ""] };
        if let Some(command) = find_command(words) {
            writeln!(out, "{}", CommandHelp(command))?;
        }
    }
    Ok(())
}

/// Syntax and description of a command; for a first word also its second words.
struct CommandHelp(ConsoleCommand);

impl Display for CommandHelp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.0, self.0.help_text())?;
        if self.0.is_group() {
            let [first, _] = self.0.words();
            f.write_str(": ")?;
            write_list(f, &|number| ExpectedElement::SecondWord(first).nth_word(number), ", ")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
