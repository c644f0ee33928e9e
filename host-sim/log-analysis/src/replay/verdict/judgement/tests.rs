use super::*;
use crate::log::FieldCorrection;
use crate::replay::hard_iron_changes::LoggedHardIronChange;
use crate::replay::hard_iron_step::HardIronStep;
use crate::replay::tests::{compass_of_flown_turns, evaluation_of_compasses, export_of, level_row};

const HELD_BACK: HeldBackScore =
    HeldBackScore { rms_deg: 1.0, as_logged_rms_deg: 20.0, is_estimate: false, field_scatter_deg: 1.0 };

fn held_back(rms_deg: f64) -> HeldBackScore {
    HeldBackScore { rms_deg, field_scatter_deg: rms_deg, ..HELD_BACK }
}

/// A compass is replaced if no parameters help: offsets beyond the limit, a loss by the symmetric matrix, or an error of
/// over 5 deg that the scatter of the field explains. On few headings it is neither replaced nor left.
#[test]
fn the_action_without_parameters_follows_from_their_reason() {
    use CompassAction::{FlyAgain, LeaveUnchanged, Replace};
    let no_gain = |rms_deg| NoParameters::NoGain(held_back(rms_deg));
    let inaccurate = |rms_deg, inexpressible_error_deg| NoParameters::Inaccurate {
        held_back: held_back(rms_deg),
        inexpressible_error_deg,
    };
    let estimate = HeldBackScore { is_estimate: true, ..held_back(9.0) };
    let by_attitude = HeldBackScore { field_scatter_deg: 4.0, ..held_back(9.0) };
    for (compass_state, rejection, covers_headings, expected) in [
        (CompassState::Good, NoParameters::OffsetsTooLarge { offset_mg: 2000.0, limit_mg: 1800.0 }, true, Replace),
        (CompassState::Bad, no_gain(4.0), true, FlyAgain),
        (CompassState::Bad, no_gain(6.0), true, Replace),
        (CompassState::Bad, NoParameters::NoGain(estimate), true, FlyAgain),
        (CompassState::Bad, NoParameters::NoGain(by_attitude), true, FlyAgain),
        (CompassState::Doubtful, no_gain(1.0), true, LeaveUnchanged),
        (CompassState::Doubtful, no_gain(26.0), true, Replace),
        (CompassState::Doubtful, no_gain(1.0), false, FlyAgain),
        (CompassState::Doubtful, no_gain(26.0), false, FlyAgain),
        (CompassState::Bad, inaccurate(4.0, 3.0), true, Replace),
        (CompassState::Bad, inaccurate(4.0, 2.0), true, FlyAgain),
        (CompassState::Bad, inaccurate(6.0, 2.0), true, Replace),
        (CompassState::Good, NoParameters::FewRows(9), true, LeaveUnchanged),
        (CompassState::Doubtful, NoParameters::FewRows(9), true, FlyAgain),
    ] {
        let action = action_without_parameters(compass_state, &rejection, covers_headings);
        assert_eq!(action, expected, "{compass_state} {rejection:?} {covers_headings}");
    }
}

/// Evaluation of level flight on headings 30 deg apart. `logged_error_ut` is added to the logged field's x component;
/// `effect_deg` is the heading error of a change of hard iron, if there is one.
fn level_evaluation(
    sector_count: u8,
    rows_per_sector: u8,
    logged_error_ut: f32,
    effect_deg: Option<f64>,
) -> FlightEvaluation {
    let (_, mut compass) = compass_of_flown_turns();
    compass.rows = (0..sector_count * rows_per_sector)
        .map(|i| {
            // The first sector is that of -20 deg, the second that of 370 deg.
            let heading_deg =
                [-20.0, 370.0][usize::from(i % sector_count % 2)] + 30.0 * f64::from(i % sector_count / 2 * 2);
            let mut row = level_row(f64::from(i), heading_deg);
            row.logged_field.ut.x += logged_error_ut;
            row
        })
        .collect();
    compass.parameter_fit.fitted_range_s = Some([0.0, 1e3]);
    let hard_iron_step = HardIronStep { time_s: 60.0, step_ut: [0.0, 4.0, 0.0], sigma_ut: [0.1; 3] };
    compass.hard_iron_changes = effect_deg
        .map(|heading_effect_deg| LoggedHardIronChange { hard_iron_step, heading_effect_deg })
        .into_iter()
        .collect();
    FlightEvaluation { reference: Some(ReferenceHeading::Simulator), ..evaluation_of_compasses(vec![compass]) }
}

#[test]
fn a_compass_is_judged_on_four_sectors_of_five_rows() {
    for (sector_count, rows_per_sector, is_judged) in [(3, 20, false), (4, 4, false), (4, 5, true), (12, 5, true)] {
        let evaluation = level_evaluation(sector_count, rows_per_sector, 1.0, None);
        let rms_deg = as_logged_rms_deg(&evaluation, &evaluation.compasses[0]);
        assert_eq!(rms_deg.is_some(), is_judged, "{sector_count} sectors of {rows_per_sector}: {rms_deg:?}");
    }
}

fn exported(rms_deg: f64, is_estimate: bool) -> ExportedCorrection {
    let held_back_score = Some(HeldBackScore { is_estimate, ..held_back(rms_deg) });
    ExportedCorrection { held_back_score, ..export_of(FieldCorrection::identity()) }
}

const NO_GAIN: Result<ExportedCorrection, NoParameters> = Err(NoParameters::NoGain(HELD_BACK));

fn judge(
    evaluation: &FlightEvaluation,
    parameters: &Result<ExportedCorrection, NoParameters>,
    failure: Option<LogWarning>,
) -> CompassJudgement {
    CompassJudgement::new(evaluation, &evaluation.compasses[0], failure, parameters)
}

/// At 25 uT horizontal an error of 1 uT bends headings by 1.6 deg RMS.
#[test]
fn the_state_follows_from_the_error_and_from_changes_of_hard_iron() {
    for (error_ut, effect_deg, compass_state, reason_codes) in [
        (1.0, None, CompassState::Good, ["good-as-logged", "no-gain"].as_slice()),
        (2.0, None, CompassState::Doubtful, &["error-as-logged", "no-gain"]),
        (4.0, None, CompassState::Bad, &["error-as-logged", "no-gain"]),
        (1.0, Some(4.0), CompassState::Doubtful, &["iron-changed", "good-as-logged", "no-gain"]),
        (1.0, Some(6.0), CompassState::Bad, &["iron-changed", "good-as-logged", "no-gain"]),
    ] {
        let judgement = judge(&level_evaluation(12, 5, error_ut, effect_deg), &NO_GAIN, None);
        assert_eq!((judgement.compass_state, judgement.reason_codes().as_slice()), (compass_state, reason_codes));
    }
    let failed =
        judge(&level_evaluation(12, 5, 1.0, None), &Ok(exported(1.0, false)), Some(LogWarning::FieldMissing(1)));
    assert_eq!((failed.compass_state, failed.recommended_action), (CompassState::Bad, CompassAction::Replace));
    assert_eq!(failed.reason_codes(), ["sensor-failed", "good-as-logged"]);
}

#[test]
fn a_judgement_is_a_sentence_of_its_reasons_and_action() {
    let no_better = "a fit is no better: 1.0 deg RMS on held-back rows";
    for (error_ut, effect_deg, parameters, text) in [
        (1.0, None, NO_GAIN, "is good already (1.62 deg RMS): leave it as it is"),
        (2.0, None, NO_GAIN, &*format!("is off by 3.2 deg RMS; {no_better}: leave it as it is")),
        (4.0, None, Ok(exported(1.0, false)), "is off by 6.5 deg RMS; with these parameters 1.0: load them"),
        (
            4.0,
            None,
            Ok(exported(2.1, false)),
            "is off by 6.5 deg RMS; with these parameters 2.1, part of it what the autopilot's parameters cannot \
             express: load them",
        ),
        (
            1.0,
            Some(5.1),
            NO_GAIN,
            &*format!(
                "has other iron around it since 60 s, by 4.0 uT, which bends headings by up to 5 deg; is off by 1.6 \
                 deg RMS; {no_better}: fly again"
            ),
        ),
    ] {
        assert_eq!(judge(&level_evaluation(12, 5, error_ut, effect_deg), &parameters, None).to_string(), text);
    }
    assert_eq!(
        judge(&level_evaluation(3, 20, 1.0, None), &NO_GAIN, None).to_string(),
        format!("was flown on too few headings to be judged; {no_better}: fly again")
    );
    let without_reference = FlightEvaluation { reference: None, ..level_evaluation(12, 5, 1.0, None) };
    assert_eq!(
        judge(&without_reference, &Ok(exported(1.0, true)), None).to_string(),
        "cannot be compared with a heading of 2 deg or better in this log; with these parameters its field is \
         consistent to 1.0 deg, as logged to 20.0: load them"
    );
    assert_eq!([CompassState::Good, CompassState::Bad].map(|state| state.to_string()), ["good", "bad"]);
}
