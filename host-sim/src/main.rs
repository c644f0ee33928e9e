//! Command line of the simulator.

// The standard macros panic when the reader has closed the pipe; `cli::print` does not.
#![warn(clippy::print_stdout, clippy::print_stderr)]

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run_program()
}
