//! Latency of an autopilot's attitude, measured by the module's own gyro.
//!
//! The vertical stays in the gyro's frame (`gyro_frame`) if a reported attitude is that of its instant. Of the candidate times, the one
//! with which it moves least is the latency. A reported attitude is advanced by the rotation since.

use core::array;

use nalgebra::Vector3;

use super::gyro_frame::{GyroFrame, REMEMBERED_STEP_US};
use crate::frames::RollPitch;
use crate::inertial::roll_and_pitch_of_down;
use crate::time::Timestamp;
use crate::trig::DEG;

/// Interval of the candidate latencies, microseconds: at a roll of 30 deg/s 1.5 deg.
const CANDIDATE_STEP_US: u64 = REMEMBERED_STEP_US;

/// Number of candidates: up to 0.6 s.
const CANDIDATE_COUNT: usize = 13;

/// Shortest interval between compared reports, microseconds: in it a source in steps of 0.1 deg changes by several, in a roll.
const COMPARISON_US: u64 = 200_000;

/// Longest interval, microseconds.
const MAX_COMPARISON_US: u64 = 400_000;

/// Time constant of the sums of squares, seconds: a roll into a turn, and some of the flight before it.
const FORGETTING_S: f32 = 3.0;

/// Smallest sum of squares, rad^2, that refutes a latency, (3 deg)^2, and the largest ratio of another candidate's sum to it and to
/// that of the reported motion. Of planes, 0.7 % of the headings are bad after a latency has grown to 500 ms, and 1.7 % with an
/// attitude of 30 % of the bank; with a ratio of 0.25 1.1 and 1.7 %, with 0.5 0.4 and 2.3 %.
const MIN_REFUTING_SUM_RAD2: f32 = square_deg(3.0);
const MAX_SUM_RATIO: f32 = 0.35;

/// Shortest latency that is corrected, microseconds. A calibration estimates the usual latency of its link itself.
const MIN_CORRECTED_US: i32 = 150_000;

const fn square_deg(deg: f32) -> f32 {
    deg * DEG * deg * DEG
}

const fn candidate_us(candidate: usize) -> i32 {
    (candidate as u64 * CANDIDATE_STEP_US) as i32
}

/// How well each candidate explains the motion of the reported vertical.
#[derive(Debug)]
pub(super) struct LatencyEstimator {
    /// Instant and vertical, in body axes, of the last compared report.
    last_report: Option<(Timestamp, Vector3<f32>)>,
    /// Squared motion of the vertical in the gyro's frame for each candidate, rad^2.
    sums_rad2: [f32; CANDIDATE_COUNT],
    /// Squared motion in body axes, rad^2.
    reported_rad2: f32,
    selected: usize,
}

impl LatencyEstimator {
    pub const fn new() -> Self {
        Self { last_report: None, sums_rad2: [0.0; CANDIDATE_COUNT], reported_rad2: 0.0, selected: 0 }
    }

    /// Latency, microseconds; 0 if it is that of a usual link.
    pub fn latency_us(&self) -> i32 {
        let latency_us = candidate_us(self.selected);
        if latency_us >= MIN_CORRECTED_US { latency_us } else { 0 }
    }

    /// Compares a reported attitude, described at `at` if its latency is 0, with the rotation of the frame.
    pub fn push_report(&mut self, frame: &GyroFrame, at: Timestamp, reported: RollPitch) {
        let down = reported.tilt_rotation().down_in_body();
        let Some((last_at, last_down)) = self.last_report else {
            self.last_report = Some((at, down));
            return;
        };
        let interval_us = at.us_since(last_at);
        if interval_us < COMPARISON_US {
            return;
        }
        self.last_report = Some((at, down));
        let motion_rad2: [Option<f32>; CANDIDATE_COUNT] = array::from_fn(|candidate| {
            let [from, to] = [last_at, at].map(|at| frame.rotation_at(at.plus_signed_us(-candidate_us(candidate))));
            Some((to? * down - from? * last_down).norm_squared())
        });
        if interval_us > MAX_COMPARISON_US || motion_rad2.iter().any(Option::is_none) {
            return;
        }
        let kept = 1.0 - interval_us as f32 * 1e-6 / FORGETTING_S;
        for (sum, motion_rad2) in self.sums_rad2.iter_mut().zip(motion_rad2) {
            *sum = kept * *sum + motion_rad2.unwrap_or_default();
        }
        self.reported_rad2 = kept * self.reported_rad2 + (down - last_down).norm_squared();
        self.select_candidate();
    }

    fn select_candidate(&mut self) {
        let selected_rad2 = self.sums_rad2[self.selected];
        let best = (0..CANDIDATE_COUNT).min_by(|a, b| self.sums_rad2[*a].total_cmp(&self.sums_rad2[*b]));
        if let Some(best) = best
            && selected_rad2 > MIN_REFUTING_SUM_RAD2
            && self.sums_rad2[best] < MAX_SUM_RATIO * selected_rad2.min(self.reported_rad2)
        {
            self.selected = best;
        }
    }

    /// The reported attitude, advanced by the rotation during its latency.
    pub fn advance_report(&self, frame: &GyroFrame, at: Timestamp, reported: RollPitch) -> RollPitch {
        let latency_us = self.latency_us();
        if latency_us == 0 {
            return reported;
        }
        let rotations = frame.rotation_at(at.plus_signed_us(-latency_us)).zip(frame.rotation_at(at));
        rotations.map_or(reported, |(then, now)| {
            roll_and_pitch_of_down(&(now.inverse() * (then * reported.tilt_rotation().down_in_body())))
        })
    }
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::super::testing::heading_and_roll_in_turns_deg;
    use super::*;

    /// Roll, degrees, 40 s of turns with own rates at 40 Hz, and of a source of 20 Hz with 0.3 deg of noise: its latency in
    /// microseconds, and the largest error of the advanced roll in the second half.
    fn estimate(reported_deg: impl Fn(f32) -> f32) -> (i32, f32) {
        let (mut estimator, mut frame, mut random) = (LatencyEstimator::new(), GyroFrame::new(), Random(1));
        let roll_pitch = |roll_deg: f32| RollPitch::from_deg(roll_deg, 0.0);
        let own_deg = |t_s: f32| heading_and_roll_in_turns_deg(t_s)[1];
        let mut worst_deg = 0.0_f32;
        for i in 0..1600_u16 {
            let (at, t_s) = (Timestamp::from_us(10_000_000 + u64::from(i) * 25_000), f32::from(i) * 0.025);
            let p_deg_s = (own_deg(t_s + 0.0125) - own_deg(t_s - 0.0125)) / 0.025;
            frame.push_rates(at, Some(Vector3::new(p_deg_s.to_radians(), 0.0, 0.0)));
            if i % 2 == 0 {
                let reported = roll_pitch(reported_deg(t_s) + 0.3 * random.normal());
                estimator.push_report(&frame, at, reported);
                let error_deg = estimator.advance_report(&frame, at, reported).roll_rad.to_degrees() - own_deg(t_s);
                worst_deg = if t_s < 20.0 { 0.0 } else { worst_deg.max(error_deg.abs()) };
            }
        }
        (estimator.latency_us(), worst_deg)
    }

    /// A roll of 25 deg/s: a step of the candidates is 1.25 deg, four sigmas of noise are 1.2 deg, an uncorrected latency of 0.1 s
    /// is 2.5 deg.
    #[test]
    fn a_long_latency_is_measured_and_corrected() {
        let own_deg = |t_s: f32| heading_and_roll_in_turns_deg(t_s)[1];
        for (latency_s, corrected_us, limit_deg) in
            [(0.0, 0, 1.5), (0.1, 0, 4.0), (0.2, 200_000, 3.0), (0.325, 325_000, 3.0), (0.5, 500_000, 3.0)]
        {
            let (found_us, worst_deg) = estimate(|t_s| own_deg(t_s - latency_s));
            assert!(u64::from(found_us.abs_diff(corrected_us)) <= CANDIDATE_STEP_US, "{latency_s}: {found_us}");
            assert!(worst_deg < limit_deg, "{latency_s}: {worst_deg}");
        }
    }

    /// A part of the bank, an attitude that hangs, another axis or sign: none is a latency.
    #[test]
    fn other_faults_are_no_latency() {
        let own_deg = |t_s: f32| heading_and_roll_in_turns_deg(t_s)[1];
        for factor in [0.0, 0.3, 0.7, -1.0] {
            assert_eq!(estimate(|t_s| factor * own_deg(t_s)).0, 0, "{factor}");
        }
    }
}
