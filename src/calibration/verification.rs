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
        let level = calibration.level(s);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Mark, Orientation, Rates};
    use crate::frames::{Attitude, Field, Level};
    use crate::time::WrappingMillis;

    const HALF: f32 = core::f32::consts::FRAC_1_SQRT_2;

    /// Level samples round the compass, whose total field and dip are one scale above and below their means in turn.
    fn samples(norm_scales: f32, dip_scales: f32) -> Vec<Sample> {
        (0..16_u8)
            .map(|i| {
                let (norm, dip) = (if i % 2 == 0 { 1.0 } else { -1.0 }, if i % 4 < 2 { 1.0 } else { -1.0 });
                let total_ut = 50.0 * (1.0 + norm * norm_scales * 0.004);
                let inclination_rad = 1.0 + dip * dip_scales * 0.005;
                let field = Field::<Level>::earth(total_ut, inclination_rad, f32::from(i));
                Sample {
                    field: Field::new(field.ut),
                    attitude: Attitude::default(),
                    time: WrappingMillis::default(),
                    rates: Rates::NONE,
                }
            })
            .collect()
    }

    fn scores(samples: &[Sample], knows_attitude: bool) -> Scores {
        let none = Calibration::uncalibrated(Orientation::NONE);
        // Twice the field in all axes: the scale of a calibration is no error of it.
        let doubled = Calibration { w: none.w.map(|row| row.map(|w| 2.0 * w)), ..none };
        let scores = verify(Samples { level: samples, ..Samples::default() }, knows_attitude, &none, &doubled);
        // f32 has 7 digits for a difference of 0.4 %: 1e-4 of a score.
        assert!((scores.candidate - scores.incumbent).abs() < 1e-3, "{scores:?}");
        scores
    }

    /// Each of the two kinds counts half: 0.4 % of total field as much as 0.005 radians of dip.
    #[test]
    fn a_scale_of_scatter_in_both_is_a_score_of_one() {
        for (norm, dip, expected) in
            [(0.0, 0.0, 0.0), (1.0, 0.0, HALF), (0.0, 1.0, HALF), (1.0, 1.0, 1.0), (3.0, 4.0, 5.0 * HALF)]
        {
            let found = scores(&samples(norm, dip), true).candidate;
            assert!((found - expected).abs() < 2e-3, "{norm} {dip}: {found}");
        }
    }

    #[test]
    fn without_attitude_only_the_total_field_counts() {
        for (norm, dip, expected) in [(0.0, 3.0, 0.0), (1.0, 0.0, HALF), (1.0, 3.0, HALF)] {
            let found = scores(&samples(norm, dip), false).candidate;
            assert!((found - expected).abs() < 2e-3, "{norm} {dip}: {found}");
        }
    }

    #[test]
    fn each_calibration_has_its_own_score() {
        let clean = samples(0.0, 0.0);
        let held_back = Samples { right: &clean, ..Samples::default() };
        let none = Calibration::uncalibrated(Orientation::NONE);
        let moved = Calibration { b_ut: [3.0, 0.0, 0.0], ..none };
        let Scores { candidate, incumbent } = verify(held_back, true, &moved, &none);
        // 3 uT of 50 are 6 %, of which the horizontal half shows: many times the scale.
        assert!(candidate > 3.0 && incumbent < 1e-2, "{candidate} {incumbent}");
        let Scores { candidate, incumbent } = verify(held_back, true, &none, &moved);
        assert!(incumbent > 3.0 && candidate < 1e-2, "{candidate} {incumbent}");
    }

    /// Neither is better, whichever way it is asked. The marks of a swing are not held back.
    #[test]
    fn without_samples_nothing_is_better() {
        let none = Calibration::uncalibrated(Orientation::NONE);
        let marks = [Mark { sample: samples(0.0, 0.0)[0], heading_rad: 0.0 }; 4];
        for nothing in [Samples::default(), Samples { marks: &marks, ..Samples::default() }] {
            let scores = verify(nothing, true, &none, &none);
            assert!(scores.candidate.is_nan() && scores.incumbent.is_nan(), "{scores:?}");
        }
    }

    /// The attitude is taken out of each field before its dip is looked at.
    #[test]
    fn an_aircraft_that_leans_measures_the_same_dip() {
        let leaning: Vec<Sample> = samples(0.0, 0.0)
            .into_iter()
            .zip((0..).map(|i: u8| Attitude::from_deg(f32::from(i) * 4.0 - 30.0, f32::from(i % 3) * 5.0)))
            .map(|(s, attitude)| Sample { field: Field::new(attitude.body(Field::new(s.field.ut)).ut), attitude, ..s })
            .collect();
        assert!(scores(&leaning, true).candidate < 1e-2);
    }
}
