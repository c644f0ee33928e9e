//! Reset cause, stored in RAM that survives a reset, since the machine has no reset flags.

use core::sync::atomic::{AtomicU32, Ordering};

use autoswing_firmware::health::ResetCause;

use crate::board::panic_message;

/// Stored state of a running firmware; a value that is no state means power-on.
const STATE_RUNNING: u32 = 0x5157_1A6E;
/// Stored state of a restart by command.
const STATE_REBOOTING: u32 = 0x0B00_7ED0;

#[unsafe(link_section = ".uninit.state")]
static RESET_STATE: AtomicU32 = AtomicU32::new(0);

/// Returns and clears the reset cause. Call it once, before all other code.
pub fn take_reset_cause() -> ResetCause {
    let before = RESET_STATE.swap(STATE_RUNNING, Ordering::Relaxed);
    match (panic_message::take_panic_report(), before) {
        (Some(report), STATE_RUNNING) => ResetCause::Panic(report),
        (_, STATE_REBOOTING) => ResetCause::Software,
        (_, STATE_RUNNING) => ResetCause::Pin,
        _ => ResetCause::PowerOn,
    }
}

/// Marks the next start as a reboot.
pub fn announce_reboot() {
    RESET_STATE.store(STATE_REBOOTING, Ordering::Relaxed);
}
