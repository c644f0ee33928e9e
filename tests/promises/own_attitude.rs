//! The module without an autopilot: roll, pitch and body rates of its own gyro and accelerometer.

use autoswing::attitude::AttitudeSource;
use mavlink_dialect::{ATTITUDE_DATA, MessageData as _};
use simulator::mission::{TurnPlan, fly_mission};
use simulator::module::Module as _;
use simulator::rig::Rig;
use simulator::routine::CalibrationRoutine;
use simulator::world::WorldConfig;
use simulator::world::aircraft::{PrescribedMotion, VehicleKind};
use simulator::world::autopilot::Leg;
use testkit::frames::mavlink_heartbeat;

use crate::fixtures::{max_error_deg, run_for_s, run_until_legs_end, share_of_flights, status_line};

fn own_config(seed: u64) -> WorldConfig {
    WorldConfig { attitude: AttitudeSource::Own, ..WorldConfig::of_table1(seed) }
}

/// Missions: RMS heading error, degrees, from 10 s after the restart on, in which the filter starts in motion, and the share of
/// these errors within two sigmas. Each flight is calibrated, and none off by more than three times its expected error; no heading, of the
/// first seconds either, is off by more than one and a half times the largest sigma by an attitude, 8 deg.
fn fly_missions(vehicle_kind: VehicleKind) -> (f64, f64) {
    let (mut squares, mut within_two_sigma, mut count, mut calibrated_count) = (0.0, 0.0, 0.0, 0);
    let mission_count = share_of_flights(12);
    for seed in 1..=mission_count {
        let config = own_config(seed).with_vehicle_kind(vehicle_kind);
        let mission_result = fly_mission(config, TurnPlan::default(), &mut |_| {});
        if let Ok(calibration) = &mission_result.calibration_result {
            let after = mission_result.errors_after.statistics();
            assert!(after.rms_deg < 3.0 * calibration.expected_rms_deg, "{vehicle_kind:?} {seed}: {after:?}");
        }
        let headings = mission_result.evaluated_headings;
        let worst_deg = headings.iter().map(|heading| heading.error_deg.abs()).fold(0.0, f64::max);
        assert!(worst_deg < 12.0, "{vehicle_kind:?} {seed}: {worst_deg}");
        let first_s = headings.first().map_or(f64::NAN, |heading| heading.true_state.time_s());
        for heading in headings.iter().filter(|heading| heading.true_state.time_s() > first_s + 10.0) {
            squares += heading.error_deg * heading.error_deg;
            within_two_sigma += f64::from(u8::from(heading.error_deg.abs() < 2.0 * heading.sigma_deg));
            count += 1.0;
        }
        calibrated_count += u64::from(!headings.is_empty());
    }
    assert_eq!(calibrated_count, mission_count, "{vehicle_kind:?}");
    ((squares / count).sqrt(), within_two_sigma / count)
}

/// In a field of 54 deg of inclination, all but the boat after some seconds of rest, all but the hand with a known speed over ground.
#[test]
fn vehicles_without_an_autopilot_have_a_heading() {
    for (vehicle_kind, limit_deg) in
        [(VehicleKind::Rover, 1.0), (VehicleKind::Hand, 2.0), (VehicleKind::Boat, 1.0), (VehicleKind::Plane, 2.0)]
    {
        let (rms_deg, within_two_sigma) = fly_missions(vehicle_kind);
        assert!(rms_deg < limit_deg && within_two_sigma > 0.93, "{vehicle_kind:?}: {rms_deg} {within_two_sigma}");
    }
}

/// Fast movements leave gaps between the samples, over which the monitor must not integrate. 3 deg: three of the sigmas that are
/// sent with the headings of the hand at rest.
#[test]
fn a_hand_that_goes_on_turning_the_module_keeps_its_heading() {
    for seed in 1..=3 {
        let world = WorldConfig { attitude: AttitudeSource::Own, ..WorldConfig::random_world(seed) };
        let mut rig = Rig::new(world.with_vehicle_kind(VehicleKind::Hand));
        run_for_s(&mut rig, 5.0);
        rig.send_console_line("set attitude own");
        rig.send_console_line("cal start");
        let gestures = CalibrationRoutine::for_vehicle(VehicleKind::Hand, TurnPlan::default(), 0.0).legs();
        for leg in [gestures.repeat(3), vec![Leg::Hover { seconds: 5.0 }]].concat() {
            rig.world.append_leg(leg);
            run_until_legs_end(&mut rig);
        }
        let notes = rig.take_console_output();
        assert!(notes.contains("note calibrated") && !notes.contains("-moved"), "{seed}: {notes}");
        let true_deg = rig.world.true_state(rig.now_us()).heading_deg();
        let _ = rig.instrument.receive_bytes();
        run_for_s(&mut rig, 10.0);
        let text = String::from_utf8_lossy(&rig.instrument.receive_bytes()).into_owned();
        let headings_deg: Vec<f64> =
            text.lines().filter_map(|line| line.strip_prefix("$HCHDM,")?.split(',').next()?.parse().ok()).collect();
        assert!(headings_deg.len() >= 99, "{seed}: {} headings", headings_deg.len());
        let error_deg = max_error_deg(headings_deg, true_deg);
        assert!(error_deg < 3.0, "{seed}: {error_deg}");
    }
}

fn held_rig(attitude: AttitudeSource) -> Rig {
    let rig = Rig::new(WorldConfig { attitude, ..own_config(2) });
    let motion =
        PrescribedMotion { roll_deg: 20.0, pitch_deg: -10.0, heading_deg: 30.0, ..PrescribedMotion::default() };
    rig.world.set_prescribed_motion(motion);
    rig
}

/// Pitch and roll of the last sentence, degrees.
fn sent_pitch_and_roll_deg(rig: &Rig) -> Option<[f64; 2]> {
    let text = String::from_utf8_lossy(&rig.instrument.receive_bytes()).into_owned();
    let fields: Vec<&str> = text.lines().rfind(|line| line.starts_with("$HCXDR"))?.split(',').collect();
    Some([2, 6].map(|index| fields[index].parse().unwrap()))
}

/// Within 6 deg, twice the tilt that the accelerometer's offset of 40 mg causes. A chip that falls silent is reported by
/// empty headings, one whose register flips is repaired.
#[test]
fn the_own_attitude_is_sent_while_the_chip_answers() {
    let mut rig = held_rig(AttitudeSource::Own);
    rig.run_for_s(0.5);
    for (source, seconds, use_text) in
        [("auto", 0.0, "not in use before the first rest"), ("autopilot", 0.0, "not in use"), ("own", 2.0, "")]
    {
        rig.send_console_line(&format!("set attitude {source}"));
        rig.run_for_s(seconds);
        let status = status_line(&mut rig, "gyro: ");
        let (_, found) = status.split_once("rates unlike the autopilot's").unwrap();
        assert_eq!(found.trim_start_matches(", "), use_text, "{source}: {status}");
    }
    let [pitch_deg, roll_deg] = sent_pitch_and_roll_deg(&rig).unwrap();
    assert!((pitch_deg + 10.0).abs() < 6.0 && (roll_deg - 20.0).abs() < 6.0, "{pitch_deg} {roll_deg}");
    let chip = rig.inertial_sensor.as_ref().unwrap().chip.clone();
    chip.borrow_mut().set_silent(true);
    rig.run_for_s(2.0);
    let _ = sent_pitch_and_roll_deg(&rig);
    rig.run_for_s(1.0);
    assert_eq!(sent_pitch_and_roll_deg(&rig), None);
    chip.borrow_mut().set_silent(false);
    rig.run_for_s(2.0);
    chip.borrow_mut().flip_register_bits(0x11, 0x08);
    rig.run_for_s(2.0);
    assert!(sent_pitch_and_roll_deg(&rig).is_some());
    let status = rig.send_console_line("status all");
    assert!(status.contains("1 register upsets repaired"), "{status}");
}

/// Before its first movements the module does not know the offset of its accelerometer, and no sample is taken, although an autopilot
/// sends its attitude.
#[test]
fn status_shows_that_the_own_attitude_is_not_accurate_yet() {
    let mut rig = held_rig(AttitudeSource::Automatic);
    rig.run_for_s(1.0);
    for (source, is_lost) in [("own", true), ("autopilot", false)] {
        rig.send_console_line(&format!("set attitude {source}"));
        rig.send_console_line("cal abort");
        rig.send_console_line("cal start turns");
        rig.run_for_s(5.0);
        let status = rig.send_console_line("status");
        let cause = "lost readings: for 100 % of the readings the own attitude was not accurate; rest for some seconds";
        assert_eq!(status.contains(cause), is_lost, "{source}: {status}");
        assert_eq!(status.contains("lost readings"), is_lost, "{source}: {status}");
    }
}

/// During the first round of gestures the own attitude becomes accurate. `status` then shows no lost readings, although most readings
/// of the collection were lost.
#[test]
fn status_tells_recently_lost_readings() {
    let world = WorldConfig { attitude: AttitudeSource::Own, ..WorldConfig::random_world(1) };
    let mut rig = Rig::new(world.with_vehicle_kind(VehicleKind::Hand));
    run_for_s(&mut rig, 5.0);
    rig.send_console_line("set attitude own");
    rig.send_console_line("cal start turns");
    let gestures = CalibrationRoutine::for_vehicle(VehicleKind::Hand, TurnPlan::default(), 0.0).legs();
    let is_lost: Vec<bool> = gestures
        .into_iter()
        .map(|leg| {
            rig.world.append_leg(leg);
            run_until_legs_end(&mut rig);
            let status = rig.send_console_line("status");
            assert!(status.contains("collecting: turns"), "{status}");
            status.contains("lost readings")
        })
        .collect();
    assert!(is_lost[0] && is_lost.contains(&false), "{is_lost:?}");
}

/// A board without the chip, as the DroneCAN board, refuses to use it, and keeps its autopilot.
#[test]
fn a_board_without_the_chip_refuses_its_attitude() {
    let mut rig = held_rig(AttitudeSource::Autopilot);
    rig.run_for_s(1.0);
    for source in ["own", "auto"] {
        let reply = rig.send_console_line(&format!("set attitude {source}"));
        assert!(reply.contains("error no-gyro: no gyro and accelerometer of the board answers"), "{reply}");
    }
    assert_eq!(status_line(&mut rig, "gyro: "), "not found");
    assert!(rig.send_console_line("set attitude autopilot").contains("ok attitude-source autopilot"));
    assert!(status_line(&mut rig, "attitude: ").starts_with("roll"));
}

/// Roll, pitch and yaw of the ATTITUDE messages that the module has sent as a system of its own, radians.
fn sent_attitudes_rad(rig: &Rig) -> Vec<[f32; 3]> {
    const SENDER_AND_MESSAGE: [u8; 5] = [1, 158, ATTITUDE_DATA::ID as u8, 0, 0];
    let bytes = rig.autopilot.receive_bytes();
    let frames = bytes.windows(34).filter(|frame| frame[0] == 0xFD && frame[5..10] == SENDER_AND_MESSAGE);
    frames.map(|frame| [14, 18, 22].map(|at| f32::from_le_bytes(frame[at..at + 4].try_into().unwrap()))).collect()
}

/// A ground station on the line of a module without an autopilot gets its attitude ten times a second, without a yaw before
/// the calibration; while nobody sends MAVLink, the line has none.
#[test]
fn a_ground_station_gets_the_own_attitude() {
    let mut rig = held_rig(AttitudeSource::Own);
    rig.run_for_s(1.0);
    rig.send_console_line("set attitude own");
    rig.run_for_s(5.0);
    assert!(sent_attitudes_rad(&rig).is_empty());
    for _ in 0..5 {
        rig.autopilot.send_bytes(&mavlink_heartbeat([255, 190], false, false));
        rig.run_for_s(1.0);
    }
    let attitudes_rad = sent_attitudes_rad(&rig);
    assert!((45..=51).contains(&attitudes_rad.len()), "{}", attitudes_rad.len());
    for [roll_rad, pitch_rad, yaw_rad] in attitudes_rad {
        let [roll_deg, pitch_deg] = [roll_rad, pitch_rad].map(f32::to_degrees);
        assert!((roll_deg - 20.0).abs() < 6.0 && (pitch_deg + 10.0).abs() < 6.0 && yaw_rad.is_nan(), "{roll_deg}");
    }
    rig.run_for_s(11.0);
    let _ = sent_attitudes_rad(&rig);
    rig.run_for_s(2.0);
    assert!(sent_attitudes_rad(&rig).is_empty());
}

/// An autopilot that boots is waited for, and replaces the own attitude for good.
#[test]
fn the_own_attitude_is_used_automatically_without_an_autopilot() {
    let mut rig = held_rig(AttitudeSource::Automatic);
    rig.world.set_sends_attitude(false);
    rig.run_for_s(1.0);
    rig.send_console_line("set attitude auto");
    rig.run_for_s(12.0);
    assert_eq!(status_line(&mut rig, "attitude: "), "none in use");
    rig.run_for_s(4.0);
    assert!(status_line(&mut rig, "attitude: ").starts_with("roll"));
    rig.world.set_sends_attitude(true);
    rig.run_for_s(2.0);
    rig.world.set_sends_attitude(false);
    rig.run_for_s(2.0);
    assert_eq!(status_line(&mut rig, "attitude: "), "none in use");
}

/// An autopilot whose attitude is half a second old: within the two 50 ms steps in which the latency is measured.
#[test]
fn the_latency_that_the_gyro_corrects_is_reported() {
    for (latency_ms, corrected_ms) in [(20.0, None), (500.0, Some(400..=600))] {
        let mut world = WorldConfig { attitude: AttitudeSource::Automatic, ..WorldConfig::of_table1(2) };
        world.attitude_source.latency_ms = latency_ms;
        let mut rig = Rig::new(world);
        rig.world.set_prescribed_motion(PrescribedMotion::default());
        rig.run_for_s(1.0);
        rig.send_console_line("set attitude auto");
        rig.run_for_s(10.0);
        // A bank in a second, held for five, and back.
        for _ in 0..6 {
            for (roll_deg, roll_rate_deg_s, seconds) in
                [(0.0, 25.0, 1.0), (25.0, 0.0, 5.0), (25.0, -25.0, 1.0), (0.0, 0.0, 5.0)]
            {
                rig.world.set_prescribed_motion(PrescribedMotion {
                    roll_deg,
                    roll_rate_deg_s,
                    ..PrescribedMotion::default()
                });
                rig.run_for_s(seconds);
            }
        }
        let gyro = status_line(&mut rig, "gyro: ");
        let reported_ms: Option<u32> =
            gyro.split_once("latency of ").and_then(|(_, text)| text.split(' ').next()?.parse().ok());
        assert!(
            match corrected_ms {
                Some(range) => reported_ms.is_some_and(|ms| range.contains(&ms)),
                None => reported_ms.is_none(),
            },
            "{latency_ms}: {gyro}"
        );
    }
}
