//! Autopilots at the module's ports, without console commands.

use std::cell::RefCell;
use std::f64::consts::PI;
use std::rc::Rc;

use autoswing::calibration::MotorCurrentInterference;
use autoswing_firmware::health::ResetCause;
use log_analysis::score::wrap_180;
use simulator::faults::Faults;
use simulator::heading_errors::HeadingErrors;
use simulator::module::Module as _;
use simulator::nmea::HeadingSentence;
use simulator::rig::Rig;
use simulator::world::aircraft::{PrescribedMotion, VehicleKind};
use simulator::world::autopilot::Leg;
use simulator::world::cable_far_end::{AttachedDevice, FarEnd};
use simulator::world::mavlink_autopilot::{MavlinkAutopilot, MavlinkFrame, ReportedPosition, XIAN_POSITION};
use simulator::world::msp_autopilot::{self, AnswerFaults, CompassSample};
use simulator::world::{CRUISE_CURRENT_A, TrueState, WorldConfig};
use testkit::frames::mavlink_command;

use crate::autopilot_view::{
    HEARTBEAT, MAG_CAL_PROGRESS, MAG_CAL_REPORT, assert_current_interference_is_estimated, frames_with_id,
    has_calibration_success, named_heading_errors_deg, status_texts,
};
use crate::fixtures::{
    HEADING_ERROR_BOUND_DEG, MAVLINK_ARDUPILOT, MSP_ARDUPILOT, fly_routine, full_status, received_sentences, run_for_s,
    shown_calibration, status_line, world_with_vehicle,
};

const FAULTY_MSP_INAV: FarEnd = FarEnd::Msp(
    msp_autopilot::MspFirmware::Inav,
    AnswerFaults {
        drop_probability: 0.05,
        rejection_probability: 0.02,
        truncation_probability: 0.05,
        delay_probability: 0.05,
    },
);

fn rig_with_far_ends(vehicle_kind: VehicleKind, far_ends: [FarEnd; 2]) -> Rig {
    Rig::with_port_devices(world_with_vehicle(vehicle_kind), Faults::default(), far_ends)
}

/// Frames received by the MAVLink autopilot since the last call.
fn received_frames(rig: &Rig, port: usize) -> Vec<MavlinkFrame> {
    mavlink_autopilot(rig, port).borrow_mut().take_received()
}

fn mavlink_autopilot(rig: &Rig, port: usize) -> Rc<RefCell<MavlinkAutopilot>> {
    let AttachedDevice::Mavlink(autopilot) = &rig.port_devices[port] else { panic!("no MAVLink there") };
    Rc::clone(autopilot)
}

const PARAM_REQUEST_READ: u32 = 20;
const COMMAND_LONG: u32 = 76;
const COMMAND_ACK: u32 = 77;
const VISION_POSITION_ESTIMATE: u32 = 102;

fn compass_readings(rig: &Rig, port: usize) -> Vec<CompassSample> {
    let AttachedDevice::Msp(autopilot) = &rig.port_devices[port] else { panic!("no MSP there") };
    autopilot.borrow_mut().take_compass_samples()
}

/// Heading from a field and the true attitude by Liu 2007 eq. 3, independent of the library.
fn heading_deg(reading: &CompassSample, truth: &TrueState) -> f64 {
    let [x, y, z] = reading.field_mg.map(f64::from);
    let ((sin_roll, cos_roll), (sin_pitch, cos_pitch)) = (truth.roll_rad.sin_cos(), truth.pitch_rad.sin_cos());
    let level_x = x * cos_pitch + (y * sin_roll + z * cos_roll) * sin_pitch;
    let level_y = y * cos_roll - z * sin_roll;
    (-level_y).atan2(level_x).rem_euclid(2.0 * PI).to_degrees()
}

fn rms_heading_error_deg(rig: &Rig, readings: &[CompassSample]) -> f64 {
    let squares = readings.iter().map(|reading| {
        let truth = rig.world.true_state(reading.received_at_us);
        wrap_180(heading_deg(reading, &truth) - truth.heading_deg()).powi(2)
    });
    (squares.sum::<f64>() / readings.len() as f64).sqrt()
}

/// Compass samples in straight flight on eight headings, without the turns, and their RMS heading error.
fn readings_on_eight_headings(rig: &mut Rig, port: usize) -> (Vec<CompassSample>, f64) {
    let (mut all_readings, mut squares) = (Vec::new(), 0.0);
    for heading in 0..8 {
        rig.world.append_leg(Leg::Straight { heading_deg: 45.0 * f64::from(heading), seconds: 14.0 });
        run_for_s(rig, 12.0);
        let _ = compass_readings(rig, port);
        run_for_s(rig, 1.5);
        let received = compass_readings(rig, port);
        squares += rms_heading_error_deg(rig, &received).powi(2) * received.len() as f64;
        all_readings.extend(received);
        run_for_s(rig, 0.5);
    }
    let rms_deg = (squares / all_readings.len() as f64).sqrt();
    (all_readings, rms_deg)
}

/// Flight with ArduPilot over MAVLink: attitude requests, status texts, calibration report, true headings.
#[test]
fn a_mavlink_autopilot_suffices_for_a_calibration_flight() {
    for vehicle_kind in [VehicleKind::Plane, VehicleKind::Copter] {
        let mut rig = rig_with_far_ends(vehicle_kind, [MAVLINK_ARDUPILOT, FarEnd::Unconnected]);
        run_for_s(&mut rig, 12.0);
        let autopilot = mavlink_autopilot(&rig, 0);
        let rate_hz = |id| autopilot.borrow().message_rate_hz(id);
        assert_eq!((rate_hz(30), autopilot.borrow().denied_request_count()), (Some(40.0), 0), "of ATTITUDE");
        assert!(rate_hz(33).is_some() && rate_hz(2).is_some(), "place and time");
        let before = received_frames(&rig, 0);
        // The first requests are component 99's: the module listens for another one.
        let is_request = |frame: &MavlinkFrame| [COMMAND_LONG, PARAM_REQUEST_READ].contains(&frame.message_id);
        assert!(before.iter().all(|frame| match (frame.system_id, frame.component_id) {
            (1, 99) => is_request(frame),
            address => address == (1, 158),
        }));
        assert!(frames_with_id(HEARTBEAT, &before).len() >= 10);
        let status = full_status(&mut rig);
        assert!(status.contains("port1: auto, baud 115200, found mavlink\r\n"), "{status}");
        assert!(status.contains("by the field model"), "{status}");
        assert!(status.contains("armed: no\r\n"), "{status}");
        fly_routine(&mut rig);
        let during = received_frames(&rig, 0);
        let status_texts = status_texts(&during);
        assert!(
            status_texts.iter().any(|text| text.starts_with("autoswing: calibrated: expected error ")),
            "{vehicle_kind:?}: {status_texts:?}"
        );
        assert!(
            status_texts.iter().filter(|text| text.contains("collecting")).count() >= 3,
            "{vehicle_kind:?}: {status_texts:?}"
        );
        assert!(has_calibration_success(&during), "{vehicle_kind:?}: {:?}", frames_with_id(MAG_CAL_REPORT, &during));
        assert!(!frames_with_id(MAG_CAL_PROGRESS, &during).is_empty());
        // In straight flight the age of a named value has no effect.
        rig.world.append_leg(Leg::Straight { heading_deg: 200.0, seconds: 60.0 });
        run_for_s(&mut rig, 45.0);
        let _ = received_frames(&rig, 0);
        let mut errors_deg = Vec::new();
        for _ in 0..5 {
            // The world stores the states of the last two seconds.
            run_for_s(&mut rig, 1.0);
            errors_deg.extend(named_heading_errors_deg(&received_frames(&rig, 0), &rig.world));
        }
        assert!(errors_deg.iter().all(|error_deg| error_deg.abs() < HEADING_ERROR_BOUND_DEG), "{errors_deg:?}");
        assert!((23..=27).contains(&errors_deg.len()), "five a second: {}", errors_deg.len());
    }
}

/// Before the calibration the module outputs the raw field, so that the autopilot detects its compass; afterwards the
/// corrected field at 50 Hz. INAV's line drops and truncates answers. MSP lacks body rates and adds six to eight
/// milliseconds of latency: the bound is 1.5 times that of MAVLink.
#[test]
fn msp_gets_the_raw_field_at_first_and_the_corrected_field_later() {
    for (far_end, vehicle_kind) in [
        (MSP_ARDUPILOT, VehicleKind::Plane),
        (FAULTY_MSP_INAV, VehicleKind::Plane),
        (MSP_ARDUPILOT, VehicleKind::Copter),
    ] {
        let mut rig = rig_with_far_ends(vehicle_kind, [far_end, FarEnd::Unconnected]);
        run_for_s(&mut rig, 0.5);
        assert!(compass_readings(&rig, 0).len() >= 15, "from power-up");
        run_for_s(&mut rig, 5.0);
        let status = full_status(&mut rig);
        assert!(status.contains("port1: auto, baud 115200, found msp\r\n"), "{status}");
        assert!(status.contains("armed: no\r\n") && status.contains("attitude: roll "), "{status}");
        let _ = compass_readings(&rig, 0);
        run_for_s(&mut rig, 10.0);
        let raw = compass_readings(&rig, 0);
        assert!((480..=520).contains(&raw.len()), "fifty a second: {}", raw.len());
        assert!(vehicle_kind != VehicleKind::Plane || rms_heading_error_deg(&rig, &raw) > 5.0, "iron bends it");
        fly_routine(&mut rig);
        let (readings, rms) = readings_on_eight_headings(&mut rig, 0);
        assert!(rms < 1.5, "{far_end:?} {vehicle_kind:?}: {rms} deg");
        let strengths = readings.iter().map(|reading| {
            reading.field_mg.map(|component_mg| f64::from(component_mg).powi(2)).iter().sum::<f64>().sqrt()
        });
        let mean_mg = strengths.sum::<f64>() / readings.len() as f64;
        // WMM2025: 526 mG in Xi'an at the beginning of 2026.
        assert!((mean_mg - 526.0).abs() < 12.0, "{mean_mg}");
    }
}

/// Interference of 12 uT in hover is estimated within four sigmas with every protocol that reports the current, and
/// corrected at other currents too; without a reported current the errors include it. After three seconds without a
/// report the mean current is assumed, with a larger sigma.
#[test]
fn motor_current_interference_is_estimated_with_a_reported_current() {
    for (far_end, is_reported) in
        [(MAVLINK_ARDUPILOT, true), (MSP_ARDUPILOT, true), (FAULTY_MSP_INAV, true), (MAVLINK_ARDUPILOT, false)]
    {
        let config = WorldConfig {
            reports_current: is_reported,
            ..world_with_vehicle(VehicleKind::Copter).with_current_interference(12.0)
        };
        let mut rig = Rig::with_port_devices(config, Faults::default(), [far_end, FarEnd::Unconnected]);
        run_for_s(&mut rig, 12.0);
        let current = status_line(&mut rig, "current: ");
        let amperes = current.strip_suffix(" A").and_then(|amperes| amperes.parse::<f64>().ok());
        // Gusts change the hover current.
        let is_right = amperes.map_or(current == "not reported", |amperes| (amperes - CRUISE_CURRENT_A).abs() < 3.0);
        assert!(is_right && amperes.is_some() == is_reported, "{far_end:?}: {current}");
        fly_routine(&mut rig);
        rig.power_on(ResetCause::PowerOn);
        run_for_s(&mut rig, 12.0);
        let calibration = shown_calibration(&mut rig).unwrap_or_else(|| panic!("{far_end:?}")).calibration;
        let error_deg = HeadingErrors::evaluate_calibration(&calibration, &config).statistics().rms_deg;
        if !is_reported {
            assert_eq!(calibration.motor_current, MotorCurrentInterference::NO_INTERFERENCE);
            continue;
        }
        assert_current_interference_is_estimated(&calibration, &config);
        assert!(error_deg < 1.5, "{far_end:?}: {error_deg}");
        if far_end != MAVLINK_ARDUPILOT {
            continue;
        }
        let sigma_deg = status_sigma_deg(&mut rig);
        rig.world.set_reports_current(false);
        run_for_s(&mut rig, 2.0);
        assert!(full_status(&mut rig).contains("\r\ncurrent: 1"), "it holds for three seconds");
        run_for_s(&mut rig, 2.0);
        assert!(full_status(&mut rig).contains("\r\ncurrent: not reported\r\n"));
        // A current spread of 1 A causes 0.8 uT of 28 uT horizontal field: 1.6 deg.
        let silent_deg = status_sigma_deg(&mut rig);
        assert!(silent_deg > sigma_deg.hypot(1.2), "{sigma_deg} {silent_deg}");
    }
}

fn status_sigma_deg(rig: &mut Rig) -> f64 {
    let heading = status_line(rig, "heading: ");
    let sigma = heading.split_once("deg magnetic, sigma ").and_then(|(_, sigma)| sigma.split_once(' '));
    sigma.and_then(|(sigma, _)| sigma.parse().ok()).unwrap_or_else(|| panic!("{heading}"))
}

/// A magnet beyond and within the sensor's range stops the output, so that the autopilot falls back. After saturation
/// the output resumes at once.
#[test]
fn a_disturbed_field_is_not_sent() {
    let mut rig = rig_with_far_ends(VehicleKind::Plane, [MSP_ARDUPILOT, FarEnd::Unconnected]);
    run_for_s(&mut rig, 10.0);
    fly_routine(&mut rig);
    let reading_count = |rig: &mut Rig| {
        run_for_s(rig, 0.5);
        let _ = compass_readings(rig, 0);
        run_for_s(rig, 2.0);
        compass_readings(rig, 0).len()
    };
    assert!((95..=105).contains(&reading_count(&mut rig)));
    for (magnet_ut, afterwards) in [(900.0, Some(95..=105)), (40.0, None)] {
        rig.world.set_disturbance_ut([0.0, 0.0, magnet_ut]);
        assert_eq!(reading_count(&mut rig), 0, "{magnet_ut} uT");
        rig.world.set_disturbance_ut([0.0; 3]);
        if let Some(afterwards) = afterwards {
            assert!(afterwards.contains(&reading_count(&mut rig)), "{magnet_ut} uT");
        }
    }
}

/// ArduPilot's filter uses the field in its own body frame, from which the attitude that it sends differs by trims. The
/// true attitude is that of the filter; without the trims the headings are up to 7.0 and 4.8 deg off (ArduPlane beside
/// the simulated module). The second trim changes in flight, as by the autopilot's autotrim.
#[test]
fn ardupilots_trims_do_not_turn_the_field() {
    for (trim, number, changed_number) in [("PTCH_TRIM_DEG", 3.0, 1.0), ("AHRS_TRIM_Y", 0.035, 0.0)] {
        let mut rig = rig_with_far_ends(VehicleKind::Plane, [MAVLINK_ARDUPILOT, MSP_ARDUPILOT]);
        mavlink_autopilot(&rig, 0).borrow_mut().parameters.set_number(trim, number);
        run_for_s(&mut rig, 1.0);
        rig.send_console_line("set port2 msp");
        fly_routine(&mut rig);
        let (_, rms_deg) = readings_on_eight_headings(&mut rig, 1);
        assert!(rms_deg < 1.0, "{trim}: {rms_deg} deg");
        mavlink_autopilot(&rig, 0).borrow_mut().change_parameter(trim, changed_number);
        let (_, rms_deg) = readings_on_eight_headings(&mut rig, 1);
        assert!(rms_deg < 1.0, "{trim} changed: {rms_deg} deg");
    }
}

/// The same setup from the console, and by a ground station's MAV_CMD_USER_1, which reads the results as texts. A change
/// needs a restart, which is one more command.
#[test]
fn the_autopilot_is_set_up_from_the_console_or_by_a_ground_station() {
    let mut rig = rig_with_far_ends(VehicleKind::Plane, [MAVLINK_ARDUPILOT, FarEnd::Unconnected]);
    let autopilot = mavlink_autopilot(&rig, 0);
    for (name, number) in [("COMPASS_DEV_ID", 5.0), ("COMPASS_PRIO1_ID", 5.0)] {
        autopilot.borrow_mut().parameters.set_number(name, number);
    }
    run_for_s(&mut rig, 10.0);
    let mut notes = rig.send_console_line("autopilot check");
    run_for_s(&mut rig, 20.0);
    notes.push_str(&rig.take_console_output());
    for note in [
        "ok asking the autopilot; notes follow",
        "note compass: slot 1, priority 1: this module, MSP (id 5)",
        "note parameter-wrong: COMPASS_USE is 1, wanted 0",
        "16 right, 3 wrong, 0 changed; to write them: autopilot setup yes",
    ] {
        assert!(notes.contains(note), "{note}: {notes}");
    }
    let set_up = mavlink_command([255, 190], [1, 158], 31_010, 0, [2.0, 0.0, 0.0, 0.0]);
    received_frames(&rig, 0);
    rig.autopilot.send_bytes(&set_up);
    run_for_s(&mut rig, 20.0);
    let texts = status_texts(&received_frames(&rig, 0));
    assert!(texts.iter().any(|text| text.contains("19 right, 0 wrong, 3 changed; restart it")), "{texts:?}");
    assert_eq!(autopilot.borrow().parameters.number("COMPASS_OFS_X"), Some(1.0));
    rig.send_console_line("autopilot restart");
    run_for_s(&mut rig, 2.0);
    assert_eq!(autopilot.borrow().restart_count, 1);
    rig.world.set_armed(true);
    run_for_s(&mut rig, 2.0);
    for command in ["autopilot setup yes", "autopilot restart"] {
        assert!(rig.send_console_line(command).contains("error armed"), "{command}");
    }
}

/// Recommended ArduPilot wiring: MAVLink on one port, MSP on the other, at full rate and 115200 baud; then also at
/// 57600 baud.
#[test]
fn mavlink_and_msp_run_at_once() {
    let mut rig = rig_with_far_ends(VehicleKind::Plane, [MAVLINK_ARDUPILOT, MSP_ARDUPILOT]);
    run_for_s(&mut rig, 1.0);
    assert!(rig.send_console_line("set port2 msp").contains("ok port2 msp, baud 115200"));
    assert!(rig.send_console_line("set vision on").contains("ok vision on"));
    run_for_s(&mut rig, 10.0);
    let status = full_status(&mut rig);
    assert!(status.contains("found mavlink\r\nport2: msp, baud 115200\r\n"), "{status}");
    fly_routine(&mut rig);
    let (_, rms) = readings_on_eight_headings(&mut rig, 1);
    assert!(rms < 1.0, "{rms} deg");
    rig.world.append_leg(Leg::Straight { heading_deg: 315.0, seconds: 200.0 });
    for baud in ["115200", "57600"] {
        rig.send_console_line(&format!("set baud1 {baud}"));
        rig.send_console_line(&format!("set baud2 {baud}"));
        run_for_s(&mut rig, 30.0);
        let (_, _) = (compass_readings(&rig, 1), received_frames(&rig, 0));
        let (mut ages_ms, mut poses, mut squares_deg2) = (Vec::new(), 0_u32, 0.0);
        for _ in 0..10 {
            run_for_s(&mut rig, 1.0);
            // Age by the module's time stamp.
            let age_ms =
                |reading: CompassSample| (reading.received_at_us / 1000).cast_signed() - i64::from(reading.time_ms);
            ages_ms.extend(compass_readings(&rig, 1).into_iter().map(age_ms));
            for pose in frames_with_id(VISION_POSITION_ESTIMATE, &received_frames(&rig, 0)) {
                let time_us = u64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|byte_index| pose.byte_at(byte_index)));
                let truth_deg = rig.world.true_state(time_us).heading_deg();
                // WMM2025: declination -4.2 deg in Xi'an at the beginning of 2026.
                let error_deg = wrap_180(f64::from(pose.float_at(28)).to_degrees() - (truth_deg - 4.2));
                squares_deg2 += error_deg * error_deg;
                assert!(pose.float_at(32).is_finite(), "ArduPilot reads no other covariance");
                poses += 1;
            }
        }
        assert!((480..=520).contains(&ages_ms.len()), "fifty a second at {baud}: {}", ages_ms.len());
        assert!((95..=105).contains(&poses), "ten a second at {baud}: {poses}");
        // Raw heading, with attitude noise of 0.3 deg and bias of 0.2 deg, each amplified by 1.4.
        let rms_deg = (squares_deg2 / f64::from(poses)).sqrt();
        assert!(rms_deg < 1.5, "at {baud}: {rms_deg}");
        // A compass sample of 20 bytes takes 3.5 ms at 57600 baud, after a request of 9 bytes.
        assert!(ages_ms.iter().all(|age_ms| (1..=8).contains(age_ms)), "at {baud}: {:?}", ages_ms.iter().max());
    }
    assert!(full_status(&mut rig).contains(" 0 not sent;"));
}

/// A ground station starts and cancels a calibration and restarts the module, which is rejected in flight. Commands to
/// other systems are ignored.
#[test]
fn a_ground_station_commands_calibration_and_restart() {
    const START: u16 = 42_424;
    const CANCEL: u16 = 42_426;
    const REBOOT: u16 = 246;
    let mut rig = rig_with_far_ends(VehicleKind::Copter, [MAVLINK_ARDUPILOT, FarEnd::Unconnected]);
    rig.run_for_s(5.0);
    rig.send_console_line("set auto off");
    let _ = received_frames(&rig, 0);
    let received_frames_log = RefCell::new(Vec::new());
    let order = |rig: &mut Rig, system: u8, command: u16, parameters: [f32; 4]| {
        rig.autopilot.send_bytes(&mavlink_command([255, 190], [system, 158], command, 0, parameters));
        run_for_s(rig, 2.5);
        let new_frames = received_frames(rig, 0);
        received_frames_log.replace(status_texts(&new_frames));
        let is_to_who_asked = |frame: &&MavlinkFrame| (frame.byte_at(8), frame.byte_at(9)) == (255, 190);
        let answers = frames_with_id(COMMAND_ACK, &new_frames).into_iter().filter(is_to_who_asked);
        answers
            .map(|frame| (u16::from_le_bytes([frame.byte_at(0), frame.byte_at(1)]), frame.byte_at(2)))
            .collect::<Vec<_>>()
    };
    assert_eq!(order(&mut rig, 7, START, [0.0; 4]).len(), 0);
    assert!(full_status(&mut rig).contains("ok uncalibrated"));
    assert_eq!(order(&mut rig, 1, START, [0.0; 4]), [(START, 0)], "accepted");
    assert!(full_status(&mut rig).contains("ok collecting"));
    assert_eq!(order(&mut rig, 1, CANCEL, [0.0; 4]), [(CANCEL, 0)]);
    assert!(full_status(&mut rig).contains("ok uncalibrated"));
    let of_us = [0.0, 0.0, 1.0, 158.0];
    rig.world.set_armed(true);
    run_for_s(&mut rig, 2.0);
    let refused = order(&mut rig, 1, REBOOT, of_us);
    assert!(refused.len() == 1 && refused[0].1 != 0, "{refused:?}");
    assert!(
        received_frames_log.borrow().iter().any(|text| text.starts_with("autoswing: refused armed: ")),
        "{received_frames_log:?}"
    );
    // A forged report disarms in flight; a disarmed state counts after five seconds at rest.
    rig.world.set_armed(false);
    run_for_s(&mut rig, 10.0);
    assert_ne!(order(&mut rig, 1, REBOOT, of_us)[0].1, 0);
    rig.world.set_prescribed_motion(PrescribedMotion::default());
    run_for_s(&mut rig, 7.0);
    rig.take_console_output();
    assert_eq!(order(&mut rig, 1, REBOOT, of_us), [(REBOOT, 0)]);
    assert!(rig.take_console_output().contains("started by reboot"));
}

/// Declinations of the true headings sent in the next five seconds, degrees: true minus magnetic heading.
fn sent_declinations_deg(rig: &mut Rig) -> Vec<f64> {
    let mut magnetic_deg = None;
    let declination = |sentence: HeadingSentence| match sentence.sentence_kind.as_str() {
        "HCHDM" => {
            magnetic_deg = sentence.heading_deg;
            None
        }
        "HCHDT" => Some(wrap_180(sentence.heading_deg? - magnetic_deg?)),
        _ => None,
    };
    received_sentences(rig, 5.0).into_iter().filter_map(declination).collect()
}

/// In Greenland the declination differs by 20 deg and more. Without a fix, an autopilot sends a position near zero, or
/// none. At Xi'an it is 4.15 deg west (WMM2025); headings have steps of 0.1 deg.
#[test]
fn a_position_that_jumps_does_not_turn_the_true_heading() {
    let mut rig = rig_with_far_ends(VehicleKind::Plane, [MAVLINK_ARDUPILOT, FarEnd::Unconnected]);
    fly_routine(&mut rig);
    let height_m = 400.0;
    let positions = [
        Some(XIAN_POSITION),
        Some(ReportedPosition { latitude_deg: 72.0, longitude_deg: -40.0, height_m }),
        Some(ReportedPosition { latitude_deg: 0.000_3, longitude_deg: 0.000_1, height_m }),
        None,
    ];
    for position in positions {
        mavlink_autopilot(&rig, 0).borrow_mut().set_position(position);
        run_for_s(&mut rig, 30.0);
        let declinations_deg = sent_declinations_deg(&mut rig);
        assert!(declinations_deg.len() > 40, "{position:?}: {declinations_deg:?}");
        assert!(
            declinations_deg.iter().all(|declination_deg| (declination_deg + 4.15).abs() < 0.2),
            "{position:?}: {declinations_deg:?}"
        );
    }
}

fn detected_protocol(rig: &mut Rig) -> Option<String> {
    let line = status_line(rig, "port1: ");
    line.split_once("found ").map(|(_, found)| found.to_owned())
}

/// The detected protocol is stored once, after five seconds. The next start uses it immediately; after ten seconds
/// without messages the port searches with MSP requests.
#[test]
fn detection_starts_with_the_stored_protocol() {
    let mut before = rig_with_far_ends(VehicleKind::Copter, [MAVLINK_ARDUPILOT, FarEnd::Unconnected]);
    run_for_s(&mut before, 4.0);
    let empty = before.flash.flash_contents();
    run_for_s(&mut before, 4.0);
    let remembered = before.flash.flash_contents();
    assert!(remembered != empty);
    run_for_s(&mut before, 60.0);
    before.power_on(ResetCause::PowerOn);
    run_for_s(&mut before, 0.2);
    assert_eq!(detected_protocol(&mut before).as_deref(), Some("mavlink"));
    run_for_s(&mut before, 60.0);
    assert!(before.flash.flash_contents() == remembered, "written once");
    let mut rig = rig_with_far_ends(VehicleKind::Copter, [FarEnd::Unconnected, FarEnd::Unconnected]);
    let searches = |rig: &Rig| rig.autopilot.receive_bytes().windows(3).any(|window| window == b"$X<");
    run_for_s(&mut rig, 1.0);
    assert!(searches(&rig), "who remembers nothing searches");
    assert!(rig.load_flash(&remembered));
    let _ = rig.autopilot.receive_bytes();
    run_for_s(&mut rig, 9.9);
    assert!(!searches(&rig));
    run_for_s(&mut rig, 0.6);
    assert!(searches(&rig));
}

/// After ten seconds of silence the new autopilot is detected within five seconds and stored.
#[test]
fn another_autopilot_is_found_after_ten_seconds() {
    let mut before = rig_with_far_ends(VehicleKind::Copter, [MAVLINK_ARDUPILOT, FarEnd::Unconnected]);
    run_for_s(&mut before, 12.0);
    let mut rig = rig_with_far_ends(VehicleKind::Copter, [MSP_ARDUPILOT, FarEnd::Unconnected]);
    assert!(rig.load_flash(&before.flash.flash_contents()));
    run_for_s(&mut rig, 0.1);
    let _ = compass_readings(&rig, 0);
    run_for_s(&mut rig, 9.0);
    assert!(compass_readings(&rig, 0).is_empty(), "it waits for who was there");
    run_for_s(&mut rig, 6.0);
    assert_eq!(detected_protocol(&mut rig).as_deref(), Some("msp"));
    run_for_s(&mut rig, 6.0);
    rig.power_on(ResetCause::PowerOn);
    run_for_s(&mut rig, 0.1);
    let _ = compass_readings(&rig, 0);
    run_for_s(&mut rig, 0.5);
    assert!(compass_readings(&rig, 0).len() >= 15, "from power-up");
}

/// The port sends nothing before its settings are loaded, so no MSP request reaches an NMEA line.
#[test]
fn a_port_uses_its_configured_protocol_from_the_first_byte() {
    let mut rig = rig_with_far_ends(VehicleKind::Copter, [FarEnd::Unconnected, FarEnd::Unconnected]);
    run_for_s(&mut rig, 1.0);
    rig.send_console_line("set port1 nmea");
    for cause in [ResetCause::PowerOn, ResetCause::Software] {
        rig.power_off();
        run_for_s(&mut rig, 0.5);
        let _ = rig.autopilot.receive_bytes();
        rig.power_on(cause);
        run_for_s(&mut rig, 2.0);
        let received = rig.autopilot.receive_bytes();
        assert!(received.starts_with(b"$HC"), "{}", String::from_utf8_lossy(&received[..20]));
        assert!(!received.windows(2).any(|window| window == b"$X") && !received.contains(&0xFD));
    }
}
