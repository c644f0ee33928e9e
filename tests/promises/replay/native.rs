//! Replays of a flight logged in each autopilot's format.

use log_analysis::log::LoggedFlight;
use log_analysis::log::log_writers::{
    FlightRecording, encode_blackbox, encode_csv, encode_dataflash, encode_tlog, encode_ulog,
};
use log_analysis::replay::evaluation::{CompassEvaluation, CorrectionSource, evaluate_flight};
use nalgebra::Vector3;
use simulator::recording::record_turns;
use simulator::world::{CRUISE_CURRENT_A, WorldConfig};

use super::{DEFAULT_OPTIONS, compare_with_module, max_rms_deg, module_result, module_score, read_flight};

/// ArduPilot's and PX4's parameters of a badly calibrated compass.
const BAD_PARAMETERS: [(&str, f64); 16] = [
    ("COMPASS_OFS_X", 90.0),
    ("COMPASS_OFS_Y", -120.0),
    ("COMPASS_DIA_X", 1.1),
    ("COMPASS_DIA_Y", 0.9),
    ("COMPASS_DIA_Z", 1.05),
    ("COMPASS_ODI_X", 0.05),
    ("COMPASS_ODI_Z", -0.06),
    ("COMPASS_SCALE", 1.1),
    ("COMPASS_USE", 1.0),
    ("COMPASS_ORIENT", 0.0),
    ("CAL_MAG0_ID", 396_809.0),
    ("CAL_MAG0_ROT", 6.0),
    ("CAL_MAG0_XOFF", 0.15),
    ("CAL_MAG0_ZOFF", -0.1),
    ("CAL_MAG0_YSCALE", 1.1),
    ("CAL_MAG0_YODIAG", 0.04),
];

/// Turns both ways, logged with bad parameters and a field latency.
fn record_flight(world: &WorldConfig, age_s: f64) -> FlightRecording {
    record_turns(world, age_s).with_parameters(&BAD_PARAMETERS)
}

fn evaluate_compass(bytes: &[u8]) -> (LoggedFlight, CompassEvaluation) {
    let (flight, mut evaluation) = compare_with_module(bytes);
    (flight, evaluation.compasses.remove(0))
}

/// The latency is found within 10 ms, or 2.5 standard deviations in a flight with little rolling.
#[test]
fn a_native_log_gives_heading_and_field_latency() {
    let world = WorldConfig::random_world(3);
    for (age_s, write) in [
        (0.05, encode_dataflash as fn(&FlightRecording) -> Vec<u8>),
        (0.09, encode_tlog),
        (0.02, encode_ulog),
        (0.0, encode_csv),
        (0.03, encode_blackbox),
    ] {
        let recording = record_flight(&world, age_s);
        let (flight, compass) = evaluate_compass(&write(&recording));
        let name = flight.log_format.format_name();
        let most_s = 2.5 * compass.latency.sigma_s.unwrap();
        assert!((compass.latency.used_s - age_s).abs() < most_s.max(0.01), "{name}: {:?}", compass.latency);
        assert_eq!(module_result(&compass).outcome.acceptance, Ok(()), "{name}");
        let module_score = module_score(&compass);
        assert!(module_score.rms_deg < max_rms_deg(&world), "{name}: {module_score:?}");
        if let Some(as_logged) = compass.score_by(CorrectionSource::Autopilot) {
            assert!(as_logged.rms_deg > 2.0 * module_score.rms_deg, "{name}: {as_logged:?}");
        }
        let usable_count = compass.rows.iter().filter(|row| row.is_usable).count();
        assert!(compass.row_counts.used == usable_count && usable_count > 2300, "{name}: {:?}", compass.row_counts);
    }
}

/// Disarmed rows near a steel hangar affect no calibrator.
#[test]
fn disarmed_rows_are_used_by_no_calibrator() {
    let world = WorldConfig::of_table1(1);
    let mut recording = record_turns(&world, 0.0);
    for (i, sample) in recording.samples.iter_mut().enumerate() {
        sample.is_armed = i >= 400;
        if !sample.is_armed {
            sample.field_ut[0] = [300.0, -200.0 + i as f64 / 10.0, 100.0];
        }
    }
    let (_, compass) = evaluate_compass(&encode_csv(&recording));
    let strength_ut = compass.parameter_fit.strength_ut().unwrap();
    assert!((strength_ut - 48.0).abs() < 5.0, "{strength_ut} uT");
    for correction_source in [CorrectionSource::Sphere, CorrectionSource::Ellipsoid] {
        // A sphere fit leaves the soft iron's error.
        let score = compass.score_by(correction_source).unwrap();
        assert!(score.rms_deg < 10.0, "{correction_source:?} {score:?}");
    }
}

/// Interference of 8 uT in level flight at 15 A, so 0.5 uT/A; the current rises with bank. A negated one means its size.
#[test]
fn motor_current_interference_is_estimated() {
    for (seed, sign, write) in [
        (3, 1.0, encode_dataflash as fn(&FlightRecording) -> Vec<u8>),
        (5, -1.0, encode_ulog),
        (7, 1.0, encode_tlog),
        (9, -1.0, encode_csv),
    ] {
        let world = WorldConfig::random_world(seed).with_current_interference(8.0);
        let mut recording = record_flight(&world, 0.05);
        recording.samples.iter_mut().for_each(|sample| sample.current_a *= sign);
        let (_, compass) = evaluate_compass(&write(&recording));
        assert_eq!(module_result(&compass).outcome.acceptance, Ok(()), "seed {seed}");
        let interference = module_result(&compass).outcome.solution.unwrap().calibration.motor_current;
        for (estimated_ut_per_a, added_field_ut) in interference.ut_per_a.iter().zip(world.current_interference_ut) {
            let estimate_error = f64::from(*estimated_ut_per_a) - added_field_ut / CRUISE_CURRENT_A;
            let limit = 4.0 * f64::from(interference.sigma_ut_per_a) + 0.01;
            assert!(estimate_error.abs() < limit, "seed {seed}: {interference:?} {:?}", world.current_interference_ut);
        }
        let module_score = module_score(&compass);
        assert!(module_score.rms_deg < max_rms_deg(&world), "seed {seed}: {module_score:?}");
    }
}

/// The field model is valid on its own days only. If the world's inclination is 12 deg off, the model's is dropped.
#[test]
fn the_model_inclination_is_used_only_on_days_of_its_validity() {
    for (inclination_deg, is_right) in [(64.0, true), (52.0, false)] {
        let mut world = WorldConfig::random_world(3);
        world.earth.inclination_deg = inclination_deg;
        let recording = FlightRecording { start_position: Some([48.0, 11.3, 500.0]), ..record_turns(&world, 0.0) };
        let flight = read_flight(&encode_dataflash(&recording));
        let of_that_day = evaluate_flight(&flight, &DEFAULT_OPTIONS);
        let of_another = evaluate_flight(&LoggedFlight { flight_date: None, ..flight }, &DEFAULT_OPTIONS);
        for (verdict, is_valid) in [(&of_that_day, true), (&of_another, false)] {
            let (earth, is_model_valid) = verdict.earth_field.as_ref().unwrap();
            assert!(*is_model_valid == is_valid && (earth.inclination_deg - 64.0).abs() < 1.0, "{earth:?}");
            assert!(verdict.compasses[0].parameter_fit.fit.is_some(), "{inclination_deg} deg, {is_valid}");
        }
        let [configured, unconfigured] =
            [of_that_day, of_another].map(|verdict| verdict.compasses[0].parameter_fit.solution().unwrap().calibration);
        assert_eq!(configured != unconfigured, is_right, "{inclination_deg}: {configured:?}");
    }
}

/// Steps of 8 uT. Limits: 0.3 uT with a sixth of the flight on one side, and 0.5 s of the log's clock.
#[test]
fn a_hard_iron_step_is_found_at_any_time_with_its_full_size() {
    for world in [WorldConfig::of_table1(1), WorldConfig::random_world(3), WorldConfig::random_world(5)] {
        for at_s in [40.0, 120.0, 180.0] {
            let mut recording = record_turns(&world, 0.0);
            for sample in recording.samples.iter_mut().filter(|sample| sample.time_us as f64 * 1e-6 >= at_s) {
                sample.field_ut[0][0] += 8.0;
            }
            let changes = evaluate_compass(&encode_csv(&recording)).1.causes.hard_iron_changes;
            let [change] = changes.as_slice() else {
                panic!("{at_s} s, {} deg: {changes:?}", world.earth.inclination_deg)
            };
            let off_ut = change.step_ut - Vector3::new(8.0, 0.0, 0.0);
            assert!(off_ut.norm() < 0.3 && (change.time_s - at_s).abs() < 0.5, "{at_s} s: {change:?}");
        }
    }
}
