//! A module that turns about the body's z axis in its mount, as opposed to iron that changes.
//!
//! Sensor and calibration turn together within the field, so that the measured field keeps its magnitude and its
//! component along the axis: with `d` the difference between the measured field `m` and the predicted one, `d . (2 m -
//! d) = 0` and `d . axis = 0`. A change of hard iron has that direction by chance only.

use nalgebra::Vector3;

use super::measurement_model::mount_axis;
use crate::calibration::{Calibration, inverse};
use crate::trig::VectorLength as _;

/// Largest cosine between the difference and the mean of both fields, or the axis: at most 9 deg from a right angle.
const MAX_COSINE_TO_FIELD_AND_AXIS: f32 = 0.15;

/// Tolerance of the difference along the mean field or the axis, relative to the field strength: noise of sensor and
/// attitude.
const FIELD_TOLERANCE: f32 = 0.006;

/// Largest field difference, relative to the field strength, that needs no turn to explain it: 1 uT of 50.
const MAX_UNCHANGED_FIELD_DIFFERENCE: f32 = 0.02;

/// The turn of the module that explains a field, clockwise from above, radians; `None` if none does.
///
/// `field_difference`: measured field after correction as calibrated, less the predicted one, in units of the field
/// strength; `normalised_field`: measured field less hard iron, sensor axes, same units.
pub(super) fn mount_turn_rad(
    calibration: &Calibration,
    field_difference: &Vector3<f32>,
    normalised_field: &Vector3<f32>,
) -> Option<f32> {
    if field_difference.vector_length() < MAX_UNCHANGED_FIELD_DIFFERENCE {
        return Some(0.0);
    }
    let field_difference = inverse(&calibration.w_matrix())? * field_difference;
    let mean = normalised_field + calibration.b_vector_ut() / calibration.total_ut - field_difference * 0.5;
    let axis = mount_axis(calibration);
    let is_across = |direction: &Vector3<f32>| {
        let tolerance = MAX_COSINE_TO_FIELD_AND_AXIS * field_difference.vector_length() + FIELD_TOLERANCE;
        field_difference.dot(direction).abs() <= tolerance * direction.vector_length()
    };
    // In sensor axes the field turns opposite to the module: `field_difference` is the chord of its arc about the
    // axis. NaN if the field is along the axis.
    let across = axis.cross(&mean);
    let half_tangent = -0.5 * field_difference.dot(&across) / across.norm_squared();
    let turn_rad = 2.0 * libm::atanf(half_tangent);
    (turn_rad.is_finite() && [mean, axis].iter().all(is_across)).then_some(turn_rad)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Rotation3};

    use super::*;
    use crate::calibration::Orientation;

    /// Soft iron of 10 %, hard iron of 20 uT, a mounting of 30 deg.
    fn calibration() -> Calibration {
        let soft_iron = Matrix3::new(1.05, 0.03, 0.0, 0.03, 0.95, 0.02, 0.0, 0.02, 1.0);
        let a = Rotation3::from_euler_angles(0.1, -0.1, 0.5) * soft_iron;
        let w = a.try_inverse().unwrap();
        Calibration {
            w: core::array::from_fn(|row| core::array::from_fn(|column| w[(row, column)])),
            b_ut: [15.0, -10.0, 8.0],
            total_ut: 50.0,
            ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION)
        }
    }

    fn explained_turn_deg(module_turn_deg: f32, iron_ut: [f32; 3]) -> Option<f32> {
        let calibration = calibration();
        let (w, b_ut) = (calibration.w_matrix(), calibration.b_vector_ut());
        let earth = Vector3::new(0.3, -0.25, 0.9);
        let field_ut = w.try_inverse().unwrap() * earth * 50.0 + b_ut;
        let axis = Rotation3::from_euler_angles(0.1, -0.1, 0.5) * Vector3::z_axis();
        let turned_ut =
            Rotation3::from_axis_angle(&axis, -module_turn_deg.to_radians()) * field_ut + Vector3::from(iron_ut);
        let position = (turned_ut - b_ut) / 50.0;
        mount_turn_rad(&calibration, &(w * position - earth), &position)
    }

    /// Soft iron of second order is neglected in the axis.
    #[test]
    fn a_turn_explains_the_field_of_a_turned_module() {
        for turn_deg in [5.0_f32, -10.0, 20.0, -20.0] {
            let found = explained_turn_deg(turn_deg, [0.0; 3]).unwrap();
            assert!((found.to_degrees() / turn_deg - 1.0).abs() < 0.01, "{turn_deg}: {found}");
        }
        assert_eq!(explained_turn_deg(0.0, [0.5, 0.5, 0.0]), Some(0.0));
    }

    /// 0.5 uT of noise across a difference of 2 uT.
    #[test]
    fn a_small_turn_is_found_despite_noise() {
        for noise_ut in [[0.0, 0.0, 0.5], [0.0, 0.0, -0.5]] {
            let found = explained_turn_deg(5.0, noise_ut);
            assert!(found.is_some_and(|rad| (rad.to_degrees() - 5.0).abs() < 1.0), "{found:?}");
        }
    }

    #[test]
    fn changes_of_strength_or_along_the_axis_are_no_turn() {
        for iron_ut in [[0.0, 0.0, 6.0], [0.0, 0.0, -6.0], [4.0, -4.0, 3.0], [5.0, 0.0, 0.0]] {
            assert_eq!(explained_turn_deg(0.0, iron_ut), None, "{iron_ut:?}");
        }
    }
}
