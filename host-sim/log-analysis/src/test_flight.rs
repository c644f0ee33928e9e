//! A recorded flight for the tests of this crate, by kinematics alone: they need no simulator.

use nalgebra::{Matrix3, Rotation3, Vector3};
use testkit::random::Random;

use crate::log::csv::FieldUnit;
use crate::log::log_writers::{FlightRecording, FlightSample, encode_dataflash};
use crate::log::{self, LogFormat, LoggedFlight};
use crate::replay::evaluation::{CompassEvaluation, EvaluationOptions, evaluate_flight};

const STEP_S: f64 = 0.1;
const AIRSPEED_M_S: f64 = 22.0;
const MAX_ROLL_RATE_RAD_S: f64 = 0.5;
/// Earth field: total, microtesla, and inclination, radians.
const EARTH: (f64, f64) = (53.0, 0.94);
/// Horizontal component of the Earth field, microtesla: `53 cos 0.94`.
pub const HORIZONTAL_FIELD_UT: f64 = 31.26;
/// Soft iron: measured by true field.
pub const SOFT_IRON: Matrix3<f64> = Matrix3::new(0.99, 0.03, -0.02, -0.02, 0.92, -0.02, -0.01, 0.02, 0.99);
const HARD_IRON_UT: [f64; 3] = [9.6, -0.8, -0.1];
const ATTITUDE_NOISE_RAD: f64 = 0.005;
const FIELD_NOISE_UT: f32 = 0.2;

/// Bank, degrees, and change of heading, degrees, of each turn: two circles right and two left at 25 deg of bank, then
/// at 40 deg.
const TURNS_DEG: [[f64; 2]; 4] = [[25.0, 720.0], [-25.0, -720.0], [40.0, 720.0], [-40.0, -720.0]];

/// Roll, pitch and heading, radians, and their rates, rad/s.
#[derive(Clone, Copy)]
struct FlightMotion {
    euler_rad: Vector3<f64>,
    euler_rates_rad_s: Vector3<f64>,
}

/// The flight of a recording, as read from ArduPilot's log of it.
pub fn logged_flight(recording: &FlightRecording) -> LoggedFlight {
    log::read_flight(&mut encode_dataflash(recording).as_slice(), FieldUnit::Milligauss).unwrap()
}

/// The only compass of a recording, evaluated without field latency.
pub fn evaluate_compass(recording: &FlightRecording) -> CompassEvaluation {
    let options = EvaluationOptions { field_latency_s: Some(0.0), ..EvaluationOptions::DEFAULT };
    evaluate_flight(&logged_flight(recording), &options).compasses.swap_remove(0)
}

/// Four minutes of turns both ways, enough for a calibration, with a field that is older than the attitude.
pub fn record_turns(field_latency_s: f64) -> FlightRecording {
    let motions = fly_turns();
    let mut random = Random(1);
    let mut noise_rad = [0.0; 2];
    let samples = (20..motions.len()).map(|i| {
        let FlightMotion { euler_rad, euler_rates_rad_s } = motions[i];
        let field_ut = measured_field_ut(past_attitude(&motions, i, field_latency_s / STEP_S));
        let field_ut = field_ut.map(|axis| axis + f64::from(FIELD_NOISE_UT * random.normal()));
        // Attitude noise with a correlation time of half a second.
        noise_rad = noise_rad.map(|noise: f64| 0.8 * noise + 0.6 * ATTITUDE_NOISE_RAD * f64::from(random.normal()));
        FlightSample {
            time_us: i as u64 * 100_000,
            field_ut: vec![field_ut.into()],
            attitude_rad: [euler_rad.x + noise_rad[0], euler_rad.y + noise_rad[1], euler_rad.z],
            rates_rad_s: body_rates_rad_s(&euler_rad, &euler_rates_rad_s),
            heading_rad: euler_rad.z.rem_euclid(std::f64::consts::TAU),
            velocity_m_s: [libm::cos(euler_rad.z) * AIRSPEED_M_S, libm::sin(euler_rad.z) * AIRSPEED_M_S],
            is_armed: true,
            ..FlightSample::default()
        }
    });
    FlightRecording { samples: samples.collect(), field_latency_s, ..FlightRecording::default() }
}

/// The flight is straight for 10 s before each pair of turns and after them.
fn fly_turns() -> Vec<FlightMotion> {
    let mut motions = vec![FlightMotion { euler_rad: Vector3::zeros(), euler_rates_rad_s: Vector3::zeros() }];
    for (i, [bank_deg, change_deg]) in TURNS_DEG.into_iter().enumerate() {
        if i % 2 == 0 {
            let until = motions.len() + 100;
            while motions.len() < until {
                add_motion_step(&mut motions, 0.0);
            }
        }
        let start_rad = motions.last().map_or(0.0, |motion| motion.euler_rad.z);
        while motions.last().is_some_and(|now| (now.euler_rad.z - start_rad).abs() < change_deg.abs().to_radians()) {
            add_motion_step(&mut motions, bank_deg);
        }
    }
    while motions.len() < 2400 {
        add_motion_step(&mut motions, 0.0);
    }
    motions
}

/// Appends the motion one step later, while the roll approaches `bank_deg`; gusts disturb roll and pitch.
fn add_motion_step(motions: &mut Vec<FlightMotion>, bank_deg: f64) {
    let Some(last) = motions.last() else { return };
    let (t_s, [roll_rad, pitch_rad, heading_rad]) = (motions.len() as f64 * STEP_S, last.euler_rad.into());
    let target_rad = bank_deg.to_radians() + 0.03 * libm::sin(1.3 * t_s);
    let roll_rate = ((target_rad - roll_rad) / STEP_S).clamp(-MAX_ROLL_RATE_RAD_S, MAX_ROLL_RATE_RAD_S);
    let pitch_rate = (0.04 * libm::sin(0.9 * t_s) - pitch_rad) / STEP_S;
    let heading_rate = 9.81 * libm::tan(roll_rad) / AIRSPEED_M_S;
    let euler_rates_rad_s = Vector3::new(roll_rate, pitch_rate, heading_rate);
    let euler_rad = Vector3::new(roll_rad, pitch_rad, heading_rad) + euler_rates_rad_s * STEP_S;
    motions.push(FlightMotion { euler_rad, euler_rates_rad_s });
}

/// Attitude a number of steps before step `i`, linearly interpolated.
fn past_attitude(motions: &[FlightMotion], i: usize, steps_ago: f64) -> Vector3<f64> {
    let step_index = (i as f64 - steps_ago).max(0.0);
    let (before, weight) = (step_index.floor() as usize, step_index.fract());
    let after = (before + 1).min(motions.len() - 1);
    motions[before].euler_rad.lerp(&motions[after].euler_rad, weight)
}

fn measured_field_ut(euler_rad: Vector3<f64>) -> Vector3<f64> {
    let (total_ut, inclination_rad) = EARTH;
    let earth_ut = Vector3::new(total_ut * libm::cos(inclination_rad), 0.0, total_ut * libm::sin(inclination_rad));
    SOFT_IRON * Rotation3::from_euler_angles(euler_rad.x, euler_rad.y, euler_rad.z).inverse_transform_vector(&earth_ut)
        + Vector3::from(HARD_IRON_UT)
}

/// Flight whose log has `row_count` rows with the attitude and the body rates of a time in seconds.
pub fn flight_of_motion(rate_hz: f64, row_count: u16, motion: impl Fn(f64) -> ([f32; 3], [f32; 3])) -> LoggedFlight {
    let mut flight = LoggedFlight::new(LogFormat::ULog);
    for t_s in (0..row_count).map(|i| f64::from(i) / rate_hz) {
        let (attitude_rad, rates_rad_s) = motion(t_s);
        flight.attitude.push_row(t_s, attitude_rad);
        flight.body_rates.push_row(t_s, rates_rad_s);
    }
    flight
}

/// Body rates of Euler rates (B. L. Stevens, F. L. Lewis, "Aircraft Control and Simulation", section 1.4).
pub fn body_rates_rad_s(euler_rad: &Vector3<f64>, rates: &Vector3<f64>) -> [f64; 3] {
    let ((sin_roll, cos_roll), (sin_pitch, cos_pitch)) = (libm::sincos(euler_rad.x), libm::sincos(euler_rad.y));
    [
        rates.x - rates.z * sin_pitch,
        rates.y * cos_roll + rates.z * sin_roll * cos_pitch,
        -rates.y * sin_roll + rates.z * cos_roll * cos_pitch,
    ]
}
