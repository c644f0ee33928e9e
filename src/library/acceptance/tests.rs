//! Unit tests of `acceptance`.

use super::*;
use crate::calibration::tests::synthetic::{
    Airframe, Parts, exact_circle, free_samples, level_samples, typical_quality,
};
use crate::calibration::{
    Advice, AttitudeEnvelope, Deviation, HardIronTimeCourse, HeadingUncertainty, Manoeuvre, Method, Sample,
};

/// Calibration with this error of hard iron along x.
fn calibration_with_error(b_ut: f32) -> Calibration {
    Calibration {
        b_ut: [b_ut, 0.0, 0.0],
        inclination_rad: 1.0,
        total_ut: 50.0,
        ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION)
    }
}

fn candidate(b_ut: f32, quality: Quality) -> Solution {
    Solution {
        calibration: calibration_with_error(b_ut),
        quality,
        uncertainty: HeadingUncertainty::NO_UNCERTAINTY,
        advice: None,
        hard_iron_change: None,
        bank_scale_error: None,
    }
}

fn active_calibration(b_ut: f32, expected_rms_deg: f32) -> Incumbent {
    Incumbent { calibration: calibration_with_error(b_ut), quality: Some(typical_quality(expected_rms_deg)) }
}

fn no_calibration() -> Incumbent {
    Incumbent { calibration: calibration_with_error(9.0), quality: None }
}

/// Circle without iron. A hard-iron error b changes the field strength by up to b cos(inclination) / F, so scores
/// are proportional to b.
fn circle_samples(roll_deg: f32, sample_count: u16) -> Vec<Sample> {
    let airframe = Airframe { inclination_rad: 1.0, ..Airframe::with_hard_iron([0.0; 3]) };
    exact_circle(&airframe, roll_deg, sample_count)
}

/// Tests a candidate with these numbers of held-back samples of left turns, right turns and level flight.
fn evaluate_with_held_back(
    held_back_counts: [u16; 3],
    candidate: &Solution,
    incumbent: &Incumbent,
) -> Result<HeldBackScores, Rejection> {
    let circles = |counts: [u16; 3]| {
        let [left, right, level] = &[(-25.0, counts[0]), (25.0, counts[1]), (0.0, counts[2])]
            .map(|(roll_deg, sample_count)| circle_samples(roll_deg, sample_count));
        Parts { left, right, level, ..Parts::default() }.samples()
    };
    let samples = AcceptanceSamples {
        fit_samples: circles([24, 24, if held_back_counts[2] > 0 { 24 } else { 0 }]),
        held_back_samples: circles(held_back_counts),
        is_attitude_known: true,
    };
    evaluate_candidate(candidate, samples, incumbent)
}

fn evaluate(candidate: &Solution, incumbent: &Incumbent) -> Result<HeldBackScores, Rejection> {
    evaluate_with_held_back([24, 24, 0], candidate, incumbent)
}

/// Tests a candidate against no calibration.
fn evaluate_first(candidate: &Solution) -> Result<HeldBackScores, Rejection> {
    evaluate(candidate, &no_calibration())
}

#[test]
fn every_part_but_level_flight_beside_turns_needs_eight_held_back_samples() {
    let good = candidate(0.1, typical_quality(0.5));
    for (held_back, expected) in
        [([8, 8, 0], None), ([7, 30, 0], Some(7)), ([30, 7, 0], Some(7)), ([30, 30, 1], None), ([0, 30, 0], Some(0))]
    {
        let found = evaluate_with_held_back(held_back, &good, &no_calibration());
        assert_eq!(found.err(), expected.map(|have| Rejection::TooFewHeldBack { have, need: 8 }), "{held_back:?}");
    }
    let nothing = AcceptanceSamples {
        fit_samples: Samples::default(),
        held_back_samples: Samples::default(),
        is_attitude_known: true,
    };
    let found = evaluate_candidate(&good, nothing, &no_calibration());
    assert_eq!(found, Err(Rejection::TooFewHeldBack { have: 0, need: 8 }));
}

/// An expected error of 3 deg is the promise of every accepted calibration.
#[test]
fn a_large_expected_error_is_rejected() {
    for (expected_rms_deg, is_accepted) in [(3.0, true), (3.1, false), (f32::NAN, false), (f32::INFINITY, false)] {
        let found = evaluate_first(&candidate(0.1, typical_quality(expected_rms_deg)));
        let is_inaccurate = matches!(found, Err(Rejection::NotAccurate { .. }));
        assert_eq!((found.is_ok(), is_inaccurate), (is_accepted, !is_accepted), "{expected_rms_deg}: {found:?}");
    }
}

const HARD_IRON_CHANGE: DetectedHardIronChange = DetectedHardIronChange {
    size_ut: 4.2,
    time_course: HardIronTimeCourse::Step { after_ms: 31_000 },
    duration_ms: 230_000,
};

/// Candidate with a detected hard-iron change and 0.5 deg of other errors.
fn candidate_with_hard_iron_change(error_deg: f32, expected_rms_deg: f32) -> Solution {
    let finding = Finding { violation: HARD_IRON_CHANGE, added_error_deg: error_deg, error_without_violation_deg: 0.5 };
    Solution { hard_iron_change: Some(finding), ..candidate(0.1, typical_quality(expected_rms_deg)) }
}

/// A hard-iron change about as large as all other errors is in the expected error.
#[test]
fn a_dominant_hard_iron_change_is_rejected() {
    for (error_deg, expected_rms_deg, is_accepted) in
        [(0.5, 0.7, true), (0.1, 2.9, true), (2.0, 2.1, false), (0.1, 3.1, false), (0.1, f32::NAN, false)]
    {
        let found = evaluate_first(&candidate_with_hard_iron_change(error_deg, expected_rms_deg));
        let expected = (!is_accepted).then_some(Rejection::IronChanged(HARD_IRON_CHANGE));
        assert_eq!(found.err(), expected, "{error_deg} {expected_rms_deg}");
    }
    // Missing held-back samples are the first rejection reason.
    let changed = candidate_with_hard_iron_change(9.0, 9.0);
    let nothing = evaluate_with_held_back([7, 24, 0], &changed, &no_calibration());
    assert_eq!(nothing, Err(Rejection::TooFewHeldBack { have: 7, need: 8 }));
}

/// Candidate with a bank-scale finding; expected errors without and with the scale error.
fn candidate_with_bank_scale_error(sigmas: f32, error_without_deg: f32, expected_rms_deg: f32) -> Solution {
    let bank = Some(Finding {
        violation: BankScaleFinding { reported_bank_ratio: 0.91, significance_sigmas: sigmas },
        added_error_deg: 1.0,
        error_without_violation_deg: error_without_deg,
    });
    Solution { bank_scale_error: bank, ..candidate(0.1, typical_quality(expected_rms_deg)) }
}

/// A suspected bank-angle scale error, which good sources show at two sigma by chance, is ignored; a certain one is the
/// rejection reason.
#[test]
fn a_bank_scale_error_is_a_rejection_reason_only_if_certain() {
    let contradicted = Rejection::AttitudeContradicted { reported_bank_ratio: 0.91, expected_rms_deg: 3.5 };
    for (sigmas, rejection) in [(2.0, None), (9.0, Some(contradicted))] {
        let evaluate_errors = |error_without_deg, expected_rms_deg| {
            evaluate_first(&candidate_with_bank_scale_error(sigmas, error_without_deg, expected_rms_deg)).err()
        };
        assert_eq!(evaluate_errors(0.5, 2.9), None, "{sigmas}");
        assert_eq!(evaluate_errors(2.9, 3.5), rejection, "{sigmas}");
        // The expected error is too large even without the scale error.
        assert_eq!(evaluate_errors(3.1, 3.5), Some(Rejection::NotAccurate { expected_rms_deg: 3.1 }), "{sigmas}");
        // A hard-iron change precedes the scale error as the reason.
        let finding = candidate_with_hard_iron_change(0.1, 3.5).hard_iron_change;
        let both = Solution { hard_iron_change: finding, ..candidate_with_bank_scale_error(sigmas, 0.5, 3.5) };
        let expected = rejection.map(|_| Rejection::IronChanged(HARD_IRON_CHANGE));
        assert_eq!(evaluate_first(&both).err(), expected, "{sigmas}");
    }
    assert!(contradicted.to_string().contains(" 91 % of the bank"), "{contradicted}");
}

#[test]
fn only_a_better_candidate_is_accepted() {
    for (b_ut, is_accepted) in [(0.99, true), (1.0, false), (1.01, false), (f32::NAN, false)] {
        let found = evaluate(&candidate(b_ut, typical_quality(0.5)), &active_calibration(1.0, 0.5));
        let Err(Rejection::NotBetter { candidate_score, incumbent_score }) = found else {
            assert!(is_accepted && found.is_ok(), "{b_ut}: {found:?}");
            continue;
        };
        assert!(!is_accepted && (candidate_score.is_nan() || candidate_score >= incumbent_score), "{b_ut}");
    }
}

/// Only free flight needs tilt: the expected error of other procedures includes undetermined coefficients.
#[test]
fn a_free_flight_without_tilt_is_unobservable() {
    let level = Quality { envelope: AttitudeEnvelope::Level, ..typical_quality(0.5) };
    let advice = Advice {
        weakest_deviation: Deviation::Constant,
        weakest_deviation_deg: 0.5,
        expected_deg: 0.5,
        manoeuvre: Manoeuvre::YawTurn,
        expected_after_deg: 0.5,
        error_floor_deg: 0.5,
        unobservable: UnobservableQuantities { mounting: true, ..UnobservableQuantities::default() },
    };
    let good = candidate(0.1, typical_quality(0.5));
    let on_priors = Solution { advice: Some(advice), ..good };
    let tumbled = candidate(0.1, Quality { method: Method::Ellipsoid, ..typical_quality(0.5) });
    let swung = candidate(0.1, Quality { method: Method::CompassSwing, ..level });
    let circle = circle_samples(0.0, 24);
    let (free, level_part) = (free_samples(&circle), level_samples(&circle));
    for (name, candidate, samples, expected) in [
        ("level free flight", &candidate(0.1, level), free, Err(Rejection::Unobservable)),
        ("mounting by the prior alone", &on_priors, free, Err(Rejection::Unobservable)),
        ("banked free flight", &good, free, Ok(())),
        ("compass swing", &swung, level_part, Ok(())),
        ("tumbled", &tumbled, free, Ok(())),
    ] {
        let samples = AcceptanceSamples { fit_samples: samples, held_back_samples: samples, is_attitude_known: true };
        let found = evaluate_candidate(candidate, samples, &no_calibration());
        assert_eq!(found.map(drop), expected, "{name}");
    }
}

/// Less informative: half as much again of expected error, a level envelope, or an unobservable mounting. Samples that
/// fit the active calibration several times worse show that it is wrong, whatever it was made from.
#[test]
fn a_less_informative_candidate_replaces_only_a_contradicted_calibration() {
    let full = typical_quality(1.0);
    let level = Quality { envelope: AttitudeEnvelope::Level, ..typical_quality(0.2) };
    let tumbled = Quality { method: Method::Ellipsoid, ..typical_quality(0.2) };
    for (name, active_ut, active, quality, is_accepted) in [
        ("somewhat larger expected error", 1.0, full, typical_quality(1.4), true),
        ("larger expected error", 1.0, full, typical_quality(1.6), false),
        ("level after full", 1.0, full, level, false),
        ("tumbled after full", 1.0, full, tumbled, false),
        ("level after level", 1.0, level, level, true),
        ("tumbled after tumbled", 1.0, tumbled, tumbled, true),
        ("full after level", 1.0, level, typical_quality(0.2), true),
        ("worse fit of the active one", 2.0, full, typical_quality(2.0), false),
        ("contradicted", 4.5, full, typical_quality(2.0), true),
    ] {
        let incumbent = Incumbent { quality: Some(active), ..active_calibration(active_ut, 1.0) };
        let found = evaluate(&candidate(0.9, quality), &incumbent);
        let (expected_rms_deg, incumbent_rms_deg) = (quality.expected_rms_deg, active.expected_rms_deg);
        let rejection = Rejection::LessInformative { expected_rms_deg, incumbent_rms_deg };
        assert_eq!(found.err(), (!is_accepted).then_some(rejection), "{name}");
    }
    assert!(evaluate_first(&candidate(0.9, typical_quality(1.6))).is_ok());
}
