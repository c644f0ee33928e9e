//! State machine of the module: uncalibrated, collecting, solving, verifying, calibrated. A collection of turns ends
//! when complete; a collection in flight runs trial solves and ends when accurate enough.
//!
//! [`Compass::process_event`] takes an [`Event`] and returns an [`Effect`], without blocking or hardware access. A solve is
//! divided into [`Event::AdvanceSolve`] steps, so that its driver can do other work in between. A candidate calibration
//! becomes active after passing [`acceptance`](autoswing::acceptance) and being completely saved.

mod activity;
mod armed_state;
mod command_admission;
mod events;
mod persistence;
mod reference_heading;
mod sample_collection;
mod solving;
mod state;
mod trial_solves;

pub use events::{
    AutopilotAction, CalibrationSummary, Command, Effect, Event, IndicatorState, ModuleState, Reply, StatusReport,
};
pub use state::Compass;
pub use trial_solves::{TrialResult, TrialSchedule};

use crate::messages::Refusal;
use crate::settings::{DependentState, Settings};
use crate::store::StoredValues;
use activity::{Activity, AutomaticStart, DetectedSensor, PendingSave, Solve, SolvePurpose};
use armed_state::ArmedState;
use autoswing::attitude::AttitudeSource;
use autoswing::calibration::Sample;
use autoswing::calibration::method_selection::Procedure;
use autoswing::collection::{CollectionState, Collector, RecentSamples, RetainedSamples};
use autoswing::earth::LocalField;
use autoswing::inertial::SensorOffsets;
use autoswing::time::WrappingMillis;
use state::PersistentState;
use trial_solves::TrialSolves;

impl<'a> Compass<'a> {
    /// Creates the initial state from flash and from samples retained in RAM. Not inlined, to limit the stack.
    #[must_use]
    #[inline(never)]
    pub fn new(stored: &StoredValues, retained: &'a mut RetainedSamples) -> Self {
        let StoredValues { settings, stored_calibrations, startup_values } = *stored;
        let mut compass = Self {
            settings,
            stored_calibrations,
            sensor: None,
            has_inertial_sensor: false,
            sensor_offsets: stored_calibrations
                .current_calibration
                .map_or(SensorOffsets::UNKNOWN, |record| record.sensor_offsets),
            armed_state: ArmedState::UNKNOWN,
            local_field: LocalField::UNKNOWN,
            collector: Collector::new(retained),
            recent_samples: RecentSamples::new(),
            activity: Activity::Idle,
            samples_during_solve: heapless::Vec::new(),
            pending_save: None,
            last_collection_outcome: None,
            advice: None,
            trial_solves: TrialSolves::NO_TRIALS,
            automatic_start: AutomaticStart::INITIAL,
            persistent_state: PersistentState::new(startup_values),
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
            Event::ProtocolsDetected(detected, now) => self.save_startup_values(detected, now),
        }
    }

    #[inline(never)]
    fn on_sample(&mut self, sample: Sample) -> Effect {
        self.recent_samples.push_sample(sample);
        self.armed_state.update_motion(&sample);
        self.start_automatic_collection();
        let Some(starter) = self.activity.starter().filter(|starter| !self.is_paused(*starter)) else {
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
                self.automatic_start.is_overridden = true;
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
                self.automatic_start.is_overridden = true;
            }
            Command::CalClear => return Ok(self.request_save(PendingSave::Clear)),
            Command::CalUndo => return self.restore_previous_calibration(),
            Command::Status | Command::StatusAll | Command::CalShow => {
                return Ok(Effect::Reply(Ok(Reply::Report(self.status_report()))));
            }
            Command::Set(setting) | Command::SetFromBus(setting) => {
                let settings = self.settings.with_setting(setting).map_err(Refusal::OutOfRange)?;
                let source = settings.attitude_source;
                let needs_sensor = source != self.settings.attitude_source && source != AttitudeSource::Autopilot;
                if needs_sensor && !self.has_inertial_sensor {
                    return Err(Refusal::NoInertialSensor);
                }
                if setting.affects(DependentState::AutomaticStart) && settings.auto_on {
                    self.enable_automatic_start(true);
                }
                return Ok(self.request_save(PendingSave::Settings(settings)));
            }
            Command::ResetSettings => {
                self.enable_automatic_start(Settings::DEFAULT.auto_on);
                return Ok(self.request_save(PendingSave::Settings(self.settings.factory_reset())));
            }
            Command::Align(heading_deg) => return self.set_alignment(heading_deg, false, now),
            Command::AlignConfirmed(heading_deg) => return self.set_alignment(Some(heading_deg), true, now),
            Command::KeepReplacedNumber(replaced) => {
                let replaced_numbers = self.settings.replaced_numbers.with_number(replaced);
                return Ok(self.request_save(PendingSave::Settings(Settings { replaced_numbers, ..self.settings })));
            }
            Command::Autopilot(_) => {}
            Command::Restart => self.collector.reset_restart_count(),
        }
        Ok(Effect::Reply(Ok(Reply::Done(self.module_state()))))
    }

    fn status_report(&self) -> StatusReport {
        StatusReport {
            module_state: self.module_state(),
            is_armed: self.armed_state.reported_state(),
            is_automatic: self.activity.is_automatic(),
            awaits_arming: self.awaits_arming(),
            collection_progress: self.collector.collection_progress(),
            last_trial: self.trial_solves.last_result.clone(),
            settings: self.settings,
            local_field: self.local_field,
            stored_calibration: self.stored_calibrations.current_calibration.as_ref().map(CalibrationSummary::from),
            can_undo: self.stored_calibrations.previous_calibration.is_some(),
            last_collection_outcome: self.last_collection_outcome.clone(),
            sample_loss: None,
        }
    }
}

#[cfg(test)]
mod tests;
