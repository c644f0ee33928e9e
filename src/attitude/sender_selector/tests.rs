//! Unit tests of `sender_selector`.

use super::*;
use HeartbeatContent::{Armed, Nothing, Other, Ready};

const AUTOPILOT: SenderId = SenderId::new(0x0101);
const SECOND: SenderId = SenderId::new(0x0201);
const GIMBAL: SenderId = SenderId::new(0x019A);

/// Content of a sender's heartbeat.
#[derive(Clone, Copy, PartialEq)]
enum HeartbeatContent {
    Nothing,
    Other,
    Ready,
    Armed,
}

/// Senders and a clock in milliseconds.
struct TestSenders {
    senders: SenderSelector,
    ms: u64,
}

impl TestSenders {
    fn new() -> Self {
        Self { senders: SenderSelector::new(), ms: 3_600_000 }
    }

    fn now(&self) -> Timestamp {
        Timestamp::from_us(self.ms * 1000)
    }

    fn send_heartbeat(&mut self, source: SenderId, said: HeartbeatContent) {
        let now = self.now();
        let heartbeat = Heartbeat { sender: source, is_autopilot: said != Other, is_armed: said == Armed };
        self.senders.update_heartbeat(now, heartbeat);
    }

    fn send_attitude(&mut self, source: SenderId) -> bool {
        let now = self.now();
        self.senders.accept_attitude(now, source)
    }

    fn is_armed(&self) -> bool {
        self.senders.is_armed(self.now()) == Some(true)
    }

    /// Each sender sends attitude at 20 Hz and a heartbeat at 1 Hz; returns the accepted attitudes per sender.
    fn run<const N: usize>(&mut self, seconds: u64, sources: [(SenderId, HeartbeatContent); N]) -> [u64; N] {
        let mut taken = [0; N];
        for tick in 0..seconds * 20 {
            for (&(source, said), taken) in sources.iter().zip(&mut taken) {
                if tick % 20 == 0 && said != Nothing {
                    self.send_heartbeat(source, said);
                }
                *taken += u64::from(self.send_attitude(source));
            }
            self.ms += 50;
        }
        taken
    }
}

#[test]
fn only_the_autopilot_is_accepted() {
    let mut bed = TestSenders::new();
    let sources = [(GIMBAL, Other), (AUTOPILOT, Ready), (SenderId::new(7), Nothing)];
    assert_eq!(bed.run(30, sources), [0, 600, 0]);
}

#[test]
fn without_heartbeats_the_first_sender_is_accepted() {
    let mut bed = TestSenders::new();
    assert_eq!(bed.run(30, [(GIMBAL, Nothing), (AUTOPILOT, Nothing)]), [600, 0]);
}

/// Heartbeats of cameras, radios and ground stations.
#[test]
fn heartbeats_of_others_change_nothing() {
    let mut bed = TestSenders::new();
    assert_eq!(bed.run(3, [(GIMBAL, Other)]), [0]);
    assert_eq!(bed.run(3, [(AUTOPILOT, Nothing), (GIMBAL, Other)]), [60, 0]);
}

#[test]
fn a_first_sender_is_dropped_when_an_autopilot_is_heard() {
    let mut bed = TestSenders::new();
    assert!(bed.send_attitude(GIMBAL));
    bed.send_heartbeat(AUTOPILOT, Ready);
    assert!(!bed.send_attitude(GIMBAL), "before the autopilot sends attitude");
    assert!(bed.send_attitude(AUTOPILOT));
    assert!(!bed.send_attitude(GIMBAL));
}

#[test]
fn the_first_sender_is_kept_only_if_it_is_an_autopilot() {
    for (said, stays) in [(Ready, true), (Other, false)] {
        let mut bed = TestSenders::new();
        assert!(bed.send_attitude(AUTOPILOT));
        bed.send_heartbeat(AUTOPILOT, said);
        assert_eq!(bed.send_attitude(AUTOPILOT), stays);
        // An identified autopilot remains selected when another is detected.
        bed.send_heartbeat(SECOND, Ready);
        assert_eq!((bed.send_attitude(SECOND), bed.send_attitude(AUTOPILOT)), (!stays, stays));
    }
}

#[test]
fn of_two_autopilots_the_first_selected_is_kept() {
    let mut bed = TestSenders::new();
    assert_eq!(bed.run(30, [(SECOND, Ready), (AUTOPILOT, Ready)]), [600, 0]);
}

/// While the other sender's attitude continues.
#[test]
fn a_silent_sender_is_released_after_ten_seconds() {
    let mut bed = TestSenders::new();
    for source in [AUTOPILOT, SECOND] {
        bed.send_heartbeat(source, Ready);
    }
    assert!(bed.send_attitude(AUTOPILOT));
    bed.ms += 9_000;
    bed.send_heartbeat(SECOND, Ready);
    bed.ms += 1_000;
    assert!(!bed.send_attitude(SECOND));
    bed.ms += 1;
    assert!(bed.send_attitude(SECOND));
    bed.send_heartbeat(AUTOPILOT, Ready);
    assert!(!bed.send_attitude(AUTOPILOT), "it is the other one's turn");
}

#[test]
fn a_sender_of_heartbeats_alone_does_not_block_an_autopilot() {
    let mut bed = TestSenders::new();
    for _ in 0..20 {
        bed.send_heartbeat(SECOND, Ready);
        assert_eq!(bed.run(1, [(AUTOPILOT, Ready)]), [20]);
    }
}

#[test]
fn an_autopilot_s_heartbeat_is_forgotten_after_ten_seconds() {
    let mut bed = TestSenders::new();
    bed.send_heartbeat(AUTOPILOT, Ready);
    bed.ms += 10_000;
    assert!(!bed.send_attitude(GIMBAL));
    bed.ms += 1;
    assert!(bed.send_attitude(GIMBAL));
}

#[test]
fn the_selected_sender_needs_no_further_heartbeats() {
    let mut bed = TestSenders::new();
    bed.send_heartbeat(AUTOPILOT, Ready);
    assert_eq!(bed.run(30, [(AUTOPILOT, Nothing), (SECOND, Ready)]), [600, 0]);
}

/// Before attitude: the first autopilot, until its heartbeat expires. Afterwards: the selected one, until another
/// is selected.
#[test]
fn the_selected_autopilot_is_queried() {
    let mut bed = TestSenders::new();
    let asked = |bed: &TestSenders| bed.senders.autopilot_to_query(bed.now());
    bed.send_heartbeat(GIMBAL, Other);
    assert_eq!(asked(&bed), None);
    bed.send_heartbeat(AUTOPILOT, Ready);
    bed.send_heartbeat(SECOND, Ready);
    assert_eq!(asked(&bed), Some(AUTOPILOT));
    bed.ms += 10_000;
    assert_eq!(asked(&bed), Some(AUTOPILOT));
    bed.ms += 1;
    assert_eq!(asked(&bed), None);
    for source in [AUTOPILOT, SECOND] {
        bed.send_heartbeat(source, Ready);
    }
    assert!(bed.send_attitude(SECOND));
    assert_eq!(asked(&bed), Some(SECOND));
    bed.ms += 60_000;
    assert_eq!(asked(&bed), Some(SECOND), "it keeps its place");
    bed.send_heartbeat(AUTOPILOT, Ready);
    assert!(bed.send_attitude(AUTOPILOT));
    assert_eq!(asked(&bed), Some(AUTOPILOT));
    // A first sender without heartbeats is not queried.
    let mut bed = TestSenders::new();
    assert!(bed.send_attitude(GIMBAL));
    assert_eq!(asked(&bed), None);
}

#[test]
fn armed_is_the_last_state_of_the_selected_autopilot() {
    let mut bed = TestSenders::new();
    bed.send_heartbeat(AUTOPILOT, Armed);
    assert!(!bed.is_armed(), "nobody is chosen yet");
    assert!(bed.send_attitude(AUTOPILOT) && bed.is_armed());
    bed.send_heartbeat(SECOND, Ready);
    bed.send_heartbeat(GIMBAL, Other);
    assert!(bed.is_armed());
    bed.send_heartbeat(AUTOPILOT, Ready);
    bed.send_heartbeat(SECOND, Armed);
    assert!(!bed.is_armed());
    // A first sender without a heartbeat.
    let mut bed = TestSenders::new();
    assert!(bed.send_attitude(AUTOPILOT) && !bed.is_armed());
}

/// Neither continuing attitude nor its loss changes the expiry.
#[test]
fn armed_is_forgotten_after_ten_seconds_without_a_heartbeat() {
    for attitude_ends_ms in [0, 20_000] {
        let mut bed = TestSenders::new();
        bed.send_heartbeat(AUTOPILOT, Armed);
        for ms in (0..=10_000).step_by(100) {
            assert!(ms > attitude_ends_ms || bed.send_attitude(AUTOPILOT));
            assert!(bed.is_armed(), "{ms}");
            bed.ms += 100;
        }
        bed.ms -= 99;
        assert!(!bed.is_armed());
    }
}

/// 20 forged autopilot heartbeats between any two frames of the real autopilot, before and after its selection.
#[test]
fn a_flood_of_heartbeats_does_not_displace_the_autopilot() {
    let mut bed = TestSenders::new();
    let mut taken = 0;
    for tick in 0..600_u16 {
        for forged in 0..20 {
            bed.send_heartbeat(SenderId::new(0x4000 + (tick % 50) * 20 + forged), Ready);
        }
        // Its first heartbeat comes after a second of attitude.
        if tick % 20 == 19 {
            bed.send_heartbeat(AUTOPILOT, Armed);
        }
        taken += u16::from(bed.send_attitude(AUTOPILOT));
        assert_eq!(bed.is_armed(), tick >= 19);
        bed.ms += 50;
    }
    assert_eq!(taken, 600 - 19);
}

/// The selected sender was received first and longest ago.
#[test]
fn the_selected_sender_is_never_evicted() {
    let mut bed = TestSenders::new();
    bed.send_heartbeat(AUTOPILOT, Armed);
    assert!(bed.send_attitude(AUTOPILOT));
    for other in 0..20 {
        bed.ms += 100;
        bed.send_heartbeat(SenderId::new(other), Ready);
        assert!(!bed.send_attitude(SenderId::new(other)));
    }
    assert!(bed.is_armed() && bed.send_attitude(AUTOPILOT));
    assert_eq!(bed.senders.entries.len(), MAX_SENDERS);
}

/// Of equal rank, the sender received longest ago is removed.
#[test]
fn the_oldest_sender_is_evicted() {
    let mut bed = TestSenders::new();
    for other in 0..7 {
        bed.send_heartbeat(SenderId::new(other), Other);
        bed.ms += 1;
    }
    bed.send_heartbeat(GIMBAL, Other);
    for other in 0..7 {
        bed.ms += 1;
        bed.send_heartbeat(SenderId::new(100 + other), Other);
    }
    assert!(!bed.send_attitude(GIMBAL));
    for other in 0..7 {
        assert!(bed.senders.heartbeat(bed.now(), SenderId::new(other)).is_none(), "{other}");
    }
}
