//! The verdict as a JSON object, which docs/json.md describes.

use autoswing::calibration::Solution;
use nalgebra::Vector3;
use serde_json::{Value, json};

use super::flight_verdict::{CompassVerdict, Verdict};
use super::judgement::CompassAction;
use crate::numbers::{coefficients_json, round_to};
use crate::replay::field_change::HardIronChange;
use crate::replay::gps_course::GpsCourseHeading;
use crate::replay::parameter_export::ExportedCorrection;
use crate::replay::result::{HeadingScore, ReplayResult};

/// Version of the JSON schema.
const SCHEMA_VERSION: u32 = 4;

impl Verdict<'_> {
    /// The verdict as a JSON object.
    pub fn json(&self) -> Value {
        let Self { flight, evaluation, .. } = self;
        let [from_s, to_s] = flight.time_range_s();
        json!({
            "schema": SCHEMA_VERSION,
            "verdict": self.summary_sentences().join(" "),
            "state": self.compass_in_use().map(|compass| compass.judgement.compass_state),
            "in_use": self.compass_in_use().map(|compass| compass.evaluation.compass_number),
            "log": {
                "format": flight.log_format.format_name(),
                "autopilot": flight.autopilot,
                "firmware": flight.firmware_name,
                "from_s": round_to(from_s, 3),
                "to_s": round_to(to_s, 3),
                "attitude_hz": round_to(1.0 / evaluation.attitude_interval_s, 2),
                "has_current": !flight.battery_current.is_empty(),
                "passed_over": flight.skipped_counts,
            },
            "reference": evaluation.reference.as_ref().map(|reference| json!({
                "name": reference.reference_name(),
                "is_accuracy": reference.measures_error(),
                "limits": reference.accuracy_description(),
                "course": reference.gps_course_solution().map(course_json),
            })),
            "field_model": evaluation.earth_field.as_ref().map(|(earth, is_valid)| json!({
                "total_ut": round_to(f64::from(earth.total_ut), 2),
                "inclination_deg": round_to(f64::from(earth.inclination_deg), 2),
                "declination_deg": earth.declination_deg.map(|deg| round_to(f64::from(deg), 2)),
                "is_of_that_day": is_valid,
            })),
            "notes": self.log_warnings,
            "compasses": self.compasses.iter().map(CompassVerdict::json).collect::<Vec<_>>(),
        })
    }
}

fn course_json(course: &GpsCourseHeading) -> Value {
    json!({
        "wind_m_s": round_to(course.wind_speed_m_s(), 2),
        "wind_from_deg": round_to(course.wind_from_deg(), 1),
        "wind_sigma_m_s": round_to(course.wind_sigma_m_s, 2),
        "airspeed_m_s": round_to(course.airspeed_m_s, 2),
        "scatter_m_s": round_to(course.scatter_m_s, 2),
        "sigma_deg": round_to(course.sigma_deg(), 2),
        "widest_gap_deg": course.widest_gap_deg,
    })
}

impl CompassVerdict<'_> {
    fn json(&self) -> Value {
        let compass = self.evaluation;
        let accuracy = self.judgement.logged_accuracy;
        json!({
            "compass": compass.compass_number,
            "is_used": compass.is_used_for_heading,
            "verdict": {
                "state": self.judgement.compass_state,
                "action": self.judgement.recommended_action,
                "reasons": self.judgement.reason_codes(),
            },
            "as_logged_rms_deg": accuracy.map(|accuracy| round_to(accuracy.rms_deg, 3)),
            "as_logged_by": accuracy.map(|accuracy| accuracy.evidence),
            "headings_flown": accuracy.map(|accuracy| accuracy.sector_count),
            "differs_from": self.disagreement.map(|disagreement| json!({
                "compasses": disagreement.agreeing,
                "deg": round_to(disagreement.difference_deg, 1),
            })),
            "field_hz": round_to(1.0 / compass.reading_interval_s, 2),
            "field_age_ms": round_to(compass.latency.used_s * 1e3, 1),
            "field_age_sigma_ms": compass.latency.sigma_s.map(|s| round_to(s * 1e3, 1)),
            "field_ut": compass.parameter_fit.strength_ut().map(|ut| round_to(ut, 2)),
            "rows": compass.row_counts,
            "fit": compass.parameter_fit.solution().map(solution_json),
            "module": compass.module_result.as_ref().map(|result| self.module_json(result)),
            "headings": compass.heading_scores.iter().map(|(correction_source, score)| json!({
                "by": correction_source.source_name(),
                "against_reference": score.as_ref().map(score_json),
            })).collect::<Vec<_>>(),
            "changes": compass.causes.hard_iron_changes.iter().map(change_json).collect::<Vec<_>>(),
            "bent_by": compass.causes.bending_loads.iter().map(|load| json!({
                "code": load.cause.stable_code(),
                "words": load.to_string(),
                "numbers": load.cause.source_numbers(),
                "at_a": load.cause.at_current_a().map(|amperes| round_to(amperes, 1)),
                "period_s": load.cause.period_s().map(|period_s| round_to(period_s, 3)),
                "ut": round_to(load.size_ut, 2),
                "deg": round_to(load.heading_effect_deg, 1),
                "sigmas": round_to(load.sigmas, 1),
            })).collect::<Vec<_>>(),
            "checks": self.reading_checks.iter().map(|check| json!({
                "code": check.meaning,
                "outcome": check.outcome.stable_code(),
                "words": check.outcome.finding(),
            })).collect::<Vec<_>>(),
            "parameters": (self.judgement.recommended_action == CompassAction::LoadParameters)
                .then_some(self.parameters.as_ref().ok().map(parameters_json)),
        })
    }

    fn module_json(&self, result: &ReplayResult) -> Value {
        let refusal = result.outcome.acceptance.as_ref().err();
        json!({
            "accepted": refusal.is_none(),
            "refusal": refusal.map(|refusal| json!({ "code": refusal.stable_code(), "words": refusal.to_string() })),
            "calibrated_s": self.evaluation.calibration_time_s().map(|s| round_to(s, 1)),
            "sent_percent": self.sent_percent().map(|percent| round_to(percent, 1)),
            "samples": result.outcome.fitted_count,
            "fit": result.outcome.solution.as_ref().map(solution_json),
            "smooth": result.smoothed_score.as_ref().map(score_json),
        })
    }
}

fn change_json(change: &HardIronChange) -> Value {
    let rounded = |vector: &Vector3<f64>| vector.map(|axis| round_to(axis, 2)).data.0[0];
    json!({
        "at_s": round_to(change.time_s, 1),
        "ut": rounded(&change.step_ut),
        "sigma_ut": rounded(&change.sigma_ut),
        "bend_deg": round_to(change.heading_effect_deg, 1),
    })
}

fn solution_json(solution: &Solution) -> Value {
    let Solution { calibration, quality, .. } = solution;
    let rounded = |value: f32, decimals: i32| round_to(f64::from(value), decimals);
    let milliseconds = |seconds: f32| round_to(f64::from(seconds) * 1e3, 1);
    let current = Some(calibration.motor_current).filter(|current| current.current_sigma_a > 0.0);
    json!({
        "method": quality.method.method_name(),
        "coefficients": coefficients_json(calibration),
        "inclination_deg": rounded(calibration.inclination_rad.to_degrees(), 2),
        "expected_rms_deg": rounded(quality.expected_rms_deg, 3),
        "iron_changed_ut": solution.hard_iron_change.map(|finding| rounded(finding.violation.size_ut, 2)),
        "bank_read": solution.bank_scale_error.map(|finding| rounded(finding.violation.reported_bank_ratio, 3)),
        "latency_ms": milliseconds(calibration.latency_s),
        "latency_found_ms": quality.latency.map(|latency| milliseconds(latency.estimate_s)),
        "latency_sigma_ms": quality.latency.map(|latency| milliseconds(latency.sigma_s)),
        "by_current": current.map(|current| json!({
            "ut_per_a": current.ut_per_a.map(|axis| rounded(axis, 4)),
            "sigma_ut_per_a": rounded(current.sigma_ut_per_a, 4),
            "mean_a": rounded(current.mean_current_a, 2),
            "spread_a": rounded(current.current_sigma_a, 2),
        })),
    })
}

fn score_json(score: &HeadingScore) -> Value {
    let has_sigma = score.within_sigmas_percent[1] > 0.0;
    json!({
        "heading_rms_deg": round_to(score.rms_deg, 3),
        "heading_mean_deg": round_to(score.mean_deg, 3),
        "rows": score.row_count,
        "within_one_sigma_percent": has_sigma.then(|| round_to(score.within_sigmas_percent[0], 1)),
        "within_two_sigma_percent": has_sigma.then(|| round_to(score.within_sigmas_percent[1], 1)),
    })
}

fn parameters_json(exported: &ExportedCorrection) -> Value {
    json!({
        "matrix": exported.correction.matrix.transpose().iter().map(|number| round_to(*number, 5)).collect::<Vec<_>>(),
        "offsets_ut": exported.correction.hard_iron_ut.iter().map(|number| round_to(-number, 3)).collect::<Vec<_>>(),
        "lost_rms_deg": round_to(exported.heading_loss_deg[0], 3),
        "lost_mean_deg": round_to(exported.heading_loss_deg[1], 3),
        "heading_rms_deg": exported.held_back_score.map(|score| round_to(score.rms_deg, 3)),
        "heading_rms_all_deg": exported.rms_by_terms_deg.map(|[all, _]| round_to(all, 3)),
        "heading_rms_offsets_deg": exported.rms_by_terms_deg.map(|[_, offsets]| round_to(offsets, 3)),
        "is_estimate": exported.held_back_score.map(|score| score.is_estimate),
        "rows_from_s": exported.fitted_range_s.map(|[from_s, _]| round_to(from_s, 1)),
        "rows_to_s": exported.fitted_range_s.map(|[_, to_s]| round_to(to_s, 1)),
        "warnings": exported.warnings,
    })
}
