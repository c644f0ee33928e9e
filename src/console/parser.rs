//! Parser, completion and help of console lines, based on the table of commands.

use core::fmt::{self, Display};

use super::command_table::{ArgumentKind, ArgumentSpec, ArgumentValue, Arguments, COMMANDS, CommandSpec, Request};
use super::line_editor::LINE_CAPACITY;
use crate::decimal::{self, ShortestDecimal};
use crate::wire::mavlink::key_from_passphrase;

/// Reason why a line is invalid.
#[derive(Clone, Copy, Debug)]
pub enum LineError {
    /// Unknown command; contains the first word if it is valid.
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
mod tests {
    use super::*;
    use crate::calibration::method_selection::Procedure;
    use crate::calibration::{Method, Orientation};
    use crate::compass::Command;
    use crate::settings::{AttitudeError, HeadingKind, SensorError, SettingChange};
    use crate::settings::{BaudRate, PortNumber, ProtocolKind};

    fn parsed_command(line: &str) -> Command {
        match parse_request(line) {
            Some(Ok(Request::Command(command))) => command,
            other => panic!("{line}: {other:?}"),
        }
    }

    fn rejection_text(line: &str) -> String {
        match parse_request(line) {
            Some(Err(error)) => format!("{}: {error}", error.stable_code()),
            other => panic!("{line}: {other:?}"),
        }
    }

    fn help_reply(line: &str) -> String {
        let Some(Ok(Request::Help(topic))) = parse_request(line) else { panic!("{line}") };
        let mut text = String::new();
        write_help(&mut text, topic).unwrap();
        text
    }

    #[test]
    fn every_command_is_parsed() {
        let yaw90 = Orientation::from_name("yaw90").unwrap();
        let error = |bias_deg, bank_percent| SettingChange::AttitudeError(AttitudeError { bias_deg, bank_percent });
        let set = Command::Set;
        let examples = [
            ("cal start", Command::CalStart(Procedure::Flight)),
            ("cal start turns", Command::CalStart(Procedure::Turns)),
            ("cal start tumble", Command::CalStart(Procedure::Tumble)),
            ("cal start again", Command::CalStartNew(None)),
            ("cal start turns again", Command::CalStartNew(Some(Procedure::Turns))),
            ("cal auto on", set(SettingChange::Auto(true))),
            ("cal auto off", set(SettingChange::Auto(false))),
            ("cal mark 12.5", Command::CalMark(12.5)),
            ("cal stop", Command::CalStop),
            ("cal solve", Command::CalSolve(None)),
            ("cal solve two-plane", Command::CalSolve(Some(Method::TwoPlane))),
            ("cal advise", Command::CalAdvise),
            ("cal clear all", Command::CalClear),
            ("cal undo", Command::CalUndo),
            ("cal abort", Command::CalAbort),
            ("stream on", set(SettingChange::StreamOn(true))),
            ("stream off", set(SettingChange::StreamOn(false))),
            ("stream rate 25", set(SettingChange::StreamRateHz(25))),
            ("stream heading raw", set(SettingChange::StreamHeading(HeadingKind::Raw))),
            ("set declination -3.5", set(SettingChange::Declination(Some(-3.5)))),
            ("set declination none", set(SettingChange::Declination(None))),
            ("set mount yaw90", set(SettingChange::Mount(yaw90))),
            ("set inclination 61", set(SettingChange::Inclination(Some(61.0)))),
            ("set inclination none", set(SettingChange::Inclination(None))),
            ("set align 90", Command::Align(Some(90.0))),
            ("set align none", Command::Align(None)),
            ("set align 90.5 yes", Command::AlignConfirmed(90.5)),
            ("set attitude-error 0.5 2", set(error(0.5, 2.0))),
            ("set accuracy 0.7", set(SettingChange::Accuracy(0.7))),
            ("set port1 mavlink", set(SettingChange::Protocol(PortNumber::One, ProtocolKind::Mavlink))),
            ("set port2 msp", set(SettingChange::Protocol(PortNumber::Two, ProtocolKind::Msp))),
            ("set baud1 460800", set(SettingChange::Baud(PortNumber::One, BaudRate::B460800))),
            ("set baud2 57600", set(SettingChange::Baud(PortNumber::Two, BaudRate::B57600))),
            ("set vision on", set(SettingChange::Vision(true))),
            ("set vision off", set(SettingChange::Vision(false))),
            ("set attitude-rate 50", set(SettingChange::AttitudeRateHz(50))),
            ("set can-node 42", set(SettingChange::CanNode(42))),
            ("set can-rate 20", set(SettingChange::CanRateHz(20))),
            ("set can-covariance on", set(SettingChange::CanCovariance(true))),
            ("set can-termination on", set(SettingChange::CanTermination(true))),
            ("set signing off", set(SettingChange::Signing(None))),
            ("set signing 4711", set(SettingChange::Signing(Some(key_from_passphrase("4711"))))),
            (
                "set sensor-error 5 0.5",
                set(SettingChange::SensorError(SensorError { gyro_percent: 5.0, drift_percent: 0.5 })),
            ),
            ("set sensor-error default", set(SettingChange::SensorError(SensorError::DEFAULT))),
            ("set attitude-error default", set(SettingChange::AttitudeError(AttitudeError::DEFAULT))),
        ];
        for (line, meaning) in examples {
            assert_eq!(parsed_command(line), meaning, "{line}");
            // Commands are accepted in upper case and with extra spaces.
            assert_eq!(parsed_command(&line.to_ascii_uppercase()), meaning, "{line}");
            assert_eq!(parsed_command(&format!("  {}  ", line.replace(' ', "   "))), meaning, "{line}");
        }
        let others = [
            ("version", "Version"),
            ("STATUS", "Command(Status)"),
            ("status all", "Command(StatusAll)"),
            ("Cal Show", "Command(CalShow)"),
            ("reboot", "Command(Restart)"),
            ("help", "Help"),
        ];
        for (line, name) in others {
            let Some(Ok(request)) = parse_request(line) else { panic!("{line}") };
            assert!(format!("{request:?}").starts_with(name), "{request:?}");
        }
        for row in COMMANDS.iter().filter(|row| row.request_constructor.is_some()) {
            let words = row.command_words.join(" ");
            let mut tested_lines = examples.iter().map(|(line, _)| *line).chain(others.map(|(line, _)| line));
            assert!(tested_lines.any(|line| line.to_ascii_lowercase().starts_with(words.trim_end())), "{words}");
        }
        assert!(parse_request("").is_none() && parse_request("   ").is_none());
    }

    /// A passphrase is not changed to lower case: ground stations derive the key from it as typed.
    #[test]
    fn a_passphrase_keeps_its_case() {
        for passphrase in ["aBc", "abc"] {
            let line = format!("set signing {passphrase}");
            let expected = SettingChange::Signing(Some(key_from_passphrase(passphrase)));
            assert!(
                matches!(parse_request(&line), Some(Ok(Request::Command(Command::Set(setting)))) if setting == expected)
            );
        }
    }

    #[test]
    fn an_error_names_the_expected_argument() {
        for (line, complaint) in [
            ("frobnicate", "unknown-command: unknown command; help lists all"),
            ("stream fast", "unknown-command: after stream expected on, off, rate or heading"),
            ("STREAM", "missing-argument: after stream expected on, off, rate or heading"),
            ("help frobnicate", "unknown-command: unknown command; help lists all"),
            ("help stream fast", "unknown-command: after stream expected on, off, rate or heading"),
            ("help stream rate 5", "unexpected-argument: too many words; it is stream rate HZ"),
            ("help help me", "unexpected-argument: too many words; it is help"),
            ("help version 1", "unexpected-argument: too many words; it is version"),
            ("version 1", "unexpected-argument: too many words; it is version"),
            ("cal start level now", "bad-value: expected again"),
            ("cal start level again now", "unexpected-argument: too many words; it is cal start [PROCEDURE] [again]"),
            (
                "set attitude-error default 1",
                "unexpected-argument: too many words; it is set attitude-error DEG PERCENT",
            ),
            ("cal start sideways", "bad-value: expected flight, turns, level, swing, tumble or again"),
            ("set port1 can", "bad-value: expected auto, mavlink, msp or nmea"),
            ("set baud2 9600", "bad-value: expected 57600, 115200, 230400 or 460800"),
            ("cal auto maybe", "bad-value: expected on or off"),
            ("stream heading smoothed", "bad-value: expected raw or smooth"),
            ("stream heading smoot", "bad-value: expected raw or smooth"),
            ("cal mark north", "bad-value: expected a number, 0 to 360 deg"),
            ("cal mark 1e2", "bad-value: expected a number, 0 to 360 deg"),
            ("set declination east", "bad-value: expected a number, -180 to 180 deg, or none"),
            ("set declination default", "bad-value: expected a number, -180 to 180 deg, or none"),
            ("set inclination x", "bad-value: expected a number, -90 to 90 deg, or none"),
            ("set attitude-error much 1", "bad-value: expected a number, 0 to 5 deg, or default"),
            ("set attitude-error 1 much", "bad-value: expected a number, 0 to 20 %"),
            ("set attitude-error 1", "missing-argument: <PERCENT> is missing; expected a number, 0 to 20 %"),
            ("set sensor-error much 1", "bad-value: expected a number, 0.1 to 20 %, or default"),
            ("set sensor-error 1", "missing-argument: <DRIFT> is missing; expected a number, 0.05 to 5 % of the field"),
            ("stream rate", "missing-argument: <HZ> is missing; expected a whole number, 1 to 80 a second"),
            ("stream rate 300", "bad-value: expected a whole number, 1 to 80 a second"),
            ("stream rate 2.5", "bad-value: expected a whole number, 1 to 80 a second"),
            ("stream rate -1", "bad-value: expected a whole number, 1 to 80 a second"),
            ("set align 90 no", "bad-value: expected yes"),
            ("set align none yes", "unexpected-argument: too many words; it is set align HEADING [yes]"),
            (
                "set signing",
                "missing-argument: <PASSPHRASE> is missing; expected one word, upper and lower case differ, such as \
                 Heron-4711, or off",
            ),
            ("status twice", "bad-value: expected all"),
            ("cal clear", "needs-word: this cannot be undone; type cal clear all"),
            ("cal clear everything", "needs-word: this cannot be undone; type cal clear all"),
        ] {
            assert_eq!(rejection_text(line), complaint, "{line}");
        }
        assert_eq!(LineError::TooLong.to_string(), "a line holds 64 characters");
        assert_eq!(LineError::TooLong.stable_code(), "line-too-long");
        let mounts = rejection_text("set mount sideways");
        assert!(
            mounts.starts_with("bad-value: expected none, yaw90, ") && mounts.ends_with(" or roll90-yaw270"),
            "{mounts}"
        );
        assert!(Orientation::all_orientations().all(|mount| mounts.contains(mount.orientation_name())), "{mounts}");
    }

    #[test]
    fn a_range_is_shown_with_all_its_digits() {
        let kind = ArgumentKind::Number { range: 0.25..=7.5, unit: "deg", alternative: None };
        let slot = ArgumentSpec { argument_name: "DEG", argument_kind: kind, is_optional: false };
        assert_eq!(slot.to_string(), "a number, 0.25 to 7.5 deg");
    }

    #[test]
    fn help_explains_everything_there_is() {
        let all = help_reply("help");
        for row in COMMANDS {
            let words = row.command_words.join(" ");
            let reply = help_reply(&format!("help {words}"));
            assert!(reply.starts_with(&format!("ok {}", words.trim_end())), "{reply}");
            assert!(reply.contains(row.help_text), "{reply}");
            let [first, second] = row.command_words;
            let group = if second.is_empty() { all.clone() } else { help_reply(&format!("help {first}")) };
            assert!(
                group.starts_with("ok ") && group.contains(&format!("\n{row}: {}", row.help_text)),
                "{row}: {group}"
            );
        }
        assert_eq!(
            help_reply("HELP Stream"),
            "ok stream: heading sentences: on, off, rate, heading\n\
             stream on: send them\n\
             stream off: do not send them\n\
             stream rate HZ: sentences per second\n\
             stream heading KIND: heading sent: smoothed by the body rates, or raw for an autopilot with its own filter\n"
        );
        let mounts = help_reply("help set mount");
        assert!(Orientation::all_orientations().all(|mount| mounts.contains(mount.orientation_name())), "{mounts}");
        assert!(help_reply("help set inclination").ends_with("DEG: a number, -90 to 90 deg, or none\n"));
    }

    #[test]
    fn partial_words_are_completed() {
        for (line, rest, fit) in [
            ("", "", 7),
            ("v", "ersion", 1),
            ("VER", "sion", 1),
            ("version", "", 1),
            ("version ", "", 0),
            ("s", "", 3),
            ("st", "", 2),
            ("sta", "tus", 1),
            ("x", "", 0),
            ("cal", "", 1),
            ("cal ", "", 10),
            ("cal so", "lve", 1),
            ("cal s", "", 4),
            ("cal st", "", 2),
            ("CAL START ", "", 6),
            ("cal auto o", "", 2),
            ("cal start tu", "", 2),
            ("cal start tur", "ns", 1),
            ("cal start turns ", "again", 1),
            ("cal solve m", "aximum-likelihood", 1),
            ("cal clear ", "all", 1),
            ("cal nonsense ", "", 0),
            ("stream heading s", "mooth", 1),
            ("set att", "itude-", 2),
            ("set attitude-error d", "efault", 1),
            ("set attitude-error 1 d", "", 0),
            ("set declination n", "one", 1),
            ("set mount roll180-p", "itch", 2),
            ("set mount roll27", "0", 5),
            ("  set   mount   no", "ne", 1),
            ("set align 90 ", "yes", 1),
            ("help s", "", 3),
            ("help str", "eam", 1),
            ("help stream h", "eading", 1),
            ("help stream heading r", "", 0),
            ("stream rate ", "", 0),
        ] {
            let mut offered = 0;
            let found = complete_line(line, &mut |_| offered += 1);
            assert_eq!((found, offered), (Completion { continuation: rest, match_count: fit }, fit), "{line:?}");
        }
    }

    /// Random lines: no panic, and each error is one line of printable characters.
    #[test]
    fn no_line_stops_the_parser() {
        let mut random = testkit::random::Random(5);
        let words: Vec<&str> = COMMANDS
            .iter()
            .flat_map(|row| row.command_words)
            .chain(["none", "default", "all", "-1", "360.5", "", "\u{e9}"])
            .collect();
        for _ in 0..20_000 {
            let mut line = String::new();
            for _ in 0..random.byte() % 5 {
                let mut word = words[usize::from(random.byte()) % words.len()].to_owned();
                if random.byte() < 60 {
                    word.push(char::from(random.byte()));
                }
                line += &word;
                line.push(' ');
            }
            line.truncate(
                (0..=line.len() - usize::from(random.byte() % 3).min(line.len()))
                    .rfind(|&n| line.is_char_boundary(n))
                    .unwrap(),
            );
            complete_line(&line, &mut |_| {});
            if let Some(Err(error)) = parse_request(&line) {
                let text = error.to_string();
                assert!(!text.is_empty() && text.bytes().all(|byte| (b' '..=b'~').contains(&byte)), "{text:?}");
            }
        }
    }
}
