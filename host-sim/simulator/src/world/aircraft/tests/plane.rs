use super::*;

fn aircraft(weather: Weather, seed: u64) -> Aircraft {
    vehicle(VehicleKind::Plane, weather, seed)
}

fn expected_load_factor(bank_deg: f64) -> f64 {
    libm::cos(bank_deg.to_radians()).recip()
}

/// Coordinated turn: g tan(25 deg) / 22 m/s = 11.91 deg/s.
#[test]
fn the_turn_rate_is_that_of_a_coordinated_turn() {
    for bank_deg in [25.0, -25.0, 40.0] {
        let mut aircraft = aircraft(Weather::calm(), 1);
        aircraft.autopilot_mut().hold_bank_and_pitch(bank_deg, 0.0);
        fly(&mut aircraft, 10.0);
        let state = aircraft.true_state();
        assert!((state.roll_rad.to_degrees() - bank_deg).abs() < 0.01);
        let expected_deg_s = (9.806_65 * libm::tan(bank_deg.to_radians()) / 22.0_f64).to_degrees();
        let rate_deg_s = state.heading_rate_rad_s.to_degrees();
        assert!((rate_deg_s / expected_deg_s - 1.0).abs() < 1e-3, "{rate_deg_s} for {expected_deg_s} deg/s");
        let load = expected_load_factor(bank_deg);
        assert!(
            (state.relative_current / (load * load) - 1.0).abs() < 1e-3,
            "induced drag goes with the square of the load"
        );
        assert!((0.5..4.0).contains(&state.pitch_rad.to_degrees()), "the nose is a little up in a turn");
    }
}

#[test]
fn the_roll_rate_is_limited_and_the_bank_does_not_overshoot() {
    let mut aircraft = aircraft(Weather::calm(), 1);
    aircraft.autopilot_mut().hold_bank_and_pitch(45.0, 0.0);
    let states = fly(&mut aircraft, 8.0);
    let fastest_deg_s = states.iter().map(|state| state.roll_rate_rad_s.to_degrees()).fold(0.0, f64::max);
    let steepest_deg = states.iter().map(|state| state.roll_rad.to_degrees()).fold(0.0, f64::max);
    assert!((29.0..30.01).contains(&fastest_deg_s), "{fastest_deg_s} deg/s");
    assert!(steepest_deg < 45.5, "{steepest_deg} deg");
    assert!((states[states.len() - 1].roll_rad.to_degrees() - 45.0).abs() < 0.1);
}

/// 1800 s are 1200 correlation times, so the standard deviations are accurate to about 3 %. Gusts of 0.5 m/s cause 1.3
/// degrees of sideslip; half of it adds to the bank and 0.3 of it to the pitch.
#[test]
fn bank_and_pitch_have_the_configured_standard_deviation() {
    let mut aircraft = aircraft(Weather::default(), 2);
    let states = fly(&mut aircraft, 1800.0);
    let sigma_deg =
        |quantity: fn(&TrueState) -> f64| mean(states.iter().map(|state| square(quantity(state)))).sqrt().to_degrees();
    let sideslip_deg = (0.5_f64 / 22.0).to_degrees();
    let bank_deg = libm::hypot(1.5_f64, 0.5 * sideslip_deg);
    let pitch_deg = libm::hypot(1.0_f64, 0.3 * sideslip_deg);
    assert!((sigma_deg(|state| state.roll_rad) / bank_deg - 1.0).abs() < 0.1);
    assert!((sigma_deg(|state| state.pitch_rad) / pitch_deg - 1.0).abs() < 0.1);
    assert!((sigma_deg(|state| state.sideslip_rad) / sideslip_deg - 1.0).abs() < 0.15);
}

/// A wind of 4 m/s from 250 degrees drifts the aircraft toward 070; full circles cancel its own motion.
#[test]
fn the_wind_moves_the_ground_track_not_the_heading() {
    let weather = Weather { wind_m_s: 4.0, wind_from_deg: 250.0, ..Weather::calm() };
    let mut aircraft = aircraft(weather, 1);
    aircraft.autopilot_mut().hold_bank_and_pitch(30.0, 0.0);
    fly(&mut aircraft, 5.0);
    let before = *aircraft.true_state();
    while aircraft.true_state().heading_rad < before.heading_rad + 10.0 * TAU {
        aircraft.advance_step();
    }
    let after = aircraft.true_state();
    let seconds = (after.time_us - before.time_us) as f64 / 1e6;
    let drift_m_s = libm::hypot(after.north_m - before.north_m, after.east_m - before.east_m) / seconds;
    let toward_deg = libm::atan2(after.east_m - before.east_m, after.north_m - before.north_m).to_degrees();
    assert!((drift_m_s - 4.0).abs() < 0.01, "{drift_m_s} m/s");
    assert!((toward_deg - 70.0).abs() < 0.2, "{toward_deg} deg");
}
