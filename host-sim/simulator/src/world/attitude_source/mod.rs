//! Simulated attitude source of the autopilot: MAVLink 2 over a UART, with typical errors.

use std::f64::consts::{PI, TAU};

use mavlink_dialect::{
    ATTITUDE_DATA, GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA, MAVLinkV2MessageRaw, MavAutopilot, MavHeader, MavModeFlag,
    MavState, MavSysStatusSensor, MavType, MessageData, SYS_STATUS_DATA, SYSTEM_TIME_DATA,
};
use serde::Deserialize;

use super::aircraft;
use super::earth::{ReportedPosition, START_UNIX_US};
use super::gauss_markov::FirstOrderProcess;
use super::gyro::{Gyro, GyroConfig};
use super::state::TrueState;
use crate::random::{RandomStream, StreamPurpose};

/// MAVLink identity of a sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SenderIdentity {
    /// MAVLink system ID of the sender.
    pub system_id: u8,
    /// MAVLink component ID of the sender.
    pub component_id: u8,
    /// Type that its heartbeats announce; `None` sends no heartbeats.
    pub heartbeat_kind: Option<SenderKind>,
}

/// Type of sender announced in heartbeats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SenderKind {
    /// The vehicle's autopilot.
    Autopilot,
    /// Any other component: gimbal, camera, ground station.
    Other,
}

impl SenderIdentity {
    /// Identity of the vehicle's autopilot.
    pub const AUTOPILOT: Self = Self { system_id: 1, component_id: 1, heartbeat_kind: Some(SenderKind::Autopilot) };
}

const HEARTBEAT_VERSION: u8 = 3;
pub(super) const HEARTBEAT_PERIOD_US: u64 = 1_000_000;
pub(super) const STATUS_PERIOD_US: u64 = 100_000;

/// Correlation time of the acceleration-induced tilt error, seconds: duration of a typical acceleration.
const TILT_ERROR_CORRELATION_TIME_S: f64 = 2.0;

/// Reported yaw; never the true heading, because the module must not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ReportedYaw {
    /// Gyro yaw with an offset that grows linearly.
    Drifting,
    /// Yaw is sent as NaN.
    Absent,
}

/// Error model of the attitude source.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AttitudeSourceConfig {
    /// Attitude messages per second.
    pub rate_hz: f64,
    /// Standard deviation of roll noise and of pitch noise, degrees.
    pub noise_deg: f64,
    /// Noise correlation time, seconds.
    pub noise_time_s: f64,
    /// Constant tilt error, degrees; the seed selects its horizontal axis.
    pub bias_deg: f64,
    /// Age of the attitude at the start of its message, milliseconds.
    pub latency_ms: f64,
    /// Bank-angle scale error: fraction of the bank that is missing, as accelerometer aiding causes in turns.
    pub turn_error: f64,
    /// Acceleration-induced tilt error of roll and of pitch, degrees per m/s^2, 1 sigma.
    pub push_error_deg: f64,
    /// Content of the yaw field.
    pub yaw: ReportedYaw,
    /// Initial error of a drifting yaw, degrees.
    pub yaw_offset_deg: f64,
    /// Growth of the yaw error, degrees per second.
    pub yaw_drift_deg_s: f64,
}

impl Default for AttitudeSourceConfig {
    fn default() -> Self {
        Self {
            rate_hz: 50.0,
            noise_deg: 0.3,
            noise_time_s: 0.5,
            bias_deg: 0.2,
            latency_ms: 20.0,
            turn_error: 0.01,
            push_error_deg: 0.0,
            yaw: ReportedYaw::Drifting,
            yaw_offset_deg: 37.0,
            yaw_drift_deg_s: 0.1,
        }
    }
}

/// Attitude that the source reports, with its errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportedAttitude {
    /// Reported roll, radians.
    pub roll_rad: f64,
    /// Reported pitch, radians.
    pub pitch_rad: f64,
    /// Yaw, -pi..pi, or NaN.
    pub yaw_rad: f64,
}

/// Attitude source with its noise processes.
#[derive(Clone, Debug)]
pub struct SimulatedAttitudeSource {
    pub(super) config: AttitudeSourceConfig,
    gyro_config: GyroConfig,
    gyro: Gyro,
    seed: u64,
    pub(super) identity: SenderIdentity,
    vehicle: MavType,
    /// Firmware that an autopilot's heartbeats announce.
    firmware: MavAutopilot,
    roll_noise_rad: FirstOrderProcess,
    pitch_noise_rad: FirstOrderProcess,
    /// Tilt error per 1 m/s^2 of acceleration.
    roll_error_per_m_s2_rad: FirstOrderProcess,
    pitch_error_per_m_s2_rad: FirstOrderProcess,
    roll_bias_rad: f64,
    pitch_bias_rad: f64,
    sequence: u8,
}

impl SimulatedAttitudeSource {
    /// A source with the autopilot's identity in an aeroplane.
    #[must_use]
    pub fn new(config: AttitudeSourceConfig, gyro_config: GyroConfig, seed: u64) -> Self {
        let noise = |purpose| {
            let sigma_rad = config.noise_deg.to_radians();
            FirstOrderProcess::new(
                sigma_rad,
                config.noise_time_s,
                1.0 / config.rate_hz,
                RandomStream::new(seed, purpose),
            )
        };
        let push = |purpose| {
            let sigma_rad = config.push_error_deg.to_radians();
            FirstOrderProcess::new(
                sigma_rad,
                TILT_ERROR_CORRELATION_TIME_S,
                1.0 / config.rate_hz,
                RandomStream::new(seed, purpose),
            )
        };
        let direction_rad = RandomStream::new(seed, StreamPurpose::AttitudeBias).uniform(0.0, TAU);
        Self {
            config,
            gyro_config,
            gyro: Gyro::new(gyro_config, seed, 1.0 / config.rate_hz),
            seed,
            identity: SenderIdentity::AUTOPILOT,
            vehicle: MavType::MAV_TYPE_FIXED_WING,
            firmware: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            roll_noise_rad: noise(StreamPurpose::RollNoise),
            pitch_noise_rad: noise(StreamPurpose::PitchNoise),
            roll_error_per_m_s2_rad: push(StreamPurpose::RollTiltError),
            pitch_error_per_m_s2_rad: push(StreamPurpose::PitchTiltError),
            roll_bias_rad: config.bias_deg.to_radians() * libm::cos(direction_rad),
            pitch_bias_rad: config.bias_deg.to_radians() * libm::sin(direction_rad),
            sequence: 0,
        }
    }

    /// The same source with another sender identity.
    #[must_use]
    pub fn with_identity(self, identity: SenderIdentity) -> Self {
        Self { identity, ..self }
    }

    /// The same source with this firmware in its heartbeats.
    pub(super) fn with_firmware(self, firmware: MavAutopilot) -> Self {
        Self { firmware, ..self }
    }

    /// The same source with this vehicle kind in its heartbeats.
    #[must_use]
    pub fn with_vehicle_kind(self, vehicle_kind: aircraft::VehicleKind) -> Self {
        let vehicle = match vehicle_kind {
            aircraft::VehicleKind::Plane => MavType::MAV_TYPE_FIXED_WING,
            aircraft::VehicleKind::Copter => MavType::MAV_TYPE_QUADROTOR,
            aircraft::VehicleKind::Vtol => MavType::MAV_TYPE_VTOL_FIXEDROTOR,
            aircraft::VehicleKind::Rover => MavType::MAV_TYPE_GROUND_ROVER,
            aircraft::VehicleKind::Boat => MavType::MAV_TYPE_SURFACE_BOAT,
            aircraft::VehicleKind::Hand => MavType::MAV_TYPE_GENERIC,
        };
        Self { vehicle, ..self }
    }

    /// Sets the sample rate of the noise processes and restarts them; the caller schedules the messages.
    pub(super) fn set_rate_hz(&mut self, rate_hz: f64) {
        let Self { identity, vehicle, firmware, sequence, .. } = *self;
        *self = Self {
            identity,
            vehicle,
            firmware,
            sequence,
            ..Self::new(AttitudeSourceConfig { rate_hz, ..self.config }, self.gyro_config, self.seed)
        };
    }

    pub(super) fn latency_us(&self) -> u64 {
        (self.config.latency_ms * 1e3) as u64
    }

    /// Reported attitude for a true state. Each call advances the noise by one message period.
    pub fn next_report(&mut self, truth: &TrueState) -> ReportedAttitude {
        let [roll_push_rad, pitch_push_rad] = [&mut self.roll_error_per_m_s2_rad, &mut self.pitch_error_per_m_s2_rad]
            .map(|push| push.next_value() * truth.disturbing_acceleration_m_s2);
        let roll_rad =
            truth.roll_rad * (1.0 - self.config.turn_error) + self.roll_bias_rad + self.roll_noise_rad.next_value();
        let pitch_rad = truth.pitch_rad + self.pitch_bias_rad + self.pitch_noise_rad.next_value();
        ReportedAttitude {
            roll_rad: roll_rad + roll_push_rad,
            pitch_rad: pitch_rad + pitch_push_rad,
            yaw_rad: self.yaw_rad(truth),
        }
    }

    /// Measured body rates for a true state, radians per second. Each call advances the gyro by one message period.
    pub fn measured_rates_rad_s(&mut self, truth: &TrueState) -> [f64; 3] {
        self.gyro.measure_rates(truth)
    }

    fn yaw_rad(&self, truth: &TrueState) -> f64 {
        let error_deg = self.config.yaw_offset_deg + self.config.yaw_drift_deg_s * truth.time_s();
        match self.config.yaw {
            ReportedYaw::Drifting => (truth.heading_rad + error_deg.to_radians() + PI).rem_euclid(TAU) - PI,
            ReportedYaw::Absent => f64::NAN,
        }
    }

    /// Next ATTITUDE message, sent at `now_us`, for an earlier true state.
    pub(super) fn attitude_message(&mut self, truth: &TrueState, now_us: u64) -> ATTITUDE_DATA {
        let reported = self.next_report(truth);
        let [roll_rate, pitch_rate, yaw_rate] = self.measured_rates_rad_s(truth);
        ATTITUDE_DATA {
            // Time stamp of sending, as ArduPilot does, so the stamp does not reveal the latency.
            time_boot_ms: (now_us / 1000) as u32,
            roll: reported.roll_rad as f32,
            pitch: reported.pitch_rad as f32,
            yaw: reported.yaw_rad as f32,
            rollspeed: roll_rate as f32,
            pitchspeed: pitch_rate as f32,
            yawspeed: yaw_rate as f32,
        }
    }

    /// Next HEARTBEAT message.
    pub fn heartbeat_message(&mut self, is_armed: bool) -> Vec<u8> {
        let (base_mode, system_status) = if is_armed {
            (MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, MavState::MAV_STATE_ACTIVE)
        } else {
            (MavModeFlag::empty(), MavState::MAV_STATE_STANDBY)
        };
        self.encode_message(&HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: self.vehicle,
            autopilot: match self.identity.heartbeat_kind {
                Some(SenderKind::Autopilot) => self.firmware,
                Some(SenderKind::Other) | None => MavAutopilot::MAV_AUTOPILOT_INVALID,
            },
            base_mode,
            system_status,
            mavlink_version: HEARTBEAT_VERSION,
        })
    }

    /// Next SYS_STATUS message with the battery current, amperes; `None` means not measured.
    pub fn status_message(&mut self, current_a: Option<f64>) -> Vec<u8> {
        let current_battery = current_a.map_or(-1, |amperes| (amperes * 100.0).round() as i16);
        let gyro = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO;
        self.encode_message(&SYS_STATUS_DATA {
            onboard_control_sensors_present: gyro,
            onboard_control_sensors_enabled: gyro,
            onboard_control_sensors_health: gyro,
            current_battery,
            ..SYS_STATUS_DATA::DEFAULT
        })
    }

    /// Next GLOBAL_POSITION_INT message; `None` means no position fix.
    pub(super) fn position_message(&mut self, reported_position: Option<ReportedPosition>, clock_us: u64) -> Vec<u8> {
        let reported_position =
            reported_position.unwrap_or(ReportedPosition { latitude_deg: 0.0, longitude_deg: 0.0, height_m: 0.0 });
        self.encode_message(&GLOBAL_POSITION_INT_DATA {
            time_boot_ms: (clock_us / 1000) as u32,
            lat: (reported_position.latitude_deg * 1e7) as i32,
            lon: (reported_position.longitude_deg * 1e7) as i32,
            alt: (reported_position.height_m * 1e3) as i32,
            hdg: u16::MAX,
            ..Default::default()
        })
    }

    /// Next SYSTEM_TIME message.
    pub(super) fn time_message(&mut self, now_us: u64, clock_us: u64) -> Vec<u8> {
        let time_unix_usec = START_UNIX_US + now_us;
        self.encode_message(&SYSTEM_TIME_DATA { time_unix_usec, time_boot_ms: (clock_us / 1000) as u32 })
    }

    pub(super) fn encode_message(&mut self, message: &impl MessageData) -> Vec<u8> {
        let SenderIdentity { system_id, component_id, .. } = self.identity;
        let header = MavHeader { system_id: system_id.into(), component_id, sequence: self.sequence };
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = MAVLinkV2MessageRaw::new();
        frame.serialize_message_data(header, message);
        frame.raw_bytes().to_vec()
    }
}

#[cfg(test)]
mod tests;
