//! The board's lamp and button: state visible from afar, and calibration without a console.
//!
//! | lamp | state |
//! |---|---|
//! | a short flash every two seconds | uncalibrated, no collection |
//! | lit for a part of each second | collecting: longer with progress |
//! | lit, a short break every two seconds | calibrated |
//! | five flashes a second | fault: no sensor, no attitude, or the last solve was refused; `status` names it |
//!
//! The lamp of a running module always changes. Holding the button for two seconds is `cal start`.

use embassy_time::{Duration, Ticker};

use super::task_links::CommandSource;
use crate::app::task_links::TaskLinks;
use autoswing::calibration::method_selection::Procedure;
use autoswing::heading::NoHeading;
use autoswing_module::compass::{Command, IndicatorState};

/// Lamp and button of a board.
pub trait Panel {
    /// Switches the lamp on or off.
    fn set_lamp(&mut self, on: bool);

    /// Whether the button is pressed; false without a button.
    fn is_pressed(&self) -> bool;
}

/// Polling period of lamp and button, milliseconds; longer than the contact bounces.
const POLL_PERIOD_MS: u16 = 50;

/// Hold time of the button, milliseconds; long enough to exclude accidents.
const BUTTON_HOLD_MS: u16 = 2000;

/// Period of the lamp's patterns, milliseconds.
const PATTERN_PERIOD_MS: u16 = 2000;

const SHORT_FLASH_MS: u16 = 100;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LampPattern {
    Indicator(IndicatorState),
    Fault,
}

impl LampPattern {
    /// Whether the lamp is lit at a time within the pattern, milliseconds.
    fn is_lit(self, pattern_ms: u16) -> bool {
        match self {
            Self::Indicator(IndicatorState::Idle) => pattern_ms < SHORT_FLASH_MS,
            Self::Indicator(IndicatorState::Collecting(percent)) => {
                // The lamp is lit for at least a tenth and at most nine tenths of each second.
                pattern_ms % 1000 < u16::from(percent.clamp(10, 90)) * 10
            }
            Self::Indicator(IndicatorState::Calibrated) => pattern_ms >= SHORT_FLASH_MS,
            Self::Indicator(IndicatorState::Refused) | Self::Fault => (pattern_ms / SHORT_FLASH_MS).is_multiple_of(2),
        }
    }
}

/// Drives the lamp and polls the button for ever.
pub async fn run_panel(links: &TaskLinks, mut panel: impl Panel) -> ! {
    let mut ticker = Ticker::every(Duration::from_millis(POLL_PERIOD_MS.into()));
    let (mut ms, mut held_ms) = (0, 0);
    loop {
        ticker.next().await;
        panel.set_lamp(select_pattern(links).is_lit(ms));
        ms = (ms + POLL_PERIOD_MS) % PATTERN_PERIOD_MS;
        let before_ms = held_ms;
        held_ms = if panel.is_pressed() { (held_ms + POLL_PERIOD_MS).min(BUTTON_HOLD_MS) } else { 0 };
        if held_ms == BUTTON_HOLD_MS && before_ms < BUTTON_HOLD_MS {
            let _ = links.commands.try_send((CommandSource::Button, Command::CalStart(Procedure::Flight)));
        }
    }
}

/// Selects the pattern. A missing heading is a fault, unless only the calibration is missing. Missing attitude is a
/// fault in an uncalibrated module that collects nothing.
fn select_pattern(links: &TaskLinks) -> LampPattern {
    let indicator_state = links.indicator_state.try_get().unwrap_or(IndicatorState::Idle);
    let has_no_fault = links.estimates.try_get().is_some_and(|estimate| match estimate.heading {
        Ok(_) => true,
        Err(reason) => {
            reason == NoHeading::Uncalibrated
                && (estimate.attitude.is_some() || indicator_state != IndicatorState::Idle)
        }
    });
    if has_no_fault { LampPattern::Indicator(indicator_state) } else { LampPattern::Fault }
}
