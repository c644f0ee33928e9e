//! A candidate against the calibration in use, on samples that neither was fitted to.
//!
//! A right calibration gives the same total field and the same inclination at every attitude. How far each strays from
//! its own mean over the held-back samples is its score. The mean is free, because the field differs from place to
//! place. What this cannot see is an error that leaves both alone, such as a constant heading offset; that is why a
//! candidate's expected error is asked for as well.

use super::{Calibration, Sample, Samples};

/// Scale of the relative deviation of the total field: a good fit's, so that its score is about 1.
const NORM_SCALE: f32 = 0.004;

/// Scale of the deviation of inclination, radians: 0.3 deg, a good fit's.
const DIP_SCALE_RAD: f32 = 0.005;

/// Scores on the same samples, smaller is better, about 1 for a good calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scores {
    /// Of the new calibration.
    pub candidate: f32,
    /// Of the one in use.
    pub incumbent: f32,
}

/// Scores two calibrations on the same samples; by the total field alone where no attitude is known. Without samples
/// both scores are not a number, so neither is better.
#[must_use]
pub fn verify(
    held_back: Samples<'_>,
    knows_attitude: bool,
    candidate: &Calibration,
    incumbent: &Calibration,
) -> Scores {
    let score = |calibration| score(held_back, knows_attitude, calibration);
    Scores { candidate: score(candidate), incumbent: score(incumbent) }
}

/// RMS of the scaled deviations of total field and inclination from their means.
fn score(samples: Samples<'_>, knows_attitude: bool, calibration: &Calibration) -> f32 {
    let dip_weight = if knows_attitude { 1.0 / DIP_SCALE_RAD } else { 0.0 };
    let observe = |s: &Sample| {
        let level = s.attitude.level(calibration.apply(s.field));
        [level.total_ut(), level.inclination_rad()]
    };
    let observations = || samples.iter().map(observe);
    let number = observations().count() as f32;
    let [total_ut, dip_rad] = [0, 1].map(|i| observations().map(|o| o[i]).sum::<f32>() / number);
    let squares: f32 = observations()
        .map(|[total, dip]| [(total / total_ut - 1.0) / NORM_SCALE, (dip - dip_rad) * dip_weight])
        .map(|[norm, dip]| norm * norm + dip * dip)
        .sum();
    libm::sqrtf(squares / (2.0 * number))
}
