//! The module's component in the autopilot's system: taken after listening, so that two modules of one autopilot have
//! different ones.
//!
//! ArduPilot forwards the heartbeat of a component to lines that have sent a message, except those that the component
//! itself has used (`GCS_MAVLINK::packetReceived`, `MAVLink_routing::handle_heartbeat`). So the first requests are those
//! of another component, on each line; heartbeats of a module with the same component arrive then. The delay to the end
//! of the listening differs between most modules that start together. Others detect each other by named values, which
//! ArduPilot forwards to all lines, and listen again.

use autoswing::time::{Timestamp, WrappingMillis};
use autoswing_module::settings::Settings;

/// Component of the first requests (MAV_COMP_ID_USER75).
pub(super) const LISTENING_COMPONENT: u8 = 99;

/// Component of a second module (MAV_COMP_ID_USER1), and the first one of further modules.
const SECOND_COMPONENT: u8 = 25;

/// Last component that the setting accepts.
const LAST_COMPONENT: u8 = 250;

/// Least time of listening, microseconds: heartbeats are a second apart.
const LISTENING_US: u64 = 1_300_000;

/// Further time, a number of steps by the low digits of the clock, microseconds: longer than a heartbeat takes.
const STEP_US: u64 = 100_000;
const STEP_COUNT: u64 = 8;

/// Number of times that a component is given up after it was claimed, until the next start: the module's own messages
/// that return late look like those of another.
const MAX_SHARED_COUNT: u8 = 3;

#[derive(Clone, Copy, Debug, Default)]
enum ClaimState {
    /// Nothing was sent yet.
    #[default]
    Silent,
    Listening {
        since: Timestamp,
        /// Whether another module's heartbeat was received.
        is_taken: bool,
    },
    Claimed,
}

/// Component of the module on a line.
#[derive(Debug)]
pub(super) struct ComponentClaim {
    /// Component by the settings.
    component: u8,
    state: ClaimState,
    /// Whether another line of the module has an autopilot by MAVLink, which forwards this line's messages to it.
    pub has_other_line: bool,
    named_value_sent_at: Timestamp,
    /// Whether another module has sent as this component after it was claimed.
    is_shared: bool,
    shared_count: u8,
}

impl Default for ComponentClaim {
    fn default() -> Self {
        Self {
            component: Settings::DEFAULT.component,
            state: ClaimState::Silent,
            has_other_line: false,
            named_value_sent_at: Timestamp::START,
            is_shared: false,
            shared_count: 0,
        }
    }
}

impl ComponentClaim {
    /// The component, to which commands are addressed.
    pub const fn component(&self) -> u8 {
        self.component
    }

    /// Component that sends the next message.
    pub const fn sender_component(&self) -> u8 {
        if self.is_claimed() { self.component } else { LISTENING_COMPONENT }
    }

    pub const fn is_claimed(&self) -> bool {
        matches!(self.state, ClaimState::Claimed)
    }

    /// Processes a heartbeat of the autopilot's system.
    pub const fn on_heartbeat(&mut self, component: u8) {
        if let ClaimState::Listening { is_taken, .. } = &mut self.state {
            *is_taken |= component == self.component;
        }
    }

    /// Processes a named value of the autopilot's system, with its sender's clock. The module's last one may come back.
    pub fn on_named_value(&mut self, component: u8, sender_clock: WrappingMillis) {
        self.is_shared |= component == self.component
            && self.is_claimed()
            && !self.has_other_line
            && sender_clock != self.named_value_sent_at.wrapping_millis();
    }

    /// Records that a named value was sent.
    pub const fn on_named_value_sent(&mut self, at: Timestamp) {
        self.named_value_sent_at = at;
    }

    /// Records that a message was sent.
    pub const fn on_message_sent(&mut self, at: Timestamp) {
        if let ClaimState::Silent = self.state {
            self.state = ClaimState::Listening { since: at, is_taken: false };
        }
    }

    /// Follows the settings; returns a new component if another module has this one. A settled component stays: in flight,
    /// without an autopilot, and beside another line of this module, whose heartbeats arrive here.
    pub fn update(&mut self, now: Timestamp, component: u8, is_settled: bool) -> Option<u8> {
        let is_settled = is_settled || self.has_other_line;
        if self.is_shared && !is_settled {
            self.is_shared = false;
            if self.shared_count < MAX_SHARED_COUNT {
                self.shared_count += 1;
                self.state = ClaimState::Listening { since: now, is_taken: true };
            }
        }
        let is_changed = self.component != component;
        self.component = component;
        let ClaimState::Listening { since, is_taken } = &mut self.state else {
            if is_settled {
                self.state = ClaimState::Claimed;
            }
            return None;
        };
        if is_changed {
            (*since, *is_taken) = (now, false);
        }
        let listening_us = LISTENING_US + STEP_US * (since.as_us() % STEP_COUNT);
        if !is_settled && now.us_since(*since) < listening_us {
            return None;
        }
        if !is_settled && *is_taken {
            *since = now;
            return Some(next_component(component));
        }
        self.state = ClaimState::Claimed;
        None
    }
}

/// Component to try after `taken`, which another module uses.
const fn next_component(taken: u8) -> u8 {
    if taken == Settings::DEFAULT.component || taken >= LAST_COMPONENT { SECOND_COMPONENT } else { taken + 1 }
}
