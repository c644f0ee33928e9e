//! Every word of the console, in one table: what is parsed, completed, explained and complained of comes from here.
//!
//! A new command is a row of [`ROWS`]; a new setting that is a number or a name, too.

use core::ops::RangeInclusive;

use super::Request;
use crate::calibration::ladder::Procedure;
use crate::calibration::{Method, Orientation};
use crate::compass::Command;
use crate::settings::{AttitudeError, HeadingKind, Setting, Settings};
use crate::settings::{Baud, PortNumber, ProtocolKind};

/// A command, or the first word of several.
#[derive(Debug)]
pub struct Row {
    /// Its one or two words, lower case; the second empty where there is one.
    pub words: [&'static str; 2],
    /// What it does.
    pub help: &'static str,
    /// What follows the words.
    pub slots: &'static [Slot],
    /// What it asks for; nothing where another word is wanted.
    pub means: Option<fn(&Given) -> Request>,
}

/// What follows the words of a command.
#[derive(Debug)]
pub struct Slot {
    /// What it is called, upper case.
    pub name: &'static str,
    /// What it must be.
    pub kind: Kind,
    /// Whether it may be left away.
    pub is_optional: bool,
}

/// What a slot takes.
#[derive(Debug)]
pub enum Kind {
    /// One of these names, by its number.
    Choice(fn(usize) -> Option<&'static str>),
    /// A number in a range and a unit, or a word instead, after which nothing follows. The range is what a person is
    /// told; whoever takes the number looks whether it is in it.
    Number {
        /// From least to most.
        range: RangeInclusive<f32>,
        /// What it is counted in.
        unit: &'static str,
        /// The word.
        or: Option<&'static str>,
    },
    /// A whole number of at most 255.
    Whole {
        /// From least to most.
        range: RangeInclusive<u8>,
        /// What it is counted in.
        unit: &'static str,
    },
    /// A word that says that it is meant.
    Sure(&'static str),
}

/// What stood in a slot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// Nothing, or the word instead of a number.
    Nothing,
    /// A number.
    Number(f32),
    /// The choice of this number.
    Choice(usize),
}

/// What stood in the slots of a command: as many as any has.
#[derive(Debug)]
pub struct Given(pub [Value; 2]);

impl Given {
    fn number(&self, slot: usize) -> Option<f32> {
        match self.0.get(slot) {
            Some(&Value::Number(number)) => Some(number),
            _ => None,
        }
    }

    fn choice<T>(&self, slot: usize, of: impl Fn(usize) -> Option<T>) -> Option<T> {
        match self.0.get(slot) {
            Some(&Value::Choice(number)) => of(number),
            _ => None,
        }
    }
}

impl Row {
    const fn new(first: &'static str, second: &'static str, help: &'static str) -> Self {
        Self { words: [first, second], help, slots: &[], means: None }
    }

    const fn takes(self, slots: &'static [Slot]) -> Self {
        Self { slots, ..self }
    }

    const fn means(self, means: fn(&Given) -> Request) -> Self {
        Self { means: Some(means), ..self }
    }

    /// The protocol that it is for, where this firmware was built without it. `stream` is for sentences; on, off and the kind
    /// of heading are for MAVLink's named values, too.
    #[must_use]
    pub fn left_out(&self) -> Option<ProtocolKind> {
        let of = match self.words {
            ["set", "vision"] => ProtocolKind::Mavlink,
            ["stream", "rate"] => ProtocolKind::Nmea,
            ["stream", _] if !ProtocolKind::Mavlink.is_here() => ProtocolKind::Nmea,
            _ => return None,
        };
        if of.is_here() { None } else { Some(of) }
    }
}

impl Slot {
    const fn new(name: &'static str, kind: Kind) -> Self {
        Self { name, kind, is_optional: false }
    }

    const fn optional(name: &'static str, kind: Kind) -> Self {
        Self { name, kind, is_optional: true }
    }

    /// The protocol of a word that this would take, had the firmware been built with it.
    pub fn left_out(&self, typed: &str) -> Option<ProtocolKind> {
        let is_it = |kind: &ProtocolKind| !kind.is_here() && kind.name().eq_ignore_ascii_case(typed);
        ProtocolKind::ALL.into_iter().find(is_it).filter(|_| self.name == PROTOCOL.name)
    }

    /// The names it takes, by their numbers.
    pub fn word(&self, number: usize) -> Option<&'static str> {
        let only = |word| if number == 0 { word } else { None };
        match self.kind {
            Kind::Choice(name) => name(number),
            Kind::Number { or, .. } => only(or),
            Kind::Whole { .. } => None,
            Kind::Sure(word) => only(Some(word)),
        }
    }
}

const DEGREES: &str = "deg";

const HEADING: Kind = Kind::Number { range: 0.0..=360.0, unit: DEGREES, or: None };

const fn number(range: RangeInclusive<f32>, unit: &'static str) -> Kind {
    Kind::Number { range, unit, or: None }
}

const fn number_or(word: &'static str, range: RangeInclusive<f32>) -> Kind {
    Kind::Number { range, unit: DEGREES, or: Some(word) }
}

/// The rows in the order in which they are listed, those of one first word together.
pub static ROWS: &[Row] = &[
    Row::new("help", "", "list the commands, or explain one"),
    Row::new("version", "", "show the firmware's version").means(|_| Request::Version),
    Row::new("status", "", "show state, sensors, progress, settings, counters").means(|_| Request::Status),
    Row::new("cal", "", "calibration"),
    Row::new(
        "cal",
        "start",
        "begin collecting; flight, turns and level solve by themselves, swing and tumble by cal solve",
    )
    .takes(&[
        Slot::optional("PROCEDURE", Kind::Choice(procedure_or_again)),
        Slot::optional("again", Kind::Sure("again")),
    ])
    .means(|given| match (given.0, given.choice(0, nth_procedure)) {
        ([Value::Choice(AGAIN), _] | [_, Value::Choice(_)], procedure) => Command::CalStartAgain(procedure).into(),
        (_, procedure) => Command::CalStart(procedure.unwrap_or_default()).into(),
    }),
    Row::new("cal", "auto", "collect by itself while uncalibrated, as soon as the autopilot is armed")
        .takes(&[Slot::new("SWITCH", Kind::Choice(switch))])
        .means(|given| set(Setting::Auto(given.choice(0, nth_switch).unwrap_or(true)))),
    Row::new("cal", "mark", "in a swing: the magnetic heading the vehicle stands at")
        .takes(&[Slot::new("HEADING", HEADING)])
        .means(|given| Command::CalMark(given.number(0).unwrap_or(f32::NAN)).into()),
    Row::new("cal", "stop", "stop collecting, keep the samples").means(|_| Command::CalStop.into()),
    Row::new("cal", "solve", "solve with the samples there are, by what they support or by a method")
        .takes(&[Slot::optional("METHOD", Kind::Choice(method))])
        .means(|given| Command::CalSolve(given.choice(0, |number| METHODS.get(number).copied())).into()),
    Row::new("cal", "advise", "show what is weak in the last solve, and what to fly")
        .means(|_| Command::CalAdvise.into()),
    Row::new("cal", "show", "show the calibration in use").means(|_| Request::CalShow),
    Row::new("cal", "clear", "forget the stored calibrations")
        .takes(&[Slot::new("all", Kind::Sure("all"))])
        .means(|_| Command::CalClear.into()),
    Row::new("cal", "undo", "back to the calibration before; again: forward").means(|_| Command::CalUndo.into()),
    Row::new("cal", "abort", "stop what runs, forget the samples").means(|_| Command::CalAbort.into()),
    Row::new("stream", "", "heading sentences"),
    Row::new("stream", "on", "send them").means(|_| set(Setting::StreamOn(true))),
    Row::new("stream", "off", "do not send them").means(|_| set(Setting::StreamOn(false))),
    Row::new("stream", "rate", "how many a second")
        .takes(&[Slot::new("HZ", Kind::Whole { range: Settings::STREAM_RATE_HZ, unit: "a second" })])
        .means(|given| set(Setting::StreamRateHz(given.number(0).unwrap_or_default() as u8))),
    Row::new("stream", "heading", "which heading: smoothed by the body rates, or raw for an autopilot with a filter")
        .takes(&[Slot::new("KIND", Kind::Choice(heading_kind))])
        .means(|given| set(Setting::StreamHeading(given.choice(0, nth_kind).unwrap_or(HeadingKind::Smooth)))),
    Row::new("set", "", "settings"),
    Row::new("set", "declination", "variation, east positive; none: not sent")
        .takes(&[Slot::new("DEG", number_or("none", Settings::DECLINATION_DEG))])
        .means(|given| set(Setting::Declination(given.number(0)))),
    Row::new("set", "mount", "how the sensor sits: turned from the vehicle by yaw, then pitch, then roll")
        .takes(&[Slot::new("ORIENTATION", Kind::Choice(orientation))])
        .means(|given| set(Setting::Mount(given.choice(0, nth_orientation).unwrap_or(Orientation::NONE)))),
    Row::new("set", "inclination", "of the field here, positive down; none: found from the samples")
        .takes(&[Slot::new("DEG", number_or("none", Settings::INCLINATION_DEG))])
        .means(|given| set(Setting::Inclination(given.number(0)))),
    Row::new("set", "align", "the vehicle stands at this magnetic heading; none: as calibrated; yes: however far off")
        .takes(&[Slot::new("HEADING", number_or("none", 0.0..=360.0)), Slot::optional("yes", Kind::Sure("yes"))])
        .means(|given| match given.0 {
            [Value::Number(heading_deg), Value::Choice(_)] => Command::AlignSurely(heading_deg).into(),
            _ => Command::Align(given.number(0)).into(),
        }),
    Row::new("set", "attitude-error", "what the attitude may be off in a whole flight, 1 sigma: constant, and of bank")
        .takes(&[
            Slot::new("DEG", number_or("default", AttitudeError::BIAS_DEG)),
            Slot::new("PERCENT", number(AttitudeError::BANK_PERCENT, "%")),
        ])
        .means(|given| set(Setting::AttitudeError(attitude_error(given)))),
    Row::new("set", "accuracy", "the expected error at which collecting in flight is over")
        .takes(&[Slot::new("DEG", number(Settings::ACCURACY_DEG, DEGREES))])
        .means(|given| set(Setting::Accuracy(given.number(0).unwrap_or(f32::NAN)))),
    Row::new("set", "port1", "what is spoken on the first port; auto: what the autopilot there speaks")
        .takes(&[PROTOCOL])
        .means(|given| set(protocol_of(PortNumber::One, given))),
    Row::new("set", "port2", "what is spoken on the second port")
        .takes(&[PROTOCOL])
        .means(|given| set(protocol_of(PortNumber::Two, given))),
    Row::new("set", "baud1", "how fast the first port is")
        .takes(&[BAUD])
        .means(|given| set(baud_of(PortNumber::One, given))),
    Row::new("set", "baud2", "how fast the second port is")
        .takes(&[BAUD])
        .means(|given| set(baud_of(PortNumber::Two, given))),
    Row::new("set", "vision", "tell a MAVLink autopilot true yaw, to be used instead of its own; needs a declination")
        .takes(&[Slot::new("SWITCH", Kind::Choice(switch))])
        .means(|given| set(Setting::Vision(given.choice(0, nth_switch).unwrap_or(false)))),
    Row::new("reboot", "", "restart the module").means(|_| Request::Reboot),
];

const PROTOCOL: Slot = Slot::new("PROTOCOL", Kind::Choice(protocol));
const BAUD: Slot = Slot::new("BAUD", Kind::Choice(baud));

/// Methods, the best first.
const METHODS: [Method; 6] = [
    Method::MaximumLikelihood,
    Method::TwoPlane,
    Method::FourEllipse,
    Method::Level,
    Method::CompassSwing,
    Method::Ellipsoid,
];

fn method(number: usize) -> Option<&'static str> {
    METHODS.get(number).map(|method| method.name())
}

fn nth_procedure(number: usize) -> Option<Procedure> {
    Procedure::ALL.get(number).copied()
}

fn procedure(number: usize) -> Option<&'static str> {
    nth_procedure(number).map(Procedure::name)
}

/// The word behind the procedures: the one before, from nothing.
const AGAIN: usize = Procedure::ALL.len();

fn procedure_or_again(number: usize) -> Option<&'static str> {
    if number == AGAIN { Some("again") } else { procedure(number) }
}

fn nth_switch(number: usize) -> Option<bool> {
    [true, false].get(number).copied()
}

fn switch(number: usize) -> Option<&'static str> {
    nth_switch(number).map(|is_on| if is_on { "on" } else { "off" })
}

fn nth_kind(number: usize) -> Option<HeadingKind> {
    HeadingKind::ALL.get(number).copied()
}

fn heading_kind(number: usize) -> Option<&'static str> {
    nth_kind(number).map(HeadingKind::name)
}

fn nth_orientation(number: usize) -> Option<Orientation> {
    Orientation::all().nth(number)
}

fn orientation(number: usize) -> Option<&'static str> {
    nth_orientation(number).map(Orientation::name)
}

fn nth_protocol(number: usize) -> Option<ProtocolKind> {
    ProtocolKind::ALL.into_iter().filter(|kind| kind.is_here()).nth(number)
}

fn protocol(number: usize) -> Option<&'static str> {
    nth_protocol(number).map(ProtocolKind::name)
}

fn protocol_of(port: PortNumber, given: &Given) -> Setting {
    Setting::Protocol(port, given.choice(0, nth_protocol).unwrap_or(ProtocolKind::Auto.in_force()))
}

fn nth_baud(number: usize) -> Option<Baud> {
    Baud::ALL.get(number).copied()
}

fn baud(number: usize) -> Option<&'static str> {
    nth_baud(number).map(Baud::name)
}

fn baud_of(port: PortNumber, given: &Given) -> Setting {
    Setting::Baud(port, given.choice(0, nth_baud).unwrap_or(Baud::B115200))
}

fn attitude_error(given: &Given) -> AttitudeError {
    match (given.number(0), given.number(1)) {
        (Some(bias_deg), Some(bank_percent)) => AttitudeError { bias_deg, bank_percent },
        _ => AttitudeError::DEFAULT,
    }
}

const fn set(setting: Setting) -> Request {
    Request::Compass(Command::Set(setting))
}

impl From<Command> for Request {
    fn from(command: Command) -> Self {
        Self::Compass(command)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_can_be_asked_for() {
        assert!(Method::ALL.iter().all(|method| METHODS.contains(method)));
    }

    /// Rows of one first word stand together behind the one that explains it; no two are alike; all that mean nothing
    /// have other words.
    #[test]
    fn the_table_is_in_order() {
        for (i, row) in ROWS.iter().enumerate() {
            let [first, second] = row.words;
            assert!(!ROWS[..i].iter().any(|other| other.words == row.words), "{first} {second} is there twice");
            assert!(second.is_empty() || ROWS[i - 1].words[0] == first, "{first} {second} stands alone");
            let is_group = row.means.is_none() && first != "help";
            assert_eq!(is_group, second.is_empty() && ROWS.iter().filter(|row| row.words[0] == first).count() > 1);
            assert!(row.slots.len() <= 2);
        }
    }

    /// What is typed in any case is compared in lower case.
    #[test]
    fn words_are_lower_case_and_of_plain_characters() {
        let is_plain = |word: &str| word.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-');
        for row in ROWS {
            assert!(row.words.iter().all(|word| is_plain(word)), "{:?}", row.words);
            for slot in row.slots {
                assert!((0..).map_while(|number| slot.word(number)).all(is_plain), "{}", slot.name);
            }
        }
    }

    /// Names that are told are the names that are read.
    #[test]
    fn choices_are_what_they_are_called() {
        for number in 0..30 {
            assert_eq!(nth_procedure(number), procedure(number).and_then(Procedure::from_name));
            assert_eq!(nth_switch(number), switch(number).map(|name| name == "on"));
            assert_eq!(nth_protocol(number), protocol(number).and_then(ProtocolKind::from_name));
            assert_eq!(nth_baud(number), baud(number).and_then(Baud::from_name));
            assert_eq!(nth_kind(number), heading_kind(number).and_then(HeadingKind::from_name));
            assert_eq!(nth_orientation(number), orientation(number).and_then(Orientation::from_name));
            assert_eq!(METHODS.get(number).copied(), method(number).and_then(Method::from_name));
        }
    }
}
