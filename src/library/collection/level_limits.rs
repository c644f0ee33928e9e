//! Limits of level attitude.

use super::turn_detector::TurnDetectorConfig;
use crate::calibration::Sample;

/// Limits of level attitude.
#[derive(Clone, Copy, Debug)]
pub struct LevelLimits {
    /// Largest absolute roll of a level sample, radians; equal to the bank at which a turn ends.
    pub level_roll_rad: f32,
    /// Largest absolute pitch of a level sample, radians.
    pub level_pitch_rad: f32,
}

impl LevelLimits {
    /// Limits for all vehicles.
    pub const DEFAULT: Self =
        Self { level_roll_rad: TurnDetectorConfig::DEFAULT.leave_roll_rad, level_pitch_rad: 12_f32.to_radians() };
}

pub(super) fn is_level(sample: &Sample) -> bool {
    let LevelLimits { level_roll_rad, level_pitch_rad } = LevelLimits::DEFAULT;
    sample.attitude.roll_rad.abs() <= level_roll_rad && sample.attitude.pitch_rad.abs() <= level_pitch_rad
}
