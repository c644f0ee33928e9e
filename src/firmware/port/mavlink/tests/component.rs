//! Component of the module beside others.

use super::*;
use autoswing_module::settings::{SettingChange, SettingValue};

const OTHER_MODULE: MavlinkAddress = [1, 158];
const HEARTBEAT_ID: u8 = 0;

/// Bench that listens for other modules; the autopilot sends a heartbeat a second.
fn listening_bench(is_armed: bool) -> MavlinkBench {
    let mut bench = MavlinkBench { mavlink: Mavlink::new(), ..MavlinkBench::new() };
    bench.receive(&mavlink_heartbeat(AUTOPILOT, true, is_armed));
    bench
}

/// Runs, with heartbeats of the autopilot, and of another component from a time on; returns the commands.
fn run_with_other(bench: &mut MavlinkBench, other: Option<(MavlinkAddress, u64)>, seconds: u64) -> Vec<Command> {
    let mut commands = vec![];
    for second in 0..seconds {
        if let Some((address, _)) = other.filter(|(_, from_s)| second >= *from_s) {
            bench.receive(&mavlink_heartbeat(address, false, false));
        }
        for _ in 0..10 {
            bench.run_ms(100);
            commands.extend(bench.mavlink.take_command());
        }
        bench.receive(&mavlink_heartbeat(AUTOPILOT, true, false));
    }
    commands
}

fn component_of_heartbeats(bench: &mut MavlinkBench) -> Option<u8> {
    bench.take_messages(HEARTBEAT_ID).last().map(|heartbeat| heartbeat.sender[1])
}

/// ArduPilot forwards no heartbeat to a line before its first message, or to one that the component has used.
#[test]
fn the_first_requests_are_not_the_components() {
    let mut bench = listening_bench(false);
    bench.run_ms(1_200);
    let requests = bench.take_messages(76);
    assert!((900..=1_100).contains(&(requests[0].sent_at_ms - 3_600_000)), "the attitude does not wait: {requests:?}");
    assert!(bench.sent_messages.iter().chain(&requests).all(|sent| sent.sender == [1, 99]));
    bench.run_ms(2_300);
    assert_eq!(component_of_heartbeats(&mut bench), Some(158));
}

#[test]
fn a_second_module_takes_another_component() {
    let change = |component| Command::Set(SettingChange::new("COMPONENT", SettingValue::Whole(component)));
    for (other, is_taken) in
        [(Some((OTHER_MODULE, 1)), true), (None, false), (Some(([1, 157], 1)), false), (Some(([2, 158], 1)), false)]
    {
        let mut bench = listening_bench(false);
        let commands = run_with_other(&mut bench, other, 4);
        assert_eq!(commands.first(), is_taken.then(|| change(25)).as_ref(), "{other:?}");
        let notice = Notice::ComponentTaken { taken: 158, component: 25 };
        assert_eq!(bench.mavlink.take_message(bench.now()), is_taken.then_some(notice), "{other:?}");
        if is_taken {
            assert_eq!(component_of_heartbeats(&mut bench), None, "silent until the change");
            bench.settings.component = 25;
            assert_eq!(run_with_other(&mut bench, other, 4), []);
            assert_eq!(component_of_heartbeats(&mut bench), Some(25));
        } else {
            assert_eq!(component_of_heartbeats(&mut bench), Some(158), "{other:?}");
        }
    }
}

/// Its texts name the component, and commands to it are the module's.
#[test]
fn texts_name_the_component_to_which_commands_go() {
    let mut bench = MavlinkBench::with_autopilot();
    bench.settings.component = 25;
    bench.run_ms(100);
    bench.mavlink.queue_text(&Notice::InstallationRestored);
    bench.run_ms(1_000);
    assert_eq!(bench.take_texts(), [(6, "autoswing 25: iron-back: as calibrated again".to_owned())]);
    let is_executed = |component| bench_command(&mut bench, component);
    assert_eq!([158, 25].map(is_executed), [false, true]);
}

fn bench_command(bench: &mut MavlinkBench, component: u8) -> bool {
    !bench.receive(&command_frame(GROUND_STATION, [1, component], 42_424, 0, [0.0; 4])).is_empty()
}

/// In flight a restarted module keeps its component, and so does a module beside another line of its own, whose
/// heartbeats the autopilot forwards.
#[test]
fn a_settled_component_is_claimed_at_once() {
    for (is_armed, has_other_mavlink_line) in [(true, false), (false, true)] {
        let mut bench = listening_bench(is_armed);
        bench.receive(&attitude_frame(AUTOPILOT, 0));
        bench.has_other_mavlink_line = has_other_mavlink_line;
        bench.run_ms(200);
        assert_eq!(component_of_heartbeats(&mut bench), Some(158));
        assert_eq!(run_with_other(&mut bench, Some((OTHER_MODULE, 0)), 4), []);
    }
}
