//! Magnetometers: one trait, one file a chip.

mod chip;
pub mod lis3mdl;
pub mod lsm303dlhc;

use crate::frames::{Field, Sensor};

/// What a magnetometer reported at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// The field in the chip's own axes.
    pub field: Field<Sensor>,
    /// At least one axis is at the end of its range: the field is not to be used.
    pub saturated: bool,
    /// The chip overwrote at least one measurement that was never read.
    pub overrun: bool,
}

/// Which chip answered, kept with a calibration so that one is never applied to another sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Identity {
    /// The chip's model.
    pub model: Model,
    /// Its 7-bit I2C address.
    pub address: u8,
}

/// Supported magnetometers. What is stored of one is its place here: a new one goes to the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Model {
    /// ST LIS3MDL.
    Lis3mdl,
    /// ST LSM303DLHC, its magnetometer.
    Lsm303dlhc,
}

impl Model {
    /// The name as printed on the chip's data sheet.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lis3mdl => "LIS3MDL",
            Self::Lsm303dlhc => "LSM303DLHC",
        }
    }
}

/// Why a magnetometer could not be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error<E> {
    /// The bus failed; the bus's own error.
    Bus(E),
    /// Something answered at the address, but its identity register held this byte.
    WrongIdentity(u8),
    /// A register written with the first value read back as the second: the chip lost power or is not what it says.
    Configuration {
        /// The value written.
        written: u8,
        /// The value read back.
        read: u8,
    },
    /// No new measurement came within the chip's time.
    NoData,
}

/// A 3-axis magnetometer that configures itself.
///
/// The order is [`init`](Self::init), then [`read`](Self::read) for every measurement. After any error the owner calls
/// `init` again. The driver waits with `embassy_time`, so that it runs in the host's virtual time too.
#[expect(async_fn_in_trait, reason = "used through generics by tasks of one executor; no caller needs Send bounds")]
pub trait Magnetometer {
    /// The bus's error.
    type BusError: core::fmt::Debug;

    /// Checks the identity, sets range and rate, starts continuous measurement.
    ///
    /// # Errors
    ///
    /// The bus's own, or that another chip answered, or that its registers do not hold what was written.
    async fn init(&mut self) -> Result<Identity, Error<Self::BusError>>;

    /// Waits for the next measurement and reads it.
    ///
    /// # Errors
    ///
    /// The bus's own, or [`Error::NoData`] when none came for four periods.
    async fn read(&mut self) -> Result<Reading, Error<Self::BusError>>;

    /// Reads the configuration back and compares it with what [`init`](Self::init) wrote.
    ///
    /// # Errors
    ///
    /// The bus's own, or [`Error::Configuration`]: `init` mends it.
    async fn verify(&mut self) -> Result<(), Error<Self::BusError>>;

    /// How many readings in a row are equal in an axis only when it is stuck: more than noise makes equal in a day at
    /// rest.
    fn stuck_after(&self) -> u16;

    /// The period between measurements in microseconds, as configured by [`init`](Self::init).
    fn period_us(&self) -> u32;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_have_the_names_of_their_data_sheets() {
        assert_eq!([Model::Lis3mdl, Model::Lsm303dlhc].map(Model::name), ["LIS3MDL", "LSM303DLHC"]);
    }
}
