//! Facts about a compass, as names and values.

use autoswing::calibration::{AttitudeLatency, MotorCurrentInterference, Solution};

use super::flight_verdict::{CompassVerdict, Verdict};
use super::judgement::CompassAction;
use crate::numbers::format_number;
use crate::replay::evaluation::CompassEvaluation;
use crate::replay::field_change::HardIronChange;
use crate::replay::rows::RowCounts;

impl Verdict<'_> {
    /// Facts about a compass, name and value.
    pub fn key_facts(&self, compass: &CompassVerdict<'_>) -> Vec<[String; 2]> {
        let sent_percent = compass.sent_percent();
        let CompassVerdict { evaluation: compass, judgement, parameters, reading_checks, disagreement, .. } = compass;
        let mut facts: Vec<[String; 2]> = Vec::new();
        let mut add_fact = |name: &str, value: String| facts.push([name.to_owned(), value]);
        if let Some(is_used) = compass.is_used_for_heading {
            add_fact("autopilot", if is_used { "uses it for its heading" } else { "does not use it" }.to_owned());
        }
        if let Some(disagreement) = disagreement {
            add_fact("other compasses", disagreement.to_string());
        }
        for change in &compass.causes.hard_iron_changes {
            let HardIronChange { time_s, step_ut, heading_effect_deg, .. } = change;
            let [x, y, z] = step_ut.data.0[0];
            add_fact(
                "iron changed",
                format!(
                    "{} uT at {:.0} s of the log, most on {} (x {x:+.1}, y {y:+.1}, z {z:+.1}), up to {heading_effect_deg:.0} deg of \
                     heading; a drift shows as a step, too",
                    format_number(step_ut.norm(), 1),
                    time_s,
                    change.axis(),
                ),
            );
        }
        for load in &compass.causes.bending_loads {
            add_fact("what bends it", load.to_string());
        }
        match parameters {
            Ok(exported) if judgement.recommended_action == CompassAction::LoadParameters => {
                if let Some([from_s, to_s]) = exported.fitted_range_s {
                    add_fact("parameters", format!("fitted to {from_s:.0} to {to_s:.0} s of the log"));
                }
                let lost = format_number(exported.heading_loss_deg[0], 2);
                add_fact("lost with them", format!("{lost} deg RMS that these parameters cannot express"));
                exported.rms_by_terms_text().into_iter().for_each(|text| add_fact("choice of terms", text));
                exported.warnings.iter().for_each(|warning| add_fact("parameters", warning.clone()));
            }
            // Parameters that the judgement does not recommend, as those of a failed sensor, are not shown.
            Ok(_) => {}
            Err(no_parameters) => add_fact("parameters", format!("none: {no_parameters}")),
        }
        let checks: Vec<String> = reading_checks.iter().map(ToString::to_string).collect();
        add_fact("reading", checks.join("; "));
        if let Some(outcome) = module_outcome(compass) {
            add_fact("module", outcome);
        }
        if let Some(percent) = sent_percent {
            add_fact("module's headings", format!("in {} % of the flight", format_number(percent, 0)));
        }
        if let Some(solution) = compass.parameter_fit.solution() {
            add_solution_facts(solution, &mut add_fact);
        }
        let source = compass.latency.sigma_s.map_or_else(
            || "not estimated from this flight".to_owned(),
            |sigma_s| format!("estimated from this flight, sigma {} ms", format_number(sigma_s * 1e3, 0)),
        );
        let age = format_number(compass.latency.used_s * 1e3, 0);
        let rate_text = format_number(1.0 / compass.reading_interval_s, 1);
        if compass.row_counts.readings > 0 {
            add_fact("field", format!("{rate_text} times a second, {age} ms old at its time stamp ({source})"));
        }
        if let (Some((earth, is_valid)), Some(strength_ut)) =
            (&self.evaluation.earth_field, compass.parameter_fit.strength_ut())
        {
            let year = if *is_valid { "" } else { ", of another year" };
            let model = format_number(f64::from(earth.total_ut), 1);
            add_fact("strength", format!("{} uT, {model} by the field model{year}", format_number(strength_ut, 1)));
        }
        let rejected: Vec<String> =
            compass.row_counts.rejection_texts().into_iter().map(|rejected| format!("; {rejected}")).collect();
        let RowCounts { used, .. } = compass.row_counts;
        add_fact("rows", format!("{used} usable{}", rejected.concat()));
        facts
    }
}

fn add_solution_facts(solution: &Solution, add_fact: &mut dyn FnMut(&str, String)) {
    let Solution { calibration, quality, .. } = solution;
    let format_deg = |angle_deg: f32| format_number(f64::from(angle_deg), 2);
    let [rms, worst] = [quality.expected_rms_deg, quality.expected_worst_deg].map(format_deg);
    add_fact("expected error", format!("{rms} deg RMS, sigma {worst} at the worst heading"));
    let inclination_deg = f64::from(calibration.inclination_rad.to_degrees());
    add_fact("inclination", format!("{} deg", format_number(inclination_deg, 1)));
    if let Some(AttitudeLatency { estimate_s, sigma_s }) = quality.latency.filter(|_| calibration.uses_latency()) {
        let [estimate, sigma] = [estimate_s, sigma_s].map(|time_s| format_number(f64::from(time_s) * 1e3, 0));
        add_fact("attitude latency", format!("{estimate} ms more than the age of the field, sigma {sigma} ms"));
    }
    let MotorCurrentInterference { ut_per_a: [x, y, z], sigma_ut_per_a, mean_current_a, current_sigma_a } =
        calibration.motor_current;
    if current_sigma_a > 0.0 {
        let interference_text = if calibration.motor_current.is_applied() {
            format!("x {x:+.3}, y {y:+.3}, z {z:+.3} uT/A (sigma {sigma_ut_per_a:.3})")
        } else {
            format!("no interference that is certain (sigma {sigma_ut_per_a:.3} uT/A)")
        };
        add_fact(
            "motor current",
            format!("{interference_text}, of {mean_current_a:.1} A that varied by {current_sigma_a:.1} A"),
        );
    }
    // Residuals name no cause: latency, attitude lag in turns, and interference cause both kinds, by time and by bank.
    for (added_error_deg, reason) in [
        (solution.hard_iron_change.map(|finding| finding.added_error_deg), "change in time"),
        (solution.bank_scale_error.map(|finding| finding.added_error_deg), "depend on the bank"),
    ] {
        if let Some(added_deg) = added_error_deg.map(format_deg) {
            add_fact("residuals", format!("{added_deg} deg of the expected error, since they {reason}"));
        }
    }
    if let Some(advice) = solution.advice.as_ref().filter(|advice| advice.is_worthwhile()) {
        let [now, then] = [advice.expected_deg, advice.expected_after_deg].map(format_deg);
        add_fact(
            "least certain",
            format!(
                "{} deviation ({} deg)",
                advice.weakest_deviation.deviation_name(),
                format_deg(advice.weakest_deviation_deg)
            ),
        );
        add_fact("would help most", format!("{} ({now} to {then} deg)", advice.manoeuvre));
    }
}

/// Whether and when the module would have calibrated a compass, a phrase; none if no module is compared.
fn module_outcome(compass: &CompassEvaluation) -> Option<String> {
    let outcome = match (&compass.module_result.as_ref()?.outcome.acceptance, compass.calibration_time_s()) {
        (Err(refusal), _) => format!("would have been refused: {}: {refusal}", refusal.stable_code()),
        (Ok(()), Some(at_s)) => format!("would have calibrated itself at {} s of the log", format_number(at_s, 0)),
        (Ok(()), None) => "would have calibrated by a command at the end".to_owned(),
    };
    Some(outcome)
}
