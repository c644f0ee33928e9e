//! Saves, and their results.

use super::activity::{Activity, PendingSave, Solve, SolveStage};
use super::{Compass, Effect, Reply};
use crate::messages::{ExpectedAccuracy, Message, Refusal};
use crate::store::{Generations, StoreChange, StoreError};

impl Compass<'_> {
    /// Data to write after [`Effect::Save`].
    #[must_use]
    pub fn pending_change(&self) -> Option<StoreChange<'_>> {
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

    pub(super) fn is_saving(&self) -> bool {
        self.pending_change().is_some()
    }

    pub(super) fn restore_previous(&mut self) -> Result<Effect, Refusal> {
        self.generations.previous.as_ref().ok_or(Refusal::NoPreviousCalibration)?;
        Ok(self.request_save(PendingSave::Undo))
    }

    pub(super) fn request_save(&mut self, pending: PendingSave) -> Effect {
        self.saving = Some(pending);
        Effect::Save
    }

    #[inline(never)]
    pub(super) fn on_saved(&mut self, result: Result<(), StoreError>) -> Effect {
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
            // A save without a command has no reply and no retry. Headings continue, so only this message shows the
            // failure.
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
}
