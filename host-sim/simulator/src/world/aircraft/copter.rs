//! Multirotor: hovers over a spot, yaws without banking, tilts to accelerate, to brake and to hold against wind.
//!
//! Thrust carries the weight, so tilt sets acceleration: with pitch `theta` and roll `phi`, `-g tan(theta)` along the
//! nose and `g tan(phi) / cos(theta)` to the right, less drag.

use crate::world::aircraft::config::VehicleConfig;
use crate::world::aircraft::motion::{GRAVITY_M_S2, STEP_S, Turbulence, forward_right, north_east};
use crate::world::autopilot::{TranslationMode, VehicleCommand};
use crate::world::state::TrueState;
use crate::world::weather::Weather;

/// Time constant of roll and pitch control, seconds.
const TILT_TIME_CONSTANT_S: f64 = 0.25;
/// Time constant from rotor command to tilt rate, seconds.
const TILT_RATE_TIME_CONSTANT_S: f64 = 0.1;
/// Largest tilt rate, radians per second (90 degrees per second).
const MAX_TILT_RATE_RAD_S: f64 = std::f64::consts::FRAC_PI_2;
/// Time constant of the turn rate, seconds.
const TURN_RATE_TIME_CONSTANT_S: f64 = 0.3;
/// Time constant of drag, seconds: 15 degrees of tilt reach 13 m/s.
const DRAG_TIME_CONSTANT_S: f64 = 5.0;
/// Gain of the hover controller: acceleration per velocity error, 1/s.
const VELOCITY_GAIN_PER_S: f64 = 1.0;
/// Gain of the hover controller: acceleration per position error, 1/s^2.
const POSITION_GAIN_PER_S2: f64 = 0.3;
/// Speed below which the hover controller fixes its position set point, metres per second.
const MAX_REST_SPEED_M_S: f64 = 1.0;
#[derive(Clone, Copy, Debug)]
pub(super) struct CopterLimits {
    /// Largest tilt of the controller's own choice (braking, position hold, speed hold), degrees. A commanded tilt is
    /// not limited.
    pub max_controller_tilt_deg: f64,
    /// Largest drag deceleration, m/s^2.
    pub max_drag_m_s2: f64,
}

impl CopterLimits {
    /// Multirotor: rotor drag grows with speed without limit.
    pub const MULTIROTOR: Self = Self { max_controller_tilt_deg: 15.0, max_drag_m_s2: f64::INFINITY };
}
/// Relative thrust loss in an upward gust, per metre per second.
const THRUST_LOSS_PER_GUST_S_M: f64 = 0.1;

/// Roll or pitch angle under cascaded angle and rate control, with a first-order response of the rate.
#[derive(Clone, Copy, Debug, Default)]
struct TiltControl {
    angle_rad: f64,
    rate_rad_s: f64,
}

impl TiltControl {
    fn step_toward(&mut self, target_rad: f64) {
        let desired_rate =
            ((target_rad - self.angle_rad) / TILT_TIME_CONSTANT_S).clamp(-MAX_TILT_RATE_RAD_S, MAX_TILT_RATE_RAD_S);
        self.rate_rad_s += (desired_rate - self.rate_rad_s) * STEP_S / TILT_RATE_TIME_CONSTANT_S;
        self.angle_rad += self.rate_rad_s * STEP_S;
    }
}

#[derive(Clone, Debug)]
pub(super) struct Copter {
    config: VehicleConfig,
    limits: CopterLimits,
    weather: Weather,
    turbulence: Turbulence,
    roll: TiltControl,
    pitch: TiltControl,
    heading_rad: f64,
    turn_rate_rad_s: f64,
    velocity_m_s: [f64; 2],
    /// Hover position set point, north and east, metres.
    set_point_m: [f64; 2],
}

impl Copter {
    pub fn new(config: VehicleConfig, limits: CopterLimits, weather: Weather, seed: u64) -> Self {
        Self {
            config,
            limits,
            weather,
            turbulence: Turbulence::new(weather, seed),
            roll: TiltControl::default(),
            pitch: TiltControl::default(),
            heading_rad: config.heading_deg.to_radians(),
            turn_rate_rad_s: 0.0,
            velocity_m_s: [0.0; 2],
            set_point_m: [0.0; 2],
        }
    }

    /// Continues from a state of another vehicle model, with no tilt.
    pub fn continue_from(&mut self, state: &TrueState) {
        (self.roll, self.pitch) = (TiltControl::default(), TiltControl::default());
        (self.heading_rad, self.turn_rate_rad_s) = (state.heading_rad, 0.0);
        self.velocity_m_s = [state.north_m_s, state.east_m_s];
    }

    pub fn next_motion(&mut self, command: VehicleCommand, previous_state: &TrueState) -> TrueState {
        let (desired_m_s2, turn_rate_rad_s) = self.desired_motion(command, previous_state);
        self.turn_rate_rad_s += (turn_rate_rad_s - self.turn_rate_rad_s) * STEP_S / TURN_RATE_TIME_CONSTANT_S;
        self.heading_rad += self.turn_rate_rad_s * STEP_S;
        self.pitch.step_toward(libm::atan(-desired_m_s2[0] / GRAVITY_M_S2));
        self.roll.step_toward(libm::atan(desired_m_s2[1] * libm::cos(self.pitch.angle_rad) / GRAVITY_M_S2));

        let disturbance = self.turbulence.next_disturbances();
        let (roll_rad, pitch_rad) =
            (self.roll.angle_rad + disturbance.bank_rad, self.pitch.angle_rad + disturbance.pitch_rad);
        let thrust_m_s2 =
            [-libm::tan(pitch_rad), libm::tan(roll_rad) / libm::cos(pitch_rad)].map(|tangent| GRAVITY_M_S2 * tangent);
        let thrust_north_east_m_s2 = north_east(self.heading_rad, thrust_m_s2);
        let gust = north_east(self.heading_rad, [disturbance.along_m_s, disturbance.across_m_s]);
        let (wind_north, wind_east) = self.weather.wind_velocity_m_s();
        let air_m_s = [wind_north + gust[0], wind_east + gust[1]];
        let drag_m_s2 = std::array::from_fn(|i| (self.velocity_m_s[i] - air_m_s[i]) / DRAG_TIME_CONSTANT_S);
        let drag_m_s2 = clamp_length(drag_m_s2, self.limits.max_drag_m_s2);
        let acceleration: [f64; 2] = std::array::from_fn(|i| thrust_north_east_m_s2[i] - drag_m_s2[i]);
        for (velocity, acceleration) in self.velocity_m_s.iter_mut().zip(acceleration) {
            *velocity += acceleration * STEP_S;
        }
        let weight = (libm::cos(roll_rad) * libm::cos(pitch_rad)).recip();
        let thrust = (weight - THRUST_LOSS_PER_GUST_S_M * disturbance.vertical_m_s).max(0.0);
        TrueState {
            roll_rad,
            pitch_rad,
            heading_rad: self.heading_rad,
            north_m_s: self.velocity_m_s[0],
            east_m_s: self.velocity_m_s[1],
            disturbing_acceleration_m_s2: libm::hypot(acceleration[0], acceleration[1]),
            // Rotor power is proportional to thrust^(3/2) (momentum theory).
            relative_current: libm::pow(thrust, 1.5),
            ..TrueState::default()
        }
    }

    /// Desired acceleration along the nose and to the right (m/s^2), and turn rate (rad/s).
    fn desired_motion(&mut self, command: VehicleCommand, previous_state: &TrueState) -> ([f64; 2], f64) {
        let position_m = [previous_state.north_m, previous_state.east_m];
        let is_at_rest = libm::hypot(self.velocity_m_s[0], self.velocity_m_s[1]) < MAX_REST_SPEED_M_S;
        if !(matches!(command.translation_mode, TranslationMode::HoldPosition) && is_at_rest) {
            self.set_point_m = position_m;
        }
        let controller_limit_m_s2 = GRAVITY_M_S2 * libm::tan(self.limits.max_controller_tilt_deg.to_radians());
        match command.translation_mode {
            TranslationMode::HoldPosition => {
                let braking = std::array::from_fn(|i| {
                    POSITION_GAIN_PER_S2 * (self.set_point_m[i] - position_m[i])
                        - VELOCITY_GAIN_PER_S * self.velocity_m_s[i]
                });
                (clamp_length(forward_right(self.heading_rad, braking), controller_limit_m_s2), command.turn_rate_rad_s)
            }
            TranslationMode::HoldTilt { toward_rad, tilt_rad } => {
                let (sin, cos) = libm::sincos(toward_rad);
                let size_m_s2 = GRAVITY_M_S2 * libm::tan(tilt_rad);
                ([size_m_s2 * cos, size_m_s2 * sin], command.turn_rate_rad_s)
            }
            TranslationMode::Forward => {
                let [forward, right] = forward_right(self.heading_rad, self.velocity_m_s);
                let errors = [self.config.speed_m_s - forward, -right].map(|error| VELOCITY_GAIN_PER_S * error);
                let [ahead, across] = clamp_length(errors, controller_limit_m_s2);
                let centripetal_m_s2 = GRAVITY_M_S2 * libm::tan(command.bank_rad);
                ([ahead, across + centripetal_m_s2], centripetal_m_s2 / self.config.speed_m_s)
            }
        }
    }
}

fn clamp_length(vector: [f64; 2], max_length: f64) -> [f64; 2] {
    let scale = (max_length / libm::hypot(vector[0], vector[1])).min(1.0);
    vector.map(|component| component * scale)
}
