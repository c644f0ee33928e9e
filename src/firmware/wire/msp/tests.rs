use super::*;
use testkit::frames::{bytes_from_hex, msp_frame};

fn reply_frame(function: MspFunction, payload: &[u8]) -> Vec<u8> {
    msp_frame(b'>', function as u16, payload)
}

fn attitude_reply(roll: i16, pitch: i16) -> Vec<u8> {
    reply_frame(MspFunction::Attitude, &[roll.to_le_bytes(), pitch.to_le_bytes(), 10_i16.to_le_bytes()].concat())
}

fn angles_of(roll_decideg: i16, pitch_decideg: i16) -> MspReply {
    MspReply::Attitude(MspAngles { roll_decideg, pitch_decideg, heading_deg: 10 })
}

/// All messages in a stream, and the number of rejected frames.
fn decoded_replies(stream: &[u8]) -> (Vec<MspReply>, u32) {
    let mut receiver = MspReceiver::default();
    let messages = stream.iter().filter_map(|&byte| receiver.push_byte(byte)).collect();
    (messages, receiver.rejected_count())
}

fn decode_single(stream: &[u8]) -> Option<MspReply> {
    match decoded_replies(stream) {
        (messages, 0) if messages.len() == 1 => Some(messages[0]),
        (messages, 1) if messages.is_empty() => None,
        other => panic!("{other:?}"),
    }
}

/// Frames that ArduPlane and INAV accepted, and CRC-8/DVB-S2's check value, 0xBC of "123456789".
#[test]
fn sent_frames_match_frames_that_autopilots_accepted() {
    assert_eq!(checksum(b"123456789"), 0xBC);
    assert_eq!(encode_request(MspFunction::Attitude).to_vec(), bytes_from_hex("24 58 3C 00 6C 00 00 00 D8"));
    let sent = compass_message(0, 123_456, Field::from_ut(20.0, -5.1, 44.2));
    assert_eq!(sent.to_vec(), bytes_from_hex("24 58 3C 00 04 1F 0B 00 00 40 E2 01 00 C8 00 CD FF BA 01 26"));
    for (function, number) in [
        (MspFunction::FcVariant, 2),
        (MspFunction::Status, 101),
        (MspFunction::RawGps, 106),
        (MspFunction::Attitude, 108),
        (MspFunction::Rtc, 247),
    ] {
        assert_eq!(encode_request(function).to_vec(), msp_frame(b'<', number, &[]));
    }
    assert_eq!(compass_message(7, u32::MAX, Field::from_ut(0.0, 0.0, 0.0))[8..13], [7, 255, 255, 255, 255]);
}

#[test]
fn a_field_is_sent_in_milligauss() {
    let encoded = |ut: f32| {
        let sent = compass_message(0, 0, Field::from_ut(ut, 0.0, ut));
        assert_eq!((sent[13], sent[14]), (sent[17], sent[18]));
        i16::from_le_bytes([sent[13], sent[14]])
    };
    let expected = [
        (48.24, 482),
        (48.26, 483),
        (-48.24, -482),
        (-48.26, -483),
        (3_276.7, 32_767),
        (1e9, 32_767),
        (-1e9, -32_768),
        (f32::INFINITY, 32_767),
        (f32::NAN, 0),
    ];
    for (ut, milligauss) in expected {
        assert_eq!(encoded(ut), milligauss, "{ut} uT");
    }
}

/// Each reply with its original length, with more, and one byte shorter, which is rejected.
#[test]
fn replies_of_later_longer_versions_are_decoded() {
    let status = [0, 0, 0, 0, 0, 0, 0x01, 0x02, 0, 0, 3];
    let gps = [2, 11, 0x80, 0xB2, 0xE6, 0x0E, 0x80, 0xC7, 0x1C, 0xFB, 0x2C, 0x01, 5, 0, 6, 0];
    let place = Position::new(25.0, -82_000_000_i32 as f32 * 1e-7, 300.0);
    let date = [0xE8, 0x07, 2, 29, 23, 59, 59, 0xE7, 0x03];
    let day = Date::from_unix_s(1_709_164_800);
    let expected = [
        (MspFunction::FcVariant, b"INAV".to_vec(), MspReply::FcVariant(AutopilotFirmware::Inav)),
        (MspFunction::FcVariant, b"BTFL".to_vec(), MspReply::FcVariant(AutopilotFirmware::Betaflight)),
        (MspFunction::Status, status.to_vec(), MspReply::Armed(true)),
        (MspFunction::Status, [&[9; 6][..], &[0xFE, 0xFF], &[1; 3]].concat(), MspReply::Armed(false)),
        (MspFunction::RawGps, gps.to_vec(), MspReply::RawGps(place)),
        (MspFunction::Attitude, bytes_from_hex("7B 00 CE FF 0A 00"), angles_of(123, -50)),
        (MspFunction::Analog, bytes_from_hex("07 07 07 07 07 D2 04"), MspReply::Current(12.34)),
        // A battery can be charged.
        (MspFunction::Analog, bytes_from_hex("07 07 07 07 07 FE FF"), MspReply::Current(-0.02)),
        (MspFunction::Rtc, date.to_vec(), MspReply::Rtc(day)),
    ];
    for (function, payload, message) in expected {
        assert_eq!(decode_single(&reply_frame(function, &payload)), Some(message));
        let longer = [payload.clone(), vec![0xA5; MAX_PAYLOAD_LENGTH - payload.len()]].concat();
        assert_eq!(decode_single(&reply_frame(function, &longer)), Some(message), "with more");
        if function != MspFunction::Rtc {
            assert_eq!(decode_single(&reply_frame(function, &payload[1..])), None, "{function:?} that is too short");
        }
    }
    // A payload longer than any firmware's is skipped.
    let (messages, rejected) = decoded_replies(
        &[reply_frame(MspFunction::Attitude, &[0; MAX_PAYLOAD_LENGTH + 1]), attitude_reply(1, 2)].concat(),
    );
    assert_eq!((messages, rejected), (vec![angles_of(1, 2)], 0));
}

/// Roll of 12.3 deg right and pitch of 5 deg up, as sent by each firmware, and as decoded.
#[test]
fn the_sign_of_pitch_is_that_of_the_firmware() {
    let expected = RollPitch::from_deg(12.3, 5.0);
    for (firmware, pitch_decideg) in
        [(AutopilotFirmware::ArduPilot, 50), (AutopilotFirmware::Inav, -50), (AutopilotFirmware::Betaflight, -50)]
    {
        let found =
            firmware.attitude_from_angles(MspAngles { roll_decideg: 123, pitch_decideg, heading_deg: 0 }).unwrap();
        assert!((found.roll_rad - expected.roll_rad).abs() < 1e-6, "{firmware:?} {found:?}");
        assert!((found.pitch_rad - expected.pitch_rad).abs() < 1e-6, "{firmware:?} {found:?}");
    }
    assert_eq!(
        AutopilotFirmware::Other.attitude_from_angles(MspAngles { roll_decideg: 0, pitch_decideg: 0, heading_deg: 0 }),
        None
    );
}

#[test]
fn impossible_angles_are_rejected() {
    for (roll, pitch, possible) in
        [(1800, 900, true), (-1800, -900, true), (1801, 0, false), (-1801, 0, false), (0, 901, false), (0, -901, false)]
    {
        let expected = possible.then(|| angles_of(roll, pitch));
        assert_eq!(decode_single(&attitude_reply(roll, pitch)), expected, "{roll} {pitch}");
    }
}

#[test]
fn a_position_needs_a_fix() {
    let gps = |fix: u8, latitude: i32, height_m: i16| {
        let mut payload = vec![fix, 9];
        payload.extend(latitude.to_le_bytes());
        payload.extend((-10_000_000_i32).to_le_bytes());
        payload.extend(height_m.to_le_bytes());
        payload.extend([0; 6]);
        decode_single(&reply_frame(MspFunction::RawGps, &payload))
    };
    let place = |latitude_deg, height_m| Some(MspReply::RawGps(Position::new(latitude_deg, -1.0, height_m)));
    assert_eq!(gps(1, 315_000_000, -400), place(31.5, -400.0));
    assert_eq!(gps(2, -315_000_000, 32_767), place(-31.5, 32_767.0));
    assert_eq!(gps(0, 315_000_000, 0), Some(MspReply::RawGps(None)));
    assert_eq!(gps(2, 910_000_000, 0), Some(MspReply::RawGps(None)));
}

/// Expected seconds are those of `date -u -d ... +%s`.
#[test]
fn a_date_is_decoded_from_calendar_or_seconds() {
    let of_date = |year: u16, month, day| {
        let [y0, y1] = year.to_le_bytes();
        decode_single(&reply_frame(MspFunction::Rtc, &[y0, y1, month, day, 1, 2, 3, 4, 0]))
    };
    let day = |seconds| Some(MspReply::Rtc(Date::from_unix_s(seconds)));
    for (year, month, date, seconds) in [
        (2020, 1, 1, 1_577_836_800),
        (2024, 2, 29, 1_709_164_800),
        (2024, 3, 1, 1_709_251_200),
        (2026, 12, 31, 1_798_675_200),
        (2100, 3, 1, 4_107_542_400),
    ] {
        assert_eq!(of_date(year, month, date), day(seconds), "{year}-{month}-{date}");
        assert!(Date::from_unix_s(seconds).is_some());
    }
    // An unset clock, and invalid dates.
    for (year, month, date) in [
        (0, 1, 1),
        (1900, 1, 0),
        (u16::MAX, 1, 1),
        (2019, 12, 31),
        (2026, 0, 1),
        (2026, 13, 1),
        (2026, 1, 0),
        (2026, 1, 32),
    ] {
        assert_eq!(of_date(year, month, date), Some(MspReply::Rtc(None)), "{year}-{month}-{date}");
    }
    let of_seconds =
        |seconds: u32| decode_single(&reply_frame(MspFunction::Rtc, &[&seconds.to_le_bytes()[..], &[7, 0]].concat()));
    assert_eq!(of_seconds(1_709_164_800), day(1_709_164_800));
    assert_eq!(of_seconds(0), Some(MspReply::Rtc(None)));
    assert_eq!(decode_single(&reply_frame(MspFunction::Rtc, &[0; 5])), None);
}

#[test]
fn refusals_and_empty_replies_are_returned() {
    for function in MspFunction::ALL_FUNCTIONS {
        for (direction, payload) in [(b'!', &[][..]), (b'!', &[1, 2, 3, 4, 5, 6]), (b'>', &[])] {
            let reply = msp_frame(direction, function as u16, payload);
            let is_change = matches!(function, MspFunction::SetSetting | MspFunction::EepromWrite);
            let is_done = is_change && direction == b'>';
            let expected = if is_done { MspReply::Done } else { MspReply::Refused(function) };
            assert_eq!(decode_single(&reply), Some(expected), "{direction} {payload:?}");
        }
    }
}

#[test]
fn unsupported_frames_are_skipped() {
    let version_1 = [b'$', b'M', b'>', 6, 108, 1, 0, 2, 0, 3, 0, 0x6A];
    let other = msp_frame(b'>', 0x3E6C, &[b'$'; 40]);
    let noise = bytes_from_hex("24 24 58 24 58 3E 24 58 3F 00 6C 00 00");
    let stream = [
        &attitude_reply(1, 2)[..],
        &version_1,
        &encode_request(MspFunction::Attitude),
        &other,
        &noise,
        &attitude_reply(3, 4),
    ]
    .concat();
    assert_eq!(decoded_replies(&stream), (vec![angles_of(1, 2), angles_of(3, 4)], 0));
}

#[test]
fn a_frame_within_a_payload_is_not_decoded() {
    let payload = [&[0; 11][..], &attitude_reply(1, 2)].concat();
    let (messages, rejected) =
        decoded_replies(&[reply_frame(MspFunction::Status, &payload), vec![0; MAX_FRAME_LENGTH]].concat());
    assert_eq!((messages, rejected), (vec![MspReply::Armed(false)], 0));
}

/// Requests and replies as INAV's fc_msp.c reads and writes them.
#[test]
fn settings_of_inav_have_their_number_and_the_choice_of_msp() {
    let name = ParameterName::new("align_mag_yaw");
    assert_eq!(encode_setting_request(name, &[])[..], msp_frame(b'<', 0x1007, b"align_mag_yaw\0"));
    assert_eq!(encode_setting_request(name, &[0x84, 0x03])[..], msp_frame(b'<', 0x1004, b"align_mag_yaw\0\x84\x03"));
    let longest = ParameterName::new("sixteen_letters_");
    assert_eq!(
        encode_setting_request(longest, &[1, 2, 3, 4])[..],
        msp_frame(b'<', 0x1004, b"sixteen_letters_\0\x01\x02\x03\x04")
    );
    let info = |kind: u8, mode: u8, values: &[u8]| {
        let fields = [0x12, 0x34, kind, 0, mode, 3, 0, 0, 0, 15, 0, 0, 0, 9, 0, 0, 0];
        let reply = [b"align_mag_yaw\0", &fields[..], values].concat();
        decode_single(&reply_frame(MspFunction::SettingInfo, &reply))
    };
    let choices = b"AUTO\0MSP\0FAKE\0";
    for (kind, mode, values, number, length, msp_choice) in [
        (0, 0x40, [&choices[..], &[200]].concat(), 200.0, 1, Some(4.0)),
        (0, 0, vec![7], 7.0, 1, None),
        (1, 0, vec![0xFE], -2.0, 1, None),
        (2, 0, vec![0xFE, 0xFF], 65_534.0, 2, None),
        (3, 0, vec![0x7C, 0xFC], -900.0, 2, None),
        (4, 0, vec![1, 2, 0, 0], 513.0, 4, None),
    ] {
        let setting = SettingInfo { name, number, length, msp_choice };
        assert_eq!(info(kind, mode, &values), Some(MspReply::Setting(setting)), "{kind}");
    }
    for (kind, values) in [(5, [0; 4]), (6, [0; 4]), (255, [0; 4])] {
        assert_eq!(info(kind, 0, &values), None, "{kind} is no integer");
    }
    assert_eq!(info(4, 0, &[1, 2, 3]), None);
    let of_longer_name = [b"inav_auto_mag_decl\0", &[0; 17][..], &[1]].concat();
    assert_eq!(decode_single(&reply_frame(MspFunction::SettingInfo, &of_longer_name)), None, "not cut to another name");
    assert_eq!(decode_single(&reply_frame(MspFunction::SetSetting, &[])), Some(MspReply::Done));
    let refused = msp_frame(b'!', 0x1004, &[]);
    assert_eq!(decode_single(&refused), Some(MspReply::Refused(MspFunction::SetSetting)));
}
