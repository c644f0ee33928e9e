//! An aeroplane: banks at a limited rate, turns by its bank, drifts with the wind, and is pushed about by the air.

use super::{Air, Command, Config, GRAVITY_M_S2, Motion, STEP_S, TrueState, Weather};

/// Time in which a bank error is worked off, seconds.
const BANK_TIME_S: f64 = 0.5;
/// Lag of the roll rate behind the ailerons, seconds.
const ROLL_RATE_TIME_S: f64 = 0.1;
/// Lag of the pitch, seconds.
const PITCH_TIME_S: f64 = 0.8;
/// Nose-up for the lift that a turn needs: degrees per unit of load factor above one. 1.2 degrees at a bank of 25.
const PITCH_PER_LOAD_DEG: f64 = 12.0;
/// Roll away from the side that the air comes from (dihedral), and pitch with it, degrees per degree.
const BANK_PER_SIDESLIP: f64 = -0.5;
const PITCH_PER_UPWASH: f64 = 0.3;

/// Attitude as flown, before the air moves it. Radians.
#[derive(Clone, Copy, Debug, Default)]
struct Flown {
    bank: f64,
    bank_rate: f64,
    pitch: f64,
}

/// See the top of the file.
#[derive(Clone, Debug)]
pub(super) struct Plane {
    config: Config,
    weather: Weather,
    air: Air,
    flown: Flown,
    /// Direction of the motion through the air, radians, counting whole turns.
    air_course: f64,
}

impl Plane {
    pub fn new(config: Config, weather: Weather, seed: u64) -> Self {
        let air_course = config.heading_deg.to_radians();
        Self { config, weather, air: Air::new(weather, seed), flown: Flown::default(), air_course }
    }

    /// Flies on from there, wings level at first.
    pub fn take_over(&mut self, state: &TrueState) {
        self.flown = Flown::default();
        self.air_course = state.heading_rad;
    }

    pub fn step(&mut self, command: Command) -> Motion {
        self.fly(command);
        let stirred = self.air.step();
        let airspeed_m_s = self.config.airspeed_m_s;
        let sideslip_rad = stirred.across_m_s / airspeed_m_s;
        let upwash_rad = stirred.vertical_m_s / airspeed_m_s;
        let roll_rad = self.flown.bank + stirred.bank_rad + BANK_PER_SIDESLIP * sideslip_rad;
        let pitch_rad = self.flown.pitch + stirred.pitch_rad + PITCH_PER_UPWASH * upwash_rad;
        // Coordinated turn: the lift's horizontal part is what turns the motion through the air. The nose points
        // where the air comes from less the sideslip.
        self.air_course += GRAVITY_M_S2 * roll_rad.tan() / airspeed_m_s * STEP_S;
        let heading_rad = self.air_course - sideslip_rad;

        let (wind_north_m_s, wind_east_m_s) = self.weather.wind_velocity_m_s();
        let (sin_course, cos_course) = self.air_course.sin_cos();
        Motion {
            roll_rad,
            pitch_rad,
            heading_rad,
            sideslip_rad,
            north_m_s: airspeed_m_s * cos_course + wind_north_m_s,
            east_m_s: airspeed_m_s * sin_course + wind_east_m_s,
            // What turns it is in the source's `turn_error`; nothing else accelerates it.
            push_m_s2: 0.0,
            // Induced drag goes with the square of the load.
            current: roll_rad.cos().powi(-2),
        }
    }

    /// Moves the flown attitude toward the command.
    fn fly(&mut self, command: Command) {
        let limit = self.config.max_roll_rate_deg_s.to_radians();
        let wanted_rate = ((command.bank_rad - self.flown.bank) / BANK_TIME_S).clamp(-limit, limit);
        self.flown.bank_rate += (wanted_rate - self.flown.bank_rate) * STEP_S / ROLL_RATE_TIME_S;
        self.flown.bank += self.flown.bank_rate * STEP_S;
        let load_factor = self.flown.bank.cos().recip();
        let wanted_pitch = command.pitch_rad + PITCH_PER_LOAD_DEG.to_radians() * (load_factor - 1.0);
        self.flown.pitch += (wanted_pitch - self.flown.pitch) * STEP_S / PITCH_TIME_S;
    }
}
