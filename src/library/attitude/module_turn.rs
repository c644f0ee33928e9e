//! A turn of the module in its mount, which the own gyro feels, and an autopilot's does not.
//!
//! Field and own gyro turn together, as in a turn of the aircraft that an autopilot with wrong rates does not report. Until the
//! angle is too large for a mount, the autopilot's rates hold the heading, so that the monitor sees the field turn.

use crate::trig::DEG;

/// Largest turn in a mount, radians.
const MAX_TURN_RAD: f32 = 30.0 * DEG;

/// Difference that errors of the gyros explain, relative to the allowed one. With 1.2 deg/s, whatever the rates, copters whose gyro errs
/// by 10 % and whose iron moves have headings of 2.1 deg RMS, with this 1.4.
const EXPLAINED_FACTOR: f32 = 2.0;

/// Integrals of the difference of the rates about the z axis, and of its bound by the errors of two gyros, radians.
#[derive(Debug)]
pub(super) struct ModuleTurn {
    turned_rad: f32,
    explained_rad: f32,
}

impl ModuleTurn {
    pub const NONE: Self = Self { turned_rad: 0.0, explained_rad: 0.0 };

    /// Adds a step with this difference of the rates, rad/s, of which errors of the gyros may be `by_gyros_rad_s`.
    pub fn accumulate_difference(&mut self, difference_rad_s: f32, by_gyros_rad_s: f32, step_s: f32) {
        self.turned_rad += difference_rad_s * step_s;
        self.explained_rad += EXPLAINED_FACTOR * by_gyros_rad_s * step_s;
    }

    /// Whether a module turns so far in its mount.
    pub const fn is_possible(&self) -> bool {
        self.turned_rad.abs() < MAX_TURN_RAD
    }

    /// Angle that errors of the gyros do not explain, radians, not negative.
    pub fn unexplained_rad(&self) -> f32 {
        (self.turned_rad.abs() - self.explained_rad).max(0.0)
    }
}
