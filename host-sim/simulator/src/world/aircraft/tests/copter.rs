use super::*;

type Quantity = fn(&TrueState) -> f64;

fn copter(weather: Weather, heading_deg: f64) -> Aircraft {
    let config = VehicleConfig { kind: VehicleKind::Copter, heading_deg, ..VehicleConfig::default() };
    Aircraft::new(config, weather, 1, 0)
}

fn wind(wind_m_s: f64, wind_from_deg: f64) -> Weather {
    Weather { wind_m_s, wind_from_deg, ..Weather::calm() }
}

/// The drag of a 4 m/s wind, 0.8 m/s^2, needs a tilt of 4.66 deg into the wind.
#[test]
fn a_copter_hovers_in_place_and_tilts_into_the_wind() {
    for (heading_deg, [roll_deg, pitch_deg]) in
        [(250.0, [0.0, -4.66]), (70.0, [0.0, 4.66]), (340.0, [-4.66, 0.0]), (160.0, [4.66, 0.0])]
    {
        let mut copter = copter(wind(4.0, 250.0), heading_deg);
        fly(&mut copter, 30.0);
        let now = copter.true_state();
        assert!((now.roll_rad.to_degrees() - roll_deg).abs() < 0.1, "at {heading_deg}: {now:?}");
        assert!((now.pitch_rad.to_degrees() - pitch_deg).abs() < 0.1, "at {heading_deg}: {now:?}");
        // The wind moves the copter for about a second until it tilts, and then holds it off its set point.
        assert!(libm::hypot(now.north_m, now.east_m) < 6.0, "{now:?}");
        assert!(libm::hypot(now.north_m_s, now.east_m_s) < 0.05 && now.disturbing_acceleration_m_s2 < 0.05, "{now:?}");
        assert!((now.heading_rad.to_degrees() - heading_deg).abs() < 1e-9);
    }
}

#[test]
fn a_copter_yaws_level_to_either_side() {
    for side_sign in [1.0, -1.0] {
        let mut copter = copter(Weather::calm(), 20.0);
        let states = fly_leg(&mut copter, Leg::Yaw { rate_deg_s: 30.0, heading_change_deg: 360.0 * side_sign });
        let seconds = states.len() as f64 * STEP_S;
        // A full circle takes 12 s at 30 deg/s, and up to 0.6 s more to reach that rate.
        assert!((12.0..12.6).contains(&seconds), "{seconds} s");
        assert!((states[1000].heading_rate_rad_s.to_degrees() - 30.0 * side_sign).abs() < 0.1);
        assert!(states.iter().all(|state| state.roll_rad.abs() < 1e-3 && state.pitch_rad.abs() < 1e-3));
        assert!(states.iter().all(|state| libm::hypot(state.north_m, state.east_m) < 0.1));
    }
}

/// Directions are relative to the nose. A tilt of 18 deg accelerates by 3.19 m/s^2 less drag. Afterwards the copter
/// brakes to rest.
#[test]
fn a_tilt_leg_moves_the_copter_to_its_side() {
    for heading_deg in [0.0, 130.0] {
        for (toward_deg, [roll, pitch]) in
            [(0.0, [0.0, -1.0]), (90.0, [1.0, 0.0]), (180.0, [0.0, 1.0]), (270.0, [-1.0, 0.0])]
        {
            let mut copter = copter(Weather::calm(), heading_deg);
            let states = fly_leg(&mut copter, Leg::Tilt { toward_deg, tilt_deg: 18.0, seconds: 2.0 });
            let tilted = states[states.len() - 1];
            assert!((tilted.roll_rad.to_degrees() - 18.0 * roll).abs() < 0.5, "{toward_deg}: {tilted:?}");
            assert!((tilted.pitch_rad.to_degrees() - 18.0 * pitch).abs() < 0.5, "{toward_deg}: {tilted:?}");
            let most_m_s2 = states.iter().map(|state| state.disturbing_acceleration_m_s2).fold(0.0, f64::max);
            assert!((2.8..3.2).contains(&most_m_s2), "{most_m_s2}");
            let way_deg = libm::atan2(tilted.east_m_s, tilted.north_m_s).to_degrees();
            let off_deg = (way_deg - heading_deg - toward_deg + 180.0).rem_euclid(360.0) - 180.0;
            assert!(off_deg.abs() < 1.0, "{toward_deg} from {heading_deg}: {way_deg}");
            assert!((tilted.heading_rad.to_degrees() - heading_deg).abs() < 1e-9, "it does not turn");
            // Braking tilts to the opposite side.
            let braking = fly(&mut copter, 1.5)[299];
            let against = braking.roll_rad * roll + braking.pitch_rad * pitch;
            assert!(against.to_degrees() < -10.0, "{braking:?}");
            fly(&mut copter, 5.0);
            let final_state = copter.true_state();
            assert!(libm::hypot(final_state.north_m_s, final_state.east_m_s) < 0.3, "{final_state:?}");
        }
    }
}

/// 3 m/s with a drag time constant of 5 s decelerate by 0.6 m/s^2: 3.5 deg of nose-down pitch. A turn at 10 deg of bank
/// has a rate of g tan(10 deg) / 3 m/s = 33 deg/s.
#[test]
fn a_copter_flies_forward_and_banks_into_its_turns() {
    let mut copter = copter(Weather::calm(), 0.0);
    fly_leg(&mut copter, Leg::Straight { heading_deg: 60.0, seconds: 20.0 });
    let now = *copter.true_state();
    assert!(
        (now.heading_deg() - 60.0).abs() < 0.5
            && (libm::atan2(now.east_m_s, now.north_m_s).to_degrees() - 60.0).abs() < 1.0,
        "{now:?}"
    );
    // Drag (0.2/s) leaves a steady error of the proportional speed controller (gain 1/s): 3 m/s / 1.2.
    assert!((2.3..3.0).contains(&libm::hypot(now.north_m_s, now.east_m_s)), "{now:?}");
    assert!((-3.6..-2.4).contains(&now.pitch_rad.to_degrees()), "{now:?}");
    let states = fly_leg(&mut copter, Leg::Turn { bank_deg: 10.0, heading_change_deg: -360.0 });
    let turning = states[states.len() - 1];
    assert!((turning.heading_rate_rad_s.to_degrees() + 33.0).abs() < 1.0, "{turning:?}");
    assert!((-14.0..-6.0).contains(&turning.roll_rad.to_degrees()), "{turning:?}");
}

/// Position control partly counteracts the disturbances.
#[test]
fn gusts_disturb_attitude_and_position() {
    let mut copter = copter(Weather { wind_m_s: 0.0, ..Weather::default() }, 0.0);
    let states = fly(&mut copter, 300.0);
    let angles: [(&str, Quantity); 2] = [("roll", |state| state.roll_rad), ("pitch", |state| state.pitch_rad)];
    for (name, angle) in angles {
        assert!((0.6..2.0).contains(&sigma_deg(&states, angle)), "{name}: {}", sigma_deg(&states, angle));
    }
    assert!(states.iter().all(|state| libm::hypot(state.north_m, state.east_m) < 10.0));
    let push_m_s2 = mean(states.iter().map(|state| state.disturbing_acceleration_m_s2));
    assert!((0.1..0.6).contains(&push_m_s2), "{push_m_s2}");
}
