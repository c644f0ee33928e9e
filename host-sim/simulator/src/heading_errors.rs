//! Evaluation of a calibration: heading errors without noise, relative to true magnetic heading.

use std::f64::consts::FRAC_PI_6;

use autoswing::calibration::Calibration;
use autoswing::frames::{Field, RollPitch};
use log_analysis::score::{ErrorStatistics, wrap_180};
use nalgebra::Vector3;

use crate::world::{CRUISE_CURRENT_A, TrueState, WorldConfig};

/// Banks at which a calibration is evaluated, degrees.
pub const BANKS_DEG: [f64; 3] = [0.0, 25.0, -25.0];

/// Heading errors (indicated minus true), degrees, at twelve headings from north, 30 deg apart, for each of
/// [`BANKS_DEG`].
#[derive(Clone, Debug, PartialEq)]
pub struct HeadingErrors(pub [[f64; 12]; 3]);

impl HeadingErrors {
    /// Evaluates a calibration in a world at cruise current.
    #[must_use]
    pub fn evaluate_calibration(calibration: &Calibration, world: &WorldConfig) -> Self {
        Self::evaluate_with_faults(calibration, world, &|_| Vector3::zeros(), [0.0; 2])
    }

    /// As [`evaluate_calibration`](Self::evaluate_calibration), with an additional field in chip axes, microtesla, at
    /// each steady state, and an error of the reported roll and pitch, radians.
    #[must_use]
    pub fn evaluate_with_faults(
        calibration: &Calibration,
        world: &WorldConfig,
        added_field_ut: &dyn Fn(&TrueState) -> Vector3<f64>,
        attitude_error_rad: [f64; 2],
    ) -> Self {
        let error_deg = |bank_deg: f64, heading_rad: f64| {
            let truth = TrueState { roll_rad: bank_deg.to_radians(), heading_rad, ..TrueState::default() };
            let field = world.airframe.measured_field(&world.earth.body_field_ut(truth.euler_angles()));
            let added_field_ut = added_field_ut(&truth) + Vector3::from(world.current_interference_ut);
            let field = Field::new(field.ut + added_field_ut.cast());
            // The indicated heading is calculated by the module's own code.
            let reported_current_a = world.reports_current.then_some(CRUISE_CURRENT_A as f32);
            let field = calibration.remove_motor_current(field, reported_current_a);
            let [roll_error_rad, pitch_error_rad] = attitude_error_rad;
            let attitude =
                RollPitch { roll_rad: (truth.roll_rad + roll_error_rad) as f32, pitch_rad: pitch_error_rad as f32 };
            let indicated = attitude.to_level_frame(calibration.calibrated_field(field)).heading_rad();
            wrap_180((f64::from(indicated) - heading_rad).to_degrees())
        };
        Self(BANKS_DEG.map(|bank_deg| std::array::from_fn(|i| error_deg(bank_deg, i as f64 * FRAC_PI_6))))
    }

    /// Statistics of the errors.
    #[must_use]
    pub fn statistics(&self) -> ErrorStatistics {
        ErrorStatistics::from_errors_deg(self.0.as_flattened())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::airframe::Airframe;
    use autoswing::calibration::{MotorCurrentInterference, Orientation};

    /// A calibration that includes the motor-current interference is exact at cruise if the current is reported.
    /// Without a reported current it assumes the mean current; a mean of zero leaves the interference of 12 uT.
    #[test]
    fn motor_current_interference_is_scored_by_the_reported_current() {
        let world = WorldConfig { airframe: Airframe::default(), ..WorldConfig::random_world(1) };
        let mut world = world.with_current_interference(12.0);
        let calibration = |mean_a: f32| Calibration {
            motor_current: MotorCurrentInterference {
                ut_per_a: world.current_interference_ut.map(|ut| (ut / CRUISE_CURRENT_A) as f32),
                mean_current_a: mean_a,
                ..MotorCurrentInterference::NO_INTERFERENCE
            },
            ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION)
        };
        let [right, wrong] = [CRUISE_CURRENT_A as f32, 0.0].map(calibration);
        let worst_deg = |calibration: &Calibration, world: &WorldConfig| {
            HeadingErrors::evaluate_calibration(calibration, world).statistics().max_deg
        };
        world.reports_current = true;
        assert!(worst_deg(&right, &world) < 0.01 && worst_deg(&wrong, &world) < 0.01);
        world.reports_current = false;
        assert!(worst_deg(&right, &world) < 0.01 && worst_deg(&wrong, &world) > 5.0);
    }
}
