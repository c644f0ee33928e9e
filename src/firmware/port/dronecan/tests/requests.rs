//! Requests of other nodes: description, parameters, restart, firmware update.

use super::*;
use crate::wire::mavlink::key_from_passphrase;
use autoswing_module::settings::SettingValue::Key;
use autoswing_module::settings::{Setting, SettingChange, SigningKey};

const GET_SET: DataType = DataType::GET_SET;

#[test]
fn a_node_describes_itself() {
    let mut bench = Bench::new();
    let payload = bench.response_to_request(DataType::GET_NODE_INFO, &[]).unwrap();
    assert_eq!(payload[7..10], [0, 1, 0], "version");
    assert_eq!(payload[22..24], [1, 0], "hardware");
    assert_eq!(payload[24..40], node_info(1).unique_id);
    assert_eq!(payload[41..], *b"org.autoswing.test");
}

#[test]
fn traffic_is_counted() {
    let mut bench = Bench::new();
    bench.run_ms(1000);
    bench.node.add_bus_errors(2);
    bench.node.add_bus_errors(5);
    let payload = bench.response_to_request(DataType::GET_TRANSPORT_STATS, &[]).unwrap();
    let count = |at: usize| u32::from_le_bytes(payload[6 * at..6 * at + 4].try_into().unwrap());
    assert_eq!(payload.len(), 36);
    assert!(count(0) >= 50 && count(3) >= 50, "{payload:?}");
    assert_eq!([count(1), count(2), count(4), count(5)], [2, 0, 2, 7]);
}

fn set_integer_payload(value: i64, name: &str) -> Vec<u8> {
    [&[0, 1][..], &value.to_le_bytes(), name.as_bytes()].concat()
}

#[test]
fn a_refused_or_unanswered_setting_is_answered_with_the_old_value() {
    let old = [1, 50, 0, 0, 0, 0, 0, 0, 0];
    let mut bench = Bench::new();
    bench.response_to_request(GET_SET, &set_integer_payload(81, "CAN_RATE"));
    bench
        .node
        .complete_command(Command::SetFromBus(SettingChange::named("CAN_RATE", 81.0).unwrap()), Err(&Refusal::Busy));
    assert_eq!(bench.run_for_response(GET_SET).unwrap()[..9], old);
    bench.response_to_request(GET_SET, &set_integer_payload(30, "CAN_RATE"));
    assert_eq!(bench.sent_in_ms(GET_SET, 1900).len(), 0);
    assert_eq!(bench.sent_in_ms(GET_SET, 200)[0].payload[..9], old, "after two seconds");
}

/// The answer waits for the state machine, and has the value that is then in force.
#[test]
fn parameters_are_set_by_commands_one_after_another() {
    let mut bench = Bench::new();
    let commands = [20.0, 30.0].map(|rate| Command::SetFromBus(SettingChange::named("CAN_RATE", rate).unwrap()));
    for (number, rate) in [20, 30].into_iter().enumerate() {
        assert_eq!(bench.response_to_request(GET_SET, &set_integer_payload(rate, "CAN_RATE")), None);
        assert_eq!(bench.commands, commands[..1], "request {number}");
    }
    for (command, rate_hz) in commands.into_iter().zip([20, 30]) {
        assert_eq!(bench.commands.last(), Some(&command));
        bench.settings.can_rate_hz = rate_hz;
        bench.node.complete_command(command, Ok(()));
        assert_eq!(bench.run_for_response(GET_SET).unwrap()[..9], [1, rate_hz, 0, 0, 0, 0, 0, 0, 0]);
    }
    assert_eq!(bench.commands, commands);
}

#[test]
fn a_passphrase_is_set_and_not_read() {
    let signing = Setting::from_parameter_name(b"SIGNING").unwrap();
    let mut bench = Bench::new();
    assert_eq!(bench.response_to_request(GET_SET, b"\x00\x04\x04wordSIGNING"), None);
    assert_eq!(
        bench.commands,
        [Command::SetFromBus(signing.change_to(Key(Some(key_from_passphrase("word")))).unwrap())]
    );
    bench.node.complete_command(bench.commands[0], Ok(()));
    bench.settings.signing_key = Some(SigningKey([7; 32]));
    assert_eq!(bench.run_for_response(GET_SET).unwrap(), b"\x04\x02on\x04\x03off\x00\x00SIGNING");
    bench.response_to_request(GET_SET, b"\x00\x04\x03offSIGNING");
    assert_eq!(bench.commands[1], Command::SetFromBus(signing.change_to(Key(None)).unwrap()));
}

const RESTART_MAGIC_BYTES: [u8; 5] = [0x1E, 0x1B, 0x55, 0xCE, 0xAC];

const OPCODE_DONE: [u8; 7] = [0, 0, 0, 0, 0, 0, 0x80];

/// Parameters are saved when they are set. Requests to set the present value, a number beyond the range, or a value of
/// another kind only read it. An update's path has 1 to 200 bytes without NUL.
#[test]
fn requests_that_need_no_command_are_answered_at_once() {
    let rate: &[u8] = &[1, 50, 0, 0, 0, 0, 0, 0, 0];
    let cases: [(&str, DataType, &[u8], &[u8]); 11] = [
        ("a part of the magic number", DataType::RESTART_NODE, &RESTART_MAGIC_BYTES[..4], &[0]),
        ("another magic number", DataType::RESTART_NODE, &[0; 5], &[0]),
        ("no magic number", DataType::RESTART_NODE, b"", &[0]),
        ("save", DataType::EXECUTE_OPCODE, &[0; 7], &OPCODE_DONE),
        ("unknown operation", DataType::EXECUTE_OPCODE, &[9; 7], &[0; 7]),
        ("the present value", GET_SET, &set_integer_payload(50, "CAN_RATE"), rate),
        ("beyond the range", GET_SET, &set_integer_payload(i64::MAX, "CAN_RATE"), rate),
        ("a fraction", GET_SET, b"\x00\x02\x00\x00\x00\x3fCAN_RATE", rate),
        ("a text", GET_SET, b"\x00\x04\x02onCAN_RATE", rate),
        ("no path", DataType::BEGIN_FIRMWARE_UPDATE, &[0], &[255]),
        ("a path with NUL", DataType::BEGIN_FIRMWARE_UPDATE, b"\x00a\x00b", &[255]),
    ];
    for (name, data_type, request, response) in cases {
        let mut bench = Bench::new();
        let found = bench.response_to_request(data_type, request).unwrap();
        assert!(found.starts_with(response), "{name}: {found:?}");
        assert_eq!(bench.commands, [], "{name}");
    }
}

/// Offsets and the size are those of the boot loader; no byte is left as it was. A refused update can be repeated.
#[test]
fn an_update_is_handed_over_with_the_restart() {
    let mut bench = Bench::new();
    bench.response_to_request(DataType::BEGIN_FIRMWARE_UPDATE, b"\x00refused");
    bench.node.complete_command(Command::Restart, Err(&Refusal::Busy));
    assert_eq!(bench.run_for_response(DataType::BEGIN_FIRMWARE_UPDATE), Some(b"\x01busy".to_vec()));
    bench.response_to_request(DataType::BEGIN_FIRMWARE_UPDATE, b"\x00a.bin");
    bench.node.complete_command(Command::Restart, Ok(()));
    let update = bench.node.granted_update().unwrap();
    assert_eq!(update.file_path(), b"a.bin");
    let bytes = update.boot_loader_handover();
    assert_eq!(bytes[..4], [0x9A, 0xAD, 0x44, 0xC5]);
    assert_eq!(bytes[4..22], [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, PEER_NODE, OWN_NODE]);
    assert_eq!(bytes[22..27], *b"a.bin");
    assert!(bytes[27..].iter().all(|byte| *byte == 0) && bytes.len() == 224);
    assert_eq!(bench.run_for_response(DataType::BEGIN_FIRMWARE_UPDATE), Some(vec![0]));
    assert_eq!(bench.response_to_request(DataType::BEGIN_FIRMWARE_UPDATE, b"\x00b.bin"), Some(vec![2]));
    let status = bench.sent_in_ms(DataType::NODE_STATUS, 1000);
    assert_eq!(status[0].payload[4] >> 3 & 7, 3, "software update");
}

/// The longest path, which this node does not send, through the decoder's type. It fits with its NUL. A server other
/// than the sender can be named.
#[test]
fn an_update_has_a_path_of_up_to_200_bytes_at_any_server() {
    let path = |length| [&[11][..], &vec![b'x'; length]].concat();
    let mut bench = Bench::new();
    let own = node_id(OWN_NODE);
    assert!(UpdateForBootLoader::new(node_id(11), own, &path(200)).is_none(), "201 bytes");
    let longest = UpdateForBootLoader::new(node_id(11), own, &path(199)).unwrap().boot_loader_handover();
    assert_eq!((longest[22], longest[221], &longest[222..]), (11, b'x', &[0, 0][..]));
    bench.response_to_request(DataType::BEGIN_FIRMWARE_UPDATE, &path(5));
    bench.node.complete_command(Command::Restart, Ok(()));
    assert_eq!(bench.node.granted_update().unwrap().server_node, node_id(11));
}
