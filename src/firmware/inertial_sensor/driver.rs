//! Interface of the drivers.

use core::fmt;

use autoswing::inertial::{InertialSample, InertialSensorErrors};

use crate::chip::ChipError;

/// Measurement of an inertial sensor, in the chip's right-handed axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialReading {
    /// Rates and specific force.
    pub sample: InertialSample,
    /// Temperature of the chip, degrees Celsius.
    pub temperature_c: f32,
    /// Whether an axis is at the limit of its range.
    pub is_saturated: bool,
}

/// Gyro and accelerometer with their own configuration.
///
/// Call [`init`](Self::init) first and after any error, then [`read_measurement`](Self::read_measurement) for each
/// measurement. Drivers wait with `embassy_time`, hence also in virtual time on the host.
#[expect(async_fn_in_trait, reason = "used through generics by tasks of one executor; no caller needs Send bounds")]
pub trait InertialSensor {
    /// Error of the bus.
    type BusError: fmt::Debug;

    /// Checks the identity, sets ranges and rate, tests the sensor, starts continuous measurement.
    ///
    /// # Errors
    ///
    /// Bus error, unexpected identity, a failed self-test, or a register that does not hold its value.
    async fn init(&mut self) -> Result<(), ChipError<Self::BusError>>;

    /// Waits for the next measurement and reads it.
    ///
    /// # Errors
    ///
    /// Bus error, or `NoData` after four periods.
    async fn read_measurement(&mut self) -> Result<InertialReading, ChipError<Self::BusError>>;

    /// Compares the configuration registers with the values written by [`init`](Self::init).
    ///
    /// # Errors
    ///
    /// Bus error, or `Configuration`, after which `init` restores the registers.
    async fn verify_configuration(&mut self) -> Result<(), ChipError<Self::BusError>>;

    /// Errors of the chip by its data sheet.
    fn sensor_errors(&self) -> InertialSensorErrors;

    /// Measurement period, microseconds, as configured by [`init`](Self::init).
    fn period_us(&self) -> u32;
}
