//! Error model of the autopilot's gyro.
//!
//! ```text
//! measured = (I + M) rate + offset + drift(t) + g-sensitivity * specific force + noise
//! ```
//!
//! The diagonal of `M` has the scale errors, its other elements the cross-axis sensitivities. Autopilots estimate and
//! subtract the zero-rate output of the chip; `offset` is the error of that estimate.
//!
//! | data sheet | scale | cross-axis | zero rate, deg/s | noise | g-sensitivity |
//! |---|---|---|---|---|---|
//! | MPU-6000 (PS-MPU-6000A rev. 3.4) | 3 % | 2 % | 20 | 0.005 deg/s/sqrt(Hz), 0.05 deg/s in 100 Hz | 0.1 deg/s/g |
//! | BMI270 (BST-BMI270-DS000 rev. 1.5) | 2 %, 0.4 % trimmed | - | 0.5 | 0.007 deg/s/sqrt(Hz) | - |
//! | ICM-42688-P (DS-000347) | 0.5 % | 1.25 % | 0.5 | 0.0028 deg/s/sqrt(Hz) | - |

use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

use super::gauss_markov::FirstOrderProcess;
use super::state::TrueState;
use crate::random::{RandomStream, StreamPurpose};

/// Standard deviations of the errors of a gyro; the seed draws one gyro of this class. The default is the class
/// `gyro-1`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GyroConfig {
    /// Standard deviation of the scale error of each axis and of each of the six cross-axis sensitivities, percent.
    pub scale_percent: f64,
    /// Remaining offset of each axis, degrees per second.
    pub offset_deg_s: f64,
    /// Standard deviation of the slow random change of the offset during a run, degrees per second.
    pub drift_deg_s: f64,
    /// Correlation time of that change, seconds.
    pub drift_time_s: f64,
    /// White noise of each reported rate, degrees per second.
    pub noise_deg_s: f64,
    /// Offset by specific force, degrees per second per g, for each pair of axes.
    pub g_sensitivity_deg_s: f64,
    /// Whether scale errors and offsets are exactly one standard deviation with a random sign, instead of normally
    /// distributed.
    pub exact: bool,
}

impl GyroConfig {
    /// A gyro without errors.
    pub const ERROR_FREE: Self = Self {
        scale_percent: 0.0,
        offset_deg_s: 0.0,
        drift_deg_s: 0.0,
        drift_time_s: 100.0,
        noise_deg_s: 0.0,
        g_sensitivity_deg_s: 0.0,
        exact: false,
    };
}

impl Default for GyroConfig {
    /// Between the sheets of the ICM-42688-P and the BMI270; noise of 0.007 deg/s/sqrt(Hz) in the 200 Hz that an
    /// autopilot's rate filter passes, in-run drift of a tenth of the offset, g-sensitivity of the MPU-6000 after the
    /// autopilot's estimate of the offset at 1 g.
    fn default() -> Self {
        Self {
            scale_percent: 1.0,
            offset_deg_s: 0.1,
            drift_deg_s: 0.01,
            noise_deg_s: 0.1,
            g_sensitivity_deg_s: 0.02,
            ..Self::ERROR_FREE
        }
    }
}

/// One gyro with its noise processes.
#[derive(Clone, Debug)]
pub(super) struct Gyro {
    error_matrix: Matrix3<f64>,
    offset_rad_s: Vector3<f64>,
    g_sensitivity_rad_s: Matrix3<f64>,
    drift_rad_s: [FirstOrderProcess; 3],
    noise_rad_s: f64,
    random: RandomStream,
}

impl Gyro {
    /// The gyro of a seed, read every `step_s`.
    pub fn new(config: GyroConfig, seed: u64, step_s: f64) -> Self {
        let mut random = RandomStream::new(seed, StreamPurpose::Gyro);
        let mut draw = |sigma: f64, is_exact: bool| {
            let normal = random.gaussian();
            sigma * if is_exact { normal.signum() } else { normal }
        };
        let error = Matrix3::from_fn(|_, _| draw(config.scale_percent / 100.0, config.exact));
        let offset_rad_s = Vector3::from_fn(|_, _| draw(config.offset_deg_s.to_radians(), config.exact));
        let g_sensitivity_rad_s = Matrix3::from_fn(|_, _| draw(config.g_sensitivity_deg_s.to_radians(), false));
        let drift = |purpose| {
            let sigma_rad_s = config.drift_deg_s.to_radians();
            FirstOrderProcess::new(sigma_rad_s, config.drift_time_s, step_s, RandomStream::new(seed, purpose))
        };
        Self {
            error_matrix: error,
            offset_rad_s,
            g_sensitivity_rad_s,
            drift_rad_s: [StreamPurpose::GyroDriftX, StreamPurpose::GyroDriftY, StreamPurpose::GyroDriftZ].map(drift),
            noise_rad_s: config.noise_deg_s.to_radians(),
            random,
        }
    }

    /// Measured body rates, radians per second. Each call advances the noise by one step.
    pub fn measure_rates(&mut self, truth: &TrueState) -> [f64; 3] {
        let rates = Vector3::from(truth.body_rates_rad_s());
        let drift = Vector3::from(self.drift_rad_s.each_mut().map(FirstOrderProcess::next_value));
        let noise = self.random.normal_vector() * self.noise_rad_s;
        let by_force = self.g_sensitivity_rad_s * specific_force_change_g(truth);
        (rates + self.error_matrix * rates + self.offset_rad_s + drift + by_force + noise).into()
    }
}

/// Specific force less that of level flight, g, body axes: a coordinated turn has `1 / cos(bank)` along the body's z
/// axis, and its offset at 1 g is part of the gyro's offset.
fn specific_force_change_g(truth: &TrueState) -> Vector3<f64> {
    let (pitch_sin, pitch_cos) = libm::sincos(truth.pitch_rad);
    let load = pitch_cos / libm::cos(truth.roll_rad).max(0.2);
    Vector3::new(pitch_sin, 0.0, 1.0 - load)
}

#[cfg(test)]
mod tests {
    use log_analysis::numbers::square;

    use super::*;

    const STEP_S: f64 = 0.02;

    /// Over 400 gyros at rest: the mean of a minute has the class's offset and drift, the differences its noise.
    #[test]
    fn a_gyro_has_the_offset_and_noise_of_its_class() {
        let config = GyroConfig::default();
        let (mut offsets, mut noise) = (0.0, 0.0);
        for seed in 0..400 {
            let mut gyro = Gyro::new(config, seed, STEP_S);
            let rates: Vec<f64> =
                (0..3000).map(|_| gyro.measure_rates(&TrueState::default())[2].to_degrees()).collect();
            let mean = rates.iter().sum::<f64>() / 3000.0;
            offsets += mean * mean / 400.0;
            noise += rates.windows(2).map(|pair| square(pair[1] - pair[0])).sum::<f64>() / (2.0 * 2999.0 * 400.0);
        }
        assert!((offsets.sqrt() - 0.1).abs() < 0.012, "{}", offsets.sqrt());
        assert!((noise.sqrt() - 0.1).abs() < 0.002, "{}", noise.sqrt());
    }
}
