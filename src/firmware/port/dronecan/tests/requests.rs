//! Requests of other nodes: description, parameters, restart, firmware update.

use super::*;
use crate::port::parameters::{PARAMETERS, ParameterValue};
use crate::wire::mavlink::key_from_passphrase;
use autoswing_module::settings::{SettingChange, SigningKey};

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

/// Every parameter by its position, with value, default and range; then an empty answer.
#[test]
fn all_parameters_are_listed() {
    let mut bench = Bench::new();
    for (index, parameter) in PARAMETERS.iter().enumerate() {
        let payload = bench.response_to_request(GET_SET, &[index as u8, 0]).unwrap();
        let name = parameter.parameter_name.as_bytes();
        assert!(payload.ends_with(name), "{} {payload:?}", parameter.parameter_name);
        let tags = |value| match value {
            ParameterValue::Whole(_) => 9,
            ParameterValue::Number(_) => 5,
            ParameterValue::Key(_) => 0,
        };
        if let Some([least, _]) = parameter.value_range() {
            assert_eq!(payload.len() - name.len(), 4 * tags(least), "{}", parameter.parameter_name);
        }
    }
    assert_eq!(bench.response_to_request(GET_SET, &[PARAMETERS.len() as u8, 0]), Some(vec![0; 4]));
    assert_eq!(bench.response_to_request(GET_SET, b"\x00\x00UNKNOWN"), Some(vec![0; 4]));
}

fn set_integer_payload(value: i64, name: &str) -> Vec<u8> {
    [&[0, 1][..], &value.to_le_bytes(), name.as_bytes()].concat()
}

/// The answer waits for the state machine, and has the value that is then in force.
#[test]
fn a_parameter_is_set_by_a_command() {
    let mut bench = Bench::new();
    assert_eq!(bench.response_to_request(GET_SET, &set_integer_payload(20, "CAN_RATE")), None);
    let command = Command::SetFromBus(SettingChange::CanRateHz(20));
    assert_eq!(bench.commands, [command]);
    bench.settings.can.rate_hz = 20;
    bench.node.complete_command(command, Ok(()));
    assert_eq!(bench.run_for_response(GET_SET).unwrap()[..9], [1, 20, 0, 0, 0, 0, 0, 0, 0]);
}

#[test]
fn a_refused_or_unanswered_setting_is_answered_with_the_old_value() {
    let old = [1, 50, 0, 0, 0, 0, 0, 0, 0];
    let mut bench = Bench::new();
    bench.response_to_request(GET_SET, &set_integer_payload(81, "CAN_RATE"));
    bench.node.complete_command(Command::SetFromBus(SettingChange::CanRateHz(81)), Err(&Refusal::Busy));
    assert_eq!(bench.run_for_response(GET_SET).unwrap()[..9], old);
    bench.response_to_request(GET_SET, &set_integer_payload(30, "CAN_RATE"));
    assert_eq!(bench.sent_in_ms(GET_SET, 1900).len(), 0);
    assert_eq!(bench.sent_in_ms(GET_SET, 200)[0].payload[..9], old, "after two seconds");
}

#[test]
fn commands_are_executed_one_after_another() {
    let mut bench = Bench::new();
    let commands = [20, 30].map(|rate| Command::SetFromBus(SettingChange::CanRateHz(rate)));
    for (number, rate) in [20, 30].into_iter().enumerate() {
        assert_eq!(bench.response_to_request(GET_SET, &set_integer_payload(rate, "CAN_RATE")), None);
        assert_eq!(bench.commands, commands[..1], "request {number}");
    }
    for command in commands {
        assert_eq!(bench.commands.last(), Some(&command));
        bench.node.complete_command(command, Ok(()));
        assert!(bench.run_for_response(GET_SET).is_some());
    }
    assert_eq!(bench.commands, commands);
}

/// Requests with the present value, a number beyond the range, or a value of another kind.
#[test]
fn requests_that_change_nothing_are_answered_at_once() {
    let mut bench = Bench::new();
    for request in [
        set_integer_payload(50, "CAN_RATE"),
        set_integer_payload(i64::MAX, "CAN_RATE"),
        b"\x00\x02\x00\x00\x00\x00CAN_RATE".to_vec(),
        b"\x00\x04\x02onCAN_RATE".to_vec(),
    ] {
        assert_eq!(bench.response_to_request(GET_SET, &request).unwrap()[..9], [1, 50, 0, 0, 0, 0, 0, 0, 0]);
    }
    assert_eq!(bench.commands, []);
}

#[test]
fn a_passphrase_is_set_and_not_read() {
    let mut bench = Bench::new();
    assert_eq!(bench.response_to_request(GET_SET, b"\x00\x04\x04wordSIGNING"), None);
    assert_eq!(bench.commands, [Command::SetFromBus(SettingChange::Signing(Some(key_from_passphrase("word"))))]);
    bench.node.complete_command(bench.commands[0], Ok(()));
    bench.settings.signing_key = Some(SigningKey([7; 32]));
    assert_eq!(bench.run_for_response(GET_SET).unwrap(), b"\x04\x02on\x04\x03off\x00\x00SIGNING");
    bench.response_to_request(GET_SET, b"\x00\x04\x03offSIGNING");
    assert_eq!(bench.commands[1], Command::SetFromBus(SettingChange::Signing(None)));
}

const RESTART_MAGIC_BYTES: [u8; 5] = [0x1E, 0x1B, 0x55, 0xCE, 0xAC];

#[test]
fn commands_refused_while_armed_are_answered_as_refused() {
    let mut bench = Bench::new();
    let mut refused = |data_type, payload: &[u8]| {
        assert_eq!(bench.response_to_request(data_type, payload), None);
        bench.node.complete_command(bench.commands.pop().unwrap(), Err(&Refusal::Armed));
        bench.run_for_response(data_type).unwrap()
    };
    assert_eq!(refused(GET_SET, &set_integer_payload(20, "CAN_RATE"))[1], 50);
    assert_eq!(refused(DataType::RESTART_NODE, &RESTART_MAGIC_BYTES), [0]);
    assert_eq!(refused(DataType::EXECUTE_OPCODE, &[1, 0, 0, 0, 0, 0, 0]), [0; 7]);
    assert_eq!(refused(DataType::BEGIN_FIRMWARE_UPDATE, b"\x00a.bin"), b"\x01armed");
    assert_eq!(bench.node.granted_update(), None);
}

#[test]
fn a_restart_needs_its_magic_number_and_the_state_machine() {
    let mut bench = Bench::new();
    for magic in [&RESTART_MAGIC_BYTES[..4], &[0; 5], b""] {
        assert_eq!(bench.response_to_request(DataType::RESTART_NODE, magic), Some(vec![0]));
    }
    assert_eq!(bench.commands, []);
    for (result, answer) in [(Err(&Refusal::Armed), 0), (Ok(()), 0x80)] {
        assert_eq!(bench.response_to_request(DataType::RESTART_NODE, &RESTART_MAGIC_BYTES), None);
        assert_eq!(bench.commands.pop(), Some(Command::Restart));
        bench.node.complete_command(Command::Restart, result);
        assert_eq!(bench.run_for_response(DataType::RESTART_NODE), Some(vec![answer]));
    }
    assert_eq!(bench.node.granted_update(), None);
}

#[test]
fn parameters_are_saved_when_set_and_reset_by_a_command() {
    let mut bench = Bench::new();
    assert_eq!(bench.response_to_request(DataType::EXECUTE_OPCODE, &[0; 7]), Some(vec![0, 0, 0, 0, 0, 0, 0x80]));
    assert_eq!(bench.response_to_request(DataType::EXECUTE_OPCODE, &[9; 7]), Some(vec![0; 7]));
    assert_eq!(bench.response_to_request(DataType::EXECUTE_OPCODE, &[1, 0, 0, 0, 0, 0, 0]), None);
    assert_eq!(bench.commands, [Command::ResetSettings]);
    bench.node.complete_command(Command::ResetSettings, Ok(()));
    assert_eq!(bench.run_for_response(DataType::EXECUTE_OPCODE), Some(vec![0, 0, 0, 0, 0, 0, 0x80]));
}

/// Offsets and the size are those of the boot loader; no byte is left as it was.
#[test]
fn an_update_is_handed_over_with_the_restart() {
    let mut bench = Bench::new();
    assert_eq!(bench.response_to_request(DataType::BEGIN_FIRMWARE_UPDATE, b"\x00a.bin"), None);
    assert_eq!(bench.commands, [Command::Restart]);
    assert_eq!(bench.node.granted_update(), None, "not before the state machine");
    bench.node.complete_command(Command::Restart, Ok(()));
    let update = bench.node.granted_update().unwrap();
    assert_eq!(
        (update.server_node, update.own_node, update.file_path()),
        (node_id(PEER_NODE), node_id(OWN_NODE), &b"a.bin"[..])
    );
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

/// The longest path fits with its NUL; a server other than the sender can be named.
#[test]
fn invalid_image_paths_are_refused() {
    let path = |length| [&[11][..], &vec![b'x'; length]].concat();
    let mut bench = Bench::new();
    for wrong in [vec![0], b"\x00a\x00b".to_vec()] {
        let answer = bench.response_to_request(DataType::BEGIN_FIRMWARE_UPDATE, &wrong).unwrap();
        assert_eq!(answer[0], 255, "{wrong:?}");
    }
    assert_eq!(bench.commands, []);
    // Payloads that this node does not send, through the decoder's type.
    let own = node_id(OWN_NODE);
    assert!(UpdateForBootLoader::new(node_id(11), own, &path(200)).is_none(), "201 bytes");
    let longest = UpdateForBootLoader::new(node_id(11), own, &path(199)).unwrap().boot_loader_handover();
    assert_eq!((longest[22], longest[221], &longest[222..]), (11, b'x', &[0, 0][..]));
    bench.response_to_request(DataType::BEGIN_FIRMWARE_UPDATE, &path(5));
    bench.node.complete_command(Command::Restart, Ok(()));
    assert_eq!(bench.node.granted_update().unwrap().server_node, node_id(11));
}

#[test]
fn a_board_without_a_boot_loader_refuses_updates() {
    let mut bench = Bench::new();
    bench.node.refuse_updates();
    for _ in 0..2 {
        let answer = bench.response_to_request(DataType::BEGIN_FIRMWARE_UPDATE, b"\x00a").unwrap();
        assert_eq!((answer[0], &answer[1..]), (255, &b"no boot loader for updates over CAN"[..]));
    }
    assert_eq!(bench.commands, []);
}

#[test]
fn a_refused_update_can_be_repeated() {
    let mut bench = Bench::new();
    bench.response_to_request(DataType::BEGIN_FIRMWARE_UPDATE, b"\x00a");
    bench.node.complete_command(Command::Restart, Err(&Refusal::Busy));
    assert_eq!(bench.run_for_response(DataType::BEGIN_FIRMWARE_UPDATE), Some(b"\x01busy".to_vec()));
    assert_eq!(bench.node.granted_update(), None);
    bench.response_to_request(DataType::BEGIN_FIRMWARE_UPDATE, b"\x00b");
    bench.node.complete_command(Command::Restart, Ok(()));
    assert_eq!(bench.node.granted_update().unwrap().file_path(), b"b");
}

/// The second of two requests does not replace the path of the first, nor does one for which there was no room.
#[test]
fn one_update_is_requested_at_a_time() {
    let mut bench = Bench::new();
    let update = |transfer_id, payload| transfer_from_peer(DataType::BEGIN_FIRMWARE_UPDATE, transfer_id, payload);
    for source in 11..15 {
        bench.deliver_transfer(source, &transfer_from_peer(DataType::GET_NODE_INFO, 0, &[]));
    }
    bench.deliver_transfer(PEER_NODE, &update(0, b"\x00lost"));
    bench.run_ms(100);
    bench.deliver_transfer(PEER_NODE, &update(1, b"\x00a"));
    bench.deliver_transfer(66, &update(2, b"\x00b"));
    let answers = bench.sent_in_ms(DataType::BEGIN_FIRMWARE_UPDATE, 100);
    assert_eq!(answers.iter().map(|sent| (sent.transfer_id, sent.payload[0])).collect::<Vec<_>>(), [(2, 2)]);
    bench.node.complete_command(Command::Restart, Ok(()));
    assert_eq!(bench.node.granted_update().unwrap().file_path(), b"a");
}

/// Requests of several nodes at once are answered to each; further ones than four wait for a repetition.
#[test]
fn each_requester_gets_its_answer() {
    let mut bench = Bench::new();
    for source in 11..20 {
        bench.deliver_transfer(source, &transfer_from_peer(DataType::GET_NODE_INFO, source, &[]));
    }
    let sent = bench.sent_in_ms(DataType::GET_NODE_INFO, 100);
    let answered: Vec<_> = sent.iter().map(|sent| (sent.header.transfer_kind, sent.transfer_id)).collect();
    assert_eq!(answered, [11, 12, 13, 14].map(|source| (TransferKind::Response(node_id(source)), source)));
}
