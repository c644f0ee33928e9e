//! Earth's magnetic field, uniform over the flight. Headings in the simulation are magnetic.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::rotation::Euler;
use crate::random::{RandomStream, StreamPurpose};
use log_analysis::numbers::square;

/// Magnetic field at the place of the flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Earth {
    /// Total intensity, microtesla.
    pub total_ut: f64,
    /// Inclination, degrees, positive down (northern hemisphere).
    pub inclination_deg: f64,
}

/// Xi'an, where the aircraft of Liu 2007 table 1 was measured.
impl Default for Earth {
    fn default() -> Self {
        Self { total_ut: 53.0, inclination_deg: 54.0 }
    }
}

impl Earth {
    /// Random place with an inclination of -70..70 degrees; field strength of a dipole with a deviation of up to 15 %:
    /// 25..60 microtesla.
    #[must_use]
    pub fn random_earth(seed: u64) -> Self {
        let mut random = RandomStream::new(seed, StreamPurpose::Earth);
        let inclination_deg = random.uniform(-70.0, 70.0);
        let magnetic_latitude_rad = libm::atan(libm::tan(inclination_deg.to_radians()) / 2.0);
        let dipole_ut = 30.0 * (1.0 + 3.0 * square(libm::sin(magnetic_latitude_rad))).sqrt();
        Self { total_ut: dipole_ut * random.uniform(0.85, 1.15), inclination_deg }
    }

    /// Horizontal intensity `H0`, microtesla.
    #[must_use]
    pub fn horizontal_ut(&self) -> f64 {
        self.total_ut * libm::cos(self.inclination_deg.to_radians())
    }

    /// Field in the body axes of an aircraft with this attitude, microtesla.
    #[must_use]
    pub fn body_field_ut(&self, aircraft: Euler) -> Vector3<f64> {
        aircraft.body_field(self.total_ut, self.inclination_deg.to_radians())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The Earth's surface field has 22 to 67 microtesla.
    #[test]
    fn random_places_are_on_earth() {
        for seed in 0..1000 {
            let earth = Earth::random_earth(seed);
            assert!(earth.inclination_deg.abs() <= 70.0 && (25.0..65.0).contains(&earth.total_ut), "{earth:?}");
        }
    }
}
