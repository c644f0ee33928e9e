//! Why the module started.

use autoswing::health::ResetCause;
use embassy_stm32::pac;

use crate::board::last_words;

/// To be called once, first of all: it forgets the answer.
pub fn cause() -> ResetCause {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|csr| csr.set_rmvf(true));
    let last_words = last_words::take();
    // Power-on and brown-out first, for then memory is undefined. The reset pin last: every reset pulls it.
    match last_words {
        _ if flags.borrstf() => ResetCause::PowerOn,
        Some(text) => ResetCause::Panic(text),
        None if flags.iwdgrstf() || flags.wwdgrstf() => ResetCause::Watchdog,
        None if flags.sftrstf() => ResetCause::Software,
        None => ResetCause::Pin,
    }
}
