//! The firmware of the Autoswing heading module: all that waits, speaks, listens or touches a chip.
//!
//! | module | contents |
//! |---|---|
//! | [`app`] | the asynchronous tasks and their order |
//! | [`port`], [`console`] | what autopilots and instruments receive and send; what a person types and reads |
//! | [`wire`] | bytes of MAVLink, MSP, NMEA and DroneCAN |
//! | [`magnetometer`], [`inertial_sensor`] | sensor drivers |
//! | [`chip`] | registers, polling and errors of chips |
//! | [`health`] | counters for diagnosis |
//!
//! The tasks run unchanged on a board and, in virtual time, on a host. The boards are modules of the binary, which is
//! built for bare metal only. See docs/architecture.md.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod app;
pub mod chip;
pub mod console;
pub mod health;
pub mod inertial_sensor;
mod log;
pub mod magnetometer;
pub mod port;
pub mod wire;

#[cfg(test)]
#[path = "../library/calibration/tests/synthetic.rs"]
#[expect(dead_code, reason = "some of it is for other packages' tests")]
mod synthetic;
