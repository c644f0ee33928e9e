//! Comparison of a candidate calibration with the active one on held-back samples.
//!
//! With a correct calibration, field strength and inclination are equal at all attitudes, so the score is their
//! deviation from their means; the means are free because the field varies with the place. Errors that change neither,
//! such as a constant heading offset, are not detected, so a candidate's expected error is also required.

use crate::calibration::types::coefficients::Calibration;
use crate::calibration::types::samples::{Sample, Samples};
use crate::trig::sqrt;

/// Scale of the relative deviation of field strength, that of a good fit.
const FIELD_STRENGTH_SCALE: f32 = 0.004;

/// Scale of the deviation of inclination, radians: 0.3 deg, that of a good fit.
const INCLINATION_SCALE_RAD: f32 = 0.005;

/// Scores on the same samples: smaller is better, about 1 for a good calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldBackScores {
    /// Score of the candidate: RMS of normalised residuals (dimensionless).
    pub candidate_score: f32,
    /// Score of the active calibration, as the candidate's (dimensionless).
    pub active_score: f32,
}

/// Scores two calibrations on held-back samples, by field strength only if the attitude is unknown. Without samples
/// both scores are NaN, so neither is better.
#[must_use]
pub fn score_held_back(
    held_back: Samples<'_>,
    knows_attitude: bool,
    candidate: &Calibration,
    incumbent: &Calibration,
) -> HeldBackScores {
    let score = |calibration| score_calibration(held_back, knows_attitude, calibration);
    HeldBackScores { candidate_score: score(candidate), active_score: score(incumbent) }
}

fn score_calibration(samples: Samples<'_>, knows_attitude: bool, calibration: &Calibration) -> f32 {
    let inclination_weight = if knows_attitude { 1.0 / INCLINATION_SCALE_RAD } else { 0.0 };
    let observation_of = |s: &Sample| {
        let level = calibration.corrected_level_field(s);
        [level.total_ut(), level.inclination_rad()]
    };
    let observations = || samples.iter().map(observation_of);
    let sample_count = observations().count() as f32;
    let [total_ut, inclination_rad] = [0, 1].map(|i| observations().map(|o| o[i]).sum::<f32>() / sample_count);
    let squares: f32 = observations()
        .map(|[total, inclination]| {
            [(total / total_ut - 1.0) / FIELD_STRENGTH_SCALE, (inclination - inclination_rad) * inclination_weight]
        })
        .map(|[norm, inclination]| norm * norm + inclination * inclination)
        .sum();
    sqrt(squares / (2.0 * sample_count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::tests::synthetic::{level_samples, marked_samples, turn_samples};
    use crate::calibration::{HeadingMark, Orientation};
    use crate::frames::{Field, Level, RollPitch};

    const SIN_45_DEG: f32 = core::f32::consts::FRAC_1_SQRT_2;

    fn samples_with_deviations(norm_scales: f32, inclination_scales: f32) -> Vec<Sample> {
        (0..16_u8)
            .map(|i| {
                let (norm, inclination_sign) =
                    (if i % 2 == 0 { 1.0 } else { -1.0 }, if i % 4 < 2 { 1.0 } else { -1.0 });
                let total_ut = 50.0 * (1.0 + norm * norm_scales * 0.004);
                let inclination_rad = 1.0 + inclination_sign * inclination_scales * 0.005;
                let field = Field::<Level>::earth_field(total_ut, inclination_rad, f32::from(i));
                Sample::new(Field::new(field.ut), RollPitch::default())
            })
            .collect()
    }

    fn scores_of(samples: &[Sample], knows_attitude: bool) -> HeldBackScores {
        let none = Calibration::uncalibrated(Orientation::IDENTITY_ROTATION);
        // The scale of `W` must not change the score.
        let doubled = Calibration { w: none.w.map(|row| row.map(|w| 2.0 * w)), ..none };
        let scores = score_held_back(level_samples(samples), knows_attitude, &none, &doubled);
        // Rounding in `f32`, relative to the scale of 0.4 %, is 1e-4 of a score.
        assert!((scores.candidate_score - scores.active_score).abs() < 1e-3, "{scores:?}");
        scores
    }

    #[test]
    fn one_unit_of_norm_and_inclination_residual_scores_one() {
        for (norm, inclination, knows_attitude, expected) in [
            (0.0, 0.0, true, 0.0),
            (1.0, 0.0, true, SIN_45_DEG),
            (0.0, 1.0, true, SIN_45_DEG),
            (1.0, 1.0, true, 1.0),
            (3.0, 4.0, true, 5.0 * SIN_45_DEG),
            // Without attitude only the total field counts.
            (0.0, 3.0, false, 0.0),
            (1.0, 0.0, false, SIN_45_DEG),
            (1.0, 3.0, false, SIN_45_DEG),
        ] {
            let found = scores_of(&samples_with_deviations(norm, inclination), knows_attitude).candidate_score;
            assert!((found - expected).abs() < 2e-3, "{norm} {inclination} {knows_attitude}: {found}");
        }
    }

    /// A hard-iron error of 3 uT is 6 % of 50 uT, many times the scale.
    #[test]
    fn each_calibration_has_its_own_score() {
        let held_back = turn_samples(&[], &samples_with_deviations(0.0, 0.0));
        let none = Calibration::uncalibrated(Orientation::IDENTITY_ROTATION);
        let shifted = Calibration { b_ut: [3.0, 0.0, 0.0], ..none };
        let HeldBackScores { candidate_score, active_score } = score_held_back(held_back, true, &shifted, &none);
        assert!(candidate_score > 3.0 && active_score < 1e-2, "{candidate_score} {active_score}");
    }

    #[test]
    fn without_held_back_samples_both_scores_are_nan() {
        let none = Calibration::uncalibrated(Orientation::IDENTITY_ROTATION);
        let marks = [HeadingMark { sample: samples_with_deviations(0.0, 0.0)[0], heading_rad: 0.0 }; 4];
        for nothing in [Samples::default(), marked_samples(&marks)] {
            let scores = score_held_back(nothing, true, &none, &none);
            assert!(scores.candidate_score.is_nan() && scores.active_score.is_nan(), "{scores:?}");
        }
    }

    #[test]
    fn a_banked_aircraft_measures_the_same_inclination() {
        let leaning: Vec<Sample> = samples_with_deviations(0.0, 0.0)
            .into_iter()
            .zip((0..).map(|i: u8| RollPitch::from_deg(f32::from(i) * 4.0 - 30.0, f32::from(i % 3) * 5.0)))
            .map(|(s, attitude)| Sample {
                field: Field::new(attitude.to_body_frame(Field::new(s.field.ut)).ut),
                attitude,
                ..s
            })
            .collect();
        assert!(scores_of(&leaning, true).candidate_score < 1e-2);
    }
}
