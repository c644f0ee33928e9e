//! Hard iron that drifts without a change of strength or inclination, in straight flight.
//!
//! The heading alone then drifts, as with a drift of the gyro's offset, and the filter's estimate of the offset follows
//! it. A turn separates the two. A change of the offset since the last turn, beyond five sigmas of that turn's
//! estimate, is either the gyro's or the hard iron's: the mean square error of the heading is the square of the
//! integrated change times the probability of the latter.

/// Time constant of the mean heading rate, seconds: gusts are shorter, turns are longer.
const MEAN_RATE_TIME_CONSTANT_S: f32 = 5.0;

/// Mean heading rate of a turn, rad/s: 2.3 deg/s.
const MIN_TURN_RATE_RAD_S: f32 = 0.04;

/// Sigmas of the offset at the last turn beyond which it has changed. With three, errors of 10 % in the gyro's scale,
/// which differ from turn to turn, double the heading's sigma.
const SIGNIFICANCE_SIGMAS: f32 = 5.0;

/// Probability that hard iron has changed and not the gyro's offset. With a half, the sigma is 1.9 times the RMS error
/// when the offset grows by 2 deg/s in a minute.
const HARD_IRON_PROBABILITY: f32 = 0.25;

/// Estimate of the gyro offset of the z axis, rad/s.
#[derive(Clone, Copy, Debug)]
pub(super) struct GyroOffsetEstimate {
    pub offset_rad_s: f32,
    pub variance: f32,
}

/// Integrated change of the gyro's offset since the last turn.
#[derive(Clone, Copy, Debug)]
pub(super) struct HeadingDrift {
    mean_heading_rate_rad_s: f32,
    /// Estimate in the last turn; `None` before the first.
    offset_in_turn: Option<GyroOffsetEstimate>,
    drift_rad: f32,
}

impl HeadingDrift {
    pub const NO_DRIFT: Self = Self { mean_heading_rate_rad_s: 0.0, offset_in_turn: None, drift_rad: 0.0 };

    /// Integrates the estimate of a sample `step_s` after the last one.
    pub fn update_drift(&mut self, offset: GyroOffsetEstimate, heading_rate_rad_s: f32, step_s: f32) {
        let part = step_s / (MEAN_RATE_TIME_CONSTANT_S + step_s);
        self.mean_heading_rate_rad_s += part * (heading_rate_rad_s - self.mean_heading_rate_rad_s);
        if self.mean_heading_rate_rad_s.abs() > MIN_TURN_RATE_RAD_S {
            self.offset_in_turn = Some(offset);
            self.drift_rad -= part * self.drift_rad;
        } else if let Some(before) = self.offset_in_turn {
            let change_rad_s = offset.offset_rad_s - before.offset_rad_s;
            if change_rad_s * change_rad_s > SIGNIFICANCE_SIGMAS * SIGNIFICANCE_SIGMAS * before.variance {
                self.drift_rad += change_rad_s * step_s;
            }
        }
    }

    /// Heading variance due to a possible drift of hard iron, square radians.
    pub fn variance_rad2(&self) -> f32 {
        HARD_IRON_PROBABILITY * self.drift_rad * self.drift_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGMA_RAD_S: f32 = 1e-3;

    fn update_for_seconds(drift: &mut HeadingDrift, offset_rad_s: f32, heading_rate_rad_s: f32, seconds: u16) {
        let offset = GyroOffsetEstimate { offset_rad_s, variance: SIGMA_RAD_S * SIGMA_RAD_S };
        (0..10 * seconds).for_each(|_| drift.update_drift(offset, heading_rate_rad_s, 0.1));
    }

    /// Heading sigma, radians, after a turn and 100 s straight ahead in which the offset has changed.
    fn sigma_after_change_rad(change_sigmas: f32) -> f32 {
        let mut drift = HeadingDrift::NO_DRIFT;
        update_for_seconds(&mut drift, 0.01, 0.2, 30);
        update_for_seconds(&mut drift, 0.01, 0.0, 20);
        update_for_seconds(&mut drift, 0.01 + change_sigmas * SIGMA_RAD_S, 0.0, 100);
        drift.variance_rad2().sqrt()
    }

    /// 6 mrad/s in 100 s: 0.6 rad with a probability of one quarter.
    #[test]
    fn a_significant_change_of_the_offset_is_integrated() {
        for change in [6.0, -6.0] {
            assert!((sigma_after_change_rad(change) - 0.3).abs() < 0.005, "{}", sigma_after_change_rad(change));
        }
        assert!(sigma_after_change_rad(4.9) < 1e-6 && sigma_after_change_rad(-4.9) < 1e-6);
    }

    #[test]
    fn nothing_is_integrated_before_the_first_turn() {
        let mut drift = HeadingDrift::NO_DRIFT;
        update_for_seconds(&mut drift, 0.0, 0.0, 10);
        update_for_seconds(&mut drift, 0.1, 0.0, 100);
        assert!(drift.variance_rad2() < 1e-9, "{drift:?}");
    }

    /// Three time constants reduce the drift to a twentieth. Gusts of a second are no turn.
    #[test]
    fn a_turn_ends_the_drift() {
        let mut drift = HeadingDrift::NO_DRIFT;
        update_for_seconds(&mut drift, 0.0, 0.2, 30);
        update_for_seconds(&mut drift, 0.0, 0.0, 20);
        for gust in 0..60_u8 {
            update_for_seconds(&mut drift, 0.01, if gust.is_multiple_of(2) { 0.2 } else { -0.2 }, 1);
        }
        assert!((drift.drift_rad - 0.6).abs() < 0.01, "{drift:?}");
        update_for_seconds(&mut drift, 0.01, 0.2, 15);
        update_for_seconds(&mut drift, 0.01, 0.0, 60);
        assert!(drift.drift_rad < 0.06, "{drift:?}");
    }
}
