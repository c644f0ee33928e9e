//! The autopilot's attitude, as the module gets it: MAVLink 2 over a UART, with the errors that such sources have.

use std::f64::consts::{PI, TAU};

use embassy_time::{Instant, Timer};
use mavlink::dialects::common::{
    ATTITUDE_DATA, HEARTBEAT_DATA, MavAutopilot, MavModeFlag, MavState, MavType, SYS_STATUS_DATA,
};
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MessageData};
use serde::{Deserialize, Serialize};

use super::World;
use super::aircraft;
use super::gauss_markov::FirstOrder;
use super::mavlink_autopilot::Frame;
use super::state::TrueState;
use crate::clock;
use crate::devices::uart::HostEnd;
use crate::faults::attitude::AttitudeFault;
use crate::random::{Purpose, Random};

/// Who sends: a MAVLink identity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// System.
    pub system_id: u8,
    /// Component of it.
    pub component_id: u8,
    /// What its heartbeats say it is; none: it sends none.
    pub heartbeats: Option<Kind>,
}

/// What a sender says it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// An autopilot.
    Autopilot,
    /// Anything else: a gimbal, a camera, a ground station.
    Other,
}

impl Identity {
    /// The autopilot.
    pub const AUTOPILOT: Self = Self { system_id: 1, component_id: 1, heartbeats: Some(Kind::Autopilot) };
}

/// The `mavlink_version` of a heartbeat in the common dialect.
const HEARTBEAT_VERSION: u8 = 3;
const HEARTBEAT_PERIOD_US: u64 = 1_000_000;
const STATUS_PERIOD_US: u64 = 100_000;

/// Correlation time of the error that pushes make, seconds: that of a push.
const PUSH_TIME_S: f64 = 2.0;

/// What the source says about yaw. Never the truth: the module is to do without.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Yaw {
    /// A gyro's yaw: off by an offset that grows.
    Drifting,
    /// Not a number.
    Absent,
}

/// How good the source is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Messages per second.
    pub rate_hz: f64,
    /// Standard deviation of the noise of roll and of pitch, degrees.
    pub noise_deg: f64,
    /// Correlation time of that noise, seconds.
    pub noise_time_s: f64,
    /// Constant error, degrees: a tilt about an axis in the plane of the wings that the seed chooses.
    pub bias_deg: f64,
    /// Age of the attitude when its message begins, milliseconds.
    pub latency_ms: f64,
    /// Part of the bank that is not reported: a source aided by accelerometers leans into the turn.
    pub turn_error: f64,
    /// Error of roll and of pitch while it accelerates, degrees per m/s^2, 1 sigma: accelerometers take a push for tilt.
    pub push_error_deg: f64,
    /// What is reported as yaw.
    pub yaw: Yaw,
    /// Error of a drifting yaw at the start, degrees.
    pub yaw_offset_deg: f64,
    /// Growth of that error, degrees per second.
    pub yaw_drift_deg_s: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            rate_hz: 50.0,
            noise_deg: 0.3,
            noise_time_s: 0.5,
            bias_deg: 0.2,
            latency_ms: 20.0,
            turn_error: 0.01,
            push_error_deg: 0.0,
            yaw: Yaw::Drifting,
            yaw_offset_deg: 37.0,
            yaw_drift_deg_s: 0.1,
        }
    }
}

/// An attitude as reported, radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reported {
    /// Bank.
    pub roll_rad: f64,
    /// Pitch.
    pub pitch_rad: f64,
    /// Yaw, -pi..pi, or not a number.
    pub yaw_rad: f64,
}

/// The source.
#[derive(Clone, Debug)]
pub struct AttitudeSource {
    config: Config,
    seed: u64,
    identity: Identity,
    vehicle: MavType,
    roll_noise_rad: FirstOrder,
    pitch_noise_rad: FirstOrder,
    /// What a push of 1 m/s^2 makes.
    roll_push_rad: FirstOrder,
    pitch_push_rad: FirstOrder,
    roll_bias_rad: f64,
    pitch_bias_rad: f64,
    sequence: u8,
}

impl AttitudeSource {
    /// A source of this quality.
    #[must_use]
    pub fn new(config: Config, seed: u64) -> Self {
        let noise = |purpose| {
            let sigma_rad = config.noise_deg.to_radians();
            FirstOrder::new(sigma_rad, config.noise_time_s, 1.0 / config.rate_hz, Random::new(seed, purpose))
        };
        let push = |purpose| {
            let sigma_rad = config.push_error_deg.to_radians();
            FirstOrder::new(sigma_rad, PUSH_TIME_S, 1.0 / config.rate_hz, Random::new(seed, purpose))
        };
        let direction_rad = Random::new(seed, Purpose::AttitudeBias).uniform(0.0, TAU);
        Self {
            config,
            seed,
            identity: Identity::AUTOPILOT,
            vehicle: MavType::MAV_TYPE_FIXED_WING,
            roll_noise_rad: noise(Purpose::RollNoise),
            pitch_noise_rad: noise(Purpose::PitchNoise),
            roll_push_rad: push(Purpose::RollPush),
            pitch_push_rad: push(Purpose::PitchPush),
            roll_bias_rad: config.bias_deg.to_radians() * direction_rad.cos(),
            pitch_bias_rad: config.bias_deg.to_radians() * direction_rad.sin(),
            sequence: 0,
        }
    }

    /// The same, sent by somebody else.
    #[must_use]
    pub fn sent_by(self, identity: Identity) -> Self {
        Self { identity, ..self }
    }

    /// The same in a vehicle of this kind, which its heartbeats tell.
    #[must_use]
    pub fn carried_by(self, kind: aircraft::Kind) -> Self {
        let vehicle = match kind {
            aircraft::Kind::Plane => MavType::MAV_TYPE_FIXED_WING,
            aircraft::Kind::Copter => MavType::MAV_TYPE_QUADROTOR,
            aircraft::Kind::Vtol => MavType::MAV_TYPE_VTOL_FIXEDROTOR,
            aircraft::Kind::Rover => MavType::MAV_TYPE_GROUND_ROVER,
            aircraft::Kind::Boat => MavType::MAV_TYPE_SURFACE_BOAT,
        };
        Self { vehicle, ..self }
    }

    /// Sends so often from now on, if whoever runs it does; its noise begins anew.
    pub(super) fn set_rate_hz(&mut self, rate_hz: f64) {
        let Self { identity, vehicle, sequence, .. } = *self;
        *self = Self { identity, vehicle, sequence, ..Self::new(Config { rate_hz, ..self.config }, self.seed) };
    }

    /// Who sends.
    pub(super) const fn identity(&self) -> Identity {
        self.identity
    }

    /// Age of the attitude when its message begins, microseconds.
    pub(super) fn latency_us(&self) -> u64 {
        (self.config.latency_ms * 1e3) as u64
    }

    /// What the source makes of the truth. Each call advances the noise by one message.
    pub fn report(&mut self, truth: &TrueState) -> Reported {
        let [roll_push_rad, pitch_push_rad] =
            [&mut self.roll_push_rad, &mut self.pitch_push_rad].map(|push| push.step() * truth.push_m_s2);
        let roll_rad =
            truth.roll_rad * (1.0 - self.config.turn_error) + self.roll_bias_rad + self.roll_noise_rad.step();
        let pitch_rad = truth.pitch_rad + self.pitch_bias_rad + self.pitch_noise_rad.step();
        Reported {
            roll_rad: roll_rad + roll_push_rad,
            pitch_rad: pitch_rad + pitch_push_rad,
            yaw_rad: self.yaw_rad(truth),
        }
    }

    fn yaw_rad(&self, truth: &TrueState) -> f64 {
        let seconds = truth.time_us as f64 / 1e6;
        let error_deg = self.config.yaw_offset_deg + self.config.yaw_drift_deg_s * seconds;
        match self.config.yaw {
            Yaw::Drifting => (truth.heading_rad + error_deg.to_radians() + PI).rem_euclid(TAU) - PI,
            Yaw::Absent => f64::NAN,
        }
    }

    /// The next ATTITUDE message, made at `now_us` of the truth some time before.
    pub(super) fn attitude(&mut self, truth: &TrueState, now_us: u64) -> ATTITUDE_DATA {
        let reported = self.report(truth);
        let [roll_rate, pitch_rate, yaw_rate] = truth.body_rates_rad_s();
        ATTITUDE_DATA {
            // Stamped when sent, as ArduPilot does: the stamp does not give the latency away.
            time_boot_ms: (now_us / 1000) as u32,
            roll: reported.roll_rad as f32,
            pitch: reported.pitch_rad as f32,
            yaw: reported.yaw_rad as f32,
            rollspeed: roll_rate as f32,
            pitchspeed: pitch_rate as f32,
            yawspeed: yaw_rate as f32,
        }
    }

    /// The next HEARTBEAT message.
    pub fn heartbeat_message(&mut self, is_armed: bool) -> Vec<u8> {
        let (base_mode, system_status) = if is_armed {
            (MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, MavState::MAV_STATE_ACTIVE)
        } else {
            (MavModeFlag::empty(), MavState::MAV_STATE_STANDBY)
        };
        self.encode(&HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: self.vehicle,
            autopilot: match self.identity.heartbeats {
                Some(Kind::Autopilot) => MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
                Some(Kind::Other) | None => MavAutopilot::MAV_AUTOPILOT_INVALID,
            },
            base_mode,
            system_status,
            mavlink_version: HEARTBEAT_VERSION,
        })
    }

    /// The next SYS_STATUS message, with this current, amperes; none: it is not measured.
    pub(super) fn status_message(&mut self, current_a: Option<f64>) -> Vec<u8> {
        let current_battery = current_a.map_or(-1, |amperes| (amperes * 100.0).round() as i16);
        self.encode(&SYS_STATUS_DATA { current_battery, ..SYS_STATUS_DATA::DEFAULT })
    }

    pub(super) fn encode(&mut self, message: &impl MessageData) -> Vec<u8> {
        let Identity { system_id, component_id, .. } = self.identity;
        let header = MavHeader { system_id: system_id.into(), component_id, sequence: self.count() };
        let mut frame = MAVLinkV2MessageRaw::new();
        frame.serialize_message_data(header, message);
        frame.raw_bytes().to_vec()
    }

    /// The frame of a message whose payload has fields that the library does not know.
    pub(super) fn framed(&mut self, id: u32, extra_crc: u8, payload: &[u8]) -> Vec<u8> {
        let Identity { system_id: system, component_id: component, .. } = self.identity;
        Frame { sequence: self.count(), system, component, id, payload: payload.to_vec() }.bytes(extra_crc)
    }

    /// The number of the next frame.
    const fn count(&mut self) -> u8 {
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        sequence
    }

    /// Sends attitude at its rate and a heartbeat every second, for ever, while the [world lets
    /// it](World::set_sends_attitude): a task of the world. An autopilot that measures the current tells it ten times a
    /// second. The faults act on every attitude message, in their order.
    pub async fn run(mut self, world: World, uart: HostEnd, mut faults: Vec<Box<dyn AttitudeFault>>) {
        let period_us = 1e6 / self.config.rate_hz;
        let latency_us = self.latency_us();
        let began_us = clock::now_us();
        let mut heartbeat_us = began_us + period_us as u64;
        let mut status_us = began_us;
        for tick in 1_u64.. {
            let now_us = began_us + (tick as f64 * period_us).round() as u64;
            Timer::at(Instant::from_micros(now_us)).await;
            if now_us >= heartbeat_us && self.identity.heartbeats.is_some() {
                heartbeat_us += HEARTBEAT_PERIOD_US;
                let heartbeat = self.heartbeat_message(world.is_armed());
                if world.sends_attitude() {
                    uart.send(&heartbeat);
                }
            }
            if now_us >= status_us && self.identity.heartbeats == Some(Kind::Autopilot) {
                status_us += STATUS_PERIOD_US;
                if let Some(amperes) = world.told_current_a(now_us).filter(|_| world.sends_attitude()) {
                    uart.send(&self.status_message(Some(amperes)));
                }
            }
            let late_us: u64 = faults.iter().map(|fault| fault.late_us(now_us)).sum();
            let truth = world.true_state(now_us.saturating_sub(latency_us + late_us));
            let mut message = self.attitude(&truth, now_us);
            for fault in &mut faults {
                fault.tamper(now_us, &mut message);
            }
            // Silent it goes on with its noise, which is that of its instant whoever else has sent.
            let frame = self.encode(&message);
            if world.sends_attitude() {
                uart.send(&frame);
            }
        }
    }
}

#[cfg(test)]
mod tests;
