//! Interface of the drivers.

use core::fmt;

use super::error::ChipError;

/// Chip that measures continuously, with its own configuration.
///
/// Call [`init`](Self::init) first and after any error, then [`read_measurement`](Self::read_measurement) for each
/// measurement. Drivers wait with `embassy_time`, hence also in virtual time on the host.
#[expect(async_fn_in_trait, reason = "used through generics by tasks of one executor; no caller needs Send bounds")]
pub trait MeasuringChip {
    /// Error of the bus.
    type BusError: fmt::Debug;
    /// Identity of a chip after its start.
    type Identity;
    /// Result of a measurement.
    type Measurement;

    /// Checks the identity, sets ranges and rate, tests the chip as far as it can, starts continuous measurement.
    ///
    /// # Errors
    ///
    /// Bus error, unexpected identity, a failed self-test, or a register that does not hold its value.
    async fn init(&mut self) -> Result<Self::Identity, ChipError<Self::BusError>>;

    /// Waits for the next measurement and reads it.
    ///
    /// # Errors
    ///
    /// Bus error, or `NoData` after four periods.
    async fn read_measurement(&mut self) -> Result<Self::Measurement, ChipError<Self::BusError>>;

    /// Compares the configuration registers with the values written by [`init`](Self::init).
    ///
    /// # Errors
    ///
    /// Bus error, or `Configuration`, after which `init` restores the registers.
    async fn verify_configuration(&mut self) -> Result<(), ChipError<Self::BusError>>;

    /// Measurement period, microseconds, as configured by [`init`](Self::init).
    fn period_us(&self) -> u32;
}
