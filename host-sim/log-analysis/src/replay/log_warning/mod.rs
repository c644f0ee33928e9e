//! Warnings about a log, each a sentence.

use super::data_loss;
use super::evaluation::{CompassEvaluation, FlightEvaluation};
use super::gps_course::{GpsCourseHeading, GpsCourseRejection};
use super::rows::{RowCounts, strength_ut};
use crate::log::{
    AttitudeView, AutopilotKind, LogFormat, LoggedFlight, missing_ardupilot_parameters, mounting_parameter_changes,
};
use crate::replay::reference::ReferenceHeading;
use crate::replay::row_headings::is_monitored;

/// Lag of the attitude behind the field that is reported, seconds: 3 deg of heading at 30 deg/s.
const LATE_ATTITUDE_S: f64 = 0.1;

/// All warnings about a log and its evaluation.
pub fn warnings_of_flight(flight: &LoggedFlight, evaluation: &FlightEvaluation) -> Vec<String> {
    let compasses = &evaluation.compasses;
    let mut warnings = warnings_of_attitude(flight, evaluation);
    for compass in compasses {
        let failure = compass.sensor_failure.as_ref();
        warnings.extend(failure.map(|failure| format!("compass {}: {failure}", compass.compass_number)));
        warnings.extend(spikes(flight, compass));
    }
    let oldest_s = compasses.iter().filter(|compass| compass.latency.sigma_s.is_some());
    let oldest_s = oldest_s.map(|compass| compass.latency.used_s).fold(f64::INFINITY, f64::min);
    warnings.extend((oldest_s < -LATE_ATTITUDE_S).then(|| {
        format!(
            "the attitude is logged {:.0} ms later than the field; the comparison allows for it, but a module that receives \
             it so late does not",
            -oldest_s * 1e3
        )
    }));
    warnings.extend(mounting_changes(flight, evaluation));
    warnings.extend(magnetometer_rejection(flight));
    warnings.extend(autopilot_texts(flight));
    warnings.extend(first_and_others(&flight.autopilot_component_ids).map(|(own, others)| {
        format!("several autopilots of the same system on the link: component {own}, received first, is evaluated, not {others}")
    }));
    warnings.extend(contradicted_attitudes(compasses));
    warnings.extend(first_and_others(&flight.autopilot_system_ids).map(|(own, others)| {
        format!("several vehicles on the link: system {own} is evaluated; --system selects another ({others})")
    }));
    warnings.extend(skipped_items(flight));
    warnings.extend(warnings_of_references(flight, evaluation));
    warnings.extend(missing_parameters(flight, compasses));
    warnings
}

/// Warnings about attitude, body rates and the rate of the field.
fn warnings_of_attitude(flight: &LoggedFlight, evaluation: &FlightEvaluation) -> Vec<String> {
    let rates = flight.rates_problem.map(|problem| {
        let is_repaired = flight.has_measured_rates;
        let use_text =
            if is_repaired { "; corrected by the attitude" } else { ": headings are without smoothing and monitor" };
        format!("{problem}{use_text}")
    });
    let fallback = flight.fallback_attitude_message;
    let fallback =
        fallback.map(|source| format!("the autopilot's own attitude is not logged; that of {source} is used"));
    let without_time = (flight.rows_without_time > 0).then(|| {
        "field rows carry no time (logs until 2014); each has that of the message before it, up to a tenth of a second early"
            .to_owned()
    });
    let tilt_deg = largest_tilt_deg(flight).filter(|deg| flight.log_format == LogFormat::Csv && *deg < 2.0);
    let tilt =
        tilt_deg.map(|deg| format!("the attitude tilts by {deg:.2} deg at most: radians in columns of degrees?"));
    let slowest_s = evaluation.compasses.iter().map(|compass| compass.reading_interval_s).fold(0.0, f64::max);
    let field = (!is_monitored(slowest_s)).then(|| {
        format!(
            "the field is logged {:.1} times a second, too slowly for the monitor (ten times): headings are without its \
             adjustments",
            1.0 / slowest_s
        )
    });
    let attitude_s = evaluation.attitude_interval_s;
    let attitude = (attitude_s > data_loss::SLOW_ATTITUDE_INTERVAL_S).then(|| {
        format!(
            "the attitude is logged {:.1} times a second; below 3 Hz its interpolation is unreliable",
            1.0 / attitude_s
        )
    });
    let lost = data_loss::excessive_rate_loss(flight).map(|fraction| {
        format!(
            "{:.0} % of the body rates are lost: headings are without smoothing and monitor, and their sigma does not adapt; \
             it is too small where the flight is rougher than the fitted samples",
            fraction * 100.0
        )
    });
    [rates, fallback, without_time, tilt, field, attitude, lost].into_iter().flatten().collect()
}

/// Rejection of the magnetometer while armed, if it is more than occasional.
fn magnetometer_rejection(flight: &LoggedFlight) -> Option<String> {
    const MIN_REJECTED_PERCENT: f64 = 1.0;
    let in_flight = flight.magnetometer_test_ratio.rows().iter().filter(|row| flight.is_armed(row.t_s) != Some(false));
    let is_rejected: Vec<bool> = in_flight.map(|row| row.row_values[0] > 1.0).collect();
    let rejected_count = is_rejected.iter().filter(|is_rejected| **is_rejected).count();
    let percent = 100.0 * rejected_count as f64 / is_rejected.len().max(1) as f64;
    (percent >= MIN_REJECTED_PERCENT)
        .then(|| format!("the autopilot's own filter rejected the magnetometer in {percent:.0} % of the flight"))
}

fn autopilot_texts(flight: &LoggedFlight) -> Option<String> {
    let texts = flight.compass_texts.iter().map(|(t_s, text)| format!("\"{text}\" at {t_s:.0} s"));
    let texts: Vec<String> = texts.collect();
    (!texts.is_empty()).then(|| format!("the autopilot reported {}", texts.join(", ")))
}

fn spikes(flight: &LoggedFlight, compass: &CompassEvaluation) -> Option<String> {
    let CompassEvaluation { compass_number, row_counts: RowCounts { spikes, .. }, .. } = *compass;
    let logged = flight.compass(compass_number)?;
    let largest_ut = logged.field.rows().iter().map(strength_ut).fold(0.0, f64::max);
    (spikes > 0).then(|| {
        format!("compass {compass_number}: {spikes} reading(s) of up to {largest_ut:.0} uT are spikes, and not used")
    })
}

/// Splits a list of numbers into the first and the others; `None` without others.
fn first_and_others(numbers: &[u8]) -> Option<(u8, String)> {
    let (own, others) = numbers.split_first()?;
    (!others.is_empty()).then(|| (*own, others.iter().map(u8::to_string).collect::<Vec<_>>().join(", ")))
}

fn contradicted_attitudes(compasses: &[CompassEvaluation]) -> Vec<String> {
    let percent = |count: fn(&RowCounts) -> usize| {
        let of_compass =
            |compass: &CompassEvaluation| count(&compass.row_counts) * 100 / compass.row_counts.readings.max(1);
        compasses.iter().map(of_compass).max().unwrap_or(0)
    };
    let off_simulator = percent(|counts| counts.off_simulator);
    let contradicting = percent(|counts| counts.contradicting_attitude);
    let off_simulator = (off_simulator > 0).then(|| {
        format!("the logged attitude differs from the simulator's by over 5 deg in {off_simulator} % of the log, which is not used")
    });
    let contradicting = (contradicting > 20).then(|| {
        format!(
            "the attitude contradicts the body rates in {contradicting} % of the log, which is not used: are the rates in \
             another unit, or of other axes?"
        )
    });
    off_simulator.into_iter().chain(contradicting).collect()
}

fn skipped_items(flight: &LoggedFlight) -> Vec<String> {
    let counts = &flight.skipped_counts;
    let restarts = counts.restarts;
    let restarts = (restarts > 0)
        .then(|| format!("the autopilot restarted {restarts} time(s) in the log; time goes on after each"));
    let skipped = [
        (counts.garbage, "bytes or lines that were not recognised"),
        (counts.bad_times, "messages with an invalid time"),
        (counts.rejected_readings, "readings out of range, or marked unhealthy by the autopilot"),
        (counts.current_dropouts, "currents of 0 or -1 A between usual ones"),
        (counts.unassigned_fields, "readings of sensors without device id (SCALED_IMU)"),
    ];
    let skipped = skipped.into_iter().filter(|(count, _)| *count > 0);
    restarts.into_iter().chain(skipped.map(|(count, items)| format!("skipped: {count} {items}"))).collect()
}

/// Warnings about currents, reference headings and the view of the attitude.
fn warnings_of_references(flight: &LoggedFlight, evaluation: &FlightEvaluation) -> Vec<String> {
    let mut warnings = Vec::new();
    let mut add_if = |applies: bool, text: &str| warnings.extend(applies.then(|| text.to_owned()));
    let compensation = flight.parameters.last_value("COMPASS_MOTCT").map(f64::round);
    add_if(
        flight.autopilot == AutopilotKind::ArduPilot && compensation == Some(1.0),
        "the autopilot compensates by throttle; interference is estimated only from a logged current",
    );
    if !evaluation.reference.as_ref().is_some_and(ReferenceHeading::measures_error)
        && let Err(rejection) = GpsCourseHeading::from_flight(flight)
    {
        let text = format!("GPS course gives no heading here: {}", rejection.description());
        add_if(rejection != GpsCourseRejection::NotLogged, &text);
    }
    add_if(
        flight.battery_current.is_empty(),
        "no current is logged: motor-current interference is neither estimated nor part of the expected error",
    );
    add_if(flight.is_current_negated, "the current is negative throughout; its size is used");
    for (name, latency_s) in &flight.heading_latencies {
        let text = format!("{name} is {:.0} ms late by the body rates; this is allowed for", latency_s * 1e3);
        add_if(true, &text);
    }
    let view = match flight.attitude_view {
        AttitudeView::BodyForVtol(message) => message,
        AttitudeView::BodyByModes => "the body by flight modes and trims",
        AttitudeView::Body | AttitudeView::Vtol(_) => return warnings,
    };
    warnings.push(format!(
        "the attitude is that of {view}: the autopilot's is the view of the VTOL modes, not that of the body in hover"
    ));
    warnings
}

fn missing_parameters(flight: &LoggedFlight, compasses: &[CompassEvaluation]) -> Option<String> {
    let missing = compasses.iter().flat_map(|compass| missing_ardupilot_parameters(flight, compass.compass_number));
    let missing: Vec<String> = missing.collect();
    if !missing.is_empty() {
        return Some(format!("parameters that are not in the log, assumed unset: {}", missing.join(", ")));
    }
    let is_ardupilot = flight.autopilot == AutopilotKind::ArduPilot;
    (is_ardupilot && flight.parameters.last_value("COMPASS_OFS_X").is_none())
        .then(|| "the parameters are not in the log: the autopilot's correction could not be undone".to_owned())
}

fn mounting_changes(flight: &LoggedFlight, evaluation: &FlightEvaluation) -> Option<String> {
    let changes =
        evaluation.compasses.iter().flat_map(|compass| mounting_parameter_changes(flight, compass.compass_number));
    let mut changes: Vec<(String, f64)> = changes.collect();
    // The board's rotation affects every compass.
    changes.sort_by(|(a, _), (b, _)| a.cmp(b));
    changes.dedup();
    let texts: Vec<String> = changes.iter().map(|(name, at_s)| format!("{name} at {at_s:.0} s")).collect();
    (!texts.is_empty()).then(|| {
        format!(
            "mountings were changed in the log: {}; no calibration fits the rows both before and after a change",
            texts.join(", ")
        )
    })
}

fn largest_tilt_deg(flight: &LoggedFlight) -> Option<f64> {
    let tilts =
        flight.attitude.rows().iter().map(|row| f64::from(row.row_values[0].abs().max(row.row_values[1].abs())));
    tilts.reduce(f64::max).map(f64::to_degrees)
}

#[cfg(test)]
mod tests;
