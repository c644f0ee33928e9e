//! Fuzz test of the MSP receiver.

use autoswing_firmware::wire::msp::{AutopilotFirmware, MspAngles, MspReceiver, MspReply};
use proptest::collection::vec;
use proptest::prelude::*;

use crate::stream::{self, NoiseAndGoodFrames, Piece};
use crate::{PropertyResult, check_property};

const FC_VARIANT: u16 = 2;
const STATUS: u16 = 101;
const RAW_IMU: u16 = 102;
const RAW_GPS: u16 = 106;
const ATTITUDE: u16 = 108;
const ANALOG: u16 = 110;
const RTC: u16 = 247;
const EEPROM_WRITE: u16 = 250;
const SET_SETTING: u16 = 0x1004;
const SETTING_INFO: u16 = 0x1007;

/// Longest accepted frame, with 192 bytes of payload.
const MAX_FRAME_LENGTH: usize = 8 + 192 + 1;

const SETTING_NAME: &[u8] = b"mag_hardware\0";

fn frame_crc(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc: u8, _| if crc & 0x80 == 0 { crc << 1 } else { crc << 1 ^ 0xD5 })
    })
}

/// Frame with a correct CRC; the length field may differ from the payload.
fn frame_with_crc(direction: u8, function: u16, claimed_length: u16, payload: &[u8]) -> Vec<u8> {
    let [f0, f1] = function.to_le_bytes();
    let [n0, n1] = claimed_length.to_le_bytes();
    let checked = [&[0, f0, f1, n0, n1], payload].concat();
    [&[b'$', b'X', direction], &checked[..], &[frame_crc(&checked)]].concat()
}

/// Frame of any function, mostly requested ones with plausible payloads.
pub fn any_frame() -> impl Strategy<Value = Vec<u8>> {
    let functions = [
        (FC_VARIANT, 4),
        (STATUS, 11),
        (RAW_IMU, 18),
        (RAW_GPS, 16),
        (RAW_GPS, 18),
        (ATTITUDE, 6),
        (ANALOG, 7),
        (RTC, 9),
        (RTC, 6),
        (EEPROM_WRITE, 0),
        (SET_SETTING, 0),
        (SETTING_INFO, 40),
    ];
    let function = prop_oneof![9 => proptest::sample::select(functions.to_vec()), 1 => (any::<u16>(), 0..80_usize)];
    let direction = prop_oneof![8 => Just(b'>'), 1 => Just(b'!'), 1 => Just(b'<')];
    let length_error = prop_oneof![6 => Just(0_i16), 1 => -8..8_i16, 1 => any::<i16>()];
    let name = proptest::sample::select(vec![*b"ARDU", *b"INAV", *b"BTFL", *b"NONE"]);
    (function, direction, length_error, name, any::<bool>(), vec(any::<u8>(), 80)).prop_map(
        |((function, length), direction, length_error, name, is_possible, mut payload)| {
            payload.truncate(length);
            if is_possible && function == ATTITUDE {
                payload.iter_mut().skip(1).step_by(2).for_each(|high| *high %= 3);
            }
            if is_possible
                && function == FC_VARIANT
                && let Some(begin) = payload.first_chunk_mut()
            {
                *begin = name;
            }
            if is_possible && function == SETTING_INFO {
                payload[..SETTING_NAME.len()].copy_from_slice(SETTING_NAME);
                // Of the kinds of numbers more than half exist.
                payload[SETTING_NAME.len() + 2] %= 8;
            }
            frame_with_crc(direction, function, (payload.len() as u16).wrapping_add_signed(length_error), &payload)
        },
    )
}

pub fn any_stream() -> impl Strategy<Value = Vec<Piece>> {
    stream::any_pieces(any_frame(), b"$X>!")
}

/// Intact frame, found independently of the receiver by a search from every byte.
pub struct IntactFrame<'a> {
    end: usize,
    function: u16,
    is_error: bool,
    payload: &'a [u8],
}

/// All intact frames in the bytes, also nested ones.
pub fn intact_frames(bytes: &[u8]) -> Vec<IntactFrame<'_>> {
    let mut intact_frames = Vec::new();
    for start in 0..bytes.len() {
        let &[b'$', b'X', direction @ (b'>' | b'!'), _, f0, f1, n0, n1, ..] = &bytes[start..] else { continue };
        let frame_end = start + 8 + usize::from(u16::from_le_bytes([n0, n1])) + 1;
        let Some(&[_, _, _, ref checked @ .., last]) = bytes.get(start..frame_end) else { continue };
        if frame_crc(checked) == last {
            let function = u16::from_le_bytes([f0, f1]);
            intact_frames.push(IntactFrame {
                end: frame_end,
                function,
                is_error: direction == b'!',
                payload: &checked[5..],
            });
        }
    }
    intact_frames
}

impl IntactFrame<'_> {
    fn i16(&self, offset: usize) -> Option<i16> {
        Some(i16::from_le_bytes([*self.payload.get(offset)?, *self.payload.get(offset + 1)?]))
    }

    /// Whether it is MSP_ATTITUDE with this roll and this pitch of either sign.
    pub fn has_angles(&self, roll_deg: f32, pitch_deg: f32) -> bool {
        let is_close = |offset, deg: f32| {
            self.i16(offset).is_some_and(|decideg| (f32::from(decideg).abs() * 0.1 - deg.abs()).abs() < 0.01)
        };
        (self.function, self.is_error) == (ATTITUDE, false) && is_close(0, roll_deg) && is_close(2, pitch_deg)
    }
}

impl stream::IntactFrame<MspReply> for IntactFrame<'_> {
    fn end(&self) -> usize {
        self.end
    }

    fn matches_message(&self, message: &MspReply) -> bool {
        if let MspReply::Refused(function) = message {
            return (self.is_error || self.payload.is_empty()) && self.function == *function as u16;
        }
        !self.is_error
            && match *message {
                MspReply::Attitude(MspAngles { roll_decideg, pitch_decideg, heading_deg }) => {
                    self.function == ATTITUDE
                        && [0, 2, 4].map(|offset| self.i16(offset))
                            == [roll_decideg, pitch_decideg, heading_deg].map(Some)
                }
                MspReply::FcVariant(firmware) => {
                    let has_prefix = |name: &[u8]| self.payload.starts_with(name);
                    self.function == FC_VARIANT
                        && match firmware {
                            AutopilotFirmware::ArduPilot => has_prefix(b"ARDU"),
                            AutopilotFirmware::Inav => has_prefix(b"INAV"),
                            AutopilotFirmware::Betaflight => has_prefix(b"BTFL"),
                            AutopilotFirmware::Other => true,
                        }
                }
                MspReply::Armed(is_armed) => {
                    self.function == STATUS && self.payload.get(6).is_some_and(|flags| (flags & 1 == 1) == is_armed)
                }
                MspReply::Gyro(counts) => {
                    self.function == RAW_IMU && [6, 8, 10].map(|offset| self.i16(offset)) == counts.map(Some)
                }
                MspReply::RawGps(_) => self.function == RAW_GPS,
                MspReply::Current(amperes) => {
                    self.function == ANALOG
                        && self.i16(5).is_some_and(|encoded_current| {
                            (f32::from(encoded_current) * 0.01).to_bits() == amperes.to_bits()
                        })
                }
                MspReply::Rtc(_) => self.function == RTC,
                MspReply::Setting(setting) => {
                    let name = setting.name.to_string();
                    self.function == SETTING_INFO && self.payload.starts_with(&[name.as_bytes(), &[0]].concat())
                }
                MspReply::Done => [SET_SETTING, EEPROM_WRITE].contains(&self.function),
                MspReply::Refused(_) => false,
            }
    }
}

fn good_frame() -> Vec<u8> {
    frame_with_crc(b'>', ATTITUDE, 6, &[123, 0, 1, 0, 1, 0])
}

#[test]
fn only_msp_frames_with_correct_crc_are_accepted() {
    check_property(any_stream(), |pieces| -> PropertyResult {
        let mut bytes = stream::joined_bytes(&pieces);
        let wire = NoiseAndGoodFrames::new(&mut bytes, &good_frame(), MAX_FRAME_LENGTH);
        let mut receiver = MspReceiver::default();
        stream::assert_decoder_properties(
            &wire,
            &intact_frames(wire.bytes),
            |byte| (receiver.push_byte(byte), receiver.rejected_count()),
            is_good_message,
        )
    });
}

fn is_good_message(message: &MspReply) -> bool {
    matches!(message, MspReply::Attitude(angles) if angles.roll_decideg == 123)
}
