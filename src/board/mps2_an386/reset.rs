//! Why the module started: the machine does not tell, memory that survives a reset does.

use core::sync::atomic::{AtomicU32, Ordering};

use autoswing::health::ResetCause;

use crate::board::last_words;

/// What is found here at a start; anything else: the power was off.
const RUNS: u32 = 0x5157_1A6E;
const REBOOTS: u32 = 0x0B00_7ED0;

#[unsafe(link_section = ".uninit.state")]
static STATE: AtomicU32 = AtomicU32::new(0);

/// To be called once, first of all: it forgets the answer.
pub fn cause() -> ResetCause {
    let before = STATE.swap(RUNS, Ordering::Relaxed);
    match (last_words::take(), before) {
        (Some(text), RUNS) => ResetCause::Panic(text),
        (_, REBOOTS) => ResetCause::Software,
        (_, RUNS) => ResetCause::Pin,
        _ => ResetCause::PowerOn,
    }
}

/// The next start is a reboot.
pub fn announce_reboot() {
    STATE.store(REBOOTS, Ordering::Relaxed);
}
