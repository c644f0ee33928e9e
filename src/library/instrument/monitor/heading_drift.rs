//! Drift of the heading that either the gyro's offset or hard iron explains.
//!
//! Hard iron that changes across the horizontal field turns the heading without a change of strength or inclination. In
//! straight flight the filter's estimate of the gyro's offset follows it, and with it the heading. If the offset has
//! not changed, the error of the heading is the integral of the estimate's change since the offset was known: from a
//! turn, which separates the two, or from the time without a change before. The mean square error is the square of
//! that integral times the probability of hard iron.

use super::parameters::{GYRO_OFFSET_SIGMA_RAD_S, HARD_IRON_PROBABILITY};
use crate::trig::square;

/// Time constant of the mean heading rate, seconds: gusts are shorter, turns are longer.
const MEAN_RATE_TIME_CONSTANT_S: f32 = 3.0;

/// Mean heading rate of a turn, rad/s: 4.6 deg/s. In a slower one the offset is observable too late.
const MIN_TURN_RATE_RAD_S: f32 = 0.08;

/// Change of the offset, in sigmas of the known one, that is as probable with hard iron as without. With 2, twice as
/// many headings are bad after hard iron has changed by 5 uT within 4 to 60 s.
const SIGNIFICANCE_SIGMAS: f32 = 1.5;

/// Ratio of variances from which an estimate without a change replaces the known offset: half the sigma.
const LEARNT_VARIANCE_RATIO: f32 = 0.25;

/// Estimate of the gyro offset of the z axis, rad/s.
#[derive(Clone, Copy, Debug)]
pub(super) struct GyroOffsetEstimate {
    pub offset_rad_s: f32,
    pub variance: f32,
}

/// Integrated change of the gyro's offset since it was known.
#[derive(Clone, Copy, Debug)]
pub(super) struct HeadingDrift {
    mean_heading_rate_rad_s: f32,
    known_offset: GyroOffsetEstimate,
    drift_rad: f32,
}

impl HeadingDrift {
    pub const NO_DRIFT: Self = Self {
        mean_heading_rate_rad_s: 0.0,
        known_offset: GyroOffsetEstimate { offset_rad_s: 0.0, variance: square(GYRO_OFFSET_SIGMA_RAD_S) },
        drift_rad: 0.0,
    };

    /// Integrates the estimate of a sample `step_s` after the last one.
    pub fn update_drift(&mut self, offset: GyroOffsetEstimate, heading_rate_rad_s: f32, step_s: f32) {
        let part = step_s / (MEAN_RATE_TIME_CONSTANT_S + step_s);
        self.mean_heading_rate_rad_s += part * (heading_rate_rad_s - self.mean_heading_rate_rad_s);
        let change_rad_s = offset.offset_rad_s - self.known_offset.offset_rad_s;
        let usual_square = square(SIGNIFICANCE_SIGMAS) * self.known_offset.variance;
        // After a turn its mean rate lasts for seconds, in which the offset is no longer observable.
        if self.is_turning() && heading_rate_rad_s.abs() > MIN_TURN_RATE_RAD_S {
            self.known_offset = offset;
            self.drift_rad -= part * self.drift_rad;
        } else if offset.variance < LEARNT_VARIANCE_RATIO * self.known_offset.variance
            && square(change_rad_s) < usual_square
        {
            self.known_offset = offset;
        } else {
            let is_changed = square(change_rad_s) / (square(change_rad_s) + usual_square + f32::MIN_POSITIVE);
            self.drift_rad += is_changed * change_rad_s * step_s;
        }
    }

    /// Whether the mean heading rate of the last seconds is that of a turn.
    pub fn is_turning(&self) -> bool {
        self.mean_heading_rate_rad_s.abs() > MIN_TURN_RATE_RAD_S
    }

    /// Heading variance due to a possible drift of hard iron, square radians.
    pub fn variance_rad2(&self) -> f32 {
        HARD_IRON_PROBABILITY * square(self.drift_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGMA_RAD_S: f32 = 1e-3;

    fn update_for_seconds(drift: &mut HeadingDrift, offset_rad_s: f32, heading_rate_rad_s: f32, seconds: u16) {
        let offset = GyroOffsetEstimate { offset_rad_s, variance: square(SIGMA_RAD_S) };
        (0..10 * seconds).for_each(|_| drift.update_drift(offset, heading_rate_rad_s, 0.1));
    }

    /// Five time constants reduce the drift to less than a hundredth. Gusts of a second are no turn, and what the
    /// offset becomes right after a turn is not known from it.
    #[test]
    fn a_turn_ends_the_drift() {
        let mut drift = HeadingDrift::NO_DRIFT;
        update_for_seconds(&mut drift, 0.0, 0.2, 30);
        update_for_seconds(&mut drift, 0.0, 0.0, 20);
        for gust in 0..60_u8 {
            update_for_seconds(&mut drift, 0.01, if gust.is_multiple_of(2) { 0.2 } else { -0.2 }, 1);
        }
        assert!((drift.drift_rad - 0.6).abs() < 0.03, "{drift:?}");
        update_for_seconds(&mut drift, 0.01, 0.2, 15);
        update_for_seconds(&mut drift, 0.01, 0.0, 60);
        assert!(drift.drift_rad < 0.01, "{drift:?}");
        update_for_seconds(&mut drift, 0.01, 0.2, 15);
        update_for_seconds(&mut drift, 0.02, 0.0, 10);
        assert!((drift.drift_rad - 0.1).abs() < 0.01, "{drift:?}");
    }
}
