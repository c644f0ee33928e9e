//! Smoothed heading: the monitor's, which the gyro carries from reading to reading, while it agrees with the raw one.
//!
//! Agreement: the exponential mean of the raw less the smoothed heading over two seconds is within 3 sigma. A wrong gyro
//! shows in the first turn. A fast failure is detected earlier, by two consecutive differences beyond 4 sigma on the same
//! side; if the raw heading is noisier than its sigma, the scatter of the differences replaces the sigma. A single outlier
//! is ignored.

use core::f32::consts::PI;

use super::monitor::MAX_SAMPLE_GAP_S;
use crate::attitude::GyroHeading;
use crate::frames::wrap_pi;
use crate::heading::Heading;
use crate::time::Timestamp;
use crate::trig::{DEG, sqrt, square};

/// Lower limit of a raw heading's variance, rad^2: a sigma of 0.05 deg.
const MIN_RAW_VARIANCE_RAD2: f32 = square(0.05 * DEG);

/// Share of the variance of the gyro heading's offset that is an error of the smoothed heading: the monitor's noise is that of an
/// attitude whose errors last for seconds. With all of it the sigma of clean flights is 1.5 times their RMS error, with a tenth 0.8 times.
const OFFSET_VARIANCE_SHARE: f32 = 0.4;

/// Time constant of the means, seconds; equals the mean age in a 2 s window.
const MEAN_TIME_CONSTANT_S: f32 = 1.0;

/// Variance of the mean difference relative to that of a single one: the attitude's errors last for half a second. With 1, a
/// gyro's offset that grows by 2 deg/s in a minute has 78 % of the errors within two sigmas, not 80.
const MEAN_VARIANCE_SHARE: f32 = 0.5;

/// Gate of the mean difference, sigmas of a single one.
const MEAN_GATE_SIGMAS: f32 = 3.0;

/// Gate of a single difference, sigmas.
const SINGLE_GATE_SIGMAS: f32 = 4.0;

/// Required duration of agreement, seconds.
const REQUIRED_AGREEMENT_S: f32 = 2.0;

/// Required turn after a disagreement, to either side, radians: a wrong gyro is unobservable in straight flight.
const REQUIRED_TURN_RAD: f32 = 45.0 * DEG;

/// Agreement of the raw heading with the monitor's.
#[derive(Clone, Debug)]
pub(super) struct HeadingSmoother {
    /// Time and gyro heading of the last reading with a heading.
    last_reading: Option<(Timestamp, GyroHeading)>,
    mean_difference_rad: f32,
    last_difference_rad: f32,
    /// Scatter: half the mean squared difference of consecutive differences.
    scatter_rad2: f32,
    last_exceeded_side: Option<bool>,
    agreement_s: f32,
    /// Turn still required before agreement, radians.
    required_turn_rad: f32,
    excess_variance_rad2: f32,
}

impl HeadingSmoother {
    pub const fn new() -> Self {
        Self {
            last_reading: None,
            mean_difference_rad: 0.0,
            last_difference_rad: 0.0,
            scatter_rad2: 0.0,
            last_exceeded_side: None,
            agreement_s: 0.0,
            required_turn_rad: 0.0,
            excess_variance_rad2: 0.0,
        }
    }

    /// Excess of the squared mean difference over its variance, rad^2: an error of the raw heading or of the smoothed one.
    pub const fn disagreement_variance_rad2(&self) -> f32 {
        self.excess_variance_rad2
    }

    /// Processes a raw heading, the gyro's, and the monitor's at the same instant; returns the smoothed heading while it is trusted.
    #[inline(never)]
    pub fn smooth_heading(
        &mut self,
        at: Timestamp,
        raw: Option<&Heading>,
        gyro_heading: Option<&GyroHeading>,
        monitored: Option<Heading>,
    ) -> Option<Heading> {
        let (raw, gyro_heading) = raw.zip(gyro_heading)?;
        let last = self.last_reading.replace((at, *gyro_heading));
        let noise_rad2 = (square(raw.sigma_rad) - raw.systematic_variance_rad2).max(MIN_RAW_VARIANCE_RAD2);
        let difference_rad = monitored.map(|monitored| wrap_pi(raw.magnetic_rad - monitored.magnetic_rad));
        let continued = last
            .map(|(last_at, last)| (at.us_since(last_at) as f32 * 1e-6, last))
            .filter(|(step_s, last)| last.run_number == gyro_heading.run_number && *step_s <= MAX_SAMPLE_GAP_S);
        let (Some((step_s, last)), Some(monitored), Some(difference_rad)) =
            (continued, monitored, difference_rad.filter(|difference_rad| difference_rad.abs() <= PI))
        else {
            let required_turn_rad = self.required_turn_rad;
            *self = Self { last_reading: self.last_reading, required_turn_rad, ..Self::new() };
            return None;
        };
        let monitored_rad2 = square(monitored.sigma_rad).min(noise_rad2);
        let turned_rad = wrap_pi(gyro_heading.relative_heading_rad - last.relative_heading_rad);
        if !self.agrees(difference_rad, noise_rad2 + monitored_rad2, step_s, turned_rad) {
            return None;
        }
        Some(Heading {
            magnetic_rad: monitored.magnetic_rad,
            sigma_rad: sqrt(
                OFFSET_VARIANCE_SHARE * monitored_rad2 + self.excess_variance_rad2 + raw.systematic_variance_rad2,
            ),
            systematic_variance_rad2: raw.systematic_variance_rad2,
        })
    }

    /// Tests a difference of this variance, `step_s` after the last one.
    fn agrees(&mut self, difference_rad: f32, variance_rad2: f32, step_s: f32, turned_rad: f32) -> bool {
        let weight = step_s / (MEAN_TIME_CONSTANT_S + step_s);
        self.mean_difference_rad += weight * (difference_rad - self.mean_difference_rad);
        self.excess_variance_rad2 = (square(self.mean_difference_rad) - MEAN_VARIANCE_SHARE * variance_rad2).max(0.0);
        let limit_rad2 = square(SINGLE_GATE_SIGMAS) * variance_rad2.max(self.scatter_rad2);
        self.scatter_rad2 += weight * (0.5 * square(difference_rad - self.last_difference_rad) - self.scatter_rad2);
        self.last_difference_rad = difference_rad;
        let exceeded_side = (square(difference_rad) > limit_rad2).then_some(difference_rad.is_sign_negative());
        let is_fast_failure = exceeded_side.is_some() && exceeded_side == self.last_exceeded_side;
        self.last_exceeded_side = exceeded_side;
        if is_fast_failure || square(self.mean_difference_rad) > square(MEAN_GATE_SIGMAS) * variance_rad2 {
            (self.agreement_s, self.required_turn_rad) = (0.0, REQUIRED_TURN_RAD);
            return false;
        }
        self.agreement_s = (self.agreement_s + step_s).min(REQUIRED_AGREEMENT_S);
        self.required_turn_rad = (self.required_turn_rad - turned_rad.abs()).max(0.0);
        self.agreement_s >= REQUIRED_AGREEMENT_S && self.required_turn_rad <= 0.0
    }
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::*;
    use crate::attitude::EulerRates;
    use crate::frames::wrap_two_pi;

    /// Interval of readings at 80 Hz.
    const STEP_US: u64 = 12_500;
    const STEP_S: f32 = 0.0125;

    type GyroModel = fn(f32) -> f32;

    /// A flight whose monitor knows the offset of the gyro's heading to 0.3 deg, and does not change it.
    struct Flight {
        smoother: HeadingSmoother,
        random: Random,
        at_us: u64,
        heading_rad: f32,
        gyro: GyroModel,
        gyro_heading: GyroHeading,
        gyro_heading_offset_rad: f32,
        raw_sigma_rad: f32,
        /// Error of the raw heading that stays.
        raw_error_rad: f32,
    }

    impl Flight {
        /// An ideal gyro, and raw headings with 1 deg of noise.
        fn new() -> Self {
            Self {
                smoother: HeadingSmoother::new(),
                random: Random(1),
                at_us: 1_000_000,
                heading_rad: 1.0,
                gyro: |rate_rad_s| rate_rad_s,
                gyro_heading: GyroHeading::default(),
                gyro_heading_offset_rad: 1.0,
                raw_sigma_rad: DEG,
                raw_error_rad: 0.0,
            }
        }

        /// A flight after three seconds of agreement.
        fn settled() -> Self {
            let mut flight = Self::new();
            flight.fly_seconds(0.0, 3.0);
            flight
        }

        fn monitored_heading(&self) -> Heading {
            let magnetic_rad = wrap_two_pi(self.gyro_heading.relative_heading_rad + self.gyro_heading_offset_rad);
            Heading { magnetic_rad, sigma_rad: 0.3 * DEG, systematic_variance_rad2: 0.0 }
        }

        /// The smoothed heading of the next reading, with these changes of the inputs; its error and sigma, radians.
        fn smooth_changed(
            &mut self,
            rate_deg_s: f32,
            change: impl Fn(&mut Heading, &mut Heading, &mut GyroHeading),
        ) -> Option<(f32, f32)> {
            let rate_rad_s = rate_deg_s * DEG;
            self.at_us += STEP_US;
            self.heading_rad = wrap_pi(self.heading_rad + rate_rad_s * STEP_S);
            let measured_rad_s = (self.gyro)(rate_rad_s);
            let turned_rad = self.gyro_heading.relative_heading_rad + measured_rad_s * STEP_S;
            self.gyro_heading.relative_heading_rad = wrap_pi(turned_rad);
            self.gyro_heading.euler_rates = EulerRates { heading_rad_s: measured_rad_s, ..EulerRates::default() };
            let noise_rad = self.raw_sigma_rad * self.random.normal();
            let mut raw = Heading {
                magnetic_rad: wrap_two_pi(self.heading_rad + self.raw_error_rad + noise_rad),
                sigma_rad: DEG,
                systematic_variance_rad2: square(0.2 * DEG),
            };
            let (mut monitored, mut gyro_heading) = (self.monitored_heading(), self.gyro_heading);
            change(&mut raw, &mut monitored, &mut gyro_heading);
            let at = Timestamp::from_us(self.at_us);
            let smoothed = self.smoother.smooth_heading(at, Some(&raw), Some(&gyro_heading), Some(monitored))?;
            Some((wrap_pi(smoothed.magnetic_rad - self.heading_rad), smoothed.sigma_rad))
        }

        fn fly_seconds(&mut self, rate_deg_s: f32, seconds: f32) -> Vec<Option<(f32, f32)>> {
            (0..(seconds / STEP_S) as usize).map(|_| self.smooth_changed(rate_deg_s, |_, _, _| {})).collect()
        }
    }

    fn worst_deg(smoothed: &[Option<(f32, f32)>]) -> f32 {
        smoothed.iter().flatten().map(|(error_rad, _)| error_rad.abs() / DEG).fold(0.0, f32::max)
    }

    /// The smoothed heading is the monitor's. A difference of 2.5 deg, whose variance is half of 0.96 + 0.09 deg^2, is in its sigma.
    #[test]
    fn a_difference_beyond_its_noise_is_in_the_sigma() {
        let mut flight = Flight::settled();
        for (raw_error_deg, excess_deg2) in [(0.0_f32, 0.0), (2.5, 2.5 * 2.5 - 0.525)] {
            (flight.raw_error_rad, flight.raw_sigma_rad) = (raw_error_deg * DEG, 0.1 * DEG);
            let output = flight.fly_seconds(0.0, 10.0);
            assert!(output.iter().all(Option::is_some) && worst_deg(&output) < 1e-3, "{}", worst_deg(&output));
            let (_, sigma_rad) = output.last().unwrap().unwrap();
            let expected_deg = (0.4_f32 * 0.3 * 0.3 + 0.2 * 0.2 + excess_deg2).sqrt();
            assert!((sigma_rad / DEG - expected_deg).abs() < 0.05, "{} {expected_deg}", sigma_rad / DEG);
        }
    }

    /// Wrong body rates: the smoothed heading is withheld from the first turn on, before its error exceeds 5 deg, and remains so until a
    /// turn shows correct rates.
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
            for rate in 0..80_u8 {
                turn.extend(flight.fly_seconds(18.0 * f32::from(rate) / 80.0, STEP_S));
            }
            turn.extend(flight.fly_seconds(18.0, 8.0));
            assert!(worst_deg(&turn) < 5.0, "{name}: {}", worst_deg(&turn));
            assert!(turn[turn.len() - 300..].iter().all(Option::is_none), "{name}");
            // The monitor estimates the offset of the gyro's heading again.
            flight.gyro_heading_offset_rad = flight.heading_rad - flight.gyro_heading.relative_heading_rad;
            let straight = flight.fly_seconds(0.0, 20.0);
            assert!(straight.iter().all(Option::is_none), "{name}: correct rates show in a turn only");
            flight.gyro = |rate_rad_s| rate_rad_s;
            flight.fly_seconds(18.0, 8.0);
            assert!(flight.fly_seconds(0.0, 2.0).iter().all(Option::is_some), "{name}");
        }
    }

    /// After a gap, a new run of the gyro, and a missing heading of the monitor the agreement takes two seconds.
    #[test]
    fn two_seconds_of_agreement_are_required() {
        for (gap_s, run_number, is_continued) in [(2.9, 0, true), (3.1, 0, false), (0.0, 1, false)] {
            let mut flight = Flight::settled();
            flight.at_us += (gap_s * 1e6) as u64;
            flight.gyro_heading.run_number = run_number;
            let later = flight.fly_seconds(0.0, 2.2);
            assert_eq!(later[0].is_some(), is_continued, "{gap_s} {run_number}");
            assert!(later[later.len() - 5..].iter().all(Option::is_some), "{gap_s} {run_number}");
        }
    }

    #[test]
    fn noise_above_the_reported_sigma_is_no_contradiction() {
        let mut flight = Flight { raw_sigma_rad: 5.0 * DEG, ..Flight::settled() };
        flight.fly_seconds(18.0, 10.0);
        let output = flight.fly_seconds(-18.0, 20.0);
        assert!(output.iter().flatten().count() > output.len() * 9 / 10);
        assert!(worst_deg(&output) < 3.0, "{}", worst_deg(&output));
    }

    #[test]
    fn non_finite_input_is_discarded() {
        for (input_name, corrupt) in [
            ("raw", (|raw, _, _, bad| raw.magnetic_rad = bad) as fn(&mut Heading, &mut Heading, &mut GyroHeading, f32)),
            ("sigma", |raw, _, _, bad| raw.sigma_rad = bad),
            ("systematic", |raw, _, _, bad| raw.systematic_variance_rad2 = bad),
            ("monitored", |_, monitored, _, bad| monitored.magnetic_rad = bad),
            ("monitored sigma", |_, monitored, _, bad| monitored.sigma_rad = bad),
            ("gyro", |_, _, gyro_heading, bad| gyro_heading.relative_heading_rad = bad),
        ] {
            for bad in [f32::NAN, f32::INFINITY, f32::MAX, 0.0] {
                let mut flight = Flight::settled();
                for _ in 0..3 {
                    flight
                        .smooth_changed(0.0, |raw, monitored, gyro_heading| corrupt(raw, monitored, gyro_heading, bad));
                }
                flight.fly_seconds(18.0, 10.0);
                let output = flight.fly_seconds(-18.0, 5.0);
                assert!(output.iter().all(Option::is_some) && worst_deg(&output) < 1.0, "{input_name} {bad}");
            }
        }
    }
}
