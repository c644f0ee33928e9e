//! Values in flash for the next start: whether a collection was running, and the detected protocols.

use crate::settings::{PORT_COUNT, ProtocolKind};
use crate::store::StartupValues;
use autoswing::time::WrappingMillis;

/// Duration after which a detected protocol is stored, milliseconds.
const STABLE_DETECTION_MS: u32 = 5000;

#[derive(Debug)]
pub(super) struct PersistentState {
    /// Values written last, successfully or not.
    pub last_written_values: StartupValues,
    /// Detected protocols, and since when.
    detected_since: Option<([ProtocolKind; PORT_COUNT], WrappingMillis)>,
}

impl PersistentState {
    pub const fn new(stored: StartupValues) -> Self {
        Self { last_written_values: stored, detected_since: None }
    }

    /// Clears the collection flag, as every save of calibrations does in flash.
    pub const fn clear_collection_flag(&mut self) {
        self.last_written_values.is_collecting = false;
    }

    /// Detected protocols, once constant for long enough.
    pub fn stable_protocols(
        &mut self,
        detected_protocols: [ProtocolKind; PORT_COUNT],
        now: WrappingMillis,
    ) -> Option<[ProtocolKind; PORT_COUNT]> {
        let (candidate, since) = *self.detected_since.get_or_insert((detected_protocols, now));
        if candidate != detected_protocols {
            self.detected_since = Some((detected_protocols, now));
            return None;
        }
        (now.ms_since(since) >= STABLE_DETECTION_MS).then_some(detected_protocols)
    }
}
