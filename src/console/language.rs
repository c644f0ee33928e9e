//! What a line means, how it goes on, and what may be said about its words: all from the table of [`words`](super::words).

use core::fmt::{self, Display};

use super::words::{Given, Kind, ROWS, Row, Slot, Value};
use super::{LINE_CAPACITY, Request};
use crate::settings::ProtocolKind;
use crate::wire::decimal::{self, AsTyped};

/// Why a line means nothing.
#[derive(Clone, Copy, Debug)]
pub enum LineError {
    /// No such command; after which first word, if that was right.
    UnknownCommand(Option<&'static str>),
    /// The second word is missing; the first.
    MissingWord(&'static str),
    /// An argument is missing; which.
    MissingArgument(&'static Slot),
    /// An argument is not what it must be; which.
    BadValue(&'static Slot),
    /// More, or other, arguments than the command takes.
    UnexpectedArgument(&'static Row),
    /// A destructive command without its word.
    NeedsWord(&'static Row),
    /// Something of a protocol that this firmware was built without.
    LeftOut(ProtocolKind),
    /// More characters than a line holds.
    TooLong,
}

impl LineError {
    /// Stable code, kebab-case.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::UnknownCommand(_) => "unknown-command",
            Self::MissingWord(_) | Self::MissingArgument(_) => "missing-argument",
            Self::BadValue(_) => "bad-value",
            Self::UnexpectedArgument(_) => "unexpected-argument",
            Self::NeedsWord(_) => "needs-word",
            Self::LeftOut(_) => "not-in-firmware",
            Self::TooLong => "line-too-long",
        }
    }
}

/// What to do about it, in words.
impl Display for LineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::UnknownCommand(None) => f.write_str("no such command; help lists them"),
            Self::UnknownCommand(Some(first)) | Self::MissingWord(first) => {
                write!(f, "after {first} expected ")?;
                listed(f, &|number| Next::Second(first).word(number), " or ")
            }
            Self::MissingArgument(slot) => write!(f, "<{}> is missing; expected {slot}", slot.name),
            Self::BadValue(slot) => write!(f, "expected {slot}"),
            Self::UnexpectedArgument(row) => write!(f, "too many words; it is {row}"),
            Self::NeedsWord(row) => write!(f, "this cannot be undone; type {row}"),
            Self::LeftOut(kind) => write!(f, "this firmware was built without {}", kind.name()),
            Self::TooLong => write!(f, "a line holds {LINE_CAPACITY} characters"),
        }
    }
}

/// What a line asks for; nothing if nothing is in it. Letters may be of either case.
///
/// # Errors
///
/// The first [`LineError`] from the left.
#[must_use]
pub fn parse(line: &str) -> Option<Result<Request, LineError>> {
    let mut words = Words(line);
    words.next().map(|first| after(first, &mut words))
}

/// The words of a line that are left. The iterators of `core` would be in flash wherever they are used.
struct Words<'a>(&'a str);

impl<'a> Words<'a> {
    #[inline(never)]
    fn next(&mut self) -> Option<&'a str> {
        let is_space = |&byte: &u8| byte == b' ';
        let begin = self.0.bytes().position(|byte| !is_space(&byte))?;
        let rest = self.0.get(begin..)?;
        let end = rest.bytes().position(|byte| is_space(&byte)).unwrap_or(rest.len());
        let (word, rest) = rest.split_at_checked(end)?;
        self.0 = rest;
        Some(word)
    }
}

/// A line up to its last word, and that word: the empty one after a space.
fn last_word(line: &str) -> (&str, &str) {
    let begin = line.bytes().rposition(|byte| byte == b' ').map_or(0, |space| space + 1);
    line.split_at_checked(begin).unwrap_or((line, ""))
}

fn after(first: &str, words: &mut Words<'_>) -> Result<Request, LineError> {
    let row = here([first, ""], LineError::UnknownCommand(None))?;
    if let Some(means) = row.means {
        return meaning(row, means, words);
    }
    let [first, _] = row.words;
    let Some(second) = words.next() else {
        return if is_help(first) { Ok(Request::Help(None)) } else { Err(LineError::MissingWord(first)) };
    };
    if is_help(first) {
        return explained(second, words);
    }
    let row = here([first, second], LineError::UnknownCommand(Some(first)))?;
    row.means.map_or(Err(LineError::UnknownCommand(None)), |means| meaning(row, means, words))
}

/// The row that `help` is asked for.
fn explained(first: &str, words: &mut Words<'_>) -> Result<Request, LineError> {
    let row = here([first, ""], LineError::UnknownCommand(None))?;
    let row = match words.next() {
        Some(second) if row.means.is_none() && !is_help(row.words[0]) => {
            here([first, second], LineError::UnknownCommand(Some(row.words[0])))?
        }
        Some(_) => return Err(LineError::UnexpectedArgument(row)),
        None => row,
    };
    if words.next().is_some() { Err(LineError::UnexpectedArgument(row)) } else { Ok(Request::Help(Some(row))) }
}

fn is_help(first: &str) -> bool {
    first == "help"
}

fn find(words: [&str; 2]) -> Option<&'static Row> {
    ROWS.iter().find(|row| row.words.iter().zip(words).all(|(word, typed)| word.eq_ignore_ascii_case(typed)))
}

/// The row of these words, if this firmware has it.
fn here(words: [&str; 2], unknown: LineError) -> Result<&'static Row, LineError> {
    let row = find(words).ok_or(unknown)?;
    row.left_out().map_or(Ok(row), |kind| Err(LineError::LeftOut(kind)))
}

fn meaning(row: &'static Row, means: fn(&Given) -> Request, words: &mut Words<'_>) -> Result<Request, LineError> {
    let mut given = Given([Value::Nothing; 2]);
    for (slot, value) in row.slots.iter().zip(&mut given.0) {
        let Some(word) = words.next() else {
            match slot.kind {
                _ if slot.is_optional => break,
                Kind::Sure(_) => return Err(LineError::NeedsWord(row)),
                _ => return Err(LineError::MissingArgument(slot)),
            }
        };
        *value = match value_of(slot, word) {
            Some(value) => value,
            None if matches!(slot.kind, Kind::Sure(_)) && !slot.is_optional => return Err(LineError::NeedsWord(row)),
            None => return Err(slot.left_out(word).map_or(LineError::BadValue(slot), LineError::LeftOut)),
        };
        // After a word instead of a number comes nothing.
        if *value == Value::Nothing {
            break;
        }
    }
    if words.next().is_some() { Err(LineError::UnexpectedArgument(row)) } else { Ok(means(&given)) }
}

fn value_of(slot: &Slot, typed: &str) -> Option<Value> {
    let choice = (0..).map_while(|number| slot.word(number)).position(|word| word.eq_ignore_ascii_case(typed));
    match &slot.kind {
        Kind::Choice(_) | Kind::Sure(_) => choice.map(Value::Choice),
        Kind::Number { .. } if choice.is_some() => Some(Value::Nothing),
        Kind::Number { .. } => decimal::parse(typed).map(Value::Number),
        Kind::Whole { .. } => typed.parse::<u8>().ok().map(|number| Value::Number(f32::from(number))),
    }
}

/// What may come next in a line.
#[derive(Clone, Copy)]
enum Next {
    First,
    Second(&'static str),
    Slot(&'static Slot),
    Nothing,
}

impl Next {
    /// After words that are complete.
    fn after(line: &str) -> Self {
        let mut words = Words(line);
        let Some(mut first) = words.next() else { return Self::First };
        let is_explained = is_help(first);
        if is_explained {
            let Some(explained) = words.next() else { return Self::First };
            first = explained;
        }
        let offered = |words| find(words).filter(|row| row.left_out().is_none());
        let Some(row) = offered([first, ""]) else { return Self::Nothing };
        let row = if row.means.is_some() {
            Some(row)
        } else {
            let Some(second) = words.next() else { return Self::Second(row.words[0]) };
            offered([first, second])
        };
        let Some(row) = row.filter(|_| !is_explained) else { return Self::Nothing };
        let mut slots = row.slots.iter();
        while words.next().is_some() {
            slots.next();
        }
        slots.next().map_or(Self::Nothing, Self::Slot)
    }

    /// The words that may come, by their numbers.
    fn word(self, number: usize) -> Option<&'static str> {
        match self {
            Self::First => offered().filter(|[_, second]| second.is_empty()).map(|[first, _]| first).nth(number),
            Self::Second(of) => {
                let of_it = |[first, second]: &[&'static str; 2]| *first == of && !second.is_empty();
                offered().filter(of_it).map(|[_, second]| second).nth(number)
            }
            Self::Slot(slot) => slot.word(number),
            Self::Nothing => None,
        }
    }
}

/// The words of the rows that this firmware has.
fn offered() -> impl Iterator<Item = [&'static str; 2]> {
    ROWS.iter().filter(|row| row.left_out().is_none()).map(|row| row.words)
}

/// How the last word of a line can go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Completion {
    /// What all words that fit have in common beyond what is there.
    pub rest: &'static str,
    /// How many fit.
    pub fit: usize,
}

/// Completes the last word of a line, the empty one after a space; the words that fit are told one by one.
pub fn complete(line: &str, fits: &mut dyn FnMut(&'static str)) -> Completion {
    let (before, typed) = last_word(line);
    let next = Next::after(before);
    let mut rest: Option<&'static str> = None;
    let mut fit = 0;
    for word in (0..).map_while(|number| next.word(number)) {
        let Some(found) = beyond(word, typed) else { continue };
        fits(word);
        fit += 1;
        rest = Some(rest.map_or(found, |rest| in_common(rest, found)));
    }
    Completion { rest: rest.unwrap_or_default(), fit }
}

/// What of a word comes after what is typed of it.
fn beyond(word: &'static str, typed: &str) -> Option<&'static str> {
    word.get(..typed.len()).filter(|start| start.eq_ignore_ascii_case(typed)).and_then(|_| word.get(typed.len()..))
}

fn in_common(one: &'static str, other: &str) -> &'static str {
    let alike = one.bytes().zip(other.bytes()).take_while(|(a, b)| a == b).count();
    one.get(..alike).unwrap_or_default()
}

/// A list of the words that have a number, with commas, and something else before the last.
fn listed(f: &mut fmt::Formatter<'_>, word: &dyn Fn(usize) -> Option<&'static str>, last: &str) -> fmt::Result {
    let mut number = 0;
    while let Some(found) = word(number) {
        let is_last = word(number + 1).is_none();
        f.write_str(if number == 0 {
            ""
        } else if is_last {
            last
        } else {
            ", "
        })?;
        f.write_str(found)?;
        number += 1;
    }
    Ok(())
}

/// How it is typed.
impl Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [first, second] = self.words;
        f.write_str(first)?;
        if !second.is_empty() {
            write!(f, " {second}")?;
        }
        for slot in self.slots {
            let (open, close) = if slot.is_optional { ("[", "]") } else { ("", "") };
            write!(f, " {open}{}{close}", slot.name)?;
        }
        Ok(())
    }
}

/// What it takes.
impl Display for Slot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.kind {
            Kind::Number { range, unit, .. } => {
                write!(f, "a number, {} to {} {unit}", AsTyped(*range.start(), 0), AsTyped(*range.end(), 0))?;
            }
            Kind::Whole { range, unit } => {
                write!(f, "a whole number, {} to {} {unit}", range.start(), range.end())?;
            }
            Kind::Choice(_) | Kind::Sure(_) => return listed(f, &|number| self.word(number), " or "),
        }
        self.word(0).map_or(Ok(()), |word| write!(f, ", or {word}"))
    }
}

/// `help`, of everything or of a row.
///
/// # Errors
///
/// What `out` says.
pub fn help(out: &mut dyn fmt::Write, of: Option<&'static Row>) -> fmt::Result {
    let Some(of) = of else {
        writeln!(out, "ok help COMMAND explains one")?;
        return below(out, Next::First);
    };
    writeln!(out, "ok {}", Explained(of))?;
    for slot in of.slots {
        writeln!(out, "{}: {slot}", slot.name)?;
    }
    let [first, second] = of.words;
    if second.is_empty() { below(out, Next::Second(first)) } else { Ok(()) }
}

/// A line for each word that may come.
fn below(out: &mut dyn fmt::Write, next: Next) -> fmt::Result {
    for word in (0..).map_while(|number| next.word(number)) {
        let words = if let Next::Second(first) = next { [first, word] } else { [word, ""] };
        if let Some(row) = find(words) {
            writeln!(out, "{}", Explained(row))?;
        }
    }
    Ok(())
}

/// How a command is typed, and what it does; of a first word, which others there are.
struct Explained(&'static Row);

impl Display for Explained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.0, self.0.help)?;
        let [first, second] = self.0.words;
        if self.0.means.is_none() && second.is_empty() && !is_help(first) {
            f.write_str(": ")?;
            listed(f, &|number| Next::Second(first).word(number), ", ")?;
        }
        Ok(())
    }
}

#[cfg(all(feature = "mavlink", feature = "msp", feature = "nmea"))]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::ladder::Procedure;
    use crate::calibration::{Method, Orientation};
    use crate::compass::Command;
    use crate::settings::{AttitudeError, HeadingKind, Setting};
    use crate::settings::{Baud, PortNumber};

    fn command(line: &str) -> Command {
        match parse(line) {
            Some(Ok(Request::Compass(command))) => command,
            other => panic!("{line}: {other:?}"),
        }
    }

    fn refused(line: &str) -> String {
        match parse(line) {
            Some(Err(error)) => format!("{}: {error}", error.code()),
            other => panic!("{line}: {other:?}"),
        }
    }

    fn helped(line: &str) -> String {
        let Some(Ok(Request::Help(of))) = parse(line) else { panic!("{line}") };
        let mut text = String::new();
        help(&mut text, of).unwrap();
        text
    }

    /// Each row of the table by the example of its meaning.
    #[test]
    fn every_command_means_what_it_says() {
        let yaw90 = Orientation::from_name("yaw90").unwrap();
        let error = |bias_deg, bank_percent| Setting::AttitudeError(AttitudeError { bias_deg, bank_percent });
        let set = Command::Set;
        let examples = [
            ("cal start", Command::CalStart(Procedure::Flight)),
            ("cal start turns", Command::CalStart(Procedure::Turns)),
            ("cal start tumble", Command::CalStart(Procedure::Tumble)),
            ("cal start again", Command::CalStartAgain(None)),
            ("cal start turns again", Command::CalStartAgain(Some(Procedure::Turns))),
            ("cal auto on", set(Setting::Auto(true))),
            ("cal auto off", set(Setting::Auto(false))),
            ("cal mark 12.5", Command::CalMark(12.5)),
            ("cal stop", Command::CalStop),
            ("cal solve", Command::CalSolve(None)),
            ("cal solve two-plane", Command::CalSolve(Some(Method::TwoPlane))),
            ("cal advise", Command::CalAdvise),
            ("cal clear all", Command::CalClear),
            ("cal undo", Command::CalUndo),
            ("cal abort", Command::CalAbort),
            ("stream on", set(Setting::StreamOn(true))),
            ("stream off", set(Setting::StreamOn(false))),
            ("stream rate 25", set(Setting::StreamRateHz(25))),
            ("stream heading raw", set(Setting::StreamHeading(HeadingKind::Raw))),
            ("set declination -3.5", set(Setting::Declination(Some(-3.5)))),
            ("set declination none", set(Setting::Declination(None))),
            ("set mount yaw90", set(Setting::Mount(yaw90))),
            ("set inclination 61", set(Setting::Inclination(Some(61.0)))),
            ("set inclination none", set(Setting::Inclination(None))),
            ("set align 90", Command::Align(Some(90.0))),
            ("set align none", Command::Align(None)),
            ("set align 90.5 yes", Command::AlignSurely(90.5)),
            ("set attitude-error 0.5 2", set(error(0.5, 2.0))),
            ("set accuracy 0.7", set(Setting::Accuracy(0.7))),
            ("set port1 mavlink", set(Setting::Protocol(PortNumber::One, ProtocolKind::Mavlink))),
            ("set port2 msp", set(Setting::Protocol(PortNumber::Two, ProtocolKind::Msp))),
            ("set baud1 460800", set(Setting::Baud(PortNumber::One, Baud::B460800))),
            ("set baud2 57600", set(Setting::Baud(PortNumber::Two, Baud::B57600))),
            ("set vision on", set(Setting::Vision(true))),
            ("set vision off", set(Setting::Vision(false))),
            ("set attitude-error default", set(Setting::AttitudeError(AttitudeError::DEFAULT))),
        ];
        for (line, meaning) in examples {
            assert_eq!(command(line), meaning, "{line}");
            // In any case, and with any spaces.
            assert_eq!(command(&line.to_ascii_uppercase()), meaning, "{line}");
            assert_eq!(command(&format!("  {}  ", line.replace(' ', "   "))), meaning, "{line}");
        }
        let others = [
            ("version", "Version"),
            ("STATUS", "Status"),
            ("Cal Show", "CalShow"),
            ("reboot", "Reboot"),
            ("help", "Help"),
        ];
        for (line, name) in others {
            let Some(Ok(request)) = parse(line) else { panic!("{line}") };
            assert!(format!("{request:?}").starts_with(name), "{request:?}");
        }
        for row in ROWS.iter().filter(|row| row.means.is_some()) {
            let words = row.words.join(" ");
            let mut tried = examples.iter().map(|(line, _)| *line).chain(others.map(|(line, _)| line));
            assert!(tried.any(|line| line.to_ascii_lowercase().starts_with(words.trim_end())), "{words}");
        }
        assert!(parse("").is_none() && parse("   ").is_none());
    }

    /// The complaint says what can be typed instead: choices, ranges and units, of what there is.
    #[test]
    fn a_complaint_says_what_is_expected() {
        for (line, complaint) in [
            ("frobnicate", "unknown-command: no such command; help lists them"),
            ("stream fast", "unknown-command: after stream expected on, off, rate or heading"),
            ("STREAM", "missing-argument: after stream expected on, off, rate or heading"),
            ("help frobnicate", "unknown-command: no such command; help lists them"),
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
            ("stream rate", "missing-argument: <HZ> is missing; expected a whole number, 1 to 80 a second"),
            ("stream rate 300", "bad-value: expected a whole number, 1 to 80 a second"),
            ("stream rate 2.5", "bad-value: expected a whole number, 1 to 80 a second"),
            ("stream rate -1", "bad-value: expected a whole number, 1 to 80 a second"),
            ("set align 90 no", "bad-value: expected yes"),
            ("set align none yes", "unexpected-argument: too many words; it is set align HEADING [yes]"),
            ("cal clear", "needs-word: this cannot be undone; type cal clear all"),
            ("cal clear everything", "needs-word: this cannot be undone; type cal clear all"),
        ] {
            assert_eq!(refused(line), complaint, "{line}");
        }
        assert_eq!(LineError::TooLong.to_string(), "a line holds 64 characters");
        assert_eq!(LineError::TooLong.code(), "line-too-long");
        let mounts = refused("set mount sideways");
        assert!(
            mounts.starts_with("bad-value: expected none, yaw90, ") && mounts.ends_with(" or roll90-yaw270"),
            "{mounts}"
        );
        assert!(Orientation::all().all(|mount| mounts.contains(mount.name())), "{mounts}");
    }

    #[test]
    fn a_range_is_told_to_its_digits() {
        let kind = Kind::Number { range: 0.25..=7.5, unit: "deg", or: None };
        let slot = Slot { name: "DEG", kind, is_optional: false };
        assert_eq!(slot.to_string(), "a number, 0.25 to 7.5 deg");
    }

    /// Everything of the table is explained, and each reply begins as all do.
    #[test]
    fn help_explains_everything_there_is() {
        let all = helped("help");
        for row in ROWS {
            let words = row.words.join(" ");
            let of_it = helped(&format!("help {words}"));
            assert!(of_it.starts_with(&format!("ok {}", words.trim_end())), "{of_it}");
            assert!(of_it.contains(row.help), "{of_it}");
            let [first, second] = row.words;
            let group = if second.is_empty() { all.clone() } else { helped(&format!("help {first}")) };
            assert!(group.starts_with("ok ") && group.contains(&format!("\n{row}: {}", row.help)), "{row}: {group}");
        }
        assert_eq!(
            helped("HELP Stream"),
            "ok stream: heading sentences: on, off, rate, heading\n\
             stream on: send them\n\
             stream off: do not send them\n\
             stream rate HZ: how many a second\n\
             stream heading KIND: which heading: smoothed by the body rates, or raw for an autopilot with a filter\n"
        );
        let mounts = helped("help set mount");
        assert!(Orientation::all().all(|mount| mounts.contains(mount.name())), "{mounts}");
        assert!(helped("help set inclination").ends_with("DEG: a number, -90 to 90 deg, or none\n"));
    }

    #[test]
    fn every_word_is_completed() {
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
            ("set att", "itude-error", 1),
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
            let mut told = 0;
            let found = complete(line, &mut |_| told += 1);
            assert_eq!((found, told), (Completion { rest, fit }, fit), "{line:?}");
        }
    }

    /// Whatever is typed: no panic, and what is refused says so in one line of plain characters.
    #[test]
    fn no_line_stops_it() {
        let mut random = testkit::random::Random(5);
        let words: Vec<&str> = ROWS
            .iter()
            .flat_map(|row| row.words)
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
            complete(&line, &mut |_| {});
            if let Some(Err(error)) = parse(&line) {
                let text = error.to_string();
                assert!(!text.is_empty() && text.bytes().all(|byte| (b' '..=b'~').contains(&byte)), "{text:?}");
            }
        }
    }
}
