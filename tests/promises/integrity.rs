//! Headings output as good while a fault is active: a small `lab bench integrity`.

use autoswing::attitude::{AttitudeReport, AttitudeSource, SenderId};
use autoswing::calibration::{Calibration, HeadingUncertainty, Orientation};
use autoswing::frames::{Field, RollPitch};
use autoswing::instrument::{Correction, Instrument, InstrumentConfig};
use autoswing::reading::Reading;
use autoswing::time::{Timestamp, WrappingMillis};
use autoswing_module::settings::HeadingKind;
use laboratory::studies::integrity::AttitudeProtocol::{Mavlink, Msp, MspInav};
use laboratory::studies::integrity::{
    IntegrityPlan, IntegrityRow, all_changes, fault_case, run_integrity_study, run_sweep,
};
use simulator::faults::Faults;
use simulator::faults::attitude::{AttitudeFault, attitude_quantisation};
use simulator::module::Module as _;
use simulator::rig::Rig;
use simulator::world::WorldConfig;
use simulator::world::aircraft::{PrescribedMotion, VehicleKind};
use testkit::{documents, random::Random};

use crate::fixtures::{count_headings, fly_turns, received_sentences, run_for_s, share_of_flights};

/// The airframes of this seed, unlike the README's, were not used to choose limits.
const TEST_PLAN: IntegrityPlan = IntegrityPlan {
    flights_per_case: 6,
    seed: 5000,
    heading: HeadingKind::Smooth,
    aircraft: VehicleKind::Plane,
    attitude_protocol: Mavlink,
    attitude: AttitudeSource::Autopilot,
};

fn run_cases(names: &[&str]) -> Vec<IntegrityRow> {
    run_plan(TEST_PLAN, names)
}

fn run_plan(plan: IntegrityPlan, names: &[&str]) -> Vec<IntegrityRow> {
    run_whole_plan(IntegrityPlan { flights_per_case: share_of_flights(plan.flights_per_case), ..plan }, names)
}

/// Also an unoptimised build flies all flights, because the bounds are of their mean.
fn run_whole_plan(plan: IntegrityPlan, names: &[&str]) -> Vec<IntegrityRow> {
    let cases: Vec<_> = names.iter().filter_map(|name| fault_case::find_by_name(name)).collect();
    assert_eq!(cases.len(), names.len(), "{names:?}");
    run_integrity_study(plan, &cases, &|| {})
}

/// All flights calibrated, none with an underestimated error.
fn are_all_accepted(row: &IntegrityRow) -> bool {
    row.accepted_percent >= 100.0 && row.wrong_percent <= 0.0
}

/// Whether a code was counted.
fn has_code(counts: &[(String, usize)], code: &str) -> bool {
    counts.iter().any(|(counted, _)| counted == code)
}

/// Hard iron of 2 to 20 uT that changes at once or within up to two minutes, from the first heading on or later, in any
/// motion, at any inclination: 63 flights, only with optimisation, because fewer show too little. Measured: bad 0.7 %, and 3.7 % when the
/// known offset of the gyro began with the first turn.
#[test]
fn headings_are_honest_while_iron_changes_at_any_rate_and_instant() {
    if cfg!(debug_assertions) {
        return;
    }
    let changes: Vec<_> = all_changes().into_iter().filter(|change| change.duration_s <= 120.0).step_by(2).collect();
    let family = fault_case::find_family("sweep-iron").unwrap();
    let sweep = run_sweep(IntegrityPlan { flights_per_case: 1, ..TEST_PLAN }, family, &changes, &|| {});
    assert_eq!(sweep.cells.len(), changes.len());
    assert!(sweep.total.bad_percent <= 1.5 && sweep.total.worst_10s_deg <= 8.0, "{:?}", sweep.total);
    assert!(sweep.total.empty_percent <= 20.0, "{:?}", sweep.total);
}

/// By ArduPilot's MSP the rates are changes of a heading in steps of 1 deg, by INAV's gyro rates in steps of 1 deg/s.
/// Headings are accurate to 0.4 deg RMS (MAVLink 0.3). Bounds are 1.5 times the measured values.
#[test]
fn headings_by_msp_are_smooth_and_accurate() {
    for source in [Msp, MspInav] {
        for row in run_plan(IntegrityPlan { attitude_protocol: source, ..TEST_PLAN }, &["clean"]) {
            assert!(are_all_accepted(&row) && row.smooth_percent > 60.0, "{source:?} {row:?}");
            assert!(row.rms_deg < 0.7 && row.worst_deg < 6.0 && row.bad_percent <= 0.0, "{source:?} {row:?}");
            assert!(row.within_three_sigma_percent > 90.0 && row.empty_percent < 0.1, "{source:?} {row:?}");
        }
    }
}

/// Attitude oscillates by up to 40 deg during ten of 245 s; no heading is output then and no estimate adapts. Without
/// the detection 19 % of the headings were missing and errors reached 74 deg.
#[test]
fn no_heading_is_sent_while_the_attitude_filter_aligns() {
    for row in run_cases(&["aligning"]) {
        assert!(
            are_all_accepted(&row) && row.bad_percent <= 0.0 && row.worst_deg < 8.0 && row.rms_deg < 0.8,
            "{row:?}"
        );
        // Of 245 s, ten of alignment and up to five of settling are without heading.
        assert!((3.5..6.2).contains(&row.empty_percent), "{row:?}");
        assert!(row.within_two_sigma_percent > 88.0, "{row:?}");
    }
}

/// Bounds of bad headings, of the largest error and of sentences without a heading, and the reason that these give.
#[test]
fn a_fault_of_a_source_withholds_the_heading_or_is_not_seen_in_it() {
    for (cases, bad_percent, worst_deg, empty_percent, reason) in [
        // Detected within 0.15 s, in which a turn of 18 deg/s covers 2.7 deg. The fault lasts 175 s or less.
        (&["stuck-x", "stuck-y", "stuck-z", "stuck-all"][..], 0.1, 6.0, 99.0..=100.0, "sensor-stuck"),
        // Fine values are detected after five reports (0.1 s), tenths of a degree after 0.5 s and 3 deg of turn.
        (&["frozen-level", "frozen-turn", "frozen-coarse"], 0.1, 10.0, 98.0..=100.0, "attitude-frozen"),
        // Outliers of the attitude are rejected; dead reckoning bridges them.
        (&["spikes"], 0.0, 25.0, 0.0..=0.1, ""),
        // A spike costs at most two headings.
        (&["sensor-spikes"], 0.0, 10.0, 0.0..=2.0, "sensor-spike"),
        // Another sender is ignored.
        (&["foreign", "foreign-silent"], 0.0, 8.0, 0.0..=0.1, ""),
        // The pause is 12 of 290 s. Until the module's own autopilot returns no heading is sent; the other vehicle's
        // attitude is never used.
        (&["second-vehicle"], 0.0, 8.0, 3.5..=5.0, ""),
        // A current that the aircraft cannot draw is ignored at once. A forged current that is possible is ignored once the
        // field contradicts it; at most five of 175 s may be without heading.
        (
            &["no-autopilot", "disarm-forged", "current-forged", "current-forged-60"],
            0.0,
            f64::INFINITY,
            0.0..=100.0 * 5.0 / 175.0,
            "",
        ),
    ] {
        for row in run_cases(cases) {
            assert!(are_all_accepted(&row), "{row:?}");
            assert!(row.bad_percent <= bad_percent && row.worst_deg <= worst_deg, "{row:?}");
            assert!(empty_percent.contains(&row.empty_percent), "{row:?}");
            assert!(reason.is_empty() || has_code(&row.no_heading_counts, reason), "{row:?}");
        }
    }
}

/// ArduPilot by MSP: a heading that stops in a turn shows after 2 deg. When a coarse source was detected after 0.5 s
/// only, a third of the headings sent was bad, and after a stall of 1.4 s all headings of a flight were. Measured over 40 flights from
/// seed 7000: none bad, 3.6 deg at worst; 8.9 when rates took the jump after a stall for a turn.
#[test]
fn a_source_by_msp_that_stops_in_a_turn_gives_no_heading() {
    let plan = IntegrityPlan { flights_per_case: 16, seed: 40_013, attitude_protocol: Msp, ..TEST_PLAN };
    for row in run_plan(plan, &["frozen-turn", "source-stalls"]) {
        assert!(row.bad_percent <= 0.05 && row.worst_deg <= 6.0, "{row:?}");
    }
}

/// Detected in the next roll, after about 10 of its 25 deg; until then the error is due to the small roll and pitch of
/// level flight.
#[test]
fn a_stale_attitude_gives_no_heading_after_the_next_roll() {
    for row in run_cases(&["attitude-hangs"]) {
        assert!(are_all_accepted(&row) && row.longest_bad_s <= 1.0 && row.worst_deg <= 20.0, "{row:?}");
        assert!(row.empty_percent > 80.0, "{row:?}");
        assert!(has_code(&row.no_heading_counts, "attitude-contradicted"), "{row:?}");
    }
}

/// In the link gaps 1.3 of ten seconds are without heading. Rates integrated over the gaps gave two hard-iron notes in
/// twelve flights, and 42/74/89 % of the headings within one, two and three sigmas.
#[test]
fn gaps_and_stalls_of_the_attitude_are_no_change_of_iron() {
    for row in run_cases(&["link-gaps", "source-stalls"]) {
        assert!(
            !has_code(&row.note_counts, "iron-moved") && row.bad_percent <= 0.05 && row.worst_deg <= 6.5,
            "{row:?}"
        );
        assert!(row.within_two_sigma_percent > 78.0 && row.empty_percent < 18.0, "{row:?}");
    }
}

/// The autopilot is silent for 4 of at least 137 s, then its filter aligns for 15 s. When its attitude was used at
/// once, errors reached 75 deg and each flight had eight hard-iron notes. By MSP, which has no time stamps, the silence
/// shows the restart.
#[test]
fn a_restart_of_the_autopilot_gives_no_wrong_heading() {
    for attitude_protocol in [Mavlink, Msp, MspInav] {
        for row in run_plan(IntegrityPlan { attitude_protocol, ..TEST_PLAN }, &["autopilot-restarts"]) {
            assert!(
                !has_code(&row.note_counts, "iron-moved") && row.bad_percent <= 0.05 && row.worst_deg <= 6.5,
                "{row:?}"
            );
            assert!((5.0..16.0).contains(&row.empty_percent), "{row:?}");
        }
    }
}

/// Saturation is detected with a delay of an eighth of a second.
#[test]
fn a_clipped_axis_is_detected() {
    for row in run_cases(&["sensor-clipped"]) {
        assert!(row.bad_percent <= 0.2 && row.empty_percent > 5.0, "{row:?}");
        // An axis that saturates below values measured before is reported as stuck.
        assert!(
            ["sensor-stuck", "sensor-clipped"].iter().any(|code| has_code(&row.no_heading_counts, code)),
            "{row:?}"
        );
    }
}

/// The configuration is read back ten times a second: at most two sentences of 175 s are empty. `upset-scale`, measured over 20 flights
/// from seed 1, has 0.26 deg RMS, as without a fault; read back once a second, 0.63.
#[test]
fn a_flipped_configuration_bit_costs_two_sentences() {
    for row in run_cases(&["upset-scale", "upset-self-test", "upset-byte-order"]) {
        assert!(row.empty_percent <= 100.0 * 0.2 / 175.0 && row.longest_bad_s <= 0.1, "{row:?}");
        assert!(row.rms_deg <= 0.5 && row.within_three_sigma_percent > 98.0, "{row:?}");
    }
}

/// Hard iron that changes or drifts during calibration leads to a rejection or a larger estimated error. One of twelve
/// may be wrong: a change across the wings between left and right turns is nearly unobservable.
#[test]
fn hard_iron_change_in_calibration_is_refused_or_in_the_expected_error() {
    let plan = IntegrityPlan { flights_per_case: 12, ..TEST_PLAN };
    for row in run_whole_plan(plan, &["cal-moved-2", "cal-moved-5", "cal-moved-10", "cal-warming"]) {
        assert!(row.wrong_percent <= 10.0, "{row:?}");
        assert!(has_code(&row.refusal_counts, "iron-changed"), "{row:?}");
        assert!(row.bad_percent <= 0.5, "{row:?}");
    }
}

/// A bank-angle scale error of 10 % leads to a rejection, or to an estimated error of at least half of the true one.
#[test]
fn a_bank_scale_error_is_refused_or_in_the_expected_error() {
    for row in run_plan(IntegrityPlan { flights_per_case: 20, ..TEST_PLAN }, &["cal-lean-90"]) {
        assert!(row.error_ratio_largest.is_none_or(|ratio| ratio <= 2.0), "{row:?}");
    }
}

/// Iron in the elevator's linkage, hysteresis of the soft iron's angle or along each axis, a bank error with a time
/// constant, pitch of the wrong sign: of the accepted calibrations at most one in twelve has an underestimated error;
/// without hypotheses of these faults and the model discrepancy 85, 47, 82, 62 and 15 % of the planes had.
/// Interference of a VTOL's motors is stronger in turns. Clean flights are all accepted.
#[test]
fn faults_that_stay_the_same_are_refused_or_in_the_expected_error() {
    let plan = IntegrityPlan { flights_per_case: 40, ..TEST_PLAN };
    for (aircraft, case, reason) in [
        (VehicleKind::Plane, "cal-linkage-3", "iron-changed"),
        (VehicleKind::Plane, "cal-lean-lag", "attitude-contradicted"),
        (VehicleKind::Plane, "cal-pitch-reversed", "not-accurate"),
        (VehicleKind::Vtol, "cal-linkage-3", "iron-changed"),
        (VehicleKind::Vtol, "cal-current-unreported", "iron-changed"),
    ] {
        for row in run_plan(IntegrityPlan { aircraft, ..plan }, &[case]) {
            assert!(row.wrong_percent <= 0.05 * row.accepted_percent, "{row:?}");
            assert!(has_code(&row.refusal_counts, reason), "{row:?}");
        }
    }
    // Of 120 planes, seeds from 3000 on, 4, 2, 4 and 0 % of the accepted; of the flights here two or three more or less. Iron that
    // follows the elevator within 5 s shows in the straight flight between the turns; 20 % without it.
    for (case, least_accepted_percent, reason) in [
        ("cal-hysteresis-15", 75.0, "iron-changed"),
        ("cal-hysteresis-axes-15", 75.0, ""),
        ("cal-level-ramp-3", 75.0, ""),
        ("cal-linkage-lag", 30.0, "iron-changed"),
    ] {
        for row in run_whole_plan(plan, &[case]) {
            assert!(reason.is_empty() || has_code(&row.refusal_counts, reason), "{row:?}");
            assert!(row.wrong_percent <= 0.08 * row.accepted_percent, "{row:?}");
            assert!(row.accepted_percent >= least_accepted_percent, "{row:?}");
        }
    }
    for row in run_plan(plan, &["clean"]) {
        assert!(are_all_accepted(&row), "{row:?}");
    }
}

/// Turns at 5 deg of bank, and yaw turns without tilt, of which in a larger run no calibration of 89 flights was
/// accepted.
#[test]
fn movements_that_show_too_little_are_refused() {
    for (aircraft, case, reason) in [
        (VehicleKind::Plane, "cal-bank-5", "too-few-samples"),
        (VehicleKind::Copter, "cal-yaw-only", "unobservable"),
        (VehicleKind::Vtol, "cal-yaw-only", "unobservable"),
    ] {
        for row in run_plan(IntegrityPlan { aircraft, ..TEST_PLAN }, &[case]) {
            assert!(row.accepted_percent <= 0.0 && has_code(&row.refusal_counts, reason), "{row:?}");
        }
    }
}

/// Attitude without quantisation (case `clean`) and in steps of 0.1 deg (`coarse`). Accelerations of copters and VTOLs
/// cause attitude errors of a degree and more. In 60 VTOL flights 0.004 % of the headings were bad; here that is one or
/// two sentences.
#[test]
fn a_clean_flight_raises_no_alarm() {
    for (aircraft, cases, bad_percent) in [
        (VehicleKind::Plane, &["clean", "coarse"][..], 0.0),
        (VehicleKind::Copter, &["clean"], 0.0),
        (VehicleKind::Vtol, &["clean"], 0.02),
    ] {
        for row in run_plan(IntegrityPlan { flights_per_case: 8, aircraft, ..TEST_PLAN }, cases) {
            assert!(are_all_accepted(&row) && row.bad_percent <= bad_percent, "{aircraft:?}: {row:?}");
            assert!(row.empty_percent <= 0.1 && row.alarms_per_hour == 0.0, "{aircraft:?}: {row:?}");
        }
    }
}

/// Bounds of bad and missing headings, percent: twice the values of thirty flights. A copter tilts less than an
/// aeroplane and has a worse attitude, so faults are less observable.
#[test]
fn faults_in_use_of_a_copter_are_compensated_or_withhold_the_heading() {
    for (case, bad_percent, empty_percent) in
        [("moved-2", 2.0, 5.0), ("moved-5", 1.0, 5.0), ("bias-2", 2.0, 5.0), ("late-300", 1.0, 15.0)]
    {
        let plan = IntegrityPlan { flights_per_case: 8, aircraft: VehicleKind::Copter, ..TEST_PLAN };
        for row in run_whole_plan(plan, &[case]) {
            assert!(row.bad_percent <= bad_percent && row.empty_percent <= empty_percent, "{row:?}");
            assert!(are_all_accepted(&row), "{row:?}");
        }
    }
}

#[test]
fn motor_current_interference_in_hover_is_calibrated_as_hard_iron() {
    for row in run_plan(
        IntegrityPlan { flights_per_case: 8, aircraft: VehicleKind::Copter, ..TEST_PLAN },
        &["cal-current-unreported"],
    ) {
        assert!(are_all_accepted(&row) && row.bad_percent <= 0.1, "{row:?}");
    }
}

/// RMS error and coverage of raw and smooth headings; the smooth error is half of the raw one. The smooth sigma
/// includes attitude errors that are equal in calibration and use here, so it is too large.
#[test]
fn headings_of_a_clean_flight_are_within_their_sigmas() {
    for (heading, rms_deg, most_percent) in
        [(HeadingKind::Raw, 0.90, [74.0, 100.0]), (HeadingKind::Smooth, 0.45, [100.0; 2])]
    {
        for row in run_plan(IntegrityPlan { flights_per_case: 12, heading, ..TEST_PLAN }, &["clean"]) {
            assert!(row.rms_deg <= rms_deg, "{row:?}");
            assert!((62.0..=most_percent[0]).contains(&row.within_one_sigma_percent), "{row:?}");
            assert!((89.0..=most_percent[1]).contains(&row.within_two_sigma_percent), "{row:?}");
            let is_smooth = heading == HeadingKind::Smooth;
            assert!(if is_smooth { row.smooth_percent > 99.5 } else { row.smooth_percent == 0.0 }, "{row:?}");
        }
    }
}

/// Errors of gyros from data sheets, and larger ones: scale and cross-axis errors are estimated, the remainder is in
/// the sigma. Without any rates the RMS error is 0.83 deg. Measured over 40 flights of each case: 0.26, 0.29, 0.52 and
/// 0.69 deg.
#[test]
fn gyro_errors_are_estimated() {
    for (case, rms_deg) in [("gyro-1", 0.45), ("gyro-3", 0.6), ("gyro-10", 0.85), ("gyro-ramp", 1.0)] {
        for row in run_whole_plan(TEST_PLAN, &[case]) {
            assert!(row.rms_deg <= rms_deg && row.bad_percent <= 0.3 && row.empty_percent <= 3.0, "{row:?}");
            assert!(row.worst_10s_deg < 5.0 && row.smooth_percent > 95.0, "{row:?}");
            // The estimate lags behind a growing offset; sigma does not include the lag: 80 % in 60 flights, 90 of gyro-10.
            let least_percent = if case == "gyro-ramp" { 78.0 } else { 85.0 };
            assert!(row.within_two_sigma_percent >= least_percent, "{row:?}");
            // An offset that a turn with a scale error of 10 %, or none, has made known: its later change is in the sigma.
            let most_sigma = if matches!(case, "gyro-10" | "gyro-ramp") { 4.0 } else { 1.6 };
            assert!(row.sigma_rms_deg < most_sigma * row.rms_deg, "{row:?}");
        }
    }
}

/// Rates of twice the size, until the chip's configuration is verified after at most 0.1 s and restored. Of an autopilot's report that
/// contradicts them, its own rates are used, and after the repair a new integral of the heading begins. Measured over 20 flights from
/// seed 1 of MAVLink and of MSP: 0.30 and 0.36 deg RMS; 0.75 and 0.98 with a verification each second, 0.28 and 0.63 without a new
/// integral. Before a repair cleared what wrong rates had shown, a third of the headings was empty with seed 13.
#[test]
fn an_upset_of_the_own_gyro_does_not_turn_the_heading() {
    for (attitude_protocol, seed) in [(Mavlink, 41), (Mavlink, 13), (Msp, 1)] {
        let plan = IntegrityPlan { attitude_protocol, flights_per_case: 8, seed, ..TEST_PLAN };
        for row in run_whole_plan(plan, &["imu-upset"]) {
            assert!(row.bad_percent <= 0.1 && row.empty_percent <= 0.2 && row.rms_deg <= 0.5, "{row:?}");
        }
    }
}

/// The own gyro shows within a movement that the autopilot's attitude is late, which is corrected, hangs or leans. Measured over 40
/// flights of each from seed 1: 0.02, 0, 0, 0.1, 0.5 and 0.04 % bad. Before the vertical was compared in the gyro's frame, axis by axis,
/// the first four were 0.02, 0.0, 1.7 and 6.4 %; before the field arbitrated between the own gyro and rates that are computed from a
/// leaning attitude, the next two 2.0 and 1.3 %. Of copters that lean in hover, where no rate shows it, 0.3 %, and before the own vertical
/// was compared 2.2 %. Of planes by INAV beside which iron passes 0 %, 0.1 over 60 flights, and 8 before the own vertical showed the
/// errors of roll and pitch.
#[test]
fn the_own_gyro_checks_the_autopilots_attitude() {
    let automatic = IntegrityPlan { attitude: AttitudeSource::Automatic, ..TEST_PLAN };
    for (aircraft, attitude_protocol, seed, case, bad_percent, empty_percent) in [
        (VehicleKind::Copter, Mavlink, TEST_PLAN.seed, "late-500", 0.5, 0.0..=3.0),
        (VehicleKind::Copter, Mavlink, 1, "lean-30", 1.0, 50.0..=90.0),
        (VehicleKind::Vtol, Mavlink, 41, "attitude-hangs", 0.5, 80.0..=100.0),
        (VehicleKind::Vtol, Mavlink, 1, "lean-30", 0.5, 70.0..=100.0),
        (VehicleKind::Plane, Msp, 17, "lean-30", 1.0, 70.0..=100.0),
        (VehicleKind::Plane, Msp, 1, "imu-stuck-z", 0.5, 0.0..=3.0),
        (VehicleKind::Plane, MspInav, 19, "passing-50-30s", 1.0, 20.0..=45.0),
        (VehicleKind::Plane, Mavlink, 5, "rates-sign", 0.5, 0.0..=2.0),
        (VehicleKind::Plane, Mavlink, 87, "rates-small", 0.5, 0.0..=2.0),
        (VehicleKind::Plane, Mavlink, 1, "rates-degrees", 0.5, 0.0..=2.0),
        (VehicleKind::Plane, Mavlink, 1, "mount-turned-20", 0.5, 0.0..=10.0),
        (VehicleKind::Copter, Mavlink, 1, "mount-turned-10", 0.5, 0.0..=10.0),
    ] {
        for row in run_whole_plan(IntegrityPlan { aircraft, attitude_protocol, seed, ..automatic }, &[case]) {
            assert!(row.bad_percent <= bad_percent && empty_percent.contains(&row.empty_percent), "{row:?}");
        }
    }
}

/// The difference of the two verticals is noise, and the own gyro replaces rates in whole degrees, and those of a gyro with errors.
/// Measured over 100 flights from seed 1:
/// VTOLs 0.40 and 0.39, planes 0.22, copters 0.69 deg. Without the noise VTOLs have 0.57 and 0.63, with INAV's rates planes 0.26.
#[test]
fn headings_beside_the_own_gyro_are_as_accurate_by_each_link() {
    for (aircraft, attitude_protocol, case, rms_deg) in [
        (VehicleKind::Vtol, Mavlink, "clean", 0.52),
        (VehicleKind::Vtol, MspInav, "clean", 0.52),
        (VehicleKind::Plane, MspInav, "clean", 0.25),
        (VehicleKind::Copter, MspInav, "clean", 0.85),
        (VehicleKind::Plane, Mavlink, "gyro-ramp", 0.5),
        (VehicleKind::Plane, Mavlink, "gyro-10-moved-5", 0.6),
    ] {
        let attitude = AttitudeSource::Automatic;
        let plan = IntegrityPlan { attitude, aircraft, attitude_protocol, flights_per_case: 12, ..TEST_PLAN };
        for row in run_whole_plan(plan, &[case]) {
            assert!(row.rms_deg <= rms_deg && row.bad_percent <= 0.0, "{row:?}");
        }
    }
}

/// A sensor that repeats one field with noise is found in the first turn, because the field turns with the aircraft. Until it is found
/// the heading stays where it was. Before this rule the flights of these seeds had errors of up to 123 deg, and 18 % bad, the copters
/// from 52 on before the own gyro showed the offset of the autopilot's. Measured over 100 flights of each: 0.1 to 0.9 % bad and at most
/// 32 deg with an own gyro; without one 0.1 to 2.4 % and 34 deg, of copters by INAV 60 deg.
#[test]
fn a_stuck_sensor_is_found_in_a_turn() {
    use AttitudeSource::{Automatic, Autopilot, Own};
    for (attitude, aircraft, attitude_protocol, seed, bad_percent) in [
        (Automatic, VehicleKind::Vtol, Mavlink, 20, 1.0),
        (Automatic, VehicleKind::Copter, Mavlink, 52, 1.0),
        (Automatic, VehicleKind::Copter, Msp, 1, 2.0),
        (Automatic, VehicleKind::Plane, Mavlink, 40, 1.0),
        (Own, VehicleKind::Vtol, Mavlink, 40, 1.0),
        (Own, VehicleKind::Copter, Mavlink, 20, 1.0),
        (Own, VehicleKind::Plane, Mavlink, 7, 1.0),
        (Autopilot, VehicleKind::Plane, Msp, 49, 3.0),
        (Autopilot, VehicleKind::Plane, MspInav, 1, 3.0),
    ] {
        let plan = IntegrityPlan { attitude, aircraft, attitude_protocol, flights_per_case: 8, seed, ..TEST_PLAN };
        for row in run_whole_plan(plan, &["stuck-noisy"]) {
            assert!(row.bad_percent <= bad_percent && row.worst_deg <= 40.0 && row.rms_deg <= 10.0, "{row:?}");
            assert!((85.0..=97.0).contains(&row.empty_percent), "{row:?}");
        }
    }
}

#[test]
fn a_hard_iron_change_is_estimated_beside_gyro_errors() {
    for (case, bad_percent) in [("gyro-1-moved-5", 0.5), ("gyro-5-moved-5", 1.0), ("gyro-10-moved-5", 3.0)] {
        for row in run_cases(&[case]) {
            assert!(row.bad_percent <= bad_percent && row.empty_percent <= 5.0, "{row:?}");
            assert!(row.hard_iron_error_median_percent.is_some_and(|percent| percent <= 40.0), "{row:?}");
        }
    }
}

/// Bad headings without an estimate of the module's turn: 23, 60 and 83 % at 5, 10 and 20 deg, 25 % in a slow turn of
/// 10 deg. Measured with the estimate over 30 flights: 0.8, 1.3, 0.8 and 0 %.
#[test]
fn a_turn_of_the_module_in_its_mount_is_estimated() {
    for (case, bad_percent, empty_percent) in [
        ("mount-turned-5", 2.0, 5.0),
        ("mount-turned-10", 2.0, 10.0),
        ("mount-turned-20", 2.0, 15.0),
        ("mount-turned-10-slow", 2.0, 5.0),
    ] {
        for row in run_whole_plan(TEST_PLAN, &[case]) {
            assert!(are_all_accepted(&row) && row.bad_percent <= bad_percent, "{row:?}");
            assert!(row.empty_percent <= empty_percent && has_code(&row.note_counts, "mount-moved"), "{row:?}");
        }
    }
}

/// Straight flight shows two of three components of hard iron; the sigma covers the third. The limit of bad headings is
/// that of all directions of the drift; without a drift ten minutes of straight flight keep a small sigma.
#[test]
fn a_drift_in_straight_flight_is_in_the_sigma() {
    for case in ["drift-straight-60", "drift-straight-300"] {
        for row in run_cases(&[case]) {
            assert!(row.bad_percent <= 3.0 && row.within_two_sigma_percent >= 75.0, "{row:?}");
            assert!(row.sigma_rms_deg < 8.0 && has_code(&row.note_counts, "turn-wanted"), "{row:?}");
        }
    }
    // Among these flights are drifts across the horizontal field, which only the heading shows: 8.6 % were bad while the
    // sigma left them out.
    for row in run_plan(IntegrityPlan { seed: 20_013, ..TEST_PLAN }, &["drift-straight-60"]) {
        assert!(row.bad_percent <= 0.7 && row.sigma_rms_deg < 8.0, "{row:?}");
    }
    for row in run_cases(&["steady"]) {
        assert!(row.bad_percent <= 0.0 && row.empty_percent <= 0.0 && row.sigma_rms_deg < 1.0, "{row:?}");
        assert!(row.note_counts.is_empty(), "{row:?}");
    }
}

#[test]
fn wrong_body_rates_do_not_affect_the_heading() {
    for row in run_whole_plan(TEST_PLAN, &["rates-zero", "rates-degrees"]) {
        // Over 60 flights 0.1 % are empty.
        assert!(row.bad_percent <= 0.05 && row.worst_deg <= 15.0 && row.empty_percent <= 0.3, "{row:?}");
        assert!(row.smooth_percent <= 15.0, "{row:?}");
        assert!(row.rms_deg <= 1.1, "{row:?}");
    }
}

/// A wrong sign or scale of the rates is observable in a roll, or in 20 s of level-flight disturbances. Until detection
/// the rates contradict the field and no heading is output; three of 175 s may be wrong.
#[test]
fn wrong_body_rates_in_turns_are_detected() {
    for row in run_plan(IntegrityPlan { flights_per_case: 12, ..TEST_PLAN }, &["rates-sign", "rates-small"]) {
        assert!(row.bad_percent <= 2.0 && row.empty_percent <= 12.0, "{row:?}");
    }
}

/// Iron that goes on moving after its change was detected: 0 and 0.1 % bad, without a drift after the detection 2.7 and 1.0. These seeds
/// have more bad headings than others.
#[test]
fn iron_that_goes_on_moving_is_followed() {
    for (aircraft, seed, case) in [(VehicleKind::Plane, 604, "passing-10-30s"), (VehicleKind::Copter, 20, "throttle-5")]
    {
        let plan = IntegrityPlan { aircraft, seed, flights_per_case: 12, ..TEST_PLAN };
        for row in run_whole_plan(plan, &[case]) {
            assert!(row.bad_percent <= 0.5 && row.empty_percent <= 30.0, "{row:?}");
        }
    }
}

/// Bounds of bad and missing headings for faults in use, percent: twice the values of a hundred flights.
#[test]
fn faults_in_use_are_compensated_or_withhold_the_heading() {
    for (case, bad_percent, empty_percent) in [
        ("moved-2", 0.2, 5.0),
        ("moved-3", 0.2, 5.0),
        ("moved-5", 0.2, 5.0),
        ("moved-10", 1.0, 6.0),
        ("stuck-noisy", 3.0, 100.0),
        ("passing-10-1s", 0.1, 30.0),
        ("passing-10-5s", 0.1, 30.0),
        ("passing-10-30s", 1.0, 30.0),
        ("throttle-5", 0.3, 50.0),
        ("bias-2", 1.0, 20.0),
        ("late-300", 1.0, 20.0),
        ("lean-70", 0.3, 5.0),
        ("ferry", 0.0, 5.0),
    ] {
        for row in run_whole_plan(IntegrityPlan { flights_per_case: 12, ..TEST_PLAN }, &[case]) {
            assert!(row.bad_percent <= bad_percent && row.empty_percent <= empty_percent, "{row:?}");
            // The reported hard-iron change is accurate to a third.
            assert!(row.hard_iron_error_median_percent.is_none_or(|percent| percent <= 30.0), "{row:?}");
            assert_eq!(row.hard_iron_error_median_percent.is_some(), case.starts_with("moved"), "{row:?}");
            if case == "moved-5" {
                let bad_text = format!("{:.1} %", row.bad_percent);
                documents::assert_document_states("README.md", "headings sent as good that are off", &bad_text);
            }
        }
    }
}

struct RestNoise {
    sigma_ut: [f32; 3],
    counts_per_ut: [f32; 3],
    period_us: u32,
    equal_readings_until_stuck: u16,
}

/// Noise of the LIS3MDL from its data sheet; of the LSM303DLHC 2 mG, little more than its resolution.
const SENSOR_NOISES: [RestNoise; 2] = [
    RestNoise {
        sigma_ut: [0.32, 0.32, 0.41],
        counts_per_ut: [68.42; 3],
        period_us: 12_500,
        equal_readings_until_stuck: 12,
    },
    RestNoise { sigma_ut: [0.2; 3], counts_per_ut: [6.7, 6.7, 6.0], period_us: 13_333, equal_readings_until_stuck: 32 },
];

#[test]
fn a_vehicle_parked_for_a_day_raises_no_alarm() {
    for RestNoise { sigma_ut, counts_per_ut, period_us, equal_readings_until_stuck } in SENSOR_NOISES {
        let mut random = Random(u64::from(period_us));
        let mut instrument = Instrument::new(InstrumentConfig {
            equal_readings_until_stuck: Some(equal_readings_until_stuck),
            ..InstrumentConfig::new(period_us)
        });
        let uncalibrated = Calibration::uncalibrated(Orientation::IDENTITY_ROTATION);
        let calibration = Calibration { inclination_rad: 1.1, total_ut: 50.0, ..uncalibrated };
        let calibration = Some((calibration, HeadingUncertainty::NO_UNCERTAINTY));
        instrument.set_correction(Correction { calibration, ..Correction::UNCALIBRATED });
        let field = RollPitch::default().to_body_frame(Field::earth_field(50.0, 1.1, 0.7)).ut;
        for i in 1..=share_of_flights(24) * 3_600_000_000 / u64::from(period_us) {
            let now = Timestamp::from_us(i * u64::from(period_us));
            if i % 8 == 1 {
                let attitude = RollPitch::from_deg(0.02 * random.normal(), 0.02 * random.normal());
                let sender_clock_at_sending = WrappingMillis::default();
                let report =
                    AttitudeReport { sender: SenderId::default(), sender_clock_at_sending, attitude, body_rates: None };
                instrument.on_attitude(now, report);
            }
            let [x, y, z] = std::array::from_fn(|axis| {
                let counts = (field[axis] + sigma_ut[axis] * random.normal()) * counts_per_ut[axis];
                counts.round() / counts_per_ut[axis]
            });
            let reading = Reading { field: Field::from_ut(x, y, z), is_saturated: false, was_overwritten: false };
            let estimate = instrument.on_reading(now, reading);
            assert!(estimate.heading.is_ok(), "after {i} readings: {estimate:?}");
            while instrument.next_sample().is_some() {}
            instrument.update_monitor();
        }
    }
}

#[test]
fn a_run_is_a_function_of_its_seed() {
    let names = ["sensor-spikes", "throttle-5"];
    let small_run = || run_plan(IntegrityPlan { flights_per_case: 2, seed: 9, ..TEST_PLAN }, &names);
    assert_eq!(small_run(), small_run());
}

#[test]
fn parked_for_ten_minutes_with_either_source_raises_no_alarm() {
    for coarse in [false, true] {
        let mut world = WorldConfig::of_table1(3);
        world.attitude_source.noise_deg = 0.01;
        let attitude: Vec<Box<dyn AttitudeFault>> =
            if coarse { vec![Box::new(attitude_quantisation(0.1))] } else { vec![] };
        let mut rig = Rig::with_faults(world, Faults { attitude_faults: attitude, ..Faults::default() });
        run_for_s(&mut rig, 1.0);
        let notice = fly_turns(&mut rig);
        assert_eq!(notice, Some(Ok(())));
        // Stops at the present heading, because a jump without body rates would count as a change of the field.
        let heading_deg = rig.world.true_state(rig.now_us()).heading_rad.to_degrees();
        rig.world.set_prescribed_motion(PrescribedMotion { heading_deg, ..PrescribedMotion::default() });
        run_for_s(&mut rig, 1.0);
        let sentences = received_sentences(&mut rig, 600.0);
        assert!(sentences.len() > 17_000, "{}", sentences.len());
        let first_empty = sentences.iter().find(|sentence| sentence.heading_deg.is_none());
        assert_eq!(first_empty, None, "coarse {coarse}: {} with heading", count_headings(&sentences));
    }
}
