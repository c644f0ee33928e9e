//! Constants of the statistical model.

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
