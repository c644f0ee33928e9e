//! Flies the module in a simulated vehicle, and judges logs.

use std::process::ExitCode;

fn main() -> ExitCode {
    host_sim::commands::run_program()
}
