//! Unit tests of `acceptance`.

use super::*;
use crate::calibration::tests::synthetic::Parts;
use crate::calibration::{
    Advice, AttitudeEnvelope, Deviation, HardIronTimeCourse, HeadingUncertainty, Manoeuvre, Method, Sample,
};
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;

const POLICY: AcceptancePolicy = AcceptancePolicy::DEFAULT;

fn quality_with_error(expected_rms_deg: f32) -> Quality {
    Quality {
        method: Method::MaximumLikelihood,
        envelope: AttitudeEnvelope::Banked,
        expected_rms_deg,
        expected_worst_deg: 2.0 * expected_rms_deg,
        norm_residual: 0.004,
        inclination_residual_deg: 0.4,
        samples: 300,
        latency: None,
        knows_inclination: true,
    }
}

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
    Incumbent { calibration: calibration_with_error(b_ut), quality: Some(quality_with_error(expected_rms_deg)) }
}

const UNCALIBRATED_INCUMBENT: Incumbent = Incumbent {
    calibration: Calibration {
        w: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        b_ut: [9.0, 0.0, 0.0],
        inclination_rad: 0.0,
        total_ut: 0.0,
        latency_s: 0.0,
        motor_current: crate::calibration::MotorCurrentInterference::NO_INTERFERENCE,
    },
    quality: None,
};

/// Circle without iron. A hard-iron error b changes the field strength by up to b cos(inclination) / F, so scores
/// are proportional to b.
fn circle_samples(roll_deg: f32, sample_count: u16) -> Vec<Sample> {
    (0..sample_count)
        .map(|i| {
            let attitude = Attitude::from_deg(roll_deg, 0.0);
            let heading_rad = f32::from(i) / f32::from(sample_count) * core::f32::consts::TAU;
            let field = Field::new(attitude.to_body_frame(Field::earth_field(50.0, 1.0, heading_rad)).ut);
            Sample { time: WrappingMillis::new(u32::from(i) * 400), ..Sample::new(field, attitude) }
        })
        .collect()
}

/// Tests a candidate with these numbers of held-back samples of left turns, right turns and level flight.
fn evaluate_with_held_back(
    held_back_counts: [u16; 3],
    candidate: &Solution,
    incumbent: &Incumbent,
) -> Result<HeldBackScores, Rejection> {
    let fitted = [-25.0, 25.0, 0.0].map(|roll_deg| circle_samples(roll_deg, 24));
    let [l, r, v] = [(-25.0, held_back_counts[0]), (25.0, held_back_counts[1]), (0.0, held_back_counts[2])]
        .map(|(roll_deg, samples)| circle_samples(roll_deg, samples));
    let level_used = held_back_counts[2] > 0;
    let grounds = AcceptanceSamples {
        fit_samples: Parts {
            left: &fitted[0],
            right: &fitted[1],
            level: if level_used { &fitted[2] } else { &[] },
            ..Parts::default()
        }
        .samples(),
        held_back_samples: Parts { left: &l, right: &r, level: &v, ..Parts::default() }.samples(),
        is_attitude_known: true,
    };
    evaluate_candidate(&POLICY, candidate, grounds, incumbent)
}

const ENOUGH_HELD_BACK_COUNTS: [u16; 3] = [24, 24, 0];

#[test]
fn a_better_candidate_replaces_an_empty_or_worse_calibration() {
    for incumbent in [UNCALIBRATED_INCUMBENT, active_calibration(2.0, 0.5)] {
        let scores =
            evaluate_with_held_back(ENOUGH_HELD_BACK_COUNTS, &candidate(0.1, quality_with_error(0.5)), &incumbent)
                .unwrap();
        assert!(scores.candidate_score < scores.active_score, "{scores:?}");
    }
}

#[test]
fn every_used_part_needs_eight_held_back_samples() {
    let good = candidate(0.1, quality_with_error(0.5));
    let rejected = |have| Err(Rejection::TooFewHeldBack { have, need: 8 });
    for (held_back, expected) in [
        ([8, 8, 0], None),
        ([7, 30, 0], Some(7)),
        ([30, 7, 0], Some(7)),
        ([30, 30, 7], Some(7)),
        ([30, 30, 8], None),
        ([0, 30, 0], Some(0)),
    ] {
        let found = evaluate_with_held_back(held_back, &good, &UNCALIBRATED_INCUMBENT);
        match expected {
            Some(have) => assert_eq!(found, rejected(have), "{held_back:?}"),
            None => assert!(found.is_ok(), "{held_back:?}: {found:?}"),
        }
    }
}

#[test]
fn a_candidate_without_held_back_samples_is_rejected() {
    let grounds = AcceptanceSamples {
        fit_samples: Samples::default(),
        held_back_samples: Samples::default(),
        is_attitude_known: true,
    };
    let found = evaluate_candidate(&POLICY, &candidate(0.1, quality_with_error(0.5)), grounds, &UNCALIBRATED_INCUMBENT);
    assert_eq!(found, Err(Rejection::TooFewHeldBack { have: 0, need: 8 }));
}

#[test]
fn a_large_expected_error_is_rejected() {
    let evaluate_with_rms = |expected_rms_deg| {
        evaluate_with_held_back(
            ENOUGH_HELD_BACK_COUNTS,
            &candidate(0.1, quality_with_error(expected_rms_deg)),
            &UNCALIBRATED_INCUMBENT,
        )
    };
    assert!(evaluate_with_rms(3.0).is_ok());
    assert_eq!(evaluate_with_rms(3.01), Err(Rejection::NotAccurate { expected_rms_deg: 3.01 }));
    assert!(matches!(evaluate_with_rms(f32::NAN), Err(Rejection::NotAccurate { .. })));
    assert!(matches!(evaluate_with_rms(f32::INFINITY), Err(Rejection::NotAccurate { .. })));
}

/// Candidate with a detected hard-iron change and 0.5 deg of other errors.
fn candidate_with_hard_iron_change(error_deg: f32, expected_rms_deg: f32) -> Solution {
    let change =
        DetectedHardIronChange { size_ut: 4.2, time_course: HardIronTimeCourse::Step { after_s: 31 }, duration_s: 230 };
    let finding = Some(Finding { violation: change, added_error_deg: error_deg, error_without_violation_deg: 0.5 });
    Solution { hard_iron_change: finding, ..candidate(0.1, quality_with_error(expected_rms_deg)) }
}

/// A hard-iron change of up to 2.5 times all other errors is accepted, if the total error is below the limit.
#[test]
fn a_dominant_hard_iron_change_is_rejected() {
    let evaluate_with_change = |error_deg, expected_rms_deg| {
        evaluate_with_held_back(
            ENOUGH_HELD_BACK_COUNTS,
            &candidate_with_hard_iron_change(error_deg, expected_rms_deg),
            &UNCALIBRATED_INCUMBENT,
        )
    };
    assert!(evaluate_with_change(1.24, 1.34).is_ok());
    let Err(refused @ Rejection::IronChanged(change)) = evaluate_with_change(1.26, 1.35) else { panic!() };
    assert_eq!(change.duration_s, 230);
    assert!(evaluate_with_change(0.1, 2.99).is_ok());
    assert_eq!(evaluate_with_change(0.1, 3.01), Err(refused));
    assert_eq!(evaluate_with_change(0.1, f32::NAN), Err(refused));
    // Missing held-back samples are the first rejection reason.
    let nothing =
        evaluate_with_held_back([7, 24, 0], &candidate_with_hard_iron_change(9.0, 9.0), &UNCALIBRATED_INCUMBENT);
    assert_eq!(nothing, Err(Rejection::TooFewHeldBack { have: 7, need: 8 }));
}

/// Candidate with a bank-scale finding; expected errors without and with the scale error.
fn candidate_with_bank_scale_error(sigmas: f32, error_without_deg: f32, expected_rms_deg: f32) -> Solution {
    let bank = Some(Finding {
        violation: BankScaleFinding { reported_bank_ratio: 0.91, significance_sigmas: sigmas },
        added_error_deg: 1.0,
        error_without_violation_deg: error_without_deg,
    });
    Solution { bank_scale_error: bank, ..candidate(0.1, quality_with_error(expected_rms_deg)) }
}

/// A suspected bank-angle scale error is ignored, a certain one is the rejection reason.
#[test]
fn a_bank_scale_error_is_a_rejection_reason_only_if_certain() {
    let evaluate_candidate =
        |candidate: &Solution| evaluate_with_held_back(ENOUGH_HELD_BACK_COUNTS, candidate, &UNCALIBRATED_INCUMBENT);
    for sigmas in [2.0, 3.4, 3.6, 9.0] {
        assert!(evaluate_candidate(&candidate_with_bank_scale_error(sigmas, 0.5, 2.99)).is_ok(), "{sigmas}");
        // The expected error is too large even without the scale error.
        let useless = evaluate_candidate(&candidate_with_bank_scale_error(sigmas, 3.01, 3.5));
        assert_eq!(useless, Err(Rejection::NotAccurate { expected_rms_deg: 3.01 }), "{sigmas}");
    }
    assert!(evaluate_candidate(&candidate_with_bank_scale_error(3.4, 2.99, 3.01)).is_ok());
    let refused = evaluate_candidate(&candidate_with_bank_scale_error(3.6, 2.99, 3.01)).unwrap_err();
    assert_eq!(refused, Rejection::AttitudeContradicted { reported_bank_ratio: 0.91, expected_rms_deg: 3.01 });
    assert!(refused.to_string().contains(" 91 % of the bank"), "{refused}");
    // A hard-iron change precedes the scale error as the reason, also when the latter is only suspected.
    let both = |sigmas| {
        let finding = candidate_with_hard_iron_change(0.1, 3.5).hard_iron_change;
        evaluate_candidate(&Solution { hard_iron_change: finding, ..candidate_with_bank_scale_error(sigmas, 0.5, 3.5) })
    };
    assert!(matches!(both(3.6), Err(Rejection::IronChanged(_))) && both(3.4).is_ok());
}

#[test]
fn only_a_better_candidate_is_accepted() {
    let evaluate_with_b_ut = |b_ut| {
        evaluate_with_held_back(
            ENOUGH_HELD_BACK_COUNTS,
            &candidate(b_ut, quality_with_error(0.5)),
            &active_calibration(1.0, 0.5),
        )
    };
    assert!(evaluate_with_b_ut(0.99).is_ok());
    for b_ut in [1.0, 1.01, f32::NAN] {
        let Err(Rejection::NotBetter { candidate_score: candidate, incumbent_score: incumbent }) =
            evaluate_with_b_ut(b_ut)
        else {
            panic!("{b_ut}")
        };
        assert!(candidate.is_nan() || candidate >= incumbent, "{candidate} {incumbent}");
    }
}

#[test]
fn expected_error_above_1_5_times_the_active_one_is_rejected() {
    let evaluate_with_rms = |expected_rms_deg| {
        evaluate_with_held_back(
            ENOUGH_HELD_BACK_COUNTS,
            &candidate(0.9, quality_with_error(expected_rms_deg)),
            &active_calibration(1.0, 1.0),
        )
    };
    assert!(evaluate_with_rms(1.5).is_ok());
    assert_eq!(
        evaluate_with_rms(1.51),
        Err(Rejection::LessInformative { expected_rms_deg: 1.51, incumbent_rms_deg: 1.0 })
    );
    assert!(
        evaluate_with_held_back(
            ENOUGH_HELD_BACK_COUNTS,
            &candidate(0.9, quality_with_error(1.51)),
            &UNCALIBRATED_INCUMBENT
        )
        .is_ok()
    );
}

/// Only free flight needs tilt: the expected error of other procedures includes undetermined coefficients.
#[test]
fn a_free_flight_without_tilt_is_unobservable() {
    let level = Quality { envelope: AttitudeEnvelope::Level, ..quality_with_error(0.5) };
    let samples = circle_samples(0.0, 24);
    let [free, swung] = [
        Parts { free: &samples, ..Parts::default() }.samples(),
        Parts { level: &samples, ..Parts::default() }.samples(),
    ];
    for (quality, parts, expected) in [
        (level, free, Err(Rejection::Unobservable)),
        (quality_with_error(0.5), free, Ok(())),
        (Quality { method: Method::CompassSwing, ..level }, swung, Ok(())),
        (Quality { method: Method::Ellipsoid, ..quality_with_error(0.5) }, free, Ok(())),
    ] {
        let grounds = AcceptanceSamples { fit_samples: parts, held_back_samples: parts, is_attitude_known: true };
        let found = evaluate_candidate(&POLICY, &candidate(0.1, quality), grounds, &UNCALIBRATED_INCUMBENT);
        assert_eq!(found.map(drop), expected, "{quality:?}");
    }
    let advice = Advice {
        weakest_deviation: Deviation::Constant,
        weakest_deviation_deg: 0.5,
        expected_deg: 0.5,
        manoeuvre: Manoeuvre::YawTurn,
        expected_after_deg: 0.5,
        error_floor_deg: 0.5,
        unobservable: UnobservableQuantities { mounting: true, ..UnobservableQuantities::default() },
    };
    let on_priors = Solution { advice: Some(advice), ..candidate(0.1, quality_with_error(0.5)) };
    let grounds = AcceptanceSamples { fit_samples: free, held_back_samples: free, is_attitude_known: true };
    assert_eq!(evaluate_candidate(&POLICY, &on_priors, grounds, &UNCALIBRATED_INCUMBENT), Err(Rejection::Unobservable));
}

/// A level envelope or an unobservable mounting makes a candidate less informative.
#[test]
fn a_partial_calibration_does_not_replace_a_full_one() {
    let level = Quality { envelope: AttitudeEnvelope::Level, ..quality_with_error(0.2) };
    let tumbled = Quality { method: Method::Ellipsoid, ..quality_with_error(0.2) };
    for less in [level, tumbled] {
        let found =
            evaluate_with_held_back(ENOUGH_HELD_BACK_COUNTS, &candidate(0.9, less), &active_calibration(1.0, 1.0));
        assert_eq!(found, Err(Rejection::LessInformative { expected_rms_deg: 0.2, incumbent_rms_deg: 1.0 }));
        let incumbent = Incumbent { quality: Some(less), ..active_calibration(1.0, 1.0) };
        assert!(
            evaluate_with_held_back(ENOUGH_HELD_BACK_COUNTS, &candidate(0.9, less), &incumbent).is_ok(),
            "both are of the same"
        );
        assert!(
            evaluate_with_held_back(ENOUGH_HELD_BACK_COUNTS, &candidate(0.9, quality_with_error(0.2)), &incumbent)
                .is_ok(),
            "this one is of more"
        );
    }
}

#[test]
fn a_less_informative_candidate_is_accepted_if_the_active_one_fits_3x_worse() {
    let evaluate_with_b_ut = |b_ut| {
        evaluate_with_held_back(
            ENOUGH_HELD_BACK_COUNTS,
            &candidate(b_ut, quality_with_error(2.0)),
            &active_calibration(3.0, 1.0),
        )
    };
    assert!(
        matches!(evaluate_with_b_ut(1.05), Err(Rejection::LessInformative { .. })),
        "{:?}",
        evaluate_with_b_ut(1.05)
    );
    assert!(evaluate_with_b_ut(0.95).is_ok(), "{:?}", evaluate_with_b_ut(0.95));
}

#[test]
fn unknown_attitude_is_ignored() {
    let mut samples = circle_samples(0.0, 24);
    for (i, sample) in samples.iter_mut().enumerate() {
        sample.attitude = Attitude::from_deg(40.0 * (i as f32).sin(), 30.0);
    }
    let score = |knows_attitude| {
        let parts = Parts { left: &samples, ..Parts::default() }.samples();
        let grounds =
            AcceptanceSamples { fit_samples: parts, held_back_samples: parts, is_attitude_known: knows_attitude };
        evaluate_candidate(&POLICY, &candidate(0.1, quality_with_error(0.5)), grounds, &UNCALIBRATED_INCUMBENT)
            .map(|scores| scores.candidate_score)
    };
    assert!(score(false).unwrap() < 1.0, "{:?}", score(false));
    assert!(score(true).is_err() || score(true).unwrap() > 10.0, "{:?}", score(true));
}
