//! Receive errors of the module's UART.

use embedded_io_async::{Error, ErrorKind};

/// Receive error of the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UartError {
    /// Bytes were lost because the receive buffer was full.
    Overrun,
    /// A stop bit was missing.
    Framing,
    /// Noise error: the receiver's samples of one bit disagreed.
    Noise,
}

impl std::fmt::Display for UartError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Overrun => "receive buffer overrun",
            Self::Framing => "framing error",
            Self::Noise => "noise on the line",
        })
    }
}

impl std::error::Error for UartError {}

impl Error for UartError {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}
