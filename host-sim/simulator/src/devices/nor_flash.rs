//! NOR flash of the STM32L4: the rules of [`RamFlash`], and the time that an operation takes. A power cut, or dropping
//! the future of an operation, leaves this operation incomplete and all earlier ones complete.

use std::cell::RefCell;
use std::rc::Rc;

use embassy_time::{Duration, Timer};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use testkit::flash::{CutProgress, FlashFault, RamFlash, WORD_BYTES};
use testkit::simulation::Stop;

/// Page size in bytes, the unit of erasing.
pub const PAGE_BYTES: usize = 2048;

/// Time to program a double word (STM32L475 data sheet, typical 81.7 us).
const WORD_PROGRAM_TIME: Duration = Duration::from_micros(82);
/// Time to erase a page (STM32L475 data sheet, typical 22.0 ms).
const PAGE_ERASE_TIME: Duration = Duration::from_millis(22);

struct FlashDevice {
    memory: RamFlash<PAGE_BYTES>,
    change_count: u64,
    /// Ends the run at a scheduled power cut.
    stop: Option<Stop>,
}

/// Cloneable handle to the flash device.
#[derive(Clone)]
pub struct SimulatedFlash(Rc<RefCell<FlashDevice>>);

/// Operation on one double word or page. Dropped before its end it is left incomplete.
struct PendingOperation<'a> {
    flash: &'a SimulatedFlash,
    start: usize,
    target: &'a [u8],
    is_programming: bool,
    is_finished: bool,
}

impl SimulatedFlash {
    /// An erased device with `pages` pages.
    #[must_use]
    pub fn new(pages: usize) -> Self {
        Self(Rc::new(RefCell::new(FlashDevice { memory: RamFlash::new(pages), change_count: 0, stop: None })))
    }

    /// Fault: after `operations` more operations, the next one is interrupted by a power cut, which also ends the run
    /// through `stop`. Accesses fail until [`power_on`](Self::power_on).
    pub fn cut_power_after(&self, operations: usize, cut: (CutProgress, u64), stop: Stop) {
        let device = &mut *self.0.borrow_mut();
        (device.memory, device.stop) = (device.memory.cut_at(operations, cut), Some(stop));
    }

    /// Restores power and cancels a scheduled cut.
    pub fn power_on(&self) {
        let device = &mut *self.0.borrow_mut();
        (device.memory, device.stop) = (device.memory.power_on(), None);
    }

    /// Number of operations since creation, including incomplete ones.
    #[must_use]
    pub fn change_count(&self) -> u64 {
        self.0.borrow().change_count
    }

    /// A copy of all bytes.
    #[must_use]
    pub fn flash_contents(&self) -> Vec<u8> {
        self.0.borrow().memory.bytes.clone()
    }

    /// Restores a copy from [`flash_contents`](Self::flash_contents). False without effect if the size differs.
    #[must_use]
    pub fn restore_contents(&self, contents: &[u8]) -> bool {
        let memory = &mut self.0.borrow_mut().memory;
        let is_of_this_size = contents.len() == memory.bytes.len();
        if is_of_this_size {
            *memory = RamFlash::new(contents.len() / PAGE_BYTES);
            memory.bytes.copy_from_slice(contents);
        }
        is_of_this_size
    }

    /// Waits for an operation's time, then performs it; at a power cut at once.
    async fn perform_operation(
        &self,
        start: usize,
        target: &[u8],
        is_programming: bool,
        duration: Duration,
    ) -> Result<(), FlashFault> {
        let mut operation = PendingOperation { flash: self, start, target, is_programming, is_finished: false };
        if !self.0.borrow().memory.is_cut_due() {
            Timer::after(duration).await;
        }
        operation.is_finished = true;
        let FlashDevice { memory, change_count, stop } = &mut *self.0.borrow_mut();
        if let Some(stop) = stop.as_ref().filter(|_| memory.is_cut_due()) {
            stop.request();
        }
        *change_count += 1;
        if is_programming { memory.program_word(start, target) } else { memory.erase_page(start) }
    }
}

impl Drop for PendingOperation<'_> {
    fn drop(&mut self) {
        if !self.is_finished {
            let device = &mut *self.flash.0.borrow_mut();
            device.change_count += 1;
            device.memory.tear_operation(self.start, self.target, self.is_programming);
        }
    }
}

impl ErrorType for SimulatedFlash {
    type Error = FlashFault;
}

impl ReadNorFlash for SimulatedFlash {
    const READ_SIZE: usize = 1;

    #[expect(clippy::await_holding_refcell_ref, reason = "a read of the memory never waits")]
    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashFault> {
        self.0.borrow_mut().memory.read(offset, bytes).await
    }

    fn capacity(&self) -> usize {
        self.0.borrow().memory.bytes.len()
    }
}

impl NorFlash for SimulatedFlash {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = PAGE_BYTES;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashFault> {
        for page in (from as usize..to as usize).step_by(PAGE_BYTES) {
            self.perform_operation(page, &[0xFF; PAGE_BYTES], false, PAGE_ERASE_TIME).await?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashFault> {
        for (start, word) in (offset as usize..).step_by(WORD_BYTES).zip(bytes.chunks(WORD_BYTES)) {
            self.perform_operation(start, word, true, WORD_PROGRAM_TIME).await?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use testkit::clock;
    use testkit::simulation::{ExecutorLevel, Simulation};

    /// STM32L475 data sheet: 81.7 us per double word, 22.0 ms per page. Power that fails during the second erase leaves
    /// a part of its double words as they were, and a part erased.
    #[test]
    fn operations_take_the_time_of_the_data_sheet_and_are_torn_by_a_loss_of_power() {
        let mut simulation = Simulation::new();
        let flash = SimulatedFlash::new(2);
        let mut writer = flash.clone();
        simulation.spawn(ExecutorLevel::Thread, "access", async move {
            writer.write(0, &[0; 4096]).await.unwrap();
            assert_eq!(clock::now_us(), 512 * 82);
            assert_eq!(writer.write(8, &[0xFF; 8]).await, Err(FlashFault::NotErased));
            let start_us = clock::now_us();
            writer.erase(0, 2048).await.unwrap();
            assert_eq!(clock::now_us() - start_us, 22_000);
            // Also all ones are written once.
            writer.write(0, &[0xFF; 8]).await.unwrap();
            assert_eq!(writer.write(0, &[0; 8]).await, Err(FlashFault::NotErased));
            writer.erase(2048, 4096).await.unwrap();
        });
        simulation.run_for(75_000);
        assert_eq!(flash.flash_contents()[..2048], [0xFF; 2048]);
        simulation.power_off();
        let contents = flash.flash_contents();
        let (words, _) = contents[2048..].as_chunks::<8>();
        // Of 256 double words a third each, within four standard deviations of 7.5.
        for word in [[0; 8], [0xFF; 8]] {
            let count = words.iter().filter(|&&found| found == word).count();
            assert!((55..=116).contains(&count), "{count} of {word:?}");
        }
    }
}
