use super::*;
use crate::log::ParameterHistory;
use crate::log::time_series::Series;
use crate::replay::tests::{compass_of_flown_turns, evaluation_of_compasses};

type FlightChange = fn(&mut Flight);

/// Warnings about a flawless log after a change.
fn warnings_after(change: FlightChange) -> Vec<String> {
    let mut flight = Flight::new(LogFormat::DataFlash);
    flight.autopilot = Autopilot::ArduPilot;
    flight.parameters.set_value(0.0, "COMPASS_OFS_X", 1.0);
    flight.attitude.push_row(0.0, [0.5, 0.0, 0.0]);
    flight.body_rates.push_row(0.0, [0.0; 3]);
    flight.battery_current.push_row(0.0, [10.0]);
    change(&mut flight);
    let evaluation =
        FlightEvaluation { compasses: Vec::new(), reference: None, earth_field: None, attitude_interval_s: 0.1 };
    LogWarning::warnings_of_flight(&flight, &evaluation).iter().map(ToString::to_string).collect()
}

#[test]
fn a_fault_of_a_log_gives_its_own_warning_only() {
    assert_eq!(warnings_after(|_| {}), [""; 0]);
    assert_eq!(warnings_after(|flight| flight.parameters.set_value(1.0, "COMPASS_MOTCT", 2.0)), [""; 0]);
    assert_eq!(warnings_after(|flight| flight.attitude.rows_mut()[0].row_values[0] = 0.02), [""; 0]);
    let cases: [(FlightChange, &str); 14] = [
        (
            |flight| {
                flight.rates_problem = Some(RatesProblem::NotLogged);
                flight.has_measured_rates = false;
            },
            "no body rates are logged: headings are without",
        ),
        (
            |flight| {
                flight.rates_problem = Some(RatesProblem::WrongSign(1));
                flight.has_measured_rates = true;
            },
            "about y has the sign opposite to the attitude's change; corrected by the attitude",
        ),
        (|flight| flight.rows_without_time = 1, "field rows carry no time"),
        (|flight| flight.fallback_attitude_message = Some("AHR2"), "that of AHR2 is used"),
        (|flight| flight.autopilot_component_ids = vec![1, 4], "component 1, received first, is evaluated, not 4"),
        (
            |flight| {
                flight.log_format = LogFormat::Csv;
                flight.attitude.rows_mut()[0].row_values[0] = 0.02;
            },
            "tilts by 1.15 deg at most",
        ),
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
    for (change, expected_text) in cases {
        let warning_texts = warnings_after(change);
        assert!(
            matches!(&warning_texts[..], [note] if note.contains(expected_text)),
            "{expected_text}: {warning_texts:?}"
        );
    }
}

/// Warnings that a change adds to those about the flown turns.
fn added_warnings(change: fn(&mut Flight, &mut FlightEvaluation)) -> Vec<String> {
    let (mut flight, compass) = compass_of_flown_turns();
    let mut evaluation = evaluation_of_compasses(vec![compass.clone(), compass]);
    let texts = |flight: &Flight, evaluation: &FlightEvaluation| -> Vec<String> {
        LogWarning::warnings_of_flight(flight, evaluation).iter().map(ToString::to_string).collect()
    };
    let before = texts(&flight, &evaluation);
    change(&mut flight, &mut evaluation);
    texts(&flight, &evaluation).into_iter().filter(|text| !before.contains(text)).collect()
}

/// The GPS course of a copter is not used as a reference.
fn make_copter(flight: &mut Flight) {
    flight.is_copter = true;
    for t_s in [10.0, 11.0] {
        flight.gps.push_row(t_s, [48.0, 11.0, 0.0, 20.0, 0.0, f32::NAN]);
    }
}

type EvaluationChange = fn(&mut Flight, &mut FlightEvaluation);

#[test]
fn a_fault_of_a_compass_gives_its_own_warning_only() {
    let cases: [(EvaluationChange, &str); 16] = [
        (|_, evaluation| evaluation.compasses[1].reading_interval_s = 0.25, "the field is logged 4.0 times a second"),
        (|_, evaluation| evaluation.compasses[0].reading_interval_s = 0.18, ""),
        (
            |_, evaluation| {
                (evaluation.compasses[1].latency.used_s, evaluation.compasses[1].latency.sigma_s) = (-0.15, Some(0.01));
            },
            "the attitude is logged 150 ms later",
        ),
        (
            |_, evaluation| {
                (evaluation.compasses[1].latency.used_s, evaluation.compasses[1].latency.sigma_s) = (-0.09, Some(0.01));
            },
            "",
        ),
        (|_, evaluation| evaluation.compasses[1].latency.used_s = -0.15, ""),
        (|_, evaluation| evaluation.compasses[1].row_counts.contradicting_attitude = 600, "in 25 % of the log"),
        (|_, evaluation| evaluation.compasses[1].row_counts.contradicting_attitude = 400, ""),
        (
            |flight, _| {
                flight.autopilot = Autopilot::ArduPilot;
                for (t_s, name) in [(30.0, "COMPASS_ORIENT"), (60.0, "AHRS_ORIENTATION")] {
                    flight.parameters.set_value(0.0, name, 0.0);
                    flight.parameters.set_value(t_s, name, 4.0);
                }
            },
            "changed in the log: AHRS_ORIENTATION at 60 s, COMPASS_ORIENT at 30 s; no calibration",
        ),
        (
            |flight, _| {
                let rows = flight.body_rates.rows().to_vec();
                flight.body_rates = Series::new();
                for (_, row) in rows.iter().enumerate().filter(|(i, _)| i % 11 != 0) {
                    flight.body_rates.push_row(row.t_s, row.row_values);
                }
            },
            "10 % of the body rates are lost",
        ),
        (|_, evaluation| evaluation.compasses[1].row_counts.readings = 0, "all its readings are zero, out of range"),
        (
            |flight, evaluation| {
                make_copter(flight);
                evaluation.reference = None;
            },
            "GPS course gives no heading here: a copter's nose",
        ),
        (
            |flight, evaluation| {
                make_copter(flight);
                evaluation.reference = Some(ReferenceHeading::AutopilotYaw);
            },
            "GPS course gives no heading here: a copter's nose",
        ),
        (
            |flight, evaluation| {
                make_copter(flight);
                evaluation.reference = Some(ReferenceHeading::GpsYaw);
            },
            "",
        ),
        (|_, evaluation| evaluation.reference = None, ""),
        (|_, evaluation| evaluation.compasses[1].sphere_radius_ut = Some(0.9951), "is 0.9951 uT strong"),
        (|_, evaluation| evaluation.compasses[1].sphere_radius_ut = Some(100.04), "is 100.0 uT strong"),
    ];
    for (i, (change, expected_text)) in cases.into_iter().enumerate() {
        let texts = added_warnings(change);
        assert_eq!(texts.len(), usize::from(!expected_text.is_empty()), "{i}: {texts:?}");
        assert!(texts.iter().all(|text| text.contains(expected_text)), "{expected_text}: {texts:?}");
    }
}

/// Only a table may have another unit.
#[test]
fn a_field_in_another_unit_is_recognised() {
    let (_, compass) = compass_of_flown_turns();
    for (found_ut, unit) in [
        (480.0, "milligauss read as microtesla"),
        (4.8, "microtesla read as milligauss"),
        (4800.0, "nanotesla read as milligauss"),
        (48_000.0, "nanotesla read as microtesla"),
        (0.48, "gauss read as microtesla"),
        (0.048, "gauss read as milligauss"),
        (1e6, "another unit, or a poor sensor"),
    ] {
        let compass = CompassEvaluation { sphere_radius_ut: Some(found_ut), ..compass.clone() };
        let evaluation = evaluation_of_compasses(vec![compass.clone()]);
        for (is_table, expected) in [(true, unit), (false, "a poor sensor, or little was flown")] {
            let warning = implausible_strength(&evaluation, &compass, is_table);
            assert!(
                matches!(warning, Some(LogWarning::ImplausibleStrength { cause, .. }) if cause == expected),
                "{found_ut} uT: {warning:?}"
            );
        }
    }
}
