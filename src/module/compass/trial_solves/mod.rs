//! Trial solves during a collection in flight: estimate accuracy, recommend a manoeuvre, end the collection.

use crate::messages::Refusal;
use autoswing::calibration::{Advice, Manoeuvre, NOTICEABLE_ERROR_RATIO, Solution};
use autoswing::collection::{CollectionProblem, Collector};
use autoswing::time::WrappingMillis;

/// Samples before the first trial: 40 to fit (three per unknown), and every fourth held back.
const MIN_SAMPLES: u16 = 53;

/// Minimum interval, milliseconds: twenty times the duration of a solve (0.25 to 0.5 s at 80 MHz).
const MIN_INTERVAL_MS: u32 = 10_000;

/// Distinct samples required since the last trial; a stationary vehicle produces none.
const MIN_NEW_DISTINCT_SAMPLES: u16 = 10;

/// Stored samples required since the last trial; with fewer the result hardly changes.
const MIN_NEWLY_STORED_SAMPLES: u16 = 10;

/// With fewer stored samples, only every n-th trial runs (once a minute), to detect stagnation.
const STAGNATION_TRIAL_DIVISOR: u8 = 6;

/// Consecutive trials (one minute), run or skipped, without noticeable improvement that end a collection.
const MAX_STALLED_TRIALS: u8 = 6;

/// Ratio of the expected errors of two successive trials from which they are unchanged.
const UNCHANGED_ERROR_RATIO: f32 = 0.9;

/// Consecutive trials, run or skipped, with an unchanged expected error before a limit of the accuracy is known. Without
/// them, a recorded flight with 0 to 6 s cut off at its start ended at 0.8 or at 1.9 deg, depending on the cut, and
/// another at 1.3 to 2.1 deg.
const MIN_SETTLED_TRIALS: u8 = 2;

/// Result of a trial solve.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialResult {
    /// Expected heading error, degrees RMS; `None` if the solve failed.
    pub expected_error_deg: Option<f32>,
    /// Manoeuvre that would noticeably reduce the expected error.
    pub missing_manoeuvre: Option<Manoeuvre>,
    /// The attitude source limits the accuracy: the expected error is at its floor, settled, and as small as the best
    /// before. A single trial of 20 s of a recorded flight gave a floor of 5.2 deg, and later ones 0.7 deg.
    pub is_limited_by_attitude: bool,
    /// Recent trials brought no improvement, and the expected error has settled.
    pub is_stalled: bool,
    /// Reason for which the solution would be rejected.
    pub refusal: Option<Refusal>,
}

impl TrialResult {
    fn reaches_accuracy(&self, wanted_deg: f32) -> bool {
        self.expected_error_deg.is_some_and(|expected_error_deg| expected_error_deg <= wanted_deg)
    }

    /// Whether the collection ends: because it is accurate, or no manoeuvre would help. A refusal for missing samples
    /// continues it.
    fn ends_collection(&self, is_accurate: bool) -> bool {
        let cannot_improve = (self.is_limited_by_attitude || self.is_stalled) && self.missing_manoeuvre.is_none();
        let is_curable = self.refusal.as_ref().is_some_and(Refusal::is_curable_by_samples);
        (is_accurate || cannot_improve) && !is_curable
    }
}

/// Schedule of trial solves.
#[derive(Clone, Copy, Debug)]
pub struct TrialSchedule {
    /// Time of the last trial, run or skipped, and count of distinct samples then (wrapping).
    last_trial_at: WrappingMillis,
    distinct_samples_at_last_trial: u16,
    /// Count of stored samples at the last trial that ran (wrapping).
    stored_count_at_last_trial: u16,
    skipped_trials: u8,
    /// Trials that the last one represents, itself and skipped ones before it; 0 before the first.
    represented_trials: u8,
}

impl TrialSchedule {
    /// Schedule before the first trial.
    pub const NO_TRIAL: Self = Self {
        last_trial_at: WrappingMillis::new(0),
        distinct_samples_at_last_trial: 0,
        stored_count_at_last_trial: 0,
        skipped_trials: STAGNATION_TRIAL_DIVISOR - 1,
        represented_trials: 0,
    };

    /// Whether a trial is due; counts it as started.
    pub fn start_trial_if_due(&mut self, collector: &Collector, now: WrappingMillis) -> bool {
        let (new_samples, stored_count) = (collector.taken_count(), collector.stored_count());
        let is_early = if self.represented_trials == 0 {
            stored_count < MIN_SAMPLES
        } else {
            now.ms_since(self.last_trial_at) < MIN_INTERVAL_MS
                || new_samples.wrapping_sub(self.distinct_samples_at_last_trial) < MIN_NEW_DISTINCT_SAMPLES
        };
        if is_early {
            return false;
        }
        (self.last_trial_at, self.distinct_samples_at_last_trial) = (now, new_samples);
        self.skipped_trials += 1;
        let is_due = self.skipped_trials >= STAGNATION_TRIAL_DIVISOR
            || stored_count.wrapping_sub(self.stored_count_at_last_trial) >= MIN_NEWLY_STORED_SAMPLES;
        if is_due {
            (self.stored_count_at_last_trial, self.skipped_trials, self.represented_trials) =
                (stored_count, 0, self.skipped_trials);
        }
        is_due
    }

    /// Runs the next trial without waiting for newly stored samples.
    fn force_next_trial(&mut self) {
        self.stored_count_at_last_trial = self.stored_count_at_last_trial.wrapping_sub(MIN_NEWLY_STORED_SAMPLES);
    }
}

/// Schedule and results of the trial solves of a collection.
#[derive(Debug)]
pub(super) struct TrialSolves {
    schedule: TrialSchedule,
    /// Best expected error, degrees RMS.
    best_expected_error_deg: Option<f32>,
    trials_since_improvement: u8,
    settled_trials: u8,
    last_result: Option<TrialResult>,
}

impl TrialSolves {
    pub const NO_TRIALS: Self = Self {
        schedule: TrialSchedule::NO_TRIAL,
        best_expected_error_deg: None,
        trials_since_improvement: 0,
        settled_trials: 0,
        last_result: None,
    };

    pub const fn last_result(&self) -> Option<&TrialResult> {
        self.last_result.as_ref()
    }

    /// Manoeuvre that would noticeably reduce the expected error of the last trial.
    pub fn missing_manoeuvre(&self) -> Option<CollectionProblem> {
        self.last_result.as_ref()?.missing_manoeuvre.map(CollectionProblem::MissingManoeuvre)
    }

    /// Progress, percent: wanted over expected heading error.
    pub fn progress_percent(&self, wanted_deg: f32) -> Option<u8> {
        let expected_error_deg = self.last_result.as_ref()?.expected_error_deg?;
        // The cast saturates and maps NaN to 0.
        Some((100.0 * wanted_deg / expected_error_deg).clamp(0.0, 100.0) as u8)
    }

    pub fn start_trial_if_due(&mut self, collector: &Collector, now: WrappingMillis) -> bool {
        self.schedule.start_trial_if_due(collector, now)
    }

    /// Stores the failure of a trial.
    pub fn record_failure(&mut self, refusal: Refusal) {
        self.last_result = Some(TrialResult {
            expected_error_deg: None,
            missing_manoeuvre: None,
            is_limited_by_attitude: false,
            is_stalled: false,
            refusal: Some(refusal),
        });
    }

    /// Stores the result of a trial; returns whether the collection ends.
    ///
    /// The wanted accuracy must be reached twice in a row: the errors of a few manoeuvres can be absorbed by the unknowns,
    /// and the expected error is too small. Of 400 simulated copters with 20 uT in hover, five had three times the
    /// expected error when one trial sufficed, two with two trials; of 75 accepted VTOLs whose attitude loses 12 % of the
    /// bank in turns, six and two.
    pub fn record_result(&mut self, solution: &Solution, refusal: Option<Refusal>, wanted_deg: f32) -> bool {
        let expected_error_deg = solution.quality.expected_rms_deg;
        let is_settled = self.update_settled(expected_error_deg);
        let is_near_best = is_unchanged(self.best_expected_error_deg, expected_error_deg, NOTICEABLE_ERROR_RATIO);
        let result = TrialResult {
            expected_error_deg: Some(expected_error_deg),
            missing_manoeuvre: solution.advice.filter(Advice::is_worthwhile).map(|advice| advice.manoeuvre),
            is_limited_by_attitude: solution.advice.as_ref().is_some_and(Advice::is_at_floor)
                && is_settled
                && is_near_best,
            is_stalled: self.update_stalled(expected_error_deg) && is_settled,
            refusal,
        };
        let reached_before =
            self.last_result.as_ref().is_some_and(|last_result| last_result.reaches_accuracy(wanted_deg));
        let is_reached = result.reaches_accuracy(wanted_deg);
        if is_reached && !reached_before {
            self.schedule.force_next_trial();
        }
        let is_over = result.ends_collection(is_reached && reached_before);
        self.last_result = Some(result);
        is_over
    }

    fn update_settled(&mut self, expected_error_deg: f32) -> bool {
        let last_deg = self.last_result.as_ref().and_then(|last_result| last_result.expected_error_deg);
        self.settled_trials = if is_unchanged(last_deg, expected_error_deg, UNCHANGED_ERROR_RATIO) {
            self.settled_trials.saturating_add(self.schedule.represented_trials)
        } else {
            0
        };
        self.settled_trials >= MIN_SETTLED_TRIALS
    }

    fn update_stalled(&mut self, expected_error_deg: f32) -> bool {
        let is_better = |best_deg| expected_error_deg <= NOTICEABLE_ERROR_RATIO * best_deg;
        if self.best_expected_error_deg.map_or(expected_error_deg.is_finite(), is_better) {
            (self.best_expected_error_deg, self.trials_since_improvement) = (Some(expected_error_deg), 0);
        } else {
            self.trials_since_improvement =
                self.trials_since_improvement.saturating_add(self.schedule.represented_trials);
        }
        self.trials_since_improvement >= MAX_STALLED_TRIALS
    }
}

/// Whether neither of two expected errors is smaller than the other by more than this ratio.
fn is_unchanged(earlier_deg: Option<f32>, expected_error_deg: f32, ratio: f32) -> bool {
    earlier_deg.is_some_and(|earlier_deg| {
        expected_error_deg >= ratio * earlier_deg && earlier_deg >= ratio * expected_error_deg
    })
}

#[cfg(test)]
mod tests;
