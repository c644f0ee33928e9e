//! The console's language: table of commands, parser with completion and help, line editor, [`session`] of a terminal,
//! texts of the replies ([`reply`]).
//!
//! Editor and parser are written here: `embedded-cli` generates a parser for each command (10 KB of flash more than the
//! table), has no choices and completes only the first word; crates for line editing alone save little. Every error is
//! an `error <code>: what to do`, so that scripts can rely on the codes.

mod command_table;
mod line_editor;
mod parser;
pub mod reply;
pub mod session;
mod wrapped_lines;

pub use command_table::{ConsoleCommand, Request};
pub use line_editor::LINE_CAPACITY;
pub use parser::{LineError, parse_request, write_help};
