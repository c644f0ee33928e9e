//! GPS course as a reference heading, and the ranking of references.

use autoswing::frames::wrap_pi;
use log_analysis::log::log_writers::{FlightRecording, encode_dataflash, encode_tlog, encode_ulog};
use log_analysis::log::{FieldCorrection, LoggedFlight};
use log_analysis::replay::evaluation::{evaluate_flight, score_correction};
use log_analysis::replay::gps_course::{GpsCourseHeading, GpsCourseRejection};
use log_analysis::replay::parameter_export::ParameterFormat;
use log_analysis::replay::verdict::Verdict;
use log_analysis::replay::{ReferenceHeading, build_rows};
use simulator::recording::record_sample;
use simulator::world::aircraft::VehicleKind;
use simulator::world::autopilot::Leg;
use simulator::world::{World, WorldConfig};

use super::{DEFAULT_OPTIONS, evaluate_log, read_flight, warnings_text};

/// A circle each way, then 30 s in each direction.
fn record_circles_and_legs(world: &WorldConfig, headings_deg: &[f64]) -> FlightRecording {
    let world = World::new(*world);
    for heading_change_deg in [360.0, -360.0] {
        world.append_leg(Leg::Turn { bank_deg: 25.0, heading_change_deg });
    }
    for &heading_deg in headings_deg {
        world.append_leg(Leg::Straight { heading_deg, seconds: 30.0 });
    }
    record_world(&world, 70 + headings_deg.len() as u64 * 30)
}

/// Records the flight of a world at 48 N, with GPS, until a time in seconds.
fn record_world(world: &World, end_s: u64) -> FlightRecording {
    let mut source = world.attitude_source();
    let mut recording = FlightRecording { start_position: Some([48.0, 11.3, 500.0]), ..FlightRecording::default() };
    for i in 10..end_s * 10 {
        record_sample(&mut recording, world, &mut source, i * 100_000);
    }
    recording
}

const ALL_ROUND_HEADINGS_DEG: [f64; 6] = [10.0, 130.0, 250.0, 70.0, 190.0, 310.0];

fn config_with_wind(seed: u64, wind_m_s: f64) -> WorldConfig {
    let mut world = WorldConfig::random_world(seed);
    (world.weather.wind_m_s, world.weather.wind_from_deg) = (wind_m_s, 250.0);
    world
}

/// Receiver latency 0.3 s, no gusts and so no sideslip. A bank wandering by 1.5 deg turns the nose by 0.7 deg/s, logged
/// at 1 Hz over MAVLink, hence limits of 1 deg for each heading and 0.3 deg for the mean of a leg. The recorded yaw is
/// the truth.
#[test]
fn gps_course_gives_the_heading_of_straight_flight_in_any_wind() {
    for (seed, wind_m_s, write) in [
        (1, 0.0, encode_dataflash as fn(&FlightRecording) -> Vec<u8>),
        (1, 8.0, encode_dataflash),
        (2, 8.0, encode_tlog),
        (3, 10.0, encode_ulog),
    ] {
        let mut world = config_with_wind(seed, wind_m_s);
        world.weather.gust_m_s = 0.0;
        let flight = read_flight(&write(&delay_velocity(record_circles_and_legs(&world, &ALL_ROUND_HEADINGS_DEG))));
        let course = GpsCourseHeading::from_flight(&flight).unwrap();
        let name = format!("{:?}, {wind_m_s} m/s: {}", flight.log_format, course.accuracy_description());
        assert!((course.wind_speed_m_s() - wind_m_s).abs() < 0.2, "{name}");
        let is_from = (course.wind_from_deg() - 250.0).abs() < 2.0;
        assert!((is_from || wind_m_s == 0.0) && (course.airspeed_m_s - 22.0).abs() < 0.2, "{name}");
        let mut by_leg: [Vec<f64>; 12] = Default::default();
        for row in flight.attitude.rows() {
            let [roll_rad, _, yaw_rad] = row.row_values;
            let Some(found_rad) = course.heading_rad(row.t_s) else { continue };
            assert!(roll_rad.abs() < 0.2, "{name}: banked by {roll_rad} at {}", row.t_s);
            let error_deg = f64::from(wrap_pi(found_rad - yaw_rad).to_degrees());
            assert!(error_deg.abs() < 1.0, "{name}: {error_deg} at {}", row.t_s);
            by_leg[(f64::from(yaw_rad).to_degrees().rem_euclid(360.0) / 30.0) as usize].push(error_deg);
        }
        assert!(by_leg.concat().len() > 900, "{name}: {}", by_leg.concat().len());
        for leg in by_leg.iter().filter(|leg| leg.len() > 100) {
            let mean_deg = leg.iter().sum::<f64>() / leg.len() as f64;
            assert!(mean_deg.abs() < 0.3, "{name}: {mean_deg}");
        }
    }
}

/// Delays the GPS velocity by 0.3 s.
fn delay_velocity(mut recording: FlightRecording) -> FlightRecording {
    let velocities: Vec<[f64; 2]> = recording.samples.iter().map(|flight_sample| flight_sample.velocity_m_s).collect();
    for (flight_sample, velocity_m_s) in recording.samples.iter_mut().skip(3).zip(velocities) {
        flight_sample.velocity_m_s = velocity_m_s;
    }
    recording
}

/// Gusts last 1.5 s, so sideslip averages to a sixth of its sigma over 100 s; the bound is three times that. Hard iron,
/// like a wind wrongly estimated from headings, causes an error of one cycle a turn.
#[test]
fn errors_against_gps_course_match_errors_against_the_truth() {
    for seed in 1..5 {
        let flight = read_flight(&encode_dataflash(&record_circles_and_legs(
            &config_with_wind(seed, 7.0),
            &ALL_ROUND_HEADINGS_DEG,
        )));
        let course = ReferenceHeading::best_reference(&flight).unwrap();
        assert!(course.measures_error() && course.reference_name() == "GPS course in straight flight", "{course:?}");
        let [by_course, mut by_truth] = [&course, &ReferenceHeading::AutopilotYaw]
            .map(|reference| build_rows(&flight, &flight.compasses[0], 0.0, Some(reference)).0);
        for (true_row, course_row) in by_truth.iter_mut().zip(&by_course) {
            true_row.reference_deg = true_row.reference_deg.filter(|_| course_row.reference_deg.is_some());
        }
        let [course_score, true_score] =
            [by_course, by_truth].map(|rows| score_correction(&rows, &FieldCorrection::identity()).unwrap());
        let sigma_deg = course.gps_course_solution().unwrap().sigma_deg();
        let about = format!("seed {seed}: {course_score:?} {true_score:?}");
        assert!(true_score.rms_deg > 3.0, "too good a compass for a comparison: {about}");
        assert!((course_score.rms_deg - true_score.rms_deg).abs() < sigma_deg / 2.0, "{about}");
        assert!((course_score.mean_deg - true_score.mean_deg).abs() < sigma_deg / 2.0, "{about}");
    }
}

/// A wind that changes by 8 m/s, and legs out and back alone.
#[test]
fn where_gps_course_gives_no_heading_the_autopilots_yaw_is_compared_and_the_reason_reported() {
    let mut changing_wind = record_circles_and_legs(&config_with_wind(1, 5.0), &ALL_ROUND_HEADINGS_DEG);
    let sample_count = changing_wind.samples.len() as f64;
    for (i, sample) in changing_wind.samples.iter_mut().enumerate() {
        let change_m_s = 6.0 * i as f64 / sample_count;
        sample.velocity_m_s = [sample.velocity_m_s[0] + change_m_s, sample.velocity_m_s[1] - change_m_s];
    }
    let out_and_back = record_circles_and_legs(&config_with_wind(1, 5.0), &[30.0, 210.0, 30.0, 210.0]);
    for (expected, recording) in
        [(GpsCourseRejection::FewDirections, out_and_back), (GpsCourseRejection::UncertainWind, changing_wind)]
    {
        let flight = read_flight(&encode_dataflash(&recording));
        assert_eq!(GpsCourseHeading::from_flight(&flight).unwrap_err(), expected);
        assert_eq!(ReferenceHeading::best_reference(&flight), Some(ReferenceHeading::AutopilotYaw), "{expected:?}");
        let warnings = warnings_text(&flight, &evaluate_flight(&flight, &DEFAULT_OPTIONS));
        assert!(warnings.contains(expected.description()), "{expected:?}: {warnings}");
    }
}

/// A rotorcraft not identified as such: it hovers and is pushed at a constant heading, faster than a slow aeroplane.
#[test]
fn a_copter_is_not_compared_with_its_course() {
    let mut config = config_with_wind(1, 2.0);
    config.aircraft.kind = VehicleKind::Copter;
    let world = World::new(config);
    for i in 0..8 {
        world.append_leg(Leg::Tilt { toward_deg: f64::from(i) * 45.0, tilt_deg: 15.0, seconds: 20.0 });
        world.append_leg(Leg::Hover { seconds: 10.0 });
    }
    let mut recording = record_world(&world, 240);
    assert_eq!(
        GpsCourseHeading::from_flight(&read_flight(&encode_ulog(&recording))).unwrap_err(),
        GpsCourseRejection::Copter
    );
    recording.is_copter = false;
    assert!(GpsCourseHeading::from_flight(&read_flight(&encode_ulog(&recording))).is_err());
}

#[test]
fn gps_course_is_reported_with_its_accuracy() {
    let recording = record_circles_and_legs(&config_with_wind(1, 5.0), &ALL_ROUND_HEADINGS_DEG);
    let (flight, verdict) = evaluate_log(&encode_tlog(&recording));
    let json = Verdict::new(&flight, &verdict, ParameterFormat::ArduPilot).json();
    let reference = &json["reference"];
    assert_eq!(reference["is_accuracy"], true);
    assert!((reference["course"]["wind_m_s"].as_f64().unwrap() - 5.0).abs() < 0.2, "{reference}");
    let limits = reference["limits"].as_str().unwrap();
    let expected = ["no compass", "5.0 m/s from 250", "sideslip", "banked"];
    assert!(expected.iter().all(|text| limits.contains(text)), "{limits}");
    let described = include_str!("../../../docs/json.md");
    for field in reference["course"].as_object().unwrap().keys() {
        assert!(described.contains(&format!("`{field}`")), "{field}: docs/json.md");
    }
}

#[test]
fn references_are_ranked() {
    let mut flight =
        read_flight(&encode_dataflash(&record_circles_and_legs(&config_with_wind(1, 5.0), &ALL_ROUND_HEADINGS_DEG)));
    let best_name = |flight: &LoggedFlight| ReferenceHeading::best_reference(flight).unwrap().reference_name();
    let mut ranked = vec![best_name(&flight)];
    for row in flight.gps.rows_mut() {
        row.row_values[5] = 90.0;
    }
    ranked.push(best_name(&flight));
    flight.true_attitude = flight.attitude.clone();
    ranked.push(best_name(&flight));
    assert_eq!(ranked, ["GPS course in straight flight", "GPS yaw", "the simulator's own attitude"]);
}
