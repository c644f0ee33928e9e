//! Faults of the attitude source: modified messages, and other senders on the same line.

use std::f64::consts::{FRAC_PI_4, TAU};

use mavlink::dialects::common::ATTITUDE_DATA;

use super::Switch;
use crate::devices::uart::HostEnd;
use crate::random::{Purpose, Random};
use crate::world::World;
use crate::world::attitude_source::{AttitudeSource, Identity, SenderKind};

/// Fault of the attitude source.
pub trait AttitudeFault {
    /// Additional age of the attitude, microseconds.
    fn late_us(&self, _now_us: u64) -> u64 {
        0
    }

    /// Modifies a message.
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA);
}

/// Second sender of attitude on the same line, with a roll error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondSender {
    /// System ID.
    pub system_id: u8,
    /// Component ID.
    pub component_id: u8,
    /// Type announced in heartbeats; `None` sends no heartbeats.
    pub heartbeat_kind: Option<SenderKind>,
    /// Roll error, degrees.
    pub roll_error_deg: f64,
}

impl SecondSender {
    /// Task that never returns: sends attitude at the autopilot's rate and latency with independent noise.
    pub fn run(self, world: &World, uart: HostEnd) -> impl Future<Output = ()> + use<> {
        let Self { system_id, component_id, heartbeat_kind: heartbeats, roll_error_deg: roll_deg } = self;
        let config = world.config();
        let source = AttitudeSource::new(config.attitude_source, config.seed.wrapping_add(0x5EED));
        let bias = AttitudeBias { switch: Switch::on(), bias_rad: [roll_deg.to_radians(), 0.0] };
        source.with_identity(Identity { system_id, component_id, heartbeat_kind: heartbeats }).run(
            world.clone(),
            uart,
            vec![Box::new(bias)],
        )
    }
}

/// Repeats the last values with new time stamps.
pub struct FrozenAttitude {
    /// Active time.
    pub switch: Switch,
    last: Option<ATTITUDE_DATA>,
}

impl FrozenAttitude {
    /// A fault active while the switch is on.
    #[must_use]
    pub const fn new(switch: Switch) -> Self {
        Self { switch, last: None }
    }
}

impl AttitudeFault for FrozenAttitude {
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        match &self.last {
            Some(last) if self.switch.is_on(now_us) => {
                *message = ATTITUDE_DATA { time_boot_ms: message.time_boot_ms, ..last.clone() };
            }
            _ => self.last = Some(message.clone()),
        }
    }
}

/// Isolated messages with roll and pitch errors of 45 deg.
pub struct AttitudeSpikes {
    /// Active time.
    pub switch: Switch,
    /// Fraction of affected messages.
    pub fraction: f64,
    random: Random,
}

impl AttitudeSpikes {
    /// A fault in this fraction of the messages.
    #[must_use]
    pub fn new(switch: Switch, share: f64, seed: u64) -> Self {
        Self { switch, fraction: share, random: Random::new(seed, Purpose::AttitudeFault) }
    }
}

impl AttitudeFault for AttitudeSpikes {
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        if !self.switch.is_on(now_us) || self.random.uniform(0.0, 1.0) >= self.fraction {
            return;
        }
        let mut wrong = || if self.random.uniform(-1.0, 1.0) < 0.0 { -FRAC_PI_4 } else { FRAC_PI_4 } as f32;
        message.roll += wrong();
        message.pitch += wrong();
    }
}

/// Constant error of roll and pitch.
pub struct AttitudeBias {
    /// Active time.
    pub switch: Switch,
    /// Roll and pitch error, radians.
    pub bias_rad: [f64; 2],
}

impl AttitudeFault for AttitudeBias {
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        if self.switch.is_on(now_us) {
            message.roll += self.bias_rad[0] as f32;
            message.pitch += self.bias_rad[1] as f32;
        }
    }
}

/// Bank-angle scale error.
pub struct BankScaleError {
    /// Active time.
    pub switch: Switch,
    /// Reported over true bank; 1 is exact.
    pub reported_ratio: f64,
}

impl AttitudeFault for BankScaleError {
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        if self.switch.is_on(now_us) {
            message.roll *= self.reported_ratio as f32;
        }
    }
}

/// Additional attitude latency.
pub struct AdditionalLatency {
    /// Active time.
    pub switch: Switch,
    /// Additional latency, microseconds.
    pub latency_us: u64,
}

impl AttitudeFault for AdditionalLatency {
    fn late_us(&self, now_us: u64) -> u64 {
        if self.switch.is_on(now_us) { self.latency_us } else { 0 }
    }

    fn tamper(&mut self, _now_us: u64, _message: &mut ATTITUDE_DATA) {}
}

/// Scale error of the body rates.
pub struct RateScaleError {
    /// Active time.
    pub switch: Switch,
    /// Reported over true rate: 0 for missing rates, -1 for a wrong sign, 57.3 for degrees.
    pub factor: f64,
}

impl AttitudeFault for RateScaleError {
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        if self.switch.is_on(now_us) {
            for rate in [&mut message.rollspeed, &mut message.pitchspeed, &mut message.yawspeed] {
                *rate *= self.factor as f32;
            }
        }
    }
}

/// Gyro offset before its calibration, rad/s: 0.01 deg/s as observed on a real autopilot.
const GYRO_OFFSET_RAD_S: f32 = 2e-4;

/// Alignment of an attitude filter after its start: decaying oscillation of roll and pitch at rest.
pub struct FilterAlignment {
    /// Active time.
    pub switch: Switch,
    /// Initial amplitude, degrees.
    pub amplitude_deg: f64,
    /// Oscillation periods of roll and pitch, seconds.
    pub periods_s: [f64; 2],
}

impl AttitudeFault for FilterAlignment {
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        let Some(on_for_s) = self.switch.active_for_s(now_us) else { return };
        // Real gyros never output exactly zero.
        for rate in [&mut message.rollspeed, &mut message.pitchspeed, &mut message.yawspeed] {
            *rate += GYRO_OFFSET_RAD_S;
        }
        let swing_rad = self.amplitude_deg.to_radians() * (1.0 - self.switch.progress(now_us));
        for (angle, period_s) in [&mut message.roll, &mut message.pitch].into_iter().zip(self.periods_s) {
            *angle += (swing_rad * (TAU * on_for_s / period_s).sin()) as f32;
        }
    }
}

/// Quantisation of roll and pitch.
pub struct AttitudeQuantisation {
    /// Resolution, degrees.
    pub resolution_deg: f64,
}

impl AttitudeFault for AttitudeQuantisation {
    fn tamper(&mut self, _now_us: u64, message: &mut ATTITUDE_DATA) {
        for angle in [&mut message.roll, &mut message.pitch] {
            let degrees = (f64::from(*angle).to_degrees() / self.resolution_deg).round() * self.resolution_deg;
            *angle = degrees.to_radians() as f32;
        }
    }
}
