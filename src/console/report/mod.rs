//! What the console answers. Every answer begins with `ok` or `error <code>: what to do`; what comes unasked begins
//! with `note`.

mod calibration;
mod settings;
mod status;

pub use calibration::calibration;
pub use status::status;

use core::fmt::{self, Display, Write};

use super::LineError;
use crate::compass::{Command, Outcome, Refusal, Reply, Report};
use crate::health::{Loss, ResetCause};
use crate::instrument::Iron;
use crate::settings::Setting;
use crate::wire::decimal::{AsTyped, Decimal};
use calibration::{Judged, Numbered, advise};
use settings::{Line, setting_line};

/// The firmware's version.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// `error <code>: what to do`.
///
/// # Errors
///
/// What `out` says.
pub fn error(out: &mut impl Write, code: &str, what_to_do: impl Display) -> fmt::Result {
    writeln!(out, "error {code}: {what_to_do}")
}

/// A line that means nothing.
///
/// # Errors
///
/// What `out` says.
pub fn line_error(out: &mut impl Write, line: &LineError) -> fmt::Result {
    error(out, line.code(), line)
}

/// A refusal of the state machine, with what was lost of the readings since the collection began.
///
/// # Errors
///
/// What `out` says.
pub fn refusal(out: &mut impl Write, refusal: &Refusal, loss: Option<Loss>) -> fmt::Result {
    error(out, refusal.code(), Reason(refusal, loss))
}

/// Why something was refused: where samples are wanting, what was lost of the readings is the better reason.
struct Reason<'a>(&'a Refusal, Option<Loss>);

impl Display for Reason<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self(refusal, Some(loss)) if refusal.is_for_want_of_samples() => loss.fmt(f),
            Self(refusal, _) => refusal.fmt(f),
        }
    }
}

/// `version`.
///
/// # Errors
///
/// What `out` says.
pub fn version(out: &mut impl Write) -> fmt::Result {
    writeln!(out, "ok autoswing {VERSION}")
}

/// The greeting after a start.
///
/// # Errors
///
/// What `out` says.
pub fn greeting(out: &mut impl Write, reset: &ResetCause) -> fmt::Result {
    writeln!(out, "autoswing {VERSION}, started by {}; help lists the commands", Reset(reset))
}

/// A command that was carried out.
///
/// # Errors
///
/// What `out` says.
pub fn done(out: &mut impl Write, reply: &Reply) -> fmt::Result {
    match reply {
        Reply::Done(state) => writeln!(out, "ok {}", state.name()),
        Reply::Report(report) => writeln!(out, "ok {}", report.state.name()),
        Reply::Marked(number) => writeln!(out, "ok mark {number}"),
        Reply::Advice(advice) => advise(out, advice),
    }
}

/// A solve has ended by itself; with what was lost of the readings since the collection began.
///
/// # Errors
///
/// What `out` says.
pub fn outcome(out: &mut impl Write, outcome: &Outcome, loss: Option<Loss>) -> fmt::Result {
    match outcome {
        Ok(verdict) => writeln!(out, "note calibrated: {}", Judged(verdict)),
        Err(refusal) => {
            // Nobody had asked for anything that was refused.
            let refused = if matches!(refusal, Refusal::CollectionLost) { "" } else { "refused " };
            writeln!(out, "note {refused}{}: {}", refusal.code(), Reason(refusal, loss))
        }
    }
}

/// Iron in the aircraft has moved, or is back where it was.
///
/// # Errors
///
/// What `out` says.
pub fn iron(out: &mut impl Write, iron: Option<&Iron>) -> fmt::Result {
    match iron {
        Some(iron) => writeln!(out, "note iron-moved: {}", Moved(iron)),
        None => writeln!(out, "note iron-back: as calibrated again"),
    }
}

/// By how much, where to, and what to do.
struct Moved<'a>(&'a Iron);

impl Display for Moved<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Iron { change_ut, sigma_ut } = self.0;
        let axes = [("forward", "aft"), ("to the right", "to the left"), ("down", "up")];
        let (axis, &most) = change_ut
            .iter()
            .enumerate()
            .fold((0, &0.0), |most, next| if next.1.abs() > f32::abs(*most.1) { next } else { most });
        let where_to = axes.get(axis).map_or("", |(ahead, back)| if most < 0.0 { *back } else { *ahead });
        let [x, y, z] = [change_ut.x, change_ut.y, change_ut.z].map(Decimal::<1>);
        let (size, sigma) = (Decimal::<1>(change_ut.norm()), Decimal::<1>(*sigma_ut));
        write!(f, "{size} uT since the calibration, mostly {where_to} (x {x}, y {y}, z {z}, sigma {sigma}); ")?;
        f.write_str("headings allow for it; fix what moved, or calibrate anew")
    }
}

/// What is in force after a command that has changed it.
///
/// # Errors
///
/// What `out` says.
pub fn changed(out: &mut impl Write, command: Command, report: &Report) -> fmt::Result {
    match (command, &report.current) {
        (Command::Set(setting), _) => {
            out.write_str("ok ")?;
            setting_line(out, Line::of(setting), " ", report)?;
            // A calibration is of one mounting.
            let state = if let Setting::Mount(_) = setting { report.state.name() } else { "" };
            writeln!(out, "{}{state}", if state.is_empty() { "" } else { "; " })
        }
        (Command::Align(_) | Command::AlignSurely(_), _) => {
            writeln!(out, "ok align {} deg, added to every heading", AsTyped(report.settings.align_deg, 1))
        }
        (Command::CalUndo, Some(record)) => {
            writeln!(out, "ok {}: {}", report.state.name(), Numbered(record))
        }
        _ => writeln!(out, "ok {}", report.state.name()),
    }
}

struct Reset<'a>(&'a ResetCause);

impl Display for Reset<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            ResetCause::PowerOn => f.write_str("power-on"),
            ResetCause::Pin => f.write_str("reset pin"),
            ResetCause::Software => f.write_str("reboot"),
            ResetCause::Watchdog => f.write_str("watchdog"),
            ResetCause::Panic(words) => write!(f, "panic: {words}"),
        }
    }
}
