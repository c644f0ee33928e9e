//! Errors of chips.

use core::fmt;

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

impl<E: fmt::Display> fmt::Display for ChipError<E> {
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

impl<E: fmt::Debug + fmt::Display> core::error::Error for ChipError<E> {}
