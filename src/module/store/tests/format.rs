//! Stored bytes, and extension of the format.

use autoswing::attitude::AttitudeSource;
use autoswing::inertial::SensorOffsets;
use serde::Serialize;
use testkit::frames::bytes_from_hex;

use super::*;
use crate::replaced_numbers::AutopilotKind;
use crate::settings::{BaudRate, SigningKey};

fn stored_state() -> StoredState {
    let settings = Settings {
        inclination_deg: Some(-60.0),
        align_deg: 3.5,
        stream_rate_hz: 25,
        mount: Orientation::from_name("yaw90").unwrap(),
        attitude_bias_deg: 0.5,
        bank_scale_error_percent: 2.0,
        port1_baud: BaudRate::B460800,
        port2_protocol: ProtocolKind::Msp,
        sends_vision_yaw: true,
        ..settings()
    };
    StoredState {
        save_count: 300,
        current_slot: Some(SlotReference { slot: 2, crc: 0x1234_5678 }),
        previous_slot: None,
        settings,
        startup_values: StartupValues {
            is_collecting: true,
            detected_protocols: [ProtocolKind::Mavlink, ProtocolKind::Auto],
        },
    }
}

fn full_calibration_record() -> CalibrationRecord {
    let mut record = calibration_record(7);
    record.calibration.motor_current = MotorCurrentInterference {
        ut_per_a: [0.5, -0.25, 0.125],
        sigma_ut_per_a: 0.01,
        mean_current_a: 12.0,
        current_sigma_a: 4.0,
    };
    record.sensor.model = MagnetometerModel::Lsm303dlhc;
    record.sensor_offsets = SensorOffsets {
        gyro_rad_s: [1.0, 2.0, 3.0],
        gyro_sigma_rad_s: [0.5, 0.25, 2.0],
        accelerometer_m_s2: [4.0, 5.0, 6.0],
        temperature_c: 10.0,
        movement_m_s: 8.0,
    };
    record
}

pub(super) fn field_bytes_of_item(item: &[u8]) -> Vec<u8> {
    let PageContent::Item(StoredItem { field_bytes: fields, .. }) = flash_page::parse_page(item) else {
        panic!("{item:?}")
    };
    fields.to_vec()
}

fn encoded_fields(value: &impl StoredFields) -> Vec<u8> {
    field_bytes_of_item(&encoded_item(value))
}

/// A state and a calibration as stored.
const STATE: &str = "
    01 df00
    01 0200 ac02  02 0700 0102f8acd19101  03 0100 00  04 0500 0100004841  05 0500 01000070c2
    06 0400 00006040  07 0100 00  08 0100 19  09 0100 01  0a 0400 0000003f  0b 0400 00000040  0c 0100 00
    0d 0400 0000c03f  0e 0100 00  0f 0100 00  10 0100 03  11 0100 02  12 0100 01  13 0100 01
    14 0100 01  15 0100 01  16 0100 00  17 0100 28
    18 2100 01 0707070707070707070707070707070707070707070707070707070707070707
    19 0100 2a  1a 0100 14  1b 0100 01  1c 0400 0000a040  1d 0400 0000003f  1e 0100 01  1f 0100 01
    20 0100 2a
    c8 1b00 000000 000000000000000000000000000000000000000000000000
    45736c0e ffff";
const CALIBRATION_BEGIN: &str = "
    01 f501
    01 2400 0000803f 00000000 00000000 00000000 0000803f 00000000 00000000 00000000 0000803f
    02 0c00 0000e040 00000040 00004040  03 0400 0000803f  04 0400 00004042  05 0400 0ad723bd
    06 0c00 0000003f 000080be 0000003e  07 0400 0ad7233c  08 0400 00004041  09 0400 00008040
    0a 0100 03  0b 0100 00  0c 0400 9a99993e  0d 0400 3333333f  0e 0400 6f12833b  0f 0400 cdcccc3e
    10 0300 ffff03  11 0900 01 31082cbd a69bc43b
    12 f000";
const CALIBRATION_END: &str = "
    13 0400 6f12033b  14 0400 00000000  15 0100 01  16 0100 1e  17 0100 00  18 0100 07
    19 0100 01  1a 0c00 0000803f 00000040 00004040  1b 0c00 00008040 0000a040 0000c040
    1c 0c00 0000003f 0000803e 00000040  1d 0400 00002041  1e 0400 00000041
    052b0fa8 ffffffff";

/// Bytes of a calibration. The 240 bytes of the reduced covariance, between beginning and end, are zero.
fn pinned_calibration_bytes() -> Vec<u8> {
    [bytes_from_hex(CALIBRATION_BEGIN), vec![0; 240], bytes_from_hex(CALIBRATION_END)].concat()
}

/// If this fails, the stored bytes have changed, and other firmware no longer reads them. After appending a field, add
/// its bytes here.
#[test]
fn stored_bytes_keep_their_meaning() {
    let mut state = stored_state();
    state.settings = Settings {
        signing_key: Some(SigningKey([7; 32])),
        can_node: 42,
        can_rate_hz: 20,
        can_sends_covariance: true,
        can_is_terminated: true,
        gyro_error_percent: 5.0,
        iron_drift_percent: 0.5,
        attitude_source: AttitudeSource::Own,
        component: 42,
        ..state.settings
    };
    assert_eq!(encoded_item(&state), bytes_from_hex(STATE));
    assert_eq!(fields::decode_fields(&field_bytes_of_item(&bytes_from_hex(STATE))), Ok(state));
    assert_eq!(encoded_item(&full_calibration_record()), pinned_calibration_bytes());
    assert_eq!(fields::decode_fields(&field_bytes_of_item(&pinned_calibration_bytes())), Ok(full_calibration_record()));
    assert!(pinned_calibration_bytes().len() <= MAX_ITEM_SIZE / 2, "room for as many fields again");
}

fn encoded_field(tag: u8, value: &[u8]) -> Vec<u8> {
    [&[tag, value.len() as u8, 0], value].concat()
}

#[test]
fn unknown_fields_are_ignored() {
    for value in [&[][..], &[1], &[0xFF; 200]] {
        let unknown = encoded_field(250, value);
        for fields in [
            [&encoded_fields(&stored_state())[..], &unknown].concat(),
            [unknown.clone(), encoded_fields(&stored_state())].concat(),
        ] {
            assert_eq!(fields::decode_fields(&fields), Ok(stored_state()));
        }
        let fields = [encoded_fields(&full_calibration_record()), unknown].concat();
        assert_eq!(fields::decode_fields(&fields), Ok(full_calibration_record()));
    }
}

pub(super) fn split_into_fields(mut fields: &[u8]) -> Vec<(u8, Vec<u8>)> {
    let mut all = Vec::new();
    while let [tag, low, high, rest @ ..] = fields {
        let (value, after) = rest.split_at(usize::from(u16::from_le_bytes([*low, *high])));
        all.push((*tag, encoded_field(*tag, value)));
        fields = after;
    }
    all
}

/// Fields are missing if older firmware wrote the item, or unreadable if later firmware wrote a variant after the last
/// one known here.
#[test]
fn a_missing_field_has_its_default() {
    let fields = split_into_fields(&encoded_fields(&stored_state()));
    for (missing, _) in &fields {
        let others = fields.iter().filter(|(tag, _)| tag != missing).flat_map(|(_, field)| field.clone());
        let found: Result<StoredState, _> = fields::decode_fields(&others.collect::<Vec<_>>());
        if *missing <= 3 {
            assert_eq!(found, Err(StoreError::Corrupt), "{missing}");
        } else {
            // The other fields are unchanged.
            let found = found.unwrap();
            let default = split_into_fields(&encoded_fields(&StoredState::default()));
            for ((tag, stored), (_, default)) in split_into_fields(&encoded_fields(&found)).iter().zip(&default) {
                let (_, before) = fields.iter().find(|(other, _)| other == tag).unwrap();
                assert_eq!(stored, if tag == missing { default } else { before }, "{missing} {tag}");
            }
        }
    }
    let from_later: Vec<u8> = encoded_fields(&stored_state());
    let at = from_later.windows(4).position(|bytes| bytes == [0x0c, 1, 0, 0]).unwrap();
    let mut from_later = from_later;
    from_later[at + 3] = 99;
    let stream_heading = HeadingKind::Smooth;
    let settings = Settings { stream_heading, ..stored_state().settings };
    assert_eq!(fields::decode_fields(&from_later), Ok(StoredState { settings, ..stored_state() }));
}

/// A new variant before the last would renumber the later ones.
#[test]
fn variants_keep_their_numbers() {
    fn assert_numbers<T: Serialize>(variants: &[T]) {
        for (number, variant) in (0..).zip(variants) {
            assert_eq!(postcard::to_slice(variant, &mut [0; 8]).map(|bytes| bytes.to_vec()), Ok(vec![number]));
        }
    }
    assert_numbers(&[MagnetometerModel::Lis3mdl, MagnetometerModel::Lsm303dlhc, MagnetometerModel::Rm3100]);
    assert_numbers(&[AttitudeEnvelope::Banked, AttitudeEnvelope::Level]);
    assert_numbers(&HeadingKind::NAMED_CHOICES.iter().map(|(_, value)| *value).collect::<Vec<_>>());
    assert_numbers(&ProtocolKind::NAMED_CHOICES.iter().map(|(_, value)| *value).collect::<Vec<_>>());
    assert_numbers(&BaudRate::NAMED_CHOICES.iter().map(|(_, value)| *value).collect::<Vec<_>>());
    assert_numbers(&Method::ALL_METHODS);
    assert_numbers(&[AutopilotKind::ArduPilot, AutopilotKind::Px4, AutopilotKind::Inav]);
}

#[test]
fn a_reference_beyond_the_slots_is_refused() {
    for (slot, valid) in [(3, true), (4, false), (255, false)] {
        let reference = Some(SlotReference { slot, crc: 1 });
        for state in [
            StoredState { current_slot: reference, ..stored_state() },
            StoredState { previous_slot: reference, ..stored_state() },
        ] {
            assert_eq!(flash_page::encode_item(&state, &mut [0; MAX_ITEM_SIZE]).is_ok(), valid, "{slot}");
        }
    }
}
