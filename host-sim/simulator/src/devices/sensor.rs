//! Common types of the magnetometers.

use autoswing::frames::{Field, Sensor};
use serde::Deserialize;

/// Field in a magnetometer's axes as a function of simulation time in microseconds. The time is at most one measurement
/// period (1.6 s of a LIS3MDL) in the past.
pub type FieldSource = Box<dyn FnMut(u64) -> Field<Sensor>>;

/// Magnetometer of a module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SensorModel {
    /// ST LIS3MDL on I2C, the reference board's.
    #[default]
    Lis3mdl,
    /// PNI RM3100 on SPI.
    Rm3100,
}
