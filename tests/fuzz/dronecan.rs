//! Fuzz test of the DroneCAN receiver and of the node.

use autoswing::instrument::Estimate;
use autoswing::time::Timestamp;
use autoswing_firmware::port::{CanNode, NodeContext, Snapshot};
use autoswing_firmware::wire::dronecan::outbound::{NodeInfo, SoftwareVersion};
use autoswing_firmware::wire::dronecan::{
    BusMessage, CanFrame, DataType, MAX_RECEIVED_LENGTH, NodeId, TransferReceiver,
};
use autoswing_module::compass::IndicatorState;
use autoswing_module::settings::{SETTINGS, Settings};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::{PropertyResult, check_property};

/// Number of the fuzzed node.
const OWN_NODE: u8 = 42;

/// Frames of one transfer with its CRC, divided as the protocol requires.
fn frames_of_transfer(id: u32, data_type: DataType, transfer_id: u8, payload: &[u8]) -> Vec<CanFrame> {
    let checked = if payload.len() <= 7 {
        payload.to_vec()
    } else {
        [&payload_crc(&[&data_type.signature.to_le_bytes(), payload].concat()).to_le_bytes(), payload].concat()
    };
    let count = checked.len().div_ceil(7).max(1);
    (0..count)
        .map(|frame_number| {
            let frame_payload = &checked[7 * frame_number..checked.len().min(7 * frame_number + 7)];
            let flags = u8::from(frame_number == 0) << 7
                | u8::from(frame_number + 1 == count) << 6
                | (frame_number as u8 & 1) << 5;
            CanFrame::new(id, &[frame_payload, &[flags | transfer_id & 0x1F]].concat()).expect("eight bytes")
        })
        .collect()
}

/// CRC-16-CCITT, computed bit by bit, independent of the library.
fn payload_crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(
            crc ^ u16::from(*byte) << 8,
            |crc: u16, _| {
                if crc & 0x8000 == 0 { crc << 1 } else { crc << 1 ^ 0x1021 }
            },
        )
    })
}

const RECEIVED_TYPE_SPECS: [DataType; 12] = [
    DataType::TARGETTED,
    DataType::ARMING_STATUS,
    DataType::BATTERY_INFO,
    DataType::FIX_2,
    DataType::ALLOCATION,
    DataType::GET_NODE_INFO,
    DataType::GET_SET,
    DataType::EXECUTE_OPCODE,
    DataType::RESTART_NODE,
    DataType::GET_TRANSPORT_STATS,
    DataType::BEGIN_FIRMWARE_UPDATE,
    DataType::NODE_STATUS,
];

/// Payload of a GetSet request: position, kind of value and value, name. Random bytes seldom name a setting.
fn parameter_request() -> impl Strategy<Value = Vec<u8>> {
    let value = prop_oneof![
        Just(vec![0]),
        (-1..300_i64).prop_map(|number| [&[1], &number.to_le_bytes()[..]].concat()),
        any::<f32>().prop_map(|number| [&[2], &number.to_le_bytes()[..]].concat()),
        any::<bool>().prop_map(|is_on| vec![3, is_on.into()]),
        select(vec!["", "off", "Heron-4711"]).prop_map(|text| [&[4, text.len() as u8], text.as_bytes()].concat()),
    ];
    let names: Vec<&str> = SETTINGS.iter().map(|setting| setting.parameter_name).collect();
    (0..32_u8, value, prop_oneof![Just(""), select(names)])
        .prop_map(|(index, value, name)| [&[index], &value[..], name.as_bytes()].concat())
}

/// Transfers of received types with any payload, up to lengths beyond the longest; source 0 is anonymous.
fn any_transfer() -> impl Strategy<Value = Vec<CanFrame>> {
    let source = prop_oneof![6 => Just(10_u8), 2 => 0..128_u8, 1 => Just(OWN_NODE)];
    let length = prop_oneof![6 => 0..30_usize, 3 => 30..140_usize, 1 => 200..300_usize];
    let noise = (select(RECEIVED_TYPE_SPECS.to_vec()), length, vec(any::<u8>(), 300))
        .prop_map(|(data_type, length, payload)| (data_type, payload[..length].to_vec()));
    let parameter_request = parameter_request().prop_map(|payload| (DataType::GET_SET, payload));
    (prop_oneof![9 => noise, 1 => parameter_request], source, any::<u8>()).prop_map(
        |((data_type, payload), source, transfer_id)| {
            let id = if data_type.is_service {
                0x1E00_8080 | u32::from(data_type.type_id) << 16 | u32::from(OWN_NODE) << 8 | u32::from(source)
            } else {
                0x1800_0000 | u32::from(data_type.type_id) << 8 | u32::from(source)
            };
            frames_of_transfer(id, data_type, transfer_id, &payload)
        },
    )
}

/// Damage to a sequence of frames: a frame removed, repeated, moved or changed at an index modulo the length.
#[derive(Clone, Debug)]
enum Damage {
    None,
    Remove(usize),
    Repeat(usize),
    Swap(usize, usize),
    Flip(usize, usize),
}

fn any_damage() -> impl Strategy<Value = Damage> {
    let any_index = any::<usize>;
    prop_oneof![
        4 => Just(Damage::None),
        1 => any_index().prop_map(Damage::Remove),
        1 => any_index().prop_map(Damage::Repeat),
        1 => (any_index(), any_index()).prop_map(|(first_index, second_index)| Damage::Swap(first_index, second_index)),
        1 => (any_index(), any_index()).prop_map(|(frame, bit)| Damage::Flip(frame, bit)),
    ]
}

impl Damage {
    fn damage_frames(&self, frames: &mut Vec<CanFrame>) {
        let count = frames.len().max(1);
        match *self {
            Self::None => {}
            Self::Remove(at) => drop(frames.remove(at % count)),
            Self::Repeat(at) => frames.insert(at % count, frames[at % count].clone()),
            Self::Swap(one, other) => frames.swap(one % count, other % count),
            Self::Flip(at, bit) => {
                let frame = &mut frames[at % count];
                let mut data = frame.data().to_vec();
                let bits = 29 + 8 * data.len();
                let (mut id, bit) = (frame.frame_id(), bit % bits);
                if let Some(bit) = bit.checked_sub(29) {
                    data[bit / 8] ^= 1 << (bit % 8);
                } else {
                    id ^= 1 << bit;
                }
                *frame = CanFrame::new(id, &data).expect("29 bits and eight bytes");
            }
        }
    }
}

/// Transfers with damage, interleaved, and noise.
fn any_traffic() -> impl Strategy<Value = Vec<CanFrame>> {
    let damaged = (any_transfer(), any_damage()).prop_map(|(mut frames, damage)| {
        damage.damage_frames(&mut frames);
        frames
    });
    let noise = (0..1_u32 << 29, vec(any::<u8>(), 0..=8))
        .prop_map(|(id, data)| vec![CanFrame::new(id, &data).expect("29 bits and eight bytes")]);
    let transfers = vec(prop_oneof![6 => damaged, 1 => noise], 0..5);
    (transfers, any::<bool>()).prop_map(|(transfers, is_interleaved)| {
        let longest = transfers.iter().map(Vec::len).max().unwrap_or(0);
        if is_interleaved {
            (0..longest)
                .flat_map(|frame_index| transfers.iter().filter_map(move |frames| frames.get(frame_index).cloned()))
                .collect()
        } else {
            transfers.concat()
        }
    })
}

/// Whether the lengths in a message are within their limits.
fn is_within_limits(message: &BusMessage<'_>) -> bool {
    match message {
        BusMessage::Allocation(step) => step.unique_id.len() <= 16,
        BusMessage::GetSet(request) => request.parameter_name.len() <= 92,
        BusMessage::BeginFirmwareUpdate { path, .. } => path.len() < MAX_RECEIVED_LENGTH,
        BusMessage::Targetted(piece) => piece.serial_bytes.len() <= 120,
        _ => true,
    }
}

/// Nothing panics, every message is within its bounds, and an intact transfer after the traffic is received.
#[test]
fn any_frames_are_received_or_dropped() {
    check_property(any_traffic(), |traffic| -> PropertyResult {
        let mut receiver = TransferReceiver::default();
        for frame in &traffic {
            if let Some(transfer) = receiver.push_frame(Timestamp::START, NodeId::new(OWN_NODE), frame) {
                prop_assert!(is_within_limits(&transfer.message), "{transfer:?}");
            }
        }
        let good_frames = frames_of_transfer(0x1804_440A, DataType::BATTERY_INFO, 5, &[0; 30]);
        let mut last = false;
        for frame in &good_frames {
            last = receiver.push_frame(Timestamp::START, NodeId::new(OWN_NODE), frame).is_some();
        }
        prop_assert!(last, "an intact transfer is dropped");
        Ok(())
    });
}

/// The node answers with whole transfers of its own, whatever it receives; without a number it sends only requests for
/// one.
#[test]
fn a_node_survives_any_frames() {
    const NODE_INFO: NodeInfo = NodeInfo {
        node_name: "org.autoswing.fuzz",
        software_version: SoftwareVersion::from_firmware(None),
        hardware_version: [1, 0],
        unique_id: [7; 16],
    };
    check_property((any_traffic(), any::<bool>()), |(traffic, has_number)| -> PropertyResult {
        let settings = Settings { can_node: if has_number { OWN_NODE } else { 0 }, ..Settings::DEFAULT };
        let mut node = CanNode::new(NODE_INFO, settings.can_node);
        for (frame_number, frame) in traffic.iter().enumerate() {
            let now = Timestamp::from_us(frame_number as u64 * 12_500);
            node.receive_frame(now, frame, &mut |_| {});
            let estimate = Estimate { timestamp: now, ..Estimate::EMPTY };
            let indicator = IndicatorState::Idle;
            let snapshot = Snapshot {
                now,
                estimate: &estimate,
                settings: &settings,
                indicator_state: indicator,
                calibration: None,
                can_node: None,
            };
            let command = node.poll(&NodeContext { snapshot, stored_settings: &settings });
            if let Some(command) = command {
                node.complete_command(command, Ok(()));
            }
            for _ in 0..100 {
                let Some(frame) = node.frame_to_send() else { break };
                let source = frame.frame_id() as u8 & 0x7F;
                prop_assert!(frame.data().len() <= 8 && (has_number || frame.frame_id() & 0x80 == 0 || source != 0));
                node.on_frame_sent(now);
            }
            prop_assert!(node.frame_to_send().is_none(), "frames without an end");
        }
        Ok(())
    });
}
