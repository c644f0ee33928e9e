//! Automatic collection: an uncalibrated module starts collecting in flight.

use super::Activity;
use super::Compass;
use crate::calibration::method_selection::Procedure;

/// Samples (5 s) after which no armed state is expected; autopilots send heartbeats at 1 Hz.
const ARMED_STATE_TIMEOUT_SAMPLES: u8 = 50;

/// Control of automatic collection.
#[derive(Clone, Copy, Debug)]
pub(super) struct AutomaticCollection {
    /// The present collection started automatically.
    pub is_active: bool,
    /// A user has taken control: no automatic start.
    pub is_overridden: bool,
    /// Samples since start-up, saturating at the timeout.
    samples_since_start: u8,
}

impl AutomaticCollection {
    pub const NEW: Self = Self { is_active: false, is_overridden: false, samples_since_start: 0 };
}

impl Compass<'_> {
    /// Starts a collection if enabled and the vehicle is armed, because before arming it may be carried or stand near
    /// iron.
    pub(super) fn start_automatic_collection(&mut self) {
        self.automatic.samples_since_start =
            self.automatic.samples_since_start.saturating_add(1).min(ARMED_STATE_TIMEOUT_SAMPLES);
        let is_idle = matches!(self.phase, Activity::Idle) && self.saving.is_none() && self.sensor.is_some();
        if self.is_assumed_armed() && is_idle && self.wants_automatic_collection() {
            self.start_collection(Procedure::Flight);
            self.automatic.is_active = true;
        }
    }

    /// Whether the vehicle is armed, or the armed state is unavailable.
    fn is_assumed_armed(&self) -> bool {
        self.is_armed.unwrap_or(self.automatic.samples_since_start == ARMED_STATE_TIMEOUT_SAMPLES)
    }

    /// Whether automatic collection waits for arming.
    pub(super) fn awaits_arming(&self) -> bool {
        let wants =
            self.automatic.is_active || matches!(self.phase, Activity::Idle) && self.wants_automatic_collection();
        wants && self.is_armed == Some(false)
    }

    fn wants_automatic_collection(&self) -> bool {
        self.settings.auto_on && !self.automatic.is_overridden && self.active_record().is_none()
    }

    /// Whether to store samples. An automatic collection pauses while disarmed, and after a restart until the armed
    /// state is known.
    pub(super) fn accepts_samples(&self) -> bool {
        matches!(self.phase, Activity::Collecting) && (!self.automatic.is_active || self.is_assumed_armed())
    }

    pub(super) fn give_control_to_user(&mut self) {
        self.automatic.is_active = false;
        self.automatic.is_overridden = true;
    }

    /// Returns control to the module, for `cal auto` and `cal clear`.
    pub(super) fn return_control(&mut self, auto_on: bool) {
        self.automatic.is_overridden = false;
        if !auto_on && self.automatic.is_active {
            self.discard_collection();
        }
    }
}
