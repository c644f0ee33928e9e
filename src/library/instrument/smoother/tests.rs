//! Tests of the smoothed heading on synthetic flights.

use core::f32::consts::PI;

use testkit::random::Random;

use super::super::gyro_error::GyroErrorRows;
use super::super::ud_filter::UdFilter;
use super::*;
use crate::attitude::{EulerRates, GyroHeading};
use crate::frames::RollPitch;

/// Interval of readings at 80 Hz.
const STEP_US: u64 = 12_500;
pub(super) const STEP_S: f32 = 0.0125;

type GyroModel = fn(f32) -> f32;

/// The monitor's gyro errors after some turns: estimates of zero, a scale sigma of 0.3 % on the z axis.
fn gyro_errors() -> UdFilter<GYRO_ERROR_COUNT> {
    UdFilter::new(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.003])
}

fn level_rate_error(gyro_heading: &GyroHeading) -> HeadingRateError {
    HeadingRateError::new(
        &gyro_errors(),
        GyroErrorRows::new(RollPitch::default(), &gyro_heading.euler_rates).heading_row,
    )
}

struct Flight {
    smoother: HeadingSmoother,
    random: Random,
    at_us: u64,
    step_us: u64,
    heading_rad: f32,
    gyro_heading_rad: f32,
    gyro_run_number: u8,
    gyro: GyroModel,
    /// Raw heading: reported sigma, true sigma, correlation time; then the sigma due to coefficients.
    sigma_rad: f32,
    noise_sigma_rad: f32,
    noise_correlation_s: f32,
    coefficient_sigma_rad: f32,
    noise_rad: f32,
}

struct HeadingErrors {
    /// Raw minus true heading, radians.
    raw_error_rad: f32,
    /// Smoothed minus true heading, and its sigma, radians.
    smooth_error_and_sigma: Option<(f32, f32)>,
}

impl Flight {
    /// An ideal gyro, and raw headings with 1 deg of noise, correlated over 0.5 s.
    fn new() -> Self {
        Self {
            smoother: HeadingSmoother::new(),
            random: Random(1),
            at_us: 1_000_000,
            step_us: STEP_US,
            heading_rad: 1.0,
            gyro_heading_rad: 0.0,
            gyro_run_number: 1,
            gyro: |rate_rad_s| rate_rad_s,
            sigma_rad: DEG,
            noise_sigma_rad: DEG,
            noise_correlation_s: 0.5,
            coefficient_sigma_rad: 0.0,
            noise_rad: 0.0,
        }
    }

    fn gyro_heading(&self, rate_rad_s: f32) -> GyroHeading {
        let euler_rates = EulerRates { heading_rad_s: (self.gyro)(rate_rad_s), ..EulerRates::default() };
        GyroHeading { euler_rates, relative_heading_rad: self.gyro_heading_rad, run_number: self.gyro_run_number }
    }

    fn raw_heading(&self) -> Heading {
        Heading {
            magnetic_rad: wrap_two_pi(self.heading_rad + self.noise_rad),
            sigma_rad: self.sigma_rad.hypot(self.coefficient_sigma_rad),
            systematic_variance_rad2: square(self.coefficient_sigma_rad),
        }
    }

    fn advance(&mut self, rate_deg_s: f32) -> f32 {
        let step_s = self.step_us as f32 * 1e-6;
        let rate_rad_s = rate_deg_s * DEG;
        self.at_us += self.step_us;
        self.heading_rad = wrap_pi(self.heading_rad + rate_rad_s * step_s);
        self.gyro_heading_rad = wrap_pi(self.gyro_heading_rad + (self.gyro)(rate_rad_s) * step_s);
        let decay = (-step_s / self.noise_correlation_s).exp();
        self.noise_rad =
            decay * self.noise_rad + (1.0 - decay * decay).sqrt() * self.noise_sigma_rad * self.random.normal();
        rate_rad_s
    }

    /// Passes these inputs at the present time to the smoother.
    fn smooth_inputs(&mut self, raw: Option<&Heading>, gyro_heading: Option<&GyroHeading>) -> Option<Heading> {
        let rate_error = gyro_heading.map_or(HeadingRateError::ZERO_ERROR, level_rate_error);
        self.smoother.smooth_heading(Timestamp::from_us(self.at_us), raw, gyro_heading, &rate_error)
    }

    fn smooth_step(&mut self, rate_deg_s: f32) -> HeadingErrors {
        let rate_rad_s = self.advance(rate_deg_s);
        let smooth = self.smooth_inputs(Some(&self.raw_heading()), Some(&self.gyro_heading(rate_rad_s)));
        let error_and_sigma = |smooth: Heading| (wrap_pi(smooth.magnetic_rad - self.heading_rad), smooth.sigma_rad);
        HeadingErrors { raw_error_rad: self.noise_rad, smooth_error_and_sigma: smooth.map(error_and_sigma) }
    }

    fn fly_seconds(&mut self, rate_deg_s: f32, seconds: f32) -> Vec<HeadingErrors> {
        let steps = (seconds * 1e6) as u64 / self.step_us;
        (0..steps).map(|_| self.smooth_step(rate_deg_s)).collect()
    }

    /// Repeats straight flight and turns to both sides, 30 s in total.
    fn fly_turns(&mut self, repetitions: usize) -> Vec<HeadingErrors> {
        (0..repetitions)
            .flat_map(|_| [(0.0, 8.0), (18.0, 8.0), (0.0, 6.0), (-18.0, 8.0)])
            .flat_map(|(rate_deg_s, seconds)| self.fly_seconds(rate_deg_s, seconds))
            .collect()
    }

    /// A flight after the first turns.
    fn settled() -> Self {
        let mut flight = Self::new();
        flight.fly_turns(1);
        flight
    }
}

fn rms_deg(errors_rad: impl Iterator<Item = f32>) -> f32 {
    let (sum, number) = errors_rad.fold((0.0, 0.0), |(sum, number), rad| (sum + rad * rad, number + 1.0));
    (sum / number as f32).sqrt().to_degrees()
}

/// Errors of the smoothed headings with their sigmas, radians.
fn smoothed(output: &[HeadingErrors]) -> impl Iterator<Item = (f32, f32)> {
    output.iter().filter_map(|output| output.smooth_error_and_sigma)
}

/// RMS error of the smoothed headings, and RMS of their sigma, degrees.
fn smoothed_rms_deg(output: &[HeadingErrors]) -> [f32; 2] {
    [rms_deg(smoothed(output).map(|(rad, _)| rad)), rms_deg(smoothed(output).map(|(_, sigma_rad)| sigma_rad))]
}

fn all_smoothed(output: &[HeadingErrors]) -> bool {
    output.iter().all(|output| output.smooth_error_and_sigma.is_some())
}

fn none_smoothed(output: &[HeadingErrors]) -> bool {
    output.iter().all(|output| output.smooth_error_and_sigma.is_none())
}

/// A filter with 10 s of memory leaves `sqrt(0.5 s / 10 s)` of noise correlated over 0.5 s, about a fifth.
#[test]
fn a_smoothed_heading_has_less_error_and_a_correct_sigma() {
    let output = Flight::settled().fly_turns(10);
    assert!(all_smoothed(&output));
    let raw_deg = rms_deg(output.iter().map(|output| output.raw_error_rad));
    let [smooth_deg, sigma_deg] = smoothed_rms_deg(&output);
    assert!((raw_deg - 1.0).abs() < 0.1, "{raw_deg}");
    assert!(smooth_deg < 0.4 * raw_deg, "{smooth_deg}");
    assert!(sigma_deg > 0.7 * smooth_deg && sigma_deg < 1.5 * smooth_deg, "{sigma_deg} {smooth_deg}");
}

#[test]
fn correlated_noise_stays_in_the_smoothed_sigma() {
    let mut flight = Flight { noise_correlation_s: 8.0, ..Flight::new() };
    flight.fly_turns(6);
    let [smooth_deg, sigma_deg] = smoothed_rms_deg(&flight.fly_turns(40));
    assert!(smooth_deg > 0.6, "{smooth_deg}");
    assert!(sigma_deg > 0.4 * smooth_deg && sigma_deg < 1.2, "{sigma_deg} {smooth_deg}");
}

#[test]
fn coefficient_variance_is_added_to_the_smoothed_sigma() {
    let sigma_deg = |coefficients_deg: f32| {
        let mut flight = Flight { coefficient_sigma_rad: coefficients_deg * DEG, ..Flight::new() };
        smoothed(&flight.fly_turns(4)).last().unwrap().1.to_degrees()
    };
    let (without, with) = (sigma_deg(0.0), sigma_deg(2.0));
    assert!((with - without.hypot(2.0)).abs() < 1e-3, "{with} {without}");
}

/// Reference: conventional Kalman filter in f64 at uneven steps, with its own parameters.
#[test]
fn the_smoother_equals_a_conventional_kalman_filter() {
    let square = |x: f64| x * x;
    let deg = core::f64::consts::PI / 180.0;
    let mut random = Random(5);
    let mut gyro_heading = GyroHeading::default();
    let mut at_us = 0_u64;
    let mut state = SmootherState::new_at(Timestamp::from_us(0), 0.5, square(deg) as f32, &gyro_heading);
    let (mut psi, mut beta) = (0.5_f64, 0.0_f64);
    let mut p = [[square(deg), 0.0], [0.0, square(0.1 * deg)]];
    for i in 0..4000 {
        let step_us = u64::from(random.byte()) * 400 + 5_000;
        let dt = step_us as f64 * 1e-6;
        at_us += step_us;
        gyro_heading.euler_rates.heading_rad_s = random.uniform(-0.4, 0.4);
        let turned = gyro_heading.euler_rates.heading_rad_s * dt as f32;
        gyro_heading.relative_heading_rad = wrap_pi(gyro_heading.relative_heading_rad + turned);
        // The monitor has found that the gyro turns too fast by 0.6 deg/s.
        let rate_error = HeadingRateError { rate_error_rad_s: 0.01, ..level_rate_error(&gyro_heading) };
        state.predict_state(Timestamp::from_us(at_us), &gyro_heading, &rate_error).unwrap();
        psi += f64::from(turned) - (0.01 + beta) * dt;
        let rate = f64::from(gyro_heading.euler_rates.heading_rad_s);
        let [[a, b], [_, c]] = p;
        let b = b - dt * c;
        p = [[a - 2.0 * dt * p[0][1] + dt * dt * c, b], [b, c + square(0.002 * deg) * dt]];
        p[0][0] += square(0.2 * deg) * dt + square(0.003 * rate) * 10.0 * dt;
        let innovation = if i % 50 == 0 { random.uniform(-0.5, 0.5) } else { random.uniform(-0.05, 0.05) };
        let v = f64::from(random.uniform(1e-4, 9e-4));
        let z = f64::from(innovation);
        state.update_measurement(innovation, v as f32, dt as f32);
        let far = (z * z / (9.0 * (p[0][0] + v))).max(1.0);
        let s = p[0][0] + far * v * 2.0 * 2.0 / dt;
        let k = [p[0][0] / s, p[0][1] / s];
        psi += k[0] * z;
        beta += k[1] * z;
        let [[a, b], [_, c]] = p;
        p = [[a - k[0] * a, b - k[0] * b], [b - k[0] * b, c - k[1] * b]];
        let u = f64::from(state.bias_regression_s);
        let found =
            [f64::from(state.heading_variance()), u * f64::from(state.bias_variance), f64::from(state.bias_variance)];
        for (found, expected) in found.into_iter().zip([p[0][0], p[0][1], p[1][1]]) {
            assert!((found - expected).abs() < 2e-3 * expected.abs() + 1e-9, "{i}: {found} {expected}");
        }
    }
    let psi = psi - core::f64::consts::TAU * (psi / core::f64::consts::TAU).round();
    assert!(wrap_pi(state.heading_rad - psi as f32).abs() < 2e-3, "{} {psi}", state.heading_rad);
    assert!((f64::from(state.bias_rad_s) - beta).abs() < 2e-2 * beta.abs() + 1e-5, "{} {beta}", state.bias_rad_s);
}

/// 24 hours at 10 Hz with a gyro bias that changes sign.
#[test]
fn the_smoother_does_not_degrade_in_a_day() {
    let gyros: [GyroModel; 2] = [|rate_rad_s| rate_rad_s + 0.05 * DEG, |rate_rad_s| rate_rad_s - 0.05 * DEG];
    let mut flight = Flight { step_us: 100_000, ..Flight::new() };
    for hour in 0..24 {
        flight.gyro = gyros[hour % 2];
        let mut squares = 0.0;
        let mut number = 0.0;
        for step in 0..36_000 {
            let rate_deg_s = if step % 600 < 200 { 12.0 } else { 0.0 };
            let output = flight.smooth_step(rate_deg_s);
            let state = flight.smoother.filter_state.as_ref().unwrap();
            assert!(
                state.conditional_heading_variance > 0.0 && state.bias_variance > 0.0 && state.heading_rad.abs() <= PI
            );
            assert!(
                state.heading_variance() < square(2.0 * DEG) && state.bias_variance < 1.1 * INITIAL_GYRO_BIAS_VARIANCE
            );
            if step < 3_000 {
                continue; // Settling after the change of bias.
            }
            let (rad, sigma_rad) = output.smooth_error_and_sigma.unwrap();
            assert!(sigma_rad > 0.02 * DEG && sigma_rad < 3.1 * DEG, "{}", sigma_rad.to_degrees());
            squares += rad * rad;
            number += 1.0;
        }
        let rms_deg = (squares / number).sqrt().to_degrees();
        assert!(rms_deg < 0.4, "hour {hour}: {rms_deg}");
    }
}

#[test]
fn a_lost_smoother_restarts_after_5_s() {
    let mut flight = Flight::new();
    flight.fly_turns(4);
    flight.heading_rad = wrap_pi(flight.heading_rad + PI / 2.0);
    assert!(none_smoothed(&flight.fly_seconds(18.0, 6.0)[1..]));
    flight.fly_seconds(18.0, 16.0);
    let (rad, sigma_rad) = flight.smooth_step(18.0).smooth_error_and_sigma.unwrap();
    assert!(rad.abs() < 2.0 * DEG && sigma_rad < 0.55 * DEG, "{} {}", rad.to_degrees(), sigma_rad.to_degrees());
}

#[test]
fn a_gap_is_bridged_by_the_gyro_for_three_seconds() {
    for (gap_s, is_continued) in [(2.9, true), (3.1, false)] {
        let mut flight = Flight::settled();
        for _ in 0..(gap_s / STEP_S) as usize {
            let rate_rad_s = flight.advance(40.0);
            let gyro_heading = flight.gyro_heading(rate_rad_s);
            assert_eq!(flight.smooth_inputs(None, Some(&gyro_heading)), None, "no raw heading");
        }
        let output = flight.smooth_step(40.0);
        assert_eq!(output.smooth_error_and_sigma.is_some(), is_continued, "{gap_s}");
        assert!(output.smooth_error_and_sigma.is_none_or(|(rad, _)| rad.abs() < DEG));
        let later = flight.fly_seconds(0.0, 2.2);
        assert!(all_smoothed(if is_continued { &later } else { &later[later.len() - 10..] }));
    }
}

#[test]
fn no_smoothed_heading_without_a_gyro_or_after_a_new_gyro_run() {
    let mut flight = Flight::settled();
    flight.advance(0.0);
    let raw = flight.raw_heading();
    assert_eq!(flight.smooth_inputs(Some(&raw), None), None);
    assert!(flight.smooth_step(0.0).smooth_error_and_sigma.is_some(), "it is back within three seconds");
    (flight.gyro_run_number, flight.gyro_heading_rad) = (2, -1.0);
    assert!(none_smoothed(&flight.fly_seconds(0.0, 1.9)));
    assert!(all_smoothed(&flight.fly_seconds(0.0, 2.0)[20..]));
}

#[test]
fn turns_faster_than_360_deg_s_are_not_smoothed() {
    for (rate_deg_s, is_output) in [(355.0, true), (365.0, false), (-355.0, true), (-365.0, false)] {
        let output = Flight::settled().fly_seconds(rate_deg_s, 1.0);
        assert!(if is_output { all_smoothed(&output) } else { none_smoothed(&output[1..]) }, "{rate_deg_s}");
    }
}

/// Wrong body rates: the smoothed heading is withheld from the first turn on, before its error exceeds 4 sigma, and
/// remains so until a turn shows correct rates.
#[test]
fn a_wrong_gyro_is_detected_in_the_first_turn() {
    let wrong: [(&str, GyroModel); 4] = [
        ("nearly nothing", |_| 1e-6),
        ("wrong sign", |rate_rad_s| -rate_rad_s),
        ("degrees for radians", |rate_rad_s| rate_rad_s * 57.3),
        ("radians for degrees", |rate_rad_s| rate_rad_s / 57.3),
    ];
    for (name, gyro) in wrong {
        let mut flight = Flight { gyro, ..Flight::settled() };
        let mut turn = flight.fly_seconds(0.0, 4.0);
        for rate in 0..80 {
            turn.push(flight.smooth_step(18.0 * rate as f32 / 80.0));
        }
        turn.extend(flight.fly_seconds(18.0, 8.0));
        let worst_rad = smoothed(&turn).map(|(rad, _)| rad.abs()).fold(0.0, f32::max);
        assert!(worst_rad.to_degrees() < 5.5, "{name}: {}", worst_rad.to_degrees());
        assert!(none_smoothed(&turn[turn.len() - 300..]), "{name}");
        assert!(none_smoothed(&flight.fly_seconds(0.0, 20.0)), "{name}: correct rates show in a turn only");
        flight.gyro = |rate_rad_s| rate_rad_s;
        flight.fly_seconds(18.0, 8.0);
        assert!(all_smoothed(&flight.fly_seconds(0.0, 2.0)), "{name}");
    }
}

#[test]
fn noise_above_the_reported_sigma_is_no_contradiction() {
    let mut flight = Flight { noise_correlation_s: 0.001, ..Flight::new() };
    flight.fly_turns(1);
    flight.noise_sigma_rad = 5.0 * DEG;
    flight.fly_turns(1);
    let output = flight.fly_turns(1);
    let smoothed_count = smoothed(&output).count();
    assert!(smoothed_count > output.len() * 9 / 10, "{smoothed_count} of {}", output.len());
    assert!(smoothed_rms_deg(&output)[0] < 1.0);
}

#[test]
fn non_finite_input_is_discarded() {
    for (input_name, corrupt) in [
        ("heading", (|raw, _, bad| raw.magnetic_rad = bad) as fn(&mut Heading, &mut GyroHeading, f32)),
        ("sigma", |raw, _, bad| raw.sigma_rad = bad),
        ("coefficients", |raw, _, bad| raw.systematic_variance_rad2 = bad),
        ("turned", |_, gyro_heading, bad| gyro_heading.relative_heading_rad = bad),
        ("rate", |_, gyro_heading, bad| gyro_heading.euler_rates.heading_rad_s = bad),
    ] {
        for bad in [f32::NAN, f32::INFINITY, f32::MAX, 0.0] {
            let mut flight = Flight::settled();
            for _ in 0..3 {
                let rate_rad_s = flight.advance(0.0);
                let (mut raw, mut gyro_heading) = (flight.raw_heading(), flight.gyro_heading(rate_rad_s));
                corrupt(&mut raw, &mut gyro_heading, bad);
                flight.smooth_inputs(Some(&raw), Some(&gyro_heading));
            }
            flight.fly_turns(2);
            let output = flight.fly_turns(1);
            assert!(all_smoothed(&output), "{input_name} {bad}");
            assert!(smoothed_rms_deg(&output)[0] < 1.0, "{input_name} {bad}");
        }
    }
}
