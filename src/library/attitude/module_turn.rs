//! A turn of the module in its mount, which the own gyro feels, and an autopilot's does not.
//!
//! Field and own gyro turn together, as in a turn of the aircraft that an autopilot with wrong rates does not report. Until the
//! angle is too large for a mount, the autopilot's rates hold the heading, so that the monitor sees the field turn. Rough rates, in
//! whole deg/s or derived from angles, do not: in turns they differ about this axis without a cause.

use crate::trig::DEG;

/// Largest turn in a mount, radians.
const MAX_TURN_RAD: f32 = 30.0 * DEG;

/// Difference that errors of the gyros explain, relative to the allowed one. With 1.2 deg/s, whatever the rates, copters whose gyro errs
/// by 10 % and whose iron moves have headings of 2.1 deg RMS, with this 1.4.
const EXPLAINED_FACTOR: f32 = 2.0;

/// Turn since the two rates agreed last.
#[derive(Debug)]
pub(super) struct ModuleTurn {
    /// Integral of the difference of the rates about the z axis, radians.
    turned_rad: f32,
    /// Integral of the difference that is allowed, radians, not negative.
    allowed_rad: f32,
    is_turning: bool,
    /// Largest turn that they did not explain, radians, not negative.
    shown_rad: f32,
}

impl ModuleTurn {
    pub const fn new() -> Self {
        Self { turned_rad: 0.0, allowed_rad: 0.0, is_turning: false, shown_rad: 0.0 }
    }

    /// Replaces both integrals, radians, while the rates agree.
    pub const fn restart(&mut self, turned_rad: f32, allowed_rad: f32) {
        (self.turned_rad, self.allowed_rad) = (turned_rad, allowed_rad);
    }

    /// Adds to both integrals, radians.
    pub fn accumulate_difference(&mut self, turned_rad: f32, allowed_rad: f32) {
        self.turned_rad += turned_rad;
        self.allowed_rad += allowed_rad;
    }

    /// Whether a module turns so far in its mount.
    pub const fn is_possible(&self) -> bool {
        self.turned_rad.abs() < MAX_TURN_RAD
    }

    /// Sets whether the rates differ as those of a module that turns.
    pub fn set_turning(&mut self, is_turning: bool) {
        self.is_turning = is_turning;
        if self.unexplained_rad() > 0.0 {
            self.shown_rad = self.shown_rad.max(self.turned_rad.abs());
        }
    }

    /// Angle by which the module turns now that errors of the gyros do not explain, radians, not negative.
    pub fn unexplained_rad(&self) -> f32 {
        if self.is_turning { (self.turned_rad.abs() - EXPLAINED_FACTOR * self.allowed_rad).max(0.0) } else { 0.0 }
    }

    /// Largest turn so far, radians, not negative.
    pub const fn shown_rad(&self) -> f32 {
        self.shown_rad
    }
}
