//! State machine of the module: uncalibrated, collecting, solving, verifying, calibrated. A collection of turns ends
//! when complete; a collection in flight runs trial solves and ends when accurate enough.
//!
//! [`Compass::process_event`] takes an [`Event`] and returns an [`Effect`], without blocking or hardware access. A solve is
//! divided into [`Event::AdvanceSolve`] steps, so that its driver can do other work in between. A candidate calibration
//! becomes active after passing [`acceptance`](autoswing::acceptance) and being completely saved.
//!
//! | room | content |
//! |---|---|
//! | `events`, `activity` | inputs and outputs; collection, solve or neither |
//! | `storage` | settings, calibrations and values for the next start; the save in progress |
//! | `armed_state`, `trial_solves/` | evidence for flight and rest; schedule and results of trial solves |
//! | `state` | [`Compass`], composed of these, and values derived from more than one of them |
//! | `command_admission`, `sample_collection`, `solving`, `reference_heading` | its changes by commands and samples |

mod activity;
mod armed_state;
mod command_admission;
mod events;
mod reference_heading;
mod sample_collection;
mod solving;
mod state;
mod storage;
mod trial_solves;

pub use events::{
    AutopilotAction, CalibrationSummary, Command, Effect, Event, IndicatorState, ModuleState, Reply, StatusReport,
};
pub use state::Compass;
pub use trial_solves::{TrialResult, TrialSchedule};

use crate::messages::{ExpectedAccuracy, Message, Refusal};
use crate::settings::{DependentState, Settings};
use crate::store::{StoreError, StoredValues};
use activity::{Activity, CollectionStarter, DetectedSensor, Solve, SolvePurpose, SolveStage};
use armed_state::ArmedState;
use autoswing::attitude::AttitudeSource;
use autoswing::calibration::Sample;
use autoswing::calibration::method_selection::Procedure;
use autoswing::collection::{CollectionState, Collector, RecentSamples, RetainedSamples};
use autoswing::earth::LocalField;
use autoswing::inertial::SensorOffsets;
use autoswing::time::WrappingMillis;
use storage::{PendingSave, Storage};
use trial_solves::TrialSolves;

impl<'a> Compass<'a> {
    /// Creates the initial state from flash and from samples retained in RAM. Not inlined, to limit the stack.
    #[must_use]
    #[inline(never)]
    pub fn new(stored: &StoredValues, retained: &'a mut RetainedSamples) -> Self {
        let current = stored.stored_calibrations.current_calibration.as_ref();
        let mut compass = Self {
            storage: Storage::new(stored),
            sensor: None,
            has_inertial_sensor: false,
            sensor_offsets: current.map_or(SensorOffsets::UNKNOWN, |record| record.sensor_offsets),
            armed_state: ArmedState::UNKNOWN,
            local_field: LocalField::UNKNOWN,
            collector: Collector::new(retained),
            recent_samples: RecentSamples::new(),
            activity: Activity::Idle,
            samples_during_solve: heapless::Vec::new(),
            last_collection_outcome: None,
            advice: None,
            trial_solves: TrialSolves::NO_TRIALS,
            is_automatic_start_overridden: false,
        };
        compass.restore_collection();
        compass
    }

    /// Samples of the last collection, for replay on a host.
    #[cfg(not(target_os = "none"))]
    #[must_use]
    pub const fn collector(&self) -> &Collector<'a> {
        &self.collector
    }

    /// Processes an event.
    ///
    /// Large methods are not inlined, so that their locals do not add to the solver's stack.
    pub fn process_event(&mut self, event: Event) -> Effect {
        let effect = self.dispatch_event(event);
        self.update_retained_checksum();
        effect
    }

    fn dispatch_event(&mut self, event: Event) -> Effect {
        match event {
            Event::SensorDetected(identity, readings_per_sample) => {
                self.sensor = Some(DetectedSensor { identity, readings_per_sample });
                Effect::None
            }
            Event::ArmedStateReported(reported) => {
                self.armed_state.update_reported(reported);
                Effect::None
            }
            Event::Position(place, at) => {
                self.local_field.update_position(at, place, self.position_context(at));
                Effect::None
            }
            Event::Date(day) => {
                self.local_field.update_date(day, self.calibrated_inclination_deg());
                Effect::None
            }
            Event::Sample(sample) => self.on_sample(sample),
            Event::Command(command, now) => match self.on_command(command, now) {
                Ok(effect) => effect,
                Err(refusal) => Effect::Reply(Err(refusal)),
            },
            Event::AdvanceSolve => self.advance_solve(),
            Event::Saved(result) => self.on_saved(result),
            Event::ProtocolsDetected(detected, now) => {
                let is_solving = matches!(self.activity, Activity::Solving(_));
                self.storage.save_startup_values(&self.collector, is_solving, detected, now)
            }
        }
    }

    #[inline(never)]
    fn on_sample(&mut self, sample: Sample) -> Effect {
        self.recent_samples.push_sample(sample);
        self.armed_state.update_motion(&sample);
        self.start_automatic_collection();
        // An automatic collection stores no samples while disarmed, and after a restart until the armed state is known.
        let is_armed = self.armed_state.is_assumed_armed();
        let Some(starter) = self.activity.starter().filter(|starter| is_armed || *starter == CollectionStarter::User)
        else {
            return Effect::None;
        };
        if let Activity::Solving(Solve { purpose, .. }) = self.activity {
            let is_held = self.samples_during_solve.push(sample).is_ok();
            if is_held || !matches!(purpose, SolvePurpose::Trial(_)) {
                return Effect::None;
            }
            self.resume_collection(starter);
        }
        self.collector.push_sample(sample);
        self.update_retained_checksum();
        let purpose = if self.collector.collection_progress().is_complete() {
            SolvePurpose::Calibration(Some(starter))
        } else if self.collector.procedure() == Procedure::Flight
            && self.trial_solves.start_trial_if_due(&self.collector, sample.time)
        {
            SolvePurpose::Trial(starter)
        } else {
            return Effect::None;
        };
        match self.start_solving(None, purpose) {
            Ok(()) => Effect::None,
            Err(refusal) => self.end_solve(purpose, Err(refusal)),
        }
    }

    #[inline(never)]
    fn on_command(&mut self, command: Command, now: WrappingMillis) -> Result<Effect, Refusal> {
        self.admit_command(command, now)?;
        match command {
            Command::CalStart(procedure) => self.start_by_command(procedure, false)?,
            Command::CalStartNew(procedure) => {
                self.start_by_command(procedure.unwrap_or(self.collector.procedure()), true)?;
            }
            Command::CalMark(heading_deg) => return self.mark_heading(heading_deg, now),
            Command::CalStop => {
                let Activity::Collecting(_) = self.activity else { return Err(Refusal::NotCollecting) };
                self.activity = Activity::Idle;
                self.collector.set_state(CollectionState::Stopped);
                self.is_automatic_start_overridden = true;
            }
            Command::CalSolve(method) => {
                self.start_solving(method, SolvePurpose::Calibration(self.activity.starter()))
                    .map_err(|refusal| refusal.with_cause(self.sample_deficiency()))?;
            }
            Command::CalAdvise => {
                return self.advice.map(|advice| Effect::Reply(Ok(Reply::Advice(advice)))).ok_or(Refusal::NotSolved);
            }
            Command::CalAbort => {
                self.discard_collection();
                self.is_automatic_start_overridden = true;
            }
            Command::CalClear => return Ok(self.storage.request_save(PendingSave::Clear)),
            Command::CalUndo => return self.storage.request_undo(),
            Command::Status | Command::StatusAll | Command::CalShow => {
                return Ok(Effect::Reply(Ok(Reply::Report(self.status_report()))));
            }
            Command::Set(setting) | Command::SetFromBus(setting) => {
                let settings = self.stored_settings().with_setting(setting).map_err(Refusal::OutOfRange)?;
                let source = settings.attitude_source;
                let needs_sensor =
                    source != self.stored_settings().attitude_source && source != AttitudeSource::Autopilot;
                if needs_sensor && !self.has_inertial_sensor {
                    return Err(Refusal::NoInertialSensor);
                }
                if setting.affects(DependentState::AutomaticStart) && settings.auto_on {
                    self.enable_automatic_start(true);
                }
                return Ok(self.storage.request_save(PendingSave::Settings(settings)));
            }
            Command::ResetSettings => {
                self.enable_automatic_start(Settings::DEFAULT.auto_on);
                let settings = self.stored_settings().factory_reset();
                return Ok(self.storage.request_save(PendingSave::Settings(settings)));
            }
            Command::Align(heading_deg) => return self.set_alignment(heading_deg, false, now),
            Command::AlignConfirmed(heading_deg) => return self.set_alignment(Some(heading_deg), true, now),
            Command::KeepReplacedNumber(replaced) => {
                let mut settings = *self.stored_settings();
                settings.replaced_numbers = settings.replaced_numbers.with_number(replaced);
                return Ok(self.storage.request_save(PendingSave::Settings(settings)));
            }
            Command::Autopilot(_) => {}
            Command::Restart => self.collector.reset_restart_count(),
        }
        Ok(Effect::Reply(Ok(Reply::Done(self.module_state()))))
    }

    #[inline(never)]
    fn on_saved(&mut self, result: Result<(), StoreError>) -> Effect {
        if let Activity::Solving(Solve { stage: SolveStage::Saving(record), purpose, .. }) = &self.activity {
            let purpose = *purpose;
            let outcome = result.map_err(Refusal::Store).map(|()| {
                self.storage.accept_calibration(record);
                ExpectedAccuracy::new(record.quality, &record.calibration)
            });
            return self.end_solve(purpose, outcome);
        }
        let was_auto_on = self.stored_settings().auto_on;
        match (self.storage.end_save(result.is_ok()), result) {
            // A save without a command has no reply and no retry. Headings continue, so only this message shows the
            // failure.
            (Some(PendingSave::StartupValues), Err(error @ StoreError::Timeout)) => {
                Effect::Notify(Message::StoreFailed(error))
            }
            (None | Some(PendingSave::StartupValues), _) => Effect::None,
            (_, Err(error)) => Effect::Reply(Err(Refusal::Store(error))),
            (Some(saved), Ok(())) => {
                let auto_on = self.stored_settings().auto_on;
                if matches!(saved, PendingSave::Clear) || (was_auto_on && !auto_on) {
                    self.enable_automatic_start(auto_on);
                }
                Effect::Reply(Ok(Reply::Done(self.module_state())))
            }
        }
    }

    fn status_report(&self) -> StatusReport {
        let StoredValues { settings, stored_calibrations, .. } = self.storage.values();
        StatusReport {
            module_state: self.module_state(),
            is_armed: self.armed_state.reported_state(),
            is_automatic: self.activity.is_automatic(),
            awaits_arming: self.awaits_arming(),
            collection_progress: self.collector.collection_progress(),
            last_trial: self.trial_solves.last_result().cloned(),
            settings: *settings,
            local_field: self.local_field,
            stored_calibration: stored_calibrations.current_calibration.as_ref().map(CalibrationSummary::from),
            can_undo: stored_calibrations.previous_calibration.is_some(),
            last_collection_outcome: self.last_collection_outcome.clone(),
            sample_loss: None,
        }
    }
}

#[cfg(test)]
mod tests;
