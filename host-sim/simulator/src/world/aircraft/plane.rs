//! Aeroplane: banks at a limited rate, turns by its bank, drifts with the wind, and is disturbed by gusts.

use crate::world::aircraft::config::VehicleConfig;
use crate::world::aircraft::motion::{GRAVITY_M_S2, STEP_S, Turbulence};
use crate::world::autopilot::VehicleCommand;
use crate::world::state::TrueState;
use crate::world::weather::Weather;
use log_analysis::numbers::square;

/// Time constant of bank control, seconds.
const BANK_TIME_CONSTANT_S: f64 = 0.5;
/// Time constant from ailerons to roll rate, seconds.
const ROLL_RATE_TIME_CONSTANT_S: f64 = 0.1;
/// Time constant of pitch control, seconds.
const PITCH_TIME_CONSTANT_S: f64 = 0.8;
/// Additional pitch per unit of load factor above one, degrees, for the lift of a turn: 1.2 degrees at a bank of 25.
const PITCH_PER_LOAD_FACTOR_DEG: f64 = 12.0;
/// Roll per sideslip (dihedral effect), degrees per degree.
const BANK_PER_SIDESLIP: f64 = -0.5;
/// Pitch per upwash, degrees per degree.
const PITCH_PER_UPWASH: f64 = 0.3;

/// Attitude without gusts and random disturbances, radians.
#[derive(Clone, Copy, Debug, Default)]
struct UndisturbedAttitude {
    bank: f64,
    bank_rate: f64,
    pitch: f64,
}

#[derive(Clone, Debug)]
pub(super) struct Plane {
    config: VehicleConfig,
    weather: Weather,
    turbulence: Turbulence,
    undisturbed_attitude: UndisturbedAttitude,
    /// Direction of motion through the air, radians, not wrapped.
    air_course_rad: f64,
}

impl Plane {
    pub fn new(config: VehicleConfig, weather: Weather, seed: u64) -> Self {
        let air_course_rad = config.heading_deg.to_radians();
        Self {
            config,
            weather,
            turbulence: Turbulence::new(weather, seed),
            undisturbed_attitude: UndisturbedAttitude::default(),
            air_course_rad,
        }
    }

    /// Continues from a state of another vehicle model, wings level at first.
    pub fn continue_from(&mut self, state: &TrueState) {
        self.undisturbed_attitude = UndisturbedAttitude::default();
        self.air_course_rad = state.heading_rad;
    }

    pub fn next_motion(&mut self, command: VehicleCommand) -> TrueState {
        self.follow_command(command);
        let disturbance = self.turbulence.next_disturbances();
        let airspeed_m_s = self.config.airspeed_m_s;
        let sideslip_rad = disturbance.across_m_s / airspeed_m_s;
        let upwash_rad = disturbance.vertical_m_s / airspeed_m_s;
        let roll_rad = self.undisturbed_attitude.bank + disturbance.bank_rad + BANK_PER_SIDESLIP * sideslip_rad;
        let pitch_rad = self.undisturbed_attitude.pitch + disturbance.pitch_rad + PITCH_PER_UPWASH * upwash_rad;
        // Coordinated turn: the horizontal lift component turns the velocity through the air. The nose points along
        // that velocity less the sideslip.
        self.air_course_rad += GRAVITY_M_S2 * libm::tan(roll_rad) / airspeed_m_s * STEP_S;
        let heading_rad = self.air_course_rad - sideslip_rad;

        let (wind_north_m_s, wind_east_m_s) = self.weather.wind_velocity_m_s();
        let (sin_course, cos_course) = libm::sincos(self.air_course_rad);
        TrueState {
            roll_rad,
            pitch_rad,
            heading_rad,
            sideslip_rad,
            north_m_s: airspeed_m_s * cos_course + wind_north_m_s,
            east_m_s: airspeed_m_s * sin_course + wind_east_m_s,
            // No disturbing acceleration: the attitude source's `turn_error` covers that of the turn.
            // Induced drag is proportional to the square of the load factor.
            relative_current: square(libm::cos(roll_rad)).recip(),
            ..TrueState::default()
        }
    }

    fn follow_command(&mut self, command: VehicleCommand) {
        let max_roll_rate_rad_s = self.config.max_roll_rate_deg_s.to_radians();
        let desired_rate = ((command.bank_rad - self.undisturbed_attitude.bank) / BANK_TIME_CONSTANT_S)
            .clamp(-max_roll_rate_rad_s, max_roll_rate_rad_s);
        self.undisturbed_attitude.bank_rate +=
            (desired_rate - self.undisturbed_attitude.bank_rate) * STEP_S / ROLL_RATE_TIME_CONSTANT_S;
        self.undisturbed_attitude.bank += self.undisturbed_attitude.bank_rate * STEP_S;
        let load_factor = libm::cos(self.undisturbed_attitude.bank).recip();
        let desired_pitch = command.pitch_rad + PITCH_PER_LOAD_FACTOR_DEG.to_radians() * (load_factor - 1.0);
        self.undisturbed_attitude.pitch +=
            (desired_pitch - self.undisturbed_attitude.pitch) * STEP_S / PITCH_TIME_CONSTANT_S;
    }
}
