//! NOR flash of the STM32L4: 2 KB pages; 8-byte double words that are programmed once per erase because of their
//! error-correcting code; power cuts.
//!
//! An *operation* programs one double word or erases one page. A power cut, or dropping the future of an operation,
//! leaves this operation incomplete and all earlier ones complete.

mod error;
mod flash_cells;

use std::cell::RefCell;
use std::rc::Rc;

use embassy_time::{Duration, Timer};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use testkit::simulation::Stop;

pub use self::error::SimulatedFlashError;
use self::flash_cells::{FlashCells, FlashOperation};
pub use self::flash_cells::{PAGE_BYTES, WORD_BYTES, WearCounters};
use crate::random::{RandomStream, StreamPurpose};

/// Time to program a double word (STM32L475 data sheet, typical 81.7 us).
const WORD_PROGRAM_TIME: Duration = Duration::from_micros(82);
/// Time to erase a page (STM32L475 data sheet, typical 22.0 ms).
const PAGE_ERASE_TIME: Duration = Duration::from_millis(22);

/// Progress of the operation that the power cut interrupts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CutOutcome {
    /// The operation is not started.
    NotBegun,
    /// Some bits of the word or page are programmed or erased.
    Torn,
    /// The operation is complete, but reported as failed.
    Done,
}

impl CutOutcome {
    /// All outcomes, for exhaustive tests.
    pub const ALL_OUTCOMES: [Self; 3] = [Self::NotBegun, Self::Torn, Self::Done];
}

struct ScheduledPowerCut {
    /// Number of operations that succeed before the power cut.
    operations_left: u32,
    outcome: CutOutcome,
    stop: Stop,
}

struct FlashDevice {
    cells: FlashCells,
    random: RandomStream,
    scheduled_cut: Option<ScheduledPowerCut>,
    is_power_on: bool,
}

/// Cloneable handle to the flash device.
#[derive(Clone)]
pub struct SimulatedFlash(Rc<RefCell<FlashDevice>>);

impl SimulatedFlash {
    /// An erased device with `pages` pages; the seed determines the effects of interrupted operations.
    #[must_use]
    pub fn new(pages: usize, seed: u64) -> Self {
        Self(Rc::new(RefCell::new(FlashDevice {
            cells: FlashCells::new_erased(pages),
            random: RandomStream::new(seed, StreamPurpose::Flash),
            scheduled_cut: None,
            is_power_on: true,
        })))
    }

    /// Fault: after `operations` more operations, the next one is interrupted by a power cut, which also ends the run
    /// through `stop`. Accesses fail until [`power_on`](Self::power_on).
    pub fn cut_power_after(&self, operations: u32, outcome: CutOutcome, stop: Stop) {
        self.0.borrow_mut().scheduled_cut = Some(ScheduledPowerCut { operations_left: operations, outcome, stop });
    }

    /// Restores power and cancels a scheduled cut.
    pub fn power_on(&self) {
        let mut device = self.0.borrow_mut();
        device.is_power_on = true;
        device.scheduled_cut = None;
    }

    /// Whether the device has power.
    #[must_use]
    pub fn is_powered(&self) -> bool {
        self.0.borrow().is_power_on
    }

    /// Wear counters since creation.
    #[must_use]
    pub fn wear_counters(&self) -> WearCounters {
        self.0.borrow().cells.wear_counters()
    }

    /// A copy of all bytes.
    #[must_use]
    pub fn flash_contents(&self) -> Vec<u8> {
        self.0.borrow().cells.bytes().to_vec()
    }

    /// Restores a copy from [`flash_contents`](Self::flash_contents). False without effect if the size differs.
    #[must_use]
    pub fn restore_contents(&self, contents: &[u8]) -> bool {
        self.0.borrow_mut().cells.restore_contents(contents)
    }

    /// Fault: inverts bits of one byte, as radiation or ageing does.
    ///
    /// # Panics
    ///
    /// If `offset` is outside the device.
    pub fn flip_bits(&self, offset: usize, mask: u8) {
        self.0.borrow_mut().cells.flip_bits(offset, mask);
    }

    async fn perform_operation(
        &self,
        operation: FlashOperation,
        duration: Duration,
    ) -> Result<(), SimulatedFlashError> {
        self.0.borrow_mut().begin_operation(operation)?;
        let mut guard = OperationGuard { flash: self, operation, is_finished: false };
        Timer::after(duration).await;
        guard.is_finished = true;
        self.0.borrow_mut().cells.perform_operation(operation);
        Ok(())
    }
}

/// Guard that leaves the operation incomplete when its future is dropped.
struct OperationGuard<'a> {
    flash: &'a SimulatedFlash,
    operation: FlashOperation,
    is_finished: bool,
}

impl Drop for OperationGuard<'_> {
    fn drop(&mut self) {
        if !self.is_finished {
            self.flash.0.borrow_mut().interrupt_operation(self.operation);
        }
    }
}

impl FlashDevice {
    /// Checks power and rules, and applies a scheduled power cut.
    fn begin_operation(&mut self, operation: FlashOperation) -> Result<(), SimulatedFlashError> {
        if !self.is_power_on {
            return Err(SimulatedFlashError::PowerLost);
        }
        self.cells.check_operation(operation)?;
        match &mut self.scheduled_cut {
            Some(scheduled_cut) if scheduled_cut.operations_left == 0 => {
                scheduled_cut.stop.request();
                let outcome = scheduled_cut.outcome;
                self.is_power_on = false;
                match outcome {
                    CutOutcome::NotBegun => {}
                    CutOutcome::Torn => self.interrupt_operation(operation),
                    CutOutcome::Done => self.cells.perform_operation(operation),
                }
                Err(SimulatedFlashError::PowerLost)
            }
            Some(scheduled_cut) => {
                scheduled_cut.operations_left -= 1;
                Ok(())
            }
            None => Ok(()),
        }
    }

    fn interrupt_operation(&mut self, operation: FlashOperation) {
        self.cells.apply_partially(operation, &mut self.random);
    }

    fn check_range(&self, start: u32, end: u32, unit: usize) -> Result<(), SimulatedFlashError> {
        if start > end || end as usize > self.cells.bytes().len() {
            return Err(SimulatedFlashError::OutOfBounds);
        }
        if !(start as usize).is_multiple_of(unit) || !(end as usize).is_multiple_of(unit) {
            return Err(SimulatedFlashError::NotAligned);
        }
        Ok(())
    }
}

impl ErrorType for SimulatedFlash {
    type Error = SimulatedFlashError;
}

impl ReadNorFlash for SimulatedFlash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), SimulatedFlashError> {
        let device = self.0.borrow();
        if !device.is_power_on {
            return Err(SimulatedFlashError::PowerLost);
        }
        device.check_range(offset, range_end(offset, bytes.len())?, Self::READ_SIZE)?;
        let start = offset as usize;
        bytes.copy_from_slice(&device.cells.bytes()[start..start + bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.borrow().cells.bytes().len()
    }
}

impl NorFlash for SimulatedFlash {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = PAGE_BYTES;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), SimulatedFlashError> {
        self.0.borrow().check_range(from, to, PAGE_BYTES)?;
        for page_index in from as usize / PAGE_BYTES..to as usize / PAGE_BYTES {
            self.perform_operation(FlashOperation::Erase { page_index }, PAGE_ERASE_TIME).await?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), SimulatedFlashError> {
        self.0.borrow().check_range(offset, range_end(offset, bytes.len())?, WORD_BYTES)?;
        let (words, _) = bytes.as_chunks::<WORD_BYTES>();
        for (word_index, &value) in (offset as usize / WORD_BYTES..).zip(words) {
            self.perform_operation(FlashOperation::Program { word_index, value }, WORD_PROGRAM_TIME).await?;
        }
        Ok(())
    }
}

fn range_end(offset: u32, length: usize) -> Result<u32, SimulatedFlashError> {
    u32::try_from(length).ok().and_then(|length| offset.checked_add(length)).ok_or(SimulatedFlashError::OutOfBounds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use testkit::clock;
    use testkit::simulation::{ExecutorLevel, RunEnd, Simulation};

    const OLD_WORD: [u8; 8] = *b"old word";

    fn run_access<T: 'static>(simulation: &mut Simulation, access: impl Future<Output = T> + 'static) -> Option<T> {
        let result = Rc::new(RefCell::new(None));
        let slot = Rc::clone(&result);
        simulation.spawn(ExecutorLevel::Thread, "access", async move {
            let value = access.await;
            *slot.borrow_mut() = Some(value);
        });
        simulation.run_for(10_000_000);
        result.take()
    }

    async fn write(mut flash: SimulatedFlash, offset: u32, bytes: Vec<u8>) -> Result<(), SimulatedFlashError> {
        flash.write(offset, &bytes).await
    }

    async fn erase(mut flash: SimulatedFlash, from: u32, to: u32) -> Result<(), SimulatedFlashError> {
        flash.erase(from, to).await
    }

    #[test]
    fn a_word_is_programmed_once_per_erase() {
        let mut simulation = Simulation::new();
        let flash = SimulatedFlash::new(2, 1);
        let mut program = |word: [u8; 8]| run_access(&mut simulation, write(flash.clone(), 8, word.to_vec())).unwrap();
        // Programming all ones writes the error-correcting code.
        assert_eq!(program([0xFF; 8]), Ok(()));
        assert_eq!(program(OLD_WORD), Err(SimulatedFlashError::NotErased { offset: 8 }));
        assert_eq!(run_access(&mut simulation, erase(flash.clone(), 0, 2048)), Some(Ok(())));
        assert_eq!(run_access(&mut simulation, write(flash.clone(), 8, OLD_WORD.to_vec())), Some(Ok(())));
        assert_eq!(flash.flash_contents()[8..16], OLD_WORD);
        assert_eq!(flash.wear_counters(), WearCounters { page_erases: 1, programmed_words: 2, worst_page_erases: 1 });
    }

    #[test]
    fn alignment_and_bounds_are_enforced() {
        let mut simulation = Simulation::new();
        let flash = SimulatedFlash::new(2, 1);
        let mut zeros =
            |offset, length| run_access(&mut simulation, write(flash.clone(), offset, vec![0; length])).unwrap();
        assert_eq!(zeros(4, 8), Err(SimulatedFlashError::NotAligned));
        assert_eq!(zeros(0, 12), Err(SimulatedFlashError::NotAligned));
        assert_eq!(zeros(4096, 8), Err(SimulatedFlashError::OutOfBounds));
        assert_eq!(zeros(u32::MAX - 7, 16), Err(SimulatedFlashError::OutOfBounds));
        let mut clear = |from, to| run_access(&mut simulation, erase(flash.clone(), from, to)).unwrap();
        assert_eq!(clear(0, 1024), Err(SimulatedFlashError::NotAligned));
        assert_eq!(clear(2048, 6144), Err(SimulatedFlashError::OutOfBounds));
        assert_eq!(clear(2048, 0), Err(SimulatedFlashError::OutOfBounds));
        assert_eq!(flash.wear_counters(), WearCounters::default());
    }

    /// STM32L475 data sheet: 81.7 us per double word, 22.0 ms per page.
    #[test]
    fn flash_operations_take_the_time_of_the_data_sheet() {
        let mut simulation = Simulation::new();
        let flash = SimulatedFlash::new(2, 1);
        let durations_us = run_access(&mut simulation, async move {
            let start_us = clock::now_us();
            write(flash.clone(), 0, vec![0; 24]).await.unwrap();
            let written_us = clock::now_us();
            erase(flash, 0, 4096).await.unwrap();
            (written_us - start_us, clock::now_us() - written_us)
        });
        assert_eq!(durations_us, Some((3 * 82, 2 * 22_000)));
    }

    #[test]
    fn a_power_cut_occurs_at_the_chosen_operation_and_ends_the_run() {
        for outcome in CutOutcome::ALL_OUTCOMES {
            let mut simulation = Simulation::new();
            let flash = SimulatedFlash::new(1, 7);
            flash.cut_power_after(1, outcome, simulation.stop_handle());
            let task = write(flash.clone(), 0, [OLD_WORD, OLD_WORD, OLD_WORD].concat());
            simulation.spawn(ExecutorLevel::Thread, "write", async move {
                assert_eq!(task.await, Err(SimulatedFlashError::PowerLost));
            });
            assert_eq!(simulation.run_for(1_000_000), RunEnd::Stopped);
            assert!(!flash.is_powered());
            assert_eq!(
                run_access(&mut simulation, erase(flash.clone(), 0, 2048)),
                Some(Err(SimulatedFlashError::PowerLost))
            );

            flash.power_on();
            let bytes = flash.flash_contents();
            assert_eq!(bytes[0..8], OLD_WORD, "what was done before the cut stays");
            assert_eq!(bytes[16..24], [0xFF; 8], "what would have come after it never happens");
            let interrupted_word: [u8; 8] = bytes[8..16].try_into().unwrap();
            match outcome {
                CutOutcome::NotBegun => assert_eq!(interrupted_word, [0xFF; 8]),
                CutOutcome::Done => assert_eq!(interrupted_word, OLD_WORD),
                CutOutcome::Torn => {
                    assert!(
                        interrupted_word != OLD_WORD && interrupted_word != [0xFF; 8],
                        "seed 7 leaves some bits fallen, some not"
                    );
                    let no_bit_is_cleared_wrongly =
                        interrupted_word.iter().zip(OLD_WORD).all(|(torn, old)| torn & old == old);
                    assert!(no_bit_is_cleared_wrongly, "a bit that should stay one was cleared");
                }
            }
            let rewritten = run_access(&mut simulation, write(flash.clone(), 8, OLD_WORD.to_vec())).unwrap();
            assert_eq!(rewritten.is_ok(), outcome == CutOutcome::NotBegun, "a touched word needs an erase");
        }
    }

    #[test]
    fn dropping_a_task_tears_its_pending_flash_operation() {
        let mut simulation = Simulation::new();
        let flash = SimulatedFlash::new(2, 3);
        assert_eq!(run_access(&mut simulation, write(flash.clone(), 0, OLD_WORD.repeat(256))), Some(Ok(())));
        let erasing = erase(flash.clone(), 0, 2048);
        simulation.spawn(ExecutorLevel::Thread, "erase", async move {
            erasing.await.unwrap();
        });
        simulation.run_for(10_000);
        simulation.power_off();

        let page = flash.flash_contents();
        let (words, _) = page[..2048].as_chunks::<8>();
        let unchanged_count = words.iter().filter(|&&word| word == OLD_WORD).count();
        let erased_count = words.iter().filter(|&&word| word == [0xFF; 8]).count();
        // Of 256 words a third keep their content and a third are erased, each within four standard deviations of 7.5.
        assert!((55..=116).contains(&unchanged_count), "{unchanged_count} words as before");
        assert!((55..=116).contains(&erased_count), "{erased_count} words erased");
        assert_eq!(run_access(&mut simulation, erase(flash.clone(), 0, 2048)), Some(Ok(())));
        assert_eq!(flash.flash_contents()[..2048], [0xFF; 2048], "erasing again mends the page");
    }
}
