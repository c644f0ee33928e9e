//! The end of a run: a panic or a fault leaves a message in memory that survives the reset, for the next start to show.

use core::cell::UnsafeCell;
use core::fmt::{self, Write};
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use super::stack;
use cortex_m::peripheral::SCB;
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};

/// The longest message, as `ResetCause` takes it.
const CAPACITY: usize = 96;
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// A message with its CRC: after power-on the memory holds anything.
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
        // Inverted, so that memory full of zeros is no message.
        !digest.finalize()
    }

    /// The message, if one was left.
    fn text(&self) -> Option<heapless::String<CAPACITY>> {
        let text = self.text.get(..self.length).filter(|text| !text.is_empty() && self.crc == self.checksum())?;
        heapless::String::try_from(core::str::from_utf8(text).ok()?).ok()
    }
}

impl Write for Message {
    /// Takes what fits; replaces all but printable ASCII, so that the end can be anywhere.
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

/// Memory that the start-up code leaves alone.
struct Kept(UnsafeCell<MaybeUninit<Message>>);

// SAFETY: written only by `die`, with interrupts off, and by `take`, before there are tasks or interrupts.
unsafe impl Sync for Kept {}

#[unsafe(link_section = ".uninit.last_words")]
static LAST_WORDS: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

/// Leaves a message and resets.
fn die(message: fmt::Arguments<'_>) -> ! {
    cortex_m::interrupt::disable();
    let mut words = Message::EMPTY;
    // Writing into a message takes what fits and never fails.
    let _ = words.write_fmt(message);
    words.crc = words.checksum();
    // SAFETY: interrupts are off, so nothing else accesses it (see `Kept`). Volatile, because nothing reads it in this
    // run.
    unsafe { LAST_WORDS.0.get().write_volatile(MaybeUninit::new(words)) };
    SCB::sys_reset()
}

/// Takes the message of the run before and forgets it. To be called once, first of all.
pub fn take() -> Option<heapless::String<CAPACITY>> {
    // SAFETY: nothing else accesses it yet (see `Kept`). Any bytes are valid for the integers of a `Message`; they are
    // memory, only of an earlier run.
    let words = unsafe { LAST_WORDS.0.get().read_volatile().assume_init() };
    // SAFETY: as above.
    unsafe { LAST_WORDS.0.get().write_volatile(MaybeUninit::new(Message::EMPTY)) };
    words.text()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    let message = info.message();
    match info.location() {
        // The end of the path is what tells most; a message that does not fit loses its own end.
        Some(place) => {
            let path = place.file();
            // Bytes, for a search among characters is half a kilobyte of flash.
            let file =
                path.bytes().rposition(|byte| byte == b'/').and_then(|slash| path.get(slash + 1..)).unwrap_or(path);
            die(format_args!("{file}:{} {message}", place.line()))
        }
        None => die(format_args!("{message}")),
    }
}

/// A fault, as the processor calls it: an access to nowhere, an undefined instruction. All kinds end here.
///
/// The stack pointer may be past the end of the stack, where a handler cannot run: it is set back first, to the start;
/// what was there is not needed any more. Should the processor not even get here then, the watchdog resets it.
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

/// What the processor pushes when it takes an exception.
#[repr(C)]
struct Frame {
    r0_to_r3: [u32; 4],
    r12: u32,
    lr: u32,
    pc: u32,
    xpsr: u32,
}

extern "C" fn report_fault(frame: *const Frame) -> ! {
    // SAFETY: the System Control Block is always there, and these registers have no side effects.
    let scb = unsafe { &*SCB::PTR };
    let (cfsr, bfar) = (scb.cfsr.read(), scb.bfar.read());
    if !stack::holds(frame) {
        die(format_args!("stack overflow, cfsr {cfsr:08x}"));
    }
    // SAFETY: the frame is within the stack's memory and aligned as the processor aligns it.
    let Frame { lr, pc, .. } = unsafe { frame.read() };
    die(format_args!("fault at pc {pc:08x} lr {lr:08x} cfsr {cfsr:08x} bfar {bfar:08x}"))
}
