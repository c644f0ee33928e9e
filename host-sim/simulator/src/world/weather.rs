//! Wind and turbulence settings.

use serde::Deserialize;

/// Wind and turbulence. Default: calm to light.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weather {
    /// Mean wind speed, metres per second.
    pub wind_m_s: f64,
    /// Direction from which the wind blows, degrees from magnetic north.
    pub wind_from_deg: f64,
    /// Standard deviation of each gust component, metres per second. Gusts cause sideslip and disturb roll and pitch.
    pub gust_m_s: f64,
    /// Standard deviation of random bank, degrees.
    pub bank_wander_deg: f64,
    /// Standard deviation of random pitch, degrees.
    pub pitch_wander_deg: f64,
    /// Correlation time of random bank and pitch, seconds.
    pub wander_time_s: f64,
}

impl Default for Weather {
    fn default() -> Self {
        Self {
            wind_m_s: 4.0,
            wind_from_deg: 250.0,
            gust_m_s: 0.5,
            bank_wander_deg: 1.5,
            pitch_wander_deg: 1.0,
            wander_time_s: 1.5,
        }
    }
}

impl Weather {
    /// No wind, gusts or random attitude disturbances.
    #[must_use]
    pub fn calm() -> Self {
        Self { wind_m_s: 0.0, gust_m_s: 0.0, bank_wander_deg: 0.0, pitch_wander_deg: 0.0, ..Self::default() }
    }

    pub(super) fn wind_velocity_m_s(&self) -> (f64, f64) {
        let (sin_from, cos_from) = libm::sincos(self.wind_from_deg.to_radians());
        (-self.wind_m_s * cos_from, -self.wind_m_s * sin_from)
    }
}
