//! Text commands to the simulated pilot, one per line; numbers in degrees and seconds.

use std::fmt;
use std::str::{FromStr, SplitWhitespace};

use host_sim::option_parsers::value_of_name;
use serde::{Deserialize, Serialize};
use simulator::random::RandomStream;
use simulator::routine::{CalibrationRoutine, TurnPlan, random_leg};
use simulator::world::aircraft::VehicleKind;
use simulator::world::autopilot::Leg;

/// Pilot command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PilotCommand {
    /// Turn at a bank through an angle, to the right if both have the same sign.
    Turn {
        /// Bank of the turn, degrees.
        bank_deg: f64,
        /// Heading change of the turn, degrees.
        change_deg: f64,
    },
    /// Straight ahead at the present heading, or hover.
    Level {
        /// Duration of the leg, seconds.
        seconds: f64,
    },
    /// Turn to a magnetic heading and hold it.
    Heading {
        /// Heading, degrees.
        heading_deg: f64,
        /// Duration including the turn, seconds.
        seconds: f64,
    },
    /// Fly a pattern.
    Pattern(PilotPattern),
    /// Level out, land, disarm.
    Land,
    /// Arm and take off.
    TakeOff,
    /// Report the true state.
    Status,
    /// List the commands.
    Help,
}

/// All commands with a description.
pub const COMMANDS: [(&str, &str); 8] = [
    ("turn BANK DEG", "turn at a bank (1 to 60) through an angle (to 3600); DEG -360 is a full circle to the left"),
    ("level S", "go straight on, or stay on the spot, for this many seconds (to 3600)"),
    ("heading DEG S", "turn to a magnetic heading and hold it, for this many seconds in all"),
    ("pattern NAME", "fly routine, circles, wandering or level from now on"),
    ("land", "level out and stand on the ground, disarmed: `reboot` and `set mount` need that"),
    ("takeoff", "arm and fly on"),
    ("status", "the true attitude and heading; the module does not know them"),
    ("help", "this list"),
];

/// Reason why a command was rejected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PilotCommandError {
    /// Unknown command.
    Unknown(String),
    /// Missing argument.
    Missing(&'static str),
    /// Superfluous argument.
    Unexpected(String),
    /// Invalid argument.
    BadValue(&'static str),
    /// Number outside the allowed range.
    OutOfRange(&'static str),
    /// An external simulator controls the aircraft.
    ExternallyControlled,
    /// The vehicle is on the ground.
    Landed,
}

impl PilotCommandError {
    /// Stable error code for scripts.
    #[must_use]
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::Unknown(_) => "unknown-order",
            Self::Missing(_) => "missing-argument",
            Self::Unexpected(_) => "unexpected-argument",
            Self::BadValue(_) => "bad-value",
            Self::OutOfRange(_) => "out-of-range",
            Self::ExternallyControlled => "flown-by-another",
            Self::Landed => "landed",
        }
    }
}

impl fmt::Display for PilotCommandError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(word) => {
                let orders = COMMANDS.map(|(command, _)| command).join(", ");
                write!(f, "{} is no order; there are {orders}", printable(word))
            }
            Self::Missing(argument) => write!(f, "{argument} is missing"),
            Self::Unexpected(word) => write!(f, "{} is too much", printable(word)),
            Self::BadValue(expected) => write!(f, "expected {expected}"),
            Self::OutOfRange(range) => f.write_str(range),
            Self::ExternallyControlled => {
                f.write_str("another simulator gives the attitude; only status and help are available")
            }
            Self::Landed => f.write_str("it stands on the ground; takeoff"),
        }
    }
}

impl std::error::Error for PilotCommandError {}

/// Input text without control characters, shortened to 40 characters.
fn printable(word: &str) -> String {
    word.chars().take(40).flat_map(char::escape_default).collect()
}

pub(super) fn help_text() -> String {
    COMMANDS
        .iter()
        .fold("ok orders:".to_owned(), |text, (command, description)| format!("{text}\n  {command:15}{description}"))
}

impl FromStr for PilotCommand {
    type Err = PilotCommandError;

    fn from_str(line: &str) -> Result<Self, PilotCommandError> {
        let mut arguments = line.split_whitespace();
        let word = arguments.next().unwrap_or_default();
        let command = match word.to_ascii_lowercase().as_str() {
            "turn" => Self::Turn {
                bank_deg: parse_angle(&mut arguments, "BANK", 60.0, "a bank is 1 to 60 deg, either way")?,
                change_deg: parse_angle(
                    &mut arguments,
                    "DEG",
                    3600.0,
                    "a turn goes through 1 to 3600 deg, either way",
                )?,
            },
            "level" => Self::Level { seconds: parse_seconds(&mut arguments)? },
            "heading" => {
                let heading_deg =
                    parse_number_in_range(&mut arguments, "DEG", 0.0..=360.0, "a heading is 0 to 360 deg")?;
                Self::Heading { heading_deg, seconds: parse_seconds(&mut arguments)? }
            }
            "pattern" => Self::Pattern(parse_pattern(&mut arguments)?),
            "land" => Self::Land,
            "takeoff" => Self::TakeOff,
            "status" => Self::Status,
            "help" => Self::Help,
            _ => return Err(PilotCommandError::Unknown(word.to_owned())),
        };
        arguments.next().map_or(Ok(command), |word| Err(PilotCommandError::Unexpected(word.to_owned())))
    }
}

/// Parses an angle of at least one degree, either way.
fn parse_angle(
    arguments: &mut SplitWhitespace<'_>,
    name: &'static str,
    max_deg: f64,
    range_text: &'static str,
) -> Result<f64, PilotCommandError> {
    let angle_deg = parse_number_in_range(arguments, name, -max_deg..=max_deg, range_text)?;
    if angle_deg.abs() >= 1.0 { Ok(angle_deg) } else { Err(PilotCommandError::OutOfRange(range_text)) }
}

fn parse_seconds(arguments: &mut SplitWhitespace<'_>) -> Result<f64, PilotCommandError> {
    parse_number_in_range(arguments, "S", 0.1..=3600.0, "a time is 0.1 to 3600 s")
}

fn parse_pattern(arguments: &mut SplitWhitespace<'_>) -> Result<PilotPattern, PilotCommandError> {
    let name = arguments.next().ok_or(PilotCommandError::Missing("NAME"))?;
    value_of_name(&name.to_ascii_lowercase())
        .map_err(|_| PilotCommandError::BadValue("routine, circles, wandering or level"))
}

fn parse_number_in_range(
    arguments: &mut SplitWhitespace<'_>,
    name: &'static str,
    range: std::ops::RangeInclusive<f64>,
    range_text: &'static str,
) -> Result<f64, PilotCommandError> {
    let word = arguments.next().ok_or(PilotCommandError::Missing(name))?;
    let value: f64 = word.parse().map_err(|_| PilotCommandError::BadValue("a number"))?;
    // NaN is outside every range.
    if range.contains(&value) { Ok(value) } else { Err(PilotCommandError::OutOfRange(range_text)) }
}

/// Flight pattern without commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PilotPattern {
    /// Calibration routine of the vehicle, then 30 s straight.
    #[default]
    Routine,
    /// Two circles to the right, two to the left.
    Circles,
    /// Random legs.
    Wandering,
    /// Straight ahead, or hover.
    Level,
}

impl PilotPattern {
    /// Legs of one repetition; empty for level flight.
    pub(super) fn legs(self, vehicle_kind: VehicleKind, heading_deg: f64, random: &mut RandomStream) -> Vec<Leg> {
        let straight = Leg::Straight { heading_deg, seconds: 30.0 };
        let circles = |change_deg| match vehicle_kind {
            VehicleKind::Plane | VehicleKind::Vtol => {
                Leg::Turn { bank_deg: CIRCLE_BANK_DEG, heading_change_deg: change_deg }
            }
            VehicleKind::Copter | VehicleKind::Rover | VehicleKind::Boat | VehicleKind::Hand => {
                Leg::Yaw { rate_deg_s: CIRCLE_RATE_DEG_S, heading_change_deg: change_deg }
            }
        };
        match self {
            Self::Routine => {
                let mut legs = CalibrationRoutine::for_vehicle(vehicle_kind, TurnPlan::default(), heading_deg).legs();
                legs.push(straight);
                legs
            }
            Self::Circles => vec![circles(720.0), circles(-720.0)],
            Self::Wandering => vec![random_leg(vehicle_kind, random)],
            Self::Level => Vec::new(),
        }
    }
}

/// Bank of circles, degrees: half a minute each.
const CIRCLE_BANK_DEG: f64 = 25.0;
const CIRCLE_RATE_DEG_S: f64 = 18.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pilot_commands_are_parsed_from_words_and_numbers() {
        for (line, command) in [
            ("turn 25 -360", PilotCommand::Turn { bank_deg: 25.0, change_deg: -360.0 }),
            ("  TURN  -10.5  90 ", PilotCommand::Turn { bank_deg: -10.5, change_deg: 90.0 }),
            ("level 10", PilotCommand::Level { seconds: 10.0 }),
            ("heading 270 9.5", PilotCommand::Heading { heading_deg: 270.0, seconds: 9.5 }),
            ("pattern Circles", PilotCommand::Pattern(PilotPattern::Circles)),
            ("land", PilotCommand::Land),
            ("takeoff", PilotCommand::TakeOff),
            ("status", PilotCommand::Status),
            ("help", PilotCommand::Help),
        ] {
            assert_eq!(line.parse(), Ok(command), "{line}");
        }
    }

    #[test]
    fn an_invalid_pilot_command_is_rejected_with_a_code() {
        for (line, code) in [
            ("", "unknown-order"),
            ("loop 3", "unknown-order"),
            ("turn", "missing-argument"),
            ("turn 25", "missing-argument"),
            ("turn 25 left", "bad-value"),
            ("turn 61 90", "out-of-range"),
            ("turn 0 90", "out-of-range"),
            ("turn 25 0", "out-of-range"),
            ("turn 25 nan", "out-of-range"),
            ("turn 25 90 5", "unexpected-argument"),
            ("level", "missing-argument"),
            ("level -1", "out-of-range"),
            ("level inf", "out-of-range"),
            ("heading 361 5", "out-of-range"),
            ("heading 90", "missing-argument"),
            ("heading 90 0", "out-of-range"),
            ("pattern", "missing-argument"),
            ("pattern eights", "bad-value"),
            ("land now", "unexpected-argument"),
        ] {
            let error = line.parse::<PilotCommand>().unwrap_err();
            assert_eq!(error.stable_code(), code, "{line}: {error}");
        }
    }

    /// Escape sequences in the error would affect the reader's terminal.
    #[test]
    fn an_unknown_command_error_lists_all_without_control_characters() {
        let error = format!("\u{1b}]0;x\u{7}{}", "y".repeat(10_000)).parse::<PilotCommand>().unwrap_err().to_string();
        assert!(error.chars().all(|character| !character.is_control()) && error.len() < 300, "{error}");
        assert!(COMMANDS.iter().all(|(command, _)| error.contains(command)), "{error}");
    }

    #[test]
    fn every_listed_pilot_command_is_accepted() {
        for (command, _) in COMMANDS {
            let line = command.replace("BANK", "20").replace("DEG", "90").replace("NAME", "level");
            let line = line.replace(" S", " 5");
            assert!(line.parse::<PilotCommand>().is_ok(), "{line}");
            assert!(help_text().contains(command));
        }
    }
}
