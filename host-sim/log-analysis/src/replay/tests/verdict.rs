use super::*;
use crate::replay::log_warning::LogWarning;
use crate::replay::verdict::FlightOutcome;

fn warning_texts(flight: &Flight, evaluation: &FlightEvaluation) -> Vec<String> {
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
    assert!(verdict_at(Some(40.0)).ends_with("each of 2 compasses by itself at 40 s of the log, expecting 0.9 deg"));
    // Times less than 1.5 s apart are reported as one.
    assert!(verdict_at(Some(41.4)).contains("by itself at 40 s of"), "{}", verdict_at(Some(41.4)));
    assert!(verdict_at(Some(41.6)).contains("by itself at 40 to 42 s of"), "{}", verdict_at(Some(41.6)));
    assert!(verdict_at(Some(12.0)).contains("by itself at 12 to 40 s of"), "{}", verdict_at(Some(12.0)));
    assert!(
        verdict_at(None).contains("by a command at the end of the flight, expecting 0.9 deg"),
        "{}",
        verdict_at(None)
    );
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

/// The limit is 20 readings and 20 usable rows.
#[test]
fn a_log_with_under_20_usable_rows_is_the_cause_of_a_refusal() {
    let refused = |readings: usize, used_count: usize| {
        let (_, mut compass) = compass_of_flown_turns();
        (compass.module_result.acceptance, compass.module_result.collection_end_s) = (REFUSED_SOLVE, None);
        compass.row_counts =
            RowCounts { readings, used: used_count, disarmed: readings - used_count, ..RowCounts::default() };
        let module_refusal = compass.module_result.acceptance.as_ref().unwrap_err().to_string();
        FlightOutcome::new(&evaluation_of_compasses(vec![compass])).to_string().replace(&module_refusal, "its own")
    };
    assert!(refused(19, 19).ends_with("the log has 19 readings of the field, too few for a flight"));
    assert!(refused(20, 19).ends_with("of 20 readings of the field 19 are usable; 1 are disarmed"));
    assert_eq!(refused(20, 20), "the module would have refused: its own");
}

#[test]
fn the_refusal_of_the_compass_closest_to_acceptance_is_reported() {
    let compass_with = |compass_number: u8, readings: usize| {
        let (_, mut compass) = compass_of_flown_turns();
        (compass.module_result.acceptance, compass.module_result.collection_end_s) = (REFUSED_SOLVE, None);
        compass.row_counts = RowCounts { readings, used: readings, ..RowCounts::default() };
        CompassEvaluation { compass_number, ..compass }
    };
    let refusal = compass_with(1, 900).module_result.acceptance.unwrap_err();
    for (readings, expected_text) in [
        (900, format!("the module would have refused each of 2 compasses: {refusal}")),
        (10, format!("the module would have refused each of 2 compasses; number 2 came nearest: {refusal}")),
    ] {
        assert_eq!(
            FlightOutcome::new(&evaluation_of_compasses(vec![compass_with(1, readings), compass_with(2, 900)]))
                .to_string(),
            expected_text
        );
    }
}

fn strength_warning(sphere_radius_ut: f64, earth_ut: Option<f32>) -> String {
    use autoswing::earth::{Date, EarthField, Position};
    let (flight, compass) = compass_of_flown_turns();
    let mut verdict =
        evaluation_of_compasses(vec![CompassEvaluation { sphere_radius_ut: Some(sphere_radius_ut), ..compass }]);
    verdict.earth_field = earth_ut.map(|total_ut| {
        let field = EarthField::from_model(
            Position::new(48.0, 11.3, 500.0).unwrap(),
            Date::from_unix_s(1_767_484_800).unwrap(),
        );
        (EarthField { total_ut, ..field.unwrap() }, true)
    });
    warning_texts(&flight, &verdict)
        .into_iter()
        .find(|note| note.starts_with("compass 1: the field"))
        .unwrap_or_default()
}

/// The limits are a factor of 1.35 about the model, or about the Earth's range of 22 to 67 uT.
#[test]
fn an_implausible_field_strength_is_reported() {
    for (ut, is_reported) in [(48.0, false), (64.0, false), (66.0, true), (36.0, false), (35.0, true)] {
        assert_eq!(!strength_warning(ut, Some(48.0)).is_empty(), is_reported, "{ut} uT where there are 48");
    }
    for (ut, is_reported) in [(17.0, false), (16.0, true), (90.0, false), (91.0, true)] {
        assert_eq!(!strength_warning(ut, None).is_empty(), is_reported, "{ut} uT anywhere");
    }
    assert!(strength_warning(66.04, Some(48.0)).contains("the field is 66.0 uT strong, by the field model 48.0:"));
    assert!(strength_warning(0.04812, None).contains("the field is 0.0481 uT strong, the Earth's is 22 to 67:"));
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
    let note_without_all = warnings_without(&[]);
    assert!(
        note_without_all.len() == 1 && note_without_all[0].starts_with("the parameters are not in the log"),
        "{note_without_all:?}"
    );
}
