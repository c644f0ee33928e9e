//! State that survives a restart: the running collection in RAM, and in flash whether one was running and which
//! protocols were detected.

use super::activity::{Activity, CollectionStarter, PendingSave};
use crate::compass::events::Effect;
use crate::compass::state::Compass;
use crate::messages::Message;
use crate::settings::{PORT_COUNT, PortNumber, ProtocolKind};
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
}
