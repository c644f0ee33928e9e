//! Data of the state machine, and values derived from them.

use super::activity::{Activity, DetectedSensor, Solve, SolvePurpose, SolveStage};
use super::armed_state::ArmedState;
use super::storage::Storage;
use super::trial_solves::TrialSolves;
use crate::compass::events::{IndicatorState, ModuleState};
use crate::messages::Message;
use crate::settings::Settings;
use crate::store::{CalibrationRecord, StoreChange};
use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{Advice, Sample};
use autoswing::collection::{Collector, RecentSamples};
use autoswing::earth::{LocalField, PositionContext};
use autoswing::inertial::SensorOffsets;
use autoswing::instrument::{Correction, SampleAttitude};
use autoswing::time::WrappingMillis;

/// Capacity for samples during a solve, 4.8 s at ten a second. The longest solve, with motor-current interference,
/// takes 54 million instructions at most (`bench budget`): 3.5 s in the emulator, less than 1 s at 80 MHz. A longer
/// trial solve is ended, and ended each time: the collection would never finish.
pub(super) const SAMPLES_DURING_SOLVE_CAPACITY: usize = 48;

/// State machine. About 4 KB; samples are in borrowed memory.
#[derive(Debug)]
pub struct Compass<'a> {
    pub(super) storage: Storage,
    pub(super) sensor: Option<DetectedSensor>,
    pub(super) has_inertial_sensor: bool,
    /// Latest estimate of the offsets of gyro and accelerometer.
    pub(super) sensor_offsets: SensorOffsets,
    pub(super) armed_state: ArmedState,
    pub(super) local_field: LocalField,
    pub(super) collector: Collector<'a>,
    pub(super) recent_samples: RecentSamples,
    pub(super) activity: Activity,
    /// Samples received during the solve, for a collection that continues; the samples of the solve do not change.
    pub(super) samples_during_solve: heapless::Vec<Sample, SAMPLES_DURING_SOLVE_CAPACITY>,
    pub(super) last_collection_outcome: Option<Message>,
    pub(super) advice: Option<Advice>,
    pub(super) trial_solves: TrialSolves,
    /// Whether a user has taken control, so that no collection starts automatically.
    pub(super) is_automatic_start_overridden: bool,
}

impl Compass<'_> {
    /// Result of the last solve; at start-up, the loss of a collection.
    #[must_use]
    pub fn last_collection_outcome(&self) -> Option<&Message> {
        self.last_collection_outcome.as_ref()
    }

    /// Solution that the next [`Event::AdvanceSolve`](super::Event::AdvanceSolve) verifies, for replay on a host.
    #[cfg(not(target_os = "none"))]
    #[must_use]
    pub const fn candidate_solution(&self) -> Option<&autoswing::calibration::Solution> {
        match &self.activity {
            Activity::Solving(Solve { stage: SolveStage::Verifying(solution), .. }) => Some(solution),
            _ => None,
        }
    }

    /// Whether [`Event::AdvanceSolve`](super::Event::AdvanceSolve) is needed.
    #[must_use]
    pub fn needs_solve_step(&self) -> bool {
        matches!(&self.activity, Activity::Solving(solve) if !matches!(solve.stage, SolveStage::Saving(_)))
    }

    /// Data to write after [`Effect::Save`](super::Effect::Save).
    #[must_use]
    pub fn pending_change(&self) -> Option<StoreChange<'_>> {
        let accepted = match &self.activity {
            Activity::Solving(Solve { stage: SolveStage::Saving(record), .. }) => Some(record),
            _ => None,
        };
        self.storage.pending_change(accepted)
    }

    /// Offsets of gyro and accelerometer: those of the stored calibration, until they are updated.
    #[must_use]
    pub const fn sensor_offsets(&self) -> SensorOffsets {
        self.sensor_offsets
    }

    /// Updates the estimated offsets of gyro and accelerometer, which have answered. The next calibration includes them.
    pub const fn set_sensor_offsets(&mut self, offsets: SensorOffsets) {
        self.has_inertial_sensor = true;
        self.sensor_offsets = offsets;
    }

    /// Configuration of the instrument.
    #[must_use]
    pub fn instrument_correction(&self) -> Correction {
        let settings = self.stored_settings();
        let tumbles =
            matches!(self.activity, Activity::Collecting(_)) && self.collector.procedure() == Procedure::Tumble;
        Correction {
            calibration: self.active_record().map(|record| (record.calibration, record.uncertainty)),
            has_valid_inclination: self.active_record().is_none_or(|record| record.quality.knows_inclination),
            align_deg: settings.align_deg,
            sample_attitude: if tumbles { SampleAttitude::Unknown } else { SampleAttitude::Interpolated },
            mount: self.sensor.map(|_| settings.mount),
            total_ut: self.model_field_strength_ut(),
            is_armed: self.armed_state.reported_state(),
            sensor_errors: settings.sensor_error_sigmas(),
            attitude_source: settings.attitude_source,
        }
    }

    /// Stored calibration, if valid for sensor and mounting.
    pub(super) fn active_record(&self) -> Option<&CalibrationRecord> {
        self.storage.active_record(self.sensor.map(|sensor| sensor.identity))
    }

    /// Settings as stored.
    #[must_use]
    pub fn stored_settings(&self) -> &Settings {
        &self.storage.values().settings
    }

    /// Effective settings: declination and inclination default to the field model's.
    #[must_use]
    pub fn effective_settings(&self) -> Settings {
        let settings = self.stored_settings();
        let field = self.local_field.model_field();
        Settings {
            declination_deg: settings.declination_deg.or_else(|| field?.declination_deg),
            inclination_deg: settings.inclination_deg.or_else(|| Some(field?.inclination_deg)),
            ..*settings
        }
    }

    /// Armed state and calibrated inclination, against which reported positions are tested.
    pub(super) fn position_context(&self, now: WrappingMillis) -> PositionContext {
        PositionContext {
            is_disarmed: self.armed_state.reported_state() == Some(false) && !self.armed_state.is_in_flight(now),
            calibrated_inclination_deg: self.calibrated_inclination_deg(),
        }
    }

    pub(super) fn calibrated_inclination_deg(&self) -> Option<f32> {
        let record = self.active_record().filter(|record| record.quality.knows_inclination);
        record.map(|record| record.calibration.inclination_rad.to_degrees())
    }

    /// Field strength of the field model, microtesla.
    pub(super) fn model_field_strength_ut(&self) -> Option<f32> {
        self.local_field.model_field().map(|field| field.total_ut)
    }

    /// State of the module, as shown to users.
    pub(super) fn module_state(&self) -> ModuleState {
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

    /// Indicator state of the module.
    #[must_use]
    pub fn indicator_state(&self) -> IndicatorState {
        match self.module_state() {
            ModuleState::Uncalibrated => match self.last_collection_outcome {
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
        let trial_percent = || self.trial_solves.progress_percent(self.stored_settings().accuracy_deg);
        progress.percent().or_else(trial_percent).unwrap_or(0)
    }
}
