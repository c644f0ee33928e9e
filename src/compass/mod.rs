//! State machine of the module: uncalibrated, collecting, solving, verifying, calibrated. A collection of turns ends
//! when complete; a collection in flight runs trial solves and ends when accurate enough.
//!
//! [`Compass::step`] takes an [`Event`] and returns an [`Effect`], without blocking or hardware access. A solve is
//! divided into [`Event::Advance`] steps, so that its driver can do other work in between. A candidate calibration
//! becomes active after passing [`acceptance`] and being completely saved.

mod admission;
mod automatic;
mod events;
mod indicator;
mod persistence;
#[cfg(test)]
mod tests;
mod trial_solves;

pub use events::{CalibrationSummary, Command, Effect, Event, ModuleState, Reply, StatusReport};
pub use indicator::IndicatorState;
pub use trial_solves::{TrialResult, TrialSchedule};

use crate::acceptance::{self, AcceptancePolicy, AcceptanceSamples, Incumbent};
use crate::calibration::method_selection::{self, Procedure, SelectedParts};
use crate::calibration::{
    Advice, Mark, Method, Prior, Sample, Samples, Solution, SolveError, SolveProgress as Solving, Solver,
};
use crate::collection::{
    CollectionProblem, CollectionState, Collector, MIN_HELD_BACK_WHEN_COMPLETE, RecentSamples, RetainedSamples,
};
use crate::earth::LocalField;
use crate::frames::wrap_pi;
use crate::instrument::{Correction, SampleAttitude};
use crate::messages::{ExpectedAccuracy, Message, Refusal, SolveOutcome};
use crate::reading::Identity;
use crate::settings::{OutOfRange, SettingChange, Settings};
use crate::store::{CalibrationRecord, Generations, StartupValues, StoreChange, StoreError, StoredValues};
use crate::time::WrappingMillis;
use automatic::AutomaticStart;
use persistence::PersistentState;
use trial_solves::TrialSolves;

const _: () = assert!(AcceptancePolicy::DEFAULT.min_held_back <= MIN_HELD_BACK_WHEN_COMPLETE);

/// Capacity for samples during a solve: 3 s, six times the duration of a solve at 80 MHz. A longer trial solve is ended.
const HELD_SAMPLES: usize = 32;

/// Largest alignment without confirmation, degrees: mountings are within 20 deg of a right angle.
const MAX_UNCONFIRMED_ALIGNMENT_DEG: f32 = 20.0;

/// Who started a collection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Starter {
    User,
    /// The module: the collection pauses while the vehicle is disarmed.
    Module,
}

#[expect(clippy::large_enum_variant, reason = "there is one of it, and no heap to put it on")]
#[derive(Debug)]
enum Activity {
    Idle,
    Collecting(Starter),
    Solving(Solve),
}

/// A solve, up to the save of its calibration.
#[derive(Debug)]
struct Solve {
    stage: SolveStage,
    purpose: SolvePurpose,
    /// Sensor at the start of the solve; the calibration is valid for it alone.
    sensor: DetectedSensor,
}

#[expect(clippy::large_enum_variant, reason = "there is one of it, and no heap to put it on")]
#[derive(Debug)]
enum SolveStage {
    Fitting(Solver),
    Verifying(Solution),
    /// Save of the accepted calibration.
    Saving(CalibrationRecord),
}

#[derive(Clone, Copy, Debug)]
enum SolvePurpose {
    /// Trial solve: the collection continues, unless the result ends it.
    Trial(Starter),
    /// Calibration from the samples of a collection, if one is in progress; a failure ends it unless it is automatic.
    Calibration(Option<Starter>),
}

impl Activity {
    /// Who started the collection in progress.
    const fn starter(&self) -> Option<Starter> {
        match self {
            Self::Idle => None,
            Self::Collecting(starter) => Some(*starter),
            Self::Solving(solve) => match solve.purpose {
                SolvePurpose::Trial(starter) => Some(starter),
                SolvePurpose::Calibration(starter) => starter,
            },
        }
    }

    fn is_automatic(&self) -> bool {
        self.starter() == Some(Starter::Module)
    }
}

/// Data of a save in progress, except that of a calibration.
#[derive(Debug)]
enum PendingSave {
    /// Swap of current and previous calibration.
    Undo,
    /// Removal of both calibrations.
    Clear,
    Settings(Settings),
    /// Values for the next start.
    Remembered(StartupValues),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct DetectedSensor {
    identity: Identity,
    readings_per_sample: u16,
}

/// State machine. About 4 KB; samples are in borrowed memory.
#[derive(Debug)]
pub struct Compass<'a> {
    policy: AcceptancePolicy,
    settings: Settings,
    generations: Generations,
    sensor: Option<DetectedSensor>,
    is_armed: Option<bool>,
    here: LocalField,
    collector: Collector<'a>,
    recent: RecentSamples,
    activity: Activity,
    /// Samples received during the solve, for a collection that continues; those of the solve do not change.
    held: heapless::Vec<Sample, HELD_SAMPLES>,
    saving: Option<PendingSave>,
    last_outcome: Option<Message>,
    advice: Option<Advice>,
    trials: TrialSolves,
    automatic: AutomaticStart,
    persistent: PersistentState,
}

impl<'a> Compass<'a> {
    /// Creates the initial state from flash and from samples retained in RAM. Not inlined, to limit the stack.
    #[must_use]
    #[inline(never)]
    pub fn new(policy: AcceptancePolicy, stored: &StoredValues, retained: &'a mut RetainedSamples) -> Self {
        let StoredValues { settings, generations, remembered } = *stored;
        let mut compass = Self {
            policy,
            settings,
            generations,
            sensor: None,
            is_armed: None,
            here: LocalField::UNKNOWN,
            collector: Collector::new(retained),
            recent: RecentSamples::new(),
            activity: Activity::Idle,
            held: heapless::Vec::new(),
            saving: None,
            last_outcome: None,
            advice: None,
            trials: TrialSolves::NONE,
            automatic: AutomaticStart::NEW,
            persistent: PersistentState::new(remembered),
        };
        compass.restore_collection();
        compass
    }

    /// Result of the last solve; at start-up, the loss of a collection.
    #[must_use]
    pub fn last_outcome(&self) -> Option<&Message> {
        self.last_outcome.as_ref()
    }

    /// Samples of the last collection, for replay on a host.
    #[cfg(not(target_os = "none"))]
    #[must_use]
    pub const fn collector(&self) -> &Collector<'a> {
        &self.collector
    }

    /// Solution that the next [`Event::Advance`] verifies, for replay on a host.
    #[cfg(not(target_os = "none"))]
    #[must_use]
    pub const fn candidate(&self) -> Option<&Solution> {
        match &self.activity {
            Activity::Solving(Solve { stage: SolveStage::Verifying(solution), .. }) => Some(solution),
            _ => None,
        }
    }

    /// Whether [`Event::Advance`] is needed.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        matches!(&self.activity, Activity::Solving(solve) if !matches!(solve.stage, SolveStage::Saving(_)))
    }

    fn is_saving(&self) -> bool {
        self.to_save().is_some()
    }

    /// Configuration of the instrument.
    #[must_use]
    pub fn correction(&self) -> Correction {
        let tumbles =
            matches!(self.activity, Activity::Collecting(_)) && self.collector.procedure() == Procedure::Tumble;
        Correction {
            calibration: self.active_record().map(|record| (record.calibration, record.uncertainty)),
            has_valid_inclination: self.active_record().is_none_or(|record| record.quality.knows_inclination),
            align_deg: self.settings.align_deg,
            sample_attitude: if tumbles { SampleAttitude::Unknown } else { SampleAttitude::Interpolated },
            mount: self.sensor.map(|_| self.settings.mount),
            total_ut: self.model_field_strength_ut(),
            is_armed: self.is_armed,
        }
    }

    /// Stored calibration, if valid for sensor and mounting.
    #[must_use]
    pub fn active_record(&self) -> Option<&CalibrationRecord> {
        let record = self.generations.current.as_ref()?;
        let fits = Some(record.sensor) == self.sensor.map(|sensor| sensor.identity);
        (fits && record.mount == self.settings.mount).then_some(record)
    }

    /// Settings as stored.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Effective settings: declination and inclination default to the field model's.
    #[must_use]
    pub fn effective_settings(&self) -> Settings {
        let Settings { declination_deg, inclination_deg, .. } = self.settings;
        let field = self.here.field();
        Settings {
            declination_deg: declination_deg.or_else(|| field?.declination_deg),
            inclination_deg: inclination_deg.or_else(|| Some(field?.inclination_deg)),
            ..self.settings
        }
    }

    /// Field strength of the field model, microtesla.
    #[must_use]
    pub fn model_field_strength_ut(&self) -> Option<f32> {
        self.here.field().map(|field| field.total_ut)
    }

    /// State for users.
    #[must_use]
    pub fn state(&self) -> ModuleState {
        match &self.activity {
            Activity::Collecting(_) | Activity::Solving(Solve { purpose: SolvePurpose::Trial(_), .. }) => {
                ModuleState::Collecting
            }
            Activity::Solving(Solve { stage: SolveStage::Fitting(_), .. }) => ModuleState::Solving,
            Activity::Solving(_) => ModuleState::Verifying,
            Activity::Idle if self.active_record().is_some() => ModuleState::Calibrated,
            Activity::Idle => ModuleState::Uncalibrated,
        }
    }

    /// Data to write after [`Effect::Save`].
    #[must_use]
    pub fn to_save(&self) -> Option<StoreChange<'_>> {
        let Generations { current, previous } = &self.generations;
        if let Activity::Solving(Solve { stage: SolveStage::Saving(record), .. }) = &self.activity {
            return Some(StoreChange::Generations { current: Some(record), previous: current.as_ref() });
        }
        Some(match self.saving.as_ref()? {
            PendingSave::Settings(settings) => StoreChange::Settings(settings),
            PendingSave::Remembered(remembered) => StoreChange::Remembered(*remembered),
            PendingSave::Undo => StoreChange::Generations { current: previous.as_ref(), previous: current.as_ref() },
            PendingSave::Clear => StoreChange::Clear,
        })
    }

    /// Processes an event.
    ///
    /// Large methods are not inlined, so that their locals do not add to the solver's stack.
    pub fn step(&mut self, event: Event) -> Effect {
        let effect = self.dispatch(event);
        self.update_retained();
        effect
    }

    fn dispatch(&mut self, event: Event) -> Effect {
        match event {
            Event::SensorDetected(identity, readings_per_sample) => {
                self.sensor = Some(DetectedSensor { identity, readings_per_sample });
                Effect::None
            }
            Event::Armed(is_armed) => {
                self.is_armed = is_armed;
                Effect::None
            }
            Event::Position(place) => {
                self.here.set_position(place);
                Effect::None
            }
            Event::Date(day) => {
                self.here.set_date(day);
                Effect::None
            }
            Event::Sample(sample) => self.on_sample(sample),
            Event::Command(command, now) => match self.on_command(command, now) {
                Ok(effect) => effect,
                Err(refusal) => Effect::Reply(Err(refusal)),
            },
            Event::Advance => self.advance_solve(),
            Event::Saved(result) => self.on_saved(result),
            Event::ProtocolsDetected(detected, now) => self.save_persistent(detected, now),
        }
    }

    #[inline(never)]
    fn on_sample(&mut self, sample: Sample) -> Effect {
        self.recent.push(sample);
        self.start_automatic_collection();
        let Some(starter) = self.activity.starter().filter(|starter| !self.is_paused(*starter)) else {
            return Effect::None;
        };
        if let Activity::Solving(Solve { purpose, .. }) = self.activity {
            let is_held = self.held.push(sample).is_ok();
            if is_held || !matches!(purpose, SolvePurpose::Trial(_)) {
                return Effect::None;
            }
            self.resume_collection(starter);
        }
        self.collector.push(sample);
        self.update_retained();
        let purpose = if self.collector.progress().is_complete() {
            SolvePurpose::Calibration(Some(starter))
        } else if self.collector.procedure() == Procedure::Flight && self.trials.is_due(&self.collector, sample.time) {
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
        self.admit(command)?;
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
                self.automatic.is_overridden = true;
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
                self.automatic.is_overridden = true;
            }
            Command::CalClear => return Ok(self.request_save(PendingSave::Clear)),
            Command::CalUndo => return self.restore_previous(),
            Command::Status | Command::CalShow => return Ok(Effect::Reply(Ok(Reply::Report(self.report())))),
            Command::Set(setting) => {
                let settings = self.settings.with_setting(setting).map_err(Refusal::OutOfRange)?;
                if let SettingChange::Auto(true) = setting {
                    self.return_control(true);
                }
                return Ok(self.request_save(PendingSave::Settings(settings)));
            }
            Command::Align(heading_deg) => return self.set_alignment(heading_deg, false, now),
            Command::AlignConfirmed(heading_deg) => return self.set_alignment(Some(heading_deg), true, now),
            Command::Restart => self.collector.reset_restart_count(),
        }
        Ok(Effect::Reply(Ok(Reply::Done(self.state()))))
    }

    /// Starts a collection, or takes over an automatic one unless `forgets`.
    fn start_by_command(&mut self, procedure: Procedure, discards_previous: bool) -> Result<(), Refusal> {
        self.sensor.ok_or(Refusal::NoSensor)?;
        match self.activity {
            Activity::Collecting(Starter::User) if !discards_previous => {
                return Err(Refusal::Collecting { present: self.collector.procedure(), requested: procedure });
            }
            Activity::Collecting(Starter::Module) if !discards_previous && procedure == self.collector.procedure() => {
                self.activity = Activity::Collecting(Starter::User);
            }
            _ => self.start_collection(procedure, Starter::User),
        }
        self.automatic.is_overridden = true;
        Ok(())
    }

    fn start_collection(&mut self, procedure: Procedure, starter: Starter) {
        self.collector.begin(procedure);
        self.recent = RecentSamples::new();
        self.trials = TrialSolves::NONE;
        self.activity = Activity::Collecting(starter);
    }

    /// Aborts all activity and discards the samples.
    #[inline(never)]
    fn discard_collection(&mut self) {
        self.collector.discard();
        self.trials = TrialSolves::NONE;
        self.activity = Activity::Idle;
    }

    /// Marks a heading with the mean sample of the last second.
    fn mark_heading(&mut self, heading_deg: f32, now: WrappingMillis) -> Result<Effect, Refusal> {
        let is_swinging =
            matches!(self.activity, Activity::Collecting(_)) && self.collector.procedure() == Procedure::Swing;
        if !is_swinging {
            return Err(Refusal::NotSwinging);
        }
        check_heading_range(heading_deg)?;
        let sample = self.recent.mean_at_rest(now).ok_or(Refusal::NotStationary)?;
        if !self.collector.add_mark(Mark { sample, heading_rad: heading_deg.to_radians() }) {
            return Err(Refusal::TooManyMarks);
        }
        self.recent = RecentSamples::new();
        Ok(Effect::Reply(Ok(Reply::Marked(self.collector.progress().marks))))
    }

    /// Sets the alignment from the present and the given heading.
    fn set_alignment(
        &mut self,
        heading_deg: Option<f32>,
        is_sure: bool,
        now: WrappingMillis,
    ) -> Result<Effect, Refusal> {
        let mut align_deg = 0.0;
        if let Some(heading_deg) = heading_deg {
            check_heading_range(heading_deg)?;
            let calibration = &self.active_record().ok_or(Refusal::NoCalibration)?.calibration;
            let mean_sample = self.recent.mean_at_rest(now).ok_or(Refusal::NotStationary)?;
            let shown_rad = mean_sample.attitude.level(calibration.corrected_body_field(&mean_sample)).heading_rad();
            align_deg = wrap_pi(heading_deg.to_radians() - shown_rad).to_degrees();
            if align_deg.abs() > MAX_UNCONFIRMED_ALIGNMENT_DEG && !is_sure {
                return Err(Refusal::LargeAlignment { heading_deg, align_deg });
            }
        }
        Ok(self.request_save(PendingSave::Settings(Settings { align_deg, ..self.settings })))
    }

    fn restore_previous(&mut self) -> Result<Effect, Refusal> {
        self.generations.previous.as_ref().ok_or(Refusal::NoPreviousCalibration)?;
        Ok(self.request_save(PendingSave::Undo))
    }

    fn request_save(&mut self, pending: PendingSave) -> Effect {
        self.saving = Some(pending);
        Effect::Save
    }

    fn start_solving(&mut self, method: Option<Method>, purpose: SolvePurpose) -> Result<(), Refusal> {
        self.held.clear();
        let sensor = self.sensor.ok_or(Refusal::NoSensor)?;
        if self.collector.fit().all().next().is_none() {
            return Err(Refusal::NoSamples);
        }
        let supported = || method_selection::select_method(self.collector.fit(), self.collector.procedure());
        let method = method.map_or_else(supported, Ok).map_err(Refusal::Solve)?;
        self.start_solve_with_inclination(method, self.effective_settings().inclination_deg, purpose, sensor)
    }

    fn start_solve_with_inclination(
        &mut self,
        method: Method,
        inclination_deg: Option<f32>,
        purpose: SolvePurpose,
        sensor: DetectedSensor,
    ) -> Result<(), Refusal> {
        let prior = Prior {
            mount: self.settings.mount,
            inclination_rad: inclination_deg.map(f32::to_radians),
            readings_per_sample: sensor.readings_per_sample,
        };
        let consider = self.settings.attitude_error.to_consider_sigmas();
        let solver = Solver::with_consider_sigmas(method, samples_to_fit(&self.collector), &prior, consider)
            .map_err(Refusal::Solve)?;
        self.activity = Activity::Solving(Solve { stage: SolveStage::Fitting(solver), purpose, sensor });
        Ok(())
    }

    #[inline(never)]
    fn advance_solve(&mut self) -> Effect {
        let Activity::Solving(solve) = &mut self.activity else { return Effect::None };
        let (purpose, sensor) = (solve.purpose, solve.sensor);
        match &mut solve.stage {
            SolveStage::Fitting(solver) => match solver.step(samples_to_fit(&self.collector)) {
                Solving::Continue => Effect::None,
                Solving::Finished(Ok(solution)) => {
                    self.advice = solution.advice;
                    solve.stage = SolveStage::Verifying(solution);
                    Effect::None
                }
                Solving::Finished(Err(error)) => self.on_solve_failed(error, purpose, sensor),
            },
            SolveStage::Verifying(_) => self.verify_candidate(),
            SolveStage::Saving(_) => Effect::None,
        }
    }

    /// Handles a failed solve. If the samples contradict the field model's inclination (local anomaly, attitude
    /// errors), solves again without it; an inclination set by the user is never ignored.
    fn on_solve_failed(&mut self, error: SolveError, purpose: SolvePurpose, sensor: DetectedSensor) -> Effect {
        if let (SolveError::InclinationContradicted { .. }, None) = (error, self.settings.inclination_deg)
            && self.start_solve_with_inclination(Method::MaximumLikelihood, None, purpose, sensor).is_ok()
        {
            return Effect::None;
        }
        self.end_solve(purpose, Err(Refusal::Solve(error)))
    }

    #[inline(never)]
    fn verify_candidate(&mut self) -> Effect {
        let Activity::Solving(Solve { stage: SolveStage::Verifying(candidate), purpose, sensor }) = &self.activity
        else {
            return Effect::None;
        };
        let (mut purpose, sensor) = (*purpose, *sensor);
        let accepted = self.accept_candidate(candidate, sensor.identity);
        if let SolvePurpose::Trial(starter) = purpose {
            let refusal = accepted.as_ref().err().cloned();
            self.collector.use_trial_solution(candidate);
            if !self.trials.record_result(candidate, refusal, &self.collector, self.settings.accuracy_deg) {
                self.resume_collection(starter);
                return Effect::None;
            }
            // Ends an automatic collection, too, whether or not the save succeeds.
            purpose = SolvePurpose::Calibration(None);
        }
        match accepted {
            Ok(record) => {
                self.activity = Activity::Solving(Solve { stage: SolveStage::Saving(record), purpose, sensor });
                Effect::Save
            }
            Err(refusal) => self.end_solve(purpose, Err(refusal)),
        }
    }

    #[inline(never)]
    fn accept_candidate(&self, candidate: &Solution, sensor: Identity) -> Result<CalibrationRecord, Refusal> {
        let selection = SelectedParts::new(self.collector.fit(), self.collector.procedure());
        let grounds = AcceptanceSamples {
            fit: selection.select(self.collector.fit()),
            held_back: selection.select(self.collector.held_back()),
            is_attitude_known: self.collector.procedure() != Procedure::Tumble,
        };
        acceptance::evaluate_candidate(&self.policy, candidate, grounds, &self.incumbent())
            .map_err(Refusal::Rejected)?;
        let current = self.generations.current.as_ref();
        Ok(CalibrationRecord {
            calibration: candidate.calibration,
            quality: candidate.quality,
            uncertainty: candidate.uncertainty,
            sensor,
            mount: self.settings.mount,
            serial: current.map_or(1, |current| current.serial.wrapping_add(1)),
        })
    }

    fn incumbent(&self) -> Incumbent {
        self.active_record().map_or_else(
            || Incumbent::uncalibrated(self.settings.mount),
            |record| Incumbent::active(record.calibration, record.quality),
        )
    }

    #[inline(never)]
    fn on_saved(&mut self, result: Result<(), StoreError>) -> Effect {
        if let Activity::Solving(Solve { stage: SolveStage::Saving(record), purpose, .. }) = &self.activity {
            let purpose = *purpose;
            let outcome = result.map_err(Refusal::Store).map(|()| {
                self.persistent.forget_collection();
                self.generations.push(record);
                ExpectedAccuracy::new(record.quality, &record.calibration)
            });
            return self.end_solve(purpose, outcome);
        }
        let Some(saving) = self.saving.take() else { return Effect::None };
        match (saving, result) {
            // Not requested by a user: no reply, no retry. Headings continue, so that nothing else shows the failure.
            (PendingSave::Remembered(_), Err(error @ StoreError::Timeout)) => {
                Effect::Notify(Message::StoreFailed(error))
            }
            (PendingSave::Remembered(_), _) => Effect::None,
            (_, Err(error)) => Effect::Reply(Err(Refusal::Store(error))),
            (PendingSave::Undo, Ok(())) => {
                self.persistent.forget_collection();
                self.generations.undo();
                self.reply_done()
            }
            (PendingSave::Clear, Ok(())) => {
                self.persistent.forget_collection();
                self.generations.clear();
                self.return_control(self.settings.auto_on);
                self.reply_done()
            }
            (PendingSave::Settings(settings), Ok(())) => {
                if !settings.auto_on && self.settings.auto_on {
                    self.return_control(false);
                }
                self.settings = settings;
                self.reply_done()
            }
        }
    }

    fn reply_done(&self) -> Effect {
        Effect::Reply(Ok(Reply::Done(self.state())))
    }

    /// Continues collecting after a solve, or instead of a trial solve.
    fn resume_collection(&mut self, starter: Starter) {
        for sample in &self.held {
            self.collector.push(*sample);
        }
        self.held.clear();
        self.activity = Activity::Collecting(starter);
        self.collector.reset_restart_count();
    }

    /// Known reason for missing or insufficient samples.
    fn sample_deficiency(&self) -> Option<CollectionProblem> {
        self.collector
            .problem()
            .or_else(|| self.trials.last_result.as_ref().and_then(TrialResult::missing_manoeuvre_reason))
    }

    /// Ends a solve; keeps the samples.
    fn end_solve(&mut self, purpose: SolvePurpose, outcome: SolveOutcome) -> Effect {
        let outcome = outcome.map_err(|refusal| refusal.with_cause(self.sample_deficiency()));
        match (purpose, &outcome) {
            (SolvePurpose::Trial(starter), Err(refusal)) => {
                self.trials.last_result = Some(TrialResult::from_failure(refusal.clone()));
                self.resume_collection(starter);
                return Effect::None;
            }
            (SolvePurpose::Calibration(Some(Starter::Module)), Err(_)) => self.resume_collection(Starter::Module),
            _ => {
                self.collector.reset_restart_count();
                self.collector.set_state(CollectionState::Inactive);
                self.activity = Activity::Idle;
            }
        }
        let message = Message::Solved(outcome);
        self.last_outcome = Some(message.clone());
        Effect::Notify(message)
    }

    fn report(&self) -> StatusReport {
        StatusReport {
            state: self.state(),
            is_armed: self.is_armed,
            is_automatic: self.activity.is_automatic(),
            awaits_arming: self.awaits_arming(),
            progress: self.collector.progress(),
            last_trial: self.trials.last_result.clone(),
            settings: self.settings,
            local_field: self.here,
            stored_calibration: self.generations.current.as_ref().map(CalibrationSummary::from),
            can_undo: self.generations.previous.is_some(),
            last_outcome: self.last_outcome.clone(),
        }
    }
}

fn samples_to_fit<'a>(collector: &'a Collector<'_>) -> Samples<'a> {
    SelectedParts::new(collector.fit(), collector.procedure()).select(collector.fit())
}

fn check_heading_range(heading_deg: f32) -> Result<(), Refusal> {
    if (0.0..=360.0).contains(&heading_deg) {
        Ok(())
    } else {
        Err(Refusal::OutOfRange(OutOfRange("a magnetic heading is 0 to 360 degrees")))
    }
}
