//! Logs that do not mean what they seem to: a wrong sign, axis, unit or reference is named, and no file is given.

use log_analysis::log::log_writers::{
    FlightRecording, FlightSample, encode_csv, encode_dataflash, encode_dataflash_text, encode_tlog, encode_ulog,
};
use log_analysis::log::time_series::Series;
use log_analysis::replay::evaluation::{EvaluationOptions, evaluate_flight};
use log_analysis::replay::parameter_export::ParameterFormat;
use log_analysis::replay::verdict::{CompassAction, Verdict};
use nalgebra::Rotation3;
use simulator::recording::record_turns;
use simulator::world::WorldConfig;
use simulator::world::aircraft::VehicleKind;
use simulator::world::earth::Earth;

use super::{DEFAULT_OPTIONS, evaluate_log};
use crate::fixtures::share_of_flights;

type Encoder = fn(&FlightRecording) -> Vec<u8>;

/// Change of a recorded sample that gives a log another meaning.
type Change = fn(&mut FlightSample);

const FORMATS: [(&str, Encoder); 5] = [
    ("bin", encode_dataflash),
    ("csv", encode_csv),
    ("ulg", encode_ulog),
    ("tlog", encode_tlog),
    ("log", encode_dataflash_text),
];

/// A flight in Xi'an, whose field model reader and world share.
fn record_flight(kind: VehicleKind, seed: u64, change: Change) -> FlightRecording {
    let world = WorldConfig { earth: Earth::default(), ..WorldConfig::random_world(seed).with_vehicle_kind(kind) };
    let mut recording = record_turns(&world, 0.05);
    recording.samples.iter_mut().for_each(change);
    recording
}

/// The verdict's sentence, the action, the number of exported compasses, and the checks that did not pass.
fn judge(bytes: &[u8]) -> (String, CompassAction, usize, String) {
    let (flight, evaluation) = evaluate_log(bytes);
    let verdict = Verdict::new(&flight, &evaluation, ParameterFormat::for_autopilot(flight.autopilot));
    let compass = &verdict.compasses[0];
    let not_passed = compass.reading_checks.iter().filter(|check| check.outcome.finding().is_some());
    let not_passed: Vec<String> = not_passed.map(ToString::to_string).collect();
    let action = compass.judgement.recommended_action;
    (compass.summary_sentence(), action, verdict.exported_corrections().len(), not_passed.join("; "))
}

fn formats() -> &'static [(&'static str, Encoder)] {
    &FORMATS[..share_of_flights(FORMATS.len() as u64) as usize]
}

fn flip(sample: &mut FlightSample, axis: usize) {
    sample.field_ut[0][axis] *= -1.0;
}

/// A wrong meaning, and the words that name it.
const BROKEN_READINGS: [(&str, Change, &str); 8] = [
    ("x mirrored", |s| flip(s, 0), "x axis of the field is mirrored"),
    ("y mirrored", |s| flip(s, 1), "y axis of the field is mirrored"),
    ("z mirrored", |s| flip(s, 2), "z axis of the field is mirrored"),
    ("all negated", |s| s.field_ut[0] = s.field_ut[0].map(|axis| -axis), "field negated"),
    ("pitch of the wrong sign", |s| s.attitude_rad[1] *= -1.0, "sign of pitch"),
    ("roll of the wrong sign", |s| s.attitude_rad[0] *= -1.0, "sign of roll"),
    ("field ten times too small", |s| s.field_ut[0] = s.field_ut[0].map(|axis| 0.1 * axis), "uT strong"),
    ("field a hundred times too large", |s| s.field_ut[0] = s.field_ut[0].map(|axis| 100.0 * axis), "uT strong"),
];

#[test]
fn a_broken_reading_is_named_and_gives_no_file() {
    for seed in 1..=share_of_flights(3) {
        for (name, change, words) in BROKEN_READINGS {
            let recording = record_flight(VehicleKind::Plane, seed, change);
            for &(format, encode) in formats() {
                // Fields of DataFlash and MAVLink are 16 bits wide.
                if name.contains("hundred") && !matches!(format, "ulg" | "csv") {
                    continue;
                }
                let (sentence, action, exported_count, checks) = judge(&encode(&recording));
                let about = format!("{name}, .{format}, seed {seed}: {action:?} {sentence} {checks}");
                assert_eq!((action, exported_count), (CompassAction::CorrectReading, 0), "{about}");
                assert!(sentence.contains(words), "{about}");
            }
        }
    }
}

/// Parameters that leave a meaning open, and the code of the reason for giving none.
const OPEN_MEANINGS: [(&[(&str, f64)], &str); 5] = [
    (&[("COMPASS_PRIO1_ID", 97_539.0)], "slot-unknown"),
    (&[("COMPASS_PRIO1_ID", 97_539.0), ("COMPASS_DEV_ID", 131_874.0)], "slot-unknown"),
    (&[("Q_ENABLE", 1.0)], "reading-unproven"),
    (&[("Q_ENABLE", 1.0), ("Q_TAILSIT_ENABLE", 1.0), ("Q_TRIM_PITCH", 0.0)], "reading-unproven"),
    (&[("Q_ENABLE", 1.0), ("Q_TAILSIT_ENABLE", 0.0), ("Q_TRIM_PITCH", 5.0)], "reading-unproven"),
];

/// A quadplane whose view is that of the body.
const UNTRIMMED_QUADPLANE: [(&str, f64); 4] =
    [("Q_ENABLE", 1.0), ("Q_TAILSIT_ENABLE", 0.0), ("Q_TRIM_PITCH", 0.0), ("PTCH_TRIM_DEG", 0.0)];

/// A device id that names no slot, and an attitude that may be a VTOL's view. Without such parameters, and of a quadplane
/// without trims, there is a file.
#[test]
fn a_meaning_that_the_log_leaves_open_gives_no_file() {
    let offsets = ["X", "Y", "Z"].map(|axis| (format!("COMPASS_OFS_{axis}"), 0.0));
    let with_file = [(&[][..], "parameters-gain"), (&UNTRIMMED_QUADPLANE, "parameters-gain")];
    for (parameters, code) in with_file.into_iter().chain(OPEN_MEANINGS) {
        // In AUTO an aircraft may hover.
        let mut recording = record_flight(VehicleKind::Plane, 3, |sample| sample.flight_mode = 10);
        recording.parameters = offsets.to_vec();
        recording.parameters.extend(parameters.iter().map(|(name, value)| ((*name).to_owned(), *value)));
        for encode in [encode_dataflash as Encoder, encode_tlog] {
            let (flight, evaluation) = evaluate_log(&encode(&recording));
            let verdict = Verdict::new(&flight, &evaluation, ParameterFormat::ArduPilot);
            let codes = verdict.compasses[0].judgement.reason_codes();
            assert!(codes.contains(&code), "{parameters:?}: {codes:?}");
            assert_eq!(verdict.exported_corrections().is_empty(), code != "parameters-gain", "{parameters:?}");
        }
    }
}

/// QLOITER in the first half of the flight, then FBWA; the view of `QLOITER` is pitched up by this much less.
fn show_vtol_view(recording: &mut FlightRecording, hover_trim_deg: f64, forward_trim_deg: f64) {
    let view_from_body = Rotation3::from_euler_angles(0.0, -hover_trim_deg.to_radians(), 0.0);
    let half = recording.samples.len() / 2;
    for (i, sample) in recording.samples.iter_mut().enumerate() {
        sample.flight_mode = if i < half { 19 } else { 5 };
        let [roll, pitch, yaw] = sample.attitude_rad;
        sample.attitude_rad = if i < half {
            (Rotation3::from_euler_angles(roll, pitch, yaw) * view_from_body).euler_angles().into()
        } else {
            [roll, pitch - forward_trim_deg.to_radians(), yaw]
        };
    }
}

/// `ATT` and `ATTITUDE` of a quadplane, and of a tailsitter: modes and trims give the attitude of the body, and a file.
/// `PTCH_TRIM_DEG` concerns telemetry alone.
#[test]
fn the_view_of_vtol_modes_is_undone() {
    for (encode, forward_trim_deg) in [(encode_dataflash as Encoder, 0.0), (encode_tlog, 3.0)] {
        for (trim_deg, is_tailsitter) in [(5.0, 0.0), (-4.0, 1.0)] {
            let body = record_flight(VehicleKind::Plane, 3, |_| {});
            let mut recording = body.clone();
            let parameters = [
                ("COMPASS_OFS_X", 0.0),
                ("Q_ENABLE", 1.0),
                ("Q_TAILSIT_ENABLE", is_tailsitter),
                ("Q_TRIM_PITCH", trim_deg),
                ("PTCH_TRIM_DEG", 3.0),
            ];
            recording.parameters = parameters.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
            show_vtol_view(&mut recording, trim_deg + 90.0 * is_tailsitter, forward_trim_deg);
            let (flight, evaluation) = evaluate_log(&encode(&recording));
            let begin_s = flight.attitude.rows()[0].t_s;
            for sample in &body.samples {
                let t_s = begin_s + (sample.time_us - body.samples[0].time_us) as f64 * 1e-6;
                let Some(read) = flight.attitude.interpolate_angles(t_s, 0.2) else { continue };
                let [found, expected] = [read.map(f64::from), sample.attitude_rad]
                    .map(|[roll, pitch, yaw]| Rotation3::from_euler_angles(roll, pitch, yaw).into_inner());
                // Half of a trim; rows are interpolated.
                let error_rad = (found - expected).norm() / std::f64::consts::SQRT_2;
                assert!(error_rad < 0.025, "{trim_deg} {is_tailsitter} {t_s}: {error_rad}");
            }
            let verdict = Verdict::new(&flight, &evaluation, ParameterFormat::ArduPilot);
            assert_eq!(verdict.exported_corrections().len(), 1, "{:?}", verdict.summary_sentences());
        }
    }
}

/// A table without a place and a heading does not show whether the whole field is negated: it needs the inclination.
#[test]
fn the_sign_of_the_field_is_confirmed_or_no_file_is_given() {
    let negate: Change = |sample| (0..3).for_each(|axis| flip(sample, axis));
    // The simulated field is 54 deg down.
    for (change, has_yaw, given_deg, refusal) in [
        ((|_| {}) as Change, true, None, ""),
        (|_| {}, false, None, "confirms that the field points down, as on the northern half"),
        (|_| {}, false, Some(54.0), ""),
        (negate, false, None, "confirms that the field points up, as on the southern half"),
        (negate, false, Some(54.0), "no fit of these rows converges"),
        (negate, false, Some(-54.0), ""),
    ] {
        let (mut flight, _) = evaluate_log(&encode_csv(&record_flight(VehicleKind::Plane, 3, change)));
        flight.gps = Series::new();
        if !has_yaw {
            flight.reference_heading = Series::new();
            flight.attitude.rows_mut().iter_mut().for_each(|row| row.row_values[2] = f32::NAN);
        }
        let options = EvaluationOptions { inclination_deg: given_deg, ..DEFAULT_OPTIONS };
        let evaluation = evaluate_flight(&flight, &options);
        let verdict = Verdict::new(&flight, &evaluation, ParameterFormat::ArduPilot);
        let sentences = verdict.summary_sentences();
        assert_eq!(verdict.exported_corrections().is_empty(), !refusal.is_empty(), "{sentences:?}");
        assert!(sentences[0].contains(refusal), "{sentences:?}");
    }
}

/// PX4's parameters of a calibrated compass.
const CALIBRATED: [(&str, f64); 5] = [
    ("CAL_MAG0_ID", 396_809.0),
    ("CAL_MAG0_ROT", 0.0),
    ("CAL_MAG0_XOFF", 0.15),
    ("CAL_MAG0_YSCALE", 1.1),
    ("CAL_MAG0_ZODIAG", 0.02),
];

/// A parameter of the log that is not that in use, and the outcome of the check of the correction.
const OTHER_PARAMETERS: [(&str, [u8; 4], &str); 6] = [
    ("CAL_MAG0_XOFF", 0.15_f32.to_le_bytes(), ""),
    ("CAL_MAG0_ROT", 2_i32.to_le_bytes(), "correction failed: the corrected field differs"),
    ("CAL_MAG0_YSCALE", 1.4_f32.to_le_bytes(), "correction failed: the corrected field differs"),
    ("CAL_MAG0_ZODIAG", 0.2_f32.to_le_bytes(), "correction failed: the corrected field differs"),
    ("CAL_MAG0_XOFF", (-0.15_f32).to_le_bytes(), "as if the offsets were not those in use"),
    ("CAL_MAG0_XOFF", 0.1_f32.to_le_bytes(), "correction unchecked: the corrected field differs from the raw one"),
];

/// A ULog has both fields: they agree by the parameters in use alone. A constant difference may be a learnt bias.
#[test]
fn a_correction_that_is_not_that_of_the_parameters_gives_no_file() {
    let recording = record_flight(VehicleKind::Plane, 3, |_| {}).with_parameters(&CALIBRATED);
    for (name, value, words) in OTHER_PARAMETERS {
        let mut bytes = encode_ulog(&recording);
        let name_start = bytes.windows(name.len()).position(|window| window == name.as_bytes()).unwrap();
        bytes[name_start + name.len()..][..4].copy_from_slice(&value);
        let (sentence, action, exported_count, checks) = judge(&bytes);
        let about = format!("{name} {value:?}: {action:?} {sentence} {checks}");
        assert!(checks.contains(words) && checks.contains("correction") != words.is_empty(), "{about}");
        assert_eq!(exported_count == 0, words.contains("failed") || words.contains("as if"), "{about}");
    }
    let (_, _, _, checks) = judge(&encode_dataflash(&recording));
    assert!(checks.contains("correction unchecked: the log has not both"), "{checks}");
}

/// The checks refuse at most one clean flight in a hundred.
#[test]
fn the_reading_of_a_clean_log_is_confirmed() {
    let mut compass_count = 0;
    let mut refused = Vec::new();
    for kind in [VehicleKind::Plane, VehicleKind::Copter, VehicleKind::Vtol] {
        for seed in 1..=share_of_flights(9) {
            let recording = record_flight(kind, seed, |_| {});
            for &(format, encode) in formats() {
                let (sentence, _, _, checks) = judge(&encode(&recording));
                compass_count += 1;
                if checks.contains("failed") || checks.contains("sense") || checks.contains("unit") {
                    refused.push(format!("{kind:?}, .{format}, seed {seed}: {sentence} {checks}"));
                }
            }
        }
    }
    assert!(refused.len() * 100 <= compass_count, "{} of {compass_count}: {refused:#?}", refused.len());
}
