//! Earth's magnetic field, uniform over the flight, and the place and day of the flight. Headings in the simulation are
//! magnetic.

use log_analysis::numbers::square;
use nalgebra::Vector3;
use serde::Deserialize;

use super::rotation::Euler;
use crate::random::{RandomStream, StreamPurpose};

/// Magnetic field at the place of the flight.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
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

/// Position that an autopilot reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportedPosition {
    /// Latitude, degrees north.
    pub latitude_deg: f64,
    /// Longitude, degrees east.
    pub longitude_deg: f64,
    /// Height above mean sea level, metres.
    pub height_m: f64,
}

/// Xi'an, where the aircraft of Liu 2007 table 1 was measured.
pub const XIAN_POSITION: ReportedPosition =
    ReportedPosition { latitude_deg: 34.341_6, longitude_deg: 108.939_8, height_m: 400.0 };

impl ReportedPosition {
    /// Position at a displacement, metres north and east.
    #[must_use]
    pub fn displaced(self, [north_m, east_m]: [f64; 2]) -> Self {
        const METRES_PER_DEG: f64 = 111_195.0;
        Self {
            latitude_deg: self.latitude_deg + north_m / METRES_PER_DEG,
            longitude_deg: self.longitude_deg + east_m / (METRES_PER_DEG * libm::cos(self.latitude_deg.to_radians())),
            ..self
        }
    }
}

/// Unix time at the start of the simulation clock, microseconds: 2026-01-01.
pub const START_UNIX_US: u64 = 1_767_225_600_000_000;

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
