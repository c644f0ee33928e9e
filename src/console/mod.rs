//! The console's language: what a person types and what it means.
//!
//! | file | holds |
//! |---|---|
//! | `words.rs` | every command, in one table |
//! | `language.rs` | what a line means, how a word goes on, help and complaints, all by that table |
//! | `editor.rs` | keys to a line: cursor, history |
//! | [`session`] | one terminal: the two above, and what waits to be sent |
//! | [`report`] | the replies' texts |
//!
//! Editor and parser are our own: `embedded-cli`, which did this, generates a parser for each command (10 KB of flash
//! more than the table), knows no choices and completes only the first word; crates that edit a line and no more would
//! leave most of it to do. Every complaint is an `error <code>: what to do`, so that scripts can rely on the codes.

mod editor;
mod language;
#[cfg(test)]
mod left_out;
pub mod report;
pub mod session;
mod words;

pub use language::{LineError, help, parse};
pub use words::Row;

use crate::compass;

/// What a line asks for.
#[derive(Clone, Copy, Debug)]
pub enum Request {
    /// What can be typed; about one command, if it is given.
    Help(Option<&'static Row>),
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

/// Characters in a line.
pub const LINE_CAPACITY: usize = 64;
