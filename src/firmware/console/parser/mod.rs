//! Parser, completion and help of console lines, based on the table of commands.

use core::fmt::{self, Display};

use super::command_table::{
    ArgumentKind, ArgumentSpec, ArgumentValue, Arguments, CommandForm, CommandSpec, Request, all_commands,
};
use super::line_editor::LINE_CAPACITY;
use crate::wire::mavlink::key_from_passphrase;
use autoswing::decimal::{self, ShortestDecimal};
use autoswing_module::compass::Command;
use autoswing_module::settings::{Setting, SettingChange, SettingKind, SettingValue, Settings};

/// Reason why a line is invalid.
#[derive(Clone, Copy, Debug)]
pub enum LineError {
    /// Unknown first word (`None`), or unknown second word after this known first one.
    UnknownCommand(Option<&'static str>),
    /// Missing second word; contains the first.
    MissingWord(&'static str),
    /// Missing argument.
    MissingArgument(ArgumentSpec),
    /// Invalid argument.
    BadValue(ArgumentSpec),
    /// More arguments than the command takes.
    UnexpectedArgument(CommandSpec),
    /// Destructive command without its confirmation word.
    MissingConfirmation(CommandSpec),
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
        match self {
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
    let command = find_command([first, ""]).ok_or(LineError::UnknownCommand(None))?;
    let [first, _] = command.command_words;
    match (command.command_form, words.next()) {
        (CommandForm::Help, None) => Ok(Request::Help(None)),
        (CommandForm::Help, Some(topic)) => parse_help(topic, words),
        (CommandForm::Group, None) => Err(LineError::MissingWord(first)),
        (CommandForm::Group, Some(second)) => {
            let command = find_command([first, second]).ok_or(LineError::UnknownCommand(Some(first)))?;
            parse_arguments(command, words)
        }
        (_, word) => parse_arguments(command, word.into_iter().chain(words)),
    }
}

fn parse_help<'a>(first: &str, mut words: impl Iterator<Item = &'a str>) -> Result<Request, LineError> {
    let command = find_command([first, ""]).ok_or(LineError::UnknownCommand(None))?;
    let command = match (command.command_form, words.next()) {
        (CommandForm::Group, Some(second)) => {
            find_command([first, second]).ok_or(LineError::UnknownCommand(Some(command.command_words[0])))?
        }
        (_, Some(_)) => return Err(LineError::UnexpectedArgument(command)),
        (_, None) => command,
    };
    if words.next().is_some() { Err(LineError::UnexpectedArgument(command)) } else { Ok(Request::Help(Some(command))) }
}

fn is_help(first: &str) -> bool {
    first == "help"
}

fn find_command(words: [&str; 2]) -> Option<CommandSpec> {
    all_commands().find(|row| row.command_words.iter().zip(words).all(|(word, typed)| word.eq_ignore_ascii_case(typed)))
}

fn parse_arguments<'a>(command: CommandSpec, mut words: impl Iterator<Item = &'a str>) -> Result<Request, LineError> {
    let mut arguments = Arguments([ArgumentValue::Absent; 2]);
    for (argument, value) in command.arguments().zip(&mut arguments.0) {
        let is_required_confirmation =
            matches!(argument.argument_kind, ArgumentKind::Confirmation(_)) && !argument.is_optional;
        let Some(word) = words.next() else {
            return match argument {
                _ if argument.is_optional => break,
                _ if is_required_confirmation => Err(LineError::MissingConfirmation(command)),
                _ => Err(LineError::MissingArgument(argument)),
            };
        };
        *value = match parse_value(&argument, word) {
            Some(value) => value,
            None if is_required_confirmation => return Err(LineError::MissingConfirmation(command)),
            None => return Err(LineError::BadValue(argument)),
        };
        // No argument follows a word in place of a number.
        if *value == ArgumentValue::Absent {
            break;
        }
    }
    if words.next().is_some() {
        return Err(LineError::UnexpectedArgument(command));
    }
    Ok(match command.command_form {
        CommandForm::Request(_, to_request) => to_request(&arguments),
        CommandForm::Settings([setting, more @ ..]) => Command::Set(setting_change(setting, more, &arguments)).into(),
        CommandForm::Settings([]) | CommandForm::Help | CommandForm::Group => Request::Help(Some(command)),
    })
}

/// Change of a command's settings; an omitted value is the default.
fn setting_change(setting: &'static Setting, more: &[Setting], arguments: &Arguments) -> SettingChange {
    let value_of = |setting: &Setting, argument| match argument {
        ArgumentValue::Setting(value) => value,
        _ => setting.value(&Settings::DEFAULT),
    };
    let [first, second] = arguments.0;
    let next_value = more.first().and_then(|next| match value_of(next, second) {
        SettingValue::Number(number) => number,
        _ => None,
    });
    SettingChange { setting, value: value_of(setting, first), next_value }
}

fn parse_value(argument: &ArgumentSpec, typed: &str) -> Option<ArgumentValue> {
    let word = (0..).map_while(|number| argument.nth_word(number)).position(|word| word.eq_ignore_ascii_case(typed));
    match (argument.argument_kind, word) {
        (ArgumentKind::Choice(_) | ArgumentKind::Confirmation(_), word) => word.map(ArgumentValue::Choice),
        (ArgumentKind::Heading(_), None) => decimal::parse_decimal(typed).map(ArgumentValue::Number),
        (ArgumentKind::Heading(_) | ArgumentKind::Setting(Setting { kind: SettingKind::Number(..), .. }), Some(_)) => {
            Some(ArgumentValue::Absent)
        }
        (ArgumentKind::Setting(setting), Some(index)) => {
            setting.nth_word(index).map(|(_, value)| ArgumentValue::Setting(value))
        }
        (ArgumentKind::Setting(setting), None) => parse_setting_value(setting, typed).map(ArgumentValue::Setting),
    }
}

/// Parses a value that is not one of the setting's words.
fn parse_setting_value(setting: &Setting, typed: &str) -> Option<SettingValue> {
    match setting.kind {
        SettingKind::Switch(..) | SettingKind::Choice(_) | SettingKind::Alignment(_) => None,
        SettingKind::Whole(..) => typed.parse::<u8>().ok().map(|number| SettingValue::Whole(number.into())),
        SettingKind::Number(..) | SettingKind::Angle(..) => {
            decimal::parse_decimal(typed).map(|number| SettingValue::Number(Some(number)))
        }
        SettingKind::Key(_) => Some(SettingValue::Key(Some(key_from_passphrase(typed)))),
    }
}

/// Syntax element expected next in a line.
#[derive(Clone, Copy)]
enum ExpectedElement {
    FirstWord,
    SecondWord(&'static str),
    Argument(ArgumentSpec),
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
        let Some(command) = find_command([first, ""]) else { return Self::Nothing };
        let command = match command.command_form {
            CommandForm::Help | CommandForm::Group => {
                let Some(second) = words.next() else { return Self::SecondWord(command.command_words[0]) };
                find_command([first, second])
            }
            _ => Some(command),
        };
        let Some(command) = command.filter(|_| !is_explained) else { return Self::Nothing };
        command.nth_argument(words.count()).map_or(Self::Nothing, Self::Argument)
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
    all_commands().map(|command| command.command_words)
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
        for argument in self.arguments() {
            let (opening, closing) = if argument.is_optional { ("[", "]") } else { ("", "") };
            write!(f, " {opening}{}{closing}", argument.argument_name)?;
        }
        Ok(())
    }
}

impl ArgumentSpec {
    fn write_words(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_list(f, &|number| self.nth_word(number), " or ")
    }
}

impl Display for ArgumentSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (range, unit) = match self.argument_kind {
            ArgumentKind::Heading(_) => ([0.0, 360.0], "deg"),
            ArgumentKind::Choice(_) | ArgumentKind::Confirmation(_) => return self.write_words(f),
            ArgumentKind::Setting(setting) => match setting.kind {
                SettingKind::Number(_, range, unit, ..) => (range, unit),
                SettingKind::Angle(_, range, ..) => (range, "deg"),
                SettingKind::Whole(_, [least, most], unit, _) => {
                    return write!(f, "a whole number, {least} to {most} {unit}");
                }
                SettingKind::Key(_) => {
                    return f.write_str("one word, upper and lower case differ, such as Heron-4711, or off");
                }
                SettingKind::Switch(..) | SettingKind::Choice(_) | SettingKind::Alignment(_) => {
                    return self.write_words(f);
                }
            },
        };
        let [least, most] = range.map(|number| ShortestDecimal(number, 0));
        write!(f, "a number, {least} to {most} {unit}")?;
        self.nth_word(0).map_or(Ok(()), |word| write!(f, ", or {word}"))
    }
}

/// Writes the reply to `help`, for all commands or for one.
///
/// # Errors
///
/// Those of `out`.
pub fn write_help(out: &mut dyn fmt::Write, topic: Option<CommandSpec>) -> fmt::Result {
    let Some(topic) = topic else {
        writeln!(out, "ok help COMMAND explains one")?;
        return write_help_of_next_words(out, ExpectedElement::FirstWord);
    };
    writeln!(out, "ok {}", CommandHelp(topic))?;
    for argument in topic.arguments() {
        writeln!(out, "{}: {argument}", argument.argument_name)?;
    }
    let [first, second] = topic.command_words;
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
struct CommandHelp(CommandSpec);

impl Display for CommandHelp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.0, self.0.help_text)?;
        let [first, _] = self.0.command_words;
        if let CommandForm::Group = self.0.command_form {
            f.write_str(": ")?;
            write_list(f, &|number| ExpectedElement::SecondWord(first).nth_word(number), ", ")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
