//! A frame that the own gyro holds still: the rotation since an arbitrary instant, for the last 0.9 s.
//!
//! In it the vertical stays but for the gyro's errors, however the vehicle turns, and without any assumption on its accelerations.

use heapless::HistoryBuf;
use nalgebra::{UnitQuaternion, Vector3};

use super::source::HAS_OWN_ATTITUDE;
use crate::inertial::{normalised, rotated_in_body};
use crate::time::Timestamp;

/// Interval of the remembered rotations, microseconds: at 300 deg/s^2 the interpolation's error is 0.1 deg.
pub(super) const REMEMBERED_STEP_US: u64 = 50_000;

/// Number of remembered rotations.
const REMEMBERED_COUNT: usize = if HAS_OWN_ATTITUDE { 19 } else { 1 };

/// Longest interval between two rates, and after the newest, microseconds; a longer one is a pause of the sensors.
pub(super) const MAX_STEP_US: u64 = 100_000;

/// Newest rotation and rates.
#[derive(Clone, Copy, Debug)]
struct NewestRotation {
    at: Timestamp,
    /// From body axes to the frame.
    rotation: UnitQuaternion<f32>,
    rates_rad_s: Vector3<f32>,
}

impl NewestRotation {
    /// Rotation some time later, at the mean of these rates and others.
    fn rotation_at(&self, at: Timestamp, rates_rad_s: &Vector3<f32>) -> UnitQuaternion<f32> {
        let mean_rad_s = (self.rates_rad_s + rates_rad_s) * 0.5;
        rotated_in_body(&self.rotation, &(mean_rad_s * (at.us_since(self.at) as f32 * 1e-6)))
    }
}

/// Rotation from body axes to the frame at recent instants.
#[derive(Debug)]
pub(super) struct GyroFrame {
    newest: Option<NewestRotation>,
    remembered: HistoryBuf<(Timestamp, UnitQuaternion<f32>), REMEMBERED_COUNT>,
}

impl GyroFrame {
    pub const fn new() -> Self {
        Self { newest: None, remembered: HistoryBuf::new() }
    }

    /// Integrates to body rates of an instant, rad/s. After a gap, and after an instant without known rates, a new frame starts.
    pub fn push_rates(&mut self, at: Timestamp, rates_rad_s: Option<Vector3<f32>>) {
        let Some(rates_rad_s) = rates_rad_s else {
            *self = Self::new();
            return;
        };
        if self.newest.is_some_and(|newest| at.us_since(newest.at) > MAX_STEP_US) {
            *self = Self::new();
        }
        let rotation = self.newest.map_or_else(UnitQuaternion::identity, |newest| newest.rotation_at(at, &rates_rad_s));
        self.newest = Some(NewestRotation { at, rotation, rates_rad_s });
        if self.remembered.recent().is_none_or(|(last_at, _)| at.us_since(*last_at) >= REMEMBERED_STEP_US) {
            self.remembered.write((at, rotation));
        }
    }

    /// Rotation from body axes to the frame at an instant: interpolated, or extrapolated for a short time.
    pub fn rotation_at(&self, at: Timestamp) -> Option<UnitQuaternion<f32>> {
        let newest = self.newest?;
        if at >= newest.at {
            return (at.us_since(newest.at) <= MAX_STEP_US).then(|| newest.rotation_at(at, &newest.rates_rad_s));
        }
        let mut after = (newest.at, newest.rotation);
        for (before_at, before) in self.remembered.oldest_ordered().rev() {
            if *before_at <= at {
                let step_us = after.0.us_since(*before_at).max(1);
                let fraction = at.us_since(*before_at) as f32 / step_us as f32;
                return Some(normalised(before.quaternion() * (1.0 - fraction) + after.1.quaternion() * fraction));
            }
            after = (*before_at, *before);
        }
        None
    }
}
