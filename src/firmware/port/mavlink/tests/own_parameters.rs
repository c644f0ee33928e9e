//! The module's settings as parameters.

use std::collections::BTreeSet;

use super::*;
use autoswing_module::settings::{PARAMETERS, SettingChange};

const PARAM_VALUE: u8 = 22;

/// Number of all parameters.
const COUNT: u8 = PARAMETERS.len() as u8;

fn name_bytes(name: &str) -> [u8; 16] {
    std::array::from_fn(|index| name.as_bytes().get(index).copied().unwrap_or(0))
}

fn list_request(target: MavlinkAddress) -> Vec<u8> {
    mavlink_v2_frame(GROUND_STATION, 21, 159, &target)
}

fn read_request(target: MavlinkAddress, name: &str, index: i16) -> Vec<u8> {
    mavlink_v2_frame(GROUND_STATION, 20, 214, &[&index.to_le_bytes()[..], &target, &name_bytes(name)].concat())
}

fn change(target: MavlinkAddress, name: &str, number: f32) -> Vec<u8> {
    let payload = [&number.to_le_bytes()[..], &target, &name_bytes(name), &[9]].concat();
    mavlink_v2_frame(GROUND_STATION, 23, 168, &payload)
}

/// Sent parameters: name, number, count and index.
fn sent_parameters(bench: &mut MavlinkBench) -> Vec<(String, f32, u8, u8)> {
    bench.run_ms(3_000);
    let parameter = |sent: &SentMessage| {
        let name = sent.payload[8..24].iter().take_while(|byte| **byte != 0).map(|byte| char::from(*byte));
        assert_eq!(sent.payload[24], 9, "a float");
        (name.collect(), sent.float_at(0), sent.payload[4], sent.payload[6])
    };
    bench.take_messages(PARAM_VALUE).iter().map(parameter).collect()
}

/// Ground stations request the list of all components, or of one; and what they miss again by its index.
#[test]
fn settings_are_listed_and_read() {
    for target in [[1, 158], [1, 0]] {
        let mut bench = MavlinkBench::with_autopilot();
        bench.receive(&list_request(target));
        let parameters = sent_parameters(&mut bench);
        let indices: BTreeSet<u8> = parameters.iter().map(|(.., index)| *index).collect();
        assert_eq!(indices, (0..COUNT).collect());
        assert!(parameters.iter().all(|(_, _, count, _)| *count == COUNT));
        assert!(parameters.contains(&("BAUD1".to_owned(), 115_200.0, COUNT, 14)), "{parameters:?}");
    }
    let mut bench = MavlinkBench::with_autopilot();
    for (name, index) in [("ACCURACY", -1), ("", 10)] {
        bench.receive(&read_request([1, 158], name, index));
        assert_eq!(sent_parameters(&mut bench), [("ACCURACY".to_owned(), 0.5, COUNT, 10)]);
    }
    for frame in [
        list_request([1, 1]),
        list_request([2, 0]),
        read_request([1, 0], "ACCURACY", -1),
        read_request([1, 158], "NONE", -1),
        read_request([1, 158], "", 100),
    ] {
        bench.receive(&frame);
        assert_eq!(sent_parameters(&mut bench), []);
    }
}

/// The answer to a change is the value in force, after the state machine has decided.
#[test]
fn a_setting_is_changed_as_from_the_can_bus() {
    let mut bench = MavlinkBench::with_autopilot();
    let command = Command::SetFromBus(SettingChange::named("ATTITUDE_RATE", 25.0).unwrap());
    assert_eq!(bench.receive(&change([1, 158], "ATTITUDE_RATE", 25.0)), [ReceivedMessage::Command(command)]);
    assert_eq!(sent_parameters(&mut bench), []);
    bench.settings.attitude_rate_hz = 25;
    bench.mavlink.complete_command(command, Ok(()));
    assert_eq!(sent_parameters(&mut bench), [("ATTITUDE_RATE".to_owned(), 25.0, COUNT, 18)]);
    for (name, number) in
        [("ATTITUDE_RATE", 25.5), ("ATTITUDE_RATE", -1.0), ("ATTITUDE_RATE", f32::NAN), ("SIGNING", 1.0)]
    {
        assert_eq!(bench.receive(&change([1, 158], name, number)), [], "{name}");
        assert_eq!(sent_parameters(&mut bench)[0].0, name);
    }
    assert_eq!(bench.receive(&change([1, 0], "ATTITUDE_RATE", 20.0)), []);
}
