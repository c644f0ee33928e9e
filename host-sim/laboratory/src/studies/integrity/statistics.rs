//! Statistics of the output headings.

use std::collections::{BTreeMap, VecDeque};

/// A heading is bad if its error exceeds both this multiple of its sigma and 5 deg.
const MIN_BAD_ERROR_SIGMAS: f64 = 4.0;
/// Error below which a heading is never bad, degrees.
const MIN_BAD_ERROR_DEG: f64 = 5.0;

/// Duration of an error that counts as sustained, seconds.
const MIN_SUSTAINED_ERROR_S: f64 = 10.0;
/// Largest sigma of a heading that counts in a sustained error, degrees.
const MAX_SUSTAINED_SIGMA_DEG: f64 = 2.0;

/// Output sentence with the error of its heading, or without a heading.
#[derive(Clone, Debug, PartialEq)]
pub enum EvaluatedSentence {
    /// Sentence with a heading.
    Heading {
        /// Output minus true heading, degrees.
        error_deg: f64,
        /// Standard deviation sent with the heading, degrees.
        sigma_deg: f64,
        /// Whether the smoothed heading was output.
        is_smooth: bool,
    },
    /// Status code of a sentence without heading.
    Empty(String),
}

/// Counts over one or several flights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeadingStatistics {
    heading_count: u64,
    smooth_count: u64,
    bad_count: u64,
    squared_error_sum: f64,
    squared_sigma_sum: f64,
    within_sigma_counts: [u64; 3],
    /// Largest heading error, degrees.
    pub worst_deg: f64,
    /// Longest sequence of bad headings, seconds.
    pub longest_bad_s: f64,
    /// Largest error exceeded for 10 s without a break while every sigma was 2 deg or less, degrees.
    pub worst_10s_deg: f64,
    /// Sentences without heading, by status code.
    pub no_heading_counts: BTreeMap<String, usize>,
    alarm_count: u64,
    faultless_s: f64,
    /// Start of the present sequence of bad headings, microseconds.
    bad_since_us: Option<u64>,
    was_empty: bool,
    /// Errors of the last 10 s of uninterrupted headings with a small sigma.
    recent_errors_deg: VecDeque<f64>,
}

impl HeadingStatistics {
    /// Adds a sentence, `step_s` after the previous one. False alarms count while no fault is active, all else after
    /// the onset.
    pub fn add_sentence(
        &mut self,
        at_us: u64,
        step_s: f64,
        sentence: &EvaluatedSentence,
        is_evaluated: bool,
        is_fault_active: bool,
    ) {
        let is_empty = matches!(sentence, EvaluatedSentence::Empty(_));
        if !is_fault_active {
            self.faultless_s += step_s;
            self.alarm_count += u64::from(is_empty && !self.was_empty);
        }
        self.was_empty = is_empty;
        if !is_evaluated {
            return;
        }
        match sentence {
            EvaluatedSentence::Empty(reason) => {
                *self.no_heading_counts.entry(reason.clone()).or_insert(0) += 1;
                self.bad_since_us = None;
                self.recent_errors_deg.clear();
            }
            EvaluatedSentence::Heading { error_deg, sigma_deg, is_smooth } => {
                self.smooth_count += u64::from(*is_smooth);
                self.add_heading_error(at_us, step_s, error_deg.abs(), *sigma_deg);
            }
        }
    }

    fn add_heading_error(&mut self, at_us: u64, step_s: f64, error_deg: f64, sigma_deg: f64) {
        self.heading_count += 1;
        self.squared_error_sum += error_deg * error_deg;
        self.squared_sigma_sum += sigma_deg * sigma_deg;
        self.update_sustained_error(step_s, error_deg, sigma_deg);
        self.worst_deg = self.worst_deg.max(error_deg);
        for (count, sigmas) in self.within_sigma_counts.iter_mut().zip([1.0, 2.0, 3.0]) {
            *count += u64::from(error_deg <= sigmas * sigma_deg);
        }
        if error_deg > (MIN_BAD_ERROR_SIGMAS * sigma_deg).max(MIN_BAD_ERROR_DEG) {
            self.bad_count += 1;
            let since_us = *self.bad_since_us.get_or_insert(at_us);
            self.longest_bad_s = self.longest_bad_s.max((at_us - since_us) as f64 / 1e6 + step_s);
        } else {
            self.bad_since_us = None;
        }
    }

    fn update_sustained_error(&mut self, step_s: f64, error_deg: f64, sigma_deg: f64) {
        if sigma_deg > MAX_SUSTAINED_SIGMA_DEG {
            self.recent_errors_deg.clear();
            return;
        }
        self.recent_errors_deg.push_back(error_deg);
        let sustained_count = (MIN_SUSTAINED_ERROR_S / step_s).round() as usize;
        if self.recent_errors_deg.len() > sustained_count {
            self.recent_errors_deg.pop_front();
        }
        if self.recent_errors_deg.len() == sustained_count {
            let least_deg = self.recent_errors_deg.iter().copied().fold(f64::INFINITY, f64::min);
            self.worst_10s_deg = self.worst_10s_deg.max(least_deg);
        }
    }

    /// Statistics with the counts of both flights added.
    #[must_use]
    pub fn merged_with(mut self, other: &Self) -> Self {
        self.heading_count += other.heading_count;
        self.smooth_count += other.smooth_count;
        self.bad_count += other.bad_count;
        self.squared_error_sum += other.squared_error_sum;
        self.squared_sigma_sum += other.squared_sigma_sum;
        self.worst_10s_deg = self.worst_10s_deg.max(other.worst_10s_deg);
        for (count, other_count) in self.within_sigma_counts.iter_mut().zip(other.within_sigma_counts) {
            *count += other_count;
        }
        self.worst_deg = self.worst_deg.max(other.worst_deg);
        self.longest_bad_s = self.longest_bad_s.max(other.longest_bad_s);
        for (reason, occurrences) in &other.no_heading_counts {
            *self.no_heading_counts.entry(reason.clone()).or_insert(0) += occurrences;
        }
        self.alarm_count += other.alarm_count;
        self.faultless_s += other.faultless_s;
        self
    }

    /// Bad headings, percent of headings.
    #[must_use]
    pub fn bad_percent(&self) -> f64 {
        percent(self.bad_count, self.heading_count)
    }

    /// Smooth headings, percent of headings.
    #[must_use]
    pub fn smooth_percent(&self) -> f64 {
        percent(self.smooth_count, self.heading_count)
    }

    /// Errors within one, two and three sigmas, percent of headings.
    #[must_use]
    pub fn within_percent(&self) -> [f64; 3] {
        self.within_sigma_counts.map(|count| percent(count, self.heading_count))
    }

    /// RMS heading error, degrees.
    #[must_use]
    pub fn rms_deg(&self) -> f64 {
        (self.squared_error_sum / self.heading_count.max(1) as f64).sqrt()
    }

    /// RMS of the output sigmas, degrees.
    #[must_use]
    pub fn sigma_rms_deg(&self) -> f64 {
        (self.squared_sigma_sum / self.heading_count.max(1) as f64).sqrt()
    }

    /// Sentences without heading, percent of all sentences.
    #[must_use]
    pub fn empty_percent(&self) -> f64 {
        let empty_count = self.no_heading_counts.values().sum::<usize>() as u64;
        percent(empty_count, empty_count + self.heading_count)
    }

    /// Interruptions of the heading output without an active fault, per hour without fault.
    #[must_use]
    pub fn alarms_per_hour(&self) -> f64 {
        if self.alarm_count == 0 { 0.0 } else { self.alarm_count as f64 * 3600.0 / self.faultless_s.max(1.0) }
    }
}

fn percent(numerator: u64, denominator: u64) -> f64 {
    100.0 * numerator as f64 / denominator.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heading_sentence(error_deg: f64, sigma_deg: f64) -> EvaluatedSentence {
        EvaluatedSentence::Heading { error_deg, sigma_deg, is_smooth: sigma_deg > 1.5 }
    }

    fn empty_sentence() -> EvaluatedSentence {
        EvaluatedSentence::Empty("sensor-silent".to_owned())
    }

    /// Sentences at 10 Hz after the onset.
    fn statistics_of(sentences: &[EvaluatedSentence], is_fault_active: bool) -> HeadingStatistics {
        let mut statistics = HeadingStatistics::default();
        for (i, sentence) in (0..).zip(sentences) {
            statistics.add_sentence(i * 100_000, 0.1, sentence, true, is_fault_active);
        }
        statistics
    }

    #[test]
    fn a_bad_heading_is_off_by_over_four_sigmas_and_5_deg() {
        for (error_deg, sigma_deg, expected_bad_count) in
            [(4.9, 0.1, false), (5.1, 0.1, true), (-5.1, 0.1, true), (7.9, 2.0, false), (8.1, 2.0, true)]
        {
            let percent = if expected_bad_count { 100.0 } else { 0.0 };
            assert_eq!(
                statistics_of(&[heading_sentence(error_deg, sigma_deg)], true).bad_percent().to_bits(),
                f64::to_bits(percent)
            );
        }
    }

    #[test]
    fn a_run_of_bad_headings_ends_with_a_good_one_or_none() {
        let (good_heading, bad_heading) = (heading_sentence(0.5, 1.0), heading_sentence(9.0, 1.0));
        let run_of_two = [
            bad_heading.clone(),
            bad_heading.clone(),
            good_heading.clone(),
            bad_heading.clone(),
            empty_sentence(),
            bad_heading.clone(),
        ];
        assert!((statistics_of(&run_of_two, true).longest_bad_s - 0.2).abs() < 1e-9);
        let run_of_three = [good_heading, bad_heading.clone(), bad_heading.clone(), bad_heading];
        assert!((statistics_of(&run_of_three, true).longest_bad_s - 0.3).abs() < 1e-9);
        assert!((statistics_of(&run_of_two, true).bad_percent() - 80.0).abs() < 1e-9);
    }

    #[test]
    fn smooth_headings_are_counted() {
        let sentences = [
            heading_sentence(0.1, 2.0),
            heading_sentence(0.1, 1.0),
            empty_sentence(),
            heading_sentence(0.1, 1.0),
            heading_sentence(0.1, 1.0),
        ];
        assert!((statistics_of(&sentences, true).smooth_percent() - 25.0).abs() < 1e-9);
    }

    /// An interruption counts once, if it begins without a fault.
    #[test]
    fn an_alarm_is_an_empty_period_that_begins_while_nothing_is_wrong() {
        let good_heading = heading_sentence(0.5, 1.0);
        let sentences = [
            good_heading.clone(),
            empty_sentence(),
            empty_sentence(),
            good_heading.clone(),
            empty_sentence(),
            good_heading,
        ];
        // Two alarms in six sentences of 0.1 s: two per 0.6 s.
        assert!((statistics_of(&sentences, false).alarms_per_hour() - 2.0 * 3600.0).abs() < 1e-6);
        assert_eq!(statistics_of(&sentences, true).alarms_per_hour().to_bits(), 0);
        assert!((statistics_of(&sentences, true).empty_percent() - 50.0).abs() < 1e-9);
        assert_eq!(statistics_of(&sentences, true).no_heading_counts["sensor-silent"], 3);
    }

    #[test]
    fn headings_before_the_fault_are_not_counted() {
        let mut statistics = HeadingStatistics::default();
        statistics.add_sentence(0, 0.1, &heading_sentence(90.0, 1.0), false, false);
        assert_eq!(statistics.worst_deg.to_bits(), 0);
        assert_eq!(statistics.heading_count, 0);
    }

    #[test]
    fn statistics_of_flights_are_merged() {
        let first_flight = statistics_of(&[heading_sentence(3.0, 2.0), heading_sentence(1.0, 2.0)], true);
        let second_flight =
            statistics_of(&[heading_sentence(-5.0, 2.0), empty_sentence(), heading_sentence(1.0, 2.0)], true);
        let merged = first_flight.merged_with(&second_flight);
        assert_eq!(merged.within_percent().map(|percent| percent as u8), [50, 75, 100]);
        assert!((merged.rms_deg() - 3.0).abs() < 1e-9 && (merged.worst_deg - 5.0).abs() < 1e-9);
        assert!((merged.empty_percent() - 20.0).abs() < 1e-9);
        assert!((merged.smooth_percent() - 100.0).abs() < 1e-9);
    }
}
