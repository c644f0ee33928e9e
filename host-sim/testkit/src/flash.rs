//! A NOR flash in memory that keeps the rules of the STM32L4's, with power cuts and every fault that a store must
//! survive. It takes no time, so that thousands of saves can be tried.

use std::ops::Range;

use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

use crate::random::Random;

/// Bytes of a double word, the unit of programming.
const WORD: usize = 8;

/// What has become of the operation during which power failed.
#[derive(Clone, Copy, Debug)]
pub enum Cut {
    /// It had not begun.
    Before,
    /// A random part of its bits has changed.
    Torn,
    /// It was finished.
    After,
}

impl Cut {
    /// How an operation can end when power fails: not at all, in part (with the seed of what changes), in full.
    pub const ALL: [(Self, u64); 4] = [(Self::Before, 0), (Self::Torn, 1), (Self::Torn, 2), (Self::After, 0)];

    /// Where and how power fails in so many operations: in each way at every operation near the ends, where headers and
    /// markers are written, and at every seventh of the many words between, which are all alike.
    pub fn in_operations(operations: usize) -> impl Iterator<Item = (usize, (Self, u64))> {
        let near_an_end = move |at: &usize| *at < 4 || *at + 4 >= operations || at.is_multiple_of(7);
        (0..operations).filter(near_an_end).flat_map(|at| Self::ALL.map(|cut| (at, cut)))
    }
}

/// How a flash programs without saying that it fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lie {
    /// It does nothing.
    Ignores,
    /// It changes other bits than it should.
    Alters,
}

/// Why an access failed.
#[derive(Debug, PartialEq, Eq)]
pub enum Fault {
    /// The word has been programmed since its page was erased.
    NotErased,
    /// The power is cut.
    NoPower,
    /// These bytes cannot be read.
    Unreadable,
}

impl NorFlashError for Fault {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

/// A flash with pages of so many bytes. It programs erased double words only, erases pages, and counts both as
/// operations. It refuses a second program even with zeros, which the STM32L4 allows: a word that a failure has torn is
/// as stubborn there when its error correction fails.
#[derive(Clone)]
pub struct RamFlash<const PAGE: usize> {
    /// What is stored.
    pub bytes: Vec<u8>,
    /// Double words programmed and pages erased since power came.
    pub operations: usize,
    /// Reads that touch these bytes fail, so many of them.
    pub unreadable: Option<(Range<usize>, usize)>,
    /// How it programs, if not truly.
    pub lie: Option<Lie>,
    cut: Option<(usize, Cut)>,
    noise: Random,
}

impl<const PAGE: usize> RamFlash<PAGE> {
    /// An erased flash of so many pages.
    #[must_use]
    pub fn new(pages: usize) -> Self {
        let bytes = vec![0xFF; PAGE * pages];
        Self { bytes, operations: 0, unreadable: None, lie: None, cut: None, noise: Random(1) }
    }

    /// A copy whose power fails at an operation from now, counted from 0.
    #[must_use]
    pub fn cut_at(&self, operation: usize, (cut, seed): (Cut, u64)) -> Self {
        Self { operations: 0, cut: Some((operation, cut)), noise: Random(seed), ..self.clone() }
    }

    /// A copy with power and without faults.
    #[must_use]
    pub fn power_on(&self) -> Self {
        Self { operations: 0, cut: None, unreadable: None, lie: None, ..self.clone() }
    }

    /// Changes the bytes from `start` on to `target`, unless power fails now.
    fn operate(&mut self, start: usize, target: &[u8]) -> Result<(), Fault> {
        let cut = match self.cut {
            Some((at, _)) if self.operations > at => return Err(Fault::NoPower),
            Some((at, cut)) if self.operations == at => Some(cut),
            _ => None,
        };
        self.operations += 1;
        for (byte, &target) in self.bytes[start..].iter_mut().zip(target) {
            let changed = match cut {
                None | Some(Cut::After) => 0xFF,
                Some(Cut::Before) => 0,
                Some(Cut::Torn) => self.noise.byte(),
            };
            *byte = (*byte & !changed) | (target & changed);
        }
        if cut.is_some() { Err(Fault::NoPower) } else { Ok(()) }
    }
}

impl<const PAGE: usize> ErrorType for RamFlash<PAGE> {
    type Error = Fault;
}

impl<const PAGE: usize> ReadNorFlash for RamFlash<PAGE> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Fault> {
        let range = offset as usize..offset as usize + bytes.len();
        if let Some((bad, times)) = &mut self.unreadable
            && *times > 0
            && range.start < bad.end
            && bad.start < range.end
        {
            *times -= 1;
            return Err(Fault::Unreadable);
        }
        bytes.copy_from_slice(&self.bytes[range]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl<const PAGE: usize> NorFlash for RamFlash<PAGE> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Fault> {
        if self.lie == Some(Lie::Ignores) {
            return Ok(());
        }
        (from as usize..to as usize).step_by(PAGE).try_for_each(|page| self.operate(page, &[0xFF; PAGE]))
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Fault> {
        for (start, word) in (offset as usize..).step_by(WORD).zip(bytes.chunks_exact(WORD)) {
            if self.bytes[start..start + WORD] != [0xFF; WORD] {
                return Err(Fault::NotErased);
            }
            match self.lie {
                None => self.operate(start, word)?,
                Some(Lie::Ignores) => {}
                Some(Lie::Alters) => {
                    let altered: Vec<u8> = word.iter().map(|byte| byte & !0x10).collect();
                    self.operate(start, &altered)?;
                }
            }
        }
        Ok(())
    }
}
