//! Unit tests of `sender_selector`.

use super::*;
use HeartbeatContent::{Armed, Disarmed, Missing, NotAutopilot};

const AUTOPILOT: SenderId = SenderId::new(0x0101);
const SECOND_AUTOPILOT: SenderId = SenderId::new(0x0201);
const GIMBAL: SenderId = SenderId::new(0x019A);

/// Content of a sender's heartbeat.
#[derive(Clone, Copy, PartialEq)]
enum HeartbeatContent {
    Missing,
    NotAutopilot,
    Disarmed,
    Armed,
}

/// Senders and a clock in milliseconds.
struct TestSenders {
    sender_selector: SenderSelector,
    now_ms: u64,
}

impl TestSenders {
    fn new() -> Self {
        Self { sender_selector: SenderSelector::new(), now_ms: 3_600_000 }
    }

    fn now(&self) -> Timestamp {
        Timestamp::from_us(self.now_ms * 1000)
    }

    fn send_heartbeat(&mut self, source: SenderId, content: HeartbeatContent) {
        let now = self.now();
        let heartbeat = Heartbeat { sender: source, is_autopilot: content != NotAutopilot, is_armed: content == Armed };
        self.sender_selector.update_heartbeat(now, heartbeat);
    }

    fn send_attitude(&mut self, source: SenderId) -> bool {
        let now = self.now();
        self.sender_selector.accept_attitude(now, source)
    }

    fn is_armed(&self) -> bool {
        self.sender_selector.is_armed(self.now()) == Some(true)
    }

    /// Each sender sends attitude at 20 Hz and a heartbeat at 1 Hz; returns the accepted attitudes per sender.
    fn run_seconds<const N: usize>(&mut self, seconds: u64, senders: [(SenderId, HeartbeatContent); N]) -> [u64; N] {
        let mut accepted = [0; N];
        for tick in 0..seconds * 20 {
            for (&(source, content), accepted) in senders.iter().zip(&mut accepted) {
                if tick % 20 == 0 && content != Missing {
                    self.send_heartbeat(source, content);
                }
                *accepted += u64::from(self.send_attitude(source));
            }
            self.now_ms += 50;
        }
        accepted
    }
}

#[test]
fn only_the_autopilot_is_accepted() {
    let mut bench = TestSenders::new();
    let sources = [(GIMBAL, NotAutopilot), (AUTOPILOT, Disarmed), (SenderId::new(7), Missing)];
    assert_eq!(bench.run_seconds(30, sources), [0, 600, 0]);
}

#[test]
fn without_heartbeats_the_first_sender_is_accepted() {
    let mut bench = TestSenders::new();
    assert_eq!(bench.run_seconds(30, [(GIMBAL, Missing), (AUTOPILOT, Missing)]), [600, 0]);
}

/// Heartbeats of cameras, radios and ground stations.
#[test]
fn heartbeats_of_others_change_nothing() {
    let mut bench = TestSenders::new();
    assert_eq!(bench.run_seconds(3, [(GIMBAL, NotAutopilot)]), [0]);
    assert_eq!(bench.run_seconds(3, [(AUTOPILOT, Missing), (GIMBAL, NotAutopilot)]), [60, 0]);
}

#[test]
fn a_first_sender_is_dropped_at_an_autopilot_s_first_heartbeat() {
    let mut bench = TestSenders::new();
    assert!(bench.send_attitude(GIMBAL));
    bench.send_heartbeat(AUTOPILOT, Disarmed);
    assert!(!bench.send_attitude(GIMBAL), "before the autopilot sends attitude");
    assert!(bench.send_attitude(AUTOPILOT));
    assert!(!bench.send_attitude(GIMBAL));
}

#[test]
fn the_first_sender_is_kept_only_if_it_is_an_autopilot() {
    for (content, stays) in [(Disarmed, true), (NotAutopilot, false)] {
        let mut bench = TestSenders::new();
        assert!(bench.send_attitude(AUTOPILOT));
        bench.send_heartbeat(AUTOPILOT, content);
        assert_eq!(bench.send_attitude(AUTOPILOT), stays);
        // An identified autopilot remains selected when another is detected.
        bench.send_heartbeat(SECOND_AUTOPILOT, Disarmed);
        assert_eq!((bench.send_attitude(SECOND_AUTOPILOT), bench.send_attitude(AUTOPILOT)), (!stays, stays));
    }
}

#[test]
fn of_two_autopilots_the_first_selected_is_kept() {
    let mut bench = TestSenders::new();
    assert_eq!(bench.run_seconds(30, [(SECOND_AUTOPILOT, Disarmed), (AUTOPILOT, Disarmed)]), [600, 0]);
}

#[test]
fn a_silent_sender_is_released_after_ten_seconds() {
    let mut bench = TestSenders::new();
    for source in [AUTOPILOT, SECOND_AUTOPILOT] {
        bench.send_heartbeat(source, Disarmed);
    }
    assert!(bench.send_attitude(AUTOPILOT));
    bench.now_ms += 9_000;
    bench.send_heartbeat(SECOND_AUTOPILOT, Disarmed);
    bench.now_ms += 1_000;
    assert!(!bench.send_attitude(SECOND_AUTOPILOT));
    bench.now_ms += 1;
    assert!(bench.send_attitude(SECOND_AUTOPILOT));
    assert!(bench.send_attitude(AUTOPILOT), "the module's own autopilot has returned");
    assert!(!bench.send_attitude(SECOND_AUTOPILOT));
}

#[test]
fn a_sender_of_heartbeats_alone_does_not_block_an_autopilot() {
    let mut bench = TestSenders::new();
    for _ in 0..20 {
        bench.send_heartbeat(SECOND_AUTOPILOT, Disarmed);
        assert_eq!(bench.run_seconds(1, [(AUTOPILOT, Disarmed)]), [20]);
    }
}

#[test]
fn an_autopilot_s_heartbeat_expires_after_ten_seconds() {
    let mut bench = TestSenders::new();
    bench.send_heartbeat(AUTOPILOT, Disarmed);
    bench.now_ms += 10_000;
    assert!(!bench.send_attitude(GIMBAL));
    bench.now_ms += 1;
    assert!(bench.send_attitude(GIMBAL));
}

#[test]
fn the_selected_sender_needs_no_further_heartbeats() {
    let mut bench = TestSenders::new();
    bench.send_heartbeat(AUTOPILOT, Disarmed);
    assert_eq!(bench.run_seconds(30, [(AUTOPILOT, Missing), (SECOND_AUTOPILOT, Disarmed)]), [600, 0]);
}

/// Before attitude: the first autopilot, until its heartbeat expires. Afterwards: the selected one, until another
/// is selected.
#[test]
fn the_selected_autopilot_is_queried() {
    let mut bench = TestSenders::new();
    let queried = |bench: &TestSenders| bench.sender_selector.autopilot_to_query(bench.now());
    bench.send_heartbeat(GIMBAL, NotAutopilot);
    assert_eq!(queried(&bench), None);
    bench.send_heartbeat(AUTOPILOT, Disarmed);
    bench.send_heartbeat(SECOND_AUTOPILOT, Disarmed);
    assert_eq!(queried(&bench), Some(AUTOPILOT));
    bench.now_ms += 10_000;
    assert_eq!(queried(&bench), Some(AUTOPILOT));
    bench.now_ms += 1;
    assert_eq!(queried(&bench), None);
    for source in [AUTOPILOT, SECOND_AUTOPILOT] {
        bench.send_heartbeat(source, Disarmed);
    }
    assert!(bench.send_attitude(SECOND_AUTOPILOT));
    assert_eq!(queried(&bench), Some(SECOND_AUTOPILOT));
    bench.now_ms += 60_000;
    assert_eq!(queried(&bench), Some(SECOND_AUTOPILOT), "it keeps its place");
    bench.send_heartbeat(AUTOPILOT, Disarmed);
    assert!(bench.send_attitude(AUTOPILOT));
    assert_eq!(queried(&bench), Some(AUTOPILOT));
    // A first sender without heartbeats is not queried.
    let mut bench = TestSenders::new();
    assert!(bench.send_attitude(GIMBAL));
    assert_eq!(queried(&bench), None);
}

#[test]
fn armed_is_the_last_state_of_the_selected_autopilot() {
    let mut bench = TestSenders::new();
    bench.send_heartbeat(AUTOPILOT, Armed);
    assert!(!bench.is_armed(), "nobody is chosen yet");
    assert!(bench.send_attitude(AUTOPILOT) && bench.is_armed());
    bench.send_heartbeat(SECOND_AUTOPILOT, Disarmed);
    bench.send_heartbeat(GIMBAL, NotAutopilot);
    assert!(bench.is_armed());
    bench.send_heartbeat(AUTOPILOT, Disarmed);
    bench.send_heartbeat(SECOND_AUTOPILOT, Armed);
    assert!(!bench.is_armed());
    let mut bench = TestSenders::new();
    assert!(bench.send_attitude(AUTOPILOT) && !bench.is_armed());
}

/// Neither continuing attitude nor its loss changes the expiry.
#[test]
fn armed_state_expires_after_ten_seconds_without_a_heartbeat() {
    for attitude_ends_ms in [0, 20_000] {
        let mut bench = TestSenders::new();
        bench.send_heartbeat(AUTOPILOT, Armed);
        for ms in (0..=10_000).step_by(100) {
            assert!(ms > attitude_ends_ms || bench.send_attitude(AUTOPILOT));
            assert!(bench.is_armed(), "{ms}");
            bench.now_ms += 100;
        }
        bench.now_ms -= 99;
        assert!(!bench.is_armed());
    }
}

/// 20 forged autopilot heartbeats between any two frames of the real autopilot, before and after its selection.
#[test]
fn a_flood_of_heartbeats_does_not_displace_the_autopilot() {
    let mut bench = TestSenders::new();
    let mut accepted = 0;
    for tick in 0..600_u16 {
        for forged in 0..20 {
            bench.send_heartbeat(SenderId::new(0x4000 + (tick % 50) * 20 + forged), Disarmed);
        }
        // The autopilot's first heartbeat follows a second of attitude.
        if tick % 20 == 19 {
            bench.send_heartbeat(AUTOPILOT, Armed);
        }
        accepted += u16::from(bench.send_attitude(AUTOPILOT));
        assert_eq!(bench.is_armed(), tick >= 19);
        bench.now_ms += 50;
    }
    assert_eq!(accepted, 600 - 19);
}

/// The selected sender was received first and longest ago.
#[test]
fn the_selected_sender_is_never_evicted() {
    let mut bench = TestSenders::new();
    bench.send_heartbeat(AUTOPILOT, Armed);
    assert!(bench.send_attitude(AUTOPILOT));
    for other in 0..20 {
        bench.now_ms += 100;
        bench.send_heartbeat(SenderId::new(other), Disarmed);
        assert!(!bench.send_attitude(SenderId::new(other)));
    }
    assert!(bench.is_armed() && bench.send_attitude(AUTOPILOT));
    assert_eq!(bench.sender_selector.entries.len(), MAX_SENDERS);
}

#[test]
fn the_oldest_sender_is_evicted() {
    let mut bench = TestSenders::new();
    for other in 0..7 {
        bench.send_heartbeat(SenderId::new(other), NotAutopilot);
        bench.now_ms += 1;
    }
    bench.send_heartbeat(GIMBAL, NotAutopilot);
    for other in 0..7 {
        bench.now_ms += 1;
        bench.send_heartbeat(SenderId::new(100 + other), NotAutopilot);
    }
    assert!(!bench.send_attitude(GIMBAL));
    for other in 0..7 {
        assert!(bench.sender_selector.last_heartbeat(bench.now(), SenderId::new(other)).is_none(), "{other}");
    }
}

/// Replacements: another vehicle's autopilot, and a second one of the same vehicle.
#[test]
fn while_armed_only_the_same_vehicle_replaces_a_silent_autopilot() {
    let same_vehicle = SenderId::new(0x0102);
    for (content, other, replaces) in [
        (Armed, SECOND_AUTOPILOT, false),
        (Armed, same_vehicle, true),
        (Disarmed, SECOND_AUTOPILOT, true),
        (Disarmed, same_vehicle, true),
    ] {
        let mut bench = TestSenders::new();
        assert_eq!(bench.run_seconds(1, [(AUTOPILOT, content), (other, Disarmed)]), [20, 0]);
        let accepted = bench.run_seconds(60, [(other, Armed)]);
        assert_eq!(accepted[0] > 0, replaces, "{other:?}");
        assert_eq!(bench.run_seconds(1, [(AUTOPILOT, content), (other, Armed)]), [20, 0]);
    }
}

/// The heartbeat is forged, or of a component with the autopilot's address. A silence of 12 s exceeds the expiry.
#[test]
fn a_heartbeat_without_autopilot_does_not_displace_the_autopilot() {
    for silent_ms in [0, 12_000] {
        let mut bench = TestSenders::new();
        bench.send_heartbeat(AUTOPILOT, Armed);
        assert!(bench.send_attitude(AUTOPILOT));
        bench.now_ms += silent_ms;
        bench.send_heartbeat(AUTOPILOT, NotAutopilot);
        bench.send_heartbeat(SECOND_AUTOPILOT, Disarmed);
        assert!(!bench.send_attitude(SECOND_AUTOPILOT) && bench.send_attitude(AUTOPILOT));
        assert_eq!(bench.is_armed(), silent_ms == 0);
    }
}

/// Senders are released in turn: either may be another vehicle. Occasional agreement does not restart the minute.
#[test]
fn a_sender_that_contradicts_the_field_for_a_minute_is_released() {
    let mut bench = TestSenders::new();
    let mut accepted = [0; 2];
    for second in 0..140_u32 {
        let now = bench.now();
        bench.sender_selector.record_field_contradiction(now, second % 10 != 9);
        let more = bench.run_seconds(1, [(AUTOPILOT, Armed), (SECOND_AUTOPILOT, Armed)]);
        accepted = [accepted[0] + more[0], accepted[1] + more[1]];
        match second {
            59 => assert_eq!(accepted, [1200, 0]),
            90 => assert!(accepted[1] > 200, "{accepted:?}"),
            _ => {}
        }
    }
    assert_eq!(accepted[0] + accepted[1], 2800);
    // A contradicted sender is kept if no other autopilot sends attitude.
    let mut bench = TestSenders::new();
    for _ in 0..140 {
        let now = bench.now();
        bench.sender_selector.record_field_contradiction(now, true);
        assert_eq!(bench.run_seconds(1, [(AUTOPILOT, Armed)]), [20]);
    }
}
