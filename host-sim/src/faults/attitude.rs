//! Faults of the attitude source: its messages on their way to the wire, and others on the same wire.

use std::f64::consts::{FRAC_PI_4, TAU};

use mavlink::dialects::common::ATTITUDE_DATA;

use super::Switch;
use crate::devices::uart::HostEnd;
use crate::random::{Purpose, Random};
use crate::world::World;
use crate::world::attitude_source::{AttitudeSource, Identity, Kind};

/// Something wrong with the source.
pub trait AttitudeFault {
    /// How much older than usual the attitude is that a message of now tells, microseconds.
    fn late_us(&self, _now_us: u64) -> u64 {
        0
    }

    /// Changes a message.
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA);
}

/// Another that sends attitude on the same line, from the beginning, with a roll that differs by so much.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foreign {
    /// Its system.
    pub system_id: u8,
    /// Its component.
    pub component_id: u8,
    /// What it says it is, if it says anything.
    pub heartbeats: Option<Kind>,
    /// Error of its roll, degrees.
    pub roll_deg: f64,
}

impl Foreign {
    /// Sends for ever, as often and as late as the autopilot, with noise of its own.
    pub fn run(self, world: &World, uart: HostEnd) -> impl Future<Output = ()> + use<> {
        let Self { system_id, component_id, heartbeats, roll_deg } = self;
        let config = world.config();
        let source = AttitudeSource::new(config.attitude_source, config.seed.wrapping_add(0x5EED));
        let bias = Bias { switch: Switch::on(), bias_rad: [roll_deg.to_radians(), 0.0] };
        source.sent_by(Identity { system_id, component_id, heartbeats }).run(world.clone(), uart, vec![Box::new(bias)])
    }
}

/// Values repeat, stamps go on.
pub struct Frozen {
    /// While they do.
    pub switch: Switch,
    last: Option<ATTITUDE_DATA>,
}

impl Frozen {
    /// While the switch is on.
    #[must_use]
    pub const fn new(switch: Switch) -> Self {
        Self { switch, last: None }
    }
}

impl AttitudeFault for Frozen {
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        match &self.last {
            Some(last) if self.switch.is_on(now_us) => {
                *message = ATTITUDE_DATA { time_boot_ms: message.time_boot_ms, ..last.clone() };
            }
            _ => self.last = Some(message.clone()),
        }
    }
}

/// Single messages whose roll and pitch are wrong by 45 deg either way.
pub struct Spikes {
    /// While there are some.
    pub switch: Switch,
    /// Which part of the messages.
    pub share: f64,
    random: Random,
}

impl Spikes {
    /// In this part of the messages.
    #[must_use]
    pub fn new(switch: Switch, share: f64, seed: u64) -> Self {
        Self { switch, share, random: Random::new(seed, Purpose::AttitudeFault) }
    }
}

impl AttitudeFault for Spikes {
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        if !self.switch.is_on(now_us) || self.random.uniform(0.0, 1.0) >= self.share {
            return;
        }
        let mut wrong = || if self.random.uniform(-1.0, 1.0) < 0.0 { -FRAC_PI_4 } else { FRAC_PI_4 } as f32;
        message.roll += wrong();
        message.pitch += wrong();
    }
}

/// A constant error of roll and pitch.
pub struct Bias {
    /// While it is there.
    pub switch: Switch,
    /// Of roll and of pitch, radians.
    pub bias_rad: [f64; 2],
}

impl AttitudeFault for Bias {
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        if self.switch.is_on(now_us) {
            message.roll += self.bias_rad[0] as f32;
            message.pitch += self.bias_rad[1] as f32;
        }
    }
}

/// Only a part of the bank is told.
pub struct Lean {
    /// While it leans.
    pub switch: Switch,
    /// The part that is told, 1 for all of it.
    pub told: f64,
}

impl AttitudeFault for Lean {
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        if self.switch.is_on(now_us) {
            message.roll *= self.told as f32;
        }
    }
}

/// Attitude that is older than it was.
pub struct Late {
    /// While it is.
    pub switch: Switch,
    /// By so much, microseconds.
    pub by_us: u64,
}

impl AttitudeFault for Late {
    fn late_us(&self, now_us: u64) -> u64 {
        if self.switch.is_on(now_us) { self.by_us } else { 0 }
    }

    fn tamper(&mut self, _now_us: u64, _message: &mut ATTITUDE_DATA) {}
}

/// Body rates that are not what they are taken for.
pub struct Rates {
    /// While they are not.
    pub switch: Switch,
    /// What is sent for each of what they are: 0 for nothing at all, -1 for the wrong side, 57.3 for degrees.
    pub factor: f64,
}

impl AttitudeFault for Rates {
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        if self.switch.is_on(now_us) {
            for rate in [&mut message.rollspeed, &mut message.pitchspeed, &mut message.yawspeed] {
                *rate *= self.factor as f32;
            }
        }
    }
}

/// What a gyro at rest says while its offset is not yet known, radians a second: 0.01 deg/s were seen.
const GYRO_OFFSET_RAD_S: f32 = 2e-4;

/// A filter that aligns after its start: roll and pitch swing about while nothing turns, less and less, and are right in
/// the end.
pub struct Aligning {
    /// While it does.
    pub switch: Switch,
    /// How far it swings at first, degrees.
    pub swing_deg: f64,
    /// How long a swing of roll and one of pitch take, seconds.
    pub periods_s: [f64; 2],
}

impl AttitudeFault for Aligning {
    fn tamper(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        let Some(on_for_s) = self.switch.on_for_s(now_us) else { return };
        // No gyro says nothing at all.
        for rate in [&mut message.rollspeed, &mut message.pitchspeed, &mut message.yawspeed] {
            *rate += GYRO_OFFSET_RAD_S;
        }
        let swing_rad = self.swing_deg.to_radians() * (1.0 - self.switch.progress(now_us));
        for (angle, period_s) in [&mut message.roll, &mut message.pitch].into_iter().zip(self.periods_s) {
            *angle += (swing_rad * (TAU * on_for_s / period_s).sin()) as f32;
        }
    }
}

/// Roll and pitch in steps, as of a source that sends tenths of a degree.
pub struct Coarse {
    /// The step, degrees.
    pub step_deg: f64,
}

impl AttitudeFault for Coarse {
    fn tamper(&mut self, _now_us: u64, message: &mut ATTITUDE_DATA) {
        for angle in [&mut message.roll, &mut message.pitch] {
            let degrees = (f64::from(*angle).to_degrees() / self.step_deg).round() * self.step_deg;
            *angle = degrees.to_radians() as f32;
        }
    }
}
