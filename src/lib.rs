//! Autoswing: a magnetic heading module that swings its own compass.
//!
//! Iron in an airframe bends a magnetic compass by tens of degrees. This crate collects magnetometer and attitude
//! samples while the aircraft flies left and right turns, solves the twelve deviation coefficients on the device
//! without any heading reference, keeps them in flash and streams corrected heading. It implements and extends
//! Liu Shibin, "Study on Automatic Magnetic Deviation Compensation of Magnetic Heading Measurement for UAV",
//! Acta Aeronautica et Astronautica Sinica 28(2), 2007, 411-414 (cited below as *Liu 2007*).
//!
//! # As a library
//!
//! Two things are of use without the firmware: [`calibration`] makes coefficients of samples, and an
//! [`instrument::Instrument`] makes headings of readings and attitude with them. Each has an example. The rest builds
//! the module around them; docs/architecture.md draws it.
//!
//! | module | holds |
//! |---|---|
//! | [`frames`], [`time`] | fields in frames, attitude, instants, as types |
//! | [`calibration`] | from samples to the twelve coefficients, with their uncertainty |
//! | [`heading`], [`attitude`], [`earth`] | a corrected field to a heading; attitude in time; place and day |
//! | [`magnetometer`], [`wire`] | sensor drivers; MAVLink, NMEA |
//! | [`instrument`] | readings and attitude in, headings and samples out |
//! | [`collection`], [`acceptance`], [`store`] | which samples are kept, whether a result is, and where |
//! | [`compass`], [`port`], [`console`], [`app`] | the state machine, what others are told, and the tasks |
//! | [`settings`], [`health`] | what the user chose, how the module is |
//!
//! # The way of a sample (read the modules in this order)
//!
//! I2C registers ([`magnetometer`]) -> [`frames::Field`]`<Sensor>` in microtesla at an instant -> the [`instrument`]
//! pairs it with the attitude interpolated to that instant ([`attitude`]) and averages -> [`calibration::Sample`]
//! -> [ turn detector and dataset ([`collection`]) -> solver ([`calibration`]) -> [`acceptance`] on held-back samples
//! -> flash ([`store`]) ] -> `Field<Body>` corrected -> de-rotated by the attitude -> heading ([`heading`])
//! -> a [`port`] -> a field to an autopilot's compass, NMEA ([`wire`]).
//!
//! The asynchronous tasks that move it along are in [`app`]; they run unchanged on a board and, in virtual time, on
//! the host. What is board-specific is in `board`, which exists only when built for bare metal.
//!
//! # Frames and signs
//!
//! - Body frame FRD: x forward, y right wing, z down. Attitude: Euler ZYX; roll phi > 0 is right wing down, pitch
//!   theta > 0 is nose up, heading psi is clockwise from magnetic north. The same as MAVLink, PX4 and ArduPilot.
//! - Level frame: x along the horizontal projection of the nose, y to the right, z down.
//! - Liu 2007 uses x forward, y up, z right: `(x, y, z)_paper = (x, -z, y)_FRD`.
//! - Earth field in the level frame at heading psi: `H0 [cos psi, -sin psi, D]`, `D = tan(inclination)`, inclination
//!   positive down. So `psi = atan2(-l_y, l_x)` (Liu 2007 eq. 3).
//! - Sensor model (Liu 2007 eq. 8): `m = A h_body + b`. `A` holds soft iron, scale, non-orthogonality and the rotation
//!   between sensor and attitude frame; `b` holds hard iron and zero offset. The device keeps `W = A^-1` and `b`.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod acceptance;
pub mod app;
pub mod attitude;
pub mod calibration;
pub mod collection;
pub mod compass;
pub mod console;
pub mod earth;
pub mod frames;
pub mod heading;
pub mod health;
pub mod instrument;
mod log;
pub mod magnetometer;
pub mod port;
pub mod settings;
pub mod store;
pub mod time;
mod trig;
pub mod wire;
