use crate::log::LoggedFlight;
use autoswing::earth::{Date, EarthField, Position};

use super::*;
use crate::replay::ReferenceHeading;
use crate::replay::field_change::HardIronChange;
use crate::replay::parameter_export::ParameterFormat;
use crate::replay::tests::{FLOWN_TURNS, REFUSED_SOLVE, module_mut};

fn report_after_change(change: impl Fn(&mut LoggedFlight, &mut FlightEvaluation)) -> Report {
    let (mut flight, mut verdict) = FLOWN_TURNS.clone();
    change(&mut flight, &mut verdict);
    report_replay(&Verdict::new(&flight, &verdict, ParameterFormat::ArduPilot), "flight.bin", &ReportOrigin::default())
}

fn fact(report: &Report, name_wanted: &str) -> Option<String> {
    report.compasses[0].facts.iter().find(|[name, _]| name == name_wanted).map(|[_, words]| words.clone())
}

#[test]
fn a_refused_calibration_is_labelled_as_refused() {
    let automatic = report_after_change(|_, _| {});
    let refused =
        report_after_change(|_, verdict| module_mut(&mut verdict.compasses[0]).outcome.acceptance = REFUSED_SOLVE);
    for (report, mark, expected_text) in [
        (&automatic, "would have calibrated", "would have calibrated itself at"),
        (&refused, "would have solved", "would have been refused: not-converged"),
    ] {
        let compass = &report.compasses[0];
        assert_eq!(compass.event_marks[0].event_name, mark);
        assert!(fact(report, "module").unwrap().starts_with(expected_text), "{:?}", compass.facts);
    }
    let on_request =
        report_after_change(|_, verdict| module_mut(&mut verdict.compasses[0]).outcome.collection_end_s = None);
    assert!(on_request.compasses[0].event_marks.is_empty());
    assert_eq!(fact(&on_request, "module").unwrap(), "would have calibrated by a command at the end");
}

#[test]
fn calibration_and_hard_iron_step_are_marked_at_their_times() {
    let report = report_after_change(|_, verdict| {
        let compass = &mut verdict.compasses[0];
        // 30 s of the log precede the first row.
        compass.rows.drain(..300);
        let at_s = compass.rows[0].t_s + 50.0;
        module_mut(compass).outcome.collection_end_s = Some(90.0);
        compass.causes.hard_iron_changes = vec![HardIronChange {
            time_s: at_s,
            step_ut: Vector3::new(1.0, -8.0, 0.0),
            sigma_ut: Vector3::repeat(0.1),
            heading_effect_deg: 15.0,
        }];
    });
    let [calibrated, changed] = report.compasses[0].event_marks.as_slice() else { panic!("two marks") };
    // Times are on the log's clock.
    let first_s = FLOWN_TURNS.1.compasses[0].rows[300].t_s;
    assert!((calibrated.time_s - first_s - 90.0).abs() < 1e-9 && (changed.time_s - first_s - 50.0).abs() < 1e-9);
    assert_eq!(changed.event_name, "iron changed by 8.1 uT");
}

#[test]
fn a_field_model_of_another_year_is_reported() {
    for (is_valid, expected_text) in [(true, "by the field model"), (false, "by the field model, of another year")] {
        let report = report_after_change(|_, verdict| {
            let day = Date::from_unix_s(1_767_484_800).unwrap();
            let earth = EarthField::from_model(Position::new(48.0, 11.3, 500.0).unwrap(), day).unwrap();
            verdict.earth_field = Some((earth, is_valid));
        });
        assert!(fact(&report, "strength").unwrap().ends_with(expected_text), "{expected_text}");
    }
}

#[test]
fn the_before_curve_is_the_autopilot_s_correction() {
    let logged = report_after_change(|_, _| {});
    let raw = report_after_change(|_, verdict| {
        verdict.compasses[0].heading_scores.retain(|(source, _)| *source != CorrectionSource::Autopilot);
    });
    let rows = &FLOWN_TURNS.1.compasses[0].rows;
    for (report, name, is_logged_field_corrected) in [(&logged, "as logged", true), (&raw, "uncorrected", false)] {
        let compass = &report.compasses[0];
        assert_eq!(compass.curves_before[0].curve_name, name);
        // Errors have their mean removed, so differences between rows are compared.
        let difference_deg = |i: usize| {
            let row = &rows[i];
            let ut = if is_logged_field_corrected { row.logged_field.ut } else { row.raw_field.ut };
            heading_deg(row, ut.map(f64::from)) - row.reference_deg.unwrap()
        };
        let error_before_deg = |i: usize| compass.samples[i].error_before_deg.unwrap();
        let off_deg =
            wrap_180(error_before_deg(500) - error_before_deg(1500) - (difference_deg(500) - difference_deg(1500)));
        assert!(off_deg.abs() < 1e-6, "{name}: {off_deg}");
    }
}

#[test]
fn differences_are_named_by_their_reference() {
    for (reference, word) in [
        (Some(ReferenceHeading::Simulator), "error"),
        (Some(ReferenceHeading::AutopilotYaw), "disagreement"),
        (None, "correction"),
    ] {
        let report = report_after_change(|_, verdict| {
            verdict.reference.clone_from(&reference);
            if reference.is_none() {
                verdict.compasses[0].rows.iter_mut().for_each(|row| row.reference_deg = None);
            }
        });
        assert_eq!(report.reference.difference_name, word);
        let has_card = crate::report::render_page(&report).contains("Deviation card");
        assert_eq!(has_card, word == "error", "a card is for a known accuracy");
        let usable = || report.compasses[0].samples.iter().filter(|report_sample| report_sample.is_usable).skip(20);
        assert_eq!(usable().all(|report_sample| report_sample.error_deg.is_some()), reference.is_some(), "{word}");
        // Without a reference, the difference between the module's and the autopilot's heading is shown.
        assert!(usable().all(|report_sample| report_sample.error_before_deg.is_some()), "{word}");
        assert_eq!(report.compasses[0].curves_after.is_empty(), reference.is_none(), "{word}");
    }
}

#[test]
fn use_of_the_compass_by_the_autopilot_is_reported() {
    for (is_used, expected_text) in
        [(Some(true), Some("uses it for its heading")), (Some(false), Some("does not use it")), (None, None)]
    {
        let report = report_after_change(|_, verdict| verdict.compasses[0].is_used_for_heading = is_used);
        assert_eq!(fact(&report, "autopilot").as_deref(), expected_text);
    }
}
