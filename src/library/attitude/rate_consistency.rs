//! Consistency test between body rates and attitude.
//!
//! Rates in a wrong unit or with a wrong sign would corrupt the gyro-smoothed heading. The changes of roll and pitch
//! over one second, integrated from the rates, must agree with those of the attitude, within its noise, latency and
//! bank-angle scale error.

use crate::attitude::euler_rates::EulerRates;
use crate::attitude::report::AttitudeReport;
use crate::frames::{RollPitch, wrap_pi};
use crate::time::Timestamp;

/// Integration interval, microseconds; longer than the attitude latency.
const INTEGRATION_US: u64 = 1_000_000;

/// Smallest consistent ratio of attitude change to integrated rates; a source with a bank scale of a third passes.
const MIN_ATTITUDE_RATIO: f32 = 0.15;

/// Evidence threshold, square radians, (5 deg)^2. The evidence is clamped to it, so that a long consistent history does
/// not delay detection.
const EVIDENCE_THRESHOLD_RAD2: f32 = 0.0076;

/// Ratio of integrated rates to attitude change below which the rates are too slow: about half of the
/// ratio of rates to a bank that a source reports three times too large.
const MIN_RATE_RATIO: f32 = 0.15;

/// Attitude change that exceeds noise, square radians, (7 deg)^2; also the clamp of the rate-magnitude evidence.
const MIN_ATTITUDE_CHANGE_RAD2: f32 = 0.015;

/// Forgetting factor per second (20 s): keeps a gyro offset of 2 deg/s at rest below the threshold.
const FORGETTING_FACTOR: f32 = 0.95;

/// Immediate detection: integrated rates of more than (12 deg)^2, square radians, with an attitude change of less than
/// 15 % (squared here).
const LARGE_GYRO_CHANGE_RAD2: f32 = 0.044;
const MAX_ATTITUDE_RATIO_SQUARED: f32 = 0.022_5;

/// Longest interval between reports that is integrated, microseconds.
const MAX_STEP_US: u64 = 250_000;

/// Leaky evidence that rates and attitude agree or contradict.
#[derive(Clone, Copy, Debug)]
pub(super) struct RateConsistency {
    last_report: Option<(Timestamp, RollPitch, EulerRates)>,
    /// Duration and changes of roll and pitch, by rates and by attitude, in the current integration interval.
    elapsed_us: u64,
    gyro_change_rad: [f32; 2],
    attitude_change_rad: [f32; 2],
    /// Evidence of agreement, square radians, clamped on both sides.
    agreement_rad2: f32,
    /// Evidence that the rates are fast enough, square radians of attitude.
    sufficient_rate_evidence_rad2: f32,
    is_contradicted: bool,
}

impl RateConsistency {
    pub const EMPTY: Self = Self {
        last_report: None,
        elapsed_us: 0,
        gyro_change_rad: [0.0; 2],
        attitude_change_rad: [0.0; 2],
        agreement_rad2: 0.0,
        sufficient_rate_evidence_rad2: 0.0,
        is_contradicted: false,
    };

    pub const fn is_contradicted(&self) -> bool {
        self.is_contradicted
    }

    /// Processes a report; returns whether the rates contradict the attitude.
    pub fn process_report(&mut self, at: Timestamp, report: &AttitudeReport) -> bool {
        let Some(euler_rates) = EulerRates::from_report(report) else { return false };
        let attitude = report.attitude;
        if let Some((last_at, last_attitude, last_rates)) = self.last_report.replace((at, attitude, euler_rates)) {
            let step_us = at.us_since(last_at);
            if step_us <= MAX_STEP_US {
                let step_s = step_us as f32 * 1e-6;
                let mean = last_rates.interpolate(&euler_rates, 0.5);
                let per_attitude =
                    [wrap_pi(attitude.roll_rad - last_attitude.roll_rad), attitude.pitch_rad - last_attitude.pitch_rad];
                for (i, rate_rad_s) in [mean.roll_rad_s, mean.pitch_rad_s].into_iter().enumerate() {
                    self.gyro_change_rad[i] += rate_rad_s * step_s;
                    self.attitude_change_rad[i] += per_attitude[i];
                }
                self.elapsed_us += step_us;
            }
        }
        let [by_gyro, by_attitude] = [self.gyro_change_rad, self.attitude_change_rad].map(norm_squared);
        if self.elapsed_us >= INTEGRATION_US {
            self.update_evidence();
        }
        if by_gyro > LARGE_GYRO_CHANGE_RAD2 && by_attitude < MAX_ATTITUDE_RATIO_SQUARED * by_gyro {
            self.agreement_rad2 = -EVIDENCE_THRESHOLD_RAD2;
        }
        if self.agreement_rad2.abs() >= EVIDENCE_THRESHOLD_RAD2 {
            self.is_contradicted = self.agreement_rad2 < 0.0;
        }
        self.is_contradicted
    }

    /// Updates the evidence at the end of an integration interval.
    fn update_evidence(&mut self) {
        let (gyro, attitude) = (self.gyro_change_rad, self.attitude_change_rad);
        let (gyro_change_rad2, attitude_change_rad2) = (norm_squared(gyro), norm_squared(attitude));
        let product = gyro[0] * attitude[0] + gyro[1] * attitude[1];
        (self.elapsed_us, self.gyro_change_rad, self.attitude_change_rad) = (0, [0.0; 2], [0.0; 2]);
        self.agreement_rad2 =
            finite_or_zero(FORGETTING_FACTOR * self.agreement_rad2 + product - MIN_ATTITUDE_RATIO * gyro_change_rad2)
                .clamp(-EVIDENCE_THRESHOLD_RAD2, EVIDENCE_THRESHOLD_RAD2);
        if self.are_rates_too_small(gyro_change_rad2, attitude_change_rad2) {
            self.agreement_rad2 = -EVIDENCE_THRESHOLD_RAD2;
        }
    }

    /// Whether the body rates are too small for the attitude's changes. Adds the squared changes of one interval,
    /// rad^2, to the evidence.
    fn are_rates_too_small(&mut self, gyro_change_rad2: f32, attitude_change_rad2: f32) -> bool {
        let rate_excess = gyro_change_rad2 / (MIN_RATE_RATIO * MIN_RATE_RATIO) - attitude_change_rad2;
        self.sufficient_rate_evidence_rad2 =
            finite_or_zero(FORGETTING_FACTOR * self.sufficient_rate_evidence_rad2 + rate_excess)
                .min(MIN_ATTITUDE_CHANGE_RAD2);
        self.sufficient_rate_evidence_rad2 < -MIN_ATTITUDE_CHANGE_RAD2
    }
}

/// Replaces NaN and infinity, which would persist in the evidence.
fn finite_or_zero(sum: f32) -> f32 {
    if sum.is_finite() { sum } else { 0.0 }
}

fn norm_squared([roll, pitch]: [f32; 2]) -> f32 {
    roll * roll + pitch * pitch
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::super::testing::{heading_and_roll_in_turns_deg, report, report_time};
    use super::*;

    /// Seconds until a contradiction is reported, of 100 s of turns at 50 Hz, with 0.3 deg of noise, a scale error and
    /// a latency of the attitude, and a scale of the rates.
    fn seconds_to_contradiction(roll_scale: f32, attitude_latency_s: f32, rate_scale: f32) -> Option<u32> {
        let mut random = Random(1);
        let mut check = RateConsistency::EMPTY;
        let roll_rad = |t_s: f32| heading_and_roll_in_turns_deg(t_s)[1].to_radians();
        (1..=5000).find_map(|i: u16| {
            let t_s = f32::from(i) * 0.02;
            let attitude = RollPitch {
                roll_rad: roll_scale * roll_rad(t_s - attitude_latency_s) + 0.005 * random.normal(),
                pitch_rad: 0.005 * random.normal(),
            };
            let p = (roll_rad(t_s - attitude_latency_s + 0.01) - roll_rad(t_s - attitude_latency_s - 0.01)) / 0.02;
            let rates_rad_s = [rate_scale * p, 0.0, rate_scale * 0.01];
            check.process_report(report_time(i), &report(attitude, rates_rad_s)).then(|| u32::from(i) / 50)
        })
    }

    /// Accepted: scale errors and latency of the attitude, rates wrong by up to a factor of two.
    #[test]
    fn consistent_rates_are_accepted() {
        for (roll_scale, attitude_latency_s, rate_scale) in [
            (1.0, 0.0, 1.0),
            (0.7, 0.0, 1.0),
            (0.3, 0.0, 1.0),
            (1.0, 0.5, 1.0),
            (1.2, 0.1, 1.0),
            (1.0, 0.0, 0.5),
            (1.0, 0.0, 2.0),
        ] {
            let found = seconds_to_contradiction(roll_scale, attitude_latency_s, rate_scale);
            assert_eq!(found, None, "{roll_scale} {attitude_latency_s} {rate_scale}");
        }
    }

    /// Feeds a triangular roll with these rates and this attitude amplitude per second.
    fn feed_triangular_roll(
        rate_consistency: &mut RateConsistency,
        from_s: u32,
        seconds: u32,
        gyro_rad_per_s: f32,
        attitude_rad_per_s: f32,
    ) -> bool {
        let mut is_contradicted = false;
        for i in 10 * from_s..=10 * (from_s + seconds) {
            // Alternates between up and down every second.
            let up = (i / 10) % 2 == 0;
            let part = f32::from((i % 10) as u8) / 10.0;
            let roll_rad = attitude_rad_per_s * if up { part } else { 1.0 - part };
            let rate = gyro_rad_per_s * if up { 1.0 } else { -1.0 };
            let report = report(RollPitch { roll_rad, pitch_rad: 0.0 }, [rate, 0.0, 1e-6]);
            is_contradicted = rate_consistency.process_report(Timestamp::from_us(u64::from(i) * 100_000), &report);
        }
        is_contradicted
    }

    #[test]
    fn rates_that_become_wrong_are_detected_in_time() {
        for (per_gyro, per_attitude, seconds) in [(0.04, -0.04, 12), (0.001, 0.05, 16), (0.3, 0.01, 2), (0.001, 0.2, 2)]
        {
            let mut check = RateConsistency::EMPTY;
            assert!(!feed_triangular_roll(&mut check, 0, 60, 0.3, 0.3));
            assert!(feed_triangular_roll(&mut check, 61, seconds, per_gyro, per_attitude), "{per_gyro} {per_attitude}");
        }
    }
}
