//! A module that turns about the body's z axis in its mount, as opposed to iron that changes.
//!
//! Sensor and calibration turn together within the field of the Earth and of the iron that stays in the airframe, so
//! that this field keeps its magnitude and its component along the axis: with `d` the difference between the measured
//! field `m` and the predicted one, `d . (2 m - d) = 0` and `d . axis = 0`. A change of hard iron has that direction by
//! chance only.

use nalgebra::Vector3;

use super::measurement_model::{MountTurnEffect, mount_axis};
use crate::calibration::{Calibration, inverse};
use crate::trig::VectorLength as _;

/// Largest cosine between the difference and the mean of both fields, or the axis: at most 9 deg from a right angle.
const MAX_COSINE_TO_FIELD_AND_AXIS: f32 = 0.15;

/// Tolerance of the difference along the mean field or the axis, relative to the field strength: noise of sensor and
/// attitude.
const FIELD_TOLERANCE: f32 = 0.006;

/// Largest field difference, relative to the field strength, that needs no turn to explain it: 1 uT of 50.
const MAX_UNCHANGED_FIELD_DIFFERENCE: f32 = 0.02;

/// Shares of the hard iron that may stay in the airframe: iron of the module and its carrier turns with it.
const STAYING_IRON_SHARES: [f32; 3] = [0.0, 0.5, 1.0];

/// A turn of the module that explains a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ExplainedTurn {
    /// Turn with its iron, clockwise from above, radians.
    pub turn_rad: f32,
    /// Change of hard iron by the iron that stays, body axes, relative to the field strength.
    pub hard_iron_change: Vector3<f32>,
}

impl ExplainedTurn {
    /// The module has not turned.
    pub const NO_TURN: Self = Self { turn_rad: 0.0, hard_iron_change: Vector3::new(0.0, 0.0, 0.0) };
}

/// The turn of the module that explains a field best; `None` if none does.
///
/// `field_difference`: measured field after correction as calibrated, less the predicted one, in units of the field
/// strength; `normalised_field`: measured field less hard iron, sensor axes, same units.
pub(super) fn explained_turn(
    calibration: &Calibration,
    field_difference: &Vector3<f32>,
    normalised_field: &Vector3<f32>,
) -> Option<ExplainedTurn> {
    if field_difference.vector_length() < MAX_UNCHANGED_FIELD_DIFFERENCE {
        return Some(ExplainedTurn::NO_TURN);
    }
    let field_difference = inverse(&calibration.w_matrix())? * field_difference;
    let axis = mount_axis(calibration);
    let tolerance = MAX_COSINE_TO_FIELD_AND_AXIS * field_difference.vector_length() + FIELD_TOLERANCE;
    let along = |direction: &Vector3<f32>| field_difference.dot(direction).abs() / direction.vector_length();
    let mut best = (tolerance, None);
    for share in STAYING_IRON_SHARES {
        let staying_iron = calibration.b_vector_ut() * (share / calibration.total_ut);
        let mean = normalised_field + staying_iron - field_difference * 0.5;
        // In sensor axes the field turns opposite to the module: `field_difference` is the chord of its arc about the
        // axis. NaN if the field is along the axis.
        let across = axis.cross(&mean);
        let turn_rad = 2.0 * libm::atanf(-0.5 * field_difference.dot(&across) / across.norm_squared());
        let unexplained = along(&mean).max(along(&axis));
        if turn_rad.is_finite() && unexplained <= best.0 {
            let [change, _] = MountTurnEffect::new(calibration, &-staying_iron).field_change_and_derivative(turn_rad);
            best = (unexplained, Some(ExplainedTurn { turn_rad, hard_iron_change: change }));
        }
    }
    best.1
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

    /// The explanation of a field that a module measures which has turned, with this share of the iron staying behind and
    /// iron added.
    fn explanation(module_turn_deg: f32, staying_share: f32, added_ut: [f32; 3]) -> Option<ExplainedTurn> {
        let calibration = calibration();
        let (w, b_ut) = (calibration.w_matrix(), calibration.b_vector_ut());
        let earth = Vector3::new(0.3, -0.25, 0.9);
        let staying_ut = w.try_inverse().unwrap() * earth * 50.0 + b_ut * staying_share;
        let axis = Rotation3::from_euler_angles(0.1, -0.1, 0.5) * Vector3::z_axis();
        let turned_ut = Rotation3::from_axis_angle(&axis, -module_turn_deg.to_radians()) * staying_ut
            + b_ut * (1.0 - staying_share)
            + Vector3::from(added_ut);
        let position = (turned_ut - b_ut) / 50.0;
        let explained = explained_turn(&calibration, &(w * position - earth), &position)?;
        // What the explanation leaves of the field's change.
        let [change, _] = MountTurnEffect::new(&calibration, &position).field_change_and_derivative(explained.turn_rad);
        let unexplained = w * position + change - explained.hard_iron_change - earth;
        let added = Vector3::from(added_ut).vector_length() / 50.0;
        assert!(unexplained.vector_length() < 0.01 + added, "{unexplained}");
        Some(explained)
    }

    /// The turn that explains a field, degrees.
    fn explained_turn_deg(module_turn_deg: f32, staying_share: f32, added_ut: [f32; 3]) -> Option<f32> {
        Some(explanation(module_turn_deg, staying_share, added_ut)?.turn_rad.to_degrees())
    }

    /// Soft iron of second order is neglected in the axis.
    #[test]
    fn a_turn_explains_the_field_of_a_turned_module() {
        for (turn_deg, share) in [(5.0, 1.0), (-10.0, 1.0), (20.0, 0.0), (-20.0, 0.5), (-20.0, 0.0), (20.0, 0.5)] {
            let found_deg = explained_turn_deg(turn_deg, share, [0.0; 3]).unwrap();
            assert!((found_deg / turn_deg - 1.0).abs() < 0.01, "{turn_deg} {share}: {found_deg}");
        }
        assert_eq!(explanation(0.0, 1.0, [0.5, 0.5, 0.0]), Some(ExplainedTurn::NO_TURN));
    }

    /// 0.5 uT of noise across a difference of 2 uT.
    #[test]
    fn a_small_turn_is_found_despite_noise() {
        for noise_ut in [[0.0, 0.0, 0.5], [0.0, 0.0, -0.5]] {
            let found_deg = explained_turn_deg(5.0, 1.0, noise_ut);
            assert!(found_deg.is_some_and(|deg| (deg - 5.0).abs() < 1.0), "{found_deg:?}");
        }
    }

    #[test]
    fn changes_of_strength_or_along_the_axis_are_no_turn() {
        for added_ut in [[0.0, 0.0, 6.0], [0.0, 0.0, -6.0], [4.0, -4.0, 3.0], [5.0, 0.0, 0.0]] {
            assert_eq!(explanation(0.0, 1.0, added_ut), None, "{added_ut:?}");
        }
    }
}
