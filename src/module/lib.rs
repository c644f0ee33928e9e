//! The state machine of the Autoswing heading module, without tasks and hardware: events in, effects out.
//!
//! | module | contents |
//! |---|---|
//! | [`compass`] | the state machine: commands, collection, solves, saves |
//! | [`messages`] | everything reported to people: codes, severities, texts, advice |
//! | [`replaced_numbers`] | numbers of the autopilot's parameters of before a setup |
//! | [`settings`] | what the user chose |
//! | [`store`] | calibrations and settings on pages of flash |
//!
//! `autoswing_firmware` runs it in a task; the analysis of logs feeds it with a log. See docs/architecture.md.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod compass;
pub mod messages;
pub mod replaced_numbers;
pub mod settings;
pub mod store;

#[cfg(test)]
#[path = "../library/calibration/tests/synthetic.rs"]
#[expect(dead_code, reason = "some of it is for other packages' tests")]
mod synthetic;
