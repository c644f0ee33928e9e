//! Codes are stable, and texts fit their displays.

use nalgebra::Vector3;

use super::SampleLoss;
use super::*;
use crate::settings::OutOfRange;
use crate::store::StoreError;
use autoswing::acceptance::Rejection;
use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{
    Axis, DetectedHardIronChange, HardIronTimeCourse, Manoeuvre, Orientation, SamplePart, Side, SolveError,
};
use autoswing::collection::CollectionProblem;
use autoswing::instrument::{HardIronChange, InstallationChange, MountTurn};

const STEP_CHANGE: DetectedHardIronChange =
    DetectedHardIronChange { size_ut: 14.26, time_course: HardIronTimeCourse::Step { after_s: 31 }, duration_s: 230 };
const DRIFT_CHANGE: DetectedHardIronChange =
    DetectedHardIronChange { size_ut: 6.04, time_course: HardIronTimeCourse::Drift, duration_s: 230 };

type ExpectedRefusal = (Refusal, &'static str, &'static str);

const TOO_FEW_LEFT_SAMPLES: SolveError =
    SolveError::TooFewSamples { part: SamplePart::Turns(Side::Left), have: 8, need: 12 };

fn refusals() -> impl Iterator<Item = ExpectedRefusal> {
    [refused_commands(), known_causes(), solve_errors(), rejections(), store_errors()].into_iter().flatten()
}

const SAFE_MODE: &str = "three starts in a row ended in a panic, so only the console runs; report the panic shown by \
                         status; to erase all stored data: cal clear all, then reboot";

fn refused_commands() -> Vec<ExpectedRefusal> {
    vec![
        (
            Refusal::Armed,
            "armed",
            "the autopilot is armed or the vehicle still moves, and this command is for the ground; land, disarm and wait for 5 s",
        ),
        (Refusal::Busy, "busy", "a solve is running; wait for it, or cal abort"),
        (
            Refusal::Collecting { present_procedure: Procedure::Flight, requested_procedure: Procedure::Turns },
            "collecting",
            "a collection of flight is in progress; to discard it: cal start turns again",
        ),
        (Refusal::NotCollecting, "not-collecting", "no collection is in progress; cal start begins one"),
        (Refusal::NotSwinging, "not-swinging", "no compass swing is in progress; cal start swing begins one"),
        (
            Refusal::NotStationary,
            "not-steady",
            "the vehicle moves, or no attitude is received; keep it still for a second",
        ),
        (Refusal::TooManyMarks, "too-many-marks", "there is no room for another mark; cal solve"),
        (Refusal::NotSolved, "not-solved", "nothing was solved since the start; cal solve first"),
        (Refusal::NoCalibration, "no-calibration", "there is no active calibration; calibrate first"),
        (
            Refusal::NoStoredCalibration,
            "no-calibration",
            "no calibration is stored; cal start, then fly; status shows what is missing",
        ),
        (
            Refusal::NoSamples,
            "no-samples",
            "there are no samples; cal start, then fly, turning and tilting to all sides",
        ),
        (
            Refusal::LargeAlignment { heading_deg: 90.0, align_deg: -33.33 },
            "needs-word",
            "every heading would be turned by -33.3 deg, more than a mounting is usually off; if that is right: set \
             align 90 yes",
        ),
        (Refusal::NoSensor, "no-sensor", "the magnetometer does not answer; check its wiring, see status"),
        (Refusal::NoPreviousCalibration, "nothing-to-undo", "there is no previous calibration"),
        (Refusal::OutOfRange(OutOfRange("a rate is 1 to 80")), "out-of-range", "a rate is 1 to 80"),
        (Refusal::SafeMode, "safe-mode", SAFE_MODE),
    ]
}

fn known_causes() -> Vec<ExpectedRefusal> {
    let refusal_for_lack = |lack| Refusal::Solve(TOO_FEW_LEFT_SAMPLES).with_cause(Some(lack));
    let lost = |loss| Refusal::NoSamples.with_cause(Some(loss));
    vec![
        (
            refusal_for_lack(CollectionProblem::SampleIntervalTooLong { interval_s: 1.04 }),
            "too-few-samples",
            "a sample comes every 1.0 s, too slow for turns; send field and attitude ten times a second",
        ),
        (
            refusal_for_lack(CollectionProblem::NoTilt { max_tilt_deg: 0.44 }),
            "too-few-samples",
            "the attitude tilts by 0.4 deg at most; tilt by 15 deg or more to both sides, or if that was flown, check \
             the unit of the attitude: radians for degrees?",
        ),
        (
            refusal_for_lack(CollectionProblem::InsufficientBank { max_tilt_deg: 6.3 }),
            "too-few-samples",
            "too little bank, 6.3 deg at most; fly turns at 15 deg of bank or more each way",
        ),
        (
            refusal_for_lack(CollectionProblem::OneSideOnly(Side::Left)),
            "too-few-samples",
            "only left turns were flown; fly right turns, too",
        ),
        (
            refusal_for_lack(CollectionProblem::OneSideOnly(Side::Right)),
            "too-few-samples",
            "only right turns were flown; fly left turns, too",
        ),
        (
            refusal_for_lack(CollectionProblem::ArcOnly { side: Side::Right, sectors: 5 }),
            "too-few-samples",
            "the right turns went through 5 of 12 sectors, too slow or too short; fly full circles",
        ),
        (
            refusal_for_lack(CollectionProblem::MissingManoeuvre(Manoeuvre::YawTurn)),
            "too-few-samples",
            "missing: turn once round, level",
        ),
        (
            Refusal::Rejected(Rejection::NotAccurate { expected_rms_deg: 4.26 })
                .with_cause(Some(CollectionProblem::OneSideOnly(Side::Left))),
            "not-accurate",
            "expected error 4.3 deg; only left turns were flown; fly right turns, too",
        ),
        (
            lost(SampleLoss::Saturated(12)),
            "no-samples",
            "12 % of the readings were saturated; move the sensor away from magnets and wires",
        ),
        (
            lost(SampleLoss::ImpossibleAttitude),
            "no-samples",
            "the attitude reports had impossible values; check their unit: MAVLink's is radians, not degrees",
        ),
        (
            lost(SampleLoss::NoAttitude(83)),
            "no-samples",
            "83 % of the readings had no attitude; send ATTITUDE ten times a second or more",
        ),
    ]
}

fn solve_errors() -> Vec<ExpectedRefusal> {
    let yaw90 = Orientation::from_name("yaw90").unwrap();
    vec![
        (Refusal::Solve(TOO_FEW_LEFT_SAMPLES), "too-few-samples", "8 of 12 samples of left turns; fly more left turns"),
        (
            Refusal::Solve(SolveError::TooFewSamples { part: SamplePart::Marks, have: 3, need: 4 }),
            "too-few-samples",
            "3 of 4 samples of marks; take more marks",
        ),
        (
            Refusal::Solve(SolveError::NotFinite),
            "not-finite",
            "a sample is not a finite number; this is a fault of the firmware, please report it",
        ),
        (
            Refusal::Solve(SolveError::TooFewHeadings { have: 4, need: 5 }),
            "too-few-headings",
            "4 of 5 headings, 30 deg apart; turn through all of them",
        ),
        (
            Refusal::Solve(SolveError::AxisStuck { axis: Axis::Y }),
            "axis-stuck",
            "the sensor's y axis is saturated or stuck; move the sensor away from magnets, or replace it",
        ),
        (
            Refusal::Solve(SolveError::NotAnEllipse(SamplePart::Turns(Side::Right))),
            "not-an-ellipse",
            "the right turns are no full circle; turn all the way round",
        ),
        (
            Refusal::Solve(SolveError::NotDetermined(SamplePart::Marks)),
            "not-determined",
            "the samples of marks do not determine the coefficients; turn all the way round",
        ),
        (
            Refusal::Solve(SolveError::SamePlane),
            "same-plane",
            "left and right bank differ too little; bank 15 deg or more each way",
        ),
        (
            Refusal::Solve(SolveError::HardIronChanged(STEP_CHANGE)),
            "iron-changed",
            "iron changed by 14.3 uT after 31 of 230 s; fix what moved and fly again",
        ),
        (
            Refusal::Solve(SolveError::NotConverged),
            "not-converged",
            "no coefficients explain the samples; move the sensor away from iron and wires, then fly again",
        ),
        (
            Refusal::Solve(SolveError::TurnsReversed),
            "turns-reversed",
            "the headings run against the turns; check the sign of the attitude source's roll",
        ),
        (
            Refusal::Solve(SolveError::InclinationContradicted { found_deg: -62 }),
            "inclination-contradicted",
            "the samples show an inclination of -62 deg; set inclination -62 or none, then cal solve",
        ),
        (
            Refusal::Solve(SolveError::MountContradicted { found: yaw90 }),
            "mount-contradicted",
            "the sensor seems to be mounted yaw90; set mount yaw90, then cal solve",
        ),
    ]
}

fn rejections() -> Vec<ExpectedRefusal> {
    vec![
        (
            Refusal::Rejected(Rejection::IronChanged(DRIFT_CHANGE)),
            "iron-changed",
            "iron drifted by 6.0 uT in 230 s; wait until temperatures settle and fly again",
        ),
        (
            Refusal::Rejected(Rejection::TooFewHeldBack { have: 5, need: 8 }),
            "too-few-held-back",
            "5 of 8 samples to verify with on the side with fewer; fly longer turns each way",
        ),
        (
            Refusal::Rejected(Rejection::Unobservable),
            "unobservable",
            "turns without tilt do not determine a calibration; tilt by 15 deg or more ahead, back, right and left on \
             four headings",
        ),
        (
            Refusal::Rejected(Rejection::AttitudeContradicted { reported_bank_ratio: 0.91, expected_rms_deg: 3.01 }),
            "attitude-contradicted",
            "the attitude source seems to read 91 % of the bank, which costs 3.0 deg; calibrate the attitude source \
             and fly again",
        ),
        (
            Refusal::Rejected(Rejection::NotAccurate { expected_rms_deg: 4.26 }),
            "not-accurate",
            "expected error 4.3 deg; cal advise shows what to fly",
        ),
        (
            Refusal::Rejected(Rejection::NotBetter { candidate_score: 1.5, incumbent_score: 1.25 }),
            "not-better",
            "score 1.50 against 1.25 of the active calibration; the active one stays",
        ),
        (
            Refusal::Rejected(Rejection::LessInformative { expected_rms_deg: 2.0, incumbent_rms_deg: 0.5 }),
            "thinner",
            "expected error 2.0 deg against 0.5 deg of the active calibration; the active one stays; cal advise shows \
             what to fly",
        ),
    ]
}

fn store_errors() -> Vec<ExpectedRefusal> {
    vec![
        (
            Refusal::Store(StoreError::Flash),
            "store-flash",
            "the flash memory failed; try again, then replace the board",
        ),
        (
            Refusal::Store(StoreError::Timeout),
            "store-timeout",
            "the flash memory did not complete a save in time; try again, then replace the board",
        ),
        (Refusal::Store(StoreError::Corrupt), "store-corrupt", "the stored data are damaged; calibrate again"),
        (
            Refusal::Store(StoreError::OtherFormat(2)),
            "store-version",
            "another firmware wrote the stored data; install that firmware, or delete them: cal clear all",
        ),
        (
            Refusal::Store(StoreError::Full),
            "store-full",
            "the data do not fit into the flash region; this is a fault of the firmware, please report it",
        ),
        (
            Refusal::Store(StoreError::ReadBackDiffers),
            "store-verify",
            "the written data read back differently; try again, then replace the board",
        ),
        (Refusal::Store(StoreError::Invalid), "store-invalid", "a value is out of its range, and nothing was written"),
    ]
}

/// Every message but `Solved`, with severity and line.
fn messages() -> Vec<(Message, Severity, &'static str)> {
    let change = HardIronChange { change_ut: Vector3::new(-4.9, 0.3, -1.7), sigma_ut: 0.44 };
    let refusal = Refusal::Armed;
    vec![
        (
            Message::CommandRejected(refusal),
            Severity::Warning,
            "refused armed: the autopilot is armed or the vehicle still moves, and this command is for the ground; land, disarm and wait for 5 s",
        ),
        (
            Message::StoreFailed(StoreError::Corrupt),
            Severity::Warning,
            "refused store-corrupt: the stored data are damaged; calibrate again",
        ),
        (
            Message::CollectionLost,
            Severity::Warning,
            "collection-lost: the power failed during a collection, and its samples are lost; collect again",
        ),
        (Message::Collecting(40), Severity::Info, "collecting: 40 %"),
        (Message::CollectionEnded, Severity::Info, "collection-ended: no more samples"),
        (
            Message::InstallationChanged(InstallationChange::HardIron(change)),
            Severity::Warning,
            "iron-moved: 5.2 uT since the calibration, mostly aft (x -4.9, y 0.3, z -1.7, sigma 0.4); headings are \
             corrected for it; fix what moved, or calibrate again",
        ),
        (
            Message::InstallationChanged(InstallationChange::Mount(MountTurn { turn_rad: -0.171, sigma_rad: 0.0105 })),
            Severity::Warning,
            "mount-moved: 9.8 deg counterclockwise since the calibration, from above (sigma 0.6); headings are corrected for \
             it; fasten the module and calibrate again",
        ),
        (
            Message::TurnRequested { sigma_rad: 0.06 },
            Severity::Warning,
            "turn-wanted: headings have a sigma of 3.4 deg by now; turn once each way, so that a drift of iron is determined",
        ),
        (Message::InstallationRestored, Severity::Info, "iron-back: as calibrated again"),
        (
            Message::SafeMode,
            Severity::Warning,
            "safe-mode: three starts in a row ended in a panic, so only the console runs; report the panic shown by \
             status; to erase all stored data: cal clear all, then reboot",
        ),
    ]
}

#[test]
fn every_refusal_has_its_code_and_text() {
    for (refusal, code, text) in refusals() {
        assert_eq!((refusal.stable_code(), refusal.to_string().as_str()), (code, text));
        let solved = Message::Solved(Err(refusal));
        assert_eq!((solved.stable_code(), solved.severity()), (code, Severity::Warning));
        assert_eq!(solved.to_string(), format!("refused {code}: {text}"));
    }
}

#[test]
fn every_message_has_its_severity_and_text() {
    for (message, severity, line) in messages() {
        assert_eq!((message.severity(), message.to_string().as_str()), (severity, line));
        let text = line.split_once(": ").unwrap().1;
        assert_eq!(message.message_text().to_string(), text);
    }
}

#[test]
fn an_error_is_one_clause() {
    for (refusal, _, text) in refusals() {
        let error_text = match refusal {
            Refusal::Solve(error) => error.to_string(),
            Refusal::Rejected(rejection) => rejection.to_string(),
            Refusal::Store(error) => error.to_string(),
            _ => continue,
        };
        assert!(!error_text.contains(';') && text.starts_with(&error_text), "{error_text}: {text}");
    }
}

/// A STATUSTEXT of the module has 240 characters, including the prefix `autoswing: refused <code>: `.
#[test]
fn message_texts_are_ascii_and_at_most_200_characters() {
    let lines = refusals().map(|(refusal, ..)| Message::Solved(Err(refusal)).to_string());
    for line in lines.chain(messages().into_iter().map(|(message, ..)| message.to_string())) {
        assert!(line.len() <= 200 && line.is_ascii() && !line.ends_with([';', ' ', '.']), "{line}");
    }
}

#[test]
fn the_direction_of_a_hard_iron_change_is_its_largest_axis() {
    for (change_ut, direction) in [
        ([3.0, 1.0, -1.0], "forward"),
        ([-3.0, 1.0, 1.0], "aft"),
        ([1.0, 3.0, 1.0], "to the right"),
        ([1.0, -3.0, 1.0], "to the left"),
        ([1.0, 1.0, 3.0], "down"),
        ([1.0, 1.0, -3.0], "up"),
    ] {
        let change = HardIronChange { change_ut: change_ut.into(), sigma_ut: 0.2 };
        let line = Message::InstallationChanged(InstallationChange::HardIron(change)).to_string();
        assert!(line.contains(&format!("mostly {direction} (x ")), "{line}");
    }
}

#[test]
fn lost_readings_replace_other_causes_of_a_refusal() {
    let lack = CollectionProblem::OneSideOnly(Side::Left);
    let refused = Refusal::Rejected(Rejection::NotAccurate { expected_rms_deg: 4.0 }).with_cause(Some(lack));
    let inaccurate = Refusal::Rejected(Rejection::NotAccurate { expected_rms_deg: 4.0 });
    let [refused_with_loss, inaccurate_with_loss] =
        [refused, inaccurate].map(|refusal| refusal.with_cause(Some(SampleLoss::Saturated(20))));
    let expected = Refusal::InsufficientSamples {
        code: "not-accurate",
        expected_rms_deg: None,
        cause: RefusalCause::SampleLoss(SampleLoss::Saturated(20)),
    };
    assert_eq!((&refused_with_loss, &inaccurate_with_loss), (&expected, &expected));
    assert_eq!(Refusal::Armed.with_cause(Some(SampleLoss::Saturated(20))), Refusal::Armed);
    assert_eq!(Refusal::NoSamples.with_cause(None::<SampleLoss>), Refusal::NoSamples);
}
