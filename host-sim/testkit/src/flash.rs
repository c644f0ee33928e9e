//! NOR flash in memory with the rules of the STM32L4, power cuts and read/write faults. Operations take no time, so
//! tests can run thousands of saves.

use std::future::pending;
use std::ops::Range;

use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

use crate::random::Random;

const WORD_BYTES: usize = 8;

/// Progress of the operation that a power cut interrupts.
#[derive(Clone, Copy, Debug)]
pub enum CutProgress {
    /// The operation is not started.
    Before,
    /// A random part of the bits has changed.
    Torn,
    /// The operation is complete.
    After,
}

impl CutProgress {
    /// Power cuts for exhaustive tests, with the seed of the changed bits.
    pub const ALL: [(Self, u64); 4] = [(Self::Before, 0), (Self::Torn, 1), (Self::Torn, 2), (Self::After, 0)];

    /// All power cuts at the first and last four operations (headers and markers) and at every seventh between them.
    pub fn cuts_at_sampled_operations(operations: usize) -> impl Iterator<Item = (usize, (Self, u64))> {
        let near_an_end =
            move |operation: &usize| *operation < 4 || *operation + 4 >= operations || operation.is_multiple_of(7);
        (0..operations).filter(near_an_end).flat_map(|operation| Self::ALL.map(|cut| (operation, cut)))
    }
}

/// Programming fault that the flash does not report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SilentFault {
    /// Programming and erasing have no effect.
    WritesIgnored,
    /// Programming changes wrong bits.
    WritesAltered,
    /// Programming and erasing never complete.
    WritesHang,
}

/// Reason why an access to the flash failed.
#[derive(Debug, PartialEq, Eq)]
pub enum FlashFault {
    /// The word was programmed since its page was erased.
    NotErased,
    /// The flash has no power.
    NoPower,
    /// These bytes are unreadable.
    Unreadable,
}

impl NorFlashError for FlashFault {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

/// Flash with pages of `PAGE_BYTES` bytes. An operation programs one erased double word or erases one page. Unlike the
/// STM32L4 it rejects zeros over a programmed word, as an incomplete word with an invalid code would.
#[derive(Clone)]
pub struct RamFlash<const PAGE_BYTES: usize> {
    /// Memory contents.
    pub bytes: Vec<u8>,
    /// Programmed double words and erased pages since power-on.
    pub operation_count: usize,
    /// Byte range and number of reads that fail there.
    pub unreadable: Option<(Range<usize>, usize)>,
    /// Programming fault, if any.
    pub silent_fault: Option<SilentFault>,
    cut: Option<(usize, CutProgress)>,
    noise: Random,
}

impl<const PAGE_BYTES: usize> RamFlash<PAGE_BYTES> {
    /// An erased flash with `pages` pages.
    #[must_use]
    pub fn new(pages: usize) -> Self {
        let bytes = vec![0xFF; PAGE_BYTES * pages];
        Self { bytes, operation_count: 0, unreadable: None, silent_fault: None, cut: None, noise: Random(1) }
    }

    /// A copy whose power fails at an operation counted from 0.
    #[must_use]
    pub fn cut_at(&self, operation: usize, (cut, seed): (CutProgress, u64)) -> Self {
        Self { operation_count: 0, cut: Some((operation, cut)), noise: Random(seed), ..self.clone() }
    }

    /// A copy with power and without faults.
    #[must_use]
    pub fn power_on(&self) -> Self {
        Self { operation_count: 0, cut: None, unreadable: None, silent_fault: None, ..self.clone() }
    }

    /// Writes `target` at `start`, unless the power fails.
    fn write_cells(&mut self, start: usize, target: &[u8]) -> Result<(), FlashFault> {
        let cut = match self.cut {
            Some((at, _)) if self.operation_count > at => return Err(FlashFault::NoPower),
            Some((at, cut)) if self.operation_count == at => Some(cut),
            _ => None,
        };
        self.operation_count += 1;
        for (byte, &target) in self.bytes[start..].iter_mut().zip(target) {
            let changed = match cut {
                None | Some(CutProgress::After) => 0xFF,
                Some(CutProgress::Before) => 0,
                Some(CutProgress::Torn) => self.noise.byte(),
            };
            *byte = (*byte & !changed) | (target & changed);
        }
        if cut.is_some() { Err(FlashFault::NoPower) } else { Ok(()) }
    }
}

impl<const PAGE_BYTES: usize> ErrorType for RamFlash<PAGE_BYTES> {
    type Error = FlashFault;
}

impl<const PAGE_BYTES: usize> ReadNorFlash for RamFlash<PAGE_BYTES> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashFault> {
        let range = offset as usize..offset as usize + bytes.len();
        if let Some((bad_range, remaining_failures)) = &mut self.unreadable
            && *remaining_failures > 0
            && range.start < bad_range.end
            && bad_range.start < range.end
        {
            *remaining_failures -= 1;
            return Err(FlashFault::Unreadable);
        }
        bytes.copy_from_slice(&self.bytes[range]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl<const PAGE_BYTES: usize> NorFlash for RamFlash<PAGE_BYTES> {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = PAGE_BYTES;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashFault> {
        match self.silent_fault {
            Some(SilentFault::WritesIgnored) => return Ok(()),
            Some(SilentFault::WritesHang) => pending().await,
            Some(SilentFault::WritesAltered) | None => {}
        }
        (from as usize..to as usize)
            .step_by(PAGE_BYTES)
            .try_for_each(|page| self.write_cells(page, &[0xFF; PAGE_BYTES]))
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashFault> {
        for (start, word) in (offset as usize..).step_by(WORD_BYTES).zip(bytes.chunks_exact(WORD_BYTES)) {
            if self.bytes[start..start + WORD_BYTES] != [0xFF; WORD_BYTES] {
                return Err(FlashFault::NotErased);
            }
            match self.silent_fault {
                None => self.write_cells(start, word)?,
                Some(SilentFault::WritesIgnored) => {}
                Some(SilentFault::WritesHang) => pending().await,
                Some(SilentFault::WritesAltered) => {
                    let altered: Vec<u8> = word.iter().map(|byte| byte & !0x10).collect();
                    self.write_cells(start, &altered)?;
                }
            }
        }
        Ok(())
    }
}
