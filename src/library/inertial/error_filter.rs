//! Kalman filter of the attitude filter's errors.
//!
//! The errors are true less estimated values: tilt about the horizontal axes of the navigation frame, offset of the
//! gyro, velocity (navigation frame), offset of the accelerometer, relative scale of the gyro. With the rotation `R`
//! from body to navigation frame, the body rates `w` and the specific force `f` (navigation frame):
//!
//! ```text
//! tilt'     = -(R (gyro_offset + diag(w) scale))_xy
//! velocity' = tilt x f - R accelerometer_offset + (R gyro_offset)_z z x v
//! ```
//!
//! The last term, with a known velocity `v`: the navigation frame turns with the gyro's error about the vertical.

use nalgebra::{Matrix2, Matrix3, Vector3};

/// Number of errors.
const ERROR_COUNT: usize = 14;

/// First index of each kind; the tilt is at 0.
const GYRO_OFFSET: usize = 2;
const VELOCITY: usize = 5;
const ACCELEROMETER_OFFSET: usize = 8;
const GYRO_SCALE: usize = 11;

type ErrorVector = [f32; ERROR_COUNT];

/// Estimated errors, to be added to the estimates. The tilt has no component about the vertical.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Corrections {
    pub tilt_rad: Vector3<f32>,
    pub gyro_offset_rad_s: Vector3<f32>,
    pub velocity_m_s: Vector3<f32>,
    pub accelerometer_offset_m_s2: Vector3<f32>,
    pub gyro_scale: Vector3<f32>,
}

/// Variances of the errors, one for each kind.
#[derive(Clone, Copy, Debug)]
pub(super) struct ErrorVariances {
    pub tilt: f32,
    pub gyro_offset: f32,
    pub velocity: f32,
    pub accelerometer_offset: f32,
    pub gyro_scale: f32,
}

impl ErrorVariances {
    const fn by_index(&self, index: usize) -> f32 {
        match index {
            ..GYRO_OFFSET => self.tilt,
            GYRO_OFFSET..VELOCITY => self.gyro_offset,
            VELOCITY..ACCELEROMETER_OFFSET => self.velocity,
            ACCELEROMETER_OFFSET..GYRO_SCALE => self.accelerometer_offset,
            _ => self.gyro_scale,
        }
    }
}

/// Integrals over a step of the factors in the errors' differential equations.
#[derive(Clone, Copy, Debug)]
pub(super) struct StepIntegrals {
    /// Rotation from body to navigation frame, s.
    pub rotation_s: Matrix3<f32>,
    /// Rotation times diagonal body rates, rad.
    pub rotated_rates_rad: Matrix3<f32>,
    /// Specific force, navigation frame, m/s.
    pub force_m_s: Vector3<f32>,
    /// Horizontal velocity, navigation frame, m/s, if it is known.
    pub known_velocity_m_s: Option<[f32; 2]>,
}

/// Error-state Kalman filter. The mean is zero between two steps.
#[derive(Clone, Debug)]
pub(super) struct ErrorFilter {
    mean: ErrorVector,
    /// Symmetric to the last bit.
    covariance: [ErrorVector; ERROR_COUNT],
}

impl ErrorFilter {
    pub fn new(variances: &ErrorVariances) -> Self {
        let mut filter = Self { mean: [0.0; ERROR_COUNT], covariance: [[0.0; ERROR_COUNT]; ERROR_COUNT] };
        filter.add_process_noise(variances);
        filter
    }

    /// Time update by a step with these variances of process noise.
    pub fn propagate(&mut self, step: &StepIntegrals, process_noise: &ErrorVariances) {
        let force = step.force_m_s;
        let velocity_by_tilt = [[0.0, force.z], [-force.z, 0.0], [force.y, -force.x]];
        let row =
            |matrix: &Matrix3<f32>, axis: usize, factor: f32| [0, 1, 2].map(|column| matrix[(axis, column)] * factor);
        let by_turn = step.known_velocity_m_s.map_or([0.0; 3], |[north_m_s, east_m_s]| [-east_m_s, north_m_s, 0.0]);
        // The velocity first: it grows with the tilt at the start of the step.
        for (axis, (by_tilt, by_turn)) in velocity_by_tilt.iter().zip(by_turn).enumerate() {
            let by_force = row(&step.rotation_s, axis, -1.0);
            let by_gyro = row(&step.rotation_s, 2, by_turn);
            self.add_states(
                VELOCITY + axis,
                &[(0, by_tilt), (ACCELEROMETER_OFFSET, &by_force), (GYRO_OFFSET, &by_gyro)],
            );
        }
        for axis in 0..2 {
            let by_offset = row(&step.rotation_s, axis, -1.0);
            let by_scale = row(&step.rotated_rates_rad, axis, -1.0);
            self.add_states(axis, &[(GYRO_OFFSET, &by_offset), (GYRO_SCALE, &by_scale)]);
        }
        self.add_process_noise(process_noise);
    }

    fn add_process_noise(&mut self, variances: &ErrorVariances) {
        for (index, row) in self.covariance.iter_mut().enumerate() {
            row[index] += variances.by_index(index);
        }
    }

    /// Adds other states to one, each times its factor: `x_target += sum_i factor_i x_(source + i)`, summed over the terms
    /// `(source, factors)`.
    fn add_states(&mut self, target: usize, terms: &[(usize, &[f32])]) {
        let mut row = self.covariance[target];
        for (source, factors) in terms {
            for (source_row, factor) in self.covariance[*source..].iter().zip(*factors) {
                add_scaled(&mut row, source_row, *factor);
            }
        }
        // So far the covariances of the new value with the old ones.
        let sum_of = |(source, factors): &(usize, &[f32])| -> f32 {
            row[*source..].iter().zip(*factors).map(|(covariance, factor)| covariance * factor).sum()
        };
        row[target] += terms.iter().map(sum_of).sum::<f32>();
        for (other, element) in self.covariance.iter_mut().zip(row) {
            other[target] = element;
        }
        self.covariance[target] = row;
    }

    /// Measures the velocity: measured less estimated, and the variance of each axis.
    pub fn measure_velocity(&mut self, residual_m_s: &Vector3<f32>, variance: f32) {
        self.measure_states(VELOCITY, residual_m_s, variance);
    }

    /// Measures the gyro's offset: measured less estimated, and the variance of each axis.
    pub fn measure_gyro_offset(&mut self, residual_rad_s: &Vector3<f32>, variance: f32) {
        self.measure_states(GYRO_OFFSET, residual_rad_s, variance);
    }

    /// Makes the tilt unknown to this variance of each axis, independently of the other errors.
    pub fn reset_tilt(&mut self, variance: f32) {
        (0..GYRO_OFFSET).for_each(|index| self.reset_state(index, variance));
    }

    /// Makes the gyro's offset unknown to these variances, independently of the other errors.
    pub fn reset_gyro_offset(&mut self, variances: [f32; 3]) {
        (GYRO_OFFSET..).zip(variances).for_each(|(index, variance)| self.reset_state(index, variance));
    }

    /// Makes the velocity unknown to this variance of each axis, independently of the other errors.
    pub fn reset_velocity(&mut self, variance: f32) {
        (VELOCITY..ACCELEROMETER_OFFSET).for_each(|index| self.reset_state(index, variance));
    }

    fn reset_state(&mut self, index: usize, variance: f32) {
        self.covariance.iter_mut().for_each(|row| row[index] = 0.0);
        self.covariance[index] = [0.0; ERROR_COUNT];
        self.covariance[index][index] = variance;
    }

    /// Measures three states, one after the other, in the lower half of the covariance, which is then the upper one, too.
    fn measure_states(&mut self, first: usize, residuals: &Vector3<f32>, variance: f32) {
        for (index, residual) in (first..).zip(residuals) {
            self.measure_state(index, *residual, variance);
        }
        for row in 1..ERROR_COUNT {
            for column in 0..row {
                self.covariance[column][row] = self.covariance[row][column];
            }
        }
    }

    /// Measures a state in the lower half of the covariance.
    fn measure_state(&mut self, index: usize, residual: f32, variance: f32) {
        let column: ErrorVector = core::array::from_fn(|other| self.covariance[index.max(other)][index.min(other)]);
        let predicted_variance = column[index];
        let innovation_variance = predicted_variance + variance;
        let gain = (residual - self.mean[index]) / innovation_variance;
        add_scaled(&mut self.mean, &column, gain);
        let scale = -1.0 / innovation_variance;
        for (row_index, (row, covariance)) in self.covariance.iter_mut().zip(column).enumerate() {
            add_scaled(&mut row[..=row_index], &column, scale * covariance);
        }
        // The difference cancels for an accurate measurement.
        self.covariance[index][index] = predicted_variance * (variance / innovation_variance);
    }

    /// Returns the estimated errors, and sets them to zero.
    pub fn take_corrections(&mut self) -> Corrections {
        let mean = core::mem::replace(&mut self.mean, [0.0; ERROR_COUNT]);
        let vector_at = |first: usize| Vector3::from_fn(|axis, _| mean[first + axis]);
        Corrections {
            tilt_rad: Vector3::new(mean[0], mean[1], 0.0),
            gyro_offset_rad_s: vector_at(GYRO_OFFSET),
            velocity_m_s: vector_at(VELOCITY),
            accelerometer_offset_m_s2: vector_at(ACCELEROMETER_OFFSET),
            gyro_scale: vector_at(GYRO_SCALE),
        }
    }

    /// Covariance of the tilt about the navigation frame's horizontal axes, rad^2.
    pub fn tilt_covariance(&self) -> Matrix2<f32> {
        Matrix2::from_fn(|row, column| self.covariance[row][column])
    }

    /// Variance of the accelerometer's horizontal offset, both axes, (m/s^2)^2: of all axes but the one known best, which
    /// gravity shows. Where no axis of the sensor is vertical it is too large.
    pub fn horizontal_offset_variance(&self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|axis| self.covariance[ACCELEROMETER_OFFSET + axis][ACCELEROMETER_OFFSET + axis]);
        x + y + z - x.min(y).min(z)
    }

    /// Variance of a component of the velocity, (m/s)^2, mean of the three.
    pub fn velocity_variance(&self) -> f32 {
        (VELOCITY..ACCELEROMETER_OFFSET).map(|i| self.covariance[i][i]).sum::<f32>() / 3.0
    }

    /// Variance of the gyro's offset, (rad/s)^2, by axis.
    pub fn gyro_offset_variance(&self) -> Vector3<f32> {
        Vector3::from_fn(|axis, _| self.covariance[GYRO_OFFSET + axis][GYRO_OFFSET + axis])
    }
}

/// `row += factor * added`, over the shorter length. Of one length known at compile time it takes a third longer.
#[inline(never)]
fn add_scaled(row: &mut [f32], added: &[f32], factor: f32) {
    for (element, added) in row.iter_mut().zip(added) {
        *element += factor * added;
    }
}
