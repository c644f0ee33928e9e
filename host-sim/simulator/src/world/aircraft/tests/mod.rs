mod copter;
mod inertial;
mod plane;
mod surfaces;
mod vtol;

use super::*;
use crate::world::autopilot::Leg;
use log_analysis::numbers::square;

fn vehicle(vehicle_kind: VehicleKind, weather: Weather, seed: u64) -> Aircraft {
    Aircraft::new(VehicleConfig { kind: vehicle_kind, ..VehicleConfig::default() }, weather, seed, 0)
}

/// States of every step during `seconds`.
fn fly(aircraft: &mut Aircraft, seconds: f64) -> Vec<TrueState> {
    (0..(seconds / STEP_S) as usize)
        .map(|_| {
            aircraft.advance_step();
            *aircraft.true_state()
        })
        .collect()
}

/// States of every step until the leg ends.
fn fly_leg(aircraft: &mut Aircraft, leg: Leg) -> Vec<TrueState> {
    aircraft.autopilot_mut().append_leg(leg);
    let mut states = Vec::new();
    while states.is_empty() || aircraft.autopilot().unfinished_leg_count() > 0 {
        states.extend(fly(aircraft, STEP_S));
        assert!(states.len() < 100_000, "{leg:?} does not end");
    }
    states
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

fn sigma_deg(states: &[TrueState], quantity: fn(&TrueState) -> f64) -> f64 {
    let mean_rad = mean(states.iter().map(quantity));
    mean(states.iter().map(|state| square(quantity(state) - mean_rad))).sqrt().to_degrees()
}

fn legs() -> [Leg; 6] {
    [
        Leg::Yaw { rate_deg_s: 30.0, heading_change_deg: 200.0 },
        Leg::Tilt { toward_deg: 40.0, tilt_deg: 20.0, seconds: 2.0 },
        Leg::Hover { seconds: 4.0 },
        Leg::Straight { heading_deg: 70.0, seconds: 12.0 },
        Leg::Turn { bank_deg: 15.0, heading_change_deg: -90.0 },
        Leg::Hover { seconds: 6.0 },
    ]
}

/// From step to step the rotation matrix changes by `R(after) R(before)^T = 1 - [w] dt`. Rates are differences over the
/// previous step, so an error of the square of the angle per step remains: 0.4 deg/s at 90 deg/s and 5 ms.
#[test]
fn body_rates_belong_to_the_attitude() {
    for vehicle_kind in VehicleKind::ALL_VEHICLES {
        let mut aircraft = vehicle(vehicle_kind, Weather::default(), 4);
        let states: Vec<TrueState> = legs().into_iter().flat_map(|leg| fly_leg(&mut aircraft, leg)).collect();
        let mut fastest_deg_s: f64 = 0.0;
        for (before, after) in states.iter().zip(&states[1..]) {
            let rotation_over_two_steps =
                after.euler_angles().body_from_earth() * before.euler_angles().body_from_earth().transpose();
            let rates = [
                rotation_over_two_steps[(1, 2)] - rotation_over_two_steps[(2, 1)],
                rotation_over_two_steps[(2, 0)] - rotation_over_two_steps[(0, 2)],
                rotation_over_two_steps[(0, 1)] - rotation_over_two_steps[(1, 0)],
            ]
            .map(|twice| (twice / 2.0 / STEP_S).to_degrees());
            let reported_deg_s = after.body_rates_rad_s().map(f64::to_degrees);
            for (rate, reported_deg_s) in rates.iter().zip(reported_deg_s) {
                fastest_deg_s = fastest_deg_s.max(reported_deg_s.abs());
                assert!(
                    (rate - reported_deg_s).abs() < 0.6,
                    "{vehicle_kind:?}: {reported_deg_s} deg/s reported, {rate} turned, {after:?}"
                );
            }
        }
        assert!(fastest_deg_s > 15.0, "{vehicle_kind:?} has turned");
    }
}

/// Bounds per step of 5 ms: 1 deg (200 deg/s) and 15 m/s^2, also at the start of legs and at VTOL transitions.
#[test]
fn attitude_and_velocity_change_without_jumps() {
    for vehicle_kind in VehicleKind::ALL_VEHICLES {
        let mut aircraft = vehicle(vehicle_kind, Weather::default(), 6);
        let mut before = *aircraft.true_state();
        // Rovers and boats start with the tilt of their surface, which is no rotation.
        if matches!(vehicle_kind, VehicleKind::Rover | VehicleKind::Boat) {
            assert!(libm::hypot(before.roll_rate_rad_s, before.pitch_rate_rad_s) < 1.0, "{vehicle_kind:?}: {before:?}");
        }
        for leg in legs() {
            for after in fly_leg(&mut aircraft, leg) {
                let angles = [
                    after.roll_rad - before.roll_rad,
                    after.pitch_rad - before.pitch_rad,
                    after.heading_rad - before.heading_rad,
                ];
                assert!(
                    angles.iter().all(|change| change.to_degrees().abs() < 1.0),
                    "{vehicle_kind:?} {leg:?}: {after:?}"
                );
                let speed_m_s = libm::hypot(after.north_m_s - before.north_m_s, after.east_m_s - before.east_m_s);
                assert!(speed_m_s < 0.075, "{vehicle_kind:?} {leg:?}: {speed_m_s} m/s in a step at {}", after.time_us);
                before = after;
            }
        }
    }
}
