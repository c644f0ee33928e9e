//! Turned sensors: the file's orientation and matrix, applied by formulas of this test, give the heading.

use log_analysis::log::log_writers::{FlightRecording, FlightSample, encode_dataflash, encode_tlog, encode_ulog};
use log_analysis::replay::parameter_export::{ParameterFormat, format_parameter_file};
use log_analysis::replay::verdict::{CompassAction, Verdict};
use log_analysis::score::wrap_180;
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use simulator::recording::record_turns;
use simulator::world::WorldConfig;
use simulator::world::aircraft::VehicleKind;
use simulator::world::earth::Earth;
use testkit::random::Random;

use super::evaluate_log;
use crate::fixtures::share_of_flights;

/// Firmware: its name, its parameters, and the writer of its logs.
type Firmware = (&'static str, &'static [(&'static str, f64)], fn(&FlightRecording) -> Vec<u8>);

const FIRMWARES: [Firmware; 4] = [
    ("ArduPilot 4.1", &[("COMPASS_CUS_ROLL", 0.0)], encode_dataflash),
    ("ArduPilot 4.5", &[("CUST_ROT_ENABLE", 0.0)], encode_dataflash),
    ("ArduPilot 4.5, .tlog", &[("CUST_ROT_ENABLE", 0.0)], encode_tlog),
    ("PX4 1.15", &[("CAL_MAG0_ROT", 0.0), ("CAL_MAG0_ID", 396_809.0)], encode_ulog),
];

/// Parameters of an external compass without correction.
const UNCORRECTED: [(&str, f64); 5] = [
    ("COMPASS_OFS_X", 0.0),
    ("COMPASS_OFS_Y", 0.0),
    ("COMPASS_OFS_Z", 0.0),
    ("COMPASS_ORIENT", 0.0),
    ("COMPASS_EXTERNAL", 1.0),
];

/// A flight in Xi'an with a sensor that is turned from its orientation to the body.
fn record_turned(
    kind: VehicleKind,
    seed: u64,
    firmware: &[(&str, f64)],
    body_from_sensor: &Matrix3<f64>,
) -> FlightRecording {
    let world = WorldConfig { earth: Earth::default(), ..WorldConfig::random_world(seed).with_vehicle_kind(kind) };
    let mut recording = record_turns(&world, 0.05);
    for sample in &mut recording.samples {
        sample.field_ut[0] = (body_from_sensor.transpose() * Vector3::from(sample.field_ut[0])).into();
    }
    let is_px4 = firmware.iter().any(|(name, _)| name.starts_with("CAL"));
    let parameters = UNCORRECTED.iter().filter(|_| !is_px4).chain(firmware);
    recording.parameters = parameters.map(|(name, value)| ((*name).to_owned(), *value)).collect();
    recording
}

/// Parameters of a file: the last two columns of a line, or those before PX4's type.
struct LoadedFile<'a>(&'a str);

impl LoadedFile<'_> {
    fn value(&self, name: &str, unset: f64) -> f64 {
        let cells = |line: &str| -> Vec<String> { line.split([',', '\t']).map(str::to_owned).collect() };
        let found = self.0.lines().map(cells).find_map(|cells| {
            let position = cells.iter().position(|cell| cell == name)?;
            cells.get(position + 1)?.parse().ok()
        });
        found.unwrap_or(unset)
    }

    fn vector(&self, names: [&str; 3], unset: f64) -> Vector3<f64> {
        Vector3::from(names.map(|name| self.value(name, unset)))
    }

    fn angles(&self, names: [&str; 3]) -> Matrix3<f64> {
        let [roll, pitch, yaw] = self.vector(names, 0.0).map(f64::to_radians).into();
        Rotation3::from_euler_angles(roll, pitch, yaw).into_inner()
    }

    fn symmetric(diagonal: Vector3<f64>, off: Vector3<f64>) -> Matrix3<f64> {
        Matrix3::new(diagonal.x, off.x, off.y, off.x, diagonal.y, off.z, off.y, off.z, diagonal.z)
    }

    /// ArduPilot's `AP_Compass_Backend::rotate_field` and `correct_field`, and PX4's `Magnetometer::Correct`.
    fn corrected_ut(&self, sensor_ut: Vector3<f64>, current_a: f64) -> Vector3<f64> {
        if self.0.contains("CAL_MAG0_") {
            let rotation = match self.value("CAL_MAG0_ROT", 0.0) as u8 {
                100 => self.angles(["CAL_MAG0_ROLL", "CAL_MAG0_PITCH", "CAL_MAG0_YAW"]),
                number => numbered(number),
            };
            let names = |part: &str| ["X", "Y", "Z"].map(|axis| format!("CAL_MAG0_{axis}{part}"));
            let vector = |part: &str, unset| {
                let names = names(part);
                self.vector([&names[0], &names[1], &names[2]], unset)
            };
            let soft = Self::symmetric(vector("SCALE", 1.0), vector("ODIAG", 0.0));
            let is_compensated = self.value("CAL_MAG_COMP_TYP", 0.0) as u8 == 2;
            let compensation = if is_compensated { vector("COMP", 0.0) * current_a / 1000.0 } else { Vector3::zeros() };
            return rotation * soft * (sensor_ut / 100.0 + compensation - vector("OFF", 0.0)) * 100.0;
        }
        let rotation = match self.value("COMPASS_ORIENT", 0.0) as u8 {
            100 => self.angles(["COMPASS_CUS_ROLL", "COMPASS_CUS_PIT", "COMPASS_CUS_YAW"]),
            101 => self.angles(["CUST_ROT1_ROLL", "CUST_ROT1_PITCH", "CUST_ROT1_YAW"]),
            number => numbered(number),
        };
        let vector = |part: &str, unset| {
            let names = ["X", "Y", "Z"].map(|axis| format!("COMPASS_{part}_{axis}"));
            self.vector([&names[0], &names[1], &names[2]], unset)
        };
        let soft = Self::symmetric(vector("DIA", 1.0), vector("ODI", 0.0));
        let is_compensated = self.value("COMPASS_MOTCT", 0.0) as u8 == 2;
        let compensation = if is_compensated { vector("MOT", 0.0) * current_a / 10.0 } else { Vector3::zeros() };
        soft * (rotation * sensor_ut + vector("OFS", 0.0) / 10.0) + compensation
    }

    /// Heading error with the file, degrees: RMS about magnetic north, mean included.
    fn error_deg(&self, recording: &FlightRecording) -> f64 {
        let square = |sample: &FlightSample| {
            let [roll, pitch, _] = sample.attitude_rad;
            let field = self.corrected_ut(sample.field_ut[0].into(), sample.current_a);
            let level = Rotation3::from_euler_angles(roll, pitch, 0.0) * field;
            let heading_deg = (-level.y).atan2(level.x).to_degrees();
            wrap_180(heading_deg - sample.heading_rad.to_degrees() + recording.declination_deg).powi(2)
        };
        let squares: Vec<f64> = recording.samples.iter().map(square).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }
}

/// Numbered rotations of ArduPilot's and PX4's rotations.h that this test needs: of z by 45 deg up to 7, then by `roll`.
fn numbered(number: u8) -> Matrix3<f64> {
    let [roll_deg, pitch_deg, yaw_deg] = match number {
        0..8 => [0.0, 0.0, f64::from(number) * 45.0],
        12 => [0.0, 180.0, 0.0],
        8..16 => [180.0, 0.0, f64::from(number - 8) * 45.0],
        16..20 => [90.0, 0.0, f64::from(number - 16) * 45.0],
        20..24 => [270.0, 0.0, f64::from(number - 20) * 45.0],
        24 => [0.0, 90.0, 0.0],
        25 => [0.0, 270.0, 0.0],
        26 => [0.0, 180.0, 90.0],
        27 => [0.0, 180.0, 270.0],
        39 => [0.0, 315.0, 0.0],
        _ => panic!("number {number}"),
    };
    let [roll, pitch, yaw] = [roll_deg, pitch_deg, yaw_deg].map(f64::to_radians);
    Rotation3::from_euler_angles(roll, pitch, yaw).into_inner()
}

/// Sentence and action of the verdict, and the file.
fn judge(bytes: &[u8]) -> (String, CompassAction, String) {
    let (flight, evaluation) = evaluate_log(bytes);
    let format = ParameterFormat::for_autopilot(flight.autopilot);
    let verdict = Verdict::new(&flight, &evaluation, format);
    let file = format_parameter_file(&flight, &verdict.exported_corrections(), format);
    let compass = &verdict.compasses[0];
    (compass.summary_sentence(), compass.judgement.recommended_action, file)
}

/// Rotation about z by up to 45 deg, or about any axis.
fn random_rotation(random: &mut Random, is_about_z: bool) -> Matrix3<f64> {
    let mut uniform = || f64::from(random.uniform(-1.0, 1.0));
    let axis = if is_about_z { Vector3::z() } else { Vector3::new(uniform(), uniform(), uniform()) };
    Rotation3::from_axis_angle(&Unit::new_normalize(axis), uniform() * 45_f64.to_radians()).into_inner()
}

/// Largest error with a file, degrees RMS with its mean: 1.1 by noise of the attitude and age of the field, and 2 by a small
/// rotation that is left to the matrix.
const MAX_ERROR_DEG: f64 = 2.3;

/// Sensors turned by up to 45 deg, and by right angles beyond.
#[test]
fn the_file_of_a_turned_sensor_gives_the_heading() {
    let mut random = Random(7);
    for seed in 1..=share_of_flights(3) {
        for (firmware, parameters, encode) in FIRMWARES {
            let right_angle = numbered([4, 16, 26][seed as usize % 3]);
            let rotations = [random_rotation(&mut random, true), random_rotation(&mut random, false), right_angle];
            for rotation in rotations {
                let recording = record_turned(VehicleKind::Plane, seed, parameters, &rotation);
                let (sentence, action, file) = judge(&encode(&recording));
                let angles = Rotation3::from_matrix_unchecked(rotation).euler_angles();
                let about = format!("{firmware} {seed} {angles:?}: {sentence}");
                assert_eq!(action, CompassAction::LoadParameters, "{about}");
                let error_deg = LoadedFile(&file).error_deg(&recording);
                assert!(error_deg < MAX_ERROR_DEG, "{about}: {error_deg:.2} deg\n{file}");
            }
        }
    }
}

/// Rotation of the sensor and parameters of the log, and the reason for leaving the orientation.
#[test]
fn a_rotation_that_cannot_be_corrected_or_proved_is_named() {
    let yaw_30 = Rotation3::from_euler_angles(0.0, 0.0, 30_f64.to_radians()).into_inner();
    let custom = ("CUST_ROT_ENABLE", 0.0);
    for (parameters, rotation, has_place, words, action) in [
        (&[custom, ("COMPASS_EXTERNAL", 0.0)][..], yaw_30, true, "turns with its board", CompassAction::Replace),
        (
            &[custom, ("AHRS_ORIENTATION", 101.0), ("CUST_ROT2_YAW", 5.0)],
            yaw_30,
            true,
            "custom rotations of the firmware are in use",
            CompassAction::CorrectReading,
        ),
        (&[custom], numbered(4), false, "tells it from a mirrored axis", CompassAction::FlyAgain),
    ] {
        let mut recording = record_turned(VehicleKind::Plane, 3, &[], &rotation);
        for (name, value) in parameters {
            recording.parameters.retain(|(other, _)| other != name);
            recording.parameters.push(((*name).to_owned(), *value));
        }
        recording.start_position = recording.start_position.filter(|_| has_place);
        let (sentence, found, file) = judge(&encode_dataflash(&recording));
        let about = format!("{parameters:?}: {found:?} {sentence}");
        assert!(sentence.contains(words) && found == action && !file.contains("COMPASS_"), "{about}");
    }
}
