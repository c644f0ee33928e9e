//! Simulator of Autoswing: the firmware's tasks in a simulated vehicle, in simulation time.
//!
//! | module | holds |
//! |---|---|
//! | [`clock`], [`simulation`] | simulation clock behind `embassy_time`, executor (package `testkit`) |
//! | [`devices`] | register-level hardware: I2C with a LIS3MDL, NOR flash, UART cables |
//! | [`module`] | interface to a heading module in a vehicle |
//! | [`rig`], [`emulator`] | its implementations: simulated hardware, and ARM code in QEMU |
//! | [`routine`] | calibration routines by vehicle kind |
//! | [`mission`] | complete calibration flight |
//! | [`serve`] | access for external programs: console, pilot commands, ports, simulators |
//! | [`world`] | vehicle, weather, Earth's field, airframe, autopilot |
//! | [`paper`] | reproduction of Liu 2007 table 1 with every method |
//! | [`log`] | reader of autopilot logs, and writer of small ones |
//! | [`replay`] | logged flights through the module's collector and solver |
//! | [`accuracy`] | accuracy relative to the Cramér-Rao bound |
//! | [`faults`] | fault injection |
//! | [`integrity`] | headings output as good while a fault is active |
//! | [`numbers`] | numbers as text and in JSON |
//! | [`random`] | seeded random streams, one per purpose |
//!
//! All results are functions of the seed; no code reads real time or unseeded random numbers.

pub use testkit::{clock, simulation};

pub mod accuracy;
pub mod devices;
pub mod emulator;
pub mod faults;
pub mod integrity;
pub mod log;
pub mod mission;
pub mod module;
pub mod nmea;
pub mod numbers;
pub mod paper;
pub mod random;
pub mod replay;
pub mod report;
pub mod rig;
pub mod routine;
pub mod score;
pub mod serve;
pub mod transcript;
pub mod world;
