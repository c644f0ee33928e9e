//! Measurement of a magnetometer, and identity of the sensor.

use core::fmt;

use crate::frames::{Field, Sensor};

/// Measurement of a magnetometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Measured field, chip axes.
    pub field: Field<Sensor>,
    /// Whether an axis is at the end of its range; the instrument rejects such readings.
    pub is_saturated: bool,
    /// Whether an earlier measurement was overwritten before it was read.
    pub was_overwritten: bool,
}

/// Identity of the sensor. A calibration is valid for one sensor only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Identity {
    /// Model of the magnetometer.
    pub model: MagnetometerModel,
    /// 7-bit I2C address, or [`SPI_ADDRESS`](Self::SPI_ADDRESS).
    pub address: u8,
}

impl Identity {
    /// Address of a sensor on an SPI bus; no I2C device has it.
    pub const SPI_ADDRESS: u8 = 0;
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.model.model_name())?;
        match self.address {
            Self::SPI_ADDRESS => f.write_str(" on SPI"),
            address => write!(f, " at {address:02x}"),
        }
    }
}

/// Supported magnetometers. Stored by position: append new variants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum MagnetometerModel {
    /// ST LIS3MDL.
    Lis3mdl,
    /// ST LSM303DLHC.
    Lsm303dlhc,
    /// PNI RM3100.
    Rm3100,
}

impl MagnetometerModel {
    /// Name on the data sheet.
    #[must_use]
    pub const fn model_name(self) -> &'static str {
        match self {
            Self::Lis3mdl => "LIS3MDL",
            Self::Lsm303dlhc => "LSM303DLHC",
            Self::Rm3100 => "RM3100",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_have_the_names_of_their_data_sheets() {
        let models = [MagnetometerModel::Lis3mdl, MagnetometerModel::Lsm303dlhc, MagnetometerModel::Rm3100];
        assert_eq!(models.map(MagnetometerModel::model_name), ["LIS3MDL", "LSM303DLHC", "RM3100"]);
    }

    #[test]
    fn an_identity_is_shown_with_its_address_or_its_bus() {
        assert_eq!(Identity { model: MagnetometerModel::Lis3mdl, address: 0x1E }.to_string(), "LIS3MDL at 1e");
        assert_eq!(
            Identity { model: MagnetometerModel::Rm3100, address: Identity::SPI_ADDRESS }.to_string(),
            "RM3100 on SPI"
        );
    }
}
