//! Stored values: which data a save writes, what it changes once it has succeeded, which calibration is active, and when
//! the values for the next start are saved.

use super::events::Effect;
use crate::messages::Refusal;
use crate::settings::{PORT_COUNT, PortNumber, ProtocolKind, Settings};
use crate::store::{CalibrationRecord, StoreChange, StoredCalibrations, StoredValues};
use autoswing::collection::{CollectionState, Collector};
use autoswing::reading::Identity;
use autoswing::time::WrappingMillis;

/// Duration after which a detected protocol is stored, milliseconds.
const STABLE_DETECTION_MS: u32 = 5000;

/// Data of a save in progress, except that of an accepted calibration.
#[derive(Debug)]
pub(super) enum PendingSave {
    /// Swap of current and previous calibration.
    Undo,
    /// Removal of both calibrations.
    Clear,
    Settings(Settings),
    /// Values for the next start: whether a collection was running, and the detected protocols.
    StartupValues,
}

/// Stored values and the save in progress.
#[derive(Debug)]
pub(super) struct Storage {
    /// Settings and calibrations in flash; startup values written last, successfully or not.
    values: StoredValues,
    pending_save: Option<PendingSave>,
    /// Detected protocols, and since when.
    detected_since: Option<([ProtocolKind; PORT_COUNT], WrappingMillis)>,
}

impl Storage {
    pub const fn new(stored: &StoredValues) -> Self {
        Self { values: *stored, pending_save: None, detected_since: None }
    }

    /// Stored values, of which only a successful save changes settings and calibrations.
    pub const fn values(&self) -> &StoredValues {
        &self.values
    }

    /// Serial number of the current calibration; 0 without one.
    pub fn calibration_serial(&self) -> u32 {
        self.values.stored_calibrations.current_calibration.as_ref().map_or(0, |record| record.serial_number)
    }

    /// Current calibration, if valid for this sensor and for the mounting.
    pub fn active_record(&self, sensor: Option<Identity>) -> Option<&CalibrationRecord> {
        let current = self.values.stored_calibrations.current_calibration.as_ref();
        current.filter(|record| Some(record.sensor) == sensor && record.mount == self.values.settings.mount)
    }

    pub fn request_save(&mut self, pending: PendingSave) -> Effect {
        self.pending_save = Some(pending);
        Effect::Save
    }

    pub fn request_undo(&mut self) -> Result<Effect, Refusal> {
        self.values.stored_calibrations.previous_calibration.as_ref().ok_or(Refusal::NoPreviousCalibration)?;
        Ok(self.request_save(PendingSave::Undo))
    }

    /// Requests a save of changed startup values, unless a solve or a save is in progress.
    pub fn save_startup_values(
        &mut self,
        collector: &Collector<'_>,
        is_solving: bool,
        detected_protocols: [ProtocolKind; PORT_COUNT],
        now: WrappingMillis,
    ) -> Effect {
        let mut new_values = self.values.startup_values;
        new_values.is_collecting = collector.collection_state() != CollectionState::Inactive
            && (new_values.is_collecting || collector.is_loss_reportable());
        if self.is_detection_stable(detected_protocols, now) {
            for ((number, stored), kind) in
                PortNumber::ALL_PORTS.into_iter().zip(&mut new_values.detected_protocols).zip(detected_protocols)
            {
                // Failed detection does not replace an earlier result, nor does a configured protocol.
                let configured = self.values.settings.settings_of_port(number).protocol;
                if configured == ProtocolKind::Auto && kind != ProtocolKind::Auto {
                    *stored = kind;
                }
            }
        }
        if new_values == self.values.startup_values || is_solving || self.pending_save.is_some() {
            return Effect::None;
        }
        self.values.startup_values = new_values;
        self.request_save(PendingSave::StartupValues)
    }

    /// Whether the detected protocols have been constant for long enough.
    fn is_detection_stable(&mut self, detected_protocols: [ProtocolKind; PORT_COUNT], now: WrappingMillis) -> bool {
        let detected_since = self.detected_since.filter(|(protocols, _)| *protocols == detected_protocols);
        let (_, since) = *self.detected_since.insert(detected_since.unwrap_or((detected_protocols, now)));
        now.ms_since(since) >= STABLE_DETECTION_MS
    }

    /// Data to write: an accepted calibration, or that of the pending save.
    pub fn pending_change<'a>(&'a self, accepted: Option<&'a CalibrationRecord>) -> Option<StoreChange<'a>> {
        let StoredCalibrations { current_calibration: current, previous_calibration: previous } =
            &self.values.stored_calibrations;
        if accepted.is_some() {
            return Some(StoreChange::StoredCalibrations { current: accepted, previous: current.as_ref() });
        }
        Some(match self.pending_save.as_ref()? {
            PendingSave::Settings(settings) => StoreChange::Settings(settings),
            PendingSave::StartupValues => StoreChange::StartupValues(self.values.startup_values),
            PendingSave::Undo => {
                StoreChange::StoredCalibrations { current: previous.as_ref(), previous: current.as_ref() }
            }
            PendingSave::Clear => StoreChange::Clear,
        })
    }

    /// Makes an accepted and saved calibration the current one.
    pub fn accept_calibration(&mut self, record: &CalibrationRecord) {
        // In flash, too, a save of calibrations clears this flag.
        self.values.startup_values.is_collecting = false;
        self.values.stored_calibrations.make_current(record);
    }

    /// Ends the pending save, and applies its change if it succeeded.
    pub fn end_save(&mut self, is_saved: bool) -> Option<PendingSave> {
        let pending = self.pending_save.take()?;
        if is_saved {
            self.values.startup_values.is_collecting &= !matches!(pending, PendingSave::Undo | PendingSave::Clear);
            match &pending {
                PendingSave::Undo => self.values.stored_calibrations.undo_last(),
                PendingSave::Clear => self.values.stored_calibrations.clear(),
                PendingSave::Settings(settings) => self.values.settings = *settings,
                PendingSave::StartupValues => {}
            }
        }
        Some(pending)
    }
}
