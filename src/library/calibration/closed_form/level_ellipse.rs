//! Level flight: six coefficients from one ellipse, for vehicles that do not bank.
//!
//! The horizontal field at headings psi is a circle, `(H0 cos psi, -H0 sin psi)`, and its measurement an ellipse (Liu
//! 2007 eq. 4), which has five coefficients (eq. 6). The sixth, the phase, is zero by the *ellipse hypothesis*:
//! `A = K P` with `K = diag(Kx, Ky)`, `P = [cos p, sin p; sin p, cos p]` (eq. 5). Neglected mounting error about the
//! vertical and asymmetric soft iron cause a constant heading error; `set align` removes it.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::conic::fit_conic;
use super::starting_point::SensorResponse;
use crate::calibration::linear_algebra::LeastSquares;
use crate::calibration::types::quality::SolveError;
use crate::calibration::types::samples::{CollectionPart, Samples};
use crate::trig;
use crate::trig::sqrt;

/// Minimum number of samples: a conic has five coefficients, plus a margin for noise.
const MIN_SAMPLES: usize = 8;

/// Minimum radius of the circle of headings, microtesla: half the horizontal field at 75 deg of inclination. The noise
/// of a constant heading gives a smaller one.
const MIN_RADIUS_UT: f32 = 6.0;

/// Minimum number of headings, 30 deg apart (Liu 2007 section 1).
const MIN_HEADINGS: u8 = 5;

/// Affine map of the ellipse hypothesis (Liu 2007 eq. 5).
#[derive(Clone, Debug)]
pub(in crate::calibration) struct EllipseMap {
    /// `K P` times H0: maps (cos psi, -sin psi) to the measurement minus `centre_ut`.
    pub map_ut: Matrix2<f32>,
    pub centre_ut: Vector2<f32>,
}

impl EllipseMap {
    /// Fits the conic and derives the map. With `S` the inverse of the conic's form, `S = K P P^T K`: its diagonal is
    /// `K^2`, its off-diagonal element over `Kx Ky` is `sin 2p`. `None` when the points are not on an ellipse.
    pub fn fit_ellipse_map(points_ut: impl Iterator<Item = Vector2<f32>> + Clone) -> Option<Self> {
        let point_count = points_ut.clone().count() as f32;
        let mean = points_ut.clone().sum::<Vector2<f32>>() / point_count;
        let scale = sqrt(points_ut.clone().map(|p| (p - mean).norm_squared()).sum::<f32>() / point_count);
        // Scaled to about 1; otherwise the equations would mix magnitudes of 1 and uT^4.
        let (centre, quadratic_form) = fit_conic(points_ut.map(|p| (p - mean) / scale))?;
        let s = quadratic_form.try_inverse()?;
        let (kx, ky) = (sqrt(s[(0, 0)]), sqrt(s[(1, 1)]));
        let p = trig::asin(s[(0, 1)] / (kx * ky)) / 2.0;
        let (sin, cos) = trig::sin_cos(p);
        Some(Self {
            map_ut: Matrix2::new(kx * cos, kx * sin, ky * sin, ky * cos) * scale,
            centre_ut: mean + centre * scale,
        })
    }

    /// Number of headings covered, 30 deg apart: the larger of the number of runs of 15 deg sectors, so that a leg
    /// across a border counts once, and of half the covered sectors, so that a circle counts twelve.
    fn count_headings(&self, points_ut: impl Iterator<Item = Vector2<f32>>) -> u8 {
        // The map of an ellipse is regular; a singular one counts no headings.
        let circle_from_field = self.map_ut.try_inverse().unwrap_or_else(Matrix2::zeros);
        let sectors = points_ut.fold(0_u32, |sectors, p| {
            let circle = circle_from_field * (p - self.centre_ut);
            let turns = libm::atan2f(-circle.y, circle.x) / core::f32::consts::TAU + 0.5;
            // The cast saturates and maps NaN to 0; the remainder keeps the shift below 24.
            sectors | 1 << ((turns * 24.0) as u32 % 24)
        });
        let shifted = sectors << 1 | sectors >> 23;
        let legs = (sectors & !shifted).count_ones();
        legs.max(sectors.count_ones() / 2) as u8
    }
}

/// Solves samples of level flight; fields are rotated by `rotation` first.
///
/// Coefficients without effect in level flight are set: response of other axes to the vertical field 0, vertical hard
/// iron 0, vertical scale equal to the mean horizontal one.
///
/// # Errors
///
/// [`SolveError::TooFewSamples`], [`SolveError::TooFewHeadings`], and [`SolveError::NotAnEllipse`] without a circle of
/// a horizontal field.
pub(in crate::calibration) fn solve_level_ellipse(
    samples: Samples<'_>,
    rotation: &Matrix3<f32>,
) -> Result<SensorResponse, SolveError> {
    let mount_fields = samples.all_samples().map(|sample| rotation * sample.field.ut);
    SolveError::require_samples(CollectionPart::LEVEL, mount_fields.clone().count(), MIN_SAMPLES)?;
    let ellipse_map = EllipseMap::fit_ellipse_map(mount_fields.clone().map(|f| f.xy()))
        .ok_or(SolveError::NotAnEllipse(CollectionPart::LEVEL))?;
    let vertical_ut = sqrt(ellipse_map.map_ut.determinant().abs());
    if vertical_ut.is_nan() || vertical_ut < MIN_RADIUS_UT {
        return Err(SolveError::NotAnEllipse(CollectionPart::LEVEL));
    }
    let headings = ellipse_map.count_headings(mount_fields.clone().map(|f| f.xy()));
    if headings < MIN_HEADINGS {
        return Err(SolveError::TooFewHeadings { have: headings, need: MIN_HEADINGS });
    }
    let [x, y, mean_ut] = fit_vertical_axis(&ellipse_map, mount_fields)
        .filter(|responses_ut| responses_ut.iter().all(|ut| ut.abs() < 1e3 * vertical_ut))
        .ok_or(SolveError::NotAnEllipse(CollectionPart::LEVEL))?;
    let map = ellipse_map.map_ut;
    #[rustfmt::skip]
    let a_ut = Matrix3::new(
        map[(0, 0)], map[(0, 1)], 0.0,
        map[(1, 0)], map[(1, 1)], 0.0,
        x,           y,           vertical_ut,
    );
    let b_ut = Vector3::new(ellipse_map.centre_ut.x, ellipse_map.centre_ut.y, 0.0);
    Ok(SensorResponse { response_ut: a_ut, hard_iron_ut: b_ut, tan_inclination: mean_ut / vertical_ut })
}

/// Responses of the vertical axis to the horizontal field, and its mean, microtesla.
fn fit_vertical_axis(ellipse_map: &EllipseMap, fields: impl Iterator<Item = Vector3<f32>>) -> Option<[f32; 3]> {
    let circle_from_field = ellipse_map.map_ut.try_inverse()?;
    let mut least_squares = LeastSquares::<3, 1>::new();
    for field in fields {
        let row = (circle_from_field * (field.xy() - ellipse_map.centre_ut)).push(1.0);
        least_squares.add_weighted_row(&row, [field.z], 1.0);
    }
    least_squares.solve().map(Into::into)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Sample;
    use crate::calibration::tests::synthetic::level_samples;
    use crate::frames::{Field, RollPitch};

    fn test_map_ut() -> Matrix2<f32> {
        let (sin, cos) = 0.1_f32.sin_cos();
        Matrix2::new(30.0 * cos, 30.0 * sin, 20.0 * sin, 20.0 * cos)
    }

    /// Level samples; the vertical axis has 40 uT plus 3 and 1.5 uT of horizontal response.
    fn samples_at(headings_deg: &[f32], scale: f32) -> Vec<Sample> {
        headings_deg
            .iter()
            .map(|heading_deg| {
                let (sin, cos) = heading_deg.to_radians().sin_cos();
                let flat = (test_map_ut() * Vector2::new(cos, -sin) + Vector2::new(12.0, -30.0)) * scale;
                let field = Field::from_ut(flat.x, flat.y, 40.0 + 3.0 * cos - 1.5 * -sin);
                Sample::new(field, RollPitch::default())
            })
            .collect()
    }

    fn evenly_spaced_deg(heading_count: u8) -> Vec<f32> {
        (0..heading_count).map(|i| f32::from(i) * 360.0 / f32::from(heading_count) + 7.0).collect()
    }

    fn solve_level(samples: &[Sample]) -> Result<SensorResponse, SolveError> {
        solve_level_ellipse(level_samples(samples), &Matrix3::identity())
    }

    /// Five headings determine an ellipse; each is a leg of three samples. A circle below 6 uT, a quarter of this one, is
    /// noise of a magnetometer next to the pole.
    #[test]
    fn samples_that_do_not_determine_an_ellipse_are_rejected() {
        let legs = |headings_deg: &[f32]| -> Vec<f32> {
            headings_deg.iter().flat_map(|heading| [-2.0, 0.0, 2.0].map(|offset_deg| heading + offset_deg)).collect()
        };
        let arc: Vec<f32> = (0..60_u8).map(|i| 1.0 + f32::from(i) * 2.0).collect();
        let (five_legs, four_legs) = (legs(&[7.0, 80.0, 150.0, 220.0, 295.0]), legs(&[7.0, 97.0, 187.0, 277.0]));
        let too_few_headings = Err(SolveError::TooFewHeadings { have: 4, need: 5 });
        let no_ellipse = Err(SolveError::NotAnEllipse(CollectionPart::LEVEL));
        let too_few_samples = Err(SolveError::TooFewSamples { part: CollectionPart::LEVEL, have: 7, need: 8 });
        for (name, headings_deg, scale, expected) in [
            ("a circle", evenly_spaced_deg(24), 1.0, Ok(())),
            ("eight samples", evenly_spaced_deg(8), 1.0, Ok(())),
            ("seven samples", evenly_spaced_deg(7), 1.0, too_few_samples),
            ("a small circle", evenly_spaced_deg(24), 0.4, Ok(())),
            ("a circle of noise", evenly_spaced_deg(24), 0.1, no_ellipse),
            ("one heading", vec![30.0; 24], 1.0, no_ellipse),
            ("five legs", five_legs, 1.0, Ok(())),
            ("four legs", four_legs, 1.0, too_few_headings),
            ("a third of a circle", arc, 1.0, too_few_headings),
        ] {
            assert_eq!(solve_level(&samples_at(&headings_deg, scale)).map(|_| ()), expected, "{name}");
        }
    }

    #[test]
    fn implausible_vertical_axis_is_rejected() {
        let samples_with_z = |z: f32| -> Vec<Sample> {
            let shifted =
                |sample: Sample| Sample { field: Field::from_ut(sample.field.ut.x, sample.field.ut.y, z), ..sample };
            samples_at(&evenly_spaced_deg(24), 1.0).into_iter().map(shifted).collect()
        };
        assert!(solve_level(&samples_with_z(2_000.0)).is_ok());
        assert_eq!(
            solve_level(&samples_with_z(50_000.0)).map(|_| ()),
            Err(SolveError::NotAnEllipse(CollectionPart::LEVEL))
        );
    }
}
