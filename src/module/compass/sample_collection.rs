//! Start, end and continuation of a collection.

use super::activity::{Activity, CollectionStarter};
use super::trial_solves::TrialSolves;
use crate::compass::state::Compass;
use crate::compass::trial_solves::TrialResult;
use crate::messages::Refusal;
use autoswing::calibration::method_selection::Procedure;
use autoswing::collection::{CollectionProblem, RecentSamples};

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
}
