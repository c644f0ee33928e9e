//! An aircraft that lies as somebody else's simulator says, time after time.
//!
//! It goes from where it is to what was told last in the time that lay between the last two tellings, and waits there. So
//! it lags by one of those times, 20 ms at 50 a second, but moves without jumps, with rates as a gyro would read them,
//! however irregularly it is told.

use std::f64::consts::{PI, TAU};

use super::{STEP_US, TrueState};
use crate::world::rotation::Euler;

/// A change takes no longer than this: four a second are still followed without a rest, a first one is not crept to.
const LONGEST_US: u64 = 250_000;

/// A change that is under way, or done.
#[derive(Clone, Copy, Debug)]
pub(super) struct Followed {
    from: Euler,
    /// Radians in all of it, each the short way round.
    change: Euler,
    told_us: u64,
    takes_us: u64,
}

impl Followed {
    /// What begins with an attitude told now; `before`: what was told before it.
    pub fn told(before: Option<&Self>, state: &TrueState, told: Euler) -> Self {
        let since_us = before.map_or(LONGEST_US, |before| state.time_us - before.told_us);
        let from = state.euler();
        let change = Euler {
            roll_rad: short_way(told.roll_rad - from.roll_rad),
            pitch_rad: told.pitch_rad - from.pitch_rad,
            heading_rad: short_way(told.heading_rad - from.heading_rad),
        };
        Self { from, change, told_us: state.time_us, takes_us: since_us.clamp(STEP_US, LONGEST_US) }
    }

    /// How it lies a step after a state.
    pub fn after_a_step(&self, before: &TrueState) -> TrueState {
        let time_us = before.time_us + STEP_US;
        let share = ((time_us - self.told_us) as f64 / self.takes_us as f64).min(1.0);
        let is_moving = before.time_us < self.told_us + self.takes_us;
        let rate = |change_rad: f64| if is_moving { change_rad / (self.takes_us as f64 / 1e6) } else { 0.0 };
        let Self { from, change, .. } = self;
        TrueState {
            time_us,
            roll_rad: short_way(from.roll_rad + change.roll_rad * share),
            pitch_rad: from.pitch_rad + change.pitch_rad * share,
            heading_rad: from.heading_rad + change.heading_rad * share,
            roll_rate_rad_s: rate(change.roll_rad),
            pitch_rate_rad_s: rate(change.pitch_rad),
            heading_rate_rad_s: rate(change.heading_rad),
            north_m: before.north_m,
            east_m: before.east_m,
            ..TrueState::default()
        }
    }
}

/// The same angle in -pi..pi.
fn short_way(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::aircraft::{Aircraft, Config};
    use crate::world::weather::Weather;

    fn told(aircraft: &mut Aircraft, attitude: Euler, steps: usize) -> TrueState {
        aircraft.follow(attitude);
        (0..steps).for_each(|_| aircraft.step());
        *aircraft.state()
    }

    /// 50 times a second, 20 deg/s of yaw: 20 ms behind, without a jump, at that rate.
    #[test]
    fn what_is_told_is_followed_one_telling_behind() {
        let mut aircraft = Aircraft::new(Config::default(), Weather::default(), 1, 0);
        let mut before = told(&mut aircraft, Euler::from_deg(25.0, 3.0, 0.0), 100);
        assert!((before.roll_rad.to_degrees() - 25.0).abs() < 1e-9, "it is brought there: {before:?}");
        // The first of them is reached in the longest time, and that must have passed.
        for tick in 1..200 {
            let state = told(&mut aircraft, Euler::from_deg(25.0, 3.0, 0.4 * f64::from(tick)), 4);
            if tick > 20 {
                let moved_deg = (state.heading_rad - before.heading_rad).to_degrees();
                assert!((moved_deg - 0.4).abs() < 1e-6, "tick {tick}: {moved_deg}");
                assert!((state.heading_rate_rad_s.to_degrees() - 20.0).abs() < 1e-6, "{state:?}");
                assert!((state.heading_rad.to_degrees() - 0.4 * f64::from(tick)).abs() < 1e-6, "at the next telling");
            }
            before = state;
        }
    }

    /// From 350 deg to 10 deg it is 20 deg, from a bank of 170 deg to -170 deg as well.
    #[test]
    fn it_goes_the_short_way_round() {
        let mut aircraft = Aircraft::new(Config::default(), Weather::default(), 1, 0);
        let before = told(&mut aircraft, Euler::from_deg(170.0, 0.0, 350.0), 100);
        let after = told(&mut aircraft, Euler::from_deg(-170.0, 0.0, 10.0), 100);
        assert!(((after.heading_rad - before.heading_rad).to_degrees() - 20.0).abs() < 1e-9);
        assert!((after.roll_rad.to_degrees() + 170.0).abs() < 1e-9, "{after:?}");
        aircraft.follow(Euler::from_deg(170.0, 0.0, 10.0));
        aircraft.step();
        assert!(aircraft.state().roll_rate_rad_s < 0.0, "back over the top");
    }

    /// Who falls silent leaves it where it is, at rest.
    #[test]
    fn it_rests_where_it_was_told_last() {
        let mut aircraft = Aircraft::new(Config::default(), Weather::default(), 1, 0);
        let state = told(&mut aircraft, Euler::from_deg(10.0, -5.0, 90.0), 400);
        let rates_rad_s = [state.roll_rate_rad_s, state.pitch_rate_rad_s, state.heading_rate_rad_s];
        assert!(rates_rad_s.iter().all(|rate_rad_s| rate_rad_s.abs() < f64::EPSILON), "{rates_rad_s:?}");
        assert!((state.heading_deg() - 90.0).abs() < 1e-9 && (state.pitch_rad.to_degrees() + 5.0).abs() < 1e-9);
    }
}
