//! Access to the machine's registers, and its interrupts.

use cortex_m::interrupt::InterruptNumber;

/// A 32-bit register of the machine.
#[derive(Clone, Copy)]
pub struct Register(usize);

impl Register {
    /// The register at an offset of a peripheral of the machine.
    pub const fn of(peripheral: Peripheral, offset: usize) -> Self {
        Self(peripheral as usize + offset)
    }

    pub const fn address(self) -> usize {
        self.0
    }

    pub fn read(self) -> u32 {
        // SAFETY: the address is of a peripheral of this machine, whose registers are aligned words. Those this
        // firmware uses have no effect on memory.
        unsafe { core::ptr::with_exposed_provenance::<u32>(self.0).read_volatile() }
    }

    pub fn write(self, value: u32) {
        // SAFETY: as above.
        unsafe { core::ptr::with_exposed_provenance_mut::<u32>(self.0).write_volatile(value) }
    }
}

/// Where the machine's peripherals are (ARM DAI0386, and QEMU's hw/arm/mps2.c for the sensor's bus).
#[derive(Clone, Copy)]
pub enum Peripheral {
    DualTimer = 0x4000_2000,
    Uart0 = 0x4000_4000,
    Uart1 = 0x4000_5000,
    Uart2 = 0x4000_6000,
    Uart3 = 0x4000_7000,
    FpgaIo = 0x4002_8000,
    SensorBus = 0x4002_A000,
}

/// The machine's interrupts that are used.
#[derive(Clone, Copy)]
pub enum Interrupt {
    Uart0Rx = 0,
    Uart1Rx = 2,
    Uart2Rx = 4,
    DualTimer = 10,
    Uart3Rx = 18,
    /// Of the port GPIO 2, which is not used: runs the lockstep with the world.
    StepTask = 15,
    /// Of the port GPIO 0: runs the executor of the tasks that make headings.
    HeadingTasks = 16,
    /// Of the port GPIO 1: runs the executor of the others.
    OtherTasks = 17,
}

// SAFETY: the numbers are those of the machine's 32 interrupts, each given once.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

/// What the processor calls on an interrupt.
#[derive(Clone, Copy)]
pub union Vector {
    handler: extern "C" fn(),
    reserved: u32,
}

const INTERRUPTS: usize = 32;

impl Vector {
    /// The table with these handlers; the others are never enabled.
    pub const fn table(handlers: &[(Interrupt, extern "C" fn())]) -> [Self; INTERRUPTS] {
        let mut table = [Self { reserved: 0 }; INTERRUPTS];
        let mut i = 0;
        while i < handlers.len() {
            let (interrupt, handler) = handlers[i];
            table[interrupt as usize] = Self { handler };
            i += 1;
        }
        table
    }
}
