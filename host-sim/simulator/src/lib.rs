//! Simulator of Autoswing: the firmware's tasks in a simulated vehicle, in simulation time.
//!
//! | module | holds |
//! |---|---|
//! | [`world`] | vehicle, weather, Earth's field, airframe, autopilot |
//! | [`devices`] | register-level hardware: magnetometers, NOR flash, UART cables, CAN bus |
//! | [`faults`] | fault injection |
//! | [`module`] | interface to a heading module in a vehicle |
//! | [`rig`] | its implementation on simulated hardware |
//! | [`routine`] | calibration routines by vehicle kind |
//! | [`mission`], [`mission_report`] | complete calibration flight, and its report |
//! | [`recording`] | logs of simulated flights |
//! | [`transcript`], [`nmea`] | parsers of console and heading output |
//! | [`heading_errors`] | errors of a calibration in a world |
//! | [`random`] | seeded random streams, one per purpose |
//!
//! Clock and executor are in `testkit`; statistics, log formats and report pages in `log_analysis`. All results are
//! functions of the seed: no code reads real time, files or unseeded random numbers, and the crate needs no operating
//! system.

#![warn(clippy::disallowed_methods, clippy::disallowed_types)]

pub mod devices;
pub mod faults;
pub mod heading_errors;
pub mod mission;
pub mod mission_report;
pub mod module;
pub mod nmea;
pub mod random;
pub mod recording;
pub mod rig;
pub mod routine;
pub mod sensors;
pub mod transcript;
pub mod world;
