//! Magnetic disturbance of the airframe, and mounting of the sensor: `m = A h_body + b` (Liu 2007 eq. 8).

use autoswing::calibration::{Calibration, MotorCurrentInterference};
use autoswing::frames::{Field, Sensor};
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::Deserialize;

use super::earth::Earth;
use super::published_table1;
use crate::random::{RandomStream, StreamPurpose};

/// Largest symmetric soft iron of a random airframe, relative.
const MAX_RANDOM_SOFT_IRON: f64 = 0.20;
/// Largest asymmetric soft iron, relative: soft iron near the sensor is nearly symmetric.
const MAX_RANDOM_ASYMMETRY: f64 = 0.02;
/// Largest hard iron of a random airframe, in units of the horizontal field.
const MAX_RANDOM_HARD_IRON: f64 = 1.5;
/// Largest mounting rotation of a random airframe, degrees.
const MAX_RANDOM_MOUNTING_DEG: f64 = 10.0;

/// Linear map from the field in body axes to the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(from = "AirframeDescription")]
pub struct Airframe {
    /// `A`, dimensionless, body axes to chip axes: soft iron, then mounting.
    pub field_matrix: Matrix3<f64>,
    /// `b`, microtesla, chip axes: hard iron and zero offset.
    pub hard_iron_ut: Vector3<f64>,
}

impl Default for Airframe {
    /// No soft or hard iron, chip axes equal to body axes.
    fn default() -> Self {
        Self { field_matrix: Matrix3::identity(), hard_iron_ut: Vector3::zeros() }
    }
}

/// Airframe in a scenario file: `A = mounting * soft_iron`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AirframeDescription {
    /// Soft-iron matrix by rows, dimensionless, body axes; the unit matrix means none.
    pub soft_iron: [[f64; 3]; 3],
    /// Hard iron and zero offset, microtesla, chip axes.
    pub hard_iron_ut: [f64; 3],
    /// Mounting of the chip relative to the body axes: roll, pitch, yaw in degrees, Euler ZYX.
    pub mounting_deg: [f64; 3],
}

impl From<AirframeDescription> for Airframe {
    fn from(description: AirframeDescription) -> Self {
        let [roll, pitch, yaw] = description.mounting_deg.map(f64::to_radians);
        // Euler angles give the chip's axes in the body frame; the field needs the inverse rotation.
        let chip_from_body = Rotation3::from_euler_angles(roll, pitch, yaw).inverse();
        let [x, y, z] = description.soft_iron.map(Into::into);
        let soft_iron = Matrix3::from_columns(&[x, y, z]).transpose();
        Self { field_matrix: chip_from_body * soft_iron, hard_iron_ut: description.hard_iron_ut.into() }
    }
}

impl From<&Airframe> for AirframeDescription {
    /// Polar decomposition of `A` into a symmetric soft iron and a mounting rotation; requires a chip that is not
    /// mirrored.
    fn from(airframe: &Airframe) -> Self {
        let svd = airframe.field_matrix.svd(true, true);
        let [u, v_t] = [svd.u, svd.v_t].map(Option::unwrap_or_default);
        let soft_iron = v_t.transpose() * Matrix3::from_diagonal(&svd.singular_values) * v_t;
        let (roll, pitch, yaw) = Rotation3::from_matrix_unchecked(u * v_t).inverse().euler_angles();
        Self {
            soft_iron: soft_iron.transpose().into(),
            hard_iron_ut: airframe.hard_iron_ut.into(),
            mounting_deg: [roll, pitch, yaw].map(f64::to_degrees),
        }
    }
}

impl Airframe {
    /// Aircraft of Liu 2007 table 1 (see [`published_table1`]).
    #[must_use]
    pub fn of_table1() -> Self {
        let a = Matrix3::from_row_slice(published_table1::FITTED_SOFT_IRON.as_flattened());
        Self {
            field_matrix: a,
            hard_iron_ut: Vector3::from(published_table1::FITTED_HARD_IRON_RATIO) * Earth::default().horizontal_ut(),
        }
    }

    /// Random airframe: soft iron up to 20 %, hard iron up to 1.5 times the horizontal field, mounting up to 10
    /// degrees.
    #[must_use]
    pub fn random_airframe(seed: u64, earth: &Earth) -> Self {
        let mut random = RandomStream::new(seed, StreamPurpose::Airframe);
        let raw = Matrix3::from_fn(|_, _| random.uniform(-1.0, 1.0));
        let symmetric = raw + raw.transpose();
        let asymmetric = raw - raw.transpose();
        let soft_iron = Matrix3::identity()
            + scaled_to_size(symmetric, random.uniform(0.0, MAX_RANDOM_SOFT_IRON))
            + scaled_to_size(asymmetric, random.uniform(0.0, MAX_RANDOM_ASYMMETRY));
        let hard_iron = random.random_direction() * random.uniform(0.0, MAX_RANDOM_HARD_IRON);
        let mounting = random.random_rotation(MAX_RANDOM_MOUNTING_DEG);
        Self { field_matrix: mounting * soft_iron, hard_iron_ut: hard_iron * earth.horizontal_ut() }
    }

    /// Field of the soft iron per field in body axes, chip axes: `A` less its rotation, the mounting.
    #[must_use]
    pub fn soft_iron(&self) -> Matrix3<f64> {
        self.field_matrix - Rotation3::from_matrix(&self.field_matrix).into_inner()
    }

    /// Field at the chip for a field in body axes, microtesla.
    #[must_use]
    pub fn measured_field(&self, body_ut: &Vector3<f64>) -> Field<Sensor> {
        Field::new((self.field_matrix * body_ut + self.hard_iron_ut).cast())
    }

    /// The calibration that inverts this airframe exactly; `None` when `A` is singular.
    #[must_use]
    pub fn true_calibration(&self, earth: &Earth) -> Option<Calibration> {
        let correction_matrix = self.field_matrix.try_inverse()?;
        let scale = libm::cbrt(correction_matrix.determinant()).recip();
        let correction_matrix = (correction_matrix * scale).cast::<f32>();
        Some(Calibration {
            w: std::array::from_fn(|row| std::array::from_fn(|column| correction_matrix[(row, column)])),
            b_ut: self.hard_iron_ut.cast().into(),
            inclination_rad: earth.inclination_deg.to_radians() as f32,
            total_ut: (earth.total_ut * scale) as f32,
            latency_s: 0.0,
            motor_current: MotorCurrentInterference::NO_INTERFERENCE,
        })
    }
}

/// The matrix, scaled to a largest singular value of `size`.
fn scaled_to_size(matrix: Matrix3<f64>, size: f64) -> Matrix3<f64> {
    matrix * (size / matrix.singular_values().max())
}

#[cfg(test)]
mod tests {
    use autoswing::frames::RollPitch;

    use super::*;
    use crate::world::rotation::Euler;

    #[test]
    fn random_airframes_cover_their_limits() {
        let mut largest = [0.0_f64; 3];
        for seed in 0..1000 {
            let earth = Earth::random_earth(seed);
            let airframe = Airframe::random_airframe(seed, &earth);
            let svd = airframe.field_matrix.svd(true, true);
            let soft_iron = svd.singular_values.map(|singular_value| (singular_value - 1.0).abs()).max();
            let rotation = Rotation3::from_matrix(&airframe.field_matrix);
            let hard_iron = airframe.hard_iron_ut.norm() / earth.horizontal_ut();
            for (largest, value) in largest.iter_mut().zip([soft_iron, rotation.angle().to_degrees(), hard_iron]) {
                *largest = largest.max(value);
            }
        }
        assert!((0.18..0.22).contains(&largest[0]), "soft iron {}", largest[0]);
        assert!((9.0..11.2).contains(&largest[1]), "mounting {} deg", largest[1]);
        assert!((1.4..1.5).contains(&largest[2]), "hard iron {} H0", largest[2]);
    }

    /// The library's correction inverts the simulated chain; f32 leaves errors of about 1e-5 of 50 microtesla.
    #[test]
    fn the_true_calibration_recovers_heading_and_field() {
        for seed in 0..50 {
            let earth = Earth::random_earth(seed);
            let airframe = Airframe::random_airframe(seed, &earth);
            let calibration = airframe.true_calibration(&earth).unwrap();
            let attitude = RollPitch::from_deg(25.0, -4.0);
            let truth = Euler { heading_rad: 1.0, ..Euler::from_deg(25.0, -4.0, 0.0) };
            let body_ut = earth.body_field_ut(truth);
            let level_field = attitude.to_level_frame(calibration.calibrated_field(airframe.measured_field(&body_ut)));
            assert!((level_field.heading_rad() - 1.0).abs() < 2e-5, "seed {seed}: {}", level_field.heading_rad());
            assert!((level_field.total_ut() / calibration.total_ut - 1.0).abs() < 1e-5);
            assert!((level_field.inclination_rad() - calibration.inclination_rad).abs() < 1e-5);
        }
    }
}
