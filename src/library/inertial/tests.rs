//! Tests by motions whose attitude and velocity are functions of time.

use nalgebra::{UnitQuaternion, Vector3};
use testkit::random::Random;

use super::*;
use crate::frames::RollPitch;
use crate::time::Timestamp;

const RATE_HZ: u32 = 104;

/// Roll, pitch and yaw, radians, and velocity, m/s in north, east, down, at a time in seconds.
type Motion = fn(f64) -> ([f64; 3], [f64; 3]);

fn rotation_at(motion: Motion, t_s: f64) -> UnitQuaternion<f64> {
    let ([roll, pitch, yaw], _) = motion(t_s);
    UnitQuaternion::from_euler_angles(roll, pitch, yaw)
}

/// A sensor with constant errors and noise that follows a motion.
struct MovingSensor {
    motion: Motion,
    gyro_offset_rad_s: Vector3<f32>,
    accelerometer_offset_m_s2: Vector3<f32>,
    random: Random,
}

impl MovingSensor {
    fn new(motion: Motion, seed: u64) -> Self {
        let mut random = Random(seed);
        let mut drawn = |sigma: f32| Vector3::from_fn(|_, _| sigma * random.normal());
        let errors = InertialSensorErrors::CALIBRATED;
        Self {
            motion,
            gyro_offset_rad_s: drawn(errors.gyro_offset_rad_s),
            accelerometer_offset_m_s2: drawn(errors.accelerometer_offset_m_s2),
            random,
        }
    }

    /// Mean rates and specific force of the step that ends at `t_s`, with the noise of a MEMS sensor in 50 Hz.
    fn sample(&mut self, t_s: f64) -> InertialSample {
        let step_s = 1.0 / f64::from(RATE_HZ);
        let [before, after] = [t_s - step_s, t_s].map(|t_s| rotation_at(self.motion, t_s));
        let rates = (before.inverse() * after).scaled_axis() / step_s;
        let [earlier, later] = [t_s - 0.5 * step_s, t_s + 0.5 * step_s].map(|t_s| Vector3::from((self.motion)(t_s).1));
        let force = after.inverse() * ((later - earlier) / step_s - Vector3::new(0.0, 0.0, f64::from(GRAVITY_M_S2)));
        let mut noisy = |exact: Vector3<f64>, sigma: f32| {
            exact.cast::<f32>() + Vector3::from_fn(|_, _| sigma * self.random.normal())
        };
        InertialSample {
            rates_rad_s: noisy(rates, 0.05 * DEG) + self.gyro_offset_rad_s,
            specific_force_m_s2: noisy(force, 0.01) + self.accelerometer_offset_m_s2,
        }
    }
}

/// Filter that follows a sensor, and the true motion.
struct Run {
    filter: AttitudeFilter,
    sensor: MovingSensor,
    speed_m_s: Option<f32>,
    sample_count: u32,
}

impl Run {
    fn new(motion: Motion, seed: u64) -> Self {
        let filter = AttitudeFilter::new(InertialSensorErrors::CALIBRATED, SensorOffsets::UNKNOWN);
        Self { filter, sensor: MovingSensor::new(motion, seed), speed_m_s: None, sample_count: 0 }
    }

    fn t_s(&self) -> f64 {
        f64::from(self.sample_count) / f64::from(RATE_HZ)
    }

    fn run_for_s(&mut self, duration_s: u32) {
        for _ in 0..duration_s * RATE_HZ {
            self.sample_count += 1;
            let sample = self.sensor.sample(self.t_s());
            self.filter.update(Timestamp::from_us((self.t_s() * 1e6) as u64), &sample, self.speed_m_s);
        }
    }

    /// Error of the tilt about the level frame's x and y axes, rad.
    fn tilt_errors_rad(&self) -> [f64; 2] {
        let RollPitch { roll_rad, pitch_rad } = self.filter.attitude().unwrap().attitude;
        let estimated = UnitQuaternion::from_euler_angles(f64::from(roll_rad), f64::from(pitch_rad), 0.0);
        let down = estimated * (rotation_at(self.sensor.motion, self.t_s()).inverse() * Vector3::z());
        [-down.y, down.x]
    }

    fn tilt_error_deg(&self) -> f64 {
        let [x, y] = self.tilt_errors_rad();
        x.hypot(y).to_degrees()
    }

    fn tilt_sigma_deg(&self) -> f64 {
        f64::from(self.filter.attitude().unwrap().tilt_sigma_rad()).to_degrees()
    }
}

fn at_rest(_: f64) -> ([f64; 3], [f64; 3]) {
    ([2.0, -0.7, 1.0], [0.0; 3])
}

/// A seaway of 15 deg at 5 s, with 0.6 m/s of surge, sway and heave.
fn seaway(t_s: f64) -> ([f64; 3], [f64; 3]) {
    let wave = |period_s: f64, phase: f64| (t_s * std::f64::consts::TAU / period_s + phase).sin();
    (
        [0.26 * wave(5.0, 0.3), 0.1 * wave(4.1, 2.0), 0.05 * wave(7.3, 1.0)],
        [0.6 * wave(4.1, 0.0), 0.6 * wave(5.0, 1.0), 0.6 * wave(4.5, 2.0)],
    )
}

/// A hand turns the sensor about all axes by up to 200 deg/s and moves it by 10 cm.
fn tumbling(t_s: f64) -> ([f64; 3], [f64; 3]) {
    (
        [2.0 * t_s, 1.2 * (1.1 * t_s).sin(), 1.5 * (0.7 * t_s).sin()],
        [0.3 * (3.0 * t_s).sin(), 0.3 * (2.3 * t_s).sin(), 0.2 * (2.9 * t_s).cos()],
    )
}

/// A boat on a circle at 20 m/s and 3 deg/s, after 5 s straight ahead.
fn circling(t_s: f64) -> ([f64; 3], [f64; 3]) {
    let yaw = 0.05 * (t_s - 5.0).max(0.0);
    ([0.0, 0.0, yaw], [20.0 * yaw.cos(), 20.0 * yaw.sin(), 0.0])
}

/// A hovering vehicle that accelerates by up to 2.5 m/s^2, which looks like 14 deg of pitch, to and fro.
fn hovering(t_s: f64) -> ([f64; 3], [f64; 3]) {
    let sway = 0.03 * (3.0 * t_s).sin();
    ([sway, sway, 0.0], [5.0 * (0.5 * t_s).sin(), 0.0, 0.0])
}

/// An aeroplane that rests for 5 s, accelerates to 22 m/s, and then flies straight on for 20 s and turns by 92 deg within 10 s at a bank of
/// 24 deg, again and again, with a sway, so that it is not at rest.
fn turning(t_s: f64) -> ([f64; 3], [f64; 3]) {
    let (legs_s, speed_m_s) = ((t_s - 10.0).max(0.0) / 30.0, (5.0 * (t_s - 5.0)).clamp(0.0, 22.0));
    let in_turn_s = (30.0 * legs_s.fract() - 20.0).max(0.0);
    let rolled = (in_turn_s / 2.0).min(1.0) * ((10.0 - in_turn_s) / 2.0).min(1.0);
    // The integral of the bank, of which 2 s are the roll into the turn and out of it.
    let turned_s = match in_turn_s {
        ..2.0 => in_turn_s * in_turn_s / 4.0,
        2.0..8.0 => in_turn_s - 1.0,
        _ => 8.0 - (10.0 - in_turn_s).powi(2) / 4.0,
    };
    let (yaw, sway) = (0.2 * (turned_s + 8.0 * legs_s.floor()), 0.03 * (3.0 * (t_s - 5.0).max(0.0)).sin());
    ([0.42 * rolled + sway, sway, yaw], [speed_m_s * yaw.cos(), speed_m_s * yaw.sin(), 0.0])
}

/// The attitude is known within 2 s at rest and within 10 s in motion, and its sigma shows how well: to a fifth of the waves and of a
/// hand's accelerations. A hovering vehicle's accelerations last too long for that.
#[test]
fn the_attitude_is_known_soon_after_the_start() {
    for (motion, start_s, limit_deg) in
        [(at_rest as Motion, 2, 0.6), (seaway, 10, 3.5), (tumbling, 10, 2.5), (hovering, 10, 20.0)]
    {
        for seed in 0..10 {
            let mut run = Run::new(motion, seed);
            run.run_for_s(start_s);
            let (error_deg, sigma_deg) = (run.tilt_error_deg(), run.tilt_sigma_deg());
            assert!(error_deg < limit_deg && error_deg < 4.0 * sigma_deg, "{start_s} {seed}: {error_deg} {sigma_deg}");
            assert!(sigma_deg < 3.0 * limit_deg, "{start_s} {seed}: {sigma_deg}");
        }
    }
}

/// Later errors, RMS of 20 sensors for two minutes, and the shares within one and two sigmas. The deviations of an aeroplane's velocity
/// keep their sign in a turn; with their noise on the short scale alone 76 % of the errors are within two
/// sigmas.
#[test]
fn errors_are_small_and_their_sigmas_right() {
    for (motion, limit_deg) in [(at_rest as Motion, 0.4), (seaway, 0.5), (tumbling, 0.4), (turning, 2.0)] {
        let (mut squares, mut normalised) = (0.0, Vec::new());
        for seed in 0..20 {
            let mut run = Run::new(motion, seed);
            run.run_for_s(20);
            for _ in 0..50 {
                run.run_for_s(2);
                let covariance = run.filter.attitude().unwrap().tilt_covariance;
                squares += run.tilt_error_deg().powi(2) / 1000.0;
                for (axis, error) in run.tilt_errors_rad().iter().enumerate() {
                    normalised.push(error.abs() / f64::from(covariance[(axis, axis)]).sqrt());
                }
            }
        }
        let share = |sigmas: f64| normalised.iter().filter(|z| **z < sigmas).count() as f64 / normalised.len() as f64;
        let (rms_deg, shares) = (squares.sqrt(), [1.0, 2.0].map(share));
        assert!(rms_deg < limit_deg && shares[0] > 0.58 && shares[1] > 0.9, "{limit_deg}: {rms_deg} {shares:?}");
    }
}

/// A centripetal acceleration of 1 m/s^2 looks like 6 deg of bank: a known speed removes this error, and without
/// one it is in the sigma.
#[test]
fn a_known_speed_removes_the_centripetal_acceleration() {
    let [known_deg, unknown_deg] = [Some(20.0), None].map(|speed_m_s| {
        let mut run = Run::new(circling, 1);
        run.run_for_s(5);
        run.speed_m_s = speed_m_s;
        let mut mean_sigma_deg = 0.0;
        for _ in 0..120 {
            run.run_for_s(1);
            let (error_deg, sigma_deg) = (run.tilt_error_deg(), run.tilt_sigma_deg());
            assert!(error_deg < 4.0 * sigma_deg, "{speed_m_s:?}: {error_deg} {sigma_deg}");
            assert!(speed_m_s.is_none() || error_deg < 0.5, "{error_deg}");
            mean_sigma_deg += sigma_deg / 120.0;
        }
        mean_sigma_deg
    });
    assert!(known_deg < 0.5 && unknown_deg > 1.5 * known_deg, "{known_deg} {unknown_deg}");
}

/// A steady turn of 3 deg/s, as of an aeroplane in calm air, is no offset of the gyro once that is known.
#[test]
fn rest_measures_the_offset_and_a_steady_turn_does_not() {
    fn rest_then_turn(t_s: f64) -> ([f64; 3], [f64; 3]) {
        ([0.0, 0.0, 0.05 * (t_s - 10.0).max(0.0)], [0.0; 3])
    }
    let mut run = Run::new(rest_then_turn, 3);
    for (duration_s, is_still) in [(10, true), (20, false)] {
        run.run_for_s(duration_s);
        let error = Vector3::from(run.filter.sensor_offsets(25.0).gyro_rad_s) - run.sensor.gyro_offset_rad_s;
        assert!(error.norm() < 0.05 * DEG, "still {is_still}: {}", error.norm() / DEG);
    }
}

/// Without rest and speed, an aeroplane's circles make the estimated offset wrong by degrees per second, with a small sigma: its
/// rates are not taken as measured.
#[test]
fn rates_are_measured_from_the_first_rest_on() {
    /// After a minute straight ahead two circles at 25 deg of bank and 22 m/s to each side; bank and pitch sway by 11 deg.
    fn banked_circles(t_s: f64) -> ([f64; 3], [f64; 3]) {
        let (turn_s, side) = if t_s < 120.0 { (t_s - 60.0, 1.0) } else { (180.0 - t_s, -1.0) };
        let (turn_s, bank) = (turn_s.max(0.0), 0.44 * side * (turn_s * 0.5).clamp(0.0, 1.0));
        let yaw = 0.2 * turn_s;
        ([bank + 0.2 * (0.5 * t_s).sin(), 0.2 * (0.65 * t_s).sin(), yaw], [22.0 * yaw.cos(), 22.0 * yaw.sin(), 0.0])
    }
    for (motion, is_at_rest) in [(at_rest as Motion, true), (banked_circles, false)] {
        let mut run = Run::new(motion, 0);
        run.run_for_s(5);
        for _ in 5..180 {
            run.run_for_s(1);
            let measured_rates = run.filter.attitude().and_then(|estimate| estimate.measured_rates_rad_s);
            assert_eq!(measured_rates.is_some(), is_at_rest, "{} s", run.t_s());
        }
    }
}

/// A vehicle that is steady but known to move may turn: what the gyro measures is not its offset. An offset about the vertical then
/// acts as a centripetal acceleration, which is in the sigma.
#[test]
fn a_moving_vehicle_is_not_at_rest() {
    let mut run = Run::new(circling, 3);
    run.speed_m_s = Some(20.0);
    run.run_for_s(5);
    let estimate_rad_s = run.filter.sensor_offsets(25.0).gyro_rad_s[2];
    assert!(estimate_rad_s.abs() < 0.1 * run.sensor.gyro_offset_rad_s.z.abs(), "{estimate_rad_s}");
    for _ in 0..60 {
        run.run_for_s(1);
        let (error_deg, sigma_deg) = (run.tilt_error_deg(), run.tilt_sigma_deg());
        assert!(error_deg < 4.0 * sigma_deg, "{error_deg} {sigma_deg}");
    }
}

/// A restart in a seaway: with the offsets that were estimated before, the gyro holds the attitude over the waves. Another temperature
/// makes them as uncertain as it may change them.
#[test]
fn a_restart_uses_the_offsets_estimated_before() {
    let mean_square_deg = |use_offsets: fn(SensorOffsets) -> SensorOffsets| {
        let mut mean_square_deg = 0.0;
        for seed in 0..20 {
            let mut run = Run::new(seaway, seed);
            run.run_for_s(60);
            let offsets = use_offsets(run.filter.sensor_offsets(25.0));
            run.filter = AttitudeFilter::new(InertialSensorErrors::CALIBRATED, offsets);
            for _ in 0..20 {
                run.run_for_s(1);
                mean_square_deg += run.tilt_error_deg().powi(2) / 400.0;
            }
        }
        mean_square_deg
    };
    let [known, unknown] = [mean_square_deg(|offsets| offsets), mean_square_deg(|_| SensorOffsets::UNKNOWN)];
    assert!(known < 0.5 * unknown, "{known} {unknown}");
    let sigma_deg_s = |temperature_c| {
        SensorOffsets { gyro_sigma_rad_s: [0.0; 3], ..SensorOffsets::UNKNOWN }
            .at_temperature(temperature_c)
            .gyro_sigma_rad_s[0]
            / DEG
    };
    assert!(sigma_deg_s(0.0) < 0.01 && (0.4..0.5).contains(&sigma_deg_s(-30.0)), "{}", sigma_deg_s(-30.0));
    // A sensor that was never used has its data sheet's errors at any temperature.
    let errors = InertialSensorErrors { accelerometer_offset_m_s2: 0.4, ..InertialSensorErrors::CALIBRATED };
    let variances = |temperature_c| SensorOffsets::UNKNOWN.at_temperature(temperature_c).variances(&errors);
    assert_eq!(variances(-30.0), ([errors.gyro_offset_rad_s.powi(2); 3], 0.4_f32.powi(2)));
}

/// In a turn the specific force of an aeroplane is along its vertical axis, as in level flight. After a start there the attitude is up to
/// 9 sigmas off within a minute, unless the filter knows how the aeroplane has moved before.
#[test]
fn a_start_in_a_turn_is_as_uncertain_as_earlier_turns_make_it() {
    fn in_turn(t_s: f64) -> ([f64; 3], [f64; 3]) {
        turning(t_s + 33.0)
    }
    let largest_sigmas = |knows_movement: bool| {
        let mut largest = 0.0_f64;
        for seed in 0..10 {
            let mut flown = Run::new(turning, seed);
            flown.run_for_s(120);
            let offsets = flown.filter.sensor_offsets(20.0);
            let movement_m_s = if knows_movement { offsets.movement_m_s } else { 0.0 };
            let mut run = Run::new(in_turn, seed);
            run.filter =
                AttitudeFilter::new(InertialSensorErrors::CALIBRATED, SensorOffsets { movement_m_s, ..offsets });
            for _ in 0..60 {
                run.run_for_s(1);
                largest = largest.max(run.tilt_error_deg() / run.tilt_sigma_deg());
            }
        }
        largest
    };
    let [known, unknown] = [true, false].map(largest_sigmas);
    assert!(known < 4.0 && unknown > 4.0, "{known} {unknown}");
}

/// At rest the accelerometer's offset remains as uncertain as before: a calibration may use an attitude with 10 mg, not with 20 mg,
/// nor at the start.
#[test]
fn an_accurate_attitude_has_a_known_tilt_and_a_known_offset() {
    let is_accurate = |accelerometer_offset_m_s2: f32, duration_s: u32| {
        let errors = InertialSensorErrors { accelerometer_offset_m_s2, ..InertialSensorErrors::CALIBRATED };
        let mut run = Run::new(at_rest, 1);
        run.filter = AttitudeFilter::new(errors, SensorOffsets::UNKNOWN);
        let first = run.sensor.sample(0.0);
        run.filter.update(Timestamp::START, &first, None);
        run.run_for_s(duration_s);
        run.filter.attitude().unwrap().is_accurate
    };
    assert_eq!([(0.098, 10), (0.2, 10), (0.03, 0)].map(|(m_s2, s)| is_accurate(m_s2, s)), [true, false, false]);
}

/// A sample that is not finite changes nothing; a gap, and free fall at the start, leave no attitude.
#[test]
fn unusable_samples_leave_no_wrong_attitude() {
    let mut run = Run::new(at_rest, 1);
    run.run_for_s(3);
    let good = run.sensor.sample(3.0);
    let known = run.filter.attitude();
    let at_us = |us: u64| Timestamp::from_us(3_000_000 + us);
    for bad in [f32::NAN, f32::INFINITY] {
        let mut sample = good;
        sample.rates_rad_s.y = bad;
        run.filter.update(at_us(10_000), &sample, None);
        assert_eq!(run.filter.attitude(), known);
    }
    let free_fall = InertialSample { specific_force_m_s2: Vector3::zeros(), ..good };
    run.filter.update(at_us(200_000), &free_fall, None);
    assert_eq!(run.filter.attitude(), None);
    run.filter.update(at_us(210_000), &good, None);
    assert!(run.filter.attitude().unwrap().tilt_sigma_rad() > 0.1);
}

/// Half an hour of movement: no variance is negative by rounding, and the attitude is as accurate as at the start.
#[test]
fn rounding_does_not_accumulate() {
    for motion in [at_rest as Motion, tumbling] {
        let mut run = Run::new(motion, 2);
        for _ in 0..180 {
            run.run_for_s(10);
            let covariance = run.filter.attitude().unwrap().tilt_covariance;
            assert!(covariance.determinant() > 0.0 && covariance.trace() > 0.0, "{} s: {covariance}", run.t_s());
        }
        assert!(run.tilt_error_deg() < 0.7, "{}", run.tilt_error_deg());
    }
}
/// A start while a catapult accelerates by 8 m/s^2 shows the vertical wrong by 39 deg, and then a velocity that grows
/// without end.
#[test]
fn a_start_with_a_wrong_vertical_is_corrected() {
    fn launch(t_s: f64) -> ([f64; 3], [f64; 3]) {
        ([0.0; 3], [8.0 * t_s.min(2.0), 0.0, 0.0])
    }
    let mut run = Run::new(launch, 1);
    run.run_for_s(20);
    assert!(run.tilt_error_deg() < 1.0, "{}", run.tilt_error_deg());
}
