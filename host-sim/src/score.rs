//! Evaluation of a calibration: heading errors at exact field and attitude, relative to true magnetic heading.

use std::f64::consts::FRAC_PI_6;

use autoswing::acceptance::{self, AcceptancePolicy, AcceptanceSamples, Incumbent, Rejection};
use autoswing::calibration::{Calibration, Orientation, Samples, Solution};
use autoswing::frames::{Attitude, Field};
use nalgebra::Vector3;
use serde::Serialize;

use crate::world::rotation::Euler;
use crate::world::{CRUISE_CURRENT_A, WorldConfig};

/// Banks at which a calibration is evaluated, degrees.
pub const BANKS_DEG: [f64; 3] = [0.0, 25.0, -25.0];

/// Heading errors (indicated minus true), degrees, at twelve headings from north, 30 deg apart, for each of
/// [`BANKS_DEG`].
#[derive(Clone, Debug, PartialEq)]
pub struct HeadingErrors(pub [[f64; 12]; 3]);

/// Statistics of heading errors, degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ErrorStatistics {
    /// Largest error.
    pub max_deg: f64,
    /// Mean error.
    pub mean_deg: f64,
    /// Root mean square error.
    pub rms_deg: f64,
    /// Largest error after subtraction of the mean.
    pub max_demeaned_deg: f64,
}

impl HeadingErrors {
    /// Evaluates a calibration in a world at cruise current.
    #[must_use]
    pub fn evaluate(calibration: &Calibration, world: &WorldConfig) -> Self {
        let error_deg = |bank_deg: f64, heading_rad: f64| {
            let truth = Euler { roll_rad: bank_deg.to_radians(), pitch_rad: 0.0, heading_rad };
            let sensed = world.airframe.measured_field(&world.earth.body_field_ut(truth));
            let sensed = Field::new(sensed.ut + Vector3::from(world.current_interference_ut).cast());
            // The remaining calculation uses the module's own code.
            let told_a = world.reports_current.then_some(CRUISE_CURRENT_A as f32);
            let sensed = calibration.remove_motor_current(sensed, told_a);
            let attitude = Attitude::from_deg(bank_deg as f32, 0.0);
            let indicated = attitude.level(calibration.apply(sensed)).heading_rad();
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

impl ErrorStatistics {
    /// Statistics of errors in degrees.
    #[must_use]
    pub fn from_errors_deg(errors_deg: &[f64]) -> Self {
        let number = errors_deg.len() as f64;
        let mean_deg = errors_deg.iter().sum::<f64>() / number;
        let largest = |offset: f64| errors_deg.iter().map(|e| (e - offset).abs()).fold(0.0, f64::max);
        Self {
            max_deg: largest(0.0),
            mean_deg,
            rms_deg: (errors_deg.iter().map(|e| e * e).sum::<f64>() / number).sqrt(),
            max_demeaned_deg: largest(mean_deg),
        }
    }
}

/// Whether an uncalibrated module accepts a solution.
///
/// # Errors
///
/// The reason of a rejection.
pub fn accepted_by_uncalibrated(
    solution: &Solution,
    fit: Samples<'_>,
    held_back: Samples<'_>,
) -> Result<(), Rejection> {
    let samples = AcceptanceSamples { fit, held_back, is_attitude_known: true };
    let incumbent = Incumbent::uncalibrated(Orientation::NONE);
    acceptance::evaluate_candidate(&AcceptancePolicy::DEFAULT, solution, samples, &incumbent).map(|_| ())
}

/// Percent of normalised errors within one and two standard deviations.
#[must_use]
pub fn within_percent(normalised: &[f64]) -> [f64; 2] {
    [1.0, 2.0].map(|sigmas| {
        let within = normalised.iter().filter(|error| error.abs() <= sigmas).count();
        100.0 * within as f64 / normalised.len().max(1) as f64
    })
}

/// Wraps an angle in degrees to -180..180.
#[must_use]
pub fn wrap_180(angle_deg: f64) -> f64 {
    (angle_deg + 180.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use autoswing::calibration::{MotorCurrentInterference, Orientation};

    #[test]
    fn statistics_match_hand_calculated_errors() {
        let figures = ErrorStatistics::from_errors_deg(&[3.0, 1.0, -1.0, 1.0]);
        let expected = ErrorStatistics { max_deg: 3.0, mean_deg: 1.0, rms_deg: 3_f64.sqrt(), max_demeaned_deg: 2.0 };
        assert_eq!(figures, expected);
        let within = |errors: &[f64]| within_percent(errors).map(|percent| percent.round() as i32);
        assert_eq!(within(&[0.5, -1.0, 1.1, -2.0, 2.1]), [40, 80]);
        assert_eq!(within(&[]), [0; 2]);
    }

    /// A calibration that includes the motor-current interference is exact at cruise if the current is reported.
    /// Without a reported current it assumes the mean current; a wrong mean causes an error of 12 uT.
    #[test]
    fn motor_current_interference_is_scored_by_the_reported_current() {
        let world = WorldConfig { airframe: crate::world::airframe::Airframe::none(), ..WorldConfig::random(1) };
        let mut world = world.with_current_interference(12.0);
        let calibration = |mean_a: f32| Calibration {
            motor_current: MotorCurrentInterference {
                ut_per_a: world.current_interference_ut.map(|ut| (ut / CRUISE_CURRENT_A) as f32),
                mean_current_a: mean_a,
                ..MotorCurrentInterference::NONE
            },
            ..Calibration::uncalibrated(Orientation::NONE)
        };
        let [right, wrong] = [CRUISE_CURRENT_A as f32, 0.0].map(calibration);
        let worst_deg = |calibration: &Calibration, world: &WorldConfig| {
            HeadingErrors::evaluate(calibration, world).statistics().max_deg
        };
        world.reports_current = true;
        assert!(worst_deg(&right, &world) < 0.01 && worst_deg(&wrong, &world) < 0.01);
        world.reports_current = false;
        assert!(worst_deg(&right, &world) < 0.01 && worst_deg(&wrong, &world) > 5.0);
    }
}
