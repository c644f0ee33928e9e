//! The truth about the aircraft at one instant.

use std::f64::consts::TAU;

use autoswing::frames::Attitude;

use super::rotation::Euler;

/// Attitude, heading, motion. Angles in radians, FRD body axes, Euler ZYX; heading counts whole turns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrueState {
    /// Microseconds of the virtual clock.
    pub time_us: u64,
    /// Bank, right wing down positive.
    pub roll_rad: f64,
    /// Pitch, nose up positive.
    pub pitch_rad: f64,
    /// Magnetic heading of the nose, clockwise from north, not wrapped.
    pub heading_rad: f64,
    /// Derivative of the bank.
    pub roll_rate_rad_s: f64,
    /// Derivative of the pitch.
    pub pitch_rate_rad_s: f64,
    /// Derivative of the heading.
    pub heading_rate_rad_s: f64,
    /// Angle from the nose to the motion through the air, air from the right positive.
    pub sideslip_rad: f64,
    /// Position over ground, metres magnetic north of the start.
    pub north_m: f64,
    /// Position over ground, metres magnetic east of the start.
    pub east_m: f64,
    /// Velocity over ground toward magnetic north, metres per second.
    pub north_m_s: f64,
    /// Velocity over ground toward magnetic east, metres per second.
    pub east_m_s: f64,
    /// Size of the horizontal acceleration that an attitude source takes for tilt, metres per second squared.
    pub push_m_s2: f64,
    /// Current of the motors, of that in level flight, in hover, or on the flat.
    pub current: f64,
}

/// Current of the motors in level flight, in hover, or on the flat, amperes: that of an aircraft of some kilograms.
pub const CRUISE_A: f64 = 15.0;

impl TrueState {
    /// Current of the motors, amperes.
    #[must_use]
    pub fn current_a(&self) -> f64 {
        self.current * CRUISE_A
    }

    /// Magnetic heading in degrees, 0..360.
    #[must_use]
    pub fn heading_deg(&self) -> f64 {
        self.heading_rad.rem_euclid(TAU).to_degrees()
    }

    /// Course over ground in degrees from magnetic north, 0..360: what a satellite receiver would show.
    #[must_use]
    pub fn course_deg(&self) -> f64 {
        self.east_m_s.atan2(self.north_m_s).rem_euclid(TAU).to_degrees()
    }

    /// How the aircraft lies.
    #[must_use]
    pub fn euler(&self) -> Euler {
        Euler { roll_rad: self.roll_rad, pitch_rad: self.pitch_rad, heading_rad: self.heading_rad }
    }

    /// Roll and pitch, as the module's library takes them.
    #[must_use]
    pub fn attitude(&self) -> Attitude {
        Attitude { roll_rad: self.roll_rad as f32, pitch_rad: self.pitch_rad as f32 }
    }

    /// Rates about the body axes x, y, z, radians per second: what gyros measure.
    #[must_use]
    pub fn body_rates_rad_s(&self) -> [f64; 3] {
        let (sin_roll, cos_roll) = self.roll_rad.sin_cos();
        let (sin_pitch, cos_pitch) = self.pitch_rad.sin_cos();
        [
            self.roll_rate_rad_s - self.heading_rate_rad_s * sin_pitch,
            self.pitch_rate_rad_s * cos_roll + self.heading_rate_rad_s * sin_roll * cos_pitch,
            self.heading_rate_rad_s * cos_roll * cos_pitch - self.pitch_rate_rad_s * sin_roll,
        ]
    }

    /// The state at `time_us` on the straight line from this one to a later one.
    pub(super) fn interpolate(&self, later: &Self, time_us: u64) -> Self {
        let passed_us = time_us.saturating_sub(self.time_us) as f64;
        let share = passed_us / (later.time_us - self.time_us) as f64;
        let mix = |from: f64, to: f64| from + (to - from) * share;
        Self {
            time_us,
            roll_rad: mix(self.roll_rad, later.roll_rad),
            pitch_rad: mix(self.pitch_rad, later.pitch_rad),
            heading_rad: mix(self.heading_rad, later.heading_rad),
            roll_rate_rad_s: mix(self.roll_rate_rad_s, later.roll_rate_rad_s),
            pitch_rate_rad_s: mix(self.pitch_rate_rad_s, later.pitch_rate_rad_s),
            heading_rate_rad_s: mix(self.heading_rate_rad_s, later.heading_rate_rad_s),
            sideslip_rad: mix(self.sideslip_rad, later.sideslip_rad),
            north_m: mix(self.north_m, later.north_m),
            east_m: mix(self.east_m, later.east_m),
            north_m_s: mix(self.north_m_s, later.north_m_s),
            east_m_s: mix(self.east_m_s, later.east_m_s),
            push_m_s2: mix(self.push_m_s2, later.push_m_s2),
            current: mix(self.current, later.current),
        }
    }
}
