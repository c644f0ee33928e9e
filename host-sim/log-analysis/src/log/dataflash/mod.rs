//! Reader for ArduPilot's DataFlash logs, binary and text.
//!
//! Names and instances follow ArduPilot's LogStructure.h through the years. Since 2020-11 the instance is a column
//! (MAG.I, IMU.I, GPS.I, BAT.Inst); before, there were MAG2, MAG3, IMU2. CURR preceded BAT, TimeMS preceded TimeUS (T
//! in GPS).

mod formats;
mod messages;

pub use formats::{is_sdlog2, is_without_start, matches_header, read_binary, read_text};
pub(super) use messages::{LogMessage, MESSAGES_TO_READ, ardupilot_builder, quaternion_to_euler_rad, record_message};

#[cfg(test)]
mod tests;
