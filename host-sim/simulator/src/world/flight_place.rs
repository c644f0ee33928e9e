//! Place and date of the flight.

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
