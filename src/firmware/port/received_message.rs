//! What the protocols of a port receive.

use autoswing::attitude::AttitudeReport;
use autoswing::earth::{Date, Position};
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
