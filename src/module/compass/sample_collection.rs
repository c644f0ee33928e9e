//! Start, end and continuation of a collection, by command or automatically: an uncalibrated module starts collecting in
//! flight.

use super::activity::{Activity, CollectionStarter};
use super::trial_solves::TrialSolves;
use crate::compass::state::Compass;
use crate::compass::trial_solves::TrialResult;
use crate::messages::Refusal;
use autoswing::calibration::method_selection::Procedure;
use autoswing::collection::{CollectionProblem, RecentSamples};

/// Number of samples (5 s) after which no armed state is expected; autopilots send heartbeats at 1 Hz.
const ARMED_STATE_TIMEOUT_SAMPLES: u8 = 50;

impl Compass<'_> {
    /// Starts a collection, or takes over an automatic one unless `discards_previous`.
    pub(super) fn start_by_command(&mut self, procedure: Procedure, discards_previous: bool) -> Result<(), Refusal> {
        self.sensor.ok_or(Refusal::NoSensor)?;
        match self.activity {
            Activity::Collecting(CollectionStarter::User) if !discards_previous => {
                return Err(Refusal::Collecting {
                    present_procedure: self.collector.procedure(),
                    requested_procedure: procedure,
                });
            }
            Activity::Collecting(CollectionStarter::Module)
                if !discards_previous && procedure == self.collector.procedure() =>
            {
                self.activity = Activity::Collecting(CollectionStarter::User);
            }
            _ => self.start_collection(procedure, CollectionStarter::User),
        }
        self.automatic_start.is_overridden = true;
        Ok(())
    }

    pub(super) fn start_collection(&mut self, procedure: Procedure, starter: CollectionStarter) {
        self.collector.begin_procedure(procedure);
        self.recent_samples = RecentSamples::new();
        self.trial_solves = TrialSolves::NO_TRIALS;
        self.activity = Activity::Collecting(starter);
    }

    /// Aborts all activity and discards the samples.
    pub(super) fn discard_collection(&mut self) {
        self.collector.discard_collection();
        self.trial_solves = TrialSolves::NO_TRIALS;
        self.activity = Activity::Idle;
    }

    /// Continues collecting after a solve, or instead of a trial solve.
    pub(super) fn resume_collection(&mut self, starter: CollectionStarter) {
        for sample in &self.samples_during_solve {
            self.collector.push_sample(*sample);
        }
        self.samples_during_solve.clear();
        self.activity = Activity::Collecting(starter);
        self.collector.reset_restart_count();
    }

    /// Known reason for missing or insufficient samples.
    pub(super) fn sample_deficiency(&self) -> Option<CollectionProblem> {
        self.collector
            .collection_problem()
            .or_else(|| self.trial_solves.last_result.as_ref().and_then(TrialResult::missing_manoeuvre_reason))
    }

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

    /// Returns control to the module, for `set auto` and `cal clear`.
    pub(super) fn enable_automatic_start(&mut self, is_enabled: bool) {
        self.automatic_start.is_overridden = false;
        if !is_enabled && self.activity.is_automatic() {
            self.discard_collection();
        }
    }
}
