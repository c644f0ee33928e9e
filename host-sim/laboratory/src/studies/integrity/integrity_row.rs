//! Results of all flights of a case.

use log_analysis::numbers::quantile;
use serde::Serialize;

use super::flight::{AcceptedCalibration, CaseFlightResult, HardIronEstimateError};
use super::statistics::HeadingStatistics;

/// Results of all flights of one fault case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IntegrityRow {
    /// Case name.
    pub case: &'static str,
    /// Number of flights.
    pub flights: usize,
    /// Accepted calibrations, percent of flights.
    pub accepted_percent: f64,
    /// Accepted calibrations with a true error above three times the estimated one, percent of flights.
    pub wrong_percent: f64,
    /// True over estimated error of accepted calibrations, median; `None` without any.
    #[serde(rename = "ratio_median")]
    pub error_ratio_median: Option<f64>,
    /// True over estimated error of accepted calibrations, largest.
    #[serde(rename = "ratio_worst")]
    pub error_ratio_largest: Option<f64>,
    /// Bad headings, with an error above four sigmas and above 5 deg, percent of all output since the onset.
    pub bad_percent: f64,
    /// Longest sequence of bad headings, seconds.
    pub longest_bad_s: f64,
    /// Largest heading error, degrees.
    pub worst_deg: f64,
    /// Smooth headings, percent of all headings.
    pub smooth_percent: f64,
    /// RMS heading error, degrees.
    pub rms_deg: f64,
    /// RMS of the output sigmas, degrees.
    pub sigma_rms_deg: f64,
    /// Largest error that was exceeded for 10 s without a break while every output sigma was 2 deg or less, degrees.
    pub worst_10s_deg: f64,
    /// Percentage of headings with an error within one sigma.
    pub within_one_sigma_percent: f64,
    /// Percentage of headings with an error within two sigmas.
    pub within_two_sigma_percent: f64,
    /// Percentage of headings with an error within three sigmas.
    pub within_three_sigma_percent: f64,
    /// Sentences without a heading, percent of all since the onset.
    pub empty_percent: f64,
    /// False alarms (interruptions of the heading output without an active fault), per hour without fault.
    pub alarms_per_hour: f64,
    /// Codes of the console's notes after the calibration, with their counts, most frequent first.
    #[serde(rename = "notes")]
    pub note_counts: Vec<(String, usize)>,
    /// Error of the estimated hard-iron change relative to the change, median, percent; `None` without a
    /// simulated change.
    #[serde(rename = "iron_error_median_percent")]
    pub hard_iron_error_median_percent: Option<f64>,
    /// Codes of rejected calibrations with their counts, most frequent first.
    #[serde(rename = "refused")]
    pub refusal_counts: Vec<(String, usize)>,
    /// Codes of sentences without a heading since the onset, with their counts.
    #[serde(rename = "empty")]
    pub no_heading_counts: Vec<(String, usize)>,
}

pub(super) fn case_row(case: &'static str, results: &[&CaseFlightResult]) -> IntegrityRow {
    let calibrated = || results.iter().filter_map(|flight_result| flight_result.calibration.as_ref().ok());
    let ratios = || calibrated().map(AcceptedCalibration::error_ratio);
    let iron_errors = results
        .iter()
        .filter_map(|flight_result| flight_result.hard_iron_error.map(|HardIronEstimateError(error)| error));
    let percent_of_flights = |flight_count: usize| 100.0 * flight_count as f64 / results.len().max(1) as f64;
    let output_statistics = results.iter().fold(HeadingStatistics::default(), |merged, flight_result| {
        merged.merged_with(&flight_result.output_statistics)
    });
    let [within_one, within_two, within_three] = output_statistics.within_percent();
    IntegrityRow {
        case,
        flights: results.len(),
        accepted_percent: percent_of_flights(ratios().count()),
        wrong_percent: percent_of_flights(ratios().filter(|ratio| *ratio > 3.0).count()),
        error_ratio_median: quantile(ratios(), 0.5),
        error_ratio_largest: quantile(ratios(), 1.0),
        bad_percent: output_statistics.bad_percent(),
        longest_bad_s: output_statistics.longest_bad_s,
        worst_deg: output_statistics.worst_deg,
        smooth_percent: output_statistics.smooth_percent(),
        rms_deg: output_statistics.rms_deg(),
        sigma_rms_deg: output_statistics.sigma_rms_deg(),
        worst_10s_deg: output_statistics.worst_10s_deg,
        within_one_sigma_percent: within_one,
        within_two_sigma_percent: within_two,
        within_three_sigma_percent: within_three,
        empty_percent: output_statistics.empty_percent(),
        alarms_per_hour: output_statistics.alarms_per_hour(),
        note_counts: count_codes(results.iter().flat_map(|flight_result| flight_result.note_codes.iter().cloned())),
        hard_iron_error_median_percent: quantile(iron_errors, 0.5).map(|error| 100.0 * error),
        refusal_counts: count_codes(
            results.iter().filter_map(|flight_result| flight_result.calibration.as_ref().err().cloned()),
        ),
        no_heading_counts: output_statistics.no_heading_counts.into_iter().collect(),
    }
}

fn count_codes(codes: impl Iterator<Item = String>) -> Vec<(String, usize)> {
    let mut counts = std::collections::BTreeMap::new();
    for code in codes {
        *counts.entry(code).or_insert(0) += 1;
    }
    let mut counts: Vec<_> = counts.into_iter().collect();
    counts.sort_by_key(|(_, occurrences)| std::cmp::Reverse(*occurrences));
    counts
}
