//! Parameters, in frames made by pymavlink (2.4.50).

use super::inbound::decode_single;
use super::outbound::{AUTOPILOT, assert_encoded};
use super::*;
use crate::wire::mavlink::parameter::parameter_bits;

const INT8: MavParamType = MavParamType::MAV_PARAM_TYPE_INT8;
const INT32: MavParamType = MavParamType::MAV_PARAM_TYPE_INT32;
const REAL32: MavParamType = MavParamType::MAV_PARAM_TYPE_REAL32;

#[test]
fn a_parameter_has_a_name_of_up_to_16_bytes() {
    for frame in [
        "fd190000050c221600008081be47b0044d00434f4d504153535f4445565f4944320006263c",
        "fe19000c22168081be47b0044d00434f4d504153535f4445565f49443200066cec",
    ] {
        let InboundMessage::Parameter(SENDER, parameter) = decode_single(&bytes_from_hex(frame)) else {
            panic!("{frame}")
        };
        assert_eq!(parameter.name, ParameterName::new("COMPASS_DEV_ID2"));
        assert_eq!(parameter.name.to_string(), "COMPASS_DEV_ID2");
        assert_eq!(parameter.number(ParameterEncoding::Cast), Some(97_539.0));
    }
}

#[test]
fn a_parameter_is_requested_by_name_and_changed_in_both_encodings() {
    let name = ParameterName::new;
    assert_encoded(
        OutboundMessage::parameter_request(AUTOPILOT, name("PTCH_TRIM_DEG")),
        "fd110000c9079e140000ffff0701505443485f5452494d5f44454750a4",
    );
    for (parameter, encoding, hex) in [
        (
            "COMPASS_DEV_ID2",
            ParameterEncoding::Cast,
            "fd170000c9079e1700008081be470701434f4d504153535f4445565f49443200061c18",
        ),
        (
            "CAL_MAG0_ID",
            ParameterEncoding::Bytewise,
            "fd170000c9079e170000037d0100070143414c5f4d4147305f4944000000000006d05c",
        ),
    ] {
        assert_encoded(OutboundMessage::parameter_change(AUTOPILOT, name(parameter), 97_539.0, INT32, encoding), hex);
    }
}

/// PX4 sends integers as bytes, ArduPilot as floats (mavlink.io, "Parameter Protocol").
#[test]
fn numbers_have_two_encodings() {
    let read = |value_bits, kind, encoding| {
        ReceivedParameter { name: ParameterName::default(), value_bits, kind }.number(encoding)
    };
    for encoding in [ParameterEncoding::Cast, ParameterEncoding::Bytewise] {
        for (kind, number) in [(INT8, -100.0), (INT32, -97_539.0), (INT32, 0.0), (REAL32, 0.25)] {
            assert_eq!(read(parameter_bits(number, kind, encoding), kind, encoding), Some(number), "{encoding:?}");
        }
        // Kinds of 64 bits, an unknown kind, and NaN.
        for (kind, bits) in [(7, 0), (10, 0), (0, 0), (9, f32::NAN.to_bits())] {
            assert_eq!(read(bits, MavParamType(kind), encoding), None, "{kind}");
        }
    }
    assert_eq!(read(0x0000_00FF, INT8, ParameterEncoding::Bytewise), Some(-1.0));
    assert_eq!(read(0xFFFF_FFFE, INT32, ParameterEncoding::Bytewise), Some(-2.0));
}
