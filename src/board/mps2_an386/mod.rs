//! QEMU's `mps2-an386`, a Cortex-M4F: the same firmware on a machine that everybody has. `host-sim emulate` runs it.
//!
//! | wire | machine |
//! |---|---|
//! | magnetometer LSM303DLHC, address 0x1E (QEMU's own model) | bit-banged I2C at 0x4002A000 |
//! | console | UART0 |
//! | autopilot | UART1 |
//! | the simulated world, see [`lockstep`] | UART2 |
//!
//! # Priorities
//!
//! 1. The UARTs, one byte each. Their priority must be above that of everything that waits in the lockstep: WFI wakes for
//!    nothing else.
//! 2. The clock, and the lockstep with the world.
//! 3. The executor of the tasks that make headings, in an interrupt that no peripheral uses.
//! 4. The executor of the others: solving, flash, console. In an interrupt, too, for QEMU's WFE does not sleep.

#[cfg(feature = "bench")]
mod bench;
mod clock;
mod flash;
mod i2c;
mod lockstep;
mod registers;
mod reset;
mod sensor;
mod uart;

use autoswing::app::{self, Links, Platform, ResetCause, StackUse, Watchdog};
use autoswing::store::Store;
use cortex_m::peripheral::{NVIC, SCB};
use cortex_m::{Peripherals, asm};
use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, SpawnError, SpawnToken};

use self::flash::StoreFlash;
use self::i2c::SensorBus;
use self::registers::{Interrupt, Peripheral, Vector};
use self::sensor::Sensor;
use self::uart::{Uart, UartTx};
use super::stack;

static LINKS: Links = Links::new();
static CONSOLE: Uart = Uart::new(Peripheral::Uart0);
static AUTOPILOT: Uart = Uart::new(Peripheral::Uart1);
static LOCKSTEP: Uart = Uart::new(Peripheral::Uart2);

/// Executor of the tasks that make headings.
static HEADING_TASKS: InterruptExecutor = InterruptExecutor::new();
static OTHER_TASKS: InterruptExecutor = InterruptExecutor::new();
static STEP_TASK: InterruptExecutor = InterruptExecutor::new();

/// The processor's table of interrupts, which cortex-m-rt's linker script puts in its place.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [Vector; 32] = Vector::table(&[
    (Interrupt::Uart0Rx, on_console),
    (Interrupt::Uart1Rx, on_autopilot),
    (Interrupt::DualTimer, clock::on_interrupt),
    (Interrupt::StepTask, on_step_task),
    (Interrupt::HeadingTasks, on_heading_tasks),
    (Interrupt::OtherTasks, on_other_tasks),
]);

extern "C" fn on_console() {
    while CONSOLE.receive() {}
}

extern "C" fn on_autopilot() {
    while AUTOPILOT.receive() {}
}

extern "C" fn on_step_task() {
    // SAFETY: this is the interrupt that the executor was started with; so with the two below.
    unsafe { STEP_TASK.on_interrupt() }
}

extern "C" fn on_heading_tasks() {
    // SAFETY: see above.
    unsafe { HEADING_TASKS.on_interrupt() }
}

extern "C" fn on_other_tasks() {
    // SAFETY: see above.
    unsafe { OTHER_TASKS.on_interrupt() }
}

/// Priorities, the lower the more urgent.
const PRIORITIES: [(Interrupt, u8); 7] = [
    (Interrupt::Uart0Rx, 0x20),
    (Interrupt::Uart1Rx, 0x20),
    (Interrupt::Uart2Rx, 0x20),
    (Interrupt::DualTimer, 0x40),
    (Interrupt::StepTask, 0x40),
    (Interrupt::HeadingTasks, 0x60),
    (Interrupt::OtherTasks, 0x80),
];

/// Runs the firmware.
pub fn start() -> ! {
    let reset = reset::cause();
    if let Some(mut core) = Peripherals::take() {
        for (interrupt, priority) in PRIORITIES {
            // SAFETY: no critical section of this firmware is made of priorities.
            unsafe { core.NVIC.set_priority(interrupt, priority) };
        }
    }
    for uart in [&CONSOLE, &AUTOPILOT, &LOCKSTEP] {
        uart.enable();
    }
    clock::start();
    lockstep::started();
    for interrupt in [Interrupt::DualTimer, Interrupt::Uart0Rx, Interrupt::Uart1Rx] {
        // SAFETY: their handlers are in the table above.
        unsafe { NVIC::unmask(interrupt) };
    }
    let flash = StoreFlash::new();
    let region = flash.region();

    // Each task is spawned once, and there is room for one of each: `spawned` cannot fail.
    STEP_TASK.start(Interrupt::StepTask).spawn(spawned(step()));
    let above = HEADING_TASKS.start(Interrupt::HeadingTasks);
    above.spawn(spawned(sensor(Sensor::new(SensorBus::new()))));
    above.spawn(spawned(attitude()));
    above.spawn(spawned(stream()));
    above.spawn(spawned(watch()));
    let below = OTHER_TASKS.start(Interrupt::OtherTasks);
    below.spawn(spawned(compass(Store::new(flash, region))));
    below.spawn(spawned(console(reset)));
    below.spawn(spawned(pulse()));
    loop {
        asm::wfi();
    }
}

fn spawned<S>(token: Result<SpawnToken<S>, SpawnError>) -> SpawnToken<S> {
    token.expect("one task of each")
}

/// The machine's watchdog is not used: it cannot be stopped while time stands still.
struct NoWatchdog;

impl Watchdog for NoWatchdog {
    fn feed(&mut self) {}
}

struct Board;

impl Platform for Board {
    fn reboot(&mut self) {
        reset::announce_reboot();
        SCB::sys_reset()
    }

    fn stack(&self) -> Option<StackUse> {
        Some(stack::high_water())
    }

    #[cfg(feature = "bench")]
    fn test(&mut self, test: autoswing::console::BenchTest, out: &mut dyn core::fmt::Write) -> core::fmt::Result {
        bench::run(test, out)
    }
}

#[embassy_executor::task]
async fn step() -> ! {
    lockstep::run().await
}

#[embassy_executor::task]
async fn sensor(magnetometer: Sensor) -> ! {
    app::sensor::run(&LINKS, magnetometer).await
}

#[embassy_executor::task]
async fn attitude() -> ! {
    app::attitude::run(&LINKS, &AUTOPILOT.received).await
}

#[embassy_executor::task]
async fn stream() -> ! {
    app::stream::run(&LINKS, UartTx { uart: &AUTOPILOT, written: lockstep::autopilot_written }).await
}

#[embassy_executor::task]
async fn watch() -> ! {
    app::watchdog::run(&LINKS, NoWatchdog).await
}

#[embassy_executor::task]
async fn pulse() -> ! {
    app::watchdog::pulse(&LINKS).await
}

#[embassy_executor::task]
async fn compass(store: Store<StoreFlash>) -> ! {
    app::compass::run(&LINKS, store).await
}

#[embassy_executor::task]
async fn console(reset: ResetCause) -> ! {
    app::console::run(&LINKS, &CONSOLE.received, UartTx { uart: &CONSOLE, written: || {} }, Board, reset).await
}
