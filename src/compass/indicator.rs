//! Indicator state, for an LED.

use super::{Compass, ModuleState, TrialResult};
use crate::calibration::method_selection::Procedure;
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
            ModuleState::Uncalibrated => match self.last_outcome {
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
        match progress.procedure {
            Procedure::Turns => progress.left_turns.percent.midpoint(progress.right_turns.percent),
            Procedure::Level => progress.level_progress.percent,
            Procedure::Flight => {
                let expected_deg =
                    self.trial_solves.last_result.as_ref().and_then(|prospect: &TrialResult| prospect.expected_deg);
                // The cast saturates and maps NaN to 0.
                expected_deg.map_or(0, |deg| (100.0 * self.settings.accuracy_deg / deg).min(100.0) as u8)
            }
            Procedure::Swing | Procedure::Tumble => 0,
        }
    }
}
