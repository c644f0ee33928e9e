//! What the module sends: frames of MAVLink 2.
//!
//! The library's serialisers leave out the fields that version 2 has added to a message (whom an acknowledgement is for,
//! which piece of a text it is, the uncertainty of a pose) and check each field for room. Here a payload is put together
//! from numbers, in the order of the wire: the largest first, what was added last (mavlink.io, "Serialization"). Numbers
//! and extra bytes of messages are the library's, where it has them.

use mavlink::MessageData;
use mavlink::dialects::common::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MAG_CAL_REPORT_DATA, MagCalStatus, MavAutopilot, MavCmd,
    MavResult, MavSeverity, MavState, MavType, NAMED_VALUE_FLOAT_DATA, STATUSTEXT_DATA, VISION_POSITION_ESTIMATE_DATA,
};

use super::{Address, V2, V2_HEADER, checksum};
use crate::time::Timestamp;

/// The longest payload: a VISION_POSITION_ESTIMATE's, with its covariance.
const MAX_PAYLOAD: usize = 117;

/// A frame to be written.
pub type Frame = heapless::Vec<u8, { V2_HEADER + MAX_PAYLOAD + 2 }>;

/// A message to be sent.
#[derive(Clone, Debug)]
pub struct Outgoing {
    /// Header and payload; the header holds only the message's number yet.
    frame: Frame,
    extra_crc: u8,
}

/// Where the module points, for VISION_POSITION_ESTIMATE.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The instant that it is of.
    pub at: Timestamp,
    /// Roll, pitch and true heading, radians, -pi..pi.
    pub roll_pitch_yaw_rad: [f32; 3],
    /// Variance of the heading, square radians.
    pub yaw_variance_rad2: f32,
    /// Counts the jumps of the heading that are none of the aircraft; wraps.
    pub reset_counter: u8,
}

/// What a calibration has found, for MAG_CAL_REPORT: `corrected = M (raw + offset)`, all in body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MagCalReport {
    /// Whether there is a new calibration, and it was stored.
    pub is_success: bool,
    /// RMS of what the calibration leaves on an axis, milligauss.
    pub fitness_mg: f32,
    /// What is added to a raw field, milligauss.
    pub offset_mg: [f32; 3],
    /// `M`'s diagonal: xx, yy, zz.
    pub diagonal: [f32; 3],
    /// What is beside it, alike on both sides: xy, xz, yz.
    pub off_diagonal: [f32; 3],
}

impl Outgoing {
    /// HEARTBEAT of an onboard controller that is no autopilot.
    #[must_use]
    pub fn heartbeat(state: MavState) -> Self {
        const VERSION: u8 = 3;
        let (kind, autopilot) = (MavType::MAV_TYPE_ONBOARD_CONTROLLER, MavAutopilot::MAV_AUTOPILOT_INVALID);
        let mut message = Self::of::<HEARTBEAT_DATA>();
        message.put(&[0, 0, 0, 0, kind as u8, autopilot as u8, 0, state as u8, VERSION]);
        message
    }

    /// COMMAND_LONG with MAV_CMD_SET_MESSAGE_INTERVAL: a message so many times a second, of this link.
    #[must_use]
    pub fn set_message_interval(target: Address, message_id: u32, rate_hz: u8) -> Self {
        let interval_us = 1e6 / f32::from(rate_hz.max(1));
        let mut message = Self::of::<COMMAND_LONG_DATA>();
        message.floats(&[message_id as f32, interval_us, 0.0, 0.0, 0.0, 0.0, 0.0]);
        message.put(&(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16).to_le_bytes());
        message.put(&[target.system, target.component, 0]);
        message
    }

    /// REQUEST_DATA_STREAM: the stream that ATTITUDE belongs to (`EXTRA1`), so many times a second.
    #[must_use]
    pub fn request_attitude_stream(target: Address, rate_hz: u8) -> Self {
        const EXTRA1: u8 = 10;
        const START: u8 = 1;
        // The library calls it superseded, as it is: it is for who does not know what supersedes it.
        let mut message = Self::new(66, 148);
        message.put(&[rate_hz, 0, target.system, target.component, EXTRA1, START]);
        message
    }

    /// COMMAND_ACK to whom it concerns.
    #[must_use]
    pub fn acknowledgement(target: Address, command: u16, result: MavResult) -> Self {
        let mut message = Self::of::<COMMAND_ACK_DATA>();
        message.put(&command.to_le_bytes());
        // How much of it is done, and another result, are not told.
        message.put(&[result as u8, 0, 0, 0, 0, 0, target.system, target.component]);
        message
    }

    /// Characters of a STATUSTEXT.
    pub const TEXT: usize = 50;

    /// STATUSTEXT: a piece of a text, of at most [`Self::TEXT`] characters. The pieces of a text that is longer share a
    /// number that is not 0, and the first that is shorter than a piece can be, or empty, is the last.
    #[must_use]
    pub fn text(severity: MavSeverity, piece: &[u8], number: u16, sequence: u8) -> Self {
        let mut text = [0; Self::TEXT];
        text.iter_mut().zip(piece).for_each(|(to, from)| *to = *from);
        let mut message = Self::of::<STATUSTEXT_DATA>();
        message.put(&[severity as u8]);
        message.put(&text);
        message.put(&number.to_le_bytes());
        message.put(&[sequence]);
        message
    }

    /// NAMED_VALUE_FLOAT; ten characters of the name are sent.
    #[must_use]
    pub fn named_value(at: Timestamp, name: &str, value: f32) -> Self {
        let mut field = [0; 10];
        field.iter_mut().zip(name.bytes()).for_each(|(to, from)| *to = from);
        let mut message = Self::of::<NAMED_VALUE_FLOAT_DATA>();
        message.put(&at.wrapping_millis().count().to_le_bytes());
        message.floats(&[value]);
        message.put(&field);
        message
    }

    /// MAG_CAL_PROGRESS of compass 0: how much of its calibration is done, percent, and where the field points in body axes.
    /// Which directions it has seen is not told.
    #[must_use]
    pub fn mag_cal_progress(percent: u8, direction: [f32; 3]) -> Self {
        // Of ArduPilot's dialect: its number and extra byte.
        let mut message = Self::new(191, 92);
        let status =
            if percent < 100 { MagCalStatus::MAG_CAL_RUNNING_STEP_ONE } else { MagCalStatus::MAG_CAL_RUNNING_STEP_TWO };
        message.floats(&direction);
        message.put(&[0, COMPASSES, status as u8, 1, percent]);
        message
    }

    /// MAG_CAL_REPORT of compass 0.
    #[must_use]
    pub fn mag_cal_report(report: &MagCalReport) -> Self {
        let mut message = Self::of::<MAG_CAL_REPORT_DATA>();
        let status = if report.is_success { MagCalStatus::MAG_CAL_SUCCESS } else { MagCalStatus::MAG_CAL_FAILED };
        message.floats(&[report.fitness_mg]);
        for three in [&report.offset_mg, &report.diagonal, &report.off_diagonal] {
            message.floats(three);
        }
        message.put(&[0, COMPASSES, status as u8, u8::from(report.is_success)]);
        message
    }

    /// VISION_POSITION_ESTIMATE at the origin: of the covariance only the heading's variance is told, the first element
    /// says that the position's is not known.
    #[must_use]
    pub fn vision(pose: &Pose) -> Self {
        /// Upper right triangle of six rows: x, y, z, roll, pitch, yaw. The last is the variance of yaw.
        const UNKNOWN: [f32; 20] = {
            let mut covariance = [0.0; 20];
            covariance[0] = f32::NAN;
            covariance
        };
        let mut message = Self::of::<VISION_POSITION_ESTIMATE_DATA>();
        message.put(&pose.at.as_us().to_le_bytes());
        message.floats(&[0.0; 3]);
        message.floats(&pose.roll_pitch_yaw_rad);
        message.floats(&UNKNOWN);
        message.floats(&[pose.yaw_variance_rad2]);
        message.put(&[pose.reset_counter]);
        message
    }

    /// The frame, from whom and with which number: zeros at the end cut off, and closed by the CRC.
    #[must_use]
    pub fn frame(mut self, from: Address, sequence: u8) -> Frame {
        // A byte of payload stays.
        while self.frame.len() > V2_HEADER + 1 && self.frame.last() == Some(&0) {
            self.frame.pop();
        }
        let payload = self.frame.len() - V2_HEADER;
        if let [_, length, _, _, number, system, component, ..] = self.frame.as_mut_slice() {
            (*length, *number) = (payload as u8, sequence);
            (*system, *component) = (from.system, from.component);
        }
        let crc = checksum(self.frame.get(1..).unwrap_or_default(), self.extra_crc);
        self.put(&crc.to_le_bytes());
        self.frame
    }

    fn of<M: MessageData>() -> Self {
        Self::new(M::ID, M::EXTRA_CRC)
    }

    fn new(id: u32, extra_crc: u8) -> Self {
        let [id_0, id_1, id_2, _] = id.to_le_bytes();
        let mut message = Self { frame: heapless::Vec::new(), extra_crc };
        message.put(&[V2, 0, 0, 0, 0, 0, 0, id_0, id_1, id_2]);
        message
    }

    #[inline(never)]
    fn put(&mut self, bytes: &[u8]) {
        // There is room for the longest message.
        let _ = self.frame.extend_from_slice(bytes);
    }

    #[inline(never)]
    fn floats(&mut self, numbers: &[f32]) {
        for number in numbers {
            self.put(&number.to_le_bytes());
        }
    }
}

/// The compasses of a report, a bit for each: the module is one.
const COMPASSES: u8 = 1;
