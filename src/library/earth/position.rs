//! Position on Earth.

/// Position reported by an autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// Latitude, degrees, north positive.
    pub latitude_deg: f32,
    /// Longitude, degrees, east positive.
    pub longitude_deg: f32,
    /// Height above mean sea level, metres.
    pub height_m: f32,
}

impl Position {
    /// Creates a position. `None` outside latitude -90..=90 deg, longitude -180..=180 deg, height -1,000..=100,000 m,
    /// and for latitude and longitude of exactly zero, which receivers send without a fix.
    #[must_use]
    pub fn new(latitude_deg: f32, longitude_deg: f32, height_m: f32) -> Option<Self> {
        let exists = latitude_deg.abs() <= 90.0
            && longitude_deg.abs() <= 180.0
            && (-1_000.0..=100_000.0).contains(&height_m)
            && !(latitude_deg == 0.0 && longitude_deg == 0.0);
        exists.then_some(Self { latitude_deg, longitude_deg, height_m })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_must_be_on_earth() {
        let nan = f32::NAN;
        for (is_on_earth, [latitude_deg, longitude_deg, height_m]) in [
            (true, [90.0, 180.0, 0.0]),
            (true, [-90.0, -180.0, -1_000.0]),
            (true, [0.0, 1e-7, 100_000.0]),
            (true, [1e-7, 0.0, 0.0]),
            (false, [90.001, 0.0, 0.0]),
            (false, [-90.001, 0.0, 0.0]),
            (false, [1.0, 180.1, 0.0]),
            (false, [1.0, -180.1, 0.0]),
            (false, [1.0, 1.0, -1_001.0]),
            (false, [1.0, 1.0, 100_010.0]),
            (false, [0.0, 0.0, 50.0]),
            (false, [nan, 1.0, 1.0]),
            (false, [1.0, nan, 1.0]),
            (false, [1.0, 1.0, nan]),
        ] {
            let position = Position::new(latitude_deg, longitude_deg, height_m);
            assert_eq!(position.is_some(), is_on_earth, "{latitude_deg} {longitude_deg} {height_m}");
        }
    }
}
