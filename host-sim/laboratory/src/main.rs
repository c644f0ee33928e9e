//! Serves, emulates and measures the module.

use std::process::ExitCode;

fn main() -> ExitCode {
    laboratory::cli::run_program()
}
