//! Keeps the machine in step with the simulated world outside.
//!
//! Every two milliseconds, and before every access to the sensor, the machine sends its time on a UART of its own and
//! stops: its clock stands still, no timer runs, nothing but the UARTs can wake the processor. The world moves on to
//! that time, sets the field, sends what the autopilot and the console's user would have sent meanwhile, and lets the
//! machine go on. So a run is a function of its seed, however fast or slow the computer is, but for a microsecond that
//! QEMU may take more or less to restart.
//!
//! To the world: a [`Message`] and the clock's ticks, little-endian. From the world: how many bytes it has sent to the
//! console, to the autopilot port and to the instrument port, and a byte of [`Go`].

use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::asm;
use cortex_m::peripheral::NVIC;
use embassy_time::{Duration, Instant, Timer};

use super::registers::Interrupt;
use super::uart::Uart;
use super::{AUTOPILOT, CONSOLE, INSTRUMENT, LOCKSTEP, clock};

/// As the reference board's receiver is woken: by 16 bytes at 115200 baud or a pause, 1.4 ms.
const STEP: Duration = Duration::from_millis(2);

/// What the world is sent.
#[derive(Clone, Copy)]
enum Message {
    /// The machine goes on: it has just started.
    Started = b'B' as isize,
    /// The machine waits: time has passed.
    Step = b'T' as isize,
    /// The machine waits: it is about to look at the sensor.
    Sensor = b'S' as isize,
    /// The machine goes on: it has written to the instrument.
    Written = b'W' as isize,
}

/// Bits of the last byte from the world.
struct Go;

impl Go {
    /// The sensor's data wire is broken.
    const SENSOR_BROKEN: u8 = 1;
    /// The bits above are the number of a test of the bench image. Others pass it over.
    #[cfg(feature = "bench")]
    const BENCH_TEST_SHIFT: u32 = 1;
}

static SENSOR_BROKEN: AtomicBool = AtomicBool::new(false);

/// Whether the sensor's data wire is broken.
pub fn sensor_is_broken() -> bool {
    SENSOR_BROKEN.load(Ordering::Relaxed)
}

/// Lets the world catch up from time to time. It is sent the time when that was to be, not when it came to be: that
/// depends on what else ran, and on where between two ticks of the clock.
pub async fn run() -> ! {
    let mut due = Instant::now();
    loop {
        due += STEP;
        Timer::at(due).await;
        wait(Message::Step, Some(due));
    }
}

/// At the start, before anything waits.
pub fn started() {
    send(Message::Started, clock::ticks());
}

/// Before a look at the sensor.
pub fn before_sensor() {
    wait(Message::Sensor, None);
}

/// After something was written to the instrument.
pub fn instrument_written() {
    critical_section::with(|_| clock::freeze(|ticks| send(Message::Written, ticks)));
}

fn send(message: Message, ticks: u64) {
    for byte in core::iter::once(message as u8).chain(ticks.to_le_bytes()) {
        // The emulator hands a byte to the host before it goes on.
        while !LOCKSTEP.put(byte) {}
    }
}

fn wait(message: Message, due: Option<Instant>) {
    critical_section::with(|_| {
        clock::freeze(|ticks| {
            send(message, due.map_or(ticks, |due| due.as_micros() * clock::TICKS_PER_US));
            let others = mask_others();
            let [console, autopilot, instrument, go] = core::array::from_fn(|_| take(&LOCKSTEP));
            receive(&CONSOLE, console);
            receive(&AUTOPILOT, autopilot);
            receive(&INSTRUMENT, instrument);
            // What was taken without a wait would interrupt later, and now and then.
            forget_interrupts();
            SENSOR_BROKEN.store(go & Go::SENSOR_BROKEN != 0, Ordering::Relaxed);
            #[cfg(feature = "bench")]
            super::bench::ask(go >> Go::BENCH_TEST_SHIFT);
            unmask(others);
        });
    });
}

/// Waits for a byte.
fn take(uart: &Uart) -> u8 {
    loop {
        if let Some(byte) = uart.take() {
            return byte;
        }
        sleep();
    }
}

/// Receives so many bytes.
fn receive(uart: &Uart, bytes: u8) {
    let mut left = bytes;
    while left > 0 {
        if uart.receive() { left -= 1 } else { sleep() }
    }
}

/// Until a UART has a byte. Interrupts are off: a pending one ends the wait and is not served.
fn sleep() {
    asm::wfi();
    forget_interrupts();
}

/// Of the bytes that were taken already.
fn forget_interrupts() {
    for interrupt in RECEIVERS {
        NVIC::unpend(interrupt);
    }
}

const RECEIVERS: [Interrupt; 4] = [Interrupt::Uart0Rx, Interrupt::Uart1Rx, Interrupt::Uart2Rx, Interrupt::Uart3Rx];

/// Nothing but the UARTs may end the wait. Returns what was enabled.
fn mask_others() -> u32 {
    // SAFETY: interrupts are off, and `unmask` restores what was enabled.
    let nvic = unsafe { &*NVIC::PTR };
    let enabled = nvic.iser[0].read();
    let receivers = RECEIVERS.iter().fold(0, |bits, &interrupt| bits | 1 << interrupt as u32);
    // SAFETY: writing bits here disables or enables those interrupts and nothing else; none runs until the section
    // ends.
    unsafe {
        nvic.icer[0].write(!receivers);
        nvic.iser[0].write(receivers);
    }
    enabled
}

fn unmask(enabled: u32) {
    // SAFETY: as above; these are the interrupts that were enabled before.
    unsafe {
        let nvic = &*NVIC::PTR;
        nvic.icer[0].write(!enabled);
        nvic.iser[0].write(enabled);
    }
}
