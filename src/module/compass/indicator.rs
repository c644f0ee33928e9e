//! Indicator state, for an LED.

use crate::compass::events::ModuleState;
use crate::compass::state::Compass;
use crate::messages::Message;

/// Indicator state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IndicatorState {
    /// Uncalibrated, not collecting.
    Idle,
    /// Collecting; progress in percent.
    Collecting(u8),
    /// A calibration is active.
    Calibrated,
    /// Uncalibrated; the last solve was refused.
    Refused,
}

impl Compass<'_> {
    /// Indicator state of the module.
    #[must_use]
    pub fn indicator_state(&self) -> IndicatorState {
        match self.module_state() {
            ModuleState::Uncalibrated => match self.last_collection_outcome {
                Some(Message::Solved(Err(_))) => IndicatorState::Refused,
                // The next flight starts another collection, so the module is idle.
                _ => IndicatorState::Idle,
            },
            ModuleState::Collecting if self.awaits_arming() => IndicatorState::Idle,
            ModuleState::Collecting => IndicatorState::Collecting(self.progress_percent()),
            ModuleState::Solving | ModuleState::Verifying => IndicatorState::Collecting(100),
            ModuleState::Calibrated => IndicatorState::Calibrated,
        }
    }

    /// Progress, percent: in a flight, wanted over expected heading error; 0 for procedures that the user ends.
    fn progress_percent(&self) -> u8 {
        let progress = self.collector.collection_progress();
        let expected_error_deg = self.trial_solves.last_result.as_ref().and_then(|result| result.expected_error_deg);
        // The cast saturates and maps NaN to 0.
        let trial_percent = || Some((100.0 * self.settings.accuracy_deg / expected_error_deg?).min(100.0) as u8);
        progress.percent().or_else(trial_percent).unwrap_or(0)
    }
}
