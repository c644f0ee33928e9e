//! Independent watchdog of the STM32.

use autoswing_firmware::app::{self, watchdog};
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peri, pac};

/// Period of the watchdog, microseconds: longer than the longest interval between feedings, one missed check included,
/// even if the watchdog clock runs at 34 kHz instead of 32 kHz (data sheets of STM32L4 and STM32G4, LSI).
const PERIOD_US: u32 = 2_000_000;
const _: () = assert!(PERIOD_US as u64 * 32 > watchdog::MAX_FEED_INTERVAL_US * 34);

pub struct Watchdog(IndependentWatchdog<'static, IWDG>);

impl Watchdog {
    /// Starts the watchdog. If a boot loader has started it, this sets its period.
    pub fn start_watchdog(watchdog: Peri<'static, IWDG>) -> Self {
        let mut watchdog = IndependentWatchdog::new(watchdog, PERIOD_US);
        watchdog.unleash();
        // A reload before the new period is in force, 0.2 ms, would use the old one.
        while pac::IWDG.sr().read().0 != 0 {}
        watchdog.pet();
        Self(watchdog)
    }
}

impl app::Watchdog for Watchdog {
    fn feed(&mut self) {
        self.0.pet();
    }
}
