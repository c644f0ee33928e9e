//! NOR flash with the rules of the STM32L4's: 2 KB pages, double words of 8 bytes that are programmed once after an
//! erase (their error-correcting code allows no second time), and power cuts.
//!
//! The unit of everything is an *operation*: one double word programmed or one page erased. A cut, or dropping the
//! future that waits for an operation, leaves that one operation torn and all before it done.

mod cells;

use std::cell::RefCell;
use std::rc::Rc;

use embassy_time::{Duration, Timer};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

use self::cells::{Cells, Operation};
use crate::random::{Purpose, Random};
use crate::simulation::Stop;

/// Bytes of a page, the unit of erasing.
pub const PAGE_BYTES: usize = 2048;
/// Bytes of a double word, the unit of programming.
pub const WORD_BYTES: usize = 8;
/// Time to program a double word (STM32L475 data sheet, typical 81.7 us).
const PROGRAM_TIME: Duration = Duration::from_micros(82);
/// Time to erase a page (typical 22.0 ms).
const ERASE_TIME: Duration = Duration::from_millis(22);

/// What an access can fail with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashError {
    /// Offset or length is not a multiple of the word or page.
    NotAligned,
    /// The range does not lie within the device.
    OutOfBounds,
    /// The double word at this offset has been programmed since its page was erased.
    NotErased {
        /// Offset of the double word.
        offset: u32,
    },
    /// The power is cut.
    PowerLost,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::NotAligned => NorFlashErrorKind::NotAligned,
            Self::OutOfBounds => NorFlashErrorKind::OutOfBounds,
            Self::NotErased { .. } | Self::PowerLost => NorFlashErrorKind::Other,
        }
    }
}

/// How far the operation got at which the power went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CutOutcome {
    /// It had not begun.
    NotBegun,
    /// It was under way.
    Torn,
    /// It was just finished, but nobody was told.
    Done,
}

impl CutOutcome {
    /// All of them, for exhaustive tests.
    pub const ALL: [Self; 3] = [Self::NotBegun, Self::Torn, Self::Done];
}

/// A power cut to come.
struct Cut {
    /// Operations that still succeed.
    operations_left: u32,
    outcome: CutOutcome,
    stop: Stop,
}

/// What has been done to the device since it was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wear {
    /// Pages erased, torn ones included.
    pub erases: u64,
    /// Double words programmed, torn ones included.
    pub writes: u64,
    /// Erases of the page that was erased most.
    pub worst_page_erases: u32,
}

struct Device {
    cells: Cells,
    random: Random,
    cut: Option<Cut>,
    powered: bool,
}

/// The device: a handle, cloned freely. What is stored lives as long as any handle.
#[derive(Clone)]
pub struct Flash(Rc<RefCell<Device>>);

impl Flash {
    /// An erased device of so many pages; the seed decides what torn operations leave behind.
    #[must_use]
    pub fn new(pages: usize, seed: u64) -> Self {
        Self(Rc::new(RefCell::new(Device {
            cells: Cells::erased(pages),
            random: Random::new(seed, Purpose::Flash),
            cut: None,
            powered: true,
        })))
    }

    /// Fault: lets `operations` more operations succeed, then cuts the power at the next one and ends the run through
    /// `stop`. Until [`power_on`](Self::power_on), everything else fails.
    pub fn cut_power_after(&self, operations: u32, outcome: CutOutcome, stop: Stop) {
        self.0.borrow_mut().cut = Some(Cut { operations_left: operations, outcome, stop });
    }

    /// Power is back; a cut that has not struck is called off.
    pub fn power_on(&self) {
        let mut device = self.0.borrow_mut();
        device.powered = true;
        device.cut = None;
    }

    /// Whether a cut has not struck.
    #[must_use]
    pub fn is_powered(&self) -> bool {
        self.0.borrow().powered
    }

    /// What has been done to the device so far.
    #[must_use]
    pub fn wear(&self) -> Wear {
        self.0.borrow().cells.wear()
    }

    /// A copy of all bytes.
    #[must_use]
    pub fn contents(&self) -> Vec<u8> {
        self.0.borrow().cells.bytes().to_vec()
    }

    /// Stores what [`contents`](Self::contents) gave. False, and nothing stored, when it was a device of another size.
    #[must_use]
    pub fn restore(&self, contents: &[u8]) -> bool {
        self.0.borrow_mut().cells.restore(contents)
    }

    /// Fault: inverts bits of one byte, as radiation or age would.
    ///
    /// # Panics
    ///
    /// When `offset` lies outside of the device.
    pub fn flip_bits(&self, offset: usize, mask: u8) {
        self.0.borrow_mut().cells.flip_bits(offset, mask);
    }

    /// Performs one operation in its time.
    async fn perform(&self, operation: Operation, duration: Duration) -> Result<(), FlashError> {
        self.0.borrow_mut().before(operation)?;
        let mut unfinished = Unfinished { flash: self, operation, finished: false };
        Timer::after(duration).await;
        unfinished.finished = true;
        self.0.borrow_mut().cells.perform(operation);
        Ok(())
    }
}

/// Tears the operation if the task is dropped while it waits for it.
struct Unfinished<'a> {
    flash: &'a Flash,
    operation: Operation,
    finished: bool,
}

impl Drop for Unfinished<'_> {
    fn drop(&mut self) {
        if !self.finished {
            self.flash.0.borrow_mut().tear(self.operation);
        }
    }
}

impl Device {
    /// Checks the rules, and whether this is where the power goes.
    fn before(&mut self, operation: Operation) -> Result<(), FlashError> {
        if !self.powered {
            return Err(FlashError::PowerLost);
        }
        self.cells.check(operation)?;
        match &mut self.cut {
            Some(cut) if cut.operations_left == 0 => {
                cut.stop.request();
                let outcome = cut.outcome;
                self.powered = false;
                match outcome {
                    CutOutcome::NotBegun => {}
                    CutOutcome::Torn => self.tear(operation),
                    CutOutcome::Done => self.cells.perform(operation),
                }
                Err(FlashError::PowerLost)
            }
            Some(cut) => {
                cut.operations_left -= 1;
                Ok(())
            }
            None => Ok(()),
        }
    }

    fn tear(&mut self, operation: Operation) {
        self.cells.tear(operation, &mut self.random);
    }

    fn check_range(&self, start: u32, end: u32, unit: usize) -> Result<(), FlashError> {
        if start > end || end as usize > self.cells.bytes().len() {
            return Err(FlashError::OutOfBounds);
        }
        if !(start as usize).is_multiple_of(unit) || !(end as usize).is_multiple_of(unit) {
            return Err(FlashError::NotAligned);
        }
        Ok(())
    }
}

impl ErrorType for Flash {
    type Error = FlashError;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        let device = self.0.borrow();
        if !device.powered {
            return Err(FlashError::PowerLost);
        }
        device.check_range(offset, end(offset, bytes.len())?, Self::READ_SIZE)?;
        let start = offset as usize;
        bytes.copy_from_slice(&device.cells.bytes()[start..start + bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.borrow().cells.bytes().len()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = PAGE_BYTES;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        self.0.borrow().check_range(from, to, PAGE_BYTES)?;
        for page in from as usize / PAGE_BYTES..to as usize / PAGE_BYTES {
            self.perform(Operation::Erase { page }, ERASE_TIME).await?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        self.0.borrow().check_range(offset, end(offset, bytes.len())?, WORD_BYTES)?;
        let (words, _) = bytes.as_chunks::<WORD_BYTES>();
        for (word, &value) in (offset as usize / WORD_BYTES..).zip(words) {
            self.perform(Operation::Program { word, value }, PROGRAM_TIME).await?;
        }
        Ok(())
    }
}

fn end(offset: u32, length: usize) -> Result<u32, FlashError> {
    u32::try_from(length).ok().and_then(|length| offset.checked_add(length)).ok_or(FlashError::OutOfBounds)
}

#[cfg(test)]
mod tests;
