//! Noise model of sensor and attitude, and constants of the statistical model.

use nalgebra::{Matrix3, Vector3};

use super::prediction::FieldPrediction;
use crate::trig::sqrt;

/// Standard deviations of sensor and attitude, re-estimated from the residuals.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct NoiseModel {
    /// Norm residual, relative: sensor noise on each axis.
    pub norm_sigma: f32,
    /// Inclination residual, radians: sensor and attitude noise.
    pub inclination_sigma_rad: f32,
    /// `W` at the time of the estimate, maps sensor noise to the corrected field. A copy, so that the weights are
    /// constant during refinement.
    w: Matrix3<f32>,
}

/// Variances of the two residuals of a sample. Soft iron correlates them; the inclination residual minus `slope` times
/// the norm residual is uncorrelated with the norm residual.
#[derive(Clone, Debug)]
pub(in crate::calibration) struct ResidualCovariance {
    pub norm_variance: f32,
    /// Variance of the decorrelated inclination residual.
    pub inclination_variance: f32,
    pub decorrelation_slope: f32,
}

impl NoiseModel {
    /// Initial sigmas, wide enough for a poor starting point.
    pub const INITIAL: Self = Self {
        norm_sigma: 0.05,
        inclination_sigma_rad: 0.1,
        w: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    };

    pub fn new(norm_sigma: f32, inclination_sigma_rad: f32, w: Matrix3<f32>) -> Self {
        Self { norm_sigma, inclination_sigma_rad, w }
    }

    /// Attitude noise on each of roll and pitch, radians.
    pub fn attitude_sigma_rad(&self) -> f32 {
        sqrt((self.inclination_sigma_rad * self.inclination_sigma_rad - self.norm_sigma * self.norm_sigma).max(0.0))
    }

    /// Residual covariance from derivatives of norm and inclination by field, and of inclination by attitude.
    pub(in crate::calibration) fn covariance(
        &self,
        norm_derivative: &Vector3<f32>,
        inclination_derivative: &Vector3<f32>,
        attitude_derivatives: [f32; 2],
    ) -> ResidualCovariance {
        let (norm_derivative, inclination_derivative) =
            (self.w.tr_mul(norm_derivative), self.w.tr_mul(inclination_derivative));
        let sensor_variance = self.norm_sigma * self.norm_sigma;
        let norm_variance = sensor_variance * norm_derivative.norm_squared();
        let cross_covariance = sensor_variance * norm_derivative.dot(&inclination_derivative);
        let slope = cross_covariance / norm_variance;
        let tilt_variance = (self.inclination_sigma_rad * self.inclination_sigma_rad - sensor_variance).max(0.0);
        let [roll, pitch] = attitude_derivatives;
        // Next to the pole both derivatives by attitude vanish; the floor keeps the variance positive.
        let inclination_variance = sensor_variance * inclination_derivative.norm_squared()
            + tilt_variance * (roll * roll + pitch * pitch)
            - slope * cross_covariance;
        ResidualCovariance {
            norm_variance,
            inclination_variance: inclination_variance.max(0.01 * sensor_variance),
            decorrelation_slope: slope,
        }
    }

    /// Most likely sensor error for this gradient of the cost by the corrected field.
    pub fn likely_sensor_error(&self, field_gradient: &Vector3<f32>) -> Vector3<f32> {
        self.w.tr_mul(field_gradient) * (self.norm_sigma * self.norm_sigma)
    }

    /// Heading variance of one sample from its derivative by the corrected field. A tilt error rotates the heading by
    /// `tan(inclination)` times its component towards the field.
    pub fn heading_variance(&self, heading_derivative: &Vector3<f32>, prediction: &FieldPrediction) -> f32 {
        let tan_inclination = prediction.level_field.z / prediction.cos_inclination;
        let attitude = self.attitude_sigma_rad() * tan_inclination;
        self.w.tr_mul(heading_derivative).norm_squared() * self.norm_sigma * self.norm_sigma + attitude * attitude
    }
}

/// Constants of the model.
#[derive(Clone, Copy, Debug)]
pub struct ModelConfig {
    /// Whether the samples' attitude is used; without it only norm residuals are.
    pub uses_attitude: bool,
    /// Soft iron, 1 sigma of an element of the symmetric part of `W`, relative: 30 %, a poor airframe.
    pub soft_iron_sigma: f32,
    /// Mounting, 1 sigma of an element of the skew part of `W`, radians: 20 deg.
    pub mounting_sigma_rad: f32,
    /// Hard iron, 1 sigma, microtesla: three times the Earth's field.
    pub hard_iron_sigma_ut: f32,
    /// Known inclination, 1 sigma, radians: 1 deg, half of it the chart's error, the rest local anomalies.
    pub known_inclination_sigma_rad: f32,
    /// Given heading, 1 sigma, radians: 1 deg, a compass rose or a bearing compass.
    pub given_heading_sigma_rad: f32,
    /// Typical norm residual scale, counted as a few samples: a handful that fits by chance does not give a zero scale.
    pub typical_norm_sigma: f32,
    /// Typical inclination residual scale, radians.
    pub typical_inclination_sigma_rad: f32,
    /// Number of samples that the typical scales count as.
    pub typical_sigma_sample_weight: f32,
    /// Minimum norm residual scale: quantisation and linearity of the chip.
    pub min_norm_sigma: f32,
    /// Minimum inclination residual scale, radians: 0.05 deg.
    pub min_inclination_sigma_rad: f32,
    /// Maximum norm residual scale of an accepted fit: ten times a poor sensor's.
    pub max_norm_sigma: f32,
    /// Maximum inclination residual scale of an accepted fit, radians: 5 deg.
    pub max_inclination_sigma_rad: f32,
    /// Huber threshold, sigmas: larger residuals count linearly.
    pub huber_sigmas: f32,
}

impl ModelConfig {
    /// Values for airframes and sensors of UAVs, with attitude.
    pub const DEFAULT: Self = Self {
        uses_attitude: true,
        soft_iron_sigma: 0.3,
        mounting_sigma_rad: 0.35,
        hard_iron_sigma_ut: 150.0,
        known_inclination_sigma_rad: 0.0175,
        given_heading_sigma_rad: 0.0175,
        typical_norm_sigma: 0.004,
        typical_inclination_sigma_rad: 0.006,
        typical_sigma_sample_weight: 4.0,
        min_norm_sigma: 0.0005,
        min_inclination_sigma_rad: 0.0009,
        max_norm_sigma: 0.05,
        max_inclination_sigma_rad: 0.087,
        huber_sigmas: 2.0,
    };

    /// Configuration for samples that do not determine the mounting: the configured mounting is fixed within half a
    /// degree.
    pub const WITH_FIXED_MOUNTING: Self = Self { mounting_sigma_rad: 0.009, ..Self::DEFAULT };

    /// Configuration for tumbling on a bench, without attitude.
    pub const WITHOUT_ATTITUDE: Self = Self { uses_attitude: false, ..Self::WITH_FIXED_MOUNTING };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::model::ModelParameters;
    use crate::calibration::tests::derivatives::numerical_derivative;
    use crate::frames::{RollPitch, wrap_pi};

    const SKEWED: Matrix3<f32> = Matrix3::new(1.2, 0.1, -0.2, 0.3, 0.9, 0.1, -0.1, 0.2, 1.1);

    #[test]
    fn attitude_noise_is_inclination_noise_less_sensor_noise() {
        let share =
            |norm, inclination_sigma_rad| NoiseModel::new(norm, inclination_sigma_rad, SKEWED).attitude_sigma_rad();
        assert!((share(0.003, 0.005) - 0.004).abs() < 1e-7);
        assert_eq!(share(0.005, 0.003).to_bits(), 0);
    }

    /// The floor is a tenth of the sensor's sigma. It applies at the pole, where the attitude does not change the
    /// inclination, when norm and inclination depend on the same axis.
    #[test]
    fn inclination_variance_has_a_floor() {
        let noise = NoiseModel::new(0.01, 0.02, Matrix3::identity());
        let x = Vector3::new(1.0, 0.0, 0.0);
        let variance = noise.covariance(&x, &x, [0.0; 2]).inclination_variance;
        assert!((variance - 0.01 * 1e-4).abs() < 1e-9, "{variance}");
    }

    /// Reference: numerical derivatives by each sensor axis, roll and pitch, at zero pitch.
    #[test]
    fn heading_variance_equals_numerical_propagation() {
        let noise = NoiseModel::new(0.01, 0.02, SKEWED);
        let attitude_sigma_rad = noise.attitude_sigma_rad();
        let parameters =
            ModelParameters { w: SKEWED, corrected_mean_field: Vector3::new(0.1, 0.2, 0.1), inclination_rad: 0.0 };
        for (roll_rad, x) in [(0.3, Vector3::new(0.7, -0.3, 0.4)), (-0.5, Vector3::new(-0.2, 0.6, -0.8))] {
            let attitude = RollPitch { roll_rad, pitch_rad: 0.0 };
            let predict = |x, attitude: RollPitch| parameters.predict_field(x, &attitude.tilt_rotation());
            let reference = predict(x, attitude);
            let heading_change_rad =
                |perturbed: &FieldPrediction| wrap_pi(perturbed.heading_rad() - reference.heading_rad());
            let sensor = (0..3).map(|axis| {
                numerical_derivative(|step| heading_change_rad(&predict(x + Vector3::ith(axis, step), attitude)))
            });
            let roll = numerical_derivative(|step| {
                heading_change_rad(&predict(x, RollPitch { roll_rad: roll_rad + step, pitch_rad: 0.0 }))
            });
            let pitch =
                numerical_derivative(|step| heading_change_rad(&predict(x, RollPitch { roll_rad, pitch_rad: step })));
            let expected = sensor.map(|d| d * d).sum::<f32>() * 1e-4
                + (roll * roll + pitch * pitch) * attitude_sigma_rad * attitude_sigma_rad;
            let found =
                noise.heading_variance(&reference.heading_derivative_by_field(&attitude.tilt_rotation()), &reference);
            assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
        }
    }
}
