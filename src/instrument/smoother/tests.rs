//! Tests of the smoothed heading on synthetic flights.

use core::f32::consts::{PI, TAU};

use testkit::random::Random;

use super::*;
use crate::attitude::EulerRates;

/// 80 Hz.
const STEP_US: u64 = 12_500;
const STEP_S: f32 = 0.0125;

type Gyro = fn(f32) -> f32;

struct Flight {
    smoother: HeadingSmoother,
    random: Random,
    at_us: u64,
    step_us: u64,
    heading_rad: f32,
    turned_rad: f32,
    run: u8,
    gyro: Gyro,
    /// Raw heading: reported sigma, true sigma, correlation time; then the sigma due to coefficients.
    sigma_rad: f32,
    noise_sigma_rad: f32,
    noise_s: f32,
    coefficients_rad: f32,
    noise_rad: f32,
}

struct Told {
    /// Raw minus true.
    raw_rad: f32,
    /// Smoothed minus true, and its sigma.
    smooth: Option<(f32, f32)>,
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
            turned_rad: 0.0,
            run: 1,
            gyro: |rate_rad_s| rate_rad_s,
            sigma_rad: DEG,
            noise_sigma_rad: DEG,
            noise_s: 0.5,
            coefficients_rad: 0.0,
            noise_rad: 0.0,
        }
    }

    fn turning(&self, rate_rad_s: f32) -> GyroHeading {
        let motion = EulerRates { heading_rad_s: (self.gyro)(rate_rad_s), ..EulerRates::default() };
        GyroHeading { euler_rates: motion, relative_heading_rad: self.turned_rad, run: self.run }
    }

    fn raw(&self) -> Heading {
        Heading {
            magnetic_rad: wrap_two_pi(self.heading_rad + self.noise_rad),
            sigma_rad: self.sigma_rad.hypot(self.coefficients_rad),
            systematic_variance_rad2: square(self.coefficients_rad),
        }
    }

    fn pass(&mut self, rate_deg_s: f32) -> f32 {
        let step_s = self.step_us as f32 * 1e-6;
        let rate_rad_s = rate_deg_s * DEG;
        self.at_us += self.step_us;
        self.heading_rad = wrap_pi(self.heading_rad + rate_rad_s * step_s);
        self.turned_rad = wrap_pi(self.turned_rad + (self.gyro)(rate_rad_s) * step_s);
        let kept = (-step_s / self.noise_s).exp();
        self.noise_rad =
            kept * self.noise_rad + (1.0 - kept * kept).sqrt() * self.noise_sigma_rad * self.random.normal();
        rate_rad_s
    }

    fn step(&mut self, rate_deg_s: f32) -> Told {
        let rate_rad_s = self.pass(rate_deg_s);
        let smooth = self.smoother.smooth_heading(
            Timestamp::from_us(self.at_us),
            Some(&self.raw()),
            Some(self.turning(rate_rad_s)),
        );
        let off = |smooth: Heading| (wrap_pi(smooth.magnetic_rad - self.heading_rad), smooth.sigma_rad);
        Told { raw_rad: self.noise_rad, smooth: smooth.map(off) }
    }

    fn fly(&mut self, rate_deg_s: f32, seconds: f32) -> Vec<Told> {
        let steps = (seconds * 1e6) as u64 / self.step_us;
        (0..steps).map(|_| self.step(rate_deg_s)).collect()
    }

    /// Straight flight and turns to both sides, 30 s.
    fn wander(&mut self) -> Vec<Told> {
        [(0.0, 8.0), (18.0, 8.0), (0.0, 6.0), (-18.0, 8.0)]
            .into_iter()
            .flat_map(|(rate_deg_s, seconds)| self.fly(rate_deg_s, seconds))
            .collect()
    }
}

fn rms_deg(errors_rad: impl Iterator<Item = f32>) -> f32 {
    let (sum, number) = errors_rad.fold((0.0, 0.0), |(sum, number), rad| (sum + rad * rad, number + 1.0));
    (sum / number as f32).sqrt().to_degrees()
}

fn all_told(told: &[Told]) -> bool {
    told.iter().all(|told| told.smooth.is_some())
}

fn none_told(told: &[Told]) -> bool {
    told.iter().all(|told| told.smooth.is_none())
}

/// A filter with 10 s of memory leaves `sqrt(0.5 s / 10 s)` of noise correlated over 0.5 s, about a fifth.
#[test]
fn a_smooth_heading_is_better_than_the_raw_one_and_knows_how_good_it_is() {
    let mut flight = Flight::new();
    flight.wander();
    let told: Vec<Told> = (0..10).flat_map(|_| flight.wander()).collect();
    assert!(all_told(&told));
    let raw_deg = rms_deg(told.iter().map(|told| told.raw_rad));
    let smooth_deg = rms_deg(told.iter().filter_map(|told| told.smooth).map(|(rad, _)| rad));
    let sigma_deg = rms_deg(told.iter().filter_map(|told| told.smooth).map(|(_, sigma_rad)| sigma_rad));
    assert!((raw_deg - 1.0).abs() < 0.1, "{raw_deg}");
    assert!(smooth_deg < 0.4 * raw_deg, "{smooth_deg}");
    assert!(sigma_deg > 0.7 * smooth_deg && sigma_deg < 1.5 * smooth_deg, "{sigma_deg} {smooth_deg}");
}

#[test]
fn what_lasts_is_not_smoothed_away() {
    let mut flight = Flight { noise_s: 8.0, ..Flight::new() };
    for _ in 0..6 {
        flight.wander();
    }
    let told: Vec<Told> = (0..40).flat_map(|_| flight.wander()).collect();
    let smooth_deg = rms_deg(told.iter().filter_map(|told| told.smooth).map(|(rad, _)| rad));
    let sigma_deg = rms_deg(told.iter().filter_map(|told| told.smooth).map(|(_, sigma_rad)| sigma_rad));
    assert!(smooth_deg > 0.6, "{smooth_deg}");
    assert!(sigma_deg > 0.4 * smooth_deg && sigma_deg < 1.2, "{sigma_deg} {smooth_deg}");
}

/// Gyro drift of 1 deg/s: the sigma grows with the mean innovation before the test fails.
#[test]
fn what_is_doubted_is_in_the_sigma() {
    let mut flight = Flight { noise_s: 0.001, ..Flight::new() };
    for _ in 0..4 {
        flight.wander();
    }
    flight.gyro = |rate_rad_s| rate_rad_s + DEG;
    let told = flight.fly(0.0, 6.0);
    assert!(told.iter().filter_map(|told| told.smooth).any(|(rad, _)| rad.abs() > 3.0 * DEG));
    for (rad, sigma_rad) in told.iter().filter_map(|told| told.smooth).filter(|(rad, _)| rad.abs() > 2.5 * DEG) {
        assert!(rad.abs() < 4.0 * sigma_rad, "{} {}", rad.to_degrees(), sigma_rad.to_degrees());
    }
    assert!(none_told(&told[told.len() - 40..]));
}

#[test]
fn the_coefficients_share_comes_on_top() {
    let sigma_deg = |coefficients_deg: f32| {
        let mut flight = Flight { coefficients_rad: coefficients_deg * DEG, ..Flight::new() };
        let told = (0..4).flat_map(|_| flight.wander()).last().unwrap();
        told.smooth.unwrap().1.to_degrees()
    };
    let (without, with) = (sigma_deg(0.0), sigma_deg(2.0));
    assert!((with - without.hypot(2.0)).abs() < 1e-3, "{with} {without}");
}

/// A gyro bias of 0.3 deg/s adds up to 90 deg in five minutes; uncompensated, the filter would lag by 4 deg.
#[test]
fn the_gyro_s_bias_is_found() {
    let mut flight = Flight { gyro: |rate_rad_s| rate_rad_s + 0.3 * DEG, ..Flight::new() };
    for _ in 0..10 {
        flight.wander();
    }
    let told: Vec<Told> = (0..4).flat_map(|_| flight.wander()).collect();
    assert!(all_told(&told));
    let mean_rad = told.iter().filter_map(|told| told.smooth).map(|(rad, _)| rad).sum::<f32>() / told.len() as f32;
    assert!(mean_rad.to_degrees().abs() < 0.15, "{}", mean_rad.to_degrees());
}

/// Reference: conventional Kalman filter in f64 at uneven steps, with its own parameters.
#[test]
fn the_filter_is_kalman_s() {
    let square = |x: f64| x * x;
    let deg = core::f64::consts::PI / 180.0;
    let mut random = Random(5);
    let mut turning = GyroHeading::default();
    let mut at_us = 0_u64;
    let mut state = SmootherState::new_at(Timestamp::from_us(0), 0.5, square(deg) as f32, &turning);
    let (mut psi, mut beta) = (0.5_f64, 0.0_f64);
    let mut p = [[square(deg), 0.0], [0.0, square(0.1 * deg)]];
    for i in 0..4000 {
        let step_us = u64::from(random.byte()) * 400 + 5_000;
        let dt = step_us as f64 * 1e-6;
        at_us += step_us;
        turning.euler_rates.heading_rad_s = random.uniform(-0.4, 0.4);
        let turned = turning.euler_rates.heading_rad_s * dt as f32;
        turning.relative_heading_rad = wrap_pi(turning.relative_heading_rad + turned);
        state.predict(Timestamp::from_us(at_us), &turning).unwrap();
        psi += f64::from(turned) - beta * dt;
        let rate = f64::from(turning.euler_rates.heading_rad_s);
        let [[a, b], [_, c]] = p;
        let b = b - dt * c;
        p = [[a - 2.0 * dt * p[0][1] + dt * dt * c, b], [b, c + square(0.002 * deg) * dt]];
        p[0][0] += square(0.2 * deg) * dt + square(0.03 * rate) * 0.1 * dt;
        // With occasional outliers.
        let off = if i % 50 == 0 { random.uniform(-0.5, 0.5) } else { random.uniform(-0.05, 0.05) };
        let v = f64::from(random.uniform(1e-4, 9e-4));
        let z = f64::from(off);
        state.update_measurement(off, v as f32, dt as f32);
        let far = (z * z / (9.0 * (p[0][0] + v))).max(1.0);
        let s = p[0][0] + far * v * 2.0 * 2.0 / dt;
        let k = [p[0][0] / s, p[0][1] / s];
        psi += k[0] * z;
        beta += k[1] * z;
        let [[a, b], [_, c]] = p;
        p = [[a - k[0] * a, b - k[0] * b], [b - k[0] * b, c - k[1] * b]];
        let u = f64::from(state.bias_regression_s);
        let found = [f64::from(state.variance()), u * f64::from(state.bias_variance), f64::from(state.bias_variance)];
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
fn a_day_leaves_nothing_behind() {
    let gyros: [Gyro; 2] = [|rate_rad_s| rate_rad_s + 0.05 * DEG, |rate_rad_s| rate_rad_s - 0.05 * DEG];
    let mut flight = Flight { step_us: 100_000, ..Flight::new() };
    for hour in 0..24 {
        flight.gyro = gyros[hour % 2];
        let mut squares = 0.0;
        let mut number = 0.0;
        for step in 0..36_000 {
            let rate_deg_s = if step % 600 < 200 { 12.0 } else { 0.0 };
            let told = flight.step(rate_deg_s);
            let state = flight.smoother.state.as_ref().unwrap();
            assert!(
                state.conditional_heading_variance > 0.0 && state.bias_variance > 0.0 && state.heading_rad.abs() <= PI
            );
            assert!(state.variance() < square(2.0 * DEG) && state.bias_variance < 1.1 * INITIAL_BIAS_VARIANCE);
            if step < 3_000 {
                continue; // Settling after the change of bias.
            }
            let (rad, sigma_rad) = told.smooth.unwrap();
            assert!(sigma_rad > 0.02 * DEG && sigma_rad < 3.1 * DEG, "{}", sigma_rad.to_degrees());
            squares += rad * rad;
            number += 1.0;
        }
        let rms_deg = (squares / number).sqrt().to_degrees();
        assert!(rms_deg < 0.4, "hour {hour}: {rms_deg}");
    }
}

/// A sigma of zero counts as 0.05 deg.
#[test]
fn no_raw_heading_is_exact() {
    let mut flight = Flight { sigma_rad: 0.0, noise_sigma_rad: 0.0, ..Flight::new() };
    for told in (0..4).flat_map(|_| flight.wander()).skip(400) {
        let (rad, sigma_rad) = told.smooth.unwrap();
        assert!(rad.abs() < 0.05 * DEG && sigma_rad > 0.0 && sigma_rad < 0.05 * DEG, "{rad} {sigma_rad}");
    }
}

/// The heading jumps by 90 deg without a turn; the filter restarts after 5 s.
#[test]
fn a_filter_that_was_lost_begins_anew() {
    let mut flight = Flight::new();
    for _ in 0..4 {
        flight.wander();
    }
    flight.heading_rad = wrap_pi(flight.heading_rad + PI / 2.0);
    assert!(none_told(&flight.fly(18.0, 6.0)[1..]));
    flight.fly(18.0, 16.0);
    let (rad, sigma_rad) = flight.step(18.0).smooth.unwrap();
    assert!(rad.abs() < 2.0 * DEG && sigma_rad < 0.55 * DEG, "{} {}", rad.to_degrees(), sigma_rad.to_degrees());
}

#[test]
fn nothing_is_told_before_it_has_settled() {
    let mut flight = Flight::new();
    // The filter starts with the first heading.
    assert!(none_told(&flight.fly(0.0, 2.0)));
    flight.step(0.0);
    assert!(all_told(&flight.fly(0.0, 1.0)));
}

#[test]
fn a_gap_is_bridged_by_the_gyro_for_three_seconds() {
    for (gap_s, goes_on) in [(2.9, true), (3.1, false)] {
        let mut flight = Flight::new();
        flight.wander();
        for _ in 0..(gap_s / STEP_S) as usize {
            let rate_rad_s = flight.pass(40.0);
            let at = Timestamp::from_us(flight.at_us);
            assert_eq!(
                flight.smoother.smooth_heading(at, None, Some(flight.turning(rate_rad_s))),
                None,
                "nothing to tell"
            );
        }
        let told = flight.step(40.0);
        assert_eq!(told.smooth.is_some(), goes_on, "{gap_s}");
        assert!(told.smooth.is_none_or(|(rad, _)| rad.abs() < DEG));
        let later = flight.fly(0.0, 2.2);
        assert!(all_told(if goes_on { &later } else { &later[later.len() - 10..] }));
    }
}

#[test]
fn without_a_gyro_or_with_another_run_of_it_nothing_is_told() {
    let mut flight = Flight::new();
    flight.wander();
    flight.pass(0.0);
    let at = Timestamp::from_us(flight.at_us);
    assert_eq!(flight.smoother.smooth_heading(at, Some(&flight.raw()), None), None);
    assert!(flight.step(0.0).smooth.is_some(), "it is back within three seconds");
    (flight.run, flight.turned_rad) = (2, -1.0);
    assert!(none_told(&flight.fly(0.0, 1.9)));
    assert!(all_told(&flight.fly(0.0, 2.0)[20..]));
}

#[test]
fn too_fast_a_turn_is_not_smoothed() {
    for (rate_deg_s, is_told) in [(355.0, true), (365.0, false), (-355.0, true), (-365.0, false)] {
        let mut flight = Flight::new();
        flight.wander();
        let told = flight.fly(rate_deg_s, 1.0);
        assert!(if is_told { all_told(&told) } else { none_told(&told[1..]) }, "{rate_deg_s}");
    }
}

#[test]
fn a_reset_forgets_everything() {
    let mut flight = Flight::new();
    flight.wander();
    flight.smoother.reset();
    assert!(none_told(&flight.fly(0.0, 2.0)));
}

#[test]
fn a_spike_of_the_raw_heading_changes_nothing() {
    let mut flight = Flight::new();
    flight.wander();
    let at = |flight: &Flight| Timestamp::from_us(flight.at_us);
    for spike_rad in [PI, 0.5, -0.5] {
        flight.fly(0.0, 3.0);
        let rate_rad_s = flight.pass(0.0);
        let raw = Heading { magnetic_rad: wrap_two_pi(flight.heading_rad + spike_rad), ..flight.raw() };
        let turning = flight.turning(rate_rad_s);
        let told = flight.smoother.smooth_heading(at(&flight), Some(&raw), Some(turning)).unwrap();
        assert!(wrap_pi(told.magnetic_rad - flight.heading_rad).abs() < DEG);
        assert!(all_told(&flight.fly(0.0, 1.0)), "{spike_rad}");
    }
}

/// Wrong body rates: the smoothed heading is withheld from the first turn on, before its error exceeds 4 sigma, and
/// remains so until a turn shows correct rates.
#[test]
fn a_gyro_that_is_wrong_shows_in_the_first_turn() {
    let wrong: [(&str, Gyro); 4] = [
        ("nearly nothing", |_| 1e-6),
        ("wrong sign", |rate_rad_s| -rate_rad_s),
        ("degrees for radians", |rate_rad_s| rate_rad_s * 57.3),
        ("radians for degrees", |rate_rad_s| rate_rad_s / 57.3),
    ];
    for (name, gyro) in wrong {
        let mut flight = Flight::new();
        flight.wander();
        flight.gyro = gyro;
        let mut turn = flight.fly(0.0, 4.0);
        for rate in 0..80 {
            turn.push(flight.step(18.0 * rate as f32 / 80.0));
        }
        turn.extend(flight.fly(18.0, 8.0));
        let worst_rad = turn.iter().filter_map(|told| told.smooth).map(|(rad, _)| rad.abs()).fold(0.0, f32::max);
        assert!(worst_rad.to_degrees() < 5.5, "{name}: {}", worst_rad.to_degrees());
        assert!(none_told(&turn[turn.len() - 300..]), "{name}");
        assert!(none_told(&flight.fly(0.0, 20.0)), "{name}: nothing has shown that it is right");
        flight.gyro = |rate_rad_s| rate_rad_s;
        flight.fly(18.0, 8.0);
        assert!(all_told(&flight.fly(0.0, 2.0)), "{name}");
    }
}

#[test]
fn more_noise_than_told_is_no_contradiction() {
    let mut flight = Flight { noise_s: 0.001, ..Flight::new() };
    flight.wander();
    flight.noise_sigma_rad = 5.0 * DEG;
    flight.wander();
    let told = flight.wander();
    let number = told.iter().filter(|told| told.smooth.is_some()).count();
    assert!(number > told.len() * 9 / 10, "{number} of {}", told.len());
    assert!(rms_deg(told.iter().filter_map(|told| told.smooth).map(|(rad, _)| rad)) < 1.0);
}

#[test]
fn what_is_not_a_number_is_forgotten() {
    let bad = [f32::NAN, f32::INFINITY, f32::MAX, 0.0];
    for (what, spoil) in [
        ("heading", (|raw, _, bad| raw.magnetic_rad = bad) as fn(&mut Heading, &mut GyroHeading, f32)),
        ("sigma", |raw, _, bad| raw.sigma_rad = bad),
        ("coefficients", |raw, _, bad| raw.systematic_variance_rad2 = bad),
        ("turned", |_, turning, bad| turning.relative_heading_rad = bad),
        ("rate", |_, turning, bad| turning.euler_rates.heading_rad_s = bad),
    ] {
        for bad in bad {
            let mut flight = Flight::new();
            flight.wander();
            for _ in 0..3 {
                let rate_rad_s = flight.pass(0.0);
                let (mut raw, mut turning) = (flight.raw(), flight.turning(rate_rad_s));
                spoil(&mut raw, &mut turning, bad);
                flight.smoother.smooth_heading(Timestamp::from_us(flight.at_us), Some(&raw), Some(turning));
            }
            flight.wander();
            flight.wander();
            let told = flight.wander();
            assert!(all_told(&told), "{what} {bad}");
            assert!(rms_deg(told.iter().filter_map(|told| told.smooth).map(|(rad, _)| rad)) < 1.0, "{what} {bad}");
        }
    }
}

mod agreement {
    use super::super::agreement::{AgreementResult, AgreementTest};
    use super::{DEG, GyroStep, STEP_S, TAU};

    const VARIANCE: f32 = 1.0;

    fn step(turned_deg: f32) -> GyroStep {
        GyroStep { step_s: STEP_S, turned_rad: turned_deg * DEG }
    }

    fn settled() -> AgreementTest {
        let mut agreement = AgreementTest::NEW;
        see(&mut agreement, 0.0, 10.0);
        agreement
    }

    /// Repeats an innovation in sigmas; whether all results were in agreement.
    fn see(agreement: &mut AgreementTest, off: f32, seconds: f32) -> bool {
        (0..(seconds / STEP_S) as usize).fold(true, |all, _| {
            agreement.test_innovation(off, VARIANCE, step(0.0)) == AgreementResult::InAgreement && all
        })
    }

    /// At 3.9 sigma detected within about a second.
    #[test]
    fn a_mean_of_more_than_three_sigmas_contradicts() {
        for sign in [1.0, -1.0] {
            assert!(see(&mut settled(), sign * 2.9, 60.0));
            assert!(!see(&mut settled(), sign * 3.1, 60.0));
            let mut quick = settled();
            assert!(see(&mut quick, sign * 3.9, 1.2) && !see(&mut quick, sign * 3.9, 0.5));
        }
    }

    #[test]
    fn sigmas_are_those_of_the_variance() {
        let contradicts = |off: f32, variance: f32| {
            let mut agreement = settled();
            (0..2000).any(|_| agreement.test_innovation(off, variance, step(0.0)) != AgreementResult::InAgreement)
        };
        assert!(!contradicts(5.8, 4.0) && contradicts(6.2, 4.0));
        assert!(!contradicts(0.29, 0.01) && contradicts(0.31, 0.01));
    }

    /// Two consecutive beyond 4 sigma, on the same side.
    #[test]
    fn two_large_differences_in_a_row_contradict() {
        let all = |offs: &[f32]| {
            let mut agreement = settled();
            offs.iter().all(|&off| agreement.test_innovation(off, VARIANCE, step(0.0)) == AgreementResult::InAgreement)
        };
        assert!(all(&[3.9, 3.9, 3.9]) && all(&[-3.9, -3.9]));
        assert!(!all(&[4.1, 4.1]) && !all(&[-4.1, -4.1]));
        assert!(all(&[4.1, -4.1, 4.1]) && all(&[4.1, 0.0, 4.1, 0.0, -4.1]) && all(&[50.0, 0.0, 0.0]));
    }

    /// Excess variance: `2.9^2 - 1`, and none below 1 sigma.
    #[test]
    fn a_mean_beyond_a_sigma_is_doubted() {
        for (off, doubt) in [(0.9, 0.0), (-0.9, 0.0), (2.9, 7.41), (-2.9, 7.41)] {
            let mut agreement = settled();
            see(&mut agreement, off, 20.0);
            assert!(
                (agreement.excess_variance_rad2() - doubt).abs() < 0.01,
                "{off}: {}",
                agreement.excess_variance_rad2()
            );
        }
    }

    /// Two seconds of agreement and 45 deg of turn.
    #[test]
    fn after_a_contradiction_it_has_to_be_shown_in_a_turn() {
        for (turned_deg, sign, agreed) in [(44.0, 1.0, false), (46.0, 1.0, true), (46.0, -1.0, true)] {
            let mut agreement = settled();
            for _ in 0..2 {
                agreement.test_innovation(5.0, VARIANCE, step(20.0));
            }
            let steps = (4.0 / STEP_S) as usize;
            let mut last = AgreementResult::NotInAgreement;
            for i in 0..steps {
                last = agreement.test_innovation(0.0, VARIANCE, step(sign * turned_deg / steps as f32));
                assert!(i as f32 * STEP_S > 1.9 || last == AgreementResult::NotInAgreement);
            }
            assert_eq!(last == AgreementResult::InAgreement, agreed, "{turned_deg}");
            // The requirement survives a restart.
            agreement.restart();
            assert_eq!(!see(&mut agreement, 0.0, 2.1) && see(&mut agreement, 0.0, 1.0), agreed);
        }
    }

    #[test]
    fn what_contradicts_for_long_is_lost() {
        let mut agreement = settled();
        let lost = (0..1000)
            .position(|_| agreement.test_innovation(TAU, VARIANCE, step(0.0)) == AgreementResult::Lost)
            .unwrap();
        assert!((lost as f32 * STEP_S - 5.0).abs() < 0.05, "{lost}");
        // An interruption restarts the time.
        let mut agreement = settled();
        for _ in 0..10 {
            for _ in 0..200 {
                assert_ne!(agreement.test_innovation(5.0, VARIANCE, step(0.0)), AgreementResult::Lost);
            }
            for _ in 0..2000 {
                agreement.test_innovation(0.0, VARIANCE, step(0.1));
            }
        }
    }
}

mod lasting {
    use super::super::residual_noise::ResidualNoise;
    use super::{Random, STEP_S};

    /// Mean fraction estimated from 30 runs of correlated noise.
    fn share(noise_s: f32) -> f32 {
        let mut random = Random(3);
        let kept = (-STEP_S / noise_s).exp();
        let mut sum = 0.0;
        for _ in 0..30 {
            let (mut lasting, mut noise) = (ResidualNoise::NEW, 2.0 * random.normal());
            for _ in 0..(240.0 / STEP_S) as usize {
                noise = kept * noise + 2.0 * (1.0 - kept * kept).sqrt() * random.normal();
                lasting.update(noise, 4.0, STEP_S);
            }
            sum += lasting.remaining_fraction();
        }
        sum / 30.0
    }

    /// Expected: `1.5 tau / (tau + 5 s)`.
    #[test]
    fn the_share_is_that_of_a_mean_over_five_seconds() {
        for (noise_s, expected, within) in [(0.01, 0.003, 0.02), (0.5, 0.136, 0.03), (2.0, 0.43, 0.06)] {
            let found = share(noise_s);
            assert!((found - expected).abs() < within, "{noise_s}: {found}");
        }
        assert!(share(30.0) > 0.5, "{}", share(30.0));
    }

    /// The fraction is limited to 1; half a sigma gives `1.5 * 0.25`.
    #[test]
    fn a_share_is_never_more_than_the_whole() {
        for (off, expected) in [(1.0, 1.0), (2.0, 1.0), (-1.0, 1.0), (0.5, 0.375)] {
            let mut lasting = ResidualNoise::NEW;
            assert!((lasting.remaining_fraction() - 0.225).abs() < 1e-6);
            for _ in 0..(1200.0 / STEP_S) as usize {
                lasting.update(off, 1.0, STEP_S);
            }
            assert!((lasting.remaining_fraction() - expected).abs() < 0.01, "{off}: {}", lasting.remaining_fraction());
        }
    }

    /// Averaging time grows from 10 s to two minutes.
    #[test]
    fn a_share_is_learnt_quickly_and_forgotten_slowly() {
        let mut lasting = ResidualNoise::NEW;
        let quiet = |lasting: &mut ResidualNoise, seconds: f32| {
            for _ in 0..(seconds / STEP_S) as usize {
                lasting.update(0.0, 1.0, STEP_S);
            }
        };
        quiet(&mut lasting, 10.0);
        assert!((lasting.remaining_fraction() - 0.1125).abs() < 0.004, "{}", lasting.remaining_fraction());
        for _ in 0..(2000.0 / STEP_S) as usize {
            lasting.update(1.0, 1.0, STEP_S);
        }
        lasting.restart();
        quiet(&mut lasting, 120.0);
        assert!(
            (lasting.remaining_fraction() - 1.5 * (-1.0_f32).exp()).abs() < 0.01,
            "{}",
            lasting.remaining_fraction()
        );
    }
}
