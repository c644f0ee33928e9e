use std::ops::Range;

use nalgebra::Vector3;

use super::super::surface_vehicles::{Surface, roll_pitch_on_slope};
use super::*;
use crate::world::rotation::Euler;

#[track_caller]
fn assert_sigma_deg(expected_deg: Range<f64>, states: &[TrueState], angle: fn(&TrueState) -> f64) {
    let sigma_deg = sigma_deg(states, angle);
    assert!(expected_deg.contains(&sigma_deg), "{sigma_deg} deg for {expected_deg:?}");
}

/// A slope of 1:10 is 5.71 deg. On any slope the down axis, rotated to the level frame, is the slope's normal.
#[test]
fn the_down_axis_on_a_slope_is_its_normal() {
    assert!((roll_pitch_on_slope([0.1, 0.0])[1].to_degrees() - 5.71).abs() < 0.01, "it rises ahead: nose up");
    assert!(
        (roll_pitch_on_slope([0.0, 0.1])[0].to_degrees() + 5.71).abs() < 0.01,
        "it rises to the right: right side up"
    );
    for slope in [[0.2, 0.3], [-0.1, 0.25], [0.3, -0.05]] {
        let [roll_rad, pitch_rad] = roll_pitch_on_slope(slope);
        let euler = Euler { roll_rad, pitch_rad, heading_rad: 0.0 };
        let down_axis = euler.body_from_level().transpose() * Vector3::new(0.0, 0.0, 1.0);
        // Height rises by the slope; the z axis points down.
        let normal = Vector3::new(slope[0], slope[1], 1.0).normalize();
        assert!((down_axis - normal).norm() < 1e-12, "{slope:?}: {down_axis:?} for {normal:?}");
    }
}

/// Waves of 8 to 20 m have periods of 2.3 to 3.6 s. Directions within 40 deg make slopes along the mean direction 2.4
/// times as large as across it.
#[test]
fn waves_have_their_slopes_and_periods() {
    let [mut along, mut across] = [0.0_f64; 2];
    let mut crossings = 0;
    for seed in 0..20 {
        let water = Surface::water_waves(6.0, 0.0, seed);
        let slopes: Vec<[f64; 2]> = (0..3000).map(|i| water.surface_slope([3.0, 4.0], f64::from(i) * 0.1)).collect();
        along += mean(slopes.iter().map(|slope| slope[0] * slope[0])) / 20.0;
        across += mean(slopes.iter().map(|slope| slope[1] * slope[1])) / 20.0;
        crossings += slopes.windows(2).filter(|pair| pair[0][0] < 0.0 && pair[1][0] >= 0.0).count();
    }
    assert!((libm::atan(along.sqrt()).to_degrees() - 6.0).abs() < 0.3, "{}", libm::atan(along.sqrt()).to_degrees());
    assert!((2.1..2.8).contains(&(along / across).sqrt()), "{}", (along / across).sqrt());
    let period_s = 20.0 * 300.0 / crossings as f64;
    assert!((2.5..3.4).contains(&period_s), "{period_s} s");
}

#[test]
fn a_rover_has_the_tilt_of_the_ground() {
    let mut rover = vehicle(VehicleKind::Rover, Weather::default(), 2);
    let right_turn = fly_leg(&mut rover, Leg::Yaw { rate_deg_s: 18.0, heading_change_deg: 720.0 });
    let left_turn = fly_leg(&mut rover, Leg::Yaw { rate_deg_s: 18.0, heading_change_deg: -720.0 });
    assert!((right_turn[2000].heading_rate_rad_s.to_degrees() - 18.0).abs() < 0.1);
    assert!((left_turn[2000].heading_rate_rad_s.to_degrees() + 18.0).abs() < 0.1);
    let mut both_turns = right_turn.clone();
    both_turns.extend_from_slice(&left_turn);
    assert_sigma_deg(3.0..10.0, &both_turns, |state| state.roll_rad);
    assert_sigma_deg(3.0..10.0, &both_turns, |state| state.pitch_rad);
    // In its second circle, 20 s later, the rover has the same tilt at the same place.
    let (first, second) = (right_turn[1999], right_turn[5999]);
    assert!(libm::hypot(first.north_m - second.north_m, first.east_m - second.east_m) < 0.5);
    assert!((first.roll_rad - second.roll_rad).to_degrees().abs() < 1.5, "{first:?} {second:?}");
    assert!((first.pitch_rad - second.pitch_rad).to_degrees().abs() < 1.5, "{first:?} {second:?}");
    // 3 m/s at 18 deg/s are 0.94 m/s^2. Driving uphill draws more current.
    assert!((right_turn[2000].disturbing_acceleration_m_s2 - 0.942).abs() < 0.01);
    assert!(both_turns.iter().all(|state| (state.relative_current > 1.0) == (state.pitch_rad > 0.0)), "uphill");
}

/// Expected heel: half of 0.94 m/s^2 / g, 2.8 deg.
#[test]
fn a_boat_rolls_in_waves_and_heels_out_of_its_turns() {
    let mean_roll_deg = |side_sign: f64| {
        let mut boat = vehicle(VehicleKind::Boat, Weather::default(), 2);
        let states = fly_leg(&mut boat, Leg::Yaw { rate_deg_s: 18.0, heading_change_deg: side_sign * 7200.0 });
        assert_sigma_deg(4.0..9.0, &states, |state| state.roll_rad);
        assert_sigma_deg(1.5..4.0, &states, |state| state.pitch_rad);
        // Waves with slopes of 6 deg accelerate the boat by about as much as its turns, 0.94 m/s^2.
        let push_m_s2 = mean(states.iter().map(|state| state.disturbing_acceleration_m_s2));
        assert!((1.5..2.5).contains(&push_m_s2), "{push_m_s2}");
        let mean_roll_rad = mean(states.iter().map(|state| state.roll_rad));
        let crossings = states
            .windows(2)
            .filter(|state| state[0].roll_rad < mean_roll_rad && state[1].roll_rad >= mean_roll_rad)
            .count();
        let period_s = states.len() as f64 * STEP_S / crossings as f64;
        assert!((1.8..5.0).contains(&period_s), "{period_s} s");
        mean_roll_rad.to_degrees()
    };
    // 400 s contain more than a hundred waves: the mean is accurate to half a degree.
    assert!((mean_roll_deg(1.0) + 2.75).abs() < 0.6, "{}", mean_roll_deg(1.0));
    assert!((mean_roll_deg(-1.0) - 2.75).abs() < 0.6, "{}", mean_roll_deg(-1.0));
}
