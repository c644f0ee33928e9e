//! True state of the vehicle at one instant.

use std::f64::consts::TAU;

use autoswing::frames::RollPitch;

use super::rotation::Euler;

/// Attitude, heading, motion. Angles in radians, FRD body axes, Euler ZYX; heading is not wrapped.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrueState {
    /// Simulation time, microseconds.
    pub time_us: u64,
    /// Roll, right wing down positive.
    pub roll_rad: f64,
    /// Pitch, nose up positive.
    pub pitch_rad: f64,
    /// Magnetic heading of the nose, clockwise from north, not wrapped.
    pub heading_rad: f64,
    /// Derivative of roll, rad/s.
    pub roll_rate_rad_s: f64,
    /// Derivative of pitch, rad/s.
    pub pitch_rate_rad_s: f64,
    /// Derivative of heading, rad/s.
    pub heading_rate_rad_s: f64,
    /// Angle from the nose to the velocity through the air; positive for air from the right.
    pub sideslip_rad: f64,
    /// Position over ground, metres magnetic north of the start.
    pub north_m: f64,
    /// Position over ground, metres magnetic east of the start.
    pub east_m: f64,
    /// Velocity over ground toward magnetic north, metres per second.
    pub north_m_s: f64,
    /// Velocity over ground toward magnetic east, metres per second.
    pub east_m_s: f64,
    /// Magnitude of the horizontal acceleration that causes tilt errors of the attitude source, m/s^2.
    pub disturbing_acceleration_m_s2: f64,
    /// Motor current relative to level flight, hover or driving on level ground.
    pub relative_current: f64,
}

/// Motor current in level flight, in hover or on level ground, amperes; typical of an aircraft of a few kilograms.
pub const CRUISE_CURRENT_A: f64 = 15.0;

impl TrueState {
    /// Simulation time, seconds.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.time_us as f64 / 1e6
    }

    /// Motor current, amperes.
    #[must_use]
    pub fn current_a(&self) -> f64 {
        self.relative_current * CRUISE_CURRENT_A
    }

    /// Magnetic heading in degrees, 0..360.
    #[must_use]
    pub fn heading_deg(&self) -> f64 {
        self.heading_rad.rem_euclid(TAU).to_degrees()
    }

    /// Euler angles.
    #[must_use]
    pub fn euler_angles(&self) -> Euler {
        Euler { roll_rad: self.roll_rad, pitch_rad: self.pitch_rad, heading_rad: self.heading_rad }
    }

    /// Roll and pitch in the library's type.
    #[must_use]
    pub fn attitude(&self) -> RollPitch {
        RollPitch { roll_rad: self.roll_rad as f32, pitch_rad: self.pitch_rad as f32 }
    }

    /// Angular rates about the body axes x, y, z, radians per second, as gyros measure them.
    #[must_use]
    pub fn body_rates_rad_s(&self) -> [f64; 3] {
        let (sin_roll, cos_roll) = libm::sincos(self.roll_rad);
        let (sin_pitch, cos_pitch) = libm::sincos(self.pitch_rad);
        [
            self.roll_rate_rad_s - self.heading_rate_rad_s * sin_pitch,
            self.pitch_rate_rad_s * cos_roll + self.heading_rate_rad_s * sin_roll * cos_pitch,
            self.heading_rate_rad_s * cos_roll * cos_pitch - self.pitch_rate_rad_s * sin_roll,
        ]
    }

    pub(super) fn interpolate(&self, later: &Self, time_us: u64) -> Self {
        let elapsed_us = time_us.saturating_sub(self.time_us) as f64;
        let share = elapsed_us / (later.time_us - self.time_us) as f64;
        let interpolate_value = |from: f64, to: f64| from + (to - from) * share;
        Self {
            time_us,
            roll_rad: interpolate_value(self.roll_rad, later.roll_rad),
            pitch_rad: interpolate_value(self.pitch_rad, later.pitch_rad),
            heading_rad: interpolate_value(self.heading_rad, later.heading_rad),
            roll_rate_rad_s: interpolate_value(self.roll_rate_rad_s, later.roll_rate_rad_s),
            pitch_rate_rad_s: interpolate_value(self.pitch_rate_rad_s, later.pitch_rate_rad_s),
            heading_rate_rad_s: interpolate_value(self.heading_rate_rad_s, later.heading_rate_rad_s),
            sideslip_rad: interpolate_value(self.sideslip_rad, later.sideslip_rad),
            north_m: interpolate_value(self.north_m, later.north_m),
            east_m: interpolate_value(self.east_m, later.east_m),
            north_m_s: interpolate_value(self.north_m_s, later.north_m_s),
            east_m_s: interpolate_value(self.east_m_s, later.east_m_s),
            disturbing_acceleration_m_s2: interpolate_value(
                self.disturbing_acceleration_m_s2,
                later.disturbing_acceleration_m_s2,
            ),
            relative_current: interpolate_value(self.relative_current, later.relative_current),
        }
    }
}
