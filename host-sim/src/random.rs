//! Seeded random numbers: one independent stream per purpose, so that a change of one setting leaves the noise of
//! everything else as it was.

use nalgebra::{Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// What a stream of random numbers is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Iron and mounting of a random airframe.
    Airframe = 1,
    /// Place on Earth of a random airframe.
    Earth = 2,
    /// Wander of the bank.
    Bank = 3,
    /// Wander of the pitch.
    Pitch = 4,
    /// Gusts across the flight path.
    GustAcross = 5,
    /// Gusts from below.
    GustVertical = 6,
    /// Noise of the attitude source's roll.
    RollNoise = 7,
    /// Noise of the attitude source's pitch.
    PitchNoise = 11,
    /// Direction of the attitude source's bias.
    AttitudeBias = 8,
    /// Noise of the magnetometer.
    Magnetometer = 9,
    /// What a power cut leaves in flash.
    Flash = 10,
    /// Noise of the samples that a study holds back.
    HeldBack = 12,
    /// What befalls a magnetometer.
    SensorFault = 13,
    /// What befalls an attitude source.
    AttitudeFault = 14,
    /// Moves of the throttle.
    Throttle = 15,
    /// Instants and directions of faults.
    Case = 16,
    /// Legs of a flight.
    Legs = 17,
    /// Gusts along the flight path.
    GustAlong = 18,
    /// Rough ground and waves.
    Surface = 19,
    /// Error of the attitude source's roll while it is pushed about.
    RollPush = 20,
    /// Error of the attitude source's pitch while it is pushed about.
    PitchPush = 21,
    /// Direction of the iron that a current makes.
    Current = 22,
    /// Delays and troubles of an autopilot's answers.
    Msp = 23,
    /// Bytes of a log, damaged.
    Damage = 24,
}

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Random(ChaCha8Rng);

impl Random {
    /// The stream of a seed for a purpose.
    #[must_use]
    pub fn new(seed: u64, purpose: Purpose) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(purpose as u64);
        Self(rng)
    }

    /// Normally distributed, mean 0, standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        self.0.sample(StandardNormal)
    }

    /// Evenly distributed over `low..high`; `low` must be below `high`.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.random()
    }

    /// Three independent normal numbers.
    pub fn normal_vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal())
    }

    /// A direction, evenly distributed over the sphere.
    pub fn direction(&mut self) -> Vector3<f64> {
        loop {
            // The normal distribution in three dimensions has no preferred direction.
            if let Some(direction) = self.normal_vector().try_normalize(f64::EPSILON) {
                return direction;
            }
        }
    }

    /// A rotation about a random axis by up to `max_deg` degrees.
    pub fn rotation(&mut self, max_deg: f64) -> Rotation3<f64> {
        let axis = self.direction();
        Rotation3::new(axis * self.uniform(0.0, 1.0) * max_deg.to_radians())
    }
}
