//! Replays of a flight logged in each autopilot's format, and the exported parameters.

use std::fmt::Write as _;

use log_analysis::log::csv::FieldUnit;
use log_analysis::log::log_writers::{FlightRecording, encode_csv, encode_dataflash, encode_tlog, encode_ulog};
use log_analysis::log::{self, FieldCorrection, Flight, NumberedRotation};
use log_analysis::replay::HeadingScore;
use log_analysis::replay::evaluation::{
    CompassEvaluation, CorrectionSource, EvaluationOptions, evaluate_flight, score_correction,
};
use log_analysis::replay::hard_iron_changes::HardIronChange;
use log_analysis::replay::log_warning::LogWarning;
use log_analysis::replay::parameter_export::{self, ExportedCorrection, ParameterFormat};
use log_analysis::replay::verdict::{CompassAction, Verdict};
use nalgebra::{Matrix3, Vector3};
use simulator::recording::record_turns;
use simulator::world::{CRUISE_CURRENT_A, WorldConfig};

use super::{DEFAULT_OPTIONS, read_flight};

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
    let parameters = BAD_PARAMETERS.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    FlightRecording { parameters, ..record_turns(world, age_s) }
}

fn evaluate_log(bytes: &[u8]) -> (Flight, CompassEvaluation) {
    let flight = read_flight(bytes);
    let mut verdict = evaluate_flight(&flight, &DEFAULT_OPTIONS);
    (flight, verdict.compasses.remove(0))
}

/// The latency is found within 10 ms, or 2.5 standard deviations in a flight with little rolling. The limit of the
/// heading error is due to attitude noise of 0.3 deg.
#[test]
fn a_native_log_gives_heading_and_field_latency() {
    let world = WorldConfig::random_world(3);
    let noise_deg = 0.45 * world.earth.inclination_deg.to_radians().tan().abs();
    for (age_s, write) in [
        (0.05, encode_dataflash as fn(&FlightRecording) -> Vec<u8>),
        (0.09, encode_tlog),
        (0.02, encode_ulog),
        (0.0, encode_csv),
    ] {
        let recording = record_flight(&world, age_s);
        let (flight, compass) = evaluate_log(&write(&recording));
        let name = flight.log_format.format_name();
        let most_s = 2.5 * compass.latency.sigma_s.unwrap();
        assert!((compass.latency.used_s - age_s).abs() < most_s.max(0.01), "{name}: {:?}", compass.latency);
        assert_eq!(compass.module_result.acceptance, Ok(()), "{name}");
        let module_score = compass.correction_from(CorrectionSource::Module).unwrap().score.unwrap();
        assert!(module_score.rms_deg < 0.5 + noise_deg, "{name}: {module_score:?}");
        assert_eq!(compass.rms_without_current_deg, None, "{name}: nothing goes with the current");
        if let Some(autopilot_correction) = compass.correction_from(CorrectionSource::Autopilot) {
            assert!(
                autopilot_correction.score.unwrap().rms_deg > 2.0 * module_score.rms_deg,
                "{name}: {autopilot_correction:?}"
            );
        }
        let usable_count = compass.rows.iter().filter(|row| row.is_usable).count();
        assert!(compass.row_counts.used == usable_count && usable_count > 2300, "{name}: {:?}", compass.row_counts);
    }
}

/// Disarmed rows near a steel hangar affect no calibrator. The second compass is evaluated alone when selected.
#[test]
fn disarmed_rows_are_used_by_no_calibrator() {
    let world = WorldConfig::of_table1(1);
    let mut recording = record_turns(&world, 0.0);
    for (i, sample) in recording.samples.iter_mut().enumerate() {
        sample.is_armed = i >= 400;
        if !sample.is_armed {
            sample.field_ut[0] = [300.0, -200.0 + i as f64 / 10.0, 100.0];
        }
        sample.field_ut.push([1.0, 2.0, 3.0]);
    }
    let (_, compass) = evaluate_log(&encode_csv(&recording));
    assert!((compass.sphere_radius_ut.unwrap() - 48.0).abs() < 3.0, "{:?} uT", compass.sphere_radius_ut);
    for correction_source in [CorrectionSource::Sphere, CorrectionSource::Ellipsoid] {
        // A sphere fit leaves the soft iron's error.
        assert!(
            compass.correction_from(correction_source).unwrap().score.unwrap().rms_deg < 10.0,
            "{correction_source:?}: {:?}",
            compass.correction_from(correction_source)
        );
    }
    let flight = read_flight(&encode_dataflash(&recording));
    let verdict = evaluate_flight(&flight, &EvaluationOptions { compass_number: Some(2), ..DEFAULT_OPTIONS });
    assert_eq!((flight.compasses.len(), verdict.compasses.len(), verdict.compasses[0].compass_number), (2, 1, 2));
}

/// The written file is parsed and applied by the autopilot's own formula.
#[test]
fn exported_parameters_give_the_predicted_heading_error() {
    for (seed, write, dialect) in [
        (3, encode_dataflash as fn(&FlightRecording) -> Vec<u8>, ParameterFormat::ArduPilot),
        (5, encode_ulog, ParameterFormat::Px4),
        (7, encode_tlog, ParameterFormat::ArduPilot),
    ] {
        let (flight, compass) = evaluate_log(&write(&record_flight(&WorldConfig::random_world(seed), 0.05)));
        let export = export_module_calibration(&compass, Some(50.0), dialect);
        let score = score_of_file(&flight, &compass, &export, dialect);
        let module_score = compass.correction_from(CorrectionSource::Module).unwrap().score.unwrap();
        let max_rms_deg = module_score.rms_deg + export.heading_loss_deg[0] + 0.05;
        assert!(score.rms_deg < max_rms_deg, "seed {seed}: {score:?}, {module_score:?}, {:?}", export.heading_loss_deg);
        // The correction has the scale of the given field strength.
        let strengths: Vec<f64> =
            compass.rows.iter().map(|row| row.corrected_field(&export.correction).norm()).collect();
        let mean = strengths.iter().sum::<f64>() / strengths.len() as f64;
        assert!((mean - 50.0).abs() < 1.5, "seed {seed}: {mean}");
    }
}

/// ArduPilot rotates an internal compass with the board.
#[test]
fn an_internal_compass_is_given_no_orientation() {
    let (mut flight, compass) = evaluate_log(&encode_dataflash(&record_flight(&WorldConfig::random_world(3), 0.05)));
    let mut export = export_module_calibration(&compass, None, ParameterFormat::ArduPilot);
    export.rotation_from_logged = NumberedRotation::new(2.0).unwrap();
    for (external, line) in
        [(1.0, "\nCOMPASS_ORIENT,2\n"), (0.0, "\n# COMPASS_ORIENT: not used, because COMPASS_EXTERNAL is 0")]
    {
        flight.parameters.set_value(0.0, "COMPASS_EXTERNAL", external);
        let text =
            parameter_export::format_parameter_file(&flight, std::slice::from_ref(&export), ParameterFormat::ArduPilot);
        assert!(text.contains(line), "{external}: {text}");
    }
}

/// Interference of 8 uT in level flight at 15 A, so 0.5 uT/A; the current rises with bank.
#[test]
fn motor_current_interference_is_estimated_and_exported() {
    for (seed, write, dialect) in [
        (3, encode_dataflash as fn(&FlightRecording) -> Vec<u8>, ParameterFormat::ArduPilot),
        (5, encode_ulog, ParameterFormat::Px4),
        (7, encode_tlog, ParameterFormat::ArduPilot),
        (9, encode_csv, ParameterFormat::Px4),
    ] {
        let world = WorldConfig::random_world(seed).with_current_interference(8.0);
        let noise_deg = 0.45 * world.earth.inclination_deg.to_radians().tan().abs();
        let (flight, compass) = evaluate_log(&write(&record_flight(&world, 0.05)));
        assert_eq!(compass.module_result.acceptance, Ok(()), "seed {seed}");
        let interference = compass.module_result.solution.as_ref().unwrap().calibration.motor_current;
        for (estimated_ut_per_a, added_field_ut) in interference.ut_per_a.iter().zip(world.current_interference_ut) {
            let estimate_error = f64::from(*estimated_ut_per_a) - added_field_ut / CRUISE_CURRENT_A;
            assert!(
                estimate_error.abs() < 4.0 * f64::from(interference.sigma_ut_per_a) + 0.01,
                "seed {seed}: {interference:?} {:?}",
                world.current_interference_ut
            );
        }
        let module_score = compass.correction_from(CorrectionSource::Module).unwrap().score.unwrap();
        assert!(module_score.rms_deg < 0.5 + noise_deg, "seed {seed}: {module_score:?}");
        assert!(
            compass.rms_without_current_deg.unwrap() > 1.5 * module_score.rms_deg,
            "seed {seed}: {:?}",
            compass.rms_without_current_deg
        );
        let export = export_module_calibration(&compass, Some(50.0), dialect);
        let score = score_of_file(&flight, &compass, &export, dialect);
        assert!(
            score.rms_deg < module_score.rms_deg + export.heading_loss_deg[0] + 0.05,
            "seed {seed}: {score:?} {module_score:?}"
        );
        // Without current compensation the mean interference goes into the offsets, and its variation is lost.
        let inav = export_module_calibration(&compass, Some(50.0), ParameterFormat::Inav);
        assert!(inav.warnings.iter().any(|warning| warning.contains("current")), "seed {seed}: {:?}", inav.warnings);
        assert!(inav.heading_loss_deg[0] > export.heading_loss_deg[0], "seed {seed}: {inav:?}");
        // Without compensation 0.5 uT/A times 10 A in a bank would cause degrees of heading error.
        assert!(inav.heading_loss_deg[0] > 0.3, "seed {seed}: {inav:?}");
        // The file rounds to whole numbers: offsets to 0.5 mG, gains to 1/1024.
        let score = score_correction(
            &compass.rows,
            &parse_inav_correction(&parameter_export::format_parameter_file(
                &flight,
                std::slice::from_ref(&inav),
                ParameterFormat::Inav,
            )),
        )
        .unwrap();
        let unrounded_score = score_correction(&compass.rows, &inav.correction).unwrap();
        assert!((score.rms_deg - unrounded_score.rms_deg).abs() < 0.1, "seed {seed}: {score:?} {inav:?}");
    }
}

/// Parses INAV's zeros and gains: `(raw - zero) 1024 / gain`, raw in milligauss.
fn parse_inav_correction(text: &str) -> FieldCorrection {
    let parameter = |name: &str, axis: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(&format!("set {name}_{axis} = "))).unwrap();
        line.parse::<f64>().unwrap()
    };
    let parameter_vector = |name: &str| Vector3::from(["x", "y", "z"].map(|axis| parameter(name, axis)));
    FieldCorrection::without_current(
        Matrix3::from_diagonal(&parameter_vector("maggain").map(|gain| 1024.0 / gain)),
        parameter_vector("magzero") * 0.1,
    )
}

/// Parameters that ArduPilot rejects are not given: the compass is to be moved.
#[test]
fn no_parameters_are_given_beyond_compass_offs_max() {
    let (mut flight, compass) = evaluate_log(&encode_dataflash(&record_flight(&WorldConfig::random_world(3), 0.05)));
    let evaluation = evaluate_flight(&flight, &DEFAULT_OPTIONS);
    let offsets_mg =
        export_module_calibration(&compass, Some(50.0), ParameterFormat::ArduPilot).correction.hard_iron_ut * 10.0;
    for (limit_ratio, action) in [(0.95, CompassAction::Replace), (1.05, CompassAction::LoadParameters)] {
        flight.parameters.set_value(f64::MAX, "COMPASS_OFFS_MAX", offsets_mg.amax() * limit_ratio);
        let judgement = &Verdict::new(&flight, &evaluation, ParameterFormat::ArduPilot).compasses[0].judgement;
        assert_eq!(judgement.recommended_action, action, "{judgement:?}");
    }
}

fn export_module_calibration(
    compass: &CompassEvaluation,
    total_ut: Option<f64>,
    dialect: ParameterFormat,
) -> ExportedCorrection {
    let calibration = &compass.module_result.solution.as_ref().unwrap().calibration;
    parameter_export::export_correction(compass.compass_number, &compass.rows, calibration, total_ut, dialect).unwrap()
}

/// Heading score of the exported parameters, parsed as by the autopilot.
fn score_of_file(
    flight: &Flight,
    compass: &CompassEvaluation,
    export: &ExportedCorrection,
    dialect: ParameterFormat,
) -> HeadingScore {
    let text = parameter_export::format_parameter_file(flight, std::slice::from_ref(export), dialect);
    let loaded = parameter_export::parse_parameter_file(&text, &flight.parameters);
    assert_eq!(export.rotation_from_logged.rotation_number(), 0, "mounted as the log says");
    let correction = match dialect {
        ParameterFormat::Px4 => FieldCorrection::from_px4(&loaded, compass.compass_number),
        ParameterFormat::ArduPilot | ParameterFormat::Inav => {
            FieldCorrection::from_ardupilot(&loaded, compass.compass_number)
        }
    };
    score_correction(&compass.rows, &correction).unwrap()
}

#[test]
fn implausible_units_are_reported() {
    let world = WorldConfig::of_table1(1);
    // A place whose field strength, 48 uT, is about the simulated one.
    let text = encode_csv(&FlightRecording { start_position: Some([48.0, 11.3, 500.0]), ..record_flight(&world, 0.0) });
    let notes = |bytes: &[u8], unit: FieldUnit| {
        let mut source = bytes;
        let flight = log::read_flight(&mut source, unit).unwrap();
        let notes = LogWarning::warnings_of_flight(&flight, &evaluate_flight(&flight, &DEFAULT_OPTIONS));
        notes.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
    };
    assert_eq!(notes(&text, FieldUnit::Milligauss), "");
    let notes_in_ut = notes(&text, FieldUnit::Microtesla);
    assert!(notes_in_ut.contains("milligauss read as microtesla"), "{notes_in_ut}");
    let radians: String = String::from_utf8(text)
        .unwrap()
        .lines()
        .map(|line| {
            let mut values: Vec<String> = line.split(',').map(str::to_owned).collect();
            for value in &mut values[4..6] {
                if let Ok(degrees) = value.parse::<f64>() {
                    *value = format!("{:.5}", degrees.to_radians());
                }
            }
            values.join(",") + "\n"
        })
        .collect();
    let notes_text = notes(radians.as_bytes(), FieldUnit::Milligauss);
    assert!(notes_text.contains("radians"), "{notes_text}");
}

#[test]
fn duplicate_and_unordered_readings_become_sorted_rows() {
    let text = String::from_utf8(encode_csv(&record_flight(&WorldConfig::random_world(3), 0.0))).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap();
    let mut untidy = format!("{header}\n");
    let lines: Vec<&str> = lines.collect();
    for pair in lines.chunks(2) {
        for line in pair.iter().rev() {
            let (time, other_cells) = line.split_once(',').unwrap();
            let later: f64 = time.parse::<f64>().unwrap() + 0.002;
            writeln!(untidy, "{later:.3},{other_cells}\n{line}\n{line}").unwrap();
        }
    }
    let (tidy, untidy) = (evaluate_log(text.as_bytes()).1, evaluate_log(untidy.as_bytes()).1);
    assert!(untidy.rows.len().abs_diff(tidy.rows.len()) < 20, "{} {}", untidy.rows.len(), tidy.rows.len());
    assert_eq!(untidy.module_result.acceptance, Ok(()));
    let [rms, before] = [&untidy, &tidy]
        .map(|compass| compass.correction_from(CorrectionSource::ModuleAllRows).unwrap().score.unwrap().rms_deg);
    assert!((rms - before).abs() < 0.1, "{rms} {before}");
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
        let of_another = evaluate_flight(&Flight { flight_date: None, ..flight }, &DEFAULT_OPTIONS);
        for (verdict, is_valid) in [(&of_that_day, true), (&of_another, false)] {
            let (earth, is_model_valid) = verdict.earth_field.as_ref().unwrap();
            assert!(*is_model_valid == is_valid && (earth.inclination_deg - 64.0).abs() < 1.0, "{earth:?}");
            assert_eq!(verdict.compasses[0].module_result.acceptance, Ok(()), "{inclination_deg} deg, {is_valid}");
        }
        let [configured, unconfigured] =
            [of_that_day, of_another].map(|verdict| verdict.compasses[0].all_rows_result.solution.unwrap().calibration);
        assert_eq!(configured != unconfigured, is_right, "{inclination_deg}: {configured:?}");
    }
}

/// Evaluates a flight whose hard iron steps by 8 uT at a time in seconds.
fn evaluate_hard_iron_step(world: &WorldConfig, at_s: u64) -> CompassEvaluation {
    let mut recording = record_turns(world, 0.0);
    for sample in recording.samples.iter_mut().filter(|sample| sample.time_us >= at_s * 1_000_000) {
        sample.field_ut[0][0] += 8.0;
    }
    evaluate_log(&encode_csv(&recording)).1
}

/// Limits: 0.3 uT with a sixth of the flight on one side, and 0.5 s of the log's clock.
#[test]
fn a_hard_iron_step_is_found_at_any_time_with_its_full_size() {
    for world in [WorldConfig::of_table1(1), WorldConfig::random_world(3), WorldConfig::random_world(5)] {
        for at_s in [40, 120, 180] {
            let changes = evaluate_hard_iron_step(&world, at_s).hard_iron_changes;
            let [HardIronChange { hard_iron_step: change, .. }] = changes.as_slice() else {
                panic!("{at_s} s, {} deg: {changes:?}", world.earth.inclination_deg)
            };
            let off_ut = Vector3::from(change.step_ut) - Vector3::new(8.0, 0.0, 0.0);
            assert!(off_ut.norm() < 0.3 && (change.time_s - at_s as f64).abs() < 0.5, "{at_s} s: {change:?}");
        }
    }
}
