//! Autoswing: a magnetic heading module that compensates its own deviation. Terms and symbols: `docs/glossary.md`.
//!
//! Iron in an airframe deflects a magnetic compass by tens of degrees. This crate collects magnetometer and attitude
//! samples in flight, solves for the twelve deviation coefficients on the device without a heading reference, stores
//! them in flash and outputs the corrected heading. It implements and extends Liu Shibin, "Study on Automatic Magnetic
//! Deviation Compensation of Magnetic Heading Measurement for UAV", Acta Aeronautica et Astronautica Sinica 28(2),
//! 2007, 411-414 (*Liu 2007* below).
//!
//! # As a library
//!
//! [`calibration`] solves for coefficients, and an [`instrument::Instrument`] computes headings with them. Each has an
//! example. The packages `autoswing-module` (state machine, settings, flash) and `autoswing-firmware` (tasks, ports,
//! drivers, boards) build the module around this library; see docs/architecture.md.
//!
//! | module | contents |
//! |---|---|
//! | [`frames`], [`time`] | types for fields in frames, attitude, time |
//! | [`calibration`] | the twelve coefficients and their covariance from samples |
//! | [`heading`], [`attitude`], [`earth`] | heading from a corrected field; attitude track; field model |
//! | [`inertial`] | roll, pitch and rates from gyro and accelerometer |
//! | [`instrument`] | readings and attitude in, headings and samples out |
//! | [`collection`], [`acceptance`] | selection of samples, acceptance of results |
//!
//! # Data flow (and order for reading)
//!
//! A sensor's reading -> [`frames::Field`]`<Sensor>` in microtesla with timestamp -> [`instrument`]: attitude
//! interpolated to that time ([`attitude`]), averaging -> [`calibration::Sample`] -> [ turn detector and dataset
//! ([`collection`]) -> solver ([`calibration`]) -> [`acceptance`] on held-back samples -> flash ] -> `Field<Body>`
//! corrected -> level frame -> heading ([`heading`]) -> a port.
//!
//! # Frames and signs
//!
//! - Body frame FRD: x forward, y right wing, z down. Attitude: Euler ZYX; roll phi > 0 right wing down, pitch theta >
//!   0 nose up, heading psi clockwise from magnetic north. As in MAVLink, PX4 and ArduPilot.
//! - Level frame: x along the horizontal projection of the nose, y to the right, z down.
//! - Liu 2007 uses x forward, y up, z right: `(x, y, z)_paper = (x, -z, y)_FRD`.
//! - Earth field in the level frame at heading psi: `H0 [cos psi, -sin psi, D]`, `D = tan(inclination)`, inclination
//!   positive down. So `psi = atan2(-l_y, l_x)` (Liu 2007 eq. 3).
//! - Sensor model (Liu 2007 eq. 8): `m = A h_body + b`. `A` contains soft iron, scale, non-orthogonality and the
//!   rotation between sensor and attitude frame; `b` contains hard iron and zero offset. The device stores `W = A^-1`
//!   and `b`.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod acceptance;
pub mod attitude;
pub mod calibration;
pub mod collection;
pub mod decimal;
pub mod earth;
pub mod frames;
pub mod heading;
pub mod inertial;
pub mod instrument;
pub mod reading;
pub mod time;
pub mod trig;

// Test fixtures that other packages include name the library.
#[cfg(test)]
extern crate self as autoswing;
