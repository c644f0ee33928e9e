//! Contents of a page, independent of their source (mission or log).

use crate::numbers::mean_angle_deg;
use crate::replay::verdict::CompassState;
use crate::replay::{ParameterChange, ParameterFile};
use crate::score::wrap_180;

/// Contents of a report page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Title of the page.
    pub title: String,
    /// Verdicts, the most important first.
    pub verdicts: Vec<VerdictLine>,
    /// Most important figures, name and value.
    pub key_figures: Vec<[String; 2]>,
    /// Warnings about the log.
    pub log_warnings: Vec<String>,
    /// Reference of the headings.
    pub reference: ReferenceInfo,
    /// Heading errors of all compasses with the coefficients of each calibrator.
    pub calibrators: CalibratorComparison,
    /// Results of each compass, the one in use first.
    pub compasses: Vec<CompassReport>,
    /// What the pilot does next, in steps.
    pub next_steps: Vec<String>,
    /// Heading errors by the terms that a file has, sentences.
    pub correction_choices: String,
    /// Parameter files to load; the first for the usual ground station.
    pub parameter_files: Vec<ParameterFile>,
    /// Old and new values of the parameters to load.
    pub parameter_changes: Vec<ParameterChange>,
    /// The module's console session, of a simulated flight.
    pub console_session: Option<String>,
    /// Command, version, log, settings.
    pub origin: Vec<[String; 2]>,
}

/// A verdict on one line.
#[derive(Clone, Debug, PartialEq)]
pub struct VerdictLine {
    /// State of the compass; none of an unused one.
    pub compass_state: Option<CompassState>,
    /// State of the compass in one word.
    pub state_word: &'static str,
    /// The verdict in a sentence.
    pub verdict_text: String,
}

/// Origin of a report, besides its flight.
#[derive(Clone, Debug, Default)]
pub struct ReportOrigin {
    /// Command line that created the report.
    pub command_line: String,
    /// Settings, name and value.
    pub settings: Vec<[String; 2]>,
}

/// Reference of the headings.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReferenceInfo {
    /// Name of a difference from the reference: error, disagreement or correction.
    pub difference_name: &'static str,
    /// Name of the reference.
    pub reference_name: String,
    /// Accuracy of the reference heading, in words.
    pub accuracy_text: String,
    /// Constant part of the errors on a deviation card, a sentence.
    pub card_constant_text: String,
    /// Whether the reference is accurate to 2 deg or better, as a deviation card requires.
    pub is_accurate: bool,
}

/// Heading errors with the coefficients of several calibrators.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CalibratorComparison {
    /// Names of the compasses.
    pub compasses: Vec<String>,
    /// Calibrators with heading RMS less mean for each compass, degrees.
    pub calibrator_rows: Vec<(String, Vec<Option<f64>>)>,
}

/// Results of a compass.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CompassReport {
    /// Name of the compass.
    pub compass_name: String,
    /// Further results, name and value.
    pub facts: Vec<[String; 2]>,
    /// Errors before the calibration.
    pub curves_before: Vec<DeviationCurve>,
    /// Errors after the calibration.
    pub curves_after: Vec<DeviationCurve>,
    /// Expected standard deviation by heading, degrees; as long as a line, or empty.
    pub sigma_by_heading_deg: Vec<f64>,
    /// States of the flight in order of time.
    pub samples: Vec<ReportSample>,
    /// Time of the last change of hard iron or mounting, seconds: means and the deviation card are of later samples.
    pub last_change_s: Option<f64>,
    /// Events that are marked on the charts' time axis.
    pub event_marks: Vec<EventMark>,
    /// Name of the correction used for the headings before the calibration.
    pub before_correction_name: &'static str,
    /// Name of the correction that is applied to the fields of the samples.
    pub corrected_by: &'static str,
    /// Earth's field that the corrected field should have: strength, microtesla, and inclination, degrees.
    pub earth_field: Option<[f64; 2]>,
    /// Magnetic heading less the heading of the samples, degrees.
    pub magnetic_offset_deg: f64,
    /// Advice for the next flight.
    pub advice: Option<String>,
    /// Coefficients: `W` by rows and `b`, microtesla.
    pub coefficients: Option<[[f64; 3]; 4]>,
}

/// Heading errors over the heading.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeviationCurve {
    /// Name of the curve in the legend.
    pub curve_name: String,
    /// Errors from north clockwise at equal steps, degrees.
    pub errors_deg: Vec<Option<f64>>,
    /// Constant part of the error, degrees; a deviation card adds it to `errors_deg`.
    pub constant_deg: f64,
}

impl DeviationCurve {
    /// Error on the deviation card at a step, degrees.
    pub(super) fn card_error_deg(&self, step: usize) -> Option<f64> {
        Some(wrap_180(self.errors_deg.get(step).copied().flatten()? + self.constant_deg))
    }
}

/// Event that is marked on the charts' time axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EventMark {
    /// Seconds on the clock of the samples.
    pub time_s: f64,
    /// Name of the event in the picture.
    pub event_name: String,
}

/// State of the flight at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReportSample {
    /// Seconds on the clock of the log, or of the mission.
    pub time_s: f64,
    /// Heading, degrees: reference, else the module's own.
    pub heading_deg: Option<f64>,
    /// Bank, right wing down positive, degrees.
    pub roll_deg: f64,
    /// Pitch, nose up positive, degrees.
    pub pitch_deg: f64,
    /// Field without a correction, body axes, microtesla.
    pub raw_ut: Option<[f64; 3]>,
    /// Field as logged, microtesla.
    pub logged_ut: Option<[f64; 3]>,
    /// Field corrected by the module or by the parameters to load, body axes, microtesla.
    pub corrected_ut: Option<[f64; 3]>,
    /// Battery current, amperes.
    pub current_a: Option<f64>,
    /// Heading error with the parameters to load, degrees.
    pub error_parameters_deg: Option<f64>,
    /// Heading error of the module, degrees.
    pub error_deg: Option<f64>,
    /// Standard deviation of the heading, degrees.
    pub sigma_deg: Option<f64>,
    /// Heading error before the correction, degrees.
    pub error_before_deg: Option<f64>,
    /// Whether field and attitude are usable.
    pub is_usable: bool,
    /// Whether the module would not have sent the heading.
    pub is_heading_withheld: bool,
}

/// Sector width of mean errors by heading, degrees.
pub(super) const SECTOR_DEG: f64 = 15.0;

/// Least number of values for a mean.
const MIN_SECTOR_VALUES: usize = 3;

/// Circular mean errors by heading, over the usable samples.
pub(super) fn means_by_heading(
    report_samples: &[ReportSample],
    quantity: impl Fn(&ReportSample) -> Option<f64>,
) -> Vec<Option<f64>> {
    let mut values_by_sector: [Vec<f64>; 24] = Default::default();
    for sample in report_samples.iter().filter(|sample| sample.is_usable) {
        let value = quantity(sample).filter(|value| value.is_finite());
        let Some((heading_deg, value)) = sample.heading_deg.zip(value) else { continue };
        let sector = (heading_deg / SECTOR_DEG).round().rem_euclid(24.0) as usize;
        values_by_sector[sector % 24].push(value);
    }
    let mean = |values: &Vec<f64>| mean_angle_deg(values.iter().copied()).filter(|_| values.len() >= MIN_SECTOR_VALUES);
    values_by_sector.iter().map(mean).collect()
}

impl CompassReport {
    /// Whether the compass has errors by heading.
    pub(super) const fn has_curves(&self) -> bool {
        !self.curves_before.is_empty() || !self.curves_after.is_empty()
    }

    /// Samples since the last change of hard iron or mounting.
    pub(super) fn samples_since_change(&self) -> &[ReportSample] {
        let from_s = self.last_change_s.unwrap_or(f64::NEG_INFINITY);
        self.samples.get(self.samples.partition_point(|sample| sample.time_s < from_s)..).unwrap_or_default()
    }

    /// Subtracts from all heading errors their mean over the usable samples since the last change of hard iron. Returns
    /// the means of the logged headings, of those with the parameters, and of the module's, degrees.
    pub(super) fn subtract_mean_errors(&mut self) -> [Option<f64>; 3] {
        let since = self.samples_since_change();
        let usable = |quantity: fn(&ReportSample) -> Option<f64>| {
            mean_angle_deg(since.iter().filter(|report_sample| report_sample.is_usable).filter_map(quantity))
        };
        let means = [
            usable(|report_sample| report_sample.error_before_deg),
            usable(|report_sample| report_sample.error_parameters_deg),
            usable(|report_sample| report_sample.error_deg),
        ];
        for report_sample in &mut self.samples {
            let demeaned = |error: Option<f64>, mean: Option<f64>| Some(wrap_180(error? - mean?));
            report_sample.error_before_deg = demeaned(report_sample.error_before_deg, means[0]);
            report_sample.error_parameters_deg = demeaned(report_sample.error_parameters_deg, means[1]);
            report_sample.error_deg = demeaned(report_sample.error_deg, means[2]);
        }
        means
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample_at(heading_deg: f64, error_deg: f64) -> ReportSample {
        ReportSample {
            heading_deg: Some(heading_deg),
            error_deg: Some(error_deg),
            is_usable: true,
            ..ReportSample::default()
        }
    }

    #[test]
    fn heading_sectors_are_centred_on_their_heading() {
        let mut report_samples: Vec<ReportSample> =
            [353.0, 0.0, 7.0].map(|heading_deg| sample_at(heading_deg, 2.0)).to_vec();
        report_samples.extend([8.0, 15.0, 22.0].map(|heading_deg| sample_at(heading_deg, 5.0)));
        // Two values are too few for a mean; unusable moments and NaN are ignored.
        report_samples.extend([90.0, 90.0].map(|heading_deg| sample_at(heading_deg, 9.0)));
        report_samples.push(ReportSample { is_usable: false, ..sample_at(90.0, 9.0) });
        report_samples.push(sample_at(90.0, f64::NAN));
        let means = means_by_heading(&report_samples, |report_sample| report_sample.error_deg);
        let sector_means: Vec<(usize, f64)> =
            means.iter().enumerate().filter_map(|(i, mean)| Some((i, (*mean)?))).collect();
        assert!(
            matches!(sector_means[..], [(0, a), (1, b)] if (a - 2.0).abs() < 1e-9 && (b - 5.0).abs() < 1e-9),
            "{sector_means:?}"
        );
    }

    #[test]
    fn the_mean_error_is_circular_and_of_usable_samples() {
        let mut compass_report =
            CompassReport { samples: vec![sample_at(0.0, 179.0), sample_at(0.0, -179.0)], ..CompassReport::default() };
        compass_report.samples.push(ReportSample { is_usable: false, ..sample_at(0.0, 0.0) });
        let [before, parameters, after] = compass_report.subtract_mean_errors();
        assert_eq!((before, parameters), (None, None));
        assert!((after.unwrap().abs() - 180.0).abs() < 1e-9);
        let errors: Vec<f64> =
            compass_report.samples.iter().map(|report_sample| report_sample.error_deg.unwrap()).collect();
        assert!((errors[0] + 1.0).abs() < 1e-9 && (errors[1] - 1.0).abs() < 1e-9, "{errors:?}");
    }

    #[test]
    fn the_mean_error_is_that_since_the_last_change() {
        let samples = [(1.0, 10.0), (2.0, 30.0), (3.0, 32.0)]
            .map(|(at_s, error_deg)| ReportSample { time_s: at_s, ..sample_at(0.0, error_deg) });
        let mut report =
            CompassReport { samples: samples.to_vec(), last_change_s: Some(1.5), ..CompassReport::default() };
        assert_eq!(report.samples_since_change().len(), 2);
        assert!((report.subtract_mean_errors()[2].unwrap() - 31.0).abs() < 1e-9);
        assert!((report.samples[0].error_deg.unwrap() + 21.0).abs() < 1e-9);
    }
}
