//! Panic and fault message in RAM that survives the reset, for `status` after the restart.

use core::cell::UnsafeCell;
use core::fmt::{self, Write};
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use super::stack;
use autoswing_firmware::health::{PanicReport, count_early_panics};
use cortex_m::peripheral::SCB;
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use embassy_time::Instant;
use static_cell::StaticCell;

/// Longest message: 200 characters with the path of a source file and its line.
const TEXT_CAPACITY: usize = 288;
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// A message with CRC: after power-on the memory has random contents.
#[derive(Clone, Copy)]
struct PanicMessage {
    length: usize,
    /// Number of consecutive panics soon after the start.
    early_panic_count: u8,
    text: [u8; TEXT_CAPACITY],
    crc: u32,
}

impl PanicMessage {
    const EMPTY: Self = Self { length: 0, early_panic_count: 0, text: [0; TEXT_CAPACITY], crc: 0 };

    fn checksum(&self) -> u32 {
        let mut digest = CRC.digest();
        digest.update(&self.length.to_le_bytes());
        digest.update(&[self.early_panic_count]);
        digest.update(&self.text);
        // The CRC is inverted, so that memory of all zeros is invalid.
        !digest.finalize()
    }

    /// The stored message, or an empty one after power-on.
    fn load_message() -> Self {
        // SAFETY: called before tasks and interrupts start, or with interrupts disabled, so there is no other access.
        // The message consists of integers, valid for any contents.
        let stored = unsafe { PANIC_MESSAGE.0.get().read_volatile().assume_init() };
        if stored.crc == stored.checksum() { stored } else { Self::EMPTY }
    }

    fn store_message(mut self) {
        self.crc = self.checksum();
        // SAFETY: called before tasks and interrupts start, or with interrupts disabled, so there is no other access.
        // Volatile, because nothing reads it in this run.
        unsafe { PANIC_MESSAGE.0.get().write_volatile(MaybeUninit::new(self)) };
    }
}

impl Write for PanicMessage {
    /// Appends text up to the capacity; replaces all but printable ASCII, so that it can be cut anywhere.
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            if let Some(place) = self.text.get_mut(self.length) {
                *place = if byte.is_ascii_graphic() { byte } else { b' ' };
                self.length += 1;
            }
        }
        Ok(())
    }
}

/// Memory not initialised by the start-up code.
struct UninitialisedMessage(UnsafeCell<MaybeUninit<PanicMessage>>);

// SAFETY: accessed only at a panic or fault, with interrupts disabled, and at the start, before tasks and
// interrupts exist.
unsafe impl Sync for UninitialisedMessage {}

#[unsafe(link_section = ".uninit.last_words")]
static PANIC_MESSAGE: UninitialisedMessage = UninitialisedMessage(UnsafeCell::new(MaybeUninit::uninit()));

/// Stores a message and resets.
fn store_panic_and_reset(message: fmt::Arguments<'_>) -> ! {
    cortex_m::interrupt::disable();
    let early_panic_count =
        count_early_panics(PanicMessage::load_message().early_panic_count, Instant::now().as_secs());
    let mut words = PanicMessage { early_panic_count, ..PanicMessage::EMPTY };
    // Infallible: `PanicMessage` truncates a text that is too long.
    let _ = words.write_fmt(message);
    words.store_message();
    SCB::sys_reset()
}

/// Returns the panic of the previous run and erases its message; the number of early panics stays until a run ends
/// otherwise. Call once, first of all.
pub fn take_panic_report() -> Option<PanicReport> {
    static MESSAGE_TEXT: StaticCell<[u8; TEXT_CAPACITY]> = StaticCell::new();
    let PanicMessage { length, early_panic_count, text, .. } = PanicMessage::load_message();
    let message = MESSAGE_TEXT.init(text).get(..length).and_then(|text| core::str::from_utf8(text).ok())?;
    let has_panicked = !message.is_empty();
    PanicMessage { early_panic_count: if has_panicked { early_panic_count } else { 0 }, ..PanicMessage::EMPTY }
        .store_message();
    has_panicked.then_some(PanicReport { message, early_panic_count })
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    let message = info.message();
    match info.location() {
        Some(place) => store_panic_and_reset(format_args!("{}:{} {message}", place.file(), place.line())),
        None => store_panic_and_reset(format_args!("{message}")),
    }
}

/// Handler of all processor faults, for example an access to an invalid address or an undefined instruction.
///
/// After a stack overflow no handler could run, so it first resets the stack pointer to the start of the stack. If the
/// processor locks up before, the watchdog resets it.
#[unsafe(naked)]
#[unsafe(no_mangle)]
unsafe extern "C" fn HardFault() -> ! {
    core::arch::naked_asm!(
        "mrs r0, msp",
        "ldr r1, =_stack_start",
        "msr msp, r1",
        "b {report}",
        report = sym report_fault,
    )
}

/// Exception frame pushed by the processor.
#[repr(C)]
struct ExceptionFrame {
    r0_to_r3: [u32; 4],
    r12: u32,
    lr: u32,
    pc: u32,
    xpsr: u32,
}

extern "C" fn report_fault(frame: *const ExceptionFrame) -> ! {
    // SAFETY: the System Control Block always exists, and reading these registers has no side effects.
    let scb = unsafe { &*SCB::PTR };
    let (cfsr, bfar) = (scb.cfsr.read(), scb.bfar.read());
    if !stack::contains_object(frame) {
        store_panic_and_reset(format_args!("stack overflow, cfsr {cfsr:08x}"));
    }
    // SAFETY: the frame is within the stack and aligned by the processor.
    let ExceptionFrame { lr, pc, .. } = unsafe { frame.read() };
    store_panic_and_reset(format_args!("fault at pc {pc:08x} lr {lr:08x} cfsr {cfsr:08x} bfar {bfar:08x}"))
}
