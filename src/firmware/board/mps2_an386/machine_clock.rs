//! Time driver of `embassy_time`: a free-running counter, and a timer for the next deadline.
//!
//! Time is frozen while the simulator catches up: see [`lockstep`](super::lockstep).

use core::cell::RefCell;
use core::task::Waker;

use critical_section::Mutex;
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

use super::registers::{Peripheral, Register};

const FPGA_COUNTER: Register = Register::at_offset(Peripheral::FpgaIo, 0x18);
const FPGA_PRESCALE: Register = Register::at_offset(Peripheral::FpgaIo, 0x1C);
const TIMER_LOAD: Register = Register::at_offset(Peripheral::DualTimer, 0x00);
const TIMER_VALUE: Register = Register::at_offset(Peripheral::DualTimer, 0x04);
const TIMER_CONTROL: Register = Register::at_offset(Peripheral::DualTimer, 0x08);
const TIMER_CLEAR: Register = Register::at_offset(Peripheral::DualTimer, 0x0C);

/// Frequency of counter and timer: 25 MHz.
pub const TICKS_PER_US: u64 = 25;

/// Values of `TIMER_CONTROL`: one shot, 32 bits. QEMU applies 32 bits of `TIMER_LOAD` only if 32-bit mode was set before.
const TIMER_STOPPED: u32 = 0b0000_0011;
const TIMER_RUNNING: u32 = 0b1010_0011;
/// Value of `TIMER_CONTROL` that stops the timer, which keeps its remaining time.
const TIMER_PAUSED: u32 = 0b0010_0011;

/// Longest timer interval: the counter must be read before it wraps after 171 s.
const MAX_TIMER_US: u64 = 60_000_000;

struct Clock {
    wake_queue: Queue,
    /// Last counter value, and number of wraps.
    last_counter: u32,
    counter_wraps: u32,
    /// Number of ticks during which time was frozen.
    frozen_ticks: u64,
    /// Last conversion of the clock: a time in microseconds, and the same time in ticks.
    converted_us: u64,
    converted_ticks: u64,
}

struct MachineClock(Mutex<RefCell<Clock>>);

embassy_time_driver::time_driver_impl!(static CLOCK: MachineClock = MachineClock(Mutex::new(RefCell::new(Clock {
    wake_queue: Queue::new(),
    last_counter: 0,
    counter_wraps: 0,
    frozen_ticks: 0,
    converted_us: 0,
    converted_ticks: 0,
}))));

impl Clock {
    fn read_counter(&mut self) -> u64 {
        let low = FPGA_COUNTER.read_register();
        if low < self.last_counter {
            self.counter_wraps = self.counter_wraps.wrapping_add(1);
        }
        self.last_counter = low;
        u64::from(self.counter_wraps) << 32 | u64::from(low)
    }

    fn ticks(&mut self) -> u64 {
        self.read_counter() - self.frozen_ticks
    }

    /// Microseconds since the start. Divides only the ticks since the last call, which fit into 32 bits; the processor
    /// has no 64-bit division.
    fn now_us(&mut self) -> u64 {
        let since_us = (self.ticks() - self.converted_ticks) as u32 / TICKS_PER_US as u32;
        self.converted_us += u64::from(since_us);
        self.converted_ticks += u64::from(since_us) * TICKS_PER_US;
        self.converted_us
    }

    /// Wakes expired timers and sets the hardware timer for the next.
    fn set_timer(&mut self) {
        TIMER_CONTROL.write_register(TIMER_STOPPED);
        let now_us = self.now_us();
        let next_us = self.wake_queue.next_expiration(now_us);
        // The interval is at most a minute, and at least 1 us, so that deadlines passed meanwhile are handled by the
        // next interrupt.
        let after_us = next_us.saturating_sub(now_us).clamp(1, MAX_TIMER_US);
        TIMER_LOAD.write_register((after_us * TICKS_PER_US) as u32);
        TIMER_CONTROL.write_register(TIMER_RUNNING);
    }
}

impl MachineClock {
    /// The closures do not access the clock, so the borrow cannot fail.
    fn with_clock<R>(&self, f: impl FnOnce(&mut Clock) -> R) -> R {
        critical_section::with(|token| f(&mut self.0.borrow_ref_mut(token)))
    }
}

impl Driver for MachineClock {
    fn now(&self) -> u64 {
        self.with_clock(Clock::now_us)
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        self.with_clock(|clock| {
            if clock.wake_queue.schedule_wake(at, waker) {
                clock.set_timer();
            }
        });
    }
}

/// Starts the counter at zero.
pub fn start_clock() {
    FPGA_PRESCALE.write_register(0);
    FPGA_COUNTER.write_register(0);
    CLOCK.with_clock(Clock::set_timer);
}

/// Timer interrupt handler.
pub extern "C" fn on_interrupt() {
    TIMER_CLEAR.write_register(1);
    CLOCK.with_clock(Clock::set_timer);
}

/// Phase of the processor within the 5-instruction period of the counter (5 instructions = 8 ticks), from the ticks
/// between five reads.
#[inline(never)]
fn clock_phase() -> u32 {
    /// Phase by four bits: the differences of consecutive reads, less one, the first difference as the most significant
    /// bit.
    const CLOCK_PHASES: [u8; 16] = [0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 4, 1, 0, 3, 0, 0];
    let (a, b, c, d, e): (u32, u32, u32, u32, u32);
    // SAFETY: five consecutive reads of a register without side effects.
    unsafe {
        core::arch::asm!(
            "ldr {a}, [{counter}]",
            "ldr {b}, [{counter}]",
            "ldr {c}, [{counter}]",
            "ldr {d}, [{counter}]",
            "ldr {e}, [{counter}]",
            counter = in(reg) FPGA_COUNTER.register_address(),
            a = out(reg) a,
            b = out(reg) b,
            c = out(reg) c,
            d = out(reg) d,
            e = out(reg) e,
            options(nostack, preserves_flags),
        );
    }
    let bit = |from: u32, to: u32| to.wrapping_sub(from).wrapping_sub(1) & 1;
    let bits = bit(a, b) << 3 | bit(b, c) << 2 | bit(c, d) << 1 | bit(d, e);
    u32::from(CLOCK_PHASES[bits as usize & 15])
}

/// Executes instructions until the processor has this phase relative to the counter again.
#[inline(never)]
fn restore_clock_phase(phase: u32) {
    let missing_cycles = (phase + 5 - clock_phase()) % 5;
    // SAFETY: skips `4 - missing_cycles` of four `nop`s; the first `nop` is always skipped.
    unsafe {
        core::arch::asm!(
            "add pc, {skip}",
            "nop",
            "nop",
            "nop",
            "nop",
            "nop",
            skip = in(reg) 2 * (4 - missing_cycles),
            options(nomem, nostack, preserves_flags),
        );
    }
}

/// Ticks since the start, without frozen time.
pub fn ticks() -> u64 {
    CLOCK.with_clock(Clock::ticks)
}

/// Freezes time while `f` runs, which receives the ticks of that moment.
///
/// The instruction count of `f` depends on the host, since bytes arrive at any time. An instruction takes 64 ns, a tick
/// 40 ns, so five instructions are eight ticks; without restoring the phase, runs of one seed would differ.
pub fn with_frozen_clock(f: impl FnOnce(u64)) {
    TIMER_CONTROL.write_register(TIMER_PAUSED);
    let phase = clock_phase();
    let before = CLOCK.with_clock(Clock::read_counter);
    f(ticks());
    restore_clock_phase(phase);
    CLOCK.with_clock(|clock| clock.frozen_ticks += clock.read_counter() - before);
    // An expired timer has its interrupt pending, which restarts it.
    if TIMER_VALUE.read_register() != 0 {
        TIMER_CONTROL.write_register(TIMER_RUNNING);
    }
}
