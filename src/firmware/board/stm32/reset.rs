//! Reset cause from the reset flags.

use autoswing_firmware::health::ResetCause;
use embassy_stm32::pac;

use crate::board::panic_message;

/// Returns and clears the reset cause. Call once, first of all.
pub fn take_reset_cause() -> ResetCause {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|csr| csr.set_rmvf(true));
    let panic_message = panic_message::take_panic_report();
    // Brown-out is tested first, since memory is then undefined, the reset pin last, since every reset sets its flag.
    match panic_message {
        _ if flags.borrstf() => ResetCause::PowerOn,
        Some(report) => ResetCause::Panic(report),
        None if flags.iwdgrstf() || flags.wwdgrstf() => ResetCause::Watchdog,
        None if flags.sftrstf() => ResetCause::Software,
        None => ResetCause::Pin,
    }
}
