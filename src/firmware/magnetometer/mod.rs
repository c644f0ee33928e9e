//! Magnetometer drivers: a common trait, one file per chip.

mod driver;
pub mod lis3mdl;
pub mod lsm303dlhc;
pub mod rm3100;

pub use autoswing::reading::{Identity, MagnetometerModel, Reading};
pub use driver::Magnetometer;
