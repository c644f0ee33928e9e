//! Codes are stable, and texts fit their displays.

use nalgebra::Vector3;

use super::Severity::{Info, Warning};
use super::*;
use crate::settings::OutOfRange;
use crate::store::StoreError;
use autoswing::acceptance::Rejection;
use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{
    Axis, CollectionPart, DetectedHardIronChange, HardIronTimeCourse, Manoeuvre, Orientation, SolveError,
};
use autoswing::collection::CollectionProblem;
use autoswing::instrument::{HardIronChange, InstallationChange, MountTurn};

const ONE_SIDE_ONLY: CollectionProblem = CollectionProblem::OneSideOnly(CollectionPart::LEFT);
const TOO_FEW_SAMPLES: SolveError = SolveError::TooFewSamples { part: CollectionPart::LEFT, have: 8, need: 12 };
const TOO_FEW_MARKS: SolveError = SolveError::TooFewSamples { part: CollectionPart::MARKS, have: 3, need: 4 };
const TOO_FEW_HELD_BACK: Rejection = Rejection::TooFewHeldBack { have: 5, need: 8 };
const NOT_ACCURATE: Rejection = Rejection::NotAccurate { expected_rms_deg: 4.26 };

/// A refusal with its code, and parts of its text: the fact with its values, and what to do.
type ExpectedRefusal = (Refusal, &'static str, &'static [&'static str]);

fn refusals() -> impl Iterator<Item = ExpectedRefusal> {
    [refused_commands(), known_causes(), solve_errors(), rejections(), store_errors()].into_iter().flatten()
}

fn refused_commands() -> Vec<ExpectedRefusal> {
    let collecting =
        Refusal::Collecting { present_procedure: Procedure::Flight, requested_procedure: Procedure::Turns };
    vec![
        (Refusal::Armed, "armed", &["or the vehicle still moves", "; land, disarm and wait for 5 s"]),
        (Refusal::Busy, "busy", &["a solve is running", "; wait for it, or cal abort"]),
        (collecting, "collecting", &["a collection of flight is in progress; to discard it: cal start turns again"]),
        (Refusal::NotCollecting, "not-collecting", &["no collection", "; cal start begins one"]),
        (Refusal::NotSwinging, "not-swinging", &["no compass swing", "; cal start swing begins one"]),
        (Refusal::NotStationary, "not-steady", &["the vehicle moves", "; keep it still for a second"]),
        (Refusal::TooManyMarks, "too-many-marks", &["no room for another mark; cal solve"]),
        (Refusal::NotSolved, "not-solved", &["nothing was solved", "; cal solve first"]),
        (Refusal::NoCalibration, "no-calibration", &["no active calibration; calibrate first"]),
        (Refusal::NoStoredCalibration, "no-calibration", &["no calibration is stored; cal start, then fly"]),
        (Refusal::NoSamples, "no-samples", &["there are no samples; cal start, then fly, turning and tilting"]),
        (
            Refusal::LargeAlignment { heading_deg: 90.0, align_deg: -33.33 },
            "needs-word",
            &["would be turned by -33.3 deg", "; if that is right: set align 90 yes"],
        ),
        (Refusal::NoSensor, "no-sensor", &["the magnetometer does not answer; check its wiring"]),
        (
            Refusal::NoInertialSensor,
            "no-gyro",
            &["no gyro and accelerometer of the board answers; set attitude autopilot"],
        ),
        (Refusal::NoPreviousCalibration, "nothing-to-undo", &["there is no previous calibration"]),
        (Refusal::OutOfRange(OutOfRange("a rate is 1 to 80")), "out-of-range", &["a rate is 1 to 80"]),
        (
            Refusal::SafeMode,
            "safe-mode",
            &["only the console runs; report the panic", "erase all stored data: cal clear"],
        ),
    ]
}

fn known_causes() -> Vec<ExpectedRefusal> {
    use CollectionProblem::{ArcOnly, InsufficientBank, MissingManoeuvre, NoTilt, OneSideOnly, SampleIntervalTooLong};
    let problems: [(CollectionProblem, &[&str]); 7] = [
        (SampleIntervalTooLong { interval_s: 1.04 }, &["every 1.0 s, too slow for turns; send field and attitude ten"]),
        (NoTilt { max_tilt_deg: 0.44 }, &["tilts by 0.4 deg at most; tilt by 15 deg", "radians for degrees?"]),
        (InsufficientBank { max_tilt_deg: 6.3 }, &["too little bank, 6.3 deg at most; fly turns at 15 deg of bank"]),
        (OneSideOnly(CollectionPart::LEFT), &["only left turns were flown; fly right turns, too"]),
        (OneSideOnly(CollectionPart::RIGHT), &["only right turns were flown; fly left turns, too"]),
        (
            ArcOnly { part: CollectionPart::RIGHT, sectors: 5 },
            &["the right turns went through 5 of 12", "; fly full circles"],
        ),
        (MissingManoeuvre(Manoeuvre::YawTurn), &["missing: turn once round, level"]),
    ];
    let losses: [(SampleLoss, &[&str]); 4] = [
        (SampleLoss::Saturated(12), &["12 % of the readings were saturated; move the sensor away from magnets"]),
        (SampleLoss::ImpossibleAttitude, &["impossible values; check their unit: MAVLink's is radians"]),
        (SampleLoss::NoAttitude(83), &["83 % of the readings had no attitude; send ATTITUDE ten times a second"]),
        (
            SampleLoss::InaccurateOwnAttitude(90),
            &["for 90 % of the readings the own attitude was not accurate; rest for"],
        ),
    ];
    let inaccurate = Refusal::Rejected(NOT_ACCURATE).with_cause(Some(ONE_SIDE_ONLY));
    let problems = problems
        .into_iter()
        .map(|(problem, texts)| (Refusal::Solve(TOO_FEW_SAMPLES).with_cause(Some(problem)), "too-few-samples", texts));
    let losses =
        losses.into_iter().map(|(loss, texts)| (Refusal::NoSamples.with_cause(Some(loss)), "no-samples", texts));
    let texts: &[&str] = &["expected error 4.3 deg; only left turns were flown; fly right turns, too"];
    problems.chain(losses).chain([(inaccurate, "not-accurate", texts)]).collect()
}

fn solve_errors() -> Vec<ExpectedRefusal> {
    let axis_stuck = SolveError::AxisStuck { axis: Axis::Y };
    let not_an_ellipse = SolveError::NotAnEllipse(CollectionPart::RIGHT);
    let not_determined = SolveError::NotDetermined(CollectionPart::MARKS);
    let too_few_headings = SolveError::TooFewHeadings { have: 4, need: 5 };
    let mount_contradicted = SolveError::MountContradicted { found: Orientation::from_name("yaw90").unwrap() };
    let inclination_contradicted = SolveError::InclinationContradicted { found_deg: -62 };
    let cases: Vec<(SolveError, &str, &[&str])> = vec![
        (TOO_FEW_SAMPLES, "too-few-samples", &["8 of 12 samples of left turns; fly more left turns"]),
        (TOO_FEW_MARKS, "too-few-samples", &["3 of 4 samples of marks; take more marks"]),
        (SolveError::NotFinite, "not-finite", &["; this is a fault of the firmware, please report it"]),
        (too_few_headings, "too-few-headings", &["4 of 5 headings, 30 deg apart; turn through all of them"]),
        (axis_stuck, "axis-stuck", &["the sensor's y axis is saturated or stuck; move the sensor"]),
        (not_an_ellipse, "not-an-ellipse", &["the right turns are no full circle; turn all the way round"]),
        (not_determined, "not-determined", &["the samples of marks do not determine", "; turn all the way round"]),
        (SolveError::SamePlane, "same-plane", &["; bank 15 deg or more each way"]),
        (SolveError::NotConverged, "not-converged", &["; move the sensor away from iron and wires, then fly again"]),
        (SolveError::TurnsReversed, "turns-reversed", &["; check the sign of the attitude source's roll"]),
        (inclination_contradicted, "inclination-contradicted", &["of -62 deg; set inclination -62 or none, then cal"]),
        (mount_contradicted, "mount-contradicted", &["seems to be mounted yaw90; set mount yaw90, then cal solve"]),
    ];
    cases.into_iter().map(|(error, code, texts)| (Refusal::Solve(error), code, texts)).collect()
}

fn rejections() -> Vec<ExpectedRefusal> {
    let attitude_contradicted = Rejection::AttitudeContradicted { reported_bank_ratio: 0.91, expected_rms_deg: 3.01 };
    let not_better = Rejection::NotBetter { candidate_score: 1.5, incumbent_score: 1.25 };
    let less_informative = Rejection::LessInformative { expected_rms_deg: 2.0, incumbent_rms_deg: 0.5 };
    let iron_changed = |time_course| {
        Rejection::IronChanged(DetectedHardIronChange { size_ut: 6.04, time_course, duration_ms: 230_999 })
    };
    let step = HardIronTimeCourse::Step { after_ms: 31_999 };
    let cases: Vec<(Rejection, &str, &[&str])> = vec![
        (TOO_FEW_HELD_BACK, "too-few-held-back", &["5 of 8 samples to verify with", "; fly longer turns each way"]),
        (Rejection::Unobservable, "unobservable", &["; tilt by 15 deg or more ahead, back, right and left"]),
        (
            attitude_contradicted,
            "attitude-contradicted",
            &["read 91 % of the bank, which costs 3.0 deg; calibrate the attitude source and fly again"],
        ),
        (NOT_ACCURATE, "not-accurate", &["expected error 4.3 deg; cal advise shows what to fly"]),
        (not_better, "not-better", &["score 1.50 against 1.25 of the active calibration; the active one stays"]),
        (less_informative, "thinner", &["2.0 deg against 0.5 deg of the active calibration; the active one stays"]),
        (iron_changed(step), "iron-changed", &["by 6.0 uT after 31 of 230 s; fix what moved and fly again"]),
        (
            iron_changed(HardIronTimeCourse::Drift),
            "iron-changed",
            &["drifted by 6.0 uT in 230 s; wait until temperatures settle"],
        ),
        (iron_changed(HardIronTimeCourse::LoadFactor), "iron-changed", &["; remove the iron of the linkage"]),
        (iron_changed(HardIronTimeCourse::Hysteresis), "iron-changed", &["; move the module away from steel"]),
    ];
    let same_as_solve_error = |(rejection, code, texts): &(Rejection, &'static str, &'static [&'static str])| {
        let Rejection::IronChanged(change) = rejection else { return None };
        Some((Refusal::Solve(SolveError::HardIronChanged(*change)), *code, *texts))
    };
    let solve_errors: Vec<ExpectedRefusal> = cases.iter().filter_map(same_as_solve_error).collect();
    cases
        .into_iter()
        .map(|(rejection, code, texts)| (Refusal::Rejected(rejection), code, texts))
        .chain(solve_errors)
        .collect()
}

fn store_errors() -> Vec<ExpectedRefusal> {
    let cases: [(StoreError, &str, &[&str]); 7] = [
        (StoreError::Flash, "store-flash", &["; try again, then replace the board"]),
        (StoreError::Timeout, "store-timeout", &["; try again, then replace the board"]),
        (StoreError::Corrupt, "store-corrupt", &["; calibrate again"]),
        (StoreError::OtherFormat(2), "store-version", &["; install that firmware, or delete them: cal clear all"]),
        (StoreError::Full, "store-full", &["; this is a fault of the firmware, please report it"]),
        (StoreError::ReadBackDiffers, "store-verify", &["; try again, then replace the board"]),
        (StoreError::Invalid, "store-invalid", &["a value is out of its range, and nothing was written"]),
    ];
    cases.into_iter().map(|(error, code, texts)| (Refusal::Store(error), code, texts)).collect()
}

/// Message with severity, beginning and end of its line.
type ExpectedMessage = (Message, Severity, &'static str, &'static str);

/// Every message but `Solved`.
fn messages() -> impl Iterator<Item = ExpectedMessage> {
    let hard_iron =
        InstallationChange::HardIron(HardIronChange { change_ut: Vector3::new(-4.9, 0.3, -1.7), sigma_ut: 0.44 });
    let mount =
        |turn_rad| Message::InstallationChanged(InstallationChange::Mount(MountTurn { turn_rad, sigma_rad: 0.0105 }));
    let changed = "iron-moved: 5.2 uT since the calibration, mostly aft (x -4.9, y 0.3, z -1.7, sigma 0.4); headings";
    let turned = "mount-moved: 9.8 deg counterclockwise since the calibration, from above (sigma 0.6); headings are";
    let node_number = |is_given_up| Message::NodeNumberConflict { number: 42, is_given_up };
    let same_number = "node-number-conflict: another node on the CAN bus has number 42, too";
    let ambiguous = "trims-ambiguous: the pitch trim in a quadplane's attitude depends on its mode";
    [
        (Message::CommandRejected(Refusal::Armed), Warning, "refused armed: the", "; land, disarm and wait for 5 s"),
        (Message::StoreFailed(StoreError::Corrupt), Warning, "refused store-corrupt: the stored", "; calibrate again"),
        (Message::CollectionLost, Warning, "collection-lost: the power failed", "; collect again"),
        (Message::Collecting(40), Info, "collecting: 40 %", ""),
        (Message::CollectionEnded, Info, "collection-ended: no more samples", ""),
        (Message::InstallationChanged(hard_iron), Warning, changed, "; fix what moved, or calibrate again"),
        (mount(-0.171), Warning, turned, "; fasten the module and calibrate again"),
        (mount(0.171), Warning, "mount-moved: 9.8 deg clockwise since", "; fasten the module and calibrate again"),
        (Message::TurnRequested { sigma_rad: 0.06 }, Warning, "turn-wanted: headings have a sigma of 3.4 deg by", ""),
        (Message::InstallationRestored, Info, "iron-back: as calibrated again", ""),
        (Message::TrimsAmbiguous, Warning, ambiguous, "; set bit 8 of FLIGHT_OPTIONS, and Q_TRIM_PITCH=0"),
        (
            node_number(true),
            Warning,
            same_number,
            "; this one takes another; give that node another number, or set can-node",
        ),
        (
            node_number(false),
            Warning,
            same_number,
            "; no field is sent; give that node another number, or set can-node",
        ),
        (
            Message::ComponentTaken { taken: 158, component: 25 },
            Info,
            "component-taken: another module is component 158; this one is component 25 from",
            "; to change it: set component",
        ),
        (Message::SafeMode, Warning, "safe-mode: three starts in a row", "all stored data: cal clear all, then reboot"),
    ]
    .into_iter()
    .chain(autopilot_reports())
}

fn autopilot_reports() -> impl Iterator<Item = ExpectedMessage> {
    use AutopilotReport::{Armed, Compass, CorrectedTwice, Heading, NoAutopilot, NoCompass, NoReply};
    use AutopilotReport::{NotKept, NothingReplaced, OtherAutopilot, Trims};
    use ParameterState::{Changed, Missing, NotChanged, Wrong};
    static WANTED: WantedParameter = WantedParameter {
        name_pattern: "COMPASS_OFS#_X",
        number: WantedNumber::Fixed(1.0),
        reason: "an offset, of 1 mG, marks it as calibrated",
    };
    let compass_at =
        |priority, device_id| Compass(RegisteredCompass { slot: 3, priority, device_id, is_module: false });
    let compass = |device_id, priority| compass_at(CompassPriority::ArduPilot(priority), device_id);
    let parameter = |state| {
        let (row, slot, priority, number, wanted, is_undo) = (&WANTED, 2, 1, -0.25, 1.0, false);
        AutopilotReport::Parameter(ParameterReport { row, slot, priority, state, number, wanted, is_undo })
    };
    let counts = |wrong, changed| {
        let (right, missing, needs_restart) = (18, wrong / 2, changed > 1);
        AutopilotReport::Summary(ParameterCounts { right, wrong, missing, changed, needs_restart })
    };
    [
        (
            NoAutopilot,
            Warning,
            "no-autopilot: no ArduPilot or PX4",
            "; connect MAVLink, or the CAN bus with its tunnel",
        ),
        (NoReply, Warning, "no-parameters: the autopilot does not", "TX reaches it, and signatures"),
        (NotKept, Warning, "number-not-kept: the old number", "; see status all"),
        (NothingReplaced, Warning, "nothing-replaced: no setup has", "of the autopilot's"),
        (OtherAutopilot, Warning, "other-autopilot: a setup has", "; connect that one for an undo"),
        (NoCompass, Warning, "no-compass: the autopilot has no", "; power both together, or restart the autopilot"),
        (compass(658_945, Some(1)), Info, "compass: slot 3, priority 1: another", "I2C bus 0 address 14 (id 658945)"),
        (compass(131_874, None), Info, "compass: slot 3, no priority: another", "SPI bus 4 device 3 (id 131874)"),
        (compass(97_547, Some(2)), Info, "compass: slot 3, ", "DroneCAN bus 1 node 125 (id 97547)"),
        (compass_at(CompassPriority::Px4, 8_944_899), Info, "compass: CAL_MAG2: another", "0 node 125 (id 8944899)"),
        (compass(5, Some(2)), Info, "compass: slot 3, ", "MSP (id 5)"),
        (
            CorrectedTwice { slot: 2, offset_mg: 120.6 },
            Warning,
            "corrected-twice: the autopilot's offsets of compass slot 2, 121 mG",
            "; to remove them: autopilot setup yes",
        ),
        (Trims([0.0, 3.0]), Info, "trims: the autopilot's attitude lacks 0.0 deg of roll, 3.0", "; removed"),
        (Heading(123.44), Info, "heading: 123.4 deg magnetic now", "known one before the autopilot uses it"),
        (Armed, Warning, "armed: the autopilot is armed", "wait for 5 s"),
        (parameter(Wrong), Warning, "parameter-wrong: COMPASS_OFS2_X is -0.25, wanted 1: an", "as calibrated"),
        (parameter(Changed), Info, "parameter-set: COMPASS_OFS2_X changed from -0.25 to 1: an", "as calibrated"),
        (parameter(NotChanged), Warning, "parameter-refused: COMPASS_OFS2_X was set to 1", ", and is -0.25"),
        (parameter(Missing), Warning, "parameter-missing: no answer for COMPASS_OFS2_X, wanted 1", "calibrated"),
        (counts(0, 0), Info, "autopilot: parameters of the autopilot: 18 right", "0 wrong, 0 changed"),
        (counts(2, 0), Info, "autopilot: ", "2 wrong, 0 changed, 1 missing; to write them: autopilot setup yes"),
        (counts(0, 1), Info, "autopilot: ", "0 wrong, 1 changed"),
        (counts(2, 2), Info, "autopilot: ", "2 wrong, 2 changed, 1 missing; restart it: autopilot restart"),
    ]
    .map(|(report, severity, beginning, end)| (Message::Autopilot(report), severity, beginning, end))
    .into_iter()
}

#[test]
fn every_refusal_has_its_code_its_values_and_what_to_do() {
    for (refusal, code, parts) in refusals() {
        let text = refusal.to_string();
        assert_eq!(refusal.stable_code(), code, "{text}");
        for part in parts {
            assert!(text.contains(part), "{code}: {text}");
        }
        let solved = Message::Solved(Err(refusal));
        assert_eq!((solved.stable_code(), solved.severity()), (code, Warning));
        assert_eq!(solved.to_string(), format!("refused {code}: {text}"));
    }
}

#[test]
fn every_message_has_its_severity_its_values_and_what_to_do() {
    for (message, severity, beginning, end) in messages() {
        let line = message.to_string();
        assert_eq!(message.severity(), severity, "{line}");
        assert!(line.starts_with(beginning) && line.ends_with(end), "{line}");
        assert_eq!(message.message_text().to_string(), line.split_once(": ").unwrap().1);
    }
}

#[test]
fn an_error_is_one_clause() {
    for (refusal, ..) in refusals() {
        let error_text = match &refusal {
            Refusal::Solve(error) => error.to_string(),
            Refusal::Rejected(rejection) => rejection.to_string(),
            Refusal::Store(error) => error.to_string(),
            _ => continue,
        };
        assert!(!error_text.contains(';') && refusal.to_string().starts_with(&error_text), "{error_text}: {refusal}");
    }
}

/// A STATUSTEXT of the module has 240 characters, including the prefix `autoswing: refused <code>: `.
#[test]
fn message_texts_are_ascii_and_at_most_200_characters() {
    let lines = refusals().map(|(refusal, ..)| Message::Solved(Err(refusal)).to_string());
    for line in lines.chain(messages().map(|(message, ..)| message.to_string())) {
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

/// Arcs alone explain an estimated mounting or turn direction, because they leave the coefficients undetermined.
#[test]
fn a_cause_explains_only_refusals_for_missing_samples() {
    let arc = CollectionProblem::ArcOnly { part: CollectionPart::LEFT, sectors: 2 };
    let not_better = Rejection::NotBetter { candidate_score: 1.0, incumbent_score: 0.5 };
    let mount_contradicted = SolveError::MountContradicted { found: Orientation::IDENTITY_ROTATION };
    for (refusal, is_explained, is_explained_by_arc) in [
        (Refusal::NoSamples, true, true),
        (Refusal::Solve(TOO_FEW_SAMPLES), true, true),
        (Refusal::Solve(SolveError::TooFewSamples { part: CollectionPart::FREE, have: 8, need: 12 }), true, true),
        (Refusal::Solve(SolveError::SamePlane), true, true),
        (Refusal::Solve(SolveError::NotAnEllipse(CollectionPart::LEFT)), true, true),
        (Refusal::Solve(SolveError::NotDetermined(CollectionPart::FREE)), true, true),
        (Refusal::Rejected(TOO_FEW_HELD_BACK), true, true),
        (Refusal::Rejected(NOT_ACCURATE), true, true),
        (Refusal::Rejected(Rejection::Unobservable), true, true),
        (Refusal::Solve(SolveError::NotConverged), false, true),
        (Refusal::Solve(SolveError::TurnsReversed), false, true),
        (Refusal::Solve(mount_contradicted), false, true),
        (Refusal::Solve(TOO_FEW_MARKS), false, false),
        (Refusal::Rejected(not_better), false, false),
        (Refusal::Store(StoreError::Full), false, false),
        (Refusal::Armed, false, false),
    ] {
        assert_eq!(refusal.clone().with_cause(None::<CollectionProblem>), refusal);
        let causes: [(RefusalCause, bool); 3] = [
            (ONE_SIDE_ONLY.into(), is_explained),
            (SampleLoss::Saturated(20).into(), is_explained),
            (arc.into(), is_explained_by_arc),
        ];
        for (cause, is_explained) in causes {
            let (explained, code) = (refusal.clone().with_cause(Some(cause)), refusal.stable_code());
            match explained {
                Refusal::InsufficientSamples { code: found_code, cause: found_cause, .. } => {
                    assert_eq!((is_explained, found_code, found_cause), (true, code, cause), "{refusal:?}");
                }
                unexplained => assert_eq!((is_explained, &unexplained), (false, &refusal), "{cause:?}"),
            }
        }
    }
}

#[test]
fn lost_readings_replace_other_causes_of_a_refusal() {
    for cause in [None, Some(ONE_SIDE_ONLY)] {
        let refused = Refusal::Rejected(NOT_ACCURATE).with_cause(cause).with_cause(Some(SampleLoss::Saturated(20)));
        assert!(refused.to_string().starts_with("20 % of the readings were saturated"), "{refused}");
    }
}
