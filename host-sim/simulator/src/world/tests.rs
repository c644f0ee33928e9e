use nalgebra::Vector3;

use super::autopilot::Leg;
use super::*;
use testkit::clock;
use testkit::simulation::{ExecutorLevel, Simulation};

const EXAMPLE_AIRFRAME_FILE: &str = include_str!("../../../airframes/example.toml");

#[test]
fn the_example_file_shows_the_defaults() {
    let config = WorldConfig::from_toml(EXAMPLE_AIRFRAME_FILE, 3).unwrap();
    let defaults = WorldConfig::of_table1(3);
    assert_eq!(WorldConfig { airframe: defaults.airframe, ..config }, defaults);
    // The file's 8 % of soft iron and 24.8 uT of hard iron; singular values do not depend on the mounting.
    assert!((config.airframe.hard_iron_ut.norm() - 24.8).abs() < 0.1);
    assert!((config.airframe.field_matrix.singular_values().max() - 1.085).abs() < 0.01);
}

#[test]
fn a_world_file_selects_the_vehicle_kind() {
    let text = EXAMPLE_AIRFRAME_FILE
        .replace("kind = \"plane\"", "kind = \"copter\"")
        .replace("push_error_deg = 0.0", "push_error_deg = 1.5");
    let copter = WorldConfig::from_toml(&text, 3).unwrap();
    assert_eq!(copter.aircraft.kind, aircraft::VehicleKind::Copter);
    assert_eq!(copter.with_vehicle_kind(aircraft::VehicleKind::Copter), copter);
    let boat = copter.with_vehicle_kind(aircraft::VehicleKind::Boat);
    assert!((boat.attitude_source.push_error_deg - 0.4).abs() < 1e-9);
}

#[test]
fn mistakes_in_a_file_are_named() {
    let message = |from: &str, to: &str| {
        assert!(EXAMPLE_AIRFRAME_FILE.contains(from));
        WorldConfig::from_toml(&EXAMPLE_AIRFRAME_FILE.replace(from, to), 0).unwrap_err().to_string()
    };
    assert_eq!(
        message("inclination_deg = 54.0", "inclination_deg = 95.0"),
        "earth.inclination_deg is 95; it must lie in -85 to 85"
    );
    assert!(message("[1.08, 0.02, 0.01]", "[-1.08, 0.02, 0.01]").starts_with("determinant of airframe.soft_iron"));
    assert_eq!(message("speed_m_s = 3.0", "speed_m_s = 31.0"), "aircraft.speed_m_s is 31; it must lie in 0.5 to 30");
    assert_eq!(
        message("push_error_deg = 0.0", "push_error_deg = 11.0"),
        "attitude_source.push_error_deg is 11; it must lie in 0 to 10"
    );
    assert!(message("kind = \"plane\"", "kind = \"zeppelin\"").contains("unknown variant `zeppelin`"));
    assert!(message("gust_m_s = 0.5", "gust_m_s = nan").starts_with("weather.gust_m_s is NaN"));
    assert!(message("noise_deg", "noise_dge").contains("unknown field `noise_dge`"));
    assert!(message("[12.0, -8.5, 20.0]", "[12.0, -8.5]").contains("hard_iron_ut"));
}

#[test]
fn the_flight_does_not_depend_on_queries() {
    let flight = |look_every_us: u64| {
        let mut simulation = Simulation::new();
        let world = World::new(WorldConfig::random_world(5));
        let looker = world.clone();
        simulation.spawn(ExecutorLevel::World, "looker", async move {
            loop {
                embassy_time::Timer::after_micros(look_every_us).await;
                let _ = looker.sensor_field(clock::now_us());
            }
        });
        simulation.run_until(1_234_567);
        world.append_leg(Leg::Turn { bank_deg: 20.0, heading_change_deg: 90.0 });
        simulation.run_until(20_000_000);
        (world.true_state(20_000_000), world.sensor_field(19_000_001), world.unfinished_leg_count())
    };
    assert_eq!(flight(777), flight(10_000_000));
}

#[test]
fn states_of_the_past_two_seconds_are_available() {
    let mut simulation = Simulation::new();
    let config = WorldConfig { weather: weather::Weather::calm(), ..WorldConfig::of_table1(1) };
    let world = World::new(config);
    world.hold_bank_and_pitch(30.0, 0.0);
    simulation.run_until(20_000_000);
    let [now, then] = [20_000_000, 18_006_789].map(|at_us| world.true_state(at_us));
    assert_eq!(then.time_us, 18_006_789);
    let turned_rad = now.heading_rad - then.heading_rad;
    let expected_rad = now.heading_rate_rad_s * 1.993_211;
    assert!((turned_rad - expected_rad).abs() < 1e-6, "{turned_rad} for {expected_rad}");
    assert_eq!(world.true_state(0).time_us, 18_005_000, "older times give the oldest state");
}

/// In still hover the interference is the configured one; a tilt of 18 deg increases the current by a factor of 1.078.
#[test]
fn motor_current_interference_is_proportional_to_the_current() {
    let mut simulation = Simulation::new();
    let still = WorldConfig { weather: weather::Weather::calm(), ..WorldConfig::of_table1(1) };
    let world = World::new(still.with_vehicle_kind(aircraft::VehicleKind::Copter));
    simulation.run_until(2_000_000);
    let added_field_ut = |current_ut: [f64; 3]| {
        let at_us = clock::now_us();
        world.set_current_interference_ut([0.0; 3]);
        let without_current = world.sensor_field(at_us);
        world.set_current_interference_ut(current_ut);
        (world.sensor_field(at_us).ut - without_current.ut).x
    };
    assert!((added_field_ut([10.0, 0.0, 0.0]) - 10.0).abs() < 0.01);
    world.append_leg(Leg::Tilt { toward_deg: 90.0, tilt_deg: 18.0, seconds: 3.0 });
    simulation.run_until(4_900_000);
    assert!((added_field_ut([10.0, 0.0, 0.0]) - 10.78).abs() < 0.05);
    assert_eq!(WorldConfig::of_table1(1).current_interference_ut.map(f64::to_bits), [0; 3]);
    let interference_ut_per_a =
        Vector3::from(WorldConfig::of_table1(1).with_current_interference(8.0).current_interference_ut);
    assert!((interference_ut_per_a.norm() - 8.0).abs() < 1e-9);
    assert_ne!(
        interference_ut_per_a,
        Vector3::from(WorldConfig::of_table1(2).with_current_interference(8.0).current_interference_ut)
    );
}
