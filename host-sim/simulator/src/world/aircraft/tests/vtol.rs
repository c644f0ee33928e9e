use super::*;

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
