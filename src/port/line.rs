//! A port: the protocols that it can speak, and which it does.

use super::{Facts, Heard, Mavlink, Nmea, Order, Output, Protocol, ProtocolKind};
use crate::compass::Refusal;
use crate::time::Timestamp;

/// A line whose far end says nothing that is understood for so long is searched anew, microseconds.
const SILENCE_US: u64 = 10_000_000;

/// A port. Whatever it speaks, it hears the protocols of autopilots.
#[derive(Debug)]
pub struct Port {
    chosen: ProtocolKind,
    /// Of `auto`: what the far end speaks, and when it was heard last.
    found: Option<(ProtocolKind, Timestamp)>,
    mavlink: Mavlink,
    nmea: Nmea,
    /// What is to be written.
    pub output: Output,
}

impl Port {
    /// A port on which nothing was heard.
    #[must_use]
    pub const fn new(chosen: ProtocolKind) -> Self {
        Self { chosen, found: None, mavlink: Mavlink::new(), nmea: Nmea::new(), output: Output::new() }
    }

    /// Speaks this from now on.
    pub fn choose(&mut self, chosen: ProtocolKind) {
        if chosen != self.chosen {
            self.chosen = chosen;
            self.found = None;
        }
    }

    /// What is spoken at this instant: of `auto`, what was found, or `auto` while it is searched.
    #[must_use]
    pub fn spoken(&self, now: Timestamp) -> ProtocolKind {
        let found = self.found.filter(|(_, at)| now.us_since(*at) <= SILENCE_US).map(|(kind, _)| kind);
        if self.chosen == ProtocolKind::Auto { found.unwrap_or(self.chosen) } else { self.chosen }
    }

    /// Takes a byte that came at an instant.
    pub fn byte(&mut self, at: Timestamp, byte: u8) -> Option<Heard> {
        let heard = self.mavlink.byte(at, byte);
        if heard.is_some() {
            self.found = Some((ProtocolKind::Mavlink, at));
        }
        heard
    }

    /// Whether the autopilot at the far end is armed, if it has said so lately.
    #[must_use]
    pub fn is_armed(&self, now: Timestamp) -> Option<bool> {
        self.mavlink.is_armed(now)
    }

    /// Frames that were broken or impossible; wraps.
    #[must_use]
    pub fn rejected(&self) -> u32 {
        self.mavlink.rejected()
    }

    /// Appends what is due to the output.
    pub fn poll(&mut self, facts: &Facts<'_>) {
        match self.spoken(facts.now) {
            ProtocolKind::Mavlink => self.mavlink.poll(facts, &mut self.output),
            ProtocolKind::Nmea => self.nmea.poll(facts, &mut self.output),
            ProtocolKind::Auto | ProtocolKind::Msp => {}
        }
    }

    /// What became of an order that came here.
    pub fn answer(&mut self, order: Order, result: Result<(), &Refusal>) {
        self.mavlink.answer(order, result);
    }

    /// A line for whoever looks at a ground station.
    pub fn note(&mut self, text: &str) {
        self.mavlink.note(text);
    }
}
