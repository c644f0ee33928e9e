use nalgebra::Vector3;

use super::*;
use crate::log::FieldCorrection;
use crate::replay::bending_load::BendingCause;
use crate::replay::evaluation::FieldCauses;
use crate::replay::field_change::HardIronChange;
use crate::replay::logged_accuracy::AccuracyEvidence;
use crate::replay::tests::{compass_of_flown_turns, export_of};

const HELD_BACK: HeldBackScore =
    HeldBackScore { rms_deg: 1.0, as_logged_rms_deg: 20.0, is_estimate: false, field_scatter_deg: 1.0 };

fn held_back(rms_deg: f64) -> HeldBackScore {
    HeldBackScore { rms_deg, field_scatter_deg: rms_deg, ..HELD_BACK }
}

/// A compass is replaced if no parameters help: offsets beyond the limit, a loss by the symmetric matrix, or an error of
/// over 5 deg that the scatter of the field explains. An unjudged compass is neither replaced nor left.
#[test]
fn the_action_without_parameters_follows_from_their_reason() {
    use CompassAction::{FlyAgain, LeaveUnchanged, Replace};
    use CompassState::{Bad, Fair, Good, Unjudged};
    let no_gain = |rms_deg| NoParameters::NoGain(held_back(rms_deg));
    let inaccurate = |rms_deg, inexpressible_error_deg| NoParameters::Inaccurate {
        held_back: held_back(rms_deg),
        inexpressible_error_deg,
    };
    let estimate = HeldBackScore { is_estimate: true, ..held_back(9.0) };
    let by_attitude = HeldBackScore { field_scatter_deg: 4.0, ..held_back(9.0) };
    for (compass_state, rejection, expected) in [
        (Fair, NoParameters::OffsetsTooLarge { offset_mg: 2000.0, limit_mg: 1800.0 }, Replace),
        (Good, NoParameters::OffsetsTooLarge { offset_mg: 2000.0, limit_mg: 1800.0 }, LeaveUnchanged),
        (Bad, no_gain(4.0), FlyAgain),
        (Bad, no_gain(6.0), Replace),
        (Bad, NoParameters::NoGain(estimate), FlyAgain),
        (Bad, NoParameters::NoGain(by_attitude), FlyAgain),
        (Fair, no_gain(1.0), LeaveUnchanged),
        (Unjudged, no_gain(1.0), FlyAgain),
        (Unjudged, no_gain(26.0), FlyAgain),
        (Bad, inaccurate(4.0, 3.0), Replace),
        (Bad, inaccurate(4.0, 2.0), FlyAgain),
        (Bad, inaccurate(6.0, 2.0), Replace),
        (Good, NoParameters::FewRows(9), LeaveUnchanged),
        (Fair, NoParameters::FewRows(9), FlyAgain),
    ] {
        let action = action_without_parameters(compass_state, &rejection);
        assert_eq!(action, expected, "{compass_state:?} {rejection:?}");
    }
}

fn exported(rms_deg: f64, is_estimate: bool) -> ExportedCorrection {
    let held_back_score = Some(HeldBackScore { is_estimate, ..held_back(rms_deg) });
    ExportedCorrection { held_back_score, ..export_of(FieldCorrection::identity()) }
}

const NO_GAIN: Result<ExportedCorrection, NoParameters> = Err(NoParameters::NoGain(HELD_BACK));

/// Judges a compass with this error as logged.
fn judge(
    accuracy: Result<f64, UnknownError>,
    causes: FieldCauses,
    parameters: &Result<ExportedCorrection, NoParameters>,
    failure: Option<SensorFailure>,
) -> CompassJudgement {
    let compass = CompassEvaluation { causes, sensor_failure: failure, ..compass_of_flown_turns().1 };
    let by_rates = |rms_deg| LoggedAccuracy { rms_deg, sector_count: 7, evidence: AccuracyEvidence::BodyRates };
    CompassJudgement::new(&compass, accuracy.map(by_rates), parameters)
}

/// A change of hard iron with this effect on headings.
fn changed_iron(effect_deg: Option<f64>) -> FieldCauses {
    let change = effect_deg.map(|heading_effect_deg| HardIronChange {
        time_s: 60.0,
        step_ut: Vector3::new(0.0, 4.0, 0.0),
        sigma_ut: Vector3::repeat(0.1),
        heading_effect_deg,
    });
    FieldCauses { hard_iron_changes: change.into_iter().collect(), ..FieldCauses::default() }
}

#[test]
fn the_state_follows_from_the_error_and_from_changes_of_hard_iron() {
    for (rms_deg, effect_deg, compass_state, reason_codes) in [
        (1.9, None, CompassState::Good, ["good-as-logged", "no-gain"].as_slice()),
        (2.1, None, CompassState::Fair, &["error-as-logged", "no-gain"]),
        (5.1, None, CompassState::Bad, &["error-as-logged", "no-gain"]),
        (1.9, Some(1.5), CompassState::Fair, &["iron-changed", "good-as-logged", "no-gain"]),
        (1.9, Some(6.0), CompassState::Bad, &["iron-changed", "good-as-logged", "no-gain"]),
    ] {
        let judgement = judge(Ok(rms_deg), changed_iron(effect_deg), &NO_GAIN, None);
        assert_eq!((judgement.compass_state, judgement.reason_codes().as_slice()), (compass_state, reason_codes));
    }
    let failed = judge(Ok(1.0), FieldCauses::default(), &Ok(exported(1.0, false)), Some(SensorFailure::NoReadings));
    assert_eq!((failed.compass_state, failed.recommended_action), (CompassState::Bad, CompassAction::Replace));
    assert_eq!(failed.reason_codes(), ["sensor-failed", "good-as-logged"]);
}

/// A load that bends headings by 12 deg makes a compass bad whose error is unknown; a good compass stays good.
#[test]
fn a_load_that_bends_headings_is_named_and_moved() {
    let cause = BendingCause::Periodic(2.0);
    let load = BendingLoad { cause, size_ut: 4.0, heading_effect_deg: 12.0, sigmas: 9.0 };
    let causes = FieldCauses { bending_loads: vec![load], ..FieldCauses::default() };
    for (accuracy, state, reason_codes) in [
        (Err(UnknownError::FewHeadings(1)), CompassState::Bad, ["bent-by-load"].as_slice()),
        (Ok(6.0), CompassState::Bad, &["bent-by-load", "error-as-logged", "no-gain"]),
        (Ok(1.0), CompassState::Good, &["good-as-logged", "no-gain"]),
    ] {
        let judgement = judge(accuracy, causes.clone(), &NO_GAIN, None);
        assert_eq!((judgement.compass_state, judgement.reason_codes().as_slice()), (state, reason_codes));
        let action = if state == CompassState::Bad { CompassAction::Replace } else { CompassAction::LeaveUnchanged };
        assert_eq!(judgement.recommended_action, action);
    }
}

#[test]
fn a_judgement_is_a_sentence_of_its_reasons_and_action() {
    let no_better = "a fit is no better: 1.0 deg RMS";
    let flown = "on 7 of 12 headings by the body rates";
    for (rms_deg, effect_deg, parameters, text) in [
        (1.62, None, NO_GAIN, format!("is good already (1.6 deg RMS {flown}): leave it as it is")),
        (3.2, None, NO_GAIN, format!("is off by 3.2 deg RMS {flown}; {no_better}: leave it as it is")),
        (
            6.5,
            None,
            Ok(exported(1.0, false)),
            format!("is off by 6.5 deg RMS {flown}; with these parameters 1.0: load them"),
        ),
        (
            6.5,
            None,
            Ok(exported(2.1, false)),
            format!(
                "is off by 6.5 deg RMS {flown}; with these parameters 2.1, part of it what they cannot express: load \
                 them"
            ),
        ),
        (
            1.6,
            Some(5.1),
            NO_GAIN,
            format!(
                "has other iron around it since 60 s, by 4.0 uT, which bends headings by up to 5 deg; since then it is \
                 good (1.6 deg RMS {flown}); {no_better}: fly again"
            ),
        ),
    ] {
        assert_eq!(judge(Ok(rms_deg), changed_iron(effect_deg), &parameters, None).to_string(), text);
    }
    let few_headings = judge(Err(UnknownError::FewHeadings(1)), FieldCauses::default(), &NO_GAIN, None);
    assert_eq!(
        few_headings.to_string(),
        "cannot be judged: it was flown on 1 of 12 headings: turn all the way round: fly again"
    );
    assert_eq!(
        (few_headings.compass_state, few_headings.recommended_action),
        (CompassState::Unjudged, CompassAction::FlyAgain)
    );
}
