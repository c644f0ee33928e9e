//! Expected heading error of a calibration over all headings, degrees: its quality figure. The residual of the fit is
//! not: a norm residual of 0.3 % can hide a heading error of 5 deg in an unobservable direction.

use core::f32::consts::FRAC_PI_6;
use core::fmt;

use nalgebra::Matrix3;

use super::coefficient_covariance::CoefficientCovariance;
use crate::calibration::linear_algebra::inverse;
use crate::calibration::model::{Vector12, coefficient_jacobian_row, heading_derivative_by_field};
use crate::calibration::types::coefficients::Calibration;
use crate::calibration::types::quality::AttitudeEnvelope;
use crate::frames::{Field, Level, RollPitch};
use crate::trig;
use crate::trig::sqrt;

const HEADING_COUNT: u8 = 12;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::calibration) struct ExpectedError {
    /// Error, RMS over the envelope, degrees.
    pub rms_deg: f32,
    /// Error at the worst heading and bank of the envelope, degrees.
    pub worst_deg: f32,
    /// Largest part of the error, and its size, degrees RMS.
    pub weakest_deviation: (Deviation, f32),
}

/// Parts of the deviation, in the terms of compass adjusters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Deviation {
    /// Coefficient A: equal at all headings.
    Constant,
    /// Coefficients B and C: one period per circle.
    Semicircular,
    /// Coefficients D and E: two periods per circle.
    Quadrantal,
    /// Heeling error: varies with bank.
    Heeling,
}

impl Deviation {
    const ALL_DEVIATIONS: [Self; 4] = [Self::Constant, Self::Semicircular, Self::Quadrantal, Self::Heeling];

    /// Stable name of a part of the deviation.
    #[must_use]
    pub const fn deviation_name(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Semicircular => "semicircular",
            Self::Quadrantal => "quadrantal",
            Self::Heeling => "heeling",
        }
    }
}

impl fmt::Display for Deviation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Constant => "the same error at all headings",
            Self::Semicircular => "an error with one period per circle, opposite on opposite headings",
            Self::Quadrantal => "an error with two periods per circle, equal on opposite headings",
            Self::Heeling => "an error in turns that level flight does not have",
        })
    }
}

pub(in crate::calibration) fn expected_heading_error(
    calibration: &Calibration,
    covariance: &CoefficientCovariance,
    envelope: AttitudeEnvelope,
) -> Option<ExpectedError> {
    let heading_error_model = HeadingErrorModel::new(calibration)?;
    let (rms_deg, worst_deg) = heading_error_model.rms_and_worst_deg(covariance, envelope)?;
    let size_deg = |part: Deviation| sigma_deg(heading_error_model.mean_square_of_part(part, covariance));
    let weakest = Deviation::ALL_DEVIATIONS
        .into_iter()
        .filter(|&part| part != Deviation::Heeling || envelope == AttitudeEnvelope::Banked)
        .map(|part| (part, size_deg(part)))
        .fold((Deviation::Constant, 0.0), |a, b| if b.1 > a.1 { b } else { a });
    Some(ExpectedError { rms_deg, worst_deg, weakest_deviation: weakest })
}

pub(in crate::calibration) fn expected_rms_deg(
    calibration: &Calibration,
    covariance: &CoefficientCovariance,
    envelope: AttitudeEnvelope,
) -> Option<f32> {
    HeadingErrorModel::new(calibration)?.rms_and_worst_deg(covariance, envelope).map(|(rms_deg, _)| rms_deg)
}

struct HeadingErrorModel {
    field_from_body: Matrix3<f32>,
    inclination_rad: f32,
}

impl HeadingErrorModel {
    fn new(calibration: &Calibration) -> Option<Self> {
        let field_from_body = inverse(&calibration.w_matrix())?;
        Some(Self { field_from_body, inclination_rad: calibration.inclination_rad })
    }

    fn heading_jacobian_row(&self, bank_deg: f32, heading_index: u8) -> Vector12 {
        let tilt = RollPitch::from_deg(bank_deg, 0.0).tilt_rotation();
        let level = Field::<Level>::earth_field(1.0, self.inclination_rad, f32::from(heading_index) * FRAC_PI_6);
        let x = self.field_from_body * tilt.to_body_frame(level).ut;
        coefficient_jacobian_row(&heading_derivative_by_field(&tilt, &level.ut), &x)
    }

    fn rms_and_worst_deg(&self, covariance: &CoefficientCovariance, envelope: AttitudeEnvelope) -> Option<(f32, f32)> {
        let mut sum = 0.0;
        let mut worst: f32 = 0.0;
        for &bank_deg in envelope.banks_deg() {
            for heading_index in 0..HEADING_COUNT {
                let variance = covariance.variance(&self.heading_jacobian_row(bank_deg, heading_index));
                sum += variance;
                worst = worst.max(variance);
            }
        }
        let mean = sum / (usize::from(HEADING_COUNT) * envelope.banks_deg().len()) as f32;
        mean.is_finite().then(|| (sigma_deg(mean), sigma_deg(worst)))
    }

    fn mean_square_of_part(&self, part: Deviation, covariance: &CoefficientCovariance) -> f32 {
        let heading_count = f32::from(HEADING_COUNT);
        let rows_at = |bank_deg: f32| (0..HEADING_COUNT).map(move |index| self.heading_jacobian_row(bank_deg, index));
        match part {
            Deviation::Constant => covariance.variance(&(rows_at(0.0).sum::<Vector12>() / heading_count)),
            Deviation::Semicircular => self.mean_square_of_harmonic(1.0, covariance),
            Deviation::Quadrantal => self.mean_square_of_harmonic(2.0, covariance),
            Deviation::Heeling => {
                let differences = rows_at(30.0).zip(rows_at(-30.0)).map(|(right, left)| (right - left) / 2.0);
                differences.map(|difference| covariance.variance(&difference)).sum::<f32>() / heading_count
            }
        }
    }

    /// Mean square of the part with a number of periods per circle, square radians.
    fn mean_square_of_harmonic(&self, periods_per_circle: f32, covariance: &CoefficientCovariance) -> f32 {
        let coefficient = |weight: fn(f32) -> f32| {
            let weighted = (0..HEADING_COUNT).map(|heading_index| {
                let angle_rad = periods_per_circle * f32::from(heading_index) * FRAC_PI_6;
                self.heading_jacobian_row(0.0, heading_index) * weight(angle_rad)
            });
            covariance.variance(&(weighted.sum::<Vector12>() * (2.0 / f32::from(HEADING_COUNT))))
        };
        // A sine of amplitude `c` has the mean square `c^2 / 2`.
        coefficient(|angle_rad| trig::sin_cos(angle_rad).0)
            .midpoint(coefficient(|angle_rad| trig::sin_cos(angle_rad).1))
    }
}

fn sigma_deg(variance: f32) -> f32 {
    sqrt(variance).to_degrees()
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;
    use crate::calibration::model::{beta_index, w_index};
    use crate::calibration::tests::synthetic::{level_samples, max_abs, mean, rms};
    use crate::calibration::{Method, Orientation, Sample, matrix_rows};
    use crate::frames::wrap_pi;

    fn iron_free_calibration() -> Calibration {
        Calibration { inclination_rad: 0.9, total_ut: 1.0, ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION) }
    }

    fn expected_error_of(wrong: &[(usize, f32)], envelope: AttitudeEnvelope) -> ExpectedError {
        let mut direction = Vector12::zeros();
        for &(index, size) in wrong {
            direction[index] = size;
        }
        let mut covariance = CoefficientCovariance::ZERO;
        covariance.add_outer_product(&direction, 1.0);
        expected_heading_error(&iron_free_calibration(), &covariance, envelope).unwrap()
    }

    fn errors_deg(w: Matrix3<f32>, beta: [f32; 3], banks_deg: &[f32]) -> Vec<f32> {
        let wrong = Calibration { w: matrix_rows(&(Matrix3::identity() + w)), b_ut: beta, ..iron_free_calibration() };
        let error = |bank_deg: f32, heading_index: u8| {
            let heading_rad = f32::from(heading_index) * FRAC_PI_6;
            let attitude = RollPitch::from_deg(bank_deg, 0.0);
            let field = Field::new(attitude.to_body_frame(Field::earth_field(1.0, 0.9, heading_rad)).ut);
            wrap_pi(attitude.to_level_frame(wrong.calibrated_field(field)).heading_rad() - heading_rad).to_degrees()
        };
        banks_deg
            .iter()
            .flat_map(|&bank_deg| (0..12).map(move |heading_index| error(bank_deg, heading_index)))
            .collect()
    }

    /// Causes: sensor rotated about the vertical, horizontal hard iron, horizontal soft iron, vertical response.
    #[test]
    fn the_weakest_part_identifies_the_cause() {
        let sensor_yaw = [(w_index(0, 1), -0.02), (w_index(1, 0), 0.02)];
        let constant = expected_error_of(&sensor_yaw, AttitudeEnvelope::Banked).weakest_deviation;
        assert_eq!(constant.0, Deviation::Constant);
        assert!((constant.1 - 0.02_f32.to_degrees()).abs() < 0.01, "{constant:?}");
        for axis in [0, 1] {
            let semicircular =
                expected_error_of(&[(beta_index(axis), 0.02)], AttitudeEnvelope::Banked).weakest_deviation;
            assert_eq!(semicircular.0, Deviation::Semicircular);
            let amplitude_deg = (0.02 / 0.9_f32.cos()).to_degrees();
            assert!((semicircular.1 - amplitude_deg / 2_f32.sqrt()).abs() < 0.01, "{semicircular:?}");
        }
        for wrong in [&[(w_index(0, 0), 0.02), (w_index(1, 1), -0.02)], &[(w_index(0, 1), 0.02), (w_index(1, 0), 0.02)]]
        {
            let quadrantal = expected_error_of(wrong, AttitudeEnvelope::Level).weakest_deviation;
            assert_eq!(quadrantal.0, Deviation::Quadrantal);
            assert!((quadrantal.1 - 0.02_f32.to_degrees() / 2_f32.sqrt()).abs() < 0.01, "{quadrantal:?}");
        }
        let heeling = expected_error_of(&[(beta_index(2), 0.02)], AttitudeEnvelope::Banked).weakest_deviation;
        assert_eq!(heeling.0, Deviation::Heeling);
        let [right, left] = [30.0, -30.0].map(|bank_deg| errors_deg(Matrix3::zeros(), [0.0, 0.0, 0.02], &[bank_deg]));
        let halves: Vec<f32> = right.iter().zip(left).map(|(right, left)| (right - left) / 2.0).collect();
        assert!((heeling.1 - rms(&halves)).abs() < 0.02 * rms(&halves), "{heeling:?} {}", rms(&halves));
        assert_ne!(
            expected_error_of(&[(beta_index(2), 0.02)], AttitudeEnvelope::Level).weakest_deviation.0,
            Deviation::Heeling
        );
    }

    #[test]
    fn expected_error_equals_the_error_of_perturbed_calibrations() {
        for (envelope, banks_deg) in
            [(AttitudeEnvelope::Banked, &[-30.0, 0.0, 30.0][..]), (AttitudeEnvelope::Level, &[0.0])]
        {
            let beta_z = expected_error_of(&[(beta_index(2), 0.01), (w_index(0, 2), 0.01)], envelope);
            let mut change = Matrix3::zeros();
            change[(0, 2)] = 0.01;
            let errors = errors_deg(change, [0.0, 0.0, 0.01], banks_deg);
            assert!(mean(&errors).abs() < rms(&errors));
            // Linearisation error for 1 % of the field.
            assert!((beta_z.rms_deg / rms(&errors) - 1.0).abs() < 0.03, "{beta_z:?} {}", rms(&errors));
            assert!((beta_z.worst_deg / max_abs(&errors) - 1.0).abs() < 0.05, "{beta_z:?} {}", max_abs(&errors));
        }
    }

    #[test]
    fn non_finite_errors_are_rejected() {
        let flat = Calibration { w: [[0.0; 3]; 3], ..iron_free_calibration() };
        assert_eq!(expected_heading_error(&flat, &CoefficientCovariance::ZERO, AttitudeEnvelope::Level), None);
        let mut covariance = CoefficientCovariance::ZERO;
        covariance.set_lower_triangle(|_, _| 1e38);
        assert_eq!(expected_heading_error(&iron_free_calibration(), &covariance, AttitudeEnvelope::Level), None);
        let nothing =
            expected_heading_error(&iron_free_calibration(), &CoefficientCovariance::ZERO, AttitudeEnvelope::Level)
                .unwrap();
        assert_eq!(
            [nothing.rms_deg.to_bits(), nothing.worst_deg.to_bits(), nothing.weakest_deviation.1.to_bits()],
            [0; 3]
        );
    }

    #[test]
    fn banked_samples_give_the_banked_envelope() {
        let sample = |roll_deg: f32| Sample::new(Field::from_ut(1.0, 0.0, 0.0), RollPitch::from_deg(roll_deg, 0.0));
        for (method, rolls_deg, expected) in [
            (Method::CompassSwing, [5.0, -5.0], AttitudeEnvelope::Level),
            (Method::CompassSwing, [0.0, 15.0], AttitudeEnvelope::Banked),
            (Method::MaximumLikelihood, [-15.0, 0.0], AttitudeEnvelope::Banked),
            (Method::Level, [20.0, -20.0], AttitudeEnvelope::Level),
            (Method::Ellipsoid, [0.0, 0.0], AttitudeEnvelope::Banked),
        ] {
            let found = AttitudeEnvelope::for_samples(method, level_samples(&rolls_deg.map(sample)));
            assert_eq!(found, expected, "{method:?} {rolls_deg:?}");
        }
    }

    #[test]
    fn each_deviation_part_has_a_name_and_a_text() {
        let all = Deviation::ALL_DEVIATIONS.map(|part| (part.deviation_name(), part.to_string()));
        assert_eq!(all.each_ref().map(|(name, _)| *name), ["constant", "semicircular", "quadrantal", "heeling"]);
        let words = ["at all headings", "one period", "two periods", "in turns"];
        assert!(all.iter().zip(words).all(|((_, said), word)| said.contains(word)), "{all:?}");
    }
}
