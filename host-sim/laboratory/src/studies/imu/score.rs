//! Errors of an estimated attitude as the BROAD benchmark defines them.
//!
//! D. Laidig, M. Caruso, A. Cereatti, T. Seel, "BROAD: A Benchmark for Robust Inertial Orientation Estimation", Data
//! 6(7), 2021: with the error quaternion `(w, x, y, z)` in the reference frame, the total error is `2 acos |w|`, that of
//! heading `2 atan |z / w|`, that of inclination `2 acos sqrt(w^2 + z^2)`.

use log_analysis::numbers::square;
use log_analysis::score::within_percent;
use nalgebra::{UnitQuaternion, Vector3};
use serde::Serialize;

/// Errors of a trial, degrees and percent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrialScore {
    /// RMS of the total error, less the mean heading error.
    pub total_deg: Option<f64>,
    /// RMS of the heading error less its circular mean: the reference's yaw has an unknown constant.
    pub heading_deg: Option<f64>,
    /// Scored rows with a heading.
    pub heading_percent: f64,
    /// These heading errors within one and two sigmas.
    pub heading_within_percent: [f64; 2],
    /// RMS of the inclination error.
    pub inclination_deg: f64,
    /// Tilt errors about each horizontal axis within one and two sigmas.
    pub tilt_within_percent: [f64; 2],
}

/// Sums of a trial's errors.
#[derive(Clone, Debug, Default)]
pub struct TrialErrors {
    inclinations_rad: Vec<f64>,
    normalised_tilts: Vec<f64>,
    headings: Vec<HeadingRow>,
}

/// A row with a heading: its error, that error's sigma, and the inclination's error, radians.
#[derive(Clone, Copy, Debug)]
struct HeadingRow {
    error: f64,
    sigma: f64,
    inclination: f64,
}

impl TrialErrors {
    /// Adds a row: estimated rotation, with any yaw if it has no heading, and true one, the heading's sigma, rad, and the sigmas of
    /// the tilt about the level frame's axes, rad.
    pub fn add_row(
        &mut self,
        estimate: &UnitQuaternion<f64>,
        truth: &UnitQuaternion<f64>,
        heading_sigma_rad: Option<f64>,
        tilt_sigmas_rad: [f64; 2],
    ) {
        let error = estimate * truth.inverse();
        let inclination_rad = 2.0 * libm::acos(libm::sqrt(square(error.w) + square(error.k)).min(1.0));
        self.inclinations_rad.push(inclination_rad);
        let heading_rad = 2.0 * libm::atan2(error.k * error.w.signum(), error.w.abs());
        let row = |sigma| HeadingRow { error: heading_rad, sigma, inclination: inclination_rad };
        self.headings.extend(heading_sigma_rad.map(row));
        // True vertical in the estimate's reference frame, turned to its level frame.
        let down = error * Vector3::z();
        let nose = estimate * Vector3::x();
        let (sin, cos) = libm::sincos(libm::atan2(nose.y, nose.x));
        let tilts = [-(cos * down.y - sin * down.x), cos * down.x + sin * down.y];
        self.normalised_tilts.extend(tilts.iter().zip(tilt_sigmas_rad).map(|(tilt, sigma_rad)| tilt / sigma_rad));
    }

    /// Score of the rows; `None` without any.
    #[must_use]
    pub fn score(&self) -> Option<TrialScore> {
        let errors_rad = || self.headings.iter().map(|row| row.error);
        let mean_rad = libm::atan2(errors_rad().map(libm::sin).sum(), errors_rad().map(libm::cos).sum());
        let without_mean = |row: &HeadingRow| HeadingRow { error: wrapped_rad(row.error - mean_rad), ..*row };
        let demeaned: Vec<HeadingRow> = self.headings.iter().map(without_mean).collect();
        // The rotations of heading and of inclination are about perpendicular axes: their half cosines multiply.
        let total =
            demeaned.iter().map(|row| 2.0 * libm::acos(libm::cos(row.error / 2.0) * libm::cos(row.inclination / 2.0)));
        let normalised: Vec<f64> = demeaned.iter().map(|row| row.error / row.sigma).collect();
        Some(TrialScore {
            total_deg: rms_deg(total),
            heading_deg: rms_deg(demeaned.iter().map(|row| row.error)),
            heading_percent: 100.0 * self.headings.len() as f64 / self.inclinations_rad.len().max(1) as f64,
            heading_within_percent: within_percent(&normalised),
            inclination_deg: rms_deg(self.inclinations_rad.iter().copied())?,
            tilt_within_percent: within_percent(&self.normalised_tilts),
        })
    }
}

fn wrapped_rad(angle_rad: f64) -> f64 {
    libm::atan2(libm::sin(angle_rad), libm::cos(angle_rad))
}

fn rms_deg(angles_rad: impl ExactSizeIterator<Item = f64>) -> Option<f64> {
    let count = angles_rad.len();
    let sum: f64 = angles_rad.map(square).sum();
    (count > 0).then(|| (sum / count as f64).sqrt().to_degrees())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: tilts of 3 and -3 deg about the body's y axis, and heading errors of 10 and 14 deg, whose mean counts
    /// not.
    #[test]
    fn errors_are_divided_into_heading_and_inclination() {
        let mut errors = TrialErrors::default();
        for (heading_deg, tilt_deg) in [(10.0_f64, 3.0_f64), (14.0, -3.0)] {
            let truth = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.7);
            let tilt = UnitQuaternion::from_euler_angles(0.0, tilt_deg.to_radians(), 0.0);
            let yaw = UnitQuaternion::from_euler_angles(0.0, 0.0, heading_deg.to_radians());
            let [heading_sigma, across, along] = [1.5, 0.1, 2.0].map(f64::to_radians);
            errors.add_row(&(yaw * truth * tilt), &truth, Some(heading_sigma), [across, along]);
        }
        let score = errors.score().unwrap();
        assert!(
            (score.heading_deg.unwrap() - 2.0).abs() < 1e-6 && (score.inclination_deg - 3.0).abs() < 1e-6,
            "{score:?}"
        );
        assert!((score.total_deg.unwrap() - 13_f64.sqrt()).abs() < 2e-3, "{score:?}");
        // No error about x, and one of 1.5 sigmas about y; headings of 1.3 sigmas.
        let within_percent = (score.tilt_within_percent, score.heading_within_percent);
        assert_eq!((within_percent, score.heading_percent), (([50.0, 100.0], [0.0, 100.0]), 100.0));
        assert_eq!(TrialErrors::default().score(), None);
    }
}
