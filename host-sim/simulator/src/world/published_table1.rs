//! Liu 2007 table 1: published heading errors, and an airframe that reproduces the uncompensated ones.
//!
//! The paper prints no coefficients. [`FITTED_SOFT_IRON`] and [`FITTED_HARD_IRON_RATIO`] of `m = A h_body + b` are a
//! least-squares fit to the two "before" columns in degrees, regularised with weight 1 degree per unit toward the unit
//! matrix and zero hard iron. The regularisation determines only what 24 heading errors leave unobservable, mainly the
//! common scale. Assumed: pitch 0, banks of 20 degrees, inclination 54 degrees.
//!
//! Heading error is indicated minus true heading: this sign leaves residuals of 0.42 degrees RMS, the opposite sign
//! 0.63, exchanged left and right columns 1.2 or 1.7.

/// Bank of the tilted aircraft, degrees. Not given in the paper; 20 fits.
pub const EXPERIMENT_BANK_DEG: f64 = 20.0;
/// `A`, dimensionless, by rows.
pub const FITTED_SOFT_IRON: [[f64; 3]; 3] =
    [[0.986_935, 0.027_915, -0.015_376], [-0.023_215, 0.921_715, -0.018_934], [-0.013_081, 0.019_358, 0.986_086]];
/// `b` in units of the horizontal field.
pub const FITTED_HARD_IRON_RATIO: [f64; 3] = [0.309_228, -0.026_14, -0.002_42];

/// Published table with comments, comma-separated values.
pub const PUBLISHED_TABLE_CSV: &str = include_str!("../../../data/table1.csv");

/// Heading errors at one heading, banked to either side, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BankErrors {
    /// Heading error with the right wing down, degrees.
    pub right_deg: f64,
    /// Heading error with the left wing down, degrees.
    pub left_deg: f64,
}

/// Row of the published table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PublishedRow {
    /// True heading, degrees.
    pub heading_deg: f64,
    /// Errors of the uncompensated heading.
    pub uncompensated: BankErrors,
    /// Heading errors after compensation from known headings.
    pub known_heading_method: BankErrors,
    /// Heading errors after compensation by the paper's method.
    pub four_ellipse: BankErrors,
    /// Heading errors after compensation by the paper's method, less the mean error.
    pub four_ellipse_demeaned: BankErrors,
}

/// Published table.
///
/// # Panics
///
/// Never: the table is compiled in, and a test parses it.
#[must_use]
pub fn published_rows() -> [PublishedRow; 12] {
    let mut lines = PUBLISHED_TABLE_CSV.lines().filter(|line| !line.starts_with('#')).skip(1);
    std::array::from_fn(|_| parse_row(lines.next().expect("twelve rows")))
}

fn parse_row(line: &str) -> PublishedRow {
    let mut numbers = line.split(',').map(|cell| cell.parse().expect("a number"));
    let mut next = || numbers.next().expect("nine columns");
    let heading_deg = next();
    let mut next_bank_errors = || BankErrors { right_deg: next(), left_deg: next() };
    PublishedRow {
        heading_deg,
        uncompensated: next_bank_errors(),
        known_heading_method: next_bank_errors(),
        four_ellipse: next_bank_errors(),
        four_ellipse_demeaned: next_bank_errors(),
    }
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
        published_rows()
            .iter()
            .flat_map(|row| {
                [(EXPERIMENT_BANK_DEG, row.uncompensated.right_deg), (-EXPERIMENT_BANK_DEG, row.uncompensated.left_deg)]
                    .map(|(bank, published)| error_before_deg(airframe, row.heading_deg, bank) - published)
            })
            .collect()
    }

    #[test]
    fn the_table_is_read_as_printed() {
        let rows = published_rows();
        let [first, last] = [rows[0], rows[11]];
        assert_eq!((first.heading_deg, first.uncompensated), (0.0, BankErrors { right_deg: 4.2, left_deg: 2.4 }));
        assert_eq!(
            (last.heading_deg, last.known_heading_method),
            (330.0, BankErrors { right_deg: 1.5, left_deg: -2.3 })
        );
        assert_eq!(last.four_ellipse_demeaned, BankErrors { right_deg: 0.8, left_deg: -1.2 });
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
