//! One-time reset of PX4's yaw to the heading: MAV_CMD_EXTERNAL_ATTITUDE_ESTIMATE.
//!
//! With the yaw as a pose PX4 begins to fuse it as soon as its filter has a yaw of its own. A yaw that is wrong by then,
//! from a compass near iron on the ground, is corrected by the command at once, and a filter without a yaw gets one
//! (PX4 1.17, `EKF2.cpp`, `resetHeadingToExternalObservation`). It is sent after the vehicle is armed, and again after a
//! calibration in flight. An older PX4 answers that it does not know it, and is not sent it again.

use mavlink_dialect::{MavAutopilot, MavResult};

use super::transmitter::Transmitter;
use crate::wire::mavlink::{Acknowledgement, Address, OutboundMessage, Pose};
use autoswing::time::Timestamp;

/// Time for the answer, microseconds.
const REPLY_TIMEOUT_US: u64 = 1_000_000;

/// Number of commands without a positive answer.
const ATTEMPTS: u8 = 3;

/// Progress of the reset.
#[derive(Debug, Default)]
pub(super) struct HeadingReset {
    /// Number of the calibration for which the yaw was reset in this flight.
    reset_calibration: Option<u8>,
    attempts: u8,
    sent_at: Timestamp,
    is_unsupported: bool,
}

impl HeadingReset {
    /// Processes the autopilot's answer to the command.
    pub fn on_acknowledgement(&mut self, ack: Acknowledgement) {
        if ack.command_number == OutboundMessage::EXTERNAL_ATTITUDE_ESTIMATE.0 {
            self.is_unsupported |= ack.result == MavResult::MAV_RESULT_UNSUPPORTED.0;
            if ack.result == MavResult::MAV_RESULT_ACCEPTED.0 {
                self.attempts = ATTEMPTS;
            }
        }
    }

    /// Sends the due command; returns whether one was sent.
    pub fn send_due_command(
        &mut self,
        now: Timestamp,
        (autopilot, firmware): (Address, MavAutopilot),
        is_armed: bool,
        pose: Option<&Pose>,
        line: &mut Transmitter<'_>,
    ) -> bool {
        let is_px4 = firmware == MavAutopilot::MAV_AUTOPILOT_PX4;
        let Some(pose) = pose.filter(|_| is_armed && is_px4 && !self.is_unsupported) else {
            if !is_armed {
                self.reset_calibration = None;
            }
            return false;
        };
        if self.reset_calibration != Some(pose.reset_counter) {
            (self.reset_calibration, self.attempts) = (Some(pose.reset_counter), 0);
        }
        let is_due = self.attempts == 0 || now.us_since(self.sent_at) >= REPLY_TIMEOUT_US;
        let is_sent = self.attempts < ATTEMPTS
            && is_due
            && line.send_message(OutboundMessage::external_yaw_estimate(autopilot, pose));
        if is_sent {
            (self.attempts, self.sent_at) = (self.attempts + 1, now);
        }
        is_sent
    }
}
