//! Inputs and outputs of the state machine.

use crate::compass::trial_solves::TrialResult;
use crate::messages::{ExpectedAccuracy, Message, Refusal, SampleLoss};
use crate::replaced_numbers::ReplacedNumber;
use crate::settings::{PORT_COUNT, ProtocolKind, SettingChange, Settings};
use crate::store::{CalibrationRecord, StoreError};
use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{Advice, Calibration, Method, Orientation, Quality, Sample};
use autoswing::collection::CollectionProgress;
use autoswing::earth::{Date, LocalField, Position};
use autoswing::reading::Identity;
use autoswing::time::WrappingMillis;

/// Input of the state machine.
#[derive(Clone, Copy, Debug)]
pub enum Event {
    /// Detected magnetometer, and readings averaged per sample.
    SensorDetected(Identity, u16),
    /// Armed state of the autopilot; `None` if unknown.
    ArmedStateReported(Option<bool>),
    /// Position from the autopilot, and its time on the sample clock.
    Position(Position, WrappingMillis),
    /// Date from the autopilot.
    Date(Date),
    /// Next averaged sample.
    Sample(Sample),
    /// Command and its time on the sample clock.
    Command(Command, WrappingMillis),
    /// Next step of a solve, while [`Compass::needs_solve_step`](super::Compass::needs_solve_step).
    AdvanceSolve,
    /// Idle time: detected protocol of each port, and time on the sample clock.
    ProtocolsDetected([ProtocolKind; PORT_COUNT], WrappingMillis),
    /// Result of [`Effect::Save`].
    Saved(Result<(), StoreError>),
}

/// Command of a user: from the console, from a port, or by the button.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Start a collection, or take over an automatic one.
    CalStart(Procedure),
    /// Discard the present collection and start a new one; `None` repeats the last procedure.
    CalStartNew(Option<Procedure>),
    /// Mark a heading: the known magnetic heading of the stationary vehicle, degrees.
    CalMark(f32),
    /// Stop collecting, keep the samples.
    CalStop,
    /// Solve by a given method, or by the best supported one.
    CalSolve(Option<Method>),
    /// Report the weakness of the last solve and the recommended manoeuvre.
    CalAdvise,
    /// Abort collection or solve, discard the samples.
    CalAbort,
    /// Erase the stored calibrations.
    CalClear,
    /// Restore the previous calibration.
    CalUndo,
    /// Report the state in six lines.
    Status,
    /// Report state, progress, settings and counters.
    StatusAll,
    /// Report the stored calibration.
    CalShow,
    /// Change a setting.
    Set(SettingChange),
    /// Changes a setting from a CAN bus, which has no authentication: refused while armed.
    SetFromBus(SettingChange),
    /// Reset all settings but the alignment.
    ResetSettings,
    /// Set the alignment so that the present heading becomes this one, degrees; `None` resets it.
    Align(Option<f32>),
    /// Set the alignment without a limit of its size.
    AlignConfirmed(f32),
    /// Keep a number of the autopilot's parameters that a setup replaces, or forget it.
    KeepReplacedNumber(ReplacedNumber),
    /// Check, set up or restart the autopilot; the driver of the state machine passes it on to a line after the reply.
    Autopilot(AutopilotAction),
    /// Restart the module; the driver of the state machine does so after the reply.
    Restart,
}

/// Action on the autopilot, by MAVLink.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AutopilotAction {
    /// Compare its parameters with the wanted ones.
    Check,
    /// Write the parameters that differ.
    Setup,
    /// Write the numbers back that a setup replaced.
    Undo,
    /// Restart it.
    Restart,
}

/// Output of the state machine.
#[expect(clippy::large_enum_variant, reason = "there is one of it, and the board has no heap")]
#[derive(Debug)]
pub enum Effect {
    /// The event requires no action.
    None,
    /// Reply to the sender of a command.
    Reply(Result<Reply, Refusal>),
    /// Message to all users.
    Notify(Message),
    /// Write [`Compass::pending_change`](super::Compass::pending_change) to flash, then send [`Event::Saved`].
    Save,
}

/// Positive answer to a command.
#[expect(clippy::large_enum_variant, reason = "there is one of it, and the board has no heap")]
#[derive(Clone, Debug)]
pub enum Reply {
    /// The command is done; the present state of the module.
    Done(ModuleState),
    /// Number of headings marked so far.
    MarkCount(u16),
    /// Weakness of the last solve and recommended manoeuvre.
    Advice(Advice),
    /// Full report of the module's state.
    Report(StatusReport),
    /// Report that the module is in safe mode.
    SafeMode,
}

/// State of the module, as shown to users.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModuleState {
    /// No calibration for this sensor and mounting.
    Uncalibrated,
    /// Collecting samples.
    Collecting,
    /// Solving for the coefficients.
    Solving,
    /// Verifying on held-back samples, and saving.
    Verifying,
    /// A calibration is active.
    Calibrated,
}

impl ModuleState {
    /// Display name.
    #[must_use]
    pub const fn state_name(self) -> &'static str {
        match self {
            Self::Uncalibrated => "uncalibrated",
            Self::Collecting => "collecting",
            Self::Solving => "solving",
            Self::Verifying => "verifying",
            Self::Calibrated => "calibrated",
        }
    }
}

/// Indicator state of the module, for an LED.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IndicatorState {
    /// Uncalibrated, not collecting.
    Idle,
    /// Collecting; progress in percent.
    Collecting(u8),
    /// A calibration is active.
    Calibrated,
    /// Uncalibrated; the last solve was refused.
    Refused,
}

/// Full report of the module's state.
#[derive(Clone, Debug)]
pub struct StatusReport {
    /// Present state of the module.
    pub module_state: ModuleState,
    /// Armed state, if known.
    pub is_armed: Option<bool>,
    /// Whether the collection was started automatically.
    pub is_automatic: bool,
    /// Whether automatic collection waits for arming.
    pub awaits_arming: bool,
    /// Progress of the collection.
    pub collection_progress: CollectionProgress,
    /// Result of the last trial solve.
    pub last_trial: Option<TrialResult>,
    /// Stored settings.
    pub settings: Settings,
    /// Position, date, Earth field.
    pub local_field: LocalField,
    /// Stored calibration, possibly for another sensor or mounting.
    pub stored_calibration: Option<CalibrationSummary>,
    /// Whether `cal undo` has a calibration to restore.
    pub can_undo: bool,
    /// Result of the last solve.
    pub last_collection_outcome: Option<Message>,
    /// Why readings since the start of the collection did not become samples.
    pub sample_loss: Option<SampleLoss>,
}

/// Stored calibration without coefficient covariance.
#[derive(Clone, Debug)]
pub struct CalibrationSummary {
    /// Calibration coefficients.
    pub calibration: Calibration,
    /// Expected accuracy.
    pub quality: Quality,
    /// Magnetometer of the calibration.
    pub sensor: Identity,
    /// Mounting of the calibration.
    pub mount: Orientation,
    /// Sequence number of accepted calibrations.
    pub serial_number: u32,
}

impl From<&CalibrationRecord> for CalibrationSummary {
    fn from(record: &CalibrationRecord) -> Self {
        let CalibrationRecord { calibration, quality, sensor, mount, serial_number: serial, .. } = *record;
        Self { calibration, quality, sensor, mount, serial_number: serial }
    }
}

impl CalibrationSummary {
    /// Expected accuracy.
    #[must_use]
    pub fn expected_accuracy(&self) -> ExpectedAccuracy {
        ExpectedAccuracy::new(self.quality, &self.calibration)
    }
}
