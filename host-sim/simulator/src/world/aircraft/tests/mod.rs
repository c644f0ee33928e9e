mod copter;
mod plane;
mod surfaces;

use autoswing::inertial::{AttitudeFilter, InertialSample, InertialSensorErrors, SensorOffsets};
use autoswing::time::Timestamp;
use log_analysis::numbers::square;

use super::*;
use crate::devices::lsm6dsl::MeasurementErrors;
use crate::world::autopilot::Leg;
use crate::world::inertial_truth;
use crate::world::rotation::Euler;

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

#[test]
fn a_vtol_hovers_as_a_copter_and_travels_as_an_aeroplane() {
    let mut vtol = vehicle(VehicleKind::Vtol, Weather::calm(), 1);
    let yaw_states = fly_leg(&mut vtol, Leg::Yaw { rate_deg_s: 30.0, heading_change_deg: 360.0 });
    assert!(
        yaw_states.iter().all(|state| state.roll_rad.abs() < 1e-3 && libm::hypot(state.north_m, state.east_m) < 0.1)
    );
    let speed_m_s = |state: &TrueState| libm::hypot(state.north_m_s, state.east_m_s);
    let away = fly_leg(&mut vtol, Leg::Straight { heading_deg: 0.0, seconds: 20.0 });
    assert!((speed_m_s(&away[away.len() - 1]) - 22.0).abs() < 0.5);
    assert!(
        away[0].disturbing_acceleration_m_s2 < 0.1 && (2.4..2.6).contains(&largest_disturbance_m_s2(&away)),
        "{}",
        largest_disturbance_m_s2(&away)
    );
    let circle = fly_leg(&mut vtol, Leg::Turn { bank_deg: 25.0, heading_change_deg: -360.0 });
    // The last step of the leg already executes the following hover command.
    let turning = circle[circle.len() - 2];
    assert!((turning.roll_rad.to_degrees() + 25.0).abs() < 0.5);
    assert!((turning.heading_rate_rad_s.to_degrees() + 11.9).abs() < 0.2, "{turning:?}");
    // Braking from 22 m/s takes 8 s: a pitch of 8 deg, at first slightly more, and drag decelerate by 1.4 + 1.5 m/s^2.
    let stopping = fly_leg(&mut vtol, Leg::Hover { seconds: 15.0 });
    let most_deg = stopping.iter().map(|state| state.pitch_rad.to_degrees()).fold(0.0, f64::max);
    assert!((8.0..9.0).contains(&most_deg), "{most_deg}");
    assert!((2.8..3.1).contains(&largest_disturbance_m_s2(&stopping)), "{}", largest_disturbance_m_s2(&stopping));
    assert!(speed_m_s(&stopping[stopping.len() - 1]) < 0.5);
}

/// The velocity change per step equals the acceleration that disturbs the attitude source.
#[test]
fn the_disturbing_acceleration_equals_the_velocity_change() {
    let mut vtol = vehicle(VehicleKind::Vtol, Weather::calm(), 1);
    for leg in [Leg::Straight { heading_deg: 0.0, seconds: 15.0 }, Leg::Hover { seconds: 15.0 }] {
        let states = fly_leg(&mut vtol, leg);
        // Steps at which the other model takes over are excluded.
        for pair in states[1..states.len() - 1].windows(2) {
            let [dn, de] = [pair[1].north_m_s - pair[0].north_m_s, pair[1].east_m_s - pair[0].east_m_s];
            // Tolerance: the change of the acceleration within a step.
            let off_m_s2 = libm::hypot(dn, de) / STEP_S - pair[1].disturbing_acceleration_m_s2;
            assert!(off_m_s2.abs() < 0.05, "{off_m_s2} {:?}", pair[1]);
        }
    }
}

fn largest_disturbance_m_s2(states: &[TrueState]) -> f64 {
    states.iter().map(|state| state.disturbing_acceleration_m_s2).fold(0.0, f64::max)
}

/// Errors of tilt after the first minute, RMS in degrees, and the largest in sigmas.
fn tilt_errors(vehicle_kind: VehicleKind, speed_is_known: bool) -> (f64, f64) {
    let errors_of_chip = InertialSensorErrors {
        gyro_offset_rad_s: 0.052,
        gyro_scale: 0.01,
        gyro_cross_axis: 0.01,
        accelerometer_offset_m_s2: 0.1,
    };
    let (mut squares, mut count, mut largest) = (0.0, 0.0, 0_f64);
    for seed in 0..10 {
        let mut aircraft = vehicle(vehicle_kind, Weather::default(), seed);
        // An accelerometer whose offset was aligned.
        let mut chip = MeasurementErrors::new(seed, 0.25);
        let mut filter = AttitudeFilter::new(errors_of_chip, SensorOffsets::UNKNOWN);
        let mut before = *aircraft.true_state();
        for leg in legs().into_iter().chain(legs()).chain(legs()) {
            for after in fly_leg(&mut aircraft, leg) {
                let measured = chip.measure(&inertial_truth(&before, &after, 25.0), 200.0);
                before = after;
                let sample = InertialSample {
                    rates_rad_s: measured.rates_rad_s.cast(),
                    specific_force_m_s2: measured.specific_force_m_s2.cast(),
                };
                let speed_m_s = libm::hypot(after.north_m_s, after.east_m_s) as f32;
                filter.update(Timestamp::from_us(after.time_us), &sample, speed_is_known.then_some(speed_m_s));
                if let Some(found) = filter.attitude().filter(|_| after.time_us > 60_000_000) {
                    let found_angles = Euler {
                        roll_rad: f64::from(found.attitude.roll_rad),
                        pitch_rad: f64::from(found.attitude.pitch_rad),
                        heading_rad: 0.0,
                    };
                    let down = |euler: &Euler| euler.body_from_earth().column(2).into_owned();
                    let error_rad = (down(&found_angles) - down(&after.euler_angles())).norm();
                    squares += square(error_rad.to_degrees());
                    count += 1.0;
                    largest = largest.max(error_rad / f64::from(found.tilt_sigma_rad()));
                }
            }
        }
    }
    ((squares / count).sqrt(), largest)
}

/// With their speed, which GNSS or a log knows, rover and boat are within the 1 deg that a heading of 1 deg at an
/// inclination of 65 deg allows on its own. A copter does without.
#[test]
fn vehicles_without_an_autopilot_know_their_tilt() {
    for (kind, speed_is_known, limit_deg) in
        [(VehicleKind::Rover, true, 0.4), (VehicleKind::Boat, true, 1.0), (VehicleKind::Copter, false, 1.8)]
    {
        let (rms_deg, largest_sigmas) = tilt_errors(kind, speed_is_known);
        assert!(rms_deg < limit_deg && largest_sigmas < 4.5, "{kind:?}: {rms_deg} deg, {largest_sigmas} sigmas");
    }
}
