//! Drivers of gyro and accelerometer: a common trait, one file per chip.

mod driver;
pub mod lsm6dsl;

pub use driver::{InertialReading, InertialSensor};
