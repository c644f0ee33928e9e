//! Frames and payloads compared with those of pydronecan 1.0.27; node 42 is the compass, node 10 its peer.

use super::outbound::{
    self, NodeHealth, NodeInfo, NodeMode, NodeStatus, ParameterResponse, SoftwareVersion, UpdateResult,
};
use super::*;
use autoswing::earth::{Date, Position};
use autoswing::time::Timestamp;
use autoswing_module::messages::Severity;
use testkit::frames::bytes_from_hex;

fn node_id(number: u8) -> NodeId {
    NodeId::new(number).unwrap()
}

/// Frames of a text: data in hexadecimal digits, frames separated by semicolons.
fn frames_from_hex(id: u32, text: &str) -> Vec<CanFrame> {
    text.split(';').map(|data| CanFrame::new(id, &bytes_from_hex(data)).unwrap()).collect()
}

fn outbound_transfer(data_type: DataType, kind: TransferKind, transfer_id: u8, payload: Payload) -> OutboundTransfer {
    OutboundTransfer { data_type, priority: priority::LOW_PRIORITY, transfer_kind: kind, transfer_id, payload }
}

fn outbound_message(data_type: DataType, transfer_id: u8, payload: Payload) -> OutboundTransfer {
    outbound_transfer(data_type, TransferKind::Message, transfer_id, payload)
}

fn outbound_response(data_type: DataType, transfer_id: u8, payload: Payload) -> OutboundTransfer {
    OutboundTransfer {
        priority: 30,
        ..outbound_transfer(data_type, TransferKind::Response(node_id(10)), transfer_id, payload)
    }
}

#[track_caller]
fn assert_frames(transfer: &OutboundTransfer, id: u32, text: &str) {
    let frames: Vec<CanFrame> = transfer.frames(Some(node_id(42))).collect();
    assert_eq!(frames, frames_from_hex(id, text));
    assert_eq!(frames.len(), transfer.frame_count());
}

/// Passes frames to node 42; returns the transfer that the last one completes, as text, which outlives the frames.
fn receive_all(frames: &[CanFrame]) -> (Option<String>, u32) {
    let mut receiver = TransferReceiver::default();
    let mut last = None;
    for frame in frames {
        last = receiver.push_frame(Timestamp::START, Some(node_id(42)), frame).map(|transfer| format!("{transfer:?}"));
    }
    (last, receiver.rejected_count)
}

#[track_caller]
fn assert_received(id: u32, text: &str, expected: &InboundTransfer<'_>) {
    assert_eq!(receive_all(&frames_from_hex(id, text)), (Some(format!("{expected:?}")), 0));
}

fn inbound_transfer(
    priority: u8,
    source: Option<NodeId>,
    transfer_id: u8,
    message: BusMessage<'_>,
) -> InboundTransfer<'_> {
    InboundTransfer { source_node: source, priority, transfer_id, message }
}

const UNIQUE_ID: [u8; UNIQUE_ID_LENGTH] =
    [0x11, 0x12, 0x13, 0x14, 0x15, 0x16, 0x17, 0x18, 0x19, 0x1A, 0x1B, 0x1C, 0, 0, 0, 0];

const STATUS: NodeStatus =
    NodeStatus { uptime_s: 0x1234_5678, health: NodeHealth::Ok, node_mode: NodeMode::Operational, vendor_code: 0xBEEF };

#[test]
fn a_field_is_one_frame_and_three_with_variances() {
    let field = [0.2, -0.05, 0.45];
    let mag = DataType::MAGNETIC_FIELD_STRENGTH_2;
    let without = outbound_message(mag, 0, outbound::magnetic_field(0, field, None));
    assert_frames(&without, 0x1803_EA2A, "00 66 32 66 AA 33 37 C0");
    let with = outbound_message(mag, 1, outbound::magnetic_field(0, field, Some([1e-4; 3])));
    assert_frames(&with, 0x1803_EA2A, "40 85 00 66 32 66 AA 81 ; 33 37 8E 06 8E 06 8E 21 ; 06 41");
}

#[test]
fn status_texts_and_results_are_those_of_pydronecan() {
    // The frame of pydronecan has the health WARNING, which this node never sends.
    let mut warning = STATUS.payload();
    warning[4] |= 0x40;
    assert_frames(&outbound_message(DataType::NODE_STATUS, 3, warning), 0x1801_552A, "78 56 34 12 40 EF BE C3");
    let failed = NodeStatus { health: NodeHealth::Error, node_mode: NodeMode::SoftwareUpdate, ..STATUS };
    assert_eq!(failed.payload()[4], 0b1001_1000);
    let text = outbound_message(DataType::LOG_MESSAGE, 0, outbound::log_message(Severity::Info, "mag", b"ok"));
    assert_frames(&text, 0x183F_FF2A, "23 6D 61 67 6F 6B C0");
    let restarted = outbound_response(DataType::RESTART_NODE, 2, outbound::restart_result(true));
    assert_frames(&restarted, 0x1E05_0AAA, "80 C2");
    let updated = outbound_response(DataType::BEGIN_FIRMWARE_UPDATE, 4, outbound::update_result(UpdateResult::Ok, ""));
    assert_frames(&updated, 0x1E28_0AAA, "00 C4");
    let saved = outbound_response(DataType::EXECUTE_OPCODE, 1, outbound::opcode_result(true));
    assert_frames(&saved, 0x1E0A_0AAA, "00 00 00 00 00 00 80 C1");
}

/// pydronecan's response has the status WARNING, as set here: 46 bytes with the CRC bytes EE 5E in 7 frames.
#[test]
fn node_info_has_versions_unique_id_and_name() {
    let software = SoftwareVersion {
        major_version: 1,
        minor_version: 9,
        commit: Some(0xDEAD_BEEF),
        image_crc: Some(0x1122_3344_5566_7788),
    };
    let info =
        NodeInfo { node_name: "org.x", software_version: software, hardware_version: [4, 64], unique_id: UNIQUE_ID };
    let mut payload = info.payload(STATUS);
    assert_eq!(payload.len(), 46);
    payload[4] = 0x40;
    let frames: Vec<CanFrame> =
        outbound_response(DataType::GET_NODE_INFO, 0, payload).frames(Some(node_id(42))).collect();
    assert_eq!((frames.len(), frames[0].frame_id(), &frames[0].data()[..2]), (7, 0x1E01_0AAA, &[0xEE, 0x5E][..]));
    let unknown = SoftwareVersion { commit: None, image_crc: None, ..software };
    assert_eq!(
        NodeInfo { software_version: unknown, ..info }.payload(STATUS)[7..22],
        [1, 9, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
    );
}

#[test]
fn the_commit_is_parsed_from_the_version_text() {
    for (text, commit) in [
        ("0.1.0 (148f00e4eb)", Some(0x148F_00E4)),
        ("0.1.0 (148f00e4eb-dirty)", Some(0x148F_00E4)),
        ("0.1.0 (148f00)", None),
        ("0.1.0 (v1 release)", None),
        ("0.1.0", None),
    ] {
        assert_eq!(SoftwareVersion::parse_commit(text), commit, "{text}");
    }
}

#[test]
fn an_allocation_is_requested_and_granted_in_three_parts() {
    for (transfer_id, part, id, text) in [
        (0, 0..6, 0x188F_F500, "01 11 12 13 14 15 16 C0"),
        (1, 6..12, 0x188A_7500, "00 17 18 19 1A 1B 1C C1"),
        (2, 12..16, 0x1822_1900, "00 00 00 00 00 C2"),
    ] {
        let payload = outbound::allocation_payload(part.start == 0, &UNIQUE_ID[part]);
        let request = outbound_message(DataType::ALLOCATION, transfer_id, payload);
        assert_eq!(request.frames(None).collect::<Vec<_>>(), frames_from_hex(id, text));
    }
    for (transfer_id, number, length, text) in [
        (0, 0, 6, "00 11 12 13 14 15 16 C0"),
        (1, 0, 12, "91 D3 00 11 12 13 14 81 ; 15 16 17 18 19 1A 1B 21 ; 1C 41"),
        (2, 125, 16, "0D 70 FA 11 12 13 14 82 ; 15 16 17 18 19 1A 1B 22 ; 1C 00 00 00 00 42"),
    ] {
        let allocation = Allocation { node: NodeId::new(number), unique_id: &UNIQUE_ID[..length] };
        let expected = inbound_transfer(30, Some(node_id(10)), transfer_id, BusMessage::Allocation(allocation));
        assert_received(0x1E00_010A, text, &expected);
    }
    // Anonymous request of another client.
    let part = Allocation { node: None, unique_id: &UNIQUE_ID[..6] };
    let expected = inbound_transfer(24, None, 0, BusMessage::Allocation(part));
    assert_received(0x188F_F500, "01 11 12 13 14 15 16 C0", &expected);
}

#[test]
fn parameters_are_read_and_written_by_name_or_index() {
    let request =
        |index, value, name| BusMessage::GetSet(GetSetRequest { parameter_index: index, value, parameter_name: name });
    for (transfer_id, text, expected) in [
        (5, "AC 76 00 00 43 41 4E 85 ; 5F 4E 4F 44 45 65", request(0, GetSetValue::Empty, &b"CAN_NODE"[..])),
        (6, "03 00 C6", request(3, GetSetValue::Empty, b"")),
        (
            7,
            "4A 24 00 01 32 00 00 87 ; 00 00 00 00 00 43 41 27 ; 4E 5F 4E 4F 44 45 47",
            request(0, GetSetValue::Integer(50), b"CAN_NODE"),
        ),
    ] {
        assert_received(0x1E0B_AA8A, text, &inbound_transfer(30, Some(node_id(10)), transfer_id, expected));
    }
    let answer = ParameterResponse {
        value: GetSetValue::Integer(50),
        parameter_name: "CAN_NODE",
        ..ParameterResponse::default()
    };
    assert_frames(
        &outbound_response(DataType::GET_SET, 7, answer.payload()),
        0x1E0B_0AAA,
        "7A 95 01 32 00 00 00 87 ; 00 00 00 00 00 00 00 27 ; 43 41 4E 5F 4E 4F 44 07 ; 45 67",
    );
    let unknown = outbound_response(DataType::GET_SET, 9, ParameterResponse::default().payload());
    assert_frames(&unknown, 0x1E0B_0AAA, "00 00 00 00 C9");
}

/// Layout by the table of the definition: tags of three and of two bits, each in a byte of its own.
#[test]
fn a_parameter_has_value_default_and_range() {
    let parameter = ParameterResponse {
        value: GetSetValue::Real(1.0),
        default_value: GetSetValue::Boolean(true),
        max_value: GetSetValue::Real(2.0),
        min_value: GetSetValue::Integer(-1),
        parameter_name: "P",
    };
    let expected = "02 00 00 80 3F  03 01  02 00 00 00 40  01 FF FF FF FF FF FF FF FF  50";
    assert_eq!(parameter.payload()[..], bytes_from_hex(expected));
    let text = ParameterResponse { value: GetSetValue::Text(b"on"), ..ParameterResponse::default() };
    assert_eq!(text.payload()[..], bytes_from_hex("04 02 6F 6E  00 00 00"));
}

#[test]
fn bytes_of_a_serial_line_are_sent_and_received() {
    let text = "9D 83 01 14 01 00 E1 89 ; 00 FD 01 02 69";
    let data = &[0xFD, 1, 2][..];
    let piece = Targetted {
        protocol: Targetted::MAVLINK_2_PROTOCOL,
        target: 10,
        serial_line: 0,
        tunnel_options: 1,
        baud: 57_600,
        serial_bytes: data,
    };
    assert_received(0x100B_B92A, text, &inbound_transfer(16, Some(node_id(42)), 9, BusMessage::Targetted(piece)));
    let sent = OutboundTransfer {
        priority: priority::MEDIUM_PRIORITY,
        ..outbound_message(DataType::TARGETTED, 9, piece.payload())
    };
    assert_frames(&sent, 0x100B_B92A, text);
    let default = Targetted { serial_line: -1, serial_bytes: &[0; Targetted::MAX_DATA_LENGTH], ..piece };
    assert_eq!(default.payload().len(), 126);
    let frames: Vec<_> =
        outbound_message(DataType::TARGETTED, 0, default.payload()).frames(Some(node_id(42))).collect();
    assert_eq!(
        receive_all(&frames).0,
        Some(format!("{:?}", inbound_transfer(24, Some(node_id(42)), 0, BusMessage::Targetted(default))))
    );
}

/// NotifyState is not received.
#[test]
fn the_armed_state_is_received() {
    let from_peer = |message| inbound_transfer(24, Some(node_id(10)), 0, message);
    assert_received(0x1804_4C0A, "FF C0", &from_peer(BusMessage::ArmingStatus(true)));
    assert_received(0x1804_4C0A, "00 C0", &from_peer(BusMessage::ArmingStatus(false)));
    assert_eq!(receive_all(&frames_from_hex(0x1804_4C0A, "01 C0")), (None, 1), "no state of this meaning");
    assert_eq!(
        receive_all(&frames_from_hex(0x184E_270A, "03 77 00 02 50 46 06 81 ; 00 00 00 00 00 00 00 61")),
        (None, 0)
    );
}

/// Transfer of any length from node 10, in frames of seven bytes and the tail byte.
fn frames_from_peer(data_type: DataType, payload: &[u8]) -> Vec<CanFrame> {
    let checked = [&data_type.crc(payload).to_le_bytes()[..], payload].concat();
    frames_of_parts(data_type, &checked.chunks(7).collect::<Vec<_>>())
}

fn frames_of_parts(data_type: DataType, parts: &[&[u8]]) -> Vec<CanFrame> {
    let id = FrameHeader {
        priority: 24,
        transfer_kind: if data_type.is_service { TransferKind::Request(node_id(42)) } else { TransferKind::Message },
        type_id: data_type.type_id,
        source_node: Some(node_id(10)),
    };
    let frame = |(number, part): (usize, &&[u8])| {
        let (is_first, is_last) = (number == 0, number + 1 == parts.len());
        let tail = u8::from(is_first) << 7 | u8::from(is_last) << 6 | (number as u8 % 2) << 5;
        CanFrame::new(id.to_id(), &[part, &[tail][..]].concat()).unwrap()
    };
    parts.iter().enumerate().map(frame).collect()
}

/// Layout by the table of the definition: half precision at byte 4, here 12.5 A and NaN, number of the battery at 18.
#[test]
fn the_current_of_a_battery_is_received() {
    for (encoded, current_a) in [(0x4A40_u16, Some(12.5)), (0x7E00, None)] {
        let mut payload = [0; 40];
        payload[4..6].copy_from_slice(&encoded.to_le_bytes());
        payload[18] = 3;
        let message = BusMessage::Battery { battery_number: 3, current_a };
        let expected = inbound_transfer(24, Some(node_id(10)), 0, message);
        let (received, _) = receive_all(&frames_from_peer(DataType::BATTERY_INFO, &payload));
        assert_eq!(received, Some(format!("{expected:?}")));
    }
}

/// Bits by the table of the definition.
fn fix_payload(status: u64, time_standard: u64) -> Vec<u8> {
    let mut bits = bit_stream::BitWriter::default();
    let signed = i64::cast_unsigned;
    bits.put_bits(0, 56);
    bits.put_bits(1_795_000_000_000_000, 56);
    bits.put_bits(time_standard, 3);
    bits.put_bits(0, 13 + 8);
    bits.put_bits(signed(-7_010_000_000), 37);
    bits.put_bits(signed(-3_390_000_000), 37);
    bits.put_bits(0, 27);
    bits.put_bits(signed(-1_500), 27);
    bits.put_bits(0, 64);
    bits.put_bits(0, 32);
    bits.put_bits(9, 6);
    bits.put_bits(status, 2);
    bits.put_bits(0, 40);
    bits.into_payload().to_vec()
}

#[test]
fn position_and_date_of_satellites_are_received() {
    let position = Position::new(-33.9, -70.1, -1.5);
    let date = Date::from_unix_s(1_795_000_000);
    for (status, time_standard, position, date) in
        [(3, 2, position, date), (2, 2, None, date), (3, 3, position, None), (0, 0, None, None)]
    {
        let frames = frames_from_peer(DataType::FIX_2, &fix_payload(status, time_standard));
        let expected = inbound_transfer(24, Some(node_id(10)), 0, BusMessage::Fix(position, date));
        assert_eq!(receive_all(&frames).0, Some(format!("{expected:?}")));
    }
}

/// Frames of a Targetted message with 40 serial bytes: a transfer of seven.
fn targetted_frames() -> Vec<CanFrame> {
    let piece =
        Targetted { protocol: 1, target: 42, serial_line: 0, tunnel_options: 0, baud: 0, serial_bytes: &[7; 40] };
    frames_from_peer(DataType::TARGETTED, &piece.payload())
}

/// After a lost frame the next transfer is received.
#[test]
fn lost_frames_drop_a_transfer_and_repeated_ones_do_not() {
    let frames = targetted_frames();
    for at in 0..frames.len() {
        let mut lost = frames.clone();
        lost.remove(at);
        assert_eq!(receive_all(&lost).0, None, "frame {at} lost");
        assert!(receive_all(&[lost, frames.clone()].concat()).0.is_some(), "after the loss of frame {at}");
        // Old bytes of a repeated frame do not count in the length, and a first frame always begins anew.
        for repetitions in [1, 100] {
            let repeated = [&frames[..at], &vec![frames[at].clone(); repetitions], &frames[at..]].concat();
            assert!(at + 1 == frames.len() || receive_all(&repeated).0.is_some(), "frame {at} repeated");
            let restarted = [&frames[..=at], &vec![frames[at].clone(); repetitions], &frames].concat();
            assert!(receive_all(&restarted).0.is_some(), "a transfer after frame {at} repeated");
        }
    }
}

/// Transfers with changes of header and tail byte, which the CRC does not cover, of the data, and of the division.
#[test]
fn frames_that_are_no_valid_transfer_are_dropped() {
    let frames = targetted_frames();
    let id = frames[2].frame_id();
    let changed = |id: u32, xor: [u8; 8]| {
        let data: Vec<u8> = frames[2].data().iter().zip(xor).map(|(byte, change)| byte ^ change).collect();
        [&frames[..2], &[CanFrame::new(id, &data).unwrap()], &frames[3..]].concat()
    };
    let rebuilt = |frames: &[CanFrame], id: u32, tail_change: u8| -> Vec<CanFrame> {
        let rebuild = |frame: &CanFrame| {
            let (tail, part) = frame.data().split_last().unwrap();
            CanFrame::new(id, &[part, &[tail ^ tail_change]].concat()).unwrap()
        };
        frames.iter().map(rebuild).collect()
    };
    let endless = frames[..1].iter().chain([&frames[1], &frames[2]].into_iter().cycle().take(1000)).cloned().collect();
    let payload = [&[1, 84, 0, 0, 0, 0][..], &[7; 20]].concat();
    let checked = [&DataType::TARGETTED.crc(&payload).to_le_bytes()[..], &payload].concat();
    let parts = [&checked[..7], &checked[7..13], &checked[13..20], &checked[20..27], &checked[27..]];
    for (name, frames, is_received) in [
        ("unchanged", changed(id, [0; 8]), true),
        ("another priority", changed(id ^ 1 << 24, [0; 8]), true),
        ("a frame of another transfer", changed(id, [0, 0, 0, 0, 0, 0, 0, 1]), false),
        ("other data", changed(id, [0, 0, 0, 1, 0, 0, 0, 0]), false),
        ("no sender", rebuilt(&frames_from_peer(DataType::ALLOCATION, &[0; 17]), 0x1800_0100, 0), false),
        ("toggle bit in the first frame", rebuilt(&frames, id, 0x20), false),
        ("toggle bit in a single frame", frames_from_hex(0x1804_4C0A, "FF E0"), false),
        ("longer than any payload", endless, false),
        ("a middle frame of six bytes", frames_of_parts(DataType::TARGETTED, &parts), false),
    ] {
        let (received, rejected) = receive_all(&frames);
        assert_eq!(received.is_some(), is_received, "{name}");
        assert_eq!(rejected == 0, is_received, "{name}: {rejected} rejected");
    }
}
