//! Measurement of a magnetometer, and identity of the sensor.

use crate::frames::{Field, Sensor};

/// Measurement of a magnetometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Field, chip axes.
    pub field: Field<Sensor>,
    /// Whether an axis is at the end of its range; the instrument rejects such readings.
    pub saturated: bool,
    /// Whether an earlier measurement was overwritten before it was read.
    pub overrun: bool,
}

/// Identity of the sensor. A calibration is valid for one sensor only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Identity {
    /// Model.
    pub model: Model,
    /// 7-bit I2C address.
    pub address: u8,
}

/// Supported magnetometers. Stored by position: append new variants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Model {
    /// ST LIS3MDL.
    Lis3mdl,
    /// ST LSM303DLHC.
    Lsm303dlhc,
}

impl Model {
    /// Name on the data sheet.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lis3mdl => "LIS3MDL",
            Self::Lsm303dlhc => "LSM303DLHC",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_have_the_names_of_their_data_sheets() {
        assert_eq!([Model::Lis3mdl, Model::Lsm303dlhc].map(Model::name), ["LIS3MDL", "LSM303DLHC"]);
    }
}
