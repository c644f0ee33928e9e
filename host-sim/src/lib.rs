//! The command line: fly the module in a simulated vehicle, and judge logs; and what the laboratory's commands share.
//!
//! | module | holds |
//! |---|---|
//! | [`commands`] | the commands and their exit codes |
//! | [`fly`], [`replay`], [`several_logs`] | each command |
//! | [`verdict_text`], [`heading_file`] | the verdict as text, headings as a table |
//! | [`file_options`], [`option_parsers`] | files and values of options |
//! | [`print`](mod@print) | output |
//! | [`command_failure`], [`termination`] | how a command ends before its end |
//!
//! The simulator is the crate `simulator`, the judgement of logs the crate `log_analysis`; studies, emulator and served
//! modules are the crate `laboratory`. All results are functions of the seed or of the log.

// The standard macros panic when the reader has closed the pipe; `print` does not.
#![warn(clippy::disallowed_methods, clippy::print_stdout, clippy::print_stderr)]

pub mod command_failure;
pub mod commands;
pub mod file_options;
pub mod fly;
pub mod heading_file;
pub mod option_parsers;
pub mod print;
pub mod replay;
pub mod several_logs;
pub mod termination;
pub mod verdict_text;
