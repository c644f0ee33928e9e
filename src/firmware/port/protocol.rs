//! Interface of the protocols.

use crate::port::snapshot::Snapshot;
use crate::port::transmit_buffer::TransmitBuffer;
use autoswing::attitude::AttitudeReport;
use autoswing::earth::{Date, Position};
use autoswing::time::Timestamp;
use autoswing_module::compass::Command;

/// Message received on a port, independent of the protocol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReceivedMessage {
    /// Roll and pitch of the selected sender, with body rates if the protocol has them.
    Attitude(AttitudeReport),
    /// Attitude of another sender, which is only counted.
    RejectedAttitude,
    /// Position of the aircraft.
    Position(Position),
    /// Date.
    Date(Date),
    /// Motor current, amperes.
    Current(f32),
    /// Speed over ground, m/s.
    GroundSpeed(f32),
    /// Command for the state machine, whose result is awaited.
    Command(Command),
    /// Any other message of the protocol, which shows that the protocol is in use.
    Other,
}

/// Protocol of a port.
pub trait Protocol {
    /// Processes a received byte; returns the message that it completes.
    fn process_byte(&mut self, at: Timestamp, byte: u8) -> Option<ReceivedMessage>;

    /// Whether the autopilot is armed, if it has reported that recently.
    fn is_armed(&self, now: Timestamp) -> Option<bool>;

    /// Number of broken or impossible frames since the start; wraps.
    fn rejected_frame_count(&self) -> u32;

    /// Appends due messages. Called for every estimate, at least ten times a second.
    fn poll(&mut self, snapshot: &Snapshot<'_>, out: &mut TransmitBuffer);
}
