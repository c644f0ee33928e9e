//! Tables with gyro and accelerometer in place of the attitude.

use std::fmt::Write as _;

use log_analysis::log::csv::FieldUnit;
use log_analysis::log::{self, LoggedFlight};
use nalgebra::{Rotation3, Vector3};
use simulator::devices::lsm6dsl::MeasurementErrors;
use simulator::world::aircraft::VehicleKind;
use simulator::world::autopilot::Leg;
use simulator::world::{TrueState, World, WorldConfig};

use super::evaluate_log;

/// Samples of a recorder, a second.
const RATE_HZ: u64 = 100;

/// A sample of the sensors in body axes: rad/s, m/s^2, microtesla; and the truth.
struct Sample {
    t_s: f64,
    rates: Vector3<f64>,
    force: Vector3<f64>,
    field: Vector3<f64>,
    truth: TrueState,
}

/// A rover that drives circles on uneven ground, measured by a chip with the errors of its data sheet.
fn record_samples() -> Vec<Sample> {
    let world = World::new(WorldConfig::of_table1(1).with_vehicle_kind(VehicleKind::Rover));
    let (mut motion, mut errors) = (world.inertial_source(), MeasurementErrors::new(1, 1.0));
    for heading_change_deg in [720.0, -720.0] {
        world.append_leg(Leg::Turn { bank_deg: 5.0, heading_change_deg });
    }
    let sample = |i: u64| {
        let at_us = i * 1_000_000 / RATE_HZ;
        let measured = errors.measure(&motion(at_us), RATE_HZ as f64);
        let field = world.sensor_field(at_us).ut.cast();
        let (rates, force) = (measured.rates_rad_s, measured.specific_force_m_s2);
        Sample { t_s: at_us as f64 * 1e-6, rates, force, field, truth: world.true_state(at_us) }
    };
    (2..120 * RATE_HZ).map(sample).collect()
}

/// A table with a header, and the numbers of each sample.
fn table<const N: usize>(header: &str, samples: &[Sample], numbers: impl Fn(&Sample) -> [f64; N]) -> String {
    samples.iter().fold(format!("{header}\n"), |mut text, sample| {
        let cells = numbers(sample).map(|number| format!("{number:.5}")).join(",");
        writeln!(text, "{cells}").unwrap();
        text
    })
}

/// Files of each recorder. Phones: x right, y forward, z up. xio: x forward, y left, z up.
fn recorded_files(samples: &[Sample]) -> Vec<(&'static str, Vec<(&'static str, String)>)> {
    let phone = |v: Vector3<f64>| Vector3::new(v.y, v.x, -v.z);
    let xio = |v: Vector3<f64>| Vector3::new(v.x, -v.y, -v.z);
    let of_phone = |header: &str, sensor: &dyn Fn(&Sample) -> Vector3<f64>| {
        table(header, samples, |sample| {
            let v = phone(sensor(sample));
            if header.ends_with("z,y,x") { [1e18, sample.t_s, v.z, v.y, v.x] } else { [sample.t_s, v.x, v.y, v.z, 0.0] }
        })
    };
    let (force, rates, field) = (|s: &Sample| s.force, |s: &Sample| s.rates, |s: &Sample| s.field);
    let sensor_logger = "time,seconds_elapsed,z,y,x";
    let phyphox = |name: &str, unit: &str| {
        format!("\"Time (s)\",\"{name} x ({unit})\",\"{name} y ({unit})\",\"{name} z ({unit})\",\"\"")
    };
    vec![
        (
            "Sensor Logger",
            vec![
                ("Accelerometer.csv", of_phone(sensor_logger, &|_| Vector3::zeros())),
                ("Gyroscope.csv", of_phone(sensor_logger, &rates)),
                ("Magnetometer.csv", of_phone(sensor_logger, &field)),
                ("TotalAcceleration.csv", of_phone(sensor_logger, &force)),
            ],
        ),
        (
            "phyphox",
            vec![
                ("Accelerometer.csv", of_phone(&phyphox("Acceleration", "m/s^2"), &force)),
                ("Gyroscope.csv", of_phone(&phyphox("Gyroscope", "rad/s"), &rates)),
                ("Magnetometer.csv", of_phone(&phyphox("Magnetic field", "\u{b5}T"), &field)),
            ],
        ),
        (
            "x-IMU3",
            vec![
                (
                    "Inertial.csv",
                    table(
                        "Timestamp (us),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),Accelerometer X (g),\
                         Accelerometer Y (g),Accelerometer Z (g)",
                        samples,
                        |s| {
                            let ([p, q, r], [x, y, z]) =
                                (xio(s.rates).map(f64::to_degrees).into(), (xio(s.force) / 9.806_65).into());
                            [s.t_s * 1e6, p, q, r, x, y, z]
                        },
                    ),
                ),
                (
                    "Magnetometer.csv",
                    table("Timestamp (us),X (a.u.),Y (a.u.),Z (a.u.)", samples, |s| {
                        let [x, y, z] = (xio(s.field) / 50.0).into();
                        [s.t_s * 1e6, x, y, z]
                    }),
                ),
            ],
        ),
        (
            "table",
            vec![(
                "",
                table("t_s,p_dps,q_dps,r_dps,ax_mps2,ay_mps2,az_mps2,mx_ut,my_ut,mz_ut", samples, |s| {
                    let [p, q, r] = s.rates.map(f64::to_degrees).into();
                    let ([ax, ay, az], [x, y, z]) = (s.force.into(), s.field.into());
                    [s.t_s, p, q, r, ax, ay, az, x, y, z]
                }),
            )],
        ),
    ]
}

fn read_files(files: &[(&str, String)]) -> LoggedFlight {
    if let [("", text)] = files {
        return evaluate_log(text.as_bytes()).0;
    }
    let mut visit_files = |visit: &mut log::EntryVisitor<'_>| {
        files.iter().try_for_each(|(name, text)| visit((*name).to_owned(), &mut text.as_bytes()))
    };
    log::only_flight(&mut |visit| log::visit_folder(&mut visit_files, FieldUnit::Milligauss, visit)).unwrap()
}

/// RMS angle between the true vertical and that of the attitude, degrees.
fn tilt_error_deg(flight: &LoggedFlight, samples: &[Sample]) -> f64 {
    let down = |[roll, pitch]: [f64; 2]| {
        Rotation3::from_euler_angles(roll, pitch, 0.0).inverse_transform_vector(&Vector3::z())
    };
    let rows = flight.attitude.rows();
    let squares = rows.iter().map(|row| {
        let truth = &samples[((row.t_s * RATE_HZ as f64).round() as usize) - 2].truth;
        let [roll, pitch, _] = row.row_values.map(f64::from);
        down([roll, pitch]).angle(&down([truth.roll_rad, truth.pitch_rad])).powi(2)
    });
    (squares.sum::<f64>() / rows.len() as f64).sqrt().to_degrees()
}

/// The tilt is that of the library's filter, whose accelerometer has an offset of up to 40 mg.
#[test]
fn gyro_and_accelerometer_of_each_recorder_give_the_attitude() {
    let samples = record_samples();
    for (recorder, files) in recorded_files(&samples) {
        let flight = read_files(&files);
        let field = flight.compasses[0].field.rows();
        assert!(field.len() > samples.len() * 9 / 10 && flight.attitude.rows().len() > samples.len() / 2, "{recorder}");
        for row in field {
            let sample = &samples[((row.t_s * RATE_HZ as f64).round() as usize) - 2];
            let read = Vector3::from_row_slice(&row.row_values[..3]).map(f64::from);
            assert!((read - sample.field).norm() < 0.01, "{recorder}: {read} {}", sample.field);
        }
        let tilt_error_deg = tilt_error_deg(&flight, &samples);
        assert!(tilt_error_deg < 2.5, "{recorder}: {tilt_error_deg}");
    }
}
