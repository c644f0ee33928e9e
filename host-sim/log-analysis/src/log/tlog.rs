//! Reader for MAVLink frames, with or without eight bytes of the receiver's clock before each (microseconds since 1970,
//! big-endian, as ground stations write).
//!
//! Times come from the sender's clock since boot. Messages without one get the last sender time plus the receiver's
//! clock difference since. Only one autopilot is read: the requested system, or the first received.

use std::io::{self, Read};

use mavlink_dialect::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavParamType, MavlinkVersion, Message, PARAM_VALUE_DATA,
    SCALED_IMU_DATA, SCALED_IMU2_DATA, SCALED_IMU3_DATA, SERVO_OUTPUT_RAW_DATA, calculate_crc,
};

use super::compass_slot::{PX4_INDICES, UnknownSlot};
use super::flight::{AutopilotKind, Gps, LogFormat, LoggedFlight};
use super::flight_builder::{FieldProcessing, FlightBuilder};
use super::load::{LoadRows, LoadSource};
use super::read_window::ReadWindow;
use super::time_series::Series;
use crate::numbers::{UT_PER_GAUSS, UT_PER_MILLIGAUSS};

const CLOCK_LENGTH: usize = 8;
/// Length of a MAVLink 1 header, bytes.
const HEADER_LENGTH_V1: usize = 6;
const HEADER_LENGTH_V2: usize = 10;
const CHECKSUM_LENGTH: usize = 2;
const SIGNATURE_LENGTH: usize = 13;
const MAX_FRAME_LENGTH: usize = HEADER_LENGTH_V2 + 255 + CHECKSUM_LENGTH + SIGNATURE_LENGTH;

const MAX_START_SEARCH_BYTES: usize = 4096;

/// Number of parameters retained before the first heartbeat; ArduPilot has some 1,400.
const MAX_EARLY_PARAMETERS: usize = 4096;

pub fn matches_header(first_bytes: &[u8]) -> bool {
    find_clock_length(first_bytes).is_some()
}

/// Length of the clock before every frame, bytes; none without a valid frame. Two consecutive frames are required,
/// since the end of the previous frame can look like a clock.
fn find_clock_length(first_bytes: &[u8]) -> Option<usize> {
    let valid_frame = |offset: usize, clock_length: usize| {
        LogFrame::parse_first_frame(first_bytes.get(offset..)?, clock_length).filter(|frame| frame.is_checksum_valid)
    };
    let are_two_frames = |offset: usize, clock_length: usize| {
        valid_frame(offset, clock_length)
            .is_some_and(|first_frame| valid_frame(offset + first_frame.total_len, clock_length).is_some())
    };
    let frame_starts = || {
        (0..first_bytes.len().min(MAX_START_SEARCH_BYTES))
            .flat_map(|offset| [CLOCK_LENGTH, 0].map(|clock_length| (offset, clock_length)))
    };
    let length_of_two = frame_starts()
        .find(|&(offset, clock_length)| are_two_frames(offset, clock_length))
        .map(|(_, clock_length)| clock_length);
    // A log that ends after its first frame is accepted only if a receiver's clock precedes the frame.
    length_of_two.or_else(|| {
        frame_starts().any(|(offset, _)| valid_frame(offset, CLOCK_LENGTH).is_some()).then_some(CLOCK_LENGTH)
    })
}

/// Reads the flight of a system, or of the first autopilot received.
pub fn read_tlog(source: &mut dyn Read, system: Option<u8>) -> io::Result<LoggedFlight> {
    let mut window = ReadWindow::new(source);
    let mut log = TlogReader::new(system);
    let clock_length =
        find_clock_length(window.peek_bytes(MAX_START_SEARCH_BYTES + 2 * (CLOCK_LENGTH + MAX_FRAME_LENGTH))?)
            .unwrap_or(CLOCK_LENGTH);
    loop {
        let bytes = window.peek_bytes(CLOCK_LENGTH + MAX_FRAME_LENGTH)?;
        if bytes.is_empty() {
            break;
        }
        let frame = LogFrame::parse_first_frame(bytes, clock_length);
        let length = if let Some(frame) = frame {
            if frame.is_checksum_valid {
                let message = MavMessage::parse(frame.version, frame.message_id, frame.payload).ok();
                log.record_message(frame.origin, message.as_ref());
            }
            frame.total_len
        } else {
            log.builder.flight.skipped_counts.garbage += 1;
            1
        };
        window.consume_bytes(length);
    }
    Ok(log.finish_flight())
}

/// Sender of a message, and when it arrived.
#[derive(Clone, Copy)]
pub(super) struct Origin {
    /// Receiver's clock, microseconds since 1970; zero if absent.
    pub received_us: u64,
    /// System and component.
    pub sender: [u8; 2],
}

struct LogFrame<'a> {
    origin: Origin,
    version: MavlinkVersion,
    message_id: u32,
    is_checksum_valid: bool,
    payload: &'a [u8],
    total_len: usize,
}

impl<'a> LogFrame<'a> {
    /// Parses the frame at the start of `bytes`, after `clock_length` bytes of the receiver's clock.
    fn parse_first_frame(bytes: &'a [u8], clock_length: usize) -> Option<Self> {
        let (received, frame) = bytes.split_at_checked(clock_length)?;
        let (version, header, sender, message_id, has_signature) = match *frame {
            [0xFE, _, _, system, component, message_id, ..] => {
                (MavlinkVersion::V1, HEADER_LENGTH_V1, [system, component], u32::from(message_id), false)
            }
            [0xFD, _, flags, _, _, system, component, a, b, c, ..] => (
                MavlinkVersion::V2,
                HEADER_LENGTH_V2,
                [system, component],
                u32::from_le_bytes([a, b, c, 0]),
                flags & 1 != 0,
            ),
            _ => return None,
        };
        let payload_end = header + usize::from(*frame.get(1)?);
        let [low, high] = *frame.get(payload_end..payload_end + CHECKSUM_LENGTH)? else { return None };
        let extra_crc = MavMessage::extra_crc(message_id);
        let is_checksum_valid = calculate_crc(frame.get(1..payload_end)?, extra_crc) == u16::from_le_bytes([low, high]);
        let frame_len = clock_length + payload_end + CHECKSUM_LENGTH + if has_signature { SIGNATURE_LENGTH } else { 0 };
        // An unknown message, or one whose definition has changed, fails its checksum. If another frame follows, the
        // frame is skipped whole and its content ignored.
        let is_followed = || bytes.get(frame_len + clock_length).is_none_or(|marker| matches!(marker, 0xFE | 0xFD));
        let received_us = received.first_chunk().map_or(0, |clock_length| u64::from_be_bytes(*clock_length));
        let payload = &frame[header..payload_end];
        (is_checksum_valid || is_followed()).then_some(Self {
            origin: Origin { received_us, sender },
            version,
            message_id,
            is_checksum_valid,
            payload,
            total_len: frame_len,
        })
    }
}

/// Whether this is the heartbeat of an autopilot.
fn is_of_autopilot(heartbeat: &HEARTBEAT_DATA) -> bool {
    // MAV_TYPE: ground station, onboard controller, gimbal, ADS-B, camera. Some report a generic autopilot.
    const NON_VEHICLE_TYPES: [u8; 5] = [6, 18, 26, 27, 30];
    heartbeat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID && !NON_VEHICLE_TYPES.contains(&heartbeat.mavtype.0)
}

#[derive(Default)]
pub(super) struct TlogReader {
    builder: FlightBuilder,
    requested_system: Option<u8>,
    /// System and component of the autopilot that is read.
    autopilot_ids: Option<[u8; 2]>,
    other_systems: Vec<u8>,
    other_components: Vec<u8>,
    /// Fields of PX4's `sensor_mag` instances by `SCALED_IMU`, `SCALED_IMU2` and `SCALED_IMU3`: uncorrected, in the axes
    /// of the sensor, microtesla.
    px4_sensor_fields: [Series<3>; 3],
    /// Parameters received before the first heartbeat (1 Hz), by sender.
    early_parameters: Vec<([u8; 2], PARAM_VALUE_DATA)>,
    /// Clock of the sender in its last message with one, and the receiver's clock at that message, microseconds.
    last_clock_pair_us: Option<(u64, u64)>,
}

impl TlogReader {
    pub fn new(requested_system: Option<u8>) -> Self {
        Self { builder: FlightBuilder::new(LogFormat::TLog), requested_system, ..Self::default() }
    }

    /// Records a message; `None` is one of another dialect.
    pub fn record_message(&mut self, origin: Origin, message: Option<&MavMessage>) {
        let [system, _] = origin.sender;
        if self.autopilot_ids.is_some_and(|selected| selected != origin.sender)
            || self.requested_system.is_some_and(|requested| requested != system)
        {
            self.builder.flight.skipped_counts.other_system_messages += 1;
            if matches!(message, Some(MavMessage::HEARTBEAT(heartbeat)) if is_of_autopilot(heartbeat)) {
                self.record_other_vehicle(origin.sender);
            }
            return;
        }
        match message {
            Some(MavMessage::HEARTBEAT(heartbeat)) => self.process_heartbeat(origin, heartbeat),
            Some(message) if self.autopilot_ids.is_some() => {
                self.process_message(origin, message);
            }
            Some(MavMessage::PARAM_VALUE(payload)) if self.early_parameters.len() < MAX_EARLY_PARAMETERS => {
                self.early_parameters.push((origin.sender, payload.clone()));
            }
            // Ignored until the first heartbeat identifies the autopilot.
            _ => {}
        }
    }

    /// Notes the id of another vehicle, or of a second autopilot of the same system, for the flight's lists.
    fn record_other_vehicle(&mut self, [system, component]: [u8; 2]) {
        let is_own = self.autopilot_ids.is_some_and(|[selected_system, _]| selected_system == system);
        if is_own && !self.other_components.contains(&component) {
            self.other_components.push(component);
        } else if !is_own && !self.other_systems.contains(&system) {
            self.other_systems.push(system);
        }
    }

    fn process_heartbeat(&mut self, origin: Origin, heartbeat: &HEARTBEAT_DATA) {
        // MAV_TYPE: quadrotor, coaxial, helicopter, hexa-, octo-, tri-, dodeca-, decarotor.
        const ROTORCRAFT_TYPES: [u8; 8] = [2, 3, 4, 13, 14, 15, 29, 35];
        if !is_of_autopilot(heartbeat) {
            return;
        }
        if self.autopilot_ids.is_none() {
            self.autopilot_ids = Some(origin.sender);
            self.builder.flight.is_copter = ROTORCRAFT_TYPES.contains(&heartbeat.mavtype.0);
            self.builder.flight.autopilot = match heartbeat.autopilot {
                MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => AutopilotKind::ArduPilot,
                MavAutopilot::MAV_AUTOPILOT_PX4 => AutopilotKind::Px4,
                _ => AutopilotKind::Unknown,
            };
            let early = std::mem::take(&mut self.early_parameters);
            early
                .iter()
                .filter(|(sender, _)| *sender == origin.sender)
                .for_each(|(_, payload)| self.record_parameter(payload));
        }
        if let Some(t_s) = self.receiver_time_s(origin) {
            let is_armed = heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
            self.builder.push_armed_report(t_s, is_armed);
            // ArduPlane's numbers fit into the lowest byte.
            self.builder.flight_modes.push_row(t_s, [f32::from(heartbeat.custom_mode as u8)]);
        }
    }

    pub fn finish_flight(mut self) -> LoggedFlight {
        let id_part = |id_index: usize| self.autopilot_ids.map(|sender| sender[id_index]).into_iter();
        self.builder.flight.autopilot_system_ids = id_part(0).chain(self.other_systems.iter().copied()).collect();
        self.builder.flight.autopilot_component_ids = id_part(1).chain(self.other_components.iter().copied()).collect();
        self.assign_px4_sensors();
        self.builder.finish_flight()
    }

    /// Assigns PX4's sensor fields, which have no device id, to calibration parameters: possible for one sensor with one
    /// calibration. The axes of others are unknown, so that their fields mean nothing.
    fn assign_px4_sensors(&mut self) {
        let fields = std::mem::take(&mut self.px4_sensor_fields);
        let parameters = &self.builder.flight.parameters;
        let is_calibrated =
            |index: &u8| parameters.last_value(&format!("CAL_MAG{index}_ID")).is_some_and(|id| id != 0.0);
        let calibrated: Vec<u8> = PX4_INDICES.into_iter().filter(is_calibrated).collect();
        let logged: Vec<&Series<3>> = fields.iter().filter(|field| !field.is_empty()).collect();
        if let ([field], [index]) = (&*logged, &*calibrated) {
            for row in field.rows() {
                self.builder.push_field(1, FieldProcessing::Px4SensorRaw(*index), row.t_s, row.row_values, None);
            }
        } else {
            let row_count: usize = logged.iter().map(|field| field.rows().len()).sum();
            self.builder.flight.skipped_counts.unassigned_fields += row_count as u64;
        }
    }

    /// Reads a message of the autopilot; `None` if it has no usable time.
    fn process_message(&mut self, origin: Origin, message: &MavMessage) -> Option<()> {
        let is_px4 = self.builder.flight.autopilot == AutopilotKind::Px4;
        match message {
            MavMessage::ATTITUDE(payload) => {
                let t_s = self.sender_time_s(origin, u64::from(payload.time_boot_ms) * 1000)?;
                self.builder.push_attitude(t_s, [payload.roll, payload.pitch, payload.yaw]);
                self.builder.push_rates(t_s, [payload.rollspeed, payload.pitchspeed, payload.yawspeed]);
            }
            MavMessage::RAW_IMU(payload) if !is_px4 => {
                self.record_field(origin, 1, payload.time_usec, [payload.xmag, payload.ymag, payload.zmag]);
            }
            MavMessage::SCALED_IMU(SCALED_IMU_DATA { time_boot_ms, xmag, ymag, zmag, .. }) if is_px4 => {
                self.record_field(origin, 1, u64::from(*time_boot_ms) * 1000, [*xmag, *ymag, *zmag]);
            }
            MavMessage::SCALED_IMU2(SCALED_IMU2_DATA { time_boot_ms, xmag, ymag, zmag, .. }) => {
                self.record_field(origin, 2, u64::from(*time_boot_ms) * 1000, [*xmag, *ymag, *zmag]);
            }
            MavMessage::SCALED_IMU3(SCALED_IMU3_DATA { time_boot_ms, xmag, ymag, zmag, .. }) => {
                self.record_field(origin, 3, u64::from(*time_boot_ms) * 1000, [*xmag, *ymag, *zmag]);
            }
            MavMessage::HIGHRES_IMU(payload) if has_field_update(payload.fields_updated.bits()) => {
                let t_s = self.sender_time_s(origin, payload.time_usec)?;
                let field_ut = [payload.xmag, payload.ymag, payload.zmag].map(|gauss| gauss * UT_PER_GAUSS as f32);
                self.builder.push_field(1, self.field_processing(), t_s, field_ut, None);
            }
            MavMessage::SYSTEM_TIME(payload) => {
                self.sender_time_s(origin, u64::from(payload.time_boot_ms) * 1000);
                self.builder.set_day_from_unix_s(payload.time_unix_usec / 1_000_000);
            }
            MavMessage::PARAM_VALUE(payload) => self.record_parameter(payload),
            MavMessage::STATUSTEXT(payload) => {
                let text = payload.text.to_str().ok()?;
                if ["Ardu", "APM", "PX4"].iter().any(|prefix| text.starts_with(prefix)) {
                    self.builder.set_firmware(text);
                }
                let t_s = self.receiver_time_s(origin)?;
                self.builder.record_text(t_s, text);
            }
            MavMessage::GPS_RAW_INT(payload) if payload.fix_type.0 >= 3 => {
                let t_s = self.receiver_time_s(origin)?;
                self.builder.push_gps(t_s, gps_from_message(payload));
            }
            MavMessage::GPS2_RAW(payload) if payload.fix_type.0 >= 3 => {
                let t_s = self.receiver_time_s(origin)?;
                self.builder.push_other_receiver_yaw(1, t_s, yaw_deg_from_message(payload.yaw));
            }
            // -1 means no measurement.
            MavMessage::SYS_STATUS(payload) if payload.current_battery != -1 => {
                let t_s = self.receiver_time_s(origin)?;
                self.builder.push_current(t_s, f32::from(payload.current_battery) * 0.01);
            }
            MavMessage::SIMSTATE(payload) => {
                let t_s = self.receiver_time_s(origin)?;
                self.builder.push_true_attitude(t_s, [payload.roll, payload.pitch, payload.yaw]);
            }
            MavMessage::BATTERY_STATUS(_)
            | MavMessage::ESC_STATUS(_)
            | MavMessage::ESC_TELEMETRY_1_TO_4(_)
            | MavMessage::ESC_TELEMETRY_5_TO_8(_)
            | MavMessage::SERVO_OUTPUT_RAW(_)
            | MavMessage::VFR_HUD(_) => {
                let t_s = self.receiver_time_s(origin)?;
                record_loads(&mut self.builder.loads, t_s, message);
            }
            _ => {}
        }
        Some(())
    }

    fn record_parameter(&mut self, payload: &PARAM_VALUE_DATA) {
        if let Ok(name) = payload.param_id.to_str() {
            self.builder.set_parameter(name, parameter_value(self.builder.flight.autopilot, payload));
        }
    }

    const fn field_processing(&self) -> FieldProcessing {
        match self.builder.flight.autopilot {
            AutopilotKind::ArduPilot => FieldProcessing::ArduPilot,
            AutopilotKind::Px4 => FieldProcessing::Unknown(UnknownSlot::PrimaryLessBias),
            AutopilotKind::Inav | AutopilotKind::Unknown => FieldProcessing::BodyRaw,
        }
    }

    /// Adds a field in milligauss.
    fn record_field(&mut self, origin: Origin, compass_number: u8, time_us: u64, field_mg: [i16; 3]) {
        // An absent compass is sent as zero.
        if field_mg == [0; 3] {
            return;
        }
        if let Some(t_s) = self.sender_time_s(origin, time_us) {
            let field_ut = field_mg.map(|axis| f32::from(axis) * UT_PER_MILLIGAUSS as f32);
            if self.builder.flight.autopilot == AutopilotKind::Px4 {
                if let Some(field) = self.px4_sensor_fields.get_mut(usize::from(compass_number) - 1) {
                    field.push_row(t_s, field_ut);
                }
            } else {
                self.builder.push_field(compass_number, self.field_processing(), t_s, field_ut, None);
            }
        }
    }

    /// Flight time of a message by the sender's clock, seconds. Some senders put Unix time in the field; then the
    /// receiver's clock is used.
    fn sender_time_s(&mut self, origin: Origin, boot_us: u64) -> Option<f64> {
        /// Ten years: longer than any uptime, earlier than any Unix time after 1980.
        const MAX_BOOT_US: u64 = 315_000_000_000_000;
        if boot_us == 0 || boot_us > MAX_BOOT_US {
            return self.receiver_time_s(origin);
        }
        let t_s = self.builder.timeline.flight_time_s(boot_us)?;
        self.last_clock_pair_us = Some((boot_us, origin.received_us));
        Some(t_s)
    }

    /// Flight time of a message without the sender's clock, seconds; the receiver's clock bridges at most two seconds.
    fn receiver_time_s(&mut self, origin: Origin) -> Option<f64> {
        const MAX_BRIDGED_US: u64 = 2_000_000;
        let (sent_us, received_us) = self.last_clock_pair_us?;
        let since_us = origin.received_us.saturating_sub(received_us).min(MAX_BRIDGED_US);
        self.builder.timeline.flight_time_s(sent_us + since_us)
    }
}

/// Adds the loads of a message. The first battery is that of SYS_STATUS.
fn record_loads(loads: &mut LoadRows, t_s: f64, message: &MavMessage) {
    let amperes_of_hundredths = |hundredths: u16| Some(f32::from(hundredths) * 0.01);
    match message {
        MavMessage::BATTERY_STATUS(payload) if payload.id > 0 && payload.current_battery != -1 => {
            let battery = LoadSource::Battery(payload.id.saturating_add(1));
            loads.push_value(battery, t_s, f32::from(payload.current_battery) * 0.01);
        }
        MavMessage::ESC_STATUS(payload) => {
            let source = |number: u8| LoadSource::Esc(number.saturating_add(payload.index));
            loads.push_values(source, t_s, payload.current.map(Some));
        }
        MavMessage::ESC_TELEMETRY_1_TO_4(payload) => {
            loads.push_values(LoadSource::Esc, t_s, payload.current.map(amperes_of_hundredths));
        }
        MavMessage::ESC_TELEMETRY_5_TO_8(payload) => {
            let source = |number: u8| LoadSource::Esc(number.saturating_add(4));
            loads.push_values(source, t_s, payload.current.map(amperes_of_hundredths));
        }
        MavMessage::SERVO_OUTPUT_RAW(payload) if payload.port == 0 => {
            let pulses_us = servo_pulses_us(payload).map(|pulse_us| Some(f32::from(pulse_us)));
            loads.push_values(LoadSource::Output, t_s, pulses_us);
        }
        MavMessage::VFR_HUD(payload) => loads.push_value(LoadSource::Throttle, t_s, f32::from(payload.throttle)),
        _ => {}
    }
}

/// Pulses of the outputs, microseconds; zero of those not in use.
const fn servo_pulses_us(payload: &SERVO_OUTPUT_RAW_DATA) -> [u16; 16] {
    [
        payload.servo1_raw,
        payload.servo2_raw,
        payload.servo3_raw,
        payload.servo4_raw,
        payload.servo5_raw,
        payload.servo6_raw,
        payload.servo7_raw,
        payload.servo8_raw,
        payload.servo9_raw,
        payload.servo10_raw,
        payload.servo11_raw,
        payload.servo12_raw,
        payload.servo13_raw,
        payload.servo14_raw,
        payload.servo15_raw,
        payload.servo16_raw,
    ]
}

/// Value of a parameter: PX4 sends the bits of an integer in the float, ArduPilot the number as a float.
fn parameter_value(autopilot: AutopilotKind, payload: &PARAM_VALUE_DATA) -> f64 {
    if autopilot == AutopilotKind::Px4 && payload.param_type != MavParamType::MAV_PARAM_TYPE_REAL32 {
        f64::from(payload.param_value.to_bits().cast_signed())
    } else {
        f64::from(payload.param_value)
    }
}

/// Whether a HIGHRES_IMU message contains a new magnetic field; without update flags it is assumed to.
const fn has_field_update(update_flags: u16) -> bool {
    const FIELD_UPDATE_FLAGS: u16 = 64 | 128 | 256;
    update_flags == 0 || update_flags & FIELD_UPDATE_FLAGS != 0
}

fn gps_from_message(gps_message: &mavlink_dialect::GPS_RAW_INT_DATA) -> Gps {
    /// Value of GPS_RAW_INT for an unknown speed or course.
    const UNKNOWN_SPEED_OR_COURSE: u16 = u16::MAX;
    let hundredths =
        |raw_value: u16| if raw_value == UNKNOWN_SPEED_OR_COURSE { f32::NAN } else { f32::from(raw_value) * 0.01 };
    Gps {
        latitude_deg: (f64::from(gps_message.lat) * 1e-7) as f32,
        longitude_deg: (f64::from(gps_message.lon) * 1e-7) as f32,
        height_m: (f64::from(gps_message.alt) * 1e-3) as f32,
        speed_m_s: hundredths(gps_message.vel),
        course_deg: hundredths(gps_message.cog),
        yaw_deg: yaw_deg_from_message(gps_message.yaw),
    }
}

/// Heading of a receiver, degrees, from hundredths; north is 36000, and NaN if absent.
fn yaw_deg_from_message(hundredths_deg: u16) -> f32 {
    const ABSENT: u16 = 0;
    const NOT_CONFIGURED: u16 = u16::MAX;
    if matches!(hundredths_deg, ABSENT | NOT_CONFIGURED) { f32::NAN } else { f32::from(hundredths_deg) * 0.01 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// PX4's integer 2 arrives as the float with bits 02 00 00 00, a denormal; its -1 as NaN.
    #[test]
    fn px4s_integer_parameters_are_decoded_from_float_bits() {
        let decode_parameter = |autopilot, param_type, param_value| {
            parameter_value(autopilot, &PARAM_VALUE_DATA { param_type, param_value, ..Default::default() })
        };
        let (integer_type, float_type) = (MavParamType::MAV_PARAM_TYPE_INT32, MavParamType::MAV_PARAM_TYPE_REAL32);
        for value in [2, -1, 396_809] {
            let decoded = decode_parameter(AutopilotKind::Px4, integer_type, f32::from_bits(i32::cast_unsigned(value)));
            assert!((decoded - f64::from(value)).abs() < 1e-9, "{value}: {decoded}");
        }
        assert!((decode_parameter(AutopilotKind::Px4, float_type, 0.5) - 0.5).abs() < 1e-9);
        assert!((decode_parameter(AutopilotKind::ArduPilot, integer_type, 6.0) - 6.0).abs() < 1e-9);
    }

    /// A repeated field with a new acceleration would be dated too late.
    #[test]
    fn a_repeated_field_is_not_read_again() {
        let [acceleration, field, nothing] = [7, 64 | 128 | 256, 0].map(has_field_update);
        assert!(!acceleration && field && nothing);
    }
}
