pub mod setup;

use autoswing_firmware::wire::msp::{self, AutopilotFirmware, MspFunction, MspReceiver, MspReply};

use super::*;

const AUTOPILOT_STATE: AutopilotState = AutopilotState {
    roll_rad: 0.2,
    pitch_rad: 0.1,
    yaw_rad: -0.1,
    body_rates_rad_s: [0.05, -0.07, 0.3],
    is_armed: true,
    position: Some((-33.9, 151.2, 20.0)),
    // Unix time of 2026-11-22, noon.
    unix_s: Some(1_795_348_800),
    current_a: Some(12.34),
};

const NO_FAULTS: AnswerFaults = AnswerFaults::NO_FAULTS;

fn send_request(autopilot: &mut MspAutopilot, at_us: u64, bytes: &[u8]) {
    for &byte in bytes {
        autopilot.receive_byte(at_us, byte);
    }
}

fn request_reply(
    autopilot: &mut MspAutopilot,
    function: MspFunction,
    autopilot_state: &AutopilotState,
) -> Option<MspReply> {
    send_request(autopilot, 0, &msp::encode_request(function));
    let mut receiver = MspReceiver::default();
    let messages: Vec<_> = autopilot
        .due_reply_bytes(u64::MAX, autopilot_state)
        .into_iter()
        .filter_map(|byte| receiver.push_byte(byte))
        .collect();
    assert!(messages.len() <= 1 && receiver.rejected_count() == 0);
    messages.first().copied()
}

#[test]
fn the_library_understands_variant_position_and_date_of_both_firmwares() {
    assert_eq!(testkit::frames::crc_8_dvb_s2(b"123456789"), 0xBC);
    for (firmware, detected) in
        [(MspFirmware::ArduPilot, AutopilotFirmware::ArduPilot), (MspFirmware::Inav, AutopilotFirmware::Inav)]
    {
        let mut autopilot = MspAutopilot::new(firmware, NO_FAULTS, 1);
        let reply = request_reply(&mut autopilot, MspFunction::FcVariant, &AUTOPILOT_STATE);
        assert_eq!(reply, Some(MspReply::FcVariant(detected)));
        let Some(MspReply::RawGps(Some(position))) =
            request_reply(&mut autopilot, MspFunction::RawGps, &AUTOPILOT_STATE)
        else {
            panic!()
        };
        assert!((position.latitude_deg + 33.9).abs() < 1e-5 && (position.longitude_deg - 151.2).abs() < 2e-5);
        assert!((position.height_m - 20.0).abs() < 1e-6);
        for unix_s in [1_795_348_800, 1_709_164_800, 1_735_689_599, 4_107_542_400_u64] {
            let autopilot_state = AutopilotState { unix_s: Some(unix_s), ..AUTOPILOT_STATE };
            let Some(MspReply::Rtc(Some(day))) = request_reply(&mut autopilot, MspFunction::Rtc, &autopilot_state)
            else {
                panic!()
            };
            assert_eq!(u64::from(day.days_since_1970()), unix_s / 86_400);
        }
        let lost = AutopilotState { position: None, unix_s: None, ..AUTOPILOT_STATE };
        assert_eq!(request_reply(&mut autopilot, MspFunction::RawGps, &lost), Some(MspReply::RawGps(None)));
        assert_eq!(request_reply(&mut autopilot, MspFunction::Rtc, &lost), Some(MspReply::Rtc(None)));
    }
}

#[test]
fn answers_come_in_the_order_of_their_requests() {
    let mut autopilot = MspAutopilot::new(MspFirmware::ArduPilot, NO_FAULTS, 3);
    let functions =
        [MspFunction::Attitude, MspFunction::Status, MspFunction::Attitude, MspFunction::Rtc, MspFunction::FcVariant];
    for (at_us, function) in (0..).zip(functions) {
        send_request(&mut autopilot, at_us, &msp::encode_request(function));
    }
    let answers = autopilot.due_reply_bytes(u64::MAX, &AUTOPILOT_STATE);
    let mut remaining = answers.as_slice();
    let mut answers = Vec::new();
    while let [_, _, _, _, function, _, length, ..] = remaining {
        answers.push(*function);
        remaining = &remaining[9 + usize::from(*length)..];
    }
    assert_eq!(answers, functions.map(|function| function as u8));
}

/// Messages, bytes and rejected frames from a thousand requests.
fn replies_with_faults(answer_faults: AnswerFaults) -> (Vec<MspReply>, usize, u32) {
    let mut autopilot = MspAutopilot::new(MspFirmware::ArduPilot, answer_faults, 5);
    let mut bytes = Vec::new();
    for i in 0..1_000_u64 {
        send_request(&mut autopilot, i * 20_000, &msp::encode_request(MspFunction::Attitude));
        bytes.extend(autopilot.due_reply_bytes((i + 1) * 20_000, &AUTOPILOT_STATE));
    }
    let number = bytes.len();
    let mut receiver = MspReceiver::default();
    bytes.extend([0; 128]);
    let messages = bytes.into_iter().filter_map(|byte| receiver.push_byte(byte)).collect();
    (messages, number, receiver.rejected_count())
}

/// Probability 0.1 within four sigmas; unaffected answers arrive.
#[test]
fn answer_faults_occur_with_their_probability() {
    let tenth = 62..=138;
    let faultless_bytes = 15_000;
    let (messages, byte_count, _) = replies_with_faults(AnswerFaults { drop_probability: 0.1, ..NO_FAULTS });
    assert!(tenth.contains(&(1_000 - messages.len())) && byte_count == messages.len() * 15);
    let (messages, byte_count, _) = replies_with_faults(AnswerFaults { rejection_probability: 0.1, ..NO_FAULTS });
    let refused = messages.iter().filter(|message| matches!(message, MspReply::Refused(MspFunction::Attitude))).count();
    assert!(tenth.contains(&refused) && messages.len() == 1_000 && byte_count == faultless_bytes - refused * 6);
    let (messages, byte_count, _) = replies_with_faults(AnswerFaults { truncation_probability: 0.1, ..NO_FAULTS });
    assert!(tenth.contains(&(1_000 - messages.len())), "{} of 1,000", messages.len());
    assert!((14_000..faultless_bytes).contains(&byte_count));
    // Of joined answers only the last one is missing, because no answer follows it.
    let (messages, _, rejected) = replies_with_faults(AnswerFaults { delay_probability: 0.5, ..NO_FAULTS });
    assert!(messages.len() >= 990 && rejected == 0, "{}", messages.len());
    assert_eq!(replies_with_faults(NO_FAULTS).0.len(), 1_000);
}

#[test]
fn a_delayed_answer_is_sent_with_the_next() {
    let mut autopilot =
        MspAutopilot::new(MspFirmware::ArduPilot, AnswerFaults { delay_probability: 1.0, ..NO_FAULTS }, 5);
    send_request(&mut autopilot, 0, &msp::encode_request(MspFunction::Attitude));
    assert!(autopilot.due_reply_bytes(20_000, &AUTOPILOT_STATE).is_empty());
    autopilot.answer_faults = NO_FAULTS;
    send_request(&mut autopilot, 20_000, &msp::encode_request(MspFunction::Status));
    assert_eq!(autopilot.due_reply_bytes(40_000, &AUTOPILOT_STATE).len(), 15 + 31);
}
