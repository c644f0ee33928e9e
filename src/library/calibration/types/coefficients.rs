//! Mounting and prior knowledge, the twelve deviation coefficients and motor-current interference, and their application.

use nalgebra::{Matrix3, Vector3};

use super::samples::{Sample, Samples};
use crate::calibration::linear_algebra::matrix_rows;
use crate::frames::{Body, Field, Level, Sensor};
use crate::trig;
use crate::trig::sqrt;

/// The twelve deviation coefficients and the Earth field of the fit.
///
/// Liu 2007 eq. 8 solved for the field: `h_body = W (m - b)`, `W = A^-1`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Calibration {
    /// `W`, row-major, dimensionless, determinant 1: maps the field minus hard iron from chip axes to the body frame.
    /// Contains soft iron, scale, non-orthogonality and mounting.
    pub w: [[f32; 3]; 3],
    /// `b`, microtesla, chip axes: hard iron and zero offset at zero motor current.
    pub b_ut: [f32; 3],
    /// Inclination of the Earth field of the fit, radians, positive down.
    pub inclination_rad: f32,
    /// Strength of the corrected field in the scale of `w`, microtesla.
    pub total_ut: f32,
    /// Attitude latency beyond the nominal latency of the attitude source, seconds; 0 if not applied.
    pub latency_s: f32,
    /// Motor-current interference in the measured field.
    pub motor_current: MotorCurrentInterference,
}

impl Calibration {
    /// Calibration with the mounting only: no hard iron, no soft iron.
    #[must_use]
    pub fn uncalibrated(mount: Orientation) -> Self {
        let rotation = mount.body_from_sensor();
        Self {
            w: matrix_rows(&rotation),
            b_ut: [0.0; 3],
            inclination_rad: 0.0,
            total_ut: 0.0,
            latency_s: 0.0,
            motor_current: MotorCurrentInterference::NO_INTERFERENCE,
        }
    }

    /// `W` as a matrix.
    #[must_use]
    pub fn w_matrix(&self) -> Matrix3<f32> {
        Matrix3::from_fn(|row, column| self.w[row][column])
    }

    /// `b` as a vector, microtesla.
    #[must_use]
    pub fn b_vector_ut(&self) -> Vector3<f32> {
        Vector3::from(self.b_ut)
    }

    /// Corrected field in the body frame, `W (m - b)` (Liu 2007 eq. 8), microtesla. The motor-current interference must
    /// already be removed.
    #[must_use]
    #[inline]
    pub fn calibrated_field(&self, sensor: Field<Sensor>) -> Field<Body> {
        let from_b = sensor.ut - self.b_vector_ut();
        // Scalar expressions: on a Cortex-M4 they compile to straight-line code.
        let [x, y, z] = self.w.map(|[wx, wy, wz]| wx * from_b.x + wy * from_b.y + wz * from_b.z);
        Field::from_ut(x, y, z)
    }

    /// Corrected field of a sample in the level frame, microtesla, with attitude latency and motor current compensated.
    #[must_use]
    pub fn corrected_level_field(&self, sample: &Sample) -> Field<Level> {
        sample.latency_compensated_attitude(self.latency_s).to_level_frame(self.corrected_body_field(sample))
    }

    /// Whether all coefficients are finite: check for data from flash or from a solver.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.w.as_flattened().iter().chain(&self.b_ut).all(|component| component.is_finite())
            && [self.inclination_rad, self.total_ut, self.latency_s].iter().all(|number| number.is_finite())
            && self.motor_current.is_finite()
    }

    /// Whether an attitude latency is applied.
    #[must_use]
    pub fn uses_latency(&self) -> bool {
        self.latency_s != 0.0
    }

    /// Field without motor-current interference, chip axes.
    #[must_use]
    #[inline]
    pub fn remove_motor_current(&self, field: Field<Sensor>, current_a: Option<f32>) -> Field<Sensor> {
        Field::new(field.ut - self.motor_current.interference_ut(current_a))
    }

    /// Heading variance, square radians, from unknown current or interference beyond the covariance of the
    /// coefficients, on one axis of the horizontal field.
    #[must_use]
    pub fn motor_current_heading_variance_rad2(&self, current_a: Option<f32>) -> f32 {
        let horizontal_ut = self.total_ut * trig::sin_cos(self.inclination_rad).1;
        let variance_ut2 = self.motor_current.variance_beyond_covariance_ut2(current_a);
        if variance_ut2 > 0.0 { variance_ut2 / (horizontal_ut * horizontal_ut) } else { 0.0 }
    }

    /// Corrected field of a sample in the body frame, microtesla, without motor-current interference.
    #[must_use]
    #[inline]
    pub fn corrected_body_field(&self, sample: &Sample) -> Field<Body> {
        self.calibrated_field(self.remove_motor_current(sample.field, sample.current.amperes()))
    }
}

/// Largest plausible current, relative to the highest of the calibration: a copter's full throttle is five times hover.
const MAX_CURRENT_RATIO: f32 = 5.0;

/// At most one of this many samples may lack a current.
const MIN_SAMPLES_PER_MISSING_CURRENT: usize = 4;

/// Motor-current interference, and the distribution of the currents it was estimated from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MotorCurrentInterference {
    /// `k`, uT/A, chip axes; zero if not applied.
    pub ut_per_a: [f32; 3],
    /// Standard deviation of an axis of `k`, uT/A; 0 without currents.
    pub sigma_ut_per_a: f32,
    /// Mean current of the samples, amperes.
    pub mean_current_a: f32,
    /// Standard deviation of the current, amperes; 0 without currents.
    pub current_sigma_a: f32,
}

impl MotorCurrentInterference {
    /// No interference.
    pub const NO_INTERFERENCE: Self =
        Self { ut_per_a: [0.0; 3], sigma_ut_per_a: 0.0, mean_current_a: 0.0, current_sigma_a: 0.0 };

    pub(in crate::calibration) fn from_samples(samples: Samples<'_>) -> Self {
        let currents = || samples.all_samples().filter_map(|sample| sample.current.amperes());
        let known_count = currents().count();
        if known_count * MIN_SAMPLES_PER_MISSING_CURRENT
            < samples.all_samples().count() * (MIN_SAMPLES_PER_MISSING_CURRENT - 1)
            || known_count == 0
        {
            return Self::NO_INTERFERENCE;
        }
        let mean_a = currents().sum::<f32>() / known_count as f32;
        let variance =
            currents().map(|amperes| (amperes - mean_a) * (amperes - mean_a)).sum::<f32>() / known_count as f32;
        Self { mean_current_a: mean_a, current_sigma_a: sqrt(variance), ..Self::NO_INTERFERENCE }
    }

    /// Whether an interference is applied.
    #[must_use]
    pub fn is_applied(&self) -> bool {
        self.ut_per_a.iter().any(|axis| *axis != 0.0)
    }

    /// Whether the aircraft of the samples can draw this current; a larger one is an error of the report.
    #[must_use]
    pub fn is_plausible_current(&self, current_a: f32) -> bool {
        let highest_a = self.mean_current_a.abs() + 2.0 * self.current_sigma_a;
        self.sigma_ut_per_a == 0.0 || current_a.abs() <= MAX_CURRENT_RATIO * highest_a
    }

    /// Interference of a current, microtesla, chip axes; of the mean current if unknown.
    #[must_use]
    pub fn interference_ut(&self, current_a: Option<f32>) -> Vector3<f32> {
        Vector3::from(self.ut_per_a) * current_a.unwrap_or(self.mean_current_a)
    }

    /// Current minus the mean, amperes; 0 if unknown.
    pub(in crate::calibration) fn current_deviation_a(&self, sample: &Sample) -> f32 {
        sample.current.amperes().map_or(0.0, |amperes| amperes - self.mean_current_a)
    }

    /// Field variance on an axis, square microtesla, not covered by the covariance of the coefficients: at currents
    /// beyond the samples' spread, and at unknown current.
    pub(super) fn variance_beyond_covariance_ut2(&self, current_a: Option<f32>) -> f32 {
        let current_variance_a2 = self.current_sigma_a * self.current_sigma_a;
        match current_a {
            Some(amperes) => {
                let deviation_a = amperes - self.mean_current_a;
                self.sigma_ut_per_a * self.sigma_ut_per_a * (deviation_a * deviation_a - current_variance_a2).max(0.0)
            }
            None => Vector3::from(self.ut_per_a).norm_squared() * current_variance_a2,
        }
    }

    pub(in crate::calibration) fn is_finite(&self) -> bool {
        self.ut_per_a
            .iter()
            .chain(&[self.sigma_ut_per_a, self.mean_current_a, self.current_sigma_a])
            .all(|number| number.is_finite())
    }
}

/// Mounting of the chip: one of the 24 right-angle rotations from chip to body axes.
///
/// Names and meaning as in MAVLink's `MAV_SENSOR_ORIENTATION`: yaw, then pitch, then roll (Euler ZYX). Of two MAVLink
/// names for one rotation the lower number is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Orientation(u8);

/// Names of the orientations, with roll, pitch and yaw in quarter turns.
const ORIENTATION_TABLE: [(&str, [u8; 3]); 24] = [
    ("none", [0, 0, 0]),
    ("yaw90", [0, 0, 1]),
    ("yaw180", [0, 0, 2]),
    ("yaw270", [0, 0, 3]),
    ("roll180", [2, 0, 0]),
    ("roll180-yaw90", [2, 0, 1]),
    ("pitch180", [0, 2, 0]),
    ("roll180-yaw270", [2, 0, 3]),
    ("roll90", [1, 0, 0]),
    ("roll90-yaw90", [1, 0, 1]),
    ("roll270", [3, 0, 0]),
    ("roll270-yaw90", [3, 0, 1]),
    ("pitch90", [0, 1, 0]),
    ("pitch270", [0, 3, 0]),
    ("roll90-pitch90", [1, 1, 0]),
    ("roll180-pitch90", [2, 1, 0]),
    ("roll270-pitch90", [3, 1, 0]),
    ("roll90-pitch180", [1, 2, 0]),
    ("roll270-pitch180", [3, 2, 0]),
    ("roll90-pitch270", [1, 3, 0]),
    ("roll180-pitch270", [2, 3, 0]),
    ("roll270-pitch270", [3, 3, 0]),
    ("roll90-pitch180-yaw90", [1, 2, 1]),
    ("roll90-yaw270", [1, 0, 3]),
];

impl Orientation {
    /// Chip axes equal to body axes.
    pub const IDENTITY_ROTATION: Self = Self(0);

    /// Number of orientations.
    pub const ORIENTATION_COUNT: u8 = 24;

    /// Orientation with a number, as stored; [invalid](Self::is_valid) from [`ORIENTATION_COUNT`](Self::ORIENTATION_COUNT) on.
    #[must_use]
    pub const fn from_number(number: u8) -> Self {
        Self(number)
    }

    /// Number in MAVLink order.
    #[must_use]
    pub const fn number(self) -> u8 {
        self.0
    }

    /// All 24 orientations, in MAVLink order.
    pub fn all_orientations() -> impl Iterator<Item = Self> {
        (0..Self::ORIENTATION_COUNT).map(Self)
    }

    /// Parses the output of [`orientation_name`](Self::orientation_name).
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::all_orientations().find(|orientation| orientation.orientation_name() == name)
    }

    /// Lower-case name, for example `roll180-yaw90`.
    #[must_use]
    pub fn orientation_name(self) -> &'static str {
        self.table_entry().0
    }

    /// Rotation from chip to body axes.
    #[must_use]
    pub fn body_from_sensor(self) -> Matrix3<f32> {
        let [roll, pitch, yaw] = self.table_entry().1.map(quarter_turn_sin_cos);
        let about_x = Matrix3::new(1.0, 0.0, 0.0, 0.0, roll.1, -roll.0, 0.0, roll.0, roll.1);
        let about_y = Matrix3::new(pitch.1, 0.0, pitch.0, 0.0, 1.0, 0.0, -pitch.0, 0.0, pitch.1);
        let about_z = Matrix3::new(yaw.1, -yaw.0, 0.0, yaw.0, yaw.1, 0.0, 0.0, 0.0, 1.0);
        about_z * about_y * about_x
    }

    /// Orientation nearest to a matrix `W` from chip to body axes: the largest `trace(R^T W)`.
    #[must_use]
    pub fn nearest_to_rotation(w: &Matrix3<f32>) -> Self {
        let similarity = |orientation: &Self| orientation.body_from_sensor().component_mul(w).sum();
        Self::all_orientations()
            .max_by(|a, b| similarity(a).total_cmp(&similarity(b)))
            .unwrap_or(Self::IDENTITY_ROTATION)
    }

    fn table_entry(self) -> (&'static str, [u8; 3]) {
        // Data from flash may hold any number; `is_valid` rejects those past the end, which read as the last entry.
        ORIENTATION_TABLE[usize::from(self.0).min(ORIENTATION_TABLE.len() - 1)]
    }

    /// Whether the number is one of the 24: check for data from flash.
    #[must_use]
    pub fn is_valid(self) -> bool {
        usize::from(self.0) < ORIENTATION_TABLE.len()
    }
}

/// Sine and cosine of quarter turns, exact.
fn quarter_turn_sin_cos(turns: u8) -> (f32, f32) {
    match turns % 4 {
        0 => (0.0, 1.0),
        1 => (1.0, 0.0),
        2 => (0.0, -1.0),
        _ => (-1.0, 0.0),
    }
}

/// Mounting, inclination and averaging, as known before a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Mounting of the sensor.
    pub mount: Orientation,
    /// Inclination of the local Earth field, radians, positive down, if known.
    pub inclination_rad: Option<f32>,
    /// Whether the inclination is that of a field model: samples that contradict it are solved without it.
    pub is_inclination_modelled: bool,
    /// Number of sensor readings averaged in each sample.
    pub readings_per_sample: u16,
}

/// Sensor aligned with the body, unknown field, single readings.
impl Default for Prior {
    fn default() -> Self {
        Self {
            mount: Orientation::IDENTITY_ROTATION,
            inclination_rad: None,
            is_inclination_modelled: false,
            readings_per_sample: 1,
        }
    }
}

#[cfg(test)]
mod motor_current_tests {
    use super::*;

    /// Full throttle of a copter is five times hover; ten times is an error of the report.
    #[test]
    fn a_current_far_beyond_those_of_the_calibration_is_implausible() {
        for mean_current_a in [10.0, -10.0] {
            let known = MotorCurrentInterference {
                sigma_ut_per_a: 0.1,
                mean_current_a,
                current_sigma_a: 2.0,
                ..MotorCurrentInterference::NO_INTERFERENCE
            };
            for sign in [1.0, -1.0] {
                assert!(known.is_plausible_current(sign * 50.0) && !known.is_plausible_current(sign * 100.0));
            }
        }
        let without_currents = MotorCurrentInterference::NO_INTERFERENCE;
        assert!(without_currents.is_plausible_current(500.0), "there are no currents to compare with");
    }
}

#[cfg(test)]
mod orientation_tests {
    use super::*;

    /// A repeated entry would make another mounting impossible to configure.
    #[test]
    fn all_24_rotations_are_proper_and_distinct() {
        for a in Orientation::all_orientations() {
            let rotation = a.body_from_sensor();
            assert!((rotation.determinant() - 1.0).abs() < f32::EPSILON, "{}", a.orientation_name());
            assert_eq!(Orientation::nearest_to_rotation(&rotation), a);
            for b in Orientation::all_orientations().filter(|&b| b != a) {
                assert_ne!(rotation, b.body_from_sensor(), "{} = {}", a.orientation_name(), b.orientation_name());
            }
        }
    }

    #[test]
    fn orientation_names_round_trip() {
        for orientation in Orientation::all_orientations() {
            assert_eq!(Orientation::from_name(orientation.orientation_name()), Some(orientation));
        }
        assert_eq!(Orientation::from_name("upside-down"), None);
    }

    /// Rotations are compared with nalgebra's ZYX angles.
    #[test]
    fn names_describe_the_rotation() {
        for orientation in Orientation::all_orientations() {
            let turned_deg = |axis: &str| -> f32 {
                let part = orientation.orientation_name().split('-').find_map(|part| part.strip_prefix(axis));
                part.map_or(0.0, |degrees| degrees.parse().unwrap())
            };
            let [roll, pitch, yaw] = ["roll", "pitch", "yaw"].map(|axis| turned_deg(axis).to_radians());
            let expected = nalgebra::Rotation3::from_euler_angles(roll, pitch, yaw);
            let difference = (orientation.body_from_sensor() - expected.matrix()).norm();
            assert!(difference < 1e-6, "{}: {difference}", orientation.orientation_name());
        }
    }

    #[test]
    fn a_mounting_20_deg_off_is_the_nearest_still() {
        for orientation in Orientation::all_orientations() {
            for (x, y, z) in [(0.35, 0.0, 0.0), (0.0, -0.35, 0.0), (0.0, 0.0, 0.35), (-0.2, 0.2, 0.2)] {
                let misalignment = nalgebra::Rotation3::new(Vector3::new(x, y, z));
                assert_eq!(
                    Orientation::nearest_to_rotation(&(misalignment * orientation.body_from_sensor())),
                    orientation
                );
            }
        }
    }

    #[test]
    fn orientation_numbers_from_24_on_are_invalid() {
        assert_eq!(Orientation::all_orientations().filter(|o| o.is_valid()).count(), 24);
        assert!(!Orientation(24).is_valid() && !Orientation(255).is_valid());
        assert_eq!(Orientation(255).orientation_name(), "roll90-yaw270");
        assert_eq!(Orientation::IDENTITY_ROTATION.body_from_sensor(), Matrix3::identity());
        assert_eq!(Orientation::default(), Orientation::IDENTITY_ROTATION);
    }
}
