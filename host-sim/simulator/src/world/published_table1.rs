//! Liu 2007 table 1: published heading errors, and an airframe that reproduces the uncompensated ones.
//!
//! The paper prints no coefficients. [`FITTED_SOFT_IRON`] and [`FITTED_HARD_IRON_RATIO`] of `m = A h_body + b` are a
//! least-squares fit to the two "before" columns in degrees, regularised with weight 1 degree per unit toward the unit
//! matrix and zero hard iron. The regularisation determines only what 24 heading errors leave unobservable, mainly the
//! common scale. Assumed: pitch 0, banks of 20 degrees, inclination 54 degrees.
//!
//! Heading error is indicated minus true heading: this sign leaves residuals of 0.42 degrees RMS, the opposite sign
//! 0.63, exchanged left and right columns 1.2 or 1.7.

use log_analysis::score::ErrorStatistics;
use serde::Serialize;

/// Bank of the tilted aircraft, degrees. Not given in the paper; 20 fits.
pub const EXPERIMENT_BANK_DEG: f64 = 20.0;
/// `A`, dimensionless, by rows.
pub const FITTED_SOFT_IRON: [[f64; 3]; 3] =
    [[0.986_935, 0.027_915, -0.015_376], [-0.023_215, 0.921_715, -0.018_934], [-0.013_081, 0.019_358, 0.986_086]];
/// `b` in units of the horizontal field.
pub const FITTED_HARD_IRON_RATIO: [f64; 3] = [0.309_228, -0.026_14, -0.002_42];

/// Published table with comments, comma-separated values.
const PUBLISHED_TABLE_CSV: &str = include_str!("../../../data/table1.csv");

/// Number of headings in the table, 30 deg apart.
pub const HEADING_COUNT: usize = 12;

/// Heading errors with one method, degrees, at headings 0, 30, ... 330.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MethodErrors {
    /// Method name.
    pub name: &'static str,
    /// Heading errors with the right wing down, degrees.
    pub right_deg: [f64; HEADING_COUNT],
    /// Heading errors with the left wing down, degrees.
    pub left_deg: [f64; HEADING_COUNT],
}

impl MethodErrors {
    /// Statistics over both sides.
    #[must_use]
    pub fn error_statistics(&self) -> ErrorStatistics {
        ErrorStatistics::from_errors_deg(&[self.right_deg, self.left_deg].concat())
    }
}

/// Published errors: uncompensated, compensated from known headings, and by the paper's method.
///
/// # Panics
///
/// Never: the table is compiled in, and a test parses it.
#[must_use]
pub fn published_errors() -> [MethodErrors; 3] {
    let lines = PUBLISHED_TABLE_CSV.lines().filter(|line| !line.starts_with('#')).skip(1);
    let parse_row = |line: &str| line.split(',').map(|cell| cell.parse().expect("a number")).collect();
    let rows: Vec<Vec<f64>> = lines.map(parse_row).collect();
    let column = |index: usize| std::array::from_fn(|row| rows[row][index]);
    [("before", 1), ("reference", 3), ("four ellipses", 5)].map(|(name, index)| MethodErrors {
        name,
        right_deg: column(index),
        left_deg: column(index + 1),
    })
}

#[cfg(test)]
mod tests {
    use autoswing::calibration::{Calibration, Orientation};
    use autoswing::frames::RollPitch;

    use super::*;
    use crate::world::airframe::Airframe;
    use crate::world::earth::Earth;
    use crate::world::rotation::Euler;

    fn error_before_deg(airframe: &Airframe, heading_deg: f64, bank_deg: f64) -> f64 {
        let body_ut = Earth::default().body_field_ut(Euler::from_deg(bank_deg, 0.0, heading_deg));
        let uncorrected = Calibration::uncalibrated(Orientation::IDENTITY_ROTATION)
            .calibrated_field(airframe.measured_field(&body_ut));
        let attitude = RollPitch::from_deg(bank_deg as f32, 0.0);
        let indicated_deg = f64::from(attitude.to_level_frame(uncorrected).heading_rad().to_degrees());
        (indicated_deg - heading_deg + 180.0).rem_euclid(360.0) - 180.0
    }

    fn residuals_deg(airframe: &Airframe) -> Vec<f64> {
        let [MethodErrors { right_deg, left_deg, .. }, ..] = published_errors();
        let residual_deg = |(row, bank_deg, published_deg): (usize, f64, f64)| {
            error_before_deg(airframe, 30.0 * row as f64, bank_deg) - published_deg
        };
        (0..HEADING_COUNT)
            .flat_map(|row| [(row, EXPERIMENT_BANK_DEG, right_deg[row]), (row, -EXPERIMENT_BANK_DEG, left_deg[row])])
            .map(residual_deg)
            .collect()
    }

    #[test]
    fn the_table_is_read_as_printed() {
        let [before, reference, four_ellipses] = published_errors();
        assert_eq!((before.right_deg[0], before.left_deg[0]), (4.2, 2.4));
        assert_eq!((reference.right_deg[11], reference.left_deg[11]), (1.5, -2.3));
        assert_eq!((four_ellipses.right_deg[11], four_ellipses.left_deg[11]), (2.1, 0.1));
    }

    /// Changing any of the twelve coefficients by 0.01 increases the cost described in the module documentation, far
    /// more than rounding or f32 arithmetic does.
    #[test]
    fn the_coefficients_are_the_least_squares_fit() {
        let horizontal_ut = Earth::default().horizontal_ut();
        let cost = |airframe: &Airframe| {
            let ridge = (airframe.field_matrix - nalgebra::Matrix3::identity()).norm_squared()
                + (airframe.hard_iron_ut / horizontal_ut).norm_squared();
            residuals_deg(airframe).iter().map(|residual_deg| residual_deg * residual_deg).sum::<f64>() + ridge
        };
        let fitted_cost = cost(&Airframe::of_table1());
        for (index, step) in (0..12).flat_map(|index| [(index, 0.01), (index, -0.01)]) {
            let mut changed_airframe = Airframe::of_table1();
            if index < 9 {
                changed_airframe.field_matrix[index] += step;
            } else {
                changed_airframe.hard_iron_ut[index - 9] += step * horizontal_ut;
            }
            assert!(
                cost(&changed_airframe) > fitted_cost,
                "coefficient {index} by {step}: {} for {fitted_cost}",
                cost(&changed_airframe)
            );
        }
    }
}
