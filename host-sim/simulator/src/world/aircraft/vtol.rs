//! VTOL aircraft: the copter model in hover and tilted flight, the plane model in forward flight. At a transition the
//! difference between the two models' states decays smoothly.
//!
//! Airspeed changes by 2 to 3 m/s^2, as autopilots plan it (2 m/s^2 by default, PX4's `VT_B_DEC_MSS` and ArduPilot's
//! `Q_TRANS_DECEL`).

use super::copter::{Copter, CopterLimits};
use super::plane::Plane;
use crate::world::aircraft::config::VehicleConfig;
use crate::world::aircraft::motion::STEP_S;
use crate::world::autopilot::TranslationMode;
use crate::world::autopilot::VehicleCommand;
use crate::world::state::TrueState;
use crate::world::weather::Weather;

/// Time constant of the decay of the attitude difference, seconds.
const ATTITUDE_DECAY_TIME_S: f64 = 1.0;
/// Time constant of the velocity difference's critically damped decay, seconds. Its largest acceleration is `22 / (e
/// 3.2)` = 2.5 m/s^2 for an airspeed of 22 m/s.
const SPEED_DECAY_TIME_S: f64 = 3.2;

/// Limits in rotor-borne flight. Drag of a gliding airframe: 22 m/s at a glide ratio of 6.5. Tilt and drag together
/// brake by at most 3 m/s^2.
const ROTOR_BORNE_LIMITS: CopterLimits = CopterLimits { max_controller_tilt_deg: 8.0, max_drag_m_s2: 1.5 };

/// Attitude and velocity of the previous model less those of the present one.
#[derive(Clone, Copy, Debug, Default)]
struct TransitionDifference {
    roll_rad: f64,
    pitch_rad: f64,
    heading_rad: f64,
    north_m_s: f64,
    east_m_s: f64,
    north_m_s2: f64,
    east_m_s2: f64,
}

#[derive(Clone, Debug)]
pub(super) struct Vtol {
    copter: Copter,
    plane: Plane,
    is_wing_borne: bool,
    difference: TransitionDifference,
}

impl Vtol {
    pub fn new(config: VehicleConfig, weather: Weather, seed: u64) -> Self {
        Self {
            copter: Copter::new(config, ROTOR_BORNE_LIMITS, weather, seed),
            plane: Plane::new(config, weather, seed),
            is_wing_borne: false,
            difference: TransitionDifference::default(),
        }
    }

    pub fn next_motion(&mut self, command: VehicleCommand, previous_state: &TrueState) -> TrueState {
        let is_wing_borne = matches!(command.translation_mode, TranslationMode::Forward);
        let takes_over = is_wing_borne != self.is_wing_borne;
        self.is_wing_borne = is_wing_borne;
        if takes_over && is_wing_borne {
            self.plane.continue_from(previous_state);
        } else if takes_over {
            self.copter.continue_from(previous_state);
        }
        let motion = if is_wing_borne {
            self.plane.next_motion(command)
        } else {
            self.copter.next_motion(command, previous_state)
        };
        if takes_over {
            self.difference = TransitionDifference {
                roll_rad: previous_state.roll_rad - motion.roll_rad,
                pitch_rad: previous_state.pitch_rad - motion.pitch_rad,
                heading_rad: previous_state.heading_rad - motion.heading_rad,
                north_m_s: previous_state.north_m_s - motion.north_m_s,
                east_m_s: previous_state.east_m_s - motion.east_m_s,
                ..TransitionDifference::default()
            };
        }
        self.with_difference(motion)
    }

    /// Adds the remaining difference to a motion, and advances its decay by one step.
    fn with_difference(&mut self, motion: TrueState) -> TrueState {
        let difference = &mut self.difference;
        let with_difference = TrueState {
            roll_rad: motion.roll_rad + difference.roll_rad,
            pitch_rad: motion.pitch_rad + difference.pitch_rad,
            heading_rad: motion.heading_rad + difference.heading_rad,
            north_m_s: motion.north_m_s + difference.north_m_s,
            east_m_s: motion.east_m_s + difference.east_m_s,
            disturbing_acceleration_m_s2: motion.disturbing_acceleration_m_s2
                + libm::hypot(difference.north_m_s2, difference.east_m_s2),
            ..motion
        };
        for angle in [&mut difference.roll_rad, &mut difference.pitch_rad, &mut difference.heading_rad] {
            *angle *= 1.0 - STEP_S / ATTITUDE_DECAY_TIME_S;
        }
        // Critically damped decay from rest: `v'' = -2 v' / T - v / T^2`.
        for (speed, acceleration) in [
            (&mut difference.north_m_s, &mut difference.north_m_s2),
            (&mut difference.east_m_s, &mut difference.east_m_s2),
        ] {
            *acceleration -= (2.0 * *acceleration + *speed / SPEED_DECAY_TIME_S) / SPEED_DECAY_TIME_S * STEP_S;
            *speed += *acceleration * STEP_S;
        }
        with_difference
    }
}
