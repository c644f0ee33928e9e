//! Seeded random numbers with an independent stream per purpose, so that changing one setting leaves all other noise
//! unchanged.

use nalgebra::{Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Purpose of a random stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StreamPurpose {
    /// Soft iron, hard iron and mounting of a random airframe.
    Airframe = 1,
    /// Place of a random airframe.
    Earth = 2,
    /// Random bank disturbances.
    Bank = 3,
    /// Random pitch disturbances.
    Pitch = 4,
    /// Gusts across the flight path.
    GustAcross = 5,
    /// Vertical gusts.
    GustVertical = 6,
    /// Roll noise of the attitude source.
    RollNoise = 7,
    /// Pitch noise of the attitude source.
    PitchNoise = 11,
    /// Direction of the attitude source's bias.
    AttitudeBias = 8,
    /// Magnetometer noise.
    Magnetometer = 9,
    /// Noise of held-back samples.
    HeldBack = 12,
    /// Magnetometer faults.
    SensorFault = 13,
    /// Attitude faults.
    AttitudeFault = 14,
    /// Throttle changes.
    Throttle = 15,
    /// Times and directions of faults.
    FaultCase = 16,
    /// Legs of a flight.
    Legs = 17,
    /// Gusts along the flight path.
    GustAlong = 18,
    /// Rough ground and waves.
    Surface = 19,
    /// Acceleration-induced roll error of the attitude source.
    RollTiltError = 20,
    /// Acceleration-induced pitch error of the attitude source.
    PitchTiltError = 21,
    /// Direction of motor-current interference.
    Current = 22,
    /// Delays and faults of MSP answers.
    Msp = 23,
    /// Errors and noise of the autopilot's gyro.
    Gyro = 24,
    /// Drift of the gyro's x axis.
    GyroDriftX = 25,
    /// Drift of the gyro's y axis.
    GyroDriftY = 26,
    /// Drift of the gyro's z axis.
    GyroDriftZ = 27,
    /// Errors and noise of an inertial sensor.
    InertialSensor = 28,
}

/// Stream of random numbers.
#[derive(Clone, Debug)]
pub struct RandomStream(ChaCha8Rng);

impl RandomStream {
    /// The stream of a seed for a purpose.
    #[must_use]
    pub fn new(seed: u64, purpose: StreamPurpose) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(purpose as u64);
        Self(rng)
    }

    /// Draws a standard normal number.
    pub fn gaussian(&mut self) -> f64 {
        self.0.sample(StandardNormal)
    }

    /// Uniformly distributed over `low..high`; `low` must be below `high`.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    /// 64 random bits.
    pub fn random_bits(&mut self) -> u64 {
        self.0.random()
    }

    /// Three independent standard normal numbers.
    pub fn normal_vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.gaussian())
    }

    /// Unit vector, uniformly distributed over the sphere.
    pub fn random_direction(&mut self) -> Vector3<f64> {
        loop {
            // The three-dimensional normal distribution is isotropic.
            if let Some(direction) = self.normal_vector().try_normalize(f64::EPSILON) {
                return direction;
            }
        }
    }

    /// Rotation about a random axis by up to `max_deg` degrees.
    pub fn random_rotation(&mut self, max_deg: f64) -> Rotation3<f64> {
        let axis = self.random_direction();
        Rotation3::new(axis * self.uniform(0.0, 1.0) * max_deg.to_radians())
    }
}
