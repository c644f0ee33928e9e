//! Autoswing's firmware tasks flown by a simulated aircraft, in virtual time.
//!
//! | module | holds |
//! |---|---|
//! | [`clock`], [`simulation`] | the virtual clock behind `embassy_time`, the executor on it (package `testkit`) |
//! | [`devices`] | register-level hardware: I2C with a LIS3MDL, NOR flash, UART cables |
//! | [`module`] | a heading module in an aircraft |
//! | [`rig`], [`emulator`] | the two there are: simulated here, and as ARM code in QEMU |
//! | [`routine`] | what a person flies to calibrate, aircraft by aircraft |
//! | [`mission`] | the flight that calibrates, on either |
//! | [`serve`] | the module for those outside: who types, flies, listens, or brings a simulator of their own |
//! | [`world`] | aircraft, weather, Earth field, airframe iron, attitude source |
//! | [`paper`] | the experiment of Liu 2007 table 1 again, with every method |
//! | [`log`] | flights from logs as autopilots write them, and small ones written |
//! | [`replay`] | a logged flight through the module's collection and solver, judged |
//! | [`accuracy`] | accuracy of the methods against the bound of what is possible |
//! | [`faults`] | what can go wrong around a module, as decorators |
//! | [`integrity`] | what the module believes while something is wrong |
//! | [`random`] | one seeded stream of random numbers per purpose |
//!
//! Nothing here reads a wall clock or an unseeded random number: a run is a function of its seed.

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
