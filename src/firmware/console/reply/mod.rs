//! The console's replies. Each begins with `ok` or `error <code>: what to do`; an unsolicited message begins with
//! `note`.

mod calibration;
mod error;
mod settings;
mod status;

use core::fmt::{self, Write};

use crate::health::{Diagnostics, ResetCause};
use autoswing::decimal::ShortestDecimal;
use autoswing_module::compass::{AutopilotAction, Command, Reply, StatusReport};
use autoswing_module::messages::{Message, Refusal};
use autoswing_module::settings::DependentState;
use calibration::{CalibrationTitle, write_advice, write_calibration};
pub use error::write_line_error;
use error::write_refusal;
use settings::write_setting_line;
use status::{ResetText, write_full_status, write_safe_mode_status, write_status};

/// The firmware's version; with its commit if a script of this repository built it (`scripts/foreign-target.sh`).
pub const VERSION: &str = match option_env!("AUTOSWING_VERSION") {
    Some(version) => version,
    None => env!("CARGO_PKG_VERSION"),
};

/// Writes the reply to `version`.
///
/// # Errors
///
/// Those of `out`.
pub fn write_version(out: &mut impl Write) -> fmt::Result {
    writeln!(out, "ok autoswing {VERSION}")
}

/// Writes the greeting after a start.
///
/// # Errors
///
/// Those of `out`.
pub fn write_greeting(out: &mut impl Write, reset_cause: &ResetCause) -> fmt::Result {
    writeln!(out, "autoswing {VERSION}, started by {}; help lists the commands", ResetText(reset_cause))
}

/// Writes the reply to a command; a report after a command that changes something shows the resulting state.
///
/// # Errors
///
/// Those of `out`.
pub fn write_reply(
    out: &mut impl Write,
    command: Command,
    reply: &Result<Reply, Refusal>,
    health: &Diagnostics,
) -> fmt::Result {
    match (reply, command) {
        (Err(reason), _) => write_refusal(out, reason),
        (Ok(_), Command::Restart | Command::Autopilot(AutopilotAction::Restart)) => writeln!(out, "ok restarting"),
        (Ok(_), Command::Autopilot(_)) => writeln!(out, "ok asking the autopilot; notes follow"),
        (Ok(Reply::Report(report)), Command::Status) => write_status(out, report, health),
        (Ok(Reply::Report(report)), Command::StatusAll) => write_full_status(out, report, health),
        (Ok(Reply::Report(report)), Command::CalShow) => write_calibration(out, report),
        (Ok(Reply::Report(report)), _) => write_state_after_change(out, command, report),
        (Ok(Reply::Done(state)), _) => writeln!(out, "ok {}", state.state_name()),
        (Ok(Reply::MarkCount(number)), _) => writeln!(out, "ok mark {number}"),
        (Ok(Reply::Advice(advice)), _) => write_advice(out, advice),
        (Ok(Reply::SafeMode), _) => write_safe_mode_status(out, health),
    }
}

/// Writes an unsolicited message.
///
/// # Errors
///
/// Those of `out`.
pub fn write_notice(out: &mut impl Write, message: &Message) -> fmt::Result {
    writeln!(out, "note {message}")
}

fn write_state_after_change(out: &mut impl Write, command: Command, report: &StatusReport) -> fmt::Result {
    match (command, &report.stored_calibration) {
        (Command::Set(change), _) => {
            out.write_str("ok ")?;
            write_setting_line(out, change.setting.status_texts[0], " ", report)?;
            let state = if change.affects(DependentState::Calibration) { report.module_state.state_name() } else { "" };
            writeln!(out, "{}{state}", if state.is_empty() { "" } else { "; " })
        }
        (Command::Align(_) | Command::AlignConfirmed(_), _) => {
            writeln!(out, "ok align {} deg, added to every heading", ShortestDecimal(report.settings.align_deg, 1))
        }
        (Command::CalUndo, Some(record)) => {
            writeln!(out, "ok {}: {}", report.module_state.state_name(), CalibrationTitle(record))
        }
        _ => writeln!(out, "ok {}", report.module_state.state_name()),
    }
}
