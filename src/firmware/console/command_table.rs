//! Table of the console's commands, for parsing, completion, help and errors.
//!
//! A new command, or a new setting with a number or a name, is one more row.

use core::ops::RangeInclusive;

use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{Method, Orientation};
use autoswing_module::compass::Command;
use autoswing_module::settings::{
    AttitudeError, CanSettings, HeadingKind, SensorError, SettingChange, Settings, SigningKey,
};
use autoswing_module::settings::{BaudRate, PortNumber, ProtocolKind};

/// Command, or the first word of several commands.
#[derive(Debug)]
pub struct CommandSpec {
    /// One or two words, lower case; the second is empty if there is one.
    pub command_words: [&'static str; 2],
    /// Description in `help`.
    pub help_text: &'static str,
    /// Arguments of the command, in order.
    pub arguments: &'static [ArgumentSpec],
    /// Constructor of the request; none if a second word is required.
    pub request_constructor: Option<fn(&Arguments) -> Request>,
}

/// Specification of a command's argument.
#[derive(Debug)]
pub struct ArgumentSpec {
    /// Name of the argument, upper case.
    pub argument_name: &'static str,
    /// Permitted values.
    pub argument_kind: ArgumentKind,
    /// Whether the argument may be omitted.
    pub is_optional: bool,
}

/// Permitted values of an argument.
#[derive(Debug)]
pub enum ArgumentKind {
    /// Name with an index.
    Choice(fn(usize) -> Option<&'static str>),
    /// A number, or a word in its place, after which no argument follows. The range is for help and error texts; the
    /// state machine checks the number.
    Number {
        /// Range of the number.
        range: RangeInclusive<f32>,
        /// Unit of the number.
        unit: &'static str,
        /// Word in place of the number.
        alternative: Option<&'static str>,
    },
    /// Integer of at most 255.
    Integer {
        /// Range of the number.
        range: RangeInclusive<u8>,
        /// Unit of the integer.
        unit: &'static str,
    },
    /// Confirmation word.
    Confirmation(&'static str),
    /// A word from which a key is derived, or `off`.
    Passphrase,
}

/// Parsed argument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ArgumentValue {
    /// Omitted, or the word in place of a number.
    Absent,
    /// Numeric argument.
    Number(f32),
    /// Index of a choice.
    Choice(usize),
    /// Key of a passphrase.
    SigningKey(SigningKey),
}

/// Parsed arguments of a command, two at most.
#[derive(Debug)]
pub struct Arguments(pub [ArgumentValue; 2]);

impl Arguments {
    fn number_argument(&self, index: usize) -> Option<f32> {
        match self.0.get(index) {
            Some(&ArgumentValue::Number(number)) => Some(number),
            _ => None,
        }
    }

    fn choice_argument<T>(&self, index: usize, value_of_index: impl Fn(usize) -> Option<T>) -> Option<T> {
        match self.0.get(index) {
            Some(&ArgumentValue::Choice(number)) => value_of_index(number),
            _ => None,
        }
    }
}

fn signing_key(arguments: &Arguments) -> Option<SigningKey> {
    match arguments.0 {
        [ArgumentValue::SigningKey(key), _] => Some(key),
        _ => None,
    }
}

impl CommandSpec {
    const fn new(first_word: &'static str, second_word: &'static str, help_text: &'static str) -> Self {
        Self { command_words: [first_word, second_word], help_text, arguments: &[], request_constructor: None }
    }

    const fn with_arguments(self, slots: &'static [ArgumentSpec]) -> Self {
        Self { arguments: slots, ..self }
    }

    const fn with_request(self, to_request: fn(&Arguments) -> Request) -> Self {
        Self { request_constructor: Some(to_request), ..self }
    }
}

impl ArgumentSpec {
    const fn new(name: &'static str, kind: ArgumentKind) -> Self {
        Self { argument_name: name, argument_kind: kind, is_optional: false }
    }

    const fn optional_argument(name: &'static str, kind: ArgumentKind) -> Self {
        Self { argument_name: name, argument_kind: kind, is_optional: true }
    }

    /// Permitted word with this index.
    pub fn nth_word(&self, index: usize) -> Option<&'static str> {
        let first_only = |word| if index == 0 { word } else { None };
        match self.argument_kind {
            ArgumentKind::Choice(name) => name(index),
            ArgumentKind::Number { alternative, .. } => first_only(alternative),
            ArgumentKind::Integer { .. } => None,
            ArgumentKind::Confirmation(word) => first_only(Some(word)),
            ArgumentKind::Passphrase => first_only(Some("off")),
        }
    }
}

const DEGREES_UNIT: &str = "deg";

const HEADING_ARGUMENT_KIND: ArgumentKind =
    ArgumentKind::Number { range: 0.0..=360.0, unit: DEGREES_UNIT, alternative: None };

const fn number_kind(range: RangeInclusive<f32>, unit: &'static str) -> ArgumentKind {
    ArgumentKind::Number { range, unit, alternative: None }
}

const fn number_or_word(word: &'static str, range: RangeInclusive<f32>, unit: &'static str) -> ArgumentKind {
    ArgumentKind::Number { range, unit, alternative: Some(word) }
}

/// All commands in the order of `help`, adjacent if they share the first word.
pub static COMMANDS: &[CommandSpec] = &[
    CommandSpec::new("help", "", "list the commands, or explain one"),
    CommandSpec::new("version", "", "show the firmware's version").with_request(|_| Request::Version),
    CommandSpec::new("status", "", "show the state in six lines; all: also settings and counters")
        .with_arguments(&[ArgumentSpec::optional_argument("all", ArgumentKind::Confirmation("all"))])
        .with_request(|arguments| match arguments.0 {
            [ArgumentValue::Choice(_), _] => Command::StatusAll.into(),
            _ => Command::Status.into(),
        }),
    CommandSpec::new("cal", "", "calibration"),
    CommandSpec::new(
        "cal",
        "start",
        "start collecting; flight, turns and level then solve automatically, swing and tumble need cal solve",
    )
    .with_arguments(&[
        ArgumentSpec::optional_argument("PROCEDURE", ArgumentKind::Choice(nth_procedure_or_again)),
        ArgumentSpec::optional_argument("again", ArgumentKind::Confirmation("again")),
    ])
    .with_request(|arguments| match (arguments.0, arguments.choice_argument(0, nth_procedure)) {
        ([ArgumentValue::Choice(AGAIN_INDEX), _] | [_, ArgumentValue::Choice(_)], procedure) => {
            Command::CalStartNew(procedure).into()
        }
        (_, procedure) => Command::CalStart(procedure.unwrap_or_default()).into(),
    }),
    CommandSpec::new(
        "cal",
        "auto",
        "start collecting automatically while uncalibrated, as soon as the autopilot is armed",
    )
    .with_arguments(&[ArgumentSpec::new("SWITCH", ArgumentKind::Choice(nth_switch_name))])
    .with_request(|arguments| {
        request_to_set(SettingChange::Auto(arguments.choice_argument(0, nth_switch).unwrap_or(true)))
    }),
    CommandSpec::new("cal", "mark", "in a swing: record samples at this magnetic heading of the vehicle")
        .with_arguments(&[ArgumentSpec::new("HEADING", HEADING_ARGUMENT_KIND)])
        .with_request(|arguments| Command::CalMark(arguments.number_argument(0).unwrap_or(f32::NAN)).into()),
    CommandSpec::new("cal", "stop", "stop collecting, keep the samples").with_request(|_| Command::CalStop.into()),
    CommandSpec::new(
        "cal",
        "solve",
        "solve with the collected samples, by the best method they support or by a given one",
    )
    .with_arguments(&[ArgumentSpec::optional_argument("METHOD", ArgumentKind::Choice(nth_method_name))])
    .with_request(|arguments| {
        Command::CalSolve(arguments.choice_argument(0, |index| METHODS_BY_RANK.get(index).copied())).into()
    }),
    CommandSpec::new("cal", "advise", "show the weakest part of the last solve, and the manoeuvre that improves it")
        .with_request(|_| Command::CalAdvise.into()),
    CommandSpec::new("cal", "show", "show the active calibration").with_request(|_| Command::CalShow.into()),
    CommandSpec::new("cal", "clear", "delete the stored calibrations")
        .with_arguments(&[ArgumentSpec::new("all", ArgumentKind::Confirmation("all"))])
        .with_request(|_| Command::CalClear.into()),
    CommandSpec::new("cal", "undo", "return to the previous calibration; again: to the newer one")
        .with_request(|_| Command::CalUndo.into()),
    CommandSpec::new("cal", "abort", "stop the collection or the solve, delete the samples")
        .with_request(|_| Command::CalAbort.into()),
    CommandSpec::new("stream", "", "heading sentences"),
    CommandSpec::new("stream", "on", "send them").with_request(|_| request_to_set(SettingChange::StreamOn(true))),
    CommandSpec::new("stream", "off", "do not send them")
        .with_request(|_| request_to_set(SettingChange::StreamOn(false))),
    CommandSpec::new("stream", "rate", "sentences per second")
        .with_arguments(&[ArgumentSpec::new(
            "HZ",
            ArgumentKind::Integer { range: Settings::STREAM_RATE_HZ_RANGE, unit: "a second" },
        )])
        .with_request(|arguments| {
            request_to_set(SettingChange::StreamRateHz(arguments.number_argument(0).unwrap_or_default() as u8))
        }),
    CommandSpec::new(
        "stream",
        "heading",
        "heading sent: smoothed by the body rates, or raw for an autopilot with its own filter",
    )
    .with_arguments(&[ArgumentSpec::new("KIND", ArgumentKind::Choice(nth_heading_kind_name))])
    .with_request(|arguments| {
        request_to_set(SettingChange::StreamHeading(
            arguments.choice_argument(0, nth_heading_kind).unwrap_or(HeadingKind::Smooth),
        ))
    }),
    CommandSpec::new("set", "", "settings"),
    CommandSpec::new("set", "declination", "declination, east positive; none: by the field model")
        .with_arguments(&[ArgumentSpec::new(
            "DEG",
            number_or_word("none", Settings::DECLINATION_DEG_RANGE, DEGREES_UNIT),
        )])
        .with_request(|arguments| request_to_set(SettingChange::Declination(arguments.number_argument(0)))),
    CommandSpec::new(
        "set",
        "mount",
        "orientation of the sensor: rotated from the vehicle by yaw, then pitch, then roll",
    )
    .with_arguments(&[ArgumentSpec::new("ORIENTATION", ArgumentKind::Choice(nth_orientation_name))])
    .with_request(|arguments| {
        request_to_set(SettingChange::Mount(
            arguments.choice_argument(0, nth_orientation).unwrap_or(Orientation::IDENTITY_ROTATION),
        ))
    }),
    CommandSpec::new(
        "set",
        "inclination",
        "inclination of the local field, positive down; none: by the field model or the samples",
    )
    .with_arguments(&[ArgumentSpec::new("DEG", number_or_word("none", Settings::INCLINATION_DEG_RANGE, DEGREES_UNIT))])
    .with_request(|arguments| request_to_set(SettingChange::Inclination(arguments.number_argument(0)))),
    CommandSpec::new(
        "set",
        "align",
        "magnetic heading of the vehicle now: removes a constant error; none: as calibrated; yes: of any size",
    )
    .with_arguments(&[
        ArgumentSpec::new("HEADING", number_or_word("none", 0.0..=360.0, DEGREES_UNIT)),
        ArgumentSpec::optional_argument("yes", ArgumentKind::Confirmation("yes")),
    ])
    .with_request(|arguments| match arguments.0 {
        [ArgumentValue::Number(heading_deg), ArgumentValue::Choice(_)] => Command::AlignConfirmed(heading_deg).into(),
        _ => Command::Align(arguments.number_argument(0)).into(),
    }),
    CommandSpec::new(
        "set",
        "attitude-error",
        "constant attitude error of a flight, 1 sigma: in degrees, and in percent of the bank",
    )
    .with_arguments(&[
        ArgumentSpec::new("DEG", number_or_word("default", AttitudeError::BIAS_DEG_RANGE, DEGREES_UNIT)),
        ArgumentSpec::new("PERCENT", number_kind(AttitudeError::BANK_PERCENT_RANGE, "%")),
    ])
    .with_request(|arguments| request_to_set(SettingChange::AttitudeError(attitude_error(arguments)))),
    CommandSpec::new(
        "set",
        "sensor-error",
        "errors that the monitor expects, 1 sigma: scale of the gyro, and drift of iron in a minute",
    )
    .with_arguments(&[
        ArgumentSpec::new("GYRO", number_or_word("default", SensorError::GYRO_PERCENT_RANGE, "%")),
        ArgumentSpec::new("DRIFT", number_kind(SensorError::DRIFT_PERCENT_RANGE, "% of the field")),
    ])
    .with_request(|arguments| request_to_set(SettingChange::SensorError(sensor_error(arguments)))),
    CommandSpec::new("set", "accuracy", "expected error at which a collection in flight ends")
        .with_arguments(&[ArgumentSpec::new("DEG", number_kind(Settings::ACCURACY_DEG_RANGE, DEGREES_UNIT))])
        .with_request(|arguments| {
            request_to_set(SettingChange::Accuracy(arguments.number_argument(0).unwrap_or(f32::NAN)))
        }),
    CommandSpec::new("set", "port1", "protocol of the first port; auto: detect the autopilot's")
        .with_arguments(&[PROTOCOL_ARGUMENT])
        .with_request(|arguments| request_to_set(protocol_change(PortNumber::One, arguments))),
    CommandSpec::new("set", "port2", "protocol of the second port; auto: detect the autopilot's")
        .with_arguments(&[PROTOCOL_ARGUMENT])
        .with_request(|arguments| request_to_set(protocol_change(PortNumber::Two, arguments))),
    CommandSpec::new("set", "baud1", "baud rate of the first port")
        .with_arguments(&[BAUD_ARGUMENT])
        .with_request(|arguments| request_to_set(baud_change(PortNumber::One, arguments))),
    CommandSpec::new("set", "baud2", "baud rate of the second port")
        .with_arguments(&[BAUD_ARGUMENT])
        .with_request(|arguments| request_to_set(baud_change(PortNumber::Two, arguments))),
    CommandSpec::new(
        "set",
        "vision",
        "send true yaw to a MAVLink autopilot, in place of its own compass; needs a declination",
    )
    .with_arguments(&[ArgumentSpec::new("SWITCH", ArgumentKind::Choice(nth_switch_name))])
    .with_request(|arguments| {
        request_to_set(SettingChange::Vision(arguments.choice_argument(0, nth_switch).unwrap_or(false)))
    }),
    CommandSpec::new("set", "attitude-rate", "highest rate at which attitude is requested from a MAVLink autopilot")
        .with_arguments(&[ArgumentSpec::new(
            "HZ",
            ArgumentKind::Integer { range: Settings::ATTITUDE_RATE_HZ_RANGE, unit: "a second" },
        )])
        .with_request(|arguments| {
            request_to_set(SettingChange::AttitudeRateHz(arguments.number_argument(0).unwrap_or_default() as u8))
        }),
    CommandSpec::new(
        "set",
        "signing",
        "sign MAVLink frames, and reject others, with the key of a passphrase, one word",
    )
    .with_arguments(&[ArgumentSpec::new("PASSPHRASE", ArgumentKind::Passphrase)])
    .with_request(|arguments| request_to_set(SettingChange::Signing(signing_key(arguments)))),
    CommandSpec::new("set", "can-node", "number on the CAN bus, after a restart; 0: the autopilot gives one")
        .with_arguments(&[ArgumentSpec::new(
            "NUMBER",
            ArgumentKind::Integer { range: CanSettings::NODE_ID_RANGE, unit: "as a node" },
        )])
        .with_request(|arguments| {
            request_to_set(SettingChange::CanNode(arguments.number_argument(0).unwrap_or_default() as u8))
        }),
    CommandSpec::new("set", "can-rate", "rate of the field on the CAN bus")
        .with_arguments(&[ArgumentSpec::new(
            "HZ",
            ArgumentKind::Integer { range: CanSettings::RATE_HZ_RANGE, unit: "a second" },
        )])
        .with_request(|arguments| {
            request_to_set(SettingChange::CanRateHz(arguments.number_argument(0).unwrap_or_default() as u8))
        }),
    CommandSpec::new("set", "can-covariance", "send the field on the CAN bus with its covariance")
        .with_arguments(&[ArgumentSpec::new("SWITCH", ArgumentKind::Choice(nth_switch_name))])
        .with_request(|arguments| {
            request_to_set(SettingChange::CanCovariance(arguments.choice_argument(0, nth_switch).unwrap_or(false)))
        }),
    CommandSpec::new("set", "can-termination", "terminating resistor of the CAN bus, if the board switches one")
        .with_arguments(&[ArgumentSpec::new("SWITCH", ArgumentKind::Choice(nth_switch_name))])
        .with_request(|arguments| {
            request_to_set(SettingChange::CanTermination(arguments.choice_argument(0, nth_switch).unwrap_or(false)))
        }),
    CommandSpec::new("reboot", "", "restart the module").with_request(|_| Command::Restart.into()),
];

const PROTOCOL_ARGUMENT: ArgumentSpec = ArgumentSpec::new("PROTOCOL", ArgumentKind::Choice(nth_protocol_name));
const BAUD_ARGUMENT: ArgumentSpec = ArgumentSpec::new("BAUD", ArgumentKind::Choice(nth_baud_name));

/// Methods, the best first.
const METHODS_BY_RANK: [Method; 6] = [
    Method::MaximumLikelihood,
    Method::TwoPlane,
    Method::FourEllipse,
    Method::Level,
    Method::CompassSwing,
    Method::Ellipsoid,
];

fn nth_method_name(index: usize) -> Option<&'static str> {
    METHODS_BY_RANK.get(index).map(|method| method.method_name())
}

fn nth_procedure(index: usize) -> Option<Procedure> {
    Procedure::ALL_PROCEDURES.get(index).copied()
}

fn nth_procedure_name(index: usize) -> Option<&'static str> {
    nth_procedure(index).map(Procedure::procedure_name)
}

/// Index of the choice `again`, which follows the procedures: the last procedure with an empty collection.
const AGAIN_INDEX: usize = Procedure::ALL_PROCEDURES.len();

fn nth_procedure_or_again(index: usize) -> Option<&'static str> {
    if index == AGAIN_INDEX { Some("again") } else { nth_procedure_name(index) }
}

fn nth_switch(index: usize) -> Option<bool> {
    [true, false].get(index).copied()
}

fn nth_switch_name(index: usize) -> Option<&'static str> {
    nth_switch(index).map(|is_on| if is_on { "on" } else { "off" })
}

fn nth_heading_kind(index: usize) -> Option<HeadingKind> {
    HeadingKind::ALL_HEADING_KINDS.get(index).copied()
}

fn nth_heading_kind_name(index: usize) -> Option<&'static str> {
    nth_heading_kind(index).map(HeadingKind::kind_name)
}

fn nth_orientation(index: usize) -> Option<Orientation> {
    Orientation::all_orientations().nth(index)
}

fn nth_orientation_name(index: usize) -> Option<&'static str> {
    nth_orientation(index).map(Orientation::orientation_name)
}

fn nth_protocol(index: usize) -> Option<ProtocolKind> {
    ProtocolKind::ALL_PROTOCOLS.get(index).copied()
}

fn nth_protocol_name(index: usize) -> Option<&'static str> {
    nth_protocol(index).map(ProtocolKind::protocol_name)
}

fn protocol_change(port: PortNumber, arguments: &Arguments) -> SettingChange {
    SettingChange::Protocol(port, arguments.choice_argument(0, nth_protocol).unwrap_or(ProtocolKind::Auto))
}

fn nth_baud(index: usize) -> Option<BaudRate> {
    BaudRate::ALL_RATES.get(index).copied()
}

fn nth_baud_name(index: usize) -> Option<&'static str> {
    nth_baud(index).map(BaudRate::baud_name)
}

fn baud_change(port: PortNumber, arguments: &Arguments) -> SettingChange {
    SettingChange::Baud(port, arguments.choice_argument(0, nth_baud).unwrap_or(BaudRate::B115200))
}

/// The first two numeric arguments; `None` if a word replaces the first.
fn first_two_numbers(arguments: &Arguments) -> Option<[f32; 2]> {
    arguments.number_argument(0).zip(arguments.number_argument(1)).map(<[f32; 2]>::from)
}

fn attitude_error(arguments: &Arguments) -> AttitudeError {
    first_two_numbers(arguments)
        .map_or(AttitudeError::DEFAULT, |[bias_deg, bank_percent]| AttitudeError { bias_deg, bank_percent })
}

fn sensor_error(arguments: &Arguments) -> SensorError {
    first_two_numbers(arguments)
        .map_or(SensorError::DEFAULT, |[gyro_percent, drift_percent]| SensorError { gyro_percent, drift_percent })
}

const fn request_to_set(setting: SettingChange) -> Request {
    Request::Command(Command::Set(setting))
}

/// Request parsed from a console line.
#[derive(Clone, Copy, Debug)]
pub enum Request {
    /// List the commands, or explain one.
    Help(Option<&'static CommandSpec>),
    /// Show the firmware's version.
    Version,
    /// Command for the state machine.
    Command(Command),
}

impl From<Command> for Request {
    fn from(command: Command) -> Self {
        Self::Command(command)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_can_be_selected() {
        assert!(Method::ALL_METHODS.iter().all(|method| METHODS_BY_RANK.contains(method)));
    }

    /// Commands follow the row of their first word; no two are equal; a row without a request has second words.
    #[test]
    fn the_command_table_is_grouped_and_has_no_duplicates() {
        for (i, row) in COMMANDS.iter().enumerate() {
            let [first, second] = row.command_words;
            assert!(
                !COMMANDS[..i].iter().any(|other| other.command_words == row.command_words),
                "{first} {second} is there twice"
            );
            assert!(second.is_empty() || COMMANDS[i - 1].command_words[0] == first, "{first} {second} stands alone");
            let is_group = row.request_constructor.is_none() && first != "help";
            assert_eq!(
                is_group,
                second.is_empty() && COMMANDS.iter().filter(|row| row.command_words[0] == first).count() > 1
            );
            assert!(row.arguments.len() <= 2);
        }
    }

    /// Typed words are compared in lower case.
    #[test]
    fn command_words_are_lower_case_ascii() {
        let is_plain = |word: &str| word.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-');
        for row in COMMANDS {
            assert!(row.command_words.iter().all(|word| is_plain(word)), "{:?}", row.command_words);
            for argument in row.arguments {
                assert!(
                    (0..).map_while(|number| argument.nth_word(number)).all(is_plain),
                    "{}",
                    argument.argument_name
                );
            }
        }
    }

    #[test]
    fn every_choice_name_parses_to_its_value() {
        for number in 0..30 {
            assert_eq!(nth_procedure(number), nth_procedure_name(number).and_then(Procedure::from_name));
            assert_eq!(nth_switch(number), nth_switch_name(number).map(|name| name == "on"));
            assert_eq!(nth_protocol(number), nth_protocol_name(number).and_then(ProtocolKind::from_name));
            assert_eq!(nth_baud(number), nth_baud_name(number).and_then(BaudRate::from_name));
            assert_eq!(nth_heading_kind(number), nth_heading_kind_name(number).and_then(HeadingKind::from_name));
            assert_eq!(nth_orientation(number), nth_orientation_name(number).and_then(Orientation::from_name));
            assert_eq!(METHODS_BY_RANK.get(number).copied(), nth_method_name(number).and_then(Method::from_name));
        }
    }
}
