//! Panic and fault message in RAM that survives the reset, for `status` after the restart.

use core::cell::UnsafeCell;
use core::fmt::{self, Write};
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use super::stack;
use cortex_m::peripheral::SCB;
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};

/// Longest message, the capacity of `ResetCause`.
const CAPACITY: usize = 96;
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// A message with CRC: after power-on the memory has random contents.
#[derive(Clone, Copy)]
struct Message {
    length: usize,
    text: [u8; CAPACITY],
    crc: u32,
}

impl Message {
    const EMPTY: Self = Self { length: 0, text: [0; CAPACITY], crc: 0 };

    fn checksum(&self) -> u32 {
        let mut digest = CRC.digest();
        digest.update(&self.length.to_le_bytes());
        digest.update(&self.text);
        // Inverted, so that all zeros are invalid.
        !digest.finalize()
    }

    /// The message, if valid.
    fn text(&self) -> Option<heapless::String<CAPACITY>> {
        let text = self.text.get(..self.length).filter(|text| !text.is_empty() && self.crc == self.checksum())?;
        heapless::String::try_from(core::str::from_utf8(text).ok()?).ok()
    }
}

impl Write for Message {
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
struct Kept(UnsafeCell<MaybeUninit<Message>>);

// SAFETY: written only at a panic or fault, with interrupts disabled, and read at the start, before tasks and
// interrupts exist.
unsafe impl Sync for Kept {}

#[unsafe(link_section = ".uninit.last_words")]
static LAST_WORDS: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

/// Stores a message and resets.
fn die(message: fmt::Arguments<'_>) -> ! {
    cortex_m::interrupt::disable();
    let mut words = Message::EMPTY;
    // Infallible: a message is truncated.
    let _ = words.write_fmt(message);
    words.crc = words.checksum();
    // SAFETY: interrupts are disabled, so there is no other access. Volatile, because nothing reads it in this run.
    unsafe { LAST_WORDS.0.get().write_volatile(MaybeUninit::new(words)) };
    SCB::sys_reset()
}

/// Returns the message of the previous run and erases it. Call once, first of all.
pub fn take() -> Option<heapless::String<CAPACITY>> {
    // SAFETY: there is no other access before tasks and interrupts start. The message consists of integers, valid for
    // any contents.
    let words = unsafe { LAST_WORDS.0.get().read_volatile().assume_init() };
    // SAFETY: as above.
    unsafe { LAST_WORDS.0.get().write_volatile(MaybeUninit::new(Message::EMPTY)) };
    words.text()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    let message = info.message();
    match info.location() {
        // Only the file name, since a long message is truncated at its end.
        Some(place) => {
            let path = place.file();
            // By bytes: a search by characters costs 0.5 KB of flash.
            let file =
                path.bytes().rposition(|byte| byte == b'/').and_then(|slash| path.get(slash + 1..)).unwrap_or(path);
            die(format_args!("{file}:{} {message}", place.line()))
        }
        None => die(format_args!("{message}")),
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
struct Frame {
    r0_to_r3: [u32; 4],
    r12: u32,
    lr: u32,
    pc: u32,
    xpsr: u32,
}

extern "C" fn report_fault(frame: *const Frame) -> ! {
    // SAFETY: the System Control Block always exists, and reading these registers has no side effects.
    let scb = unsafe { &*SCB::PTR };
    let (cfsr, bfar) = (scb.cfsr.read(), scb.bfar.read());
    if !stack::holds(frame) {
        die(format_args!("stack overflow, cfsr {cfsr:08x}"));
    }
    // SAFETY: the frame is within the stack and aligned by the processor.
    let Frame { lr, pc, .. } = unsafe { frame.read() };
    die(format_args!("fault at pc {pc:08x} lr {lr:08x} cfsr {cfsr:08x} bfar {bfar:08x}"))
}
