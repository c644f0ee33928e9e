//! Flash of the store, emulated in RAM that survives a reset, with the rules and timing of the reference board.

use core::ops::Range;

use embassy_time::{Duration, Timer};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

/// Page size of the STM32L4, bytes.
const PAGE_BYTES: usize = 2048;
/// Programmed unit of the STM32L4, bytes: a double word.
const WORD_BYTES: usize = 8;
/// Time to erase a page of the STM32L4.
const ERASE_TIME: Duration = Duration::from_millis(22);
/// Time to program a double word of the STM32L4.
const PROGRAM_TIME: Duration = Duration::from_micros(82);
const ERASED: u8 = 0xFF;

unsafe extern "C" {
    // Bounds of region STORE in memory.x; only the addresses are meaningful.
    static mut __store_start: u8;
    static __store_end: u8;
}

/// Flash error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashError {
    /// The address is outside the store's pages.
    Bounds,
    /// The address is not aligned to words or pages.
    Alignment,
    /// The word is not erased.
    NotErased,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Bounds => NorFlashErrorKind::OutOfBounds,
            Self::Alignment => NorFlashErrorKind::NotAligned,
            Self::NotErased => NorFlashErrorKind::Other,
        }
    }
}

/// Pages of the store.
pub struct StoreFlash(&'static mut [u8]);

impl StoreFlash {
    /// Creates the flash; may be called only once.
    pub fn new() -> Self {
        let start = &raw mut __store_start;
        let size = (&raw const __store_end).addr() - start.addr();
        // SAFETY: memory.x reserves this memory for the store, and this is called once.
        Self(unsafe { core::slice::from_raw_parts_mut(start, size) })
    }

    /// All pages, as offsets.
    pub fn store_region(&self) -> Range<u32> {
        0..self.0.len() as u32
    }

    fn bytes(&mut self, offset: u32, length: usize) -> Result<&mut [u8], FlashError> {
        let start = offset as usize;
        start.checked_add(length).and_then(|end| self.0.get_mut(start..end)).ok_or(FlashError::Bounds)
    }
}

impl ErrorType for StoreFlash {
    type Error = FlashError;
}

impl ReadNorFlash for StoreFlash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        bytes.copy_from_slice(self.bytes(offset, bytes.len())?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.len()
    }
}

impl NorFlash for StoreFlash {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = PAGE_BYTES;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        if !(from as usize).is_multiple_of(PAGE_BYTES) || !(to as usize).is_multiple_of(PAGE_BYTES) {
            return Err(FlashError::Alignment);
        }
        for page in self.bytes(from, to.saturating_sub(from) as usize)?.chunks_exact_mut(PAGE_BYTES) {
            Timer::after(ERASE_TIME).await;
            page.fill(ERASED);
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        if !(offset as usize).is_multiple_of(WORD_BYTES) || !bytes.len().is_multiple_of(WORD_BYTES) {
            return Err(FlashError::Alignment);
        }
        let words = self.bytes(offset, bytes.len())?.chunks_exact_mut(WORD_BYTES);
        for (word, new) in words.zip(bytes.chunks_exact(WORD_BYTES)) {
            Timer::after(PROGRAM_TIME).await;
            if word.iter().any(|&byte| byte != ERASED) {
                return Err(FlashError::NotErased);
            }
            word.copy_from_slice(new);
        }
        Ok(())
    }
}
