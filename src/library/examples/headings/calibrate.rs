//! Calibration from samples, and heading of a sample: `no_std`, without allocation.

use autoswing::calibration::{
    AngleRates, CollectionPart, Method, MotorCurrent, Prior, Sample, Samples, Solution, SolveError, solve_samples,
};
use autoswing::frames::{Field, RollPitch};
use autoswing::heading::{HeadingLimits, NoHeading, compute_heading};
use autoswing::time::WrappingMillis;

/// Creates a sample from time (s), field (milligauss; x forward, y right, z down), roll and pitch (deg).
#[must_use]
pub fn sample([time_s, x, y, z, roll_deg, pitch_deg]: [f32; 6]) -> Sample {
    Sample {
        field: Field::from_ut(x / 10.0, y / 10.0, z / 10.0),
        attitude: RollPitch::from_deg(roll_deg, pitch_deg),
        rates: AngleRates::UNKNOWN,
        time: WrappingMillis::new((time_s * 1000.0) as u32),
        current: MotorCurrent::UNKNOWN,
        part: CollectionPart::FREE,
    }
}

/// Estimates the twelve deviation coefficients from a flight with turns and bank.
///
/// # Errors
///
/// The samples do not determine the coefficients.
pub fn calibrate(samples: &[Sample]) -> Result<Solution, SolveError> {
    solve_samples(Method::MaximumLikelihood, Samples::new(samples), &Prior::default())
}

/// Magnetic heading of a sample and its standard deviation, degrees.
///
/// # Errors
///
/// [`NoHeading::FieldDisturbed`] if the corrected field differs from the calibration's Earth field.
pub fn heading_deg(solution: &Solution, sample: &Sample) -> Result<[f32; 2], NoHeading> {
    let Solution { calibration, uncertainty, .. } = solution;
    let heading = compute_heading(HeadingLimits::DEFAULT, calibration, uncertainty, sample.field, sample.attitude)?;
    Ok([heading.magnetic_deg(), heading.sigma_deg()])
}
