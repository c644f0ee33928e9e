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

/// Scores two calibrations on the same samples. Without samples both scores are not a number, so neither is better.
#[must_use]
pub fn verify(held_back: Samples<'_>, candidate: &Calibration, incumbent: &Calibration) -> Scores {
    Scores { candidate: score(held_back, candidate), incumbent: score(held_back, incumbent) }
}

/// RMS of the scaled deviations of total field and inclination from their means.
fn score(turns: Samples<'_>, calibration: &Calibration) -> f32 {
    let observe = |s: &Sample| {
        let level = s.attitude.level(calibration.apply(s.field));
        [level.total_ut(), level.inclination_rad()]
    };
    let observations = || turns.left.iter().chain(turns.right).map(observe);
    let number = observations().count() as f32;
    let [total_ut, dip_rad] = [0, 1].map(|i| observations().map(|o| o[i]).sum::<f32>() / number);
    let squares: f32 = observations()
        .map(|[total, dip]| [(total / total_ut - 1.0) / NORM_SCALE, (dip - dip_rad) / DIP_SCALE_RAD])
        .map(|[norm, dip]| norm * norm + dip * dip)
        .sum();
    libm::sqrtf(squares / (2.0 * number))
}
