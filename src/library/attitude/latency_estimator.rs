//! Latency of an autopilot's attitude, measured by the module's own gyro.
//!
//! The reported roll and pitch change as the own ones did some time before. Of the candidate times, the one whose changes fit best
//! is the latency. A reported attitude is advanced by what the own one has changed since.

use core::array;

use super::source::HAS_OWN_ATTITUDE;
use super::timed_report::interpolate;
use crate::frames::{RollPitch, wrap_pi};
use crate::time::Timestamp;
use crate::trig::{DEG, square};

/// Interval of the candidate latencies and of the remembered attitudes, microseconds: at a roll of 30 deg/s 1.5 deg.
const CANDIDATE_STEP_US: u64 = 50_000;

/// Number of candidates: up to 0.6 s.
const CANDIDATE_COUNT: usize = 13;

/// Remembered own attitudes: for the longest latency, and an interval between two compared reports.
const REMEMBERED_COUNT: usize = if HAS_OWN_ATTITUDE { CANDIDATE_COUNT + 6 } else { 1 };

/// Shortest interval between compared reports, microseconds: in it a source in steps of 0.1 deg changes by several, in a roll.
const COMPARISON_US: u64 = 200_000;

/// Longest interval, microseconds.
const MAX_COMPARISON_US: u64 = 400_000;

/// Time constant of the sums of squares, seconds: a roll into a turn, and some of the flight before it.
const FORGETTING_S: f32 = 3.0;

/// Smallest sum of squares, rad^2, that refutes a latency, (3 deg)^2, and the largest ratio of another candidate's sum to it and to
/// that of the reported changes. Of planes, 0.7 % of the headings are bad after a latency has grown to 500 ms, and 1.7 % with an
/// attitude of 30 % of the bank; with a ratio of 0.25 1.1 and 1.7 %, with 0.5 0.4 and 2.3 %.
const MIN_REFUTING_SUM_RAD2: f32 = square_deg(3.0);
const MAX_SUM_RATIO: f32 = 0.35;

/// Shortest latency that is corrected, microseconds. A calibration estimates the usual latency of its link itself.
const MIN_CORRECTED_US: u64 = 150_000;

const fn square_deg(deg: f32) -> f32 {
    deg * DEG * deg * DEG
}

const fn candidate_us(candidate: usize) -> u64 {
    candidate as u64 * CANDIDATE_STEP_US
}

/// Own attitudes of the last 0.9 s, and how well each candidate explains the changes of the reports.
#[derive(Debug)]
pub(super) struct LatencyEstimator {
    own: heapless::Deque<(Timestamp, RollPitch), REMEMBERED_COUNT>,
    last_report: Option<(Timestamp, RollPitch)>,
    /// Squared differences of the changes for each candidate, rad^2.
    sums_rad2: [f32; CANDIDATE_COUNT],
    /// Squared reported changes, rad^2.
    reported_rad2: f32,
    selected: usize,
}

impl LatencyEstimator {
    pub const fn new() -> Self {
        Self {
            own: heapless::Deque::new(),
            last_report: None,
            sums_rad2: [0.0; CANDIDATE_COUNT],
            reported_rad2: 0.0,
            selected: 0,
        }
    }

    /// Forgets the own attitudes, when the own filter has started again.
    pub fn forget_own_attitudes(&mut self) {
        self.own.clear();
        self.last_report = None;
    }

    /// Remembers an own attitude.
    pub fn push_own_attitude(&mut self, at: Timestamp, attitude: RollPitch) {
        if self.own.back().is_some_and(|(last, _)| at.us_since(*last) < CANDIDATE_STEP_US) {
            return;
        }
        if self.own.is_full() {
            self.own.pop_front();
        }
        // Infallible: the oldest was removed if full.
        let _ = self.own.push_back((at, attitude));
    }

    /// Latency, microseconds; 0 if it is that of a usual link.
    pub fn latency_us(&self) -> u64 {
        let latency_us = candidate_us(self.selected);
        if latency_us >= MIN_CORRECTED_US { latency_us } else { 0 }
    }

    /// Compares a reported attitude, described at `at` if its latency is 0, with the own ones.
    pub fn push_report(&mut self, at: Timestamp, reported: RollPitch) {
        let Some((last_at, last)) = self.last_report else {
            self.last_report = Some((at, reported));
            return;
        };
        let interval_us = at.us_since(last_at);
        if interval_us < COMPARISON_US {
            return;
        }
        self.last_report = Some((at, reported));
        let change = change_rad(last, reported);
        let own_changes: [Option<[f32; 2]>; CANDIDATE_COUNT] = array::from_fn(|candidate| {
            let [from, to] = [last_at, at].map(|at| self.own_attitude_before(at, candidate_us(candidate)));
            Some(change_rad(from?, to?))
        });
        if interval_us > MAX_COMPARISON_US || own_changes.iter().any(Option::is_none) {
            return;
        }
        let kept = 1.0 - interval_us as f32 * 1e-6 / FORGETTING_S;
        for (sum, own) in self.sums_rad2.iter_mut().zip(own_changes) {
            let [roll_rad, pitch_rad] = own.unwrap_or_default();
            *sum = kept * *sum + square(roll_rad - change[0]) + square(pitch_rad - change[1]);
        }
        self.reported_rad2 = kept * self.reported_rad2 + square(change[0]) + square(change[1]);
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

    /// The reported attitude, advanced by the own changes during its latency.
    pub fn advance_report(&self, at: Timestamp, reported: RollPitch) -> RollPitch {
        let latency_us = self.latency_us();
        if latency_us == 0 {
            return reported;
        }
        let own = self.own_attitude_before(at, latency_us).zip(self.own_attitude_before(at, 0));
        let [roll_rad, pitch_rad] = own.map_or([0.0; 2], |(then, now)| change_rad(then, now));
        RollPitch { roll_rad: wrap_pi(reported.roll_rad + roll_rad), pitch_rad: reported.pitch_rad + pitch_rad }
    }

    /// Own attitude some microseconds before an instant: between two remembered ones, or extrapolated by at most two intervals.
    fn own_attitude_before(&self, at: Timestamp, before_us: u64) -> Option<RollPitch> {
        let at = Timestamp::from_us(at.as_us().saturating_sub(before_us));
        let later = self.own.iter().position(|(remembered_at, _)| *remembered_at > at);
        let after_index = later.unwrap_or(self.own.len().saturating_sub(1));
        let (before, after) = (self.own.get(after_index.checked_sub(1)?)?, self.own.get(after_index)?);
        let step_us = after.0.us_since(before.0);
        let is_near = at >= before.0 && at.us_since(before.0) <= 3 * CANDIDATE_STEP_US && step_us <= MAX_COMPARISON_US;
        let fraction = at.us_since(before.0) as f32 / step_us as f32;
        is_near.then(|| interpolate(before.1, after.1, fraction))
    }
}

/// Changes of roll and pitch.
fn change_rad(from: RollPitch, to: RollPitch) -> [f32; 2] {
    [wrap_pi(to.roll_rad - from.roll_rad), to.pitch_rad - from.pitch_rad]
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::super::testing::heading_and_roll_in_turns_deg;
    use super::*;

    /// Roll, degrees, 40 s of turns with own attitudes at 40 Hz, and of a source of 20 Hz with 0.3 deg of noise: its latency in
    /// microseconds, and the largest error of the advanced roll in the second half.
    fn estimate(reported_deg: impl Fn(f32) -> f32) -> (u64, f32) {
        let (mut estimator, mut random) = (LatencyEstimator::new(), Random(1));
        let roll_pitch = |roll_deg: f32| RollPitch::from_deg(roll_deg, 0.0);
        let own_deg = |t_s: f32| heading_and_roll_in_turns_deg(t_s)[1];
        let mut worst_deg = 0.0_f32;
        for i in 0..1600_u16 {
            let (at, t_s) = (Timestamp::from_us(10_000_000 + u64::from(i) * 25_000), f32::from(i) * 0.025);
            estimator.push_own_attitude(at, roll_pitch(own_deg(t_s)));
            if i % 2 == 0 {
                let reported = roll_pitch(reported_deg(t_s) + 0.3 * random.normal());
                estimator.push_report(at, reported);
                let error_deg = estimator.advance_report(at, reported).roll_rad.to_degrees() - own_deg(t_s);
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
            assert!(found_us.abs_diff(corrected_us) <= CANDIDATE_STEP_US, "{latency_s}: {found_us}");
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
