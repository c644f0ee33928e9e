//! Interface of the drivers, and their errors.

use core::fmt;

use autoswing::reading::{Identity, Reading};

/// Magnetometer error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MagnetometerError<E> {
    /// Bus error.
    Bus(E),
    /// Unexpected value of the identity register.
    WrongIdentity(u8),
    /// A register did not hold its value: power loss or a different chip.
    Configuration {
        /// Register value written.
        written: u8,
        /// Register value read back.
        read: u8,
    },
    /// The chip's built-in self-test failed; value of its result register.
    SelfTest(u8),
    /// No measurement within the timeout.
    NoData,
}

impl<E: fmt::Display> fmt::Display for MagnetometerError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus(error) => write!(f, "bus error: {error}"),
            Self::WrongIdentity(identity) => write!(f, "the identity register reads {identity:#04x}"),
            Self::Configuration { written, read } => {
                write!(f, "a register with {written:#04x} written reads {read:#04x}")
            }
            Self::SelfTest(result) => write!(f, "the self-test returned {result:#04x}"),
            Self::NoData => f.write_str("no measurement within the timeout"),
        }
    }
}

impl<E: fmt::Debug + fmt::Display> core::error::Error for MagnetometerError<E> {}

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
    async fn init(&mut self) -> Result<Identity, MagnetometerError<Self::BusError>>;

    /// Waits for the next measurement and reads it.
    ///
    /// # Errors
    ///
    /// Bus error, or `NoData` after four periods.
    async fn read_measurement(&mut self) -> Result<Reading, MagnetometerError<Self::BusError>>;

    /// Compares the configuration registers with the values written by [`init`](Self::init).
    ///
    /// # Errors
    ///
    /// Bus error, or `Configuration`, after which `init` restores the registers.
    async fn verify_configuration(&mut self) -> Result<(), MagnetometerError<Self::BusError>>;

    /// Number of equal consecutive readings of an axis that indicates a stuck axis: more than noise produces in a day
    /// at rest.
    fn equal_readings_until_stuck(&self) -> u16;

    /// Measurement period, microseconds, as configured by [`init`](Self::init).
    fn period_us(&self) -> u32;
}
