//! MAVLink 2 writer with the receiver's clock, as ArduPilot sends it.

use mavlink_dialect::{
    ATTITUDE_DATA, BATTERY_STATUS_DATA, ESC_STATUS_DATA, GPS_RAW_INT_DATA, GpsFixType, HEARTBEAT_DATA,
    MAVLinkV2MessageRaw, MavAutopilot, MavHeader, MavModeFlag, MavParamType, MavSysStatusSensor, MavType, MessageData,
    PARAM_VALUE_DATA, RAW_IMU_DATA, SCALED_IMU2_DATA, SCALED_IMU3_DATA, SERVO_OUTPUT_RAW_DATA, SYS_STATUS_DATA,
    SYSTEM_TIME_DATA,
};

use super::recording::{FLIGHT_START_UTC_US, FlightRecording, FlightSample};

/// Encodes a recording as a MAVLink log.
#[must_use]
pub fn encode_tlog(recording: &FlightRecording) -> Vec<u8> {
    let mut writer = FrameWriter { bytes: Vec::new(), sequence: 0, received_us: 0 };
    for (i, sample) in recording.samples.iter().enumerate() {
        writer.received_us = sample.time_us;
        if i % 10 == 0 {
            writer.write_slow_messages(recording, sample);
        }
        if i == 5 {
            for (name, value) in &recording.parameters {
                let (param_id, param_value) = (name.as_str().into(), *value as f32);
                let param_type = MavParamType::MAV_PARAM_TYPE_UINT8;
                writer.write_message(&PARAM_VALUE_DATA { param_id, param_value, param_type, ..Default::default() });
            }
        }
        writer.write_loads(sample);
        let time_boot_ms = (sample.time_us / 1000) as u32;
        let [roll, pitch, yaw] = sample.attitude_rad.map(|angle| angle as f32);
        let [rollspeed, pitchspeed, yawspeed] = sample.rates_rad_s.map(|rate| rate as f32);
        writer.write_message(&ATTITUDE_DATA { time_boot_ms, roll, pitch, yaw, rollspeed, pitchspeed, yawspeed });
        for compass_number in 1..=recording.compass_count() {
            let (field, _) = recording.ardupilot_field_ut(sample, compass_number);
            let [xmag, ymag, zmag] = field.map(|axis| (axis * 10.0).round() as i16);
            match compass_number {
                1 => writer.write_message(&RAW_IMU_DATA {
                    time_usec: sample.time_us,
                    xmag,
                    ymag,
                    zmag,
                    ..Default::default()
                }),
                2 => writer.write_message(&SCALED_IMU2_DATA { time_boot_ms, xmag, ymag, zmag, ..Default::default() }),
                _ => writer.write_message(&SCALED_IMU3_DATA { time_boot_ms, xmag, ymag, zmag, ..Default::default() }),
            }
        }
    }
    writer.bytes
}

/// Version of the protocol in a heartbeat.
const HEARTBEAT_VERSION: u8 = 3;

struct FrameWriter {
    bytes: Vec<u8>,
    sequence: u8,
    received_us: u64,
}

impl FrameWriter {
    fn write_message<M: MessageData>(&mut self, message: &M) {
        let mut frame = MAVLinkV2MessageRaw::new();
        frame.serialize_message_data(MavHeader { system_id: 1, component_id: 1, sequence: self.sequence }, message);
        self.sequence = self.sequence.wrapping_add(1);
        self.bytes.extend((FLIGHT_START_UTC_US + self.received_us).to_be_bytes());
        self.bytes.extend(frame.raw_bytes());
    }

    fn write_loads(&mut self, sample: &FlightSample) {
        if !sample.outputs.is_empty() {
            let pulses_us = sample.output_pulses_us::<14>().map(|pulse_us| pulse_us as u16);
            let [servo1_raw, servo2_raw, servo3_raw, servo4_raw, servo5_raw, servo6_raw, servo7_raw, ..] = pulses_us;
            let [.., servo8_raw, servo9_raw, servo10_raw, servo11_raw, servo12_raw, servo13_raw, servo14_raw] =
                pulses_us;
            self.write_message(&SERVO_OUTPUT_RAW_DATA {
                servo1_raw,
                servo2_raw,
                servo3_raw,
                servo4_raw,
                servo5_raw,
                servo6_raw,
                servo7_raw,
                servo8_raw,
                servo9_raw,
                servo10_raw,
                servo11_raw,
                servo12_raw,
                servo13_raw,
                servo14_raw,
                ..Default::default()
            });
        }
        if !sample.esc_currents_a.is_empty() {
            let current =
                std::array::from_fn(|i| sample.esc_currents_a.get(i).map_or(f32::NAN, |amperes| *amperes as f32));
            self.write_message(&ESC_STATUS_DATA { current, ..Default::default() });
        }
        for (id, current_a) in (1..).zip(&sample.further_currents_a) {
            let current_battery = (current_a * 100.0) as i16;
            self.write_message(&BATTERY_STATUS_DATA { id, current_battery, ..Default::default() });
        }
    }

    /// Writes the messages that an autopilot sends once a second.
    fn write_slow_messages(&mut self, recording: &FlightRecording, sample: &FlightSample) {
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
        base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, sample.is_armed);
        let autopilot = MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA;
        let mavtype = if recording.is_copter { MavType::MAV_TYPE_QUADROTOR } else { MavType::MAV_TYPE_FIXED_WING };
        self.write_message(&HEARTBEAT_DATA {
            custom_mode: u32::from(sample.flight_mode),
            mavtype,
            autopilot,
            base_mode,
            mavlink_version: HEARTBEAT_VERSION,
            ..Default::default()
        });
        let time_boot_ms = (sample.time_us / 1000) as u32;
        self.write_message(&SYSTEM_TIME_DATA { time_unix_usec: FLIGHT_START_UTC_US + sample.time_us, time_boot_ms });
        let current_battery = (sample.current_a * 100.0) as i16;
        let gyro = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO;
        self.write_message(&SYS_STATUS_DATA {
            onboard_control_sensors_present: gyro,
            onboard_control_sensors_enabled: gyro,
            onboard_control_sensors_health: gyro,
            current_battery,
            ..Default::default()
        });
        if let Some([latitude, longitude, height]) = recording.sample_position(sample) {
            let [lat, lon] = [latitude, longitude].map(|deg| (deg * 1e7).round() as i32);
            let [speed_m_s, course_rad] = sample.speed_and_course();
            let [vel, cog] = [speed_m_s, course_rad.to_degrees()].map(|number| (number * 100.0).round() as u16);
            let (alt, fix_type) = ((height * 1e3) as i32, GpsFixType::GPS_FIX_TYPE_3D_FIX);
            self.write_message(&GPS_RAW_INT_DATA { lat, lon, alt, vel, cog, fix_type, ..Default::default() });
        }
    }
}
