//! Comparison of the autopilot's vertical with the own one.
//!
//! The two differ by the alignment of their sensors, which stays, and by their errors. A larger difference is an error that one of them
//! does not know: an attitude that hangs, or that reports a part of a copter's lean, which no rate shows in hover. Which of the two is
//! right stays open: the excess is a variance of the tilt. A smaller difference is noise: in a hover that accelerates the autopilot's
//! vertical is wrong by degrees for seconds.

use nalgebra::Vector3;

use super::autopilot_errors::{TILT_ERROR_TIME_S, TiltError};
use super::euler_rates::MIN_COS_PITCH;
use super::sender_selector::SenderId;
use crate::time::Timestamp;
use crate::trig::{DEG, hypot, square};

/// Difference by the alignment of the sensors before the first comparison, rad, on each axis, and its random walk, rad/sqrt(s): 0.25 deg
/// in a minute, by temperature.
const ALIGNMENT_SIGMA_RAD: f32 = 3.0 * DEG;
const ALIGNMENT_RANDOM_WALK: f32 = 0.03 * DEG;

/// Error of the autopilot's vertical, rad.
const AUTOPILOT_SIGMA_RAD: f32 = 0.5 * DEG;

/// Time constant of the difference, seconds.
const SMOOTHING_S: f32 = 1.0;

/// Longest interval between two comparisons, seconds.
const MAX_STEP_S: f32 = 1.0;

/// Square of the difference, relative to the variance of an axis, that the errors explain: 95 % of the squares are smaller. Of copters with
/// 30 % of the true lean 0.4 % of the headings are bad, without the comparison 1.7 %.
const EXPLAINED_SQUARE: f32 = 6.0;

/// Share of the autopilot in the square of a difference of the verticals. With all of it, a plane's sigma is 1.4 times
/// its RMS error, not 1.3; without any, a VTOL's RMS is 0.57 deg, not 0.40.
const AUTOPILOT_SHARE: f32 = 0.5;

/// Largest smoothed difference that is noise, rad, on each axis: by accelerations of 7 m/s^2 at 0.4 deg per m/s^2. A larger one is an error
/// that the monitor finds. With it as noise 0.2 % of a plane's headings are bad after a bias of 5 deg, not 0.
const MAX_NOISE_RAD: f32 = 0.05;

/// Difference of the two verticals, and its part by the alignment.
#[derive(Debug)]
pub(super) struct TiltComparison {
    /// Autopilot whose sensors have this alignment.
    sender: SenderId,
    compared_at: Timestamp,
    alignment_rad: Vector3<f32>,
    alignment_variance: f32,
    /// Smoothed difference without the alignment.
    difference_rad: Vector3<f32>,
    tilt_error: Option<TiltError>,
}

impl TiltComparison {
    pub const fn new(sender: SenderId) -> Self {
        Self {
            sender,
            compared_at: Timestamp::START,
            alignment_rad: Vector3::new(0.0, 0.0, 0.0),
            alignment_variance: ALIGNMENT_SIGMA_RAD * ALIGNMENT_SIGMA_RAD,
            difference_rad: Vector3::new(0.0, 0.0, 0.0),
            tilt_error: None,
        }
    }

    pub const fn sender(&self) -> SenderId {
        self.sender
    }

    /// Compares the two verticals of an instant in body axes, the own one with this variance of its tilt, rad^2. A contradiction is no
    /// alignment.
    pub fn compare_verticals(&mut self, at: Timestamp, autopilot: Vector3<f32>, own: Vector3<f32>, own_variance: f32) {
        let step_s = (at.us_since(self.compared_at) as f32 * 1e-6).min(MAX_STEP_S);
        self.compared_at = at;
        let deviation_rad = autopilot - own - self.alignment_rad;
        self.difference_rad += (deviation_rad - self.difference_rad) * (step_s / SMOOTHING_S);
        let errors_variance = 0.5 * (own_variance + square(AUTOPILOT_SIGMA_RAD));
        // Of each horizontal axis.
        let is_noise = 0.5 * self.difference_rad.norm_squared() <= square(MAX_NOISE_RAD);
        let [roll_rad, pitch_rad] = roll_and_pitch_error(&own, &self.difference_rad);
        self.tilt_error = Some(TiltError {
            roll_rad,
            pitch_rad,
            variance_rad2: errors_variance + self.alignment_variance,
            noise_variance_rad2: if is_noise { AUTOPILOT_SHARE * 0.5 * deviation_rad.norm_squared() } else { 0.0 },
        });
        self.alignment_variance += square(ALIGNMENT_RANDOM_WALK) * step_s;
        if self.excess_variance() == 0.0 {
            // As independent measurements in the time for which the errors stay.
            let gain = step_s * self.alignment_variance
                / (step_s * self.alignment_variance + 4.0 * TILT_ERROR_TIME_S * errors_variance);
            self.alignment_rad += deviation_rad * gain;
            self.alignment_variance *= 1.0 - gain;
        }
    }

    /// Forgets the difference while there is no own vertical to compare with.
    pub fn pause(&mut self) {
        (self.difference_rad, self.tilt_error) = (Vector3::zeros(), None);
    }

    /// Error of the autopilot's roll and pitch by the own vertical at the last comparison.
    pub const fn tilt_error(&self) -> Option<TiltError> {
        self.tilt_error
    }

    /// Variance of the tilt, rad^2, by a difference that the errors of both do not explain.
    pub fn excess_variance(&self) -> f32 {
        let excess = |error: TiltError| self.difference_rad.norm_squared() - EXPLAINED_SQUARE * error.variance_rad2;
        self.tilt_error.map_or(0.0, excess).max(0.0)
    }
}

/// Errors of roll and pitch that move the vertical in body axes by a difference.
fn roll_and_pitch_error(vertical: &Vector3<f32>, difference: &Vector3<f32>) -> [f32; 2] {
    let cos_pitch = hypot(vertical.y, vertical.z).max(MIN_COS_PITCH);
    [(difference.y * vertical.z - difference.z * vertical.y) / square(cos_pitch), -difference.x / cos_pitch]
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::super::testing::report_time;
    use super::*;

    /// Comparison by a difference in roll of `(alignment, later)` degrees: as before for 100 s, and then by so much more for 3 s, with own
    /// errors of this sigma that stay for a second.
    fn comparison_after(alignment_deg: f32, later_deg: f32, own_sigma_deg: f32) -> TiltComparison {
        let (mut comparison, mut random) = (TiltComparison::new(SenderId::new(1)), Random(1));
        let mut own_error_deg = Vector3::zeros();
        for i in 0..5150_u16 {
            if i % 50 == 0 {
                own_error_deg = Vector3::from_fn(|_, _| own_sigma_deg / core::f32::consts::SQRT_2 * random.normal());
            }
            let difference_deg = alignment_deg + if i < 5000 { 0.0 } else { later_deg };
            let autopilot = Vector3::new(0.0, (difference_deg * DEG).sin(), (difference_deg * DEG).cos());
            let own = Vector3::z() + own_error_deg * DEG;
            comparison.compare_verticals(report_time(i), autopilot, own, square(own_sigma_deg * DEG));
        }
        comparison
    }

    /// The alignment, which stays, and errors as large as their sigma are no contradiction; a lean of 4 deg is, if the own vertical is
    /// known to 0.7 deg. A heading is wrong beyond four sigmas, so that half of the difference is enough.
    #[test]
    fn a_difference_beyond_alignment_and_errors_is_a_variance() {
        for (alignment_deg, later_deg, own_sigma_deg, expected_deg) in [
            (0.0, 0.0, 0.7, 0.0..=0.0),
            (4.0, 0.0, 0.7, 0.0..=0.0),
            (4.0, 4.0, 0.7, 2.0..=4.0),
            (-2.0, 8.0, 0.7, 6.0..=8.0),
            (0.0, 4.0, 3.0, 0.0..=0.0),
        ] {
            let comparison = comparison_after(alignment_deg, later_deg, own_sigma_deg);
            let sigma_deg = comparison.excess_variance().sqrt() / DEG;
            assert!(expected_deg.contains(&sigma_deg), "{alignment_deg} {later_deg} {own_sigma_deg}: {sigma_deg}");
        }
    }

    /// The mean error is that of roll. The autopilot's sigma of an axis is half of a difference of roll alone, unless it is too large for
    /// noise, as long as there is an own vertical.
    #[test]
    fn a_difference_of_an_instant_is_noise() {
        for (alignment_deg, later_deg, expected_deg) in
            [(0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (4.0, 2.0, 1.0), (0.0, 5.0, 0.0)]
        {
            let mut comparison = comparison_after(alignment_deg, later_deg, 0.0);
            let error = comparison.tilt_error().unwrap();
            let is_mean = (error.roll_rad / DEG - later_deg).abs() < 0.3 && error.pitch_rad.abs() < 0.01 * DEG;
            assert!(is_mean, "{alignment_deg} {later_deg}: {error:?}");
            let sigma_deg = error.noise_variance_rad2.sqrt() / DEG;
            assert!((sigma_deg - expected_deg).abs() < 0.1, "{alignment_deg} {later_deg}: {sigma_deg}");
            comparison.pause();
            assert!(comparison.tilt_error().is_none() && comparison.excess_variance() <= 0.0);
        }
    }
}
