//! Positions, dates, commands and acknowledgements, in frames made by pymavlink (2.4.50).

use super::*;
use autoswing::earth::Date;

pub fn decode_single(frame: &[u8]) -> InboundMessage {
    let (messages, rejected) = decoded_messages(frame);
    assert_eq!((messages.len(), rejected), (1, 0), "{frame:02X?}");
    messages[0]
}

const POSITION_FRAMES: [&str; 2] = [
    "fd1b0000c90c22210000e80300004c52401c760be8fabb7207000100000002000300040005e4ab",
    "fe1cc90c2221e80300004c52401c760be8fabb720700010000000200030004000500fc87",
];

#[test]
fn a_position_is_in_degrees_and_metres_above_sea_level() {
    for frame in POSITION_FRAMES {
        let InboundMessage::Position(SENDER, Some(place)) = decode_single(&bytes_from_hex(frame)) else {
            panic!("{frame}")
        };
        // The resolution of degrees in an f32 is a metre.
        assert!((place.latitude_deg - 47.397_742).abs() < 1e-5, "{place:?}");
        assert!((place.longitude_deg + 8.545_601).abs() < 1e-5, "{place:?}");
        assert!((place.height_m - 488.123).abs() < 1e-3, "{place:?}");
    }
}

/// SYS_STATUS has the current at byte 16; BATTERY_STATUS at byte 30, the battery's number at byte 32. -1 means unknown,
/// and a second battery is ignored.
#[test]
fn a_current_is_in_amperes() {
    for (centiamperes, amperes) in [
        (1_234_i16, Some(12.34)),
        (0, Some(0.0)),
        (-2, Some(-0.02)),
        (i16::MAX, Some(f32::from(i16::MAX) * 0.01)),
        (-1, None),
    ] {
        let battery = |number| [&[0x55; 30], &centiamperes.to_le_bytes()[..], &[number, 50]].concat();
        let status = [&[0x77; 16], &centiamperes.to_le_bytes()[..], &[0x77; 13]].concat();
        for (frame, expected) in [
            (v2_frame(1, 124, &status), amperes),
            (v2_frame(147, 154, &battery(0)), amperes),
            (v2_frame(147, 154, &battery(1)), None),
        ] {
            assert_eq!(decode_single(&frame), InboundMessage::Current(SENDER, expected), "{centiamperes}");
        }
    }
}

#[test]
fn a_date_is_received_in_microseconds_since_1970() {
    let frames = ["fd090000c90c2202000040c227dafe5b0600059bd1", "fe0cc90c220240c227dafe5b060005000000a1b8"];
    for hex in frames {
        assert_eq!(decode_single(&bytes_from_hex(hex)), InboundMessage::Date(SENDER, Date::from_unix_s(1_790_000_000)));
    }
    // No date is decoded from an unset clock or out of range.
    for unix_us in [0, 5_000_000, u64::MAX] {
        assert_eq!(decode_single(&v2_frame(2, 137, &unix_us.to_le_bytes())), InboundMessage::Date(SENDER, None));
    }
}

#[test]
fn commands_are_decoded_from_command_long_and_command_int() {
    let expected = |command, confirmation| {
        InboundMessage::Command(ReceivedCommand {
            sender_id: SENDER,
            target: Address { system_id: 12, component_id: 158 },
            command_number: command,
            confirmation,
            parameters: [1.5, -2.0, 3.0, 4.0],
        })
    };
    for (hex, command, confirmation) in [
        ("fd210000c90c224c00000000c03f000000c000004040000080400000a0400000c0400000e040f6000c9e03b17a", 246, 3),
        ("fe21c90c224c0000c03f000000c000004040000080400000a0400000c0400000e040f6000c9e031454", 246, 3),
        // The byte of COMMAND_LONG's confirmation is COMMAND_INT's coordinate frame, or its `current` field.
        ("fd230000c90c224b00000000c03f000000c0000040400000804005000000060000000000e040b8a50c9e000101c811", 42424, 0),
        ("fe23c90c224b0000c03f000000c0000040400000804005000000060000000000e040b8a50c9e0001010f92", 42424, 0),
    ] {
        assert_eq!(decode_single(&bytes_from_hex(hex)), expected(command, confirmation), "{hex}");
    }
}
