//! Motion of a vehicle over one integration step.

use crate::random::{RandomStream, StreamPurpose};
use crate::world::gauss_markov::SecondOrderProcess;
use crate::world::weather::Weather;

/// Integration step, 20 times shorter than the shortest time constant.
pub const STEP_US: u64 = 5_000;
/// Integration step, seconds.
pub const STEP_S: f64 = STEP_US as f64 / 1e6;

/// Standard gravity, m/s^2.
pub const GRAVITY_M_S2: f64 = 9.806_65;

/// North and east components of a vector given along the nose and to the right.
pub fn north_east(heading_rad: f64, [forward, right]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = libm::sincos(heading_rad);
    [cos * forward - sin * right, sin * forward + cos * right]
}

/// Components along the nose and to the right of a vector given north and east.
pub fn forward_right(heading_rad: f64, [north, east]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = libm::sincos(heading_rad);
    [cos * north + sin * east, cos * east - sin * north]
}

/// Gust correlation time, seconds: turbulence length near the ground (50 m) over an airspeed of 20 m/s.
const GUST_CORRELATION_TIME_S: f64 = 2.5;

#[derive(Clone, Debug)]
pub(super) struct Turbulence {
    bank: SecondOrderProcess,
    pitch: SecondOrderProcess,
    gust_across_m_s: SecondOrderProcess,
    gust_vertical_m_s: SecondOrderProcess,
    gust_along_m_s: SecondOrderProcess,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Disturbances {
    /// Random disturbance of the roll, radians.
    pub bank_rad: f64,
    /// Random disturbance of the pitch, radians.
    pub pitch_rad: f64,
    /// Gust from the right of the flight path, m/s.
    pub across_m_s: f64,
    /// Gust along the flight path, m/s.
    pub along_m_s: f64,
    /// Upward gust, m/s.
    pub vertical_m_s: f64,
}

impl Turbulence {
    pub fn new(weather: Weather, seed: u64) -> Self {
        let process =
            |sigma, time_s, purpose| SecondOrderProcess::new(sigma, time_s, STEP_S, RandomStream::new(seed, purpose));
        let gauss_markov = |sigma_deg: f64, purpose| process(sigma_deg.to_radians(), weather.wander_time_s, purpose);
        let gust = |purpose| process(weather.gust_m_s, GUST_CORRELATION_TIME_S, purpose);
        Self {
            bank: gauss_markov(weather.bank_wander_deg, StreamPurpose::Bank),
            pitch: gauss_markov(weather.pitch_wander_deg, StreamPurpose::Pitch),
            gust_across_m_s: gust(StreamPurpose::GustAcross),
            gust_vertical_m_s: gust(StreamPurpose::GustVertical),
            gust_along_m_s: gust(StreamPurpose::GustAlong),
        }
    }

    pub fn next_disturbances(&mut self) -> Disturbances {
        Disturbances {
            bank_rad: self.bank.next_value(),
            pitch_rad: self.pitch.next_value(),
            across_m_s: self.gust_across_m_s.next_value(),
            along_m_s: self.gust_along_m_s.next_value(),
            vertical_m_s: self.gust_vertical_m_s.next_value(),
        }
    }
}
