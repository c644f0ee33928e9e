//! Errors of chips.

/// Error of a chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChipError<E> {
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
