//! What the air does.

use serde::{Deserialize, Serialize};

/// Wind and turbulence. The defaults are a calm to light day.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weather {
    /// Speed of the steady wind, metres per second.
    pub wind_m_s: f64,
    /// Where it comes from, degrees from magnetic north.
    pub wind_from_deg: f64,
    /// Standard deviation of gusts across the flight path and from below, metres per second: they cause sideslip and
    /// disturb bank and pitch.
    pub gust_m_s: f64,
    /// Standard deviation of the bank's own wander, degrees.
    pub bank_wander_deg: f64,
    /// Standard deviation of the pitch's own wander, degrees.
    pub pitch_wander_deg: f64,
    /// Correlation time of both, seconds.
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
    /// Air that does not move.
    #[must_use]
    pub fn still() -> Self {
        Self { wind_m_s: 0.0, gust_m_s: 0.0, bank_wander_deg: 0.0, pitch_wander_deg: 0.0, ..Self::default() }
    }

    /// The motion of the air toward north and east, metres per second.
    pub(super) fn wind_velocity_m_s(&self) -> (f64, f64) {
        let (sin_from, cos_from) = self.wind_from_deg.to_radians().sin_cos();
        (-self.wind_m_s * cos_from, -self.wind_m_s * sin_from)
    }
}
