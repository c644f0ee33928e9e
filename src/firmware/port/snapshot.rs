//! Snapshot of the module's state.

use autoswing::calibration::{Calibration, HeadingUncertainty};
use autoswing::heading::{Heading, NoHeading};
use autoswing::instrument::Estimate;
use autoswing::time::Timestamp;
use autoswing_module::compass::IndicatorState;
use autoswing_module::settings::{HeadingKind, Settings};

/// Snapshot of the module's state, from which messages are made.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot<'a> {
    /// Current time; never earlier than the time of the estimate.
    pub now: Timestamp,
    /// Latest estimate.
    pub estimate: &'a Estimate,
    /// Effective settings; a declination that was not entered is the field model's, if known.
    pub settings: &'a Settings,
    /// State of collection and calibration, as the indicator shows it.
    pub indicator_state: IndicatorState,
    /// Active calibration with its heading uncertainty; may be none if it was already reported.
    pub calibration: Option<&'a (Calibration, HeadingUncertainty)>,
    /// Number of the module's node on a CAN bus.
    pub can_node: Option<u8>,
}

impl Snapshot<'_> {
    /// Heading to send, and its kind: the smoothed heading if it is selected and available, otherwise the raw one.
    pub fn selected_heading(&self) -> (Result<Heading, NoHeading>, HeadingKind) {
        match (self.settings.stream_heading, self.estimate.smoothed_heading) {
            (HeadingKind::Smooth, Some(smooth)) => (Ok(smooth), HeadingKind::Smooth),
            _ => (self.estimate.heading, HeadingKind::Raw),
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::port) fn test_snapshot<'a>(estimate: &'a Estimate, settings: &'a Settings) -> Snapshot<'a> {
        Snapshot {
            now: estimate.timestamp,
            estimate,
            settings,
            indicator_state: IndicatorState::Calibrated,
            calibration: None,
            can_node: None,
        }
    }
}
