//! Starting points of the refinement: closed-form results, the sphere fit, and the fit to the vertical.

use nalgebra::{Matrix3, SVector, Vector3, Vector4};

use crate::calibration::linear_algebra::{LeastSquares, inverse};
use crate::calibration::types::samples::{Sample, Samples};
use crate::frames::Field;
use crate::trig;
use crate::trig::sqrt;

/// Affine response of the sensor to the Earth's field, mount axes.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct SensorResponse {
    /// `A` times H0, microtesla: response to a field of H0 in body axes.
    pub response_ut: Matrix3<f32>,
    /// Hard iron, microtesla.
    pub hard_iron_ut: Vector3<f32>,
    /// `D`: tangent of the inclination.
    pub tan_inclination: f32,
}

/// Starting point of a refinement.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct StartingPoint {
    /// Unit of field, microtesla.
    pub field_unit_ut: f32,
    pub w: Matrix3<f32>,
    pub hard_iron: Vector3<f32>,
    pub inclination_rad: f32,
}

impl SensorResponse {
    /// Starting point in the unit of field for which `W` has determinant one. `None` if `A` is singular or mirrored:
    /// chip axes are right-handed.
    pub fn starting_point(&self) -> Option<StartingPoint> {
        let total = sqrt(1.0 + self.tan_inclination * self.tan_inclination);
        let w = inverse(&self.response_ut)? / total;
        let determinant = w.determinant();
        let field_unit_ut = trig::reciprocal_cbrt(determinant);
        (determinant > 0.0 && field_unit_ut.is_finite() && field_unit_ut > 0.0).then(|| StartingPoint {
            field_unit_ut,
            w: w * field_unit_ut,
            hard_iron: self.hard_iron_ut / field_unit_ut,
            inclination_rad: libm::atan2f(self.tan_inclination, 1.0),
        })
    }
}

/// Weight of the assumption of no hard iron relative to the samples.
const NO_HARD_IRON_WEIGHT: f32 = 1e-4;

/// Centre (chip axes) and radius of the sphere fit to a new sample, if there is one, and all others, microtesla: hard
/// iron and field strength without soft iron. `None` without samples or if not finite.
#[inline(never)]
pub(crate) fn fit_sphere(new_sample: Option<&Sample>, samples: Samples<'_>) -> Option<(Vector3<f32>, f32)> {
    let sample_fields = || new_sample.into_iter().chain(samples.all_samples()).map(|sample| sample.field.ut);
    let (sum, count) = sample_fields().fold((Vector3::zeros(), 0.0), |(sum, count), field| (sum + field, count + 1.0));
    let mean = sum / count;
    // |m|^2 = 2 m . b + (r^2 - |b|^2) is linear in b and the bracket. The mean is subtracted to preserve digits.
    let mut least_squares = LeastSquares::<4, 1>::new();
    let mut mean_square_distance = 0.0;
    sample_fields().for_each(|field| {
        let p = field - mean;
        least_squares.add_weighted_row(&(p * 2.0).push(1.0), [p.norm_squared()], 1.0);
        mean_square_distance += p.norm_squared();
    });
    // Ridge towards no hard iron: a single turn leaves the centre undetermined along its axis.
    for i in 0..3 {
        least_squares.add_weighted_row(&Vector4::ith(i, 1.0), [-mean[i]], NO_HARD_IRON_WEIGHT * mean_square_distance);
    }
    let solution = least_squares.solve()?;
    let centre = solution.fixed_rows::<3>(0).into_owned();
    Some((mean + centre, sqrt((solution[3] + centre.norm_squared()).max(1.0))))
}

/// Starting point from the sphere fit: hard iron only. Fields are rotated by `rotation` first.
pub(in crate::calibration) fn sphere_start(samples: Samples<'_>, rotation: &Matrix3<f32>) -> Option<StartingPoint> {
    let (centre_ut, field_unit_ut) = fit_sphere(None, samples)?;
    let b_ut = rotation * centre_ut;
    let sin_inclination = samples
        .all_samples()
        .map(|sample| {
            let level = sample.attitude.to_level_frame(Field::new(rotation * sample.field.ut - b_ut));
            level.ut.z / level.total_ut().max(1e-6)
        })
        .sum::<f32>()
        / samples.all_samples().count() as f32;
    let inclination_rad = trig::asin(sin_inclination);
    Some(StartingPoint { field_unit_ut, w: Matrix3::identity(), hard_iron: b_ut / field_unit_ut, inclination_rad })
}

/// Starting point from the vertical component, for samples tilted in several directions; needs no heading. With the
/// down vector `u` in body axes, `u . (W m - c) = sin I` in units of field is linear in `W / sin I` and `c / sin I`;
/// the mean norm gives the field strength. Attitude errors bias `W` low along the level axes. `None` if undetermined,
/// as near the magnetic equator. Fields are rotated by `rotation` first.
pub(in crate::calibration) fn vertical_component_start(
    samples: Samples<'_>,
    rotation: &Matrix3<f32>,
) -> Option<StartingPoint> {
    let mount_fields = || samples.all_samples().map(|sample| (rotation * sample.field.ut, sample));
    let sample_count = mount_fields().count() as f32;
    let mean = mount_fields().map(|(f, _)| f).sum::<Vector3<f32>>() / sample_count;
    let mean_square_distance = mount_fields().map(|(f, _)| (f - mean).norm_squared()).sum::<f32>() / sample_count;
    let scale_ut = sqrt(mean_square_distance);
    let rows = mount_fields().map(|(field, sample)| {
        let down = sample.attitude.to_body_frame(Field::new(Vector3::z())).ut;
        let row = down * ((field - mean) / scale_ut).push(1.0).transpose();
        SVector::<f32, 12>::from_iterator(row.iter().copied())
    });
    let solution = LeastSquares::<12, 1>::from_rows(rows, [1.0]).solve()?;
    let (matrix, offset) = (solution.fixed_rows::<9>(0), solution.fixed_rows::<3>(9).into_owned());
    let per_ut = Matrix3::from_iterator(matrix.iter().copied()) / scale_ut;
    let b_ut = mean - inverse(&per_ut)? * offset;
    let total = sqrt(mount_fields().map(|(f, _)| (per_ut * (f - b_ut)).norm_squared()).sum::<f32>() / sample_count);
    // Chip axes are right-handed, so a mirrored solution belongs to a field that points up.
    let sign = if per_ut.determinant() < 0.0 { -1.0 } else { 1.0 };
    let w = per_ut * (sign / total);
    let field_unit_ut = trig::reciprocal_cbrt(w.determinant());
    let is_valid = field_unit_ut.is_finite() && field_unit_ut > 0.0 && b_ut.iter().all(|ut| ut.is_finite());
    is_valid.then(|| StartingPoint {
        field_unit_ut,
        w: w * field_unit_ut,
        hard_iron: b_ut / field_unit_ut,
        inclination_rad: sign * trig::asin(1.0 / total),
    })
}

pub(in crate::calibration) fn inclination_tangent(inclination_rad: f32) -> f32 {
    let (sin, cos) = trig::sin_cos(inclination_rad);
    sin / cos
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::HeadingMark;
    use crate::calibration::tests::synthetic::{
        Airframe, YAW_90, exact_circle, level_samples, marked_samples, turn_samples,
    };

    fn test_response() -> SensorResponse {
        SensorResponse {
            response_ut: Matrix3::new(27.0, 2.0, -1.0, 0.5, 22.0, 3.0, -2.0, 1.0, 30.0),
            hard_iron_ut: Vector3::new(12.0, -7.0, 40.0),
            tan_inclination: 1.4,
        }
    }

    #[test]
    fn mirrored_or_singular_responses_are_rejected() {
        let good = test_response();
        for (name, bad) in [
            ("mirrored", SensorResponse { response_ut: -good.response_ut, ..good }),
            ("flat", SensorResponse { response_ut: Matrix3::from_diagonal(&Vector3::new(20.0, 20.0, 0.0)), ..good }),
            ("no response", SensorResponse { response_ut: Matrix3::repeat(f32::NAN), ..good }),
            ("no inclination", SensorResponse { tan_inclination: f32::NAN, ..good }),
        ] {
            assert!(bad.starting_point().is_none(), "{name}");
        }
    }

    /// The ridge biases the centre by 1e-4 of the hard iron: 0.01 uT.
    #[test]
    fn a_sphere_finds_hard_iron_and_inclination() {
        let airframe = Airframe::with_hard_iron([30.0, -60.0, 45.0]);
        let [left, right] = [-25.0, 25.0].map(|bank_deg| exact_circle(&airframe, bank_deg, 24));
        let start = sphere_start(turn_samples(&left, &right), &Matrix3::identity()).unwrap();
        let hard_iron_ut = |start: &StartingPoint| start.hard_iron * start.field_unit_ut;
        assert!((start.field_unit_ut - 50.0).abs() < 0.1, "{}", start.field_unit_ut);
        assert!((hard_iron_ut(&start) - airframe.b_ut).norm() < 0.2, "{}", hard_iron_ut(&start));
        assert!((start.inclination_rad - airframe.inclination_rad).abs() < 0.01, "{}", start.inclination_rad);
        assert_eq!(start.w, Matrix3::identity());

        let mark = |&sample| HeadingMark { sample, heading_rad: 0.0 };
        let marks: Vec<HeadingMark> = left.iter().chain(&right).map(mark).collect();
        let turned = sphere_start(marked_samples(&marks), &YAW_90).unwrap();
        assert!((hard_iron_ut(&turned) - YAW_90 * airframe.b_ut).norm() < 0.2, "{}", hard_iron_ut(&turned));
    }

    /// The ridge selects the sphere with the least hard iron through the circle.
    #[test]
    fn a_single_circle_gives_no_hard_iron_along_its_axis() {
        let airframe = Airframe::with_hard_iron([5.0, -3.0, 0.0]);
        let level = level_samples(&exact_circle(&airframe, 0.0, 24));
        let start = sphere_start(level, &Matrix3::identity()).unwrap();
        let b_ut = start.hard_iron * start.field_unit_ut;
        assert!((b_ut - airframe.b_ut).norm() < 2.0, "{b_ut}");
        assert!((start.field_unit_ut - 50.0).abs() < 1.0, "{}", start.field_unit_ut);
    }
}
