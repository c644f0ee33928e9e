//! What the closed forms give, and the sphere: where a refinement begins.

use nalgebra::{Matrix3, SVector, Vector3, Vector4};

use super::least_squares::LeastSquares;
use super::{Samples, inverse};
use crate::frames::Field;
use crate::trig;

/// The response of the sensor in mount axes, unit of field microtesla: what each closed form gives.
#[derive(Clone, Debug)]
pub(super) struct Response {
    /// Response to a field of H0 in body axes: `A` times H0, microtesla.
    pub a_ut: Matrix3<f32>,
    /// Hard iron, microtesla.
    pub b_ut: Vector3<f32>,
    /// `D`, the tangent of the inclination.
    pub tan_inclination: f32,
}

/// Where a refinement begins, in a unit of field of its own.
#[derive(Clone, Debug)]
pub(super) struct Start {
    /// The unit, microtesla.
    pub unit_ut: f32,
    pub w: Matrix3<f32>,
    pub b: Vector3<f32>,
    pub inclination_rad: f32,
}

impl Response {
    /// In the unit of field in which `W` has a determinant of one. `None` if `A` has no inverse or mirrors: a chip's
    /// axes are right-handed.
    pub fn start(&self) -> Option<Start> {
        // Total field in units of H0.
        let total = libm::sqrtf(1.0 + self.tan_inclination * self.tan_inclination);
        let w = inverse(&self.a_ut)? / total;
        let determinant = w.determinant();
        let unit_ut = trig::reciprocal_cbrt(determinant);
        (determinant > 0.0 && unit_ut.is_finite() && unit_ut > 0.0).then(|| Start {
            unit_ut,
            w: w * unit_ut,
            b: self.b_ut / unit_ut,
            inclination_rad: libm::atan2f(self.tan_inclination, 1.0),
        })
    }
}

/// Weight of the assumption that there is no hard iron, beside that of the samples.
const SPHERE_RIDGE: f32 = 1e-4;

/// The centre of a sphere through all samples, in the chip's axes, and its radius, both in microtesla: the hard iron and
/// the total field where there is no soft iron. `None` without samples, or if one is no number.
#[inline(never)]
pub(crate) fn centre(samples: Samples<'_>) -> Option<(Vector3<f32>, f32)> {
    let fields = || samples.all().map(|s| s.field.ut);
    let mean = fields().sum::<Vector3<f32>>() / fields().count() as f32;
    // |m|^2 = 2 m . b + (r^2 - |b|^2), linear in b and the bracket; fields from their mean, for the digits.
    let mut system = LeastSquares::<4, 1>::new();
    let mut spread = 0.0;
    for field in fields() {
        let p = field - mean;
        system.add(&(p * 2.0).push(1.0), [p.norm_squared()], 1.0);
        spread += p.norm_squared();
    }
    // Weakly, no hard iron: it decides where a single turn leaves the centre open along its axis.
    for i in 0..3 {
        system.add(&Vector4::ith(i, 1.0), [-mean[i]], SPHERE_RIDGE * spread);
    }
    let solution = system.solve()?;
    let centre = solution.fixed_rows::<3>(0).into_owned();
    Some((mean + centre, libm::sqrtf((solution[3] + centre.norm_squared()).max(1.0))))
}

/// A sphere through all samples: hard iron only. The fields are rotated by `rotation`
/// first.
pub(super) fn sphere(samples: Samples<'_>, rotation: &Matrix3<f32>) -> Option<Start> {
    let (centre_ut, unit_ut) = centre(samples)?;
    let b_ut = rotation * centre_ut;
    let sin_dip = samples
        .all()
        .map(|s| {
            let level = s.attitude.level(Field::new(rotation * s.field.ut - b_ut));
            level.ut.z / level.total_ut().max(1e-6)
        })
        .sum::<f32>()
        / samples.all().count() as f32;
    let inclination_rad = trig::asin(sin_dip);
    Some(Start { unit_ut, w: Matrix3::identity(), b: b_ut / unit_ut, inclination_rad })
}

/// Of samples that are tilted more than one way, the coefficients from the vertical alone: with the down vector `u` in
/// body axes, which the attitude tells, `u . (W m - c) = sin I` in units of the field, and this is linear in `W / sin I`
/// and `c / sin I`. Neither heading nor turns are needed. The field's strength follows from what it is in the mean.
/// Errors of the attitude make its tilt look larger than it is, and `W` smaller along the level axes: a start. `None` where
/// the samples leave it open, as they do near the magnetic equator. The fields are rotated by `rotation` first.
pub(super) fn tilted(samples: Samples<'_>, rotation: &Matrix3<f32>) -> Option<Start> {
    let fields = || samples.all().map(|s| (rotation * s.field.ut, s));
    let number = fields().count() as f32;
    let mean = fields().map(|(f, _)| f).sum::<Vector3<f32>>() / number;
    let spread = fields().map(|(f, _)| (f - mean).norm_squared()).sum::<f32>() / number;
    let scale_ut = libm::sqrtf(spread);
    let rows = fields().map(|(field, s)| {
        let down = s.attitude.body(Field::new(Vector3::z())).ut;
        let row = down * ((field - mean) / scale_ut).push(1.0).transpose();
        SVector::<f32, 12>::from_iterator(row.iter().copied())
    });
    let solution = LeastSquares::<12, 1>::of_rows(rows, [1.0]).solve()?;
    // Column by column, as they were taken.
    let (matrix, offset) = (solution.fixed_rows::<9>(0), solution.fixed_rows::<3>(9).into_owned());
    let per_ut = Matrix3::from_iterator(matrix.iter().copied()) / scale_ut;
    let b_ut = mean - inverse(&per_ut)? * offset;
    let total = libm::sqrtf(fields().map(|(f, _)| (per_ut * (f - b_ut)).norm_squared()).sum::<f32>() / number);
    // A chip's axes are right-handed: what mirrors is of a field that points up.
    let sign = if per_ut.determinant() < 0.0 { -1.0 } else { 1.0 };
    let w = per_ut * (sign / total);
    let unit_ut = trig::reciprocal_cbrt(w.determinant());
    let is_one = unit_ut.is_finite() && unit_ut > 0.0 && b_ut.iter().all(|ut| ut.is_finite());
    is_one.then(|| Start {
        unit_ut,
        w: w * unit_ut,
        b: b_ut / unit_ut,
        inclination_rad: sign * trig::asin(1.0 / total),
    })
}

/// Tangent of an inclination in radians.
pub(super) fn tangent(inclination_rad: f32) -> f32 {
    let (sin, cos) = trig::sin_cos(inclination_rad);
    sin / cos
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use super::*;
    use crate::calibration::{Mark, Rates, Sample};
    use crate::frames::{Attitude, Level};
    use crate::time::WrappingMillis;

    fn response() -> Response {
        Response {
            a_ut: Matrix3::new(27.0, 2.0, -1.0, 0.5, 22.0, 3.0, -2.0, 1.0, 30.0),
            b_ut: Vector3::new(12.0, -7.0, 40.0),
            tan_inclination: 1.4,
        }
    }

    /// What the sensor would measure at any attitude is, corrected, a field of one unit.
    #[test]
    fn a_start_corrects_to_the_unit_of_field() {
        let response = response();
        let start = response.start().unwrap();
        assert!((start.w.determinant() - 1.0).abs() < 1e-5);
        assert!((start.inclination_rad - 1.4_f32.atan()).abs() < 1e-6);
        let total = (1.0_f32 + 1.4 * 1.4).sqrt();
        for direction in [Vector3::x(), Vector3::y(), -Vector3::z(), Vector3::new(0.6, 0.0, 0.8)] {
            let measured_ut = response.a_ut * direction * total + response.b_ut;
            let corrected = start.w * (measured_ut / start.unit_ut - start.b);
            assert!((corrected - direction).norm() < 1e-5, "{corrected} {direction}");
        }
    }

    #[test]
    fn what_mirrors_or_flattens_is_no_start() {
        let mirrored = Response { a_ut: -response().a_ut, ..response() };
        assert!(mirrored.start().is_none());
        let flat = Response { a_ut: Matrix3::from_diagonal(&Vector3::new(20.0, 20.0, 0.0)), ..response() };
        assert!(flat.start().is_none());
        assert!(Response { tan_inclination: f32::NAN, ..response() }.start().is_none());
        assert!(Response { a_ut: Matrix3::repeat(f32::NAN), ..response() }.start().is_none());
    }

    /// Circles at these banks, of an aircraft with hard iron only.
    fn circles(banks_deg: &[f32], b_ut: Vector3<f32>) -> Vec<Sample> {
        let fly = |&bank_deg: &f32| {
            let attitude = Attitude::from_deg(bank_deg, 2.0);
            (0..24_u8).map(move |i| {
                let level = Field::<Level>::earth(50.0, 1.0, f32::from(i) / 24.0 * TAU);
                let field = Field::new(attitude.body(level).ut + b_ut);
                Sample { field, attitude, time: WrappingMillis::default(), rates: Rates::NONE }
            })
        };
        banks_deg.iter().flat_map(fly).collect()
    }

    /// The ridge of 1e-4 pulls the centre by as much of the hard iron: 0.01 uT.
    #[test]
    fn a_sphere_finds_hard_iron_and_inclination() {
        let b_ut = Vector3::new(30.0, -60.0, 45.0);
        let (left, right) = (circles(&[-25.0], b_ut), circles(&[25.0], b_ut));
        let start = sphere(Samples { left: &left, right: &right, ..Samples::default() }, &Matrix3::identity()).unwrap();
        assert!((start.unit_ut - 50.0).abs() < 0.1, "{}", start.unit_ut);
        assert!((start.b * start.unit_ut - b_ut).norm() < 0.2, "{}", start.b * start.unit_ut);
        assert!((start.inclination_rad - 1.0).abs() < 0.01, "{}", start.inclination_rad);
        assert_eq!(start.w, Matrix3::identity());

        let marks: Vec<Mark> =
            circles(&[-25.0, 25.0], b_ut).iter().map(|&sample| Mark { sample, heading_rad: 0.0 }).collect();
        let about_z = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let turned = sphere(Samples { marks: &marks, ..Samples::default() }, &about_z).unwrap();
        let expected_ut = about_z * b_ut;
        assert!((turned.b * turned.unit_ut - expected_ut).norm() < 0.2, "{}", turned.b * turned.unit_ut);
    }

    /// Spheres of any size go through one circle; of those the one with the least hard iron is taken.
    #[test]
    fn a_single_circle_is_taken_for_one_without_hard_iron_along_its_axis() {
        let level = circles(&[0.0], Vector3::new(5.0, -3.0, 0.0));
        let start = sphere(Samples { level: &level, ..Samples::default() }, &Matrix3::identity()).unwrap();
        let b_ut = start.b * start.unit_ut;
        assert!((b_ut - Vector3::new(5.0, -3.0, 0.0)).norm() < 2.0, "{b_ut}");
        assert!((start.unit_ut - 50.0).abs() < 1.0, "{}", start.unit_ut);
    }

    #[test]
    fn a_tangent_is_the_vertical_over_the_horizontal() {
        for (degrees, expected) in [(0.0_f32, 0.0), (45.0, 1.0), (-60.0, -1.732_05), (75.0, 3.732_05)] {
            assert!((tangent(degrees.to_radians()) - expected).abs() < 1e-4, "{degrees}");
        }
    }
}
