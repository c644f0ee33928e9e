//! The laboratory: programs around the simulator that need an operating system, and the studies.
//!
//! | module | holds |
//! |---|---|
//! | [`emulator`] | the firmware's ARM code in QEMU, as a module of the simulator |
//! | [`serve`] | access for external programs: console, pilot commands, ports, simulators |
//! | [`studies`] | accuracy, integrity, and the paper's table |
//! | [`cli`] | the commands of the binary `lab` |
//!
//! All results but those of the emulator and of served modules are functions of
//! the seed.

// The standard macros panic when the reader has closed the pipe; `host_sim::print` does not.
#![warn(clippy::disallowed_methods, clippy::print_stdout, clippy::print_stderr)]

pub mod cli;
pub mod emulator;
pub mod serve;
pub mod studies;
