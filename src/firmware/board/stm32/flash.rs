//! Flash of the store, in bank 2 of the internal flash.
//!
//! A program in bank 1 runs meanwhile: an erase (22 ms) is awaited, a write (90 us per double word) blocks only the
//! thread executor. Code in bank 2, if a board has it there, waits for the end of the erase or write.

use core::ops::Range;

use embassy_stm32::flash::{Async, Flash};
use embassy_stm32::pac;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

/// Start address of the flash.
const FLASH_BASE: u32 = embassy_stm32::flash::FLASH_BASE as u32;
/// Size of each of the two banks of the flash, bytes.
const BANK_SIZE: u32 = embassy_stm32::flash::FLASH_SIZE as u32 / 2;

unsafe extern "C" {
    // Bounds of region STORE in memory.x; only the addresses are meaningful.
    static __store_start: u8;
    static __store_end: u8;
}

/// Flash error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashError {
    /// The address is outside the store's pages, or unaligned.
    Bounds,
    /// The hardware reported an error.
    Hardware(embassy_stm32::flash::Error),
    /// The bytes read back differ from the data.
    Verify,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Bounds => NorFlashErrorKind::OutOfBounds,
            Self::Hardware(_) | Self::Verify => NorFlashErrorKind::Other,
        }
    }
}

/// Pages of the store, with offsets relative to the first, so that the program cannot be overwritten.
pub struct StoreFlash {
    flash: Flash<'static, Async>,
    /// Range of the store's pages, bytes from the start of the flash.
    page_range: Range<u32>,
}

impl StoreFlash {
    /// The pages reserved in memory.x.
    pub fn new(flash: Flash<'static, Async>) -> Self {
        Self { flash, page_range: Self::reserved_pages() }
    }

    fn reserved_pages() -> Range<u32> {
        let start = (&raw const __store_start).addr() as u32 - FLASH_BASE;
        let end = (&raw const __store_end).addr() as u32 - FLASH_BASE;
        start..end
    }

    /// All pages, as offsets.
    pub fn store_region(&self) -> Range<u32> {
        0..self.page_range.end - self.page_range.start
    }

    /// Converts an offset in the store to one in the flash and checks the range.
    fn flash_offset(&self, offset: u32, size: usize) -> Result<u32, FlashError> {
        let available_bytes = self.store_region().end.checked_sub(offset).ok_or(FlashError::Bounds)?;
        if size as u64 > u64::from(available_bytes) {
            Err(FlashError::Bounds)
        } else {
            Ok(self.page_range.start + offset)
        }
    }

    /// Volatile read, because the compiler does not know of flash writes.
    fn read_byte(offset: u32) -> u8 {
        let address = (FLASH_BASE + offset) as *const u8;
        // SAFETY: callers checked that the offset is within the store, which is readable flash.
        unsafe { address.read_volatile() }
    }
}

impl ErrorType for StoreFlash {
    type Error = FlashError;
}

impl ReadNorFlash for StoreFlash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        let start = self.flash_offset(offset, bytes.len())?;
        for (offset, byte) in (start..).zip(bytes) {
            *byte = Self::read_byte(offset);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.page_range.len()
    }
}

impl NorFlash for StoreFlash {
    const WRITE_SIZE: usize = embassy_stm32::flash::WRITE_SIZE;
    const ERASE_SIZE: usize = embassy_stm32::flash::MAX_ERASE_SIZE;

    /// Erases pages and reads them back, because the HAL clears the hardware's error flags before checking them.
    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let size = to.checked_sub(from).ok_or(FlashError::Bounds)?;
        let start = self.flash_offset(from, size as usize)?;
        let cache = DataCacheOff::new();
        self.flash.erase(start, start + size).await.map_err(FlashError::Hardware)?;
        drop(cache);
        if (start..start + size).all(|offset| Self::read_byte(offset) == 0xFF) {
            Ok(())
        } else {
            Err(FlashError::Verify)
        }
    }

    /// Writes double words and reads them back. Blocking, because only the HAL's blocking writes report errors.
    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let start = self.flash_offset(offset, bytes.len())?;
        let cache = DataCacheOff::new();
        self.flash.blocking_write(start, bytes).map_err(FlashError::Hardware)?;
        drop(cache);
        let same = (start..).zip(bytes).all(|(offset, &byte)| Self::read_byte(offset) == byte);
        if same { Ok(()) } else { Err(FlashError::Verify) }
    }
}

/// Guard that disables the data cache and invalidates it at the end.
///
/// Errata of STM32L47x and STM32G47x, "Data cache might be corrupted during Flash memory read-while-write operation":
/// bank 1 must not be read through the data cache while bank 2 is written.
struct DataCacheOff;

impl DataCacheOff {
    fn new() -> Self {
        pac::FLASH.acr().modify(|acr| acr.set_dcen(false));
        Self
    }
}

impl Drop for DataCacheOff {
    fn drop(&mut self) {
        // Invalidate stale contents; a reset is only allowed while the cache is disabled.
        pac::FLASH.acr().modify(|acr| acr.set_dcrst(true));
        pac::FLASH.acr().modify(|acr| acr.set_dcrst(false));
        pac::FLASH.acr().modify(|acr| acr.set_dcen(true));
    }
}

/// ECC error on reading a double word whose programming was interrupted by a power failure. In the store the read
/// continues, and the store's CRC rejects the data; in the program it panics.
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    let eccr = pac::FLASH.eccr().read();
    // The address is an offset in the bank that `bk_ecc` selects.
    let offset = eccr.addr_ecc() % BANK_SIZE + if eccr.bk_ecc() { BANK_SIZE } else { 0 };
    assert!(eccr.eccd() && StoreFlash::reserved_pages().contains(&offset), "NMI, ECCR {:08x}", eccr.0);
    // Writing one clears the flag.
    pac::FLASH.eccr().modify(|eccr| eccr.set_eccd(true));
}
