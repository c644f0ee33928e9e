//! The console's language: what a person types and what it means.
//!
//! Line editing, history, Tab and help come from `embedded-cli` ([`session`]); its parser is used as it is, but every
//! complaint of it becomes an `error <code>: what to do` of ours, so that scripts can rely on the codes. The replies'
//! texts are in [`report`].

pub mod report;
pub mod session;

use core::fmt;

use embedded_cli::arguments::{FromArgument, FromArgumentError};
use embedded_cli::command::RawCommand;
use embedded_cli::service::{FromRaw, ParseError};
use session::MINUS;

use crate::calibration::ladder::Procedure;
use crate::calibration::{Method, Orientation};
use crate::compass;
use crate::settings::{AttitudeError, HeadingKind, Setting};
use crate::wire::decimal;

/// What a line asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Request {
    /// The firmware's version.
    Version,
    /// Everything there is to know.
    Status,
    /// The calibration in use.
    CalShow,
    /// Restart.
    Reboot,
    /// Something for the state machine.
    Compass(compass::Command),
}

/// Why a line means nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LineError {
    /// No such command.
    UnknownCommand,
    /// An argument is missing; its name.
    MissingArgument(heapless::String<24>),
    /// An argument is not what it must be; what that is.
    BadValue(heapless::String<80>),
    /// More, or other, arguments than the command takes.
    UnexpectedArgument,
    /// A destructive command without its word; the whole command.
    NeedsWord(&'static str),
    /// More characters than a line holds.
    TooLong,
}

impl LineError {
    /// Stable code, kebab-case.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::UnknownCommand => "unknown-command",
            Self::MissingArgument(_) => "missing-argument",
            Self::BadValue(_) => "bad-value",
            Self::UnexpectedArgument => "unexpected-argument",
            Self::NeedsWord(_) => "needs-word",
            Self::TooLong => "line-too-long",
        }
    }
}

impl fmt::Display for LineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownCommand => f.write_str("no such command; help lists them"),
            Self::MissingArgument(name) => write!(f, "{name} is missing; help shows how"),
            Self::BadValue(expected) => write!(f, "expected {expected}"),
            Self::UnexpectedArgument => f.write_str("too many words; help shows how"),
            Self::NeedsWord(command) => write!(f, "this cannot be undone; type {command}"),
            Self::TooLong => write!(f, "a line holds {LINE_CAPACITY} characters"),
        }
    }
}

/// The grammar. The comments are the help that the console shows.
#[derive(Debug, embedded_cli::Command)]
enum Line<'a> {
    /// Show the firmware's version
    Version,
    /// Show state, sensors, progress, settings, counters
    Status,
    /// Calibration: start mark stop solve advise show clear undo abort
    Cal {
        #[command(subcommand)]
        command: Cal<'a>,
    },
    /// Heading sentences: on, off, rate HZ, heading raw or smooth
    Stream {
        #[command(subcommand)]
        command: Stream,
    },
    /// Settings: declination, mount, inclination, align, attitude-error
    Set {
        #[command(subcommand)]
        command: Set,
    },
    /// Restart the module
    Reboot,
}

#[derive(Debug, embedded_cli::Command)]
enum Cal<'a> {
    /// Begin collecting; then fly three circles each way. Solves by itself when it has enough
    Start {
        /// turns (the default), level, swing or tumble
        procedure: Option<Procedure>,
    },
    /// Give the magnetic heading the vehicle stands at, in a swing
    Mark {
        /// 0 to 360
        heading: Number,
    },
    /// Stop collecting, keep the samples
    Stop,
    /// Solve with the samples there are
    Solve {
        /// A method; without one, what the samples support
        method: Option<Method>,
    },
    /// Show what is weak in the last solve, and what to fly
    Advise,
    /// Show the calibration in use
    Show,
    /// Forget the stored calibrations: cal clear all
    Clear {
        /// The word all
        word: Option<&'a str>,
    },
    /// Back to the calibration before; again: forward
    Undo,
    /// Stop what runs, forget the samples
    Abort,
}

#[derive(Debug, embedded_cli::Command)]
enum Stream {
    /// Send heading sentences
    On,
    /// Stop sending them
    Off,
    /// Set how many a second
    Rate {
        /// 1 to 80
        hz: u8,
    },
    /// Choose which heading they tell
    Heading {
        /// smooth (the default): with the body rates; raw: for an autopilot with a filter of its own
        kind: HeadingKind,
    },
}

#[derive(Debug, embedded_cli::Command)]
enum Set {
    /// Variation (declination), degrees, east positive; none: not sent
    Declination {
        /// -180 to 180, or none
        deg: Maybe,
    },
    /// How the sensor sits: none, yaw90, roll180-yaw270, ...
    Mount {
        /// One of the 24 names
        orientation: Orientation,
    },
    /// Inclination of the field here, degrees, positive down; none: found from the samples
    Inclination {
        /// -90 to 90, or none
        deg: Maybe,
    },
    /// Magnetic heading the vehicle stands at now, degrees; none: as calibrated
    Align {
        /// 0 to 360, or none
        heading: Maybe,
    },
    /// What the attitude source may be off, 1 sigma: a constant in degrees and a part of the bank in percent; or default
    AttitudeError {
        /// 0 to 5, or default
        deg: Chosen,
        /// 0 to 20
        percent: Option<Number>,
    },
}

/// A number in fixed point.
#[derive(Debug)]
struct Number(f32);

impl<'a> FromArgument<'a> for Number {
    fn from_arg(text: &'a str) -> Result<Self, FromArgumentError<'a>> {
        // The minus sign travels as another character, see `Session::byte`.
        let mut plain = heapless::String::<16>::new();
        let fits = text.chars().try_for_each(|c| plain.push(if c == MINUS { '-' } else { c }));
        let number = fits.ok().and_then(|()| decimal::parse(&plain));
        number.map(Self).ok_or(FromArgumentError { value: text, expected: "a number such as -3.5" })
    }
}

/// A number, or the word none.
#[derive(Debug)]
struct Maybe(Option<f32>);

impl<'a> FromArgument<'a> for Maybe {
    fn from_arg(text: &'a str) -> Result<Self, FromArgumentError<'a>> {
        number_or("none", text).map(Self)
    }
}

/// A number, or the word default.
#[derive(Debug)]
struct Chosen(Option<f32>);

impl<'a> FromArgument<'a> for Chosen {
    fn from_arg(text: &'a str) -> Result<Self, FromArgumentError<'a>> {
        number_or("default", text).map(Self)
    }
}

fn number_or<'a>(word: &str, text: &'a str) -> Result<Option<f32>, FromArgumentError<'a>> {
    if text == word { Ok(None) } else { Number::from_arg(text).map(|number| Some(number.0)) }
}

impl<'a> FromArgument<'a> for Procedure {
    fn from_arg(text: &'a str) -> Result<Self, FromArgumentError<'a>> {
        Self::from_name(text).ok_or(FromArgumentError { value: text, expected: "turns, level, swing or tumble" })
    }
}

impl<'a> FromArgument<'a> for Method {
    fn from_arg(text: &'a str) -> Result<Self, FromArgumentError<'a>> {
        Self::from_name(text).ok_or(FromArgumentError {
            value: text,
            expected: "maximum-likelihood, two-plane, four-ellipse, level, compass-swing or ellipsoid",
        })
    }
}

impl<'a> FromArgument<'a> for HeadingKind {
    fn from_arg(text: &'a str) -> Result<Self, FromArgumentError<'a>> {
        Self::from_name(text).ok_or(FromArgumentError { value: text, expected: "raw or smooth" })
    }
}

impl<'a> FromArgument<'a> for Orientation {
    fn from_arg(text: &'a str) -> Result<Self, FromArgumentError<'a>> {
        Self::from_name(text).ok_or(FromArgumentError {
            value: text,
            expected: "none, yaw90, roll180, pitch90-... (README lists all 24)",
        })
    }
}

impl Line<'_> {
    /// How many words may follow the first.
    fn most_words(&self) -> usize {
        match self {
            Line::Version | Line::Status | Line::Reboot => 0,
            Line::Set { command: Set::AttitudeError { deg: Chosen(Some(_)), .. } } => 3,
            Line::Cal { command: Cal::Clear { .. } | Cal::Start { .. } | Cal::Mark { .. } | Cal::Solve { .. } }
            | Line::Stream { command: Stream::Rate { .. } | Stream::Heading { .. } }
            | Line::Set { .. } => 2,
            Line::Cal { .. } | Line::Stream { .. } => 1,
        }
    }

    fn meaning(self) -> Result<Request, LineError> {
        use compass::Command;
        Ok(Request::Compass(match self {
            Line::Version => return Ok(Request::Version),
            Line::Status => return Ok(Request::Status),
            Line::Reboot => return Ok(Request::Reboot),
            Line::Cal { command } => match command {
                Cal::Show => return Ok(Request::CalShow),
                Cal::Start { procedure } => Command::CalStart(procedure.unwrap_or_default()),
                Cal::Mark { heading } => Command::CalMark(heading.0),
                Cal::Stop => Command::CalStop,
                Cal::Solve { method } => Command::CalSolve(method),
                Cal::Advise => Command::CalAdvise,
                Cal::Clear { word: Some("all") } => Command::CalClear,
                Cal::Clear { .. } => return Err(LineError::NeedsWord("cal clear all")),
                Cal::Undo => Command::CalUndo,
                Cal::Abort => Command::CalAbort,
            },
            Line::Stream { command } => match command {
                Stream::On => Command::Set(Setting::StreamOn(true)),
                Stream::Off => Command::Set(Setting::StreamOn(false)),
                Stream::Rate { hz } => Command::Set(Setting::StreamRateHz(hz)),
                Stream::Heading { kind } => Command::Set(Setting::StreamHeading(kind)),
            },
            Line::Set { command } => match command {
                Set::Declination { deg } => Command::Set(Setting::Declination(deg.0)),
                Set::Mount { orientation } => Command::Set(Setting::Mount(orientation)),
                Set::Inclination { deg } => Command::Set(Setting::Inclination(deg.0)),
                Set::Align { heading } => Command::Align(heading.0),
                Set::AttitudeError { deg, percent } => {
                    Command::Set(Setting::AttitudeError(attitude_error(deg, percent)?))
                }
            },
        }))
    }
}

fn attitude_error(deg: Chosen, percent: Option<Number>) -> Result<AttitudeError, LineError> {
    match (deg, percent) {
        (Chosen(None), _) => Ok(AttitudeError::DEFAULT),
        (Chosen(Some(bias_deg)), Some(Number(bank_percent))) => Ok(AttitudeError { bias_deg, bank_percent }),
        (Chosen(Some(_)), None) => Err(LineError::MissingArgument(cut("<PERCENT>"))),
    }
}

fn parse(raw: RawCommand<'_>) -> Result<Request, LineError> {
    let words = raw.args().args().count();
    let line = Line::parse(raw)?;
    // embedded-cli passes over words after a command that takes none.
    if words > line.most_words() { Err(LineError::UnexpectedArgument) } else { line.meaning() }
}

impl From<ParseError<'_>> for LineError {
    fn from(error: ParseError<'_>) -> Self {
        match error {
            ParseError::MissingRequiredArgument { name } => Self::MissingArgument(cut(name)),
            ParseError::ParseValueError { expected, .. } => Self::BadValue(cut(expected)),
            ParseError::UnknownCommand => Self::UnknownCommand,
            _ => Self::UnexpectedArgument,
        }
    }
}

/// As much of a text as fits.
fn cut<const N: usize>(text: &str) -> heapless::String<N> {
    let mut out = heapless::String::new();
    // The rest of an overlong text is left away.
    let _ = text.chars().try_for_each(|c| out.push(c));
    out
}

/// Characters in a line.
pub const LINE_CAPACITY: usize = 64;
