//! Messages: everything that the module reports to people, in one list.
//!
//! | file | holds |
//! |---|---|
//! | `message.rs` | [`Message`] and its severity |
//! | `refusal.rs` | [`Refusal`]: why a command or a solve was refused |
//! | `message_list.rs` | the list: stable code, what happened and what to do, an entry for each message and each refusal |
//! | `sample_loss.rs` | [`SampleLoss`]: why readings did not become samples |
//! | `autopilot_report.rs` | [`AutopilotReport`]: results of `autopilot check` and `autopilot setup` |
//! | `parameter_name.rs` | [`ParameterName`]: name of an autopilot's parameter |
//! | `accuracy.rs` | [`ExpectedAccuracy`] of a calibration, as text |
//!
//! The console writes a message after `note `, MAVLink sends it as a STATUSTEXT of its severity. The errors of the
//! rooms below have one plain clause each; advice and severity are here.

mod accuracy;
mod autopilot_report;
mod message;
mod message_list;
mod parameter_name;
mod refusal;
mod sample_loss;

pub use accuracy::ExpectedAccuracy;
pub use accuracy::ExpectedErrorText;
pub use autopilot_report::{
    AutopilotReport, CompassPriority, ParameterCounts, ParameterReport, ParameterState, RegisteredCompass,
    WantedNumber, WantedParameter,
};
pub use message::{Message, Severity, SolveOutcome};
pub use parameter_name::ParameterName;
pub use refusal::{Refusal, RefusalCause};
pub use sample_loss::SampleLoss;

#[cfg(test)]
mod tests;
