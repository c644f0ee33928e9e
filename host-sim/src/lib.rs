//! Programs around the simulator and the analysis of logs: all that needs an operating system, and the studies.
//!
//! | module | holds |
//! |---|---|
//! | [`emulator`] | the firmware's ARM code in QEMU, as a module of the simulator |
//! | [`serve`] | access for external programs: console, pilot commands, ports, simulators |
//! | [`studies`] | accuracy, integrity, and the paper's table |
//!
//! The simulator is the crate `simulator`, the analysis of logs the crate `log_analysis`; the command line is the
//! binary. All results but those of the emulator and of served modules are functions of the seed.

#![warn(clippy::disallowed_methods)]

pub mod emulator;
pub mod serve;
pub mod studies;
