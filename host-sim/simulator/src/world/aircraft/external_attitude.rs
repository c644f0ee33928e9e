//! Motion of an aircraft whose attitude an external simulator provides.
//!
//! The aircraft turns from its present attitude to the newest received one within the interval between the last two
//! received attitudes, then rests. It lags by one interval (20 ms at 50 Hz), but moves without jumps and with plausible
//! body rates even when attitudes arrive irregularly.

use std::f64::consts::{PI, TAU};

use crate::world::aircraft::motion::STEP_US;
use crate::world::rotation::Euler;
use crate::world::state::TrueState;

/// Longest interpolation, microseconds: attitudes at 4 Hz are still interpolated without a rest.
const MAX_INTERPOLATION_US: u64 = 250_000;

/// Interpolation to a received attitude.
#[derive(Clone, Copy, Debug)]
pub(super) struct AttitudeInterpolation {
    start_attitude: Euler,
    /// Total change in radians; roll and heading by the shorter direction.
    attitude_change: Euler,
    received_us: u64,
    /// Duration, microseconds; 0 if the aircraft jumps to the attitude.
    duration_us: u64,
}

impl AttitudeInterpolation {
    /// Interpolation to an attitude received now; `previous_interpolation` leads to the previous one. The first
    /// attitude sets the aircraft without a turn: the world's own attitude before it means nothing. Of several
    /// attitudes at one instant, as after a stall, the last one counts.
    pub fn new(previous_interpolation: Option<&Self>, state: &TrueState, received: Euler) -> Self {
        let replaced =
            previous_interpolation.filter(|previous_interpolation| previous_interpolation.received_us == state.time_us);
        let duration_us = match (replaced, previous_interpolation) {
            (Some(replaced), _) => replaced.duration_us,
            (None, Some(previous_interpolation)) => {
                (state.time_us - previous_interpolation.received_us).min(MAX_INTERPOLATION_US)
            }
            (None, None) => 0,
        };
        let start_attitude = if duration_us == 0 {
            received
        } else {
            replaced.map_or(state.euler_angles(), |replaced| replaced.start_attitude)
        };
        let attitude_change = Euler {
            roll_rad: wrap_pi_rad(received.roll_rad - start_attitude.roll_rad),
            pitch_rad: received.pitch_rad - start_attitude.pitch_rad,
            heading_rad: wrap_pi_rad(received.heading_rad - start_attitude.heading_rad),
        };
        Self { start_attitude, attitude_change, received_us: state.time_us, duration_us }
    }

    /// State one step after `previous_state`.
    pub fn next_state(&self, previous_state: &TrueState) -> TrueState {
        let time_us = previous_state.time_us + STEP_US;
        let share = ((time_us - self.received_us) as f64 / self.duration_us as f64).min(1.0);
        let is_moving = previous_state.time_us < self.received_us + self.duration_us;
        let rate = |change_rad: f64| if is_moving { change_rad / (self.duration_us as f64 / 1e6) } else { 0.0 };
        let Self { start_attitude, attitude_change, .. } = self;
        TrueState {
            time_us,
            roll_rad: wrap_pi_rad(start_attitude.roll_rad + attitude_change.roll_rad * share),
            pitch_rad: start_attitude.pitch_rad + attitude_change.pitch_rad * share,
            heading_rad: start_attitude.heading_rad + attitude_change.heading_rad * share,
            roll_rate_rad_s: rate(attitude_change.roll_rad),
            pitch_rate_rad_s: rate(attitude_change.pitch_rad),
            heading_rate_rad_s: rate(attitude_change.heading_rad),
            north_m: previous_state.north_m,
            east_m: previous_state.east_m,
            ..TrueState::default()
        }
    }
}

fn wrap_pi_rad(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::aircraft::{Aircraft, VehicleConfig};
    use crate::world::weather::Weather;

    fn follow_for_steps(aircraft: &mut Aircraft, attitude: Euler, steps: usize) -> TrueState {
        aircraft.follow_attitude(attitude);
        (0..steps).for_each(|_| aircraft.advance_step());
        *aircraft.true_state()
    }

    /// At 50 Hz and 20 deg/s of yaw: a lag of 20 ms, no jumps, correct rate.
    #[test]
    fn an_external_attitude_is_followed_one_update_later() {
        let mut aircraft = Aircraft::new(VehicleConfig::default(), Weather::default(), 1, 0);
        let mut before = follow_for_steps(&mut aircraft, Euler::from_deg(25.0, 3.0, 0.0), 100);
        assert!((before.roll_rad.to_degrees() - 25.0).abs() < 1e-9, "it is set there: {before:?}");
        for tick in 1..200 {
            let state = follow_for_steps(&mut aircraft, Euler::from_deg(25.0, 3.0, 0.4 * f64::from(tick)), 4);
            // The first ticks are not checked: after the rest above, the first interpolation takes
            // `MAX_INTERPOLATION_US`.
            if tick > 20 {
                let moved_deg = (state.heading_rad - before.heading_rad).to_degrees();
                assert!((moved_deg - 0.4).abs() < 1e-6, "tick {tick}: {moved_deg}");
                assert!((state.heading_rate_rad_s.to_degrees() - 20.0).abs() < 1e-6, "{state:?}");
                assert!((state.heading_rad.to_degrees() - 0.4 * f64::from(tick)).abs() < 1e-6, "at the next attitude");
            }
            before = state;
        }
    }

    /// The second of two first attitudes at one instant once turned the aircraft by 59 deg within a step: a heading
    /// 4 to 9 deg off for the rest of the run.
    #[test]
    fn of_attitudes_at_one_instant_the_last_one_counts() {
        let mut aircraft = Aircraft::new(VehicleConfig::default(), Weather::default(), 1, 0);
        aircraft.follow_attitude(Euler::from_deg(0.0, 0.0, 290.0));
        let set = follow_for_steps(&mut aircraft, Euler::from_deg(0.0, 0.0, 301.0), 1);
        assert!((set.heading_deg() - 301.0).abs() < 1e-9 && set.heading_rate_rad_s.abs() < f64::EPSILON, "{set:?}");
        // A stall of 20 steps (0.1 s), then two attitudes: 4 deg are turned within 0.1 s.
        (1..20).for_each(|_| aircraft.advance_step());
        aircraft.follow_attitude(Euler::from_deg(0.0, 0.0, 303.0));
        let turning = follow_for_steps(&mut aircraft, Euler::from_deg(0.0, 0.0, 305.0), 10);
        assert!((turning.heading_deg() - 303.0).abs() < 1e-6, "half of the way: {turning:?}");
        assert!((turning.heading_rate_rad_s.to_degrees() - 40.0).abs() < 1e-6, "{turning:?}");
    }

    #[test]
    fn the_aircraft_turns_the_short_way_round() {
        let mut aircraft = Aircraft::new(VehicleConfig::default(), Weather::default(), 1, 0);
        let before = follow_for_steps(&mut aircraft, Euler::from_deg(170.0, 0.0, 350.0), 100);
        let after = follow_for_steps(&mut aircraft, Euler::from_deg(-170.0, 0.0, 10.0), 100);
        assert!(((after.heading_rad - before.heading_rad).to_degrees() - 20.0).abs() < 1e-9);
        assert!((after.roll_rad.to_degrees() + 170.0).abs() < 1e-9, "{after:?}");
        aircraft.follow_attitude(Euler::from_deg(170.0, 0.0, 10.0));
        aircraft.advance_step();
        assert!(aircraft.true_state().roll_rate_rad_s < 0.0, "back over the top");
    }

    #[test]
    fn the_aircraft_rests_at_the_last_attitude() {
        let mut aircraft = Aircraft::new(VehicleConfig::default(), Weather::default(), 1, 0);
        let state = follow_for_steps(&mut aircraft, Euler::from_deg(10.0, -5.0, 90.0), 400);
        let rates_rad_s = [state.roll_rate_rad_s, state.pitch_rate_rad_s, state.heading_rate_rad_s];
        assert!(rates_rad_s.iter().all(|rate_rad_s| rate_rad_s.abs() < f64::EPSILON), "{rates_rad_s:?}");
        assert!((state.heading_deg() - 90.0).abs() < 1e-9 && (state.pitch_rad.to_degrees() + 5.0).abs() < 1e-9);
    }
}
