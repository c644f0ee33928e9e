//! Saves, and their results.

use super::activity::{Activity, PendingSave, Solve, SolveStage};
use crate::compass::events::{Effect, Reply};
use crate::compass::state::Compass;
use crate::messages::{ExpectedAccuracy, Message, Refusal};
use crate::store::{StoreChange, StoreError, StoredCalibrations};

impl Compass<'_> {
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
