//! Errors of flash accesses.

use embedded_storage_async::nor_flash::{NorFlashError, NorFlashErrorKind};

/// Reason why an access to the flash failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimulatedFlashError {
    /// Offset or length is not a multiple of the word or page size.
    NotAligned,
    /// The range exceeds the device.
    OutOfBounds,
    /// The double word was programmed since its page was erased.
    NotErased {
        /// Offset of the double word.
        offset: u32,
    },
    /// The device has no power.
    PowerLost,
}

impl NorFlashError for SimulatedFlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::NotAligned => NorFlashErrorKind::NotAligned,
            Self::OutOfBounds => NorFlashErrorKind::OutOfBounds,
            Self::NotErased { .. } | Self::PowerLost => NorFlashErrorKind::Other,
        }
    }
}
