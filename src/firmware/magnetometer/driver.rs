//! Interface of the drivers.

use core::fmt;

use crate::chip::ChipError;
use autoswing::reading::{Identity, Reading};

/// Three-axis magnetometer with its own configuration.
///
/// Call [`init`](Self::init) first and after any error, then [`read_measurement`](Self::read_measurement) for each
/// measurement. Drivers wait with `embassy_time`, hence also in virtual time on the host.
#[expect(async_fn_in_trait, reason = "used through generics by tasks of one executor; no caller needs Send bounds")]
pub trait Magnetometer {
    /// Error of the bus.
    type BusError: fmt::Debug;

    /// Checks the identity, sets range and rate, starts continuous measurement.
    ///
    /// # Errors
    ///
    /// Bus error, unexpected identity, a failed self-test, or a register that does not hold its value.
    async fn init(&mut self) -> Result<Identity, ChipError<Self::BusError>>;

    /// Waits for the next measurement and reads it.
    ///
    /// # Errors
    ///
    /// Bus error, or `NoData` after four periods.
    async fn read_measurement(&mut self) -> Result<Reading, ChipError<Self::BusError>>;

    /// Compares the configuration registers with the values written by [`init`](Self::init).
    ///
    /// # Errors
    ///
    /// Bus error, or `Configuration`, after which `init` restores the registers.
    async fn verify_configuration(&mut self) -> Result<(), ChipError<Self::BusError>>;

    /// Number of equal consecutive readings of an axis that indicates a stuck axis: more than noise produces in a day
    /// at rest.
    fn equal_readings_until_stuck(&self) -> u16;

    /// Measurement period, microseconds, as configured by [`init`](Self::init).
    fn period_us(&self) -> u32;
}
