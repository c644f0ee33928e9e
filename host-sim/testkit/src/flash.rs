//! NOR flash in memory with the rules of the STM32L4, power cuts and read/write faults. Operations take no time, so
//! tests can run thousands of saves; the simulator's flash adds the times.

use std::future::pending;
use std::ops::Range;

use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

use crate::random::Random;

/// Size of a double word, bytes.
pub const WORD_BYTES: usize = 8;

const ERASED: u8 = 0xFF;

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
    /// Double words programmed since the last erase, also with all ones: that writes the error-correcting code.
    programmed_words: Vec<bool>,
    cut: Option<(usize, CutProgress)>,
    noise: Random,
}

impl<const PAGE_BYTES: usize> RamFlash<PAGE_BYTES> {
    /// An erased flash with `pages` pages.
    #[must_use]
    pub fn new(pages: usize) -> Self {
        let bytes = vec![ERASED; PAGE_BYTES * pages];
        let programmed_words = vec![false; bytes.len() / WORD_BYTES];
        let (unreadable, silent_fault, cut) = (None, None, None);
        Self { bytes, operation_count: 0, unreadable, silent_fault, programmed_words, cut, noise: Random(1) }
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

    /// Whether the power fails at the next operation, or has failed.
    #[must_use]
    pub fn is_cut_due(&self) -> bool {
        self.cut.is_some_and(|(at, _)| self.operation_count >= at)
    }

    /// Programs a double word.
    ///
    /// # Errors
    ///
    /// It is not erased, or the power fails.
    ///
    /// # Panics
    ///
    /// It is not one aligned double word.
    pub fn program_word(&mut self, start: usize, word: &[u8]) -> Result<(), FlashFault> {
        assert!(start.is_multiple_of(WORD_BYTES) && word.len() == WORD_BYTES, "{start} {}", word.len());
        if self.programmed_words[start / WORD_BYTES] || self.bytes[start..start + WORD_BYTES] != [ERASED; WORD_BYTES] {
            return Err(FlashFault::NotErased);
        }
        self.write_cells(start, word, true)
    }

    /// Erases a page.
    ///
    /// # Errors
    ///
    /// The power fails.
    ///
    /// # Panics
    ///
    /// `start` is not that of a page.
    pub fn erase_page(&mut self, start: usize) -> Result<(), FlashFault> {
        assert!(start.is_multiple_of(PAGE_BYTES), "{start}");
        self.write_cells(start, &[ERASED; PAGE_BYTES], false)
    }

    /// Writes `target` at `start`, unless the power fails.
    fn write_cells(&mut self, start: usize, target: &[u8], is_programming: bool) -> Result<(), FlashFault> {
        let cut = match self.cut {
            Some((at, _)) if self.operation_count > at => return Err(FlashFault::NoPower),
            Some((at, cut)) if self.operation_count == at => Some(cut),
            _ => None,
        };
        self.operation_count += 1;
        self.change_cells(start, target, is_programming, cut.unwrap_or(CutProgress::After));
        if cut.is_some() { Err(FlashFault::NoPower) } else { Ok(()) }
    }

    /// Leaves an operation incomplete: each double word as before, complete, or with a part of its bits changed.
    pub fn tear_operation(&mut self, start: usize, target: &[u8], is_programming: bool) {
        self.change_cells(start, target, is_programming, CutProgress::Torn);
    }

    fn change_cells(&mut self, start: usize, target: &[u8], is_programming: bool, progress: CutProgress) {
        const NONE: [u8; WORD_BYTES] = [0; WORD_BYTES];
        const ALL: [u8; WORD_BYTES] = [0xFF; WORD_BYTES];
        for (start, target) in (start..).step_by(WORD_BYTES).zip(target.chunks_exact(WORD_BYTES)) {
            let changed = match progress {
                CutProgress::Before => NONE,
                CutProgress::After => ALL,
                CutProgress::Torn => match self.noise.bits() % 3 {
                    0 => NONE,
                    1 => ALL,
                    _ => self.noise.bits().to_le_bytes(),
                },
            };
            for ((byte, target), changed) in self.bytes[start..start + WORD_BYTES].iter_mut().zip(target).zip(changed) {
                *byte = (*byte & !changed) | (target & changed);
            }
            let is_programmed = &mut self.programmed_words[start / WORD_BYTES];
            *is_programmed =
                if is_programming { *is_programmed || changed != NONE } else { *is_programmed && changed != ALL };
        }
    }
}

impl<const PAGE_BYTES: usize> ErrorType for RamFlash<PAGE_BYTES> {
    type Error = FlashFault;
}

impl<const PAGE_BYTES: usize> ReadNorFlash for RamFlash<PAGE_BYTES> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashFault> {
        let range = offset as usize..offset as usize + bytes.len();
        if self.cut.is_some_and(|(at, _)| self.operation_count > at) {
            return Err(FlashFault::NoPower);
        }
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
        (from as usize..to as usize).step_by(PAGE_BYTES).try_for_each(|page| self.erase_page(page))
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashFault> {
        for (start, word) in (offset as usize..).step_by(WORD_BYTES).zip(bytes.chunks(WORD_BYTES)) {
            match self.silent_fault {
                None => self.program_word(start, word)?,
                Some(SilentFault::WritesIgnored) => {}
                Some(SilentFault::WritesHang) => pending().await,
                Some(SilentFault::WritesAltered) => {
                    let altered: Vec<u8> = word.iter().map(|byte| byte & !0x10).collect();
                    self.program_word(start, &altered)?;
                }
            }
        }
        Ok(())
    }
}
