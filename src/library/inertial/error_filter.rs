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

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector3};

use crate::trig::sqrt;

/// Number of errors.
const ERROR_COUNT: usize = 14;

/// First index of each kind; the tilt is at 0.
const GYRO_OFFSET: usize = 2;
const VELOCITY: usize = 5;
const ACCELEROMETER_OFFSET: usize = 8;
const GYRO_SCALE: usize = 11;

type ErrorVector = SVector<f32, ERROR_COUNT>;

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
    covariance: SMatrix<f32, ERROR_COUNT, ERROR_COUNT>,
}

impl ErrorFilter {
    pub fn new(variances: &ErrorVariances) -> Self {
        let variances = ErrorVector::from_fn(|i, _| variances.by_index(i));
        Self { mean: ErrorVector::zeros(), covariance: SMatrix::from_diagonal(&variances) }
    }

    /// Time update by a step with these variances of process noise.
    pub fn propagate(&mut self, step: &StepIntegrals, process_noise: &ErrorVariances) {
        let force = step.force_m_s;
        let tilt_to_velocity = SMatrix::<f32, 3, 2>::new(0.0, force.z, -force.z, 0.0, force.y, -force.x);
        // The velocity first: it grows with the tilt at the start of the step.
        self.propagate_block::<3, 2>(VELOCITY, 0, &tilt_to_velocity);
        self.propagate_block::<3, 3>(VELOCITY, ACCELEROMETER_OFFSET, &-step.rotation_s);
        if let Some([north_m_s, east_m_s]) = step.known_velocity_m_s {
            let turned = SMatrix::<f32, 2, 1>::new(-east_m_s, north_m_s) * step.rotation_s.fixed_rows::<1>(2);
            self.propagate_block::<2, 3>(VELOCITY, GYRO_OFFSET, &turned);
        }
        self.propagate_block::<2, 3>(0, GYRO_OFFSET, &-step.rotation_s.fixed_rows::<2>(0));
        self.propagate_block::<2, 3>(0, GYRO_SCALE, &-step.rotated_rates_rad.fixed_rows::<2>(0));
        for i in 0..ERROR_COUNT {
            self.covariance[(i, i)] += process_noise.by_index(i);
        }
    }

    /// `P <- (I + E) P (I + E)^T`, with `factor` as the block of `E` at rows `target` and columns `source`.
    fn propagate_block<const T: usize, const S: usize>(
        &mut self,
        target: usize,
        source: usize,
        factor: &SMatrix<f32, T, S>,
    ) {
        let rows = factor * self.covariance.fixed_rows::<S>(source);
        let mut target_rows = self.covariance.fixed_rows_mut::<T>(target);
        target_rows += rows;
        let columns = self.covariance.fixed_columns::<S>(source) * factor.transpose();
        let mut target_columns = self.covariance.fixed_columns_mut::<T>(target);
        target_columns += columns;
    }

    /// Measures the velocity: measured less estimated, and the variance of each axis.
    pub fn measure_velocity(&mut self, residual_m_s: &Vector3<f32>, variance: f32) {
        // Rounding makes the time update asymmetric; grown over minutes, that makes variances negative.
        self.covariance.fill_lower_triangle_with_upper_triangle();
        self.measure_states(VELOCITY, residual_m_s, variance);
    }

    /// Measures the gyro's offset: measured less estimated, and the variance of each axis.
    pub fn measure_gyro_offset(&mut self, residual_rad_s: &Vector3<f32>, variance: f32) {
        self.measure_states(GYRO_OFFSET, residual_rad_s, variance);
    }

    /// Makes the velocity unknown to this variance of each axis, independently of the other errors.
    pub fn reset_velocity(&mut self, variance: f32) {
        self.covariance.fixed_rows_mut::<3>(VELOCITY).fill(0.0);
        self.covariance.fixed_columns_mut::<3>(VELOCITY).fill(0.0);
        for i in VELOCITY..ACCELEROMETER_OFFSET {
            self.covariance[(i, i)] = variance;
        }
    }

    /// Measures three states, one after the other.
    fn measure_states(&mut self, first: usize, residuals: &Vector3<f32>, variance: f32) {
        for (index, residual) in (first..).zip(residuals) {
            self.measure_state(index, *residual, variance);
        }
    }

    fn measure_state(&mut self, index: usize, residual: f32, variance: f32) {
        let column: ErrorVector = self.covariance.column(index).into_owned();
        let predicted_variance = column[index];
        let innovation_variance = predicted_variance + variance;
        self.mean.axpy((residual - self.mean[index]) / innovation_variance, &column, 1.0);
        // Both factors of the product are the same, so that the covariance stays symmetric to the last bit.
        let scaled = column / sqrt(innovation_variance);
        let columns = self.covariance.as_mut_slice().chunks_exact_mut(ERROR_COUNT);
        for (column, factor) in columns.zip(scaled.as_slice()) {
            add_scaled(column, &scaled, -factor);
        }
        // The difference cancels for an accurate measurement.
        self.covariance[(index, index)] = predicted_variance * (variance / innovation_variance);
    }

    /// Returns the estimated errors, and sets them to zero.
    pub fn take_corrections(&mut self) -> Corrections {
        let mean = core::mem::replace(&mut self.mean, ErrorVector::zeros());
        let vector_at = |first| mean.fixed_rows::<3>(first).into_owned();
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
        self.covariance.fixed_view::<2, 2>(0, 0).into_owned()
    }

    /// Variance of a component of the velocity, (m/s)^2, mean of the three.
    pub fn velocity_variance(&self) -> f32 {
        (VELOCITY..ACCELEROMETER_OFFSET).map(|i| self.covariance[(i, i)]).sum::<f32>() / 3.0
    }

    /// Variance of the gyro's offset, (rad/s)^2, by axis.
    pub fn gyro_offset_variance(&self) -> Vector3<f32> {
        Vector3::from_fn(|axis, _| self.covariance[(GYRO_OFFSET + axis, GYRO_OFFSET + axis)])
    }
}

/// `column += factor * added`.
#[inline]
fn add_scaled(column: &mut [f32], added: &ErrorVector, factor: f32) {
    for (element, added) in column.iter_mut().zip(added.as_slice()) {
        *element += factor * added;
    }
}
