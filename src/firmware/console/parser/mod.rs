//! Parser, completion and help of console lines, based on the table of commands.

use core::fmt::{self, Display};

use super::command_table::{ArgumentKind, ArgumentSpec, ArgumentValue, Arguments, COMMANDS, CommandSpec, Request};
use super::line_editor::LINE_CAPACITY;
use crate::wire::mavlink::key_from_passphrase;
use autoswing::decimal::{self, ShortestDecimal};

/// Reason why a line is invalid.
#[derive(Clone, Copy, Debug)]
pub enum LineError {
    /// Unknown first word (`None`), or unknown second word after this known first one.
    UnknownCommand(Option<&'static str>),
    /// Missing second word; contains the first.
    MissingWord(&'static str),
    /// Missing argument.
    MissingArgument(&'static ArgumentSpec),
    /// Invalid argument.
    BadValue(&'static ArgumentSpec),
    /// More arguments than the command takes.
    UnexpectedArgument(&'static CommandSpec),
    /// Destructive command without its confirmation word.
    MissingConfirmation(&'static CommandSpec),
    /// Line beyond the capacity.
    TooLong,
}

impl LineError {
    /// Stable code in kebab-case.
    #[must_use]
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::UnknownCommand(_) => "unknown-command",
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
        match *self {
            Self::UnknownCommand(None) => f.write_str("unknown command; help lists all"),
            Self::UnknownCommand(Some(first)) | Self::MissingWord(first) => {
                write!(f, "after {first} expected ")?;
                write_list(f, &|number| ExpectedElement::SecondWord(first).nth_word(number), " or ")
            }
            Self::MissingArgument(slot) => write!(f, "<{}> is missing; expected {slot}", slot.argument_name),
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
    let row = find_command([first, ""]).ok_or(LineError::UnknownCommand(None))?;
    if let Some(to_request) = row.request_constructor {
        return parse_arguments(row, to_request, words);
    }
    let [first, _] = row.command_words;
    let Some(second) = words.next() else {
        return if is_help(first) { Ok(Request::Help(None)) } else { Err(LineError::MissingWord(first)) };
    };
    if is_help(first) {
        return parse_help(second, words);
    }
    let row = find_command([first, second]).ok_or(LineError::UnknownCommand(Some(first)))?;
    row.request_constructor
        .map_or(Err(LineError::UnknownCommand(None)), |to_request| parse_arguments(row, to_request, words))
}

fn parse_help<'a>(first: &str, mut words: impl Iterator<Item = &'a str>) -> Result<Request, LineError> {
    let row = find_command([first, ""]).ok_or(LineError::UnknownCommand(None))?;
    let row = match words.next() {
        Some(second) if row.request_constructor.is_none() && !is_help(row.command_words[0]) => {
            find_command([first, second]).ok_or(LineError::UnknownCommand(Some(row.command_words[0])))?
        }
        Some(_) => return Err(LineError::UnexpectedArgument(row)),
        None => row,
    };
    if words.next().is_some() { Err(LineError::UnexpectedArgument(row)) } else { Ok(Request::Help(Some(row))) }
}

fn is_help(first: &str) -> bool {
    first == "help"
}

fn find_command(words: [&str; 2]) -> Option<&'static CommandSpec> {
    COMMANDS
        .iter()
        .find(|row| row.command_words.iter().zip(words).all(|(word, typed)| word.eq_ignore_ascii_case(typed)))
}

fn parse_arguments<'a>(
    row: &'static CommandSpec,
    to_request: fn(&Arguments) -> Request,
    mut words: impl Iterator<Item = &'a str>,
) -> Result<Request, LineError> {
    let mut arguments = Arguments([ArgumentValue::Absent; 2]);
    for (argument, value) in row.arguments.iter().zip(&mut arguments.0) {
        let Some(word) = words.next() else {
            match argument.argument_kind {
                _ if argument.is_optional => break,
                ArgumentKind::Confirmation(_) => return Err(LineError::MissingConfirmation(row)),
                _ => return Err(LineError::MissingArgument(argument)),
            }
        };
        *value = match parse_value(argument, word) {
            Some(value) => value,
            None if matches!(argument.argument_kind, ArgumentKind::Confirmation(_)) && !argument.is_optional => {
                return Err(LineError::MissingConfirmation(row));
            }
            None => return Err(LineError::BadValue(argument)),
        };
        // No argument follows a word in place of a number.
        if *value == ArgumentValue::Absent {
            break;
        }
    }
    if words.next().is_some() { Err(LineError::UnexpectedArgument(row)) } else { Ok(to_request(&arguments)) }
}

fn parse_value(argument: &ArgumentSpec, typed: &str) -> Option<ArgumentValue> {
    let choice = (0..).map_while(|number| argument.nth_word(number)).position(|word| word.eq_ignore_ascii_case(typed));
    match &argument.argument_kind {
        ArgumentKind::Choice(_) | ArgumentKind::Confirmation(_) => choice.map(ArgumentValue::Choice),
        ArgumentKind::Number { .. } | ArgumentKind::Passphrase if choice.is_some() => Some(ArgumentValue::Absent),
        ArgumentKind::Number { .. } => decimal::parse_decimal(typed).map(ArgumentValue::Number),
        ArgumentKind::Passphrase => Some(ArgumentValue::SigningKey(key_from_passphrase(typed))),
        ArgumentKind::Integer { .. } => typed.parse::<u8>().ok().map(|number| ArgumentValue::Number(f32::from(number))),
    }
}

/// Syntax element expected next in a line.
#[derive(Clone, Copy)]
enum ExpectedElement {
    FirstWord,
    SecondWord(&'static str),
    Argument(&'static ArgumentSpec),
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
        let Some(row) = find_command([first, ""]) else { return Self::Nothing };
        let row = if row.request_constructor.is_some() {
            Some(row)
        } else {
            let Some(second) = words.next() else { return Self::SecondWord(row.command_words[0]) };
            find_command([first, second])
        };
        let Some(row) = row.filter(|_| !is_explained) else { return Self::Nothing };
        let mut slots = row.arguments.iter();
        while words.next().is_some() {
            slots.next();
        }
        slots.next().map_or(Self::Nothing, Self::Argument)
    }

    /// Allowed word with this index.
    fn nth_word(self, number: usize) -> Option<&'static str> {
        match self {
            Self::FirstWord => {
                command_word_pairs().filter(|[_, second]| second.is_empty()).map(|[first, _]| first).nth(number)
            }
            Self::SecondWord(command) => {
                let is_subcommand = |[first, second]: &[&'static str; 2]| *first == command && !second.is_empty();
                command_word_pairs().filter(is_subcommand).map(|[_, second]| second).nth(number)
            }
            Self::Argument(slot) => slot.nth_word(number),
            Self::Nothing => None,
        }
    }
}

fn command_word_pairs() -> impl Iterator<Item = [&'static str; 2]> {
    COMMANDS.iter().map(|row| row.command_words)
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

impl Display for CommandSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [first, second] = self.command_words;
        f.write_str(first)?;
        if !second.is_empty() {
            write!(f, " {second}")?;
        }
        for argument in self.arguments {
            let (opening, closing) = if argument.is_optional { ("[", "]") } else { ("", "") };
            write!(f, " {opening}{}{closing}", argument.argument_name)?;
        }
        Ok(())
    }
}

impl Display for ArgumentSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.argument_kind {
            ArgumentKind::Number { range, unit, .. } => {
                write!(
                    f,
                    "a number, {} to {} {unit}",
                    ShortestDecimal(*range.start(), 0),
                    ShortestDecimal(*range.end(), 0)
                )?;
            }
            ArgumentKind::Integer { range, unit } => {
                write!(f, "a whole number, {} to {} {unit}", range.start(), range.end())?;
            }
            ArgumentKind::Passphrase => f.write_str("one word, upper and lower case differ, such as Heron-4711")?,
            ArgumentKind::Choice(_) | ArgumentKind::Confirmation(_) => {
                return write_list(f, &|number| self.nth_word(number), " or ");
            }
        }
        self.nth_word(0).map_or(Ok(()), |word| write!(f, ", or {word}"))
    }
}

/// Writes the reply to `help`, for all commands or for one.
///
/// # Errors
///
/// Those of `out`.
pub fn write_help(out: &mut dyn fmt::Write, topic: Option<&'static CommandSpec>) -> fmt::Result {
    let Some(topic) = topic else {
        writeln!(out, "ok help COMMAND explains one")?;
        return write_help_of_next_words(out, ExpectedElement::FirstWord);
    };
    writeln!(out, "ok {}", CommandHelp(topic))?;
    for argument in topic.arguments {
        writeln!(out, "{}: {argument}", argument.argument_name)?;
    }
    let [first, second] = topic.command_words;
    if second.is_empty() { write_help_of_next_words(out, ExpectedElement::SecondWord(first)) } else { Ok(()) }
}

/// Writes the help of each word allowed next.
fn write_help_of_next_words(out: &mut dyn fmt::Write, expected: ExpectedElement) -> fmt::Result {
    for word in (0..).map_while(|number| expected.nth_word(number)) {
        let words = if let ExpectedElement::SecondWord(first) = expected { [first, word] } else { [word, ""] };
        if let Some(row) = find_command(words) {
            writeln!(out, "{}", CommandHelp(row))?;
        }
    }
    Ok(())
}

/// Syntax and description of a command; for a first word also its second words.
struct CommandHelp(&'static CommandSpec);

impl Display for CommandHelp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.0, self.0.help_text)?;
        let [first, second] = self.0.command_words;
        if self.0.request_constructor.is_none() && second.is_empty() && !is_help(first) {
            f.write_str(": ")?;
            write_list(f, &|number| ExpectedElement::SecondWord(first).nth_word(number), ", ")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
