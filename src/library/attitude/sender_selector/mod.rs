//! Selection of one attitude sender on a line, preferably an autopilot.
//!
//! An autopilot, its gimbal and relayed aircraft may share one line. Mixing two senders 5 deg apart caused heading
//! errors of 10 deg. Rules:
//!
//! - Attitude of a sender whose heartbeat identifies it as an autopilot is accepted exclusively.
//! - Without a known autopilot heartbeat, the first sender is accepted, unless its heartbeat shows that it is not an
//!   autopilot.
//! - A selected sender, also one of several autopilots, remains selected until its attitude is absent for the expiry
//!   time. Selection needs attitude, so senders of heartbeats alone do not block it.
//! - While armed, the selected sender is not replaced by one of another system, however long its attitude is absent:
//!   that is another vehicle.
//! - The first selected autopilot is the module's own. Where another one replaced it, it is selected again as soon as
//!   it sends attitude.
//! - A sender whose attitude has contradicted the field for a minute is released to another autopilot that sends
//!   attitude.
//! - A heartbeat without an autopilot from the address of a known autopilot is ignored.

use crate::time::Timestamp;

/// Opaque identifier of a sender.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SenderId(u16);

impl SenderId {
    /// Creates an identifier; sources with a single sender, such as recordings, use the default.
    #[must_use]
    pub const fn new(number: u16) -> Self {
        Self(number)
    }

    /// Packed number: the system in the upper byte, the component in the lower one.
    #[must_use]
    pub const fn packed_number(self) -> u16 {
        self.0
    }

    /// System, of which the sender is a component: the upper byte.
    const fn system_id(self) -> u8 {
        self.0.to_be_bytes()[0]
    }
}

/// Heartbeat of a sender, about 1 Hz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heartbeat {
    /// Sender of the heartbeat.
    pub sender: SenderId,
    /// Whether the sender is an autopilot.
    pub is_autopilot: bool,
    /// Whether the vehicle is armed.
    pub is_armed: bool,
}

/// Expiry time of heartbeats and of the selection, microseconds: ten heartbeats.
const SELECTION_EXPIRY_US: u64 = 10_000_000;

/// Time of contradictions after which a sender is released, microseconds: several times the duration of a passing
/// disturbance.
const MAX_CONTRADICTED_US: u64 = 60_000_000;

/// Longest interval between two checks that counts in full, microseconds.
const MAX_CHECK_INTERVAL_US: u64 = 1_000_000;

/// Capacity of the sender table.
const MAX_SENDERS: usize = 8;

/// Entry of the sender table.
#[derive(Clone, Copy, Debug)]
struct SenderEntry {
    sender: SenderId,
    heartbeat: Option<(Timestamp, Heartbeat)>,
    last_attitude_at: Option<Timestamp>,
}

impl SenderEntry {
    /// Heartbeat, unless expired.
    fn last_heartbeat(&self, now: Timestamp) -> Option<Heartbeat> {
        self.heartbeat.filter(|(at, _)| is_unexpired(*at, now)).map(|(_, heartbeat)| heartbeat)
    }

    /// Retention rank: senders of recent attitude first, regardless of heartbeats, then by last message.
    fn retention_priority(&self, now: Timestamp) -> (bool, Timestamp) {
        let last_received_at = self.heartbeat.map(|(at, _)| at).max(self.last_attitude_at).unwrap_or_default();
        (self.last_attitude_at.is_some_and(|at| is_unexpired(at, now)), last_received_at)
    }
}

#[derive(Clone, Copy, Debug)]
struct SelectedSender {
    sender: SenderId,
    last_attitude_at: Timestamp,
    /// Whether a heartbeat identified the sender as an autopilot.
    is_autopilot: bool,
}

/// Sender table and selection of one line.
#[derive(Debug, Default)]
pub struct SenderSelector {
    entries: heapless::Vec<SenderEntry, MAX_SENDERS>,
    /// Selected sender. It remains after its expiry until another one is selected, so that the armed state remains
    /// available when attitude fails.
    selected: Option<SelectedSender>,
    /// Autopilot that was selected first.
    own_autopilot: Option<SenderId>,
    /// Last sender released for its contradictions.
    released_sender: Option<SenderId>,
    /// Time with contradictions minus time without, at least 0, microseconds, and its last update.
    contradicted_us: u64,
    contradiction_checked_at: Timestamp,
}

impl SenderSelector {
    /// No senders yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            entries: heapless::Vec::new(),
            selected: None,
            own_autopilot: None,
            released_sender: None,
            contradicted_us: 0,
            contradiction_checked_at: Timestamp::START,
        }
    }

    /// Processes a heartbeat received at `now`.
    pub fn update_heartbeat(&mut self, now: Timestamp, heartbeat: Heartbeat) {
        let Heartbeat { sender, is_autopilot, .. } = heartbeat;
        let is_known_autopilot =
            self.selected.is_some_and(|selected| selected.sender == sender && selected.is_autopilot)
                || self.last_heartbeat(now, sender).is_some_and(|previous| previous.is_autopilot);
        if is_known_autopilot && !is_autopilot {
            return;
        }
        if let Some(entry) = self.entry_or_insert(now, sender) {
            entry.heartbeat = Some((now, heartbeat));
        }
        self.selected = match self.selected {
            Some(selected) if selected.sender == sender => {
                is_autopilot.then_some(SelectedSender { is_autopilot, ..selected })
            }
            // An autopilot replaces the first sender.
            Some(selected) if is_autopilot && !selected.is_autopilot => None,
            other => other,
        };
    }

    /// Returns whether attitude received at `now` from `sender` is accepted.
    pub fn accept_attitude(&mut self, now: Timestamp, sender: SenderId) -> bool {
        if let Some(entry) = self.entry_or_insert(now, sender) {
            entry.last_attitude_at = Some(now);
        }
        let candidate = match self.selected {
            Some(chosen) if chosen.sender == sender => Some(chosen),
            _ if self.own_autopilot == Some(sender) => {
                Some(SelectedSender { sender, last_attitude_at: now, is_autopilot: true })
            }
            Some(chosen) if is_unexpired(chosen.last_attitude_at, now) || self.is_other_vehicle(chosen, sender) => None,
            _ => self.permitted_selection(now, sender),
        };
        if let Some(candidate) = candidate {
            self.selected = Some(SelectedSender { last_attitude_at: now, ..candidate });
            if candidate.is_autopilot {
                self.own_autopilot.get_or_insert(sender);
            }
        }
        candidate.is_some()
    }

    /// Records whether the selected sender's attitude contradicts the field at `now`; releases the sender after
    /// a net minute if another autopilot sends attitude.
    pub fn record_field_contradiction(&mut self, now: Timestamp, is_contradicted: bool) {
        let elapsed_us = now.us_since(self.contradiction_checked_at).min(MAX_CHECK_INTERVAL_US);
        self.contradiction_checked_at = now;
        self.contradicted_us = if is_contradicted {
            (self.contradicted_us + elapsed_us).min(MAX_CONTRADICTED_US)
        } else {
            self.contradicted_us.saturating_sub(elapsed_us)
        };
        if let Some(SelectedSender { sender: source, .. }) = self.selected
            && self.contradicted_us == MAX_CONTRADICTED_US
            && self.has_other_autopilot(now, source)
        {
            (self.selected, self.own_autopilot, self.released_sender) = (None, None, Some(source));
            self.contradicted_us = 0;
        }
    }

    /// Whether `sender` is of another system than the selected sender, whose last heartbeat was armed.
    fn is_other_vehicle(&self, selected: SelectedSender, sender: SenderId) -> bool {
        let last_heartbeat =
            self.entries.iter().find(|entry| entry.sender == selected.sender).and_then(|entry| entry.heartbeat);
        selected.sender.system_id() != sender.system_id()
            && last_heartbeat.is_some_and(|(_, heartbeat)| heartbeat.is_armed)
    }

    /// Whether an autopilot other than `sender` sends attitude.
    fn has_other_autopilot(&self, now: Timestamp, sender: SenderId) -> bool {
        self.entries.iter().any(|entry| {
            entry.sender != sender
                && entry.last_attitude_at.is_some_and(|at| is_unexpired(at, now))
                && entry.last_heartbeat(now).is_some_and(|heartbeat| heartbeat.is_autopilot)
        })
    }

    /// Armed state of the selected sender; `None` without a recent heartbeat.
    #[must_use]
    pub fn is_armed(&self, now: Timestamp) -> Option<bool> {
        self.selected.and_then(|selected| self.last_heartbeat(now, selected.sender)).map(|heartbeat| heartbeat.is_armed)
    }

    /// Autopilot to query: the selected one, or before any attitude the first with a recent autopilot heartbeat.
    #[must_use]
    pub fn autopilot_to_query(&self, now: Timestamp) -> Option<SenderId> {
        let selected = self.selected.filter(|selected| selected.is_autopilot).map(|selected| selected.sender);
        let autopilot_heartbeat = || {
            self.entries
                .iter()
                .filter_map(|entry| entry.last_heartbeat(now))
                .find(|autopilot_heartbeat| autopilot_heartbeat.is_autopilot)
        };
        selected.or_else(|| autopilot_heartbeat().map(|heartbeat| heartbeat.sender))
    }

    /// Selects a sender, if the rules permit it.
    fn permitted_selection(&self, now: Timestamp, sender: SenderId) -> Option<SelectedSender> {
        let heartbeat_of_source = self.last_heartbeat(now, sender);
        let autopilots = || {
            self.entries.iter().filter_map(|entry| entry.last_heartbeat(now)).any(|heartbeat| heartbeat.is_autopilot)
        };
        let is_selectable = heartbeat_of_source
            .map_or_else(|| !autopilots(), |heartbeat_of_source| heartbeat_of_source.is_autopilot)
            && !(self.released_sender == Some(sender) && self.has_other_autopilot(now, sender));
        is_selectable.then_some(SelectedSender {
            sender,
            last_attitude_at: now,
            is_autopilot: heartbeat_of_source.is_some(),
        })
    }

    fn last_heartbeat(&self, now: Timestamp, source: SenderId) -> Option<Heartbeat> {
        self.entries.iter().find(|entry| entry.sender == source)?.last_heartbeat(now)
    }

    /// Table entry of a sender. A new sender in a full table replaces the lowest-ranked one, never the selected one.
    fn entry_or_insert(&mut self, now: Timestamp, sender: SenderId) -> Option<&mut SenderEntry> {
        if self.entries.iter().all(|entry| entry.sender != sender) {
            if self.entries.is_full() {
                let selected = self.selected.map(|selected| selected.sender);
                let replaceable_entries =
                    self.entries.iter().enumerate().filter(|(_, entry)| Some(entry.sender) != selected);
                let (lowest_ranked, _) = replaceable_entries.min_by_key(|(_, entry)| entry.retention_priority(now))?;
                self.entries.swap_remove(lowest_ranked);
            }
            // Cannot fail: an entry was removed if full.
            let _ = self.entries.push(SenderEntry { sender, heartbeat: None, last_attitude_at: None });
        }
        self.entries.iter_mut().find(|entry| entry.sender == sender)
    }
}

fn is_unexpired(received_at: Timestamp, now: Timestamp) -> bool {
    now.us_since(received_at) <= SELECTION_EXPIRY_US
}

#[cfg(test)]
mod tests;
