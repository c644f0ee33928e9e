//! Test support shared by the library and the simulator: simulation clock, executor, random numbers, flash, frames,
//! documents.
//!
//! | module | holds |
//! |---|---|
//! | [`clock`] | simulation clock behind `embassy_time` |
//! | [`simulation`] | executor: tasks, priorities, power-off |
//! | [`random`] | random numbers for tests |
//! | [`flash`] | NOR flash with power cuts and faults |
//! | [`frames`] | frames of MAVLink and MSP |
//! | [`documents`] | figures that documents state |
//!
//! A separate package, because the simulator depends on the library and the library's tests must not depend on the
//! simulator.

#![warn(clippy::disallowed_methods, clippy::disallowed_types)]

pub mod clock;
pub mod documents;
pub mod flash;
pub mod frames;
pub mod random;
pub mod simulation;

// Links the critical-section implementation for `embassy-sync`.
use critical_section as _;
