//! Signatures of received and sent frames.

use mavlink_dialect::MavState;

use super::super::signature::{MAX_NEW_STREAM_AGE_10US, SIGNATURE_SIZE, SIGNED_FLAG};
use super::super::{
    Address, EncodedFrame, InboundMessage, MavlinkReceiver, OutboundMessage, Signatures, key_from_passphrase,
};

const AUTOPILOT: Address = Address { system_id: 1, component_id: 1 };

/// HEARTBEAT of an armed autopilot with the passphrase "swing", link 2, time 100,000,000; made with Python's hashlib.
const SIGNED_FRAME: [u8; 34] = [
    0xFD, 9, 1, 0, 7, 1, 1, 0, 0, 0, 0, 0, 0, 0, 1, 3, 0x80, 4, 3, 0xFD, 0xBC, 2, 0, 0xE1, 0xF5, 5, 0, 0, 0xF0, 0xA8,
    0x65, 0x87, 0x0C, 0xD4,
];

fn receiver_with_key(passphrase: &str) -> MavlinkReceiver {
    let mut receiver = MavlinkReceiver::default();
    receiver.signatures.set_key(Some(key_from_passphrase(passphrase)));
    receiver
}

fn is_accepted(receiver: &mut MavlinkReceiver, frame: &[u8]) -> bool {
    frame
        .iter()
        .filter_map(|&byte| receiver.push_byte(byte))
        .any(|message| matches!(message, InboundMessage::Heartbeat(..)))
}

fn signed_frame(signatures: &mut Signatures, from: Address) -> EncodedFrame {
    OutboundMessage::heartbeat(MavState::MAV_STATE_ACTIVE).into_frame(from, 0, signatures)
}

#[test]
fn a_frame_is_accepted_once_and_with_the_right_key() {
    let mut right = receiver_with_key("swing");
    assert!(is_accepted(&mut right, &SIGNED_FRAME));
    assert!(!is_accepted(&mut right, &SIGNED_FRAME) && right.rejected_count() == 1, "repeated");
    assert!(!is_accepted(&mut receiver_with_key("Swing"), &SIGNED_FRAME));
    assert!(is_accepted(&mut MavlinkReceiver::default(), &SIGNED_FRAME), "without a key");
    for byte in [5, 14, 16, 22, 23, 33] {
        let mut changed = SIGNED_FRAME;
        changed[byte] ^= 1;
        assert!(!is_accepted(&mut receiver_with_key("swing"), &changed), "{byte}");
    }
}

#[test]
fn with_a_key_unsigned_frames_are_rejected_and_sent_ones_signed() {
    let (mut one, mut other) = (receiver_with_key("swing"), receiver_with_key("swing"));
    let unsigned = signed_frame(&mut Signatures::default(), AUTOPILOT);
    assert!(!is_accepted(&mut one, &unsigned) && one.rejected_count() == 1);
    assert!(is_accepted(&mut MavlinkReceiver::default(), &unsigned));
    for _ in 0..3 {
        let signed = signed_frame(&mut one.signatures, AUTOPILOT);
        assert_eq!((signed.len(), signed[2]), (unsigned.len() + SIGNATURE_SIZE, SIGNED_FLAG));
        assert!(is_accepted(&mut other, &signed));
    }
    // The time follows the newest received frame.
    assert!(is_accepted(&mut one, &SIGNED_FRAME));
    let signed = signed_frame(&mut one.signatures, AUTOPILOT);
    assert!(is_accepted(&mut other, &signed) && other.signatures.newest_time_10us == 100_000_001);
}

/// A new stream more than a minute behind the newest frame is rejected, and so is a ninth stream.
#[test]
fn old_streams_and_too_many_are_rejected() {
    let frame_at = |time, system| {
        let mut sender = Signatures::default();
        sender.set_key(Some(key_from_passphrase("swing")));
        sender.newest_time_10us = time;
        signed_frame(&mut sender, Address { system_id: system, component_id: 1 })
    };
    let mut receiver = receiver_with_key("swing");
    assert!(is_accepted(&mut receiver, &frame_at(2 * MAX_NEW_STREAM_AGE_10US, 1)));
    assert!(!is_accepted(&mut receiver, &frame_at(MAX_NEW_STREAM_AGE_10US - 1, 2)));
    assert!(is_accepted(&mut receiver, &frame_at(MAX_NEW_STREAM_AGE_10US, 2)));
    for system in 3..=8 {
        assert!(is_accepted(&mut receiver, &frame_at(2 * MAX_NEW_STREAM_AGE_10US, system)));
    }
    assert!(!is_accepted(&mut receiver, &frame_at(2 * MAX_NEW_STREAM_AGE_10US, 9)));
    assert!(is_accepted(&mut receiver, &frame_at(3 * MAX_NEW_STREAM_AGE_10US, 1)));
}
