use super::*;
use crate::log::time_series::Series;
use crate::log::{ParameterHistory, RatesProblem};
use crate::replay::field_latency::FieldLatency;
use crate::replay::sensor_failure::SensorFailure;
use crate::replay::tests::{compass_of_flown_turns, evaluation_of_compasses};

type FlightChange = fn(&mut LoggedFlight);

/// Warnings about a flawless log after a change.
fn warnings_after(change: FlightChange) -> Vec<String> {
    let mut flight = LoggedFlight::new(LogFormat::DataFlash);
    flight.autopilot = AutopilotKind::ArduPilot;
    flight.parameters.set_value(0.0, "COMPASS_OFS_X", 1.0);
    flight.attitude.push_row(0.0, [0.5, 0.0, 0.0]);
    flight.body_rates.push_row(0.0, [0.0; 3]);
    flight.battery_current.push_row(0.0, [10.0]);
    change(&mut flight);
    let evaluation = FlightEvaluation { reference: None, ..evaluation_of_compasses(Vec::new()) };
    warnings_of_flight(&flight, &evaluation)
}

fn push_test_ratios(flight: &mut LoggedFlight, ratios: [f32; 2]) {
    (0_u8..).zip(ratios).for_each(|(t_s, ratio)| flight.magnetometer_test_ratio.push_row(t_s.into(), [ratio]));
}

#[test]
fn a_fault_of_a_log_gives_its_own_warning_only() {
    assert_eq!(warnings_after(|_| {}), [""; 0]);
    assert_eq!(warnings_after(|flight| flight.parameters.set_value(1.0, "COMPASS_MOTCT", 2.0)), [""; 0]);
    assert_eq!(warnings_after(|flight| flight.attitude.rows_mut()[0].row_values[0] = 0.02), [""; 0]);
    assert_eq!(warnings_after(|flight| push_test_ratios(flight, [0.5, 0.9])), [""; 0]);
    let cases: [(FlightChange, &str); 16] = [
        (|flight| set_rates_problem(flight, RatesProblem::NotLogged, false), "no body rates are logged: headings are"),
        (
            |flight| set_rates_problem(flight, RatesProblem::WrongSign(1), true),
            "about y has the sign opposite to the attitude's change; corrected by the attitude",
        ),
        (|flight| flight.rows_without_time = 1, "field rows carry no time"),
        (|flight| push_test_ratios(flight, [0.5, 1.5]), "rejected the magnetometer in 50 % of the flight"),
        (
            |flight| flight.compass_texts = vec![(31.0, "Compass variance".to_owned())],
            "the autopilot reported \"Compass variance\" at 31 s",
        ),
        (|flight| flight.fallback_attitude_message = Some("AHR2"), "that of AHR2 is used"),
        (|flight| flight.autopilot_component_ids = vec![1, 4], "component 1, received first, is evaluated, not 4"),
        (make_level_table, "tilts by 1.15 deg at most"),
        (
            |flight| flight.autopilot_system_ids = vec![3, 7, 9],
            "system 3 is evaluated; --system selects another (7, 9)",
        ),
        (|flight| flight.skipped_counts.restarts = 2, "restarted 2 time"),
        (|flight| flight.skipped_counts.garbage = 3, "skipped: 3 bytes or lines"),
        (|flight| flight.skipped_counts.bad_times = 4, "skipped: 4 messages with an invalid time"),
        (|flight| flight.skipped_counts.rejected_readings = 5, "skipped: 5 readings"),
        (|flight| flight.parameters.set_value(1.0, "COMPASS_MOTCT", 1.0), "compensates by throttle"),
        (|flight| flight.battery_current = Series::new(), "no current is logged"),
        (|flight| flight.parameters = ParameterHistory::default(), "the parameters are not in the log"),
    ];
    for (change, expected) in cases {
        let warnings = warnings_after(change);
        assert!(matches!(&warnings[..], [warning] if warning.contains(expected)), "{expected}: {warnings:?}");
    }
}

fn set_rates_problem(flight: &mut LoggedFlight, problem: RatesProblem, is_repaired: bool) {
    (flight.rates_problem, flight.has_measured_rates) = (Some(problem), is_repaired);
}

fn make_level_table(flight: &mut LoggedFlight) {
    flight.log_format = LogFormat::Csv;
    flight.attitude.rows_mut()[0].row_values[0] = 0.02;
}

/// Warnings that a change adds to those about the flown turns.
fn added_warnings(change: fn(&mut LoggedFlight, &mut FlightEvaluation)) -> Vec<String> {
    let (mut flight, compass) = compass_of_flown_turns();
    let mut evaluation = evaluation_of_compasses(vec![compass.clone(), compass]);
    let before = warnings_of_flight(&flight, &evaluation);
    change(&mut flight, &mut evaluation);
    warnings_of_flight(&flight, &evaluation).into_iter().filter(|text| !before.contains(text)).collect()
}

/// The GPS course of a copter is not used as a reference.
fn make_copter(flight: &mut LoggedFlight, evaluation: &mut FlightEvaluation, reference: Option<ReferenceHeading>) {
    (flight.is_copter, evaluation.reference) = (true, reference);
    for t_s in [10.0, 11.0] {
        flight.gps.push_row(t_s, [48.0, 11.0, 0.0, 20.0, 0.0, f32::NAN]);
    }
}

fn change_mountings(flight: &mut LoggedFlight) {
    flight.autopilot = AutopilotKind::ArduPilot;
    for (t_s, name) in [(30.0, "COMPASS_ORIENT"), (60.0, "AHRS_ORIENTATION"), (90.0, "COMPASS_ORIENT3")] {
        flight.parameters.set_value(0.0, name, 0.0);
        flight.parameters.set_value(t_s, name, 4.0);
    }
}

type EvaluationChange = fn(&mut LoggedFlight, &mut FlightEvaluation);

#[test]
fn a_fault_of_a_compass_gives_its_own_warning_only() {
    let gives_no_heading = "GPS course gives no heading here: a copter's nose";
    let cases: [(EvaluationChange, &str); 15] = [
        (|flight, _| flight.parameters.set_value(0.0, "COMPASS_OFS2_X", 1.0), ""),
        (
            |flight, _| flight.parameters = ParameterHistory::of_values(&INCOMPLETE_PARAMETERS),
            "not in the log, assumed unset: COMPASS_OFS_X, COMPASS_OFS_Z, COMPASS_DIA_Y",
        ),
        (|_, evaluation| evaluation.compasses[1].reading_interval_s = 0.25, "the field is logged 4.0 times a second"),
        (|_, evaluation| evaluation.compasses[0].reading_interval_s = 0.15, ""),
        (|_, evaluation| evaluation.compasses[1].latency = LATE_ATTITUDE, "the attitude is logged 150 ms later"),
        (|_, evaluation| evaluation.compasses[1].latency = FieldLatency { sigma_s: None, ..LATE_ATTITUDE }, ""),
        (|_, evaluation| evaluation.compasses[1].row_counts.contradicting_attitude = 600, "in 25 % of the log"),
        (|_, evaluation| evaluation.compasses[1].row_counts.contradicting_attitude = 200, ""),
        (
            |flight, _| change_mountings(flight),
            "changed in the log: AHRS_ORIENTATION at 60 s, COMPASS_ORIENT at 30 s; no calibration",
        ),
        (|flight, _| flight.body_rates.retain_rows(|i, _| i % 11 != 0), "10 % of the body rates are lost"),
        (
            |_, evaluation| evaluation.compasses[1].sensor_failure = Some(SensorFailure::NoReadings),
            "all its readings are zero, out of range",
        ),
        (|flight, evaluation| make_copter(flight, evaluation, None), gives_no_heading),
        (|flight, evaluation| make_copter(flight, evaluation, Some(ReferenceHeading::AutopilotYaw)), gives_no_heading),
        (|flight, evaluation| make_copter(flight, evaluation, Some(ReferenceHeading::GpsYaw)), ""),
        (|_, evaluation| evaluation.reference = None, ""),
    ];
    for (i, (change, expected)) in cases.into_iter().enumerate() {
        let warnings = added_warnings(change);
        assert_eq!(warnings.len(), usize::from(!expected.is_empty()), "{i}: {warnings:?}");
        assert!(warnings.iter().all(|warning| warning.contains(expected)), "{expected}: {warnings:?}");
    }
}

const INCOMPLETE_PARAMETERS: [(&str, f64); 3] =
    [("COMPASS_OFS_Y", 1.0), ("COMPASS_DIA_X", 1.0), ("COMPASS_DIA_Z", 1.0)];

const LATE_ATTITUDE: FieldLatency = FieldLatency { used_s: -0.15, sigma_s: Some(0.01) };
