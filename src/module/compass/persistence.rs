//! State that survives a restart, and its saves: the running collection in RAM, and in flash calibrations, settings,
//! whether a collection was running, and the detected protocols.

use super::activity::{Activity, CollectionStarter, PendingSave, Solve, SolveStage};
use crate::compass::events::{Effect, Reply};
use crate::compass::state::Compass;
use crate::messages::{ExpectedAccuracy, Message, Refusal};
use crate::settings::{PORT_COUNT, PortNumber, ProtocolKind};
use crate::store::{StoreChange, StoreError, StoredCalibrations};
use autoswing::collection::{CollectionContext, CollectionState};
use autoswing::time::WrappingMillis;

impl Compass<'_> {
    /// Resumes a collection that survived the restart, or detects that one was lost.
    pub(super) fn restore_collection(&mut self) {
        match self.collector.restored_context() {
            // Only a collection saved under the present calibration continues. With another serial number, its solve
            // has produced the present calibration.
            Some(CollectionContext { is_automatic: was_automatic, calibration_serial: serial })
                if serial == self.calibration_serial() =>
            {
                match self.collector.collection_state() {
                    CollectionState::Running => {
                        let starter = if was_automatic { CollectionStarter::Module } else { CollectionStarter::User };
                        self.activity = Activity::Collecting(starter);
                        self.automatic_start.is_overridden = !was_automatic;
                    }
                    CollectionState::Stopped => self.automatic_start.is_overridden = true,
                    CollectionState::Inactive => {}
                }
            }
            Some(_) => self.collector.discard_collection(),
            None if self.persistent_state.last_written_values.is_collecting => {
                self.last_collection_outcome = Some(Message::CollectionLost);
            }
            None => {}
        }
    }

    /// Updates the checksum of the retained collection.
    pub(super) fn update_retained_checksum(&mut self) {
        self.collector.update_header(CollectionContext {
            is_automatic: self.activity.is_automatic(),
            calibration_serial: self.calibration_serial(),
        });
    }

    /// Serial number of the current calibration; 0 without one.
    fn calibration_serial(&self) -> u32 {
        self.stored_calibrations.current_calibration.as_ref().map_or(0, |record| record.serial_number)
    }

    /// Saves changed values while idle.
    pub(super) fn save_startup_values(
        &mut self,
        detected_protocols: [ProtocolKind; PORT_COUNT],
        now: WrappingMillis,
    ) -> Effect {
        let mut new_values = self.persistent_state.last_written_values;
        new_values.is_collecting = match self.collector.collection_state() {
            CollectionState::Inactive => false,
            CollectionState::Stopped | CollectionState::Running => {
                new_values.is_collecting || self.collector.is_loss_reportable()
            }
        };
        if let Some(settled) = self.persistent_state.stable_protocols(detected_protocols, now) {
            for ((number, detected), kind) in
                PortNumber::ALL_PORTS.into_iter().zip(&mut new_values.detected_protocols).zip(settled)
            {
                // Failed detection does not replace an earlier result, nor does a configured protocol.
                if self.settings.settings_of_port(number).protocol == ProtocolKind::Auto && kind != ProtocolKind::Auto {
                    *detected = kind;
                }
            }
        }
        if new_values == self.persistent_state.last_written_values || self.needs_solve_step() || self.is_saving() {
            return Effect::None;
        }
        self.persistent_state.last_written_values = new_values;
        self.request_save(PendingSave::StartupValues(new_values))
    }

    /// Data to write after [`Effect::Save`].
    #[must_use]
    pub fn pending_change(&self) -> Option<StoreChange<'_>> {
        let StoredCalibrations { current_calibration: current, previous_calibration: previous } =
            &self.stored_calibrations;
        if let Activity::Solving(Solve { stage: SolveStage::Saving(record), .. }) = &self.activity {
            return Some(StoreChange::StoredCalibrations { current: Some(record), previous: current.as_ref() });
        }
        Some(match self.pending_save.as_ref()? {
            PendingSave::Settings(settings) => StoreChange::Settings(settings),
            PendingSave::StartupValues(startup_values) => StoreChange::StartupValues(*startup_values),
            PendingSave::Undo => {
                StoreChange::StoredCalibrations { current: previous.as_ref(), previous: current.as_ref() }
            }
            PendingSave::Clear => StoreChange::Clear,
        })
    }

    pub(super) fn is_saving(&self) -> bool {
        self.pending_change().is_some()
    }

    pub(super) fn restore_previous_calibration(&mut self) -> Result<Effect, Refusal> {
        self.stored_calibrations.previous_calibration.as_ref().ok_or(Refusal::NoPreviousCalibration)?;
        Ok(self.request_save(PendingSave::Undo))
    }

    pub(super) fn request_save(&mut self, pending: PendingSave) -> Effect {
        self.pending_save = Some(pending);
        Effect::Save
    }

    #[inline(never)]
    pub(super) fn on_saved(&mut self, result: Result<(), StoreError>) -> Effect {
        if let Activity::Solving(Solve { stage: SolveStage::Saving(record), purpose, .. }) = &self.activity {
            let purpose = *purpose;
            let outcome = result.map_err(Refusal::Store).map(|()| {
                self.persistent_state.clear_collection_flag();
                self.stored_calibrations.make_current(record);
                ExpectedAccuracy::new(record.quality, &record.calibration)
            });
            return self.end_solve(purpose, outcome);
        }
        let Some(saving) = self.pending_save.take() else { return Effect::None };
        match (saving, result) {
            // A save without a command has no reply and no retry. Headings continue, so only this message shows the
            // failure.
            (PendingSave::StartupValues(_), Err(error @ StoreError::Timeout)) => {
                Effect::Notify(Message::StoreFailed(error))
            }
            (PendingSave::StartupValues(_), _) => Effect::None,
            (_, Err(error)) => Effect::Reply(Err(Refusal::Store(error))),
            (PendingSave::Undo, Ok(())) => {
                self.persistent_state.clear_collection_flag();
                self.stored_calibrations.undo_last();
                self.reply_done()
            }
            (PendingSave::Clear, Ok(())) => {
                self.persistent_state.clear_collection_flag();
                self.stored_calibrations.clear();
                self.enable_automatic_start(self.settings.auto_on);
                self.reply_done()
            }
            (PendingSave::Settings(settings), Ok(())) => {
                if !settings.auto_on && self.settings.auto_on {
                    self.enable_automatic_start(false);
                }
                self.settings = settings;
                self.reply_done()
            }
        }
    }

    fn reply_done(&self) -> Effect {
        Effect::Reply(Ok(Reply::Done(self.module_state())))
    }
}
