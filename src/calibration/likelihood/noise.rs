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

#[cfg(test)]
mod tests {
    use super::super::Parameters;
    use super::*;
    use crate::calibration::tests::derivatives::derivative;
    use crate::frames::{Attitude, wrap_pi};

    const SKEWED: Matrix3<f32> = Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1);

    /// The dip's noise is the sensor's and the attitude's; a dip that scatters by less than the norm shows no attitude
    /// noise.
    #[test]
    fn the_attitude_s_share_is_what_the_sensor_leaves() {
        let share = |norm, dip_rad| Noise::new(norm, dip_rad, SKEWED).attitude_sigma_rad();
        assert!((share(0.003, 0.005) - 0.004).abs() < 1e-7);
        assert_eq!(share(0.005, 0.003).to_bits(), 0);
    }

    /// At the pole, where attitude does not change the dip, and where norm and dip show the same axis' noise, a tenth
    /// of the sensor's sigma is left; away from it, what there is.
    #[test]
    fn a_dip_is_never_certain() {
        let noise = Noise::new(0.01, 0.02, Matrix3::identity());
        let x = Vector3::new(1.0, 0.0, 0.0);
        let dip = |by_dip: Vector3<f32>| noise.covariance(&x, &by_dip, [0.0; 2]).dip;
        assert!((dip(x) - 0.01 * 1e-4).abs() < 1e-9);
        assert!((dip(Vector3::new(1.0, 0.09, 0.0)) - 0.01 * 1e-4).abs() < 1e-9);
        assert!((dip(Vector3::new(1.0, 0.11, 0.0)) - 0.0121 * 1e-4).abs() < 1e-9);
    }

    /// A corrected field that should move by `v` was most likely measured wrong by `sigma^2 W^T v`: the more along axes
    /// that `W` stretches.
    #[test]
    fn the_sensor_moves_where_it_is_most_likely_wrong() {
        let noise = Noise::new(0.1, 0.2, SKEWED);
        let v = Vector3::new(1.0, -2.0, 3.0);
        assert!((noise.sensor_move(&v) - SKEWED.transpose() * v * 0.01).norm() < 1e-6);
    }

    /// The heading's variance is that of the noise of each axis of the sensor and of roll and pitch, by the differences
    /// that they make; at no pitch, where roll and pitch turn about level axes.
    #[test]
    fn a_heading_s_variance_is_what_noise_does_to_it() {
        let noise = Noise::new(0.01, 0.02, SKEWED);
        let attitude_sigma_rad = noise.attitude_sigma_rad();
        let parameters = Parameters { w: SKEWED, d: Vector3::new(0.1, 0.2, 0.1), inclination_rad: 0.0 };
        for (roll_rad, x) in [(0.3, Vector3::new(0.7, -0.3, 0.4)), (-0.5, Vector3::new(-0.2, 0.6, -0.8))] {
            let attitude = Attitude { roll_rad, pitch_rad: 0.0 };
            let predict = |x, attitude: Attitude| parameters.predict(x, &attitude.tilt());
            let here = predict(x, attitude);
            let turned = |there: &Prediction| wrap_pi(there.heading_rad() - here.heading_rad());
            let sensor = (0..3).map(|axis| derivative(|step| turned(&predict(x + Vector3::ith(axis, step), attitude))));
            let roll = derivative(|step| turned(&predict(x, Attitude { roll_rad: roll_rad + step, pitch_rad: 0.0 })));
            let pitch = derivative(|step| turned(&predict(x, Attitude { roll_rad, pitch_rad: step })));
            let expected = sensor.map(|d| d * d).sum::<f32>() * 1e-4
                + (roll * roll + pitch * pitch) * attitude_sigma_rad * attitude_sigma_rad;
            let found = noise.heading_variance(&here.heading_by_field(&attitude.tilt()), &here);
            assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
        }
    }
}
