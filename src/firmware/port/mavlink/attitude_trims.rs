//! ArduPilot's trims: the difference between the attitude that it sends and the frame in which it uses a compass.
//!
//! ArduPilot's filter works in the body frame of its sensors. The Euler angles of ATTITUDE are the filter's minus
//! AHRS_TRIM_X and AHRS_TRIM_Y (`NavEKF3_core::getEulerAngles`); an aeroplane subtracts PTCH_TRIM_DEG from pitch, too,
//! unless bit 8 of FLIGHT_OPTIONS is set (`GCS_MAVLINK_Plane::send_attitude`). The sum of both is the filter's attitude
//! again, so that calibration, heading and field are in the filter's frame, whatever the trims are, and were.
//!
//! A quadplane's attitude in VTOL modes has Q_TRIM_PITCH in place of PTCH_TRIM_DEG. The mode is not known here, so that
//! its pitch trims are reported instead of being used.

use core::f32::consts::FRAC_PI_2;

use autoswing::frames::{RollPitch, wrap_pi};
use autoswing_module::messages::ParameterName;

/// Parameters that determine the trims.
const PARAMETER_NAMES: [&str; PARAMETER_COUNT] = [
    "AHRS_TRIM_X",
    "AHRS_TRIM_Y",
    "PTCH_TRIM_DEG",
    // Before version 4.5, in hundredths of a degree.
    "TRIM_PITCH_CD",
    "FLIGHT_OPTIONS",
    "Q_ENABLE",
    "Q_TRIM_PITCH",
];

const PARAMETER_COUNT: usize = 7;

/// Bit of FLIGHT_OPTIONS: pitch is sent without PTCH_TRIM_DEG.
const UNTRIMMED_PITCH_OPTION: u32 = 1 << 8;

/// Largest trim, radians: the range of PTCH_TRIM_DEG, 45 deg, and of AHRS_TRIM_Y, 10 deg.
const MAX_TRIM_RAD: f32 = 0.96;

/// Trims of the autopilot's attitude.
#[derive(Debug, Default)]
pub(super) struct AttitudeTrims {
    /// Numbers of the parameters; zero until read, and where this firmware lacks one.
    numbers: [f32; PARAMETER_COUNT],
    /// Index of the parameter to read next; past the end after all.
    next_index: u8,
    /// Whether the trims of a quadplane were reported as ambiguous.
    is_ambiguity_reported: bool,
}

impl AttitudeTrims {
    /// Name of the parameter to read next; none after all.
    pub fn next_name(&self) -> Option<ParameterName> {
        PARAMETER_NAMES.get(usize::from(self.next_index)).map(|name| ParameterName::new(name))
    }

    /// Ends the read of [`next_name`](Self::next_name).
    pub const fn advance_reading(&mut self) {
        self.next_index = self.next_index.saturating_add(1);
    }

    /// Reads all parameters again: a trim may change without a message.
    pub const fn restart_reading(&mut self) {
        self.next_index = 0;
    }

    /// Processes a parameter of the autopilot, which it also sends when the parameter changes.
    pub fn on_parameter(&mut self, name: ParameterName, number: f32) {
        let index = PARAMETER_NAMES.iter().position(|known| ParameterName::new(known) == name);
        if let Some(stored) = index.and_then(|index| self.numbers.get_mut(index)) {
            *stored = number;
        }
    }

    /// Attitude in the frame of the autopilot's filter, from the attitude that it sent.
    pub fn untrimmed_attitude(&self, sent: RollPitch) -> RollPitch {
        let [roll_trim_rad, pitch_trim_rad] = self.trims_rad();
        RollPitch {
            roll_rad: wrap_pi(sent.roll_rad + roll_trim_rad),
            pitch_rad: (sent.pitch_rad + pitch_trim_rad).clamp(-FRAC_PI_2, FRAC_PI_2),
        }
    }

    /// Roll and pitch that the autopilot subtracts, radians; zero where an impossible number was received.
    pub fn trims_rad(&self) -> [f32; 2] {
        let [roll_trim_rad, pitch_trim_rad, ..] = self.numbers;
        let plane_trim_rad = if self.is_ambiguous() { 0.0 } else { self.plane_pitch_trim_rad() };
        [roll_trim_rad, pitch_trim_rad + plane_trim_rad]
            .map(|trim_rad| if trim_rad.abs() <= MAX_TRIM_RAD { trim_rad } else { 0.0 })
    }

    /// Whether the trims have become ambiguous since the last call.
    pub fn take_ambiguity(&mut self) -> bool {
        let was_reported = self.is_ambiguity_reported;
        // Half the parameters may look ambiguous although the whole is not.
        if self.next_name().is_none() {
            self.is_ambiguity_reported = self.is_ambiguous();
        }
        self.is_ambiguity_reported && !was_reported
    }

    /// Whether the pitch trim depends on the mode of a quadplane.
    fn is_ambiguous(&self) -> bool {
        let [.., is_quadplane, vtol_pitch_trim_deg] = self.numbers;
        is_quadplane > 0.0 && (self.plane_pitch_trim_rad() != 0.0 || vtol_pitch_trim_deg != 0.0)
    }

    /// Pitch that an aeroplane subtracts, radians.
    fn plane_pitch_trim_rad(&self) -> f32 {
        let [_, _, trim_deg, trim_centidegrees, options, ..] = self.numbers;
        let is_sent_untrimmed = options as u32 & UNTRIMMED_PITCH_OPTION != 0;
        if is_sent_untrimmed { 0.0 } else { (trim_deg + 0.01 * trim_centidegrees).to_radians() }
    }
}
