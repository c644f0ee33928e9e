//! How good a calibration is: heading errors at exact field and true attitude, against true magnetic heading.

use std::f64::consts::FRAC_PI_6;

use autoswing::calibration::Calibration;
use autoswing::frames::{Attitude, Field};
use nalgebra::Vector3;
use serde::Serialize;

use crate::world::rotation::Euler;
use crate::world::{CRUISE_A, WorldConfig};

/// Banks at which a calibration is scored, degrees.
pub const BANKS_DEG: [f64; 3] = [0.0, 25.0, -25.0];

/// Heading errors, indicated less true, in degrees: twelve headings from north, 30 deg apart, at each of
/// [`BANKS_DEG`].
#[derive(Clone, Debug, PartialEq)]
pub struct Errors(pub [[f64; 12]; 3]);

/// Figures of [`Errors`], degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Largest error.
    pub max_deg: f64,
    /// The constant error: the mean over all.
    pub mean_deg: f64,
    /// Root mean square.
    pub rms_deg: f64,
    /// Largest error less the constant one.
    pub max_demeaned_deg: f64,
}

impl Errors {
    /// Scores a calibration in a world, at the current of level flight, hover or on the flat.
    #[must_use]
    pub fn of(calibration: &Calibration, world: &WorldConfig) -> Self {
        let error_deg = |bank_deg: f64, heading_rad: f64| {
            let truth = Euler { roll_rad: bank_deg.to_radians(), pitch_rad: 0.0, heading_rad };
            let sensed = world.airframe.measure(&world.earth.body_field_ut(truth));
            let sensed = Field::new(sensed.ut + Vector3::from(world.current_ut).cast());
            // From here on it is the module's own arithmetic that is judged.
            let told_a = world.tells_current.then_some(CRUISE_A as f32);
            let sensed = calibration.without_current(sensed, told_a);
            let attitude = Attitude::from_deg(bank_deg as f32, 0.0);
            let indicated = attitude.level(calibration.apply(sensed)).heading_rad();
            wrap_180((f64::from(indicated) - heading_rad).to_degrees())
        };
        Self(BANKS_DEG.map(|bank_deg| std::array::from_fn(|i| error_deg(bank_deg, i as f64 * FRAC_PI_6))))
    }

    /// The figures.
    #[must_use]
    pub fn figures(&self) -> Figures {
        Figures::of(self.0.as_flattened())
    }
}

impl Figures {
    /// Of errors in degrees.
    #[must_use]
    pub fn of(errors_deg: &[f64]) -> Self {
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

/// Percent of errors, each over its standard deviation, within one and within two.
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
    use autoswing::calibration::{CurrentIron, Orientation};

    #[test]
    fn figures_are_those_of_the_errors() {
        let figures = Figures::of(&[3.0, 1.0, -1.0, 1.0]);
        let expected = Figures { max_deg: 3.0, mean_deg: 1.0, rms_deg: 3_f64.sqrt(), max_demeaned_deg: 2.0 };
        assert_eq!(figures, expected);
        let within = |errors: &[f64]| within_percent(errors).map(|percent| percent.round() as i32);
        assert_eq!(within(&[0.5, -1.0, 1.1, -2.0, 2.1]), [40, 80]);
        assert_eq!(within(&[]), [0; 2]);
    }

    /// A calibration that takes all of it for what goes with the current is right in cruise where the current is told, and off by
    /// as much where it takes another mean to flow: 12 uT.
    #[test]
    fn iron_by_current_counts_as_the_module_is_told_it() {
        let world = WorldConfig { airframe: crate::world::airframe::Airframe::none(), ..WorldConfig::random(1) };
        let mut world = world.with_current(12.0);
        let calibration = |mean_a: f32| Calibration {
            current: CurrentIron {
                ut_per_a: world.current_ut.map(|ut| (ut / CRUISE_A) as f32),
                mean_a,
                ..CurrentIron::NONE
            },
            ..Calibration::uncalibrated(Orientation::NONE)
        };
        let [right, wrong] = [CRUISE_A as f32, 0.0].map(calibration);
        let worst_deg =
            |calibration: &Calibration, world: &WorldConfig| Errors::of(calibration, world).figures().max_deg;
        world.tells_current = true;
        assert!(worst_deg(&right, &world) < 0.01 && worst_deg(&wrong, &world) < 0.01);
        world.tells_current = false;
        assert!(worst_deg(&right, &world) < 0.01 && worst_deg(&wrong, &world) > 5.0);
    }
}
