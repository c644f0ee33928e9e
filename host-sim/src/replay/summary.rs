//! Verdict of a replay as text and JSON. docs/your-flight.md describes the JSON object, which only grows.

use std::collections::BTreeSet;

use autoswing::calibration::MotorCurrentInterference;
use serde::Serialize;
use serde_json::{Value, json};

use super::evaluation::{CompassEvaluation, CorrectionSource, FlightEvaluation, ScoredCorrection};
use super::gps_course::{GpsCourseHeading, GpsCourseRejection};
use super::{HeadingScore, ReferenceHeading, ReplayResult, RowCounts, data_loss, frozen_field, is_monitored};
use crate::log::{Autopilot, Flight, LogFormat, missing_ardupilot_parameters, mounting_parameter_changes};

/// Version of the JSON schema.
const SCHEMA: u32 = 2;

/// Largest plausible ratio between field strength and model.
const PLAUSIBLE: f64 = 1.35;

/// Fewer rows than this are no flight (2 s at 10 Hz).
const NO_FLIGHT: usize = 20;

/// One-line verdict: whether, when and how accurately the module would have calibrated.
#[must_use]
pub fn verdict_line(judged: &FlightEvaluation) -> String {
    let all = judged.compasses.len();
    let accepted: Vec<&CompassEvaluation> =
        judged.compasses.iter().filter(|compass| compass.module.accepted.is_ok()).collect();
    let expected =
        |compass: &&CompassEvaluation| compass.module.solution.as_ref().map(|s| f64::from(s.quality.expected_rms_deg));
    let times: Vec<f64> = accepted.iter().filter_map(|compass| compass.calibrated_s()).collect();
    let worst = accepted.iter().filter_map(expected).fold(0.0, f64::max);
    let slow = slow_attitude(judged);
    let which = match (accepted.len(), all) {
        (0, _) => {
            let why = |compass: &CompassEvaluation| why_refused(compass, slow.as_deref());
            let nearest = nearest(&judged.compasses);
            let nearest_why = nearest.map_or_else(String::new, why);
            let whose = match nearest {
                Some(_) if all > 1 && judged.compasses.iter().all(|compass| why(compass) == nearest_why) => {
                    format!(" each of {all} compasses")
                }
                Some(compass) if all > 1 => format!(" each of {all} compasses; number {} came nearest", compass.number),
                _ => String::new(),
            };
            return format!("the module would have refused{whose}: {nearest_why}");
        }
        (1, 1) => "the module would have calibrated".to_owned(),
        (some, _) if some == all => format!("the module would have calibrated each of {all} compasses"),
        (some, _) => {
            let numbers: Vec<String> = accepted.iter().map(|compass| compass.number.to_string()).collect();
            format!("the module would have calibrated {some} of {all} compasses (number {})", numbers.join(", "))
        }
    };
    let when = match (times.iter().copied().reduce(f64::min), times.iter().copied().reduce(f64::max)) {
        (Some(first), Some(last)) if times.len() == accepted.len() && last - first < 1.5 => {
            format!(" by itself, {first:.0} s into the flight")
        }
        (Some(first), Some(last)) if times.len() == accepted.len() => {
            format!(" by itself, {first:.0} to {last:.0} s into the flight")
        }
        _ => " when asked to at the end of the flight".to_owned(),
    };
    let but = slow.map_or_else(String::new, |slow| format!("; but {slow}"));
    format!("{which}{when}, expecting {worst:.1} deg{but}")
}

/// The rejected compass closest to a calibration.
fn nearest(compasses: &[CompassEvaluation]) -> Option<&CompassEvaluation> {
    let expected_deg = |compass: &CompassEvaluation| {
        compass.module.solution.as_ref().map_or(f64::INFINITY, |s| f64::from(s.quality.expected_rms_deg))
    };
    // Compasses that are unused or hardly logged rank last.
    let is_out = |compass: &CompassEvaluation| (compass.counts.used < NO_FLIGHT, compass.is_used == Some(false));
    compasses.iter().min_by(|a, b| {
        let by_rows = || b.counts.used.cmp(&a.counts.used);
        is_out(a).cmp(&is_out(b)).then_with(|| expected_deg(a).total_cmp(&expected_deg(b))).then_with(by_rows)
    })
}

fn slow_attitude(judged: &FlightEvaluation) -> Option<String> {
    // 3 Hz with a margin for jitter.
    const SLOW_S: f64 = 0.34;
    let every_s = judged.attitude_interval_s;
    (every_s > SLOW_S).then(|| {
        format!("the attitude comes {:.1} times a second, and below 3 Hz what lies between is a guess", 1.0 / every_s)
    })
}

/// Cause of a refusal: too few usable rows, else the module's reason.
fn why_refused(judged: &CompassEvaluation, slow: Option<&str>) -> String {
    let refusal = judged.refusal().map_or_else(String::new, |why| why.to_string());
    let RowCounts { readings, used, .. } = judged.counts;
    if readings < NO_FLIGHT {
        return format!("the log holds {readings} readings of the field, which is no flight");
    }
    if used < NO_FLIGHT {
        let (most, why) = judged.counts.main_rejection();
        let slow = slow.map_or_else(String::new, |slow| format!("; {slow}"));
        return format!("of {readings} readings of the field {used} may be used, {most} are {why}{slow}");
    }
    slow.map_or_else(|| refusal.clone(), |slow| format!("{refusal}; and {slow}"))
}

impl CompassEvaluation {
    /// Time to calibration from the first usable row, seconds; none without an automatic end.
    #[must_use]
    pub fn calibrated_s(&self) -> Option<f64> {
        let first_s = self.rows.first()?.t_s;
        let used_s = self.rows.iter().find(|row| row.usable)?.t_s;
        Some(self.module.ended_s? + first_s - used_s)
    }

    /// The correction from one source.
    #[must_use]
    pub fn correction_from(&self, by: CorrectionSource) -> Option<&ScoredCorrection> {
        self.corrections.iter().find(|correction| correction.source == by)
    }
}

/// Warnings about the log as a whole.
#[must_use]
pub fn notes(flight: &Flight, judged: &FlightEvaluation) -> Vec<String> {
    let mut notes = Vec::new();
    if flight.rates.is_empty() {
        notes.push(
            "no body rates are logged: attitude is interpolated on straight lines, and nothing is smoothed".into(),
        );
    }
    if let Some(from) = flight.attitude_source {
        notes.push(format!("the autopilot's own attitude is not logged: {from}'s is taken"));
    }
    if flight.rows_without_time > 0 {
        notes.push(
            "rows of the field carry no time, as it was until 2014: that of the last message that has one is taken, which may be \
             a tenth of a second earlier"
                .into(),
        );
    }
    // Native formats define their units.
    let is_table = flight.format == LogFormat::Csv;
    if let Some(most_deg) = most_tilt_deg(flight).filter(|most_deg| is_table && *most_deg < 2.0) {
        notes
            .push(format!("the attitude tilts by {most_deg:.2} deg at most: are these radians in columns of degrees?"));
    }
    let slowest_s = judged.compasses.iter().map(|compass| compass.reading_interval_s).fold(0.0, f64::max);
    if !is_monitored(slowest_s) {
        notes.push(format!(
            "the field comes {:.1} times a second; the module reads its own ten times, so what it adjusts in flight is left \
             out of its headings",
            1.0 / slowest_s
        ));
    }
    if let Some(share) = data_loss::excessive_rate_loss(flight) {
        notes.push(format!(
            "{:.0} % of the body rates are lost: what the module smooths and adjusts by them in flight is left out of its \
             headings, and so is what it learns of scatter: where the flight is rougher than what was fitted to, their sigma is \
             too small",
            share * 100.0
        ));
    }
    for compass in &judged.compasses {
        notes.extend(strength_note(judged, compass, flight.format == LogFormat::Csv));
        notes.extend(frozen_field::sensor_failure_note(flight, compass));
    }
    notes.extend(turned_note(flight, judged));
    notes.extend(beside_note(flight));
    let contradicted = |compass: &&CompassEvaluation| compass.counts.unsettled * 5 > compass.counts.readings;
    if let Some(compass) = judged.compasses.iter().find(contradicted) {
        notes.push(format!(
            "the attitude changes otherwise than the body rates say in {} % of the log, which is left out: are the rates in \
             another unit, or of other axes?",
            compass.counts.unsettled * 100 / compass.counts.readings.max(1)
        ));
    }
    let counts = &flight.counts;
    if let [own, others @ ..] = flight.systems.as_slice()
        && !others.is_empty()
    {
        let others: Vec<String> = others.iter().map(u8::to_string).collect();
        notes.push(format!(
            "several vehicles on the link: system {own} is judged; --system judges another ({})",
            others.join(", ")
        ));
    }
    if counts.restarts > 0 {
        notes.push(format!("the autopilot restarted {} time(s) in the file; time goes on after each", counts.restarts));
    }
    for (number, what) in [
        (counts.garbage, "bytes or lines that belong to nothing"),
        (counts.bad_times, "messages whose time is nonsense"),
        (counts.unhealthy, "readings that the autopilot called unhealthy, or that are no field"),
    ] {
        if number > 0 {
            notes.push(format!("passed over: {number} {what}"));
        }
    }
    if flight.autopilot == Autopilot::ArduPilot && flight.parameters.last("COMPASS_MOTCT").map(f64::round) == Some(1.0)
    {
        notes.push(
            "the autopilot compensates by throttle; interference is estimated only from a logged current".to_owned(),
        );
    }
    notes.extend(course_note(flight, judged));
    if flight.current.is_empty() {
        notes.push(
            "no current is logged: motor-current interference is neither estimated nor part of the expected error"
                .to_owned(),
        );
    }
    let missing =
        judged.compasses.iter().flat_map(|compass| missing_ardupilot_parameters(&flight.parameters, compass.number));
    let missing: Vec<String> = missing.collect();
    if !missing.is_empty() {
        notes.push(format!("parameters that are not in the log, taken as if never set: {}", missing.join(", ")));
    }
    if flight.autopilot == Autopilot::ArduPilot
        && flight.parameters.last("COMPASS_OFS_X").is_none()
        && missing.is_empty()
    {
        notes.push("the parameters are not in the log: what the autopilot had applied could not be undone".to_owned());
    }
    notes
}

fn turned_note(flight: &Flight, judged: &FlightEvaluation) -> Option<String> {
    let [from_s, _] = flight.time_range_s();
    let turned = judged.compasses.iter().flat_map(|compass| mounting_parameter_changes(flight, compass.number));
    // The board's rotation affects every compass.
    let each: BTreeSet<String> = turned.map(|(name, at_s)| format!("{name} after {:.0} s", at_s - from_s)).collect();
    (!each.is_empty()).then(|| {
        format!(
            "mountings were changed in the log: {}; what was logged before is in other axes than what was logged after, and no \
             calibration holds for both",
            each.into_iter().collect::<Vec<_>>().join(", ")
        )
    })
}

fn beside_note(flight: &Flight) -> Option<String> {
    let [own, others @ ..] = flight.components.as_slice() else { return None };
    let others: Vec<String> = others.iter().map(u8::to_string).collect();
    (!others.is_empty()).then(|| {
        format!(
            "more than one autopilot of the same system on the link: component {own} is judged, which was heard first, not {}",
            others.join(", ")
        )
    })
}

/// Why GPS course is not the reference.
fn course_note(flight: &Flight, judged: &FlightEvaluation) -> Option<String> {
    if judged.reference.as_ref().is_some_and(ReferenceHeading::is_accuracy) {
        return None;
    }
    let why = GpsCourseHeading::from_flight(flight).err().filter(|why| *why != GpsCourseRejection::NotLogged)?;
    Some(format!("GPS course gives no heading here: {}", why.description()))
}

fn most_tilt_deg(flight: &Flight) -> Option<f64> {
    let tilts = flight.attitude.rows().iter().map(|row| f64::from(row.values[0].abs().max(row.values[1].abs())));
    tilts.reduce(f64::max).map(f64::to_degrees)
}

/// Warning about an implausible field strength by the sphere fit, against the field model or, without a place, the
/// Earth's range.
fn strength_note(judged: &FlightEvaluation, compass: &CompassEvaluation, is_table: bool) -> Option<String> {
    /// Weakest and strongest Earth field, microtesla.
    const EARTH_UT: [f64; 2] = [22.0, 67.0];
    let [least, most, found] = match &judged.earth {
        Some((earth, _)) => [f64::from(earth.total_ut), f64::from(earth.total_ut), compass.radius_ut?],
        None => [EARTH_UT[0], EARTH_UT[1], compass.radius_ut?],
    };
    let is_in = |factor: f64| (least * factor / PLAUSIBLE..=most * factor * PLAUSIBLE).contains(&found);
    if is_in(1.0) {
        return None;
    }
    let guess = [
        (10.0, "milligauss read as microtesla"),
        (0.1, "microtesla read as milligauss"),
        (100.0, "nanotesla read as milligauss"),
        (1000.0, "nanotesla read as microtesla"),
        (0.01, "gauss read as microtesla"),
        (0.001, "gauss read as milligauss"),
    ]
    .into_iter()
    .find(|&(factor, _)| is_table && is_in(factor))
    .map_or(
        if is_table { "another unit, or a poor sensor" } else { "a poor sensor, or little was flown" },
        |(_, words)| words,
    );
    let number = compass.number;
    let expected = if judged.earth.is_some() {
        format!("by the field model {most:.1}")
    } else {
        format!("the Earth's is {least:.0} to {most:.0}")
    };
    // In a wrong unit the value may be small.
    let decimals = if found < 1.0 { 4 } else { 1 };
    Some(format!("compass {number}: the field is {found:.decimals$} uT strong, {expected}: {guess}"))
}

/// The evaluation as a JSON object.
#[must_use]
pub fn json(flight: &Flight, judged: &FlightEvaluation, parameters: &dyn Fn(&CompassEvaluation) -> Value) -> Value {
    let [from_s, to_s] = flight.time_range_s();
    json!({
        "schema": SCHEMA,
        "verdict": verdict_line(judged),
        "accepted": judged.compasses.iter().any(|compass| compass.module.accepted.is_ok()),
        "log": {
            "format": flight.format.name(),
            "autopilot": flight.autopilot,
            "firmware": flight.firmware,
            "from_s": rounded(from_s, 3),
            "to_s": rounded(to_s, 3),
            "attitude_hz": rounded(1.0 / judged.attitude_interval_s, 2),
            "has_current": !flight.current.is_empty(),
            "passed_over": flight.counts,
        },
        "reference": judged.reference.as_ref().map(|reference| json!({
            "name": reference.name(),
            "is_accuracy": reference.is_accuracy(),
            "limits": reference.limits(),
            "course": reference.course().map(course),
        })),
        "field_model": judged.earth.as_ref().map(|(earth, is_valid)| json!({
            "total_ut": rounded(f64::from(earth.total_ut), 2),
            "inclination_deg": rounded(f64::from(earth.inclination_deg), 2),
            "declination_deg": earth.declination_deg.map(|deg| rounded(f64::from(deg), 2)),
            "is_of_that_day": is_valid,
        })),
        "notes": notes(flight, judged),
        "compasses": judged.compasses.iter().map(|compass| one(compass, &parameters(compass))).collect::<Vec<_>>(),
    })
}

fn course(course: &GpsCourseHeading) -> Value {
    json!({
        "wind_m_s": rounded(course.wind_speed_m_s(), 2),
        "wind_from_deg": rounded(course.wind_from_deg(), 1),
        "wind_sigma_m_s": rounded(course.wind_sigma_m_s, 2),
        "airspeed_m_s": rounded(course.airspeed_m_s, 2),
        "scatter_m_s": rounded(course.scatter_m_s, 2),
        "sigma_deg": rounded(course.sigma_deg(), 2),
        "widest_gap_deg": course.widest_gap_deg,
    })
}

fn one(judged: &CompassEvaluation, parameters: &Value) -> Value {
    #[derive(Serialize)]
    struct Rows {
        #[serde(flatten)]
        counted: RowCounts,
        fitted: usize,
    }
    json!({
        "compass": judged.number,
        "is_used": judged.is_used,
        "field_hz": rounded(1.0 / judged.reading_interval_s, 2),
        "field_age_ms": rounded(judged.latency.used_s * 1e3, 1),
        "field_age_sigma_ms": judged.latency.sigma_s.map(|s| rounded(s * 1e3, 1)),
        "field_ut": judged.radius_ut.map(|ut| rounded(ut, 2)),
        "rows": Rows { counted: judged.counts, fitted: judged.module.samples },
        "calibrated_s": judged.calibrated_s().map(|s| rounded(s, 1)),
        "module": solved(&judged.module),
        "without_current_rms_deg": judged.rms_without_current_deg.map(|deg| rounded(deg, 3)),
        "all_rows": solved(&judged.all_rows),
        "headings": judged.corrections.iter().map(|correction| json!({
            "by": correction.source.name(),
            "against_reference": correction.score.as_ref().map(scored),
        })).collect::<Vec<_>>(),
        "iron_change": judged.hard_iron_step.as_ref().map(|change| json!({
            "at_s": rounded(change.at_s, 1),
            "ut": change.step_ut.map(|axis| rounded(axis, 2)),
            "sigma_ut": change.sigma_ut.map(|axis| rounded(axis, 2)),
            "axis": change.axis().to_string(),
        })),
        "parameters": parameters,
    })
}

fn solved(replayed: &ReplayResult) -> Value {
    let solution = replayed.solution.as_ref();
    let refusal = super::evaluation::refusal(replayed);
    json!({
        "accepted": replayed.accepted.is_ok(),
        "refusal": refusal.map(|r| json!({ "code": r.code(), "words": r.to_string() })),
        "method": solution.map(|s| s.quality.method.name()),
        "coefficients": solution.map(|s| json!({
            "w": s.calibration.w.as_flattened().iter().copied().map(shortest).collect::<Vec<_>>(),
            "b_ut": s.calibration.b_ut.map(shortest),
        })),
        "inclination_deg": solution.map(|s| rounded(f64::from(s.calibration.inclination_rad.to_degrees()), 2)),
        "expected_rms_deg": solution.map(|s| rounded(f64::from(s.quality.expected_rms_deg), 3)),
        "iron_changed_ut": solution.and_then(|s| s.hard_iron_change).map(|doubt| rounded(f64::from(doubt.violation.size_ut), 2)),
        "bank_read": solution.and_then(|s| s.bank_scale_error).map(|doubt| rounded(f64::from(doubt.violation.read_ratio), 3)),
        "latency_ms": solution.map(|s| rounded(f64::from(s.calibration.latency_s) * 1e3, 1)),
        "latency_found_ms": solution.and_then(|s| s.quality.latency).map(|l| rounded(f64::from(l.estimate_s) * 1e3, 1)),
        "latency_sigma_ms": solution.and_then(|s| s.quality.latency).map(|l| rounded(f64::from(l.sigma_s) * 1e3, 1)),
        "by_current": solution.filter(|s| s.calibration.motor_current.current_sigma_a > 0.0).map(|s| by_current(&s.calibration.motor_current)),
        "samples": replayed.samples,
        "smooth": replayed.smoothed_score.as_ref().map(scored),
    })
}

fn by_current(iron: &MotorCurrentInterference) -> Value {
    json!({
        "ut_per_a": iron.ut_per_a.map(|axis| rounded(f64::from(axis), 4)),
        "sigma_ut_per_a": rounded(f64::from(iron.sigma_ut_per_a), 4),
        "mean_a": rounded(f64::from(iron.mean_current_a), 2),
        "spread_a": rounded(f64::from(iron.current_sigma_a), 2),
    })
}

fn scored(score: &HeadingScore) -> Value {
    let has_sigma = score.within_percent[1] > 0.0;
    json!({
        "heading_rms_deg": rounded(score.rms_deg, 3),
        "heading_mean_deg": rounded(score.mean_deg, 3),
        "rows": score.rows,
        "within_one_sigma_percent": has_sigma.then(|| rounded(score.within_percent[0], 1)),
        "within_two_sigma_percent": has_sigma.then(|| rounded(score.within_percent[1], 1)),
    })
}

fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10_f64.powi(decimals);
    (value * scale).round() / scale
}

/// The f64 with the same shortest decimal form as the f32.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::LogFormat;

    type Change = fn(&mut Flight);

    /// Notes of a flawless log after a change.
    fn notes_after(change: Change) -> Vec<String> {
        let mut flight = Flight::new(LogFormat::DataFlash);
        flight.autopilot = Autopilot::ArduPilot;
        flight.parameters.set(0.0, "COMPASS_OFS_X", 1.0);
        flight.attitude.push(0.0, [0.5, 0.0, 0.0]);
        flight.rates.push(0.0, [0.0; 3]);
        flight.current.push(0.0, [10.0]);
        change(&mut flight);
        notes(
            &flight,
            &FlightEvaluation { compasses: Vec::new(), reference: None, earth: None, attitude_interval_s: 0.1 },
        )
    }

    #[test]
    fn what_is_doubtful_about_a_log_is_told() {
        assert_eq!(notes_after(|_| {}), [""; 0]);
        assert_eq!(notes_after(|flight| flight.parameters.set(1.0, "COMPASS_MOTCT", 2.0)), [""; 0]);
        let cases: [(Change, &str); 10] = [
            (|flight| flight.rates = crate::log::series::Series::new(), "no body rates"),
            (
                |flight| {
                    flight.format = LogFormat::Csv;
                    flight.attitude.rows_mut()[0].values[0] = 0.02;
                },
                "tilts by 1.15 deg at most",
            ),
            (|flight| flight.systems = vec![3, 7, 9], "system 3 is judged; --system judges another (7, 9)"),
            (|flight| flight.counts.restarts = 2, "restarted 2 time"),
            (|flight| flight.counts.garbage = 3, "passed over: 3 bytes or lines"),
            (|flight| flight.counts.bad_times = 4, "passed over: 4 messages whose time"),
            (|flight| flight.counts.unhealthy = 5, "passed over: 5 readings"),
            (|flight| flight.parameters.set(1.0, "COMPASS_MOTCT", 1.0), "compensates by throttle"),
            (|flight| flight.current = crate::log::series::Series::new(), "no current is logged"),
            (|flight| flight.parameters = crate::log::ParameterHistory::default(), "the parameters are not in the log"),
        ];
        for (change, words) in cases {
            let found = notes_after(change);
            assert!(matches!(&found[..], [note] if note.contains(words)), "{words}: {found:?}");
        }
    }
}
