//! Score of a calibration: statistics of heading errors, and acceptance by an uncalibrated module.

use autoswing::acceptance::{self, AcceptanceSamples, Incumbent, Rejection};
use autoswing::calibration::{Orientation, Samples, Solution};
use serde::Serialize;

use crate::numbers::{mean, rms};

/// Largest error of a good compass, degrees RMS, and of parameters on held-back rows: they must make the compass good,
/// however bad it was. A larger remainder has a cause that parameters do not correct.
pub const GOOD_COMPASS_RMS_DEG: f64 = 2.0;

/// Error beyond which a compass is bad, degrees RMS. Up to this error parameters are given if all but
/// [`GOOD_COMPASS_RMS_DEG`] of it (in squares) is the known loss by the autopilot's symmetric matrix: flying again does
/// not reduce that.
pub const BAD_COMPASS_RMS_DEG: f64 = 5.0;

/// Statistics of heading errors, degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ErrorStatistics {
    /// Largest heading error, degrees.
    pub max_deg: f64,
    /// Mean heading error, degrees.
    pub mean_deg: f64,
    /// Root mean square heading error, degrees.
    pub rms_deg: f64,
    /// Largest heading error after subtraction of the mean, degrees.
    pub max_demeaned_deg: f64,
}

impl ErrorStatistics {
    /// Statistics of errors in degrees.
    #[must_use]
    pub fn from_errors_deg(errors_deg: &[f64]) -> Self {
        let mean_deg = mean(errors_deg.iter().copied());
        let largest = |offset: f64| errors_deg.iter().map(|error_deg| (error_deg - offset).abs()).fold(0.0, f64::max);
        Self {
            max_deg: largest(0.0),
            mean_deg,
            rms_deg: rms(errors_deg.iter().copied()),
            max_demeaned_deg: largest(mean_deg),
        }
    }
}

/// Whether an uncalibrated module accepts a solution.
///
/// # Errors
///
/// The reason of a rejection.
pub fn accepted_by_uncalibrated(
    solution: &Solution,
    fit_samples: Samples<'_>,
    held_back: Samples<'_>,
) -> Result<(), Rejection> {
    let samples = AcceptanceSamples { fit_samples, held_back_samples: held_back, is_attitude_known: true };
    let incumbent = Incumbent::uncalibrated(Orientation::IDENTITY_ROTATION);
    acceptance::evaluate_candidate(solution, samples, &incumbent).map(|_| ())
}

/// Percent of normalised errors within one and two standard deviations.
#[must_use]
pub fn within_percent(normalised: &[f64]) -> [f64; 2] {
    [1.0, 2.0].map(|sigmas| {
        let within = normalised.iter().filter(|error| error.abs() <= sigmas).count();
        100.0 * within as f64 / normalised.len().max(1) as f64
    })
}

/// Wraps an angle in degrees to -180..180.
#[must_use]
pub fn wrap_180(angle_deg: f64) -> f64 {
    (angle_deg + 180.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_match_hand_calculated_errors() {
        let statistics = ErrorStatistics::from_errors_deg(&[3.0, 1.0, -1.0, 1.0]);
        let expected = ErrorStatistics { max_deg: 3.0, mean_deg: 1.0, rms_deg: 3_f64.sqrt(), max_demeaned_deg: 2.0 };
        assert_eq!(statistics, expected);
        let within = |errors: &[f64]| within_percent(errors).map(|percent| percent.round() as i32);
        assert_eq!(within(&[0.5, -1.0, 1.1, -2.0, 2.1]), [40, 80]);
        assert_eq!(within(&[]), [0; 2]);
    }
}
