//! The command line of the simulator.

// They end the program where nobody reads: `cli::print` does not.
#![warn(clippy::print_stdout, clippy::print_stderr)]

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
