//! Choice and score of parameters: on flown turns, and on candidates with single properties.

use autoswing::calibration::{BankScaleFinding, DetectedHardIronChange, Finding, HardIronTimeCourse, Orientation};
use autoswing::frames::Field;

use nalgebra::{Matrix3, Vector3};

use super::super::parameter_fit::ParameterFit;
use super::super::result::EarthFieldPrior;
use super::*;
use crate::log::LogFormat;
use crate::replay::tests::{
    LEVEL_ROW_FIELD_UT, compass_of_flown_turns, evaluation_of_compasses, export_inputs, export_of, level_row,
};

/// Verified parameters with a heading error and a loss by the symmetric matrix, degrees, of a compass with an error as
/// logged.
fn candidate(rms_deg: f64, as_logged_rms_deg: f64, loss_deg: f64) -> ParameterCandidate {
    let mut solution = *compass_of_flown_turns().1.parameter_fit.solution().unwrap();
    solution.quality.expected_rms_deg = 1.9;
    (solution.hard_iron_change, solution.bank_scale_error) = (None, None);
    ParameterCandidate {
        solution,
        is_accepted: true,
        exported: ExportedCorrection { heading_loss_deg: [loss_deg, 0.0], ..export_of(FieldCorrection::identity()) },
        held_back: HeldBackScore { rms_deg, as_logged_rms_deg, is_estimate: false, field_scatter_deg: 1.0 },
        turned: None,
    }
}

/// The promise of docs/how-replay-works.md: a gain of 0.3 deg and of a fifth of the error as logged, and at most 2 deg, or at
/// most 5 deg of which all but 2 deg (in squares) is the loss by the autopilot's symmetric matrix.
#[test]
fn parameters_are_given_if_they_improve_a_compass_to_a_useful_accuracy() {
    for (rms_deg, as_logged_rms_deg, loss_deg, expected) in [
        (1.8, 9.0, 0.0, None),
        (1.0, 1.25, 0.0, Some("no-gain")),
        (1.0, 1.4, 0.0, None),
        (1.8, 2.15, 0.0, Some("no-gain")),
        (2.2, 9.0, 0.0, Some("inaccurate")),
        (2.2, 9.0, 1.2, None),
        (3.0, 9.0, 2.0, Some("inaccurate")),
        (4.5, 9.0, 4.3, None),
        (5.5, 9.0, 5.3, Some("inaccurate")),
    ] {
        let result = candidate(rms_deg, as_logged_rms_deg, loss_deg).check_usefulness(Some(1.0));
        let code = result.as_ref().err().map(NoParameters::stable_code);
        assert_eq!(code, expected, "{rms_deg} {as_logged_rms_deg} {loss_deg}");
    }
}

/// A rotation that the file does not correct is the reason where it causes most of the error, or turns all headings.
#[test]
fn a_rotation_that_is_not_corrected_is_the_reason() {
    let turned = TurnedSensor { rotation_from_logged: Matrix3::identity(), reason: FixedOrientation::NoneFree };
    for (rms_deg, as_logged_rms_deg, loss_deg, mean_deg, code) in [
        (6.0, 9.0, 5.0, 10.0, Some("turned")),
        (6.0, 9.0, 3.0, 10.0, Some("inaccurate")),
        (8.5, 9.0, 8.0, 10.0, Some("turned")),
        (4.8, 4.9, 4.7, 4.0, Some("no-gain")),
        (5.8, 5.9, 5.7, 4.0, Some("turned")),
        (1.0, 9.0, 0.5, 10.0, None),
        (1.0, 9.0, 0.5, 30.0, Some("turned")),
    ] {
        let mut candidate = candidate(rms_deg, as_logged_rms_deg, loss_deg);
        (candidate.turned, candidate.exported.heading_loss_deg[1]) = (Some(turned.clone()), mean_deg);
        let refusal = candidate.check_usefulness(Some(1.0)).err();
        assert_eq!(refusal.as_ref().map(NoParameters::stable_code), code, "{rms_deg} {loss_deg} {mean_deg}");
    }
}

#[test]
fn an_unverified_fit_needs_a_reference() {
    for (reference_sigma_deg, is_accepted, is_given) in
        [(None, false, false), (None, true, true), (Some(0.0), false, true), (Some(0.0), true, true)]
    {
        let candidate = ParameterCandidate { is_accepted, ..candidate(1.0, 9.0, 0.0) };
        let expected = if is_given { Ok(()) } else { Err(NoParameters::Unverified) };
        assert_eq!(candidate.check_usefulness(reference_sigma_deg), expected);
    }
}

/// The expected error is at most 2 deg. Residuals are the cause if they are more than half of it in squares.
#[test]
fn uncertain_parameters_are_refused_with_the_cause() {
    let time = DetectedHardIronChange { size_ut: 2.0, time_course: HardIronTimeCourse::Drift, duration_ms: 100_000 };
    let bank = BankScaleFinding { reported_bank_ratio: 0.9, significance_sigmas: 5.0 };
    for (expected_rms_deg, by_time_deg, by_bank_deg, expected) in [
        (1.9, 1.8, 1.8, ""),
        (2.1, 0.0, 0.0, "unobservable"),
        (f32::NAN, 0.0, 0.0, "unobservable"),
        (2.1, 1.3, 1.3, "unobservable"),
        (2.1, 1.6, 0.0, "the field late in the flight"),
        (2.1, 0.0, 1.6, "the field in steep banks"),
    ] {
        let mut candidate = candidate(1.0, 9.0, 0.0);
        let solution = &mut candidate.solution;
        solution.quality.expected_rms_deg = expected_rms_deg;
        solution.hard_iron_change =
            Some(Finding { violation: time, added_error_deg: by_time_deg, error_without_violation_deg: 0.0 });
        solution.bank_scale_error =
            Some(Finding { violation: bank, added_error_deg: by_bank_deg, error_without_violation_deg: 0.0 });
        let flight = LoggedFlight::new(LogFormat::DataFlash);
        let refusal = check_certainty(&flight, &candidate.solution).err();
        let found = refusal.map(|refusal| format!("{} {refusal}", refusal.stable_code())).unwrap_or_default();
        assert!(found.contains(expected) && found.is_empty() == expected.is_empty(), "{expected}: {found}");
    }
}

/// The hard iron differs between the halves, and each half's parameters have that of the other. The logged field is off
/// by 0.5 uT forward: RMS `b / H / sqrt 2` of the heading, of which strength and inclination show `b / H / 2`.
#[test]
fn each_half_is_scored_with_the_parameters_of_the_other() {
    let hard_iron_ut = [Vector3::new(3.0, 1.0, 0.0), Vector3::new(0.0, -5.0, 2.0)];
    let rows: Vec<ReplayRow> = (0..720)
        .map(|i| {
            let mut row = level_row(f64::from(i), f64::from(i) * 7.0);
            row.raw_field.ut += hard_iron_ut[half_index_at(row.t_s)].map(|axis| axis as f32);
            row.logged_field.ut.x += 0.5;
            row
        })
        .collect();
    let corrections =
        [1, 0].map(|half| FieldCorrection { hard_iron_ut: hard_iron_ut[half], ..FieldCorrection::identity() });
    let flight = LoggedFlight::new(LogFormat::DataFlash);
    let score = |lost_ut: f64, has_reference: bool| {
        let halves = corrections.map(|mut correction| {
            correction.hard_iron_ut.x += lost_ut;
            export_of(correction)
        });
        let rows: Vec<ReplayRow> = rows
            .iter()
            .map(|row| ReplayRow { reference_deg: row.reference_deg.filter(|_| has_reference), ..*row })
            .collect();
        let inputs = export_inputs(&rows, ParameterFormat::ArduPilot);
        score_held_back(&flight, &inputs, &halves, &corrections, has_reference).unwrap()
    };
    let error_deg = (0.5 / LEVEL_ROW_FIELD_UT[0]).to_degrees();
    for (lost_ut, has_reference, rms_deg, as_logged_rms_deg) in [
        (0.0, true, 0.0, error_deg / 2_f64.sqrt()),
        (0.5, true, error_deg / 2_f64.sqrt(), error_deg / 2_f64.sqrt()),
        (0.0, false, 0.0, error_deg / 2.0),
        (0.5, false, error_deg / 2_f64.sqrt(), error_deg / 2.0),
    ] {
        let score = score(lost_ut, has_reference);
        assert_eq!(score.is_estimate, !has_reference);
        // Second order of the error, and two decimals of a milligauss.
        let differences =
            [score.rms_deg - rms_deg, score.as_logged_rms_deg - as_logged_rms_deg, score.field_scatter_deg];
        assert!(differences.iter().all(|difference| difference.abs() < 0.02), "{has_reference}: {score:?}");
    }
}

fn choose(flight: &LoggedFlight, evaluation: &CompassEvaluation) -> Result<ExportedCorrection, NoParameters> {
    choose_terms(flight, evaluation, CorrectedTerms::All)
}

fn choose_terms(
    flight: &LoggedFlight,
    compass: &CompassEvaluation,
    corrected_terms: CorrectedTerms,
) -> Result<ExportedCorrection, NoParameters> {
    let reference = Some(ReferenceHeading::Simulator);
    let evaluation = FlightEvaluation { reference, corrected_terms, ..evaluation_of_compasses(Vec::new()) };
    choose_parameters(flight, &evaluation, compass, ParameterFormat::ArduPilot, Err(FixedOrientation::NotLogged))
}

/// The errors of all choices are those of the files. Offsets alone leave the soft iron, and a strong field as it is, which the
/// scale corrects.
#[test]
fn a_file_corrects_the_chosen_terms() {
    let (flight, mut evaluation) = compass_of_flown_turns();
    let motor = &mut evaluation.parameter_fit.fit.as_mut().unwrap().solution.calibration.motor_current;
    (motor.ut_per_a, motor.sigma_ut_per_a, motor.current_sigma_a) = ([0.02, 0.0, 0.0], 0.001, 20.0);
    let exported = [CorrectedTerms::All, CorrectedTerms::Offsets, CorrectedTerms::Scale]
        .map(|terms| choose_terms(&flight, &evaluation, terms).unwrap());
    let [all_deg, offsets_deg, scale_deg] = exported.each_ref().map(|of| of.held_back_score.unwrap().rms_deg);
    assert!(all_deg < 1.0 && offsets_deg > all_deg + 0.5 && offsets_deg < 10.0, "{all_deg} {offsets_deg}");
    assert!((scale_deg - offsets_deg).abs() < 0.01, "{scale_deg} {offsets_deg}");
    assert_eq!(exported.each_ref().map(|of| of.rms_by_terms_deg.unwrap()[0].to_bits()), [all_deg.to_bits(); 3]);
    assert_eq!(exported[0].rms_by_terms_deg, exported[1].rms_by_terms_deg);
    let [all, offsets, scale] = exported.each_ref().map(|of| &of.correction);
    assert!(all.motor_ut_per_a.x > 0.0 && offsets.motor_ut_per_a.norm() + scale.motor_ut_per_a.norm() == 0.0);
    assert_eq!(offsets.matrix, Matrix3::identity());
    let factor = scale.matrix[(0, 0)];
    assert!((factor - all.matrix.trace() / 3.0).abs() < 0.05 && (factor - 1.0).abs() > 0.001, "{factor}");
    assert_eq!(scale.matrix, Matrix3::identity() * factor);
    let used = exported[1].clone();
    evaluation.rows.iter_mut().for_each(|row| {
        row.logged_field = Field::new(
            (used.correction.matrix * (row.raw_field.ut.map(f64::from) - used.correction.hard_iron_ut))
                .map(|axis| axis as f32),
        );
    });
    let refusal = choose_terms(&flight, &evaluation, CorrectedTerms::Offsets).unwrap_err();
    assert_eq!(refusal.stable_code(), "no-gain", "{refusal}");
}

/// A sensor turned by right angles is fitted in that mounting, both halves too, and as well as an aligned one.
#[test]
fn a_sensor_turned_by_right_angles_is_fitted_in_its_mounting() {
    let (flight, evaluation) = compass_of_flown_turns();
    let aligned = choose(&flight, &evaluation).unwrap().held_back_score.unwrap();
    for name in ["none", "yaw90", "yaw180", "roll180", "pitch180", "roll270-pitch90"] {
        let mount = Orientation::from_name(name).unwrap();
        let sensor_from_body = mount.body_from_sensor().transpose().map(f64::from);
        let rows: Vec<ReplayRow> = evaluation.rows.iter().map(|row| row.in_rotated_axes(&sensor_from_body)).collect();
        let fit = ParameterFit::new(&rows, None, &EarthFieldPrior::default());
        let fit = fit.fit.unwrap();
        assert_eq!(fit.mount, mount);
        let inputs = export_inputs(&rows, ParameterFormat::Inav);
        let candidate = ParameterCandidate::new(&flight, &inputs, &fit, &fit.fits_of_halves(&rows), true).unwrap();
        // INAV's matrix is diagonal.
        let rms_deg = candidate.held_back.rms_deg;
        assert!((rms_deg - aligned.rms_deg).abs() < 0.3, "{}: {rms_deg}", mount.orientation_name());
    }
}

/// Ten seconds of flight determine no parameters, and a few rows with a reference do not judge them. The autopilot
/// rejects offsets beyond its limit.
#[test]
fn parameters_need_enough_rows_and_offsets_within_the_limit() {
    let (mut flight, mut evaluation) = compass_of_flown_turns();
    let exported = choose(&flight, &evaluation).unwrap();
    assert_eq!(exported.fitted_range_s, evaluation.parameter_fit.fitted_range_s);
    let score = exported.held_back_score.unwrap();
    // Hard iron of 9.6 uT at 31 uT horizontal: 12 deg RMS.
    assert!(score.rms_deg < 1.0 && score.as_logged_rms_deg > 10.0 && !score.is_estimate, "{score:?}");
    let offset_mg = exported.largest_offset_mg();
    for (limit_mg, is_too_large) in [(0.9 * offset_mg, true), (1.1 * offset_mg, false)] {
        flight.parameters.set_value(0.0, "COMPASS_OFFS_MAX", limit_mg);
        let refusal = is_too_large.then_some(NoParameters::OffsetsTooLarge { offset_mg, limit_mg });
        assert_eq!(choose(&flight, &evaluation).err(), refusal);
    }
    for row in evaluation.rows.iter_mut().filter(|row| row.is_usable).skip(30) {
        row.reference_deg = None;
    }
    assert!(choose(&flight, &evaluation).unwrap().held_back_score.unwrap().is_estimate);
    let used_s: Vec<f64> = evaluation.rows.iter().filter(|row| row.is_usable).map(|row| row.t_s).collect();
    evaluation.parameter_fit.fitted_range_s = Some([used_s[0], used_s[89]]);
    assert_eq!(choose(&flight, &evaluation), Err(NoParameters::FewRows(90)));
}

/// Interference that the autopilot does not compensate is not among its parameters.
#[test]
fn interference_is_given_if_the_autopilot_compensates_it() {
    let (mut flight, mut evaluation) = compass_of_flown_turns();
    let fit = evaluation.parameter_fit.fit.as_mut().unwrap();
    let motor = &mut fit.solution.calibration.motor_current;
    (motor.ut_per_a, motor.sigma_ut_per_a, motor.current_sigma_a) = ([0.02, 0.0, 0.0], 0.001, 20.0);
    for (second_slots_ut_per_a, is_compensated) in [(0.0, true), (3.0, false)] {
        flight.parameters.set_value(0.0, "COMPASS_MOTCT", 1.0);
        flight.parameters.set_value(0.0, "COMPASS_MOT2_X", second_slots_ut_per_a);
        let exported = choose(&flight, &evaluation).unwrap();
        assert_eq!(exported.correction.motor_ut_per_a != Vector3::zeros(), is_compensated);
    }
}
