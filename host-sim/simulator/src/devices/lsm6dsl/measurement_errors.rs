//! Errors of a chip, drawn by a seed: standard deviations are the typical values of the data sheet's table 3, or of
//! another maker where ST is silent.

use autoswing::inertial::GRAVITY_M_S2;
use log_analysis::numbers::f32_as_f64;
use nalgebra::{Matrix3, Vector3};

use crate::random::{RandomStream, StreamPurpose};

/// Zero-rate level, deg/s, and its change with temperature, deg/s/K.
const ZERO_RATE_DEG_S: f64 = 3.0;
const ZERO_RATE_DEG_S_PER_K: f64 = 0.015;

/// Zero-g level, g, and its change with temperature, g/K.
const ZERO_G: f64 = 0.04;
const ZERO_G_PER_K: f64 = 1e-4;

/// Sensitivity tolerance of both sensors, relative.
const SCALE: f64 = 0.01;

/// Cross-axis sensitivity, relative: 2 % at most in the MPU-6000 (PS-MPU-6000A rev. 3.4).
const CROSS_AXIS: f64 = 0.01;

/// Offset of the gyro by specific force, deg/s/g: the MPU-6000's.
const G_SENSITIVITY_DEG_S_PER_G: f64 = 0.1;

/// Noise densities in high-performance mode: 4 mdps/sqrt(Hz), and 90 ug/sqrt(Hz) at 8 g.
const RATE_NOISE_DEG_S: f64 = 0.004;
const FORCE_NOISE_G: f64 = 90e-6;

/// Temperature of the zero levels, degrees Celsius.
const REFERENCE_TEMPERATURE_C: f64 = 25.0;

/// Errors of the three axes of one sensor.
struct TriadErrors {
    matrix: Matrix3<f64>,
    offset: Vector3<f64>,
    offset_per_k: Vector3<f64>,
    noise_density: f64,
}

impl TriadErrors {
    fn new(random: &mut RandomStream, scale: f64, offset: f64, offset_per_k: f64, noise_density: f64) -> Self {
        let mut matrix = Matrix3::from_fn(|_, _| scale * CROSS_AXIS * random.gaussian());
        matrix.set_diagonal(&(random.normal_vector() * scale * SCALE));
        Self {
            matrix,
            offset: random.normal_vector() * scale * offset,
            offset_per_k: random.normal_vector() * scale * offset_per_k,
            noise_density: scale * noise_density,
        }
    }

    fn measure(
        &self,
        truth: &Vector3<f64>,
        temperature_c: f64,
        rate_hz: f64,
        random: &mut RandomStream,
    ) -> Vector3<f64> {
        let drift = self.offset_per_k * (temperature_c - REFERENCE_TEMPERATURE_C);
        let noise = random.normal_vector() * self.noise_density * libm::sqrt(rate_hz / 2.0);
        truth + self.matrix * truth + self.offset + drift + noise
    }
}

/// Errors of one chip with its noise.
pub struct MeasurementErrors {
    gyro: TriadErrors,
    accelerometer: TriadErrors,
    g_sensitivity: Matrix3<f64>,
    random: RandomStream,
}

impl MeasurementErrors {
    /// A chip of this seed with `scale` times the errors of the data sheet.
    #[must_use]
    pub fn new(seed: u64, scale: f64) -> Self {
        let mut random = RandomStream::new(seed, StreamPurpose::InertialSensor);
        let [rate, drift, rate_noise] = [ZERO_RATE_DEG_S, ZERO_RATE_DEG_S_PER_K, RATE_NOISE_DEG_S].map(f64::to_radians);
        let g = f32_as_f64(GRAVITY_M_S2);
        let g_sensitivity = scale * G_SENSITIVITY_DEG_S_PER_G.to_radians() / g;
        Self {
            gyro: TriadErrors::new(&mut random, scale, rate, drift, rate_noise),
            accelerometer: TriadErrors::new(&mut random, scale, ZERO_G * g, ZERO_G_PER_K * g, FORCE_NOISE_G * g),
            g_sensitivity: Matrix3::from_fn(|_, _| g_sensitivity * random.gaussian()),
            random,
        }
    }

    /// Motion as the chip measures it at this rate.
    pub fn measure(&mut self, truth: &InertialTruth, rate_hz: f64) -> InertialTruth {
        let InertialTruth { rates_rad_s, specific_force_m_s2, temperature_c } = truth;
        let by_force = self.g_sensitivity * specific_force_m_s2;
        InertialTruth {
            rates_rad_s: self.gyro.measure(rates_rad_s, *temperature_c, rate_hz, &mut self.random) + by_force,
            specific_force_m_s2: self.accelerometer.measure(
                specific_force_m_s2,
                *temperature_c,
                rate_hz,
                &mut self.random,
            ),
            temperature_c: *temperature_c,
        }
    }
}

/// Motion at an instant, in the chip's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialTruth {
    /// Rates, rad/s.
    pub rates_rad_s: Vector3<f64>,
    /// Specific force, m/s^2.
    pub specific_force_m_s2: Vector3<f64>,
    /// Temperature of the chip, degrees Celsius.
    pub temperature_c: f64,
}

/// Motion as a function of simulation time in microseconds.
pub type InertialSource = Box<dyn FnMut(u64) -> InertialTruth>;

/// Fault of the chip.
pub trait InertialFault {
    /// Modifies a measurement.
    fn modify_measurement(&mut self, _at_us: u64, _measured: &mut InertialTruth) {}

    /// Register address and bit mask of bits that flip now.
    fn register_upset(&mut self, _at_us: u64) -> Option<(u8, u8)> {
        None
    }

    /// Whether the chip does not answer.
    fn is_silent(&self, _at_us: u64) -> bool {
        false
    }
}

impl<F: FnMut(u64, &mut InertialTruth)> InertialFault for F {
    fn modify_measurement(&mut self, at_us: u64, measured: &mut InertialTruth) {
        self(at_us, measured);
    }
}
