//! Settings: what the user has chosen.

use core::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use crate::calibration::Orientation;

/// What the user has chosen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Magnetic declination (variation), degrees, east positive; none if it was never entered.
    pub declination_deg: Option<f32>,
    /// Inclination of the Earth field where the module is used, degrees, positive down; none if it was never entered.
    pub inclination_deg: Option<f32>,
    /// Added to every heading, degrees: by how much the attitude source, or the sensor where no attitude shows its
    /// mounting, is turned from the vehicle's axis.
    pub align_deg: f32,
    /// Whether heading is sent on the autopilot port.
    pub stream_on: bool,
    /// Headings a second on the autopilot port.
    pub stream_rate_hz: u8,
    /// How the chip sits in the aircraft.
    pub mount: Orientation,
}

impl Default for Settings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Settings {
    /// As delivered: ten sentences a second is what autopilots expect of a compass.
    pub const DEFAULT: Self = Self {
        declination_deg: None,
        inclination_deg: None,
        align_deg: 0.0,
        stream_on: true,
        stream_rate_hz: 10,
        mount: Orientation::NONE,
    };

    /// Rates that can be chosen: up to one heading for every measurement.
    pub const STREAM_RATE_HZ: RangeInclusive<u8> = 1..=80;

    /// Whether every setting is within its range: declination and alignment -180..180 deg, inclination -90..90 deg, rate
    /// [`Self::STREAM_RATE_HZ`].
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.declination_deg.is_none_or(|declination_deg| declination_deg.abs() <= 180.0)
            && self.inclination_deg.is_none_or(|inclination_deg| inclination_deg.abs() <= 90.0)
            && self.align_deg.abs() <= 180.0
            && Self::STREAM_RATE_HZ.contains(&self.stream_rate_hz)
            && self.mount.is_valid()
    }
}
