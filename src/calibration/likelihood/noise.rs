//! How wrong the measurements are.

use nalgebra::{Matrix3, Vector3};

use super::Prediction;

/// Standard deviations of sensor and attitude, re-estimated from the residuals.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct Noise {
    /// Of the norm residual, relative to the total field: the sensor's, on each axis.
    pub norm: f32,
    /// Of the dip residual, radians: the sensor's and the attitude's together.
    pub dip_rad: f32,
    /// `W` as it was when these were estimated: takes the sensor's noise to the corrected field. Kept, so that the
    /// weights stay what they are while the unknowns are refined.
    w: Matrix3<f32>,
}

/// Variances of the two residuals of a sample. The norm's noise is also in the dip's as far as soft iron skews it;
/// `slope` times the norm's residual is what must be taken out of the dip's to make them independent.
#[derive(Clone, Debug)]
pub(super) struct Covariance {
    pub norm: f32,
    /// Of the dip residual after that.
    pub dip: f32,
    pub slope: f32,
}

impl Noise {
    /// Before anything is known: wide enough for a bad start.
    pub const INITIAL: Self =
        Self { norm: 0.05, dip_rad: 0.1, w: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0) };

    pub fn new(norm: f32, dip_rad: f32, w: Matrix3<f32>) -> Self {
        Self { norm, dip_rad, w }
    }

    /// The attitude's share of the dip residual, radians, on each of roll and pitch.
    pub fn attitude_sigma_rad(&self) -> f32 {
        libm::sqrtf((self.dip_rad * self.dip_rad - self.norm * self.norm).max(0.0))
    }

    /// From the derivatives of norm and dip by the corrected field and of the dip by attitude.
    pub(super) fn covariance(
        &self,
        by_norm: &Vector3<f32>,
        by_dip: &Vector3<f32>,
        by_attitude: [f32; 2],
    ) -> Covariance {
        let (by_norm, by_dip) = (self.w.tr_mul(by_norm), self.w.tr_mul(by_dip));
        let sensor = self.norm * self.norm;
        let norm = sensor * by_norm.norm_squared();
        let common = sensor * by_norm.dot(&by_dip);
        let slope = common / norm;
        let tilt = (self.dip_rad * self.dip_rad - sensor).max(0.0);
        let [roll, pitch] = by_attitude;
        // At the pole both derivatives by attitude vanish; the floor keeps the variance positive.
        let dip = sensor * by_dip.norm_squared() + tilt * (roll * roll + pitch * pitch) - slope * common;
        Covariance { norm, dip: dip.max(0.01 * sensor), slope }
    }

    /// The most likely error of the measured field, given what the corrected field is asked to move by.
    pub fn sensor_move(&self, by_field: &Vector3<f32>) -> Vector3<f32> {
        self.w.tr_mul(by_field) * (self.norm * self.norm)
    }

    /// Variance of the heading of one sample, given its derivative by the corrected field. A tilt of the level frame
    /// turns the heading by `tan(dip)` times the tilt towards the field.
    pub fn heading_variance(&self, by_field: &Vector3<f32>, prediction: &Prediction) -> f32 {
        let tan_dip = prediction.level.z / prediction.horizontal;
        let attitude = self.attitude_sigma_rad() * tan_dip;
        self.w.tr_mul(by_field).norm_squared() * self.norm * self.norm + attitude * attitude
    }
}
