//! Start, end and continuation of a collection, by command, automatically or after a restart: an uncalibrated module
//! starts collecting in flight.

use super::activity::{Activity, CollectionStarter};
use super::trial_solves::TrialSolves;
use crate::compass::state::Compass;
use crate::messages::{Message, Refusal};
use autoswing::calibration::method_selection::Procedure;
use autoswing::collection::{CollectionContext, CollectionProblem, CollectionState, RecentSamples};

impl Compass<'_> {
    /// Resumes a collection that survived the restart, or detects that one was lost.
    pub(super) fn restore_collection(&mut self) {
        match self.collector.restored_context() {
            // Only a collection saved under the present calibration continues. With another serial number, its solve
            // has produced the present calibration.
            Some(CollectionContext { is_automatic: was_automatic, calibration_serial: serial })
                if serial == self.storage.calibration_serial() =>
            {
                match self.collector.collection_state() {
                    CollectionState::Running => {
                        let starter = if was_automatic { CollectionStarter::Module } else { CollectionStarter::User };
                        self.activity = Activity::Collecting(starter);
                        self.is_automatic_start_overridden = !was_automatic;
                    }
                    CollectionState::Stopped => self.is_automatic_start_overridden = true,
                    CollectionState::Inactive => {}
                }
            }
            Some(_) => self.collector.discard_collection(),
            None if self.storage.values().startup_values.is_collecting => {
                self.last_collection_outcome = Some(Message::CollectionLost);
            }
            None => {}
        }
    }

    /// Updates the checksum of the retained collection.
    pub(super) fn update_retained_checksum(&mut self) {
        self.collector.update_header(CollectionContext {
            is_automatic: self.activity.is_automatic(),
            calibration_serial: self.storage.calibration_serial(),
        });
    }

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
        self.is_automatic_start_overridden = true;
        Ok(())
    }

    fn start_collection(&mut self, procedure: Procedure, starter: CollectionStarter) {
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
        self.collector.collection_problem().or_else(|| self.trial_solves.missing_manoeuvre())
    }

    /// Starts a collection if enabled and the vehicle is armed, because before arming it may be carried or stand near
    /// iron.
    pub(super) fn start_automatic_collection(&mut self) {
        let is_ready = self.pending_change().is_none() && self.sensor.is_some();
        if self.armed_state.is_assumed_armed() && is_ready && self.wants_automatic_collection() {
            self.start_collection(Procedure::Flight, CollectionStarter::Module);
        }
    }

    /// Whether automatic collection waits for arming.
    pub(super) fn awaits_arming(&self) -> bool {
        self.armed_state.reported_state() == Some(false)
            && (self.activity.is_automatic() || self.wants_automatic_collection())
    }

    fn wants_automatic_collection(&self) -> bool {
        matches!(self.activity, Activity::Idle)
            && self.stored_settings().auto_on
            && !self.is_automatic_start_overridden
            && self.active_record().is_none()
    }

    /// Returns control to the module, for `set auto` and `cal clear`.
    pub(super) fn enable_automatic_start(&mut self, is_enabled: bool) {
        self.is_automatic_start_overridden = false;
        if !is_enabled && self.activity.is_automatic() {
            self.discard_collection();
        }
    }
}
