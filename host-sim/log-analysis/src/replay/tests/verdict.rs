use autoswing::calibration::{AttitudeLatency, Solution};

use super::*;
use crate::log::LoggedCompass;
use crate::replay::log_warning::warnings_of_flight;
use crate::replay::verdict::{CompassAction, CompassState, Verdict};

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
    for (i, (row, heading)) in
        compass.rows.iter_mut().zip(&mut compass.module_result.as_mut().unwrap().headings).enumerate()
    {
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
        assert_eq!(verdict.compass_in_use().unwrap().judgement.compass_state, compass_state);
        assert_eq!(verdict.is_good_or_correctable(), is_good_or_correctable, "{compass_state:?}");
    }
    assert_eq!(verdict.exported_corrections().len(), 2);
}

#[test]
fn compasses_that_are_not_used_do_not_decide() {
    let (flight, mut evaluation) = evaluation_of_three();
    evaluation.compasses.iter_mut().for_each(|compass| compass.is_used_for_heading = Some(false));
    let mut verdict = Verdict::new(&flight, &evaluation, ParameterFormat::ArduPilot);
    verdict.compasses.iter_mut().for_each(|compass| compass.judgement.recommended_action = CompassAction::FlyAgain);
    let json = verdict.json();
    assert!(json["in_use"].is_null() && json["state"].is_null(), "{json}");
    assert!(verdict.is_good_or_correctable());
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
    let solution = &mut evaluation.compasses[0].parameter_fit.fit.as_mut().unwrap().solution;
    (solution.calibration.latency_s, solution.quality.latency) =
        (0.05, Some(AttitudeLatency { estimate_s: 0.0521, sigma_s: 0.0043 }));
    let motor = &mut solution.calibration.motor_current;
    (motor.mean_current_a, motor.current_sigma_a, motor.sigma_ut_per_a) = (12.34, 5.67, 0.0123);
    let verdict = Verdict::new(&flight, &evaluation, ParameterFormat::ArduPilot);
    let compass = &evaluation.compasses[0];
    let exported = verdict.compasses[0].parameters_to_load().unwrap();
    let held_back_deg = exported.held_back_score.unwrap().rms_deg;

    let table = verdict.rms_by_correction_deg();
    let rms_deg = |source| Some(compass.score_by(source).unwrap().rms_deg);
    assert_eq!(table[0], ("uncorrected", vec![rms_deg(CorrectionSource::Uncorrected)]));
    assert!(table.contains(&("module", vec![rms_deg(CorrectionSource::Module)])));
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
    assert_eq!(fact("autopilot"), "");

    let json = verdict.json();
    let object = &json["compasses"][0];
    assert_eq!(json["notes"], serde_json::json!(warnings_of_flight(&flight, &evaluation)));
    assert_eq!(json["log"]["attitude_hz"], 10.0);
    let decimals = |value: f64| numbers::round_to(value, 3);
    let expected_rms_deg = |solution: &Solution| decimals(f64::from(solution.quality.expected_rms_deg));
    assert_eq!(object["fit"]["expected_rms_deg"], expected_rms_deg(compass.parameter_fit.solution().unwrap()));
    assert_eq!(object["fit"]["by_current"]["mean_a"], 12.34);
    assert_eq!(
        object["module"]["fit"]["expected_rms_deg"],
        expected_rms_deg(&module_of(compass).outcome.solution.unwrap())
    );
    assert_eq!(object["field_age_ms"], 46.3);
    assert_eq!(object["parameters"]["heading_rms_deg"], decimals(held_back_deg));
    let uncorrected = &object["headings"][0]["against_reference"];
    assert_eq!(uncorrected["heading_rms_deg"], decimals(table[0].1[0].unwrap()));
    assert_eq!(uncorrected["within_two_sigma_percent"], serde_json::Value::Null);
    let within_percent = object["module"]["smooth"]["within_two_sigma_percent"].as_f64().unwrap();
    assert!((80.0..=100.0).contains(&within_percent), "{within_percent}");
    assert_eq!(object["fit"]["latency_found_ms"], 52.1);
}

/// Facts about parameters are shown if they are to be loaded, and those about a module if it is compared.
#[test]
fn facts_depend_on_action_and_comparison() {
    let (flight, mut evaluation) = FLOWN_TURNS.clone();
    let verdict_facts = |evaluation: &FlightEvaluation, recommended_action| {
        let mut verdict = Verdict::new(&flight, evaluation, ParameterFormat::ArduPilot);
        verdict.compasses[0].judgement.recommended_action = recommended_action;
        verdict.key_facts(&verdict.compasses[0])
    };
    let has = |facts: &[[String; 2]], name: &str| facts.iter().any(|fact| fact[0] == name);
    let facts = verdict_facts(&evaluation, CompassAction::Replace);
    assert!(!has(&facts, "parameters") && has(&facts, "module") && has(&facts, "field"), "{facts:?}");
    let compass = &mut evaluation.compasses[0];
    (compass.module_result, compass.row_counts.readings) = (None, 0);
    let facts = verdict_facts(&evaluation, CompassAction::LoadParameters);
    assert!(has(&facts, "parameters") && !has(&facts, "module") && !has(&facts, "field"), "{facts:?}");
}
