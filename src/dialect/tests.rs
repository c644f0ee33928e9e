//! Every row against the crate `mavlink`, which is generated from the protocol's definitions, and against the checksum
//! of the row itself.
extern crate std;

use std::vec::Vec;
use std::{format, vec};

use mavlink::dialects::common as reference;
use testkit::random::Random;

use super::*;

/// A field's type, and its type in the reference.
trait TestedField: Sized {
    type Reference;
    /// Name of the type in the protocol's definition.
    const PROTOCOL_TYPE: &'static str;
    /// Number of elements; zero if it is no array.
    const COUNT: u8 = 0;

    fn random_field(random: &mut Random) -> Self;

    fn to_reference(&self) -> Self::Reference;
}

/// Random bits, of which some are zero, so that payloads are truncated everywhere.
fn random_bits(random: &mut Random) -> u64 {
    if random.bits().is_multiple_of(3) { 0 } else { random.bits() }
}

macro_rules! test_numbers {
    ($($number:ty, $name:literal, $from_bits:expr;)*) => {
        $(impl TestedField for $number {
            type Reference = Self;
            const PROTOCOL_TYPE: &'static str = $name;

            fn random_field(random: &mut Random) -> Self {
                $from_bits(random_bits(random))
            }

            fn to_reference(&self) -> Self {
                *self
            }
        })*
    };
}

test_numbers! {
    u8, "uint8_t", |bits| bits as Self;
    i8, "int8_t", |bits| bits as Self;
    u16, "uint16_t", |bits| bits as Self;
    i16, "int16_t", |bits| bits as Self;
    u32, "uint32_t", |bits| bits as Self;
    i32, "int32_t", |bits| bits as Self;
    u64, "uint64_t", |bits| bits;
    // Not NaN, which is unequal to itself.
    f32, "float", |bits| (bits as i32) as Self;
}

impl<F: TestedField<Reference = F> + Copy, const COUNT: usize> TestedField for [F; COUNT] {
    type Reference = Self;
    const PROTOCOL_TYPE: &'static str = F::PROTOCOL_TYPE;
    const COUNT: u8 = COUNT as u8;

    fn random_field(random: &mut Random) -> Self {
        core::array::from_fn(|_| F::random_field(random))
    }

    fn to_reference(&self) -> Self {
        *self
    }
}

impl<const COUNT: usize> TestedField for CharArray<COUNT> {
    type Reference = Self;
    const PROTOCOL_TYPE: &'static str = "char";
    const COUNT: u8 = COUNT as u8;

    fn random_field(random: &mut Random) -> Self {
        <[u8; COUNT]>::random_field(random).into()
    }

    fn to_reference(&self) -> Self {
        *self
    }
}

macro_rules! reference_number {
    (enumeration $value:expr) => {
        $value as u64
    };
    (bitmask $value:expr) => {
        u64::from($value.bits())
    };
}

macro_rules! test_enumerations {
    ($($kind:ident $name:ident: $number:ty { $($entry:ident = $value:literal),* $(,)? })*) => {
        $(
            #[expect(clippy::allow_attributes, reason = "for some enumerations only")]
            #[allow(deprecated, reason = "old autopilots need what the protocol supersedes")]
            impl TestedField for $name {
                type Reference = reference::$name;
                const PROTOCOL_TYPE: &'static str = <$number>::PROTOCOL_TYPE;

                fn random_field(random: &mut Random) -> Self {
                    let entries = [$(Self::$entry),*];
                    entries[random.bits() as usize % entries.len()]
                }

                fn to_reference(&self) -> reference::$name {
                    match *self {
                        $(Self::$entry => reference::$name::$entry,)*
                        Self(unlisted) => panic!("{unlisted}"),
                    }
                }
            }
        )*

        #[test]
        #[expect(deprecated, reason = "old autopilots need what the protocol supersedes")]
        fn listed_numbers_are_those_of_the_protocol() {
            $($(assert_eq!(
                u64::from($name::$entry.0),
                reference_number!($kind reference::$name::$entry),
                "{}", stringify!($entry)
            );)*)*
        }
    };
}

enumeration_table!(test_enumerations);

/// Extra byte of the CRC as the protocol derives it from name, field types and field names of a message, extension
/// fields excepted (<https://mavlink.io/en/guide/serialization.html#crc_extra>).
fn derived_extra_crc(name: &str, fields: &[(&str, &str, u8)]) -> u8 {
    let mut definition = format!("{name} ").into_bytes();
    for &(protocol_type, field, count) in fields {
        // `type` is a keyword of Rust.
        let field = if field == "mavtype" { "type" } else { field };
        definition.extend(format!("{protocol_type} {field} ").into_bytes());
        definition.extend((count > 0).then_some(count));
    }
    let (last, first) = definition.split_last().unwrap();
    let [low, high] = calculate_crc(first, *last).to_le_bytes();
    low ^ high
}

fn v1_frame(message: &impl MessageData) -> Vec<u8> {
    let mut frame = MAVLinkV1MessageRaw::new();
    frame.serialize_message_data(MavHeader { system_id: 1, component_id: 2, sequence: 3 }, message);
    frame.raw_bytes().to_vec()
}

fn v2_frame(message: &impl MessageData) -> Vec<u8> {
    let mut frame = MAVLinkV2MessageRaw::new();
    frame.serialize_message_data(MavHeader { system_id: 1, component_id: 2, sequence: 3 }, message);
    frame.raw_bytes().to_vec()
}

/// Payload of a frame with a header of 10 bytes.
fn v2_payload(frame: &[u8]) -> &[u8] {
    &frame[10..frame.len() - 2]
}

macro_rules! compare_dialect {
    (common { $(
        $(#[$doc:meta])*
        $name:ident: $data:ident = $id:literal, crc $crc:literal {
            $($field:ident: $type:ty),* $(; extension $($extension:ident: $extension_type:ty),*)?
        }
    )* }) => {
        #[expect(clippy::allow_attributes, reason = "for some messages only")]
        #[allow(deprecated, reason = "old autopilots need what the protocol supersedes")]
        fn compare_with_reference(random: &mut Random) {
            $(
                assert_eq!($data::ID, reference::$data::ID, "{}", $data::NAME);
                assert_eq!($data::NAME, reference::$data::NAME);
                assert_eq!($data::EXTRA_CRC, reference::$data::EXTRA_CRC, "{}", $data::NAME);
                assert_eq!($data::V2_LENGTH, reference::$data::ENCODED_LEN, "{}", $data::NAME);
                let v1_length = reference::$data::DEFAULT.ser(MavlinkVersion::V1, &mut [0; 255]);
                assert_eq!($data::V1_LENGTH, v1_length, "{}", $data::NAME);
                for _ in 0..1000 {
                    let message = $data {
                        $($field: TestedField::random_field(random),)*
                        $($($extension: TestedField::random_field(random),)*)?
                    };
                    let referred = reference::$data {
                        $($field: message.$field.to_reference(),)*
                        $($($extension: message.$extension.to_reference(),)*)?
                    };
                    let frame = v2_frame(&referred);
                    assert_eq!(v2_frame(&message), frame, "{message:?}");
                    assert_eq!($data::deser(MavlinkVersion::V2, v2_payload(&frame)).unwrap(), message);
                    let parsed = MavMessage::parse(MavlinkVersion::V2, $id, v2_payload(&frame)).unwrap();
                    assert_eq!(parsed, MavMessage::$name(message.clone()));
                    if u8::try_from($data::ID).is_ok() {
                        let frame = v1_frame(&referred);
                        assert_eq!(v1_frame(&message), frame, "{message:?}");
                        let mut without_extensions = $data::DEFAULT;
                        $(without_extensions.$field = message.$field;)*
                        let received = $data::deser(MavlinkVersion::V1, &frame[6..frame.len() - 2]).unwrap();
                        assert_eq!(received, without_extensions);
                    }
                }
            )*
        }
    };
    // The reference has the common dialect alone.
    ($other:ident { $($row:tt)* }) => {};
}

macro_rules! test_messages {
    ($($dialect:ident { $($rows:tt)* })*) => {
        $(compare_dialect! { $dialect { $($rows)* } })*
        $(test_rows! { $dialect { $($rows)* } })*

        /// Numbers of the messages of other dialects than the common one, and extra bytes of their CRC.
        fn other_dialects() -> Vec<(u32, u8)> {
            [$((stringify!($dialect), $dialect::numbers_and_extra_crcs())),*]
                .into_iter()
                .filter(|(dialect, _)| *dialect != "common")
                .flat_map(|(_, rows)| rows)
                .collect()
        }
    };
}

macro_rules! test_rows {
    ($dialect:ident { $(
        $(#[$doc:meta])*
        $name:ident: $data:ident = $id:literal, crc $crc:literal {
            $($field:ident: $type:ty),* $(; extension $($extension:ident: $extension_type:ty),*)?
        }
    )* }) => {
        mod $dialect {
            use super::*;

            pub fn numbers_and_extra_crcs() -> Vec<(u32, u8)> {
                vec![$(($id, $crc)),*]
            }

            #[test]
            fn extra_crcs_follow_from_the_rows() {
                $(
                    let fields =
                        [$((<$type>::PROTOCOL_TYPE, stringify!($field), <$type as TestedField>::COUNT)),*];
                    assert_eq!(derived_extra_crc(stringify!($name), &fields), $crc, "{}", stringify!($name));
                )*
            }

            /// No number of an enumeration is lost, no length is too short or too long.
            #[test]
            fn any_payload_is_parsed_and_encoded_again() {
                let mut random = Random(2);
                for length in (0..=255).cycle().take(2550) {
                    let received = random.bytes(length);
                    $(
                        let message = MavMessage::parse(MavlinkVersion::V2, $id, &received).unwrap();
                        assert_eq!(message.message_id(), $id);
                        let mut expected = received.clone();
                        expected.resize($data::V2_LENGTH, 0);
                        while expected.len() > 1 && expected.ends_with(&[0]) {
                            expected.pop();
                        }
                        let mut encoded = [0; 255];
                        let encoded_length = message.ser(MavlinkVersion::V2, &mut encoded);
                        assert_eq!(encoded[..encoded_length], expected, "{message:?}");
                    )*
                }
            }

            #[test]
            fn a_default_message_is_zero_and_has_the_addressee_of_its_fields() {
                $(
                    let message = MavMessage::default_message_from_id($id).unwrap();
                    assert_eq!(message, MavMessage::$name($data::default()));
                    assert_eq!(MavMessage::message_id_from_name(message.message_name()), Some($id));
                    assert_eq!(message.ser(MavlinkVersion::V2, &mut [1; 255]), 1);
                    assert_eq!(message.ser(MavlinkVersion::V1, &mut [1; 255]), $data::V1_LENGTH);
                    let fields = [$(stringify!($field)),* $(, $(stringify!($extension)),*)?];
                    assert_eq!(message.target_system_id().is_some(), fields.contains(&"target_system"));
                    assert_eq!(message.target_component_id().is_some(), fields.contains(&"target_component"));
                )*
            }
        }
    };
}

message_table!(test_messages);

#[test]
fn messages_of_the_common_dialect_are_those_of_the_mavlink_crate() {
    compare_with_reference(&mut Random(1));
}

/// For frames of all messages, whether they have a row or not.
#[test]
fn extra_crcs_of_all_numbers_are_those_of_the_mavlink_crate() {
    use mavlink::Message as _;
    let others = other_dialects();
    for id in 0..1 << 24 {
        let expected = others
            .iter()
            .find_map(|&(other, extra_crc)| (other == id).then_some(extra_crc))
            .unwrap_or_else(|| reference::MavMessage::extra_crc(id));
        assert_eq!(MavMessage::extra_crc(id), expected, "{id}");
    }
}

#[test]
fn the_addressee_is_found_among_the_fields() {
    let attitude = MavMessage::ATTITUDE(ATTITUDE_DATA::default());
    assert_eq!((attitude.target_system_id(), attitude.target_component_id()), (None, None));
    // Its addressee is among the extension fields.
    let mut message = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA::default());
    *message.target_system_id_mut().unwrap() = 7;
    *message.target_component_id_mut().unwrap() = 8;
    assert_eq!((message.target_system_id(), message.target_component_id()), (Some(7), Some(8)));
}

#[test]
fn flags_are_set_and_cleared() {
    let mut mode = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED | MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    assert_eq!(mode.bits(), 129);
    assert!(mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED) && !mode.contains(MavModeFlag(3)));
    mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, false);
    assert_eq!(mode, MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED);
    mode.set(MavModeFlag::all(), true);
    assert_eq!((mode.bits(), MavModeFlag::empty()), (255, MavModeFlag::default()));
}
