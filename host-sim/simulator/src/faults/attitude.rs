//! Faults of the attitude source: modified messages.

use std::f64::consts::{FRAC_PI_4, TAU};

use mavlink_dialect::ATTITUDE_DATA;

use crate::faults::fault_switch::FaultSwitch;
use crate::random::{RandomStream, StreamPurpose};
use crate::world::attitude_source::AttitudeSourceConfig;
pub use crate::world::fault_interfaces::AttitudeFault;
use crate::world::gauss_markov::FirstOrderProcess;

fn change_messages_while_on(switch: FaultSwitch, mut change: impl FnMut(&mut ATTITUDE_DATA)) -> impl AttitudeFault {
    move |now_us: u64, message: &mut ATTITUDE_DATA| {
        if switch.is_on(now_us) {
            change(message);
        }
    }
}

fn rates_of_message(message: &mut ATTITUDE_DATA) -> [&mut f32; 3] {
    [&mut message.rollspeed, &mut message.pitchspeed, &mut message.yawspeed]
}

/// Fault: the source repeats its last values with new time stamps.
#[must_use]
pub fn frozen_attitude(switch: FaultSwitch) -> impl AttitudeFault {
    let mut last: Option<ATTITUDE_DATA> = None;
    move |now_us: u64, message: &mut ATTITUDE_DATA| match &last {
        Some(last) if switch.is_on(now_us) => {
            *message = ATTITUDE_DATA { time_boot_ms: message.time_boot_ms, ..last.clone() };
        }
        _ => last = Some(message.clone()),
    }
}

/// Fault: roll and pitch stay at the values of the onset, with the source's noise, and body rates remain right, as of a
/// filter that ignores its gyro.
#[must_use]
pub fn stale_attitude(switch: FaultSwitch, source: &AttitudeSourceConfig, seed: u64) -> impl AttitudeFault + use<> {
    let noise = |seed| {
        let random = RandomStream::new(seed, StreamPurpose::AttitudeFault);
        FirstOrderProcess::new(source.noise_deg.to_radians(), source.noise_time_s, 1.0 / source.rate_hz, random)
    };
    let (mut roll_noise_rad, mut pitch_noise_rad) = (noise(seed), noise(!seed));
    let mut held_rad = None;
    change_messages_while_on(switch, move |message| {
        let [roll_rad, pitch_rad] = *held_rad.get_or_insert([message.roll, message.pitch]);
        message.roll = roll_rad + roll_noise_rad.next_value() as f32;
        message.pitch = pitch_rad + pitch_noise_rad.next_value() as f32;
    })
}

/// Silence of the source, in one or several intervals.
pub struct SourceSilence {
    /// Time in which the fault is active.
    pub fault_switch: FaultSwitch,
    /// Duration of an interval, seconds.
    pub silent_s: f64,
    /// Time between the beginnings of two intervals, seconds; infinite for a single one.
    pub period_s: f64,
    /// Whether the source's clock stops in an interval, so that its later time stamps are behind.
    pub stops_clock: bool,
}

impl AttitudeFault for SourceSilence {
    fn is_silent(&self, now_us: u64) -> bool {
        self.fault_switch.active_for_s(now_us).is_some_and(|active_s| active_s % self.period_s < self.silent_s)
    }

    fn modify_message(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        if let Some(active_s) = self.fault_switch.active_for_s(now_us).filter(|_| self.stops_clock) {
            let intervals = (active_s / self.period_s).floor() + 1.0;
            message.time_boot_ms = message.time_boot_ms.wrapping_sub((1e3 * intervals * self.silent_s) as u32);
        }
    }
}

/// Restart of the source: silence, then time stamps from zero and the alignment of its filter.
pub struct SourceRestart {
    /// Time in which the fault is active; it begins with the silence.
    pub fault_switch: FaultSwitch,
    /// Duration of the silence, seconds.
    pub silent_s: f64,
    /// Alignment of the attitude filter after the silence.
    pub alignment: FilterAlignment,
}

impl AttitudeFault for SourceRestart {
    fn is_silent(&self, now_us: u64) -> bool {
        self.fault_switch.active_for_s(now_us).is_some_and(|active_s| active_s < self.silent_s)
    }

    fn modify_message(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        if let Some(active_s) = self.fault_switch.active_for_s(now_us) {
            message.time_boot_ms = (1e3 * active_s) as u32;
            self.alignment.add_oscillation(active_s - self.silent_s, message);
        }
    }
}

/// Fault: roll and pitch errors of 45 deg in a fraction of the messages.
#[must_use]
pub fn attitude_spikes(switch: FaultSwitch, fraction: f64, seed: u64) -> impl AttitudeFault {
    let mut random = RandomStream::new(seed, StreamPurpose::AttitudeFault);
    change_messages_while_on(switch, move |message| {
        if random.uniform(0.0, 1.0) < fraction {
            let mut spike_rad = || if random.uniform(-1.0, 1.0) < 0.0 { -FRAC_PI_4 } else { FRAC_PI_4 } as f32;
            message.roll += spike_rad();
            message.pitch += spike_rad();
        }
    })
}

/// Fault: error of roll, pitch and heading, radians, reached at once or while the switch is on.
#[must_use]
pub fn attitude_bias(switch: FaultSwitch, bias_rad: [f64; 3]) -> impl AttitudeFault {
    move |now_us: u64, message: &mut ATTITUDE_DATA| {
        let angles = [&mut message.roll, &mut message.pitch, &mut message.yaw];
        add_changed_fraction(&switch, now_us, angles, bias_rad);
    }
}

/// Fault: offset of the body rates, rad/s, reached at once or while the switch is on.
#[must_use]
pub fn rate_offset(switch: FaultSwitch, offset_rad_s: [f64; 3]) -> impl AttitudeFault {
    move |now_us: u64, message: &mut ATTITUDE_DATA| {
        add_changed_fraction(&switch, now_us, rates_of_message(message), offset_rad_s);
    }
}

fn add_changed_fraction(switch: &FaultSwitch, now_us: u64, values: [&mut f32; 3], changes: [f64; 3]) {
    for (value, change) in values.into_iter().zip(changes) {
        *value += (switch.changed_fraction(now_us) * change) as f32;
    }
}

/// Bank-angle scale error: ratio of reported to true bank.
#[must_use]
pub fn bank_scale_error(switch: FaultSwitch, reported_ratio: f64) -> impl AttitudeFault {
    change_messages_while_on(switch, move |message| message.roll *= reported_ratio as f32)
}

/// Pitch with the wrong sign.
#[must_use]
pub fn reversed_pitch(switch: FaultSwitch) -> impl AttitudeFault {
    change_messages_while_on(switch, |message| message.pitch = -message.pitch)
}

/// Bank error of a filter that trusts its accelerometers in long turns, where the specific force shows no bank: the
/// missing bank approaches `missing_fraction` of the bank with this time constant (M. Euston et al., "A Complementary
/// Filter for Attitude Estimation of a Fixed-Wing UAV", IROS 2008, section IV).
#[must_use]
pub fn lagging_bank_error(switch: FaultSwitch, missing_fraction: f64, time_constant_s: f64) -> impl AttitudeFault {
    let (mut missing_bank_rad, mut last_us) = (0.0, None);
    move |now_us: u64, message: &mut ATTITUDE_DATA| {
        let step_s = now_us.saturating_sub(last_us.replace(now_us).unwrap_or(now_us)) as f64 / 1e6;
        let target_rad = if switch.is_on(now_us) { missing_fraction * f64::from(message.roll) } else { 0.0 };
        missing_bank_rad += (target_rad - missing_bank_rad) * (step_s / time_constant_s).min(1.0);
        message.roll -= missing_bank_rad as f32;
    }
}

/// Fault: additional latency of the attitude, reached at once or while the switch is on.
pub struct AdditionalLatency {
    /// Time in which the fault is active.
    pub fault_switch: FaultSwitch,
    /// Latency that is added to that of the attitude source, microseconds.
    pub latency_us: u64,
}

impl AttitudeFault for AdditionalLatency {
    fn added_latency_us(&self, now_us: u64) -> u64 {
        (self.fault_switch.changed_fraction(now_us) * self.latency_us as f64) as u64
    }

    fn modify_message(&mut self, _now_us: u64, _message: &mut ATTITUDE_DATA) {}
}

/// Scale error of the body rates, reported over true: 0 for missing rates, -1 for a wrong sign, 57.3 for degrees.
#[must_use]
pub fn rate_scale_error(switch: FaultSwitch, factor: f64) -> impl AttitudeFault {
    change_messages_while_on(switch, move |message| {
        for rate in rates_of_message(message) {
            *rate *= factor as f32;
        }
    })
}

/// Gyro offset that grows linearly from the onset on, degrees per second per second.
#[must_use]
pub fn rate_offset_ramp(switch: FaultSwitch, growth_deg_s2: [f64; 3]) -> impl AttitudeFault {
    move |now_us: u64, message: &mut ATTITUDE_DATA| {
        let Some(active_s) = switch.active_for_s(now_us) else { return };
        for (rate, growth_deg_s2) in rates_of_message(message).into_iter().zip(growth_deg_s2) {
            *rate += (growth_deg_s2.to_radians() * active_s) as f32;
        }
    }
}

/// Gyro offset before its calibration, rad/s: 0.01 deg/s as observed on a real autopilot.
const GYRO_OFFSET_RAD_S: f32 = 2e-4;

/// Alignment of an attitude filter after its start: decaying oscillation of roll and pitch.
#[derive(Clone, Copy, Debug)]
pub struct FilterAlignment {
    /// Initial amplitude of the oscillation, degrees.
    pub amplitude_deg: f64,
    /// Periods of roll and pitch, seconds.
    pub periods_s: [f64; 2],
    /// Duration of the decay, seconds.
    pub duration_s: f64,
}

impl FilterAlignment {
    fn add_oscillation(&self, after_s: f64, message: &mut ATTITUDE_DATA) {
        let amplitude_rad = self.amplitude_deg.to_radians() * (1.0 - after_s / self.duration_s).clamp(0.0, 1.0);
        for (angle, period_s) in [&mut message.roll, &mut message.pitch].into_iter().zip(self.periods_s) {
            *angle += (amplitude_rad * libm::sin(TAU * after_s / period_s)) as f32;
        }
    }
}

/// Alignment of the source's filter at rest, from the onset on.
#[must_use]
pub fn filter_alignment(switch: FaultSwitch, alignment: FilterAlignment) -> impl AttitudeFault {
    move |now_us: u64, message: &mut ATTITUDE_DATA| {
        let Some(active_s) = switch.active_for_s(now_us) else { return };
        // Real gyros never output exactly zero.
        for rate in rates_of_message(message) {
            *rate += GYRO_OFFSET_RAD_S;
        }
        alignment.add_oscillation(active_s, message);
    }
}

/// Fault: roll and pitch are rounded to multiples of a resolution in degrees.
#[must_use]
pub fn attitude_quantisation(resolution_deg: f64) -> impl AttitudeFault {
    change_messages_while_on(FaultSwitch::always_on(), move |message| {
        for angle in [&mut message.roll, &mut message.pitch] {
            let degrees = (f64::from(*angle).to_degrees() / resolution_deg).round() * resolution_deg;
            *angle = degrees.to_radians() as f32;
        }
    })
}
