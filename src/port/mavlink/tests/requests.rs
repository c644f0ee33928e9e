//! Times and ends of requests, both sides of each limit. Complete sequences are tested with simulated autopilots.

use super::*;

const ACCEPTED: u8 = 0;
const DENIED: u8 = 2;
const IN_PROGRESS: u8 = 5;

/// Requests: time, milliseconds, message and rate, Hz. Message 66 is the stream that contains ATTITUDE.
fn asked(bed: &MavlinkBench) -> Vec<(u64, u32, u32)> {
    let request = |sent: &Sent| match sent.id {
        76 => {
            assert_eq!(sent.payload[28..33], [0xFF, 1, 1, 1, 0], "511, to the autopilot");
            Some((sent.ms - 3_600_000, sent.float(0) as u32, (1e6 / sent.float(4)).round() as u32))
        }
        66 => Some((sent.ms - 3_600_000, 66, sent.payload[0].into())),
        _ => None,
    };
    bed.sent.iter().filter_map(request).collect()
}

fn answer(bed: &mut MavlinkBench, who: Who, target: Who, command: u16, result: u8) {
    let mut payload = command.to_le_bytes().to_vec();
    payload.extend([result, 0, 0, 0, 0, 0, target[0], target[1]]);
    bed.hear(&frame(who, 77, 143, &payload));
}

/// Sends attitude with this period for this time, milliseconds.
fn attitudes(bed: &mut MavlinkBench, period_ms: u64, ms: u64) {
    for _ in 0..ms / 10 {
        if bed.ms.is_multiple_of(period_ms) {
            let boot_ms = bed.ms as u32;
            bed.hear(&attitude(AUTOPILOT, boot_ms));
        }
        bed.run(10);
    }
}

#[test]
fn the_first_second_is_spent_looking() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.run(1_000);
    assert_eq!(asked(&bed), []);
    bed.run(10);
    assert_eq!(asked(&bed), [(1_000, 30, 40)]);
}

/// 32 of 40 reports a second suffice, 31 do not.
#[test]
fn four_fifths_of_what_was_asked_for_is_enough() {
    for (number, enough) in [(32, true), (31, false)] {
        let mut bed = MavlinkBench::new();
        bed.hear(&heartbeat(AUTOPILOT, true, false));
        bed.run(10);
        for _ in 0..number {
            bed.hear(&attitude(AUTOPILOT, 0));
        }
        bed.run(1_000);
        assert_eq!(asked(&bed), [if enough { (1_000, 1, 10) } else { (1_000, 30, 40) }]);
    }
}

/// The next request follows a second after the denied one.
#[test]
fn a_denial_counts_from_the_autopilot_and_to_the_module_or_to_all() {
    let own = [1, 158];
    for (who, target, command, result, counts) in [
        (AUTOPILOT, own, 511, DENIED, true),
        (AUTOPILOT, [0, 0], 511, DENIED, true),
        (AUTOPILOT, [1, 0], 511, 1, true),
        (AUTOPILOT, own, 511, 200, true),
        (AUTOPILOT, own, 511, IN_PROGRESS, false),
        (AUTOPILOT, own, 512, DENIED, false),
        (AUTOPILOT, [1, 157], 511, DENIED, false),
        (AUTOPILOT, [2, 158], 511, DENIED, false),
        (GIMBAL, own, 511, DENIED, false),
        (SECOND, own, 511, DENIED, false),
    ] {
        let mut bed = MavlinkBench::beside_an_autopilot();
        bed.run(1_200);
        answer(&mut bed, who, target, command, result);
        bed.run(800);
        assert_eq!(asked(&bed).len(), 1);
        bed.run(10);
        let next = if counts { (2_000, 30, 25) } else { (2_000, 30, 40) };
        assert_eq!(asked(&bed)[1..], [next], "{who:?} {target:?} {command} {result}");
    }
}

/// The messages must arrive within a second of the acceptance; earlier ones do not count.
#[test]
fn what_is_granted_has_to_come() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.run(1_010);
    attitudes(&mut bed, 20, 500);
    answer(&mut bed, AUTOPILOT, [1, 158], 511, ACCEPTED);
    attitudes(&mut bed, 50, 990);
    assert_eq!(asked(&bed).len(), 1);
    bed.run(30);
    assert_eq!(asked(&bed)[1..], [(2_510, 30, 40)], "20 Hz is not 40: once more");
    answer(&mut bed, AUTOPILOT, [1, 158], 511, ACCEPTED);
    attitudes(&mut bed, 20, 1_100);
    assert_eq!(asked(&bed)[2..], [(3_530, 1, 10)]);
}

/// Each rate twice, then a lower one.
#[test]
fn what_is_not_answered_is_asked_for_twice() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.run(5_010);
    let expected = [(1_000, 30, 40), (2_000, 30, 40), (3_000, 30, 25), (4_000, 30, 25), (5_000, 30, 20)];
    assert_eq!(asked(&bed), expected);
}

/// The setting limits the first rate; a change of it repeats all requests.
#[test]
fn the_highest_attitude_rate_is_a_setting() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.settings.attitude_rate_hz = 50;
    bed.run(3_010);
    assert_eq!(asked(&bed), [(1_000, 30, 50), (2_000, 30, 50), (3_000, 30, 40)]);
    bed.settings.attitude_rate_hz = 24;
    bed.run(1_020);
    assert_eq!(asked(&bed)[3..], [(4_010, 30, 20)]);
}

#[test]
fn an_answer_to_no_question_is_no_answer() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.run(500);
    answer(&mut bed, AUTOPILOT, [1, 158], 511, DENIED);
    bed.run(600);
    assert_eq!(asked(&bed), [(1_000, 30, 40)]);
    answer(&mut bed, AUTOPILOT, [1, 158], 511, DENIED);
    answer(&mut bed, AUTOPILOT, [1, 158], 511, DENIED);
    bed.run(1_000);
    assert_eq!(asked(&bed)[1..], [(2_000, 30, 25)]);
}

/// Module with granted requests: attitude at 50 Hz and three other messages.
fn content() -> MavlinkBench {
    let mut bed = MavlinkBench::beside_an_autopilot();
    for _ in 0..4 {
        attitudes(&mut bed, 20, 1_050);
        answer(&mut bed, AUTOPILOT, [1, 158], 511, ACCEPTED);
    }
    assert_eq!(asked(&bed).iter().map(|&(_, id, _)| id).collect::<Vec<_>>(), [1, 33, 2]);
    bed.sent.clear();
    bed
}

/// Two seconds, both sides.
#[test]
fn after_a_silence_it_asks_again() {
    let mut bed = content();
    let last = (bed.ms - 10) / 20 * 20;
    bed.run(last + 2_010 - bed.ms);
    assert_eq!(asked(&bed), []);
    bed.run(10);
    assert_eq!(asked(&bed), [(last + 2_010 - 3_600_000, 30, 40)]);
}

/// A restart sets the clock back by more than a second; a late report does not.
#[test]
fn after_a_restart_it_looks_and_asks_again() {
    for (back_ms, restarts) in [(1_001, true), (1_000, false)] {
        let mut bed = content();
        let clock_ms = ((bed.ms - 10) / 20 * 20) as u32;
        bed.hear(&attitude(AUTOPILOT, clock_ms - back_ms));
        bed.run(1_500);
        assert_eq!(!asked(&bed).is_empty(), restarts, "{back_ms}");
    }
    // A clock that is always zero indicates no restart.
    let mut bed = MavlinkBench::beside_an_autopilot();
    for _ in 0..500 {
        bed.hear(&attitude(AUTOPILOT, 0));
        bed.run(20);
    }
    assert!(asked(&bed).iter().all(|&(_, id, _)| id != 30), "{:?}", asked(&bed));
}

#[test]
fn another_autopilot_is_asked_anew_and_not_at_once() {
    let mut bed = content();
    bed.ms += 10_001;
    // Its clock is equal; only the address differs.
    let clock_ms = bed.ms as u32;
    bed.hear(&[heartbeat([9, 1], true, false), attitude([9, 1], clock_ms)].concat());
    bed.run(1_000);
    assert_eq!(bed.sent.iter().filter(|sent| sent.id == 76).count(), 0);
    bed.run(10);
    let requests = bed.take(76);
    assert_eq!(requests.len(), 1);
    assert_eq!((requests[0].from, &requests[0].payload[30..32]), ([9, 158], &[9, 1][..]));
}

#[test]
fn a_request_that_does_not_fit_is_not_counted() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.room = Some(0);
    bed.run(10_000);
    bed.room = None;
    bed.run(10);
    assert_eq!(asked(&bed), [(10_000, 30, 40)]);
}
