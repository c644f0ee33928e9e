//! Report of a replayed log.

use autoswing::calibration::{Advice, Calibration, Solution};
use nalgebra::Vector3;

use super::model::{
    CalibratorComparison, CompassReport, DeviationCurve, EventMark, ReferenceInfo, Report, ReportOrigin, ReportSample,
    VerdictLine, means_by_heading,
};
use crate::numbers::format_number;
use crate::replay::evaluation::{CompassEvaluation, CorrectionSource, FlightEvaluation};
use crate::replay::heading_deg;
use crate::replay::parameter_export::field_by_exported_parameters;
use crate::replay::verdict::{CompassVerdict, Verdict};
use crate::replay::{HeadingRow, ReplayRow, solved_correction};
use crate::score::wrap_180;

/// Makes the report of a replayed log.
pub fn report_replay(verdict: &Verdict<'_>, log_name: &str, origin: &ReportOrigin) -> Report {
    let evaluation = verdict.evaluation;
    let lines = [
        ("command", origin.command_line.clone()),
        ("made by", format!("Autoswing {}", env!("CARGO_PKG_VERSION"))),
        ("log", verdict.log_description(log_name)),
    ];
    let rows = verdict.rms_by_correction_deg().into_iter().map(|(name, cells)| (name.to_owned(), cells));
    Report {
        title: format!("Flight {}", log_name.rsplit(['/', '\\']).next().unwrap_or(log_name)),
        verdicts: verdict.compasses_in_use_first().into_iter().map(verdict_line).collect(),
        log_warnings: verdict.log_warnings.clone(),
        reference: reference_info(evaluation),
        calibrators: CalibratorComparison {
            compasses: evaluation
                .compasses
                .iter()
                .map(|compass| format!("compass {}", compass.compass_number))
                .collect(),
            calibrator_rows: rows.collect(),
        },
        compasses: verdict
            .compasses_in_use_first()
            .into_iter()
            .map(|compass| compass_report(verdict, compass))
            .collect(),
        next_steps: verdict.next_steps(),
        correction_choices: correction_choices(verdict),
        parameter_files: verdict.parameter_files(),
        parameter_changes: verdict.parameter_changes(),
        origin: lines
            .into_iter()
            .filter(|(_, value)| !value.is_empty())
            .map(|(label, value)| [label.to_owned(), value])
            .chain(origin.settings.iter().cloned())
            .collect(),
        ..Report::default()
    }
}

fn correction_choices(verdict: &Verdict<'_>) -> String {
    let choice = |compass: &CompassVerdict<'_>| {
        let text = compass.parameters_to_load()?.rms_by_terms_text()?;
        Some(format!("Compass {}: {text}.", compass.evaluation.compass_number))
    };
    verdict.compasses.iter().filter_map(choice).collect::<Vec<_>>().join(" ")
}

fn verdict_line(compass: &CompassVerdict<'_>) -> VerdictLine {
    VerdictLine {
        compass_state: compass.state_in_use(),
        state_word: compass.state_word(),
        verdict_text: compass.summary_sentence(),
    }
}

fn reference_info(evaluation: &FlightEvaluation) -> ReferenceInfo {
    match &evaluation.reference {
        Some(reference) => ReferenceInfo {
            difference_name: reference.difference_name(),
            reference_name: reference.reference_name().to_owned(),
            accuracy_text: format!(
                "{}; the mean difference, which declination and mounting cause, is subtracted",
                reference.accuracy_description()
            ),
            card_constant_text: declination_deg(evaluation).map_or_else(
                || "The mean is subtracted: the declination there is not known.".to_owned(),
                |deg| format!("The declination, {} deg by the field model, is subtracted.", format_number(deg, 1)),
            ),
            is_accurate: reference.sigma_if_accurate_deg().is_some(),
        },
        None => ReferenceInfo {
            difference_name: "correction",
            reference_name: "the heading by the fit".to_owned(),
            accuracy_text: "the log has no reference heading; shown is the change by the fit".to_owned(),
            card_constant_text: String::new(),
            is_accurate: false,
        },
    }
}

fn compass_report(verdict: &Verdict<'_>, compass: &CompassVerdict<'_>) -> CompassReport {
    let Verdict { flight, evaluation, .. } = *verdict;
    let facts = verdict.key_facts(compass);
    let exported = compass.parameters_to_load();
    let compass_name = compass.compass_name.clone();
    let compass = compass.evaluation;
    let solution = compass.parameter_fit.solution();
    let parameters = exported.map(|export| field_by_exported_parameters(flight, export, verdict.parameter_format));
    let corrections = ShownCorrections {
        is_logged_field_corrected: logged_correction_source(compass) == CorrectionSource::Autopilot,
        field_by_parameters: parameters.as_ref().map(|field| field as &FieldOfRow<'_>),
        solution,
        has_reference: evaluation.reference.is_some(),
    };
    let module_headings = compass.module_result.as_ref().map_or(&[][..], |module| &module.headings);
    let samples = compass.rows.iter().enumerate();
    let samples = samples.map(|(i, row)| corrections.report_sample(row, module_headings.get(i)));
    let mut report = CompassReport {
        compass_name,
        facts,
        samples: samples.collect(),
        last_change_s: compass.parameter_fit.last_change_s,
        event_marks: event_marks(compass),
        before_correction_name: logged_correction_source(compass).source_name(),
        corrected_by: if exported.is_some() { "with the parameters to load" } else { "by the fit" },
        earth_field: solution.map(|s| expected_earth(evaluation, &s.calibration, exported.is_some())),
        advice: solution.and_then(|s| s.advice).filter(Advice::is_worthwhile).map(|advice| {
            let [now, then] =
                [advice.expected_deg, advice.expected_after_deg].map(|deg| format_number(f64::from(deg), 2));
            format!("{} ({now} to {then} deg)", advice.manoeuvre)
        }),
        coefficients: solution.map(|s| {
            let Calibration { w: [x, y, z], b_ut, .. } = s.calibration;
            [x, y, z, b_ut].map(|row| row.map(f64::from))
        }),
        ..CompassReport::default()
    };
    let means = report.subtract_mean_errors();
    report.magnetic_offset_deg = means[1].or(means[2]).unwrap_or(0.0);
    let means_words: Vec<String> = ["deg as logged", "deg with the parameters", "deg of the module"]
        .into_iter()
        .zip(means)
        .filter_map(|(name, mean)| Some(format!("{} {name}", format_number(mean?, 2))))
        .collect();
    if !means_words.is_empty() {
        let means_text = format!("{}; the declination is part of them", means_words.join(", "));
        report.facts.push(["means subtracted".to_owned(), means_text]);
    }
    let declination_deg = declination_deg(evaluation);
    let line = |name: &str, mean_deg: Option<f64>, of: fn(&ReportSample) -> Option<f64>| {
        let errors_deg = means_by_heading(report.samples_since_change(), of);
        let constant_deg = declination_deg.zip(mean_deg).map_or(0.0, |(declination, mean)| mean + declination);
        errors_deg.iter().any(Option::is_some).then(|| DeviationCurve {
            curve_name: name.to_owned(),
            errors_deg,
            constant_deg,
        })
    };
    let before = line(logged_correction_source(compass).source_name(), means[0], |sample| sample.error_before_deg);
    let after = line("with the parameters", means[1], |sample| sample.error_parameters_deg);
    (report.curves_before, report.curves_after) = (before.into_iter().collect(), after.into_iter().collect());
    report
}

/// Declination by the field model, degrees, for a reference from true north.
fn declination_deg(evaluation: &FlightEvaluation) -> Option<f64> {
    evaluation.reference.as_ref().filter(|reference| reference.counts_from_true_north())?;
    evaluation.declination_deg()
}

/// Strength, microtesla, and inclination, degrees, that a corrected field should have: exported parameters have the
/// scale of the field model, a calibration its own.
fn expected_earth(evaluation: &FlightEvaluation, calibration: &Calibration, is_exported: bool) -> [f64; 2] {
    let modelled = evaluation.earth_field.as_ref().filter(|_| is_exported).map(|(earth, _)| earth.total_ut);
    let inclination_deg = calibration.inclination_rad.to_degrees();
    [modelled.unwrap_or(calibration.total_ut), inclination_deg].map(f64::from)
}

fn logged_correction_source(compass: &CompassEvaluation) -> CorrectionSource {
    if compass.heading_scores.iter().any(|(source, _)| *source == CorrectionSource::Autopilot) {
        CorrectionSource::Autopilot
    } else {
        CorrectionSource::Uncorrected
    }
}

fn event_marks(compass: &CompassEvaluation) -> Vec<EventMark> {
    let calibrated =
        compass.calibration_time_s().zip(compass.module_result.as_ref()).map(|(time_s, module)| EventMark {
            time_s,
            event_name: if module.outcome.acceptance.is_ok() { "would have calibrated" } else { "would have solved" }
                .to_owned(),
        });
    let changed = compass.causes.hard_iron_changes.iter().map(|change| EventMark {
        time_s: change.time_s,
        event_name: format!("iron changed by {} uT", format_number(change.step_ut.norm(), 1)),
    });
    calibrated.into_iter().chain(changed).collect()
}

/// Corrected field of a row, body axes, microtesla.
type FieldOfRow<'a> = dyn Fn(&ReplayRow) -> Vector3<f64> + 'a;

/// Corrections whose fields and heading errors a report sample holds.
struct ShownCorrections<'a> {
    /// Whether the autopilot corrected the logged field.
    is_logged_field_corrected: bool,
    /// Field with the parameters to load.
    field_by_parameters: Option<&'a FieldOfRow<'a>>,
    /// The fit.
    solution: Option<&'a Solution>,
    has_reference: bool,
}

impl ShownCorrections<'_> {
    fn report_sample(&self, row: &ReplayRow, module: Option<&HeadingRow>) -> ReportSample {
        let raw = row.raw_field.ut.map(f64::from);
        let logged = row.logged_ut();
        let with_parameters = self.field_by_parameters.map(|field| field(row));
        let before_deg = heading_deg(row, if self.is_logged_field_corrected { logged } else { raw });
        let fitted = self.solution.map(|solution| row.corrected_field(&solved_correction(solution)));
        let fitted_deg = fitted.map(|field| heading_deg(row, field));
        let module_deg = module.map(|module| module.heading_deg).filter(|deg| deg.is_finite());
        let compared_deg = if self.has_reference { row.reference_deg } else { fitted_deg };
        let error_deg = |heading_deg: f64| Some(wrap_180(heading_deg - compared_deg?));
        ReportSample {
            time_s: row.t_s,
            heading_deg: row.reference_deg.or(fitted_deg).or(Some(before_deg)).map(|deg| deg.rem_euclid(360.0)),
            roll_deg: f64::from(row.attitude.roll_rad.to_degrees()),
            pitch_deg: f64::from(row.attitude.pitch_rad.to_degrees()),
            raw_ut: Some(raw.into()),
            logged_ut: self.is_logged_field_corrected.then(|| logged.into()),
            corrected_ut: with_parameters.or(fitted).map(Into::into),
            current_a: row.current_a.map(f64::from),
            error_before_deg: error_deg(before_deg),
            error_parameters_deg: with_parameters
                .filter(|_| self.has_reference)
                .and_then(|field| error_deg(heading_deg(row, field))),
            error_deg: module_deg.filter(|_| self.has_reference).and_then(error_deg),
            sigma_deg: module.map(|module| module.sigma_deg).filter(|deg| deg.is_finite()),
            is_usable: row.is_usable,
            is_heading_withheld: module.is_some_and(|module| module.status.is_err()),
        }
    }
}

#[cfg(test)]
mod tests;
