//! Flash contents survive power failures; an interrupted save leaves the old values.

use autoswing::calibration::Calibration;
use autoswing::frames::{Field, RollPitch, wrap_pi};
use autoswing_firmware::health::ResetCause;
use simulator::module::{Module as _, ModuleRunEnd};
use simulator::rig::Rig;
use simulator::transcript::{self, Refusal};
use simulator::world::WorldConfig;
use simulator::world::aircraft::PrescribedMotion;
use simulator::world::autopilot::Leg;
use testkit::flash::CutProgress;

use crate::fixtures::{
    append_routine, calibrated_rig, fly_turns, full_status, run_for_s, run_until_legs_end, shown_calibration,
    started_rig, status_line,
};

#[test]
fn a_calibration_survives_a_restart_and_a_power_cut() {
    let mut rig = calibrated_rig();
    let before = shown_calibration(&mut rig).unwrap();
    rig.send_console_line("reboot");
    rig.run_for_s(1.0);
    assert_eq!(shown_calibration(&mut rig).unwrap(), before);
    rig.power_off();
    rig.power_on(ResetCause::PowerOn);
    rig.run_for_s(1.0);
    assert_eq!(shown_calibration(&mut rig).unwrap(), before);
    assert!(full_status(&mut rig).contains("ok calibrated"));
}

/// Power cuts at every fourth operation of the first save, of four kinds: it starts uncalibrated or with the complete
/// new calibration.
#[test]
fn a_power_cut_in_the_first_save_leaves_the_new_calibration_or_none() {
    let new = shown_calibration(&mut calibrated_rig()).unwrap();
    let mut outcome_counts = [0, 0];
    for operations in (0..40).step_by(4) {
        for cut in CutProgress::ALL {
            let mut rig = started_rig(&WorldConfig::of_table1(3));
            rig.cut_power_after(operations, cut);
            if fly_turns(&mut rig).is_some() {
                continue; // The save was over before the cut.
            }
            rig.power_on(ResetCause::PowerOn);
            rig.run_for_s(1.0);
            rig.take_console_output();
            let loaded_calibration = shown_calibration(&mut rig);
            assert!(
                loaded_calibration.is_none() || loaded_calibration.as_ref() == Some(&new),
                "after {operations} {cut:?}: {loaded_calibration:?}"
            );
            outcome_counts[usize::from(loaded_calibration.is_some())] += 1;
        }
    }
    assert!(outcome_counts[0] > 0, "some cuts come before the record is complete: {outcome_counts:?}");
}

/// Power cuts during a later, small save of a setting.
#[test]
fn a_power_cut_in_a_later_save_leaves_the_old_calibration() {
    let mut rig = calibrated_rig();
    let old = shown_calibration(&mut rig).unwrap();
    let mut power_cuts = 0;
    for operations in 0..52 {
        for cut in CutProgress::ALL {
            rig.cut_power_after(operations, cut);
            rig.console.send_bytes(format!("set stream-rate {}\r", 10 + operations).as_bytes());
            if rig.run_for_s(0.5) == ModuleRunEnd::PowerCut {
                power_cuts += 1;
            }
            rig.power_off();
            rig.power_on(ResetCause::PowerOn);
            rig.run_for_s(0.5);
            rig.take_console_output();
            assert_eq!(shown_calibration(&mut rig).unwrap(), old, "after {operations} {cut:?}");
        }
    }
    // A save of settings erases a page and programs 15 double words; each is cut in four ways.
    assert!(power_cuts >= 64, "the save was cut {power_cuts} times");
}

#[test]
fn a_single_calibration_survives_undo_and_clear_needs_all() {
    let mut rig = calibrated_rig();
    let first = shown_calibration(&mut rig).unwrap();
    rig.send_console_line("cal undo");
    assert!(shown_calibration(&mut rig).is_some(), "there is nothing before the first, so it stays");
    rig.send_console_line("cal clear");
    assert_eq!(shown_calibration(&mut rig).unwrap(), first);
    assert!(rig.send_console_line("cal clear all").contains("ok uncalibrated"));
    assert!(shown_calibration(&mut rig).is_none());
    rig.send_console_line("reboot");
    rig.run_for_s(1.0);
    assert!(shown_calibration(&mut rig).is_none(), "cleared for good");
}

/// A second swing replaces the first only if it is better on held-back samples.
#[test]
fn a_better_calibration_replaces_the_first_and_can_be_undone() {
    let mut rig = calibrated_rig();
    let first = shown_calibration(&mut rig).unwrap();
    // Another magnet aboard: the old calibration is wrong by several degrees.
    rig.world.set_disturbance_ut([6.0, -4.0, 3.0]);
    fly_turns(&mut rig);
    let second = shown_calibration(&mut rig).unwrap();
    let moved_ut = second.calibration.b_vector_ut() - first.calibration.b_vector_ut();
    // The limit of 0.5 uT is 1 deg of heading in this field.
    assert!((moved_ut - nalgebra::Vector3::new(6.0, -4.0, 3.0)).norm() < 0.5, "{moved_ut}");
    assert!(
        rig.send_console_line("cal undo").contains("ok calibrated: number 1 of maximum-likelihood, expected error ")
    );
    assert_eq!(shown_calibration(&mut rig).unwrap().calibration, first.calibration);
    assert!(
        rig.send_console_line("cal undo").contains("ok calibrated: number 2 of maximum-likelihood, expected error ")
    );
    assert_eq!(shown_calibration(&mut rig).unwrap().calibration, second.calibration);
}

/// Circles to one side and level legs contain little information about the vertical axis. Their calibration may have
/// better scores on held-back samples of the same flight, but never replaces one from turns to both sides.
#[test]
fn a_one_sided_flight_does_not_replace_turns_to_both_sides() {
    let mut rig = calibrated_rig();
    let first = shown_calibration(&mut rig).unwrap();
    rig.send_console_line("cal start turns");
    rig.world.append_leg(Leg::Turn { bank_deg: 25.0, heading_change_deg: -720.0 });
    for heading_deg in [0.0, 30.0, 60.0] {
        rig.world.append_leg(Leg::Straight { heading_deg, seconds: 10.0 });
    }
    run_until_legs_end(&mut rig);
    rig.take_console_output();
    let reply = rig.send_console_line("cal solve");
    rig.run_for_s(2.0);
    let text = format!("{reply}{}", rig.take_console_output());
    let refusal = transcript::parse_solve_notice(&text).or(transcript::parse_error(&text).map(Err));
    assert!(matches!(&refusal, Some(Err(Refusal { code, .. })) if code == "thinner"), "{text}");
    assert_eq!(shown_calibration(&mut rig).unwrap(), first);
    // The weakness is reported with the recommended manoeuvre.
    let advice = rig.send_console_line("cal advise");

    assert!(advice.contains("right"), "{advice}");
}

/// In the same field both calibrations are equally good, and noise of the held-back samples decides: the second
/// replaces the first exactly if it wins.
#[test]
fn a_calibration_that_is_no_better_changes_nothing() {
    let mut unchanged = 0;
    let mut replaced = 0;
    for seed in 0..8 {
        let mut rig = started_rig(&WorldConfig::random_world(seed));
        fly_turns(&mut rig);
        let first = shown_calibration(&mut rig).unwrap();
        let outcome = fly_turns(&mut rig).unwrap();
        let second = shown_calibration(&mut rig).unwrap();
        match outcome {
            Ok(()) => {
                assert_ne!(first, second);
                replaced += 1;
            }
            Err(Refusal { code, explanation }) => {
                assert_eq!(code, "not-better", "{explanation}");
                assert_eq!(first, second);
                unchanged += 1;
            }
        }
    }
    assert!(unchanged > 0 && replaced > 0, "{unchanged} kept, {replaced} replaced");
}

#[test]
fn a_calibration_is_not_used_with_another_mounting() {
    let mut rig = calibrated_rig();
    assert!(rig.send_console_line("set mount yaw90").contains("ok mount yaw90, align 0.0 deg; uncalibrated"));
    let status = rig.send_console_line("status");
    assert!(status.contains("calibration: number 1, not applied: it is of mount none"), "{status}");
    assert!(rig.send_console_line("set mount none").contains("ok mount none, align 0.0 deg; calibrated"));
}
/// Armed aeroplane on its routine, with automatic collection.
fn armed_rig() -> Rig {
    let mut rig = Rig::new(WorldConfig::of_table1(7));
    rig.run_for_s(8.0);
    arm_and_start_routine(&mut rig);
    rig.take_console_output();
    rig
}

fn arm_and_start_routine(rig: &mut Rig) {
    rig.world.set_armed(true);
    append_routine(&rig.world);
}

/// Unsolicited output of the module until the end of the routine.
fn output_until_routine_end(rig: &mut Rig) -> String {
    let mut transcript_text = String::new();
    while rig.world.unfinished_leg_count() > 0 && transcript::parse_solve_notice(&transcript_text).is_none() {
        run_for_s(rig, 1.0);
        transcript_text.push_str(&rig.take_console_output());
    }
    transcript_text
}

fn assert_calibrated(transcript_text: &str) {
    assert_eq!(transcript::parse_solve_notice(transcript_text), Some(Ok(())), "{transcript_text}");
}

/// Largest difference of two calibrations' headings in level flight, degrees.
fn max_heading_difference_deg(first_calibration: &Calibration, second_calibration: &Calibration) -> f32 {
    let inverse = first_calibration.w_matrix().try_inverse().expect("a calibration");
    let difference = |heading_deg: f32| {
        let (sin, cos) = heading_deg.to_radians().sin_cos();
        // Field at Xi'an, as simulated.
        let earth = nalgebra::Vector3::new(31.0 * cos, -31.0 * sin, 42.0);
        let sensed = Field::new(inverse * earth + first_calibration.b_vector_ut());
        let [heading_rad, other_rad] = [first_calibration, second_calibration]
            .map(|calibration| RollPitch::default().to_level_frame(calibration.calibrated_field(sensed)).heading_rad());
        wrap_pi(other_rad - heading_rad).to_degrees().abs()
    };
    (0..36).map(|i| difference(10.0 * i as f32)).fold(0.0, f32::max)
}

/// Number of free-flight samples in `status`.
fn retained_sample_count(rig: &mut Rig) -> u32 {
    let line = status_line(rig, "attitudes: ");
    line.split(' ').next().and_then(|sample_count| sample_count.parse().ok()).unwrap_or_else(|| panic!("{line}"))
}

/// Watchdog resets at any time, or repeatedly: the flight still calibrates, and its headings differ from those without
/// resets by at most 1 deg, twice the wanted accuracy of 0.5 deg of each.
#[test]
fn a_watchdog_in_flight_does_not_end_a_collection() {
    let mut uninterrupted_rig = armed_rig();
    assert_calibrated(&output_until_routine_end(&mut uninterrupted_rig));
    let uninterrupted = shown_calibration(&mut uninterrupted_rig).unwrap().calibration;
    for cuts_s in [vec![12.345], vec![33.037], vec![50.5], vec![20.0, 40.111, 60.2]] {
        let mut rig = armed_rig();
        let began_us = rig.now_us();
        for &cut_s in &cuts_s {
            rig.run_until(began_us + (cut_s * 1e6) as u64);
            let before = retained_sample_count(&mut rig);
            assert!(before > 10, "{cuts_s:?}: {before}");
            rig.power_on(ResetCause::Watchdog);
            rig.run_for_s(0.3);
            let after = retained_sample_count(&mut rig);
            assert!((before..=before + 4).contains(&after), "{cuts_s:?}: {before} {after}");
        }
        let transcript_text = output_until_routine_end(&mut rig);
        assert!(!transcript_text.contains("collection-lost"), "{transcript_text}");
        assert_calibrated(&transcript_text);
        let differ = max_heading_difference_deg(&shown_calibration(&mut rig).unwrap().calibration, &uninterrupted);
        assert!(differ < 1.0, "{cuts_s:?}: {differ} deg");
    }
}

/// Landing, restart by command, next flight: samples are retained, and collecting pauses meanwhile. After the end there
/// is nothing to resume.
#[test]
fn a_collection_survives_a_reboot_between_two_flights() {
    let mut rig = armed_rig();
    rig.run_for_s(40.0);
    rig.world.set_armed(false);
    rig.world.set_prescribed_motion(PrescribedMotion::default());
    rig.run_for_s(7.0);
    let before = retained_sample_count(&mut rig);
    let mut printed = rig.send_console_line("reboot");
    rig.run_for_s(5.0);
    printed.push_str(&rig.take_console_output());
    assert!(printed.contains("started by reboot") && !printed.contains("collection-lost"), "{printed}");
    assert_eq!(retained_sample_count(&mut rig), before);
    let status = full_status(&mut rig);
    assert!(status.contains("ok collecting") && status.contains("when the autopilot arms"), "{status}");
    rig.world.end_prescribed_motion();
    arm_and_start_routine(&mut rig);
    assert_calibrated(&output_until_routine_end(&mut rig));
    rig.power_on(ResetCause::Watchdog);
    rig.run_for_s(3.0);
    let status = full_status(&mut rig);
    assert!(status.contains("ok calibrated") && !status.contains("collection-lost"), "{status}");
    assert_eq!(retained_sample_count(&mut rig), 0);
}

/// After a power failure or damaged memory, the loss is reported once on console and MAVLink, and remains in `status`.
/// The next collection starts empty.
#[test]
fn a_lost_collection_is_reported() {
    for damage in [false, true] {
        let mut rig = armed_rig();
        rig.run_for_s(40.0);
        assert!(retained_sample_count(&mut rig) > 40);
        rig.power_off();
        if damage {
            let mut first_word = 0;
            rig.retained_samples.borrow_mut().transform_words(|word| {
                first_word += 1;
                if first_word % 211 == 40 { word ^ 0x0001_0000 } else { word }
            });
        }
        let cause = if damage { ResetCause::Watchdog } else { ResetCause::PowerOn };
        rig.power_on(cause);
        rig.run_for_s(1.0);
        let printed = rig.take_console_output();
        assert!(printed.contains("note collection-lost: "), "{printed}");
        assert!(full_status(&mut rig).contains("collection-lost: "));
        assert!(retained_sample_count(&mut rig) < 10);
        rig.power_on(cause);
        rig.run_for_s(1.0);
        assert!(!rig.take_console_output().contains("collection-lost"), "reported once");
        let transcript_text = output_until_routine_end(&mut rig);
        let notice = transcript::parse_solve_notice(&transcript_text);
        assert!(matches!(notice, Some(Ok(())) | None), "{transcript_text}");
    }
}
