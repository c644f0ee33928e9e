//! Verdict on a flight, which the terminal, the page and `--json` show. docs/your-flight.md describes the JSON object,
//! which only grows.

use std::fmt;

use autoswing::calibration::{AttitudeLatency, MotorCurrentInterference, Solution};
use autoswing::messages::Refusal;
use serde::{Serialize, Serializer};
use serde_json::{Value, json};

use super::evaluation::{CompassEvaluation, CorrectionSource, FlightEvaluation};
use super::gps_course::GpsCourseHeading;
use super::note::Note;
use super::parameter_export::{ExportedCorrection, ParameterFormat, export_correction};
use super::{HeadingScore, ReplayResult, RowCounts};
use crate::log::Flight;
use crate::numbers::{coefficients_json, format_number, round_to};

/// Version of the JSON schema.
const SCHEMA: u32 = 2;

/// Fewer rows than this are no flight (2 s at 10 Hz).
const NO_FLIGHT: usize = 20;

/// Interval of the attitude from which on interpolation is unreliable, seconds: 3 Hz with a margin for jitter.
const SLOW_ATTITUDE_S: f64 = 0.34;

/// Verdict on a flight.
#[derive(Clone, Debug)]
pub struct Verdict<'a> {
    /// The log.
    pub flight: &'a Flight,
    /// Its evaluation.
    pub evaluation: &'a FlightEvaluation,
    /// Whether the module would have calibrated.
    pub outcome: FlightOutcome,
    /// Warnings about the log.
    pub notes: Vec<Note>,
    /// The compasses.
    pub compasses: Vec<CompassVerdict<'a>>,
}

/// Verdict on a compass.
#[derive(Clone, Debug)]
pub struct CompassVerdict<'a> {
    /// Its evaluation.
    pub evaluation: &'a CompassEvaluation,
    /// Whether the module would have calibrated it.
    pub outcome: CompassOutcome,
    /// The result as parameters of an autopilot; none after a refusal.
    pub parameters: Option<ExportedCorrection>,
}

/// Whether, when and how accurately the module would have calibrated; displayed as a line.
#[derive(Clone, Debug, PartialEq)]
pub enum FlightOutcome {
    /// Calibrated.
    Calibrated {
        /// Numbers of the calibrated compasses.
        numbers: Vec<u8>,
        /// Number of all compasses.
        of: usize,
        /// First and last calibration without a command, seconds into the flight; none if one required a command.
        at_s: Option<[f64; 2]>,
        /// Largest expected error, degrees RMS.
        expected_deg: f64,
        /// Interval of an attitude that is too slow, seconds.
        slow_attitude_s: Option<f64>,
    },
    /// Refused.
    Refused {
        /// Number of all compasses.
        of: usize,
        /// Number of the compass nearest to a calibration, if the causes differ.
        nearest: Option<u8>,
        /// Cause for this compass.
        cause: FlightRefusal,
        /// Interval of an attitude that is too slow, seconds.
        slow_attitude_s: Option<f64>,
    },
}

/// Cause of a refusal.
#[derive(Clone, Debug, PartialEq)]
pub enum FlightRefusal {
    /// Number of readings, too few for a flight.
    FewReadings(usize),
    /// Too few usable rows.
    FewRows {
        /// Number of readings.
        readings: usize,
        /// Number of usable rows.
        used: usize,
        /// The most frequent rejection: number and cause.
        rejected: (usize, &'static str),
    },
    /// The module's reason.
    Module(Refusal),
}

/// Whether and when the module would have calibrated a compass; displayed as a phrase.
#[derive(Clone, Debug, PartialEq)]
pub enum CompassOutcome {
    /// Calibrated without a command after this time in flight, seconds.
    Automatic(f64),
    /// Calibrated by a command at the end.
    Commanded,
    /// Refused.
    Refused(Refusal),
}

impl<'a> Verdict<'a> {
    /// Verdict on an evaluated log; `format` is that of the parameters.
    #[must_use]
    pub fn new(flight: &'a Flight, evaluation: &'a FlightEvaluation, format: ParameterFormat) -> Self {
        let total_ut = evaluation.earth.as_ref().map(|(earth, _)| f64::from(earth.total_ut));
        let compass = |compass: &'a CompassEvaluation| CompassVerdict {
            evaluation: compass,
            outcome: CompassOutcome::new(compass),
            parameters: export_correction(flight, compass, total_ut, format),
        };
        Self {
            flight,
            evaluation,
            outcome: FlightOutcome::new(evaluation),
            notes: Note::all(flight, evaluation),
            compasses: evaluation.compasses.iter().map(compass).collect(),
        }
    }

    /// Whether the module would have calibrated a compass.
    #[must_use]
    pub const fn is_accepted(&self) -> bool {
        matches!(self.outcome, FlightOutcome::Calibrated { .. })
    }

    /// Parameters of all calibrated compasses.
    #[must_use]
    pub fn parameters(&self) -> Vec<ExportedCorrection> {
        self.compasses.iter().filter_map(|compass| compass.parameters.clone()).collect()
    }

    /// Name and duration of the log.
    #[must_use]
    pub fn log_description(&self, name: &str) -> String {
        let [from_s, to_s] = self.flight.time_range_s();
        let firmware = self.flight.firmware.as_deref().unwrap_or("firmware not named");
        format!("{name}: {}, {firmware}, {} s", self.flight.format.name(), format_number(to_s - from_s, 0))
    }

    /// RMS less mean against the reference by correction and compass, degrees; corrections without any are omitted.
    #[must_use]
    pub fn comparison_deg(&self) -> Vec<(&'static str, Vec<Option<f64>>)> {
        let rows = CorrectionSource::ALL.map(|source| {
            let rms_deg = |compass: &CompassEvaluation| Some(compass.correction_from(source)?.score?.rms_deg);
            (source.name(), self.evaluation.compasses.iter().map(rms_deg).collect::<Vec<_>>())
        });
        rows.into_iter().filter(|(_, cells)| cells.iter().any(Option::is_some)).collect()
    }

    /// Facts about a compass, name and value.
    #[must_use]
    pub fn facts(&self, compass: &CompassVerdict<'_>) -> Vec<[String; 2]> {
        let CompassVerdict { evaluation: compass, outcome, parameters } = compass;
        let mut facts: Vec<[String; 2]> = Vec::new();
        let mut add = |name: &str, value: String| facts.push([name.to_owned(), value]);
        add("verdict", outcome.to_string());
        if let Some(is_used) = compass.is_used {
            add("autopilot", if is_used { "uses it for its heading" } else { "does not use it" }.to_owned());
        }
        if let Some(solution) = &compass.displayed_result().solution {
            let of = if compass.module.solution.is_some() { "" } else { ", of all rows" };
            add("solved by", format!("{}{of}", solution.quality.method.name()));
            add_solution_facts(solution, &mut add);
        }
        if let Some(without_deg) = compass.rms_without_current_deg {
            add("without the current", format!("{} deg RMS", format_number(without_deg, 2)));
        }
        match (&compass.module.accepted, &compass.all_rows.accepted) {
            (Ok(()), Err(refusal)) => add("all rows, thinned", format!("would have been refused: {refusal}")),
            (Err(_), Ok(())) => add("all rows, thinned", "would have been accepted".to_owned()),
            _ => {}
        }
        let source = compass.latency.sigma_s.map_or_else(
            || "not estimated from this flight".to_owned(),
            |sigma_s| format!("estimated from this flight, sigma {} ms", format_number(sigma_s * 1e3, 0)),
        );
        let age = format_number(compass.latency.used_s * 1e3, 0);
        let hz = format_number(1.0 / compass.reading_interval_s, 1);
        add("field", format!("{hz} times a second, {age} ms old at its time stamp ({source})"));
        if let (Some((earth, is_valid)), Some(radius_ut)) = (&self.evaluation.earth, compass.radius_ut) {
            let year = if *is_valid { "" } else { ", of another year" };
            let model = format_number(f64::from(earth.total_ut), 1);
            add("strength", format!("{} uT, {model} by the field model{year}", format_number(radius_ut, 1)));
        }
        let rejected: Vec<String> =
            compass.counts.rejection_texts().into_iter().map(|rejected| format!("; {rejected}")).collect();
        let RowCounts { used, .. } = compass.counts;
        add("rows", format!("{used} usable, {} fitted to{}", compass.module.samples, rejected.concat()));
        if let Some(step) = &compass.hard_iron_step {
            let [x, y, z] = step.step_ut;
            let after_s = step.at_s - compass.rows.iter().find(|row| row.usable).map_or(0.0, |row| row.t_s);
            add(
                "hard-iron step",
                format!(
                    "{} uT about {after_s:.0} s into the flight, most on {} (x {x:+.1}, y {y:+.1}, z {z:+.1}); a drift \
                     or a current shows as a step, too",
                    format_number(step.size_ut(), 1),
                    step.axis(),
                ),
            );
            for (part, expected_deg) in
                ["before it alone", "after it alone"].iter().zip(&compass.expected_rms_by_part_deg)
            {
                let expected = expected_deg.map_or_else(
                    || "not enough for a calibration".to_owned(),
                    |deg| format!("expected error {} deg", format_number(deg, 1)),
                );
                add(part, expected);
            }
        }
        if let Some(exported) = parameters {
            let lost = format_number(exported.heading_loss_deg[0], 2);
            add("as parameters", format!("{lost} deg RMS lost"));
            exported.warnings.iter().for_each(|warning| add("parameters", warning.clone()));
        }
        facts
    }

    /// The verdict as a JSON object.
    #[must_use]
    pub fn json(&self) -> Value {
        let Self { flight, evaluation, .. } = self;
        let [from_s, to_s] = flight.time_range_s();
        json!({
            "schema": SCHEMA,
            "verdict": self.outcome,
            "accepted": self.is_accepted(),
            "log": {
                "format": flight.format.name(),
                "autopilot": flight.autopilot,
                "firmware": flight.firmware,
                "from_s": round_to(from_s, 3),
                "to_s": round_to(to_s, 3),
                "attitude_hz": round_to(1.0 / evaluation.attitude_interval_s, 2),
                "has_current": !flight.current.is_empty(),
                "passed_over": flight.counts,
            },
            "reference": evaluation.reference.as_ref().map(|reference| json!({
                "name": reference.name(),
                "is_accuracy": reference.is_accuracy(),
                "limits": reference.limits(),
                "course": reference.course().map(course_json),
            })),
            "field_model": evaluation.earth.as_ref().map(|(earth, is_valid)| json!({
                "total_ut": round_to(f64::from(earth.total_ut), 2),
                "inclination_deg": round_to(f64::from(earth.inclination_deg), 2),
                "declination_deg": earth.declination_deg.map(|deg| round_to(f64::from(deg), 2)),
                "is_of_that_day": is_valid,
            })),
            "notes": self.notes,
            "compasses": self.compasses.iter().map(CompassVerdict::json).collect::<Vec<_>>(),
        })
    }
}

fn add_solution_facts(solution: &Solution, add: &mut dyn FnMut(&str, String)) {
    let Solution { calibration, quality, .. } = solution;
    let deg = |deg: f32| format_number(f64::from(deg), 2);
    let [rms, worst] = [quality.expected_rms_deg, quality.expected_worst_deg].map(deg);
    add("expected error", format!("{rms} deg RMS, sigma {worst} at the worst heading"));
    let inclination_deg = f64::from(calibration.inclination_rad.to_degrees());
    add("inclination", format!("{} deg", format_number(inclination_deg, 1)));
    if let Some(AttitudeLatency { estimate_s, sigma_s }) = quality.latency.filter(|_| calibration.uses_latency()) {
        let [estimate, sigma] = [estimate_s, sigma_s].map(|s| format_number(f64::from(s) * 1e3, 0));
        add("attitude latency", format!("{estimate} ms more than the age of the field, sigma {sigma} ms"));
    }
    let MotorCurrentInterference { ut_per_a: [x, y, z], sigma_ut_per_a, mean_current_a, current_sigma_a } =
        calibration.motor_current;
    if current_sigma_a > 0.0 {
        let found = if calibration.motor_current.is_applied() {
            format!("x {x:+.3}, y {y:+.3}, z {z:+.3} uT/A (sigma {sigma_ut_per_a:.3})")
        } else {
            format!("no interference that is certain (sigma {sigma_ut_per_a:.3} uT/A)")
        };
        add("motor current", format!("{found}, of {mean_current_a:.1} A that varied by {current_sigma_a:.1} A"));
    }
    if let Some(finding) = &solution.hard_iron_change {
        add("allowed for", format!("{} deg: {}", deg(finding.added_error_deg), finding.violation));
    }
    if let Some(finding) = &solution.bank_scale_error {
        let percent = 100.0 * finding.violation.read_ratio;
        let added = deg(finding.added_error_deg);
        add("allowed for", format!("{added} deg: the attitude source seems to read {percent:.0} % of the bank"));
    }
    if let Some(advice) = &solution.advice {
        let [now, then] = [advice.expected_deg, advice.expected_after_deg].map(deg);
        add("weakest", format!("{} ({} deg)", advice.weakest.name(), deg(advice.weakest_deg)));
        add("best next", format!("{} ({now} to {then} deg)", advice.manoeuvre));
    }
}

impl FlightOutcome {
    /// Outcome of an evaluated flight.
    #[must_use]
    pub fn new(evaluation: &FlightEvaluation) -> Self {
        let compasses = &evaluation.compasses;
        let of = compasses.len();
        let accepted: Vec<&CompassEvaluation> =
            compasses.iter().filter(|compass| compass.module.accepted.is_ok()).collect();
        let slow_attitude_s = Some(evaluation.attitude_interval_s).filter(|interval_s| *interval_s > SLOW_ATTITUDE_S);
        if accepted.is_empty() {
            let nearest = nearest(compasses);
            let cause = nearest.map_or(FlightRefusal::FewReadings(0), FlightRefusal::new);
            // Causes with other numbers are the same cause if their texts are.
            let is_shared =
                compasses.iter().all(|compass| FlightRefusal::new(compass).to_string() == cause.to_string());
            let nearest = nearest.filter(|_| !is_shared).map(|compass| compass.number);
            return Self::Refused { of, nearest, cause, slow_attitude_s };
        }
        let times_s: Option<Vec<f64>> = accepted.iter().map(|compass| compass.calibrated_s()).collect();
        Self::Calibrated {
            numbers: accepted.iter().map(|compass| compass.number).collect(),
            of,
            at_s: times_s.map(|times_s| {
                times_s
                    .iter()
                    .fold([f64::INFINITY, f64::NEG_INFINITY], |[first, last], &at_s| [first.min(at_s), last.max(at_s)])
            }),
            expected_deg: accepted.iter().filter_map(|compass| compass.module.expected_rms_deg()).fold(0.0, f64::max),
            slow_attitude_s,
        }
    }
}

/// The rejected compass closest to a calibration.
fn nearest(compasses: &[CompassEvaluation]) -> Option<&CompassEvaluation> {
    let expected_deg = |compass: &CompassEvaluation| compass.module.expected_rms_deg().unwrap_or(f64::INFINITY);
    // Compasses that are unused or hardly logged rank last.
    let is_out = |compass: &CompassEvaluation| (compass.counts.used < NO_FLIGHT, compass.is_used == Some(false));
    compasses.iter().min_by(|a, b| {
        let by_rows = || b.counts.used.cmp(&a.counts.used);
        is_out(a).cmp(&is_out(b)).then_with(|| expected_deg(a).total_cmp(&expected_deg(b))).then_with(by_rows)
    })
}

impl FlightRefusal {
    /// Too few usable rows, else the module's reason.
    fn new(compass: &CompassEvaluation) -> Self {
        let RowCounts { readings, used, .. } = compass.counts;
        match &compass.module.accepted {
            Err(refusal) if used >= NO_FLIGHT => Self::Module(refusal.clone()),
            _ if readings < NO_FLIGHT => Self::FewReadings(readings),
            _ => Self::FewRows { readings, used, rejected: compass.counts.main_rejection() },
        }
    }
}

impl CompassOutcome {
    fn new(compass: &CompassEvaluation) -> Self {
        match (&compass.module.accepted, compass.calibrated_s()) {
            (Err(refusal), _) => Self::Refused(refusal.clone()),
            (Ok(()), Some(after_s)) => Self::Automatic(after_s),
            (Ok(()), None) => Self::Commanded,
        }
    }
}

impl fmt::Display for FlightOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Calibrated { slow_attitude_s, .. } | Self::Refused { slow_attitude_s, .. }) = self;
        let slow = slow_attitude_s.map_or_else(String::new, |interval_s| {
            let hz = 1.0 / interval_s;
            format!("the attitude is logged {hz:.1} times a second; below 3 Hz its interpolation is unreliable")
        });
        let slow_after = |joint: &str| if slow.is_empty() { String::new() } else { format!("; {joint}{slow}") };
        match self {
            Self::Calibrated { numbers, of, at_s, expected_deg, .. } => {
                f.write_str("the module would have calibrated")?;
                match (numbers.len(), *of) {
                    (1, 1) => {}
                    (some, of) if some == of => write!(f, " each of {of} compasses")?,
                    (some, of) => {
                        let numbers: Vec<String> = numbers.iter().map(u8::to_string).collect();
                        write!(f, " {some} of {of} compasses (number {})", numbers.join(", "))?;
                    }
                }
                match at_s {
                    Some([first, last]) if last - first < 1.5 => write!(f, " by itself, {first:.0} s into the flight"),
                    Some([first, last]) => write!(f, " by itself, {first:.0} to {last:.0} s into the flight"),
                    None => f.write_str(" by a command at the end of the flight"),
                }?;
                write!(f, ", expecting {expected_deg:.1} deg{}", slow_after("but "))
            }
            Self::Refused { of, nearest, cause, .. } => {
                f.write_str("the module would have refused")?;
                if *of > 1 {
                    write!(f, " each of {of} compasses")?;
                }
                if let Some(number) = nearest {
                    write!(f, "; number {number} came nearest")?;
                }
                let slow = match cause {
                    FlightRefusal::FewReadings(_) => String::new(),
                    FlightRefusal::FewRows { .. } => slow_after(""),
                    FlightRefusal::Module(_) => slow_after("and "),
                };
                write!(f, ": {cause}{slow}")
            }
        }
    }
}

impl Serialize for FlightOutcome {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl fmt::Display for FlightRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FewReadings(number) => {
                write!(f, "the log has {number} readings of the field, too few for a flight")
            }
            Self::FewRows { readings, used, rejected: (number, why) } => {
                write!(f, "of {readings} readings of the field {used} are usable; {number} are {why}")
            }
            Self::Module(refusal) => refusal.fmt(f),
        }
    }
}

impl fmt::Display for CompassOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Automatic(after_s) => {
                write!(f, "would have calibrated itself after {} s", format_number(*after_s, 0))
            }
            Self::Commanded => f.write_str("would have calibrated by a command at the end"),
            Self::Refused(refusal) => write!(f, "would have been refused: {}: {refusal}", refusal.code()),
        }
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
        #[derive(Serialize)]
        struct Rows {
            #[serde(flatten)]
            counted: RowCounts,
            fitted: usize,
        }
        let compass = self.evaluation;
        json!({
            "compass": compass.number,
            "is_used": compass.is_used,
            "field_hz": round_to(1.0 / compass.reading_interval_s, 2),
            "field_age_ms": round_to(compass.latency.used_s * 1e3, 1),
            "field_age_sigma_ms": compass.latency.sigma_s.map(|s| round_to(s * 1e3, 1)),
            "field_ut": compass.radius_ut.map(|ut| round_to(ut, 2)),
            "rows": Rows { counted: compass.counts, fitted: compass.module.samples },
            "calibrated_s": compass.calibrated_s().map(|s| round_to(s, 1)),
            "module": result_json(&compass.module),
            "without_current_rms_deg": compass.rms_without_current_deg.map(|deg| round_to(deg, 3)),
            "all_rows": result_json(&compass.all_rows),
            "headings": compass.corrections.iter().map(|correction| json!({
                "by": correction.source.name(),
                "against_reference": correction.score.as_ref().map(score_json),
            })).collect::<Vec<_>>(),
            "iron_change": compass.hard_iron_step.as_ref().map(|step| json!({
                "at_s": round_to(step.at_s, 1),
                "ut": step.step_ut.map(|axis| round_to(axis, 2)),
                "sigma_ut": step.sigma_ut.map(|axis| round_to(axis, 2)),
                "axis": step.axis().to_string(),
            })),
            "parameters": self.parameters.as_ref().map(parameters_json),
        })
    }
}

fn result_json(result: &ReplayResult) -> Value {
    let solution = result.solution.as_ref();
    let rounded = |value: f32, decimals: i32| round_to(f64::from(value), decimals);
    let ms = |seconds: f32| round_to(f64::from(seconds) * 1e3, 1);
    let latency = solution.and_then(|s| s.quality.latency);
    let current = solution.map(|s| s.calibration.motor_current).filter(|current| current.current_sigma_a > 0.0);
    json!({
        "accepted": result.accepted.is_ok(),
        "refusal": result.accepted.as_ref().err().map(|r| json!({ "code": r.code(), "words": r.to_string() })),
        "method": solution.map(|s| s.quality.method.name()),
        "coefficients": solution.map(|s| coefficients_json(&s.calibration)),
        "inclination_deg": solution.map(|s| rounded(s.calibration.inclination_rad.to_degrees(), 2)),
        "expected_rms_deg": solution.map(|s| rounded(s.quality.expected_rms_deg, 3)),
        "iron_changed_ut": solution.and_then(|s| s.hard_iron_change).map(|finding| rounded(finding.violation.size_ut, 2)),
        "bank_read": solution.and_then(|s| s.bank_scale_error).map(|finding| rounded(finding.violation.read_ratio, 3)),
        "latency_ms": solution.map(|s| ms(s.calibration.latency_s)),
        "latency_found_ms": latency.map(|latency| ms(latency.estimate_s)),
        "latency_sigma_ms": latency.map(|latency| ms(latency.sigma_s)),
        "by_current": current.map(|current| json!({
            "ut_per_a": current.ut_per_a.map(|axis| rounded(axis, 4)),
            "sigma_ut_per_a": rounded(current.sigma_ut_per_a, 4),
            "mean_a": rounded(current.mean_current_a, 2),
            "spread_a": rounded(current.current_sigma_a, 2),
        })),
        "samples": result.samples,
        "smooth": result.smoothed_score.as_ref().map(score_json),
    })
}

fn score_json(score: &HeadingScore) -> Value {
    let has_sigma = score.within_percent[1] > 0.0;
    json!({
        "heading_rms_deg": round_to(score.rms_deg, 3),
        "heading_mean_deg": round_to(score.mean_deg, 3),
        "rows": score.rows,
        "within_one_sigma_percent": has_sigma.then(|| round_to(score.within_percent[0], 1)),
        "within_two_sigma_percent": has_sigma.then(|| round_to(score.within_percent[1], 1)),
    })
}

fn parameters_json(exported: &ExportedCorrection) -> Value {
    json!({
        "matrix": exported.correction.matrix.transpose().iter().map(|number| round_to(*number, 5)).collect::<Vec<_>>(),
        "offsets_ut": exported.correction.hard_iron_ut.iter().map(|number| round_to(-number, 3)).collect::<Vec<_>>(),
        "lost_rms_deg": round_to(exported.heading_loss_deg[0], 3),
        "lost_mean_deg": round_to(exported.heading_loss_deg[1], 3),
        "heading_rms_deg": exported.score.map(|score| round_to(score.rms_deg, 3)),
        "warnings": exported.warnings,
    })
}
