//! Lockstep of the emulated machine with the simulator.
//!
//! Every 2 ms, before each access to the sensor and after each write to the instrument port, the machine sends its time
//! on a dedicated UART and waits with its clock frozen; only UART interrupts wake it. The simulator advances to that
//! time, takes the machine's output, sets the field, sends the bytes of the ports, and releases the machine. So a run
//! depends on its seed only, not on the host's speed, except for a microsecond by which QEMU's restart varies, and in
//! one of some 300 s by as much for an unknown reason.
//!
//! To the simulator: a message byte and the clock's ticks, little-endian. From the simulator: numbers of bytes sent to
//! the console, autopilot and instrument ports, and a byte of flags.

use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::asm;
use cortex_m::peripheral::NVIC;
use embassy_time::{Duration, Instant, Timer};

use super::machine_clock;
use super::registers::Interrupt;
use super::uart::{AUTOPILOT, CONSOLE, INSTRUMENT, LOCKSTEP, Uart};

/// Time between two steps: the reference board's receiver wakes after 16 bytes at 115200 baud or a pause, 1.4 ms.
const LOCKSTEP_PERIOD: Duration = Duration::from_millis(2);

/// Message to the simulator.
#[derive(Clone, Copy)]
enum LockstepMessage {
    /// The machine has started; it does not wait.
    Started = b'B' as isize,
    /// A time step has passed; the machine waits.
    Step = b'T' as isize,
    /// The machine is about to access the sensor; it waits.
    Sensor = b'S' as isize,
    /// The machine has written to the instrument port; it waits.
    Written = b'W' as isize,
}

/// Bits of the simulator's last byte.
struct ReleaseBits;

impl ReleaseBits {
    /// Bit: the sensor's data line is broken.
    const SENSOR_BROKEN: u8 = 1;
    /// First bit of the test number for the bench image; ignored by others.
    #[cfg(feature = "bench")]
    const BENCH_TEST_SHIFT: u32 = 1;
}

static SENSOR_BROKEN: AtomicBool = AtomicBool::new(false);

pub fn sensor_is_broken() -> bool {
    SENSOR_BROKEN.load(Ordering::Relaxed)
}

/// Synchronises at every step. Sends the nominal time, because the actual one depends on other tasks and on the clock
/// phase.
pub async fn run_lockstep() -> ! {
    let mut due = Instant::now();
    loop {
        due += LOCKSTEP_PERIOD;
        Timer::at(due).await;
        send_and_wait_for_release(LockstepMessage::Step, Some(due));
    }
}

/// Reports the start of the firmware to the simulator, before a task waits for the simulator.
pub fn report_start() {
    send_message(LockstepMessage::Started, machine_clock::ticks());
}

pub fn wait_before_sensor_access() {
    send_and_wait_for_release(LockstepMessage::Sensor, None);
}

/// Reports a write to the instrument port.
pub fn report_instrument_port_write() {
    send_and_wait_for_release(LockstepMessage::Written, None);
}

fn send_message(message: LockstepMessage, ticks: u64) {
    for byte in core::iter::once(message as u8).chain(ticks.to_le_bytes()) {
        // The emulator passes each byte to the host at once.
        while !LOCKSTEP.put_byte(byte) {}
    }
}

fn send_and_wait_for_release(message: LockstepMessage, due: Option<Instant>) {
    critical_section::with(|_| {
        machine_clock::with_frozen_clock(|ticks| {
            send_message(message, due.map_or(ticks, |due| due.as_micros() * machine_clock::TICKS_PER_US));
            let others = mask_all_but_uarts();
            let [console, autopilot, instrument, go] = core::array::from_fn(|_| wait_for_byte(&LOCKSTEP));
            receive_bytes(&CONSOLE, console);
            receive_bytes(&AUTOPILOT, autopilot);
            receive_bytes(&INSTRUMENT, instrument);
            // Bytes received without waiting would cause interrupts later, not reproducibly.
            clear_receive_interrupts();
            SENSOR_BROKEN.store(go & ReleaseBits::SENSOR_BROKEN != 0, Ordering::Relaxed);
            #[cfg(feature = "bench")]
            super::bench::request_test(go >> ReleaseBits::BENCH_TEST_SHIFT);
            restore_interrupt_mask(others);
        });
    });
}

fn wait_for_byte(uart: &Uart) -> u8 {
    loop {
        if let Some(byte) = uart.read_byte() {
            return byte;
        }
        wait_for_interrupt();
    }
}

fn receive_bytes(uart: &Uart, byte_count: u8) {
    let mut left = byte_count;
    while left > 0 {
        if uart.receive_byte() { left -= 1 } else { wait_for_interrupt() }
    }
}

/// Waits for a UART interrupt. Interrupts are disabled, so it only ends the wait.
fn wait_for_interrupt() {
    asm::wfi();
    clear_receive_interrupts();
}

fn clear_receive_interrupts() {
    for interrupt in RECEIVE_INTERRUPTS {
        NVIC::unpend(interrupt);
    }
}

const RECEIVE_INTERRUPTS: [Interrupt; 4] =
    [Interrupt::Uart0Rx, Interrupt::Uart1Rx, Interrupt::Uart2Rx, Interrupt::Uart3Rx];

/// Enables the UART interrupts only; returns the previous mask.
fn mask_all_but_uarts() -> u32 {
    // SAFETY: interrupts are disabled, and `restore_interrupt_mask` restores the mask.
    let nvic = unsafe { &*NVIC::PTR };
    let enabled = nvic.iser[0].read();
    let receivers = RECEIVE_INTERRUPTS.iter().fold(0, |bits, &interrupt| bits | 1 << interrupt as u32);
    // SAFETY: these writes only enable or disable interrupts, which cannot run before the end of the critical section.
    unsafe {
        nvic.icer[0].write(!receivers);
        nvic.iser[0].write(receivers);
    }
    enabled
}

fn restore_interrupt_mask(enabled: u32) {
    // SAFETY: these writes only enable or disable interrupts: they restore the mask from before `mask_all_but_uarts`.
    unsafe {
        let nvic = &*NVIC::PTR;
        nvic.icer[0].write(!enabled);
        nvic.iser[0].write(enabled);
    }
}
