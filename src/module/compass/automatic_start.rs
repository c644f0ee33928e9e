//! Automatic collection: an uncalibrated module starts collecting in flight.

use super::activity::{Activity, CollectionStarter};
use crate::compass::state::Compass;
use autoswing::calibration::method_selection::Procedure;

/// Number of samples (5 s) after which no armed state is expected; autopilots send heartbeats at 1 Hz.
const ARMED_STATE_TIMEOUT_SAMPLES: u8 = 50;

impl Compass<'_> {
    /// Starts a collection if enabled and the vehicle is armed, because before arming it may be carried or stand near
    /// iron.
    pub(super) fn start_automatic_collection(&mut self) {
        self.automatic_start.samples_since_startup =
            self.automatic_start.samples_since_startup.saturating_add(1).min(ARMED_STATE_TIMEOUT_SAMPLES);
        let is_ready = self.pending_save.is_none() && self.sensor.is_some();
        if self.is_assumed_armed() && is_ready && self.wants_automatic_collection() {
            self.start_collection(Procedure::Flight, CollectionStarter::Module);
        }
    }

    /// Whether the vehicle is armed, or the armed state is unavailable.
    fn is_assumed_armed(&self) -> bool {
        self.armed_state
            .reported_state()
            .unwrap_or(self.automatic_start.samples_since_startup == ARMED_STATE_TIMEOUT_SAMPLES)
    }

    /// Whether automatic collection waits for arming.
    pub(super) fn awaits_arming(&self) -> bool {
        self.armed_state.reported_state() == Some(false)
            && (self.activity.is_automatic() || self.wants_automatic_collection())
    }

    fn wants_automatic_collection(&self) -> bool {
        matches!(self.activity, Activity::Idle)
            && self.settings.auto_on
            && !self.automatic_start.is_overridden
            && self.active_record().is_none()
    }

    /// Whether a collection stores no samples: an automatic one while disarmed, and after a restart until the armed
    /// state is known.
    pub(super) fn is_paused(&self, starter: CollectionStarter) -> bool {
        starter == CollectionStarter::Module && !self.is_assumed_armed()
    }

    /// Returns control to the module, for `cal auto` and `cal clear`.
    pub(super) fn enable_automatic_start(&mut self, is_enabled: bool) {
        self.automatic_start.is_overridden = false;
        if !is_enabled && self.activity.is_automatic() {
            self.discard_collection();
        }
    }
}
