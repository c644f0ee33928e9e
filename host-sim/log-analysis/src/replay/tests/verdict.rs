use autoswing::calibration::AttitudeLatency;

use super::*;
use crate::log::LoggedCompass;
use crate::replay::log_warning::LogWarning;
use crate::replay::parameter_export::ParameterFormat;
use crate::replay::verdict::{CompassAction, CompassState, FlightOutcome, Verdict};

fn warning_texts(flight: &LoggedFlight, evaluation: &FlightEvaluation) -> Vec<String> {
    LogWarning::warnings_of_flight(flight, evaluation).iter().map(ToString::to_string).collect()
}

fn outcome_text_of_two_compasses(change: impl Fn(&mut CompassEvaluation)) -> String {
    let (_, first) = compass_of_flown_turns();
    let mut first = CompassEvaluation { compass_number: 1, ..first };
    first.module_result.collection_end_s = Some(40.0 - first.rows[0].t_s);
    let mut second = CompassEvaluation { compass_number: 2, ..first.clone() };
    for (compass, expected_deg) in [(&mut first, 0.52), (&mut second, 0.91)] {
        compass.module_result.solution.as_mut().unwrap().quality.expected_rms_deg = expected_deg;
    }
    change(&mut second);
    FlightOutcome::new(&evaluation_of_compasses(vec![first, second])).to_string()
}

#[test]
fn a_verdict_reports_the_worst_compass_s_time_and_accuracy() {
    let verdict_at = |at_s: Option<f64>| {
        outcome_text_of_two_compasses(|second| {
            second.module_result.collection_end_s = at_s.map(|at_s| at_s - second.rows[0].t_s);
        })
    };
    for (at_s, expected) in [
        (Some(40.0), "each of 2 compasses by itself at 40 s of the log, expecting 0.9 deg"),
        (Some(40.6), "by itself at 40 s of"),
        (Some(50.0), "by itself at 40 to 50 s of"),
        (Some(12.0), "by itself at 12 to 40 s of"),
        (None, "by a command at the end of the flight, expecting 0.9 deg"),
    ] {
        assert!(verdict_at(at_s).contains(expected), "{at_s:?}: {}", verdict_at(at_s));
    }
    let refused = outcome_text_of_two_compasses(|second| {
        (second.module_result.acceptance, second.module_result.collection_end_s) = (REFUSED_SOLVE, None);
    });
    assert!(refused.contains("1 of 2 compasses (number 1) by itself at 40 s of the log, expecting 0.5"), "{refused}");
}

#[test]
fn the_time_of_the_calibration_is_on_the_log_s_clock() {
    let (flight, mut compass) = compass_of_flown_turns();
    compass.module_result.collection_end_s = Some(70.0);
    let first_s = flight.time_range_s()[0];
    assert!(first_s > 1.0, "the recording does not start at zero: {first_s}");
    assert!((compass.calibration_time_s().unwrap() - first_s - 70.0).abs() < 0.2, "{:?}", compass.calibration_time_s());
    compass.module_result.collection_end_s = None;
    assert_eq!(compass.calibration_time_s(), None);
}

/// A compass that the module refuses, with numbers of readings and of usable rows.
fn refused_compass(compass_number: u8, readings: usize, used_count: usize) -> CompassEvaluation {
    let (_, mut compass) = compass_of_flown_turns();
    (compass.module_result.acceptance, compass.module_result.collection_end_s) = (REFUSED_SOLVE, None);
    compass.row_counts =
        RowCounts { readings, used: used_count, disarmed: readings - used_count, ..RowCounts::default() };
    CompassEvaluation { compass_number, ..compass }
}

#[test]
fn a_refusal_is_explained_by_the_log_or_by_the_compass_closest_to_acceptance() {
    let refusal = REFUSED_SOLVE.unwrap_err().to_string();
    for (compasses, expected) in [
        (vec![refused_compass(1, 10, 10)], "the log has 10 readings of the field, too few for a flight".to_owned()),
        (vec![refused_compass(1, 100, 10)], "of 100 readings of the field 10 are usable; 90 are disarmed".to_owned()),
        (vec![refused_compass(1, 100, 100)], format!("the module would have refused: {refusal}")),
        (
            vec![refused_compass(1, 900, 900), refused_compass(2, 900, 900)],
            format!("the module would have refused each of 2 compasses: {refusal}"),
        ),
        (
            vec![refused_compass(1, 10, 10), refused_compass(2, 900, 900)],
            format!("the module would have refused each of 2 compasses; number 2 came nearest: {refusal}"),
        ),
    ] {
        let text = FlightOutcome::new(&evaluation_of_compasses(compasses)).to_string();
        assert!(text.ends_with(&expected), "{expected}: {text}");
    }
}

#[test]
fn missing_parameters_are_reported() {
    let warnings_without = |names: &[&str]| {
        let (mut flight, compass) = compass_of_flown_turns();
        flight.parameters = log::ParameterHistory::default();
        for name in names {
            flight.parameters.set_value(0.0, name, 1.0);
        }
        warning_texts(&flight, &evaluation_of_compasses(vec![compass]))
            .into_iter()
            .filter(|note| note.contains("parameters"))
            .collect::<Vec<_>>()
    };
    assert_eq!(warnings_without(&["COMPASS_OFS_X", "COMPASS_OFS_Y", "COMPASS_OFS_Z", "COMPASS_OFS2_X"]), [""; 0]);
    let missing = "parameters that are not in the log, assumed unset: COMPASS_OFS_X, COMPASS_OFS_Z";
    assert_eq!(warnings_without(&["COMPASS_OFS_Y"]), [missing]);
}

#[test]
fn a_slow_attitude_is_reported_with_the_outcome() {
    let (_, compass) = compass_of_flown_turns();
    let outcome = |attitude_interval_s, acceptance| {
        let mut compass = compass.clone();
        compass.module_result.acceptance = acceptance;
        let evaluation = FlightEvaluation { attitude_interval_s, ..evaluation_of_compasses(vec![compass]) };
        FlightOutcome::new(&evaluation).to_string()
    };
    let slow = "the attitude is logged 2.5 times a second; below 3 Hz its interpolation is unreliable";
    assert!(outcome(0.4, Ok(())).ends_with(&format!(" deg; but {slow}")), "{}", outcome(0.4, Ok(())));
    assert!(outcome(0.4, REFUSED_SOLVE).ends_with(&format!("; and {slow}")), "{}", outcome(0.4, REFUSED_SOLVE));
    assert!(!outcome(0.2, Ok(())).contains(slow));
    assert!(outcome(0.2, Ok(())).starts_with("the module would have calibrated by itself at"));
}

/// A compass that the autopilot does not use, or that is hardly logged, is the last to decide.
#[test]
fn an_unused_compass_does_not_give_the_cause_of_a_refusal() {
    for (is_first_used, first_row_count, nearest) in
        [(Some(false), 2000, 2), (Some(true), 2000, 1), (None, 2000, 1), (Some(true), 10, 2)]
    {
        let mut compasses = [refused_compass(1, 2000, first_row_count), refused_compass(2, 2000, 2000)];
        compasses[0].is_used_for_heading = is_first_used;
        compasses[1].module_result.acceptance = Err(Refusal::NoSamples);
        for (compass, expected_rms_deg) in compasses.iter_mut().zip([1.0, 2.0]) {
            compass.module_result.solution.as_mut().unwrap().quality.expected_rms_deg = expected_rms_deg;
        }
        let text = FlightOutcome::new(&evaluation_of_compasses(compasses.into())).to_string();
        assert!(text.contains(&format!("; number {nearest} came nearest: ")), "{text}");
    }
}

/// Three compasses of which the last is in use, and half of the usable rows without a heading that the module sends.
fn evaluation_of_three() -> (LoggedFlight, FlightEvaluation) {
    let (mut flight, compass) = compass_of_flown_turns();
    let logged = |compass_number| LoggedCompass { compass_number, ..flight.compasses[0].clone() };
    flight.compasses = [1, 2, 3].map(logged).into();
    let numbered = |(compass_number, is_used_for_heading)| CompassEvaluation {
        compass_number,
        is_used_for_heading,
        ..compass.clone()
    };
    let mut evaluation = evaluation_of_compasses([(1, Some(false)), (2, None), (3, Some(true))].map(numbered).into());
    evaluation.reference = Some(ReferenceHeading::Simulator);
    let compass = &mut evaluation.compasses[0];
    for (i, (row, heading)) in compass.rows.iter_mut().zip(&mut compass.module_result.headings).enumerate() {
        row.is_usable = i % 3 != 0;
        heading.status = if i % 3 == 1 { Err(autoswing::heading::NoHeading::SensorSilent) } else { Ok(()) };
    }
    (flight, evaluation)
}

#[test]
fn the_compass_in_use_comes_first_and_decides() {
    let (flight, evaluation) = evaluation_of_three();
    let mut verdict = Verdict::new(&flight, &evaluation, ParameterFormat::ArduPilot);
    let numbers: Vec<u8> =
        verdict.compasses_in_use_first().iter().map(|compass| compass.evaluation.compass_number).collect();
    assert_eq!(numbers, [3, 2, 1]);
    assert!(verdict.would_module_calibrate());
    let sentences = verdict.summary_sentences();
    assert!(sentences[0].starts_with("Compass 3, in use, is off by") && sentences[0].ends_with(": load them."));
    assert!(sentences[1].starts_with("Compass 2 is off by") && sentences.len() == 3, "{sentences:?}");
    assert_eq!(
        verdict.exported_corrections().iter().map(|export| export.compass_number).collect::<Vec<_>>(),
        [1, 2, 3]
    );
    assert_eq!(verdict.compasses[0].sent_percent(), Some(50.0));
    for (compass_state, recommended_action, is_good_or_correctable) in [
        (CompassState::Good, CompassAction::LeaveUnchanged, true),
        (CompassState::Bad, CompassAction::LoadParameters, true),
        (CompassState::Unjudged, CompassAction::FlyAgain, false),
    ] {
        let judgement = &mut verdict.compasses[2].judgement;
        (judgement.compass_state, judgement.recommended_action) = (compass_state, recommended_action);
        assert_eq!(verdict.state_of_compass_in_use(), compass_state);
        assert_eq!(verdict.is_good_or_correctable(), is_good_or_correctable, "{compass_state}");
    }
    assert_eq!(verdict.exported_corrections().len(), 2);
    verdict.module_outcome = FlightOutcome::new(&evaluation_of_compasses(Vec::new()));
    assert!(!verdict.would_module_calibrate());
}

#[test]
fn the_log_is_described_by_format_firmware_and_time() {
    let (mut flight, evaluation) = FLOWN_TURNS.clone();
    flight.firmware_name = Some("ArduPlane V4.6".to_owned());
    let verdict = Verdict::new(&flight, &evaluation, ParameterFormat::ArduPilot);
    assert_eq!(
        verdict.log_description("turns.bin"),
        "turns.bin: ArduPilot DataFlash, ArduPlane V4.6, 238 s: 2 to 240 s of its clock"
    );
}

/// The table, the facts and the JSON object report the numbers of the evaluation, rounded.
#[test]
fn reports_contain_the_numbers_of_the_evaluation() {
    let (flight, mut evaluation) = FLOWN_TURNS.clone();
    evaluation.reference = Some(ReferenceHeading::Simulator);
    evaluation.compasses[0].latency = field_latency::FieldLatency { used_s: 0.0463, sigma_s: Some(0.0081) };
    let solution = evaluation.compasses[0].module_result.solution.as_mut().unwrap();
    (solution.calibration.latency_s, solution.quality.latency) =
        (0.05, Some(AttitudeLatency { estimate_s: 0.0521, sigma_s: 0.0043 }));
    let motor = &mut solution.calibration.motor_current;
    (motor.mean_current_a, motor.current_sigma_a, motor.sigma_ut_per_a) = (12.34, 5.67, 0.0123);
    let verdict = Verdict::new(&flight, &evaluation, ParameterFormat::ArduPilot);
    let compass = &evaluation.compasses[0];
    let exported = verdict.compasses[0].parameters_to_load().unwrap();
    let held_back_deg = exported.held_back_score.unwrap().rms_deg;

    let table = verdict.rms_by_correction_deg();
    let rms_deg = |source| compass.correction_from(source).unwrap().score.map(|score| score.rms_deg);
    assert_eq!(table[0], ("uncorrected", vec![rms_deg(evaluation::CorrectionSource::Uncorrected)]));
    assert!(table.contains(&("module", vec![rms_deg(evaluation::CorrectionSource::Module)])));
    assert_eq!(table.last(), Some(&("parameters to load", vec![Some(held_back_deg)])));

    let facts = verdict.key_facts(&verdict.compasses[0]);
    let fact = |name: &str| facts.iter().find(|fact| fact[0] == name).map_or("", |fact| fact[1].as_str());
    assert_eq!(
        fact("field"),
        "10.0 times a second, 46 ms old at its time stamp (estimated from this flight, sigma 8 ms)"
    );
    assert_eq!(
        fact("motor current"),
        "no interference that is certain (sigma 0.012 uT/A), of 12.3 A that varied by 5.7 A"
    );
    assert_eq!(fact("attitude latency"), "52 ms more than the age of the field, sigma 4 ms");
    assert!(fact("parameters").starts_with("fitted to "), "{facts:?}");
    let calibrated_s = compass.calibration_time_s().unwrap();
    assert_eq!(fact("module"), format!("would have calibrated itself at {calibrated_s:.0} s of the log"));
    assert_eq!((fact("all rows, thinned"), fact("autopilot")), ("", ""));

    let json = verdict.json();
    let object = &json["compasses"][0];
    assert_eq!(json["notes"], serde_json::json!(warning_texts(&flight, &evaluation)));
    assert_eq!(json["module_verdict"], verdict.module_outcome.to_string());
    assert_eq!(json["log"]["attitude_hz"], 10.0);
    let decimals = |value: f64| numbers::round_to(value, 3);
    let expected_rms_deg = f64::from(compass.module_result.solution.unwrap().quality.expected_rms_deg);
    assert_eq!(object["module"]["expected_rms_deg"], decimals(expected_rms_deg));
    assert_eq!(object["module"]["by_current"]["mean_a"], 12.34);
    assert_eq!(object["all_rows"]["by_current"], serde_json::Value::Null);
    assert_eq!(object["field_age_ms"], 46.3);
    assert_eq!(object["parameters"]["heading_rms_deg"], decimals(held_back_deg));
    let uncorrected = &object["headings"][0]["against_reference"];
    assert_eq!(uncorrected["heading_rms_deg"], decimals(table[0].1[0].unwrap()));
    assert_eq!(uncorrected["within_two_sigma_percent"], serde_json::Value::Null);
    let within_percent = object["module"]["smooth"]["within_two_sigma_percent"].as_f64().unwrap();
    assert!((80.0..=100.0).contains(&within_percent), "{within_percent}");
    assert_eq!(object["module"]["latency_found_ms"], 52.1);
}

/// Facts about parameters are shown if they are to be loaded, and the result of all rows if it differs.
#[test]
fn facts_depend_on_action_and_outcome() {
    let (flight, evaluation) = FLOWN_TURNS.clone();
    let verdict_facts = |evaluation: &FlightEvaluation, recommended_action| {
        let mut verdict = Verdict::new(&flight, evaluation, ParameterFormat::ArduPilot);
        verdict.compasses[0].judgement.recommended_action = recommended_action;
        verdict.key_facts(&verdict.compasses[0])
    };
    let has = |facts: &[[String; 2]], name: &str| facts.iter().any(|fact| fact[0] == name);
    assert!(!has(&verdict_facts(&evaluation, CompassAction::Replace), "parameters"));
    for (module, all_rows, expected) in
        [(Ok(()), REFUSED_SOLVE, "would have been refused: "), (REFUSED_SOLVE, Ok(()), "would have been accepted")]
    {
        let mut evaluation = evaluation.clone();
        let compass = &mut evaluation.compasses[0];
        (compass.module_result.acceptance, compass.all_rows_result.acceptance) = (module, all_rows);
        compass.row_counts.readings = 0;
        let facts = verdict_facts(&evaluation, CompassAction::FlyAgain);
        let fact = facts.iter().find(|fact| fact[0] == "all rows, thinned").unwrap();
        assert!(fact[1].starts_with(expected), "{facts:?}");
        assert!(!has(&facts, "field") && !has(&facts, "motor current"), "{facts:?}");
    }
}
