//! What a MAVLink autopilot receives from the module, in the simulator and in QEMU.

use autoswing::calibration::{Calibration, MotorCurrentInterference};
use log_analysis::score::wrap_180;
use simulator::world::mavlink_autopilot::MavlinkFrame;
use simulator::world::{CRUISE_CURRENT_A, World, WorldConfig};

pub const HEARTBEAT: u32 = 0;
pub const MAG_CAL_PROGRESS: u32 = 191;
pub const MAG_CAL_REPORT: u32 = 192;
const NAMED_VALUE_FLOAT: u32 = 251;
const STATUSTEXT: u32 = 253;

pub fn frames_with_id(id: u32, frames: &[MavlinkFrame]) -> Vec<&MavlinkFrame> {
    frames.iter().filter(|frame| frame.message_id == id).collect()
}

/// Complete status texts, without the spaces that fill chunks; byte 53 is the chunk number of a text in several frames.
pub fn status_texts(frames: &[MavlinkFrame]) -> Vec<String> {
    let mut texts: Vec<String> = Vec::new();
    for frame in frames_with_id(STATUSTEXT, frames) {
        let characters: Vec<u8> =
            (1..51).map(|byte_index| frame.byte_at(byte_index)).take_while(|&byte| byte != 0).collect();
        let chunk = String::from_utf8(characters).expect("plain characters");
        if frame.byte_at(53) > 0 {
            texts.last_mut().expect("its beginning").push_str(&chunk);
        } else {
            texts.push(chunk);
        }
    }
    let without_fill = |text: String| text.split_whitespace().collect::<Vec<_>>().join(" ");
    texts.into_iter().map(without_fill).collect()
}

/// Whether a `MAG_CAL_REPORT` has status `MAG_CAL_SUCCESS` (4) and `autosaved` 1.
pub fn has_calibration_success(frames: &[MavlinkFrame]) -> bool {
    frames_with_id(MAG_CAL_REPORT, frames).iter().any(|report| (report.byte_at(42), report.byte_at(43)) == (4, 1))
}

/// Errors of the named values `hdg_mag` at their time stamps, degrees.
pub fn named_heading_errors_deg(frames: &[MavlinkFrame], world: &World) -> Vec<f64> {
    let is_heading = |frame: &&MavlinkFrame| (8..15).map(|byte_index| frame.byte_at(byte_index)).eq(*b"hdg_mag");
    let error_deg = |frame: &MavlinkFrame| {
        let time_ms = u32::from_le_bytes([0, 1, 2, 3].map(|byte_index| frame.byte_at(byte_index)));
        wrap_180(f64::from(frame.float_at(4)) - world.true_state(u64::from(time_ms) * 1000).heading_deg())
    };
    frames_with_id(NAMED_VALUE_FLOAT, frames).into_iter().filter(is_heading).map(error_deg).collect()
}

/// Within four sigmas of the interference that the world adds.
#[track_caller]
pub fn assert_current_interference_is_estimated(calibration: &Calibration, world: &WorldConfig) {
    let MotorCurrentInterference { ut_per_a, sigma_ut_per_a, .. } = calibration.motor_current;
    for (estimated_ut_per_a, added_field_ut) in ut_per_a.iter().zip(world.current_interference_ut) {
        let error_ut_per_a = f64::from(*estimated_ut_per_a) - added_field_ut / CRUISE_CURRENT_A;
        assert!(error_ut_per_a.abs() < 4.0 * f64::from(sigma_ut_per_a), "{ut_per_a:?} in {world:?}");
    }
}
