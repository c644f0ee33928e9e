//! Registers and interrupts of the machine.

use cortex_m::interrupt::InterruptNumber;

/// A 32-bit register.
#[derive(Clone, Copy)]
pub struct Register(usize);

impl Register {
    /// The register at an offset of a peripheral.
    pub const fn at_offset(peripheral: Peripheral, offset: usize) -> Self {
        Self(peripheral as usize + offset)
    }

    pub const fn register_address(self) -> usize {
        self.0
    }

    pub fn read_register(self) -> u32 {
        // SAFETY: the address belongs to a peripheral with aligned registers. Those used here do not affect memory.
        unsafe { core::ptr::with_exposed_provenance::<u32>(self.0).read_volatile() }
    }

    pub fn write_register(self, value: u32) {
        // SAFETY: the address belongs to a peripheral with aligned registers. A write to those used here does not
        // affect memory.
        unsafe { core::ptr::with_exposed_provenance_mut::<u32>(self.0).write_volatile(value) }
    }
}

/// Peripheral base addresses (ARM DAI0386; QEMU's hw/arm/mps2.c for the sensor bus).
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

/// Interrupts in use.
#[derive(Clone, Copy)]
pub enum Interrupt {
    Uart0Rx = 0,
    Uart1Rx = 2,
    Uart2Rx = 4,
    DualTimer = 10,
    Uart3Rx = 18,
    /// Interrupt of the unused port GPIO 2: lockstep task.
    StepTask = 15,
    /// Interrupt of the unused port GPIO 0: executor of the heading tasks.
    HeadingTasks = 16,
    /// Interrupt of the unused port GPIO 1: executor of the other tasks.
    OtherTasks = 17,
}

// SAFETY: the numbers are valid interrupts of the machine, each listed once.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

/// Entry of the vector table.
#[derive(Clone, Copy)]
pub union Vector {
    handler: extern "C" fn(),
    reserved: u32,
}

const INTERRUPT_COUNT: usize = 32;

impl Vector {
    /// A table with these handlers; other interrupts are never enabled.
    pub const fn interrupt_table(handlers: &[(Interrupt, extern "C" fn())]) -> [Self; INTERRUPT_COUNT] {
        let mut table = [Self { reserved: 0 }; INTERRUPT_COUNT];
        let mut i = 0;
        while i < handlers.len() {
            let (interrupt, handler) = handlers[i];
            table[interrupt as usize] = Self { handler };
            i += 1;
        }
        table
    }
}
