//! Report of a simulated mission, as a page and as JSON.

use autoswing::calibration::{Calibration, Orientation};
use autoswing::frames::{Body, Field};
use log_analysis::numbers::{coefficients_json, format_number, round_all_numbers, round_to};
use log_analysis::replay::verdict::CompassState;
use log_analysis::report::ReportOrigin;
use log_analysis::report::model::{
    CompassReport, DeviationCurve, EventMark, ReferenceInfo, Report, ReportSample, VerdictLine,
};
use log_analysis::score::{ErrorStatistics, wrap_180};
use serde_json::{Value, json};

use crate::heading_errors::{BANKS_DEG, HeadingErrors};
use crate::mission::{EvaluatedHeading, MissionResult, RoutineMeasurement};
use crate::transcript::Refusal;
use crate::world::airframe::AirframeDescription;
use crate::world::{TrueState, WorldConfig};

/// Makes the report of a mission.
#[must_use]
pub fn report_mission(mission_result: &MissionResult, origin: &ReportOrigin) -> Report {
    let seed = mission_result.world.seed;
    let vehicle_name = mission_result.world.aircraft.kind.vehicle_name();
    Report {
        title: format!("Simulated {vehicle_name}, seed {seed}"),
        verdicts: vec![verdict_line(mission_result)],
        key_figures: key_figures(mission_result),
        reference: ReferenceInfo {
            difference_name: "error",
            reference_name: "the simulator's own heading".to_owned(),
            accuracy_text:
                "exact field and true attitude at twelve headings; indicated less true, the constant included"
                    .to_owned(),
            card_constant_text: String::new(),
            is_accurate: true,
        },
        compasses: vec![mission_compass_report(mission_result)],
        console_session: Some(strip_control_sequences(&mission_result.transcript)),
        origin: [
            ["command".to_owned(), origin.command_line.clone()],
            ["made by".to_owned(), format!("Autoswing {}", env!("CARGO_PKG_VERSION"))],
            ["flight".to_owned(), format!("simulated, {} s, seed {seed}", format_number(mission_result.duration_s, 0))],
        ]
        .into_iter()
        .chain(origin.settings.iter().cloned())
        .collect(),
        ..Report::default()
    }
}

/// Figures of a mission as `host-sim fly --json` prints them: one object with rounded numbers.
#[must_use]
pub fn mission_json(mission_result: &MissionResult) -> Value {
    let (before, after) = (mission_result.errors_before.statistics(), mission_result.errors_after.statistics());
    let shown_calibration = mission_result.calibration_result.as_ref().ok();
    let refusal = mission_result.calibration_result.as_ref().err();
    let mut figures = json!({
        "accepted": shown_calibration.is_some(),
        "refusal": refusal.map(|Refusal { code, explanation }| json!({ "code": code, "words": explanation })),
        "method": shown_calibration.map(|shown| &shown.method),
        "coefficients": shown_calibration.map(|shown| coefficients_json(&shown.calibration)),
        "inclination_deg": shown_calibration.map(|shown| shown.calibration.inclination_rad.to_degrees()),
        "expected_rms_deg": shown_calibration.map(|shown| shown.expected_rms_deg),
        "before": before,
        "after": shown_calibration.map(|_| after),
        "streamed": mission_result.streamed_statistics,
        "duration_s": mission_result.duration_s,
        "aircraft": mission_result.world.aircraft.kind.vehicle_name(),
        "airframe": airframe_json(&mission_result.world),
        "seed": mission_result.world.seed,
    });
    round_all_numbers(&mut figures);
    figures
}

/// Airframe and Earth field, as objects of the command line show them.
#[must_use]
pub fn airframe_json(world: &WorldConfig) -> Value {
    let AirframeDescription { soft_iron, hard_iron_ut, mounting_deg } = AirframeDescription::from(&world.airframe);
    json!({
        "soft_iron": soft_iron.map(|row| row.map(|element| round_to(element, 4))),
        "hard_iron_ut": hard_iron_ut,
        "mounting_deg": mounting_deg,
        "total_ut": world.earth.total_ut,
        "inclination_deg": world.earth.inclination_deg,
    })
}

fn verdict_line(mission_result: &MissionResult) -> VerdictLine {
    let (compass_state, state_word, verdict_text) = match &mission_result.calibration_result {
        Ok(shown) => {
            let text = format!(
                "the module calibrated itself {} s into the flight by {}, expecting {} deg RMS; the true error is {}",
                format_number(mission_result.solve_end_s, 0),
                shown.method,
                format_number(shown.expected_rms_deg, 2),
                format_number(mission_result.errors_after.statistics().rms_deg, 2)
            );
            (CompassState::Good, "Accepted", text)
        }
        Err(Refusal { code, explanation }) => {
            (CompassState::Bad, "Refused", format!("the module refused: {code}: {explanation}"))
        }
    };
    VerdictLine { compass_state: Some(compass_state), state_word, verdict_text }
}

/// Degrees with two decimals.
fn degrees_text(degrees: f64) -> String {
    format!("{} deg", format_number(degrees, 2))
}

fn key_figures(mission_result: &MissionResult) -> Vec<[String; 2]> {
    let (before, after) = (mission_result.errors_before.statistics(), mission_result.errors_after.statistics());
    let mut figures = vec![["before: largest error".to_owned(), degrees_text(before.max_deg)]];
    if let Ok(shown_calibration) = &mission_result.calibration_result {
        figures.push(["after: largest error".to_owned(), degrees_text(after.max_deg)]);
        figures.push(["after: RMS".to_owned(), degrees_text(after.rms_deg)]);
        figures.push(["expected: RMS".to_owned(), degrees_text(shown_calibration.expected_rms_deg)]);
    }
    if let Some(streamed) = &mission_result.streamed_statistics {
        figures.push(["streamed in flight: RMS".to_owned(), degrees_text(streamed.rms_deg)]);
        let [one, two] = streamed.within_percent.map(|percent| format_number(percent, 0));
        figures.push(["within 1 and 2 sigma".to_owned(), format!("{one} and {two} %")]);
    }
    figures
}

fn mission_compass_report(mission_result: &MissionResult) -> CompassReport {
    let shown_calibration = mission_result.calibration_result.as_ref().ok();
    let calibration = shown_calibration.map(|shown| shown.calibration);
    let measurements = mission_result
        .routine_measurements
        .iter()
        .map(|measurement| collected_sample(measurement, calibration.as_ref()));
    CompassReport {
        compass_name: "The module's compass".to_owned(),
        facts: summary_table(mission_result),
        curves_before: deviation_curves(&mission_result.errors_before),
        curves_after: shown_calibration.map_or_else(Vec::new, |_| deviation_curves(&mission_result.errors_after)),
        sigma_by_heading_deg: shown_calibration.map_or_else(Vec::new, |shown| vec![shown.expected_rms_deg; 12]),
        samples: measurements.chain(mission_result.evaluated_headings.iter().map(streamed_sample)).collect(),
        event_marks: vec![EventMark {
            time_s: mission_result.solve_end_s,
            event_name: shown_calibration.map_or("refused", |_| "calibrated, restarted").to_owned(),
        }],
        before_correction_name: "uncorrected",
        corrected_by: "by the module",
        earth_field: calibration
            .map(|calibration| [calibration.total_ut, calibration.inclination_rad.to_degrees()].map(f64::from)),
        coefficients: calibration
            .map(|Calibration { w: [x, y, z], b_ut, .. }| [x, y, z, b_ut].map(|row| row.map(f64::from))),
        ..CompassReport::default()
    }
}

fn summary_table(mission_result: &MissionResult) -> Vec<[String; 2]> {
    let statistics_text = |statistics: ErrorStatistics| {
        format!(
            "largest {}, RMS {}, constant {}, largest less constant {}",
            format_number(statistics.max_deg, 2),
            format_number(statistics.rms_deg, 2),
            format_number(statistics.mean_deg, 2),
            degrees_text(statistics.max_demeaned_deg)
        )
    };
    let mut facts = vec![["before".to_owned(), statistics_text(mission_result.errors_before.statistics())]];
    if mission_result.calibration_result.is_ok() {
        facts.push(["after".to_owned(), statistics_text(mission_result.errors_after.statistics())]);
    }
    if let Some(streamed) = &mission_result.streamed_statistics {
        facts.push([
            "streamed in flight, attitude noise and age included".to_owned(),
            format!(
                "{} headings, largest {}, RMS {}",
                streamed.headings,
                format_number(streamed.max_deg, 2),
                degrees_text(streamed.rms_deg)
            ),
        ]);
    }
    if let Ok(shown_calibration) = &mission_result.calibration_result {
        let Calibration { total_ut, inclination_rad, .. } = shown_calibration.calibration;
        facts.push(["field".to_owned(), format!("{} uT", format_number(f64::from(total_ut), 2))]);
        facts.push(["inclination".to_owned(), degrees_text(f64::from(inclination_rad.to_degrees()))]);
        facts.push(["sigma at the worst heading".to_owned(), degrees_text(shown_calibration.expected_worst_deg)]);
    }
    facts
}

fn deviation_curves(errors: &HeadingErrors) -> Vec<DeviationCurve> {
    let name = |bank_deg: f64| match bank_deg {
        0.0 => "level".to_owned(),
        right if right > 0.0 => format!("right {right:.0}"),
        left => format!("left {:.0}", -left),
    };
    let curve = |(bank_deg, errors_deg): (f64, &[f64; 12])| DeviationCurve {
        curve_name: name(bank_deg),
        errors_deg: errors_deg.map(Some).to_vec(),
        constant_deg: 0.0,
    };
    BANKS_DEG.into_iter().zip(&errors.0).map(curve).collect()
}

fn report_sample(true_state: &TrueState) -> ReportSample {
    ReportSample {
        time_s: true_state.time_s(),
        heading_deg: Some(true_state.heading_deg()),
        roll_deg: f64::from(true_state.attitude().roll_rad.to_degrees()),
        pitch_deg: f64::from(true_state.attitude().pitch_rad.to_degrees()),
        is_usable: true,
        ..ReportSample::default()
    }
}

/// State of the vehicle at a measurement during the collection, for the report.
fn collected_sample(measurement: &RoutineMeasurement, calibration: Option<&Calibration>) -> ReportSample {
    let corrected = |applied: &Calibration| {
        applied.calibrated_field(applied.remove_motor_current(measurement.field, measurement.current_a))
    };
    let before = corrected(&Calibration::uncalibrated(Orientation::IDENTITY_ROTATION));
    let attitude = measurement.true_state.attitude();
    let before_deg = f64::from(attitude.to_level_frame(before).heading_rad().to_degrees());
    let body_ut = |field: Field<Body>| field.ut.map(f64::from).into();
    ReportSample {
        raw_ut: Some(body_ut(before)),
        corrected_ut: calibration.map(|applied| body_ut(corrected(applied))),
        current_a: measurement.current_a.map(f64::from),
        error_before_deg: Some(wrap_180(before_deg - measurement.true_state.heading_deg())),
        ..report_sample(&measurement.true_state)
    }
}

/// Moment after the calibration, with the streamed heading but no field.
fn streamed_sample(heading: &EvaluatedHeading) -> ReportSample {
    ReportSample {
        error_deg: Some(heading.error_deg),
        sigma_deg: Some(heading.sigma_deg),
        ..report_sample(&heading.true_state)
    }
}

/// Terminal text without control sequences.
fn strip_control_sequences(session: &str) -> String {
    session.replace("\r\u{1b}[2K", "").replace('\r', "")
}
