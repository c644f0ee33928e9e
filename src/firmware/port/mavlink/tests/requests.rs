//! Times and ends of requests. Complete sequences are tested with simulated autopilots.

use super::*;

/// Requests: time, milliseconds, message and rate, Hz. Message 66 is the stream that contains ATTITUDE.
fn sent_requests(bench: &MavlinkBench) -> Vec<(u64, u32, u32)> {
    let request = |sent: &SentMessage| match sent.message_id {
        76 => {
            assert_eq!(sent.payload[28..33], [0xFF, 1, 1, 1, 0], "511, to the autopilot");
            Some((sent.sent_at_ms - 3_600_000, sent.float_at(0) as u32, (1e6 / sent.float_at(4)).round() as u32))
        }
        66 => Some((sent.sent_at_ms - 3_600_000, 66, sent.payload[0].into())),
        _ => None,
    };
    bench.sent_messages.iter().filter_map(request).collect()
}

fn send_acknowledgement(
    bench: &mut MavlinkBench,
    sender: MavlinkAddress,
    target: MavlinkAddress,
    command: u16,
    result: u8,
) {
    let mut payload = command.to_le_bytes().to_vec();
    payload.extend([result, 0, 0, 0, 0, 0, target[0], target[1]]);
    bench.receive(&mavlink_v2_frame(sender, 77, 143, &payload));
}

/// Sends attitude with this period for this time, milliseconds.
fn send_attitudes(bench: &mut MavlinkBench, period_ms: u64, ms: u64) {
    for _ in 0..ms / 10 {
        if bench.now_ms.is_multiple_of(period_ms) {
            let boot_ms = bench.now_ms as u32;
            bench.receive(&attitude_frame(AUTOPILOT, boot_ms));
        }
        bench.run_ms(10);
    }
}

/// The next request follows a second after the denied one.
#[test]
fn only_the_autopilot_s_denial_to_the_module_or_to_all_counts() {
    let module_address = [1, 158];
    for (sender, target, command, result, counts) in [
        (AUTOPILOT, module_address, 511, DENIED, true),
        (AUTOPILOT, [0, 0], 511, DENIED, true),
        (AUTOPILOT, [1, 0], 511, 1, true),
        (AUTOPILOT, module_address, 511, 200, true),
        (AUTOPILOT, module_address, 511, IN_PROGRESS, false),
        (AUTOPILOT, module_address, 512, DENIED, false),
        (AUTOPILOT, [1, 157], 511, DENIED, false),
        (AUTOPILOT, [2, 158], 511, DENIED, false),
        (GIMBAL, module_address, 511, DENIED, false),
        (SECOND_AUTOPILOT, module_address, 511, DENIED, false),
    ] {
        let mut bench = MavlinkBench::with_autopilot();
        bench.run_ms(1_200);
        send_acknowledgement(&mut bench, sender, target, command, result);
        bench.run_ms(800);
        assert_eq!(sent_requests(&bench).len(), 1);
        bench.run_ms(10);
        let next = if counts { (2_000, 30, 25) } else { (2_000, 30, 40) };
        assert_eq!(sent_requests(&bench)[1..], [next], "{sender:?} {target:?} {command} {result}");
    }
}

/// The setting limits the first rate; a change of it repeats all requests.
#[test]
fn each_rate_up_to_the_setting_is_requested_twice_without_an_answer() {
    let mut bench = MavlinkBench::with_autopilot();
    bench.run_ms(5_010);
    let expected = [(1_000, 30, 40), (2_000, 30, 40), (3_000, 30, 25), (4_000, 30, 25), (5_000, 30, 20)];
    assert_eq!(sent_requests(&bench), expected);
    for (rate_hz, requested_at_ms, requested_hz) in [(50, 6_010, 50), (24, 7_020, 20)] {
        bench.settings.attitude_rate_hz = rate_hz;
        bench.run_ms(1_010);
        assert_eq!(sent_requests(&bench).last(), Some(&(requested_at_ms, 30, requested_hz)));
    }
}

/// Module with granted requests: attitude at 50 Hz and three other messages.
fn bench_with_granted_requests() -> MavlinkBench {
    let mut bench = MavlinkBench::with_autopilot();
    for _ in 0..4 {
        send_attitudes(&mut bench, 20, 1_050);
        send_acknowledgement(&mut bench, AUTOPILOT, [1, 158], 511, ACCEPTED);
    }
    assert_eq!(sent_requests(&bench).iter().map(|&(_, id, _)| id).collect::<Vec<_>>(), [1, 33, 2]);
    bench.sent_messages.clear();
    bench
}

/// A step back of the autopilot's clock by seconds is a restart; half a second is the order of reports on the line. A
/// clock that is always zero indicates no restart.
#[test]
fn attitude_is_requested_again_after_an_autopilot_restart() {
    for (back_ms, restarts) in [(3_000, true), (500, false)] {
        let mut bench = bench_with_granted_requests();
        let clock_ms = bench.now_ms as u32;
        bench.receive(&attitude_frame(AUTOPILOT, clock_ms - back_ms));
        bench.run_ms(1_500);
        assert_eq!(!sent_requests(&bench).is_empty(), restarts, "{back_ms}");
    }
    let mut bench = MavlinkBench::with_autopilot();
    for _ in 0..500 {
        bench.receive(&attitude_frame(AUTOPILOT, 0));
        bench.run_ms(20);
    }
    assert!(sent_requests(&bench).iter().all(|&(_, id, _)| id != 30), "{:?}", sent_requests(&bench));
}
