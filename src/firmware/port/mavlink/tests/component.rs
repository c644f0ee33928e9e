//! Component of the module beside others.

use super::*;
use autoswing_module::settings::SettingChange;

const OTHER_MODULE: MavlinkAddress = [1, 158];
const HEARTBEAT_ID: u8 = 0;
const NAMED_VALUE_ID: u8 = 251;

/// Bench that listens for other modules; the autopilot sends a heartbeat a second.
fn listening_bench(is_armed: bool) -> MavlinkBench {
    let mut bench = MavlinkBench { mavlink: Mavlink::default(), ..MavlinkBench::new() };
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
    let change = |component: f32| Command::Set(SettingChange::named("COMPONENT", component).unwrap());
    for (other, is_taken) in
        [(Some((OTHER_MODULE, 1)), true), (None, false), (Some(([1, 157], 1)), false), (Some(([2, 158], 1)), false)]
    {
        let mut bench = listening_bench(false);
        let commands = run_with_other(&mut bench, other, 4);
        assert_eq!(commands.first(), is_taken.then(|| change(25.0)).as_ref(), "{other:?}");
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
    !bench.receive(&mavlink_command(GROUND_STATION, [1, component], 42_424, 0, [0.0; 4])).is_empty()
}

/// In flight a restarted module keeps its component, and so does a module beside another line of its own, whose
/// heartbeats the autopilot forwards.
#[test]
fn a_settled_component_is_claimed_at_once() {
    for (is_armed, has_other_line) in [(true, false), (false, true)] {
        let mut bench = listening_bench(is_armed);
        bench.receive(&attitude_frame(AUTOPILOT, 0));
        bench.mavlink.set_has_other_line(has_other_line);
        bench.run_ms(200);
        assert_eq!(component_of_heartbeats(&mut bench), Some(158));
        assert_eq!(run_with_other(&mut bench, Some((OTHER_MODULE, 0)), 4), []);
    }
}

/// Runs two modules beside one ArduPilot, which forwards named values, and heartbeats to a line that has not used their
/// component; settings change as the modules command.
fn run_two_modules(benches: &mut [MavlinkBench; 2], seconds: u64) {
    let mut used_components: [Vec<u8>; 2] = [vec![], vec![]];
    for step in 0..100 * seconds {
        if step % 100 == 0 {
            for bench in benches.iter_mut() {
                bench.receive(&mavlink_heartbeat(AUTOPILOT, true, false));
            }
        }
        // Both send before either receives.
        let sent_messages = benches.each_mut().map(|bench| {
            bench.run_ms(10);
            std::mem::take(&mut bench.sent_messages)
        });
        for (used, sent) in used_components.iter_mut().zip(&sent_messages) {
            used.extend(sent.iter().map(|sent| sent.sender[1]));
        }
        for (from, to) in [(0, 1), (1, 0)] {
            for sent in &sent_messages[from] {
                match sent.message_id {
                    HEARTBEAT_ID if !used_components[to].contains(&sent.sender[1]) => {
                        benches[to].receive(&mavlink_heartbeat(sent.sender, false, false));
                    }
                    NAMED_VALUE_ID => {
                        benches[to].receive(&mavlink_v2_frame(sent.sender, NAMED_VALUE_ID, 170, &sent.payload[..18]));
                    }
                    _ => {}
                }
            }
            if let Some(Command::Set(change)) = benches[from].mavlink.take_command() {
                benches[from].settings = benches[from].settings.with_setting(change).unwrap();
            }
        }
    }
}

/// Listening at the same instants, neither receives a heartbeat before it takes the component.
#[test]
fn modules_that_take_one_component_together_part() {
    let mut benches = [listening_bench(false), listening_bench(false)];
    benches[1].clock_offset_us = 5_000;
    run_two_modules(&mut benches, 3);
    // Clocks drift apart.
    benches[1].clock_offset_us += 3;
    run_two_modules(&mut benches, 12);
    let components = benches.each_ref().map(|bench| bench.mavlink.component_claim.sender_component());
    assert!(components[0] != components[1] && !components.contains(&LISTENING_COMPONENT), "{components:?}");
    assert_eq!(benches.each_ref().map(|bench| bench.settings.component), components);
}

/// Only before and after a flight, and at most three times: late copies of its own messages are like another module's.
#[test]
fn a_claimed_component_is_given_up_for_another_module_alone() {
    for (is_own_value, is_armed, has_other_line, change_count) in
        [(false, false, false, 3), (true, false, false, 0), (false, true, false, 0), (false, false, true, 0)]
    {
        let mut bench = listening_bench(is_armed);
        bench.receive(&attitude_frame(AUTOPILOT, 0));
        bench.mavlink.set_has_other_line(has_other_line);
        let mut changes = vec![];
        for _ in 0..300 {
            bench.run_ms(100);
            let own = bench.take_messages(NAMED_VALUE_ID).pop().map(|sent| sent.payload[..18].to_vec());
            if let Some(payload) = if is_own_value { own } else { Some(vec![7; 18]) } {
                let sender = [1, bench.settings.component];
                bench.receive(&mavlink_v2_frame(sender, NAMED_VALUE_ID, 170, &payload));
            }
            bench.receive(&mavlink_heartbeat(AUTOPILOT, true, is_armed));
            bench.receive(&attitude_frame(AUTOPILOT, 0));
            if let Some(Command::Set(change)) = bench.mavlink.take_command() {
                bench.settings = bench.settings.with_setting(change).unwrap();
                changes.push(bench.settings.component);
            }
        }
        assert_eq!(changes, [25, 26, 27][..change_count], "{is_own_value} {is_armed} {has_other_line}");
        assert!(bench.mavlink.component_claim.is_claimed());
    }
}

#[test]
fn the_component_after_the_last_is_the_first() {
    let mut bench = listening_bench(false);
    bench.settings.component = 250;
    let change = Command::Set(SettingChange::named("COMPONENT", 25.0).unwrap());
    assert_eq!(run_with_other(&mut bench, Some(([1, 250], 1)), 4)[0], change);
}
