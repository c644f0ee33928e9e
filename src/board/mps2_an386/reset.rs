//! Reset cause, stored in RAM that survives a reset, since the machine has no reset flags.

use core::sync::atomic::{AtomicU32, Ordering};

use autoswing::health::ResetCause;

use crate::board::last_words;

/// Values of the stored state; any other value means power-on.
const RUNS: u32 = 0x5157_1A6E;
const REBOOTS: u32 = 0x0B00_7ED0;

#[unsafe(link_section = ".uninit.state")]
static STATE: AtomicU32 = AtomicU32::new(0);

/// Returns and clears the reset cause. Call it once, before all other code.
pub fn cause() -> ResetCause {
    let before = STATE.swap(RUNS, Ordering::Relaxed);
    match (last_words::take(), before) {
        (Some(report), RUNS) => ResetCause::Panic(report),
        (_, REBOOTS) => ResetCause::Software,
        (_, RUNS) => ResetCause::Pin,
        _ => ResetCause::PowerOn,
    }
}

/// Marks the next start as a reboot.
pub fn announce_reboot() {
    STATE.store(REBOOTS, Ordering::Relaxed);
}
