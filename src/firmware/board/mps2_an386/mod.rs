//! QEMU's `mps2-an386`, a Cortex-M4F: the same firmware on an emulator. Run by `lab emulate`.
//!
//! | connection | machine |
//! |---|---|
//! | magnetometer LSM303DLHC, address 0x1E (QEMU's own model) | bit-banged I2C at 0x4002A000 |
//! | console | UART0 |
//! | autopilot (port 1) | UART1 |
//! | instrument (port 2) | UART3 |
//! | simulator, see [`lockstep`] | UART2 |
//!
//! # Interrupt priorities
//!
//! 1. UARTs. Above everything that waits in the lockstep, or WFI would not wake.
//! 2. Clock and lockstep.
//! 3. Executor of the heading tasks, in an unused peripheral's interrupt.
//! 4. Executor of the others: solving, flash, console. Also in an interrupt: the main thread only spins.

#[cfg(feature = "bench")]
mod bench;
mod flash;
mod i2c;
mod lockstep;
mod machine_clock;
mod registers;
mod reset;
mod sensor;
mod uart;

use autoswing_firmware::app;
use autoswing_firmware::health::StackUse;
use cortex_m::peripheral::{NVIC, SCB};
use cortex_m::{Peripherals, asm};
use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, SendSpawner};

pub use self::flash::StoreFlash;
use self::i2c::SensorBus;
use self::registers::{Interrupt, Vector};
pub use self::sensor::EmulatedMagnetometer as Magnetometer;
pub use self::uart::UartTx;
use self::uart::{AUTOPILOT, CONSOLE, INSTRUMENT, LOCKSTEP, ReceiveQueue};
use super::hardware::{self, PortAndConsoleUarts};
use super::stack;

pub type UartRx = &'static ReceiveQueue;
pub type Uarts = PortAndConsoleUarts<UartTx, UartRx>;
pub type Hardware = hardware::Hardware<Magnetometer, (), Uarts, (), Watchdog, Panel, StoreFlash, Platform>;

/// Cycles of one idle spin; longer ones are faster to emulate.
const IDLE_SPIN_CYCLES: u32 = 100;

const CONSOLE_TX: UartTx = UartTx { uart: &CONSOLE, on_written: || {} };

/// Executor of the heading tasks.
static HEADING_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
static OTHER_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
static STEP_EXECUTOR: InterruptExecutor = InterruptExecutor::new();

/// Interrupt vector table, placed by cortex-m-rt's linker script.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [Vector; 32] = Vector::interrupt_table(&[
    (Interrupt::Uart0Rx, on_console),
    (Interrupt::Uart1Rx, on_autopilot),
    (Interrupt::Uart3Rx, on_instrument),
    (Interrupt::DualTimer, machine_clock::on_interrupt),
    (Interrupt::StepTask, on_step_task),
    (Interrupt::HeadingTasks, on_heading_tasks),
    (Interrupt::OtherTasks, on_other_tasks),
]);

extern "C" fn on_console() {
    while CONSOLE.receive_byte() {}
}

extern "C" fn on_autopilot() {
    while AUTOPILOT.receive_byte() {}
}

extern "C" fn on_instrument() {
    while INSTRUMENT.receive_byte() {}
}

extern "C" fn on_step_task() {
    // SAFETY: the executor was started with this interrupt.
    unsafe { STEP_EXECUTOR.on_interrupt() }
}

extern "C" fn on_heading_tasks() {
    // SAFETY: the executor was started with this interrupt.
    unsafe { HEADING_EXECUTOR.on_interrupt() }
}

extern "C" fn on_other_tasks() {
    // SAFETY: the executor was started with this interrupt.
    unsafe { OTHER_EXECUTOR.on_interrupt() }
}

/// Interrupt priorities; lower values are more urgent.
const INTERRUPT_PRIORITIES: [(Interrupt, u8); 8] = [
    (Interrupt::Uart0Rx, 0x20),
    (Interrupt::Uart1Rx, 0x20),
    (Interrupt::Uart2Rx, 0x20),
    (Interrupt::Uart3Rx, 0x20),
    (Interrupt::DualTimer, 0x40),
    (Interrupt::StepTask, 0x40),
    (Interrupt::HeadingTasks, 0x60),
    (Interrupt::OtherTasks, 0x80),
];

pub fn start_board(spawn_tasks: impl FnOnce(SendSpawner, SendSpawner, Hardware)) -> ! {
    let reset = reset::take_reset_cause();
    if let Some(mut core) = Peripherals::take() {
        for (interrupt, priority) in INTERRUPT_PRIORITIES {
            // SAFETY: no critical section in this firmware depends on priorities.
            unsafe { core.NVIC.set_priority(interrupt, priority) };
        }
    }
    for uart in [&CONSOLE, &AUTOPILOT, &INSTRUMENT, &LOCKSTEP] {
        uart.enable();
    }
    machine_clock::start_clock();
    lockstep::report_start();
    for interrupt in [Interrupt::DualTimer, Interrupt::Uart0Rx, Interrupt::Uart1Rx, Interrupt::Uart3Rx] {
        // SAFETY: `__INTERRUPTS` has handlers of these interrupts.
        unsafe { NVIC::unmask(interrupt) };
    }
    #[cfg(feature = "bench")]
    let is_safe_mode = reset.requires_safe_mode();
    let hardware = Hardware {
        magnetometer: Magnetometer::new(SensorBus::new()),
        inertial_sensor: (),
        uarts: Uarts {
            port_uarts: [
                (UartTx { uart: &AUTOPILOT, on_written: || {} }, &AUTOPILOT.receive_queue),
                (
                    UartTx { uart: &INSTRUMENT, on_written: lockstep::report_instrument_port_write },
                    &INSTRUMENT.receive_queue,
                ),
            ],
            console_uart: (CONSOLE_TX, &CONSOLE.receive_queue),
        },
        can_bus: (),
        watchdog: Watchdog,
        panel: Panel,
        flash: StoreFlash::new(),
        platform: Platform,
        reset_cause: reset,
    };

    // Infallible: this task and the bench task are spawned only once.
    STEP_EXECUTOR.start(Interrupt::StepTask).spawn(lockstep_task().expect("one task"));
    let above = HEADING_EXECUTOR.start(Interrupt::HeadingTasks);
    let below = OTHER_EXECUTOR.start(Interrupt::OtherTasks);
    spawn_tasks(above, below, hardware);
    #[cfg(feature = "bench")]
    if !is_safe_mode {
        below.spawn(bench_task().expect("one task"));
    }
    // Spins: when the processor sleeps, QEMU advances time by some instructions more or less, depending on the host.
    loop {
        asm::delay(IDLE_SPIN_CYCLES);
    }
}

/// Watchdog stub: the machine's watchdog cannot be stopped while time is frozen.
pub struct Watchdog;

impl app::Watchdog for Watchdog {
    fn feed(&mut self) {}
}

/// Panel stub.
pub struct Panel;

impl app::Panel for Panel {
    fn set_lamp(&mut self, _on: bool) {}

    fn is_pressed(&self) -> bool {
        false
    }
}

pub struct Platform;

impl app::Platform for Platform {
    fn reboot(&mut self) {
        reset::announce_reboot();
        SCB::sys_reset()
    }

    fn peak_stack_use(&self) -> Option<StackUse> {
        Some(stack::peak_use())
    }
}

#[embassy_executor::task]
async fn lockstep_task() -> ! {
    lockstep::run_lockstep().await
}

#[cfg(feature = "bench")]
#[embassy_executor::task]
async fn bench_task() -> ! {
    bench::run_bench(CONSOLE_TX).await
}
