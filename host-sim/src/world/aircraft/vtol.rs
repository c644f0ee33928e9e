//! Takes off on rotors, flies on wings: a copter where it is told to stay or is pushed, an aeroplane where it is told to
//! go on. What differs between the two when one takes over fades.
//!
//! It gains and loses its airspeed by 2 to 3 m/s^2, as autopilots plan it (2 m/s^2 by default, PX4's `VT_B_DEC_MSS` and
//! ArduPilot's `Q_TRANS_DECEL`).

use super::copter::{Copter, Limits};
use super::plane::Plane;
use super::{Command, Config, Motion, STEP_S, TrueState, Weather};
use crate::world::autopilot::Manner;

/// Time in which a difference of attitude fades, seconds.
const ATTITUDE_TIME_S: f64 = 1.0;
/// Time constant of the fading of a difference of speed, seconds, twice over: thrust grows and falls again, 22 m/s of
/// airspeed are gained at up to `22 / (e 3.2)`, 2.5 m/s^2.
const SPEED_TIME_S: f64 = 3.2;

/// Under its rotors, with the drag of an airframe that glides: 22 m/s at 1 in 6.5. It brakes by no more tilt than adds up to
/// 3 m/s^2 with it.
const LIMITS: Limits = Limits { own_tilt_deg: 8.0, drag_m_s2: 1.5 };

/// What the attitude and the velocity were more than those of whom they were handed to.
#[derive(Clone, Copy, Debug, Default)]
struct Difference {
    roll_rad: f64,
    pitch_rad: f64,
    heading_rad: f64,
    north_m_s: f64,
    east_m_s: f64,
    /// Acceleration that takes the speed's away.
    north_m_s2: f64,
    east_m_s2: f64,
}

/// See the top of the file.
#[derive(Clone, Debug)]
pub(super) struct Vtol {
    copter: Copter,
    plane: Plane,
    on_wings: bool,
    difference: Difference,
}

impl Vtol {
    pub fn new(config: Config, weather: Weather, seed: u64) -> Self {
        Self {
            copter: Copter::new(config, LIMITS, weather, seed),
            plane: Plane::new(config, weather, seed),
            on_wings: false,
            difference: Difference::default(),
        }
    }

    pub fn step(&mut self, command: Command, before: &TrueState) -> Motion {
        let on_wings = matches!(command.manner, Manner::Onward);
        let takes_over = on_wings != self.on_wings;
        self.on_wings = on_wings;
        if takes_over && on_wings {
            self.plane.take_over(before);
        } else if takes_over {
            self.copter.take_over(before);
        }
        let motion = if on_wings { self.plane.step(command) } else { self.copter.step(command, before) };
        if takes_over {
            self.difference = Difference {
                roll_rad: before.roll_rad - motion.roll_rad,
                pitch_rad: before.pitch_rad - motion.pitch_rad,
                heading_rad: before.heading_rad - motion.heading_rad,
                north_m_s: before.north_m_s - motion.north_m_s,
                east_m_s: before.east_m_s - motion.east_m_s,
                ..Difference::default()
            };
        }
        self.faded(motion)
    }

    /// With what is left of the difference, which then fades on.
    fn faded(&mut self, motion: Motion) -> Motion {
        let left = &mut self.difference;
        let faded = Motion {
            roll_rad: motion.roll_rad + left.roll_rad,
            pitch_rad: motion.pitch_rad + left.pitch_rad,
            heading_rad: motion.heading_rad + left.heading_rad,
            north_m_s: motion.north_m_s + left.north_m_s,
            east_m_s: motion.east_m_s + left.east_m_s,
            push_m_s2: motion.push_m_s2 + left.north_m_s2.hypot(left.east_m_s2),
            ..motion
        };
        for angle in [&mut left.roll_rad, &mut left.pitch_rad, &mut left.heading_rad] {
            *angle *= 1.0 - STEP_S / ATTITUDE_TIME_S;
        }
        // Critically damped, from rest: `v'' = -2 v' / T - v / T^2`.
        for (speed, acceleration) in
            [(&mut left.north_m_s, &mut left.north_m_s2), (&mut left.east_m_s, &mut left.east_m_s2)]
        {
            *acceleration -= (2.0 * *acceleration + *speed / SPEED_TIME_S) / SPEED_TIME_S * STEP_S;
            *speed += *acceleration * STEP_S;
        }
        faded
    }
}
