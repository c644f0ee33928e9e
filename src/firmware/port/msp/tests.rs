use super::*;
use crate::port::snapshot::tests::test_snapshot;
use autoswing::earth::{Date, Position};
use autoswing::instrument::Estimate;
use autoswing_module::settings::Settings;
use testkit::frames::msp_frame;

const ESTIMATE_PERIOD_US: u64 = 12_500;

fn timestamp(us: u64) -> Timestamp {
    Timestamp::from_us(1_000_000 + us)
}

fn poll_frames(msp: &mut Msp, us: u64, estimate: &Estimate) -> Vec<Vec<u8>> {
    let mut out = TransmitBuffer::default();
    let snapshot = Snapshot { now: timestamp(us), ..test_snapshot(estimate, &Settings::DEFAULT) };
    msp.poll(&snapshot, &mut AutopilotSession::default(), &mut out);
    let mut rest = out.pending_bytes();
    let mut frames = Vec::new();
    while let [b'$', b'X', b'<', _, _, _, length, ..] = rest {
        let (frame, remaining) = rest.split_at(9 + usize::from(*length));
        frames.push(frame.to_vec());
        rest = remaining;
    }
    assert!(rest.is_empty());
    frames
}

fn function_of_frame(frame: &[u8]) -> u16 {
    u16::from_le_bytes([frame[4], frame[5]])
}

fn process_byte(msp: &mut Msp, at: Timestamp, byte: u8) -> Option<ReceivedMessage> {
    msp.process_byte(at, byte, &mut AutopilotSession::default())
}

/// Decoded messages except `Other`, which only identifies the protocol in use.
fn receive(msp: &mut Msp, us: u64, direction: u8, function: MspFunction, payload: &[u8]) -> Vec<ReceivedMessage> {
    let mut received: Vec<_> = msp_frame(direction, function as u16, payload)
        .iter()
        .filter_map(|&byte| process_byte(msp, timestamp(us), byte))
        .collect();
    received.retain(|received| *received != ReceivedMessage::Other);
    received
}

const ATTITUDE_PAYLOAD: [u8; 6] = [100, 0, 50, 0, 0, 0];
const STATUS_ARMED: [u8; 11] = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0];
const STATUS_DISARMED: [u8; 11] = [0; 11];

/// Protocol with a known firmware.
fn msp_with_firmware(name: &[u8]) -> Msp {
    let mut msp = Msp::default();
    assert!(receive(&mut msp, 0, b'>', MspFunction::FcVariant, name).is_empty());
    msp
}

/// Times, microseconds, and functions of the requests, if each attitude request is answered after a time, or never.
fn requests_in_seconds(msp: &mut Msp, seconds: u64, answered_after_us: Option<u64>) -> Vec<(u64, u16)> {
    let mut requested = Vec::new();
    let mut answer_us = None;
    for us in (0..seconds * 1_000_000).step_by(500) {
        if answer_us.is_some_and(|at_us| us >= at_us) {
            answer_us = None;
            assert_eq!(receive(msp, us, b'>', MspFunction::Attitude, &ATTITUDE_PAYLOAD).len(), 1);
        }
        if us % ESTIMATE_PERIOD_US == 0 {
            for frame in poll_frames(msp, us, &Estimate::EMPTY) {
                requested.push((us, function_of_frame(&frame)));
                if function_of_frame(&frame) == MspFunction::Attitude as u16 {
                    answer_us = answered_after_us.map(|after_us| us + after_us);
                }
            }
        }
    }
    requested
}

fn count_requests(requested: &[(u64, u16)], function: MspFunction) -> usize {
    requested.iter().filter(|(_, requested)| *requested == function as u16).count()
}

/// Only the firmware is requested, 20 times a second until it replies. An unknown firmware provides no attitude.
#[test]
fn without_a_known_firmware_attitude_is_ignored() {
    for (name, times) in [(None, 209..=211), (Some(b"PX4X"), 10..=10)] {
        let mut msp = name.map_or_else(Msp::default, |name| msp_with_firmware(name));
        assert!(receive(&mut msp, 0, b'>', MspFunction::Attitude, &ATTITUDE_PAYLOAD).is_empty());
        let requested = requests_in_seconds(&mut msp, 10, None);
        assert_eq!(count_requests(&requested, MspFunction::Attitude), 0);
        let request_count = count_requests(&requested, MspFunction::FcVariant);
        assert!(times.contains(&request_count), "{name:?}: {request_count}");
        assert!((9..=11).contains(&count_requests(&requested, MspFunction::Status)), "whether it is armed is of use");
    }
    let first = poll_frames(&mut Msp::default(), 0, &Estimate::EMPTY);
    assert!(first.iter().any(|frame| function_of_frame(frame) == MspFunction::FcVariant as u16), "at once");
}

/// INAV's gyro: forward, left, up, deg/s. ArduPilot answers with an empty frame, and is not asked again for each
/// attitude.
#[test]
fn inav_s_gyro_gives_the_body_rates() {
    let gyro: Vec<u8> = [0_i16, 0, 512, 3, -4, -18, 0, 0, 0].iter().flat_map(|number| number.to_le_bytes()).collect();
    for (name, expected_deg_s) in [(b"INAV", Some([3.0, 4.0, 18.0])), (b"ARDU", None), (b"BTFL", None)] {
        let mut msp = msp_with_firmware(name);
        assert!(receive(&mut msp, 0, b'>', MspFunction::RawImu, &gyro).is_empty());
        let received = receive(&mut msp, 0, b'>', MspFunction::Attitude, &ATTITUDE_PAYLOAD);
        let [ReceivedMessage::Attitude(report)] = received[..] else { panic!("{received:?}") };
        let found_deg_s = report.body_rates.map(|rates| rates.rad_s().map(|rad_s| rad_s.to_degrees().round()));
        assert_eq!(found_deg_s, expected_deg_s, "{name:?}");
        let requested = requests_in_seconds(&mut msp, 10, Some(10_000));
        let [attitudes, gyros] = [MspFunction::Attitude, MspFunction::RawImu].map(|f| count_requests(&requested, f));
        let expected = if name == b"INAV" { attitudes * 3 / 4..attitudes } else { 0..1 };
        assert!(attitudes > 100 && expected.contains(&gyros), "{name:?}: {attitudes} {gyros}");
    }
}

/// Body rates without a gyro, from a heading that turns by 1 deg in 50 ms.
#[test]
fn without_a_gyro_the_attitude_s_changes_give_the_body_rates() {
    let mut msp = msp_with_firmware(b"ARDU");
    let mut sum_deg_s = 0.0;
    for step in 0..100_u16 {
        let angles: Vec<u8> = [0, 0, (350 + step * 2 / 5) % 360].iter().flat_map(|angle| angle.to_le_bytes()).collect();
        let received = receive(&mut msp, u64::from(step) * 20_000, b'>', MspFunction::Attitude, &angles);
        let [ReceivedMessage::Attitude(report)] = received[..] else { panic!("{received:?}") };
        sum_deg_s += if step >= 50 { report.body_rates.unwrap().rad_s()[2].to_degrees() } else { 0.0 };
    }
    assert!((sum_deg_s / 50.0 - 20.0).abs() < 0.5, "{}", sum_deg_s / 50.0);
}

/// Attitude is requested at 50 Hz at most, less from a slow autopilot, in steps of the estimates; other data about once
/// a second each, the current four times.
#[test]
fn attitude_is_requested_at_the_rate_of_the_replies() {
    for (after_us, min_requests, max_requests) in
        [(3_500, 495, 501), (9_500, 495, 501), (18_000, 395, 401), (40_000, 195, 201)]
    {
        let mut msp = msp_with_firmware(b"ARDU");
        let requested = requests_in_seconds(&mut msp, 10, Some(after_us));
        let request_count = count_requests(&requested, MspFunction::Attitude);
        assert!(
            (min_requests..=max_requests).contains(&request_count),
            "answered after {after_us} us: {request_count}"
        );
        for other in PERIODIC_REQUESTS {
            let times = if other == MspFunction::Analog { 4 } else { 1 };
            assert!((9 * times..=10 * times + 1).contains(&count_requests(&requested, other)), "{other:?}");
        }
    }
}

/// Requests continue: without replies every 50 ms, with refusals at the full rate.
#[test]
fn unanswered_requests_do_not_stop_polling() {
    let mut msp = msp_with_firmware(b"INAV");
    let unanswered = requests_in_seconds(&mut msp, 10, None);
    let attitudes: Vec<u64> = unanswered
        .iter()
        .filter(|(_, function)| *function == MspFunction::Attitude as u16)
        .map(|(us, _)| *us)
        .collect();
    assert!(attitudes.windows(2).all(|pair| pair[1] - pair[0] == 50_000), "{attitudes:?}");
    // No request is repeated before the timeout, even if polled just before it.
    let mut msp = msp_with_firmware(b"INAV");
    let is_asked =
        |msp: &mut Msp, us| poll_frames(msp, us, &Estimate::EMPTY).iter().any(|f| function_of_frame(f) == 108);
    assert!(is_asked(&mut msp, 0) && !is_asked(&mut msp, 49_999) && is_asked(&mut msp, 50_000));
    assert!(receive(&mut msp, 51_000, b'!', MspFunction::Attitude, &[]).is_empty());
    assert!(is_asked(&mut msp, 70_000));
    assert!(receive(&mut msp, 71_000, b'!', MspFunction::Status, &[]).is_empty());
    assert!(!is_asked(&mut msp, 90_000), "that was not the answer to this");
}

#[test]
fn an_incomplete_reply_is_discarded_and_a_damaged_one_counted() {
    let mut msp = msp_with_firmware(b"ARDU");
    poll_frames(&mut msp, 0, &Estimate::EMPTY);
    let mut answer = msp_frame(b'>', MspFunction::Attitude as u16, &ATTITUDE_PAYLOAD);
    assert!(answer[..12].iter().all(|&byte| process_byte(&mut msp, timestamp(10_000), byte).is_none()));
    poll_frames(&mut msp, 50_000, &Estimate::EMPTY);
    let received: Vec<_> = answer.iter().filter_map(|&byte| process_byte(&mut msp, timestamp(60_000), byte)).collect();
    assert_eq!((received.len(), msp.rejected_frame_count()), (1, 0));
    answer[9] ^= 1;
    assert!(answer.iter().all(|&byte| process_byte(&mut msp, timestamp(70_000), byte).is_none()));
    assert_eq!(msp.rejected_frame_count(), 1);
}

#[test]
fn only_a_reply_detects_an_msp_peer() {
    let mut msp = Msp::default();
    assert!(b"$GPRMC,$X>$X!".iter().all(|&byte| process_byte(&mut msp, timestamp(0), byte).is_none()));
    for (direction, payload) in [(b'!', &b""[..]), (b'>', b"INAV")] {
        let answer = msp_frame(direction, MspFunction::FcVariant as u16, payload);
        let received: Vec<_> = answer.iter().map(|&byte| process_byte(&mut msp, timestamp(7), byte)).collect();
        let (last, before) = received.split_last().unwrap();
        assert_eq!((*last, before.iter().flatten().count()), (Some(ReceivedMessage::Other), 0));
    }
}

#[test]
fn armed_state_expires_after_ten_seconds() {
    let mut msp = Msp::default();
    assert_eq!(msp.is_armed(timestamp(0)), None);
    assert!(receive(&mut msp, 0, b'>', MspFunction::Status, &STATUS_ARMED).is_empty());
    assert_eq!((msp.is_armed(timestamp(10_000_000)), msp.is_armed(timestamp(10_000_001))), (Some(true), None));
    assert!(receive(&mut msp, 11_000_000, b'>', MspFunction::Status, &STATUS_DISARMED).is_empty());
    assert_eq!(msp.is_armed(timestamp(11_000_000)), Some(false));
    assert!(receive(&mut msp, 12_000_000, b'!', MspFunction::Status, &[]).is_empty());
    assert_eq!(msp.is_armed(timestamp(12_000_000)), Some(false), "a refusal says nothing");
}

#[test]
fn current_position_and_date_are_received() {
    let mut msp = Msp::default();
    let received = receive(&mut msp, 0, b'>', MspFunction::Analog, &[0, 0, 0, 0, 0, 0xE2, 0x04]);
    assert_eq!(received, [ReceivedMessage::Current(12.5)]);
    let mut gps = [2, 9, 0, 0, 0, 0, 0, 0, 0, 0, 44, 1, 0, 0, 0, 0];
    gps[2..6].copy_from_slice(&500_000_000_i32.to_le_bytes());
    gps[6..10].copy_from_slice(&(-100_000_000_i32).to_le_bytes());
    let place = Position::new(50.0, -10.0, 300.0).unwrap();
    assert_eq!(receive(&mut msp, 0, b'>', MspFunction::RawGps, &gps), [ReceivedMessage::Position(place)]);
    gps[0] = 0;
    assert!(receive(&mut msp, 0, b'>', MspFunction::RawGps, &gps).is_empty(), "no fix");
    let day = Date::from_unix_s(1_709_164_800).unwrap();
    let rtc = [0xE8, 0x07, 2, 29, 0, 0, 0, 0, 0];
    assert_eq!(receive(&mut msp, 0, b'>', MspFunction::Rtc, &rtc), [ReceivedMessage::Date(day)]);
    assert!(receive(&mut msp, 0, b'>', MspFunction::Rtc, &[0; 6]).is_empty(), "a clock that was never set");
}

#[test]
fn a_request_that_does_not_fit_is_sent_later() {
    let mut msp = msp_with_firmware(b"ARDU");
    let mut out = TransmitBuffer::default();
    assert!(out.append_message(&[&[0; 380]]));
    let snapshot = Snapshot { now: timestamp(0), ..test_snapshot(&Estimate::EMPTY, &Settings::DEFAULT) };
    msp.poll(&snapshot, &mut AutopilotSession::default(), &mut out);
    assert_eq!(out.pending_bytes().len(), 380);
    assert!(poll_frames(&mut msp, 25_000, &Estimate::EMPTY).iter().any(|frame| function_of_frame(frame) == 108));
}
