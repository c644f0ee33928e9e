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

    fn send_heartbeat(&mut self, sender: SenderId, content: HeartbeatContent) {
        let now = self.now();
        let heartbeat = Heartbeat { sender, is_autopilot: content != NotAutopilot, is_armed: content == Armed };
        self.sender_selector.update_heartbeat(now, heartbeat);
    }

    fn send_attitude(&mut self, sender: SenderId) -> bool {
        let now = self.now();
        self.sender_selector.accept_attitude(now, sender)
    }

    fn is_armed(&self) -> bool {
        self.sender_selector.is_armed(self.now()) == Some(true)
    }

    /// Each sender sends attitude at 20 Hz and a heartbeat at 1 Hz; returns the accepted attitudes per sender.
    fn run_seconds<const N: usize>(&mut self, seconds: u64, senders: [(SenderId, HeartbeatContent); N]) -> [u64; N] {
        let mut accepted = [0; N];
        for tick in 0..seconds * 20 {
            for (&(sender, content), accepted) in senders.iter().zip(&mut accepted) {
                if tick % 20 == 0 && content != Missing {
                    self.send_heartbeat(sender, content);
                }
                *accepted += u64::from(self.send_attitude(sender));
            }
            self.now_ms += 50;
        }
        accepted
    }
}

#[test]
fn one_sender_is_selected_and_kept() {
    for (case, senders, accepted) in [
        (
            "the autopilot alone",
            [(GIMBAL, NotAutopilot), (AUTOPILOT, Disarmed), (SenderId::new(7), Missing)],
            [0, 600, 0],
        ),
        (
            "the first without heartbeats",
            [(GIMBAL, Missing), (AUTOPILOT, Missing), (SenderId::new(7), Missing)],
            [600, 0, 0],
        ),
        (
            "the first of two autopilots",
            [(GIMBAL, NotAutopilot), (SECOND_AUTOPILOT, Disarmed), (AUTOPILOT, Disarmed)],
            [0, 600, 0],
        ),
    ] {
        assert_eq!(TestSenders::new().run_seconds(30, senders), accepted, "{case}");
    }
}

#[test]
fn the_first_sender_is_kept_only_if_it_is_an_autopilot() {
    for (content, stays) in [(Disarmed, true), (NotAutopilot, false)] {
        let mut senders = TestSenders::new();
        assert!(senders.send_attitude(AUTOPILOT));
        senders.send_heartbeat(AUTOPILOT, content);
        assert_eq!(senders.send_attitude(AUTOPILOT), stays);
        // An identified autopilot remains selected when another is detected.
        senders.send_heartbeat(SECOND_AUTOPILOT, Disarmed);
        assert_eq!((senders.send_attitude(SECOND_AUTOPILOT), senders.send_attitude(AUTOPILOT)), (!stays, stays));
    }
}

#[test]
fn a_silent_sender_is_released_after_ten_seconds() {
    let mut senders = TestSenders::new();
    for sender in [AUTOPILOT, SECOND_AUTOPILOT] {
        senders.send_heartbeat(sender, Disarmed);
    }
    assert!(senders.send_attitude(AUTOPILOT));
    senders.now_ms += 9_000;
    senders.send_heartbeat(SECOND_AUTOPILOT, Disarmed);
    senders.now_ms += 1_000;
    assert!(!senders.send_attitude(SECOND_AUTOPILOT));
    senders.now_ms += 1;
    assert!(senders.send_attitude(SECOND_AUTOPILOT));
    assert!(senders.send_attitude(AUTOPILOT), "the module's own autopilot has returned");
    assert!(!senders.send_attitude(SECOND_AUTOPILOT));
}

/// Neither continuing attitude nor its loss changes the expiry.
#[test]
fn armed_state_expires_after_ten_seconds_without_a_heartbeat() {
    for attitude_ends_ms in [0, 20_000] {
        let mut senders = TestSenders::new();
        senders.send_heartbeat(AUTOPILOT, Armed);
        for ms in (0..=10_000).step_by(100) {
            assert!(ms > attitude_ends_ms || senders.send_attitude(AUTOPILOT));
            assert!(senders.is_armed(), "{ms}");
            senders.now_ms += 100;
        }
        senders.now_ms -= 99;
        assert!(!senders.is_armed());
    }
}

#[test]
fn the_oldest_sender_is_evicted() {
    let mut senders = TestSenders::new();
    for other in 0..7 {
        senders.send_heartbeat(SenderId::new(other), NotAutopilot);
        senders.now_ms += 1;
    }
    senders.send_heartbeat(GIMBAL, NotAutopilot);
    for other in 0..7 {
        senders.now_ms += 1;
        senders.send_heartbeat(SenderId::new(100 + other), NotAutopilot);
    }
    assert!(!senders.send_attitude(GIMBAL));
    for other in 0..7 {
        assert!(senders.sender_selector.last_heartbeat(senders.now(), SenderId::new(other)).is_none(), "{other}");
    }
}

/// Senders are released in turn: either may be another vehicle. Occasional agreement does not restart the minute.
#[test]
fn a_sender_that_contradicts_the_field_for_a_minute_is_released() {
    let mut senders = TestSenders::new();
    let mut accepted = [0; 2];
    for second in 0..140_u32 {
        let now = senders.now();
        senders.sender_selector.record_field_contradiction(now, second % 10 != 9);
        let more = senders.run_seconds(1, [(AUTOPILOT, Armed), (SECOND_AUTOPILOT, Armed)]);
        accepted = [accepted[0] + more[0], accepted[1] + more[1]];
        match second {
            59 => assert_eq!(accepted, [1200, 0]),
            90 => assert!(accepted[1] > 200, "{accepted:?}"),
            _ => {}
        }
    }
    assert_eq!(accepted[0] + accepted[1], 2800);
    // A contradicted sender is kept if no other autopilot sends attitude.
    let mut senders = TestSenders::new();
    for _ in 0..140 {
        let now = senders.now();
        senders.sender_selector.record_field_contradiction(now, true);
        assert_eq!(senders.run_seconds(1, [(AUTOPILOT, Armed)]), [20]);
    }
}
